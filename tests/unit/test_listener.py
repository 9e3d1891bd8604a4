"""A listener gives exactly what its filter takes, as an iterator, awaited or to callbacks, and keeps state beside it."""

import asyncio
import threading
from collections.abc import Iterator, Sequence

import msgspec
import pytest

from bridge import (
    AdsError,
    AlarmRaised,
    EventLogger,
    FilterSyntaxError,
    Listener,
    MessageSent,
    Publisher,
    Rejected,
    Severity,
    Source,
    TailUnknown,
    open_bus,
    where,
)
from bridge.core import codec, keys
from bridge.core.events import AlarmCleared, AlarmConfirmed, AnyEvent, Event
from bridge.core.sequence import Beat
from bridge.edges.bus import ALONE, Bus
from bridge.notices import Item
from bridge.testing.builders import alarm_raised
from tests.unit.logger.logger_stories import eventually

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "0a1b2c3d-0000-4000-8000-000000000001"


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


def test_what_the_filter_takes_and_nothing_else(bus: Bus) -> None:
    """By key and by content; what the key can tell does not even arrive."""
    with Listener(bus, (where.severity >= Severity.ERROR) & where.source_name.like("%Main%")) as listener:
        with Publisher(bus, "plc1") as publisher:
            for severity in Severity:
                for name in ("MAIN.fb", "other"):
                    publisher.send_message(CLASS, int(severity), severity, source=Source(name=name))
        got = listener.take(2)
        assert {(event.event_id, event.source_name) for event in got} == {(3, "MAIN.fb"), (4, "MAIN.fb")}
        assert listener.counters.received == 4


def test_a_bad_filter_raises_at_once(bus: Bus) -> None:
    """Text with a position, a pointer with its HRESULT."""
    with pytest.raises(FilterSyntaxError, match="did you mean 'severity'"):
        Listener(bus, "sevrity >= error")
    with pytest.raises(AdsError, match="ADS_E_INVALIDDATA"):
        Listener(bus, "json('axis') = 3")


def test_events_can_be_awaited(bus: Bus) -> None:
    """async for gives events as they come and ends when the listener is closed."""

    async def collect(listener: Listener) -> list[int]:
        numbers = []
        async for item in listener:
            assert isinstance(item, MessageSent)
            numbers.append(item.event_id)
            if len(numbers) == 20:
                break
        return numbers

    with Listener(bus) as listener, Publisher(bus, "plc1") as publisher:
        threading.Thread(
            target=lambda: [publisher.send_message(CLASS, number, Severity.INFO) for number in range(20)], daemon=True
        ).start()
        assert asyncio.run(asyncio.wait_for(collect(listener), 30)) == list(range(20))


def test_callbacks_say_whether_the_alarm_left_the_active_list(bus: Bus) -> None:
    """bRemove: false while something is still raised or waits, true when nothing is (manual 8.2.1)."""
    calls: list[tuple[str, bool | None]] = []
    disposed = threading.Event()

    class Observer:
        def on_message_sent(self, event: MessageSent) -> None:
            calls.append((event.kind, None))

        def on_alarm_raised(self, event: AlarmRaised) -> None:
            calls.append((event.kind, None))

        def on_alarm_cleared(self, event: AlarmCleared, removed: bool) -> None:
            calls.append((event.kind, removed))

        def on_alarm_confirmed(self, event: AlarmConfirmed, removed: bool) -> None:
            calls.append((event.kind, removed))

        def on_alarm_disposed(self, event: AnyEvent) -> None:
            calls.append((event.kind, None))
            disposed.set()

    with Listener(bus) as listener, EventLogger("plc1", bus=bus) as logger:
        listener.observe(Observer())
        logger.send_message(OTHER, 1, Severity.INFO)
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True).alarm
        logger.raise_alarm(alarm)
        logger.confirm_alarm(alarm)
        logger.clear_alarm(alarm)
        logger.raise_alarm(alarm)
        logger.clear_alarm(alarm)
        logger.confirm_alarm(alarm)
        logger.dispose_alarm(alarm)
        assert disposed.wait(20)
    by_alarm = [call for call in calls if call[0] != "message_sent"]
    assert ("message_sent", None) in calls
    assert by_alarm == [
        ("alarm_raised", None),
        ("alarm_confirmed", False),
        ("alarm_cleared", True),
        ("alarm_raised", None),
        ("alarm_cleared", False),
        ("alarm_confirmed", True),
        ("alarm_disposed", None),
    ]


