"""Who joins late has the state at once, and who is slow has it all the same."""

import threading
import time

import pytest

from bridge import Listener, Severity, Source, open_bus
from bridge.core.alarms import Alarm, AlarmTable
from bridge.core.events import Event
from bridge.edges.bus import BusConfig
from bridge.inbox import Dropped
from bridge.logger import EventLogger

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
TRANSITIONS = 10_000
MOST = 500_000
JOINS = 50
ALARMS = 40


def _burst(logger: EventLogger, transitions: int, started: threading.Event, enough: threading.Event) -> None:
    """Raise, confirm and clear alarms of several keys until so many transitions are done and somebody has had enough."""
    alarms: list[Alarm] = []
    for number in range(ALARMS):
        source = Source(name=f"MAIN.axis{number}")
        alarm = logger.create_alarm(CLASS, number, Severity(number % 5), with_confirmation=number % 2 == 0, source=source).alarm
        assert alarm is not None
        alarms.append(alarm)
    started.set()
    done = 0
    while done < transitions or not enough.is_set():
        assert done < MOST
        for alarm in alarms:
            now = logger.get_alarm(alarm.event_class, alarm.event_id, alarm.source)
            match done % 3, now.raised:
                case _, False:
                    logger.raise_alarm(alarm, arguments=(done,))
                case 0, True if now.with_confirmation and now.is_active and not now.time_confirmed_ns:
                    logger.confirm_alarm(alarm)
                case _:
                    logger.clear_alarm(alarm, reset_confirmation=done % 7 == 0)
            done += 1
            if done >= transitions and enough.is_set():
                break


def _live(logger: EventLogger) -> AlarmTable:
    table = AlarmTable()
    table.load(logger.book.alarms.values())
    return table


def _same_in_the_end(listener: Listener, logger: EventLogger, timeout_s: float = 30) -> bool:
    """Whether the listener's state becomes the logger's, once it has taken in what was sent."""
    deadline = time.monotonic() + timeout_s
    want = _live(logger).state()
    while time.monotonic() < deadline:
        listener.settle()
        if listener.table.state() == want:
            return True
    return False


@pytest.mark.timeout(200)
def test_fifty_joins_in_the_middle_of_a_burst(bus_config: BusConfig) -> None:
    """A listener that joins while 10,000 transitions are on their way ends with the logger's state, 50 times of 50."""
    with open_bus(bus_config) as theirs, EventLogger("plc1", bus=theirs, on_full="wait") as logger:
        started, enough = threading.Event(), threading.Event()
        burst = threading.Thread(target=_burst, args=(logger, TRANSITIONS, started, enough))
        burst.start()
        assert started.wait(10)
        listeners: list[Listener] = []
        in_the_middle = 0
        with open_bus(bus_config) as ours:
            for _ in range(JOINS):
                joined_at = logger.publisher.seq
                listeners.append(Listener(ours, "is_alarm", with_state=True, queue_events=100))
                in_the_middle += burst.is_alive() and joined_at > 0
            enough.set()
            burst.join(150)
            assert not burst.is_alive()
            assert logger.publisher.seq >= TRANSITIONS
            assert in_the_middle == JOINS
            assert logger.publisher.flush()
            assert [_same_in_the_end(listener, logger) for listener in listeners] == [True] * JOINS
            for listener in listeners:
                assert listener.counters.missing == 0
                listener.close()


def test_a_slow_callback_costs_events_but_not_state(bus_config: BusConfig) -> None:
    """With a callback that stands still its listener's state is still the logger's, and Dropped is exact."""
    transitions, queue = 3_000, 100
    go_on = threading.Event()
    seen: list[Event] = []
    dropped: list[int] = []

    class Slow:
        """Stands still at its first event until told to go on."""

        def on_alarm_raised(self, event: Event) -> None:
            go_on.wait(60)
            seen.append(event)

        def on_alarm_cleared(self, event: Event, removed: bool) -> None:
            self.on_alarm_raised(event)

        def on_alarm_confirmed(self, event: Event, removed: bool) -> None:
            self.on_alarm_raised(event)

        def on_notice(self, notice: object) -> None:
            assert isinstance(notice, Dropped)
            dropped.append(notice.count)

    with open_bus(bus_config) as theirs, open_bus(bus_config) as ours, EventLogger("plc1", bus=theirs) as logger:
        with Listener(ours, "is_alarm", with_state=True, queue_events=queue) as listener:
            assert listener.wait_for_beat(logger.session)
            thread = listener.observe(Slow())
            enough = threading.Event()
            enough.set()
            _burst(logger, transitions, threading.Event(), enough)
            assert logger.publisher.flush()
            assert _same_in_the_end(listener, logger)
            assert not seen
            assert listener.dropped > 0
            go_on.set()
        thread.join(10)
    assert len(seen) + sum(dropped) == transitions
    assert sum(dropped) == listener.dropped
    assert queue <= len(seen) <= queue + 64
    for severity in Severity:
        numbers = [event.key_seq for event in seen if event.severity is severity]
        assert numbers == sorted(set(numbers))
