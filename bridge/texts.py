"""Texts of events without their files: classes are offered on the bus, and asked for once.

Rule 1: own files first. What they do not know is asked for by GUID on @classes: under the event's target, and, if it is
unknown there, under every target of the realm. A GUID is one version, so every whole answer that has it is right; only
translations may differ, and then what one has and the others lack is added.
Rule 2: what was learnt is kept while this object lives, at most KEPT classes. What nobody knows is asked for again after
UNKNOWN_S at the earliest; until then it is shown as an unknown class is shown (core/catalog.py).
Rule 3: text() and class_name() never raise, and wait for an answer no longer than timeout_s per question. Requests
(request_text, request_class_name) do not wait: they give a future, and OUTSTANDING of them may be open at once.
Rule 4: questions are asked by one thread of ours, several classes at a time, so a stream of unknown classes costs one open
question, not one each.
"""

import contextlib
import logging
import os
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from types import TracebackType
from typing import Final, Protocol, Self

import msgspec

from bridge.core import class_offer, keys
from bridge.core.arguments import ZERO_GUID, ArgumentType, EventReference
from bridge.core.catalog import ENGLISH, Catalog, EventClass, Language, Occurrence, language_id
from bridge.core.class_offer import ClassesPart, ClassesQuestion
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOMOREHDL, ADS_E_NOTFOUND, AdsError
from bridge.edges.bus import Bus, BusError, Question, Refusal, Reply

log: Final = logging.getLogger(__name__)

KEPT: Final = 4096
UNKNOWN_S: Final = 5.0
OUTSTANDING: Final = 100
_STEP_S: Final = 0.05
MAX_ANSWER_BYTES: Final = 64_000_000
"""More than this is not taken from one question, however many answer it."""


class ClassOffer:
    """Answers @classes of a target from a catalog: what a logger does, and what a publisher alone may do. A context manager."""

    def __init__(self, bus: Bus, target: str, catalog: Catalog, *, realm: str = keys.LIVE, session: str | None = None) -> None:
        """Several may offer classes under one target; session tells them apart, a random one unless given."""
        self.target, self.catalog = target, catalog
        self.session = session or os.urandom(8).hex()
        self._closable = bus.answer(keys.verb_key(realm, target, "@classes"), self._answer)

    def _answer(self, question: Question) -> Iterator[Reply | Refusal]:
        try:
            asked = msgspec.json.decode(question.payload or b"{}", type=ClassesQuestion)
            for part in class_offer.answer(self.catalog, asked, self.session):
                yield Reply(msgspec.json.encode(part))
        except (ValueError, RecursionError) as error:  # a ValidationError is a ValueError
            yield Refusal(f"no question about classes: {error}")

    def close(self) -> None:
        """Answer no more."""
        self._closable.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def ask_classes(
    bus: Bus, question: ClassesQuestion, *, target: str | None = None, realm: str = keys.LIVE, timeout_s: float = 2.0
) -> dict[str, EventClass]:
    """The classes that those who offer some know, by GUID; {} when nobody does or nobody answers.

    target None asks those of every target. Where two know a class, translations of both count. Answers that cannot be read or
    are not whole are left out. BusError when the bus is closed.
    """
    parts: dict[tuple[str, str], list[ClassesPart]] = {}
    taken = 0
    for answer in bus.ask_each(keys.verb_key(realm, target, "@classes"), msgspec.json.encode(question), timeout_s=timeout_s):
        taken += len(answer.payload)
        if taken > MAX_ANSWER_BYTES:
            log.warning("answers about classes over %d bytes are left out", MAX_ANSWER_BYTES)
            break
        if answer.error:
            log.debug("classes refused: %r", answer.payload[:200])
            continue
        try:
            part = msgspec.json.decode(answer.payload, type=ClassesPart)
        except (ValueError, RecursionError) as error:
            log.warning("an answer about classes cannot be read: %s", error)
            continue
        parts.setdefault((answer.key, part.session), []).append(part)
    whole = (class_offer.join(each) for _, each in sorted(parts.items(), reverse=True))
    found = Catalog(each for joined in whole if joined is not None for each in joined.classes.values())
    return {each.guid: each for each in found}


class _Resolve(Protocol):
    """Makes a request's text of a catalog; AdsError when it cannot."""

    def __call__(self, catalog: Catalog, /) -> str: ...


def _settle(wanted: "dict[str, tuple[str, Future[None]]]") -> None:
    for _, future in wanted.values():
        if not future.done():
            future.set_result(None)


def _target(event: Occurrence) -> str:
    target = getattr(event, "target", "")
    return target if isinstance(target, str) else ""


