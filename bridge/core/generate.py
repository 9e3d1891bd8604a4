"""Event classes as constants for code: a Python module, or JSON for other languages.

    logger.send_message(*TC_EVENTS.TutorialClass.TutorialEvent, arguments=[3])

Rule 1: the same classes give the same text, in whatever order they come: classes by name, events by id. No date, no path.
Rule 2: a constant stands for the newest version. Versions that another one hides are left out. Where none hides the others,
        each gets its name with the first eight digits of its GUID: Pump_7d760066.
Rule 3: a Name that is no identifier is made one: what does not fit becomes "_", a digit in front gets one too, "__" in front
        becomes "_", a keyword gets one behind. The namespace is part of a class's name: opt.Pump is opt_Pump. Where two names
        meet, both get a suffix: the GUID's first eight digits or all of it for classes, the id for events.

The module follows what TwinCAT generates: TC_EVENTS has a struct for each class with a TcEventEntry for each event,
TC_EVENT_CLASSES the GUIDs (facts 2.5). An editor completes both; a type checker refuses an event that does not exist.
"""

import keyword
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Final, TypeVar

import msgspec

from bridge.core.catalog import Catalog, EventClass, EventEntry

_T = TypeVar("_T")
JSON_FORMAT: Final = 1
"""The version of the JSON: fields may be added within one."""
_TAKEN: Final = frozenset({"_Definition", "_Final", "_Severity", "mro"})
"""What the module itself uses inside its classes, and what every class has without underscores."""
_TEXT_SIZE: Final = 100


class JsonEvent(msgspec.Struct, frozen=True):
    """One event. texts: LCID to display text with its placeholders; "0" is the one without a language."""

    identifier: str
    name: str
    id: int
    severity: int
    severity_name: str
    texts: dict[str, str]


class JsonClass(msgspec.Struct, frozen=True):
    """One class; hides are the GUIDs of its older versions."""

    identifier: str
    name: str
    guid: str
    hides: tuple[str, ...]
    texts: dict[str, str]
    events: list[JsonEvent]


class JsonModule(msgspec.Struct, frozen=True):
    """The whole JSON text."""

    made_by: str
    sources: tuple[str, ...]
    format: int
    classes: list[JsonClass]


def python_module(classes: Iterable[EventClass], *, made_by: str = "tcbridge", sources: Sequence[str] = ()) -> str:
    """A Python module with TC_EVENTS and TC_EVENT_CLASSES. made_by and sources (file names) stand in its header."""
    named = _classes(classes)
    origin = f" from {', '.join(sorted(sources))}" if sources else ""
    lines = [
        _literal(f"Event classes as constants. Made by {made_by}{origin}: do not edit, make it again."),
        "",
        "from typing import Final as _Final",
        "",
        "from bridge.core.events import EventDefinition as _Definition",
        "from bridge.core.events import Severity as _Severity",
        "",
        '__all__ = ["TC_EVENTS", "TC_EVENT_CLASSES"]',
        "",
        "",
        "class TC_EVENTS:",
        f"    {_literal('One class for each event class, one constant for each of its events.')}",
    ]
    for identifier, found in named:
        lines += ("", f"    class {identifier}:", f"        {_literal(_shown(found.display_text or found.name))}", "")
        for event, entry in _events(found):
            value = f'_Definition("{found.guid}", {entry.id}, _Severity.{entry.severity.name})'
            lines += (
                f"        {event}: _Final = {value}",
                f"        {_literal(_shown(entry.display_text or entry.name))}",
            )
    lines += ("", "", "class TC_EVENT_CLASSES:", f"    {_literal('The GUID of each event class.')}", "")
    lines += (f'    {identifier}: _Final = "{found.guid}"' for identifier, found in named)
    return "\n".join(lines).rstrip("\n") + "\n"


def json_text(classes: Iterable[EventClass], *, made_by: str = "tcbridge", sources: Sequence[str] = ()) -> str:
    """The same as JSON, with the texts in every language: the fields are those of JsonModule."""
    module = JsonModule(made_by, tuple(sorted(sources)), JSON_FORMAT, [_json_class(*each) for each in _classes(classes)])
    whole: str = msgspec.json.format(msgspec.json.encode(module), indent=2).decode()
    return f"{whole}\n"


def _json_class(identifier: str, found: EventClass) -> JsonClass:
    events = [
        JsonEvent(
            event, entry.name, entry.id, int(entry.severity), entry.severity.name.lower(), _texts(found, entry.display_text)
        )
        for event, entry in _events(found)
    ]
    name = found.qualified_name
    return JsonClass(identifier, name, found.guid, tuple(sorted(found.hides)), _texts(found, found.display_text), events)


def _texts(found: EventClass, text: str) -> dict[str, str]:
    return {"0": text} | {str(lcid): each for lcid, each in sorted(found.translations.get(text, {}).items())}


# NAMES ------------------------------------------------------------------------------------------------------------------------


def _classes(classes: Iterable[EventClass]) -> list[tuple[str, EventClass]]:
    versions: dict[str, list[EventClass]] = {}
    for each in sorted(Catalog(classes), key=lambda each: (each.qualified_name, each.guid)):
        versions.setdefault(each.qualified_name, []).append(each)
    current = [found for group in versions.values() for found in _not_hidden(group) or group]
    return _named(current, lambda each: each.qualified_name, lambda each: (each.guid[:8], each.guid.replace("-", "_")))


def _not_hidden(versions: list[EventClass]) -> list[EventClass]:
    return [each for each in versions if not any(each.guid in other.hides for other in versions if other is not each)]


def _events(found: EventClass) -> list[tuple[str, EventEntry]]:
    ordered = sorted(found.events.values(), key=lambda entry: entry.id)
    return _named(ordered, lambda entry: entry.name, lambda entry: (str(entry.id),))


def _named(items: Sequence[_T], name: Callable[[_T], str], endings: Callable[[_T], Sequence[str]]) -> list[tuple[str, _T]]:
    """Items with identifiers of their own: the plain one where it is nobody else's, else with the first ending that helps.

    The last ending is nobody else's, so this comes to an end.
    """
    plain = [identifier(name(item)) for item in items]
    chosen = list(plain)
    step = [0] * len(items)
    while again := _shared(chosen):
        for i in again:
            ending = endings(items[i])[step[i] :][:1] or endings(items[i])[-1:]
            chosen[i] = f"{plain[i]}_{ending[0]}"
            step[i] += 1
    return list(zip(chosen, items, strict=True))


def _shared(chosen: Sequence[str]) -> list[int]:
    count = Counter(chosen)
    return [i for i, each in enumerate(chosen) if count[each] > 1 or each in _TAKEN]


def identifier(name: str) -> str:
    """A Name as a Python identifier, by rule 3."""
    text = unicodedata.normalize("NFKC", name)  # as Python reads identifiers
    text = "".join(letter if f"_{letter}".isidentifier() else "_" for letter in text)
    if text.startswith("__"):
        text = f"_{text.lstrip('_')}"
    if not text.isidentifier():
        text = f"_{text}"
    return f"{text}_" if keyword.iskeyword(text) else text


def _shown(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _TEXT_SIZE else f"{line[: _TEXT_SIZE - 3]}..."


def _literal(text: str) -> str:
    return '"' + "".join(_letter(each) for each in text) + '"'


def _letter(letter: str) -> str:
    if letter in '"\\':
        return f"\\{letter}"
    return letter if letter.isprintable() else letter.encode("unicode_escape", "surrogatepass").decode()
