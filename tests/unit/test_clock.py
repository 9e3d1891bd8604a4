"""The clock of events when the system's clock jumps."""

from hypothesis import given
from hypothesis import strategies as st

from bridge.clock import SteadyClock
from bridge.core.events import Severity
from bridge.edges.bus import ALONE, open_bus
from bridge.logger import EventLogger
from bridge.publisher import Publisher
from tests.unit.logger.logger_stories import CLASS, PUMP, new_alarm

HOUR_NS = 3_600_000_000_000
START_NS = 1_800_000_000_000_000_000


class Hand:
    """A clock that is set by hand."""

    def __init__(self, now_ns: int) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns


def test_a_clock_that_only_goes_on_is_followed() -> None:
    """Also when it stands still, and when it is set forward."""
    wall = Hand(START_NS)
    clock = SteadyClock(wall)
    assert [clock(), clock()] == [START_NS, START_NS]
    wall.now_ns += 48 * HOUR_NS
    assert clock() == START_NS + 48 * HOUR_NS


def test_a_clock_that_is_set_back_is_caught_up_with() -> None:
    """Time goes on at half pace, and an hour's jump is over after two hours."""
    wall, pace = Hand(START_NS), Hand(0)
    clock = SteadyClock(wall, pace)
    clock()
    wall.now_ns -= HOUR_NS
    told = []
    for _ in range(5):
        wall.now_ns += HOUR_NS // 2
        pace.now_ns += HOUR_NS // 2
        told.append((clock() - START_NS) / HOUR_NS)
    assert told == [0.25, 0.5, 0.75, 1.0, 1.5]


@given(st.lists(st.tuples(st.integers(-HOUR_NS, HOUR_NS), st.integers(0, HOUR_NS))))
def test_time_never_goes_back(steps: list[tuple[int, int]]) -> None:
    """However the clock jumps; and it is never behind the system's clock."""
    wall, pace = Hand(START_NS), Hand(0)
    clock = SteadyClock(wall, pace)
    last = clock()
    for jump, passed in steps:
        wall.now_ns += jump + passed
        pace.now_ns += passed
        now = clock()
        assert now >= last
        assert now >= wall.now_ns
        last = now


def test_the_messages_of_a_session_never_go_back_in_time() -> None:
    """The clock is set back by an hour between two messages; a time that is given is taken as it is."""
    wall = Hand(START_NS)
    with open_bus(ALONE) as bus, Publisher(bus, "plc1", clock=wall) as publisher:
        first = publisher.send_message(CLASS, 1, Severity.INFO, source=PUMP)
        wall.now_ns -= HOUR_NS
        second = publisher.send_message(CLASS, 1, Severity.INFO, source=PUMP)
        third = publisher.send_message(CLASS, 1, Severity.INFO, source=PUMP, time_ns=START_NS - HOUR_NS)
    assert START_NS == first.time_ns <= second.time_ns < START_NS + HOUR_NS
    assert third.time_ns == START_NS - HOUR_NS


def test_the_transitions_of_a_logger_never_go_back_in_time() -> None:
    """An alarm that is cleared after the clock was set back is not cleared before it was raised; nor is it so in the log."""
    wall = Hand(START_NS)
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus, clock=wall) as logger:
        alarm = logger.raise_alarm(new_alarm(logger))
        wall.now_ns -= HOUR_NS
        message = logger.send_message(CLASS, 1, Severity.INFO, source=PUMP)
        alarm = logger.clear_alarm(alarm)
        assert START_NS == alarm.time_raised_ns <= message.time_ns <= alarm.time_cleared_ns
        arrivals = [stored.arrival_ns for stored in logger.log()]
        assert arrivals == sorted(arrivals, reverse=True)
