"""What recordings span, and what a person means by a place in them.

A place is a number of seconds from the first entry of the recordings, or a time (ISO 8601). Both are about when something was
recorded, which never goes back, not about what the events say of themselves.
"""

import os
from collections.abc import Iterable, Mapping
from decimal import Decimal, InvalidOperation

import msgspec

from bridge.core.times import NS_PER_S, TimeError, check_time, parse_time, time_text
from bridge.edges.recording import keyframe_places, summary


class Span(msgspec.Struct, frozen=True, kw_only=True):
    """What several recordings hold together. Times are Unix ns of recording, 0 when there is nothing."""

    first_ns: int = 0
    last_ns: int = 0
    events: int = 0
    targets: frozenset[str] = frozenset()

    def place(self, text: str) -> int:
        """The Unix ns that a text means: "90" and "90.5" are seconds from the start, the rest is a time. TimeError else."""
        try:
            offset = Decimal(text.strip())
        except InvalidOperation:
            return parse_time(text)
        if not offset.is_finite() or offset < 0:
            raise TimeError(f"{text!r} is no place in a recording; expected seconds from its start, or a time")
        return check_time(self.first_ns + int(offset * NS_PER_S))

    def inside(self, text: str) -> int:
        """The same for a place that somebody wants to go to; TimeError for one before the start or behind the end too."""
        at_ns = self.place(text)
        if not self.first_ns <= at_ns <= self.last_ns:
            raise TimeError(
                f"{text!r} is not in the recording, which begins at {time_text(self.first_ns)}"
                f" and ends {self.offset_s(self.last_ns):g} s later, at {time_text(self.last_ns)}"
            )
        return at_ns

    def offset_s(self, at_ns: int) -> float:
        """Seconds from the start, for people."""
        return round((at_ns - self.first_ns) / NS_PER_S, 3)


def span_of(paths: Iterable[str | os.PathLike[str]]) -> Span:
    """The span of recordings, from their summaries where they have one. RecordingError for a file that is no recording."""
    infos = [summary(path) for path in paths]
    all_totals = [info.totals for info in infos]
    standing = {target for info in infos if info.totals.states for _, target in keyframe_places(info.path)}
    return Span(
        first_ns=min((totals.first_log_time_ns for totals in all_totals if totals.last_log_time_ns), default=0),
        last_ns=max((totals.last_log_time_ns for totals in all_totals), default=0),
        events=sum(totals.events for totals in all_totals),
        targets=frozenset(count.target for totals in all_totals for count in totals.counts) | standing,
    )


class RemapError(ValueError):
    """Targets that cannot be renamed so; says why."""


def check_remap(remap: Mapping[str, str], targets: Iterable[str]) -> None:
    """Return when every renamed target is in the recording and no two become one; RemapError else."""
    known = set(targets)
    if unknown := sorted(remap.keys() - known):
        raise RemapError(f"{', '.join(unknown)}: not in the recording, which has {', '.join(sorted(known)) or 'no target'}")
    goals: dict[str, str] = {}
    for target in sorted(known):
        goal = remap.get(target, target)
        if goal in goals:
            raise RemapError(f"{goals[goal]} and {target} would both be {goal}")
        goals[goal] = target
