"""What a module says about itself in its class body: parameters, interface pointers, data areas.

    class Filter(Module):
        gain = Parameter(0x1, float, default=1.0, settable=Settable.INIT | Settable.OP)
        source = InterfacePointer(0x2, ICalculation)
        outputs = DataArea(1, Outputs)

Rule 1: inside, each is a plain attribute: self.gain, self.source.addition(1, 2), self.outputs.value.
Rule 2: outside, a parameter or pointer has an id and a name, an area a number and a name, a symbol "outputs.value".
Rule 3: what comes from outside is checked against the declared type (ADS_E_INVALIDDATA) and against the state: INIT
parameters and pointers are set until the module leaves PREOP, OP parameters in OP (manual 8.1.1.1, "Parameter").
Rule 4: a pointer holds the id of an object; the object server turns it into a reference in PS or SO, and releases that in SP
or OS. A pointer that is not required may stay empty, or name an object that comes later: each use of it tries again.
"""

import copy
from collections.abc import Mapping
from enum import Enum, Flag, StrEnum, auto
from typing import Final, Generic, Protocol, TypeAlias, TypeVar, overload

import msgspec
from msgspec.structs import FieldInfo, fields

from bridge.core.hresult import (
    ADS_E_INVALIDACCESS,
    ADS_E_INVALIDDATA,
    ADS_E_NOTFOUND,
    ADS_E_NOTINIT,
    ADS_E_SYMBOLNOTFOUND,
    AdsError,
)
from bridge.tccom.identity import NO_OBJECT, IdError, ObjectId, ParameterId, id_text, is_object_id, parse_id
from bridge.tccom.interfaces import Interface, InterfaceInfo, describe
from bridge.tccom.states import Transition

T = TypeVar("T")
S = TypeVar("S", bound=msgspec.Struct)


class _Unset(Enum):
    UNSET = auto()


UNSET: Final = _Unset.UNSET
"""No default: a parameter that must be given."""


class Settable(Flag):
    """When a parameter may be set from outside: at creation and in PREOP, in OP, both (INIT | OP) or never."""

    NEVER = 0
    INIT = 1
    OP = 2


class Resolved(StrEnum):
    """In which step a pointer gets its reference. The step that undoes it releases it."""

    PS = "PS"
    SO = "SO"

    @property
    def transition(self) -> Transition:
        """The same step in the table of states."""
        return Transition(self.value)


Address: TypeAlias = ObjectId | str
"""The object that a pointer names: its id, or "target/0x71010000" when it lives under another target."""


def checked_address(value: object) -> Address:
    """An id as a number or text, or "target/id"; ValueError when it is neither. 0 names no object."""
    if isinstance(value, str):
        target, slash, number = value.rpartition("/")
        if not slash:
            return checked_address(parse_id(number))
        if target:
            return f"{target}/{id_text(parse_id(number))}"
    elif isinstance(value, int) and not isinstance(value, bool) and (value == NO_OBJECT or is_object_id(value)):
        return value
    raise IdError(f"{value!r} names no object; expected an id such as 0x71010000, or target/0x71010000")


class Owner(Protocol):
    """What a declaration needs of the module that it belongs to: where its values are kept, and references are got."""

    _values: dict[str, object]

    def pointed(self, pointer: "InterfacePointer[T]") -> T:
        """The stub of a pointer; AdsError when there is none."""
        ...


class _Named:
    name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class _Identified(_Named):
    id: ParameterId


class Parameter(_Identified, Generic[T]):
    """A typed value with an id. Without a default it must be given when the module is created."""

    def __init__(
        self,
        parameter_id: ParameterId,
        type: type[T],
        *,
        default: T | _Unset = UNSET,
        settable: Settable = Settable.INIT,
        comment: str = "",
    ) -> None:
        self.id, self.type, self.default, self.settable, self.comment = parameter_id, type, default, settable, comment

    def __set_name__(self, owner: type, name: str) -> None:
        super().__set_name__(owner, name)
        if self.default is not UNSET:
            self.checked(self.default)

    def checked(self, value: object) -> T:
        """The value in the declared type, e.g. as it came from TOML or JSON; AdsError (ADS_E_INVALIDDATA)."""
        try:
            return msgspec.convert(value, self.type, str_keys=True)
        except msgspec.ValidationError as error:
            raise AdsError(ADS_E_INVALIDDATA, f"{self.name}: {error}") from None

    @overload
    def __get__(self, module: None, owner: type) -> "Parameter[T]": ...
    @overload
    def __get__(self, module: Owner, owner: type) -> T: ...
    def __get__(self, module: Owner | None, owner: type) -> "Parameter[T] | T":
        if module is None:
            return self
        value = module._values.get(self.name, UNSET)
        if value is UNSET and self.default is not UNSET:
            value = module._values.setdefault(self.name, copy.deepcopy(self.default))
        if value is UNSET:
            raise AdsError(ADS_E_NOTINIT, f"parameter {self.name!r} was not given")
        return value  # type: ignore[return-value] # checked() has seen it, or the module's author has set it

    def __set__(self, module: Owner, value: T) -> None:
        module._values[self.name] = value


