"""What comes out of a listener beside events.

Rule 1: loss and faults are values that stand in the stream where they happened.
Rule 2: nothing here does anything: who finds a gap is in losses.py and repair.py.
"""

from collections.abc import Sequence
from typing import TypeAlias

import msgspec

from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.events import (
    AnyEvent,
)
from bridge.core.sequence import Missing
from bridge.inbox import Dropped


class Gap(msgspec.Struct, frozen=True):
    """Events that were sent and are nowhere to be had: `missing.count` of them, here, and why not."""

    missing: Missing
    reason: str


class Rejected(msgspec.Struct, frozen=True):
    """A payload (whole) or one element of it that is no event: its key, its bytes and why."""

    key: str
    raw: bytes
    reason: str
    whole_payload: bool = False


class TailUnknown(msgspec.Struct, frozen=True):
    """A sender is gone without its final beat: what it sent last cannot be known."""

    target: str
    session: str


class TwoLoggers(msgspec.Struct, frozen=True):
    """Two loggers answer for a target now, as after a healed partition: its state stays as it was until one steps back."""

    target: str
    sessions: tuple[str, ...]


class BusLost(msgspec.Struct, frozen=True):
    """The connection to the router is lost. Nothing is known of anybody until BusBack; what was missed is repaired then."""


class BusBack(msgspec.Struct, frozen=True):
    """The connection to the router is there again."""


class LoggerGone(msgspec.Struct, frozen=True):
    """The logger of a target is gone, the bus is there. clean: it said its last word; else its raised alarms are suspect."""

    target: str
    session: str
    clean: bool


class LoggerBack(msgspec.Struct, frozen=True):
    """A target has a logger again: another session, or the one that could not be reached."""

    target: str
    session: str


class SuspectsChanged(msgspec.Struct, frozen=True):
    """A logger has marked alarms suspect, or taken marks off, without an event: these of the target are suspect now."""

    target: str
    session: str
    suspects: tuple[AlarmKey, ...]


class Heard(msgspec.Struct, frozen=True, gc=False):
    """An event with the bytes it came in and when it came (Unix ns): what a recorder wants."""

    event: AnyEvent
    element: bytes
    encoding: str
    arrival_ns: int


class Snapshot(msgspec.Struct, frozen=True):
    """The alarms of a target that were raised and not disposed; events of `session` up to `seq` are folded in, perhaps more."""

    target: str
    session: str
    seq: int
    alarms: tuple[Alarm, ...]


Loss: TypeAlias = Dropped | Gap | Rejected | TailUnknown | TwoLoggers
News: TypeAlias = BusLost | BusBack | LoggerGone | LoggerBack | SuspectsChanged
Notice: TypeAlias = Loss | News
Item: TypeAlias = AnyEvent | Heard | Snapshot | Notice


class ListenerCounters(msgspec.Struct):
    """What a listener saw. missing events were never to be had; repaired ones came late but in their place."""

    payloads: int = 0
    received: int = 0
    passed: int = 0
    duplicates: int = 0
    repaired: int = 0
    missing: int = 0
    rejected_payloads: int = 0
    rejected_events: int = 0
    tails_unknown: int = 0


class TwoLoggersError(RuntimeError):
    """Two loggers answer for one target, where exactly one is right; names both sessions."""

    def __init__(self, target: str, sessions: Sequence[str]) -> None:
        self.target, self.sessions = target, tuple(sessions)
        super().__init__(f"target {target!r} has {len(sessions)} loggers: {', '.join(sessions)}")
