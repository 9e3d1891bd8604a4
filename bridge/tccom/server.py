"""The object server: who is there, and how objects come, are found and go.

Rule 1: an id is given once at a time. An object is found from the moment IP is complete until PI is.
Rule 2: create() gives an object in the wanted state, or nothing: what fails on the way up is taken down again. Who wants to see
how far a module comes creates it in PREOP and moves it then.
Rule 3: delete() takes an object down and signs it off. It is gone when its last holder lets go.
Rule 4: close() takes everything down, the youngest first, by force, and says how many failed.

The server is an object too, see itself.py.
"""

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Final, Protocol, Self, TypeVar

from bridge.core.hresult import (
    ADS_E_ACCESSDENIED,
    ADS_E_EXISTS,
    ADS_E_INVALIDOBJID,
    ADS_E_INVALIDSTATE,
    ADS_E_NOMOREHDLS,
    ADS_E_NOTFOUND,
    ADS_E_SRVNOTSUPP,
    E_NOTIMPL,
    AdsError,
)
from bridge.tccom.declarations import Address, checked_address
from bridge.tccom.factories import Factories
from bridge.tccom.general import ObjectInfo, ParameterKey, Parameters
from bridge.tccom.identity import (
    CREATE_NEW_ID,
    FIRST_FREE_ID,
    LAST_FREE_ID,
    NO_OBJECT,
    OBJECT_SERVER_ID,
    CategoryId,
    ClassId,
    ObjectId,
    id_text,
    is_object_id,
    parse_id,
)
from bridge.tccom.interfaces import Interface, missing
from bridge.tccom.itself import ServerObject
from bridge.tccom.module import Module
from bridge.tccom.objects import LiveObject, current_step
from bridge.tccom.raised import as_ads_error
from bridge.tccom.references import Reference
from bridge.tccom.reports import Report, ReportTo
from bridge.tccom.states import State
from bridge.tccom.tasks import Task
from bridge.tccom.values import Watch, initialize

T = TypeVar("T")
log: Final = logging.getLogger(__name__)

PATIENCE_S: Final = 5.0
"""How long a call waits for an object that is busy."""
LEAST_S: Final = 0.05
CLOSE_S: Final = 1.0
"""How long close() waits for busy objects, all together, but LEAST_S for each; who is still busy then is left as it is."""


class Remote(Protocol):
    """Gives references to objects of other targets, e.g. a proxy over the bus."""

    def __call__(self, target: str, object_id: ObjectId, interface: Interface[T]) -> AbstractContextManager[T]:
        """A reference; AdsError when there is no such object, or nobody answers."""
        ...


