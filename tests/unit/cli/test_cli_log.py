"""The commands about the log on a cache file: shown, exported, cleared."""

import json
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core.csv_export import import_csv, import_jsonl, read_csv
from bridge.core.events import Severity
from bridge.edges.cache import Cache, StoreBatch, Stored
from bridge.testing.builders import TIME_NS, alarm_cleared, alarm_raised, message_sent
from tests.unit.edges.cache_stories import alarm


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A file with an alarm life and two messages."""
    monkeypatch.chdir(tmp_path)
    events = (
        (1, alarm_raised(seq=1, severity=Severity.ERROR, source_name="=pump")),
        (2, message_sent(seq=2, severity=Severity.VERBOSE, source_name="b", json_attribute='{"axis": 3}')),
        (1, alarm_cleared(seq=3, severity=Severity.ERROR, source_name="=pump", time_ns=TIME_NS + 2_500_000_000)),
        (3, message_sent(seq=4, severity=Severity.WARNING, source_name="a")),
    )
    with Cache(tmp_path / "log.db") as made:
        made.append(StoreBatch([Stored(number, TIME_NS, event) for number, event in events], (alarm(1),)))
        made.flush()
    return str(tmp_path / "log.db")


def seqs(capsys: pytest.CaptureFixture[str], *options: str) -> list[int]:
    """The numbers of the events that log prints."""
    assert run(["log", *options, "--json"]) == Exit.OK
    return [json.loads(line)["seq"] for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ("", [4, 3, 2, 1]),
        ("--only messages", [4, 2]),
        ("--only alarms --oldest-first", [1, 3]),
        ("--min-severity warning", [4, 3, 1]),
        ("--view occurrences", [4, 3, 2]),
        ("--sort source_name --oldest-first", [1, 3, 4, 2]),
        ("--sort event_text --limit 1 --last", [1]),
        ("--limit 2 --offset 1", [3, 2]),
        ("--limit 1 --last --offset 1", [2]),
        ("--filter is_raised --only alarms", [1]),
    ],
)
def test_what_is_shown(cache: str, capsys: pytest.CaptureFixture[str], options: str, wanted: list[int]) -> None:
    """Selected, sorted, in either view."""
    assert seqs(capsys, "--cache", cache, *options.split()) == wanted


def test_a_cache_without_texts_says_what_gives_them(cache: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A cache holds no event classes: GUIDs in a table come with a hint on stderr, and not when a class file knows them."""
    assert run(["log", "--cache", cache]) == Exit.OK
    assert capsys.readouterr().err == (
        "an event class is unknown, a cache holds none; for texts name the class files with --classes\n"
    )
    guid = message_sent().event_class
    (tmp_path / "a.toml").write_text(
        f'[[classes]]\nname = "A"\nguid = "{guid}"\n[[classes.events]]\nid = 1\n'
        'name = "B"\nseverity = "info"\ndisplay_text = "b"\n',
        encoding="utf-8",
    )
    assert run(["log", "--cache", cache, "--classes", "a.toml"]) == Exit.OK
    assert capsys.readouterr().err == ""


def test_occurrences_have_a_state_and_a_duration(cache: str, capsys: pytest.CaptureFixture[str]) -> None:
    """For people too."""
    assert run(["log", "--cache", cache, "--view", "occurrences"]) == Exit.OK
    out = capsys.readouterr().out
    assert "Inactive(Cleared)" in out
    assert "2.500 s" in out


