"""What happens to a logger's log besides events: it is cleared on demand, and what it dropped is told.

Rule 1: a clearing is carried out once per id; the last ANSWERS_KEPT answers are kept. Alarm states are never touched.
Rule 2: what was dropped or cleared is a message of the logger, of our own class. What was dropped is told on a thread of ours,
because the cache's writer, who says so, must wait for nobody. A drop of such messages alone is not told.
"""

import logging
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import Final

import msgspec

from bridge.core.events import MessageSent
from bridge.core.filters.ast import UnknownClassError
from bridge.core.filters.text import FilterSyntaxError
from bridge.core.hresult import ADS_E_INVALIDDATA, ADS_E_INVALIDSIZE, ADS_E_INVALIDSTATE, ADS_E_NOMEMORY, AdsError
from bridge.core.keys import KeyFormatError
from bridge.core.logbook import COMMENT_CHARS, NAME_CHARS
from bridge.core.own_events import CACHE_DROPPED, LOG_CLEARED, own_event
from bridge.core.questions import ClearLogAnswer, ClearLogQuestion
from bridge.edges.bus import Question, Refusal, Reply
from bridge.edges.cache import CacheError, Drop
from bridge.logger.book import Book

log: Final = logging.getLogger(__name__)

CLEAR_LOG: Final = "clear_log"
ANSWERS_KEPT: Final = 1_000


class Housekeeping:
    """Clears the log of a book and reports what became of it with `send`; refusal says why nothing may be changed, else ""."""

    def __init__(self, book: Book, session: str, send: Callable[[MessageSent], object], refusal: Callable[[], str]) -> None:
        self._book, self._session, self._send, self._refusal = book, session, send, refusal
        self._turn = threading.Lock()
        self._answers: dict[str, tuple[int, ClearLogAnswer]] = {}

    # Clearing.

    def answer(self, question: Question) -> Iterator[Reply | Refusal]:
        """Answer a ClearLogQuestion from the bus."""
        try:
            asked = msgspec.json.decode(question.payload, type=ClearLogQuestion)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            yield Refusal(f"no question about clearing the log: {error}")
            return
        yield Reply(msgspec.json.encode(self.clear(asked)))

    def clear(self, question: ClearLogQuestion) -> ClearLogAnswer:
        """Carry it out, or say again what became of it."""
        with self._turn:
            known = self._answers.get(question.id)
            if known is not None and known[0] == hash(question):
                return known[1]
            answer = self._clear(question, known is not None)
            if question.id and known is None and not answer.read_only:
                self._answers[question.id] = hash(question), answer
                if len(self._answers) > ANSWERS_KEPT:
                    del self._answers[next(iter(self._answers))]
            return answer

    def _clear(self, question: ClearLogQuestion, id_taken: bool) -> ClearLogAnswer:
        def refused(code: int, detail: str, *, read_only: bool = False) -> ClearLogAnswer:
            return ClearLogAnswer(id=question.id, session=self._session, result=code, detail=detail, read_only=read_only)

        if reason := self._refusal():
            return refused(ADS_E_INVALIDSTATE, reason, read_only=True)
        if id_taken or not question.id:
            return refused(ADS_E_INVALIDDATA, "the id belongs to another question" if id_taken else "a command needs an id")
        for name, text, allowed in (
            ("id", question.id, NAME_CHARS),
            ("operator", question.operator, NAME_CHARS),
            ("client", question.client, NAME_CHARS),
            ("comment", question.comment, COMMENT_CHARS),
        ):
            if len(text) > allowed:
                return refused(ADS_E_INVALIDSIZE, f"{name}: {len(text)} is over the limit of {allowed} characters")
        try:
            count = self._book.clear(question.which)
        except AdsError as error:
            return refused(error.code, error.detail)
        except (FilterSyntaxError, UnknownClassError, KeyFormatError) as error:
            return refused(ADS_E_INVALIDDATA, str(error))
        except (CacheError, TimeoutError) as error:
            return refused(ADS_E_NOMEMORY, f"cannot be cleared: {error}")
        if count:
            who = {"operator": question.operator, "client": question.client, "comment": question.comment}
            self._report(LOG_CLEARED, count, *who.values(), **who)
        return ClearLogAnswer(id=question.id, session=self._session, cleared=count)

    # Reports.

    def report_drops(self, drops: "SimpleQueue[Drop | None]") -> None:
        """Tell each drop, until None."""
        for drop in iter(drops.get, None):
            log.warning("%s: dropped the %d oldest events (%s)", self._book.path, drop.count, drop.reason)
            if not drop.quiet and not self._refusal():
                self._report(CACHE_DROPPED, drop.count, drop.reason)

    def _report(self, event_id: int, *arguments: int | str, **who: str) -> None:
        try:
            self._send(own_event(self._book.logbook.target or "", "cache", event_id, *arguments, **who))
        except Exception:
            # A report is for people; what it is about has happened, and must be answered.
            log.exception("%s: event %d of tcbridge could not be sent", self._book.path, event_id)
