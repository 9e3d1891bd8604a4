"""A publisher numbers, keeps and hands on; its own faults raise at the call."""

import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest

from bridge import Argument, LimitError, MessageSent, Publisher, Severity, Source, open_bus
from bridge.batches import Kept, find
from bridge.core import codec, keys
from bridge.core.sequence import Beat, Missing
from bridge.edges.bus import ALONE
from bridge.publisher import PublisherClosedError, QueueFullError
from bridge.testing.builders import alarm_raised

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


def test_numbers_of_the_session_and_of_each_key() -> None:
    """seq counts every event, key_seq those of one class, kind and severity."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", clock=lambda: 5) as publisher:
        sent = [publisher.send_message(CLASS, 1, severity) for severity in (Severity.INFO, Severity.ERROR, Severity.INFO)]
    assert [(event.seq, event.key_seq) for event in sent] == [(1, 1), (2, 1), (3, 2)]
    assert {event.session for event in sent} == {publisher.session}
    assert sent[0].time_ns == 5


def test_an_event_without_a_source_names_the_code_that_sent_it() -> None:
    """The qualified name of the calling code and the publisher's object id (manual 5.8); an empty source stays empty."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", object_id=0x08502000) as publisher:
        sent = publisher.send_message(CLASS, 1, Severity.INFO)
        empty = publisher.send_message(CLASS, 1, Severity.INFO, source=Source())
    assert sent.source_id == 0x08502000
    assert sent.source_name is not None
    assert sent.source_name.endswith("test_an_event_without_a_source_names_the_code_that_sent_it")
    assert empty.source == Source()


@pytest.mark.parametrize(
    ("field", "value"), [("event_id", -1), ("event_id", 2**32), ("time_ns", -5), ("vendor_id", -1), ("revision_no", 2**32)]
)
def test_a_number_out_of_range_raises_at_the_call(field: str, value: int) -> None:
    """The sender hears of it, not its receivers; nothing is numbered."""
    event = MessageSent(target="plc1", event_class=CLASS, event_id=1, severity=Severity.INFO, vendor_id=2)
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        with pytest.raises(ValueError, match=field):
            publisher.send(msgspec.structs.replace(event, **{field: value}))
        assert publisher.seq == 0


def test_over_a_limit_nothing_is_numbered() -> None:
    """A refused event leaves no gap."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        with pytest.raises(LimitError) as error:
            publisher.send_message(CLASS, 1, Severity.INFO, json_attribute="x" * 9000)
        assert error.value.field == "json_attribute"
        assert publisher.send_message(CLASS, 1, Severity.INFO).seq == 1


def test_another_target_is_refused() -> None:
    """Events go out under the publisher's own target only, also the second time for a key."""
    event = MessageSent(target="plc1", event_class=CLASS, event_id=1, severity=Severity.INFO)
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        publisher.send(event)
        with pytest.raises(ValueError, match="plc2"):
            publisher.send(msgspec.structs.replace(event, target="plc2"))


def test_what_was_sent_can_be_asked_for() -> None:
    """@sent gives a range of a key in order; without a range it tells how far the sender has numbered."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        sent = [publisher.send_message(CLASS, number, Severity.INFO) for number in range(10)]
        key = keys.event_key("live", sent[0])
        question = keys.verb_key("live", "plc1", "@sent", publisher.session)
        (answer,) = bus.ask(question, msgspec.json.encode(Missing(publisher.session, key, 3, 5)))
        assert codec.decode(answer.payload, answer.encoding).events == sent[2:5]
        (later,) = bus.ask(question, msgspec.json.encode(Missing(publisher.session, key, 3, 5, after_seq=4)))
        assert codec.decode(later.payload, later.encoding).events == sent[4:5]
        (numbers,) = bus.ask(question)
        assert msgspec.json.decode(numbers.payload, type=Beat).keys == {key: 10}
        (refusal,) = bus.ask(question, b"nonsense")
        assert refusal.error


def test_the_ring_forgets_the_oldest_and_says_so() -> None:
    """Beyond ring_events an event can no longer be had; an answer notes the last seq forgotten and the last number."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", ring_events=4) as publisher:
        sent = [publisher.send_message(CLASS, number, Severity.INFO) for number in range(10)]
        assert publisher.flush()  # what waits for the bus is held beside the ring
        missing = Missing(publisher.session, keys.event_key("live", sent[0]), 1, 10)
        (answer,) = bus.ask(keys.verb_key("live", "plc1", "@sent", publisher.session), msgspec.json.encode(missing))
    assert codec.decode(answer.payload, answer.encoding).events == sent[6:]
    assert answer.note == b"6 10"


