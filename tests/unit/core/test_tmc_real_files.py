"""Every real class file of the shared data: counts, hidden versions and translations.

The counts were taken from the files with a regular expression over their text: DataType blocks with <EventId> elements.
"""

import os
from pathlib import Path

import pytest

from bridge.core import class_toml
from bridge.core.arguments import Argument, EventReference
from bridge.core.catalog import Catalog
from bridge.core.events import AlarmRaised, Severity
from bridge.core.tmc import TmcError, read_classes
from bridge.core.tmc_writer import write_classes
from bridge.edges.class_files import load_catalog

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
FOLDER = SHARED / "data" / "tmc"
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(),
    reason=f"the real class files are not in {FOLDER}; TCBRIDGE_SHARED names the folder that holds data/tmc",
)

COUNTS = {
    "aag-test-bench.tsproj": {"AlarmEvents": [5], "MsgEvents": [5, 5]},
    "beckhoff-filter-sample.tmc": {"TestFilterClass2": [2], "TestFilterClass": [4], "MessageTest": [2]},
    "beckhoff-publisher.tmc": {"Win32EventClass": [37], "AnotherEventClass": [1], "PublisherEventClass": [4]},
    "beckhoff-resource-import.tmc": {"Component_1": [2], "Component_2": [2]},
    "beckhoff-start-stop.tmc": {"TcComMessages": [8]},
    "packml-vffs-demo.tmc": {"PullWheels": [5], "Sealer": [6], "Unwind": [5], "VFFSDemo": [6]},
}
"""File to class name to the number of events of each of its versions."""

ALARMS = "cc934e43-a49d-4f30-abe2-9196095ba389"
MESSAGES = "d4074881-4cee-4a2d-b31c-1e2678588802"
OLD_MESSAGES = "64b4d49e-1bd8-462d-9a40-2904237f1837"
CAPTURED = "5819b654-acc7-4328-a54f-a5886769f484"
PUBLISHER = "e4b8bfa4-0295-4b62-aec5-a93acaeb32a8"


def load(name: str) -> Catalog:
    catalog, problems = load_catalog([FOLDER / name])
    assert problems == []
    return catalog


def test_no_file_is_forgotten() -> None:
    """Every file of the folder has its counts here."""
    assert {path.name for path in FOLDER.iterdir()} == set(COUNTS)


@pytest.mark.parametrize("name", COUNTS)
def test_a_file_has_its_classes_and_events(name: str) -> None:
    """Classes and events as counted in the file; nothing is a problem."""
    result = read_classes((FOLDER / name).read_bytes(), name)
    assert result.problems == ()
    counts: dict[str, list[int]] = {}
    for found in result.classes:
        counts.setdefault(found.name, []).append(len(found.events))
        assert found.display_text
        assert all(key == entry.id and entry.name and entry.display_text for key, entry in found.events.items())
    assert counts == COUNTS[name]


@pytest.mark.parametrize("name", COUNTS)
def test_each_class_is_equal_after_a_round_trip(name: str) -> None:
    """Written and read again, as TMC and as TOML; also alone, without the others of its file."""
    classes = read_classes((FOLDER / name).read_bytes(), name).classes
    assert read_classes(write_classes(classes)).classes == classes
    assert class_toml.read_classes(class_toml.write_classes(classes)).classes == classes
    for found in classes:
        assert read_classes(write_classes([found])).classes == (found,)
        assert class_toml.read_classes(class_toml.write_classes([found])).classes == (found,)


@pytest.mark.parametrize("name", COUNTS)
def test_each_class_says_where_it_stands(name: str) -> None:
    """The line of a class and of each of its events holds the start of their elements."""
    data = (FOLDER / name).read_bytes()
    lines = data.decode("utf-8-sig").splitlines()
    result = read_classes(data, name)
    for found in result.classes:
        assert "<DataType>" in lines[result.line(found.guid) - 1]
        for entry in found.events.values():
            assert "<EventId>" in lines[result.line(found.guid, entry.id) - 1]


def test_all_files_make_one_catalog() -> None:
    """16 classes with 99 events, 15 names: only MsgEvents has two versions."""
    catalog, problems = load_catalog([FOLDER])
    assert problems == []
    assert len(catalog) == 16
    assert sum(len(found.events) for found in catalog) == 99
    assert len(catalog.names()) == 15
    severities = [entry.severity for found in catalog for entry in found.events.values()]
    assert {severity: severities.count(severity) for severity in Severity} == {
        Severity.VERBOSE: 24,
        Severity.INFO: 14,
        Severity.WARNING: 9,
        Severity.ERROR: 48,
        Severity.CRITICAL: 4,
    }


