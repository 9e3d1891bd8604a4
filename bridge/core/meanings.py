"""What a return code means: all readings of a number, or of a name.

Rule 1: a number is an HRESULT with or without its sign, an ADS return code, or Windows' number; what fits twice has several
meanings, in this order: ADS, HRESULT, Windows. So 2 is ERR_NORTIME of ADS and ERROR_FILE_NOT_FOUND of Windows.
Rule 2: numbers are decimal, 0x712, or as a PLC writes them, 16#712.
Rule 3: names are those of the manuals (ADSERR_DEVICE_NOTFOUND), of the interfaces (ADS_E_NOTFOUND), of Windows and Winsock, and
of the events (NotFound), in any case. An event's name may be that of several codes.
"""

import difflib
from collections.abc import Iterator
from typing import Final

import msgspec

from bridge.core import hresult
from bridge.core.builtin import WIN32, builtin_catalog
from bridge.core.conversion import WIN32_FACILITY, hresult_ads_err_to_event_entry, win32_to_event_entry
from bridge.core.events import EventDefinition

_PRINTED: Final = {"ADSERR_DEVICE_NOMOREHDLS": "ADS_E_NOMOREHDL"}
"""Names that the EventLogger manual writes in another way."""


class Meaning(msgspec.Struct, frozen=True):
    """One thing that a code means: its name, text, the forms of the code that exist, and its event.

    short_name is ADS_E_X for ADSERR_DEVICE_X, else the name. hresult is unsigned; ads_code and win32 are None when it is
    none of ADS, or of Windows. The text is an English sentence.
    """

    name: str
    short_name: str
    text: str
    hresult: int | None = None
    ads_code: int | None = None
    win32: int | None = None
    event: EventDefinition | None = None


class CodeNameError(LookupError):
    """A text that is neither a number nor the name of a code; `similar` are names like it."""

    def __init__(self, name: str, similar: tuple[str, ...]) -> None:
        self.name, self.similar = name, similar
        hint = f", did you mean {' or '.join(similar)}?" if similar else "; expected e.g. 0x98110712, 1810 or ADS_E_NOTFOUND"
        super().__init__(f"{name!r} is no code and no name of one{hint}")


def meanings(text: str) -> tuple[Meaning, ...]:
    """What a code means that somebody typed or pasted, by the rules of this page; () for a number without a known meaning.

    CodeNameError.
    """
    number = _number(text)
    if number is not None:
        return tuple(_of_number(number))
    name = text.strip().upper()
    found = tuple(dict.fromkeys(each for known, each in _names() if known.upper() == name))
    if not found:
        names = {known.upper(): known for known, _ in _names()}
        raise CodeNameError(text, tuple(names[each] for each in difflib.get_close_matches(name, names, n=3)))
    return found


def _number(text: str) -> int | None:
    plain = text.strip().lower()
    sign, digits = ("-", plain[1:]) if plain.startswith("-") else ("", plain)
    try:
        return int(sign + digits.removeprefix("16#"), 16) if digits.startswith("16#") else int(plain, 0)
    except ValueError:
        return None


def _of_number(number: int) -> Iterator[Meaning]:
    if 0 <= number <= 0xFFFF and (row := hresult.lookup(hresult.from_ads(number))) is not None:
        yield _of_row(row)
    if not -(2**31) <= number < 2**32:
        return
    if (row := hresult.lookup(number)) is not None:
        yield _of_row(row)
    if (entry := win32_to_event_entry(number)) is not None:
        yield _of_win32(entry)


def _of_row(row: hresult.Code) -> Meaning:
    text = f"{row.text[0].upper()}{row.text[1:]}."
    return Meaning(row.name, row.short_name, text, row.code, row.ads_code, None, hresult_ads_err_to_event_entry(row.code))


def _of_win32(entry: EventDefinition) -> Meaning:
    found = builtin_catalog().entry(WIN32, entry.event_id)
    name, text = (found.name, found.display_text) if found is not None else ("", "")
    return Meaning(name, name, text, WIN32_FACILITY | entry.event_id if entry.event_id else 0, None, entry.event_id, entry)


def _names() -> Iterator[tuple[str, Meaning]]:
    for row in hresult.CODES:
        meaning = _of_row(row)
        yield row.name, meaning
        yield row.short_name, meaning
        if row.name in _PRINTED:
            yield _PRINTED[row.name], meaning
        if meaning.event is not None and (entry := builtin_catalog().entry(*meaning.event[:2])) is not None:
            yield entry.name, meaning
    for entry in builtin_catalog().newest("Win32EventClass").events.values():
        yield entry.name, _of_win32(EventDefinition(WIN32, entry.id, entry.severity))
