"""Events and alarms as rows, and back.

Rule 1: what SQLite cannot hold is refused here, at the call that brought it, and never reaches the writer: an integer outside
64 bits, a float where an integer belongs, a value of another type.
Rule 2: a text that is legal in Python is never refused. A lone surrogate becomes "?" in its column and stays exact in the body.
Rule 3: what went in comes out, also when it was over a limit: limits are judged where events come in, not here.
"""

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, TypeAlias, cast

import msgspec

from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.codec import JSON, CodecError, decode_one, encode
from bridge.core.events import AnyEvent, Limits

EVENT_COLUMNS: Final = (
    "unique_id",
    "arrival_ns",
    "kind",
    "is_alarm",
    "target",
    "session",
    "seq",
    "key_seq",
    "event_class",
    "event_id",
    "severity",
    "source_id",
    "source_name",
    "has_source_name",
    "source_guid",
    "json_attribute",
    "time_ns",
    "time_raised_ns",
    "time_cleared_ns",
    "time_confirmed_ns",
    "raised",
    "confirmation_state",
    "vendor_id",
    "product_code",
    "revision_no",
    "inexact_text",
    "body",
)
"""The columns of `events` in the order of event_row(), without id."""

EventRow: TypeAlias = tuple[int | str | bytes, ...]
AlarmRow: TypeAlias = tuple[bytes, str, int, bytes]
_UNLIMITED: Final = Limits(2**62, 2**62, 2**62, 9999)
_MISSING: Final = -1
_NUMBERS: Final = struct.Struct("15q")
"""Refuses what SQLite would refuse later: other types than int, and more than 64 bits."""
_MAX: Final = 2**63 - 1


class RowError(ValueError):
    """A value that no column can hold, or a body that no event can be read from."""


class Stored(msgspec.Struct, frozen=True, gc=False):
    """An event to keep. arrival_ns is Unix ns; body is the event as codec.encode() wrote it in JSON, when the caller has it."""

    unique_id: int
    arrival_ns: int
    event: AnyEvent
    body: bytes = b""


class StoredEvent(msgspec.Struct, frozen=True, gc=False):
    """An event of the cache. row numbers the arrivals, is never used twice, and is what `after` and `before` take."""

    row: int
    unique_id: int
    arrival_ns: int
    event: AnyEvent


class StoredAlarm(msgspec.Struct, frozen=True, gc=False):
    """An alarm state to keep. unique_id is that of its life, 0 before it was first raised."""

    unique_id: int
    alarm: Alarm


class StoredAnswer(NamedTuple):
    """A command that was carried out: its digest, the session and number of its event (0: none), whether it made an alarm."""

    question: bytes
    session: str
    seq: int
    created: bool


class StoreBatch(msgspec.Struct, frozen=True):
    """What is kept together or not at all: events in order, then alarm states, then alarms that are gone, facts by name, and
    what became of commands."""

    events: Sequence[Stored] = ()
    alarms: Sequence[StoredAlarm] = ()
    removals: Sequence[AlarmKey] = ()
    meta: Mapping[str, str] = {}
    answers: Sequence[StoredAnswer] = ()


def _json(value: AnyEvent | Alarm | AlarmKey) -> bytes:
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        return json.dumps(msgspec.to_builtins(value)).encode("ascii")


def _utf8(text: str) -> str:
    return text.encode("utf-8", "replace").decode("utf-8")


def event_row(stored: Stored) -> EventRow:
    """The values of EVENT_COLUMNS. RowError names the event when one of them fits no column."""
    event = stored.event
    name, guid = event.source_name, event.source_guid
    texts: tuple[str, ...] = (event.target, event.session, event.event_class, name or "", guid or "", event.json_attribute)
    numbers = (
        stored.unique_id,
        stored.arrival_ns,
        event.seq,
        event.key_seq,
        event.event_id,
        int(event.severity),
        _MISSING if event.source_id is None else event.source_id,
        event.time_ns,
        event.time_raised_ns,
        event.time_cleared_ns,
        event.time_confirmed_ns,
        int(event.confirmation_state),
        _MISSING if event.vendor_id is None else event.vendor_id,
        _MISSING if event.product_code is None else event.product_code,
        _MISSING if event.revision_no is None else event.revision_no,
    )
    try:
        _NUMBERS.pack(*numbers)
        joined = "".join(texts)
    except (struct.error, TypeError) as error:
        raise RowError(f"{event!r}: {error}") from None
    inexact = False
    if not joined.isascii():
        encodable = tuple(map(_utf8, texts))
        inexact, texts = encodable != texts, encodable
    body = stored.body
    if not body:
        try:
            body = encode(event, JSON)
        except CodecError:
            body = _json(event)
    target, session, event_class, source_name, source_guid, json_attribute = texts
    return (
        *numbers[:2],
        *(event.kind, 1 if event.is_alarm else 0, target, session),
        *numbers[2:4],
        event_class,
        *numbers[4:7],
        *(source_name, 0 if name is None else 1, source_guid, json_attribute),
        *numbers[7:11],
        1 if event.raised else 0,
        *numbers[11:],
        *(1 if inexact else 0, body),
    )


def read_event(body: bytes) -> AnyEvent:
    """The event of a body. RowError when there is none in it."""
    try:
        return decode_one(body, JSON, _UNLIMITED)
    except CodecError:
        try:
            return cast(AnyEvent, msgspec.convert(json.loads(body), AnyEvent))
        except (ValueError, RecursionError, msgspec.MsgspecError) as error:
            raise RowError(f"no event in {body[:80]!r}: {error}") from None


def alarm_row(kept: StoredAlarm) -> AlarmRow:
    """key, target, unique_id and body of an alarm. RowError when the number is none that fits."""
    alarm = kept.alarm
    if not isinstance(kept.unique_id, int) or not 0 <= kept.unique_id <= _MAX:
        raise RowError(f"unique_id {kept.unique_id!r} of {alarm.key!r} is outside 0..{_MAX}")
    return key_bytes(alarm.key), _utf8(alarm.target), kept.unique_id, _json(alarm)


def key_bytes(key: AlarmKey) -> bytes:
    """The primary key of `alarms`: equal for equal keys and for no others, whatever text is in them."""
    return _json(key)


def read_alarm(body: bytes) -> Alarm:
    """The alarm of a body. RowError when there is none in it."""
    try:
        return msgspec.json.decode(body, type=Alarm)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        try:
            return msgspec.convert(json.loads(body), Alarm)
        except (ValueError, RecursionError, msgspec.MsgspecError) as error:
            raise RowError(f"no alarm in {body[:80]!r}: {error}") from None
