"""Events on their way to a put, and the ring of those that were put.

Rule 1: a batch holds events of one key that follow each other, encoded; one batch is one put.
Rule 2: what was put is kept, the last events and bytes of it, for those who missed it. Leaving the queue because it was full
is no reason to leave the ring.
Rule 3: nothing in the ring is tracked by the garbage collector, whose passes would cost more than sending.
"""

from array import array
from collections import deque
from collections.abc import Iterable

import msgspec

from bridge.core.sequence import Missing
from bridge.edges.bus import Sender


class KeyState:
    """What is known of one key: its numbers, who carries it, the batch that still takes events."""

    __slots__ = ("is_alarm", "key", "open", "put_key_seq", "sender", "sent_key_seq", "used_s")

    def __init__(self, key: str, is_alarm: bool) -> None:
        self.key = key
        self.is_alarm = is_alarm
        self.sender: Sender | None = None
        self.sent_key_seq = 0
        self.put_key_seq = 0
        self.used_s = 0.0
        self.open: Batch | None = None


class Batch:
    """Events of one key that wait for one put. Their numbers on the key start with first_key_seq; seqs are the session's.

    dropped: how many of them, the oldest first, have left the queue unsent. taken: the publishing thread has it.
    """

    __slots__ = ("dropped", "elements", "first_key_seq", "seqs", "state", "taken")

    def __init__(self, state: KeyState, first_key_seq: int) -> None:
        self.state = state
        self.first_key_seq = first_key_seq
        self.elements: list[bytes] = []
        self.seqs: list[int] = []
        self.dropped = 0
        self.taken = False

    @property
    def waiting(self) -> int:
        """How many of its events are still to be put."""
        return len(self.seqs) - self.dropped

    def kept(self) -> "Kept":
        """The events as the ring holds them, those that were dropped too."""
        return Kept(self.state.key, self.first_key_seq, tuple(self.elements), array("Q", self.seqs))


class Kept(msgspec.Struct, gc=False):
    """A batch that was put. gone: how many of its events, the oldest first, the ring has given up."""

    key: str
    first_key_seq: int
    elements: tuple[bytes, ...]
    seqs: "array[int]"
    gone: int = 0


class Ring:
    """The last events that were put, at most so many and so many bytes. evicted_seq: up to which seq some can be gone."""

    def __init__(self, max_events: int, max_bytes: int) -> None:
        self._max_events = max_events
        self._max_bytes = max_bytes
        self._events = 0
        self._bytes = 0
        self._kept: deque[Kept] = deque()
        self.evicted_seq = 0

    def add(self, kept: Kept) -> None:
        """Keep a batch, and give up the oldest events beyond the limits."""
        self._kept.append(kept)
        self._events += len(kept.seqs)
        self._bytes += sum(map(len, kept.elements))
        while self._events > self._max_events or self._bytes > self._max_bytes:
            old = self._kept[0]
            whole = not old.gone and self._events - len(old.seqs) >= self._max_events
            gone = len(old.seqs) if whole else old.gone + 1
            self._bytes -= sum(map(len, old.elements[old.gone : gone]))
            self._events -= gone - old.gone
            old.gone = gone
            self.evicted_seq = max(self.evicted_seq, old.seqs[gone - 1])
            if gone == len(old.seqs):
                self._kept.popleft()

    def all(self) -> list[Kept]:
        """What is kept now, the oldest first, whatever is given up while somebody looks through it (gone counts no more)."""
        kept = list(self._kept)
        if kept and (gone := kept[0].gone):  # only the oldest batch can have lost a part
            oldest = kept[0]
            kept[0] = Kept(oldest.key, oldest.first_key_seq + gone, oldest.elements[gone:], oldest.seqs[gone:])
        return kept


def find(batches: Iterable[Kept], missing: Missing) -> list[bytes]:
    """The elements of a range that are still held, in order."""
    found: list[bytes] = []
    for kept in batches:
        if kept.key == missing.key:
            first = max(0, missing.first - kept.first_key_seq)
            last = min(len(kept.seqs), missing.last - kept.first_key_seq + 1)
            found += [kept.elements[place] for place in range(first, last) if kept.seqs[place] > missing.after_seq]
    return found
