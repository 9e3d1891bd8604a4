"""Translations of event classes as files for translators: out of the classes, and back into them.

Rule 1: a text is translated once per class. In a table, the class "" stands for every class that has the text.
Rule 2: an empty translation is none: it is written, so that somebody can fill it in, and changes nothing when it comes back.
Rule 3: nothing is guessed. What a table has for texts or classes that do not exist is told and left out.

As XML a table is the Translations block of facts 2.3, which knows no classes. As CSV it is ours: UTF-8 with a mark (so that
spreadsheets know), a header "class,guid,text" followed by one column per language (a tag, or an LCID without one), a row per
class and text. `class` is for people. A row without GUID belongs to every class that has the text. Semicolons instead of
commas are read too, as spreadsheets of some countries write them.
"""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Final, TypeAlias

import msgspec

from bridge.core.arguments import guid
from bridge.core.catalog import EventClass, LanguageError, exact_language, exact_tag, language_tag
from bridge.core.tmc import TmcError, read_translations
from bridge.core.tmc_writer import document, translations_element

Table: TypeAlias = dict[str, dict[str, dict[int, str]]]
"""GUID of the class, or "" for all; text; LCID; translated text."""
EVERY: Final = ""
MAX_CELL: Final = 131_072
"""Characters of a field; the csv module's own limit is one for the whole process, and others raise it."""
_HEAD: Final = ("class", "guid", "text")


class Imported(msgspec.Struct, frozen=True):
    """The classes with the translations, how many are new or other than before, and what belongs to no class: (GUID, text)."""

    classes: tuple[EventClass, ...]
    added: int
    changed: int
    unknown: tuple[tuple[str, str], ...]


# OUT OF CLASSES AND BACK ------------------------------------------------------------------------------------------------------


def every_text(classes: Iterable[EventClass], languages: Iterable[int] = ()) -> Table:
    """Every text of the classes with its translations; with languages exactly these, "" where one is missing.

    Texts that no event uses any more come last (see unused()).
    """
    wanted = tuple(languages)
    table: Table = {}
    for found in classes:
        texts = table.setdefault(found.guid, {})
        for text in dict.fromkeys((*found.texts(), *found.translations)):
            known = found.translations.get(text, {})
            texts[text] = {lcid: known.get(lcid, "") for lcid in wanted} if wanted else dict(known)
    return table


def imported(classes: Iterable[EventClass], table: Table) -> Imported:
    """The classes with the table's translations; those that the table has not stay as they are."""
    result: list[EventClass] = []
    added = changed = 0
    used: set[tuple[str, str]] = set()
    for found in classes:
        translations = dict(found.translations)
        for text in dict.fromkeys((*found.texts(), *found.translations)):
            given: dict[int, str] = {}
            for event_class in (EVERY, found.guid):  # what is said of the class itself comes last and counts
                if text in table.get(event_class, {}):
                    used.add((event_class, text))
                    given.update((lcid, value) for lcid, value in table[event_class][text].items() if value)
            before = found.translations.get(text, {})
            news = {lcid: value for lcid, value in given.items() if value != before.get(lcid)}
            if news:
                translations[text] = {**before, **news}
                changed += sum(1 for lcid in news if before.get(lcid))
                added += sum(1 for lcid in news if not before.get(lcid))
        result.append(msgspec.structs.replace(found, translations=translations))
    unknown = ((event_class, text) for event_class, texts in table.items() for text in texts)
    return Imported(tuple(result), added, changed, tuple(each for each in unknown if each not in used))


def unused(classes: Iterable[EventClass]) -> dict[str, tuple[str, ...]]:
    """GUID to the texts that a class translates and no longer has; only classes with such texts."""
    left = {found.guid: tuple(text for text in found.translations if text not in set(found.texts())) for found in classes}
    return {event_class: texts for event_class, texts in left.items() if texts}


def without_unused(classes: Iterable[EventClass]) -> tuple[EventClass, ...]:
    """The classes without the translations of texts that they no longer have."""
    result: list[EventClass] = []
    for found in classes:
        texts = set(found.texts())
        kept = {text: known for text, known in found.translations.items() if text in texts}
        result.append(msgspec.structs.replace(found, translations=kept))
    return tuple(result)


