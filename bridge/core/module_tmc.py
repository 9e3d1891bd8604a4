"""Module classes and interfaces from TwinCAT's class XML: the Modules and DataTypes of a .tmc file.

Rule 1: bytes in, values out; who opens files is at the edge. A DTD is refused, as in bridge.core.tmc.
Rule 2: a class or an interface is read whole or not at all. Each fault is a Problem with file and line, and the others are
        read. Content that is not well-formed is refused as a whole: half of a module is none.
Rule 3: what this knows nothing of is passed over: the file may be newer, and a description is no place for guessing.

A DataType is an interface when it has a GUID and a BaseType, and either methods or ITcUnknown as that base. Function blocks
have methods too, but no GUID; structures and enumerations have no methods.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final, TypeVar

import msgspec
from lxml import etree

from bridge.core.arguments import guid
from bridge.core.module_classes import (
    Context,
    DataArea,
    InterfaceType,
    Library,
    Member,
    Method,
    MethodParameter,
    ModuleClass,
    Parameter,
    Pointer,
    Symbol,
    TypeName,
    Value,
)
from bridge.core.tmc import MAX_PROBLEMS, Problem, number, parse

ITC_UNKNOWN: Final = "00000001-0000-0000-e000-000000000064"
_TRUE: Final = ("true", "1")
_KNOWN: Final = ("GUID", "Group")
_Row = TypeVar("_Row")


class ModuleFile(msgspec.Struct, frozen=True):
    """The whole classes and interfaces of a file in its order, whose they are, and the faults."""

    modules: tuple[ModuleClass, ...] = ()
    interfaces: tuple[InterfaceType, ...] = ()
    library: Library = Library()
    problems: tuple[Problem, ...] = ()

    def module(self, name: str) -> ModuleClass:
        """The class of that name, GUID or class id. KeyError when there is none, or more than one."""
        found = [each for each in self.modules if name == each.name] or [
            each for each in self.modules if name.strip("{}").lower() in (each.guid, each.class_id)
        ]
        if len(found) != 1:
            known = ", ".join(each.name for each in self.modules)
            raise KeyError(f"{len(found)} module classes are {name!r}; expected one of {known or 'none'}")
        return found[0]


def read_modules(data: bytes, name: str = "") -> ModuleFile:
    """Read the module classes and interfaces of a .tmc file's content; `name` is what problems call the file.

    TmcError when the content is not well-formed XML, has another root, or has a DTD.
    """
    root = parse(data, name)
    reader = _Reader(name)
    return ModuleFile(
        tuple(reader.whole(reader.module, root.iterfind("Modules/Module"))),
        tuple(reader.whole(reader.interface, filter(_is_interface, root.iterfind("DataTypes/DataType")))),
        Library(_text(root, "Vendor/Name"), _text(root, "Library/Name"), _text(root, "Library/Version")),
        tuple(reader.problems),
    )


def _is_interface(element: etree._Element) -> bool:
    head, base = element.find("Name"), element.find("BaseType")
    if head is None or base is None or not head.get("GUID"):
        return False
    return element.find("Method") is not None or _guid_or_empty(base) == ITC_UNKNOWN


class _FaultError(ValueError):
    """A fault, and the element that has it."""

    def __init__(self, element: etree._Element, message: str) -> None:
        self.line, self.message = element.sourceline or 1, message
        super().__init__(message)


class _Reader:
    """Collects the faults of one file."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.problems: list[Problem] = []

    def whole(self, read: Callable[[etree._Element], _Row], elements: Iterable[etree._Element]) -> Iterator[_Row]:
        """What could be read whole."""
        for element in elements:
            try:
                yield read(element)
            except _FaultError as fault:
                if len(self.problems) < MAX_PROBLEMS:
                    self.problems.append(Problem(self.name, fault.line, fault.message))

    def module(self, element: etree._Element) -> ModuleClass:
        name = _required(element, "Name", "a module")
        what = f"module {name}"
        class_id = element.find("CLSID")
        if class_id is None:
            raise _FaultError(element, f"{what}: no CLSID; expected <CLSID ClassFactory=...>{{GUID}}</CLSID>")
        return ModuleClass(
            guid=_guid(element, element.get("GUID"), what),
            name=name,
            class_id=_guid(class_id, class_id.text, f"the CLSID of {what}"),
            class_factory=class_id.get("ClassFactory") or "",
            group=element.get("Group") or "",
            init_sequence=_text(element, "InitSequence"),
            contexts=tuple(_context(each, what) for each in element.iterfind("Contexts/Context")),
            interfaces=tuple(_required_type(each, "Type", what) for each in element.iterfind("Interfaces/Interface")),
            parameters=tuple(_parameter(each, what) for each in element.iterfind("Parameters/Parameter")),
            data_areas=tuple(_data_area(each, what) for each in element.iterfind("DataAreas/DataArea")),
            interface_pointers=tuple(_pointer(each, what) for each in element.iterfind("InterfacePointers/InterfacePointer")),
            data_pointers=tuple(_pointer(each, what) for each in element.iterfind("DataPointers/DataPointer")),
            event_classes=tuple(_required_type(each, "Type", what) for each in element.iterfind("EventClasses/EventClass")),
            licenses={
                _guid(each, each.findtext("LicenseId"), f"a licence of {what}"): each.findtext("Comment") or ""
                for each in element.iterfind("Licenses/License")
            },
            properties=_properties(element),
            attributes={key: value for key, value in element.attrib.items() if key not in _KNOWN},
        )

    def interface(self, element: etree._Element) -> InterfaceType:
        name = _required(element, "Name", "an interface")
        what = f"interface {name}"
        head = element.find("Name")
        return InterfaceType(
            guid=_guid(head, head.get("GUID"), what),
            name=name,
            base=_required_type(element, "BaseType", what),
            methods=tuple(_method(each, what) for each in element.iterfind("Method")),
            hides=tuple(_guid(each, each.get("GUID"), f"a Hide of {what}") for each in element.iterfind("Hides/Hide")),
            comment=element.findtext("Comment") or "",
            namespace=(head.get("Namespace") or "").strip(),
        )


