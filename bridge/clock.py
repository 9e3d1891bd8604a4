"""What time it is for events: the system's clock, but never earlier than what was said before.

Rule 1: while the system's clock is not behind, its time is the answer.
Rule 2: when it was set back, time goes on from where it was at half the pace of the monotonic clock, until the system's clock
has caught up: order stays visible in the times, and no jump lasts longer than twice its size.
Rule 3: only "now" is asked here. A time that a caller gives is taken as it is.
"""

import threading
import time
from collections.abc import Callable
from typing import Self


class SteadyClock:
    """Gives Unix ns that never go back. For any number of threads."""

    def __init__(self, clock: Callable[[], int] = time.time_ns, pace: Callable[[], int] = time.monotonic_ns) -> None:
        """clock gives Unix ns and may jump; pace gives ns that do not."""
        self._clock, self._pace = clock, pace
        self._last_ns = self._paced_ns = 0
        self._ahead = False
        self._lock = threading.Lock()

    @classmethod
    def of(cls, clock: Callable[[], int]) -> Self:
        """A steady clock over this one, or this one if it is steady: who shares a clock shares what it said."""
        return clock if isinstance(clock, cls) else cls(clock)

    def __call__(self) -> int:
        """Now."""
        with self._lock:
            now_ns, paced_ns = self._clock(), self._pace()
            if self._ahead or now_ns < self._last_ns:
                own_ns = self._last_ns + (paced_ns - self._paced_ns) // 2
                self._ahead = own_ns > now_ns
                now_ns = max(own_ns, now_ns)
            self._last_ns, self._paced_ns = now_ns, paced_ns
            return now_ns