def test_an_answer_about_the_ring_fits_what_it_notes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is given up while an answer is looked for is in it all the same: its note says that it is held."""

    def look_late(held: Iterable[Kept], missing: Missing) -> list[bytes]:
        for number in range(4):
            publisher.send_message(CLASS, number, Severity.INFO)
        assert publisher.flush()
        return find(held, missing)

    with open_bus(ALONE) as bus, Publisher(bus, "plc1", ring_events=6) as publisher:
        sent = [publisher.send_message(CLASS, number, Severity.INFO) for number in range(8)]
        assert publisher.flush()
        monkeypatch.setattr("bridge.publisher.find", look_late)
        missing = Missing(publisher.session, keys.event_key("live", sent[0]), 1, 8)
        (answer,) = bus.ask(keys.verb_key("live", "plc1", "@sent", publisher.session), msgspec.json.encode(missing))
    assert answer.note == b"2 8"
    assert codec.decode(answer.payload, answer.encoding).events == sent[2:]


class _Stalled:
    """A bus whose puts wait until let go."""

    def __init__(self, publisher: Publisher) -> None:
        self.go = threading.Event()
        self.stalled = threading.Event()
        publisher.send_message(CLASS, 0, Severity.VERBOSE)
        publisher.flush()
        (state,) = publisher._keys.values()
        assert state.sender is not None
        put = state.sender.put

        def wait_then_put(payload: bytes) -> None:
            self.stalled.set()
            self.go.wait(30)
            put(payload)

        state.sender.put = wait_then_put  # type: ignore[method-assign]
        publisher.send_message(CLASS, 0, Severity.VERBOSE)
        assert self.stalled.wait(10)


def test_a_full_queue_drops_the_oldest_messages_which_stay_in_the_ring() -> None:
    """Messages leave a full queue, alarm transitions do not; dropped ones can still be asked for."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", queue_events=4) as publisher:
        stalled = _Stalled(publisher)
        alarm = alarm_raised(target="plc1", event_class=CLASS, severity=Severity.ERROR)
        publisher.send(alarm)
        sent = [publisher.send_message(CLASS, number, Severity.INFO) for number in range(6)]
        assert publisher.counters.dropped == 3
        missing = Missing(publisher.session, keys.event_key("live", sent[0]), 1, 6)
        (answer,) = bus.ask(keys.verb_key("live", "plc1", "@sent", publisher.session), msgspec.json.encode(missing))
        assert codec.decode(answer.payload, answer.encoding).events == sent
        stalled.go.set()
        assert publisher.flush()
        assert publisher.counters.sent == 2 + 1 + 3


def test_a_queue_full_of_transitions_refuses_the_next() -> None:
    """When only transitions wait, another is refused before anything is numbered."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", queue_events=3) as publisher:
        stalled = _Stalled(publisher)
        alarm = alarm_raised(target="plc1", event_class=CLASS, severity=Severity.ERROR)
        for _ in range(3):
            publisher.send(alarm)
        seq = publisher.seq
        with pytest.raises(QueueFullError):
            publisher.send(alarm)
        assert publisher.seq == seq
        stalled.go.set()


def test_closing_never_hangs_and_says_what_was_not_sent() -> None:
    """With a bus that stands still close() returns in time, with the count of what waits and of what did not get through."""
    with open_bus(ALONE) as bus:
        publisher = Publisher(bus, "plc1")
        stalled = _Stalled(publisher)
        for number in range(5):
            publisher.send_message(CLASS, number, Severity.INFO, arguments=(Argument.of(number),))
        assert publisher.close(timeout_s=0.1) == 6
        with pytest.raises(PublisherClosedError):
            publisher.send_message(CLASS, 1, Severity.INFO)
        stalled.go.set()


def test_what_the_publishing_thread_has_taken_but_not_put_is_not_sent() -> None:
    """Several keys may be on their way to one put each when the bus stands still."""
    with open_bus(ALONE) as bus:
        publisher = Publisher(bus, "plc1")
        stalled = _Stalled(publisher)
        for severity in Severity:
            publisher.send_message(CLASS, 1, severity)
        stalled.stalled.clear()
        again, stalled.go = stalled.go, threading.Event()
        again.set()
        assert stalled.stalled.wait(10)
        assert publisher.close(timeout_s=0.1) == len(Severity)
        assert publisher.counters.sent == 2
        stalled.go.set()


def test_flush_waits_for_a_put_whatever_is_dropped_meanwhile() -> None:
    """Events that others send, and that the full queue drops, are not taken for those that are waited for."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", queue_events=4) as publisher:
        stalled = _Stalled(publisher)
        with ThreadPoolExecutor(1) as others:
            flushed = others.submit(publisher.flush)
            with pytest.raises(TimeoutError):
                flushed.result(0.05)
            for _ in range(10):
                publisher.send_message(CLASS, 1, Severity.INFO)
            with pytest.raises(TimeoutError):
                flushed.result(0.2)
            stalled.go.set()
            assert flushed.result(30)


def test_a_lone_surrogate_is_refused_at_the_call() -> None:
    """Text that is not UTF-8 cannot go out; nothing is numbered."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        with pytest.raises(codec.CodecError):
            publisher.send_message(CLASS, 1, Severity.INFO, json_attribute="\ud800")
        assert publisher.seq == 0
