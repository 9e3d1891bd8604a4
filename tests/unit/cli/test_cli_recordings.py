"""The commands about recordings on files: cat, cut, merge, recover, info of several."""

import csv
import io
import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core import codec
from bridge.core.catalog import Catalog
from bridge.core.events import AnyEvent, Severity
from bridge.core.tmc_writer import write_classes
from bridge.edges.class_files import load_catalog
from bridge.edges.recording import Attachment, RecordingWriter, StateFrame, Viewer, carried, summary
from tests.unit.edges.recording_stories import ABOUT, ALARM, GAP, PUMP, START, STATE, cleared, message, raised, record


def write(path: Path, events: list[AnyEvent], *, states: tuple[StateFrame, ...] = (STATE,), gap: bool = False) -> Path:
    """A recording: an event each second."""
    with RecordingWriter(path, about=ABOUT) as writer:
        for state in states:
            writer.add_state(state, START)
        for number, event in enumerate(events):
            record(writer, event, START + 1_000_000_000 * (number + 1), (codec.JSON, codec.MSGPACK)[number % 2])
            writer.flush()
        if gap:
            writer.add_gap(GAP, START + 1_000_000_000 * len(events) + 1)
    return path


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A recording of six seconds with a gap at its end."""
    monkeypatch.chdir(tmp_path)
    events: list[AnyEvent] = [message(21), raised(30), message(23, PUMP), cleared(30), message(25, PUMP), raised(40)]
    write(tmp_path / "plant.mcap", events, gap=True)
    return "plant.mcap"


def objects(capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    """What was printed as JSON Lines."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_cat_prints_what_stands_there(plant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Keyframe, events, gap, in their order."""
    assert run(["cat", plant]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8
    assert "keyframe: plc1 has 1 alarms, 1 of them active" in lines[0]
    assert "raised" in lines[2]
    assert "gap: 7 events of session s1" in lines[-1]


def test_cat_as_json_has_the_names_of_the_wire(plant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With the time of recording, and notices that say what they are."""
    assert run(["cat", plant, "--json"]) == Exit.OK
    found = objects(capsys)
    assert [each.get("notice", each.get("kind")) for each in found] == [
        "keyframe",
        "message_sent",
        "alarm_raised",
        "message_sent",
        "alarm_cleared",
        "message_sent",
        "alarm_raised",
        "gap",
    ]
    assert found[1]["event_id"] == 21
    assert found[1]["realm"] == "live"
    assert found[1]["log_time_ns"] == START + 1_000_000_000


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ("--start 3", [23, 30, 25, 40]),
        ("--start 3 --duration 2", [23, 30]),
        ("--end 2.5", [21, 30]),
        ("--start 2027-01-15T08:00:05Z", [25, 40]),
        ("--filter is_alarm", [30, 30, 40]),
        ("--target plc2", []),
        (f"--filter event_class='{PUMP}'", [23, 25]),
    ],
)
def test_a_part_is_chosen_by_time_target_and_filter(
    plant: str, capsys: pytest.CaptureFixture[str], options: str, wanted: list[int]
) -> None:
    """Seconds from the start, or a time of recording."""
    assert run(["cat", plant, "--json", *options.split()]) == Exit.OK
    assert [each["event_id"] for each in objects(capsys) if "kind" in each] == wanted


@pytest.mark.parametrize(
    "options",
    [
        *("--start 3 --end 2", "--duration 0", "--end 2 --duration 1", "--start soon", "--filter x=", "--start -1"),
        *("--start 3600", "--start 2027-01-16T00:00:00Z", "--start 2020-01-01T00:00:00Z --end 2020-01-02T00:00:00Z"),
    ],
)
def test_a_part_that_makes_no_sense_is_refused(plant: str, options: str) -> None:
    """As wrong usage."""
    assert run(["cat", plant, *options.split()]) == Exit.USAGE


def test_cat_as_csv_is_the_events_alone(plant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """In the columns of the log, but for its numbers."""
    assert run(["cat", plant, "--csv"]) == Exit.OK
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out), delimiter=";"))
    assert [row["Event Id"] for row in rows] == ["21", "30", "23", "30", "25", "40"]
    assert "Unique Id" not in rows[0]


def test_several_files_and_folders_are_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each event once, in order of time; what is no recording is refused before anything is printed."""
    write(tmp_path / "b.mcap", [message(21), raised(30), message(23)], states=())
    write(tmp_path / "a.mcap", [message(21), raised(30)], states=())
    assert run(["cat", str(tmp_path), str(tmp_path / "a.mcap"), "--json"]) == Exit.OK
    assert [each["event_id"] for each in objects(capsys)] == [21, 30, 23]
    (tmp_path / "c.mcap").write_bytes(b"no recording")
    assert run(["cat", str(tmp_path)]) == Exit.NO
    assert capsys.readouterr().out == ""
    assert run(["cat", str(tmp_path / "none.mcap")]) == Exit.USAGE
    (tmp_path / "empty").mkdir()
    assert run(["cat", str(tmp_path / "empty")]) == Exit.USAGE


def test_a_damaged_file_is_printed_as_far_as_it_goes_and_named(plant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With the exit code for loss."""
    data = Path(plant).read_bytes()
    Path(plant).write_bytes(data[: len(data) * 2 // 3])
    assert run(["cat", plant]) == Exit.LOST
    found = capsys.readouterr()
    assert found.out.count("\n") >= 2
    assert "plant.mcap: damaged at byte" in found.err


def test_a_file_that_is_being_written_is_not_called_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Everybody who reads it says that it is not finished; the doctor finds no fault in that."""
    with RecordingWriter(tmp_path / "plant.mcap", about=ABOUT) as writer:
        writer.add_state(STATE, START)
        record(writer, raised(30), START + 1)
        writer.flush()
        active = str(tmp_path / "plant.mcap.active")
        said = "not finished: it is being written, or was left by a crash"
        for command, code in (("cat", Exit.LOST), ("info", Exit.NO), ("doctor", Exit.OK)):
            assert run([command, active]) == code
            found = capsys.readouterr()
            assert said in found.out + found.err
            assert "damage" not in found.out + found.err


def test_texts_come_from_the_classes_that_a_recording_carries(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without any class file."""
    known = load_catalog([Path(__file__).parents[3] / "examples" / "plant.tmc"])[0]
    found = next(iter(known))
    event = message(next(iter(found.events)), found.guid)
    with RecordingWriter(tmp_path / "a.mcap", attachments=[Attachment("plant.tmc", write_classes([found]))]) as writer:
        record(writer, event, START)
    assert run(["cat", str(tmp_path / "a.mcap")]) == Exit.OK
    assert "Production line 1: Stroke" in capsys.readouterr().out


def test_a_cut_says_what_it_holds(plant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The alarms of its start are in its keyframe; what exists is not overwritten."""
    assert run(["cut", plant, "part.mcap", "--start", "3", "--json"]) == Exit.OK
    (told,) = objects(capsys)
    assert (told["events"], told["missing"], told["complete"], told["keyframes"]) == (4, 7, "no", 1)
    active = summary("part.mcap").totals.active_at_start.named
    assert [alarm.event_id for alarm in active] == [ALARM.event_id, 30]
    assert run(["cut", plant, "part.mcap", "--start", "3"]) == Exit.NO
    assert "exists" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line", ["cut plant.mcap new.mcap", "cut plant.mcap", "cut plant.mcap new.txt --start 1", "merge plant.mcap"]
)
def test_a_cut_or_merge_that_makes_no_sense_is_refused(plant: str, tmp_path: Path, line: str) -> None:
    """Nothing to cut, no new name, a name that is none."""
    assert run(line.split()) == Exit.USAGE
    assert [path.name for path in tmp_path.iterdir()] == ["plant.mcap"]


def test_a_log_for_viewers_keeps_its_language(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Made anew for the part, in the language that it had, unless another is asked for."""
    monkeypatch.chdir(tmp_path)
    with RecordingWriter("a.mcap", viewer=Viewer(lambda event: Catalog(), "de")) as writer:
        record(writer, message(1), START)
        record(writer, message(2), START + 5_000_000_000)
    assert run(["cut", "a.mcap", "b.mcap", "--start", "1"]) == Exit.OK
    assert run(["merge", "a.mcap", "c.mcap", "--lang", "fr"]) == Exit.OK
    assert [carried(name).language for name in ("a.mcap", "b.mcap", "c.mcap")] == ["de-DE", "de-DE", "fr-FR"]


def test_merging_fills_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Said in words, and as numbers for programs."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "a.mcap", [message(1)], gap=True)
    found = [message(number - 1) for number in range(3, 9)]
    write(tmp_path / "b.mcap", [replace(event, severity=Severity.INFO) for event in found])
    assert run(["merge", "a.mcap", "b.mcap", "c.mcap"]) == Exit.OK
    assert "merged 7 events into c.mcap; 6 that one file missed came from another; 1 are missing" in capsys.readouterr().out


def test_what_a_crash_left_is_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By name, or all of a folder; a damaged file only to another name."""
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        writer = RecordingWriter(tmp_path / f"{name}.mcap")
        record(writer, message(1), START)
        writer.flush()
        writer.abandon()
    assert run(["recover", "a.mcap.active"]) == Exit.OK
    assert run(["recover", "."]) == Exit.OK
    assert run(["recover", "."]) == Exit.OK
    assert "nothing to recover" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "b.mcap"]
    data = Path("a.mcap").read_bytes()
    Path("a.mcap").write_bytes(data[: len(data) // 2])
    assert run(["recover", "a.mcap"]) == Exit.USAGE
    capsys.readouterr()
    assert run(["recover", "a.mcap", "--to", "c.mcap", "--json"]) in (Exit.OK, Exit.LOST)
    (told,) = objects(capsys)
    assert (told["recovered"], told["kept"]) == ("c.mcap", "a.mcap")
    assert Path("a.mcap").read_bytes() == data[: len(data) // 2]


def test_info_names_gaps_and_active_alarms(plant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """At the start those of the keyframe, at the end what is left of all."""
    assert run(["info", plant]) == Exit.NO
    out = capsys.readouterr().out
    assert "complete   no: 1 gaps, 7 events are missing" in out
    assert "3..9" in out
    start, end = out.split("1 alarms active at the start")[1].split("2 alarms active at the end")
    assert "#7" in start
    assert "#40" in end
    assert "#30" not in end


def test_info_tells_what_a_file_carries(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its neighbours, what else its recorder noted, each attachment with its size, and further metadata."""
    about = replace(ABOUT, part=2, recording="r1", previous="n1.mcap", more={"trigger": "severity = critical"})
    with RecordingWriter(tmp_path / "n2.mcap", about=about, attachments=[Attachment("notes.txt", b"12345")]) as writer:
        writer.add_metadata("shift", {"crew": "night", "line": "4"})
        writer.finish(next_file="n3.mcap")
    assert run(["info", str(tmp_path / "n2.mcap")]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith(("previous", "next", "trigger", "shift"))] == [
        "previous   n1.mcap",
        "next       n3.mcap",
        "trigger    severity = critical",
        "shift      crew night, line 4",
    ]
    (attached,) = [line for line in lines if line.startswith("attached")]
    assert attached.endswith("notes.txt (5 bytes)")


def test_info_of_several_files_is_of_all_and_names_a_missing_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each file has a line; the counts are those of all."""
    for part in (1, 2, 4):
        with RecordingWriter(tmp_path / f"{part}.mcap", about=replace(ABOUT, recording="night", part=part)) as writer:
            record(writer, message(part), START + part)
    assert run(["info", str(tmp_path)]) == Exit.NO
    out = capsys.readouterr().out
    assert out.count(".mcap") == 3
    assert "events     3" in out
    assert "missing    part 3 of recording night" in out
    (tmp_path / "1.mcap").unlink()
    (tmp_path / "2.mcap").unlink()
    assert run(["info", str(tmp_path), "--json"]) == Exit.OK
    assert [each["complete"] for each in objects(capsys)] == ["yes"]


def test_the_doctor_says_what_is_wrong(plant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing, remarks, faults; the exit code is that of faults."""
    assert run(["doctor", plant]) == Exit.NO  # its numbers have holes that no gap record explains
    assert run(["cut", plant, "part.mcap", "--filter", "event_id < 22"]) == Exit.OK
    capsys.readouterr()
    assert run(["doctor", "part.mcap"]) == Exit.OK
    out = capsys.readouterr().out
    assert "part.mcap: nothing wrong" in out
    assert "remark: missing numbers were not looked for" in out
    Path("part.mcap").write_bytes(Path("part.mcap").read_bytes()[:-9])
    assert run(["doctor", "part.mcap", "--json"]) == Exit.NO
    assert [each["fault"] for each in objects(capsys)].count(True) == 1


@pytest.mark.parametrize(
    "options",
    [
        "",
        "--view occurrences --oldest-first --lossless",
        "--only alarms --sort source_name --limit 2",
        "--format jsonl --filter severity>=error --lang de",
        "--column time --column event_text=Text --column /axis=Axis --delimiter tab --no-header",
    ],
)
def test_the_export_of_a_recording_is_that_of_the_logger_it_makes(
    plant: str, capsys: pytest.CaptureFixture[str], options: str
) -> None:
    """The same as replaying it into a cache and exporting that, in every view, form and order."""
    assert run(["replay", plant, "--into", "fresh.db"]) == Exit.LOST  # it has a gap
    capsys.readouterr()
    assert run(["log", "export", "--cache", "fresh.db", *options.split()]) == Exit.OK
    wanted = capsys.readouterr().out
    assert run(["export", plant, *options.split()]) == Exit.OK
    found = capsys.readouterr()
    assert found.out == wanted
    assert len(found.out.splitlines()) >= 2
    assert "7 events are missing in 1 gaps" in found.err


def test_an_export_goes_into_a_file_that_is_whole(plant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its suffix says the form; a part of the time can be chosen; a damaged recording is told."""
    assert run(["export", plant, "--to", "all.jsonl", "--start", "3"]) == Exit.OK
    assert [json.loads(line)["event_id"] for line in Path("all.jsonl").read_text().splitlines()] == [40, 25, 30, 23]
    data = Path(plant).read_bytes()
    Path(plant).write_bytes(data[: len(data) * 2 // 3])
    assert run(["export", plant, "--to", "all.csv"]) == Exit.LOST
    assert "ends before its end" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.csv", "all.jsonl", "plant.mcap"]


@pytest.mark.parametrize("line", ["cut a.mcap new.mcap --start 1", "merge a.mcap b.mcap new.mcap"])
def test_a_new_recording_has_the_log_for_viewers_when_an_old_one_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    """A line for each event in it, also for those of a file without."""
    monkeypatch.chdir(tmp_path)
    catalog = load_catalog([])[0]
    with RecordingWriter(tmp_path / "a.mcap", viewer=Viewer(lambda event: catalog)) as writer:
        for number in range(4):
            record(writer, message(number), START + 1_000_000_000 * number)
    write(tmp_path / "b.mcap", [message(7), message(8)])
    assert run(line.split()) == Exit.OK
    counts = {channel.topic: channel.messages for channel in summary("new.mcap").channels}
    assert counts["/log"] == summary("new.mcap").totals.events in (3, 6)
