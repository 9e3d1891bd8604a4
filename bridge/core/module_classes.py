"""What a module class is before anything runs: the description that a .tmc file holds (Tc3_Module manual 8.1.1.1).

Rule 1: values only. Who reads and writes them as XML is module_tmc and module_tmc_writer; who makes objects of them is above.
Rule 2: a description promises nothing about code: an interface that is named here is implemented by whoever offers the class.

A class is known by its `guid`. The class id is what the class factory is asked for; all PLC programs share one. GUIDs are in
lower case without braces, ids are 32-bit numbers, values are texts as they stand in the file, since a type may be anybody's.
"""

from typing import TypeVar

import msgspec

from bridge.core.arguments import guid as parse_guid


class TypeName(msgspec.Struct, frozen=True):
    """A type by name, and by GUID as far as it has one: UDINT, ITcCyclic, STRING(80), a structure of somebody's."""

    name: str
    guid: str = ""
    namespace: str = ""
    pointers: int = 0
    """How many times a pointer to it: an interface that is handed out has one."""
    reference: bool = False


class MethodParameter(msgspec.Struct, frozen=True):
    """One parameter of a method; a reference or a pointer is written by the callee."""

    name: str
    type: TypeName
    comment: str = ""


class Method(msgspec.Struct, frozen=True):
    """A method of an interface."""

    name: str
    parameters: tuple[MethodParameter, ...] = ()
    returns: TypeName | None = None
    comment: str = ""


class InterfaceType(msgspec.Struct, frozen=True):
    """An interface with its methods, those of `base` not among them; `hides` are the ids of its older versions."""

    guid: str
    name: str
    base: TypeName
    methods: tuple[Method, ...] = ()
    hides: tuple[str, ...] = ()
    comment: str = ""
    namespace: str = ""


class Value(msgspec.Struct, frozen=True):
    """A default value as it is written: a kind (Value, String, EnumText, ...) and a text; `name` is the part of the type."""

    text: str
    kind: str = "Value"
    name: str = ""


class Member(msgspec.Struct, frozen=True):
    """A part of a parameter whose type is written out in place."""

    name: str
    type: TypeName
    comment: str = ""


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter. It is set when an instance is made, in OP too when it is `online`, by nobody when it is `read_only`."""

    id: int
    name: str
    type: TypeName | None = None
    members: tuple[Member, ...] = ()
    default: tuple[Value, ...] = ()
    comment: str = ""
    unit: str = ""
    context_id: int | None = None
    online: bool = False
    read_only: bool = False
    hidden: bool = False
    symbol: bool = False


class Symbol(msgspec.Struct, frozen=True, kw_only=True):
    """A named part of a data area. `array` has the lower bound and the number of elements of each dimension."""

    name: str
    type: TypeName
    array: tuple[tuple[int, int], ...] = ()
    default: tuple[Value, ...] = ()
    comment: str = ""
    bit_size: int | None = None
    bit_offset: int | None = None
    properties: dict[str, str] = {}


class DataArea(msgspec.Struct, frozen=True, kw_only=True):
    """Data that others may read or write, with the symbols that tell what stands where."""

    number: int
    name: str
    area_type: str
    """InputDst, OutputSrc, Internal and what else TwinCAT has."""
    context_id: int | None = None
    byte_size: int | None = None
    symbols: tuple[Symbol, ...] = ()
    symbols_for_ads: bool = False


class Pointer(msgspec.Struct, frozen=True):
    """A pointer to an interface or to data of another module; its id is that of the parameter which holds the object id."""

    id: int
    name: str
    type: TypeName | None = None


class Context(msgspec.Struct, frozen=True):
    """A time base of the module; `task` is the object id of the task that it was bound to by hand."""

    id: int
    name: str = ""
    task: int | None = None


_Named = TypeVar("_Named", Parameter, DataArea, Pointer)


class ModuleClass(msgspec.Struct, frozen=True, kw_only=True):
    """A class of modules: what its instances offer, need and can be told."""

    guid: str
    name: str
    class_id: str
    class_factory: str = ""
    group: str = ""
    init_sequence: str = ""
    """How far an instance is started by the system: PS or SO as TwinCAT writes it."""
    contexts: tuple[Context, ...] = ()
    interfaces: tuple[TypeName, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    data_areas: tuple[DataArea, ...] = ()
    interface_pointers: tuple[Pointer, ...] = ()
    data_pointers: tuple[Pointer, ...] = ()
    event_classes: tuple[TypeName, ...] = ()
    licenses: dict[str, str] = {}
    """GUID of a licence to its comment."""
    properties: dict[str, str] = {}
    attributes: dict[str, str] = {}
    """What else stands at the module: TargetPlatform, TcSmClass, ..."""

    def implements(self, interface: str) -> bool:
        """Whether it offers an interface, by name or GUID."""
        return any(interface == each.name or _same_guid(interface, each.guid) for each in self.interfaces)

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name. KeyError names those that there are."""
        return _by_name(name, self.parameters)

    def data_area(self, name: str) -> DataArea:
        """The data area of that name. KeyError names those that there are."""
        return _by_name(name, self.data_areas)

    def interface_pointer(self, name: str) -> Pointer:
        """The interface pointer of that name. KeyError names those that there are."""
        return _by_name(name, self.interface_pointers)


class Library(msgspec.Struct, frozen=True):
    """Who made the classes of a file, and under which version."""

    vendor: str = ""
    name: str = ""
    version: str = ""


def _same_guid(text: str, guid: str) -> bool:
    try:
        return parse_guid(text) == guid
    except ValueError:
        return False


def _by_name(name: str, rows: tuple[_Named, ...]) -> _Named:
    for row in rows:
        if row.name == name:
            return row
    raise KeyError(f"{name!r}; expected one of {', '.join(row.name for row in rows) or 'none'}")
