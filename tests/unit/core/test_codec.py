"""The wire: events as bytes and back, payloads of several, and what becomes of bytes that are none."""

import json

import msgspec
import pytest

from bridge.core import codec
from bridge.core.arguments import ZERO_GUID, Argument
from bridge.core.codec import ENCODINGS, JSON, MSGPACK, CodecError, Decoded, RejectedElement
from bridge.core.events import AnyEvent, Limits, Origin, Severity
from bridge.core.keys import EventKey, event_key, parse_event_key
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

EVENTS: list[AnyEvent] = [message_sent(), alarm_raised(), alarm_cleared(), alarm_confirmed(), alarm_disposed()]
MESSAGE = message_sent(event_id=7, arguments=(Argument.of(3),), source_name="")
ELEMENT = codec.encode(MESSAGE)
MESSAGE_KEY = parse_event_key(event_key("live", MESSAGE))


def changed(old: str, new: str) -> bytes:
    """The message's JSON with one place changed."""
    text = ELEMENT.decode()
    assert text.count(old) == 1
    return text.replace(old, new).encode()


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.kind)
def test_every_kind_comes_back(event: AnyEvent, encoding: str) -> None:
    """Each kind says what it is, in both encodings."""
    element = codec.encode(event, encoding)
    assert codec.decode_one(element, encoding) == event
    assert codec.decode(codec.join([element], encoding), encoding) == Decoded([event], [])


def test_json_is_what_a_person_reads() -> None:
    """Names as in the docs, defaults left out, arguments as type and exact text; absent is left out, empty is not."""
    assert json.loads(ELEMENT) == {
        "kind": "message_sent",
        "target": "plc1",
        "event_class": EVENT_CLASS,
        "event_id": 7,
        "severity": 1,
        "time_ns": 1_795_334_400_000_000_000,
        "source_name": "",
        "arguments": [{"type": 4, "value": "3"}],
    }


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_absent_and_empty_sources_stay_apart(encoding: str) -> None:
    """No id, 0, no name, "", no GUID and the zero GUID go over the wire as six things."""
    events = [
        message_sent(),
        message_sent(source_id=0),
        message_sent(source_name=""),
        message_sent(source_guid=ZERO_GUID),
        message_sent(source_id=0, source_name="", source_guid=ZERO_GUID),
    ]
    elements = [codec.encode(event, encoding) for event in events]
    assert len(set(elements)) == len(events)
    assert codec.decode(codec.join(elements, encoding), encoding).events == events


def test_msgpack_is_the_same_content() -> None:
    """Who reads msgpack finds the map that JSON has."""
    event = alarm_raised(origin=Origin("live", "s", 1, 2), arguments=(Argument.of("Öl"),))
    assert msgspec.msgpack.decode(codec.encode(event, MSGPACK)) == json.loads(codec.encode(event))


def test_a_lone_object_is_an_array_of_one() -> None:
    """A sender by hand need not write brackets; blanks around it do not matter in JSON."""
    for payload in (ELEMENT, b" \r\n\t" + ELEMENT + b" ", b"[" + ELEMENT + b"]", b" [ " + ELEMENT + b" ] "):
        assert codec.decode(payload).events == [MESSAGE]
    assert codec.decode(codec.encode(MESSAGE, MSGPACK), MSGPACK).events == [MESSAGE]


def test_an_empty_array_holds_nothing() -> None:
    """Nobody sends it; it is no reason to complain."""
    assert codec.decode(b"[]") == Decoded([], [])
    assert codec.split(b"\x90", MSGPACK) == []


@pytest.mark.parametrize("count", [1, 15, 16, 256, 65535, 65536])
def test_a_payload_of_many_is_taken_apart_into_the_bytes_that_were_joined(count: int) -> None:
    """Around the sizes where msgpack's array header changes."""
    assert codec.split(codec.join([b"\xc0"] * count, MSGPACK), MSGPACK) == [b"\xc0"] * count
    assert codec.split(codec.join([b"null"] * count)) == [b"null"] * count


def test_splitting_keeps_the_bytes() -> None:
    """A recorder writes what came: blanks inside an element, the order of its names, numbers as written."""
    odd = b'{ "b" : 1.50e1,"a":"\\u00e4" }'
    assert codec.split(b"[" + odd + b" , " + ELEMENT + b"]") == [odd, ELEMENT]
    assert codec.split(ELEMENT) == [ELEMENT]


def test_unknown_fields_are_passed_over() -> None:
    """A newer sender may say more."""
    assert codec.decode(changed('"kind"', '"new":[{"x":1}],"kind"')).events == [MESSAGE]


def test_null_is_absent_where_a_field_may_be_absent() -> None:
    """Some languages write null for what is not there; where something must be there it is no event."""
    assert codec.decode(changed('"source_name":""', '"source_name":null,"source_id":null,"origin":null')).events == [
        msgspec.structs.replace(MESSAGE, source_name=None)
    ]
    assert codec.decode(changed('"event_id":7', '"event_id":null')).rejected[0].reason == (
        "Expected `int`, got `null` - at `$.event_id`"
    )


