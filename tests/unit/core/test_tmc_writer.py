"""Classes as TwinCAT's XML: what is written, and that it reads back equal."""

import pytest
from lxml import etree

from bridge.core.catalog import CauseRemedy, Detail, EventClass, EventEntry
from bridge.core.definitions import define_class
from bridge.core.events import Severity
from bridge.core.tmc import read_classes
from bridge.core.tmc_writer import write_classes

PUMP = "11111111-0000-0000-0000-00000000abcd"
OLD = "33333333-0000-0000-0000-000000000003"
NASTY = [
    "",
    " two  blanks ",
    "a]]>b<!-- c --> & <d> \"e\" 'f'",
    "line\nfeed, tab\t, return\r, both\r\n",
    "Ünïcode € 𝄞 \u0085\u2028",
    "{0,x} {eventclass}",
    "<![CDATA[x]]>",
]


def whole(text: str = "a {0}") -> EventClass:
    """A class with everything in it, and the text wherever a text can be."""
    first = EventEntry(
        0,
        "First",
        Severity.VERBOSE,
        text,
        text,
        (CauseRemedy(3, text, "help"), CauseRemedy(1, "why", text), CauseRemedy(2, "")),
        (Detail("Wiring", text, text), Detail("Wiring", "second of the same name"), Detail("a [b] c", "")),
        {"TcIgnore": "1", "Cause": "no cause of ours", "Cause[x]": "neither"},
    )
    last = EventEntry(2**32 - 1, "Last", Severity.CRITICAL, f"{text} b")
    translations = {text: {1031: f"{text} auf Deutsch", 1041: "日本語"}, "none": {}}
    return EventClass(
        PUMP,
        "Pump",
        text,
        {0: first, 2**32 - 1: last},
        translations,
        (OLD, PUMP.replace("1", "7")),
        True,
        "opt.in",
        text,
        {"plcAttribute_to_string": "1", "mark": ""},
        {"PersistentType": "true", "TcBaseType": "true"},
    )


@pytest.mark.parametrize("text", NASTY)
def test_what_is_written_reads_back_equal(text: str) -> None:
    """Every part of a class, with every text that XML can hold."""
    classes = (whole(text), define_class("Valve", "", [EventEntry(1, "Open", Severity.INFO, text)]))
    result = read_classes(write_classes(classes))
    assert result.problems == ()
    assert result.classes == classes


def test_the_shape_is_that_of_the_editor() -> None:
    """Braced upper-case GUIDs, TxtId on every text, CDATA, decimal ids, severities with a capital, Hides last."""
    found = define_class("Pump", "Pumps", [EventEntry(7, "Start", Severity.INFO, "started {0}")], hides=[OLD])
    text = write_classes([found]).decode("utf-8").replace("\t", "")
    assert text.startswith("<?xml version='1.0' encoding='UTF-8'?>\n<TcModuleClass ")
    assert text.partition("<DataTypes>")[2] == (
        "\n<DataType>\n"
        f'<Name GUID="{{{found.guid.upper()}}}" PersistentType="true">Pump</Name>\n'
        '<DisplayName TxtId=""><![CDATA[Pumps]]></DisplayName>\n'
        "<EventId>\n"
        '<Name Id="7">Start</Name>\n'
        '<DisplayName TxtId=""><![CDATA[started {0}]]></DisplayName>\n'
        "<Severity>Info</Severity>\n"
        "</EventId>\n"
        "<Hides>\n"
        f'<Hide GUID="{{{OLD}}}"/>\n'
        "</Hides>\n"
        "</DataType>\n"
        "</DataTypes>\n"
        "</TcModuleClass>\n"
    )


def test_causes_and_details_are_properties_of_their_event() -> None:
    """The place that bridge/core/tmc.py documents."""
    root = etree.fromstring(write_classes([whole("why")]))
    properties = root.findall("DataTypes/DataType/EventId/Properties/Property")
    assert [(each.findtext("Name"), each.findtext("Value")) for each in properties] == [
        ("Cause[3]", "why"),
        ("Remedy[3]", "help"),
        ("Cause[1]", "why"),
        ("Remedy[1]", "why"),
        ("Cause[2]", ""),
        ("Remedy[2]", ""),
        ("Detail[Wiring]", "why"),
        ("DetailComment[Wiring]", "why"),
        ("Detail[Wiring]", "second of the same name"),
        ("Detail[a [b] c]", ""),
        ("TcIgnore", "1"),
        ("Cause", "no cause of ours"),
        ("Cause[x]", "neither"),
    ]


def test_halves_of_causes_and_details_are_read() -> None:
    """A remedy without its cause and a comment without its detail, as somebody may have written them by hand."""
    data = write_classes([whole("why")]).replace(b"Cause[3]", b"Remedy[9]").replace(b">Detail[Wiring]", b">DetailComment[X]")
    (found,) = read_classes(data).classes
    assert found.events[0].causes[:2] == (CauseRemedy(9, "", "why"), CauseRemedy(3, "", "help"))
    assert found.events[0].details[:2] == (Detail("X", "", "why"), Detail("Wiring", "", "why"))


@pytest.mark.parametrize("text", ["\x00", "\x1b[31m", "\ud800", "\ufffe"])
def test_what_xml_cannot_hold_is_refused(text: str) -> None:
    """Control characters and lone surrogates, in a text or in a key of translations; the error names the class."""
    found = define_class("Pump", "", [EventEntry(1, "Start", Severity.INFO)], namespace="opt", translations={"a": {1031: text}})
    with pytest.raises(ValueError, match=r"event class 'opt\.Pump' cannot be written as XML"):
        write_classes([found])


def test_a_class_without_events_is_refused() -> None:
    """It would read back as no event class at all."""
    with pytest.raises(ValueError, match="'Pump' cannot be written as XML: it has no event"):
        write_classes([EventClass(PUMP, "Pump")])


def test_no_classes_are_an_empty_file() -> None:
    """Which reads back as none."""
    assert read_classes(write_classes([])).classes == ()
