"""The cache of a logger: events and alarm states in SQLite, written by one thread and read from any.

Rule 1: a StoreBatch is committed whole or not at all, batches in the order of append(). Up to 1,000 rows share a transaction.
Rule 2: nothing is dropped silently. While a write fails the rows wait, `error` says why, append() and flush() raise it, and
the writer tries again each second when it was the disk that was full. What close() could not write it returns as a number.
Rule 3: reading sees what is committed; flush() first to see what was just appended.
Rule 4: when the file holds more than max_bytes, or more than max_events, the older half of the events goes; with max_age_s the
oldest go as far as they arrived longer ago. Alarm states never go. What went is told (on_dropped) and counted in `meta`.

Synchronous is NORMAL: a killed process loses nothing that was flushed, a power cut may lose the last transactions.
flush(durable=True) and append(durable=True) are for state that must survive the power cut too (synchronous FULL).
"""

import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self, TypeAlias

import msgspec

from bridge.edges.cache.file import CacheError, cache_error, open_file, used_bytes
from bridge.edges.cache.queries import ANSWERS_KEPT, Queries
from bridge.edges.cache.rows import (
    EVENT_COLUMNS,
    AlarmRow,
    EventRow,
    RowError,
    StoreBatch,
    StoredAnswer,
    alarm_row,
    event_row,
    key_bytes,
)

TRANSACTION_ROWS: Final = 1_000
MIN_BYTES: Final = 256 * 1024
MIN_EVENTS: Final = 2
_RETRY_S: Final = 1.0
_ROOM_S: Final = 10.0
_RETRIED: Final = ("SQLITE_FULL", "SQLITE_IOERR_WRITE")

_INSERT: Final = (
    f"INSERT INTO events ({', '.join(EVENT_COLUMNS)}) VALUES ({', '.join('?' * len(EVENT_COLUMNS))}) "
    "ON CONFLICT (target, session, seq) WHERE seq > 0 DO NOTHING"
)
_UPSERT_ALARM: Final = "INSERT OR REPLACE INTO alarms (key, target, unique_id, body) VALUES (?, ?, ?, ?)"
_REMOVE_ALARM: Final = "DELETE FROM alarms WHERE key = ?"
_UPSERT_META: Final = "INSERT OR REPLACE INTO meta (name, value) VALUES (?, ?)"
_COUNT_META: Final = (
    "INSERT INTO meta (name, value) VALUES (?, ?) "
    "ON CONFLICT (name) DO UPDATE SET value = CAST(value AS INTEGER) + CAST(excluded.value AS INTEGER)"
)
_INSERT_ANSWER: Final = "INSERT OR IGNORE INTO answers (question, session, seq, created) VALUES (?, ?, ?, ?)"
_ANSWERS_STEP: Final = 100
_FORGET_ANSWERS: Final = "DELETE FROM answers WHERE number <= (SELECT max(number) FROM answers) - ?"
_AGE_STEP_S: Final = 60.0
_FORGET_ROWS: Final = 5_000

_AlarmRows: TypeAlias = dict[bytes, AlarmRow | None]


class CacheCounts(msgspec.Struct, frozen=True):
    """Events since opening: stored, already there (same target, session and seq), dropped for size, waiting, refused."""

    stored: int = 0
    duplicates: int = 0
    dropped: int = 0
    pending: int = 0
    refused: int = 0


class Drop(msgspec.Struct, frozen=True):
    """The oldest `count` events were dropped, and which limit made it so. quiet: they were all of quiet_class."""

    count: int
    reason: Literal["max_bytes", "max_events", "max_age"]
    quiet: bool = False


class _Prepared(msgspec.Struct, frozen=True):
    events: list[EventRow]
    alarms: _AlarmRows
    meta: dict[str, str]
    answers: Sequence[StoredAnswer]

    @property
    def size(self) -> int:
        return len(self.events) + len(self.alarms) + len(self.meta) + len(self.answers)


def _prepare(batch: StoreBatch) -> _Prepared:
    alarms: _AlarmRows = {}
    for kept in batch.alarms:
        row = alarm_row(kept)
        alarms[row[0]] = row
    for gone in batch.removals:
        alarms[key_bytes(gone)] = None
    for name, value in batch.meta.items():
        try:
            (name + value).encode()
        except (UnicodeEncodeError, TypeError) as error:
            raise RowError(f"meta {name!r} = {value!r}: {error}") from None
    return _Prepared([event_row(stored) for stored in batch.events], alarms, dict(batch.meta), batch.answers)


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


