"""Translations as files for translators: out of the classes, and back into them."""

import pytest

from bridge.core.catalog import EventClass, EventEntry
from bridge.core.definitions import define_class
from bridge.core.events import Severity
from bridge.core.tmc import TmcError
from bridge.core.tmc_writer import write_classes
from bridge.core.translations import (
    EVERY,
    Table,
    every_text,
    imported,
    read_csv,
    read_xml,
    unused,
    without_unused,
    write_csv,
    write_xml,
)


def event_class(name: str, translations: dict[str, dict[int, str]], *texts: str) -> EventClass:
    events = [EventEntry(i, f"Event{i}", Severity.INFO, text) for i, text in enumerate(texts)]
    return define_class(name, f"{name}s", events, translations={key: dict(each.items()) for key, each in translations.items()})


PUMP = event_class("Pump", {"on {0}": {1031: "an {0}", 1036: "en marche {0}"}, "gone": {1031: "weg"}}, "on {0}", "off")
VALVE = event_class("Valve", {"on {0}": {1031: "an {0}"}}, "on {0}")
CLASSES = (PUMP, VALVE)
NASTY = "a,b;c\n\"d\" 'e'\t€ \r\n=1+1 <&>]]>"


# OUT OF CLASSES ---------------------------------------------------------------------------------------------------------------


def test_every_text_with_what_it_has() -> None:
    """In the order of the class; a text that no event has any more comes last."""
    assert every_text(CLASSES) == {
        PUMP.guid: {"Pumps": {}, "on {0}": {1031: "an {0}", 1036: "en marche {0}"}, "off": {}, "gone": {1031: "weg"}},
        VALVE.guid: {"Valves": {}, "on {0}": {1031: "an {0}"}},
    }
    assert list(every_text(CLASSES)[PUMP.guid]) == ["Pumps", "on {0}", "off", "gone"]


def test_every_text_in_the_languages_that_are_wanted() -> None:
    """These and no others, empty where somebody has to fill them in."""
    assert every_text([VALVE], (1031, 1041)) == {
        VALVE.guid: {"Valves": {1031: "", 1041: ""}, "on {0}": {1031: "an {0}", 1041: ""}}
    }


def test_unused_texts_are_listed_and_deleted() -> None:
    """The other translations stay; a class without unused texts is the same as before."""
    assert unused(CLASSES) == {PUMP.guid: ("gone",)}
    pump, valve = without_unused(CLASSES)
    assert (list(pump.translations), valve) == (["on {0}"], VALVE)
    assert pump.guid == PUMP.guid
    assert unused([pump, valve]) == {}


# BACK INTO CLASSES ------------------------------------------------------------------------------------------------------------


def test_a_table_is_merged() -> None:
    """New and other translations are counted; an empty one changes nothing; what belongs to nobody is told."""
    table: Table = {
        EVERY: {"on {0}": {1031: "läuft {0}", 1041: "J"}, "nobody's": {1031: "x"}},
        PUMP.guid: {"on {0}": {1031: "Pumpe an {0}", 1036: ""}, "off": {1031: "aus"}, "Valves": {1031: "Ventile"}},
        "99999999-0000-0000-0000-000000000009": {"on {0}": {1031: "x"}},
    }
    result = imported(CLASSES, table)
    pump, valve = result.classes
    assert pump.translations == {
        "on {0}": {1031: "Pumpe an {0}", 1036: "en marche {0}", 1041: "J"},
        "off": {1031: "aus"},
        "gone": {1031: "weg"},
    }
    assert valve.translations == {"on {0}": {1031: "läuft {0}", 1041: "J"}}
    assert (result.added, result.changed) == (3, 2)
    assert result.unknown == (
        (EVERY, "nobody's"),
        (PUMP.guid, "Valves"),
        ("99999999-0000-0000-0000-000000000009", "on {0}"),
    )


def test_what_was_exported_changes_nothing_when_it_comes_back() -> None:
    """Also with empty cells for languages that nobody has."""
    for languages in ((), (1031,), (1041, 1036)):
        result = imported(CLASSES, read_csv(write_csv(every_text(CLASSES, languages), CLASSES)))
        assert (result.classes, result.added, result.changed, result.unknown) == (CLASSES, 0, 0, ())


# XML --------------------------------------------------------------------------------------------------------------------------


def test_xml_is_the_translations_block() -> None:
    """Each text once, its translations below it; without classes, as TwinCAT has it on file level."""
    data = write_xml(every_text([VALVE], (1031, 1041)))
    assert data.decode().replace("\t", "") == (
        "<?xml version='1.0' encoding='UTF-8'?>\n"
        "<Translations>\n"
        '<Text TxtId="Valves">\n<Text LcId="1031"></Text>\n<Text LcId="1041"></Text>\n</Text>\n'
        '<Text TxtId="on {0}">\n<Text LcId="1031"><![CDATA[an {0}]]></Text>\n<Text LcId="1041"></Text>\n</Text>\n'
        "</Translations>\n"
    )
    assert read_xml(data) == {EVERY: {"Valves": {1031: "", 1041: ""}, "on {0}": {1031: "an {0}", 1041: ""}}}