def _classes(event: Occurrence) -> Iterator[str]:
    """The GUIDs that the text of the event needs: its class, those of the events it refers to, and the one behind its source,
    which may know the source's name in other languages."""
    if (guid := class_offer.asked_guid(event.event_class)) is not None:
        yield guid
    source = getattr(event, "source_guid", None) if getattr(event, "source_name", None) is not None else None
    if isinstance(source, str) and (guid := class_offer.asked_guid(source)) not in (None, ZERO_GUID):
        yield guid
    for argument in event.arguments:
        if argument.type == ArgumentType.EVENT_REFERENCE:
            value = argument.python()
            if isinstance(value, EventReference) and value.event_class:
                yield value.event_class


class Texts:
    """Texts and class names of events, from own classes and from those offered on the bus. A context manager."""

    def __init__(
        self,
        bus: Bus,
        *,
        realm: str = keys.LIVE,
        catalog: Catalog | None = None,
        language: Language = ENGLISH,
        timeout_s: float = 1.0,
        unknown_s: float = UNKNOWN_S,
        outstanding: int = OUTSTANDING,
    ) -> None:
        """language is that of calls without one. LanguageError for an unknown one."""
        self.bus, self.realm, self.language = bus, realm, language_id(language)
        self._own = catalog if catalog is not None else Catalog()
        self._catalog = self._own
        self._timeout_s, self._unknown_s, self._outstanding = timeout_s, unknown_s, outstanding
        self._learnt: dict[str, EventClass] = {}
        self._unknown: dict[str, float] = {}
        self._wanted: dict[str, tuple[str, Future[None]]] = {}
        self._open = 0
        self._closed = False
        self._lock = threading.Lock()
        self._more = threading.Condition(self._lock)
        self._thread: threading.Thread | None = None
        self.questions = 0
        """How many questions were put on the bus."""

    @property
    def catalog(self) -> Catalog:
        """Every class known now; it changes no more, later ones are in a new catalog."""
        return self._catalog

    # Waiting calls.

    def catalog_for(self, events: Iterable[Occurrence]) -> Catalog:
        """The catalog after asking for the classes of these events that are not known yet; never an exception."""
        futures = self._want((guid, _target(event)) for event in events for guid in _classes(event))
        deadline = time.monotonic() + 2 * self._timeout_s  # one question to the target, one to all
        for future in futures:
            with contextlib.suppress(FutureTimeoutError):
                future.result(max(0.0, deadline - time.monotonic()))
        return self._catalog

    def known(self, event: Occurrence) -> Catalog:
        """The catalog as it is now. A class of the event that is not in it is asked for meanwhile; this does not wait."""
        missing = [guid for guid in _classes(event) if guid not in self._catalog]
        if missing:
            self._want((guid, _target(event)) for guid in missing)
        return self._catalog

    def text(self, event: Occurrence, language: Language | None = None) -> str:
        """The text of an event or alarm; of an unknown class "<GUID>#7 (a, b)". Never an exception."""
        return self.catalog_for((event,)).event_text(event, self.language if language is None else language)

    def class_name(self, event: Occurrence, language: Language | None = None) -> str:
        """What people call the event's class, the GUID of an unknown one. Never an exception."""
        return self.catalog_for((event,)).class_name(event.event_class, self.language if language is None else language)

    def guids(self, name: str) -> Sequence[str]:
        """Every GUID of a class name, own ones or, if there are none, those offered in the realm; () when it is unknown.

        For filters: pass it as resolve_class. It waits for those who may still turn up on the bus. Never an exception.
        """
        while not self._catalog.guids(name):
            last = not self.bus.undiscovered_s()
            try:
                found = ask_classes(self.bus, ClassesQuestion(names=(name,)), realm=self.realm, timeout_s=self._timeout_s)
            except (BusError, keys.KeyFormatError) as error:
                log.debug("cannot ask for class %r: %s", name, error)
            else:
                with self._lock:
                    self._learn(found)
            if last or self._closed:
                break
            time.sleep(_STEP_S)
        return self._catalog.guids(name)

    # Requests, as FB_RequestEventText and FB_RequestEventClassName (manual 6.1.1.2, 6.1.1.3).

    def request_text(self, event: Occurrence, language: Language | None = None) -> "Future[str]":
        """Ask for a text without waiting.

        The future has the text, or AdsError: ADS_E_NOTFOUND for a class or event that nobody knows, ADS_E_NOMOREHDL when too
        many requests are open, ADS_E_INVALIDSTATE after close(). Its callbacks run on a thread of ours and must be quick.
        """
        lcid = self.language if language is None else language

        def resolve(catalog: Catalog) -> str:
            if catalog.entry(event.event_class, event.event_id) is None:
                raise AdsError(ADS_E_NOTFOUND, f"event {event.event_id} of class {event.event_class}")
            return catalog.event_text(event, lcid)

        return self._request([(guid, _target(event)) for guid in _classes(event)], resolve)

    def request_class_name(self, event_class: str, language: Language | None = None, *, target: str = "") -> "Future[str]":
        """As request_text(), for the name of a class; target is whom to ask first."""
        lcid = self.language if language is None else language

        def resolve(catalog: Catalog) -> str:
            if event_class not in catalog:
                raise AdsError(ADS_E_NOTFOUND, f"class {event_class}")
            return catalog.class_name(event_class, lcid)

        guid = class_offer.asked_guid(event_class)
        return self._request([(guid, target)] if guid is not None else [], resolve)

    def _request(self, wanted: "list[tuple[str, str]]", resolve: "_Resolve") -> "Future[str]":
        result: Future[str] = Future()
        with self._lock:
            closed, full = self._closed, self._open >= self._outstanding
            if not closed and not full:
                self._open += 1
        if closed or full:
            detail = "texts are closed" if closed else f"{self._outstanding} requests are open"
            result.set_exception(AdsError(ADS_E_INVALIDSTATE if closed else ADS_E_NOMOREHDL, detail))
            return result
        futures = self._want(wanted)
        left = [len(futures)]

        def finish() -> None:
            with self._lock:
                self._open -= 1
                closed = self._closed
            if not result.set_running_or_notify_cancel():
                return
            try:
                text = resolve(self._catalog)
            except AdsError as error:
                result.set_exception(AdsError(ADS_E_INVALIDSTATE, "texts are closed") if closed else error)
            else:
                result.set_result(text)

        def one_done(_future: "Future[None]") -> None:
            with self._lock:
                left[0] -= 1
                done = not left[0]
            if done:
                finish()

        if not futures:
            finish()
        for future in futures:
            future.add_done_callback(one_done)
        return result

    # Asking.

    def _want(self, wanted: "Iterable[tuple[str, str]]") -> "list[Future[None]]":
        """Futures of the questions, new or open, that settle what is not known yet."""
        futures: dict[str, Future[None]] = {}
        now_s = time.monotonic()
        with self._lock:
            for guid, target in wanted:
                if guid in futures or guid in self._catalog or self._closed:
                    continue
                if self._unknown.get(guid, 0.0) > now_s:
                    continue
                if guid not in self._wanted:
                    if len(self._wanted) >= class_offer.MAX_ASKED:
                        continue
                    self._wanted[guid] = (target, Future())
                    self._more.notify()
                futures[guid] = self._wanted[guid][1]
            if futures and self._thread is None:
                self._thread = threading.Thread(target=self._run, name="ask for classes", daemon=True)
                self._thread.start()
        return list(futures.values())

    def _run(self) -> None:
        while True:
            with self._lock:
                while not self._wanted and not self._closed:
                    self._more.wait()
                wanted = dict(self._wanted)
                if self._closed:
                    break
            found = self._ask(wanted)
            with self._lock:
                self._learn(found)
                again_s = time.monotonic() + self._unknown_s
                self._unknown = {guid: end for guid, end in self._unknown.items() if end > again_s - self._unknown_s}
                for guid in wanted:
                    del self._wanted[guid]
                    if guid not in self._catalog and len(self._unknown) < KEPT:
                        self._unknown[guid] = again_s
            _settle(wanted)
        _settle(wanted)

    def _ask(self, wanted: "dict[str, tuple[str, Future[None]]]") -> dict[str, EventClass]:
        """Ask each target for its classes, then everybody for the rest."""
        found: dict[str, EventClass] = {}
        targets: dict[str | None, list[str]] = {}
        for guid, (target, _) in wanted.items():
            if target:
                targets.setdefault(target, []).append(guid)
        for whom, guids in targets.items():
            found |= self._ask_one(whom, guids)
        rest = [guid for guid in wanted if guid not in found]
        return found | self._ask_one(None, rest) if rest else found

    def _ask_one(self, target: str | None, guids: list[str]) -> dict[str, EventClass]:
        self.questions += 1
        try:
            found = ask_classes(
                self.bus, ClassesQuestion(guids=tuple(guids)), target=target, realm=self.realm, timeout_s=self._timeout_s
            )
        except (BusError, keys.KeyFormatError) as error:
            log.debug("cannot ask for classes: %s", error)
            return {}
        return {guid: found[guid] for guid in guids if guid in found}

    def _learn(self, found: dict[str, EventClass]) -> None:
        """Keep classes; called with the lock held."""
        new = {guid: each for guid, each in found.items() if guid not in self._own and guid not in self._learnt}
        if not new:
            return
        self._learnt |= new
        for guid in list(self._learnt)[: max(0, len(self._learnt) - KEPT)]:
            del self._learnt[guid]
        self._catalog = Catalog((*self._learnt.values(), *self._own))

    # Closing.

    def close(self, timeout_s: float = 1.0) -> None:
        """Ask no more; open requests end with ADS_E_INVALIDSTATE. What is known stays known."""
        with self._lock:
            self._closed = True
            self._more.notify_all()
            thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
