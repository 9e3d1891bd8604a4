"""Laws of the wire: what is encoded comes back, whole or in parts, and hostile bytes do no more harm than CodecError."""

import json
import random
from typing import cast

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.core import codec
from bridge.core.arguments import Argument, ArgumentType, EventReference, Value
from bridge.core.codec import ENCODINGS, JSON, MSGPACK, CodecError
from bridge.core.events import (
    KINDS,
    AnyEvent,
    ConfirmationState,
    LimitError,
    Limits,
    Origin,
    Severity,
    argument_bytes,
    check_limits,
    measure,
)
from bridge.core.keys import event_key, parse_event_key
from bridge.core.times import MAX_TIME_NS
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, alarm_raised, message_sent

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
guids = st.uuids().map(str)
u32 = st.integers(0, 2**32 - 1)
times = st.integers(0, MAX_TIME_NS)
counts = st.integers(0, 2**63 - 1)
values: st.SearchStrategy[Value] = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(allow_nan=False),
    texts,
    st.binary(max_size=20),
    st.builds(EventReference, u32, st.none() | guids),
)
arguments = st.lists(
    st.one_of(values.map(Argument.of), st.builds(Argument, st.integers(0, 25) | st.integers(0, 2**16 - 1), texts)), max_size=5
).map(tuple)


@st.composite
def events(draw: st.DrawFn) -> AnyEvent:
    """An event of any kind with any value in any field that the wire can carry."""
    kind = draw(st.sampled_from(KINDS))
    event = kind(
        target=draw(texts.filter(bool)),
        event_class=draw(guids),
        event_id=draw(u32),
        severity=draw(st.sampled_from(Severity)),
        session=draw(texts),
        seq=draw(counts),
        key_seq=draw(counts),
        time_ns=draw(times),
        source_id=draw(st.none() | u32),
        source_name=draw(st.none() | texts),
        source_guid=draw(st.none() | guids),
        arguments=draw(arguments),
        json_attribute=draw(texts),
        raised=draw(st.booleans()),
        confirmation_state=draw(st.sampled_from(ConfirmationState)),
        time_raised_ns=draw(times),
        time_cleared_ns=draw(times),
        time_confirmed_ns=draw(times),
        vendor_id=draw(st.none() | u32),
        product_code=draw(st.none() | u32),
        revision_no=draw(st.none() | u32),
        operator=draw(texts),
        client=draw(texts),
        comment=draw(texts),
        origin=draw(st.none() | st.builds(Origin, texts, texts, counts, counts)),
    )
    return cast(AnyEvent, event)


encodings = st.sampled_from(ENCODINGS)


@given(events(), encodings)
def test_an_event_comes_back(event: AnyEvent, encoding: str) -> None:
    """Kind and every field, exactly; under the key it belongs to it is taken."""
    element = codec.encode(event, encoding)
    assert codec.decode_one(element, encoding) == event
    decoded = codec.decode(codec.join([element], encoding), encoding, parse_event_key(event_key("live", event)))
    assert (decoded.events, decoded.rejected) == ([event], [])


@given(events())
def test_both_encodings_say_the_same(event: AnyEvent) -> None:
    """The same map of names and values, and the same event from either."""
    text, packed = codec.encode(event), codec.encode(event, MSGPACK)
    assert json.loads(text) == msgspec.msgpack.decode(packed)
    assert codec.decode_one(text) == codec.decode_one(packed, MSGPACK)


@given(st.lists(events(), max_size=6), encodings)
def test_split_undoes_join(many: list[AnyEvent], encoding: str) -> None:
    """A payload is taken apart into the very bytes that were joined, and decodes in order."""
    elements = [codec.encode(event, encoding) for event in many]
    payload = codec.join(elements, encoding)
    assert codec.split(payload, encoding) == elements
    assert codec.join(codec.split(payload, encoding), encoding) == payload
    assert codec.decode(payload, encoding).events == many


@given(st.lists(st.tuples(st.booleans(), events()), min_size=1, max_size=6), encodings)
def test_good_and_bad_elements_are_told_apart(many: list[tuple[bool, AnyEvent]], encoding: str) -> None:
    """The good ones come in order, the bad ones with their bytes, and nothing is counted twice or lost."""
    bad = codec.encode(message_sent(event_class="no GUID"), encoding)
    elements = [codec.encode(event, encoding) if good else bad for good, event in many]
    decoded = codec.decode(codec.join(elements, encoding), encoding)
    assert decoded.events == [event for good, event in many if good]
    assert [rejected.raw for rejected in decoded.rejected] == [bad for good, _ in many if not good]


