"""The objects of a target from elsewhere: the same names, results and errors as the object server has in its own process.

    with RemoteObjects(bus, "plc1") as plc1, plc1.get(0x71010000, ICalculation) as calculation:
        calculation.addition(1, 2)

Rule 1: ADS_E_NOTFOUND: nobody is there, nothing was done. ADS_E_TIMEOUT: it was asked, and no answer came; whether it was
carried out is not known. A call ends after timeout_s at the latest, and as soon as the bus tells that the provider is gone.
Rule 2: within that time a question that is not answered is asked again of the same object server, with the same id: it is
carried out once. Of one that was started later only what reads is asked again.
Rule 3: a reference survives its provider: when the target has an object server again, the next call holds the object of that
id there and goes to it. Until then calls answer ADS_E_NOTFOUND at once. What the old object had counted or kept is gone.
Rule 4: get(), create() and what is asked of the target itself wait for it; so it does not matter who is started first.
Rule 5: closing, or the end of this process, releases what is held.
"""

import contextlib
import os
import threading
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Final, Self, TypeVar

import msgspec

from bridge.asking import new_id
from bridge.core import keys
from bridge.core.hresult import (
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDOBJID,
    ADS_E_INVALIDPARM,
    ADS_E_NOTFOUND,
    ADS_E_SRVNOTSUPP,
    ADS_E_TIMEOUT,
    E_POINTER,
    S_OK,
    AdsError,
    raise_if_failed,
)
from bridge.edges.bus import Bus, BusError, Closable
from bridge.logger.presence import OBJECTS, Presence
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
    ObjectText,
    Question,
    Release,
    access_of,
)
from bridge.tccom.declarations import Address, checked_address
from bridge.tccom.general import ClassInfo, IDataAreas, IObject, IObjectServer, ObjectInfo, ParameterKey, Parameters
from bridge.tccom.identity import (
    CREATE_NEW_ID,
    NO_OBJECT,
    OBJECT_SERVER_ID,
    CategoryId,
    ClassId,
    InterfaceId,
    ObjectId,
    id_text,
)
from bridge.tccom.interfaces import Answer, Interface, InterfaceInfo, Method, describe, known_interface, stub
from bridge.tccom.references import Reference
from bridge.tccom.reports import ReportKind
from bridge.tccom.states import State

T = TypeVar("T")

TIMEOUT_S: Final = 1.5
"""How long a call may take, unless told otherwise: a lost provider costs its callers less than 2 s."""
_STEP_S: Final = 0.02


