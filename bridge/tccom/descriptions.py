"""Our module classes as TwinCAT describes them: rows for a .tmc file, so that its tools can show them.

Rule 1: a type that is alike on both sides gets TwinCAT's name, every other one keeps the name it has here.
Rule 2: a method answers an HRESULT; what else it gives back is its last parameter, by reference, called `result`.
Rule 3: an interface that TwinCAT has itself gets TwinCAT's name, and is not declared again: its methods there have other forms.
Rule 4: defaults of parameters are written where they are one value: a number, a text, a truth.
"""

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec
from msgspec.structs import fields

from bridge.core import module_classes as rows
from bridge.core.module_tmc import ModuleFile
from bridge.tccom.declarations import UNSET, DataArea, Settable
from bridge.tccom.describing import type_text
from bridge.tccom.identity import (
    ITC_ADI,
    ITC_CYCLIC,
    ITC_CYCLIC_CALLER,
    ITC_TASK,
    ITC_UNKNOWN,
    ITC_WATCH_SOURCE,
    ITCOM_OBJECT,
    ITCOM_OBJECT_SERVER,
)
from bridge.tccom.interfaces import InterfaceInfo, Method, known_interface
from bridge.tccom.module import Module

_TYPES: Final[dict[object, rows.TypeName]] = {
    bool: rows.TypeName("BOOL"),
    int: rows.TypeName("LINT"),
    float: rows.TypeName("LREAL", "18071995-0000-0000-0000-00000000000e"),
    str: rows.TypeName("STRING(255)"),
}
_TWINCAT: Final = {
    ITC_UNKNOWN: "ITcUnknown",
    ITCOM_OBJECT: "ITComObject",
    ITCOM_OBJECT_SERVER: "ITComObjectServer",
    ITC_TASK: "ITcTask",
    ITC_CYCLIC: "ITcCyclic",
    ITC_CYCLIC_CALLER: "ITcCyclicCaller",
    ITC_ADI: "ITcADI",
    ITC_WATCH_SOURCE: "ITcWatchSource",
}
_UNKNOWN: Final = rows.TypeName("ITcUnknown", ITC_UNKNOWN)
_HRESULT: Final = rows.TypeName("HRESULT", "18071995-0000-0000-0000-000000000019")
_KINDS: Final[dict[type, str]] = {bool: "Bool", int: "Value", float: "Value", str: "String"}


def described(classes: Iterable[type[Module]]) -> ModuleFile:
    """What a .tmc file of these classes holds: with all the interfaces that they offer and TwinCAT does not know."""
    found = list(classes)
    interfaces = {info.id: info for one in found for info in one.interfaces.values() if info.id not in _TWINCAT}
    return ModuleFile(tuple(map(_module, found)), tuple(map(_interface, interfaces.values())))


def _module(module_class: type[Module]) -> rows.ModuleClass:
    """What a .tmc file says of a class: interfaces, parameters, data areas, interface pointers."""
    declared = module_class.declared
    return rows.ModuleClass(
        guid=module_class.class_id,
        name=module_class.__name__,
        class_id=module_class.class_id,
        class_factory=module_class.__module__,
        interfaces=tuple(map(_named, (info for info in module_class.interfaces.values() if info.id != ITC_UNKNOWN))),
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
        interface_pointers=tuple(rows.Pointer(one.id, name, _named(one.info)) for name, one in declared.pointers.items()),
    )


def _interface(info: InterfaceInfo) -> rows.InterfaceType:
    """What a .tmc file says of an interface: its own methods, those of its base not among them."""
    bases = [found for found in map(known_interface, info.bases) if found is not None]
    inherited = {name for base in bases for name in base.methods}
    return rows.InterfaceType(
        guid=info.id,
        name=info.name,
        base=_named(bases[0]) if bases else _UNKNOWN,
        methods=tuple(_method(method) for name, method in info.methods.items() if name not in inherited),
        hides=info.hides,
    )


def _named(info: InterfaceInfo) -> rows.TypeName:
    return rows.TypeName(_TWINCAT.get(info.id, info.name), info.id)


def _type(kind: object) -> rows.TypeName:
    return _TYPES.get(kind) or rows.TypeName(type_text(kind))


def _default(value: object) -> tuple[rows.Value, ...]:
    kind = _KINDS.get(type(value))
    text = str(value).lower() if kind == "Bool" else str(value)
    return () if value is UNSET or kind is None else (rows.Value(text, kind),)


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
