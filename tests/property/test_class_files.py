"""Laws of class files: whatever a class says, writing and reading changes nothing."""

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from bridge.core import class_toml, tmc
from bridge.core.catalog import CauseRemedy, Detail, EventClass, EventEntry
from bridge.core.definitions import content_guid, define_class, edited, published_as
from bridge.core.events import Severity
from bridge.core.tmc_writer import write_classes
from bridge.core.translations import every_text, imported, read_csv, read_xml, without_unused, write_csv, write_xml

# What XML can hold (lone surrogates are no text in any file).
TEXTS = st.text(
    st.one_of(
        st.sampled_from(list("{}0,x<>&\"'[]\\\n\r\t ;=.#")),
        st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff"),
    ),
    max_size=12,
)
NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
GUIDS = st.uuids().map(str)
LCIDS = st.one_of(st.sampled_from([0, 7, 1031, 1033, 1041, 2057]), st.integers(0, 2**32 - 1))
PROPERTIES = st.dictionaries(NAMES, TEXTS.map(str.strip), max_size=2)
CAUSES = st.lists(st.builds(CauseRemedy, st.integers(0, 2**32 - 1), TEXTS, TEXTS), max_size=3).map(tuple)
DETAILS = st.lists(st.builds(Detail, TEXTS.map(str.strip), TEXTS, TEXTS), max_size=3).map(tuple)
ENTRIES = st.builds(
    EventEntry, st.integers(0, 2**32 - 1), NAMES, st.sampled_from(Severity), TEXTS, TEXTS, CAUSES, DETAILS, PROPERTIES
)
EVENTS = st.lists(ENTRIES, min_size=1, max_size=4, unique_by=lambda entry: entry.id)


@st.composite
def classes(draw: st.DrawFn) -> EventClass:
    """A class, with translations of its own texts and of others, under the GUID of its content or another one."""
    found = define_class(
        draw(NAMES),
        draw(TEXTS),
        draw(EVENTS),
        namespace=draw(st.one_of(st.just(""), NAMES)),
        hides=draw(st.lists(GUIDS, max_size=3, unique=True)),
        hide_needless_arguments=draw(st.booleans()),
        comment=draw(TEXTS),
        properties=draw(PROPERTIES),
    )
    keys = st.one_of(st.sampled_from(found.texts() or ("none",)), TEXTS)
    translations = draw(st.dictionaries(keys, st.dictionaries(LCIDS, TEXTS, max_size=3), max_size=4))
    found = msgspec.structs.replace(found, translations=translations)
    return msgspec.structs.replace(found, guid=draw(GUIDS)) if draw(st.booleans()) else found


@given(st.lists(classes(), max_size=3))
def test_tmc_changes_nothing(found: list[EventClass]) -> None:
    """What is written reads back equal, in the same order."""
    result = tmc.read_classes(write_classes(found))
    assert result.problems == ()
    assert list(result.classes) == found


@given(st.lists(classes(), max_size=3))
def test_toml_changes_nothing(found: list[EventClass]) -> None:
    """What is written reads back equal, in the same order; so a class may go from TMC to TOML and back."""
    result = class_toml.read_classes(class_toml.write_classes(found))
    assert result.problems == ()
    assert list(result.classes) == found


@given(classes(), st.lists(LCIDS, max_size=3, unique=True).map(tuple))
def test_translations_that_come_back_change_nothing(found: EventClass, languages: tuple[int, ...]) -> None:
    """As CSV and as XML, in all languages or some."""
    table = every_text([found], languages)
    for back in (read_csv(write_csv(table, [found])), read_xml(write_xml(table))):
        result = imported([found], back)
        assert (result.classes, result.added, result.changed, result.unknown) == ((found,), 0, 0, ())


@given(classes())
def test_translations_rebuild_a_class_that_lost_them(found: EventClass) -> None:
    """All of its own texts' translations that say something come back; nothing else does."""
    bare = msgspec.structs.replace(found, translations={})
    (full,) = imported([bare], every_text([found])).classes
    (kept,) = without_unused([found])
    said = {text: {lcid: value for lcid, value in table.items() if value} for text, table in kept.translations.items()}
    assert full.translations == {text: table for text, table in said.items() if table}


@given(classes(), EVENTS, EVENTS)
def test_edits_make_a_chain(found: EventClass, second: list[EventEntry], third: list[EventEntry]) -> None:
    """Whatever is edited, a version hides all before it and never one after it or itself; an edit to the same is none."""
    versions = [found]
    for events in (second, third):
        old = versions[-1]
        new = edited(old, msgspec.structs.replace(old, events={entry.id: entry for entry in events}))
        assert edited(new, new) == new
        assert published_as(new.guid, new) == new or new.guid == old.guid
        if new.guid != old.guid:
            assert new.guid == content_guid(new)
            versions.append(new)
    for index, version in enumerate(versions):
        assert {each.guid for each in versions[:index]} <= set(version.hides)
        assert not {each.guid for each in versions[index:]} & set(version.hides)
