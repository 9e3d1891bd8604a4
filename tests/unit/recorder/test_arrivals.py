"""When items came, while clocks do what they like."""

from bridge.core.times import NS_PER_S
from bridge.inbox import Dropped
from bridge.notices import Item
from bridge.recorder.arrivals import Arrivals
from tests.unit.recorder.recorder_stories import START, heard, message


class HandClock:
    """A clock that is set."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> int:
        """Now."""
        return START + round(self.seconds * NS_PER_S)


def at(arrivals: Arrivals, *items: Item, drained: bool = True) -> list[float]:
    """When these came, in seconds after START."""
    return [(time - START) / NS_PER_S for time in arrivals.times(list(items), drained=drained)]


def test_events_have_the_time_at_which_they_came() -> None:
    """Not the one at which they are written."""
    clock = HandClock()
    arrivals = Arrivals(clock)
    clock.seconds = 9
    assert at(arrivals, heard(message(1), 1), heard(message(2), 2.5)) == [1, 2.5]


def test_a_notice_came_before_the_event_behind_it() -> None:
    """The last one came by now, if nothing waits behind it; else right behind what came before it."""
    clock = HandClock()
    arrivals = Arrivals(clock)
    clock.seconds = 9
    assert at(arrivals, Dropped(1), heard(message(1), 3), Dropped(1), heard(message(2), 5), Dropped(1)) == [3, 3, 5, 5, 9]
    clock.seconds = 20
    assert at(arrivals, heard(message(3), 12), Dropped(1), drained=False) == [12, 12]


def test_times_never_go_back() -> None:
    """Not from one batch to the next either."""
    clock = HandClock()
    arrivals = Arrivals(clock)
    assert at(arrivals, heard(message(1), 5), heard(message(2), 4)) == [5, 5]
    assert at(arrivals, heard(message(3), 2)) == [5]
    assert arrivals.last_ns == START + 5 * NS_PER_S


def test_a_clock_that_is_set_back_does_not_stop_time() -> None:
    """An hour back: time goes on at half pace, with the events in their order, until the clock has caught up."""
    clock, pace = HandClock(), HandClock()
    clock.seconds = 7200
    arrivals = Arrivals(clock, pace)
    assert at(arrivals, heard(message(1), 7200)) == [7200]
    clock.seconds, pace.seconds = 3620, 20
    assert at(arrivals, heard(message(2), 3612), heard(message(3), 3620)) == [7202, 7210]
    assert arrivals.now_ns() == START + 7210 * NS_PER_S
    clock.seconds, pace.seconds = 11000, 7400
    assert at(arrivals, heard(message(4), 10999)) == [10999]
