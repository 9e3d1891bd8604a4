"""What strangers put on the bus costs nobody anything: neither a crash nor a neighbour nor a wrong count."""

import random

from bridge import Argument, MessageSent, Rejected, Severity, open_bus
from bridge.core import codec, keys
from bridge.edges.bus import BusConfig
from bridge.listener import Listener
from bridge.publisher import Publisher

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
MUTATED = 10_000
GOOD = 1_000
STRANGE_KEYS = 2


def _mutated(dice: random.Random, seeds: list[tuple[bytes, str]]) -> tuple[bytes, str]:
    payload, encoding = dice.choice(seeds)
    data = bytearray(payload)
    for _ in range(dice.randrange(1, 6)):
        place = dice.randrange(len(data)) if data else 0
        match dice.randrange(5):
            case 0 if data:
                data[place] = dice.randrange(256)
            case 1:
                del data[place : place + dice.randrange(1, 20)]
            case 2:
                data[place:place] = dice.randbytes(dice.randrange(1, 8))
            case 3:
                data = data[:place]
            case _:
                data[place:place] = dice.choice([b"[" * 2000, b"\xff", b"\\ud800", b"1e999", b"null", b"{}", b",{}", b"\x00"])
    return bytes(data), dice.choice([encoding, encoding, encoding, *codec.ENCODINGS, "text/plain"])


def test_ten_thousand_mutated_payloads_among_good_ones(bus_config: BusConfig) -> None:
    """Nothing crashes, every good event arrives in order, and the counts are those the decoder gives offline."""
    dice = random.Random(20261122)
    event = MessageSent(
        target="plc1",
        event_class=CLASS,
        event_id=7,
        severity=Severity.ERROR,
        source_name="MAIN.fb",
        arguments=(Argument.of(1.5), Argument.of("axis")),
        json_attribute='{"axis":3}',
    )
    key = keys.event_key("live", event)
    parsed = keys.parse_event_key(key)
    seeds = [
        (codec.join([codec.encode(event, encoding)] * count, encoding), encoding)
        for encoding in codec.ENCODINGS
        for count in (1, 3)
    ]
    payloads = [_mutated(dice, seeds) for _ in range(MUTATED)]
    rejected_payloads = rejected_events = accepted = 0
    for payload, encoding in payloads:
        try:
            decoded = codec.decode(payload, encoding, parsed)
        except codec.CodecError:
            rejected_payloads += 1
        else:
            rejected_events += len(decoded.rejected)
            accepted += len(decoded.events)
    assert rejected_payloads > 1000
    assert rejected_events > 500
    assert accepted > 500

    with open_bus(bus_config) as theirs, open_bus(bus_config) as ours:
        listener = Listener(ours, on_full="wait", queue_events=1_000_000)
        with listener, Publisher(theirs, "plc1", on_full="wait") as publisher:
            assert publisher.wait_for_listener()
            assert listener.wait_for_beat(publisher.session)
            for number, (payload, encoding) in enumerate(payloads):
                theirs.put(key, payload, encoding)
                if number % (MUTATED // GOOD) == 0:
                    publisher.send_message(CLASS, 1, Severity.INFO, arguments=(number,))
            theirs.put("tc3/1/live/plc1/event/nonsense/message/error", seeds[0][0], codec.JSON)
            theirs.put("tc3/1/live/plc1/event/" + CLASS + "/message/terrible", seeds[0][0], codec.JSON)
            publisher.close()
            assert listener.wait_for_final(publisher.session)
            # What was put without a publisher is numbered by nobody: wait until it has all been drained.
            items = []
            while listener.counters.payloads < MUTATED + STRANGE_KEYS + publisher.counters.puts:
                items.append(listener.get(10))
                assert items[-1] is not None
        items.extend(listener)
        counters = listener.counters
    assert counters.rejected_payloads == rejected_payloads + STRANGE_KEYS
    assert counters.rejected_events == rejected_events
    assert sum(isinstance(item, Rejected) for item in items) == rejected_payloads + rejected_events + STRANGE_KEYS
    assert counters.received == accepted + GOOD
    good = [item for item in items if isinstance(item, MessageSent) and item.session == publisher.session]
    assert [item.seq for item in good] == list(range(1, GOOD + 1))
    assert counters.missing == 0


def test_good_events_pass_between_bad_ones(bus_config: BusConfig) -> None:
    """A numbered sender's events all arrive, in order, while another session puts rubbish on the same key."""
    with open_bus(bus_config) as theirs, open_bus(bus_config) as ours:
        with Listener(ours, on_full="wait") as listener, Publisher(theirs, "plc1", on_full="wait") as publisher:
            assert publisher.wait_for_listener()
            assert listener.wait_for_beat(publisher.session)
            for number in range(GOOD):
                sent = publisher.send_message(CLASS, number, Severity.INFO)
                theirs.put(keys.event_key("live", sent), b"[{]", codec.JSON)
            publisher.close()
            assert listener.wait_for_final(publisher.session)
        items = list(listener)
    assert [item.event_id for item in items if isinstance(item, MessageSent)] == list(range(GOOD))
    assert sum(isinstance(item, Rejected) for item in items) == listener.counters.rejected_payloads
    assert 0 < listener.counters.rejected_payloads <= GOOD
