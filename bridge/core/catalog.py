"""What an event says: event classes, found by GUID or name, and their texts in the asked language.

Rule 1: a class is its GUID. One name may stand for several versions; each version keeps its own texts, also when it is hidden.
Rule 2: rendering never raises. What cannot be shown as asked is shown in a way this page defines.
Rule 3: a namespace is part of the name: class X in namespace opt is "opt.X".

Which text: asked language, else 1033 (English), else the display text itself, which is also the key of its translations
(facts 2.3); a class or event without a display text shows its Name.

What stands for what: the placeholders of a text, their formats and bare arguments as in bridge/core/placeholders.py, and
  surplus arguments  those that no placeholder names follow in parentheses, separated by ", ", unless the class hides them
  event reference    the text of that event, whose own placeholders get no arguments
  unknown event      "TestFilterClass#7 (a, b)", of an unknown class "54cc5482-ad79-4cdc-8c3e-b3983b36ed66#7 (a, b)"
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from locale import windows_locale
from typing import Final, Protocol, TypeAlias

import msgspec

from bridge.core.arguments import Argument, ArgumentType, EventReference, guid
from bridge.core.events import Severity
from bridge.core.placeholders import argument_text, template

ENGLISH: Final = 1033
Language: TypeAlias = int | str
"""A Windows LCID (1031) or a language tag ("de-DE", "de")."""
Translations: TypeAlias = Mapping[str, Mapping[int, str]]
"""Display text to LCID to translated text."""


class CauseRemedy(msgspec.Struct, frozen=True):
    """Why an event may have happened and what helps (manual 8.2.4)."""

    id: int
    cause: str
    remedy: str = ""


class Detail(msgspec.Struct, frozen=True):
    """A further text of an event (manual 8.2.5)."""

    name: str
    text: str
    comment: str = ""


class EventEntry(msgspec.Struct, frozen=True):
    """One event of a class: its Name for code, its display text (also the key of its translations), its usual severity.

    Causes, remedies and details are translated like display texts: by the class's translations of the text itself.
    """

    id: int
    name: str
    severity: Severity
    display_text: str = ""
    comment: str = ""
    causes: tuple[CauseRemedy, ...] = ()
    details: tuple[Detail, ...] = ()
    properties: Mapping[str, str] = {}


class EventClass(msgspec.Struct, frozen=True):
    """One version of an event class; ValueError when a GUID is none.

    `hides` are the GUIDs of older versions, `translations` those of its texts, wherever the file kept them, `properties`
    the properties other than HideNeedlessArguments, and `attributes` what TwinCAT notes beside the GUID (PersistentType,
    TcBaseType, CName).
    """

    guid: str
    name: str
    display_text: str = ""
    events: Mapping[int, EventEntry] = {}
    translations: Translations = {}
    hides: tuple[str, ...] = ()
    hide_needless_arguments: bool = False
    namespace: str = ""
    comment: str = ""
    properties: Mapping[str, str] = {}
    attributes: Mapping[str, str] = {}

    def __post_init__(self) -> None:
        msgspec.structs.force_setattr(self, "guid", guid(self.guid))
        msgspec.structs.force_setattr(self, "hides", tuple(map(guid, self.hides)))

    @property
    def qualified_name(self) -> str:
        """The name with its namespace: "opt.TestFilterClass", or just "TestFilterClass"."""
        return f"{self.namespace}.{self.name}" if self.namespace else self.name

    def named(self, name: str) -> EventEntry | None:
        """The event of that Name, or None."""
        return next((entry for entry in self.events.values() if entry.name == name), None)

    def texts(self) -> tuple[str, ...]:
        """Every text that can be translated, each once: display texts, comments, causes, remedies and details."""
        found = [self.display_text, self.comment]
        for entry in self.events.values():
            found += (entry.display_text, entry.comment)
            for cause in entry.causes:
                found += (cause.cause, cause.remedy)
            for detail in entry.details:
                found += (detail.name, detail.text, detail.comment)
        return tuple(text for text in dict.fromkeys(found) if text)

    def translated(self, text: str, lcid: int) -> str:
        """A text of the class in the language, else in English, else itself. An empty translation counts as none."""
        table = self.translations.get(text)
        return (table.get(lcid) or table.get(ENGLISH) or text) if table else text


class Occurrence(Protocol):
    """What event_text() needs: every event and every alarm has it."""

    @property
    def event_class(self) -> str: ...
    @property
    def event_id(self) -> int: ...
    @property
    def arguments(self) -> tuple[Argument, ...]: ...


class ClassNameError(LookupError):
    """A name that stands for no class, or for several of which none hides the others; lists them, or names like it."""

    def __init__(self, name: str, guids: tuple[str, ...], similar: tuple[str, ...] = ()) -> None:
        self.name, self.guids, self.similar = name, guids, similar
        hint = f", did you mean {' or '.join(map(repr, similar))}?" if similar else ""
        several = f"event class {name!r} has several versions and none hides the others: {', '.join(guids)}"
        super().__init__(several if guids else f"unknown event class {name!r}{hint}")


class LanguageError(ValueError):
    """A language that is neither an LCID nor a known tag."""


# LANGUAGES --------------------------------------------------------------------------------------------------------------------

_TAGS: Final = {lcid: name.replace("_", "-") for lcid, name in windows_locale.items()}
_LCIDS: Final[dict[str, int]] = {"zh": 2052}
"""Tags in lower case, with and without region; a language alone means the region with the smallest LCID, but for Chinese."""
for _lcid in sorted(_TAGS):
    _LCIDS.setdefault(_TAGS[_lcid].lower(), _lcid)
for _lcid in sorted(_TAGS):
    _LCIDS.setdefault(_TAGS[_lcid].lower().partition("-")[0], _lcid)


def language_id(language: Language) -> int:
    """The LCID of 1031, "1031", "de-DE", "de_de" or "de"; a neutral LCID (7) becomes its default region. LanguageError else."""
    if isinstance(language, str):
        tag = language.strip().replace("_", "-").lower()
        if tag.isdecimal() and len(tag) <= 10:
            return language_id(int(tag))
        if tag not in _LCIDS:
            raise LanguageError(f"unknown language {language!r}; expected an LCID or a tag, e.g. 1031, de-DE or de")
        return _LCIDS[tag]
    if not 0 < language < 2**32:
        raise LanguageError(f"unknown language {language}; expected an LCID or a tag, e.g. 1031, de-DE or de")
    return language + 0x400 if language < 0x400 else language


def language_tag(lcid: int) -> str:
    """The tag of an LCID ("de-DE"), or its number as text when it has none."""
    return _TAGS.get(lcid, str(lcid))


def exact_tag(lcid: int) -> str:
    """The tag that exact_language() reads back as this LCID, or its number as text: for files."""
    tag = language_tag(lcid)
    return tag if _LCIDS.get(tag.lower()) == lcid else str(lcid)


def exact_language(text: str) -> int:
    """As language_id(), but a number is any LCID from 0, and itself. LanguageError."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 10 and int(text) < 2**32 else language_id(text)


