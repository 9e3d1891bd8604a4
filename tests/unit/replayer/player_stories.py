"""What the tests of replays share: small recordings, a clock that a test moves, and waiting for what a player does."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from bridge.core import codec
from bridge.core.alarms import AlarmTable
from bridge.core.events import AnyEvent
from bridge.core.keys import EventKey
from bridge.core.times import NS_PER_S
from bridge.edges.recording import Gap, RecordingWriter, StateFrame
from bridge.replayer import Player
from bridge.testing.builders import TARGET, TIME_NS, alarm_cleared, alarm_raised, message_sent

START_NS = TIME_NS
SESSION = "0123456789abc000"


def numbered(events: Iterable[AnyEvent], session: str = SESSION, first: int = 1) -> list[AnyEvent]:
    """The events as one session sent them."""
    return [
        msgspec.structs.replace(event, session=session, seq=number, key_seq=number)
        for number, event in enumerate(events, first)
    ]


def frame_of(table: AlarmTable, seq: int, session: str = SESSION, target: str = TARGET) -> StateFrame:
    """The keyframe that a recorder takes now."""
    alarms = tuple(alarm for alarm in table.alarms.values() if alarm.target == target)
    return StateFrame(realm="live", target=target, session=session, seq=seq, alarms=alarms)


def record(path: Path, items: Iterable[AnyEvent | StateFrame | Gap], step_ns: int = NS_PER_S) -> Path:
    """A recording with one entry a second, the first at START_NS."""
    with RecordingWriter(path) as writer:
        for number, item in enumerate(items):
            at_ns = START_NS + number * step_ns
            match item:
                case StateFrame():
                    writer.add_state(item, at_ns)
                case Gap():
                    writer.add_gap(item, at_ns)
                case event:
                    key = EventKey("live", event.target, event.event_class, event.is_alarm, event.severity)
                    writer.add(codec.encode(event), codec.JSON, key, event, at_ns)
    return path


def night(path: Path) -> list[AnyEvent]:
    """Ten seconds: an alarm from 2 s to 6 s, another from 4 s on, and messages; returns the events."""
    events: list[AnyEvent] = [message_sent(event_id=100 + number) for number in range(10)]
    events[2] = alarm_raised(event_id=1)
    events[4] = alarm_raised(event_id=2)
    events[6] = alarm_cleared(event_id=1)
    events = numbered(events)
    record(path, events)
    return events


class HandClock:
    """Seconds that pass only while a player waits for them, or when the test says so."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.waited_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def wait(self, condition: threading.Condition, seconds: float) -> None:
        """Let the time pass at once; whoever wants to tell the player something gets a turn."""
        condition.wait(0)
        self.now_s += seconds
        self.waited_s += seconds


def eventually(condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
    """Wait until it is so; an AssertionError when it is not in time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not come about"
        time.sleep(0.005)


def state_is(player: Player, state: str) -> None:
    """Wait until the player is in this state."""
    eventually(lambda: player.status()["state"] == state)
