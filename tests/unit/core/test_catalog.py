"""Event classes by GUID and name, and what an event says."""

import pickle
from collections.abc import Sequence

import msgspec
import pytest

from bridge.core.arguments import Argument, ArgumentType, EventReference, Value
from bridge.core.catalog import (
    Catalog,
    CauseRemedy,
    ClassNameError,
    Detail,
    EventClass,
    EventEntry,
    Language,
    LanguageError,
    exact_language,
    exact_tag,
    language_id,
    language_tag,
)
from bridge.core.events import MessageSent, Severity

PUMP = "11111111-0000-0000-0000-000000000001"
VALVE = "22222222-0000-0000-0000-000000000002"
OLD = "33333333-0000-0000-0000-000000000003"
OLDER = "44444444-0000-0000-0000-000000000004"
T = ArgumentType


def event_class(guid: str = PUMP, name: str = "Pump", *texts: str, **more: object) -> EventClass:
    events = {i: EventEntry(i, f"Event{i}", Severity.INFO, text) for i, text in enumerate(texts)}
    return msgspec.structs.replace(EventClass(guid, name, events=events), **more)


def say(text: str, *values: Value | Argument, hide: bool = False, language: Language = 1033) -> str:
    """What a message of event 7 with that display text says."""
    entry = EventEntry(7, "Seven", Severity.ERROR, text)
    catalog = Catalog([EventClass(PUMP, "Pump", "Pumps", {7: entry}, hide_needless_arguments=hide)])
    arguments = tuple(each if isinstance(each, Argument) else Argument.of(each) for each in values)
    event = MessageSent(target="plc1", event_class=PUMP, event_id=7, severity=Severity.ERROR, arguments=arguments)
    return catalog.event_text(event, language)


# FINDING ----------------------------------------------------------------------------------------------------------------------


