"""The demo: the main job with real processes, and a comparison that finds one changed event."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from bridge.core import codec
from bridge.edges.recording import RecordedEvent, RecordingWriter, read_events

ROOT = Path(__file__).parents[2]


def tcbridge(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end."""
    environ = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "bridge.cli", *arguments]
    return subprocess.run(command, cwd=folder, env=environ, capture_output=True, encoding="utf-8", timeout=60)


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, "subprocess.CompletedProcess[str]", float]:
    """One run of the demo, kept."""
    folder = tmp_path_factory.mktemp("demo")
    started_s = time.monotonic()
    result = tcbridge(folder, "demo", "--keep", "kept")
    return folder, result, time.monotonic() - started_s


def test_the_replay_equals_what_was_live(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """It says so in its last lines, with how many events and alarms, and ends with 0 in less than 20 s."""
    _, result, seconds = demo
    assert (result.returncode, result.stderr) == (0, "")
    assert "\nreplay equals live: yes (31 events, 3 alarms)\n" in result.stdout
    assert seconds < 20


def test_listeners_print_what_their_filters_take(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """Readable lines, each with who heard it: faults from error on; the robot's third axis whatever it says."""
    lines = demo[1].stdout.splitlines()
    faults = [line for line in lines if line.startswith("faults     2")]
    robot = [line for line in lines if line.startswith("robot      2")]
    assert (len(faults), len(robot)) == (8, 7)
    assert all(" error " in line or " critical " in line for line in faults)
    assert all(line.endswith("[Line1.Robot.Axis3]") for line in robot)


def test_both_states_are_printed(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """The alarms of the live and of the fresh logger, as equal tables."""
    live = demo[1].stdout.split("alarms of the live logger\n")[1].split("\n\n")[0]
    fresh = demo[1].stdout.split("alarms of the fresh logger after the replay\n")[1].split("\n\n")[0]
    assert live == fresh
    assert len(live.splitlines()) == 4


def test_the_same_comparison_can_be_made_again(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """With what was kept, replay --against says yes."""
    again = tcbridge(demo[0], "replay", "kept/demo.mcap", "--against", "kept/live.json")
    assert (again.returncode, again.stdout.splitlines()[-1]) == (0, "replay equals live: yes (31 events, 3 alarms)")


def test_the_recording_is_readable_for_viewers(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """A line of text for each event, in words and without a GUID, and a span for each of the two alarms that ended."""
    found: dict[str, list[dict[str, object]]] = {"/log": [], "/alarms": []}
    with open(demo[0] / "kept" / "demo.mcap", "rb") as file:
        for _, channel, raw in make_reader(file).iter_messages(topics=list(found)):
            found[channel.topic].append(json.loads(raw.data))
    lines = [str(line["message"]) for line in found["/log"]]
    assert (len(lines), len(found["/alarms"])) == (31, 2)
    assert "confirmed by shift leader: Axis 3 lags 12.5 mm behind (seen)" in lines
    assert [line for line in lines if "#" in line] == []
    assert {line["name"] for line in found["/log"]} >= {"Line1.Press", "Line1.Cell", "Line1.Robot.Axis3"}


def test_one_changed_event_is_found(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """The comparison says no, names the difference, and ends with 1."""
    folder = demo[0]
    command = [sys.executable, str(ROOT / "examples" / "change_one_event.py"), "kept/demo.mcap", "changed.mcap"]
    environ = os.environ | {"PYTHONPATH": str(ROOT)}
    changed = subprocess.run(command, cwd=folder, env=environ, capture_output=True, encoding="utf-8", timeout=60, check=True)
    words = changed.stdout.split()
    result = tcbridge(folder, "replay", "changed.mcap", "--against", "kept/live.json")
    assert result.returncode == 1
    *_, difference, answer = result.stdout.splitlines()
    assert difference.strip().startswith(f"event {words[2]} of session {words[5]} of plant")
    assert difference.endswith('[{"type":21,"value":"changed"}] replayed')
    assert answer == "replay equals live: no (31 events, 3 alarms)"
    told = tcbridge(folder, "replay", "changed.mcap", "--against", "kept/live.json", "--json")
    last = json.loads(told.stdout.splitlines()[-1])
    assert (told.returncode, last["replay_equals_live"], len(last["differences"])) == (1, False, 1)


def test_nothing_that_is_kept_is_overwritten(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """A second demo into the same folder is refused."""
    assert tcbridge(demo[0], "demo", "--keep", "kept").returncode == 2


def test_no_process_stays(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """When the demo is over, nothing of it runs: no process has its realm in its command line."""
    realm = demo[1].stdout.split("realm ")[1].split(",")[0]
    left = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes()
        except OSError:
            continue
        if realm.encode() in line:
            left.append(line)
    assert left == []


def another_day(recording: Path, new: Path) -> None:
    """The same run a day later by another logger session, without the oil's alarm and with the door open for 5 s more."""
    day_ns, longer_ns = 86_400_000_000_000, 5_000_000_000
    with read_events(recording) as reader, RecordingWriter(new, about=reader.about) as writer:
        for item in reader:
            if not isinstance(item, RecordedEvent) or (item.event.is_alarm and item.event.event_id == 3):
                continue
            event = item.event
            more_ns = longer_ns if event.kind == "alarm_cleared" and event.event_id == 2 else 0
            times = {
                name: value + day_ns + (more_ns if name != "time_raised_ns" else 0)
                for name in ("time_ns", "time_raised_ns", "time_cleared_ns", "time_confirmed_ns")
                if (value := getattr(event, name))
            }
            event = msgspec.structs.replace(event, session=f"{event.session}-2", **times)
            writer.add(codec.encode(event), codec.JSON, item.key, event, item.log_time_ns + day_ns)


def test_two_runs_are_compared(demo: tuple[Path, "subprocess.CompletedProcess[str]", float]) -> None:
    """Of another run with one alarm removed and one lengthened, diff names exactly these; of the same nothing."""
    folder = demo[0]
    another_day(folder / "kept" / "demo.mcap", folder / "later.mcap")
    same = tcbridge(folder, "diff", "kept/demo.mcap", "kept")
    assert (same.returncode, same.stdout) == (0, "no difference\n")
    found = tcbridge(folder, "diff", "kept/demo.mcap", "later.mcap")
    assert (found.returncode, found.stderr) == (1, "")
    lines = [line.split() for line in found.stdout.splitlines()]
    assert [line[:2] for line in lines] == [["Alarm", "is"], ["longer", "5.000"], ["gone", "warning"]]
    told = [json.loads(line) for line in tcbridge(folder, "diff", "kept/demo.mcap", "later.mcap", "--json").stdout.splitlines()]
    assert [(each["what"], each["event_id"], each["by_ns"]) for each in told] == [("longer", 2, 5_000_000_000), ("gone", 3, 0)]
    assert [each["text"] for each in told] == ["Safety door north is open", "Oil has 68.5 °C, allowed are 60"]
    back = tcbridge(folder, "diff", "later.mcap", "kept/demo.mcap", "--align", "severity >= warning", "--json")
    assert [json.loads(line)["what"] for line in back.stdout.splitlines()] == ["shorter", "new"]
