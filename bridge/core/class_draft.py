"""Event classes as a file has them, right or wrong, with lines: what a linter looks at.

Rule 1: a reader (core/tmc.py) gives a class whole or not at all; a draft has what is there, so that one fault of a class does
not hide the others. What a draft leaves out, the reader has told as a Problem.
Rule 2: a file comes from outside, as for the reader: nothing is expanded or fetched, and a file with a DTD has no drafts.

A file that is no XML, and XML that is not well-formed, give the drafts of the classes that the reader could read whole.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

import msgspec
from lxml import etree

from bridge.core.arguments import guid
from bridge.core.catalog import EventClass, EventEntry
from bridge.core.tmc import FURTHER, ReadResult

_OPTIONS: Final = {"resolve_entities": False, "no_network": True, "huge_tree": False, "remove_comments": True}


class DraftText(msgspec.Struct, frozen=True):
    """A further text of an event: what it is ("cause 1", "detail Wiring"), the text, its line."""

    what: str
    text: str
    line: int


class DraftEvent(msgspec.Struct, frozen=True):
    """One event: its line, its id as written, Name and display text; its causes, remedies and details."""

    line: int
    id: str
    name: str
    display_text: str
    further: tuple[DraftText, ...] = ()


class DraftClass(msgspec.Struct, frozen=True):
    """One class: where it stands, its GUID ("" when it has none that is one), and what it says.

    texts are the translations that its texts have: a text to LCID to translation, with the line of each.
    """

    file: str
    line: int
    guid: str
    name: str
    display_text: str
    events: tuple[DraftEvent, ...]
    texts: Mapping[str, Mapping[int, tuple[str, int]]]
    hides: tuple[str, ...] = ()


class Use(msgspec.Struct, frozen=True):
    """A module of the file says that it uses the class of this GUID."""

    file: str
    line: int
    guid: str


class Draft(msgspec.Struct, frozen=True):
    """What one file has: its classes and which classes its modules use."""

    file: str
    classes: tuple[DraftClass, ...]
    uses: tuple[Use, ...] = ()


def draft(data: bytes, file: str, result: ReadResult) -> Draft:
    """The draft of a file's content, of which the reader made this result."""
    try:
        root = etree.fromstring(data, etree.XMLParser(**_OPTIONS))
    except etree.XMLSyntaxError:
        return Draft(file, tuple(_of_class(file, each, result) for each in result.classes))
    if root.getroottree().docinfo.internalDTD is not None:
        return Draft(file, ())
    table = _texts(root)
    classes = [_of_element(file, each, table) for each in root.iter("DataType") if each.find("EventId") is not None]
    uses = [
        Use(file, _line(each), name) for each in root.iterfind(".//EventClasses/EventClass/Type") if (name := _guid(each)) != ""
    ]
    return Draft(file, tuple(classes), tuple(uses))


def _of_class(file: str, found: EventClass, result: ReadResult) -> DraftClass:
    line = result.line(found.guid)
    events = tuple(
        DraftEvent(
            result.line(found.guid, each.id),
            str(each.id),
            each.name,
            each.display_text,
            tuple(_further(each, result.line(found.guid, each.id))),
        )
        for each in found.events.values()
    )
    lines = {each.display_text: each.line for each in events}
    texts = {
        key: {lcid: (text, lines.get(key, line)) for lcid, text in table.items()} for key, table in found.translations.items()
    }
    return DraftClass(file, line, found.guid, found.qualified_name, found.display_text, events, texts, found.hides)


def _further(event: EventEntry, line: int) -> Iterator[DraftText]:
    for cause in event.causes:
        yield DraftText(f"cause {cause.id}", cause.cause, line)
        yield DraftText(f"remedy {cause.id}", cause.remedy, line)
    for detail in event.details:
        yield DraftText(f"detail {detail.name}", detail.text, line)


def _written(event: etree._Element) -> Iterator[DraftText]:
    """The properties that core/tmc.py reads as causes, remedies and details."""
    for each in event.iterfind("Properties/Property"):
        match = FURTHER.fullmatch(_text(each.find("Name")).strip())
        if match is not None and match[3] != "DetailComment":
            yield DraftText(f"{(match[1] or match[3]).lower()} {match[2] or match[4]}", _text(each.find("Value")), _line(each))


def _of_event(event: DraftEvent) -> tuple[str, ...]:
    return event.display_text, *(each.text for each in event.further)


_Table = dict[str, dict[int, tuple[str, int]]]


def _of_element(file: str, element: etree._Element, table: _Table) -> DraftClass:
    head = element.find("Name")
    name = _text(head).strip() or "(no name)"
    namespace = (head.get("Namespace") or "").strip() if head is not None else ""
    events = tuple(
        DraftEvent(
            _line(each),
            (found.get("Id") or "").strip() if (found := each.find("Name")) is not None else "",
            _text(found).strip(),
            _text(each.find("DisplayName")),
            tuple(_written(each)),
        )
        for each in element.iterfind("EventId")
    )
    display_text = _text(element.find("DisplayName"))
    own = _texts(element)
    texts = {
        key: {**table.get(key, {}), **own.get(key, {})}
        for key in dict.fromkeys((display_text, *(text for each in events for text in _of_event(each))))
        if key in table or key in own
    }
    hides = tuple(found for each in element.iterfind("Hides/Hide") if (found := _guid(each)) != "")
    return DraftClass(
        file,
        _line(element),
        _guid(head) if head is not None else "",
        f"{namespace}.{name}" if namespace else name,
        display_text,
        events,
        texts,
        hides,
    )


def _texts(owner: etree._Element) -> _Table:
    table: _Table = {}
    for key in owner.iterfind("Translations/Text"):
        row = table.setdefault(key.get("TxtId") or "", {})
        for text in key.iterfind("Text"):
            lcid = (text.get("LcId") or "").strip()
            if lcid.isascii() and lcid.isdecimal() and len(lcid) <= 10:
                row[int(lcid)] = (text.text or "", _line(text))
    return table


def _text(element: etree._Element | None) -> str:
    return (element.text or "") if element is not None else ""


def _line(element: etree._Element) -> int:
    return element.sourceline or 1


def _guid(element: etree._Element) -> str:
    try:
        return guid((element.get("GUID") or "").strip())
    except ValueError:
        return ""


def classes_of(drafts: Iterable[Draft]) -> list[DraftClass]:
    """Every class of these files, in order."""
    return [each for found in drafts for each in found.classes]
