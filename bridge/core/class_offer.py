"""How event classes travel: what is asked on @classes, and the answer in parts.

Rule 1: a question names GUIDs, names, or nothing, which means every class. A name means every version of it that is known.
Rule 2: what is asked for and not known is listed as unknown in the last part. That is an answer, not an error.
Rule 3: a part holds about PART_BYTES. A class that is larger travels in pieces; each has the class's head and some of its
events and translations, and join() puts them together again.
Rule 4: an answer counts when it is whole: parts 0, 1, ... of one session, the last one marked.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

import msgspec

from bridge.core.arguments import guid
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Count

PART_BYTES: Final = 200_000
MAX_ASKED: Final = 1000
"""So many GUIDs and names may stand in one question."""


class ClassesQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which event classes; without GUIDs and names every one."""

    guids: tuple[str, ...] = ()
    names: tuple[str, ...] = ()


class ClassesPart(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A part of the answer of one who offers classes: whole classes, or pieces of large ones."""

    session: str
    part: Count = 0
    last: bool = True
    classes: tuple[EventClass, ...] = ()
    unknown: tuple[str, ...] = ()


def answer(catalog: Catalog, question: ClassesQuestion, session: str) -> Iterator[ClassesPart]:
    """The parts of an answer; always at least one. ValueError for a question with too many names."""
    asked = len(question.guids) + len(question.names)
    if asked > MAX_ASKED:
        raise ValueError(f"{asked} classes asked for at once; expected at most {MAX_ASKED}")
    found, unknown = _chosen(catalog, question)
    part, size, pieces = 0, 0, list[EventClass]()
    for each in found.values():
        for piece in _pieces(each):
            cost = len(msgspec.json.encode(piece))
            if pieces and size + cost > PART_BYTES:
                yield ClassesPart(session=session, part=part, last=False, classes=tuple(pieces))
                part, size, pieces = part + 1, 0, []
            pieces.append(piece)
            size += cost
    yield ClassesPart(session=session, part=part, classes=tuple(pieces), unknown=tuple(unknown))


def _chosen(catalog: Catalog, question: ClassesQuestion) -> tuple[dict[str, EventClass], list[str]]:
    if not question.guids and not question.names:
        return {each.guid: each for each in catalog}, []
    found: dict[str, EventClass] = {}
    unknown: list[str] = []
    wanted = [(text, (text,)) for text in question.guids] + [(name, catalog.guids(name)) for name in question.names]
    for text, guids in wanted:
        classes = [each for each in map(catalog.lookup, guids) if each is not None]
        found.update((each.guid, each) for each in classes)
        if not classes:
            unknown.append(text)
    return found, unknown


def _pieces(found: EventClass) -> Iterator[EventClass]:
    """The class, or pieces of it: the head on each, events and translations divided."""
    events: dict[int, EventEntry] = {}
    texts: dict[str, Mapping[int, str]] = {}
    size = 0
    for entry in found.events.values():
        cost = len(msgspec.json.encode(entry))
        if size + cost > PART_BYTES and size:
            yield msgspec.structs.replace(found, events=events, translations={})
            events, size = {}, 0
        events[entry.id] = entry
        size += cost
    for key, table in found.translations.items():
        cost = len(msgspec.json.encode((key, table)))
        if size + cost > PART_BYTES and size:
            yield msgspec.structs.replace(found, events=events, translations=texts)
            events, texts, size = {}, {}, 0
        texts[key] = table
        size += cost
    yield msgspec.structs.replace(found, events=events, translations=texts)


class Joined(msgspec.Struct, frozen=True):
    """What a whole answer says: classes by GUID, and what is unknown there."""

    classes: dict[str, EventClass]
    unknown: frozenset[str]


def join(parts: Iterable[ClassesPart]) -> Joined | None:
    """The answer of one session, put together; None when it is not whole."""
    ordered = sorted(parts, key=lambda part: part.part)
    if [part.part for part in ordered] != list(range(len(ordered))) or not ordered or not ordered[-1].last:
        return None
    classes: dict[str, EventClass] = {}
    for part in ordered:
        for piece in part.classes:
            known = classes.get(piece.guid)
            if known is not None:
                piece = msgspec.structs.replace(
                    known,
                    events={**known.events, **piece.events},
                    translations={**known.translations, **piece.translations},
                )
            classes[piece.guid] = piece
    return Joined(classes, frozenset(name for part in ordered for name in part.unknown))


def asked_guid(text: str) -> str | None:
    """A class as it may be asked for; None for what is no GUID, so that nobody is asked for it."""
    try:
        return guid(text)
    except ValueError:
        return None
