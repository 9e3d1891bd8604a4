"""What a module class looks like from outside: plain data about its interfaces, parameters and symbols."""

from collections.abc import Iterator

import msgspec
from msgspec.structs import fields

from bridge.tccom.declarations import UNSET, DataArea, Settable
from bridge.tccom.general import ClassInfo, ParameterInfo, SymbolInfo
from bridge.tccom.module import Module


def class_info(module_class: type[Module]) -> ClassInfo:
    """What everybody may know of a class."""
    declared = module_class.declared
    parameters = [
        ParameterInfo(
            id=one.id,
            name=name,
            type=type_text(one.type),
            settable=tuple(flag.name.lower() for flag in Settable if flag in one.settable and flag.name),
            required=one.default is UNSET,
            comment=one.comment,
        )
        for name, one in declared.parameters.items()
    ]
    pointers = [
        ParameterInfo(
            id=one.id,
            name=name,
            type=one.info.name,
            settable=("init",),
            required=one.required and not one.default,
            interface=one.info.id,
            comment=one.comment,
        )
        for name, one in declared.pointers.items()
    ]
    return ClassInfo(
        class_id=module_class.class_id,
        name=module_class.__name__,
        description=(module_class.__doc__ or "").strip().partition("\n")[0],
        library=module_class.library,
        thread_safe=module_class.thread_safe,
        interfaces={iid: info.name for iid, info in module_class.interfaces.items()},
        categories=module_class.categories,
        parameters=(*parameters, *pointers),
        symbols=tuple(symbol for area in declared.areas.values() for symbol in _symbols(area, area.name, area.type)),
    )


def _symbols(area: DataArea[msgspec.Struct], path: str, kind: type[msgspec.Struct]) -> Iterator[SymbolInfo]:
    for field in fields(kind):
        below = f"{path}.{field.name}"
        if isinstance(field.type, type) and issubclass(field.type, msgspec.Struct):
            yield from _symbols(area, below, field.type)
        else:
            yield SymbolInfo(path=below, type=type_text(field.type), area=area.number, writable=area.writable)


def type_text(kind: object) -> str:
    """A type as people write it: "int", "list[float]", "Severity"."""
    return kind.__name__ if isinstance(kind, type) and not hasattr(kind, "__origin__") else str(kind).replace("typing.", "")
