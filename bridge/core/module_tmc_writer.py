"""Module classes and interfaces as TwinCAT's class XML: what a .tmc file holds besides event classes.

Rule 1: what is written reads back equal (bridge/core/module_tmc.py). What that passes over in a file is not kept.
Rule 2: what XML cannot hold (control characters, lone surrogates) is the caller's fault and raises ValueError.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import groupby
from typing import Final

from lxml import etree

from bridge.core.catalog import EventClass
from bridge.core.module_classes import (
    DataArea,
    InterfaceType,
    Library,
    Method,
    ModuleClass,
    Parameter,
    Pointer,
    Symbol,
    TypeName,
    Value,
)
from bridge.core.tmc_writer import append_classes, append_properties, braced, document, file_root, put_text

_FLAGS: Final = {"HideParameter": "hidden", "OnlineParameter": "online", "ReadOnly": "read_only", "CreateSymbol": "symbol"}


def write_modules(
    modules: Iterable[ModuleClass],
    interfaces: Iterable[InterfaceType] = (),
    library: Library | None = None,
    event_classes: Iterable[EventClass] = (),
) -> bytes:
    """The content of a .tmc file with these. ValueError names the one that XML cannot hold."""
    root = file_root()
    made_by = library or Library()
    if made_by.vendor:
        _put(etree.SubElement(root, "Vendor"), "Name", made_by.vendor)
    types = etree.SubElement(root, "DataTypes")
    append_classes(types, event_classes)
    for interface in interfaces:
        with _naming(f"interface {interface.name!r}"):
            types.append(_interface(interface))
    place = etree.SubElement(root, "Modules")
    for module in modules:
        with _naming(f"module {module.name!r}"):
            place.append(_module(module))
    if made_by.name or made_by.version:
        element = etree.SubElement(root, "Library")
        _put(element, "Name", made_by.name)
        _put(element, "Version", made_by.version)
    return document(root)


@contextmanager
def _naming(what: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{what} cannot be written as XML: {error}") from None


def _module(module: ModuleClass) -> etree._Element:
    element = etree.Element("Module", {"GUID": braced(module.guid), **module.attributes})
    if module.group:
        element.set("Group", module.group)
    _put(element, "Name", module.name)
    _put(element, "CLSID", braced(module.class_id)).set("ClassFactory", module.class_factory)
    licenses = etree.SubElement(element, "Licenses")
    for license_id, comment in module.licenses.items():
        row = etree.SubElement(licenses, "License")
        _put(row, "LicenseId", braced(license_id))
        _comment(row, comment)
    if module.init_sequence:
        _put(element, "InitSequence", module.init_sequence)
    contexts = etree.SubElement(element, "Contexts")
    for context in module.contexts:
        row = etree.SubElement(contexts, "Context")
        _put(row, "Id", str(context.id))
        if context.name:
            _put(row, "Name", context.name)
        if context.task is not None:
            _put(etree.SubElement(row, "ManualConfig"), "OTCID", _hex(context.task))
    _types(element, "Interfaces", "Interface", module.interfaces)
    parameters = etree.SubElement(element, "Parameters")
    for parameter in module.parameters:
        parameters.append(_parameter(parameter))
    areas = etree.SubElement(element, "DataAreas")
    for area in module.data_areas:
        areas.append(_data_area(area))
    _pointers(element, "InterfacePointers", "InterfacePointer", module.interface_pointers)
    _pointers(element, "DataPointers", "DataPointer", module.data_pointers)
    etree.SubElement(element, "Deployment")
    _types(element, "EventClasses", "EventClass", module.event_classes)
    append_properties(element, [*module.properties.items()])
    return element


def _interface(interface: InterfaceType) -> etree._Element:
    element = etree.Element("DataType")
    head = _put(element, "Name", interface.name)
    head.set("GUID", braced(interface.guid))
    if interface.namespace:
        head.set("Namespace", interface.namespace)
    _type(element, "BaseType", interface.base)
    _comment(element, interface.comment)
    for method in interface.methods:
        element.append(_method(method))
    if interface.hides:
        hides = etree.SubElement(element, "Hides")
        for hidden in interface.hides:
            etree.SubElement(hides, "Hide", GUID=braced(hidden))
    return element


def _method(method: Method) -> etree._Element:
    element = etree.Element("Method")
    _put(element, "Name", method.name)
    _comment(element, method.comment)
    if method.returns is not None:
        _type(element, "ReturnType", method.returns)
    for parameter in method.parameters:
        row = etree.SubElement(element, "Parameter")
        _put(row, "Name", parameter.name)
        _comment(row, parameter.comment)
        _type(row, "Type", parameter.type)
    return element


def _parameter(parameter: Parameter) -> etree._Element:
    element = etree.Element("Parameter", {key: "true" for key, name in _FLAGS.items() if getattr(parameter, name)})
    _put(element, "Name", parameter.name)
    _comment(element, parameter.comment)
    if parameter.unit:
        _put(element, "Unit", parameter.unit)
    if parameter.type is not None:
        _type(element, "BaseType", parameter.type)
    for member in parameter.members:
        row = etree.SubElement(element, "SubItem")
        _put(row, "Name", member.name)
        _comment(row, member.comment)
        _type(row, "Type", member.type)
    _default(element, parameter.default)
    _put(element, "PTCID", _hex(parameter.id))
    _number(element, "ContextId", parameter.context_id)
    return element


def _data_area(area: DataArea) -> etree._Element:
    element = etree.Element("DataArea")
    head = _put(element, "AreaNo", str(area.number))
    head.set("AreaType", area.area_type)
    if area.symbols_for_ads:
        head.set("CreateSymbols", "true")
    _put(element, "Name", area.name)
    _number(element, "ContextId", area.context_id)
    _number(element, "ByteSize", area.byte_size)
    for symbol in area.symbols:
        element.append(_symbol(symbol))
    return element


def _symbol(symbol: Symbol) -> etree._Element:
    element = etree.Element("Symbol")
    _put(element, "Name", symbol.name)
    _comment(element, symbol.comment)
    _number(element, "BitSize", symbol.bit_size)
    _type(element, "BaseType", symbol.type)
    for lower, elements in symbol.array:
        row = etree.SubElement(element, "ArrayInfo")
        _put(row, "LBound", str(lower))
        _put(row, "Elements", str(elements))
    _default(element, symbol.default)
    append_properties(element, [*symbol.properties.items()])
    _number(element, "BitOffs", symbol.bit_offset)
    return element


def _pointers(parent: etree._Element, tag: str, row_tag: str, pointers: Iterable[Pointer]) -> None:
    block = etree.SubElement(parent, tag)
    for pointer in pointers:
        row = etree.SubElement(block, row_tag)
        _put(row, "PTCID", _hex(pointer.id))
        _put(row, "Name", pointer.name)
        if pointer.type is not None:
            _type(row, "Type", pointer.type)


def _types(parent: etree._Element, tag: str, row_tag: str, types: Iterable[TypeName]) -> None:
    block = etree.SubElement(parent, tag)
    for each in types:
        _type(etree.SubElement(block, row_tag), "Type", each)


def _default(parent: etree._Element, values: Iterable[Value]) -> None:
    rows = [(name, list(group)) for name, group in groupby(values, lambda value: value.name)]
    if not rows:
        return
    block = etree.SubElement(parent, "Default")
    for name, group in rows:
        place = block
        if name:
            place = etree.SubElement(block, "SubItem")
            _put(place, "Name", name)
        for value in group:
            put_text(place, value.kind, value.text)


# TEXTS ------------------------------------------------------------------------------------------------------------------------


def _put(parent: etree._Element, tag: str, text: str) -> etree._Element:
    element = etree.SubElement(parent, tag)
    element.text = text
    return element


def _comment(parent: etree._Element, comment: str) -> None:
    if comment:
        put_text(parent, "Comment", comment)


def _number(parent: etree._Element, tag: str, number: int | None) -> None:
    if number is not None:
        _put(parent, tag, str(number))


def _type(parent: etree._Element, tag: str, found: TypeName) -> None:
    element = _put(parent, tag, found.name)
    if found.guid:
        element.set("GUID", braced(found.guid))
    if found.namespace:
        element.set("Namespace", found.namespace)
    if found.pointers:
        element.set("PointerTo", str(found.pointers))
    if found.reference:
        element.set("ReferenceTo", "true")


def _hex(number: int) -> str:
    return f"#x{number:08X}"
