"""Arguments: a type number and an exact text, what they are in Python, and what they occupy in TwinCAT."""

import math
import struct

import msgspec
import pytest

from bridge.core.arguments import ZERO_GUID, Argument, ArgumentError, ArgumentType, EventReference, Value, guid, native_size

T = ArgumentType
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


NUMBERS = """Undefined Boolean Int8 Int16 Int32 Int64 UInt8 UInt16 UInt32 UInt64 Float Double Char WChar String WString
EventReference FormatString ExternalTimestamp Blob AdsNotificationStream Utf8String Utf16String Utf32String"""


def test_the_numbers_are_those_of_the_plc_library() -> None:
    """TcEventArgumentType of Tc3_EventLogger 3.1.33 counts from 0 to 23; a foreign reader knows types by number only."""
    assert [kind.name.replace("_", "").lower() for kind in T] == NUMBERS.lower().split()
    assert [int(kind) for kind in T] == list(range(24))


EXAMPLES: list[tuple[ArgumentType, Value, str, int]] = [
    # type, value in Python, exact text, bytes in TwinCAT's packed argument data
    (T.UNDEFINED, "?", "?", 0),
    (T.BOOLEAN, True, "true", 1),
    (T.BOOLEAN, False, "false", 1),
    (T.INT8, -128, "-128", 1),
    (T.INT16, -32768, "-32768", 2),
    (T.INT32, -(2**31), "-2147483648", 4),
    (T.INT64, -(2**63), "-9223372036854775808", 8),
    (T.UINT8, 255, "255", 1),
    (T.UINT16, 65535, "65535", 2),
    (T.UINT32, 2**32 - 1, "4294967295", 4),
    (T.UINT64, 2**64 - 1, "18446744073709551615", 8),
    (T.FLOAT, 1.5, "1.5", 4),
    (T.FLOAT, math.inf, "inf", 4),
    (T.DOUBLE, 0.1, "0.1", 8),
    (T.DOUBLE, -math.inf, "-inf", 8),
    (T.DOUBLE, 5e-324, "5e-324", 8),
    (T.CHAR, "ÿ", "ÿ", 1),
    (T.WCHAR, "€", "€", 2),
    (T.STRING, "Motor", "Motor", 6),
    (T.STRING, "", "", 1),
    (T.WSTRING, "Motor", "Motor", 12),
    (T.WSTRING, "🙂", "🙂", 6),
    (T.EVENT_REFERENCE, EventReference(7), "#7", 4),
    (T.EVENT_REFERENCE, EventReference(7, CLASS), f"{CLASS}#7", 20),
    (T.FORMAT_STRING, "{0}", "{0}", 4),
    (T.EXTERNAL_TIMESTAMP, 134_008_985_475_030_000, "134008985475030000", 8),
    (T.BLOB, b"", "", 4),
    (T.BLOB, b"\x00", "AA==", 5),
    (T.BLOB, b"\x00\xff", "AP8=", 6),
    (T.BLOB, b"\x00\xff\x10", "AP8Q", 7),
    (T.ADS_NOTIFICATION_STREAM, b"\x01\x02", "AQI=", 6),
    (T.UTF8_STRING, "Öl °C", "Öl °C", 8),
    (T.UTF16_STRING, "Öl", "Öl", 6),
    (T.UTF32_STRING, "Öl", "Öl", 12),
]


@pytest.mark.parametrize(("kind", "value", "text", "size"), EXAMPLES, ids=lambda item: str(item)[:24])
def test_each_type_has_an_exact_text_and_a_native_size(kind: ArgumentType, value: Value, text: str, size: int) -> None:
    """The text is what the wire carries and gives the value back; the size is TwinCAT's, not the wire's."""
    argument = Argument.of(value, kind)
    assert (argument.type, argument.value) == (int(kind), text)
    assert argument.python() == value
    assert type(argument.python()) is type(value)
    assert native_size(argument) == size


def test_every_type_has_an_example() -> None:
    """No type of the table is left out above."""
    assert {kind for kind, *_ in EXAMPLES} == set(T)


