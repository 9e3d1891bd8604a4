"""What a logger keeps: a logbook and a cache that always agree.

Rule 1: under `lock`, what was decided, stored and answered fits together.
Rule 2: a book has no bus. A logger and a mirror write into one, and a recording replays into a fresh one.
Rule 3: what the cache refuses is counted (`unstored` events), and alarm states are written as soon as it takes them again.
"""

import contextlib
import logging
import threading
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from bridge.core import keys
from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.catalog import ENGLISH, Catalog, LanguageError, language_id
from bridge.core.event_fields import FIELD_ROWS, NAMES, value
from bridge.core.events import DEFAULT_LIMITS, AnyEvent, Limits
from bridge.core.filters.text import parse
from bridge.core.hresult import ADS_E_INVALIDPARM, AdsError
from bridge.core.logbook import Answered, Changes, Kept, Logbook
from bridge.core.own_events import OWN_CLASS
from bridge.core.questions import LogQuestion, Stored
from bridge.edges.cache import Cache, CacheError, Drop, StoreBatch, StoredAlarm, StoredAnswer, StoredEvent
from bridge.edges.cache import Stored as Row
from bridge.edges.recording import StateFrame

log: Final = logging.getLogger(__name__)
BATCH: Final = 1000
NEXT_ID: Final = "next_unique_id"


class NotFreshError(RuntimeError):
    """A replay needs an empty book; `path` names the cache that is not."""

    def __init__(self, path: str) -> None:
        self.path = path
        super().__init__(f"{path} holds events or alarms already; a recording replays into a new one")


