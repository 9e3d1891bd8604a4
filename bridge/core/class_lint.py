"""What is wrong with event classes, each finding with file and line.

Rule 1: every rule is a row of RULES; docs and tests read the same rows.
Rule 2: what the readers of files report is told under the rule it belongs to, so no fault is told twice.
Rule 3: a finding says what was found and what was expected.

Which languages a class should have: those that were asked for; else every language that one of its own texts has. English
(1033) is there when a text has it, or, unless some text of the class has 1033, as the display text itself.

Plausible arguments, for the length of a text: STRING(80) is TwinCAT's default string, so 80 characters for {0}; 20 for {0,d}
(a LINT), 16 for {0,x}, 24 for {0,e} and {0,f}; {eventID} 10, {eventclass} 36. The limit of a text is TEXT_BYTES of UTF-8,
what a text request can carry (facts 3.2); that of arguments the manual's 128 of 1,024 bytes (5.7).
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

import msgspec

from bridge.core.catalog import ENGLISH, language_tag
from bridge.core.class_draft import Draft, DraftClass, DraftEvent, classes_of
from bridge.core.events import DEFAULT_LIMITS
from bridge.core.placeholders import Slot, template
from bridge.core.tmc import Problem

RULES: Final = {
    "unreadable": "the file, a class or an event cannot be read",
    "severity-missing": "an event has no severity, or none that is one",
    "duplicate-id": "two events of a class have the same id",
    "duplicate-name": "two events of a class have the same name under different ids",
    "ambiguous-name": "several classes have the same name and none hides the others",
    "missing-language": "a text is not translated into a language that its class has; causes, remedies and details count too",
    "placeholders-differ": "the placeholders of a text differ between languages",
    "unknown-format": "a placeholder has a format that is none of d, e, x, f",
    "text-too-long": "a text with plausible arguments is over the limit",
    "arguments-too-long": "plausible arguments of a text are over the limits",
    "hidden-in-use": "a class that a newer one hides is still used",
}
"""Every rule and what it finds."""
TEXT_BYTES: Final = 2035
"""An answer to a text request: 2,064 bytes less head and NUL."""
_STRING_CHARS: Final = 80
_FORMAT_CHARS: Final = {"d": 20, "x": 16, "e": 24, "f": 24}
_NAMED_CHARS: Final = {"eventid": 10, "eventclass": 36}
_PATTERNS: Final = ((re.compile(r"is used twice"), "duplicate-id"), (re.compile(r"\bSeverity\b"), "severity-missing"))


class Finding(msgspec.Struct, frozen=True):
    """One fault: where (line 0: unknown), which rule, of which class (GUID and name), and what."""

    file: str
    line: int
    rule: str
    message: str
    event_class: str = ""
    name: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.rule}: {self.message}"


class Observed(msgspec.Struct, frozen=True):
    """Somewhere (a recording, a cache) this class occurs so often."""

    where: str
    event_class: str
    count: int


def lint(
    drafts: Sequence[Draft],
    problems: Iterable[Problem] = (),
    *,
    languages: Sequence[int] = (),
    observed: Iterable[Observed] = (),
    text_bytes: int = TEXT_BYTES,
) -> list[Finding]:
    """Every finding in these files, by file and line.

    languages are those that every text should have; observed says which classes occur in recordings and caches.
    """
    found = [Finding(each.file, each.line, _rule_of(each.message), each.message) for each in problems]
    for each in classes_of(drafts):
        rules = (
            _names(each),
            _languages(each, languages),
            _placeholders(each),
            _formats(each),
            _lengths(each, text_bytes),
        )
        for rule in rules:
            found += [msgspec.structs.replace(item, event_class=each.guid, name=each.name) for item in rule]
    found += _ambiguous(classes_of(drafts))
    found += _hidden(drafts, observed)
    order = {draft.file: number for number, draft in enumerate(drafts)}
    return sorted(dict.fromkeys(found), key=lambda each: (order.get(each.file, -1), each.file, each.line))


def _rule_of(message: str) -> str:
    return next((rule for pattern, rule in _PATTERNS if pattern.search(message)), "unreadable")


def _texts(found: DraftClass) -> Iterator[tuple[str, str, int]]:
    """Each text of the class once: what it belongs to, the text, its line."""
    if found.display_text:
        yield f"class {found.name}", found.display_text, found.line
    seen = {found.display_text}
    for event in found.events:
        if event.display_text and event.display_text not in seen:
            seen.add(event.display_text)
            yield f"event {found.name}.{event.name}", event.display_text, event.line


def _further(found: DraftClass) -> Iterator[tuple[str, str, int]]:
    """Causes, remedies and details, each text once. They take no arguments and are no answer to a text request."""
    seen = {text for _, text, _ in _texts(found)}
    for event in found.events:
        for each in event.further:
            if each.text and each.text not in seen:
                seen.add(each.text)
                yield f"{each.what} of event {found.name}.{event.name}", each.text, each.line


def _names(found: DraftClass) -> Iterator[Finding]:
    first: dict[str, DraftEvent] = {}
    for event in found.events:
        known = first.setdefault(event.name, event)
        if event.name and known is not event and known.id != event.id:
            message = f"event class {found.name}: name {event.name} is used by ids {known.id} and {event.id}"
            yield Finding(found.file, event.line, "duplicate-name", f"{message}; expected different names")


def _languages(found: DraftClass, asked: Sequence[int]) -> Iterator[Finding]:
    has = Counter(lcid for row in found.texts.values() for lcid, (text, _) in row.items() if text)
    expected = tuple(asked) or tuple(sorted(has))
    for what, text, line in (*_texts(found), *_further(found)):
        row = found.texts.get(text, {})
        for lcid in expected:
            if lcid == ENGLISH and not has[ENGLISH]:
                continue  # display texts that are English prose
            if not row.get(lcid, ("", 0))[0]:
                message = f"{what}: {_short(text)} has no text in {language_tag(lcid)} ({lcid})"
                yield Finding(found.file, line, "missing-language", message)


def _placeholders(found: DraftClass) -> Iterator[Finding]:
    """A display text that is a key for an English text is no text of its own."""
    for what, key, line in _texts(found):
        row = {lcid: (text, at) for lcid, (text, at) in found.texts.get(key, {}).items() if text}
        base = row.get(ENGLISH, (key, line))[0]
        expected = _slots(base)
        for lcid, (text, at) in sorted(row.items()):
            if (slots := _slots(text)) != expected:
                message = f"{what}: {_list(slots)} in {language_tag(lcid)} ({lcid}); expected {_list(expected)}"
                yield Finding(found.file, at, "placeholders-differ", f"{message} as in {_short(base)}")


def _formats(found: DraftClass) -> Iterator[Finding]:
    for what, text, at in _all(found):
        for slot in _parts(text):
            if slot.format and slot.format.lower() not in _FORMAT_CHARS:
                yield Finding(found.file, at, "unknown-format", f"{what}: {slot.written}; expected the format d, e, x or f")


def _lengths(found: DraftClass, text_bytes: int) -> Iterator[Finding]:
    for what, text, at in _all(found):
        slots = _parts(text)
        size = len(text.encode("utf-8", "replace")) + sum(_chars(slot) - len(slot.written) for slot in slots)
        if size > text_bytes:
            message = f"{what}: {size} bytes with plausible arguments; expected at most {text_bytes}"
            yield Finding(found.file, at, "text-too-long", message)
        arguments = {int(slot.name): _chars(slot) for slot in slots if slot.name.isdecimal()}
        count = max(arguments, default=-1) + 1
        packed = sum(arguments.values()) + (count - len(arguments)) * _STRING_CHARS
        limits = DEFAULT_LIMITS
        if count > limits.arguments or packed > limits.argument_bytes:
            message = f"{what}: {count} arguments of {packed} bytes; expected at most {limits.arguments} of"
            yield Finding(found.file, at, "arguments-too-long", f"{message} {limits.argument_bytes} bytes")


def _all(found: DraftClass) -> Iterator[tuple[str, str, int]]:
    """Each text in each language."""
    for what, key, line in _texts(found):
        yield what, key, line
        for lcid, (text, at) in sorted(found.texts.get(key, {}).items()):
            yield f"{what} in {language_tag(lcid)} ({lcid})", text, at


def _parts(text: str) -> list[Slot]:
    return [part for part in template(text) if isinstance(part, Slot)]


def _slots(text: str) -> tuple[str, ...]:
    """The placeholders of a text, each once: in which order and how often a language names them is its own affair."""
    return tuple(sorted({slot.name for slot in _parts(text)}, key=lambda name: (len(name), name)))


def _list(slots: tuple[str, ...]) -> str:
    names = ", ".join(f"{{{slot}}}" for slot in slots)
    return f"{len(slots)} placeholder{'s' * (len(slots) > 1)} ({names})" if slots else "no placeholder"


def _chars(slot: Slot) -> int:
    return _NAMED_CHARS.get(slot.name) or _FORMAT_CHARS.get(slot.format.lower(), _STRING_CHARS)


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else f"{text[:37]}...")


def _ambiguous(classes: Sequence[DraftClass]) -> Iterator[Finding]:
    by_name: dict[str, dict[str, DraftClass]] = {}
    for each in classes:
        if each.guid:
            by_name.setdefault(each.name, {}).setdefault(each.guid, each)
    for name, versions in by_name.items():
        left = [
            each
            for each in versions.values()
            if not any(each.guid in other.hides for other in versions.values() if other is not each)
        ]
        for each in left if len(left) > 1 else ():
            others = ", ".join(other.guid for other in left if other is not each)
            message = f"event class {name} ({each.guid}) has other versions and none hides the others: {others}"
            yield Finding(each.file, each.line, "ambiguous-name", message, each.guid, name)


def _hidden(drafts: Sequence[Draft], observed: Iterable[Observed]) -> Iterator[Finding]:
    classes = classes_of(drafts)
    hiders: dict[str, list[DraftClass]] = {}
    for each in classes:
        for old in each.hides:
            hiders.setdefault(old, []).append(each)
    known: Mapping[str, DraftClass] = {each.guid: each for each in classes if each.guid}
    for draft in drafts:
        for use in draft.uses:
            if (newer := _newer(use.guid, hiders, known)) is not None:
                message = f"a module uses {_version(use.guid, known)}; {_instead(newer)}"
                yield Finding(use.file, use.line, "hidden-in-use", message, use.guid, newer.name)
    for seen in observed:
        if (newer := _newer(seen.event_class, hiders, known)) is not None:
            place = known.get(seen.event_class, newer)
            message = f"{_version(seen.event_class, known)} occurs {seen.count:,} times in {seen.where}; {_instead(newer)}"
            yield Finding(place.file, place.line, "hidden-in-use", message, seen.event_class, place.name)


def _newer(old: str, hiders: Mapping[str, list[DraftClass]], known: Mapping[str, DraftClass]) -> DraftClass | None:
    """The class that hides it: of the same name if it is known, else the first."""
    found = hiders.get(old, [])
    same = [each for each in found if old in known and each.name == known[old].name]
    return next(iter(same or found), None)


def _version(event_class: str, known: Mapping[str, DraftClass]) -> str:
    return f"{known[event_class].name} ({event_class})" if event_class in known else f"class {event_class}"


def _instead(newer: DraftClass) -> str:
    return f"{newer.name} ({newer.guid}) hides it"
