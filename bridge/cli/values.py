"""What a person types, as values: arguments, classes, events, severities, sources.

Rule 1: an argument is VALUE or TYPE:VALUE. Without a type a number is a number, true and false are booleans, the rest is text.
Rule 2: an event class is a GUID or a name; a name that stands for several versions is refused and the versions are listed.
"""

import base64
import binascii
import re
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

from bridge.cli.exits import Usage
from bridge.core.arguments import Argument, ArgumentError, ArgumentType, EventReference, guid
from bridge.core.events import Severity, Source
from bridge.core.hresult import AdsError
from bridge.core.times import parse_time

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.texts import Texts

SeverityName: TypeAlias = Literal["verbose", "info", "warning", "error", "critical"]
TYPES: Final = {kind.name.lower(): kind for kind in ArgumentType if kind is not ArgumentType.UNDEFINED}
"""The types that --arg takes, by name."""
_ASK_S: Final = 3.0
"""Seconds to wait for what the bus knows of a class."""
_WORDS: Final = {"true": True, "false": False}
_FACTORS: Final = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_SIZE: Final = re.compile(r"(\d{1,15}(?:\.\d{1,9})?) ?([KMGT]?)B?", re.ASCII)
_TEXTS: Final = ("string", "wstring", "utf8_string", "utf16_string", "utf32_string", "format_string", "char", "wchar")


def argument(text: str) -> Argument:
    """VALUE or TYPE:VALUE as an argument. ArgumentError for a value that does not fit its type."""
    name, mark, rest = text.partition(":")
    kind = TYPES.get(name.lower()) if mark else None
    return _untyped(text) if kind is None else _typed(kind, rest)


def _untyped(text: str) -> Argument:
    if text in _WORDS:
        return Argument.of(_WORDS[text])
    for number in (int, float):
        try:
            return Argument.of(number(text))
        except ArgumentError:
            raise
        except ValueError:
            continue
    return Argument.of(text)


def _typed(kind: ArgumentType, text: str) -> Argument:
    try:
        match kind:
            case ArgumentType.BOOLEAN:
                return Argument.of(_WORDS.get(text.lower(), text), kind)
            case ArgumentType.FLOAT | ArgumentType.DOUBLE:
                return Argument.of(float(text), kind)
            case ArgumentType.EVENT_REFERENCE:
                event_class, _, number = text.rpartition("#")
                return Argument.of(EventReference(int(number), guid(event_class) if event_class else None), kind)
            case ArgumentType.BLOB | ArgumentType.ADS_NOTIFICATION_STREAM:
                return Argument.of(base64.b64decode(text, validate=True), kind)
            case _ if kind.name.lower() in _TEXTS:
                return Argument.of(text, kind)
            case _:
                return Argument.of(int(text, 0), kind)
    except ArgumentError:
        raise
    except (ValueError, binascii.Error):
        raise ArgumentError(f"{text!r} is no value of {kind.name}") from None


def class_guid(text: str, catalog: "Catalog") -> str:
    """The GUID of a class. ClassNameError for an unknown name, or for one with several versions, which it lists."""
    try:
        return guid(text)
    except ValueError:
        return catalog.newest(text).guid


def named_event(event_class: str, event_id: str, texts: "Texts", target: str) -> tuple[str, int]:
    """The GUID of a class and the id of an event, each given as such or by name; a class of no file is asked for on the bus.

    The errors are those of class_guid() and event_number().
    """
    from bridge.core.catalog import ClassNameError

    try:
        found = class_guid(event_class, texts.catalog)
    except ClassNameError:
        texts.guids(event_class)
        found = class_guid(event_class, texts.catalog)
    if found not in texts.catalog:
        with suppress(AdsError, TimeoutError):  # nobody knows it: a number is enough
            texts.request_class_name(found, target=target).result(_ASK_S)
    return found, event_number(event_id, found, texts.catalog)


def event_number(text: str, event_class: str, catalog: "Catalog") -> int:
    """The id of an event given by number or by its Name in the class."""
    try:
        number = int(text, 0)
    except ValueError:
        found = catalog.lookup(event_class)
        entry = found.named(text) if found is not None else None
        if entry is None:
            raise Usage(f"{text!r} is no event id and no event of that class") from None
        return entry.id
    if not 0 <= number < 2**32:
        raise Usage(f"event id {number} is outside 0..4294967295")
    return number


def severity(text: SeverityName | None, event_class: str, event_id: int, catalog: "Catalog") -> Severity:
    """The severity asked for, else that of the class, else info."""
    if text is not None:
        return Severity[text.upper()]
    entry = catalog.entry(event_class, event_id)
    return entry.severity if entry is not None else Severity.INFO


def source(name: str | None, number: int | None, source_guid: str | None) -> Source:
    """The source; what is not given is absent."""
    try:
        return Source(number, name, source_guid)
    except ValueError as error:
        raise Usage(str(error)) from None


def time_ns(text: str | None) -> int:
    """A time as Unix ns, 0 for "now"."""
    return parse_time(text) if text else 0


def size(text: str) -> int:
    """Bytes as a person writes them: 1000000, 100MB, 2GB; "" is 0."""
    match = _SIZE.fullmatch(text.strip().upper())
    if text and match is None:
        raise Usage(f"{text!r} is no size; expected e.g. 1000000, 100MB or 2GB")
    return 0 if match is None else int(float(match[1]) * _FACTORS[match[2]])
