"""A running listener's filter is replaced without losing an event: real buses, a stream that never stops."""

import threading

import pytest

from bridge import MessageSent, Publisher, Severity, open_bus
from bridge.core.filters.text import FilterSyntaxError
from bridge.edges.bus import ALONE, BusConfig
from bridge.listener import Gap, Listener
from bridge.logger import EventLogger

A, B, C = (f"00000000-0000-0000-0000-00000000000{digit}" for digit in "abc")
AB, BC = f"event_class in ({A}, {B})", f"event_class in ({B}, {C})"


def send(publisher: Publisher, event_class: str, number: int) -> MessageSent:
    """One message."""
    return publisher.send_message(event_class, number, Severity.INFO)


@pytest.mark.parametrize("rounds", [3])
def test_replacing_loses_nothing_of_a_stream(bus_config: BusConfig, rounds: int) -> None:
    """Classes A, B and C are sent without a stop while the filter goes from A and B to B and C and back, several times.

    Of B, which both take, every event comes, once and in order, and nothing is called missing. Of the class that is new,
    every event sent after the replacing returned comes.
    """
    stop = threading.Event()
    sent = {A: 0, B: 0, C: 0}

    with (
        open_bus(bus_config) as theirs,
        open_bus(bus_config) as ours,
        Publisher(theirs, "plc1") as publisher,
        Listener(ours, AB) as listener,
    ):
        assert publisher.wait_for_listener(30)
        send(publisher, B, 0)
        assert listener.wait_for_beat(publisher.session, timeout_s=30)

        def stream() -> None:
            while not stop.wait(0.0005):
                for event_class in sent:
                    sent[event_class] += 1
                    send(publisher, event_class, sent[event_class])

        sender = threading.Thread(target=stream)
        sender.start()
        promised: list[tuple[str, int]] = []
        try:
            for number in range(rounds * 2):
                now, gone = ((C, A), (A, C))[number % 2]
                assert listener.replace_filter((BC, AB)[number % 2]) == []
                first = sent[now] + 1
                while sent[now] < first + 100:
                    assert sender.is_alive()
                    stop.wait(0.01)
                promised.extend((now, wanted) for wanted in range(first, first + 100))
                assert gone != now
        finally:
            stop.set()
            sender.join(30)
        send(publisher, B, sent[B] + 1)
        assert publisher.flush(30)
        listener.settle(30)
        listener.close()
        items = list(listener)
    numbers: dict[str, list[int]] = {A: [], B: [], C: []}
    for item in items:
        assert not isinstance(item, Gap), item
        assert isinstance(item, MessageSent)
        numbers[item.event_class].append(item.event_id)
    assert numbers[B] == list(range(sent[B] + 2))
    for event_class in (A, C):
        assert numbers[event_class] == sorted(set(numbers[event_class]))
        taken = set(numbers[event_class])
        assert {wanted for name, wanted in promised if name == event_class} <= taken
    assert listener.counters.missing == 0


def test_what_the_new_filter_leaves_out_comes_no_more() -> None:
    """After the return no event of a class that only the old filter took is handed over; what was queued before stays."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher, Listener(bus, AB) as listener:
        send(publisher, A, 1)
        assert [event.event_id for event in listener.take(1, 30)] == [1]
        listener.replace_filter(BC)
        for event_class in (A, B, C):
            send(publisher, event_class, 2)
        assert publisher.flush(30)
        assert {event.event_class for event in listener.take(2, 30)} == {B, C}
        assert listener.get(0) is None
        assert listener.filter == Listener(bus, BC).filter


def test_a_bad_filter_changes_nothing() -> None:
    """It raises, and the old one goes on."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher, Listener(bus, AB) as listener:
        before = listener.filter
        with pytest.raises(FilterSyntaxError):
            listener.replace_filter("event_class is")
        assert listener.filter == before
        send(publisher, B, 7)
        assert [event.event_id for event in listener.take(1, 30)] == [7]


def test_the_target_of_a_listener_stays() -> None:
    """A listener of one target does not hear another one through a new filter."""
    with (
        open_bus(ALONE) as bus,
        Publisher(bus, "plc1") as one,
        Publisher(bus, "plc2") as other,
        Listener(bus, AB, target="plc1") as listener,
    ):
        listener.replace_filter(None)
        send(other, C, 1)
        assert other.flush(30)
        send(one, C, 2)
        assert [event.target for event in listener.take(1, 30)] == ["plc1"]


def test_a_wider_filter_brings_the_alarms_that_were_there() -> None:
    """State is asked again: what was raised while nobody looked is in the list, and stays current."""
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus) as logger:
        pump = logger.create_alarm(A, 1, Severity.ERROR).alarm
        assert pump is not None
        with Listener(bus, f"event_class = {B}", with_state=True) as listener:
            logger.raise_alarm(pump)
            assert listener.alarms == []
            listener.replace_filter(f"event_class = {A}")
            assert [alarm.event_id for alarm in listener.alarms] == [1]
            logger.clear_alarm(pump)
            assert any(event.kind == "alarm_cleared" for event in listener.events())
            assert listener.alarms == []


def test_from_one_target_to_another() -> None:
    """Beats and tokens of the new target are followed, so that its losses can be found."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc2") as publisher, Listener(bus, "target = 'plc1'") as listener:
        listener.replace_filter("target = 'plc2'")
        send(publisher, A, 1)
        assert listener.wait_for_beat(publisher.session, timeout_s=30)
        assert [event.target for event in listener.take(1, 30)] == ["plc2"]


def test_what_was_not_wanted_meanwhile_is_not_missing() -> None:
    """A class is left and wanted again: what was sent between is neither a gap nor fetched."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher, Listener(bus, AB) as listener:
        send(publisher, A, 1)
        assert listener.wait_for_beat(publisher.session, timeout_s=30)
        assert [event.event_id for event in listener.take(1, 30)] == [1]
        assert listener.replace_filter(BC) == []
        send(publisher, A, 2)
        assert publisher.flush(30)
        assert listener.replace_filter(AB) == []
        send(publisher, A, 3)
        assert publisher.flush(30)
        assert [event.event_id for event in listener.take(1, 30)] == [3]
        assert (listener.counters.repaired, listener.counters.missing) == (0, 0)


def test_what_still_waits_behind_a_full_queue_is_judged_by_the_new_filter() -> None:
    """Two events were let through by the old one; three that nobody had looked at yet are not wanted any more."""
    pause = threading.Event()
    with (
        open_bus(ALONE) as bus,
        Publisher(bus, "plc1") as publisher,
        Listener(bus, AB, queue_events=1, on_full="wait") as listener,
    ):
        for number in (1, 2, 3, 4, 5):
            send(publisher, A, number)
            assert publisher.flush(30)
            for _ in range(3000):
                if listener.counters.received >= min(number, 2):
                    break
                pause.wait(0.01)
        assert listener.counters.received == 2
        listener.replace_filter(BC)
        send(publisher, B, 6)
        assert [event.event_id for event in listener.take(3, 30)] == [1, 2, 6]