class RemoteObjects:
    """The object server of `target`, wherever it runs. A context manager; for any number of threads."""

    def __init__(self, bus: Bus, target: str, *, realm: str = keys.LIVE, timeout_s: float = TIMEOUT_S) -> None:
        """timeout_s: how long a call may take. What is slow (a transition that connects, say) needs more."""
        self.bus, self.target, self.realm, self.timeout_s = bus, target, realm, timeout_s
        self.owner = os.urandom(8).hex()
        """Who holds objects, in the provider's eyes."""
        self._lock = threading.Lock()
        self._token: Closable | None = None
        self._presence = Presence(bus, target, realm, role=OBJECTS)
        self._server = self._stub(OBJECT_SERVER_ID, IObjectServer)

    # The names of the object server.

    def get(self, address: Address, interface: Interface[T]) -> Reference[T]:
        """A reference to an object; AdsError: ADS_E_NOTFOUND, ADS_E_NOINTERFACE, ADS_E_INCOMPATIBLE (another fingerprint)."""
        remote = RemoteObject(self, self._id(address))
        remote.hold(describe(interface), wait=True)
        return Reference(remote, interface)

    def create(
        self,
        class_id: ClassId,
        interface: Interface[T],
        *,
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        name: str = "",
        parameters: Parameters | None = None,
        state: State = State.PREOP,
        transient: bool = False,
    ) -> Reference[T]:
        """A new object there and a reference to it; AdsError, and then there is none.

        transient: it is deleted when the reference is released, or when this process ends.
        """
        info = describe(interface)
        given: dict[str | int, object] = dict((parameters or {}).items())
        question = Create(
            id=new_id(),
            owner=self.owner,
            class_id=class_id,
            interface=info.id,
            object_id=object_id,
            parent_id=parent_id,
            state=state,
            name=name,
            parameters=given,
            transient=transient,
            fingerprint=info.fingerprint,
        )
        self.show()
        session, answer = self.ask(question, Access.STATE, wait=True)
        held = _held(answer)
        return Reference(RemoteObject(self, held.object_id, session, held), interface)

    def delete(self, object_id: ObjectId) -> None:
        """Take an object down and sign it off."""
        self._server.delete_instance(object_id)

    def objects(
        self, *, category: CategoryId | None = None, class_id: ClassId | None = None, parent_id: ObjectId | None = None
    ) -> tuple[ObjectInfo, ...]:
        """The objects there are, in order of their creation; of a category, class or parent only."""
        return tuple(
            info
            for info in self._server.objects().value
            if (category is None or category in info.categories)
            and (class_id is None or class_id == info.class_id)
            and (parent_id is None or parent_id == info.parent_id)
        )

    def object_info(self, object_id: ObjectId) -> ObjectInfo:
        """One of them."""
        return self._server.object_info(object_id).value

    def classes(self) -> tuple[ClassInfo, ...]:
        """The module classes that can be created there."""
        return self._server.classes().value

    def class_info(self, class_id: ClassId) -> ClassInfo:
        """One of them."""
        return self._server.class_info(class_id).value

    def set_state(self, object_id: ObjectId, state: State) -> None:
        """Walk an object to a state; AdsError, and it is where the last completed step left it."""
        self._stub(object_id, IObject).set_state(state)

    def get_parameter(self, object_id: ObjectId, key: ParameterKey) -> object:
        """A parameter as plain data."""
        return self._stub(object_id, IObject).get_parameter(key).value

    def set_parameter(self, object_id: ObjectId, key: ParameterKey, value: object) -> None:
        """Set a parameter."""
        self._stub(object_id, IObject).set_parameter(key, value)

    def read_symbol(self, object_id: ObjectId, path: str) -> object:
        """A symbol, a data area or ("") all of them as plain data."""
        return self._stub(object_id, IDataAreas).read_symbol(path).value

    def write_symbol(self, object_id: ObjectId, path: str, value: object) -> None:
        """Set a symbol of a writable area."""
        self._stub(object_id, IDataAreas).write_symbol(path, value)

    # For those who have no declaration of an interface.

    def describe(self, object_id: ObjectId) -> ObjectText:
        """What an object is: its class, with parameters and symbols, and what can be called."""
        _, answer = self.ask(Describe(id=new_id(), object_id=object_id), Access.READ, wait=True)
        text = _value(answer, ObjectText)
        assert isinstance(text, ObjectText)
        return text

    def call(self, object_id: ObjectId, interface: InterfaceId, method: str, arguments: Mapping[str, object]) -> Answer[object]:
        """Call a method by its name, with plain data."""
        question = Call(
            id=new_id(), object_id=object_id, interface=interface, method=method, arguments=_encoded(method, dict(arguments))
        )
        _, answer = self.ask(question, access_of(interface, method), wait=True)
        return Answer(_value(answer, object), answer.result)

    def _stub(self, object_id: ObjectId, interface: Interface[T]) -> T:
        """The methods of whichever object has the id, without holding it."""
        return stub(interface, lambda method, arguments: self._plain(object_id, describe(interface), method, arguments))

    def _plain(self, object_id: ObjectId, info: InterfaceInfo, method: Method, arguments: msgspec.Struct) -> Answer[object]:
        question = Call(
            id=new_id(),
            object_id=object_id,
            interface=info.id,
            fingerprint=info.fingerprint,
            method=method.name,
            arguments=_encoded(method.name, arguments),
        )
        _, answer = self.ask(question, access_of(info.id, method.name), wait=True)
        return Answer(_value(answer, method.returns), answer.result)

    def _id(self, address: Address) -> ObjectId:
        checked = checked_address(address)
        if isinstance(checked, str) or checked == NO_OBJECT:
            raise AdsError(ADS_E_INVALIDOBJID, f"{address!r} is no object of {self.target}")
        return checked

    # Asking.

    def show(self) -> None:
        """Show that this process holds objects there."""
        with self._lock:
            if self._token is None:
                try:
                    self._token = self.bus.alive(keys.verb_key(self.realm, self.target, "@alive", HOLDER, self.owner))
                except BusError as error:
                    raise AdsError(ADS_E_NOTFOUND, str(error)) from None

    def session(self, deadline_s: float) -> str:
        """The object server that is there now, waited for until then; AdsError (ADS_E_NOTFOUND)."""
        if not (there := self._presence.sessions):
            self._presence.wait(max(0.0, deadline_s - time.monotonic()))
            there = self._presence.sessions
        if not there:
            raise AdsError(ADS_E_NOTFOUND, f"target {self.target!r} has no object server")
        return min(there)

    def ask(
        self,
        question: Question,
        access: Access,
        *,
        wait: bool = False,
        session: str | None = None,
        deadline_s: float | None = None,
    ) -> tuple[str, CallAnswer]:
        """The answer, and who gave it. wait: for somebody to be there; session: who is meant. AdsError as rule 1 says."""
        if deadline_s is None:
            deadline_s = time.monotonic() + self.timeout_s
        payload = msgspec.msgpack.encode(question)
        asked = ""
        while True:
            meant = session or self.session(deadline_s if wait else 0.0)
            if asked not in ("", meant) and access is not Access.READ:
                break
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                break
            asked = meant
            key = keys.verb_key(self.realm, self.target, OBJECTS_VERB, access, meant)
            try:
                for answer in self.bus.ask_each(key, payload, timeout_s=left_s, encoding=MSGPACK):
                    if not answer.error:
                        return meant, _answer(answer.payload)
            except BusError as error:
                raise AdsError(ADS_E_NOTFOUND, str(error)) from None
            if meant not in self._presence.sessions and (access is not Access.READ or session is not None):
                break
            time.sleep(_STEP_S)
        raise AdsError(ADS_E_TIMEOUT, f"{self.target} was asked and gave no answer; whether it was done is not known")

    def close(self) -> None:
        """Let go of everything. Any number of times."""
        with self._lock:
            token, self._token = self._token, None
        if token is not None:
            token.close()
        self._presence.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class RemoteObject:
    """An object there, held once for all references to it here: what a Reference needs."""

    def __init__(self, target: RemoteObjects, object_id: ObjectId, session: str = "", held: Held | None = None) -> None:
        self.object_id = object_id
        self._target, self._session = target, session
        self._handle = 0 if held is None else held.handle
        self._offers: tuple[InterfaceId, ...] = () if held is None else held.interfaces
        self._count = 0
        self._lock = threading.Lock()
        self._holding = threading.Lock()

    def __str__(self) -> str:
        return f"{self._target.target}/{id_text(self.object_id)}"

    @property
    def interfaces(self) -> Mapping[InterfaceId, InterfaceInfo]:
        """What it offers, as far as this process has declared it."""
        return {iid: info for iid in self._offers if (info := known_interface(iid)) is not None}

    def add_ref(self) -> int:
        """One more; how many there are in this process."""
        with self._lock:
            self._count += 1
            return self._count

    def release(self) -> int:
        """One less. The last one lets go of the object there; a provider that is gone has let go already."""
        with self._lock:
            self._count -= 1
            count = self._count
        if count == 0:
            self._let_go()
        return count

    def _let_go(self) -> None:
        with self._lock:
            session, handle, self._handle = self._session, self._handle, 0
        if handle:
            question = Release(id=new_id(), owner=self._target.owner, handle=handle)
            with contextlib.suppress(AdsError):
                self._target.ask(question, Access.CALL, session=session)

    def turn(self) -> AbstractContextManager[None]:
        """Nobody has an object alone over the bus: AdsError (ADS_E_SRVNOTSUPP)."""
        raise AdsError(ADS_E_SRVNOTSUPP, f"{self}: an object's turn is not given over the bus")

    def report(self, kind: ReportKind, *, code: int = S_OK, detail: str = "", duration_ns: int = 0) -> None:
        """Its own object server reports, not its callers."""

    def expect(self, info: InterfaceInfo) -> None:
        """Hold it later: with its first call."""
        self._offers = (info.id,)

    def hold(self, info: InterfaceInfo, *, wait: bool = False, deadline_s: float | None = None) -> None:
        """Hold the object that has the id now; AdsError."""
        self._target.show()
        question = Hold(
            id=new_id(),
            owner=self._target.owner,
            object_id=self.object_id,
            interface=info.id,
            fingerprint=info.fingerprint,
        )
        session, answer = self._target.ask(question, Access.CALL, wait=wait, deadline_s=deadline_s)
        held = _held(answer)
        with self._lock:
            self._session, self._handle, self._offers = session, held.handle, held.interfaces

    def call(self, info: InterfaceInfo, method: Method, arguments: msgspec.Struct) -> Answer[object]:
        """Call it; when its provider was started anew, or has given it up, it is held again first."""
        encoded = _encoded(method.name, arguments)
        access = access_of(info.id, method.name)
        deadline_s = time.monotonic() + self._target.timeout_s
        for _ in range(2):
            session, handle = self._there(info, deadline_s)
            question = Call(
                id=new_id(),
                owner=self._target.owner,
                handle=handle,
                object_id=self.object_id,
                interface=info.id,
                fingerprint=info.fingerprint,
                method=method.name,
                arguments=encoded,
            )
            _, answer = self._target.ask(question, access, session=session, deadline_s=deadline_s)
            if not answer.unheld:
                return Answer(_value(answer, method.returns), answer.result)
            with self._lock:
                if (self._session, self._handle) == (session, handle):
                    self._session = ""
        raise AdsError(ADS_E_NOTFOUND, f"{self} cannot be held")

    def _there(self, info: InterfaceInfo, deadline_s: float) -> tuple[str, int]:
        """The object server that is there, and the handle of the object with it: held anew when that is another one now."""
        if not self._holding.acquire(timeout=max(0.0, deadline_s - time.monotonic())):
            raise AdsError(ADS_E_TIMEOUT, f"{self} was to be held, and no answer came; nothing was done")
        try:
            if self._count and self._session != self._target.session(0.0):
                self.hold(info, deadline_s=deadline_s)
            with self._lock:
                if self._count:
                    return self._session, self._handle
        finally:
            self._holding.release()
        self._let_go()
        raise AdsError(E_POINTER, f"the reference to {self} was released")


