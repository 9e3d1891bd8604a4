"""What the cache answers: events by a filter, by number, and alarm states.

Rule 1: reading sees what is committed. A query does not see rows that arrived after it was asked.
Rule 2: rows come in pages of 1,000, each found by where the last one ended; nothing is held between two pages.
Rule 3: SQL may let too much through, then the predicate has the last word, and LIMIT and OFFSET are counted in Python. Rows
with inexact_text are always judged by the predicate.
Rule 4: an occurrence is the newest row of an alarm's life, and each message.
Rule 5: what SQL cannot sort is sorted here, with a bound: a page of the sorted rows of any number, or all of SORT_ROWS at most.
"""

import heapq
from array import array
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Final, TypeAlias

import msgspec

from bridge.core.event_fields import FIELD_ROWS
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.sql import sql
from bridge.core.hresult import ADS_E_NOMEMORY, AdsError
from bridge.core.keys import EventKey
from bridge.edges.cache.file import CacheError, CacheFile, Parameter, used_bytes
from bridge.edges.cache.residual import RowPredicate, row_predicate
from bridge.edges.cache.rows import EVENT_COLUMNS, RowError, StoredAlarm, StoredAnswer, StoredEvent, read_alarm, read_event

PAGE: Final = 1_000
ANSWERS_KEPT: Final = 1_000
"""Of commands, beyond the life of a logger: some 80 kB."""
SORT_ROWS: Final = 200_000
"""How many rows are sorted in memory: their sort keys and numbers, some 30 MB."""
_SELECT: Final = "SELECT id, unique_id, arrival_ns, body, inexact_text"
_SORTABLE: Final = ("id", *EVENT_COLUMNS[:-2], *(row.sql for row in FIELD_ROWS.values() if row.sql))
_OCCURRENCES: Final = (
    " AND (is_alarm = 0 OR NOT EXISTS (SELECT 1 FROM events AS later "
    "WHERE later.is_alarm = 1 AND later.unique_id = events.unique_id AND later.id > events.id AND later.id <= ?))"
)
_Row: TypeAlias = tuple[int, int, int, bytes, int, Parameter]


class SessionRange(msgspec.Struct, frozen=True):
    """What the cache holds of one session of a target."""

    target: str
    session: str
    count: int
    first_seq: int
    last_seq: int


class _Question(msgspec.Struct, frozen=True):
    """A filter, and as far as SQL answers it. exact: except for rows with inexact_text, which `where` lets through."""

    where: str
    parameters: tuple[Parameter, ...]
    exact: bool
    inexact_rows: bool
    matches: RowPredicate
    first: int
    last: int
    also: str = ""
    also_parameters: tuple[Parameter, ...] = ()


