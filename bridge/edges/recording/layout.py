"""What stands where in a recording: the names, schemas and bodies that writer and reader share.

    channel /{target}/{event_class}           events of one target and class as JSON, with the JSON Schema of an event
    channel /{target}/{event_class}/msgpack   the same as msgpack, without a schema (no viewer reads msgpack)
    channel /rejected                         payloads that could not be decoded, with their key and the reason; no schema
    channel /gaps                             what is known to be missing, at the place where it is missing
    channel /state                            keyframes: all alarms of a logger, taken atomically with its session and seq
    channels /log, /alarms                    the same once more for viewers: texts, and spans of finished alarms (viewer.py)
    metadata tcbridge                         who recorded what, written when the file is opened
    metadata tcbridge.summary                 what the file holds, written when it is finished
    metadata tcbridge.recovered               where a recovered file came from
    attachments                               the JSON Schema of an event, and the class files handed to the writer

Rule 1: one message is one event with the bytes that were on the wire; log_time is the arrival and grows strictly,
publish_time the event's own time (log_time when it has none), sequence the low 32 bits of key_seq. A message for viewers has
the log_time of the one it speaks of.
Rule 2: every message that refers to a channel stands in a chunk, and every chunk has a CRC.
Rule 3: realm, target, class and encoding of a channel are in its metadata; with the event they give the whole key.
"""

import os
from typing import Any, Final, Literal, TypeAlias

import msgspec

from bridge.core import codec
from bridge.core.alarms import Alarm
from bridge.core.events import Count
from bridge.core.keys import Selection, escape, expression

PROFILE: Final = "tcbridge"
ACTIVE_SUFFIX: Final = ".active"
REJECTED_TOPIC: Final = "/rejected"
GAPS_TOPIC: Final = "/gaps"
STATE_TOPIC: Final = "/state"
LOG_TOPIC: Final = "/log"
ALARMS_TOPIC: Final = "/alarms"
VIEWER_SCHEMAS: Final = {LOG_TOPIC: "foxglove.Log", ALARMS_TOPIC: "foxglove.Event"}
VIEWER_TOPICS: Final = tuple(VIEWER_SCHEMAS)
ABOUT_METADATA: Final = "tcbridge"
SUMMARY_METADATA: Final = "tcbridge.summary"
RECOVERED_METADATA: Final = "tcbridge.recovered"
SCHEMA_ATTACHMENT: Final = "event.schema.json"

MESSAGE_ENCODINGS: Final = {codec.JSON: "json", codec.MSGPACK: "msgpack"}
"""The wire's encoding and MCAP's name for it."""
WIRE_ENCODINGS: Final = {name: encoding for encoding, name in MESSAGE_ENCODINGS.items()}

MAX_ELEMENT_BYTES: Final = 1 << 20
"""The largest encoded event a recording takes; native limits (8,192 bytes) keep real ones far below."""
MAX_REJECTED_BYTES: Final = 1 << 20
"""What is kept of a payload that could not be decoded; its whole size is noted beside it."""
MAX_ATTACHMENT_BYTES: Final = 32 << 20
MAX_CHUNK_BYTES: Final = 64 << 20
"""The largest chunk that is read, packed and unpacked; it bounds the memory a damaged file can claim."""
ALARMS_PER_MESSAGE: Final = 1000
"""A keyframe with more alarms is written in parts."""
MAX_EVENT_CHANNELS: Final = 60_000
"""MCAP numbers channels with 16 bits; events beyond go to /rejected rather than being lost."""

Completeness: TypeAlias = Literal["yes", "no", "tail unknown"]
Compression: TypeAlias = Literal["zstd", "lz4", "none"]


class RecordingError(OSError):
    """A recording that cannot be written or read: which file, and why."""

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        self.path, self.reason = os.fspath(path), reason
        super().__init__(f"{self.path}: {reason}")


