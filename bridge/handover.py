"""How a listener's items reach the user: an iterator, an async iterator, by name to an observer.

Rule 1: user code never runs on a thread that receives: what it costs, costs only its own queue.
Rule 2: a callback that raises or returns "pause" pauses further callbacks until the next poll. Its own item counts as handed
        over; what follows stays in the queue, in order. (The manual's callbacks, 6.1.4: any answer but S_OK does that.)
Rule 3: poll() runs on the caller's thread and lets the error through; observe() polls on a thread of ours, counts the error
        and keeps the last one.
"""

import threading
import time
from collections.abc import AsyncIterator, Iterator
from typing import Final

import msgspec

from bridge.core.events import (
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmRaised,
    AnyEvent,
    Event,
    MessageSent,
    is_active,
)
from bridge.inbox import Inbox
from bridge.notices import Heard, Item, Notice, Snapshot

PAUSE: Final = "pause"
"""What a callback returns to be called no more until the next poll."""
CYCLE_S: Final = 0.1
"""How long observe() waits after a pause before it polls again."""


class Polled(msgspec.Struct, frozen=True):
    """What a poll did: how many items it handed over, and whether a callback asked for a pause."""

    items: int
    paused: bool


class Handover:
    """The user's side of a listener."""

    def __init__(self, inbox: "Inbox[AnyEvent | Heard | Snapshot | Notice]") -> None:
        """inbox: where the items come from."""
        self._inbox = inbox
        self._closed = threading.Event()
        self.callback_failures = 0
        """How many callbacks raised under observe()."""
        self.callback_error: Exception | None = None
        """What the last of them raised."""

    def get(self, timeout_s: float | None = None) -> Item | None:
        """The next item; None when the time is up, or when the listener is closed and empty."""
        return self._inbox.get(timeout_s)

    def __iter__(self) -> Iterator[Item]:
        return iter(self._inbox)

    def __aiter__(self) -> AsyncIterator[Item]:
        return aiter(self._inbox)

    @property
    def dropped(self) -> int:
        """How many events left the full queue unread."""
        return self._inbox.dropped

    def events(self) -> Iterator[AnyEvent]:
        """Only events; notices are in the counters."""
        for item in self:
            if isinstance(item, Event):
                yield item

    def take(self, count: int, timeout_s: float = 10.0) -> list[AnyEvent]:
        """The next `count` events, or fewer when the time is up; notices are in the counters."""
        deadline = time.monotonic() + timeout_s
        taken: list[AnyEvent] = []
        while len(taken) < count and (left := deadline - time.monotonic()) > 0:
            item = self.get(left)
            if item is None:
                break
            if isinstance(item, Event):
                taken.append(item)
        return taken

    def poll(self, observer: object, *, limit: int = 65536) -> Polled:
        """Call the observer for what is there now, at most `limit` items, without waiting; see observe() for its methods.

        It stops early when a callback returns "pause". An error of a callback comes through; the next poll goes on after it.
        """
        for count in range(limit):
            item = self.get(0)
            if item is None:
                return Polled(count, False)
            if dispatch(observer, item):
                return Polled(count + 1, True)
        return Polled(limit, False)

    def observe(self, observer: object, *, cycle_s: float = CYCLE_S) -> threading.Thread:
        """Call the observer's methods for every item, on one thread of ours, until closed.

        on_message_sent(event), on_alarm_raised(event), on_alarm_cleared(event, removed), on_alarm_confirmed(event, removed),
        on_alarm_disposed(event), on_notice(notice); any of them may be missing. `removed` says whether the alarm left the
        list of active ones (bRemove). After a callback that raised or returned "pause" there is none for cycle_s seconds.
        """
        thread = threading.Thread(target=self._observe, args=(observer, cycle_s), name="observe", daemon=True)
        thread.start()
        return thread

    def _observe(self, observer: object, cycle_s: float) -> None:
        for item in self:
            try:
                paused = dispatch(observer, item)
            except Exception as error:  # noqa: BLE001 - user code: whatever it raises is a pause, and is told
                self.callback_failures += 1
                self.callback_error = error
                paused = True
            if paused:
                self._closed.wait(cycle_s)

    def close(self) -> bool:
        """Take no more in; what is queued can still be read."""
        self._closed.set()
        self._inbox.close()
        return True


_METHODS: Final[dict[type[Item], str]] = {
    MessageSent: "on_message_sent",
    AlarmRaised: "on_alarm_raised",
    AlarmCleared: "on_alarm_cleared",
    AlarmConfirmed: "on_alarm_confirmed",
    AlarmDisposed: "on_alarm_disposed",
}


def dispatch(observer: object, item: Item) -> bool:
    """Call the observer's method for one item, if it has one; whether it asks for a pause. A Heard counts as its event."""
    if isinstance(item, Heard):
        item = item.event
    method = getattr(observer, _METHODS.get(type(item), "on_notice"), None)
    if method is None:
        return False
    answer: object = method(item, not is_active(item)) if isinstance(item, AlarmCleared | AlarmConfirmed) else method(item)
    return answer == PAUSE
