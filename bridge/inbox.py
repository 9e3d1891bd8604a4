"""A bounded queue between our threads and the user's: what is dropped is said, in place.

Rule 1: putting never blocks with on_full "drop": the oldest events leave, and Dropped(n) stands where they were.
Rule 2: with "wait" putting waits for room, which in the end holds up the senders.
Rule 3: notices are never dropped: they are how loss is told.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from typing import Final, Generic, Literal, TypeAlias, TypeVar

import msgspec

OnFull: TypeAlias = Literal["drop", "wait"]
TAKE_WAITING: Final = 1024
TAKE_DROPPING: Final = 64
"""How many items move to the consumer's side at once; those can no longer be dropped."""


class Dropped(msgspec.Struct, frozen=True):
    """The queue was full: the `count` oldest events left it here."""

    count: int


_T = TypeVar("_T")


class Inbox(Generic[_T]):
    """The queue. One consumer at a time; any number of threads may put."""

    def __init__(self, size: int, on_full: OnFull, is_event: Callable[[_T], bool]) -> None:
        """size: how many items it holds; is_event: what may be dropped."""
        self._size, self._on_full, self._is_event = size, on_full, is_event
        self._queue: deque[_T] = deque()
        self._local: deque[_T | Dropped] = deque()
        self._set_aside: deque[_T] = deque()
        self._undeclared = 0
        self._lock = threading.Lock()
        self._more = threading.Condition(self._lock)
        self._room = threading.Condition(self._lock)
        self._waiters: list[Callable[[], None]] = []
        self._closed = False
        self.dropped = 0
        """How many events were dropped in all."""

    def put(self, items: Sequence[_T]) -> None:
        """Add items in order."""
        with self._lock:
            queue = self._queue
            if self._on_full == "wait":
                self._room.wait_for(lambda: len(queue) < self._size or self._closed)
            queue.extend(items)
            if self._on_full == "drop" and len(queue) > self._size:
                self._drop(len(queue) - self._size)
            self._more.notify()
            waiters, self._waiters = self._waiters, []
        for wake in waiters:
            wake()

    def _drop(self, count: int) -> None:
        for _ in range(count):
            item = self._queue.popleft()
            if self._is_event(item):
                self._undeclared += 1
                self.dropped += 1
            else:
                self._set_aside.append(item)

    def _refill(self) -> bool:
        """Move what is there to the consumer's side; called with the lock held."""
        local, queue = self._local, self._queue
        if self._undeclared:
            local.append(Dropped(self._undeclared))
            self._undeclared = 0
        while self._set_aside:
            local.append(self._set_aside.popleft())
        waiting = self._on_full == "wait"
        for _ in range(min(len(queue), TAKE_WAITING if waiting else TAKE_DROPPING)):
            local.append(queue.popleft())
        if waiting:
            self._room.notify_all()
        return bool(local)

    def get(self, timeout_s: float | None = None) -> _T | Dropped | None:
        """The next item; None when the time is up, or when the inbox is closed and empty."""
        local = self._local
        if local:
            return local.popleft()
        with self._lock:
            if not self._refill():
                if timeout_s == 0 or self._closed:
                    return None
                self._more.wait_for(lambda: self._queue or self._undeclared or self._set_aside or self._closed, timeout_s)
                if not self._refill():
                    return None
        return local.popleft()

    def __iter__(self) -> Iterator[_T | Dropped]:
        local = self._local
        while (item := self.get()) is not None:
            yield item
            while local:
                yield local.popleft()

    async def __aiter__(self) -> AsyncIterator[_T | Dropped]:
        loop = asyncio.get_running_loop()
        ready = asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop may be closed by now
                loop.call_soon_threadsafe(ready.set)

        while True:
            ready.clear()
            with self._lock:
                if not self._local and not self._refill():
                    if self._closed:
                        return
                    self._waiters.append(wake)
            if not self._local:
                await ready.wait()
            while self._local:
                yield self._local.popleft()

    def close(self) -> None:
        """No more will come: whoever waits wakes; what is there can still be taken."""
        with self._lock:
            self._closed = True
            self._more.notify_all()
            self._room.notify_all()
            waiters, self._waiters = self._waiters, []
        for wake in waiters:
            wake()