def _write(
    connection: sqlite3.Connection,
    events: list[EventRow],
    alarms: _AlarmRows,
    meta: dict[str, str],
    answers: Sequence[StoredAnswer],
) -> int:
    stored = connection.executemany(_INSERT, events).rowcount if events else 0
    if alarms:
        connection.executemany(_UPSERT_ALARM, [row for row in alarms.values() if row is not None])
        connection.executemany(_REMOVE_ALARM, [(key,) for key, row in alarms.items() if row is None])
    if meta:
        connection.executemany(_UPSERT_META, meta.items())
    if answers:
        connection.executemany(_INSERT_ANSWER, answers)
    return stored


@contextmanager
def _synced(connection: sqlite3.Connection) -> Iterator[None]:
    """A transaction that is on the disk when it is over, with all before it. It changes a row, so that there is a commit."""
    connection.execute("PRAGMA synchronous=FULL")
    try:
        with _transaction(connection):
            yield
            connection.execute(_COUNT_META, ("durable_commits", "1"))
    finally:
        connection.execute("PRAGMA synchronous=NORMAL")


def _number(connection: sqlite3.Connection, text: str, *values: int) -> int | None:
    """The one integer that a SELECT finds; None for none."""
    row = connection.execute(text, values).fetchone()
    return None if row is None or row[0] is None else int(row[0])


