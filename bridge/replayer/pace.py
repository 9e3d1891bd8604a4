"""What time it is in a recording that is being played: the replay time.

Rule 1: while it runs, replay time goes `rate` times as fast as the clock that was handed in; while it stands, not at all.
Rule 2: at rate 0 nothing is waited for: the time is that of the last event played.
Rule 3: whoever asks and whoever changes it take turns; there is no lock here.
"""

import math
from collections.abc import Callable
from typing import Final

_NS: Final = 1e9
MAX_RATE: Final = 1e6
"""Eleven days a second; who wants more wants 0."""


class Pace:
    """Replay time, in Unix ns of the recording."""

    def __init__(self, rate: float, clock_s: Callable[[], float], *, running: bool = True) -> None:
        """ValueError for a rate outside 0..MAX_RATE. clock_s gives seconds that never go back."""
        self._clock_s = clock_s
        self._at_ns, self._since_s = 0, clock_s()
        self.running = running
        self.rate = _checked(rate)

    @property
    def now_ns(self) -> int:
        """The replay time."""
        if not self.running or not self.rate:
            return self._at_ns
        return self._at_ns + int((self._clock_s() - self._since_s) * self.rate * _NS)

    def jump(self, at_ns: int) -> None:
        """Go on from there."""
        self._at_ns, self._since_s = at_ns, self._clock_s()

    def play(self, at_ns: int) -> None:
        """An event of that time is played: it is not earlier."""
        if at_ns > self.now_ns:
            self.jump(at_ns)

    def run(self, running: bool) -> None:
        """Run, or stand still."""
        self.jump(self.now_ns)
        self.running = running

    def change(self, rate: float) -> None:
        """Another rate from now on. ValueError for one outside 0..MAX_RATE."""
        rate = _checked(rate)
        self.jump(self.now_ns)
        self.rate = rate

    def left_s(self, at_ns: int) -> float:
        """Seconds of the clock until the replay time is at_ns; 0 when it is due, infinite when it stands still."""
        if not self.running:
            return math.inf
        return max(0.0, (at_ns - self.now_ns) / _NS / self.rate) if self.rate else 0.0


def _checked(rate: float) -> float:
    if not 0 <= rate <= MAX_RATE:
        raise ValueError(f"rate {rate:g} is not within 0..{MAX_RATE:g}; 0 is as fast as it can")
    return rate