def test_nan_survives() -> None:
    """NaN, which JSON cannot write as a number, is the text nan."""
    argument = Argument.of(math.nan)
    assert argument == Argument(T.DOUBLE, "nan")
    value = argument.python()
    assert isinstance(value, float)
    assert math.isnan(value)


def test_byte_word_and_dword_are_unsigned_integers() -> None:
    """AddByte, AddWord and AddDWord have no types of their own: they are UInt8, UInt16 and UInt32."""
    for kind, bits in ((T.UINT8, 8), (T.UINT16, 16), (T.UINT32, 32)):
        assert native_size(Argument.of(2**bits - 1, kind)) == bits // 8
        with pytest.raises(ArgumentError, match=rf"{2**bits} is outside 0\.\.{2**bits - 1} of {kind.name}"):
            Argument.of(2**bits, kind)


@pytest.mark.parametrize("kind", [T.INT8, T.INT16, T.INT32, T.INT64, T.UINT8, T.UINT16, T.UINT32, T.UINT64])
def test_an_integer_fits_its_type_or_is_refused(kind: ArgumentType) -> None:
    """The first and last value are taken, their neighbours outside are not; the message names value, range and type."""
    bits = 8 * native_size(Argument(kind, "0"))
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind.name.startswith("INT") else (0, 2**bits - 1)
    for value in (low, high):
        assert Argument.of(value, kind).python() == value
    for value in (low - 1, high + 1):
        with pytest.raises(ArgumentError, match=rf"{value} is outside {low}\.\.{high} of {kind.name}"):
            Argument.of(value, kind)


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (True, T.BOOLEAN),
        (0, T.INT32),
        (2**31 - 1, T.INT32),
        (2**31, T.INT64),
        (-(2**31) - 1, T.INT64),
        (2**63, T.UINT64),
        (1.0, T.DOUBLE),
        ("", T.UTF8_STRING),
        (b"", T.BLOB),
        (EventReference(1), T.EVENT_REFERENCE),
    ],
)
def test_without_a_type_the_value_chooses(value: Value, kind: ArgumentType) -> None:
    """bool is no integer here; an int takes the first of INT32, INT64, UINT64 that holds it."""
    assert Argument.of(value).type == kind


@pytest.mark.parametrize("value", [2**64, -(2**63) - 1])
def test_an_integer_beyond_64_bits_is_refused(value: int) -> None:
    """No argument type holds it."""
    with pytest.raises(ArgumentError, match="does not fit 64 bits"):
        Argument.of(value)


def test_what_is_no_argument_is_refused_with_its_type() -> None:
    """A list, None and the like are named."""
    with pytest.raises(ArgumentError, match="NoneType is no argument; expected bool, int, float, str, bytes, EventReference"):
        Argument.of(None)  # type: ignore[arg-type]


MISFITS: list[tuple[Value, ArgumentType]] = [
    (1, T.BOOLEAN),
    (True, T.INT32),
    (1.0, T.INT32),
    ("1", T.INT32),
    (True, T.DOUBLE),
    ("ab", T.CHAR),
    ("", T.CHAR),
    ("€", T.CHAR),
    ("🙂", T.WCHAR),
    (b"x", T.STRING),
    ("x", T.BLOB),
    (1, T.EVENT_REFERENCE),
    (-1, T.EXTERNAL_TIMESTAMP),
    (1e39, T.FLOAT),
    (10**400, T.DOUBLE),
    (EventReference(-1), T.EVENT_REFERENCE),
    (EventReference(2**32), T.EVENT_REFERENCE),
]


@pytest.mark.parametrize(("value", "kind"), MISFITS, ids=lambda item: str(item)[:20])
def test_a_value_of_another_type_is_refused(value: Value, kind: ArgumentType) -> None:
    """Nothing is converted silently, not even an int to a bool or a character that does not fit one byte."""
    with pytest.raises(ArgumentError):
        Argument.of(value, kind)