def test_xml_of_several_classes_joins_their_texts() -> None:
    """A text stands once, whether one class translates it or two alike; two different translations are refused."""
    assert read_xml(write_xml(every_text(CLASSES)))[EVERY]["on {0}"] == {1031: "an {0}", 1036: "en marche {0}"}
    other = event_class("Motor", {"on {0}": {1031: "ein {0}"}}, "on {0}")
    with pytest.raises(ValueError, match=r"two classes translate 'on \{0\}' into de-DE differently"):
        write_xml(every_text((PUMP, other)))


def test_the_translations_of_a_class_file_are_read_too() -> None:
    """Those on file level; a file without any is an empty table."""
    text = write_classes([VALVE]).replace(
        b"<DataTypes>", b'<Translations><Text TxtId="a"><Text LcId="1031">b</Text></Text></Translations><DataTypes>'
    )
    assert read_xml(text) == {EVERY: {"a": {1031: "b"}}}
    assert read_xml(b"<Translations/>") == read_xml(write_classes([])) == {}


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        (b"", 1, "expected an XML file whose root is TcModuleClass, TcSmProject, TcSmItem or Translations"),
        (b"<html/>", 1, "the root is html; expected an XML file"),
        (b"<Translations>\n<Text/></Translations>", 2, "a Text has no TxtId"),
        (b'<Translations>\n<Text TxtId="a"><Text LcId="de"/></Text></Translations>', 2, "LcId 'de'; expected"),
        (b'<Translations>\n<Text TxtId="a">', 2, "expected well-formed XML"),
        (
            b"<!DOCTYPE Translations [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><Translations>&a;</Translations>",
            1,
            "a DTD is refused",
        ),
        (b"<Translations>" + b"<Text>" * 200_000, 1, "expected well-formed XML"),
    ],
)
def test_a_broken_xml_file_is_refused(data: bytes, line: int, message: str) -> None:
    """With file and line; half a table is worse than none."""
    with pytest.raises(TmcError) as caught:
        read_xml(data, "de.xml")
    assert str(caught.value).startswith(f"de.xml:{line}: ")
    assert message in str(caught.value)


# CSV --------------------------------------------------------------------------------------------------------------------------


def test_csv_has_a_column_per_language() -> None:
    """In the order of LCIDs, with tags; a mark in front tells spreadsheets that it is UTF-8."""
    data = write_csv(every_text(CLASSES, (1036, 1031, 7)), CLASSES)
    assert data.decode("utf-8") == (
        "\ufeffclass,guid,text,7,de-DE,fr-FR\r\n"
        f"Pump,{PUMP.guid},Pumps,,,\r\n"
        f"Pump,{PUMP.guid},on {{0}},,an {{0}},en marche {{0}}\r\n"
        f"Pump,{PUMP.guid},off,,,\r\n"
        f"Pump,{PUMP.guid},gone,,weg,\r\n"
        f"Valve,{VALVE.guid},Valves,,,\r\n"
        f"Valve,{VALVE.guid},on {{0}},,an {{0}},\r\n"
    )


def test_any_text_survives() -> None:
    """Separators, quotes, line ends of both kinds and what a spreadsheet takes for a formula."""
    table: Table = {PUMP.guid: {NASTY: {1031: NASTY}}, EVERY: {"": {1031: "leer"}}}
    assert read_csv(write_csv(table)) == table
    assert read_xml(write_xml(table)) == {EVERY: {NASTY: {1031: NASTY}, "": {1031: "leer"}}}


def test_what_a_spreadsheet_makes_of_it_is_read() -> None:
    """Semicolons, no mark, LF, GUIDs in braces, names that are gone, missing cells at the end, empty rows, tags in any case."""
    text = f"Class;GUID;Text;DE;1041\n;{{{PUMP.guid.upper()}}};on {{0}};an {{0}}, bitte\n;;;;\n\n;;off;aus;J\n"
    assert read_csv(text.encode()) == {
        PUMP.guid: {"on {0}": {1031: "an {0}, bitte"}},
        EVERY: {"off": {1031: "aus", 1041: "J"}},
    }


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "no header; expected class,guid,text and languages"),
        ("text,de\na,b\n", 1, "the header begins with 'text,de'; expected class,guid,text and languages"),
        ("class,guid,text,klingon\n", 1, "column 4: unknown language 'klingon'"),
        ("class,guid,text,de,1031\n", 1, "language 1031 has two columns"),
        ("class,guid,text,de\n,x,a,b\n", 2, "'x' is no GUID"),
        ("class,guid,text,de\n\n,,a,b,c\n", 3, "5 columns; expected 4 as in the header"),
        ("class,guid,text,de\na,b\n", 2, "2 columns; expected 4"),
        ("class,guid,text,de\n,,a,b\n,,a,c\n", 3, "'a' has two translations into de-DE; expected one"),
        ('class,guid,text,de\n,,"a,b\n', 2, "unexpected end of data"),
        ("class,guid,text,de\n,,a," + "b" * 200_000, 2, "field"),
    ],
)
def test_a_broken_csv_file_is_refused(text: str, line: int, message: str) -> None:
    """With file and line."""
    with pytest.raises(TmcError) as caught:
        read_csv(text.encode(), "de.csv")
    assert str(caught.value).startswith(f"de.csv:{line}: ")
    assert message in str(caught.value)


def test_bytes_that_are_no_utf_8_are_refused() -> None:
    """As an old spreadsheet writes them."""
    with pytest.raises(TmcError, match=r"de\.csv:2: bytes that are no UTF-8; expected CSV in UTF-8"):
        read_csv("class,guid,text,de\n,,on,läuft\n".encode("latin-1"), "de.csv")
