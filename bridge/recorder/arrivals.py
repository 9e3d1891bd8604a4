"""When items came: times that never go back, whatever the clock does.

Rule 1: an event says when it came. A notice does not: it came before the event behind it in the queue.
Rule 2: after the clock was set back, arrivals are moved to the time of a steady clock (bridge/clock.py), so that what is
measured in them, windows and the age of files, does not stand still.
"""

import time
from collections.abc import Callable

from bridge.clock import SteadyClock
from bridge.core.times import NS_PER_S
from bridge.notices import Heard, Item


class Arrivals:
    """Gives items their times. Not for several threads, apart from now_ns()."""

    def __init__(self, clock: Callable[[], int], pace: Callable[[], int] = time.monotonic_ns) -> None:
        """clock gives Unix ns and may jump; it is the one that arrivals were read from. pace gives ns that do not jump."""
        self._clock, self._steady = clock, SteadyClock(clock, pace)
        self.last_ns = self._steady()
        """The time of the last item; before the first, that of the start."""

    def now_ns(self) -> int:
        """So late it is."""
        return self._steady()

    def times(self, items: list[Item], *, drained: bool) -> list[int]:
        """When each of these came that were waiting in the queue; drained: nothing waits behind them."""
        raw_ns = self._clock()
        now_ns = self._steady()
        ahead_ns = now_ns - raw_ns if now_ns - raw_ns > NS_PER_S else 0
        times = []
        follows_ns = now_ns if drained else 0
        for item in reversed(items):
            if isinstance(item, Heard):
                follows_ns = min(item.arrival_ns + ahead_ns, now_ns) if ahead_ns else item.arrival_ns
            times.append(follows_ns)
        times.reverse()
        for place, at_ns in enumerate(times):
            self.last_ns = times[place] = max(at_ns, self.last_ns)
        return times