def test_an_integer_may_be_given_as_double() -> None:
    """A whole number is a double's value too, written as one."""
    assert Argument.of(3, T.DOUBLE) == Argument(T.DOUBLE, "3.0")


def test_a_float_is_rounded_to_single_precision() -> None:
    """REAL holds 0.1 as 0.10000000149011612; the text says what the receiver would have got."""
    (single,) = struct.unpack("<f", struct.pack("<f", 0.1))
    assert Argument.of(0.1, T.FLOAT) == Argument(T.FLOAT, repr(single))


def test_the_class_of_a_reference_is_spelled_once() -> None:
    """Upper case and braces are taken and written as on the wire; a class that is no GUID is refused."""
    assert Argument.of(EventReference(7, "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}")).value == f"{CLASS}#7"
    with pytest.raises(ValueError, match="'Motor' is no GUID"):
        Argument.of(EventReference(7, "Motor"))


def test_an_unknown_type_is_carried() -> None:
    """A type number from a newer TwinCAT keeps its number and its text, and counts as a text."""
    argument = Argument(99, "42")
    assert argument.known_type is None
    assert argument.python() == "42"
    assert native_size(argument) == 3
    assert Argument(T.INT8, "1").known_type is T.INT8


def test_a_type_is_a_16_bit_number() -> None:
    """TwinCAT keeps the type in 16 bits (facts 3.2); a larger number could not be written as msgpack and is no argument."""
    assert msgspec.json.decode(b'{"type":65535,"value":""}', type=Argument) == Argument(65535, "")
    for number in (b"65536", b"-1", b"9" * 30):
        with pytest.raises(msgspec.ValidationError):
            msgspec.json.decode(b'{"type":' + number + b',"value":""}', type=Argument)


@pytest.mark.parametrize(
    "argument",
    [
        Argument(T.BOOLEAN, "yes"),
        Argument(T.INT8, "128"),
        Argument(T.UINT8, "-1"),
        Argument(T.INT32, "1.0"),
        Argument(T.INT32, ""),
        Argument(T.INT64, "٣"),
        Argument(T.UINT64, "9" * 5000),
        Argument(T.DOUBLE, "fast"),
        Argument(T.EVENT_REFERENCE, "7"),
        Argument(T.EVENT_REFERENCE, "x#7"),
        Argument(T.EVENT_REFERENCE, "#-1"),
        Argument(T.EVENT_REFERENCE, "#4294967296"),
        Argument(T.BLOB, "no base64!"),
        Argument(T.BLOB, "AA="),
        Argument(T.BLOB, "ÄÄ=="),
    ],
    ids=str,
)
def test_a_text_that_does_not_fit_its_type_is_given_as_it_is(argument: Argument) -> None:
    """A foreign sender's fault is shown, not raised: the receiver still sees what was sent, and can measure it."""
    assert argument.python() == argument.value
    assert native_size(argument) >= 0


def test_a_guid_has_one_spelling() -> None:
    """Lower case, hyphens, no braces; upper case and braces are read."""
    assert guid("{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}") == guid("54CC5482-ad79-4cdc-8c3e-b3983b36ed66") == CLASS
    assert guid(ZERO_GUID) == ZERO_GUID


@pytest.mark.parametrize(
    "text", ["", "x", CLASS[:-1], CLASS + "0", "{" + CLASS, CLASS + "}", CLASS.replace("-", ""), CLASS + "\n"]
)
def test_what_is_no_guid_is_refused(text: str) -> None:
    """A half pair of braces, a digit too few or too many, a line end: the message shows one as it should be."""
    with pytest.raises(ValueError, match=r"is no GUID; expected e\.g\. 54cc5482-"):
        guid(text)


def test_a_lone_surrogate_can_be_measured() -> None:
    """Text that UTF-8 cannot hold counts three bytes a surrogate instead of failing."""
    assert native_size(Argument(T.UTF8_STRING, "\ud800")) == 4
    assert native_size(Argument(T.UTF16_STRING, "\ud800")) == 4
