"""TwinCAT's class XML as event classes: the contents of .tmc, .tsproj and .xti files.

Rule 1: bytes in, values out. Who opens files is at the edge.
Rule 2: a class is read whole or not at all. Each fault is a Problem with file and line; the whole classes beside it are read,
        also from a file that is cut off or not well-formed somewhere.
Rule 3: a file comes from outside: a DTD is refused (so no entities, no external references), elements nest 256 deep at most,
        and nothing is fetched.

Shape (facts 2.1 to 2.4): the root is TcModuleClass, TcSmProject or TcSmItem. A DataType is an event class exactly when it has
EventId children. Translations hang on the root or on one DataType and are joined by the display text; on one class its own
come before those of the file. Display texts are taken as they are, names, ids and GUIDs without the blanks around them.
HideNeedlessArguments holds unless its value is 0 or false; a property without a value has the value "".

Causes, remedies and details have no place that anybody has seen (facts 2.4). Ours are properties of the event, which other
generators write too: under EventId, Properties/Property with the Names
  Cause[3] and behind it Remedy[3]           cause and remedy of id 3
  Detail[Wiring] and DetailComment[Wiring]   text and comment of the detail Wiring
Their values are taken as they are, and translated as display texts are. Every other property of an event is kept as one.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Final

import msgspec
from lxml import etree

from bridge.core.arguments import guid
from bridge.core.catalog import CauseRemedy, Detail, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.tmc_pieces import is_utf8, pieces, utf8

ROOTS: Final = ("TcModuleClass", "TcSmProject", "TcSmItem")
TRANSLATIONS: Final = "Translations"
HIDE_NEEDLESS_ARGUMENTS: Final = "HideNeedlessArguments"
MAX_PROBLEMS: Final = 1000
"""So many problems of one file are reported; more say nothing new."""
HEAD_BYTES: Final = 1_000_000
"""The root element must begin within so many bytes."""
_SEVERITIES: Final = {severity.name.capitalize(): severity for severity in Severity}
_NUMBER: Final = re.compile(r"#[xX]([0-9a-fA-F]{1,8})|([0-9]{1,10})")
_OPTIONS: Final = {
    "resolve_entities": False,
    "no_network": True,
    "huge_tree": False,
    "remove_comments": True,
    "remove_pis": True,
}

_Table = dict[str, dict[int, str]]


class Problem(msgspec.Struct, frozen=True):
    """A fault in a file: where, and what was found and expected."""

    file: str
    line: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.message}"


class TmcError(ValueError):
    """Content that is no TwinCAT XML at all, or that is refused: file, line, and what was expected."""

    def __init__(self, file: str, line: int, message: str) -> None:
        self.file, self.line, self.message = file, line, message
        super().__init__(f"{file}:{line}: {message}")


class ReadResult(msgspec.Struct, frozen=True):
    """The whole classes in the file's order, the faults, and every file-level translation, used by a class or not."""

    classes: tuple[EventClass, ...]
    problems: tuple[Problem, ...] = ()
    translations: dict[str, dict[int, str]] = {}
    lines: Mapping[str, int] = {}
    """GUID to the line of the class."""
    event_lines: Mapping[str, Mapping[int, int]] = {}
    """GUID and id to the line of the event."""

    def line(self, event_class: str, event_id: int | None = None) -> int:
        """The line of a class or of its event, as far as it is known; 1 when it is not."""
        of_class = self.lines.get(event_class, 1)
        return of_class if event_id is None else self.event_lines.get(event_class, {}).get(event_id, of_class)


def read_classes(data: bytes, name: str = "") -> ReadResult:
    """Read the event classes of a .tmc, .tsproj or .xti file's content; `name` is what problems call the file.

    TmcError when the content is not XML, has another root, or has a DTD.
    """
    _check_root(data, name)
    reader = _Reader(name)
    try:
        root = etree.fromstring(data, etree.XMLParser(**_OPTIONS))
    except etree.XMLSyntaxError as error:
        reader.problem(error.lineno or 1, f"{_reason(error)}; expected well-formed XML, the classes that are whole are read")
        reader.salvage(data)
    else:
        for element in root.iterfind("Translations"):
            reader.read_translations(element, reader.table)
        for element in root.iter("DataType"):
            reader.read_data_type(element)
    return reader.result()


def read_translations(data: bytes, name: str = "") -> ReadResult:
    """Read the translations of a file whose root is a Translations block, or those on file level of a class file.

    The result has no classes. TmcError when the content is not XML, has another root, or has a DTD.
    """
    if _check_root(data, name, (*ROOTS, TRANSLATIONS)) != TRANSLATIONS:
        return msgspec.structs.replace(read_classes(data, name), classes=(), lines={}, event_lines={})
    reader = _Reader(name)
    reader.read_translations(parse(data, name, (TRANSLATIONS,)), reader.table)
    return reader.result()


def parse(data: bytes, name: str = "", roots: tuple[str, ...] = ROOTS) -> etree._Element:
    """The root of a file that is well-formed. TmcError when it is not, has another root, or has a DTD."""
    _check_root(data, name, roots)
    try:
        return etree.fromstring(data, etree.XMLParser(**_OPTIONS))
    except etree.XMLSyntaxError as error:
        raise TmcError(name, error.lineno or 1, f"{_reason(error)}; expected well-formed XML") from None