@pytest.mark.parametrize(
    ("guid", "event_id", "english", "german"),
    [
        (ALARMS, 1, "This is a verbose Alarm: 1", "Dies ist eine ausführliche Alarmmeldung: 1"),
        (ALARMS, 5, "This is a critical Alarm: 1", "Dies ist ein kritischer Alarm: 1"),
        (MESSAGES, 2, "This is a info Msg 1", "Dies ist eine Info-Meldung 1"),
        (MESSAGES, 4, "This is a error Msg 1", "Dies ist eine Fehlermeldung 1"),
        (OLD_MESSAGES, 2, "This is a info message: 1", "This is a info message: 1"),
        (CAPTURED, 5, f"{CAPTURED}#5 (1)", f"{CAPTURED}#5 (1)"),
    ],
)
def test_the_test_bench_in_english_and_german(guid: str, event_id: int, english: str, german: str) -> None:
    """The hidden version has texts of its own, untranslated ones; a hidden GUID without a class gets nobody's text."""
    catalog = load("aag-test-bench.tsproj")
    event = AlarmRaised(
        target="plc1", event_class=guid, event_id=event_id, severity=Severity.INFO, raised=True, arguments=(Argument.of(1),)
    )
    assert catalog.event_text(event) == english
    for language in (1031, "de-DE", "de"):
        assert catalog.event_text(event, language) == german
    assert catalog.event_text(event, 1041) == english


def test_names_and_versions_of_the_test_bench() -> None:
    """The newer MsgEvents hides the older one; AlarmEvents hides it too, but under its own name it is found."""
    catalog = load("aag-test-bench.tsproj")
    assert catalog.newest("MsgEvents").guid == MESSAGES
    assert [found.guid for found in catalog.hidden_by(OLD_MESSAGES)] == [ALARMS, MESSAGES]
    assert [found.guid for found in catalog.hidden_by(CAPTURED)] == [ALARMS, OLD_MESSAGES]
    assert catalog.guids("MsgEvents")[:2] == (MESSAGES, OLD_MESSAGES)
    # 2 classes, 18 hidden by the newer one besides the older one, 16 hidden by the older one
    assert len(catalog.guids("MsgEvents")) == 2 + 18 + 16
    # 1 class and 29 hidden GUIDs, one of which is the older MsgEvents
    assert len(catalog.guids("AlarmEvents")) == 1 + 29 - 1
    assert OLD_MESSAGES not in catalog.guids("AlarmEvents")
    names = [catalog.class_name(guid, 1031) for guid in (ALARMS, MESSAGES, OLD_MESSAGES, CAPTURED)]
    assert names == ["Alarmereignisse", "Msg-Ereignisse", "Msg-Ereignisse", CAPTURED]
    assert catalog.class_name(ALARMS) == "Alarm Events"
    assert catalog.entry(MESSAGES, 2) is not None


def test_symbolic_keys_have_their_english_text() -> None:
    """In the PackML demo the display text is a key, and 1033 holds the English prose."""
    catalog = load("packml-vffs-demo.tmc")
    sealer = catalog.newest("Sealer")
    hot = next(entry for entry in sealer.events.values() if entry.display_text == "DT_Sealer_Event_TemeratureOutOfRange")
    arguments = (Argument.of("Sealer 1"), Argument.of(120.0), Argument.of(180.5))
    for language in (1033, 1031):
        text = catalog.text(sealer.guid, hot.id, arguments, language)
        assert text == "Sealer 1 - Out of Temperature Range (120-180.5)"
    first = sealer.events[1]
    assert first.comment == "Reference Event that should be the first in all event classes"
    assert sealer.translations[first.comment] == {}


def test_event_references_and_surplus_arguments_of_the_publisher() -> None:
    """The sample's demo text: number, string, another event's text, and what is left over in parentheses."""
    catalog = load("beckhoff-publisher.tmc")
    arguments = (Argument.of(7), Argument.of("seven"), Argument.of(EventReference(4)), Argument.of(True))
    assert catalog.text(PUBLISHER, 3, arguments) == (
        "A small Demo of Arguments: number: 7 - String: seven - an EventReference ReferencedEvent"
        " - additional arguements are appended afterwards (true)"
    )
    assert catalog.text(PUBLISHER, 3, arguments, "de-DE") == (
        "Eine kleine demo von Argumenten: Zahl: 7 - String seven - eine EventReferenz ReferenzierterEvent"
        " - weitere Argumente werden angehangen am Ende (true)"
    )
    assert catalog.class_name(PUBLISHER, 1031) == "Publisher Ereignisklasse"
    win32 = catalog.newest("Win32EventClass")
    assert catalog.text(win32.guid, 0) == "The operation completed successfully."


def test_a_real_file_cut_or_damaged_still_gives_its_whole_classes() -> None:
    """Cut at every 97th byte: an error or the first classes. A stray & in one class: the other two are there."""
    data = (FOLDER / "aag-test-bench.tsproj").read_bytes()
    whole = read_classes(data).classes
    seen: set[int] = set()
    for end in range(0, len(data), 97):
        try:
            classes = read_classes(data[:end]).classes
        except TmcError:
            continue
        seen.add(len(classes))
        assert classes == whole[: len(classes)]
    assert seen == {0, 1, 2, 3}
    damaged = read_classes(data.replace(b'<Name Id="#x2">InfoMsg', b'<Name Id="#x2">Info & Msg'), "damaged.tsproj")
    assert damaged.classes == (whole[0], whole[2])
    assert [problem.line for problem in damaged.problems] == [111, 111]