class InterfacePointer(_Identified, Generic[T]):
    """A reference to another object, declared: its id comes with the parameters, the rest is done in PS or SO."""

    def __init__(
        self,
        parameter_id: ParameterId,
        interface: Interface[T],
        *,
        resolved: Resolved = Resolved.PS,
        required: bool = True,
        default: Address = NO_OBJECT,
        comment: str = "",
    ) -> None:
        self.id, self.interface, self.resolved, self.required = parameter_id, interface, resolved, required
        self.default, self.comment = default, comment

    @property
    def info(self) -> InterfaceInfo:
        """The interface it points to."""
        return describe(self.interface)

    def checked(self, value: object) -> Address:
        """What checked_address() makes of it; AdsError (ADS_E_INVALIDDATA)."""
        try:
            return checked_address(value)
        except IdError as error:
            raise AdsError(ADS_E_INVALIDDATA, f"{self.name}: {error}") from None

    def address(self, module: Owner) -> Address:
        """The object it names, NO_OBJECT when none."""
        value = module._values.get(self.name, self.default)
        return value if isinstance(value, int | str) else NO_OBJECT

    @overload
    def __get__(self, module: None, owner: type) -> "InterfacePointer[T]": ...
    @overload
    def __get__(self, module: Owner, owner: type) -> T: ...
    def __get__(self, module: Owner | None, owner: type) -> "InterfacePointer[T] | T":
        return self if module is None else module.pointed(self)

    def __set__(self, module: Owner, value: object) -> None:
        raise AttributeError(f"{self.name} is an interface pointer; set the id of its object from outside")


class DataArea(_Named, Generic[S]):
    """A structure of symbols that others read and, when it is writable, write: a process image."""

    def __init__(self, number: int, type: type[S], *, writable: bool = False, comment: str = "") -> None:
        self.number, self.type, self.writable, self.comment = number, type, writable, comment

    @overload
    def __get__(self, module: None, owner: type) -> "DataArea[S]": ...
    @overload
    def __get__(self, module: Owner, owner: type) -> S: ...
    def __get__(self, module: Owner | None, owner: type) -> "DataArea[S] | S":
        if module is None:
            return self
        area = module._values.get(self.name)
        if area is None:
            area = module._values.setdefault(self.name, self.type())
        return area  # type: ignore[return-value] # nothing else is put there

    def __set__(self, module: Owner, value: S) -> None:
        module._values[self.name] = value

    def read(self, module: Owner, path: tuple[str, ...]) -> object:
        """The symbol below the area as plain data; no path is the whole area; AdsError (ADS_E_SYMBOLNOTFOUND)."""
        value: object = self.__get__(module, type(module))
        for name in path:
            value = getattr(value, self._field(value, name, path).name)
        return msgspec.to_builtins(value, builtin_types=(bytes,))

    def write(self, module: Owner, path: tuple[str, ...], value: object) -> None:
        """Set a symbol, checked against its type; AdsError: ADS_E_INVALIDACCESS, ADS_E_SYMBOLNOTFOUND, ADS_E_INVALIDDATA."""
        if not self.writable:
            raise AdsError(ADS_E_INVALIDACCESS, f"{self.name} is not written from outside")
        holder: object = self.__get__(module, type(module))
        try:
            if not path:
                self.__set__(module, msgspec.convert(value, self.type))
                return
            for name in path[:-1]:
                holder = getattr(holder, self._field(holder, name, path).name)
            field = self._field(holder, path[-1], path)
            setattr(holder, field.name, msgspec.convert(value, field.type))
        except msgspec.ValidationError as error:
            raise AdsError(ADS_E_INVALIDDATA, f"{'.'.join((self.name, *path))}: {error}") from None

    def _field(self, holder: object, name: str, path: tuple[str, ...]) -> FieldInfo:
        if isinstance(holder, msgspec.Struct):
            for field in fields(holder):
                if field.name == name:
                    return field
        raise AdsError(ADS_E_SYMBOLNOTFOUND, ".".join((self.name, *path)))


Declaration: TypeAlias = Parameter[object] | InterfacePointer[object] | DataArea[msgspec.Struct]


class Declarations(msgspec.Struct, frozen=True):
    """What a class and its bases declare, by name."""

    parameters: Mapping[str, Parameter[object]]
    pointers: Mapping[str, InterfacePointer[object]]
    areas: Mapping[str, DataArea[msgspec.Struct]]

    def names(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.parameters, *self.pointers, *self.areas)

    def value(self, key: ParameterId | str) -> "Parameter[object] | InterfacePointer[object]":
        """The parameter or pointer of an id or name; AdsError (ADS_E_NOTFOUND)."""
        every: list[Parameter[object] | InterfacePointer[object]] = [*self.parameters.values(), *self.pointers.values()]
        for one in every:
            if key in (one.id, one.name):
                return one
        raise AdsError(ADS_E_NOTFOUND, f"no parameter {key if isinstance(key, str) else id_text(key)}")

    def symbol(self, path: str) -> tuple[DataArea[msgspec.Struct], tuple[str, ...]]:
        """The area of "area.symbol.member", and the path below it; AdsError (ADS_E_SYMBOLNOTFOUND)."""
        name, *below = path.split(".")
        if name not in self.areas:
            raise AdsError(ADS_E_SYMBOLNOTFOUND, path)
        return self.areas[name], tuple(below)


def declarations(module: type) -> Declarations:
    """Collect them from a class and its bases; TypeError when two share an id or a number."""
    found: dict[str, object] = {}
    for kind in reversed(module.__mro__):
        found |= {
            name: value for name, value in vars(kind).items() if isinstance(value, Parameter | InterfacePointer | DataArea)
        }
    parameters = {name: one for name, one in found.items() if isinstance(one, Parameter)}
    pointers = {name: one for name, one in found.items() if isinstance(one, InterfacePointer)}
    areas = {name: one for name, one in found.items() if isinstance(one, DataArea)}
    ids = [one.id for one in found.values() if isinstance(one, _Identified)]
    for numbers in (ids, [area.number for area in areas.values()]):
        if doubled := {number for number in numbers if numbers.count(number) > 1}:
            raise TypeError(f"{module.__name__} declares {', '.join(map(id_text, sorted(doubled)))} more than once")
    return Declarations(parameters, pointers, areas)
