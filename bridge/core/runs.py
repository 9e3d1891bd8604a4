"""Two runs of the same thing compared: which alarms are new, gone, later or longer, and which messages came more or less often.

Rule 1: times are the events' own, counted from a zero of each run (its first event, unless told otherwise), so that two days
and two clocks can be compared. Rates of the clocks are taken to be equal.
Rule 2: a life of an alarm is from its raise to its clear or dispose. Lives of the same alarm (target, class, id and source) are
paired in their order; when one run has more of them, those are left over whose leaving gives the smallest sum of shifts.
Rule 3: a pair is told as later or earlier, longer or shorter, when it is so by more than the tolerance. Lives that began before
their run have no start to compare, lives that are not over at its end have no length.
Rule 4: messages are counted per target, class and id; any difference is told.
"""

from collections.abc import Iterable, Sequence
from typing import Final, Literal, TypeAlias

import msgspec

from bridge.core.alarms import Alarm, AlarmKey, alarm_key
from bridge.core.events import AlarmDisposed, AlarmEvent, AlarmRaised, AnyEvent, MessageSent

MAX_PAIRS: Final = 4_000_000
"""Beyond so many possible pairs of one alarm the first lives are paired and the last are left over."""

What: TypeAlias = Literal["new", "gone", "later", "earlier", "longer", "shorter", "not cleared", "cleared"]
MessageKey: TypeAlias = tuple[str, str, int]


class Life(msgspec.Struct):
    """One life of an alarm, in ns from the run's zero. start_ns None: before the run; end_ns None: not over at its end.

    last is its last transition, or the alarm of a keyframe.
    """

    start_ns: int | None
    end_ns: int | None
    last: AlarmEvent | Alarm

    @property
    def length_ns(self) -> int | None:
        """How long it was, None when that is not known."""
        return self.end_ns - self.start_ns if self.start_ns is not None and self.end_ns is not None else None


class Run:
    """What one recording tells, as it goes by. zero_ns: what times are counted from, 0 for the first event that has a time."""

    def __init__(self, zero_ns: int = 0) -> None:
        self.zero_ns = zero_ns
        self.lives: dict[AlarmKey, list[Life]] = {}
        self.messages: dict[MessageKey, int] = {}
        self.samples: dict[MessageKey, MessageSent] = {}
        self._open: dict[AlarmKey, Life] = {}

    def state(self, alarms: Iterable[Alarm]) -> None:
        """Take a keyframe: what is raised in it and was not seen began before."""
        for alarm in alarms:
            if alarm.raised and alarm.key not in self._open:
                self._begin(alarm.key, None, alarm)

    def event(self, event: AnyEvent) -> None:
        """Take the next event."""
        if not self.zero_ns:
            self.zero_ns = event.time_ns
        if isinstance(event, MessageSent):
            place = (event.target, event.event_class, event.event_id)
            self.messages[place] = self.messages.get(place, 0) + 1
            self.samples.setdefault(place, event)
            return
        key = alarm_key(event)
        life = self._open.get(key)
        if isinstance(event, AlarmRaised):
            start_ns = (event.time_raised_ns or event.time_ns) - self.zero_ns
            if life is not None and life.start_ns == start_ns:
                return
            if life is not None:
                life.end_ns = start_ns
            self._begin(key, start_ns, event)
            return
        if life is None and event.raised:
            life = self._begin(key, None, event)
        if life is None:
            return
        life.last = event
        if not event.raised or isinstance(event, AlarmDisposed):
            life.end_ns = (event.time_cleared_ns or event.time_ns) - self.zero_ns
            del self._open[key]

    def _begin(self, key: AlarmKey, start_ns: int | None, item: AlarmEvent | Alarm) -> Life:
        life = self._open[key] = Life(start_ns, None, item)
        self.lives.setdefault(key, []).append(life)
        return life


