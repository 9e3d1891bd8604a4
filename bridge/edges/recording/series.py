"""Several recordings as one: by log time, and where that is equal in the order in which the files are named.

Rule 1: an event that is in several files, known by target, session and seq, is given once. Events without numbers, gaps,
rejected payloads and keyframes are given as often as they are there.
Rule 2: a file is opened when its first entry is due, so that a night split into many files needs the memory of one.
Rule 3: what is wrong with a file does not end the others; `damages` names it.
"""

import heapq
import os
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from bridge.core.events import DEFAULT_LIMITS, AnyEvent, Limits
from bridge.edges.recording.frames import Damage
from bridge.edges.recording.reader import EVERYTHING, Part, Recorded, RecordedEvent, RecordingReader, read_events

_PAGE_BITS: Final = 12


class Once:
    """Which events were seen: one bit for each number of a target's session."""

    def __init__(self) -> None:
        self._pages: dict[tuple[str, str, int], int] = {}

    def is_new(self, event: AnyEvent) -> bool:
        """Whether the event is seen for the first time; one without a number always is."""
        if not event.seq or not event.session:
            return True
        place = (event.target, event.session, event.seq >> _PAGE_BITS)
        bit = 1 << (event.seq & (1 << _PAGE_BITS) - 1)
        page = self._pages.get(place, 0)
        self._pages[place] = page | bit
        return not page & bit


class Series:
    """An iterator over recordings, and a context manager. RecordingError when one cannot be opened or is no MCAP file.

    When it is over, `damages` has what is wrong with which file, and `read_through` why a file was read from end to end.
    """

    def __init__(
        self, paths: Sequence[str | os.PathLike[str]], part: Part = EVERYTHING, *, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.paths = [Path(path) for path in paths]
        self.damages: dict[Path, Damage] = {}
        self.read_through: dict[Path, str] = {}
        self._part, self._limits = part, limits
        for path in self.paths:
            with read_events(path):
                pass  # what is no recording is told before anything is given
        self._items = self._one() if len(self.paths) == 1 else self._merged()

    def __iter__(self) -> Iterator[Recorded]:
        return self

    def __next__(self) -> Recorded:
        return next(self._items)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close every file; the iteration ends."""
        self._items.close()

    def _open(self, path: Path) -> RecordingReader:
        reader = read_events(path, self._part, limits=self._limits)
        if reader.read_through and not self._part.is_all:
            self.read_through[path] = reader.read_through
        return reader

    def _ended(self, reader: RecordingReader) -> None:
        if reader.damage is not None:
            self.damages[reader.path] = reader.damage

    def _one(self) -> Generator[Recorded, None, None]:
        with self._open(self.paths[0]) as reader:
            yield from reader
            self._ended(reader)

    def _merged(self) -> Generator[Recorded, None, None]:
        starts = []
        for number, path in enumerate(self.paths):
            with self._open(path) as reader:
                first = next(reader, None)
                if first is not None:
                    starts.append((first.log_time_ns, number))
                else:
                    self._ended(reader)
        starts.sort(reverse=True)
        once = Once()
        open_now: list[tuple[int, int, Recorded, RecordingReader]] = []
        try:
            while starts or open_now:
                while starts and (not open_now or starts[-1][0] <= open_now[0][0]):
                    number = starts.pop()[1]
                    self._step(open_now, number, self._open(self.paths[number]))
                if not open_now:
                    continue
                _, number, item, reader = open_now[0]
                if not isinstance(item, RecordedEvent) or once.is_new(item.event):
                    yield item
                heapq.heappop(open_now)
                self._step(open_now, number, reader)
        finally:
            for *_, reader in open_now:
                reader.close()

    def _step(self, open_now: list[tuple[int, int, Recorded, RecordingReader]], number: int, reader: RecordingReader) -> None:
        item = next(reader, None)
        if item is None:
            self._ended(reader)
        else:
            heapq.heappush(open_now, (item.log_time_ns, number, item, reader))


def read_series(paths: Sequence[str | os.PathLike[str]], part: Part = EVERYTHING, *, limits: Limits = DEFAULT_LIMITS) -> Series:
    """Read several recordings, or a part of them, in one order. Use it in a `with` unless you iterate to the end."""
    return Series(paths, part, limits=limits)
