"""Placeholders of a text and what an argument looks like in their place (manual 5.7; what it leaves open is decided here).

  {0} {1} ...        the argument; an argument that is missing leaves the placeholder as it is written
  {0,d} {0,x}        an integer in decimal or hexadecimal, the latter without prefix, negative ones in two's complement of
                     their type, so INT16 -1 is ffff
  {0,e} {0,f}        an integer or floating-point number with six decimals, as C's printf writes it; {0,X}, {0,E}: capitals
  a format that is unknown or does not fit the argument: the argument as without a format
  {eventID}          the event's id; takes a format. {eventclass}: the GUID. Both in any case
  other braces       stay as they are; there is no escape
  without a format   integers decimal; FLOAT and DOUBLE the shortest text that is exact, 42 for 42.0; an external timestamp
                     ISO 8601 in UTC; a blob its size, "<12 bytes>"; everything else, and what does not fit its type, its text

Surplus arguments and event references need the event class: bridge/core/catalog.py.
"""

import math
import re
import struct
from functools import lru_cache
from typing import Final

import msgspec

from bridge.core.arguments import Argument, ArgumentType
from bridge.core.times import TimeError, from_filetime, time_text


class Slot(msgspec.Struct, frozen=True):
    """A placeholder: as it is written, its name ("0", "eventid", "eventclass") and its format, "" when it has none."""

    written: str
    name: str
    format: str


_SLOT: Final = re.compile(r"\{([0-9]{1,4}|eventid|eventclass)(?:,([^{}]{0,16}))?\}", re.IGNORECASE | re.ASCII)
_WIDTHS: Final = {
    int(kind): bits
    for bits, kinds in {
        8: (ArgumentType.INT8, ArgumentType.UINT8),
        16: (ArgumentType.INT16, ArgumentType.UINT16),
        32: (ArgumentType.INT32, ArgumentType.UINT32),
    }.items()
    for kind in kinds
}


@lru_cache(maxsize=4096)
def template(text: str) -> tuple[str | Slot, ...]:
    """The plain parts of a text and its placeholders, in order."""
    parts: list[str | Slot] = []
    end = 0
    for match in _SLOT.finditer(text):
        name = match[1].lower()
        parts += (
            text[end : match.start()],
            Slot(match[0], str(int(name)) if name.isdecimal() else name, (match[2] or "").strip()),
        )
        end = match.end()
    return (*parts, text[end:])


def _formatted(argument: Argument, code: str) -> str | None:
    value = argument.python()
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    match code.lower():
        case "d" if isinstance(value, int):
            text = str(value)
        case "x" if isinstance(value, int):
            text = f"{value & (1 << _WIDTHS.get(argument.type, 64)) - 1 if value < 0 else value:x}"
        case "e":
            text = f"{value:e}"
        case "f":
            text = f"{value}.000000" if isinstance(value, int) else f"{value:f}"
        case _:
            return None
    return text.upper() if code.isupper() else text


def _float_text(value: float, single: bool) -> str:
    if single and math.isfinite(value):
        try:
            for digits in range(6, 10):
                short = f"{value:.{digits}g}"
                if struct.unpack("<f", struct.pack("<f", float(short)))[0] == value:
                    return short
        except OverflowError:  # a sender's FLOAT that is none
            pass
    return repr(value).removesuffix(".0")


def _plain(argument: Argument) -> str:
    value = argument.python()
    match argument.known_type, value:
        case (ArgumentType.FLOAT | ArgumentType.DOUBLE) as kind, float():
            return _float_text(value, kind is ArgumentType.FLOAT)
        case ArgumentType.EXTERNAL_TIMESTAMP, int():
            try:
                return time_text(from_filetime(value)) or argument.value
            except TimeError:
                return argument.value
        case _, bytes():
            return f"<{len(value)} bytes>"
    return argument.value


def argument_text(argument: Argument, code: str = "") -> str:
    """The argument in a placeholder with that format; an event reference is shown as it came."""
    text = _formatted(argument, code) if code else None
    return _plain(argument) if text is None else text
