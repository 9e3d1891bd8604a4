"""The EventLogger of a target: owns its alarms, numbers and stores what happens, answers questions.

Rule 1: one per target. Opening refuses a taken name. When two meet later (a healed partition), the older session stays; the
younger one turns read-only, says so, and releases the name: it stores on and answers questions, but refuses commands.
Rule 2: under the book's lock a command is decided, numbered by the publisher, folded in, stored and snapshotted: so the seq
of @state fits its alarms exactly. If the publisher's queue takes no transition, nothing has happened.
Rule 3: a command is answered when it is committed in the cache: it survives kill -9 (durable=True: a power cut too).
Rule 4: messages of other publishers under the target are stored; their alarm transitions are rejected and counted.
Rule 5: a clean stop leaves no alarm raised. So what is raised when a logger opens was left by one that was killed: it is
suspect until its source speaks again.
Rule 6: a source that raised alarms through the proxy and is gone without a last word makes them suspect, until it is back, it
or another source of the alarm speaks, or somebody clears them (docs/decisions/0021).
Rule 7: closing disposes of raised alarms, says the last word, then closes the cache, and never hangs.

A session id of a logger starts with its start time in microseconds, so that the older of two is the smaller one.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Final, Self

import msgspec

from bridge.attendance import Attendance, Token
from bridge.clock import SteadyClock
from bridge.core import codec, keys
from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.arguments import Argument, Value
from bridge.core.catalog import Catalog
from bridge.core.events import DEFAULT_LIMITS, Event, Limits, MessageSent, Severity, Source
from bridge.core.hresult import ADS_E_BUSY, ADS_E_INVALIDDATA, ADS_E_INVALIDSTATE, ADS_E_NOMEMORY, S_OK
from bridge.core.logbook import Changes, Plan
from bridge.core.own_events import OWN_EVENTS, SOURCE_GONE, own_event
from bridge.core.questions import (
    PART_ITEMS,
    ClearLogAnswer,
    ClearLogQuestion,
    CommandAnswer,
    CommandQuestion,
    LogQuestion,
    StatePart,
    Stored,
)
from bridge.edges.bus import LOCAL, Bus, BusConfig, Closable, Question, Refusal, Reply, open_bus
from bridge.edges.cache import Cache, CacheError, Drop
from bridge.inbox import Dropped, OnFull
from bridge.listener import Gap, Listener, Rejected
from bridge.logger.answers import answer_command, answer_log
from bridge.logger.book import Book
from bridge.logger.commands import Commands
from bridge.logger.housekeeping import CLEAR_LOG, Housekeeping
from bridge.logger.presence import SOURCE, loggers, session_of, token_key
from bridge.publisher import Publisher, PublisherClosedError, QueueFullError, default_source, new_logger_session
from bridge.texts import ClassOffer

log: Final = logging.getLogger(__name__)

COMMANDS: Final = ("create", "raise", "clear", "confirm", "dispose")
TAKEN_S: Final = 1.0
"""How long a token without a logger behind it may linger (that of a killed process) before the name counts as taken."""
_STEP_S: Final = 0.02


class TargetTakenError(RuntimeError):
    """There is a logger of this target already; names its session."""

    def __init__(self, target: str, session: str) -> None:
        self.target, self.session = target, session
        super().__init__(f"target {target!r} has a logger already: session {session}")


class LoggerCounters(msgspec.Struct):
    """What a logger did and saw. rejected: transitions of others, and what was no event; missing: events nobody has."""

    commands: int = 0
    messages: int = 0
    received: int = 0
    rejected: int = 0
    missing: int = 0
    dropped: int = 0


def _refuse_taken(bus: Bus, target: str, realm: str) -> None:
    """Return when nobody holds the name; TargetTakenError when somebody answers for it, or still holds it after TAKEN_S."""
    deadline = time.monotonic() + bus.undiscovered_s()
    patient = False
    while True:
        holders = loggers(bus, target, realm)
        for answer in bus.ask(keys.verb_key(realm, target, "@state"), timeout_s=0.5) if holders else ():
            with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError):
                session = msgspec.json.decode(answer.payload, type=StatePart).session
                if not answer.error and session in holders:
                    raise TargetTakenError(target, session)
        if holders and not patient:
            patient, deadline = True, max(deadline, time.monotonic() + TAKEN_S)
        if time.monotonic() >= deadline:
            if holders:
                raise TargetTakenError(target, min(holders))
            return
        time.sleep(_STEP_S)


class EventLogger(Commands):
    """The logger of a target, embedded in this program. A context manager."""

    def __init__(
        self,
        target: str,
        *,
        bus: Bus | None = None,
        config: BusConfig = LOCAL,
        realm: str = keys.LIVE,
        cache: str | Path | Cache = ":memory:",
        encoding: codec.Encoding = codec.JSON,
        limits: Limits = DEFAULT_LIMITS,
        object_id: int | None = None,
        clock: Callable[[], int] = time.time_ns,
        on_full: OnFull = "drop",
        queue_events: int = 65536,
        durable: bool = False,
        client: str | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        catalog: Catalog | None = None,
        on_read_only: Callable[[str], None] | None = None,
    ) -> None:
        """Open the logger, on a bus of its own when none is given; config says how to open that.

        catalog are the event classes it offers to whoever asks (@classes), and, unless resolve_class says otherwise, those
        that filters may name.

        TargetTakenError when there is a logger of this target; CacheError when the cache cannot be opened. durable makes
        commands wait for the disk itself. on_read_only is called with a reason when this logger steps back for an older one.
        """
        self.catalog = Catalog([OWN_EVENTS]).merged(catalog or ())
        if resolve_class is None:
            resolve_class = self.catalog.guids
        super().__init__(target, object_id=object_id, client=client, resolve_class=resolve_class)
        self.realm = realm
        self.counters = LoggerCounters()
        self.read_only = ""
        """Why commands are refused: an older logger is there. "" while this logger is the one."""
        clock = SteadyClock.of(clock)
        self._clock, self._durable, self._on_read_only = clock, durable, on_read_only
        self._closing = False
        self._closed: int | None = None
        with contextlib.ExitStack() as opened:
            self.bus = opened.enter_context(open_bus(config)) if bus is None else bus
            _refuse_taken(self.bus, target, realm)
            self.session = new_logger_session()
            self._drops = SimpleQueue[Drop | None]()
            self.book = Book(
                target,
                cache,
                session=self.session,
                limits=limits,
                resolve_class=resolve_class,
                catalog=self.catalog,
                on_dropped=self._drops.put,
            )
            opened.callback(self.book.close)
            if self.book.logbook.table.suspect(target):
                log.warning("%s: its logger was not stopped; alarms that were raised then are suspect now", target)
            self.publisher = opened.enter_context(
                Publisher(
                    self.bus,
                    target,
                    realm=realm,
                    role="logger",
                    session=self.session,
                    encoding=encoding,
                    limits=limits,
                    object_id=object_id,
                    on_full=on_full,
                    queue_events=queue_events,
                    clock=clock,
                )
            )
            self._housekeeping = Housekeeping(self.book, self.session, self.report, self._why_unchangeable)
            self._reporter = threading.Thread(
                target=self._housekeeping.report_drops, args=(self._drops,), name=f"drops {target}", daemon=True
            )
            self._reporter.start()
            opened.callback(self._drops.put, None)
            self._listener = opened.enter_context(Listener(self.bus, realm=realm, target=target, limits=limits))
            self._follower = threading.Thread(target=self._follow, name=f"log {target}", daemon=True)
            self._follower.start()
            self._answers = self._open_answers()
            self._offer = ClassOffer(self.bus, target, self.catalog, realm=realm, session=self.session)
            self._watch = self.bus.watch_alive(token_key(target, realm), self._logger_seen)
            self._attendance = Attendance(
                self.bus, realm, [target], came=self._came, left=self._left, connected=self._connected
            )
            self._own_bus = self.bus if bus is None else None
            opened.pop_all()

    def _open_answers(self) -> dict[str, Closable]:
        def answer(verb: str, handler: Callable[[Question], Iterable[Reply | Refusal]], *parts: str) -> Closable:
            return self.bus.answer(keys.verb_key(self.realm, self.target, verb, *parts), handler)

        answers = {name: answer("@do", self._answer_command, name) for name in COMMANDS}
        answers[CLEAR_LOG] = answer("@do", self._housekeeping.answer, CLEAR_LOG)
        return {**answers, "@log": answer("@log", self._answer_log), "@state": answer("@state", self._answer_state)}

    # Sending.

    def send_message(
        self,
        event_class: str,
        event_id: int,
        severity: Severity,
        *,
        source: Source | None = None,
        arguments: Iterable[Argument | Value] = (),
        json_attribute: str = "",
        time_ns: int = 0,
        vendor_id: int | None = None,
        product_code: int | None = None,
        revision_no: int | None = None,
    ) -> MessageSent:
        """Send and store one message; returns it as numbered.

        Without a source: the qualified name of the calling code and the object id (manual 5.8). time_ns 0 is now.
        LimitError over a limit, ValueError for a class that is no GUID, PublisherClosedError after close().
        """
        if source is None:
            source = default_source(self._object_id, depth=2)
        event = self.publisher.send_message(
            event_class,
            event_id,
            severity,
            source=source,
            arguments=arguments,
            json_attribute=json_attribute,
            time_ns=time_ns,
            vendor_id=vendor_id,
            product_code=product_code,
            revision_no=revision_no,
        )
        with self.book.lock:
            self.counters.messages += 1
            self.book.store((self.book.logbook.message(event, self._clock()),))
        return event

    def report(self, event: MessageSent) -> None:
        """Send and store a message about this logger or its host (own_events); its time, if not set, is now.

        PublisherClosedError after close().
        """
        now_ns = self._clock()
        sent = self.publisher.send(msgspec.structs.replace(event, time_ns=event.time_ns or now_ns))
        with self.book.lock:
            self.counters.messages += 1
            self.book.store((self.book.logbook.message(sent, now_ns),))

    def _why_unchangeable(self) -> str:
        return self.read_only or (f"the logger of {self.target} is closed" if self._closing else "")

    def _clear(self, question: ClearLogQuestion) -> ClearLogAnswer:
        return self._housekeeping.clear(question)

    def _do(self, question: CommandQuestion) -> CommandAnswer:
        with self.book.lock:
            answer = self._carry_out(question)
            self.publisher.tell_marks(self.book.logbook.marks)
        if answer.result == S_OK and self.book.path != ":memory:":
            try:
                self.book.flush(durable=self._durable)
            except (CacheError, TimeoutError) as error:
                return msgspec.structs.replace(answer, detail=f"done, but not stored yet: {error}")
        return answer

    def _carry_out(self, question: CommandQuestion) -> CommandAnswer:
        """One command, whole or not at all; called with the book's lock held."""
        self.counters.commands += 1
        logbook = self.book.logbook
        if self._closing or self.read_only:
            return CommandAnswer(
                id=question.id,
                session=self.session,
                result=ADS_E_INVALIDSTATE,
                detail=self.read_only or f"the logger of {self.target} is closed",
                read_only=True,
            )
        now_ns = self._clock()
        decision = logbook.decide(question, now_ns)
        if not isinstance(decision, Plan):
            return decision
        if (fault := self.book.cache.error) is not None:
            return logbook.refuse(question, ADS_E_NOMEMORY, f"cannot be stored: {fault}")
        try:
            events = [self.publisher.send(event) for event in decision.events]
        except (QueueFullError, PublisherClosedError) as error:
            return logbook.refuse(question, ADS_E_BUSY, str(error))
        except codec.CodecError as error:
            return logbook.refuse(question, ADS_E_INVALIDDATA, str(error))
        outcome = logbook.sent(decision, events, now_ns)
        self.book.store((outcome.changes,))
        return outcome.answer

    # Reading.

    def _known_alarms(self) -> dict[AlarmKey, Alarm]:
        return self.book.alarms

    def log(self, question: LogQuestion | None = None) -> Iterator[Stored]:
        """Stored events, newest first unless the question says otherwise. FilterSyntaxError or AdsError for a bad filter."""
        return self.book.log(question or LogQuestion())

    # Answering: on the bus's threads.

    def _answer_state(self, _question: Question) -> Iterator[Reply]:
        with self.book.lock:
            parts = self.book.logbook.state_parts(self.publisher.seq, read_only=bool(self.read_only))
        for part in parts:
            yield Reply(msgspec.json.encode(part))

    def _answer_log(self, question: Question) -> Iterator[Reply | Refusal]:
        return answer_log(question, self.book.log, session=self.session, read_only=bool(self.read_only))

    def _answer_command(self, question: Question) -> Iterator[Reply | Refusal]:
        return answer_command(question, self._do)

    # Following others.

    def _follow(self) -> None:
        """Store what other publishers send under this target."""
        while (first := self._listener.get()) is not None:
            items = [first]
            while len(items) < PART_ITEMS and (more := self._listener.get(0)) is not None:
                items.append(more)
            now_ns = self._clock()
            changes: list[Changes] = []
            rejected = ""
            with self.book.lock:
                for item in items:
                    if isinstance(item, Event):
                        if item.session == self.session:
                            continue
                        change = self.book.logbook.arrived(item, now_ns)
                        if change is None:
                            self.counters.rejected += 1
                            rejected = f"alarm transition of session {item.session}"
                        else:
                            self.counters.received += 1
                            changes.append(change)
                    elif isinstance(item, Rejected):
                        self.counters.rejected += 1
                        rejected = f"{len(item.raw)} bytes on {item.key}: {item.reason}"
                    elif isinstance(item, Gap):
                        self.counters.missing += item.missing.count
                    elif isinstance(item, Dropped):
                        self.counters.dropped += item.count
                if changes:
                    self.book.store(changes)
            if rejected:
                log.warning("%s: %d rejected so far, the last: %s", self.target, self.counters.rejected, rejected)

    def _logger_seen(self, key: str, there: bool) -> None:
        """Another logger of this target came or went."""
        session = session_of(key)
        if not there or session is None or session == self.session or self._closing:
            return
        if session > self.session:
            log.warning("%s: session %s is a second logger; it should step back", self.target, session)
            return
        reason = f"session {session} is an older logger of {self.target}; this one is read-only until it is closed"
        with self.book.lock:
            if self.read_only or self._closing:
                return
            self.read_only = reason
            self.publisher.change_role("reader")
        log.warning("%s: %s", self.target, reason)
        if self._on_read_only is not None:
            self._on_read_only(reason)

    def _connected(self, there: bool) -> None:
        log.warning("%s: %s", self.target, "the router is there again" if there else "the router is lost")

    def _came(self, who: Token) -> None:
        if who.role == SOURCE:
            with self.book.lock:
                self._mark(self.book.logbook.source_back(who.session))

    def _left(self, who: Token, gone: bool) -> None:
        if not gone or who.role != SOURCE or self._closing:
            return
        with self.book.lock:
            changes = self.book.logbook.source_gone(who.session)
            self._mark(changes)
        if changes.alarms and not self._why_unchangeable():
            client = changes.alarms[-1].alarm.client
            log.warning(
                "%s: source %s is gone without a last word; %d alarms are suspect now",
                self.target,
                client or who.session,
                len(changes.alarms),
            )
            with contextlib.suppress(PublisherClosedError, QueueFullError):
                self.report(own_event(self.target, "logger", SOURCE_GONE, len(changes.alarms), client))

    def _mark(self, changes: Changes) -> None:
        if changes.alarms:
            self.book.store((changes,))
            self.publisher.tell_marks(self.book.logbook.marks)

    # Closing.

    def close(self, timeout_s: float = 2.0) -> int:
        """Stop cleanly: raised alarms are disposed of, what waits is sent, the last beat is final, the cache is closed.

        Returns how many events could not be sent. Never hangs: what cannot be done in timeout_s is left.
        """
        if self._closed is not None:
            return self._closed
        deadline = time.monotonic() + timeout_s

        def left() -> float:
            return max(0.0, deadline - time.monotonic())

        for name in (*COMMANDS, CLEAR_LOG):
            self._answers[name].close()
        undisposed = self._stop(left())
        self._drops.put(None)
        self._reporter.join(left())
        self._listener.close(left())
        self._follower.join(left())
        unsent = self.publisher.close(left()) + undisposed
        self._watch.close()
        self._attendance.close()
        self._offer.close()
        self._answers["@log"].close()
        self._answers["@state"].close()
        self.book.close(max(0.5, left()))
        if self._own_bus is not None:
            self._own_bus.close(max(0.5, left()))
        self._closed = unsent
        return unsent

    def _stop(self, timeout_s: float) -> int:
        """Refuse commands from now on and dispose of raised alarms; how many transitions did not fit into the queue."""
        if not self.book.lock.acquire(timeout=timeout_s):
            self._closing = True
            return 0
        try:
            if self._closing or self.read_only:
                return 0
            now_ns = self._clock()
            events = self.book.logbook.stop(now_ns)
            changes = []
            for event in events:
                try:
                    changes.append(self.book.logbook.replay(self.publisher.send(event), now_ns))
                except (QueueFullError, PublisherClosedError):
                    break
            if changes:
                self.book.store(changes)
            return len(events) - len(changes)
        finally:
            self._closing = True
            self.book.lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