def _known_language(language: Language) -> int:
    try:
        return language_id(language)
    except LanguageError:
        return ENGLISH


# THE CATALOG ------------------------------------------------------------------------------------------------------------------


class Catalog:
    """Event classes by GUID. It does not change: merged() makes a new one.

    The same GUID twice is one class: the later one counts, and keeps translations that only the earlier one had.
    """

    def __init__(self, classes: Iterable[EventClass] = ()) -> None:
        self._classes: dict[str, EventClass] = {}
        for found in classes:
            known = self._classes.get(found.guid)
            self._classes[found.guid] = _with_translations(found, known.translations) if known is not None else found
        self._names: dict[str, list[EventClass]] = {}
        self._hiders: dict[str, list[EventClass]] = {}
        for found in self._classes.values():
            self._names.setdefault(found.qualified_name, []).append(found)
            for hidden in found.hides:
                self._hiders.setdefault(hidden, []).append(found)

    def merged(self, other: "Catalog | Iterable[EventClass]") -> "Catalog":
        """A catalog of both; where both know a GUID, `other` is the later one."""
        return Catalog((*self, *other))

    def __iter__(self) -> Iterator[EventClass]:
        return iter(self._classes.values())

    def __len__(self) -> int:
        return len(self._classes)

    def __contains__(self, event_class: str) -> bool:
        return self.lookup(event_class) is not None

    def lookup(self, event_class: str) -> EventClass | None:
        """The class of a GUID in any spelling; None when it is unknown or no GUID."""
        found = self._classes.get(event_class)
        if found is None:
            try:
                found = self._classes.get(guid(event_class))
            except ValueError:
                return None
        return found

    def entry(self, event_class: str, event_id: int) -> EventEntry | None:
        """The event of a class GUID and an id, or None."""
        found = self.lookup(event_class)
        return found.events.get(event_id) if found is not None else None

    def names(self) -> tuple[str, ...]:
        """Every class name, sorted."""
        return tuple(sorted(self._names))

    def guids(self, name: str) -> tuple[str, ...]:
        """Every known GUID of that name: the classes, then the older versions they hide. () when the name is unknown.

        A hidden GUID without a class counts as this name, for Hides lists older versions of the same type; one that is
        known under another name does not (real files hide versions from before a class was copied).
        """
        classes = self._names.get(name, [])
        hidden = (old for found in classes for old in found.hides if old not in self._classes)
        return tuple(dict.fromkeys((*(found.guid for found in classes), *hidden)))

    def newest(self, name: str) -> EventClass:
        """The version of that name that no other version of it hides; ClassNameError when there is none or several."""
        classes = self._names.get(name, [])
        left = [found for found in classes if not any(found.guid in other.hides for other in classes if other is not found)]
        if len(left) == 1:
            return left[0]
        similar = () if classes else tuple(difflib.get_close_matches(name, self._names, n=3))
        raise ClassNameError(name, tuple(found.guid for found in left or classes), similar)

    def hidden_by(self, event_class: str) -> tuple[EventClass, ...]:
        """The classes that hide this GUID, known or not; () when it is current or no GUID."""
        try:
            return tuple(self._hiders.get(guid(event_class), ()))
        except ValueError:
            return ()

    def class_name(self, event_class: str, language: Language = ENGLISH) -> str:
        """What people call the class: its display text in the language, else its Name, else the GUID as given.

        The Name itself is for code. An unknown language counts as English, as in event_text().
        """
        found = self.lookup(event_class)
        return event_class if found is None else found.translated(found.display_text, _known_language(language)) or found.name

    def causes(self, event_class: str, event_id: int, language: Language = ENGLISH) -> tuple[CauseRemedy, ...]:
        """Causes and remedies of an event in the language; () when it has none or is unknown."""
        found, entry, lcid = self.lookup(event_class), self.entry(event_class, event_id), _known_language(language)
        if found is None or entry is None:
            return ()
        return tuple(
            CauseRemedy(each.id, found.translated(each.cause, lcid), found.translated(each.remedy, lcid))
            for each in entry.causes
        )

    def details(self, event_class: str, event_id: int, language: Language = ENGLISH) -> tuple[Detail, ...]:
        """Details of an event in the language; () when it has none or is unknown."""
        found, entry, lcid = self.lookup(event_class), self.entry(event_class, event_id), _known_language(language)
        if found is None or entry is None:
            return ()
        return tuple(
            Detail(*(found.translated(text, lcid) for text in (each.name, each.text, each.comment))) for each in entry.details
        )

    def source_name(self, name: str | None, source_guid: str | None, language: Language = ENGLISH) -> str:
        """What people call a source: its name, translated when the source GUID is that of a class that has it as a text.

        So localised source names are event classes whose display texts equal the names (4026; facts 5.4). A missing name is "".
        """
        found = self.lookup(source_guid) if name and source_guid else None
        return found.translated(name, _known_language(language)) if name and found is not None else name or ""

    def event_text(self, event: Occurrence, language: Language = ENGLISH) -> str:
        """The text of an event or alarm with its arguments, by the rules on top of this page; never an exception.

        An unknown language counts as English: check what a user typed with language_id() first.
        """
        return self.text(event.event_class, event.event_id, event.arguments, language)

    def text(self, event_class: str, event_id: int, arguments: Sequence[Argument] = (), language: Language = ENGLISH) -> str:
        """As event_text(), from its parts."""
        lcid = _known_language(language)
        found = self.lookup(event_class)
        entry = found.events.get(event_id) if found is not None else None
        if found is None or entry is None:
            shown = [self._argument_text(argument, event_class, lcid) for argument in arguments]
            name = event_class if found is None else found.qualified_name
            return f"{name}#{event_id} ({', '.join(shown)})" if shown else f"{name}#{event_id}"
        used: set[int] = set()
        parts: list[str] = []
        for part in template(found.translated(entry.display_text, lcid) or entry.name):
            if isinstance(part, str):
                parts.append(part)
            elif part.name == "eventclass":
                parts.append(found.guid)
            elif part.name == "eventid":
                parts.append(argument_text(Argument(ArgumentType.UINT32, str(event_id)), part.format))
            elif (index := int(part.name)) < len(arguments):
                used.add(index)
                parts.append(self._argument_text(arguments[index], found.guid, lcid, part.format))
            else:
                parts.append(part.written)
        if len(used) < len(arguments) and not found.hide_needless_arguments:
            surplus = (self._argument_text(each, found.guid, lcid) for i, each in enumerate(arguments) if i not in used)
            parts.append(f" ({', '.join(surplus)})")
        return "".join(parts)

    def _argument_text(self, argument: Argument, event_class: str, lcid: int, code: str = "") -> str:
        if argument.type == ArgumentType.EVENT_REFERENCE:
            value = argument.python()
            # No arguments are handed on, so a chain of references ends here.
            return (
                self.text(value.event_class or event_class, value.event_id, (), lcid)
                if isinstance(value, EventReference)
                else argument.value
            )
        return argument_text(argument, code)


def _with_translations(found: EventClass, earlier: Translations) -> EventClass:
    both = {key: {**earlier.get(key, {}), **found.translations.get(key, {})} for key in (*earlier, *found.translations)}
    return msgspec.structs.replace(found, translations=both)