class ObjectServer:
    """Keeps the objects of one target. A context manager; for any number of threads."""

    def __init__(
        self,
        *,
        factories: Factories | None = None,
        report: ReportTo = lambda _: None,
        remote: Remote | None = None,
        patience_s: float = PATIENCE_S,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """report hears of every transition and failure; clock gives ns for durations."""
        self.factories = Factories() if factories is None else factories
        self.factories.register(Task)
        self.remote = remote
        self._patience_s = patience_s
        self._report, self._clock = report, clock
        self._lock = threading.Lock()
        self._objects: dict[ObjectId, LiveObject] = {}
        self._reserved: set[ObjectId] = set()
        self._living: set[LiveObject] = set()
        self._references: dict[str, set[Reference[object]]] = {}
        self._next_id = FIRST_FREE_ID
        self._closed = False
        self._closing_until = 0.0
        self.add(ServerObject(self), object_id=OBJECT_SERVER_ID, name="ObjectServer", state=State.OP)

    # Coming.

    def create(
        self,
        module_class: type[Module] | ClassId,
        interface: Interface[T],
        *,
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        name: str = "",
        parameters: Parameters | None = None,
        state: State = State.PREOP,
        owner: str = "",
        transient: bool = False,
    ) -> Reference[T]:
        """A new object of a class (or class id, or its name), and a reference to it; AdsError, and then there is none.

        It stays when the reference is released, until delete(); transient: until the reference is released, which deletes it.
        parent_id is checked by nobody: a parent may come later.
        """
        kind = self.factories.find(module_class) if isinstance(module_class, str) else module_class
        try:
            module = kind()
        except (Exception, SystemExit) as error:
            raise as_ads_error(error, f"{kind.__name__} cannot be made") from error
        live = self._add(module, object_id, name, parent_id, parameters, state)
        try:
            return self._reference(live, interface, owner, transient=transient)
        except AdsError:
            live.walk(State.INIT, force=True)
            raise

    def add(
        self,
        module: Module,
        *,
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        name: str = "",
        parameters: Parameters | None = None,
        state: State = State.PREOP,
    ) -> ObjectId:
        """Register a module that the program has made itself, and bring it to a state; its id. AdsError as create()."""
        return self._add(module, object_id, name, parent_id, parameters, state).object_id

    def _add(
        self,
        module: Module,
        object_id: ObjectId,
        name: str,
        parent_id: ObjectId,
        parameters: Parameters | None,
        state: State,
    ) -> LiveObject:
        if module._place is not None:
            raise AdsError(ADS_E_EXISTS, f"{module._place} is registered already")
        if state is State.INIT:
            raise AdsError(ADS_E_INVALIDSTATE, "INIT is a state in passing: create an object in PREOP or above")
        if absent := missing(type(module)):
            raise AdsError(E_NOTIMPL, f"{type(module).__name__} does not implement {', '.join(absent)}")
        object_id = self._reserve(object_id)
        live = LiveObject(module, self, object_id, name or type(module).__name__, parent_id)
        try:
            initialize(module, parameters or {})
            live.walk(State.PREOP)
        except BaseException:
            module._place = None
            raise
        finally:
            with self._lock:
                self._reserved.discard(object_id)
                if live.state is State.PREOP:
                    self._objects[object_id] = live
                    self._living.add(live)
        try:
            self._check_open()
            live.walk(state)
        except BaseException:
            live.walk(State.INIT, force=True)
            raise
        return live

    def _check_open(self) -> None:
        if self._closed:
            raise AdsError(ADS_E_INVALIDSTATE, "the object server is closed")

    def _reserve(self, object_id: ObjectId) -> ObjectId:
        with self._lock:
            self._check_open()
            if object_id == CREATE_NEW_ID:
                object_id = self._new_id()
            elif not is_object_id(object_id):
                raise AdsError(ADS_E_INVALIDOBJID, f"{object_id} is no object id")
            elif object_id in self._objects or object_id in self._reserved:
                raise AdsError(ADS_E_EXISTS, f"object {id_text(object_id)}")
            self._reserved.add(object_id)
            return object_id

    def _new_id(self) -> ObjectId:
        """The next free id after the last one given, so that the id of a deleted object is not soon another's."""
        count = LAST_FREE_ID - FIRST_FREE_ID + 1
        for _ in range(count):
            candidate = self._next_id
            self._next_id = candidate + 1 if candidate < LAST_FREE_ID else FIRST_FREE_ID
            if candidate not in self._objects and candidate not in self._reserved:
                return candidate
        raise AdsError(ADS_E_NOMOREHDLS, f"all {count} free object ids are taken")

    # Finding.

    def get(self, address: Address, interface: Interface[T], *, owner: str = "") -> Reference[T]:
        """A reference to an object by its id; AdsError: ADS_E_NOTFOUND, ADS_E_NOINTERFACE; ADS_E_INVALIDSTATE in IP and PI."""
        self._may_connect()
        return self._reference(self._found(address), interface, owner)

    def connect(self, address: Address, interface: Interface[T], owner: str) -> AbstractContextManager[T]:
        """As get(), also for "target/id": an object of another target."""
        checked = checked_address(address)
        if isinstance(checked, int):
            return self.get(checked, interface, owner=owner)
        self._may_connect()
        target, _, number = checked.rpartition("/")
        if self.remote is None:
            raise AdsError(ADS_E_SRVNOTSUPP, f"{checked}: this object server reaches no other target")
        return self.remote(target, parse_id(number), interface)

    def objects(
        self, *, category: CategoryId | None = None, class_id: ClassId | None = None, parent_id: ObjectId | None = None
    ) -> tuple[ObjectInfo, ...]:
        """The objects there are, in order of their creation; of a category, class or parent only. Waits for nobody."""
        with self._lock:
            found = [live.info() for live in self._objects.values()]
        return tuple(
            info
            for info in found
            if (category is None or category in info.categories)
            and (class_id is None or class_id == info.class_id)
            and (parent_id is None or parent_id == info.parent_id)
        )

    def object_info(self, object_id: ObjectId) -> ObjectInfo:
        """One of them; AdsError (ADS_E_NOTFOUND)."""
        return self._found(object_id).info()

    @property
    def living(self) -> int:
        """How many objects there are, with those that have signed off and are still held."""
        with self._lock:
            return len(self._living)

    @property
    def closed(self) -> bool:
        """Whether close() has begun."""
        return self._closed

    def set_state(self, object_id: ObjectId, state: State) -> None:
        """Walk an object to a state, step by step; AdsError, and it is where the last completed step left it."""
        self._found(object_id).set_state(state)

    def get_parameter(self, object_id: ObjectId, key: ParameterKey) -> object:
        """A parameter as plain data; AdsError (ADS_E_NOTFOUND)."""
        return self._found(object_id).get_parameter(key)

    def set_parameter(self, object_id: ObjectId, key: ParameterKey, value: object) -> None:
        """Set a parameter; AdsError, e.g. ADS_E_INVALIDSTATE when it is not settable now."""
        self._found(object_id).set_parameter(key, value)

    def watch(self, object_id: ObjectId, key: ParameterKey, tell: Callable[[object], None]) -> Watch:
        """Tell the value of a parameter or symbol now and whenever it has changed; AdsError (ADS_E_NOTFOUND)."""
        return self._found(object_id).watch(key, tell)

    def _found(self, address: Address) -> LiveObject:
        with self._lock:
            live = self._objects.get(address) if isinstance(address, int) else None
        if live is None:
            raise AdsError(ADS_E_NOTFOUND, f"no object {id_text(address) if isinstance(address, int) else address}")
        return live

    def _may_connect(self) -> None:
        current = current_step()
        if current is not None and not current[1].connects:
            raise AdsError(ADS_E_INVALIDSTATE, f"no connections in {current[1].transition}: others may not be there")

    def _reference(self, live: LiveObject, interface: Interface[T], owner: str, *, transient: bool = False) -> Reference[T]:
        def let_go(reference: Reference[T]) -> None:
            self._let_go(reference)
            if transient and live.registered:
                live.walk(State.INIT, force=True)

        reference = Reference(live, interface, owner, let_go)
        if owner:
            with self._lock:
                self._references.setdefault(owner, set()).add(reference)  # type: ignore[arg-type] # kept, never called
        return reference

    def _let_go(self, reference: Reference[T]) -> None:
        with self._lock:
            held = self._references.get(reference.owner)
            if held is not None:
                held.discard(reference)
                if not held:
                    del self._references[reference.owner]

    # Going.

    def delete(self, object_id: ObjectId, *, force: bool = False) -> None:
        """Take it down and sign it off; AdsError when a step down fails, unless by force. The object server itself stays."""
        if object_id == OBJECT_SERVER_ID:
            raise AdsError(ADS_E_ACCESSDENIED, "the object server is not deleted; close it")
        self._found(object_id).walk(State.INIT, force=force)

    def release_owner(self, owner: str) -> int:
        """Release the references of an owner that is gone, e.g. a process that died; how many there were."""
        with self._lock:
            held = list(self._references.pop(owner, ()))
        for reference in held:
            try:
                reference.safe_release()
            except AdsError as error:
                log.error("%s is not deleted: %s", reference.held, error)
        return len(held)

    def close(self) -> int:
        """Take everything down, the youngest first; how many objects could not be. Any number of times."""
        with self._lock:
            self._closed, self._closing_until = True, time.monotonic() + CLOSE_S
            there = list(self._objects.values())[::-1]
        for live in there:
            try:
                live.walk(State.INIT, force=True)
            except AdsError as error:
                log.error("%s could not be taken down: %s", live, error)
        with self._lock:
            return len(self._objects)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    # What its objects need of it.

    def patience_s(self) -> float:
        """How long to wait for somebody's turn; less while closing."""
        return max(LEAST_S, self._closing_until - time.monotonic()) if self._closed else self._patience_s

    def tell(self, report: Report) -> None:
        """Pass a report on; a listener that fails is logged."""
        try:
            self._report(report)
        except Exception:
            # An object's transition does not depend on who hears of it.
            log.exception("a report could not be passed on: %s", report)

    def now_ns(self) -> int:
        """The clock for durations."""
        return self._clock()

    def signed_off(self, live: LiveObject) -> None:
        """Forget an object that has done PI, and let go of it."""
        with self._lock:
            self._objects.pop(live.object_id, None)
        live.release()

    def gone(self, live: LiveObject) -> None:
        """Its last holder has let go."""
        with self._lock:
            self._living.discard(live)
