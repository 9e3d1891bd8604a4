"""Every text of the test bench: current and hidden classes, English and German, written here by hand from the file."""

import os
from pathlib import Path

import pytest

from bridge.core.arguments import Argument, ArgumentType
from bridge.core.catalog import Catalog
from bridge.core.tmc import read_classes

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
FILE = SHARED / "data" / "tmc" / "aag-test-bench.tsproj"
pytestmark = pytest.mark.skipif(
    not FILE.is_file(), reason=f"{FILE} is not there; TCBRIDGE_SHARED names the folder with data/tmc"
)

ALARMS = "cc934e43-a49d-4f30-abe2-9196095ba389"
MESSAGES = "d4074881-4cee-4a2d-b31c-1e2678588802"
HIDDEN_MESSAGES = "64b4d49e-1bd8-462d-9a40-2904237f1837"

TEXTS = {
    (ALARMS, 1): ("This is a verbose Alarm: #", "Dies ist eine ausführliche Alarmmeldung: #"),
    (ALARMS, 2): ("This is a info Alarm: #", "Dies ist eine Info-Warnung: #"),
    (ALARMS, 3): ("This is a warning Alarm: #", "Dies ist eine Warnung Alarm: #"),
    (ALARMS, 4): ("This is a error Alarm: #", "Dies ist ein Fehleralarm: #"),
    (ALARMS, 5): ("This is a critical Alarm: #", "Dies ist ein kritischer Alarm: #"),
    (MESSAGES, 1): ("This is a verbose Msg #", "Dies ist eine ausführliche Meldung #"),
    (MESSAGES, 2): ("This is a info Msg #", "Dies ist eine Info-Meldung #"),
    (MESSAGES, 3): ("This is a warning Msg #", "Dies ist eine Warnmeldung #"),
    (MESSAGES, 4): ("This is a error Msg #", "Dies ist eine Fehlermeldung #"),
    (MESSAGES, 5): ("This is a critical Msg #", "Dies ist eine wichtige Meldung #"),
    (HIDDEN_MESSAGES, 1): ("This is a verbose message: #",) * 2,
    (HIDDEN_MESSAGES, 2): ("This is a info message: #",) * 2,
    (HIDDEN_MESSAGES, 3): ("This is a warning message: #",) * 2,
    (HIDDEN_MESSAGES, 4): ("This is a error message: #",) * 2,
    (HIDDEN_MESSAGES, 5): ("This is a critical message: #",) * 2,
}
"""Class and id to the English and the German text, # for the argument. The hidden version was never translated."""
ARGUMENTS = [
    ((Argument.of(42),), "42", ""),
    ((Argument.of(12.5),), "12.5", ""),
    ((Argument.of("Förderband"),), "Förderband", ""),
    ((Argument.of(0.1, ArgumentType.FLOAT),), "0.1", ""),
    ((Argument.of(True), Argument.of(7)), Argument.of(True).value, " (7)"),
    ((), "{0}", ""),
]
"""Arguments, what stands for the first one, and what follows the text."""


@pytest.fixture(scope="module")
def catalog() -> Catalog:
    """The classes of the file."""
    return Catalog(read_classes(FILE.read_bytes(), FILE.name).classes)


@pytest.mark.parametrize(("arguments", "first", "rest"), ARGUMENTS)
def test_every_text_with_arguments(catalog: Catalog, arguments: tuple[Argument, ...], first: str, rest: str) -> None:
    """Numbers, text, a missing and a surplus argument, in English and German (1031); another language is English."""
    for (guid, event_id), (english, german) in TEXTS.items():
        for language, text in ((1033, english), ("en-GB", english), (1031, german), ("de", german), (1041, english)):
            assert catalog.text(guid, event_id, arguments, language) == text.replace("#", first) + rest


def test_the_table_is_the_whole_file(catalog: Catalog) -> None:
    """No event of the file is left out above, and the hidden version differs from the current one in every text."""
    assert {(each.guid, number) for each in catalog for number in each.events} == set(TEXTS)
    assert all(TEXTS[MESSAGES, number] != TEXTS[HIDDEN_MESSAGES, number] for number in range(1, 6))
    assert [each.guid for each in catalog.hidden_by(HIDDEN_MESSAGES)] == [ALARMS, MESSAGES]


def test_class_names(catalog: Catalog) -> None:
    """In both languages; the hidden version has its own translation of its name."""
    assert [catalog.class_name(guid) for guid in (ALARMS, MESSAGES, HIDDEN_MESSAGES)] == [
        "Alarm Events",
        "Msg Events",
        "Msg Events",
    ]
    german = [catalog.class_name(guid, 1031) for guid in (ALARMS, MESSAGES, HIDDEN_MESSAGES)]
    assert german == ["Alarmereignisse", "Msg-Ereignisse", "Msg-Ereignisse"]