LONG, TIMES = "x" * 1020, "1795334400000000000"
GUID_EXPECTED = "is no GUID; expected e.g. 54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
NO_EVENTS = [
    ('"kind":"message_sent"', '"kind":"message"', "Invalid value 'message' - at `$.kind`"),
    ('"kind":"message_sent",', "", "Object missing required field `kind`"),
    ('"target":"plc1",', "", "Object missing required field `target`"),
    ('"event_id":7', '"event_id":4294967296', "Expected `int` <= 4294967295 - at `$.event_id`"),
    ('"event_id":7', '"event_id":-1', "Expected `int` >= 0 - at `$.event_id`"),
    ('"event_id":7', '"event_id":"7"', "Expected `int`, got `str` - at `$.event_id`"),
    ('"event_id":7', '"event_id":7.5', "Expected `int`, got `float` - at `$.event_id`"),
    ('"severity":1', '"severity":5', "Invalid enum value 5 - at `$.severity`"),
    (TIMES, "9223372036854775808", "Expected `int` <= 9223372036854775807 - at `$.time_ns`"),
    ('"type":4', '"type":65536', "Expected `int` <= 65535 - at `$.arguments[0].type`"),
    ('"value":"3"', '"value":3', "Expected `str`, got `int` - at `$.arguments[0].value`"),
    (EVENT_CLASS, EVENT_CLASS.upper(), f"event_class '{EVENT_CLASS.upper()}' is not in lower case without braces"),
    (EVENT_CLASS, "Motor", f"event_class: 'Motor' {GUID_EXPECTED}"),
    ('"source_name":""', '"source_guid":"x"', f"source_guid: 'x' {GUID_EXPECTED}"),
    ('"source_name":""', '"source_guid":""', f"source_guid: '' {GUID_EXPECTED}"),
    (
        '"source_name":""',
        f'"source_guid":"{{{EVENT_CLASS}}}"',
        f"source_guid '{{{EVENT_CLASS}}}' is not in lower case without braces",
    ),
    ('"source_name":""', f'"source_name":"{"x" * 256}"', "source_name: 256 is over the limit source_name_chars = 255"),
    (
        '{"type":4,"value":"3"}',
        f'{{"type":21,"value":"{LONG}"}},{{"type":21,"value":"xxx"}}',
        "arguments: 1025 is over the limit argument_bytes = 1024",
    ),
    ('"arguments"', f'"json_attribute":"{"x" * 9000}","arguments"', "json_attribute: 9140 is over the limit event_bytes"),
]


@pytest.mark.parametrize(("old", "new", "reason"), NO_EVENTS, ids=[f"{n}" for n in range(len(NO_EVENTS))])
def test_one_bad_element_does_not_cost_its_neighbours(old: str, new: str, reason: str) -> None:
    """It is rejected with its bytes and the reason; those before and after it are taken, in order."""
    bad = changed(old, new)
    after = codec.encode(alarm_raised())
    decoded = codec.decode(b"[" + ELEMENT + b"," + bad + b"," + after + b"]")
    assert decoded.events == [MESSAGE, alarm_raised()]
    (rejected,) = decoded.rejected
    assert rejected.raw == bad
    assert rejected.reason.startswith(reason)
    with pytest.raises(CodecError) as caught:
        codec.decode_one(bad)
    assert caught.value.reason == rejected.reason


def test_the_error_tells_the_place() -> None:
    """`path` leads to the field inside the element; without one it is empty."""
    with pytest.raises(CodecError) as caught:
        codec.decode_one(changed('"type":4', '"type":-4'))
    assert caught.value.path == "$.arguments[0].type"
    with pytest.raises(CodecError) as caught:
        codec.decode_one(b"{")
    assert caught.value.path == ""


@pytest.mark.parametrize(
    ("key", "field"),
    [
        (EventKey("live", "plc2", EVENT_CLASS, False, Severity.INFO), "target"),
        (EventKey("live", "plc1", OTHER_CLASS, False, Severity.INFO), "event_class"),
        (EventKey("live", "plc1", EVENT_CLASS, True, Severity.INFO), "kind"),
        (EventKey("live", "plc1", EVENT_CLASS, False, Severity.ERROR), "severity"),
    ],
)
def test_an_event_that_disagrees_with_its_key_is_rejected(key: EventKey, field: str) -> None:
    """Who put it there said two things; neither is believed. The realm is not in the event."""
    assert codec.decode(ELEMENT, JSON, key) == Decoded([], [RejectedElement(ELEMENT, f"{field} disagrees with the key")])
    assert codec.decode(ELEMENT, JSON, MESSAGE_KEY).events == [MESSAGE]