class Queries:
    """The reading half of the cache."""

    def __init__(self, file: CacheFile) -> None:
        self._file = file

    def query(
        self,
        filter: Expr | None = None,
        *,
        limit: int | None = None,
        offset: int = 0,
        newest_first: bool = True,
        order: str = "id",
        after: int | None = None,
        before: int | None = None,
        take_last: bool = False,
        occurrences: bool = False,
    ) -> Iterator[StoredEvent]:
        """The events a filter wants, in order of arrival or of another column, as they were when this was called.

        after and before are rows (excluded). limit and offset count from the first row in that order, with take_last from the
        last. occurrences: one row per alarm life. A filter must have its class names resolved. ValueError for an order that is
        no column; CacheError when closed or damaged.
        """
        if order not in _SORTABLE:
            raise ValueError(f"{order!r} is no column to sort by; expected one of {', '.join(_SORTABLE)}")
        if offset < 0 or (limit is not None and limit < 0):
            raise ValueError(f"limit {limit} and offset {offset} must not be negative")
        question = self._ask(filter, after, before, occurrences)
        if take_last:
            left = max(0, self._count(question) - offset)
            limit, offset = (left, 0) if limit is None else (min(limit, left), max(0, left - limit))
        return self._pages(question, limit, offset, order, newest_first)

    def query_by(
        self,
        key: Callable[[StoredEvent], str],
        filter: Expr | None = None,
        *,
        limit: int | None = None,
        offset: int = 0,
        largest_first: bool = False,
        take_last: bool = False,
        occurrences: bool = False,
    ) -> Iterator[StoredEvent]:
        """As query(), in the order of a text that only Python knows; equal texts by arrival, in the same direction.

        AdsError ADS_E_NOMEMORY when more than SORT_ROWS would have to be kept: limit and offset together, or all without limit.
        """
        question = self._ask(filter, occurrences=occurrences)
        keyed = ((key(found), found.row) for found in self._pages(question, None, 0))
        backwards = largest_first != take_last
        if limit is not None and limit + offset <= SORT_ROWS:
            pick = heapq.nlargest if backwards else heapq.nsmallest
            picked = pick(limit + offset, keyed)[offset:]
        else:
            picked = list(islice(keyed, SORT_ROWS + 1))
            if len(picked) > SORT_ROWS:
                raise AdsError(ADS_E_NOMEMORY, f"more than {SORT_ROWS} events to sort by a text; a limit or a filter helps")
            picked.sort(reverse=backwards)
            picked = picked[offset : None if limit is None else offset + limit]
        if take_last:
            picked.reverse()
        return self._rows(array("q", (row for _, row in picked)))

    def _rows(self, rows: Sequence[int]) -> Iterator[StoredEvent]:
        for start in range(0, len(rows), PAGE):
            page = rows[start : start + PAGE]
            marks = ", ".join("?" * len(page))
            found = {row[0]: row for row in self._file.read(f"{_SELECT}, id FROM events WHERE id IN ({marks})", page)}
            for number in page:
                if number in found:
                    yield self._event(found[number])

    def count(self, filter: Expr | None = None, *, occurrences: bool = False) -> int:
        """How many events a filter wants."""
        return self._count(self._ask(filter, occurrences=occurrences))

    def _count(self, question: _Question) -> int:
        if not question.exact:
            return sum(1 for _ in self._pages(question, None, 0))
        ((number,),) = self._file.read(
            f"SELECT count(*) FROM events WHERE {question.where} AND NOT inexact_text AND id BETWEEN ? AND ?{question.also}",
            (*question.parameters, question.first, question.last, *question.also_parameters),
        )
        if question.inexact_rows:
            only = msgspec.structs.replace(question, where="inexact_text", parameters=())
            number += sum(1 for _ in self._pages(only, None, 0))
        return int(number)

    def sessions(self, target: str | None = None) -> list[SessionRange]:
        """Which sessions the cache holds numbered events of, by target and first arrival."""
        rows = self._file.read(
            "SELECT target, session, count(*), min(seq), max(seq) FROM events "
            "WHERE seq > 0 AND (?1 IS NULL OR target = ?1) GROUP BY target, session ORDER BY target, min(id)",
            (target,),
        )
        return [SessionRange(*row) for row in rows]

    def numbered(self, target: str, session: str, first_seq: int = 1, last_seq: int = 2**63 - 1) -> Iterator[StoredEvent]:
        """The events of a session from first_seq to last_seq, both included, in order of seq."""
        where = "target = ? AND session = ? AND seq > 0 AND seq > ? AND seq <= ?"
        seq = first_seq - 1
        while True:
            rows = self._file.read(
                f"{_SELECT}, seq FROM events WHERE {where} ORDER BY seq LIMIT ?", (target, session, seq, last_seq, PAGE)
            )
            for row in rows:
                yield self._event(row)
            if len(rows) < PAGE:
                return
            seq = rows[-1][-1]

    def numbered_of_key(self, session: str, key: EventKey, first_key_seq: int, last_key_seq: int) -> Iterator[StoredEvent]:
        """The events of a session and key from first_key_seq to last_key_seq, both included, in order."""
        # key_seq rises with seq and is never above it: so seq serves as bound and order, and the index on it is enough.
        where = (
            "target = ? AND session = ? AND seq > 0 AND seq >= ? AND +event_class = ? AND is_alarm = ? AND severity = ? "
            "AND key_seq BETWEEN ? AND ?"
        )
        first = first_key_seq
        while first <= last_key_seq:
            page = min(PAGE, last_key_seq - first + 1)
            rows = self._file.read(
                f"{_SELECT}, key_seq FROM events WHERE {where} ORDER BY seq LIMIT ?",
                (
                    *(key.target, session, first, key.event_class),
                    *(int(key.is_alarm), int(key.severity), first, last_key_seq, page),
                ),
            )
            for row in rows:
                yield self._event(row)
            if len(rows) < page:
                return
            first = rows[-1][-1] + 1

    def load_alarms(self, target: str | None = None) -> list[StoredAlarm]:
        """The alarm states, of one target or of all."""
        rows = self._file.read("SELECT unique_id, body FROM alarms WHERE ?1 IS NULL OR target = ?1 ORDER BY key", (target,))
        try:
            return [StoredAlarm(unique_id, read_alarm(body)) for unique_id, body in rows]
        except RowError as error:
            raise CacheError(self._file.path, f"holds {error}", bad=True) from None

    def load_answers(self) -> list[StoredAnswer]:
        """What became of the last commands, oldest first."""
        rows = self._file.read("SELECT question, session, seq, created FROM answers ORDER BY number", ())[-ANSWERS_KEPT:]
        return [StoredAnswer(question, session, seq, bool(created)) for question, session, seq, created in rows]

    def meta(self) -> dict[str, str]:
        """The facts kept by name."""
        return dict(self._file.read("SELECT name, value FROM meta ORDER BY name", ()))

    def used_bytes(self) -> int:
        """Bytes of the pages that hold something, which max_bytes limits. The file keeps freed pages for later."""
        with self._file.turn() as connection:
            return used_bytes(connection)

    def _ask(
        self, filter: Expr | None, after: int | None = None, before: int | None = None, occurrences: bool = False
    ) -> _Question:
        expr = Everything() if filter is None else filter
        answer = sql(expr)
        ((newest, inexact),) = self._file.read(
            "SELECT coalesce(max(id), 0), EXISTS (SELECT 1 FROM events WHERE inexact_text) FROM events"
        )
        return _Question(
            where=f"(({answer.where}) OR inexact_text)" if inexact else f"({answer.where})",
            parameters=answer.parameters,
            exact=answer.exact,
            inexact_rows=bool(inexact),
            matches=row_predicate(expr),
            first=0 if after is None else after + 1,
            last=newest if before is None else min(newest, before - 1),
            also=_OCCURRENCES if occurrences else "",
            also_parameters=(newest,) if occurrences else (),
        )

    def _pages(
        self, question: _Question, limit: int | None, offset: int, order: str = "id", newest_first: bool = False
    ) -> Iterator[StoredEvent]:
        direction, beyond = ("DESC", "<") if newest_first else ("ASC", ">")
        in_sql = question.exact and not question.inexact_rows
        first, last, left = question.first, question.last, limit
        skip_in_sql, skip = (offset, 0) if in_sql else (0, offset)
        id_range = "id BETWEEN ? AND ?" if order == "id" else "+id BETWEEN ? AND ?"  # + leaves the index to the order
        place, place_values = "", tuple[Parameter, ...]()  # where the last page ended, unless first and last say it
        while left is None or left > 0:
            page = min(PAGE, left) if in_sql and left is not None else PAGE
            rows: list[_Row] = self._file.read(
                f"{_SELECT}, {order} FROM events WHERE {question.where} AND {id_range}{question.also} {place}"
                f"ORDER BY {order} {direction}, id {direction} LIMIT ? OFFSET ?",
                (*question.parameters, first, last, *question.also_parameters, *place_values, page, skip_in_sql),
            )
            for row in rows:
                found = self._event(row)
                if (row[4] or not question.exact) and not question.matches(found.unique_id, found.event):
                    continue
                if skip:
                    skip -= 1
                    continue
                yield found
                if left is not None:
                    left -= 1
                    if not left:
                        return
            if len(rows) < page:
                return
            skip_in_sql = 0
            row_id, value = rows[-1][0], rows[-1][5]
            if order != "id":
                place, place_values = f"AND ({order}, id) {beyond} (?, ?) ", (value, row_id)
            elif newest_first:
                last = row_id - 1
            else:
                first = row_id + 1

    def _event(self, row: _Row) -> StoredEvent:
        try:
            return StoredEvent(row[0], row[1], row[2], read_event(row[3]))
        except RowError as error:
            raise CacheError(self._file.path, f"row {row[0]}: {error}") from None