def number(text: str) -> int | None:
    """A number as TwinCAT writes it, "12" or "#x0300201E"; None when it is none of 32 bits."""
    match = _NUMBER.fullmatch(text)
    found = (int(match[1], 16) if match[1] else int(match[2])) if match else 2**32
    return found if found < 2**32 else None


def _reason(error: etree.XMLSyntaxError) -> str:
    return re.sub(r",? line \d+, column \d+.*", "", error.msg or "not well-formed", flags=re.DOTALL)


def _check_root(data: bytes, name: str, roots: tuple[str, ...] = ROOTS) -> str:
    """The root's tag. Looks at the head only, so that a hostile rest costs nothing yet; a fault behind it is not told here."""
    expected = f"expected an XML file whose root is {' or '.join(filter(None, (', '.join(roots[:-1]), roots[-1])))}"
    probe = etree.XMLPullParser(events=("start",), **_OPTIONS)
    fault = TmcError(name, 1, f"no element; {expected}")
    for start in range(0, min(len(data), HEAD_BYTES) + 512, 512):
        piece = data[start : start + 512]
        failed = False
        try:
            probe.feed(piece) if piece else probe.close()
        except etree.XMLSyntaxError as error:
            failed, fault = True, TmcError(name, error.lineno or 1, f"{_reason(error)}; {expected}")
        root = next((element for _, element in probe.read_events()), None)
        if root is not None:
            if root.getroottree().docinfo.internalDTD is not None:
                raise TmcError(name, 1, "a DTD is refused; expected a file without DOCTYPE")
            if root.tag not in roots:
                raise TmcError(name, root.sourceline or 1, f"the root is {root.tag}; {expected}")
            return str(root.tag)
        if failed or not piece:
            break
    raise fault