# ELEMENTS ---------------------------------------------------------------------------------------------------------------------


def _context(element: etree._Element, what: str) -> Context:
    task = element.find("ManualConfig/OTCID")
    return Context(
        _number(element, "Id", f"a context of {what}"),
        _text(element, "Name"),
        None if task is None else _number(element, "ManualConfig/OTCID", f"the task of a context of {what}"),
    )


def _parameter(element: etree._Element, what: str) -> Parameter:
    name = _required(element, "Name", f"a parameter of {what}")
    place = f"parameter {name} of {what}"
    members = tuple(
        Member(
            _required(each, "Name", f"a part of {place}"), _required_type(each, "Type", place), each.findtext("Comment") or ""
        )
        for each in element.iterfind("SubItem")
    )
    found = _type(element, "BaseType") or _type(element, "Type")
    if found is None and not members:
        raise _FaultError(element, f"{place}: no type; expected BaseType or SubItem elements")
    return Parameter(
        id=_number(element, "PTCID", place),
        name=name,
        type=found,
        members=members,
        default=_default(element),
        comment=element.findtext("Comment") or "",
        unit=_text(element, "Unit"),
        context_id=_optional_number(element, "ContextId", place),
        online=_flag(element, "OnlineParameter"),
        read_only=_flag(element, "ReadOnly"),
        hidden=_flag(element, "HideParameter"),
        symbol=_flag(element, "CreateSymbol"),
    )


def _data_area(element: etree._Element, what: str) -> DataArea:
    name = _required(element, "Name", f"a data area of {what}")
    place = f"data area {name} of {what}"
    head = element.find("AreaNo")
    area_number = _number(element, "AreaNo", place)
    return DataArea(
        number=area_number,
        name=name,
        area_type=head.get("AreaType") or "",
        context_id=_optional_number(element, "ContextId", place),
        byte_size=_optional_number(element, "ByteSize", place),
        symbols=tuple(_symbol(each, place) for each in element.iterfind("Symbol")),
        symbols_for_ads=_flag(head, "CreateSymbols"),
    )


def _symbol(element: etree._Element, what: str) -> Symbol:
    name = _required(element, "Name", f"a symbol of {what}")
    place = f"symbol {name} of {what}"
    return Symbol(
        name=name,
        type=_required_type(element, "BaseType", place),
        array=tuple(
            (_signed(each, "LBound", place), _number(each, "Elements", place)) for each in element.iterfind("ArrayInfo")
        ),
        default=_default(element),
        comment=element.findtext("Comment") or "",
        bit_size=_optional_number(element, "BitSize", place),
        bit_offset=_optional_number(element, "BitOffs", place),
        properties=_properties(element),
    )


