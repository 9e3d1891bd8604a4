"""The clock jumps while events flow: order and uniqueness come from numbers, not from time."""

import threading
import time

import pytest

from bridge.core.events import AlarmEvent, Event, Severity, Source
from bridge.core.questions import LogQuestion
from bridge.edges.bus import BusConfig, open_bus
from bridge.listener import Listener
from bridge.logger import EventLogger
from tests.e2e.fault_stories import CLASS

HOUR_NS = 3_600_000_000_000


@pytest.mark.parametrize("jump_ns", [-HOUR_NS, 48 * HOUR_NS])
def test_the_clock_jumps_while_events_flow(jump_ns: int, bus_config: BusConfig) -> None:
    """Live, in the log and after it, events are in the order they were sent, each once; alarms are in their last state."""
    jumped = threading.Event()

    def clock() -> int:
        return time.time_ns() + (jump_ns if jumped.is_set() else 0)

    with (
        open_bus(bus_config) as one,
        open_bus(bus_config) as two,
        EventLogger("plc1", bus=one, clock=clock) as logger,
        Listener(two, target="plc1", with_state=True) as listener,
    ):
        assert listener.wait_for_beat(logger.session, timeout_s=30)
        alarm = logger.create_alarm(CLASS, 1, Severity.INFO, source=Source(name="MAIN"), with_confirmation=True).alarm
        assert alarm is not None
        for number in range(1000):
            if number == 500:
                jumped.set()
            if number % 10 == 0:
                (logger.clear_alarm if logger.is_raised(alarm) else logger.raise_alarm)(alarm)
            else:
                logger.send_message(CLASS, number, Severity.INFO, source=Source(name="MAIN"))
        heard = listener.take(1000, 30)
        assert len(heard) == 1000
        stored = list(logger.log(LogQuestion(newest_first=False)))
        newest = list(logger.log(LogQuestion(limit=5)))
        for key_class in (True, False):  # a listener promises order per key
            mine = [event.seq for event in heard if event.is_alarm == key_class]
            assert mine == sorted(mine)
        assert sorted(event.seq for event in heard) == list(range(1, 1001))
        assert [entry.event.seq for entry in stored] == list(range(1, 1001))
        assert [entry.event.seq for entry in newest] == [1000, 999, 998, 997, 996]
        messages = [entry.unique_id for entry in stored if not entry.event.is_alarm]
        assert len(set(messages)) == len(messages)
        lives: dict[int, list[Event]] = {}
        for entry in stored:
            if entry.event.is_alarm:
                lives.setdefault(entry.unique_id, []).append(entry.event)
        assert all(len(life) <= 2 for life in lives.values())  # raised, cleared; each raise is a life of its own
        assert not set(lives) & set(messages)
        assert listener.table.state() == logger.book.logbook.table.state()
        transitions = [event for event in heard if isinstance(event, AlarmEvent)]
        assert listener.table.alarms[alarm.key].time_ns == transitions[-1].time_ns
        for is_alarm in (True, False):
            times = [entry.event.time_ns for entry in stored if entry.event.is_alarm == is_alarm]
            assert times == sorted(times)
        assert (stored[-1].event.time_ns - stored[0].event.time_ns > 47 * HOUR_NS) == (jump_ns > 0)
