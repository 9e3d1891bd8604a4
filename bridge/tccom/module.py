"""What somebody writes who writes a module: one class.

    class Calculation(Module, ICalculation):
        class_id = "0e0f3a52-9f6e-4f0c-8a5a-0f5c3f4f2b10"
        offset = Parameter(0x1, int, default=0, settable=Settable.INIT | Settable.OP)

        def addition(self, a: int, b: int) -> Answer[int]:
            return Answer(a + b + self.offset)

Rule 1: the hooks on_ip .. on_pi are the transitions; states.py says what each may do. None is needed. A hook that raises has
failed: what it acquired with enter() and connect() is given back, the rest it undoes itself, and the state stays.
Rule 2: enter(manager) keeps a context manager until the transition is undone: what on_ps enters leaves after on_sp.
connect(address, interface) does so with a reference. So most modules need no hooks for the way down.
Rule 3: calls, transitions, cycles and parameter writes of one object never overlap, unless its class is thread_safe: then
calls may overlap everything, and its author sees to it.
Rule 4: an object keeps its class, id and server for life. Before it is registered it has none (NO_OBJECT).
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import ClassVar, Protocol, Self, TypeVar

from bridge.core.arguments import guid
from bridge.core.hresult import ADS_E_NOTINIT, S_OK, AdsError
from bridge.tccom.declarations import Address, Declarations, InterfacePointer, declarations
from bridge.tccom.general import IDataAreas, IObject, IWatchSource, ObjectInfo, ParameterKey, Parameters
from bridge.tccom.identity import CREATE_NEW_ID, NO_OBJECT, CategoryId, ClassId, InterfaceId, ObjectId, versioned_class_id
from bridge.tccom.interfaces import DONE, Answer, Interface, InterfaceInfo, missing, offered
from bridge.tccom.references import Reference
from bridge.tccom.reports import ReportKind
from bridge.tccom.states import State

T = TypeVar("T")


class Server(Protocol):
    """What a module may ask the object server. Errors are AdsErrors."""

    def get(self, address: Address, interface: Interface[T], *, owner: str = "") -> Reference[T]:
        """A reference to an object: `with server.get(object_id, ICalculation) as calculation: ...`."""
        ...

    def create(
        self,
        module_class: "type[Module] | ClassId",
        interface: Interface[T],
        *,
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        name: str = "",
        parameters: Parameters | None = None,
        state: State = State.PREOP,
        transient: bool = False,
    ) -> Reference[T]:
        """A new object in that state, and a reference to it; transient: releasing that deletes the object."""
        ...

    def delete(self, object_id: ObjectId) -> None:
        """Take an object down and sign it off; it lives on while others hold references."""
        ...

    def objects(
        self, *, category: CategoryId | None = None, class_id: ClassId | None = None, parent_id: ObjectId | None = None
    ) -> tuple[ObjectInfo, ...]:
        """The objects there are, in order of their creation."""
        ...


class Place(Protocol):
    """What a module knows of its own place: the object server's side of it."""

    object_id: ObjectId
    name: str
    parent_id: ObjectId
    state: State

    @property
    def server(self) -> Server: ...
    def enter(self, manager: AbstractContextManager[T]) -> T: ...
    def connect(self, address: Address, interface: Interface[T]) -> T: ...
    def pointed(self, pointer: InterfacePointer[T]) -> T: ...
    def report(self, kind: ReportKind, *, code: int = S_OK, detail: str = "", duration_ns: int = 0) -> None: ...
    def patience_s(self) -> float: ...
    def set_state(self, state: State) -> None: ...
    def get_parameter(self, key: ParameterKey) -> object: ...
    def set_parameter(self, key: ParameterKey, value: object) -> None: ...
    def read_symbol(self, path: str) -> object: ...
    def write_symbol(self, path: str, value: object) -> None: ...
    def read_values(self, keys: tuple[ParameterKey, ...]) -> tuple[object, ...]: ...