class Difference(msgspec.Struct, frozen=True):
    """One alarm life that differs: which one of its alarm (from 1, in the run that has it), and by how much if that is told."""

    what: What
    key: AlarmKey
    occurrence: int
    first: Life | None
    second: Life | None
    by_ns: int = 0


class CountDifference(msgspec.Struct, frozen=True):
    """A message that came `first` times in one run and `second` times in the other."""

    target: str
    event_class: str
    event_id: int
    first: int
    second: int


def alarm_differences(first: Run, second: Run, tolerance_ns: int) -> list[Difference]:
    """How the alarms of the second run differ from those of the first, in the order of their times."""
    found: list[Difference] = []
    for key in {**first.lives, **second.lives}:
        one, other = first.lives.get(key, []), second.lives.get(key, [])
        for left, right in paired(one, other):
            if left is None or right is None:
                if right is not None:
                    found.append(Difference("new", key, right + 1, None, other[right]))
                elif left is not None:
                    found.append(Difference("gone", key, left + 1, one[left], None))
                continue
            what = _told(one[left], other[right], tolerance_ns)
            found += [Difference(word, key, left + 1, one[left], other[right], by_ns) for word, by_ns in what]
    return sorted(found, key=_place)


def message_differences(first: Run, second: Run) -> list[CountDifference]:
    """Which messages came more or less often."""
    return [
        CountDifference(*place, first.messages.get(place, 0), second.messages.get(place, 0))
        for place in sorted({**first.messages, **second.messages})
        if first.messages.get(place, 0) != second.messages.get(place, 0)
    ]


def _place(difference: Difference) -> tuple[int, str, str, int]:
    life = difference.first or difference.second
    start_ns = life.start_ns if life is not None and life.start_ns is not None else 0
    return start_ns, difference.key.target, difference.key.event_class, difference.key.event_id


def _told(one: Life, other: Life, tolerance_ns: int) -> list[tuple[What, int]]:
    told: list[tuple[What, int]] = []
    if one.start_ns is not None and other.start_ns is not None and abs(by_ns := other.start_ns - one.start_ns) > tolerance_ns:
        told.append(("later" if by_ns > 0 else "earlier", abs(by_ns)))
    if (one.end_ns is None) is not (other.end_ns is None):
        told.append(("not cleared" if other.end_ns is None else "cleared", 0))
    elif one.length_ns is not None and other.length_ns is not None:
        by_ns = other.length_ns - one.length_ns
        if abs(by_ns) > tolerance_ns:
            told.append(("longer" if by_ns > 0 else "shorter", abs(by_ns)))
    return told


def paired(one: Sequence[Life], other: Sequence[Life]) -> list[tuple[int | None, int | None]]:
    """Which life goes with which, both in their order; None for those that are left over."""
    if len(one) > len(other):
        return [(right, left) for left, right in paired(other, one)]
    spare = len(other) - len(one)
    if not spare or not one or (spare + 1) * len(one) > MAX_PAIRS:
        return [(place if place < len(one) else None, place) for place in range(len(other))]
    # cost[s] is the least sum of shifts of the lives so far when s of the other's are left over before this one
    cost = [0] * (spare + 1)
    chosen: list[list[int]] = []
    for place, life in enumerate(one):
        best, least = [], 0
        for skipped in range(spare + 1):
            if skipped == 0 or cost[skipped] < cost[least]:
                least = skipped
            best.append(least)
        cost = [cost[best[skipped]] + _shift(life, other[place + skipped]) for skipped in range(spare + 1)]
        chosen.append(best)
    skipped = min(range(spare + 1), key=cost.__getitem__)
    partner: dict[int, int] = {}
    for place in range(len(one) - 1, -1, -1):
        partner[place + skipped] = place
        skipped = chosen[place][skipped]
    return [(partner.get(place), place) for place in range(len(other))]


def _shift(one: Life, other: Life) -> int:
    if one.start_ns is None or other.start_ns is None:
        return 0 if one.start_ns is other.start_ns else abs((one.end_ns or 0) - (other.end_ns or 0))
    return abs(one.start_ns - other.start_ns)
