"""The plant of the demo: who runs in it, what happens, and whether the replay equals it.

Rule 1: the parts are processes that find each other on the bus; this program gives commands as an operator would.
Rule 2: nobody sends before everybody is linked and has heard a beat of every sender: from then on no loss goes unseen.
Rule 3: each listener must have printed as many events as the log holds for its filter, or the demo fails.
"""

import os
import random
import shutil
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final

import msgspec
from cyclopts import Parameter

from bridge.cli.demo_parts import DEADLINE_S, DemoError, Parts
from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, open_bus
from bridge.cli.replay import show_comparison
from bridge.cli.show import View, print_json, print_spans
from bridge.core.alarms import Alarm
from bridge.core.catalog import Catalog, EventClass
from bridge.core.events import AnyEvent, Source
from bridge.core.questions import LogQuestion
from bridge.edges.bus import Bus, BusConfig
from bridge.edges.bus import open_bus as open_bus_with
from bridge.edges.class_files import load_catalog
from bridge.listener import Listener
from bridge.logger import Book, LoggerProxy
from bridge.logger.compare import State, compare, state_of
from bridge.publisher import BEAT_S, Publisher
from bridge.replayer import replay_into

TARGET: Final = "plant"
CLASS_FILE: Final = "plant.tmc"
LISTENERS: Final = {
    "faults": "severity >= error",
    "robot": "source.name like '%Robot%' and json('/axis') = 3",
}
PUBLISHERS: Final = ("press", "gantry")
OTHERS: Final = 2 + len(LISTENERS) + len(PUBLISHERS)
"""How many others each publisher waits for: logger, recorder, listeners, the other publisher, and the demo itself."""
MESSAGES: Final = 12
STEP_S: Final = 0.15
TRANSITIONS: Final = 7
COLOURS: Final = {"faults": "magenta", "robot": "cyan"}


def class_file() -> Path:
    """The event classes of the demo: beside this module in a built package, else in examples/ of the repository."""
    here = Path(__file__).parent
    return next(path for path in (here / CLASS_FILE, here.parents[1] / "examples" / CLASS_FILE) if path.is_file())


def _catalog() -> Catalog:
    return load_catalog([class_file()])[0]


def _event_id(found: EventClass, name: str) -> int:
    entry = found.named(name)
    assert entry is not None, name
    return entry.id


# A publisher, in a process of its own.


def publisher(name: Annotated[str, Parameter(help="press or gantry")], /, *, common: Common = COMMON) -> int:
    """Send the messages of one machine; a part of the demo."""
    settings = common.load()
    line = _catalog().newest("Line")
    with open_bus(settings) as bus, Publisher(bus, settings.one_target, realm=settings.realm) as sender:
        _wait_for_all(bus)
        print_json({"ready": name, "session": sender.session})
        for number in range(1, MESSAGES + 1):
            _send(sender, line, name, number)
            time.sleep(STEP_S)
    return Exit.LOST if sender.counters.unsent else Exit.OK


def _wait_for_all(bus: Bus) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while bus.peers() < OTHERS:
        if time.monotonic() > deadline:
            raise DemoError(f"only {bus.peers()} of {OTHERS} other programs were found within {DEADLINE_S:.0f} s")
        time.sleep(0.02)
    time.sleep(BEAT_S + 0.2)


def _send(sender: Publisher, line: EventClass, name: str, number: int) -> None:
    axis = 1 + number % 4
    if name == "press":
        event, arguments = ("ToolWorn", [50 + number]) if number % 4 == 0 else ("Stroke", [number, 80.5 + number])
        source, json_attribute = Source(name="Line1.Press"), ""
    else:
        event, arguments = ("GripLost", [axis, 100 + number]) if number % 5 == 0 else ("Moved", [axis, 12.5 * number])
        source, json_attribute = Source(name=f"Line1.Robot.Axis{axis}"), f'{{"axis":{axis}}}'
    entry = line.events[_event_id(line, event)]
    sender.send_message(line.guid, entry.id, entry.severity, source=source, arguments=arguments, json_attribute=json_attribute)


# The program that runs them.


