"""A recording explains itself: classes that only a program on the bus knows are in it, in every language."""

import json
import signal
from pathlib import Path

from mcap.reader import make_reader

from bridge.cli import run
from bridge.core import class_toml
from bridge.edges.bus import BusConfig
from bridge.edges.class_files import carried_catalog
from bridge.edges.recording import RecordedEvent, carried, read_events, recover, scan
from tests.e2e.fault_stories import Program, eventually, program

CLASSES = """
[[classes]]
name = "Pump"
display_text = "Pumps"
translations = { de-DE = "Pumpen" }

[[classes.events]]
id = 1
name = "RanDry"
severity = "error"
display_text = "Pump {0} ran dry"
translations = { de-DE = "Pumpe {0} lief trocken" }
"""
(PUMP,) = class_toml.read_classes(CLASSES.encode()).classes
SENDER = f"""
import sys
from bridge import BusConfig, Publisher, open_bus
from bridge.core.catalog import Catalog
from bridge.core.class_toml import read_classes
from bridge.texts import ClassOffer

(pump,) = read_classes({CLASSES!r}.encode()).classes
with (
    open_bus(BusConfig(scouting_group=sys.argv[1])) as bus,
    ClassOffer(bus, "plc1", Catalog([pump])),
    Publisher(bus, "plc1") as publisher,
):
    print("ready", flush=True)
    for line in sys.stdin:
        assert publisher.wait_for_listener(60)
        publisher.send_message(pump.guid, 1, pump.events[1].severity, arguments=(int(line),))
        assert publisher.flush()
        print("sent", flush=True)
"""


def lines(path: Path) -> list[tuple[str, str]]:
    """What the log channel says, with the class name beside it."""
    with open(path, "rb") as file:
        said = [json.loads(raw.data) for _, _, raw in make_reader(file).iter_messages(topics=["/log"])]
    return [(line["message"], line["file"]) for line in said]


def learnt(path: Path) -> bool:
    """Whether the recorder has put the class into the file."""
    return path.exists() and any(name.endswith(".tmc") for name in scan(path).attachments)


def send(sender: Program, number: int) -> None:
    """Send an event; it is on its way when this returns."""
    sender.tell(str(number))
    assert sender.line() == "sent"


def record_until_learnt(sender: Program, active: Path) -> None:
    """Events of a class that the recorder does not know, until it has learnt it, and one more."""

    def learnt_by_another() -> bool:
        send(sender, 3)
        return learnt(active)

    assert eventually(learnt_by_another)
    before = scan(active).totals.events
    send(sender, 4)
    assert eventually(lambda: scan(active).totals.events > before and "4" in last_arguments(active))


def last_arguments(path: Path) -> list[str]:
    """The arguments of the last event that is in the file."""
    with read_events(path) as reader:
        *_, last = (item for item in reader if isinstance(item, RecordedEvent))
    return [argument.value for argument in last.event.arguments]


def test_the_class_of_a_program_far_away_is_in_the_recording(tmp_path: Path, bus_config: BusConfig) -> None:
    """It is learnt while the recorder goes on, attached, and gives the texts of all events in any language later."""
    group, path = bus_config.scouting_group, tmp_path / "night.mcap"
    with (
        program(group, code=SENDER) as sender,
        program("record", str(path), "--lang", "de", "--scouting-group", group, "--json") as recorder,
    ):
        assert sender.line() == "ready"
        assert json.loads(recorder.line())
        record_until_learnt(sender, tmp_path / "night.mcap.active")
        recorder.signal(signal.SIGINT)
        assert recorder.process.wait(60) == 0
    *first, last = lines(path)
    assert {text for text, _ in first} <= {f"{PUMP.guid}#1 (3)", "Pumpe 3 lief trocken"}
    assert last == ("Pumpe 4 lief trocken", "Pumpen")
    found, problems = carried_catalog((each.name, each.data) for each in carried(path).attachments)
    assert (list(found), problems) == ([PUMP], [])
    assert run(["convert", str(path), str(tmp_path / "english.mcap"), "--lang", "en"]) == 0
    assert lines(tmp_path / "english.mcap") == [*[("Pump 3 ran dry", "Pumps")] * len(first), ("Pump 4 ran dry", "Pumps")]


def test_a_recorder_that_is_killed_has_put_the_class_into_the_file(tmp_path: Path, bus_config: BusConfig) -> None:
    """What is recovered explains itself as well."""
    group, active = bus_config.scouting_group, tmp_path / "night.mcap.active"
    with (
        program(group, code=SENDER) as sender,
        program("record", str(tmp_path / "night.mcap"), "--scouting-group", group, "--json") as recorder,
    ):
        assert sender.line() == "ready"
        assert json.loads(recorder.line())
        record_until_learnt(sender, active)
        recorder.kill()
    recover(active)
    found, _ = carried_catalog((each.name, each.data) for each in carried(tmp_path / "night.mcap").attachments)
    assert list(found) == [PUMP]
    assert lines(tmp_path / "night.mcap")[-1] == ("Pump 4 ran dry", "Pumps")
