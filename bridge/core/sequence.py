"""What is missing: gaps and duplicates, told from session, key and key_seq.

Rule 1: a sender numbers its events 1, 2, ... per session and key, so a receiver of only some keys still sees each loss.
Rule 2: an event whose number is at or below the last one is a duplicate. What fills a gap is handed over by who asked for it.
Rule 3: a beat says how far each key has come; what it names and nobody saw is a lost tail.
Rule 4: the promise starts with the first beat. What a key had before that was never promised. For keys that a receiver
        wants only from now on (join) it starts with the next beat.
Rule 5: key_seq 0 is a sender that does not number: nothing can be said about it.
"""

from collections.abc import Callable, Mapping

import msgspec

from bridge.core.events import Count


class Missing(msgspec.Struct, frozen=True):
    """A range of numbers of one session and key that has not come: first and last are included.

    after_seq: only events with a greater seq are promised (0: all of the range).
    """

    session: str
    key: str
    first: Count
    last: Count
    after_seq: Count = 0

    @property
    def count(self) -> int:
        """How many numbers the range has."""
        return self.last - self.first + 1


class Beat(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A sender's numbers, sent each second: the last seq, and the last key_seq of each key used in the last 60 s.

    final: it has closed, nothing follows. unsent: events it could not hand to the bus before closing. marks: of a logger, how
    often it has marked alarms suspect or taken marks off, of which no event tells.
    """

    target: str
    session: str
    role: str = "publisher"
    seq: Count = 0
    keys: dict[str, Count] = {}
    final: bool = False
    unsent: Count = 0
    marks: Count = 0


class _Join(msgspec.Struct):
    """Keys wanted from some moment on: which, of whom, and after which seq they are promised, once a beat has said it."""

    fresh: Callable[[str], bool]
    sessions: frozenset[str]
    after: dict[str, int]


class Tracker:
    """The last number seen per session and key."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], int] = {}
        self._started: dict[str, int] = {}
        self._taken: set[tuple[str, str]] = set()
        self._joins: list[_Join] = []

    def started(self, session: str) -> bool:
        """Whether a beat of this session has been seen, so that its losses are visible."""
        return session in self._started

    def start(self, session: str) -> int | None:
        """After which seq of a session every event is promised: that of its first beat; None before it."""
        return self._started.get(session)

    def join(self, fresh: Callable[[str], bool]) -> None:
        """The keys that `fresh` picks are wanted from now on and were not before: their promise starts with the next beat."""
        for place in [place for place in self._last if fresh(place[1])]:
            del self._last[place]
            self._taken.discard(place)
        self._joins = [join for join in self._joins if not join.sessions.isdisjoint(self._started)]
        self._joins.append(_Join(fresh, frozenset(self._started), {}))

    def _promised_after(self, session: str, key: str) -> int | None:
        """After which seq the events of a key are promised; None before the beat that says it."""
        for join in reversed(self._joins):
            if session in join.sessions and join.fresh(key):
                return join.after.get(session)
        return self._started.get(session)

    def heard(self, session: str) -> bool:
        """Whether anything numbered of this session was seen: a beat or an event."""
        return session in self._started or any(place[0] == session for place in self._last)

    def last(self, session: str, key: str) -> int | None:
        """The last number seen, None before the first."""
        return self._last.get((session, key))

    def see(self, session: str, key: str, first: int, last: int) -> Missing | None:
        """Take note of events first..last of a key that follow each other; what is missing before them, if anything.

        A range that lies wholly at or below what was seen is a duplicate: `is_duplicate` tells before.
        """
        place = (session, key)
        seen = self._last.get(place)
        if place in self._taken:
            self._taken.discard(place)
            if seen is not None and first <= seen:
                self._last[place] = last
                return None
        if seen is None:
            self._last[place] = last
            after = self._promised_after(session, key)
            if after is None or first == 1:
                return None
            return Missing(session, key, 1, first - 1, after)
        if last > seen:
            self._last[place] = last
        return Missing(session, key, seen + 1, first - 1) if first > seen + 1 else None

    def is_duplicate(self, session: str, key: str, number: int) -> bool:
        """Whether this number was passed before."""
        place = (session, key)
        seen = self._last.get(place)
        return seen is not None and number <= seen and place not in self._taken

    def beat(self, beat: Beat, keys: Mapping[str, int] | None = None) -> list[Missing]:
        """The tails a beat reveals. `keys` restricts it to the keys that the receiver wanted.

        The first beat of a session sets the start: what it names is taken as seen. Events before it that are still on
        their way to us are no duplicates when they come.
        """
        keys = beat.keys if keys is None else keys
        if beat.session not in self._started:
            self._started[beat.session] = beat.seq
            self._take(beat.session, keys)
            return []
        for join in self._joins:
            if beat.session in join.sessions and beat.session not in join.after:
                join.after[beat.session] = beat.seq
                self._take(beat.session, {key: number for key, number in keys.items() if join.fresh(key)})
        tails = []
        for key, number in keys.items():
            seen = self._last.get((beat.session, key))
            if seen is None:
                tails.append(Missing(beat.session, key, 1, number, self._promised_after(beat.session, key) or 0))
            elif number > seen:
                tails.append(Missing(beat.session, key, seen + 1, number))
        return tails

    def _take(self, session: str, keys: Mapping[str, int]) -> None:
        for key, number in keys.items():
            if (session, key) not in self._last:
                self._last[session, key] = number
                self._taken.add((session, key))

    def pass_over(self, missing: Missing) -> None:
        """Take a range as dealt with: delivered by repair or reported."""
        place = (missing.session, missing.key)
        self._last[place] = max(self._last.get(place, 0), missing.last)

    def step_back(self, session: str, key: str, number: int) -> None:
        """Take `number` as the last one of a key: what was seen beyond it did not come from its sender."""
        if number:
            self._last[session, key] = number
        else:
            self._last.pop((session, key), None)

    def forget(self, session: str) -> None:
        """Drop everything about a session that is over."""
        self._started.pop(session, None)
        for place in [place for place in self._last if place[0] == session]:
            del self._last[place]
            self._taken.discard(place)
