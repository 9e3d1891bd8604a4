"""The objects of a target for everybody on the bus: one queryable in front of an object server.

    with ObjectServer() as server, ObjectService(server, bus, "plc1"):
        ...

Rule 1: one object server per target. Opening refuses a taken name. After a healed partition there may be two: callers go to
the older one.
Rule 2: questions are carried out several at a time. Of one object's that take its turn at most WAITING wait or run, the next is
ADS_E_BUSY: an object that is busy does not keep the others from being called. Creating counts as the object server's.
Rule 3: what changes something is done once per id: asked again, the answer is the same. Answers are known for a while.
Rule 4: whoever holds objects shows a token. When it is gone, everything it held is released, as if it had done so itself.
Rule 5: what is not allowed is refused with ADS_E_ACCESSDENIED, whatever its key says.
"""

import contextlib
import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future
from types import TracebackType
from typing import Final, Self, assert_never

import msgspec
from msgspec.structs import fields

from bridge.asking import new_id
from bridge.attendance import Attendance, Token
from bridge.core import keys
from bridge.core.hresult import (
    ADS_E_ACCESSDENIED,
    ADS_E_BUSY,
    ADS_E_INCOMPATIBLE,
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_NOINTERFACE,
    ADS_E_NOTREADY,
    S_OK,
    AdsError,
)
from bridge.edges.bus import Bus, Closable, Reply
from bridge.edges.bus import Question as Asked
from bridge.logger.presence import OBJECTS, loggers, token_key
from bridge.publisher import new_logger_session
from bridge.tccom.calls import (
    HOLDER,
    MSGPACK,
    OBJECTS_VERB,
    Access,
    Call,
    CallAnswer,
    Create,
    Describe,
    Held,
    Hold,
    InterfaceText,
    MethodText,
    ObjectText,
    Question,
    Release,
    access_of,
)
from bridge.tccom.describing import class_info, type_text
from bridge.tccom.general import IUnknown
from bridge.tccom.identity import OBJECT_SERVER_ID, InterfaceId, ObjectId, id_text
from bridge.tccom.interfaces import InterfaceInfo, Method, known_interface
from bridge.tccom.objects import LiveObject
from bridge.tccom.raised import as_ads_error
from bridge.tccom.references import Holdable, Reference
from bridge.tccom.server import ObjectServer

log: Final = logging.getLogger(__name__)

THREADS: Final = 16
WAITING: Final = 8
ANSWERS_KEPT: Final = 1000
ANSWERS_BYTES: Final = 32 << 20
"""So many answers are known, and no more of them than have so many bytes."""
TAKEN_S: Final = 1.0
"""How long the token of a killed process may linger before its target counts as taken."""
TOKEN_S: Final = 1.0
"""How long the token of somebody who holds an object may take to be seen."""
_STEP_S: Final = 0.02
_WAITING_READS: Final = ("read_symbol", "read_values")
"""What reads and waits for the object's turn; the rest that reads waits for nobody."""


class ObjectsTakenError(RuntimeError):
    """There is an object server of this target already; names its session."""

    def __init__(self, target: str, session: str) -> None:
        self.target, self.session = target, session
        super().__init__(f"target {target!r} has an object server already: session {session}")