def test_a_class_is_found_by_its_guid_in_any_spelling() -> None:
    """Braces and capitals do not matter; what is no GUID is not found and does not raise."""
    catalog = Catalog([event_class("{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}", "Test", "text")])
    found = None
    for spelling in ("54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}"):
        found = catalog.lookup(spelling)
        assert found is not None
        assert (found.name, found.guid) == ("Test", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66")
        assert spelling in catalog
    assert catalog.lookup(PUMP) is None
    assert catalog.lookup("Test") is None
    assert catalog.entry("nonsense", 0) is None
    entry = catalog.entry("54CC5482-AD79-4CDC-8C3E-B3983B36ED66", 0)
    assert entry is not None
    assert entry.display_text == "text"
    assert found is not None
    assert found.named("Event0") == entry
    assert found.named("Event1") is None


def test_a_class_needs_real_guids() -> None:
    """A class made in Python with a GUID that is none is refused at once, for its own and for hidden ones."""
    with pytest.raises(ValueError, match="no GUID"):
        EventClass("pump", "Pump")
    with pytest.raises(ValueError, match="no GUID"):
        EventClass(PUMP, "Pump", hides=("old",))
    assert EventClass(PUMP, "Pump", hides=("{AAAAAAAA-0000-0000-0000-000000000003}",)).hides == (
        "aaaaaaaa-0000-0000-0000-000000000003",
    )


def test_a_name_means_every_version_also_hidden_ones() -> None:
    """The loaded versions come first, then the GUIDs they hide; a hidden GUID that has another name is not among them."""
    catalog = Catalog(
        [
            event_class(OLD, "Pump", hides=(OLDER,)),
            event_class(PUMP, "Pump", hides=(OLD, OLDER, VALVE)),
            event_class(VALVE, "Valve"),
        ]
    )
    assert catalog.guids("Pump") == (OLD, PUMP, OLDER)
    assert catalog.guids("Valve") == (VALVE,)
    assert catalog.guids("pump") == ()
    assert catalog.names() == ("Pump", "Valve")
    assert [found.guid for found in catalog.hidden_by(OLD)] == [PUMP]
    assert [found.guid for found in catalog.hidden_by(OLDER.upper())] == [OLD, PUMP]
    assert catalog.hidden_by(PUMP) == catalog.hidden_by("nonsense") == ()


def test_the_newest_version_is_the_one_no_other_of_that_name_hides() -> None:
    """A chain of three, in any order of loading; a class of another name hides nothing."""
    chain = [
        event_class(OLDER, "Pump"),
        event_class(OLD, "Pump", hides=(OLDER,)),
        event_class(PUMP, "Pump", hides=(OLD,)),
        event_class(VALVE, "Valve", hides=(PUMP,)),
    ]
    for classes in (chain, chain[::-1]):
        assert Catalog(classes).newest("Pump").guid == PUMP


def test_a_name_without_a_newest_version_lists_the_versions() -> None:
    """None hides the others, or they hide each other: the error carries the GUIDs; an unknown name gets hints."""
    apart = Catalog([event_class(PUMP, "Pump"), event_class(OLD, "Pump", hides=(OLDER,))])
    with pytest.raises(ClassNameError, match="several versions") as caught:
        apart.newest("Pump")
    assert caught.value.guids == (PUMP, OLD)
    circle = Catalog([event_class(PUMP, "Pump", hides=(OLD,)), event_class(OLD, "Pump", hides=(PUMP,))])
    with pytest.raises(ClassNameError) as caught:
        circle.newest("Pump")
    assert caught.value.guids == (PUMP, OLD)
    with pytest.raises(ClassNameError, match="unknown event class 'Pumb', did you mean 'Pump'"):
        apart.newest("Pumb")


def test_a_namespace_is_part_of_the_name() -> None:
    """opt.Pump and Pump are two classes."""
    catalog = Catalog([event_class(PUMP, "Pump"), event_class(OLD, "Pump", namespace="opt")])
    assert catalog.guids("Pump") == (PUMP,)
    assert catalog.guids("opt.Pump") == (OLD,)
    assert catalog.newest("opt.Pump").qualified_name == "opt.Pump"


def test_a_later_class_of_the_same_guid_counts_and_translations_add_up() -> None:
    """merged() leaves its parts alone; the later one's texts and translations win, the earlier one's others stay."""
    german = {"Go": {1031: "Los", 1036: "Allez"}}
    first = Catalog([event_class(PUMP, "Pump", "Go", translations=german)])
    second = Catalog([event_class(PUMP, "Pump", "Go", translations={"Go": {1031: "Ab"}}), event_class(VALVE, "Valve")])
    both = first.merged(second)
    assert len(both) == 2
    assert [both.text(PUMP, 0, language=lcid) for lcid in (1031, 1036)] == ["Ab", "Allez"]
    assert [first.text(PUMP, 0, language=lcid) for lcid in (1031, 1036)] == ["Los", "Allez"]
    assert len(first) == 1
    assert len(first.merged([event_class(VALVE, "Valve")])) == 2


# PLACEHOLDERS -----------------------------------------------------------------------------------------------------------------

TEXTS: list[tuple[str, Sequence[Value | Argument], str]] = [
    ("plain", (), "plain"),
    ("", (), "Seven"),
    ("A {0} and {1}", (42, "b"), "A 42 and b"),
    ("{1}{0}{1}", ("a", "b"), "bab"),
    ("{00}", ("a",), "a"),
    # missing arguments stay visible
    ("A {0} and {1}", (42,), "A 42 and {1}"),
    ("{0,x}", (), "{0,x}"),
    ("{9999}", ("a",), "{9999} (a)"),
    # surplus arguments
    ("Critical", ("Pump time out.",), "Critical (Pump time out.)"),
    ("{0}", (1, 2, 3), "1 (2, 3)"),
    ("{1}", (1, 2, 3), "2 (1, 3)"),
    # id and class
    ("no {eventID} of {eventclass}", (), f"no 7 of {PUMP}"),
    ("{EVENTID} {eventid,x} {EventClass}", (), f"7 7 {PUMP}"),
    # other braces
    ("{} {a} {{0}} {0", ("x",), "{} {a} {x} {0"),
    ("{-1} {0.5} {0:d} { 0 }", (), "{-1} {0.5} {0:d} { 0 }"),
    ("{\N{ARABIC-INDIC DIGIT ONE}}", (), "{\N{ARABIC-INDIC DIGIT ONE}}"),
    # formats
    ("{0,d} {0,x} {0,X} {0, x }", (255,), "255 ff FF ff"),
    ("{0,e} {0,E} {0,f}", (1.5,), "1.500000e+00 1.500000E+00 1.500000"),
    ("{0,e} {0,f}", (42,), "4.200000e+01 42.000000"),
    ("{0,f}", (2**63,), "9223372036854775808.000000"),
    ("{0,x}", (Argument.of(-1, T.INT16),), "ffff"),
    ("{0,X}", (Argument.of(-1, T.INT64),), "FFFFFFFFFFFFFFFF"),
    ("{0,x}", (Argument.of(-128, T.INT8),), "80"),
    ("{0,D}", (-5,), "-5"),
    # a format that does not fit
    ("{0,d} {0,x}", (1.5,), "1.5 1.5"),
    ("{0,d} {0,f}", ("text",), "text text"),
    ("{0,d}", (True,), "true"),
    ("{0,q} {0,8x} {0,}", (255,), "255 255 255"),
    ("{0,e}", (Argument(int(T.DOUBLE), "many"),), "many"),
    # types without a format
    ("{0} {1}", (42.0, 0.1), "42 0.1"),
    ("{0} {1} {2}", (float("nan"), float("inf"), -1e300), "nan inf -1e+300"),
    ("{0} {1}", (Argument.of(0.1, T.FLOAT), Argument.of(16777217, T.FLOAT)), "0.1 16777216"),
    ("{0}", (Argument.of(3.4028234663852886e38, T.FLOAT),), "3.4028235e+38"),
    ("{0}", (Argument(int(T.FLOAT), "1e300"),), "1e+300"),
    ("{0,f} {0,E}", (float("inf"),), "inf INF"),
    ("{0} {1}", (True, False), "true false"),
    ("{0}", (b"twelve bytes",), "<12 bytes>"),
    ("{0}", (Argument.of(132539328000000000, T.EXTERNAL_TIMESTAMP),), "2021-01-01T00:00:00.000000000Z"),
    ("{0}", (Argument.of(1, T.EXTERNAL_TIMESTAMP),), "1"),
    ("{0}", (Argument.of(0, T.EXTERNAL_TIMESTAMP),), "0"),
    ("{0}", (Argument(77, "whatever"),), "whatever"),
    ("{0}", (Argument(int(T.BLOB), "not base64"),), "not base64"),
    ("{0}", (Argument(int(T.INT32), "12 apples"),), "12 apples"),
    ("{0}", ("{1} {eventid}",), "{1} {eventid}"),
]


@pytest.mark.parametrize(("text", "values", "said"), TEXTS)
def test_what_a_text_says(text: str, values: Sequence[Value | Argument], said: str) -> None:
    """The rules on top of the module, one case a row."""
    assert say(text, *values) == said


def test_surplus_arguments_are_hidden_when_the_class_says_so() -> None:
    """HideNeedlessArguments leaves them out; those with a placeholder stay."""
    assert say("{0}", 1, 2, hide=True) == "1"
    assert say("x", 1, 2, hide=True) == "x"


def test_an_event_reference_says_what_the_other_event_says() -> None:
    """In the asked language, of its own or another class; placeholders in it get no arguments; references do not recurse."""
    german = {"open {0}": {1031: "offen {0}"}, "see {0}": {1031: "siehe {0}"}}
    catalog = Catalog(
        [
            event_class(PUMP, "Pump", "see {0}", "id {eventID}", translations=german),
            event_class(VALVE, "Valve", "open {0}", translations=german),
        ]
    )

    def see(event_id: int, guid: str | None, language: Language = 1033) -> str:
        return catalog.text(PUMP, 0, (Argument.of(EventReference(event_id, guid)),), language)

    assert see(1, None) == "see id 1"
    assert see(0, VALVE) == "see open {0}"
    assert see(0, VALVE, "de-DE") == "siehe offen {0}"
    assert see(0, PUMP) == "see see {0}"
    assert see(9, None) == "see Pump#9"
    assert see(9, OLD) == f"see {OLD}#9"
    reference = Argument(int(T.EVENT_REFERENCE), "no reference")
    assert catalog.text(PUMP, 0, (reference,)) == "see no reference"
    surplus = (Argument.of(1), Argument.of(EventReference(1)))
    assert catalog.text(PUMP, 0, surplus) == "see 1 (id 1)"


def test_an_unknown_class_or_event_is_still_readable() -> None:
    """GUID or class name, id and arguments; also when the GUID is none."""
    catalog = Catalog([event_class(PUMP, "Pump", "x", namespace="opt")])
    arguments = (Argument.of("a"), Argument.of(2.0))
    assert catalog.text(VALVE, 7, arguments) == f"{VALVE}#7 (a, 2)"
    assert catalog.text(VALVE, 7) == f"{VALVE}#7"
    assert catalog.text(PUMP, 7, arguments) == "opt.Pump#7 (a, 2)"
    assert catalog.text("nonsense", 7) == "nonsense#7"
    assert Catalog().class_name("nonsense") == "nonsense"


# LANGUAGES --------------------------------------------------------------------------------------------------------------------

SYMBOLIC = {"DT_Go": {1033: "Go {0}", 1031: "Los {0}", 1036: ""}, "Pumps": {1031: "Pumpen"}}


@pytest.mark.parametrize(
    ("language", "said", "name"),
    [
        (1031, "Los 1", "Pumpen"),
        ("de-DE", "Los 1", "Pumpen"),
        ("de_de", "Los 1", "Pumpen"),
        ("de", "Los 1", "Pumpen"),
        ("1031", "Los 1", "Pumpen"),
        (1033, "Go 1", "Pumps"),
        ("en-GB", "Go 1", "Pumps"),
        (1036, "Go 1", "Pumps"),
        ("klingon", "Go 1", "Pumps"),
        (-1, "Go 1", "Pumps"),
    ],
)
def test_the_text_falls_back_to_english_and_then_to_the_display_text(language: Language, said: str, name: str) -> None:
    """A symbolic key has an English text at 1033, prose is its own English; an empty translation counts as none."""
    catalog = Catalog([event_class(PUMP, "Pump", "DT_Go", translations=SYMBOLIC, display_text="Pumps")])
    assert catalog.text(PUMP, 0, (Argument.of(1),), language) == said
    assert catalog.class_name(PUMP, language) == name


def test_a_class_without_display_text_shows_its_name() -> None:
    """The Name is for code, but better than nothing."""
    assert Catalog([event_class(PUMP, "Pump")]).class_name(PUMP) == "Pump"


def test_surplus_arguments_are_those_of_the_shown_text() -> None:
    """A translation that drops a placeholder appends the argument."""
    catalog = Catalog([event_class(PUMP, "Pump", "Go {0}", translations={"Go {0}": {1031: "Los"}})])
    assert catalog.text(PUMP, 0, (Argument.of(1),), 1031) == "Los (1)"


def test_a_hidden_version_keeps_its_own_texts() -> None:
    """The event of a hidden GUID is not shown with the newest version's text, and without a class it has none."""
    new = event_class(PUMP, "Pump", "new text", hides=(OLD, OLDER))
    catalog = Catalog([new, event_class(OLD, "Pump", "old text")])
    assert [catalog.text(guid, 0) for guid in (PUMP, OLD, OLDER)] == ["new text", "old text", f"{OLDER}#0"]


def test_languages_by_number_and_tag() -> None:
    """LCIDs and tags are the same language; a bare language has a default region; unknown ones are refused when asked."""
    assert language_id("de") == language_id(7) == language_id("DE-de") == 1031
    assert [language_id(tag) for tag in ("en", "fr", "ja-JP", "zh", "zh-TW", "pt-BR")] == [1033, 1036, 1041, 2052, 1028, 1046]
    assert language_id(99999) == 99999
    assert (language_tag(1031), language_tag(1033), language_tag(99999)) == ("de-DE", "en-US", "99999")
    for unknown in ("klingon", "", "-1", 0, -1, 2**32):
        with pytest.raises(LanguageError, match="unknown language"):
            language_id(unknown)


def test_a_file_keeps_the_exact_lcid() -> None:
    """A tag where it stands for just this LCID, else the number; a number is not turned into another one."""
    for lcid in (1031, 1033, 2057, 7, 0, 99999, 2**32 - 1, *range(1025, 1200)):
        assert exact_language(exact_tag(lcid)) == lcid
    assert [exact_tag(lcid) for lcid in (1031, 7, 0)] == ["de-DE", "7", "0"]
    assert exact_language("de") == 1031
    for unknown in ("klingon", str(2**32), "-1", ""):
        with pytest.raises(LanguageError):
            exact_language(unknown)


def test_entries_survive_a_process_boundary() -> None:
    """A class pickles, so that a program can hand it to its workers."""
    found = event_class(PUMP, "Pump", "x", hides=(OLD,), translations={"x": {1031: "y"}})
    assert pickle.loads(pickle.dumps(found)) == found


# HELP AND SOURCES -------------------------------------------------------------------------------------------------------------


def test_causes_and_details_in_the_asked_language() -> None:
    """Each text is translated on its own and falls back like a display text; who has none has none."""
    entry = EventEntry(
        7,
        "Stuck",
        Severity.ERROR,
        causes=(CauseRemedy(1, "Dirt", "Clean it"), CauseRemedy(2, "K_Fuse")),
        details=(Detail("Wiring", "Sheet 3", "see {0}"),),
    )
    german = {"Dirt": {1031: "Schmutz"}, "Clean it": {1031: "Reinigen"}, "K_Fuse": {1033: "Fuse"}, "Sheet 3": {1031: "Blatt 3"}}
    catalog = Catalog([EventClass(PUMP, "Pump", events={7: entry}, translations=german)])
    assert catalog.causes(PUMP, 7, "de") == (CauseRemedy(1, "Schmutz", "Reinigen"), CauseRemedy(2, "Fuse"))
    assert catalog.causes(PUMP.upper(), 7) == (CauseRemedy(1, "Dirt", "Clean it"), CauseRemedy(2, "Fuse"))
    assert catalog.details(PUMP, 7, 1031) == (Detail("Wiring", "Blatt 3", "see {0}"),)
    assert catalog.details(PUMP, 7, "klingon") == entry.details
    for guid, number in ((PUMP, 8), (VALVE, 7), ("nonsense", 7)):
        assert catalog.causes(guid, number) == ()
        assert catalog.details(guid, number) == ()


def test_a_source_name_is_translated_by_the_class_of_its_guid() -> None:
    """4026: the source GUID names a class whose display texts are the source names."""
    names = event_class(OLD, "Sources", "Main.Pump", translations={"Main.Pump": {1031: "Hauptpumpe"}})
    catalog = Catalog([names])
    assert catalog.source_name("Main.Pump", OLD.upper(), "de") == "Hauptpumpe"
    assert catalog.source_name("Main.Pump", OLD) == "Main.Pump"
    for name, guid in (("Main.Pump", PUMP), ("Main.Pump", None), ("Main.Pump", "x"), ("Main.Other", OLD)):
        assert catalog.source_name(name, guid, "de") == name
    assert [catalog.source_name(name, OLD, "de") for name in (None, "")] == ["", ""]


def test_every_text_that_can_be_translated_is_listed_once() -> None:
    """Display texts, comments, causes, remedies and details; no empty ones."""
    first = EventEntry(1, "A", Severity.INFO, "text", "note", (CauseRemedy(1, "why", "text"),), (Detail("name", "more", ""),))
    found = EventClass(PUMP, "Pump", "Pumps", {1: first, 2: EventEntry(2, "B", Severity.INFO, "text")}, comment="Pumps")
    assert found.texts() == ("Pumps", "text", "note", "why", "name", "more")
