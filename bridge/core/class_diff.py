"""What changed between two versions of an event class, and whether listeners will notice.

Rule 1: a change says what it means for listeners; "" means that they will not notice.
Rule 2: a listener knows a class by its GUID. Content that changed under the same GUID is the worst case: whoever has the old
version goes on showing it, and nothing tells them.
Rule 3: Names are for code. They matter to listeners only where a Name is shown for want of a display text, and in filters by
class name.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

import msgspec

from bridge.core.catalog import EventClass, EventEntry, language_tag
from bridge.core.placeholders import Slot, template

STALE: Final = "the GUID is the same: who has the old version goes on showing it"


class Change(msgspec.Struct, frozen=True):
    """One change: of what, before, after, and what listeners notice ("" for nothing)."""

    what: str
    before: str
    after: str
    notice: str = ""


class ClassDiff(msgspec.Struct, frozen=True):
    """Two versions of a class, None where there is none, and what changed."""

    old: EventClass | None
    new: EventClass | None
    changes: tuple[Change, ...]

    @property
    def name(self) -> str:
        """The newest name of the class."""
        found = self.new or self.old
        return found.qualified_name if found is not None else ""

    @property
    def noticed(self) -> bool:
        """Whether listeners notice any of it."""
        return any(change.notice for change in self.changes)


def diff(old: Iterable[EventClass], new: Iterable[EventClass]) -> list[ClassDiff]:
    """Classes of two files, paired; those without a change are left out.

    Pairs have the same GUID; else the new one hides the old one; else they are the only ones left of that name.
    """
    before = {each.guid: each for each in old}
    after = {each.guid: each for each in new}
    pairs: list[tuple[EventClass | None, EventClass | None]] = [
        (before.pop(guid), after.pop(guid)) for guid in list(after) if guid in before
    ]
    for guid, each in list(after.items()):
        hidden = [old_guid for old_guid in each.hides if old_guid in before]
        same = [old_guid for old_guid in hidden if before[old_guid].qualified_name == each.qualified_name]
        if hidden:
            pairs.append((before.pop((same or hidden)[0]), after.pop(guid)))
    for guid, each in list(after.items()):
        named = [old_guid for old_guid, found in before.items() if found.qualified_name == each.qualified_name]
        alike = [found for found in after.values() if found.qualified_name == each.qualified_name]
        if len(named) == len(alike) == 1:
            pairs.append((before.pop(named[0]), after.pop(guid)))
    pairs += [(each, None) for each in before.values()] + [(None, each) for each in after.values()]
    return [found for found in (ClassDiff(a, b, tuple(_changes(a, b))) for a, b in pairs) if found.changes]


def diff_classes(old: EventClass, new: EventClass) -> ClassDiff:
    """What changed between two versions."""
    return ClassDiff(old, new, tuple(_changes(old, new)))


def _changes(old: EventClass | None, new: EventClass | None) -> Iterator[Change]:
    if old is None and new is not None:
        notice = "who has no class of this GUID shows it by GUID and id, or asks for it"
        yield Change("class", "", f"{new.qualified_name} ({new.guid})", notice)
    elif old is not None and new is None:
        notice = "nothing is sent under it any more; who drops it shows stored events by GUID and id"
        yield Change("class", f"{old.qualified_name} ({old.guid})", "", notice)
    elif old is not None and new is not None:
        changes = list(_content(old, new))
        if old.guid != new.guid:
            yield Change("GUID", old.guid, new.guid, _new_guid(old, new))
            yield from changes
        else:
            for each in changes:
                yield msgspec.structs.replace(each, notice=f"{each.notice}; {STALE}") if each.notice else each


def _new_guid(old: EventClass, new: EventClass) -> str:
    if old.guid in new.hides:
        return "a filter by class name takes both versions, one by the old GUID takes no new event"
    if new.guid in old.hides:
        return "the old version hides the new one: the two seem to be swapped"
    return "no version hides the other: nothing says that they are the same class, and a send by name is refused"


def _content(old: EventClass, new: EventClass) -> Iterator[Change]:
    if old.qualified_name != new.qualified_name:
        yield Change("name", old.qualified_name, new.qualified_name, "filters by class name need the new name")
    if old.display_text != new.display_text:
        yield Change("display text", old.display_text, new.display_text, "the class is shown under another name")
    if old.hide_needless_arguments != new.hide_needless_arguments:
        words = {True: "hidden", False: "shown"}
        after = words[new.hide_needless_arguments]
        yield Change("surplus arguments", words[old.hide_needless_arguments], after, f"arguments without a place are {after}")
    for number in sorted({*old.events, *new.events}):
        yield from _event(old, new, number)
    yield from _translations(old, new)
    shown, hidden = set(old.hides) - {*new.hides, new.guid}, set(new.hides) - {*old.hides, old.guid}
    if shown or hidden:
        notice = "a filter by class name takes other old versions"
        yield Change("hides", ", ".join(sorted(shown)), ", ".join(sorted(hidden)), notice)
    if old.comment != new.comment:
        yield Change("comment", old.comment, new.comment)
    if old.properties != new.properties:
        yield Change("properties", _mapping(old.properties), _mapping(new.properties))


def _event(old: EventClass, new: EventClass, number: int) -> Iterator[Change]:
    before, after = old.events.get(number), new.events.get(number)
    if before is None and after is not None:
        notice = "who has the old version only shows the id instead of the text"
        yield Change(f"event {number}", "", f"{after.name}: {after.display_text}", notice)
    elif after is None and before is not None:
        notice = "no event of this id comes any more; the new version has no text for stored ones"
        yield Change(f"event {number}", f"{before.name}: {before.display_text}", "", notice)
    elif before is not None and after is not None:
        yield from _entry(before, after)


def _entry(old: EventEntry, new: EventEntry) -> Iterator[Change]:
    what = f"event {new.id} ({new.name})"
    if old.severity is not new.severity:
        words = old.severity.name.lower(), new.severity.name.lower()
        yield Change(f"{what} severity", *words, "filters on severity take it differently, and its key is another")
    if old.name != new.name:
        shown = not (old.display_text and new.display_text)
        yield Change(f"{what} name", old.name, new.name, "the name is shown, for there is no display text" if shown else "")
    if old.display_text != new.display_text:
        notice = "another text is shown"
        if _slots(old.display_text) != _slots(new.display_text):
            notice += ", and arguments stand in other places"
        yield Change(f"{what} text", old.display_text, new.display_text, notice)
    if old.comment != new.comment:
        yield Change(f"{what} comment", old.comment, new.comment)
    if old.causes != new.causes:
        before, after = ("; ".join(f"{each.cause}: {each.remedy}" for each in entry.causes) for entry in (old, new))
        yield Change(f"{what} causes", before, after, "other causes and remedies are shown")
    if old.details != new.details:
        before, after = ("; ".join(f"{each.name}: {each.text}" for each in entry.details) for entry in (old, new))
        yield Change(f"{what} details", before, after, "other details are shown")


def _translations(old: EventClass, new: EventClass) -> Iterator[Change]:
    """Translations of texts that the new version has; the others went with their texts."""
    known = set(old.texts())
    for text in new.texts():
        before, after = old.translations.get(text, {}), new.translations.get(text, {})
        for lcid in sorted({*before, *after}):
            if text in known and before.get(lcid, "") != after.get(lcid, ""):
                language = f"{language_tag(lcid)} ({lcid})"
                notice = f"another text is shown in {language_tag(lcid)}"
                yield Change(f"{text!r} in {language}", before.get(lcid, ""), after.get(lcid, ""), notice)


def _slots(text: str) -> list[str]:
    return [part.name for part in template(text) if isinstance(part, Slot)]


def _mapping(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name}={value}" for name, value in sorted(values.items()))