@given(values)
def test_an_argument_gives_its_value_back(value: Value) -> None:
    """64-bit integers, floats to the last bit, bytes and references survive as text."""
    argument = Argument.of(value)
    assert argument.python() == value
    assert msgspec.json.decode(msgspec.json.encode(argument), type=Argument) == argument


@given(st.sampled_from(list(ArgumentType)), texts)
def test_any_text_under_any_type_can_be_read_and_measured(kind: ArgumentType, text: str) -> None:
    """A foreign sender's argument never raises: its value is Python's, or the text; its size is a number."""
    argument = Argument(int(kind), text)
    value = argument.python()
    assert value == text or type(value) in (bool, int, float, bytes, EventReference)
    assert argument_bytes((argument,)) >= 0


limits = st.builds(Limits, st.integers(120, 600), st.integers(0, 6), st.integers(0, 200), st.just(80))


@given(events(), limits)
def test_limits_are_exact(event: AnyEvent, allowed: Limits) -> None:
    """Whatever shortcut is taken: an event passes exactly when each of the four measures is within its limit."""
    measured = {
        "source_name_chars": len(event.source_name or ""),
        "arguments": len(event.arguments),
        "argument_bytes": argument_bytes(event.arguments),
        "event_bytes": measure(event),
    }
    over = {limit: size for limit, size in measured.items() if size > getattr(allowed, limit)}
    if not over:
        check_limits(event, allowed)
        return
    with pytest.raises(LimitError) as caught:
        check_limits(event, allowed)
    assert over[caught.value.limit] == caught.value.measured
    assert caught.value.allowed == getattr(allowed, caught.value.limit)


wide_texts = st.integers(0, 120).map("x".__mul__) | st.text(max_size=30)
wide_arguments = st.sampled_from(
    (ArgumentType.UTF32_STRING, ArgumentType.WSTRING, ArgumentType.INT64, ArgumentType.EVENT_REFERENCE)
).flatmap(lambda kind: st.lists(st.builds(Argument, st.just(int(kind)), wide_texts), max_size=9).map(tuple))
wide_limits = st.builds(Limits, st.integers(400, 5000), st.integers(0, 9) | st.just(128), st.integers(0, 900), st.just(80))


@settings(max_examples=1000)
@given(wide_arguments, wide_texts, st.none() | st.text(max_size=80), wide_limits, encodings)
def test_a_harmless_size_is_harmless(
    given: tuple[Argument, ...], json_attribute: str, source_name: str | None, allowed: Limits, encoding: str
) -> None:
    """Whoever is encoded no longer than a harmless event is within its limits, whatever its texts and arguments are."""
    smallest = message_sent(arguments=(), json_attribute="", source_name=None)
    event = msgspec.structs.replace(smallest, arguments=given, json_attribute=json_attribute, source_name=source_name)
    whole, beside_json = codec.harmless_sizes(smallest, encoding, allowed)
    try:
        size = len(codec.encode(event, encoding))
    except codec.CodecError:
        return
    if size <= whole and size - len(event.json_attribute) <= beside_json:
        check_limits(event, allowed)


# Hostile bytes.


def payloads() -> list[tuple[str, bytes]]:
    """Good payloads to spoil, short and long, in both encodings."""
    rich = alarm_raised(
        source_id=1,
        source_name="MAIN.Öl",
        source_guid=OTHER_CLASS,
        arguments=(Argument.of(1), Argument.of("x\n"), Argument.of(b"\0\xff")),
        json_attribute='{"a":[1,2.5e3,null,"\\u00e4"]}',
        origin=Origin("live", "s", 1, 2),
        comment="why",
    )
    lists: list[list[AnyEvent]] = [[message_sent()], [rich], [message_sent(), rich, message_sent(event_id=2**32 - 1)]]
    return [
        (encoding, codec.join([codec.encode(e, encoding) for e in many], encoding)) for encoding in ENCODINGS for many in lists
    ]