class Book:
    """Logbook and cache of a target (None: of every target). A context manager.

    replay() and load_state() fold a recording in.
    """

    def __init__(
        self,
        target: str | None = None,
        cache: str | Path | Cache = ":memory:",
        *,
        session: str = "",
        limits: Limits = DEFAULT_LIMITS,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        catalog: Catalog | None = None,
        on_dropped: Callable[[Drop], None] | None = None,
    ) -> None:
        """Open the cache and take over what an earlier session left. CacheError when it cannot be opened.

        catalog has the texts and class names that the log can be sorted by. on_dropped is told what the cache dropped, on its
        writer's thread, unless the cache that was given tells somebody else.
        """
        self.cache = cache if isinstance(cache, Cache) else Cache(cache)
        if on_dropped is not None and self.cache.on_dropped is None:
            self.cache.on_dropped, self.cache.quiet_class = on_dropped, OWN_CLASS
        self._catalog = Catalog() if catalog is None else catalog
        self.lock = threading.RLock()
        self.unstored = 0
        self._refused = False
        left = self.cache.load_alarms(target)
        meta = self.cache.meta()
        self._fresh = not left and NEXT_ID not in meta
        self.logbook = Logbook(
            target,
            session,
            alarms=[Kept(kept.unique_id, kept.alarm) for kept in left],
            next_unique_id=int(meta.get(NEXT_ID, "1")),
            limits=limits,
            answered=(Answered(*each) for each in self.cache.load_answers()),
        )
        self._resolve_class = resolve_class
        self._waiting: list[Changes] = []
        self._waiting_events = 0
        self._owed: dict[AlarmKey, Kept | None] = {}

    @property
    def path(self) -> str:
        """The cache's file, or ":memory:"."""
        return self.cache.path

    @property
    def alarms(self) -> dict[AlarmKey, Alarm]:
        """A copy of the alarms as they are now, created ones too."""
        with self.lock:
            return dict(self.logbook.table.alarms)

    # Writing.

    def store(self, changes: Iterable[Changes]) -> bool:
        """Hand changes to the cache, in order; False while it takes none."""
        with self.lock:
            events: list[Row] = []
            answered: list[Answered] = []
            for change in changes:
                answered.extend(change.answered)
                events.extend(Row(stored.unique_id, stored.arrival_ns, stored.event) for stored in change.events)
                self._owed.update((kept.alarm.key, kept) for kept in change.alarms)
                self._owed.update(dict.fromkeys(change.gone))
            batch = StoreBatch(
                events,
                [StoredAlarm(kept.unique_id, kept.alarm) for kept in self._owed.values() if kept is not None],
                [key for key, kept in self._owed.items() if kept is None],
                {NEXT_ID: str(self.logbook.next_unique_id)},
                [StoredAnswer(each.digest, each.session, each.seq, each.created) for each in answered],
            )
            try:
                self.cache.append(batch)
            except CacheError as error:
                self.unstored += len(events)
                if not self._refused:
                    log.error("the log takes nothing: %s", error)
                self._refused = True
                return False
            if self._refused:
                log.warning("%s takes events again; %d in all were not stored", self.path, self.unstored)
                self._refused = False
            self._owed.clear()
            return True

    def replay(self, event: AnyEvent, arrival_ns: int) -> None:
        """Fold one recorded event in as it was, with its own numbers. NotFreshError in a book that was not empty at first."""
        self._check_fresh()
        with self.lock:
            self.cache.clock = lambda: arrival_ns  # what is too old is told by replay time
            self._waiting.append(self.logbook.replay(event, arrival_ns))
            if len(self._waiting) >= BATCH:
                self._write_waiting()

    def load_state(self, state: StateFrame) -> None:
        """Take over a recorded keyframe: all alarms of its target as they were after its event `seq`."""
        self._check_fresh()
        with self.lock:
            changes = self.logbook.load_state(state.target, state.session, state.seq, state.alarms, state.last_seq)
            self._waiting.append(changes)

    def _check_fresh(self) -> None:
        if not self._fresh:
            raise NotFreshError(self.path)

    def _write_waiting(self) -> None:
        if self._waiting:
            self.store(self._waiting)
            self._waiting = []

    def flush(self, timeout_s: float = 10.0, *, durable: bool = False) -> None:
        """Return when everything is committed. CacheError or TimeoutError when it is not."""
        with self.lock:
            self._write_waiting()
            if self._owed:
                self.store(())
        self.cache.flush(timeout_s, durable=durable)

    # Reading.

    def log(self, question: LogQuestion) -> Iterator[Stored]:
        """The stored events that are asked for.

        At once FilterSyntaxError, AdsError or UnknownClassError for a bad filter, and AdsError when too many would have to be
        sorted by a text or when the language is unknown.
        """
        with contextlib.suppress(CacheError, TimeoutError):
            self.flush(2.0)
        if question.missing is not None:
            wanted = question.missing
            key = keys.parse_event_key(wanted.key)
            rows = self.cache.numbered_of_key(wanted.session, key, wanted.first, wanted.last)
            return (_stored(row) for row in rows if row.event.seq > wanted.after_seq)
        return map(_stored, self._rows(question))

    def _rows(self, question: LogQuestion) -> Iterator[StoredEvent]:
        expr = parse(question.filter, resolve_class=self._resolve_class) if question.filter else None
        field = NAMES[question.sort] if question.sort else None
        if field is None or FIELD_ROWS[field].sql:
            return self.cache.query(
                expr,
                limit=question.limit or None,
                offset=question.offset,
                newest_first=question.newest_first,
                order="id" if field is None else FIELD_ROWS[field].sql,
                take_last=question.take_last,
                occurrences=question.view == "occurrences",
            )
        try:
            language = language_id(question.lang or ENGLISH)
        except LanguageError as error:
            raise AdsError(ADS_E_INVALIDPARM, str(error)) from None
        return self.cache.query_by(
            lambda found: str(value(field, found, self._catalog, language)),
            expr,
            limit=question.limit or None,
            offset=question.offset,
            largest_first=question.newest_first,
            take_last=question.take_last,
            occurrences=question.view == "occurrences",
        )

    def clear(self, question: LogQuestion) -> int:
        """Forget the stored events that are asked for, whole lives in the view of occurrences; how many went. Alarms stay.

        Errors are those of log(), and CacheError when it cannot be done. A kill in between leaves a part forgotten.
        """
        if question.missing is not None:
            raise AdsError(ADS_E_INVALIDPARM, "what is missing cannot be cleared")
        self.flush()
        if not (question.filter or question.limit or question.offset):
            return self.cache.forget()
        rows, lives = array("q"), array("q")
        for found in self._rows(question):
            if question.view == "occurrences" and found.event.is_alarm:
                lives.append(found.unique_id)
            else:
                rows.append(found.row)
        return self.cache.forget(rows, lives)

    # Closing.

    def close(self, timeout_s: float = 2.0) -> int:
        """Write what waits and close the cache; how many rows could not be written. Takes at most timeout_s."""
        with contextlib.suppress(CacheError, TimeoutError):
            self.flush(timeout_s)
        return self.cache.close(timeout_s) + len(self._owed)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _stored(row: StoredEvent) -> Stored:
    return Stored(event=row.event, unique_id=row.unique_id, arrival_ns=row.arrival_ns)