@pytest.mark.parametrize("spelling", [EVENT_CLASS.upper(), f"{{{EVENT_CLASS}}}"])
def test_another_spelling_of_the_class_disagrees_with_the_key(spelling: str) -> None:
    """The class in the payload is spelled as in the key, or it is another one to whoever compares texts."""
    decoded = codec.decode(changed(EVENT_CLASS, spelling), JSON, MESSAGE_KEY)
    assert decoded.rejected[0].reason == "event_class disagrees with the key"


def test_limits_can_be_wider() -> None:
    """A plant with longer source names sets them in senders and receivers."""
    name = "x" * 300
    element = codec.encode(message_sent(source_name=name))
    assert codec.decode(element).events == []
    assert codec.decode(element, limits=Limits(source_name_chars=300)).events[0].source_name == name
    assert codec.decode_one(element, limits=Limits(source_name_chars=300)).source_name == name


DEEP = 100_000
HOSTILE = [
    (JSON, b""),
    (JSON, b"{"),
    (JSON, b"["),
    (JSON, b"nonsense"),
    (JSON, ELEMENT + ELEMENT),
    (JSON, b"[" + ELEMENT + b",]"),
    (JSON, b"\xef\xbb\xbf" + ELEMENT),
    (JSON, b"\xff\xfe"),
    (JSON, b"[" * DEEP),
    (JSON, b'{"kind":' + b"[" * DEEP),
    (MSGPACK, b""),
    (MSGPACK, b"\xc1"),
    (MSGPACK, b"\xdd\xff\xff\xff\xff"),
    (MSGPACK, b"\x92\xc0"),
    (MSGPACK, b"\x91" * DEEP),
    (MSGPACK, ELEMENT),
    (JSON, codec.encode(MESSAGE, MSGPACK)),
]


@pytest.mark.parametrize(("encoding", "payload"), HOSTILE, ids=[str(n) for n in range(len(HOSTILE))])
def test_bytes_that_are_no_payload_raise_codec_error(encoding: str, payload: bytes) -> None:
    """Cut off, doubled, of the other encoding, claiming 4 thousand million elements, or a hundred thousand levels deep."""
    for function in (codec.split, codec.decode):
        with pytest.raises(CodecError):
            function(payload, encoding)
    with pytest.raises(CodecError):
        codec.decode_one(payload, encoding)


@pytest.mark.parametrize("payload", [b"null", b"1", b'"x"', b"[1]", b"[[]]", b"[null]", b"{}", b"[{}]", b"[true]"])
def test_a_payload_of_things_that_are_no_events_is_rejected_element_by_element(payload: bytes) -> None:
    """It can be taken apart, but holds no event."""
    decoded = codec.decode(payload)
    assert decoded.events == []
    assert len(decoded.rejected) == 1


def test_text_that_is_no_unicode_is_refused_both_ways() -> None:
    """A lone surrogate cannot be sent, and a payload that escapes one cannot be taken apart."""
    for encoding in ENCODINGS:
        with pytest.raises(CodecError, match="text is not encodable as UTF-8"):
            codec.encode(message_sent(comment="\ud800"), encoding)
    with pytest.raises(CodecError):
        codec.decode(changed('"source_name":""', '"source_name":"\\ud800"'))


def test_an_unknown_encoding_is_named() -> None:
    """Every function answers the same: which encoding it was, and which there are."""
    for call in (
        lambda: codec.encode(MESSAGE, "text/plain"),
        lambda: codec.join([ELEMENT], "text/plain"),
        lambda: codec.split(ELEMENT, "text/plain"),
        lambda: codec.decode(ELEMENT, "text/plain"),
        lambda: codec.decode_one(ELEMENT, "text/plain"),
    ):
        with pytest.raises(CodecError, match=r"'text/plain' is not one of application/json, application/vnd\.msgpack"):
            call()


def test_decoded_numbers_can_be_sent_on_in_either_encoding() -> None:
    """A number that msgpack cannot hold does not get in, so no gateway stumbles over it on the way out."""
    decoded = codec.decode(changed('"type":4', f'"type":{"9" * 30}'))
    assert decoded.events == []
    assert codec.decode(changed('"event_id":7', f'"event_id":{"9" * 400}')).events == []


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("change", "reason"),
    [({"source_name": "x" * 256}, "source_name_chars"), ({"source_guid": "{" + EVENT_CLASS + "}"}, "source_guid")],
)
def test_under_its_key_too_an_event_keeps_the_limits(encoding: str, change: dict[str, str], reason: str) -> None:
    """One that does not is rejected with the reason, and its neighbours are taken."""
    good = message_sent()
    bad = msgspec.structs.replace(good, **change)
    payload = codec.join([codec.encode(each, encoding) for each in (good, bad, good)], encoding)
    decoded = codec.decode(payload, encoding, parse_event_key(event_key("live", good)))
    assert decoded.events == [good, good]
    assert [reason in each.reason for each in decoded.rejected] == [True]
