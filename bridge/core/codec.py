"""The wire format: events as bytes and back.

Rule 1: a payload is an array of one or more events of one key, in order; a lone object counts as an array of one.
Rule 2: JSON or msgpack of the same structs; the sample's encoding says which, every reader takes both.
Rule 3: one bad element does not cost its neighbours: the list is decoded at once, and only if that fails element by element.
Rule 4: hostile bytes raise CodecError and nothing else. msgspec raises ValidationError, DecodeError, UnicodeDecodeError and
RecursionError on them (measured with 200,000 mutated payloads).
Rule 5: fields are only ever added, with defaults; unknown fields are ignored. Golden vectors hold the format still.
"""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final, TypeAlias, cast

import msgspec

from bridge.core.arguments import guid
from bridge.core.events import (
    DEFAULT_LIMITS,
    KIND_NAMES,
    AnyEvent,
    ConfirmationState,
    Event,
    LimitError,
    Limits,
    MessageSent,
    Severity,
    check_limits,
)
from bridge.core.keys import EventKey

WIRE: Final = 1
JSON: Final = "application/json"
MSGPACK: Final = "application/vnd.msgpack"
Encoding: TypeAlias = str
ENCODINGS: Final = (JSON, MSGPACK)

_GUID_CHARS: Final = 36
_HOSTILE: Final = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
_LIST_DECODERS: Final = {
    JSON: msgspec.json.Decoder(list[AnyEvent]).decode,
    MSGPACK: msgspec.msgpack.Decoder(list[AnyEvent]).decode,
}
_ONE_DECODERS: Final = {JSON: msgspec.json.Decoder(AnyEvent).decode, MSGPACK: msgspec.msgpack.Decoder(AnyEvent).decode}
_RAW_DECODERS: Final = {
    JSON: msgspec.json.Decoder(list[msgspec.Raw]).decode,
    MSGPACK: msgspec.msgpack.Decoder(list[msgspec.Raw]).decode,
}
_JSON_ARRAY: Final = re.compile(rb"[ \t\r\n]*\[")


class CodecError(ValueError):
    """Bytes that are no event or no payload; `reason` says what was wrong, `path` where in the element."""

    def __init__(self, reason: str) -> None:
        _, mark, path = reason.partition(" - at ")
        self.reason = reason
        self.path = path.strip("`") if mark else ""
        super().__init__(reason)


class RejectedElement(msgspec.Struct, frozen=True):
    """One element of a payload that is no event: its bytes and why."""

    raw: bytes
    reason: str


class Decoded(msgspec.Struct, frozen=True):
    """What a payload held."""

    events: list[AnyEvent]
    rejected: list[RejectedElement]


def _known(encoding: Encoding) -> Encoding:
    if encoding in ENCODINGS:
        return encoding
    raise CodecError(f"encoding {encoding!r} is not one of {', '.join(ENCODINGS)}")


_ENCODERS: Final = {JSON: msgspec.json.Encoder().encode, MSGPACK: msgspec.msgpack.Encoder().encode}


def encoder(encoding: Encoding = JSON) -> Callable[[AnyEvent], bytes]:
    """What encode() does for one encoding, for who sends many: it lets UnicodeEncodeError through, which no_text() words.

    CodecError for an unknown encoding.
    """
    return _ENCODERS[_known(encoding)]


def no_text(error: UnicodeEncodeError) -> CodecError:
    """What an encoder says of text that is not UTF-8 (lone surrogates), as our error."""
    return CodecError(f"text is not encodable as UTF-8: {error.reason}")


def encode(event: AnyEvent, encoding: Encoding = JSON) -> bytes:
    """One event as one element. CodecError for text that is not UTF-8 (lone surrogates) or an unknown encoding."""
    try:
        return encoder(encoding)(event)
    except UnicodeEncodeError as error:
        raise no_text(error) from None


def harmless_sizes(smallest: AnyEvent, encoding: Encoding = JSON, limits: Limits = DEFAULT_LIMITS) -> tuple[int, int]:
    """How long an event like `smallest`, but with texts and arguments, may be encoded before its limits have to be counted.

    (bytes in all, bytes beside the JSON attribute); the length of the source name is a limit of its own. In either encoding an
    argument takes at least 15 bytes and one per character, natively at most 24 and four per character; any other text natively
    takes at most four per character, and what every event has less than a quarter of what it takes encoded.
    """
    bare = len(encode(smallest, encoding))
    return limits.event_bytes // 4, bare + min(limits.argument_bytes // 4, 15 * limits.arguments)


def join(elements: Sequence[bytes], encoding: Encoding = JSON) -> bytes:
    """Elements of one key as a payload, in order."""
    if encoding == JSON:
        return b"[" + b",".join(elements) + b"]"
    _known(encoding)
    count = len(elements)
    if count < 16:
        head = bytes((0x90 | count,))
    elif count < 65536:
        head = b"\xdc" + count.to_bytes(2, "big")
    else:
        head = b"\xdd" + count.to_bytes(4, "big")
    return head + b"".join(elements)


def _is_array(payload: bytes, encoding: Encoding) -> bool:
    if encoding == JSON:
        return _JSON_ARRAY.match(payload) is not None
    return bool(payload) and (payload[0] & 0xF0 == 0x90 or payload[0] in (0xDC, 0xDD))