class Module(IObject, IDataAreas, IWatchSource):
    """The base class of all modules.

    class_id: the GUID of the class, without which it cannot be created by id. library: "vendor|library|version", when
    versions of the class live side by side. categories: what objects() can be asked for. thread_safe: see rule 3.
    """

    class_id: ClassVar[ClassId] = ""
    library: ClassVar[str] = ""
    categories: ClassVar[tuple[CategoryId, ...]] = ()
    thread_safe: ClassVar[bool] = False

    declared: ClassVar[Declarations] = declarations(object)
    interfaces: ClassVar[Mapping[InterfaceId, InterfaceInfo]] = {}

    _values: dict[str, object]
    _place: Place | None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.declared, cls.interfaces = declarations(cls), offered(cls)
        if taken := [name for name in cls.declared.names() if hasattr(Module, name)]:
            raise TypeError(f"{cls.__name__} declares {', '.join(taken)}, which every module has")
        if "class_id" in vars(cls) and cls.class_id:
            cls.class_id = guid(cls.class_id)
            if cls.library:
                cls.class_id = versioned_class_id(cls.class_id, cls.library)
            if absent := missing(cls):
                raise TypeError(f"{cls.__name__} does not implement {', '.join(absent)}")

    def __new__(cls, *args: object, **kwargs: object) -> Self:
        module = super().__new__(cls)
        module._values, module._place = {}, None
        return module

    # Hooks.

    def on_ip(self) -> None:
        """INIT to PREOP: parameters are there; allocate memory. Others may not exist yet."""

    def on_ps(self) -> None:
        """PREOP to SAFEOP: connect to others, open files; whatever takes long."""

    def on_so(self) -> None:
        """SAFEOP to OP: register with others. Nothing slow."""

    def on_os(self) -> None:
        """OP to SAFEOP: undo SO. Nothing slow."""

    def on_sp(self) -> None:
        """SAFEOP to PREOP: undo PS."""

    def on_pi(self) -> None:
        """PREOP to INIT: undo IP."""

    def on_parameter(self, name: str) -> None:
        """A parameter was set from outside after creation; raising AdsError refuses it, and the old value is back."""

    # Its place.

    @property
    def place(self) -> Place:
        """Its place in an object server; AdsError (ADS_E_NOTINIT) before it is registered."""
        if self._place is None:
            raise AdsError(ADS_E_NOTINIT, f"{type(self).__name__} is not registered with an object server")
        return self._place

    @property
    def object_id(self) -> ObjectId:
        """Its id; NO_OBJECT before it is registered."""
        return NO_OBJECT if self._place is None else self._place.object_id

    @property
    def name(self) -> str:
        """Its name; "" before it is registered."""
        return "" if self._place is None else self._place.name

    @property
    def state(self) -> State:
        """Its state; INIT before it is registered."""
        return State.INIT if self._place is None else self._place.state

    @property
    def server(self) -> Server:
        """The object server it is registered with."""
        return self.place.server

    def enter(self, manager: AbstractContextManager[T]) -> T:
        """Enter a context manager that is left when the transition is undone (outside of hooks: the last one up)."""
        return self.place.enter(manager)

    def connect(self, address: Address, interface: Interface[T]) -> T:
        """Another object, held until the transition is undone. Refused in on_ip and on_pi (ADS_E_INVALIDSTATE)."""
        return self.place.connect(address, interface)

    def pointed(self, pointer: InterfacePointer[T]) -> T:
        """What an interface pointer points to."""
        return self.place.pointed(pointer)

    # ITComObject, ITcADI and ITcWatchSource.

    def get_object_id(self) -> Answer[ObjectId]:
        return Answer(self.object_id)

    def get_object_name(self) -> Answer[str]:
        return Answer(self.name)

    def set_object_name(self, name: str) -> Answer[None]:
        self.place.name = name
        return DONE

    def get_parent_id(self) -> Answer[ObjectId]:
        return Answer(self.place.parent_id)

    def set_parent_id(self, object_id: ObjectId) -> Answer[None]:
        self.place.parent_id = object_id
        return DONE

    def get_state(self) -> Answer[State]:
        return Answer(self.state)

    def set_state(self, state: State) -> Answer[None]:
        self.place.set_state(state)
        return DONE

    def get_parameter(self, key: ParameterKey) -> Answer[object]:
        return Answer(self.place.get_parameter(key))

    def set_parameter(self, key: ParameterKey, value: object) -> Answer[None]:
        self.place.set_parameter(key, value)
        return DONE

    def read_symbol(self, path: str) -> Answer[object]:
        return Answer(self.place.read_symbol(path))

    def write_symbol(self, path: str, value: object) -> Answer[None]:
        self.place.write_symbol(path, value)
        return DONE

    def read_values(self, keys: tuple[ParameterKey, ...]) -> Answer[tuple[object, ...]]:
        return Answer(self.place.read_values(keys))