def test_an_export_is_what_is_shown(cache: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The same rows as a table for spreadsheets, on stdout; and whole, to a file, in both formats."""
    columns = ["--column", "source_name=Where", "--column", "/axis", "--column", "time=When"]
    options = ["--cache", cache, "--oldest-first", "--time-format", "custom", "--time-pattern", "%H:%M"]
    assert run(["log", "export", *options, *columns, "--delimiter", "tab"]) == Exit.OK
    assert capsys.readouterr().out == (
        "Where\t/axis\tWhen\r\n'=pump\t\t08:00\r\nb\t3\t08:00\r\n'=pump\t\t08:00\r\na\t\t08:00\r\n"
    )
    assert run(["log", "export", "all.csv", "--cache", cache, "--lossless", "--bom"]) == Exit.OK
    assert run(["log", "export", "all.jsonl", "--cache", cache]) == Exit.OK
    with Cache(cache) as kept:
        stored = [(one.unique_id, one.arrival_ns, one.event) for one in kept.query()]
    for path, read in (("all.csv", import_csv), ("all.jsonl", import_jsonl)):
        with Path(path).open(encoding="utf-8", newline="") as file:
            assert [(one.unique_id, one.arrival_ns, one.event) for one in read(file)] == stored
    with Path("all.csv").open(encoding="utf-8", newline="") as file:
        assert next(read_csv(file))[0] == "Time"
    assert not list(Path().glob("*.part"))


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
@pytest.mark.parametrize("order", ["", "--oldest-first", "--sort source_name"])
def test_an_export_becomes_a_log_again(cache: str, suffix: str, order: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With unique ids, times and numbers, in the order of arrival; ids of the next logger are above them. No alarm is in it."""
    file = f"all.{suffix}"
    assert run(["log", "export", file, "--cache", cache, "--lossless", *order.split()]) == Exit.OK
    assert run(["log", "import", file, "--cache", "copy.db", "--json"]) == Exit.OK
    assert json.loads(capsys.readouterr().out) == {"imported": 4, "bad": 0, "duplicates": 0, "cache": "copy.db"}
    with Cache(cache) as kept, Cache("copy.db") as copy:
        rows = [[(one.unique_id, one.arrival_ns, one.event) for one in each.query()] for each in (kept, copy)]
        assert rows[0] == rows[1] if "sort" not in order else sorted(rows[0], key=repr) == sorted(rows[1], key=repr)
        assert copy.load_alarms() == []
        assert copy.meta()["next_unique_id"] == "4"
    assert {each.name for each in Path().iterdir()} == {"log.db", "copy.db", file}
    assert run(["log", "import", file, "--cache", "copy.db"]) == Exit.NO
    assert "exists" in capsys.readouterr().err


def test_arrivals_decide_the_order(cache: str) -> None:
    """An export that was sorted by something else comes back as it arrived."""
    events = [message_sent(seq=number, session=f"s{number % 3}", source_name=f"{(number * 7) % 10}") for number in range(1, 11)]
    with Cache("mixed.db") as made:
        made.append(StoreBatch([Stored(number, TIME_NS + number, event) for number, event in enumerate(events, 1)]))
        made.flush()
    assert run(["log", "export", "mixed.jsonl", "--cache", "mixed.db", "--sort", "source_name"]) == Exit.OK
    assert run(["log", "import", "mixed.jsonl", "--cache", "copy.db"]) == Exit.OK
    with Cache("copy.db") as copy:
        assert [one.unique_id for one in copy.query(newest_first=False)] == list(range(1, 11))


def test_bad_rows_are_told_with_their_place(cache: str, capsys: pytest.CaptureFixture[str]) -> None:
    """File, line and reason, and how many; the rest is imported. Of nothing but bad rows no file is made."""
    assert run(["log", "export", "all.jsonl", "--cache", cache]) == Exit.OK
    good = Path("all.jsonl").read_text(encoding="utf-8").splitlines()
    Path("some.jsonl").write_text("\n".join([good[0], '{"kind": "nothing"}', good[1], good[1], "\x1b[2J"]), encoding="utf-8")
    capsys.readouterr()
    assert run(["log", "import", "some.jsonl", "--cache", "some.db"]) == Exit.LOST
    found = capsys.readouterr()
    assert found.out == "2 events imported into some.db, 1 were there twice, 2 bad rows\n"
    assert "some.jsonl:2: row 2: no event: " in found.err
    assert "some.jsonl:5: row 5: no event: " in found.err
    assert "\x1b" not in found.err
    Path("none.csv").write_text("Record\r\n" + "nothing\r\n" * 30, encoding="utf-8")
    assert run(["log", "import", "none.csv", "--cache", "none.db"]) == Exit.NO
    assert "row 22" not in (err := capsys.readouterr().err)
    assert "none of 30 rows is an event" in err
    Path("plain.csv").write_text("Time;Text\r\n1;2\r\n", encoding="utf-8")
    assert run(["log", "import", "plain.csv", "--cache", "none.db"]) == Exit.NO
    assert "plain.csv:1: row 1: the last column is not Record" in capsys.readouterr().err
    assert {each.suffix for each in Path().iterdir() if each.name.startswith(("none", "plain"))} == {".csv"}


@pytest.mark.parametrize(
    "options",
    ["--column nonsense", "--delimiter xx", "--time-format custom", "--extra-lang xx-YY", "--limit -1", "--column /a~"],
)
def test_wrong_usage_of_export(cache: str, options: str) -> None:
    """Code 2, and no file."""
    assert run(["log", "export", "out.csv", "--cache", cache, *options.split()]) in (Exit.USAGE, Exit.NO)
    assert not Path("out.csv").exists()


def test_clearing_asks(cache: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a person to ask it is refused; with --yes what is selected goes, and alarm states stay."""
    assert run(["log", "clear", "--cache", cache]) == Exit.USAGE
    assert "--yes" in capsys.readouterr().err
    assert run(["log", "clear", "--cache", cache, "--yes", "--only", "alarms", "--view", "occurrences"]) == Exit.OK
    assert capsys.readouterr().out == "2 events cleared\n"
    assert seqs(capsys, "--cache", cache) == [4, 2]
    assert run(["log", "clear", "--cache", cache, "--yes", "--json"]) == Exit.OK
    assert json.loads(capsys.readouterr().out) == {"cleared": 2}
    with Cache(cache) as kept:
        assert kept.load_alarms() == [alarm(1)]


@pytest.mark.parametrize(("said", "code", "left"), [("y\n", Exit.OK, 0), ("n\n", Exit.NO, 4), ("", Exit.NO, 4)])
def test_the_answer_counts(
    cache: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, said: str, code: Exit, left: int
) -> None:
    """Only yes is yes; nothing is no."""
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stdin.readline", lambda: said, raising=False)
    assert run(["log", "clear", "--cache", cache]) == code
    assert "Clear all events of the log of" in capsys.readouterr().err
    assert len(seqs(capsys, "--cache", cache)) == left
