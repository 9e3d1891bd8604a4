"""Which events are written when only what is around a trigger is wanted.

    before      after
    |-----------T----------|          one window: from T - before to T + after, both ends included
    |-----------T----|------T2-----------|        T2 - before is within it: one window, one file

Rule 1: what may still be wanted waits in memory. It leaves it into a file when a trigger comes, else unwritten when it is older
than `before`; the alarm state follows what leaves, so a file begins with the state as it was at its first moment.
Rule 2: time is that of arrival. No clock here: each item comes with its time, and tick() says that time went on without one.
Rule 3: a file is ended when no trigger can reach it any more: `before` after its window. So an event is never in two files.
Rule 4: memory is bounded, in events and in bytes. What has to leave it early is counted, and stands as a gap in a window that
would have had it.
Rule 5: a loss that is noticed up to SETTLE_NS after a window is written into it: it may be its own end that is missing.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import msgspec

from bridge.core.events import AnyEvent
from bridge.core.filters.ast import Expr
from bridge.core.sequence import Missing
from bridge.core.times import NS_PER_S
from bridge.inbox import Dropped
from bridge.notices import Gap, Heard, Item, Snapshot, TailUnknown

SETTLE_NS: Final = 2 * NS_PER_S
"""A sender's beat, which reveals a lost tail, comes each second."""
EVENT_COST: Final = 1000
"""Bytes that an event takes in memory beside those of the wire (measured: 850)."""
NO_ROOM: Final = "the memory for what comes before a trigger was full: at most so many are missing here"
_STEPS: Final = 256


class Capture(msgspec.Struct, frozen=True, kw_only=True):
    """What to capture: from `before_s` before to `after_s` after each event that `trigger` takes.

    max_events and max_bytes bound what waits in memory. ValueError for what is negative or leaves no room.
    """

    trigger: Expr | str
    before_s: float = 60.0
    after_s: float = 30.0
    max_events: int = 1_000_000
    max_bytes: int = 256_000_000

    def __post_init__(self) -> None:
        if not (0 <= self.before_s < 1e9 and 0 <= self.after_s < 1e9):
            raise ValueError("the seconds before and after a trigger are not negative")
        if self.max_events < 1 or self.max_bytes < 1:
            raise ValueError("a capture needs room in memory")


class Output(Protocol):
    """Where windows go."""

    def begin(self, at_ns: int, why: str) -> None:
        """A window begins."""

    def write(self, item: Item, at_ns: int) -> None:
        """This belongs to it."""

    def skip(self, item: Item) -> None:
        """This went by and belongs to no window."""

    def end(self) -> None:
        """It is over, and nothing can belong to it any more."""


class _Waiting(NamedTuple):
    at_ns: int
    item: Item
    cost: int


class _Early(msgspec.Struct):
    """Events that left early, of a short time: one step of many, so that memory is bounded here too."""

    first_ns: int
    last_ns: int = 0
    count: int = 0


class Windows:
    """Decides, item by item. Not for several threads."""

    def __init__(self, capture: Capture, fires: Callable[[AnyEvent], bool], out: Output) -> None:
        self._before_ns, self._after_ns = round(capture.before_s * NS_PER_S), round(capture.after_s * NS_PER_S)
        self._linger_ns = max(self._before_ns, SETTLE_NS)
        self._max_events, self._max_bytes = capture.max_events, capture.max_bytes
        self._step_ns = max(1, self._before_ns // _STEPS)
        self._fires, self._out = fires, out
        self._ring: deque[_Waiting] = deque()
        self._bytes = 0
        self._early: deque[_Early] = deque()
        self._until_ns: int | None = None
        self.armed = True
        """Whether events are triggers."""
        self.triggers = 0

    @property
    def is_open(self) -> bool:
        """Whether a file is open: a window, or the time after it in which a trigger may join it."""
        return self._until_ns is not None

    def misses_tail(self, at_ns: int) -> bool:
        """Whether a sender that is silent at this time may owe events of the window."""
        return self._until_ns is not None and at_ns <= self._until_ns + SETTLE_NS

    def take(self, item: Item, at_ns: int) -> None:
        """The next item; times never go back."""
        self.tick(at_ns)
        if self.armed and isinstance(item, Heard) and self._fires(item.event):
            event = item.event
            self.trigger(at_ns, f"{event.kind} {event.event_class} {event.event_id} of {event.target}")
        is_loss = isinstance(item, Gap | Dropped | TailUnknown)
        if (self._until_ns is not None and at_ns <= self._until_ns) or (is_loss and self.misses_tail(at_ns)):
            self._out.write(item, at_ns)
        else:
            self._keep(_Waiting(at_ns, item, _cost(item)))

    def tick(self, at_ns: int) -> None:
        """So late it is."""
        if self._until_ns is not None and at_ns > self._until_ns + self._linger_ns:
            self.end()
        start_ns = at_ns - self._before_ns
        while self._ring and self._ring[0].at_ns < start_ns:
            self._out.skip(self._leave())
        while self._early and self._early[0].last_ns < start_ns:
            self._early.popleft()

    def trigger(self, at_ns: int, why: str) -> None:
        """Here something is to be captured."""
        self.tick(at_ns)
        self.triggers += 1
        start_ns = at_ns - self._before_ns
        if self._until_ns is not None and start_ns > self._until_ns:
            self.end()
        if self._until_ns is None:
            self._out.begin(max(0, start_ns), why)
        if early := sum(each.count for each in self._early):
            self._out.write(Gap(Missing("", "", 0, early - 1), NO_ROOM), max(0, start_ns))
            self._early.clear()
        while self._ring:
            waiting = self._ring[0]
            self._leave()
            self._out.write(waiting.item, waiting.at_ns)
        self._until_ns = at_ns + self._after_ns

    def end(self) -> None:
        """End the window, if there is one, now."""
        if self._until_ns is not None:
            self._until_ns = None
            self._out.end()

    def _keep(self, waiting: _Waiting) -> None:
        self._ring.append(waiting)
        self._bytes += waiting.cost
        while len(self._ring) > self._max_events or self._bytes > self._max_bytes:
            early_ns = self._ring[0].at_ns
            item = self._leave()
            self._out.skip(item)
            if isinstance(item, Heard):
                if not self._early or early_ns >= self._early[-1].first_ns + self._step_ns:
                    self._early.append(_Early(early_ns))
                self._early[-1].last_ns = early_ns
                self._early[-1].count += 1

    def _leave(self) -> Item:
        waiting = self._ring.popleft()
        self._bytes -= waiting.cost
        return waiting.item


def _cost(item: Item) -> int:
    match item:
        case Heard(element=element):
            return len(element) + EVENT_COST
        case Snapshot(alarms=alarms):
            return (1 + len(alarms)) * EVENT_COST
        case _:
            return EVENT_COST