def _pointer(element: etree._Element, what: str) -> Pointer:
    name = _required(element, "Name", f"a pointer of {what}")
    return Pointer(_number(element, "PTCID", f"pointer {name} of {what}"), name, _type(element, "Type"))


def _method(element: etree._Element, what: str) -> Method:
    name = _required(element, "Name", f"a method of {what}")
    parameters = (
        MethodParameter(
            _required(each, "Name", f"a parameter of {what}.{name}"),
            _required_type(each, "Type", f"a parameter of {what}.{name}"),
            each.findtext("Comment") or "",
        )
        for each in element.iterfind("Parameter")
    )
    return Method(name, tuple(parameters), _type(element, "ReturnType"), element.findtext("Comment") or "")


def _default(element: etree._Element) -> tuple[Value, ...]:
    found = element.find("Default")
    return tuple(_values(found, "")) if found is not None else ()


def _values(element: etree._Element, name: str) -> Iterator[Value]:
    """The values of a type and of its parts; parts of parts have the names of both."""
    for child in element:
        if child.tag == "SubItem":
            yield from _values(child, name + (child.findtext("Name") or ""))
        elif child.tag != "Name":
            yield Value(child.text or "", child.tag, name)


def _properties(element: etree._Element) -> dict[str, str]:
    rows = ((_text(each, "Name"), each.findtext("Value") or "") for each in element.iterfind("Properties/Property"))
    return {name: value for name, value in rows if name}


# TEXTS ------------------------------------------------------------------------------------------------------------------------


def _text(element: etree._Element, path: str) -> str:
    return (element.findtext(path) or "").strip()


def _required(element: etree._Element, path: str, what: str) -> str:
    text = _text(element, path)
    if not text:
        raise _FaultError(element, f"{what} has no {path}; expected <{path}>...</{path}>")
    return text


def _flag(element: etree._Element, attribute: str) -> bool:
    return (element.get(attribute) or "").lower() in _TRUE


def _guid(element: etree._Element, text: str | None, what: str) -> str:
    try:
        return guid((text or "").strip())
    except ValueError:
        found = f"GUID {text.strip()[:60]!r}" if text and text.strip() else "no GUID"
        raise _FaultError(element, f"{what}: {found}; expected e.g. {{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}}") from None


def _guid_or_empty(element: etree._Element) -> str:
    try:
        return guid((element.get("GUID") or "").strip())
    except ValueError:
        return ""


def _type(element: etree._Element, path: str) -> TypeName | None:
    found = element.find(path)
    if found is None or not (found.text or "").strip():
        return None
    pointers = number((found.get("PointerTo") or "0").strip())
    return TypeName(
        found.text.strip(),
        _guid(found, found.get("GUID"), f"type {found.text.strip()}") if found.get("GUID") else "",
        (found.get("Namespace") or "").strip(),
        1 if pointers is None else pointers,
        _flag(found, "ReferenceTo"),
    )


def _required_type(element: etree._Element, path: str, what: str) -> TypeName:
    found = _type(element, path)
    if found is None:
        raise _FaultError(element, f"{what}: no type; expected <{path} GUID=...>name</{path}>")
    return found


def _number(element: etree._Element, path: str, what: str) -> int:
    found = element.find(path)
    text = (found.text or "").strip() if found is not None else ""
    parsed = number(text)
    if parsed is None:
        said = f"{path} {text[:40]!r}" if text else f"no {path}"
        place = element if found is None else found
        raise _FaultError(place, f"{what}: {said}; expected 0..4294967295, decimal or #x and hex digits")
    return parsed


def _optional_number(element: etree._Element, path: str, what: str) -> int | None:
    return None if element.find(path) is None else _number(element, path, what)


def _signed(element: etree._Element, path: str, what: str) -> int:
    text = _text(element, path)
    if len(text) > 11 or not text.removeprefix("-").isdecimal() or not text.isascii():
        raise _FaultError(element, f"{what}: {path} {text[:40]!r}; expected a whole number")
    return int(text)
