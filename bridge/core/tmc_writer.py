"""Event classes as TwinCAT's class XML: what a .tmc file holds.

Rule 1: what is written reads back equal (bridge/core/tmc.py). Translations stand with their class, so that a class can be
        cut out of the file and pasted elsewhere; comments of the XML and the order of attributes are not kept.
Rule 2: what XML cannot hold (control characters, lone surrogates) is the caller's fault and raises ValueError.

The shape is that of facts 2.2, the places of causes, remedies and details are those on top of bridge/core/tmc.py.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from lxml import etree

from bridge.core.catalog import EventClass, EventEntry
from bridge.core.tmc import HIDE_NEEDLESS_ARGUMENTS

_ROOT: Final = "TcModuleClass"
_SCHEMA: Final = "http://www.beckhoff.com/schemas/2009/05/TcModuleClass"
_INSTANCE: Final = "http://www.w3.org/2001/XMLSchema-instance"


def write_classes(classes: Iterable[EventClass]) -> bytes:
    """The content of a .tmc file with these classes.

    ValueError names the class when it has no event, for then it would read back as none, or a text that XML cannot hold.
    """
    root = file_root()
    append_classes(etree.SubElement(root, "DataTypes"), classes)
    return document(root)


def file_root() -> etree._Element:
    """The root of a .tmc file, empty."""
    root = etree.Element(_ROOT, nsmap={"xsi": _INSTANCE})
    root.set(f"{{{_INSTANCE}}}noNamespaceSchemaLocation", _SCHEMA)
    return root


def append_classes(types: etree._Element, classes: Iterable[EventClass]) -> None:
    """Put the classes into a DataTypes element. ValueError as in write_classes()."""
    for found in classes:
        try:
            types.append(_data_type(found))
        except ValueError as error:
            raise ValueError(f"event class {found.qualified_name!r} cannot be written as XML: {error}") from None


def document(root: etree._Element) -> bytes:
    """The element as a file: declaration, UTF-8, tabs as the TMC editor writes them."""
    etree.indent(root, "\t")
    data: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return data + b"\n"


def translations_element(table: Mapping[str, Mapping[int, str]]) -> etree._Element:
    """A Translations block: text, LCID, translated text. ValueError when a text cannot stand in XML."""
    element = etree.Element("Translations")
    for key, translated in table.items():
        text = etree.SubElement(element, "Text", TxtId=key)
        for lcid, value in translated.items():
            put_text(text, "Text", value, LcId=str(lcid))
    return element


def braced(guid: str) -> str:
    """A GUID as TwinCAT writes it: "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}"."""
    return f"{{{guid.upper()}}}"


def put_text(parent: etree._Element, tag: str, text: str, **attributes: str) -> etree._Element:
    """Add an element with a text of any kind. ValueError when XML cannot hold it."""
    element = etree.SubElement(parent, tag, **attributes)
    # A CR inside CDATA would be read as a line feed; as a plain text it is written as a reference. lxml parts "]]>" itself.
    element.text = text if not text or "\r" in text else etree.CDATA(text)
    return element


def _named(parent: etree._Element, name: str, attributes: Mapping[str, str]) -> None:
    element = etree.SubElement(parent, "Name", dict(attributes))
    element.text = name


def _data_type(found: EventClass) -> etree._Element:
    if not found.events:
        raise ValueError("it has no event")
    element = etree.Element("DataType")
    namespace = {"Namespace": found.namespace} if found.namespace else {}
    _named(element, found.name, {"GUID": braced(found.guid), **found.attributes, **namespace})
    put_text(element, "DisplayName", found.display_text, TxtId="")
    for entry in found.events.values():
        element.append(_event(entry))
    if found.comment:
        put_text(element, "Comment", found.comment, TxtId="")
    if found.translations:
        element.append(translations_element(found.translations))
    hidden = [(HIDE_NEEDLESS_ARGUMENTS, "1")] if found.hide_needless_arguments else []
    append_properties(element, [*hidden, *found.properties.items()])
    if found.hides:
        hides = etree.SubElement(element, "Hides")
        for hidden_guid in found.hides:
            etree.SubElement(hides, "Hide", GUID=braced(hidden_guid))
    return element


def _event(entry: EventEntry) -> etree._Element:
    element = etree.Element("EventId")
    _named(element, entry.name, {"Id": str(entry.id)})
    put_text(element, "DisplayName", entry.display_text, TxtId="")
    severity = etree.SubElement(element, "Severity")
    severity.text = entry.severity.name.capitalize()
    if entry.comment:
        put_text(element, "Comment", entry.comment, TxtId="")
    append_properties(element, [*_help(entry), *entry.properties.items()])
    return element


def _help(entry: EventEntry) -> Iterator[tuple[str, str]]:
    for cause in entry.causes:
        yield f"Cause[{cause.id}]", cause.cause
        yield f"Remedy[{cause.id}]", cause.remedy
    for detail in entry.details:
        yield f"Detail[{detail.name}]", detail.text
        if detail.comment:
            yield f"DetailComment[{detail.name}]", detail.comment


def append_properties(parent: etree._Element, properties: Sequence[tuple[str, str]]) -> None:
    """Add a Properties block if there are any."""
    if not properties:
        return
    block = etree.SubElement(parent, "Properties")
    for name, value in properties:
        element = etree.SubElement(block, "Property")
        _named(element, name, {})
        put_text(element, "Value", value)
