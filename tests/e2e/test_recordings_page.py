"""docs/recordings.md is true: its tables name what is in a file, and its programs run."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.edges.recording import About, RecordedEvent, RecordingWriter, Totals, Viewer, recover, scan
from bridge.edges.recording.carried import carried
from bridge.edges.recording.layout import Gap, RejectedPayload, StatePart
from tests.e2e.node_tools import modules, run_program
from tests.unit.edges.recording_stories import (
    ABOUT,
    AXIS,
    GAP,
    START,
    STATE,
    cleared,
    everything,
    message,
    raised,
    record,
)

PAGE = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text(encoding="utf-8")
CATALOG = Catalog([EventClass(AXIS, "Axis", "", {90: EventEntry(90, "Jam", Severity.ERROR, "Axis jams")})])


def section(title: str) -> str:
    """The text under a heading."""
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def program(language: str, title: str) -> str:
    """The program in that language under a heading."""
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", section(title), re.MULTILINE | re.DOTALL)
    assert isinstance(found, str)
    return found


def cells(title: str, column: int) -> list[str]:
    """What stands in a column of the table under a heading, without its head."""
    rows = [line.strip("|").split("|") for line in section(title).splitlines() if line.startswith("|")]
    return [row[column].strip() for row in rows[2:]]


@pytest.fixture
def plant(tmp_path: Path) -> Path:
    """A recording that has every channel."""
    path = tmp_path / "plant.mcap"
    with RecordingWriter(path, about=ABOUT, viewer=Viewer(lambda event: CATALOG)) as writer:
        writer.add_state(STATE, START)
        record(writer, message(1), START)
        record(writer, message(2), START, "application/vnd.msgpack")
        record(writer, raised(90), START)
        record(writer, cleared(90), START)
        writer.add_gap(GAP, START)
        writer.add_rejected("no/key", "", b"{", "no JSON", START)
    return path


def test_the_channels_are_those_of_the_page(plant: Path) -> None:
    """Topics, with the target and the class of the file put in, and encodings."""
    topics = [cell.strip("`").format(target="plc1", event_class=AXIS) for cell in cells("Channels", 0)]
    there = dict(zip(topics, cells("Channels", 1), strict=True))
    assert {channel.topic: channel.message_encoding for channel in scan(plant).channels} == there


def test_the_fields_are_those_of_the_page() -> None:
    """Of a gap, a keyframe, and each record of metadata; nothing that is there is left out."""
    messages = section("Messages")
    for name in (*Gap.__struct_fields__, *StatePart.__struct_fields__):
        assert f"`{name}`" in messages, name
    assert {"key", "encoding", "payload", "size", "reason"} == set(RejectedPayload.__struct_fields__)
    about, told, recovered = cells("Metadata", 1)
    assert [name for name in About.__struct_fields__ if name != "more" and f"`{name}`" not in about] == []
    assert [name for name in (*Totals.__struct_fields__, "complete", "crc32") if f"`{name}`" not in told] == []
    assert re.findall(r"`(\w+)`", recovered) == ["source", "source_bytes", "kept_bytes", "reason", "harmless"]


def test_the_metadata_are_those_of_the_page(plant: Path) -> None:
    """Each record that is written has a row, and each row a record."""
    active = RecordingWriter(plant.with_name("left.mcap"))
    active.flush()
    active.abandon()
    recover(active.active_path)
    names = {cell.split("`")[1] for cell in cells("Metadata", 0)}
    assert names == {"tcbridge", "tcbridge.summary", *dict(carried(plant.with_name("left.mcap")).metadata)}
    ((_, entries),) = carried(plant.with_name("left.mcap")).metadata
    assert [name for name in entries if f"`{name}`" not in cells("Metadata", 1)[2]] == []


def test_what_is_attached_is_on_the_page(plant: Path) -> None:
    """The schema by its name, the class that only the bus knew by the pattern of the page."""
    names = [each.name for each in carried(plant).attachments]
    assert names == ["event.schema.json", f"Axis-{AXIS[:8]}.tmc"]
    assert cells("Attachments", 0)[0] == "`event.schema.json`"


def test_the_python_program_prints_the_events(plant: Path, tmp_path: Path) -> None:
    """All that are JSON, with nothing of ours imported."""
    assert "import bridge" not in program("python", "Reading it in Python")
    (tmp_path / "read.py").write_text(program("python", "Reading it in Python"), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "read.py", "plant.mcap"], cwd=tmp_path, check=True, capture_output=True, encoding="utf-8", timeout=60
    )
    events = [item for item in everything(plant) if isinstance(item, RecordedEvent) and item.encoding == "application/json"]
    assert done.stdout.splitlines() == [
        f"{item.log_time_ns} {item.event.kind} plc1 {AXIS} {item.event.event_id}" for item in events
    ]
    assert len(events) == 3


def test_the_program_with_this_library_prints_errors_and_what_is_missing(plant: Path, tmp_path: Path) -> None:
    """Of every file that is named, and the alarms that are left in the end."""
    (tmp_path / "read.py").write_text(program("python", "Reading it with this library"), encoding="utf-8")
    environ = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "read.py", "plant.mcap"]
    done = subprocess.run(command, cwd=tmp_path, env=environ, check=True, capture_output=True, encoding="utf-8", timeout=60)
    lines = done.stdout.splitlines()
    errors = [item for item in everything(plant) if isinstance(item, RecordedEvent) and item.event.severity >= Severity.ERROR]
    assert errors
    assert [f"{item.log_time_ns} {item.event.kind} {AXIS} {item.event.event_id}" for item in errors] == lines[: len(errors)]
    assert "7 events are missing: lost" in lines
    assert lines[-1].startswith("active:")


def test_the_javascript_program_prints_the_log(plant: Path, tmp_path: Path, pytestconfig: pytest.Config) -> None:
    """Level, source and text of every line, the losses among them."""
    (tmp_path / "read.js").write_text(program("js", "Reading it in JavaScript"), encoding="utf-8")
    printed = run_program(modules(pytestconfig), tmp_path / "read.js", plant).splitlines()
    assert len(printed) == 6
    assert printed[2] == "4 plc1 raised: Axis jams"
    assert printed[4] == "3 plc1 7 events are missing here: lost"


def test_the_answers_are_those_of_info() -> None:
    """yes, no and tail unknown, each with when."""
    assert cells("Is it complete?", 0) == ["`yes`", "`no`", "`tail unknown`"]
    assert json.loads(Totals().metadata()["events"]) == 0
    assert Totals(unknown_tails=("*",)).metadata()["complete"] == "tail unknown"