def run(folder: Path, lang: str, *, as_json: bool) -> int:
    """Run the demo in a folder, which then holds demo.mcap, live.json and plant.tmc.

    The exit code says whether live and replayed state are equal.
    """
    view = View(_catalog(), lang)
    realm = f"demo-{os.urandom(4).hex()}"
    group = f"224.0.0.224:{random.randrange(20_000, 60_000)}"
    recording = folder / "demo.mcap"

    line = threading.Lock()

    def say(text: str) -> None:
        with line:
            if as_json:
                print_json({"step": text})
            else:
                print_spans([(text, "dim")])

    def heard(name: str, found: dict[str, object]) -> None:
        with line:
            if as_json:
                print_json({"heard_by": name} | found)
            else:
                event: AnyEvent = msgspec.convert(found, AnyEvent)
                print_spans([(f"{name:9}  ", COLOURS[name]), *view.spans(event)])

    say(f"realm {realm}, scouting group {group}")
    shutil.copyfile(class_file(), folder / CLASS_FILE)
    with (
        Parts(folder, ("--realm", realm, "--scouting-group", group), say, heard) as parts,
        open_bus_with(BusConfig(scouting_group=group)) as bus,
    ):
        parts.start("logger", "serve", "--target", TARGET)
        parts.start("recorder", "record", recording.name, "--classes", CLASS_FILE, "--lang", lang)
        for name, filter in LISTENERS.items():
            parts.start(name, "listen", "--filter", filter)
        for name in PUBLISHERS:
            parts.start(name, "demo-publisher", name, "--target", TARGET)
        for name in ("logger", "recorder", *LISTENERS, *PUBLISHERS):
            parts[name].wait_until_ready()
        with LoggerProxy(bus, TARGET, realm=realm) as logger:
            _operate(logger, view.catalog.newest("Faults"), say)
            for name in PUBLISHERS:
                parts[name].end()
            events = _all_events(logger)
            for name, filter in LISTENERS.items():
                parts[name].wait_for_events(len(list(logger.log(LogQuestion(filter=filter)))))
        live = State(alarms=_alarms(bus, realm), events=events)
        say("stopping with SIGTERM: recorder, listeners, logger")
        for name in ("recorder", *LISTENERS, "logger"):
            parts[name].end(signal.SIGTERM)
    (folder / "live.json").write_bytes(msgspec.json.encode(live))
    say(f"replaying {recording.name} into a fresh logger")
    with Book(None) as book:
        replay_into([recording], book)
        book.flush()
        replayed = state_of(book)
    if not as_json:
        for title, state in (("live logger", live), ("fresh logger after the replay", replayed)):
            print()
            view.print_alarms(state.alarms, title=f"alarms of the {title}")
        print()
    return show_comparison(compare(live, replayed), as_json=as_json)


def _operate(logger: LoggerProxy, faults: EventClass, say: Callable[[str], None]) -> None:
    """Raise, confirm and clear alarms through the proxy; in the end one is raised still."""

    def create(name: str, source: str, *arguments: float | str, confirmed: bool = False) -> Alarm:
        entry = faults.events[_event_id(faults, name)]
        json_attribute = f'{{"axis":{arguments[0]}}}' if "Axis" in source else ""
        answer = logger.create_alarm(
            faults.guid,
            entry.id,
            entry.severity,
            with_confirmation=confirmed,
            source=Source(name=source),
            arguments=arguments,
            json_attribute=json_attribute,
        )
        assert answer.alarm is not None
        return answer.alarm

    lag = create("LagError", "Line1.Robot.Axis3", 3, 12.5, confirmed=True)
    door = create("DoorOpen", "Line1.Cell", "north")
    oil = create("OilHot", "Line1.Press.Hydraulics", 68.5, 60, confirmed=True)
    steps: tuple[tuple[str, Callable[[], object]], ...] = (
        ("raise LagError", lambda: logger.raise_alarm(lag)),
        ("raise DoorOpen", lambda: logger.raise_alarm(door)),
        ("confirm LagError", lambda: logger.confirm_alarm(lag, operator="shift leader", comment="seen")),
        ("raise OilHot", lambda: logger.raise_alarm(oil)),
        ("clear DoorOpen", lambda: logger.clear_alarm(door)),
        ("clear LagError", lambda: logger.clear_alarm(lag)),
        ("raise LagError again", lambda: logger.raise_alarm(lag, arguments=[3, 14.25])),
    )
    assert len(steps) == TRANSITIONS
    for text, step in steps:
        say(f"{'operator':9}  {text}")
        step()
        time.sleep(STEP_S)


def _all_events(logger: LoggerProxy) -> tuple[AnyEvent, ...]:
    """The log, oldest first, once it holds everything that was sent."""
    expected = len(PUBLISHERS) * MESSAGES + TRANSITIONS
    deadline = time.monotonic() + DEADLINE_S
    while True:
        events = tuple(entry.event for entry in logger.log(LogQuestion(newest_first=False)))
        if len(events) >= expected:
            return events
        if time.monotonic() > deadline:
            raise DemoError(f"the logger has {len(events)} of {expected} events")
        time.sleep(0.05)


def _alarms(bus: Bus, realm: str) -> tuple[Alarm, ...]:
    with Listener(bus, realm=realm, target=TARGET, with_state=True) as listener:
        return tuple(alarm for state in listener.snapshot() for alarm in state.alarms)
