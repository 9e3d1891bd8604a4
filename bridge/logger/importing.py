"""A log from an export: events that were written as CSV or JSON Lines, in a new cache file.

Rule 1: what exists is never touched: the file appears under its name when it is whole.
Rule 2: events keep their unique ids, numbers and arrival, and come into the order in which they arrived, however the export was
sorted. An event whose target, session and seq are there already is a duplicate, and counted.
Rule 3: it is a log, not a state: no alarm is raised by it. A logger that is served from it gives unique ids above all of them.
"""

import errno
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Final

import msgspec

from bridge.core.questions import Stored
from bridge.edges.cache import Cache, StoreBatch
from bridge.edges.cache import Stored as Row
from bridge.logger.book import BATCH, NEXT_ID

_UNLIMITED: Final = 2**62


class Imported(msgspec.Struct, frozen=True):
    """How many events are in the new file, and how many were there twice."""

    events: int
    duplicates: int


class _Rows:
    """Rows as they come, and what they turned out to be."""

    def __init__(self, rows: Iterable[Stored]) -> None:
        self._rows = rows
        self.highest_id = self.count = 0
        self.rises = self.falls = True

    def __iter__(self) -> Iterator[Row]:
        before: Stored | None = None
        for row in self._rows:
            if before is not None and (step := _step(before, row)):
                self.rises &= step > 0
                self.falls &= step < 0
            before = row
            self.highest_id = max(self.highest_id, row.unique_id)
            self.count += 1
            yield Row(row.unique_id, row.arrival_ns, row.event)


def import_log(rows: Iterable[Stored], path: Path, *, on_progress: Callable[[int], None] | None = None) -> Imported:
    """Write the rows into a new cache file. on_progress is told how many were read.

    FileExistsError when there is something at the path; CacheError when it cannot be written; whatever reading a row raises.
    """
    if path.exists():
        raise FileExistsError(errno.EEXIST, "exists, and an import makes a new one", str(path))
    part, unsorted = (path.with_name(f"{path.name}.{suffix}") for suffix in ("part", "unsorted"))
    try:
        found = _Rows(rows)
        counts = _fill(part, found, found, on_progress)
        if not found.rises:
            part.rename(unsorted)
            with Cache(unsorted, max_bytes=_UNLIMITED) as cache:
                again = cache.query() if found.falls else cache.query(order="arrival_ns", newest_first=False)
                _fill(part, (Row(row.unique_id, row.arrival_ns, row.event) for row in again), found, None)
        part.rename(path)
    finally:
        for left in (part, unsorted):
            left.unlink(missing_ok=True)
    return counts


def _step(before: Stored, row: Stored) -> int:
    """Above 0 when the row arrived later, below when earlier; of those that came together the session's numbers tell."""
    if row.arrival_ns != before.arrival_ns or row.event.session != before.event.session:
        return row.arrival_ns - before.arrival_ns
    return row.event.seq - before.event.seq


def _fill(path: Path, rows: Iterable[Row], found: _Rows, on_progress: Callable[[int], None] | None) -> Imported:
    path.unlink(missing_ok=True)  # what an import that was killed left
    source = iter(rows)
    with Cache(path, max_bytes=_UNLIMITED) as cache:
        while batch := list(islice(source, BATCH)):
            cache.append(StoreBatch(batch))
            if on_progress is not None:
                on_progress(found.count)
        cache.append(StoreBatch(meta={NEXT_ID: str(found.highest_id + 1)}))
        cache.flush(60.0)
        return Imported(cache.counts.stored, cache.counts.duplicates)
