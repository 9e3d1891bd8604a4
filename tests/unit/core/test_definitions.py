"""Classes defined in Python, their GUIDs, and what an edit does to them."""

import msgspec
import pytest

from bridge.core.catalog import Catalog, CauseRemedy, Detail, EventClass, EventEntry, LanguageError
from bridge.core.definitions import content_guid, define_class, edited, published_as
from bridge.core.events import Severity

EVENTS = (
    EventEntry(1, "Started", Severity.INFO, "Pump {0} started"),
    EventEntry(2, "Stuck", Severity.ERROR, "Pump {0} is stuck"),
)
TWINCAT = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


def pump(text: str = "Pump {0} started", **more: object) -> EventClass:
    events = (EventEntry(1, "Started", Severity.INFO, text), EVENTS[1])
    return msgspec.structs.replace(define_class("Pump", "Pumps", events), **more)


def test_a_class_of_three_lines_says_its_texts() -> None:
    """Names, texts, severities and translations by tag or LCID; the GUID comes by itself."""
    found = define_class(
        "Pump", "Pumps", EVENTS, translations={"Pump {0} started": {"de-DE": "Pumpe {0} läuft", 1036: "Pompe {0} démarrée"}}
    )
    catalog = Catalog([found])
    assert catalog.newest("Pump") is found
    assert found.events == {1: EVENTS[0], 2: EVENTS[1]}
    assert [catalog.text(found.guid, 1, (), lcid) for lcid in (1033, 1031, 1036)] == [
        "Pump {0} started",
        "Pumpe {0} läuft",
        "Pompe {0} démarrée",
    ]
    entry = found.named("Stuck")
    assert entry is not None
    assert entry.severity is Severity.ERROR


def test_the_guid_is_that_of_the_content_everywhere() -> None:
    """Two programs with the same definition mean the same class; these GUIDs must not change with a version of ours."""
    assert define_class("Pump", "Pumps", EVENTS).guid == define_class("Pump", "Pumps", reversed(EVENTS)).guid
    assert define_class("Pump", "Pumps", EVENTS).guid == "6674245f-668d-55e3-b8d9-48220688139d"
    odd = (EventEntry(0, "Ö", Severity.CRITICAL, 'a "quoted"\\ text\n\x00/ €𝄞'),)
    assert (
        define_class("Ö", "", odd, namespace="opt", hides=[TWINCAT], hide_needless_arguments=True).guid
        == "e3805321-48fa-51dc-a341-cd14cd2bcdf4"
    )


@pytest.mark.parametrize(
    "other",
    [
        define_class("Pumps", "Pumps", EVENTS),
        define_class("Pump", "Pump", EVENTS),
        define_class("Pump", "Pumps", EVENTS, namespace="opt"),
        define_class("Pump", "Pumps", EVENTS, hide_needless_arguments=True),
        define_class("Pump", "Pumps", EVENTS, hides=[TWINCAT]),
        define_class("Pump", "Pumps", EVENTS[:1]),
        *(
            define_class("Pump", "Pumps", (EVENTS[0], msgspec.structs.replace(EVENTS[1], **change)))
            for change in ({"id": 3}, {"name": "Jammed"}, {"severity": Severity.WARNING}, {"display_text": "stuck"})
        ),
    ],
)
def test_what_receivers_tell_apart_is_in_the_guid(other: EventClass) -> None:
    """Names, texts, ids, severities, hidden GUIDs and the treatment of surplus arguments."""
    assert other.guid != define_class("Pump", "Pumps", EVENTS).guid


def test_translating_and_commenting_makes_no_new_version() -> None:
    """Translations, comments, causes, details and properties do not change the GUID."""
    entry = msgspec.structs.replace(
        EVENTS[0], comment="c", causes=(CauseRemedy(1, "a", "b"),), details=(Detail("n", "t"),), properties={"p": "1"}
    )
    more = define_class(
        "Pump", "Pumps", (entry, EVENTS[1]), translations={"Pumps": {"de": "Pumpen"}}, comment="c", properties={"p": "1"}
    )
    assert more.guid == define_class("Pump", "Pumps", EVENTS).guid