# XML --------------------------------------------------------------------------------------------------------------------------


def write_xml(table: Table) -> bytes:
    """The table as a file that is one Translations block.

    ValueError when two classes translate a text differently, which the block cannot tell apart, or XML cannot hold a text.
    """
    joined: dict[str, dict[int, str]] = {}
    for texts in table.values():
        for text, given in texts.items():
            known = joined.setdefault(text, {})
            for lcid, value in given.items():
                if known.get(lcid) and value and known[lcid] != value:
                    both = f"two classes translate {text!r} into {language_tag(lcid)} differently"
                    raise ValueError(f"{both}; expected one translation, or each class in a file of its own, or CSV")
                known[lcid] = value or known.get(lcid, "")
    return document(translations_element(joined))


def read_xml(data: bytes, name: str = "") -> Table:
    """The translations of a Translations block, or on file level of a .tmc, .tsproj or .xti file.

    TmcError with file and line at the first fault: a table is imported whole or not at all.
    """
    result = read_translations(data, name)
    for problem in result.problems:
        raise TmcError(problem.file, problem.line, problem.message)
    return {EVERY: result.translations} if result.translations else {}


# CSV --------------------------------------------------------------------------------------------------------------------------


def write_csv(table: Table, classes: Iterable[EventClass] = ()) -> bytes:
    """The table as CSV; the classes give their names."""
    names = {found.guid: found.qualified_name for found in classes}
    lcids = sorted({lcid for texts in table.values() for given in texts.values() for lcid in given})
    stream = io.StringIO(newline="")
    writer = csv.writer(stream)
    writer.writerow((*_HEAD, *map(exact_tag, lcids)))
    for event_class, texts in table.items():
        for text, given in texts.items():
            writer.writerow((names.get(event_class, ""), event_class, text, *(given.get(lcid, "") for lcid in lcids)))
    return stream.getvalue().encode("utf-8-sig")


def read_csv(data: bytes, name: str = "") -> Table:
    """The table of a CSV file. TmcError with file and line at the first fault: a table is imported whole or not at all."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TmcError(name, line, "bytes that are no UTF-8; expected CSV in UTF-8") from None
    head = text.partition("\n")[0]
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=";" if head.count(";") > head.count(",") else ",", strict=True)
    table: Table = {}
    lcids: tuple[int, ...] | None = None
    try:
        for row in reader:
            if any(len(cell) > MAX_CELL for cell in row):
                raise ValueError(f"a field of more than {MAX_CELL:,} characters")
            if lcids is None:
                lcids = _languages(row)
            elif any(row):
                _read_row(row, lcids, table)
    except (csv.Error, ValueError) as error:
        raise TmcError(name, max(reader.line_num, 1), f"{error}") from None
    if lcids is None:
        raise TmcError(name, 1, f"no header; expected {','.join(_HEAD)} and languages")
    return table


def _languages(header: Sequence[str]) -> tuple[int, ...]:
    if tuple(each.strip().lower() for each in header[: len(_HEAD)]) != _HEAD:
        raise ValueError(f"the header begins with {','.join(header[:3])[:80]!r}; expected {','.join(_HEAD)} and languages")
    lcids: list[int] = []
    for tag in header[len(_HEAD) :]:
        try:
            lcid = exact_language(tag)
        except LanguageError as error:
            raise ValueError(f"column {len(lcids) + len(_HEAD) + 1}: {error}") from None
        if lcid in lcids:
            raise ValueError(f"language {tag} has two columns; expected one")
        lcids.append(lcid)
    return tuple(lcids)


def _read_row(row: Sequence[str], lcids: Sequence[int], table: Table) -> None:
    if not len(_HEAD) <= len(row) <= len(_HEAD) + len(lcids):
        raise ValueError(f"{len(row)} columns; expected {len(_HEAD) + len(lcids)} as in the header")
    event_class = guid(row[1].strip()) if row[1].strip() else EVERY
    known = table.setdefault(event_class, {}).setdefault(row[2], {})
    for lcid, value in zip(lcids, row[len(_HEAD) :], strict=False):
        if known.get(lcid) and value and known[lcid] != value:
            raise ValueError(f"{row[2][:40]!r} has two translations into {language_tag(lcid)}; expected one")
        known[lcid] = value or known.get(lcid, "")