TOKENS = [b"[", b"]", b"{", b"}", b'"', b",", b":", b"\\", b"\\ud800", b"null", b"-1", b"1e999", b"9" * 25, b"\x00", b"\xff"]
TOKENS += [b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\x91" * 2000, b"[" * 2000, b"\xc1"]
TOKENS += [b"\xcf" + b"\xff" * 8, b"\xd3\x80" + b"\0" * 7, EVENT_CLASS.upper().encode()]


NASTY: list[object] = [None, True, -1, 0, 5, 2**31, 2**63, 1.5, -0.0, "", "x", "\0", "y" * 300, [], [[]], {}, [{}], {"type": 1}]
NASTY += [[{"type": kind, "value": value}] for kind in (-1, 0, 99, 2**16, "1", None) for value in ("1", 1, None)]


def misfilled(encoding: str, payload: bytes, chance: random.Random) -> bytes:
    """The payload, well formed, with one or two fields of one event left out or filled with something nasty."""
    decode = msgspec.json.decode if encoding == JSON else msgspec.msgpack.decode
    elements: list[dict[str, object]] = decode(payload)
    event = chance.choice(elements)
    for _ in range(chance.randint(1, 2)):
        field = chance.choice([*event, "source_id", "raised", "unknown"])
        if chance.randrange(4):
            event[field] = chance.choice(NASTY)
        else:
            event.pop(field, None)
    return msgspec.json.encode(elements) if encoding == JSON else msgspec.msgpack.encode(elements)


def mutated(encoding: str, payload: bytes, chance: random.Random) -> bytes:
    """The payload with fields misfilled, or with one or two places changed, cut, doubled or filled with something nasty."""
    if chance.randrange(2):
        return misfilled(encoding, payload, chance)
    spoiled = bytearray(payload)
    for _ in range(chance.randint(1, 2)):
        at = chance.randrange(len(spoiled) + 1)
        match chance.randrange(6):
            case 0:
                spoiled[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                del spoiled[at : at + chance.randint(1, 20)]
            case 2:
                spoiled[at:at] = chance.choice(TOKENS)
            case 3:
                spoiled[at : at + chance.randint(1, 8)] = chance.choice(TOKENS)
            case 4:
                spoiled[at:at] = spoiled[at : at + chance.randint(1, 60)]
            case _:
                del spoiled[at:]
    return bytes(spoiled)


@pytest.mark.parametrize("seed", range(4))
def test_hostile_bytes_raise_codec_error_and_nothing_else(seed: int) -> None:
    """20,000 spoiled payloads: split() and decode() agree on which can be taken apart and into how many, decode_one() on
    which elements are events, and what was taken can be measured, keyed and sent on in either encoding."""
    chance = random.Random(seed)
    good = payloads()
    taken = rejected = refused = 0
    for _ in range(5000):
        encoding, payload = chance.choice(good)
        payload = mutated(encoding, payload, chance)
        try:
            elements = codec.split(payload, encoding)
        except CodecError:
            refused += 1
            with pytest.raises(CodecError):
                codec.decode(payload, encoding)
            continue
        decoded = codec.decode(payload, encoding)
        assert len(decoded.events) + len(decoded.rejected) == len(elements)
        taken += len(decoded.events)
        rejected += len(decoded.rejected)
        singles = []
        for element in elements:
            try:
                singles.append(codec.decode_one(element, encoding))
            except CodecError:
                continue
        assert singles == decoded.events
        for event in decoded.events:
            for other in ENCODINGS:
                assert codec.decode_one(codec.encode(event, other), other) == event
            for argument in event.arguments:
                argument.python()
    assert min(taken, rejected, refused) > 500


@settings(max_examples=300)
@given(st.binary(max_size=60), encodings)
def test_any_bytes_raise_codec_error_and_nothing_else(payload: bytes, encoding: str) -> None:
    """Bytes that never were a payload."""
    try:
        decoded = codec.decode(payload, encoding, parse_event_key(event_key("live", message_sent())))
    except CodecError:
        return
    assert decoded.events == []


@pytest.mark.parametrize("encoding", [*ENCODINGS, "", "application/cbor", JSON.upper()])
def test_an_encoding_is_known_or_refused(encoding: str) -> None:
    """The two spellings and no others."""
    if encoding in ENCODINGS:
        assert codec.decode(codec.encode(message_sent(), encoding), encoding).events == [message_sent()]
    else:
        with pytest.raises(CodecError):
            codec.decode(codec.encode(message_sent()), encoding)
