"""What a person types on the command line, as values."""

import pytest

from bridge.cli import values
from bridge.cli.exits import Usage
from bridge.core.arguments import Argument, ArgumentError, ArgumentType
from bridge.core.catalog import Catalog, ClassNameError, EventClass, EventEntry
from bridge.core.events import Severity, Source

GUID = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "695e2e22-3f74-4ec5-a795-e51962a66fcb"
CATALOG = Catalog([EventClass(GUID, "Axis", events={7: EventEntry(7, "LagError", Severity.ERROR)})])
T = ArgumentType

TYPED = [
    ("12", T.INT32, "12"),
    ("-3", T.INT32, "-3"),
    ("3000000000", T.INT64, "3000000000"),
    ("12.5", T.DOUBLE, "12.5"),
    ("true", T.BOOLEAN, "true"),
    ("homed", T.UTF8_STRING, "homed"),
    ("", T.UTF8_STRING, ""),
    ("http://x", T.UTF8_STRING, "http://x"),
    ("int16:-3", T.INT16, "-3"),
    ("UINT8:0xff", T.UINT8, "255"),
    ("string:12", T.STRING, "12"),
    ("wstring:a:b", T.WSTRING, "a:b"),
    ("boolean:TRUE", T.BOOLEAN, "true"),
    ("float:1.5", T.FLOAT, "1.5"),
    ("double:nan", T.DOUBLE, "nan"),
    ("char:x", T.CHAR, "x"),
    ("blob:AAE=", T.BLOB, "AAE="),
    (f"event_reference:{GUID.upper()}#7", T.EVENT_REFERENCE, f"{GUID}#7"),
    ("event_reference:#7", T.EVENT_REFERENCE, "#7"),
    ("external_timestamp:5", T.EXTERNAL_TIMESTAMP, "5"),
]


@pytest.mark.parametrize(("text", "kind", "value"), TYPED)
def test_an_argument_is_a_value_or_a_type_and_a_value(text: str, kind: ArgumentType, value: str) -> None:
    """Without a type a number is a number and the rest is text; a type before the colon decides."""
    assert values.argument(text) == Argument(int(kind), value)


@pytest.mark.parametrize(
    "text", ["int8:200", "int16:x", "boolean:yes", "char:xy", "blob:%", "event_reference:x#7", "99999999999999999999"]
)
def test_a_value_that_does_not_fit_its_type_is_refused(text: str) -> None:
    """The error names the value."""
    with pytest.raises(ArgumentError):
        values.argument(text)


def test_every_type_can_be_typed() -> None:
    """All of TcEventArgumentType but UNDEFINED have a name."""
    assert set(values.TYPES.values()) == set(ArgumentType) - {T.UNDEFINED}


def test_a_class_is_a_guid_or_a_name() -> None:
    """A GUID needs no catalog and is brought into its one spelling; a name does need one."""
    assert values.class_guid("{" + OTHER.upper() + "}", Catalog()) == OTHER
    assert values.class_guid("Axis", CATALOG) == GUID
    with pytest.raises(ClassNameError, match="did you mean 'Axis'"):
        values.class_guid("Axes", CATALOG)


def test_a_name_with_several_versions_is_refused_and_they_are_listed() -> None:
    """Nobody guesses which version was meant."""
    both = Catalog([EventClass(GUID, "Axis"), EventClass(OTHER, "Axis")])
    with pytest.raises(ClassNameError) as caught:
        values.class_guid("Axis", both)
    assert GUID in str(caught.value)
    assert OTHER in str(caught.value)


def test_an_event_is_a_number_or_a_name_of_its_class() -> None:
    """Decimal, hexadecimal, or the Name; anything else is wrong usage."""
    assert values.event_number("7", GUID, CATALOG) == values.event_number("0x7", OTHER, Catalog()) == 7
    assert values.event_number("LagError", GUID, CATALOG) == 7
    for wrong in ("Lag", "-1", "4294967296"):
        with pytest.raises(Usage):
            values.event_number(wrong, GUID, CATALOG)


def test_the_severity_is_the_one_given_else_that_of_the_class_else_info() -> None:
    """What is typed counts first."""
    assert values.severity("critical", GUID, 7, CATALOG) is Severity.CRITICAL
    assert values.severity(None, GUID, 7, CATALOG) is Severity.ERROR
    assert values.severity(None, GUID, 8, CATALOG) is Severity.INFO


def test_a_source_that_is_not_given_is_absent() -> None:
    """Absent is not empty; a bad GUID is wrong usage."""
    assert values.source(None, None, None) == Source()
    assert values.source("", 0, None) == Source(0, "")
    with pytest.raises(Usage):
        values.source(None, None, "x")