def _half(connection: sqlite3.Connection) -> int | None:
    count = _number(connection, "SELECT count(*) FROM events") or 0
    return _number(connection, "SELECT id FROM events ORDER BY id LIMIT 1 OFFSET ?", (count - 1) // 2) if count else None


def _holds_more(connection: sqlite3.Connection, events: int) -> bool:
    """Whether there are more. Rows are numbered, so that they need counting only when some between were cleared."""
    first, last = _number(connection, "SELECT min(id) FROM events"), _number(connection, "SELECT max(id) FROM events")
    if first is None or last is None or last - first < events:
        return False
    return (_number(connection, "SELECT count(*) FROM events") or 0) > events


def _last_before(connection: sqlite3.Connection, arrival_ns: int) -> int | None:
    """The last of the oldest events that arrived before; one that arrived later keeps all behind it, whatever the clock did."""
    kept = _number(connection, "SELECT id FROM events WHERE arrival_ns >= ? ORDER BY id LIMIT 1", arrival_ns)
    if kept is None:
        return _number(connection, "SELECT max(id) FROM events")
    return _number(connection, "SELECT max(id) FROM events WHERE id < ?", kept)


def steady_clock() -> Callable[[], int]:
    """Unix ns that do not jump with the wall clock: its time now, and what has passed since."""
    ahead_ns = time.time_ns() - time.monotonic_ns()
    return lambda: time.monotonic_ns() + ahead_ns


class Cache(Queries):
    """Events and alarm states of a logger, in a file or in ":memory:". A context manager; safe to use from any thread.

    max_bytes, max_events: what the file may hold before the older half of the events is dropped; max_age_s: how long an event
    is kept after it arrived, by `clock` (Unix ns; one that does not jump unless told otherwise). on_dropped is told, on the
    writer's thread. CacheError when the file is not ours, damaged, newer or in use.
    """

    def __init__(
        self,
        path: str | Path = ":memory:",
        *,
        max_bytes: int = 20_000_000,
        max_events: int | None = None,
        max_age_s: float | None = None,
        on_dropped: Callable[[Drop], None] | None = None,
        quiet_class: str = "",
        max_pending: int = 100_000,
        clock: Callable[[], int] | None = None,
    ) -> None:
        if max_bytes < MIN_BYTES:
            raise ValueError(f"max_bytes {max_bytes} is below {MIN_BYTES}")
        if max_events is not None and max_events < MIN_EVENTS:
            raise ValueError(f"max_events {max_events} is below {MIN_EVENTS}")
        if max_age_s is not None and not max_age_s > 0:
            raise ValueError(f"max_age_s {max_age_s} is not above 0")
        self.path = str(path)
        self.max_bytes, self.max_events, self.max_age_s = max_bytes, max_events, max_age_s
        self.on_dropped, self.quiet_class = on_dropped, quiet_class
        self.clock = steady_clock() if clock is None else clock
        self._max_pending = max_pending
        super().__init__(open_file(self.path))
        self._change = threading.Condition()  # guards everything below
        self._queue: deque[_Prepared] = deque()
        self._pending_rows = self._pending_events = 0
        self._accepted = self._committed = self._durable = self._durable_wanted = 0
        self._answers = _ANSWERS_STEP
        self._stored = self._duplicates = self._dropped = self._refused = 0
        self._error: CacheError | None = None
        self._closing = self._closed = False
        self._writer = threading.Thread(target=self._run, name="cache-writer", daemon=True)
        self._writer.start()

    # -- writing ---------------------------------------------------------------------------------------------------------

    def append(self, batch: StoreBatch, *, durable: bool = False) -> None:
        """Take a batch to be written; returns at once, unless so much waits already that the disk must catch up first.

        CacheError while writing fails, when closed, or when there was no room for 10 s: then nothing of it was taken.
        RowError when a value fits no column. An event whose target, session and seq (above 0) are there already is a duplicate
        and changes nothing.
        """
        prepared = _prepare(batch)
        with self._change:
            # on_dropped may append: the writer must not wait for itself, and it drains what comes while it is closing.
            if threading.current_thread() is not self._writer and (error := self._refusal(prepared)) is not None:
                self._refused += len(prepared.events)
                raise error
            self._queue.append(prepared)
            self._pending_rows += prepared.size
            self._pending_events += len(prepared.events)
            self._accepted += 1
            if durable:
                self._durable_wanted = self._accepted
            self._change.notify_all()

    def flush(self, timeout_s: float = 10.0, *, durable: bool = False) -> None:
        """Return when everything appended so far is committed (durable: and safe from a power cut).

        CacheError when it cannot be written, TimeoutError after timeout_s.
        """
        with self._change:
            goal = self._accepted
            if durable and self._durable < goal and not self._closing:
                self._durable_wanted = goal
                self._change.notify_all()

            def done() -> bool:
                return self._committed >= goal and (not durable or self._durable >= goal)

            self._change.wait_for(lambda: done() or self._error is not None or self._closed, timeout_s)
            if done():
                return
            if self._error is not None:
                raise self._error
            if self._closed:
                raise CacheError(self.path, "is closed")
            raise TimeoutError(f"cache {self.path}: {self._pending_rows} rows still wait after {timeout_s} s")

    @property
    def error(self) -> CacheError | None:
        """Why writing fails at present; None when it does not."""
        with self._change:
            return self._error

    @property
    def counts(self) -> CacheCounts:
        """What became of the events since opening."""
        with self._change:
            return CacheCounts(self._stored, self._duplicates, self._dropped, self._pending_events, self._refused)

    def _refusal(self, prepared: _Prepared) -> CacheError | None:
        """Wait until there is room for a batch; why it cannot be taken, None when it can."""

        def has_room() -> bool:
            return not self._queue or self._pending_rows + prepared.size <= self._max_pending

        self._change.wait_for(lambda: self._closing or self._error is not None or has_room(), _ROOM_S)
        if self._error is not None:
            return self._error
        if self._closing:
            return CacheError(self.path, "is closed")
        return None if has_room() else CacheError(self.path, f"{self._pending_rows} rows are waiting and the disk takes none")

    # -- the writer's thread ---------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while self._wait_for_work():
                try:
                    if self._has_work:
                        self._write_some()
                    self._keep_limits()
                    self._succeeded()
                except sqlite3.Error as error:
                    if not self._failed(error):
                        return
        except BaseException as error:
            with self._change:
                self._error = CacheError(self.path, f"the writer stopped: {error!r}")
            raise
        finally:
            self._file.close()
            with self._change:
                self._closing = self._closed = True
                self._change.notify_all()

    def _wait_for_work(self) -> bool:
        """Wait until there is something to write or to drop; False when the cache is closing and nothing is left."""
        step_s = None if self.max_age_s is None else min(_AGE_STEP_S, self.max_age_s / 10)
        with self._change:
            self._change.wait_for(lambda: self._has_work or self._error is not None or self._closing, step_s)
            return self._has_work or not self._closing

    @property
    def _has_work(self) -> bool:
        return bool(self._queue) or self._durable_wanted > self._durable

    def _succeeded(self) -> None:
        with self._change:
            self._error = None
            self._change.notify_all()

    def _failed(self, error: sqlite3.Error) -> bool:
        """Keep the error; True when it is worth trying again, after a pause."""
        reason = cache_error(self.path, error)
        with self._change:
            self._error = reason
            self._change.notify_all()
            if not reason.code.startswith(_RETRIED):
                self._change.wait_for(lambda: self._closing)
            elif not self._closing:
                self._change.wait_for(lambda: self._closing, _RETRY_S)
                return True
            return False

    def _write_some(self) -> None:
        with self._change:
            batches: list[_Prepared] = []
            rows = 0
            for prepared in self._queue:
                if batches and rows + prepared.size > TRANSACTION_ROWS:
                    break
                batches.append(prepared)
                rows += prepared.size
            last = self._committed + len(batches)
            durable = self._durable_wanted > self._durable
        events = [row for prepared in batches for row in prepared.events]
        alarms = {key: value for prepared in batches for key, value in prepared.alarms.items()}
        meta = {name: value for prepared in batches for name, value in prepared.meta.items()}
        answers = [answer for prepared in batches for answer in prepared.answers]
        with self._file.turn() as connection, _synced(connection) if durable else _transaction(connection):
            stored = _write(connection, events, alarms, meta, answers)
            self._answers += len(answers)
            if self._answers >= _ANSWERS_STEP:
                connection.execute(_FORGET_ANSWERS, (ANSWERS_KEPT,))
                self._answers = 0
        with self._change:
            for _ in batches:
                self._queue.popleft()
            self._pending_rows -= rows
            self._pending_events -= len(events)
            self._stored += stored
            self._duplicates += len(events) - stored
            self._committed = last
            if durable:
                self._durable = last
            self._change.notify_all()

    def _keep_limits(self) -> None:
        while True:
            with self._file.turn() as connection:
                drop = self._drop_some(connection)
            if drop is None:
                return
            with self._change:
                self._dropped += drop.count
            if self.on_dropped is not None:
                self.on_dropped(drop)

    def _drop_some(self, connection: sqlite3.Connection) -> Drop | None:
        """Drop what is over a limit; None when nothing is."""
        reason: Literal["max_bytes", "max_events", "max_age"]
        if used_bytes(connection) > self.max_bytes:
            reason, last = "max_bytes", _half(connection)
        elif self.max_events is not None and _holds_more(connection, self.max_events):
            reason, last = "max_events", _half(connection)
        elif self.max_age_s is not None:
            reason, last = "max_age", _last_before(connection, self.clock() - int(self.max_age_s * 1e9))
        else:
            return None
        if last is None:
            return None
        text = "SELECT EXISTS (SELECT 1 FROM events WHERE id <= ? AND event_class <> ?)"
        (loud,) = connection.execute(text, (last, self.quiet_class)).fetchone()
        with _transaction(connection):
            count = connection.execute("DELETE FROM events WHERE id <= ?", (last,)).rowcount
            connection.execute(_COUNT_META, ("dropped_events", str(count)))
        return Drop(count, reason, quiet=not loud)

    # -- forgetting on demand --------------------------------------------------------------------------------------------

    def forget(self, rows: Sequence[int] | None = None, lives: Sequence[int] = ()) -> int:
        """Delete events: these rows and all transitions of these lives (unique ids), or with None every committed event.

        How many went; alarm states stay. Others read and write in between, so a kill leaves the first part deleted.
        CacheError when it cannot be done.
        """
        newest = self._file.read("SELECT coalesce(max(id), 0) FROM events")[0][0]
        if rows is None:
            return self._forget("id IN (SELECT id FROM events WHERE id <= ? LIMIT ?)", [(newest, _FORGET_ROWS)], repeat=True)
        gone = self._forget("id = ?", [(row,) for row in rows])
        return gone + self._forget("is_alarm = 1 AND unique_id = ? AND id <= ?", [(life, newest) for life in lives])

    def _forget(self, where: str, values: Sequence[tuple[int, ...]], *, repeat: bool = False) -> int:
        gone, start = 0, 0
        while start < len(values):
            page = values[start : start + _FORGET_ROWS]
            with self._file.turn() as connection:
                try:
                    with _transaction(connection):
                        count = connection.executemany(f"DELETE FROM events WHERE {where}", page).rowcount
                except sqlite3.Error as error:
                    raise cache_error(self.path, error) from None
            gone += count
            if not (repeat and count):
                start += len(page)
        return gone

    # -- closing ---------------------------------------------------------------------------------------------------------

    def close(self, timeout_s: float = 2.0) -> int:
        """Write what waits, close the file, and return how many rows could not be written; takes at most timeout_s.

        When the disk does not answer in time, the rest is left to the writer's thread, which ends with the process.
        """
        with self._change:
            self._closing = True
            self._change.notify_all()
        if threading.current_thread() is not self._writer:
            self._writer.join(timeout_s)
        with self._change:
            return self._pending_rows

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        lost = self.close()
        if lost and kind is None:
            raise self._error or CacheError(self.path, f"closed before {lost} rows were written")
