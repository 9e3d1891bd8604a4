"""What an event's text is filled with: typed arguments as exact text.

Rule 1: an argument is a type number and a text. The text is exact: 64-bit integers, NaN, Inf and base64 survive JSON readers.
Rule 2: an unknown type number is carried, not dropped; its value is the text as it came.
Rule 3: native_size() is what the argument occupies in TwinCAT's packed argument data, whatever the encoding on our wire.

Source: TcEventArgumentType of the PLC library 3.1.33 (numbers 0..23); BYTE, WORD and DWORD are UInt8, UInt16 and UInt32.
Text forms: Boolean "true"/"false"; integers decimal; Float and Double repr ("1.5", "nan", "inf"); Char and WChar one
character; event reference "<guid>#<id>" or "#<id>"; external timestamp FILETIME ticks; blobs and notification streams base64.
"""

import base64
import binascii
import math
import re
import struct
from enum import IntEnum
from typing import Annotated, Final, TypeAlias

import msgspec

_GUID: Final = re.compile(r"\{?([0-9a-fA-F]{8}-[0-9a-fA-F]{4}-[0-9a-fA-F]{4}-[0-9a-fA-F]{4}-[0-9a-fA-F]{12})\}?")
_INTEGER: Final = re.compile(r"-?[0-9]{1,20}")
ZERO_GUID: Final = "00000000-0000-0000-0000-000000000000"


def guid(text: str) -> str:
    """The one spelling of a GUID: lower case, hyphens, no braces. ValueError when it is none."""
    match = _GUID.fullmatch(text)
    if match is None or (text[:1] == "{") != (text[-1:] == "}"):
        raise ValueError(f"{text!r} is no GUID; expected e.g. 54cc5482-ad79-4cdc-8c3e-b3983b36ed66")
    return match.group(1).lower()


class ArgumentType(IntEnum):
    """TcEventArgumentType with the manual's numbers."""

    UNDEFINED = 0
    BOOLEAN = 1
    INT8 = 2
    INT16 = 3
    INT32 = 4
    INT64 = 5
    UINT8 = 6
    UINT16 = 7
    UINT32 = 8
    UINT64 = 9
    FLOAT = 10
    DOUBLE = 11
    CHAR = 12
    WCHAR = 13
    STRING = 14
    WSTRING = 15
    EVENT_REFERENCE = 16
    FORMAT_STRING = 17
    EXTERNAL_TIMESTAMP = 18
    BLOB = 19
    ADS_NOTIFICATION_STREAM = 20
    UTF8_STRING = 21
    UTF16_STRING = 22
    UTF32_STRING = 23


_T = ArgumentType
_KNOWN: Final = {int(t): t for t in ArgumentType}
_RANGES: Final[dict[ArgumentType, tuple[int, int]]] = {
    _T.INT8: (-(2**7), 2**7 - 1),
    _T.INT16: (-(2**15), 2**15 - 1),
    _T.INT32: (-(2**31), 2**31 - 1),
    _T.INT64: (-(2**63), 2**63 - 1),
    _T.UINT8: (0, 2**8 - 1),
    _T.UINT16: (0, 2**16 - 1),
    _T.UINT32: (0, 2**32 - 1),
    _T.UINT64: (0, 2**64 - 1),
    _T.EXTERNAL_TIMESTAMP: (0, 2**64 - 1),
}
_FIXED_SIZE: Final[dict[int, int]] = {
    _T.UNDEFINED: 0,
    _T.BOOLEAN: 1,
    _T.INT8: 1,
    _T.INT16: 2,
    _T.INT32: 4,
    _T.INT64: 8,
    _T.UINT8: 1,
    _T.UINT16: 2,
    _T.UINT32: 4,
    _T.UINT64: 8,
    _T.FLOAT: 4,
    _T.DOUBLE: 8,
    _T.CHAR: 1,
    _T.WCHAR: 2,
    _T.EXTERNAL_TIMESTAMP: 8,
}
_TEXTS: Final = (_T.STRING, _T.WSTRING, _T.FORMAT_STRING, _T.UTF8_STRING, _T.UTF16_STRING, _T.UTF32_STRING)
_BYTES: Final = (_T.BLOB, _T.ADS_NOTIFICATION_STREAM)


class EventReference(msgspec.Struct, frozen=True):
    """Another event as an argument: its translated text is inserted. Without a class it is of the same class."""

    event_id: int
    event_class: str | None = None


Value: TypeAlias = bool | int | float | str | bytes | EventReference
"""What an argument is in Python."""


class ArgumentError(ValueError):
    """A value that does not fit its argument type; names both."""


