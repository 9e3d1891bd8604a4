"""Our module classes as TwinCAT describes them: rows for a .tmc file, so that its tools can show them.

Rule 1: a type that is alike on both sides gets TwinCAT's name, every other one keeps the name it has here.
Rule 2: a method answers an HRESULT; what else it gives back is its last parameter, by reference, called `result`.
Rule 3: defaults of parameters are written where they are one value: a number, a text, a truth.
"""

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec
from msgspec.structs import fields

from bridge.core import module_classes as rows
from bridge.core.module_tmc_writer import write_modules
from bridge.tccom.declarations import UNSET, DataArea, Settable
from bridge.tccom.describing import type_text
from bridge.tccom.identity import ITC_UNKNOWN
from bridge.tccom.interfaces import InterfaceInfo, Method, known_interface
from bridge.tccom.module import Module

_TYPES: Final[dict[object, rows.TypeName]] = {
    bool: rows.TypeName("BOOL"),
    int: rows.TypeName("LINT"),
    float: rows.TypeName("LREAL", "18071995-0000-0000-0000-00000000000e"),
    str: rows.TypeName("STRING(255)"),
}
_UNKNOWN: Final = rows.TypeName("ITcUnknown", ITC_UNKNOWN)
_HRESULT: Final = rows.TypeName("HRESULT", "18071995-0000-0000-0000-000000000019")
_KINDS: Final[dict[type, str]] = {bool: "Bool", int: "Value", float: "Value", str: "String"}


def description(module_class: type[Module]) -> rows.ModuleClass:
    """What a .tmc file says of a class: interfaces, parameters, data areas, interface pointers."""
    declared = module_class.declared
    return rows.ModuleClass(
        guid=module_class.class_id,
        name=module_class.__name__,
        class_id=module_class.class_id,
        class_factory=module_class.__module__,
        interfaces=tuple(rows.TypeName(info.name, info.id) for info in module_class.interfaces.values()),
        parameters=tuple(
            rows.Parameter(
                id=one.id,
                name=name,
                type=_type(one.type),
                default=_default(one.default),
                comment=one.comment,
                online=Settable.OP in one.settable,
                read_only=one.settable is Settable.NEVER,
            )
            for name, one in declared.parameters.items()
        ),
        data_areas=tuple(_area(area) for area in declared.areas.values()),
        interface_pointers=tuple(
            rows.Pointer(one.id, name, rows.TypeName(one.info.name, one.info.id)) for name, one in declared.pointers.items()
        ),
    )


def interface_description(info: InterfaceInfo) -> rows.InterfaceType:
    """What a .tmc file says of an interface: its own methods, those of its base not among them."""
    bases = [found for found in map(known_interface, info.bases) if found is not None]
    inherited = {name for base in bases for name in base.methods}
    return rows.InterfaceType(
        guid=info.id,
        name=info.name,
        base=rows.TypeName(bases[0].name, bases[0].id) if bases and bases[0].id != ITC_UNKNOWN else _UNKNOWN,
        methods=tuple(_method(method) for name, method in info.methods.items() if name not in inherited),
        hides=info.hides,
    )


def write_classes(classes: Iterable[type[Module]]) -> bytes:
    """The content of a .tmc file with these classes and all the interfaces that they offer; ITcUnknown is everywhere."""
    found = list(classes)
    interfaces = {info.id: info for one in found for info in one.interfaces.values() if info.id != ITC_UNKNOWN}
    return write_modules(map(description, found), map(interface_description, interfaces.values()))


def _type(kind: object) -> rows.TypeName:
    return _TYPES.get(kind) or rows.TypeName(type_text(kind))


def _default(value: object) -> tuple[rows.Value, ...]:
    kind = _KINDS.get(type(value))
    return () if value is UNSET or kind is None else (rows.Value(str(value), kind),)


def _method(method: Method) -> rows.Method:
    parameters = [rows.MethodParameter(field.name, _type(field.type)) for field in fields(method.arguments)]
    if method.returns not in (None, type(None)):
        parameters.append(rows.MethodParameter("result", msgspec.structs.replace(_type(method.returns), reference=True)))
    return rows.Method(method.name, tuple(parameters), _HRESULT)


def _area(area: DataArea[msgspec.Struct]) -> rows.DataArea:
    return rows.DataArea(
        number=area.number,
        name=area.name,
        area_type="InputDst" if area.writable else "OutputSrc",
        symbols=tuple(_symbols(area.type, "")),
    )


def _symbols(kind: type[msgspec.Struct], path: str) -> Iterator[rows.Symbol]:
    for field in fields(kind):
        if isinstance(field.type, type) and issubclass(field.type, msgspec.Struct):
            yield from _symbols(field.type, f"{path}{field.name}.")
        else:
            yield rows.Symbol(name=f"{path}{field.name}", type=_type(field.type), default=_default(field.default))