def split(payload: bytes, encoding: Encoding = JSON) -> list[bytes]:
    """The elements of a payload as the bytes that came, undecoded. CodecError when it cannot be taken apart."""
    _known(encoding)
    try:
        if not _is_array(payload, encoding):
            _ONE_RAW[encoding](payload)
            return [payload]
        return [bytes(raw) for raw in _RAW_DECODERS[encoding](payload)]
    except _HOSTILE as error:
        raise CodecError(str(error)) from None


_ONE_RAW: Final = {JSON: msgspec.json.Decoder(msgspec.Raw).decode, MSGPACK: msgspec.msgpack.Decoder(msgspec.Raw).decode}


def decode_one(element: bytes, encoding: Encoding = JSON, limits: Limits = DEFAULT_LIMITS) -> AnyEvent:
    """One element as an event, within the limits. CodecError says why not."""
    _known(encoding)
    try:
        event = cast(AnyEvent, _ONE_DECODERS[encoding](element))
        reason = _fault(event, None, limits)
    except _HOSTILE as error:
        raise CodecError(str(error)) from None
    if reason:
        raise CodecError(reason)
    return event


def _fault(event: Event, key: EventKey | None, limits: Limits) -> str:
    """Why a decoded event cannot be taken; "" when it can."""
    if key is None:
        if fault := _guid_fault("event_class", event.event_class):
            return fault
    elif (
        event.event_class != key.event_class
        or event.severity is not key.severity
        or event.is_alarm is not key.is_alarm
        or event.target != key.target
    ):
        return f"{key.disagreement(event)} disagrees with the key"
    if event.source_guid is not None and (fault := _guid_fault("source_guid", event.source_guid)):
        return fault
    try:
        check_limits(event, limits)
    except LimitError as error:
        return str(error)
    return ""


def _all_good(events: list[AnyEvent], key: EventKey, limits: Limits) -> bool:
    """Whether every event is one of this key and within the limits, or LimitError: _fault() spelled out for many events."""
    target, event_class, is_alarm, severity = key.target, key.event_class, key.is_alarm, key.severity
    for event in events:
        if (
            event.event_class != event_class
            or event.target != target
            or event.severity is not severity
            or event.is_alarm is not is_alarm
            or event.source_guid is not None
        ):
            return False
        check_limits(event, limits)
    return True


@lru_cache(maxsize=4096)
def _is_canonical(text: str) -> bool:
    try:
        return guid(text) == text
    except ValueError:
        return False


def _guid_fault(field: str, text: str) -> str:
    if len(text) == _GUID_CHARS and _is_canonical(text):  # other lengths are not worth their memory
        return ""
    try:
        return "" if guid(text) == text else f"{field} {text!r} is not in lower case without braces"
    except ValueError as error:
        return f"{field}: {error}"


def decode(payload: bytes, encoding: Encoding = JSON, key: EventKey | None = None, limits: Limits = DEFAULT_LIMITS) -> Decoded:
    """The events of a payload, and the elements that are none (undecodable, over a limit, or disagreeing with their key).

    CodecError when the payload cannot be taken apart at all.
    """
    rejected: list[RejectedElement] = []
    try:
        if encoding == JSON and payload[:1] != b"[" and not _is_array(payload, encoding):
            events = [cast(AnyEvent, _ONE_DECODERS[JSON](payload))]
        else:
            events = _LIST_DECODERS[encoding](payload)
        if _all_good(events, key, limits) if key is not None else not any(_fault(event, None, limits) for event in events):
            return Decoded(events, rejected)
    except (*_HOSTILE, KeyError, LimitError):
        pass
    events = []
    for raw in split(payload, encoding):
        try:
            event = cast(AnyEvent, _ONE_DECODERS[encoding](raw))
            reason = _fault(event, key, limits)
        except _HOSTILE as error:
            rejected.append(RejectedElement(raw, str(error)))
            continue
        if reason:
            rejected.append(RejectedElement(raw, reason))
        else:
            events.append(event)
    return Decoded(events, rejected)


_ENUMS: Final = {"Severity": Severity, "ConfirmationState": ConfirmationState}


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """JSON Schema of a struct: everything inlined, one plain type per property."""
    (root,), parts = msgspec.json.schema_components([kind], ref_template="{name}")
    return cast(dict[str, Any], _inlined(parts[cast(str, root["$ref"])], parts))


def schema() -> dict[str, Any]:
    """JSON Schema of one event: root inlined, no $ref, one plain type per property, as Foxglove's parser wants it."""
    event = schema_of(MessageSent)
    event["properties"]["kind"] = {"type": "string", "enum": list(KIND_NAMES)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "tcbridge.Event",
        "description": f"One event of tcbridge, wire format {WIRE}",
        "type": "object",
        "properties": event["properties"],
        "required": event["required"],
    }


def _inlined(node: Any, parts: dict[str, Any]) -> Any:  # noqa: ANN401 - a JSON Schema is any JSON
    if isinstance(node, list):
        return [_inlined(item, parts) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        name = node["$ref"]
        if name in _ENUMS:
            members = [{"title": member.name, "const": int(member)} for member in _ENUMS[name]]
            return {"type": "integer", "oneOf": members}
        return _inlined(parts[name], parts)
    if "anyOf" in node:
        (plain,) = [item for item in node["anyOf"] if item != {"type": "null"}]
        return _inlined(plain, parts)
    return {
        name: _inlined(value, parts)
        for name, value in node.items()
        if name not in ("default", "title", "description")
        or (name == "default" and value not in (None, []))
        or isinstance(value, dict)
    }
