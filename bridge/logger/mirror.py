"""A read-only copy of another logger: its alarms, and its events in a cache of one's own.

Rule 1: alarm state is that of a listener with state: folded before any queue, and taken anew from the logger after a gap.
Rule 2: events reach the cache in order of arrival; unique ids are the mirror's own. What was dropped or is missing is counted.
Rule 3: a mirror never sends. While the logger is gone the last known state stays, and `is_connected` says so.
"""

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from bridge.core import keys
from bridge.core.alarms import Alarm, AlarmTable
from bridge.core.events import DEFAULT_LIMITS, AnyEvent, Event, Limits
from bridge.core.logbook import Changes
from bridge.edges.bus import Bus
from bridge.edges.cache import Cache
from bridge.inbox import Dropped
from bridge.listener import Gap, Item, Listener, Rejected
from bridge.logger.book import Book
from bridge.logger.presence import Presence

BATCH: Final = 1000
MAX_BEYOND: Final = 100_000
_BEAT_STEP_S: Final = 0.05
"""A first beat that brings no event wakes nobody."""


class MirrorCounters(msgspec.Struct):
    """What a mirror took in. missing events are to be had nowhere, dropped ones were too many for the cache."""

    stored: int = 0
    missing: int = 0
    dropped: int = 0
    rejected: int = 0


class _Reach:
    """Up to which seq a session is stored without a hole, from where its promise starts; what came beyond a hole waits."""

    __slots__ = ("beyond", "upto")

    def __init__(self) -> None:
        self.upto = 0
        self.beyond: set[int] = set()

    def add(self, seq: int) -> None:
        self.beyond.add(seq)
        if len(self.beyond) > MAX_BEYOND:
            self.settle(min(self.beyond))

    def settle(self, start: int) -> int:
        """Take everything up to `start` as known; how far it is known now."""
        if start > self.upto:
            self.upto = start
            self.beyond = {seq for seq in self.beyond if seq > start}
        while self.upto + 1 in self.beyond:
            self.upto += 1
            self.beyond.remove(self.upto)
        return self.upto


class Mirror:
    """Follows the logger of `target`. A context manager."""

    def __init__(
        self,
        bus: Bus,
        target: str,
        *,
        realm: str = keys.LIVE,
        cache: str | Path | Cache = ":memory:",
        limits: Limits = DEFAULT_LIMITS,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        on_connection: Callable[[bool], None] | None = None,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Subscribe, take the state, follow. on_connection(there) is called on a thread of ours when the logger comes or goes.

        CacheError when the cache cannot be opened; TwoLoggersError when two loggers answer for the target.
        """
        self.target, self.realm = target, realm
        self.counters = MirrorCounters()
        self._clock = clock
        self.book = Book(target, cache, limits=limits, resolve_class=resolve_class)
        try:
            self._listener = Listener(bus, realm=realm, target=target, with_state=True, limits=limits)
        except BaseException:
            self.book.close()
            raise
        self._reach: dict[str, _Reach] = {}
        self._news = threading.Condition()
        self._take_table()
        self._presence = Presence(bus, target, realm, on_connection)
        self._follower = threading.Thread(target=self._follow, name=f"mirror {target}", daemon=True)
        self._follower.start()

    def _take_table(self) -> None:
        with self.book.lock:
            self.book.store((self.book.logbook.adopt(self._listener.table),))

    def _follow(self) -> None:
        inbox = self._listener
        while (first := inbox.get()) is not None:
            items: list[Item] = [first]
            while len(items) < BATCH and (more := inbox.get(0)) is not None:
                items.append(more)
            self._take(items)

    def _take(self, items: Sequence[Item]) -> None:
        now_ns = self._clock()
        changes: list[Changes] = []
        events: list[AnyEvent] = []
        resynced = False
        with self.book.lock:
            for item in items:
                if isinstance(item, Event):
                    events.append(item)
                    changes.append(self.book.logbook.follow(item, now_ns))
                elif isinstance(item, Gap):
                    self.counters.missing += item.missing.count
                    resynced = True
                elif isinstance(item, Dropped):
                    self.counters.dropped += item.count
                    resynced = True
                elif isinstance(item, Rejected):
                    self.counters.rejected += 1
            self.book.store(changes)
            if resynced:
                self._take_table()
        with self._news:
            self.counters.stored += len(events)
            for event in events:
                self._reach.setdefault(event.session, _Reach()).add(event.seq)
            self._news.notify_all()

    @property
    def table(self) -> AlarmTable:
        """The alarm state as the logger told it."""
        return self._listener.table

    @property
    def alarms(self) -> list[Alarm]:
        """Alarms that are raised or wait for confirmation, latest transition last."""
        return self._listener.alarms

    @property
    def is_connected(self) -> bool:
        """Whether the logger is there."""
        return bool(self._presence.sessions)

    def wait_for_logger(self, timeout_s: float = 10.0, *, there: bool = True) -> bool:
        """Wait until the logger is there (or gone); False when time is up."""
        return self._presence.wait(timeout_s, there=there)

    def wait_for_promise(self, session: str, timeout_s: float = 10.0) -> bool:
        """Wait until losses of a session are visible: from here on nothing of it is missed unnoticed; False when time is up."""
        return self._listener.wait_for_beat(session, timeout_s=timeout_s)

    def wait_for(self, session: str, seq: int, timeout_s: float = 10.0) -> bool:
        """Wait until this mirror knows everything of a session up to `seq`, by event or by state; False when time is up.

        Events from before the first beat that was heard were never promised; they do not count.
        """

        def known() -> bool:
            if self.table.base(session) >= seq:
                return True
            if not self._listener.wait_for_beat(session, timeout_s=0):
                return False
            start, reach = self._listener.tracker.start(session) or 0, self._reach.get(session)
            return start >= seq if reach is None else reach.settle(start) >= seq

        deadline = time.monotonic() + timeout_s
        with self._news:
            while not known():
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._news.wait(min(left, _BEAT_STEP_S))
            return True

    def close(self, timeout_s: float = 2.0) -> int:
        """Stop following and close the cache; how many rows could not be written. Takes at most about timeout_s."""
        deadline = time.monotonic() + timeout_s
        self._presence.close()
        self._listener.close(timeout_s)
        self._follower.join(max(0.0, deadline - time.monotonic()))
        self._take_table()
        return self.book.close(max(0.5, deadline - time.monotonic()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
