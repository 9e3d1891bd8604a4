"""What `tcbridge record` is told to take, and how it is told things while it runs."""

import json
import signal
from pathlib import Path

from bridge import BusConfig, Publisher, Severity, open_bus
from bridge.core.catalog import Catalog
from bridge.core.class_toml import read_classes
from bridge.edges.recording import RecordedEvent, read_events, summary
from bridge.texts import ClassOffer
from tests.e2e.fault_stories import CLASS, Program, eventually, program

PUMPS = """
[[classes]]
name = "Pump"
display_text = "Pumps"
[[classes.events]]
id = 1
name = "RanDry"
severity = "error"
display_text = "Pump ran dry"
"""


def started(recorder: Program) -> Path:
    """Wait until it writes a file; its path."""
    return Path(json.loads(recorder.line())["began"])


def told(recorder: Program, name: str) -> dict[str, str | int | bool]:
    """The next thing it tells, which is called so."""
    found: dict[str, str | int | bool] = json.loads(recorder.line())
    assert name in found
    return found


def test_targets_and_classes_by_name_are_chosen(bus_config: BusConfig, tmp_path: Path) -> None:
    """A class that is in no file is asked for on the bus; a GUID is taken as it is; two targets of three."""
    (pump,) = read_classes(PUMPS.encode()).classes
    group = ("--scouting-group", bus_config.scouting_group)
    chosen = (
        "--event-class",
        "Pump",
        "--event-class",
        CLASS,
        "--target",
        "plc1",
        "--target",
        "plc2",
        "--filter",
        "event_id > 1",
    )
    command = ("record", str(tmp_path / "x.mcap"), *chosen, *group, "--json")
    with open_bus(bus_config) as bus, ClassOffer(bus, "plc9", Catalog([pump])), program(*command) as recorder:
        path = started(recorder)
        publishers = [Publisher(bus, f"plc{number}") for number in (1, 2, 3)]
        for publisher in publishers:
            assert publisher is publishers[2] or publisher.wait_for_listener(60)
            for event_class in (pump.guid, CLASS, "0a0b0c0d-0000-4000-8000-000000000001"):
                for number in (1, 2):
                    publisher.send_message(event_class, number, Severity.INFO)
            assert publisher.close() == 0
        active = path.with_name(f"{path.name}.active")
        assert eventually(lambda: sum(isinstance(item, RecordedEvent) for item in read_events(active)) == 4)
        recorder.signal(signal.SIGTERM)
        assert told(recorder, "finished")["events"] == 4
        assert told(recorder, "recorded")["complete"] == "yes"
        assert recorder.process.wait(60) == 0
    events = [item.event for item in read_events(path) if isinstance(item, RecordedEvent)]
    assert sorted((event.target, event.event_class, event.event_id) for event in events) == sorted(
        (target, event_class, 2) for target in ("plc1", "plc2") for event_class in (pump.guid, CLASS)
    )
    info = summary(path)
    assert info.about.more["targets"] == "plc1, plc2"
    assert {"event.schema.json", "tcbridge.settings.json"} <= set(info.attachments)


def test_a_class_that_nobody_knows_is_refused(bus_config: BusConfig, tmp_path: Path) -> None:
    """With 2, before a file is made."""
    arguments = (str(tmp_path / "x.mcap"), "--event-class", "Pumpe", "--scouting-group", bus_config.scouting_group)
    with program("record", *arguments) as recorder:
        assert recorder.process.wait(60) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_recorder_is_stopped_and_split_by_name(bus_config: BusConfig, tmp_path: Path) -> None:
    """With tcbridge control; a second recorder of that name is refused before it makes a file."""
    group = ("--scouting-group", bus_config.scouting_group)
    with program("record", str(tmp_path / "night"), "--json", *group) as recorder:
        first = started(recorder)
        with program("control", "night", "split", "--wait", "30", *group) as control:
            assert control.process.wait(60) == 0
        assert started(recorder) != first
        assert told(recorder, "finished") == {
            "finished": str(first),
            "events": 0,
            "size_bytes": first.stat().st_size,
            "more": True,
        }
        with program("record", str(tmp_path / "other"), "--name", "night", *group) as second:
            assert second.process.wait(60) == 1
        assert not (tmp_path / "other").exists()
        with program("control", "night", "stop", "--wait", "30", *group) as control:
            assert control.process.wait(60) == 0
        told(recorder, "finished")
        assert told(recorder, "recorded")["files"] == 2
        assert recorder.process.wait(60) == 0