@pytest.mark.parametrize(
    ("name", "events", "message"),
    [
        ("", EVENTS, "an event class is named ''; expected a name"),
        (" Pump", EVENTS, "an event class is named ' Pump'; expected a name without blanks"),
        ("Pump", (), "event class Pump has no event"),
        ("Pump", (EVENTS[0], EVENTS[0]), "id 1 is used twice, by Started and Started"),
        ("Pump", (EventEntry(-1, "X", Severity.INFO),), "event Pump.X: id -1; expected 0..4294967295"),
        ("Pump", (EventEntry(2**32, "X", Severity.INFO),), "id 4294967296; expected"),
        ("Pump", (EventEntry(1, "", Severity.INFO),), "event 1 of event class Pump is named ''"),
    ],
)
def test_a_class_that_no_file_could_hold_is_refused(name: str, events: tuple[EventEntry, ...], message: str) -> None:
    """At the definition, not when it is written or sent."""
    with pytest.raises(ValueError, match=message):
        define_class(name, "", events)


def test_an_unknown_language_and_a_hidden_guid_that_is_none_are_refused() -> None:
    """Also at the definition."""
    with pytest.raises(LanguageError, match="klingon"):
        define_class("Pump", "", EVENTS, translations={"Pump": {"klingon": "x"}})
    with pytest.raises(ValueError, match="no GUID"):
        define_class("Pump", "", EVENTS, hides=["old"])


def test_an_edit_hides_what_was_before() -> None:
    """Two edits make a chain whose newest version is found by name; all versions are still known by it."""
    first = pump()
    second = edited(first, pump("Pump {0} is running"))
    third = edited(second, pump("Pump {0} runs"))
    assert (second.hides, third.hides) == ((first.guid,), (second.guid, first.guid))
    assert len({first.guid, second.guid, third.guid}) == 3
    for classes in ((first, second, third), (third, first, second), (third,)):
        catalog = Catalog(classes)
        assert catalog.newest("Pump") is third
        assert set(catalog.guids("Pump")) == {first.guid, second.guid, third.guid}


def test_taking_an_edit_back_is_a_further_edit() -> None:
    """The old text again is not the old GUID again: versions that hide each other would leave none to send."""
    first = pump()
    back = edited(edited(first, pump("other")), pump())
    assert back.guid != first.guid
    assert first.guid in back.hides
    assert back.guid == content_guid(back)


def test_an_edit_of_nothing_that_counts_keeps_the_guid() -> None:
    """A class of TwinCAT's keeps its GUID and what it hides while it is translated, and loses it with its first other text."""
    old = pump(guid=TWINCAT, hides=("11111111-0000-0000-0000-000000000001",))
    german = {"Pumps": {1031: "Pumpen"}}
    translated = edited(old, pump(translations=german))
    assert (translated.guid, translated.hides, translated.translations) == (TWINCAT, old.hides, german)
    changed = edited(old, pump("other"))
    assert changed.hides == (TWINCAT, *old.hides)
    assert changed.guid == content_guid(changed)


def test_an_edit_may_hide_more() -> None:
    """A further hidden GUID is a change too; the class never hides itself."""
    old = pump()
    other = "22222222-0000-0000-0000-000000000002"
    new = edited(old, pump(hides=(old.guid, other)))
    assert new.hides == (old.guid, other)
    assert new.guid not in new.hides


def test_a_published_class_is_itself_until_its_content_changes() -> None:
    """The published GUID is the content's, or it is hidden by what the content became."""
    first = pump()
    assert published_as(first.guid.upper(), first) == first
    second = published_as(first.guid, pump("other"))
    assert second == edited(first, pump("other"))
    assert published_as(second.guid, second) == second
    with pytest.raises(ValueError, match="no GUID"):
        published_as("old", first)
