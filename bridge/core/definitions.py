"""Event classes without TwinCAT: defined in Python, with a GUID that follows from the content.

Rule 1: the same content has the same GUID everywhere, so that two programs with the same definition mean the same class.
Rule 2: content is what receivers tell versions apart by: namespace and name, display text, whether surplus arguments are
        hidden, the hidden GUIDs, and id, name, severity and display text of each event. Translations, comments, causes,
        remedies, details, properties and attributes are none: whoever translates a class makes no new version of it.
Rule 3: an edit is a new GUID that hides the old one and all that the old one hid. Hidden GUIDs are content, so that an edit
        which takes back an earlier one gets a GUID of its own too, and no two versions hide each other.

content_guid() is UUID version 5 in a namespace of ours over compact JSON: RULE, the qualified name, the display text, whether
surplus arguments are hidden (true or false), the hidden GUIDs sorted, and a list of [id, name, severity as 0..4, display text].
"""

import uuid
from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from bridge.core.arguments import guid
from bridge.core.catalog import EventClass, EventEntry, Language, language_id

RULE: Final = 1
"""The version of this page's rules: another one gives other GUIDs."""
NAMESPACE: Final = uuid.UUID("0e1f51c5-3c5b-5a0c-9c68-7d8a5d4b3c11")
_MAX_ID: Final = 2**32 - 1
_UNKNOWN: Final = "00000000-0000-0000-0000-000000000000"


def define_class(
    name: str,
    display_text: str = "",
    events: Iterable[EventEntry] = (),
    *,
    namespace: str = "",
    translations: Mapping[str, Mapping[Language, str]] | None = None,
    hides: Iterable[str] = (),
    hide_needless_arguments: bool = False,
    comment: str = "",
    properties: Mapping[str, str] | None = None,
) -> EventClass:
    """A class whose GUID follows from its content. Translations: text to language (1031, "de-DE") to translated text.

    ValueError when it has no event or an id twice, when a name is empty or has blanks around it, an id is out of range, or a
    hidden GUID is none; LanguageError (a ValueError) when a language is unknown.
    """
    entries = tuple(events)
    _check_name(name, "an event class")
    _check_events(name, entries)
    return with_content_guid(
        EventClass(
            _UNKNOWN,
            name,
            display_text,
            {entry.id: entry for entry in entries},
            {text: {language_id(key): value for key, value in each.items()} for text, each in (translations or {}).items()},
            tuple(hides),
            hide_needless_arguments,
            namespace,
            comment,
            dict(properties or {}),
            {"PersistentType": "true"},
        )
    )


def content_guid(found: EventClass) -> str:
    """The GUID that follows from the content, whatever GUID the class has."""
    events = [[each.id, each.name, int(each.severity), each.display_text] for _, each in sorted(found.events.items())]
    content = (
        RULE,
        found.qualified_name,
        found.display_text,
        found.hide_needless_arguments,
        sorted(found.hides),
        events,
    )
    return str(uuid.uuid5(NAMESPACE, msgspec.json.encode(content).decode("utf-8")))


def with_content_guid(found: EventClass) -> EventClass:
    """The class under the GUID of its content."""
    return msgspec.structs.replace(found, guid=content_guid(found))


def edited(old: EventClass, new: EventClass) -> EventClass:
    """What becomes of `old` when it is edited into `new`, whatever GUID `new` came with.

    Unchanged content keeps the old GUID, so a class of TwinCAT's keeps TwinCAT's GUID while only its translations are edited.
    """
    hides = tuple(dict.fromkeys((*old.hides, *(each for each in new.hides if each != old.guid))))
    same = msgspec.structs.replace(new, guid=old.guid, hides=hides)
    return same if content_guid(same) == content_guid(old) else _hiding(old.guid, same)


def published_as(published: str, found: EventClass) -> EventClass:
    """The class under that GUID if it is the GUID of its content, else what it became since: a class that hides that GUID."""
    published = guid(published)
    same = with_content_guid(found)
    return same if same.guid == published else _hiding(published, found)


def _hiding(old: str, found: EventClass) -> EventClass:
    hides = (old, *(each for each in found.hides if each != old))
    return with_content_guid(msgspec.structs.replace(found, hides=hides))


def _check_name(name: str, what: str) -> None:
    if not name or name != name.strip():
        raise ValueError(f"{what} is named {name!r}; expected a name without blanks around it")


def _check_events(name: str, entries: tuple[EventEntry, ...]) -> None:
    if not entries:
        raise ValueError(f"event class {name} has no event; expected at least one")
    names: dict[int, str] = {}
    for entry in entries:
        _check_name(entry.name, f"event {entry.id} of event class {name}")
        if not 0 <= entry.id <= _MAX_ID:
            raise ValueError(f"event {name}.{entry.name}: id {entry.id}; expected 0..{_MAX_ID}")
        if entry.id in names:
            raise ValueError(f"event class {name}: id {entry.id} is used twice, by {names[entry.id]} and {entry.name}")
        names[entry.id] = entry.name