class RemoteTargets:
    """References to objects of any target, for interface pointers such as "plc2/0x71010000". A context manager.

    server.remote = RemoteTargets(bus)
    """

    def __init__(self, bus: Bus, *, realm: str = keys.LIVE, timeout_s: float = TIMEOUT_S) -> None:
        self._bus, self._realm, self._timeout_s = bus, realm, timeout_s
        self._targets: dict[str, RemoteObjects] = {}
        self._lock = threading.Lock()

    def __call__(self, target: str, object_id: ObjectId, interface: Interface[T]) -> AbstractContextManager[T]:
        """A reference; AdsError when the object is there and does not offer the interface, or not to us."""
        with self._lock:
            if target not in self._targets:
                self._targets[target] = RemoteObjects(self._bus, target, realm=self._realm, timeout_s=self._timeout_s)
            found = self._targets[target]
        remote = RemoteObject(found, object_id)
        try:
            remote.hold(describe(interface), wait=True)
        except AdsError as error:
            if error.code not in (ADS_E_NOTFOUND, ADS_E_TIMEOUT):
                raise
            remote.expect(describe(interface))
        return Reference(remote, interface)

    def close(self) -> None:
        """Let go of everything."""
        with self._lock:
            targets, self._targets = list(self._targets.values()), {}
        for target in targets:
            target.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _encoded(method: str, arguments: object) -> msgspec.Raw:
    try:
        return msgspec.Raw(msgspec.msgpack.encode(arguments))
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise AdsError(ADS_E_INVALIDPARM, f"{method}: {error}") from None


def _answer(payload: bytes) -> CallAnswer:
    try:
        return msgspec.msgpack.decode(payload, type=CallAnswer)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise AdsError(ADS_E_INVALIDDATA, f"the answer cannot be read: {error}") from None


def _value(answer: CallAnswer, kind: object) -> object:
    raise_if_failed(answer.result, answer.detail)
    try:
        value: object = msgspec.msgpack.decode(answer.value, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise AdsError(ADS_E_INVALIDDATA, f"the answer cannot be read: {error}") from None
    return value


def _held(answer: CallAnswer) -> Held:
    value = _value(answer, Held)
    assert isinstance(value, Held)
    return value