def test_a_filtered_list_of_alarms_is_a_question_to_their_state(bus: Bus) -> None:
    """An alarm that stops matching leaves the list, though no event that matches says so."""
    with EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, json_attribute='{"axis":3}').alarm
        logger.raise_alarm(alarm)
        assert logger.publisher.flush()
        with Listener(bus, "json('/axis') = 3", with_state=True) as listener:
            assert [found.key for found in listener.alarms] == [alarm.key]
            logger.confirm_alarm(alarm, json_attribute='{"axis":4}')
            assert listener.wait_for_beat(logger.session)
            listener.settle()
            assert listener.alarms == []
            assert listener.get(0) is None


def test_a_transition_of_a_stranger_is_rejected(bus: Bus) -> None:
    """Only the logger of a target says what becomes of its alarms; the rejection is seen and state is not touched."""
    with EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR).alarm
        logger.raise_alarm(alarm)
        assert logger.publisher.flush()
        with Listener(bus, with_state=True) as listener:
            stranger = msgspec.structs.replace(
                alarm_raised(target="plc1", event_class=CLASS, severity=Severity.ERROR), session="stranger", seq=1, key_seq=1
            )
            bus.put(keys.event_key("live", stranger), codec.encode(stranger))
            item = listener.get(20)
            assert isinstance(item, Rejected)
            assert "stranger" in item.reason
            assert [found.key for found in listener.alarms] == [alarm.key]


def test_a_sender_that_vanishes_leaves_an_unknown_tail(bus: Bus) -> None:
    """Without its final beat nobody knows what it sent last; that is said, never "complete"."""
    beat = Beat(target="plc1", session="gone", seq=0)
    with Listener(bus) as listener:
        token = bus.alive(keys.verb_key("live", "plc1", "@alive", "publisher", "gone"))
        bus.put(keys.verb_key("live", "plc1", "@beat", "gone"), msgspec.json.encode(beat))
        assert listener.wait_for_beat("gone")
        token.close()
        assert listener.get(20) == TailUnknown("plc1", "gone")


def test_order_per_key_and_seq_restores_the_rest(bus: Bus) -> None:
    """Every key comes in its order; sorted by seq it is the order of sending."""
    with Listener(bus, on_full="wait") as listener, Publisher(bus, "plc1", on_full="wait") as publisher:
        sent = [publisher.send_message((CLASS, OTHER)[number % 2], number, Severity(number % 5)) for number in range(2000)]
        got = listener.take(2000, timeout_s=30)
    last: dict[str, int] = {}
    for event in got:
        key = keys.event_key("live", event)
        assert event.key_seq == last.get(key, 0) + 1
        last[key] = event.key_seq
    assert sorted(got, key=lambda event: event.seq) == sent


def test_events_of_other_realms_are_not_heard(bus: Bus) -> None:
    """A replay does not meet the plant."""
    with (
        Listener(bus, realm="replay-1") as listener,
        Publisher(bus, "plc1") as live,
        Publisher(bus, "plc1", realm="replay-1") as replay,
    ):
        live.send_message(CLASS, 1, Severity.INFO)
        replay.send_message(CLASS, 2, Severity.INFO)
        (event,) = listener.take(1)
        assert isinstance(event, Event)
        assert event.event_id == 2
        assert listener.get(0) is None


def test_no_thread_overtakes_another_on_the_way_to_the_queue(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a filter is replaced two subscriptions bring the same keys; what was taken in first is handed over first."""
    with Listener(bus) as listener, Publisher(bus, "plc1") as publisher:
        assert listener.wait_for_beat(publisher.session, timeout_s=30)
        held, overtaken = threading.Event(), threading.Event()
        put = listener._inbox.put

        def put_first_late(items: Sequence[Item]) -> None:
            if any(isinstance(item, Event) for item in items):
                if held.is_set():
                    overtaken.set()
                else:
                    held.set()
                    overtaken.wait(1.0)
            put(items)

        monkeypatch.setattr(listener._inbox, "put", put_first_late)
        publisher.send_message(CLASS, 1, Severity.INFO)
        assert held.wait(30)
        replacing = threading.Thread(target=listener.replace_filter, args=("event_id > 0",))
        replacing.start()
        assert eventually(lambda: len(listener._threads) > 2)
        publisher.send_message(CLASS, 2, Severity.INFO)
        replacing.join(30)
        numbers = [item.event_id for item in (listener.get(30), listener.get(30)) if isinstance(item, Event)]
        assert numbers == [1, 2]
        assert not replacing.is_alive()