class ObjectService:
    """Answers for the objects of a server under a target, until closed. A context manager."""

    def __init__(
        self,
        server: ObjectServer,
        bus: Bus,
        target: str,
        *,
        realm: str = keys.LIVE,
        allow: Collection[Access] = frozenset(Access),
    ) -> None:
        """allow: what others may do. ObjectsTakenError when the target has an object server."""
        self.server, self.target, self.realm, self.allow = server, target, realm, frozenset(allow)
        self.session = new_logger_session()
        self._held: dict[str, dict[int, Reference[object]]] = {}
        self._handles = itertools.count(1)
        self._lock = threading.Lock()
        self._there = threading.Condition(self._lock)
        self._owners: set[str] = set()
        self._busy: dict[ObjectId, int] = {}
        self._once = _Once()
        _refuse_taken(bus, target, realm)
        self._attendance = Attendance(bus, realm, [target], came=self._came, left=self._left, connected=lambda _: None)
        self._questions = bus.answer(
            keys.verb_key(realm, target, OBJECTS_VERB, None, self.session), self._answer, threads=THREADS
        )
        self._token: Closable = bus.alive(token_key(target, realm, self.session, role=OBJECTS))

    # Who holds what.

    def _came(self, token: Token) -> None:
        if token.role == HOLDER:
            with self._there:
                self._owners.add(token.session)
                self._there.notify_all()

    def _left(self, token: Token, gone: bool) -> None:
        if token.role == HOLDER:
            with self._there:
                self._owners.discard(token.session)
                self._held.pop(token.session, None)
            # Taking down what was made for it may take long, and others come and go meanwhile.
            threading.Thread(target=self._release, args=(token.session,), name="release", daemon=True).start()

    def _release(self, owner: str) -> None:
        if count := self.server.release_owner(self._known_as(owner)):
            log.info("%s: a caller is gone, %d references were released", self.target, count)

    def _known_as(self, owner: str) -> str:
        """What the object server knows an owner as: no token of a stranger stands for an object that holds others here."""
        return f"{self.target}/{owner}"

    def _keep(self, owner: str, reference: Reference[object]) -> Held:
        """Remember a reference under a new handle; AdsError (ADS_E_NOTREADY), and it is released, for who shows no token."""
        handle = next(self._handles)
        with self._there:
            there = self._there.wait_for(lambda: owner in self._owners, TOKEN_S)
            if there:
                self._held.setdefault(owner, {})[handle] = reference
        if not there:
            reference.safe_release()
            raise AdsError(ADS_E_NOTREADY, "whoever holds an object shows a token; yours is not seen")
        return Held(handle=handle, object_id=reference.object_id, interfaces=tuple(reference.held.interfaces))

    # Answering.

    def _answer(self, asked: Asked) -> Iterator[Reply]:
        yield Reply(self._payload(asked), MSGPACK)

    def _payload(self, asked: Asked) -> bytes:
        try:
            question = msgspec.msgpack.decode(asked.payload, type=Question)
            allowed = keys.parse_verb_key(asked.key)[3][0]
            access = _needs(question)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, keys.KeyFormatError) as error:
            return self._refused(AdsError(ADS_E_INVALIDDATA, f"no question: {error}"))
        if access != allowed:
            return self._refused(AdsError(ADS_E_ACCESSDENIED, f"{access} was asked on the key of {allowed}"))
        if access not in self.allow:
            return self._refused(AdsError(ADS_E_ACCESSDENIED, f"{self.target} does not allow {access}"))
        if access is Access.READ:
            return self._carried_out(question)
        return self._once.answer(question.id, lambda: self._carried_out(question))

    def _carried_out(self, question: Question) -> bytes:
        try:
            return self._value(question)
        except Exception as error:  # noqa: BLE001 # whatever it is, the caller is told, and told the same when it asks again
            return self._refused(as_ads_error(error))

    def _refused(self, error: AdsError) -> bytes:
        detail = error.detail.encode(errors="backslashreplace").decode()
        return msgspec.msgpack.encode(CallAnswer(session=self.session, result=error.code, detail=detail))

    def _made(self, value: object, result: int = S_OK) -> bytes:
        """An answer; AdsError (ADS_E_INVALIDDATA) when the value has no plain form."""
        try:
            raw = msgspec.Raw(msgspec.msgpack.encode(value))
        except (TypeError, ValueError, OverflowError, RecursionError) as error:
            raise AdsError(ADS_E_INVALIDDATA, f"the answer cannot be sent: {error}") from None
        return msgspec.msgpack.encode(CallAnswer(session=self.session, result=result, value=raw))

    def _value(self, question: Question) -> bytes:
        """The answer, made; AdsError."""
        match question:
            case Call():
                return self._call(question)
            case Hold():
                info = _offered(question.interface, question.fingerprint)
                reference = self.server.get(question.object_id, info.protocol, owner=self._known_as(question.owner))
                return self._made(self._keep(question.owner, reference))
            case Create():
                info = _offered(question.interface, question.fingerprint)
                with self._one_more(OBJECT_SERVER_ID):
                    reference = self.server.create(
                        question.class_id,
                        info.protocol,
                        object_id=question.object_id,
                        parent_id=question.parent_id,
                        name=question.name,
                        parameters=question.parameters,
                        state=question.state,
                        owner=self._known_as(question.owner),
                        transient=question.transient,
                    )
                try:
                    return self._made(self._keep(question.owner, reference))
                except AdsError:
                    if reference.held.object_id in {info.object_id for info in self.server.objects()}:
                        self.server.delete(reference.object_id, force=True)
                    raise
            case Release():
                with self._lock:
                    found = self._held.get(question.owner, {}).pop(question.handle, None)
                if found is not None:
                    found.safe_release()
                return self._made(None)
            case Describe():
                reference = self.server.get(question.object_id, IUnknown)
                with reference:
                    return self._made(_object_text(reference.held))
            case _ as never:
                assert_never(never)

    def _call(self, question: Call) -> bytes:
        if not question.handle:
            reference = self.server.get(question.object_id, IUnknown)
            with reference:
                return self._called(reference.held, question)
        with self._lock:
            found = self._held.get(question.owner, {}).get(question.handle)
        if found is None or found.object_id != question.object_id:
            return msgspec.msgpack.encode(CallAnswer(session=self.session, unheld=True))
        return self._called(found.held, question)

    def _called(self, held: Holdable, question: Call) -> bytes:
        info = held.interfaces.get(question.interface)
        if info is None:
            raise AdsError(ADS_E_NOINTERFACE, f"{held} does not offer {question.interface}")
        _compare(info, question.fingerprint)
        method = info.methods.get(question.method)
        if method is None:
            raise AdsError(ADS_E_INVALIDPARM, f"{info.name} has no method {question.method!r}")
        try:
            arguments = msgspec.msgpack.decode(question.arguments, type=method.arguments)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise AdsError(ADS_E_INVALIDPARM, f"{method.name}: {error}") from None
        waits = method.name in _WAITING_READS or access_of(info.id, method.name) is not Access.READ
        with self._one_more(held.object_id) if waits else contextlib.nullcontext():
            answer = held.call(info, method, arguments)
        return self._made(answer.value, answer.result)

    @contextlib.contextmanager
    def _one_more(self, object_id: ObjectId) -> Iterator[None]:
        """Count who may have to wait for an object; AdsError (ADS_E_BUSY) when too many are there."""
        with self._lock:
            if self._busy.get(object_id, 0) >= WAITING:
                raise AdsError(ADS_E_BUSY, f"{id_text(object_id)}: {WAITING} calls wait or run")
            self._busy[object_id] = self._busy.get(object_id, 0) + 1
        try:
            yield
        finally:
            with self._lock:
                self._busy[object_id] -= 1
                if not self._busy[object_id]:
                    del self._busy[object_id]

    # Ending.

    def close(self) -> None:
        """Answer no more, and release what others held."""
        self._token.close()
        self._questions.close()
        self._attendance.close()
        with self._lock:
            owners = list(self._held)
            self._held.clear()
        for owner in owners:
            self.server.release_owner(self._known_as(owner))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class _Once:
    """Carries something out once per id, and knows the answers for a while."""

    def __init__(self) -> None:
        self._answers: dict[str, Future[bytes]] = {}
        self._done: deque[tuple[str, int]] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def answer(self, question_id: str, carry_out: Callable[[], bytes]) -> bytes:
        """The answer; whoever asks while it is being made waits for it."""
        mine: Future[bytes] = Future()
        with self._lock:
            found = self._answers.setdefault(question_id, mine)
        if found is not mine:
            return found.result()
        size = 0
        try:
            mine.set_result(made := carry_out())
            size = len(made)
        except BaseException as error:
            mine.set_exception(error)
            raise
        finally:
            with self._lock:
                self._done.append((question_id, size))
                self._bytes += size
                while len(self._done) > ANSWERS_KEPT or (self._bytes > ANSWERS_BYTES and len(self._done) > 1):
                    oldest, size = self._done.popleft()
                    self._bytes -= size
                    del self._answers[oldest]
        return mine.result()