def _text_of(kind: ArgumentType, value: Value) -> str:
    if kind in _RANGES and isinstance(value, int) and not isinstance(value, bool):
        low, high = _RANGES[kind]
        if low <= value <= high:
            return str(value)
        raise ArgumentError(f"{value} is outside {low}..{high} of {kind.name}")
    match kind, value:
        case _T.BOOLEAN, bool():
            return "true" if value else "false"
        case ((_T.FLOAT | _T.DOUBLE), (float() | int())) if not isinstance(value, bool):
            try:
                number = float(value)
                if kind is _T.FLOAT and math.isfinite(number):
                    (number,) = struct.unpack("<f", struct.pack("<f", number))
            except OverflowError:
                raise ArgumentError(f"{value!r} is outside the range of {kind.name}") from None
            return repr(number)
        case ((_T.CHAR | _T.WCHAR), str()) if len(value) == 1 and ord(value) < (256 if kind is _T.CHAR else 65536):
            return value
        case _T.EVENT_REFERENCE, EventReference():
            if not 0 <= value.event_id < 2**32:
                raise ArgumentError(f"event id {value.event_id} is outside 0..4294967295")
            return f"{guid(value.event_class) if value.event_class is not None else ''}#{value.event_id}"
        case _, str() if kind in _TEXTS or kind is _T.UNDEFINED:
            return value
        case _, bytes() if kind in _BYTES:
            return base64.b64encode(value).decode("ascii")
    raise ArgumentError(f"{value!r} is no value of {kind.name}")


class Argument(msgspec.Struct, frozen=True, gc=False):
    """One typed argument. `type` is a 16-bit number because unknown types are carried; `value` is its exact text."""

    type: Annotated[int, msgspec.Meta(ge=0, le=2**16 - 1)]
    value: str

    @classmethod
    def of(cls, value: Value, type: ArgumentType | None = None) -> "Argument":
        """Make an argument from a Python value; ArgumentError when it does not fit.

        Without a type: bool is BOOLEAN, int the first of INT32, INT64, UINT64 that holds it, float DOUBLE, str UTF8_STRING,
        bytes BLOB, EventReference EVENT_REFERENCE.
        """
        return cls(int(kind := _default_type(value) if type is None else type), _text_of(kind, value))

    @property
    def known_type(self) -> ArgumentType | None:
        """The type, or None when its number is not in the table."""
        return _KNOWN.get(self.type)

    def python(self) -> Value:
        """The value in Python. A text that does not fit its type (a foreign sender's fault) is returned as it is."""
        kind = _KNOWN.get(self.type)
        text = self.value
        try:
            if kind in _RANGES:
                low, high = _RANGES[kind]
                return int(text) if _INTEGER.fullmatch(text) and low <= int(text) <= high else text
            match kind:
                case _T.BOOLEAN:
                    return {"true": True, "false": False}.get(text, text)
                case _T.FLOAT | _T.DOUBLE:
                    return float(text)
                case _T.EVENT_REFERENCE:
                    class_text, mark, id_text = text.rpartition("#")
                    if not mark or not _INTEGER.fullmatch(id_text) or not 0 <= int(id_text) < 2**32:
                        return text
                    return EventReference(int(id_text), guid(class_text) if class_text else None)
                case _T.BLOB | _T.ADS_NOTIFICATION_STREAM:
                    return base64.b64decode(text, validate=True)
        except (ValueError, binascii.Error):
            return text
        return text


def _default_type(value: Value) -> ArgumentType:
    match value:
        case bool():
            return _T.BOOLEAN
        case int():
            for kind in (_T.INT32, _T.INT64, _T.UINT64):
                if _RANGES[kind][0] <= value <= _RANGES[kind][1]:
                    return kind
            raise ArgumentError(f"{value} does not fit 64 bits")
        case float():
            return _T.DOUBLE
        case str():
            return _T.UTF8_STRING
        case bytes():
            return _T.BLOB
        case EventReference():
            return _T.EVENT_REFERENCE
        case _:
            raise ArgumentError(f"{type(value).__name__} is no argument; expected bool, int, float, str, bytes, EventReference")


def utf8_size(text: str) -> int:
    """Bytes of the text in UTF-8; a lone surrogate counts three, as CESU would write it."""
    return len(text) if text.isascii() else len(text.encode("utf-8", "surrogatepass"))


def native_size(argument: Argument) -> int:
    """Bytes of the argument in TwinCAT's packed argument data; strings count their terminator, blobs a 4-byte length."""
    fixed = _FIXED_SIZE.get(argument.type)
    if fixed is not None:
        return fixed
    text = argument.value
    match _KNOWN.get(argument.type):
        case _T.WSTRING | _T.UTF16_STRING:
            return len(text.encode("utf-16-le", "surrogatepass")) + 2
        case _T.UTF32_STRING:
            return 4 * len(text) + 4
        case _T.EVENT_REFERENCE:
            return 4 if text.startswith("#") else 20
        case _T.BLOB | _T.ADS_NOTIFICATION_STREAM:
            return 4 + len(text) * 3 // 4 - text[-2:].count("=")
        case _:
            return utf8_size(text) + 1