def plain(text: str) -> str:
    """The text with lone surrogates (a file name or host name that is not UTF-8) replaced by "?"."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode()


class EventChannel(msgspec.Struct, frozen=True, gc=False):
    """What the metadata of an event channel says."""

    realm: str
    target: str
    event_class: str
    encoding: str

    @property
    def topic(self) -> str:
        """The channel's topic. The realm is not in it, so that a viewer's layout fits live and replayed recordings."""
        topic = f"/{escape(self.target)}/{self.event_class}"
        return topic if self.encoding == codec.JSON else f"{topic}/{MESSAGE_ENCODINGS[self.encoding]}"

    def metadata(self) -> dict[str, str]:
        """The metadata written with the channel."""
        return {
            "realm": self.realm,
            "target": self.target,
            "event_class": self.event_class,
            "encoding": self.encoding,
            "wire": str(codec.WIRE),
            "key": expression(self.realm, Selection(self.target, self.event_class)),
        }


def event_channel(message_encoding: str, metadata: dict[str, str]) -> EventChannel | None:
    """The event channel that this metadata describes; None when it is not one of ours."""
    encoding = WIRE_ENCODINGS.get(message_encoding)
    names = [metadata.get(name) for name in ("realm", "target", "event_class")]
    if encoding is None or not all(names):
        return None
    realm, target, event_class = names
    return EventChannel(realm or "", target or "", event_class or "", encoding)


class About(msgspec.Struct, frozen=True, kw_only=True):
    """Who recorded what: the metadata record `tcbridge`. `more` is written beside the named entries.

    recording is the same in all files of one recording, part counts them from 1 (0: not told), previous is the file before.
    """

    started_ns: Count = 0
    version: str = ""
    host: str = ""
    realm: str = ""
    filter: str = ""
    comment: str = ""
    recording: str = ""
    part: Count = 0
    previous: str = ""
    more: dict[str, str] = {}

    def metadata(self) -> dict[str, str]:
        """As MCAP metadata."""
        named = {name: str(getattr(self, name)) for name in _ABOUT_NAMES}
        texts = self.more | named | {"wire": str(codec.WIRE)}
        return {plain(name): plain(value) for name, value in texts.items()}

    @classmethod
    def of(cls, metadata: dict[str, str]) -> "About":
        """Back from MCAP metadata; entries that are missing or wrong are left at their defaults."""
        texts = {name: metadata.get(name, "") for name in _ABOUT_NAMES if name not in _ABOUT_NUMBERS}
        started_ns, part = (_number(metadata.get(name, "")) for name in _ABOUT_NUMBERS)
        more = {name: value for name, value in metadata.items() if name not in _ABOUT_NAMES and name != "wire"}
        return cls(started_ns=started_ns, part=part, more=more, **texts)


_ABOUT_NAMES: Final = tuple(name for name in About.__struct_fields__ if name != "more")
_ABOUT_NUMBERS: Final = ("started_ns", "part")


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0


class Attachment(msgspec.Struct, frozen=True):
    """A file carried in a recording: class definitions, configuration."""

    name: str
    data: bytes
    media_type: str = "application/octet-stream"
    create_time_ns: Count = 0


class Gap(msgspec.Struct, frozen=True, kw_only=True):
    """What is known to be missing: numbers first..last of a session and key. A whole lost session has key "" and numbers 0."""

    session: str
    key: str
    first_key_seq: Count
    last_key_seq: Count
    count: Count
    reason: str = ""


class RejectedPayload(msgspec.Struct, frozen=True, kw_only=True):
    """A payload that could not be decoded. `size` is what came; `payload` holds at most MAX_REJECTED_BYTES of it."""

    key: str
    encoding: str
    payload: bytes
    size: Count
    reason: str


class StateFrame(msgspec.Struct, frozen=True, kw_only=True):
    """All alarms of a logger, as they were right after its event `seq`.

    last_seq: the greatest number of the session that is folded in besides, 0 for none; some between may be missing yet.
    """

    realm: str
    target: str
    session: str
    seq: Count
    alarms: tuple[Alarm, ...] = ()
    last_seq: Count = 0


class StatePart(StateFrame, frozen=True, kw_only=True):
    """One message of a keyframe: part 1..parts."""

    part: Count = 1
    parts: Count = 1


def object_schema(title: str, properties: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of an object of which every property is there."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, "type": "object"}
    return head | {"properties": properties, "required": list(properties)}


_TEXT: Final = {"type": "string"}
_COUNT: Final = {"type": "integer", "minimum": 0}


def event_schema() -> bytes:
    """The JSON Schema of an event channel."""
    return msgspec.json.encode(codec.schema())


def gap_schema() -> bytes:
    """The JSON Schema of /gaps."""
    numbers = dict.fromkeys(("first_key_seq", "last_key_seq", "count"), _COUNT)
    return msgspec.json.encode(object_schema("tcbridge.Gap", {"session": _TEXT, "key": _TEXT, **numbers, "reason": _TEXT}))


def state_schema() -> bytes:
    """The JSON Schema of /state."""
    names = dict.fromkeys(("realm", "target", "session"), _TEXT)
    numbers = dict.fromkeys(("seq", "last_seq", "part", "parts"), _COUNT)
    alarms = {"alarms": {"type": "array", "items": codec.schema_of(Alarm)}}
    return msgspec.json.encode(object_schema("tcbridge.State", names | numbers | alarms))