def _needs(question: Question) -> Access:
    match question:
        case Call():
            return access_of(question.interface, question.method)
        case Hold() | Release():
            return Access.CALL
        case Create():
            return Access.STATE
        case Describe():
            return Access.READ
        case _ as never:
            assert_never(never)


def _offered(interface_id: InterfaceId, fingerprint: str) -> InterfaceInfo:
    """What is known of an interface here; AdsError: ADS_E_NOINTERFACE, ADS_E_INCOMPATIBLE."""
    info = known_interface(interface_id)
    if info is None:
        raise AdsError(ADS_E_NOINTERFACE, f"nobody here knows interface {interface_id}")
    _compare(info, fingerprint)
    return info


def _compare(info: InterfaceInfo, fingerprint: str) -> None:
    if fingerprint not in ("", info.fingerprint):
        raise AdsError(
            ADS_E_INCOMPATIBLE, f"{info.name} ({info.id}) is another one here: {info.fingerprint}, yours is {fingerprint}"
        )


def _object_text(held: Holdable) -> ObjectText:
    assert isinstance(held, LiveObject)
    interfaces = tuple(map(_interface_text, held.interfaces.values()))
    return ObjectText(about=class_info(type(held.module)), interfaces=interfaces)


def _interface_text(info: InterfaceInfo) -> InterfaceText:
    return InterfaceText(
        id=info.id, name=info.name, fingerprint=info.fingerprint, methods=tuple(map(_method_text, info.methods.values()))
    )


def _method_text(method: Method) -> MethodText:
    given = fields(method.arguments)
    return MethodText(
        name=method.name,
        parameters={field.name: type_text(field.type) for field in given},
        optional=tuple(field.name for field in given if not field.required),
        returns=type_text(method.returns),
    )


def _refuse_taken(bus: Bus, target: str, realm: str) -> None:
    """Return when nobody has the target; who shows it and does not answer is given TAKEN_S to be gone."""
    deadline, patient = time.monotonic() + bus.undiscovered_s(), False
    payload = msgspec.msgpack.encode(Describe(id=new_id(), object_id=OBJECT_SERVER_ID))
    while True:
        holders = loggers(bus, target, realm, role=OBJECTS)
        for session in holders:
            if bus.ask(keys.verb_key(realm, target, OBJECTS_VERB, Access.READ, session), payload, timeout_s=0.5):
                raise ObjectsTakenError(target, session)
        if holders and patient and time.monotonic() >= deadline:
            raise ObjectsTakenError(target, min(holders))
        if holders and not patient:
            deadline, patient = max(deadline, time.monotonic() + TAKEN_S), True
        if not holders and time.monotonic() >= deadline:
            return
        time.sleep(_STEP_S)