class _Reader:
    """Collects classes and problems of one file. `table` is its file-level translations; they are joined in result()."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.offset = 0
        self.faults = 0
        self.problems: list[Problem] = []
        self.classes: list[EventClass] = []
        self.table: _Table = {}
        self.lines: dict[str, int] = {}
        self.event_lines: dict[str, dict[int, int]] = {}

    def problem(self, line: int, message: str) -> None:
        self.faults += 1
        if self.faults <= MAX_PROBLEMS:
            self.problems.append(Problem(self.name, line, message))

    def fault(self, element: etree._Element, message: str) -> None:
        self.problem(self.offset + (element.sourceline or 1), message)

    def result(self) -> ReadResult:
        classes = tuple(msgspec.structs.replace(found, translations=self.joined(found)) for found in self.classes)
        return ReadResult(
            classes, tuple(sorted(self.problems, key=lambda each: each.line)), self.table, self.lines, self.event_lines
        )

    def joined(self, found: EventClass) -> _Table:
        joined = {key: dict(table) for key, table in found.translations.items()}
        for key in found.texts():
            if key in self.table:
                joined[key] = {**self.table[key], **found.translations.get(key, {})}
        return joined

    # ELEMENTS -----------------------------------------------------------------------------------------------------------------

    def read_data_type(self, element: etree._Element) -> None:
        if element.find("EventId") is None:
            return
        before = self.faults
        found = self.event_class(element)
        if found is not None and self.faults == before:
            self.classes.append(found)

    def event_class(self, element: etree._Element) -> EventClass | None:
        head = element.find("Name")
        name = _stripped(head)
        if not name:
            self.fault(element, "the event class has no Name; expected <Name GUID=...>name</Name>")
            return None
        class_guid = self.guid(head, f"event class {name}")
        events: dict[int, EventEntry] = {}
        lines: dict[int, int] = {}
        for child in element.iterfind("EventId"):
            entry = self.event(child, name)
            if entry is None:
                continue
            if entry.id in events:
                both = f"{events[entry.id].name} and {entry.name}"
                self.fault(child, f"event class {name}: id {entry.id} is used twice, by {both}; expected different ids")
            events[entry.id] = entry
            lines[entry.id] = self.offset + (child.sourceline or 1)
        translations: _Table = {}
        for child in element.iterfind("Translations"):
            self.read_translations(child, translations)
        hides = [self.guid(child, f"a Hide of event class {name}") for child in element.iterfind("Hides/Hide")]
        properties = {key: value.strip() for key, value in _properties(element.find("Properties"))}
        hidden = properties.pop(HIDE_NEEDLESS_ARGUMENTS, "0")
        if class_guid is None:
            return None
        self.lines[class_guid] = self.offset + (element.sourceline or 1)
        self.event_lines[class_guid] = lines
        return EventClass(
            guid=class_guid,
            name=name,
            display_text=element.findtext("DisplayName") or "",
            events=events,
            translations=translations,
            hides=tuple(each for each in hides if each is not None),
            hide_needless_arguments=hidden.lower() not in ("0", "false"),
            namespace=(head.get("Namespace") or "").strip(),
            comment=element.findtext("Comment") or "",
            properties=properties,
            attributes={key: value for key, value in head.attrib.items() if key not in ("GUID", "Namespace")},
        )

    def event(self, element: etree._Element, class_name: str) -> EventEntry | None:
        parts: dict[str, etree._Element] = {}
        for child in element:  # one pass: find() per part costs twice as much, and a class may have 100,000 events
            parts.setdefault(child.tag, child)
        head = parts.get("Name")
        name = _stripped(head)
        if not name:
            self.fault(element, f"event class {class_name}: an event has no Name; expected <Name Id=...>name</Name>")
            return None
        number = self.number(head, "Id", f"event {class_name}.{name}")
        word = _stripped(parts.get("Severity"))
        severity = _SEVERITIES.get(word.capitalize())
        if severity is None:
            found = f"Severity {word!r}" if word else "no Severity"
            self.fault(element, f"event {class_name}.{name}: {found}; expected one of {', '.join(_SEVERITIES)}")
        if number is None or severity is None:
            return None
        entry = EventEntry(number, name, severity, _text(parts.get("DisplayName")), _text(parts.get("Comment")))
        return _with_properties(entry, parts["Properties"]) if "Properties" in parts else entry

    def read_translations(self, element: etree._Element, into: _Table) -> None:
        for key in element.iterfind("Text"):
            text_id = key.get("TxtId")
            if text_id is None:
                self.fault(key, "a Text has no TxtId; expected the display text it translates")
                continue
            table = into.setdefault(text_id, {})
            for text in key.iterfind("Text"):
                lcid = self.number(text, "LcId", f"the translation of {text_id[:40]!r}")
                if lcid is not None:
                    table[lcid] = text.text or ""

    def guid(self, element: etree._Element, what: str) -> str | None:
        text = (element.get("GUID") or "").strip()
        try:
            return guid(text)
        except ValueError:
            found = f"GUID {text[:60]!r}" if text else "no GUID"
            self.fault(element, f"{what}: {found}; expected e.g. {{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}}")
            return None

    def number(self, element: etree._Element, attribute: str, what: str) -> int | None:
        text = (element.get(attribute) or "").strip()
        parsed = number(text)
        if parsed is not None:
            return parsed
        found = f"{attribute} {text[:40]!r}" if text else f"no {attribute}"
        self.fault(element, f"{what}: {found}; expected 0..4294967295, decimal or #x and hex digits")
        return None

    # FILES THAT ARE NOT WELL-FORMED -------------------------------------------------------------------------------------------

    def salvage(self, data: bytes) -> None:
        """Read each DataType that is whole and well-formed on its own, and the file's translations if they are."""
        text = utf8(data)
        line, last = 1, 0
        for start, end, tag in pieces(text):
            line, last = line + text.count(b"\n", last, start), start
            if end < 0:
                self.problem(line, f"a {tag} is not closed; expected </{tag}>")
                continue
            piece = text[start:end]
            if tag == "DataType" and b"<EventId" not in piece:
                continue
            self.offset = line - 1
            try:
                element = etree.fromstring(piece, etree.XMLParser(encoding="utf-8", **_OPTIONS))
            except etree.XMLSyntaxError as error:
                reason = _reason(error) if is_utf8(piece) else "bytes that are no text in the file's encoding"
                self.problem(self.offset + (error.lineno or 1), f"a {tag} cannot be read: {reason}; expected well-formed XML")
            else:
                if tag == "DataType":
                    self.read_data_type(element)
                else:
                    self.read_translations(element, self.table)


def _properties(element: etree._Element | None) -> Iterator[tuple[str, str]]:
    for child in element.iterfind("Property") if element is not None else ():
        if key := _stripped(child.find("Name")):
            yield key, child.findtext("Value") or ""


FURTHER: Final = re.compile(r"(Cause|Remedy)\[([0-9]{1,10})\]|(Detail|DetailComment)\[(.*)\]", re.DOTALL)
"""The Names of properties of an event that are causes, remedies and details."""


def _with_properties(entry: EventEntry, element: etree._Element) -> EventEntry:
    causes: list[CauseRemedy] = []
    details: list[Detail] = []
    others: dict[str, str] = {}
    for key, value in _properties(element):
        match = FURTHER.fullmatch(key)
        if match is None:
            others[key] = value.strip()
        elif match[1] == "Cause":
            causes.append(CauseRemedy(int(match[2]), value))
        elif match[3] == "Detail":
            details.append(Detail(match[4], value))
        elif match[1] and causes and causes[-1].id == int(match[2]):
            causes[-1] = msgspec.structs.replace(causes[-1], remedy=value)
        elif match[1]:
            causes.append(CauseRemedy(int(match[2]), "", value))
        elif details and details[-1].name == match[4]:
            details[-1] = msgspec.structs.replace(details[-1], comment=value)
        else:
            details.append(Detail(match[4], "", value))
    return msgspec.structs.replace(entry, causes=tuple(causes), details=tuple(details), properties=others)


def _text(element: etree._Element | None) -> str:
    return (element.text or "") if element is not None else ""


def _stripped(element: etree._Element | None) -> str:
    return _text(element).strip()
