"""Event classes as TOML, for people without TwinCAT; docs/classes.md describes the format.

Rule 1: bytes in, values out, and back; what is written reads back equal.
Rule 2: a class is read whole or not at all. Each fault is a Problem with file and line; the whole classes beside it are read.
        An unknown key is a fault, with the key that was probably meant. A file that is no TOML is refused.
Rule 3: a class without a GUID gets the one of its content (bridge/core/definitions.py). `guid` is taken as it is.
        `published` is the content's GUID when the class was last given away: if the content is another by now, the class is
        the edited one, which hides the published one.
Rule 4: a file comes from outside, so toml_text has limits for it; larger classes belong in a .tmc file.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Final, TypeAlias

import msgspec

from bridge.core import toml_text
from bridge.core.catalog import CauseRemedy, Detail, EventClass, EventEntry, exact_language, exact_tag
from bridge.core.definitions import content_guid, define_class, published_as
from bridge.core.events import Severity
from bridge.core.tmc import Problem, ReadResult, TmcError

_PERSISTENT: Final = {"PersistentType": "true"}
_SEVERITIES: Final = {severity.name.lower(): severity for severity in Severity}
_Id: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
_Texts: TypeAlias = dict[str, str]


class _Cause(msgspec.Struct, forbid_unknown_fields=True):
    id: _Id
    cause: str
    remedy: str = ""


class _Detail(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    text: str
    comment: str = ""


class _Event(msgspec.Struct, forbid_unknown_fields=True):
    id: _Id
    name: str
    severity: str
    display_text: str = ""
    translations: _Texts = {}
    comment: str = ""
    causes: list[_Cause] = []
    details: list[_Detail] = []
    properties: _Texts = {}


class _Class(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    events: list[_Event]
    namespace: str = ""
    display_text: str = ""
    translations: _Texts = {}
    guid: str | None = None
    published: str | None = None
    hides: list[str] = []
    hide_needless_arguments: bool = False
    comment: str = ""
    properties: _Texts = {}
    attributes: _Texts | None = None
    texts: dict[str, _Texts] = {}


_TABLES: Final[dict[tuple[str, ...], type[msgspec.Struct]]] = {
    (): _Class,
    ("events",): _Event,
    ("events", "causes"): _Cause,
    ("events", "details"): _Detail,
}
_KEYS: Final = {path: tuple(field.name for field in msgspec.structs.fields(table)) for path, table in _TABLES.items()}


def read_classes(data: bytes, name: str = "") -> ReadResult:
    """Read the event classes of a TOML file's content; `name` is what problems call the file.

    TmcError when it is no TOML, has no list of classes, or is larger than toml_text.MAX_BYTES.
    """
    try:
        parsed, lines = toml_text.read(data, name, "a TOML file of event classes, larger ones belong in a .tmc file")
    except toml_text.TomlError as error:
        raise TmcError(error.file, error.line, error.message) from None
    raw = parsed.get("classes")
    for key in parsed:
        if key != "classes":
            raise TmcError(name, lines.of((key,)), f"unknown key {key!r}; expected [[classes]]")
    if not isinstance(raw, list) or not all(isinstance(each, dict) for each in raw):
        raise TmcError(name, 1, "no list of classes; expected [[classes]]")
    classes: list[EventClass] = []
    problems: list[Problem] = []
    class_lines: dict[str, int] = {}
    event_lines: dict[str, dict[int, int]] = {}
    for index, table in enumerate(raw):
        faults = list(_faults(table, ("classes", index)))
        if not faults:
            try:
                form = msgspec.convert(table, _Class)
                found = _event_class(form)
            except _Fault as fault:
                faults = [(("classes", index, *fault.path), fault.message)]
            except msgspec.ValidationError as error:
                faults = [toml_text.mistyped(error, ("classes", index))]
            except ValueError as error:
                faults = [(("classes", index), str(error))]
            else:
                classes.append(found)
                class_lines[found.guid] = lines.of(("classes", index))
                places = {event.id: lines.of(("classes", index, "events", number)) for number, event in enumerate(form.events)}
                event_lines[found.guid] = places
        problems += (Problem(name, lines.of(path), message) for path, message in faults)
    return ReadResult(tuple(classes), tuple(problems), lines=class_lines, event_lines=event_lines)


def write_classes(classes: Iterable[EventClass]) -> bytes:
    """The content of a TOML file with these classes. ValueError when a text is none (a lone surrogate)."""
    text = "\n".join("\n".join(_class_lines(found)) + "\n" for found in classes)
    return (text or "classes = []\n").encode("utf-8")


# READING ----------------------------------------------------------------------------------------------------------------------


class _Fault(Exception):
    """A fault that is found behind the types: where in the class, and what."""

    def __init__(self, path: toml_text.Path, message: str) -> None:
        self.path, self.message = path, message
        super().__init__(message)


def _faults(table: object, path: toml_text.Path) -> Iterator[tuple[toml_text.Path, str]]:
    """Unknown keys, everywhere below the class."""
    names = tuple(step for step in path[2:] if isinstance(step, str))
    keys = _KEYS.get(names)
    if keys is None or not isinstance(table, dict):
        return
    for key, value in table.items():
        if key not in keys:
            yield (*path, key), toml_text.unknown_key(key, keys)
        elif isinstance(value, list):
            for index, each in enumerate(value):
                yield from _faults(each, (*path, key, index))


def _event_class(form: _Class) -> EventClass:
    texts: dict[str, dict[int, str]] = {}
    _translate(texts, form.display_text, form.translations, ("translations",))
    for text, table in form.texts.items():
        _translate(texts, text, table, ("texts", text))
    entries: dict[int, EventEntry] = {}
    for index, event in enumerate(form.events):
        path: toml_text.Path = ("events", index)
        if event.id in entries:
            both = f"{entries[event.id].name} and {event.name}"
            raise _Fault(path, f"event class {form.name}: id {event.id} is used twice, by {both}; expected different ids")
        severity = _SEVERITIES.get(event.severity.lower())
        if severity is None:
            expected = ", ".join(_SEVERITIES)
            raise _Fault(
                (*path, "severity"), f"event {form.name}.{event.name}: severity {event.severity!r}; expected one of {expected}"
            )
        if event.translations:
            _translate(texts, event.display_text, event.translations, (*path, "translations"))
        entries[event.id] = EventEntry(
            event.id,
            event.name,
            severity,
            event.display_text,
            event.comment,
            tuple(CauseRemedy(each.id, each.cause, each.remedy) for each in event.causes),
            tuple(Detail(each.name, each.text, each.comment) for each in event.details),
            event.properties,
        )
    if form.guid is not None and form.published is not None:
        raise _Fault(("published",), f"event class {form.name}: both guid and published; expected one of them")
    found = define_class(
        form.name,
        form.display_text,
        entries.values(),
        namespace=form.namespace,
        hides=form.hides,
        hide_needless_arguments=form.hide_needless_arguments,
        comment=form.comment,
        properties=form.properties,
    )
    attributes = _PERSISTENT if form.attributes is None else form.attributes
    found = msgspec.structs.replace(found, translations=texts, attributes=attributes)
    if form.guid is not None:
        return msgspec.structs.replace(found, guid=form.guid)
    return found if form.published is None else published_as(form.published, found)


def _translate(texts: dict[str, dict[int, str]], text: str, table: Mapping[str, str], path: toml_text.Path) -> None:
    if not table and path == ("translations",):
        return
    known = texts.setdefault(text, {})
    for language, translated in table.items():
        try:
            lcid = exact_language(language)
        except ValueError as error:
            raise _Fault((*path, language), str(error)) from None
        if known.setdefault(lcid, translated) != translated:
            raise _Fault((*path, language), f"{text[:40]!r} has two translations into {language}; expected one")


# WRITING ----------------------------------------------------------------------------------------------------------------------

_ESCAPES: Final = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}


def _string(text: str) -> str:
    return '"' + "".join(_ESCAPES.get(c, c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}") for c in text) + '"'


def _key(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else _string(text)


def _inline(table: Mapping[str, str]) -> str:
    return "{ " + ", ".join(f"{_key(key)} = {_string(value)}" for key, value in table.items()) + " }" if table else "{}"


def _languages(table: Mapping[int, str]) -> str:
    return _inline({exact_tag(lcid): text for lcid, text in table.items()})


def _optional(**texts: str) -> Iterator[str]:
    return (f"{key} = {_string(text)}" for key, text in texts.items() if text)


def _class_lines(found: EventClass) -> Iterator[str]:
    left = dict(found.translations)
    yield "[[classes]]"
    yield f"name = {_string(found.name)}"
    yield from _optional(namespace=found.namespace)
    yield f"{'published' if content_guid(found) == found.guid else 'guid'} = {_string(found.guid)}"
    yield from _optional(display_text=found.display_text)
    if left.get(found.display_text):
        yield f"translations = {_languages(left.pop(found.display_text))}"
    yield from _optional(comment=found.comment)
    if found.hides:
        yield f"hides = [{', '.join(map(_string, found.hides))}]"
    if found.hide_needless_arguments:
        yield "hide_needless_arguments = true"
    if found.properties:
        yield f"properties = {_inline(found.properties)}"
    if found.attributes != _PERSISTENT:
        yield f"attributes = {_inline(found.attributes)}"
    events = [line for entry in found.events.values() for line in _event_lines(entry, left)]
    if left:
        yield "\n[classes.texts]"
        yield from (f"{_key(text)} = {_languages(table)}" for text, table in left.items())
    yield from events


def _event_lines(entry: EventEntry, left: dict[str, Mapping[int, str]]) -> Iterator[str]:
    yield "\n[[classes.events]]"
    yield f"id = {entry.id}"
    yield f"name = {_string(entry.name)}"
    yield f"severity = {_string(entry.severity.name.lower())}"
    yield from _optional(display_text=entry.display_text)
    if left.get(entry.display_text):
        yield f"translations = {_languages(left.pop(entry.display_text))}"
    yield from _optional(comment=entry.comment)
    causes = [f"id = {each.id}, cause = {_string(each.cause)}, remedy = {_string(each.remedy)}" for each in entry.causes]
    details = [
        f"name = {_string(each.name)}, text = {_string(each.text)}, comment = {_string(each.comment)}" for each in entry.details
    ]
    for key, tables in (("causes", causes), ("details", details)):
        if tables:
            yield f"{key} = [\n" + "".join(f"  {{ {table} }},\n" for table in tables) + "]"
    if entry.properties:
        yield f"properties = {_inline(entry.properties)}"
