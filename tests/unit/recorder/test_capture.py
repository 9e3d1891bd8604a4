"""What is written when only what is around a trigger is wanted."""

import pytest

from bridge.core.events import AnyEvent, Severity
from bridge.core.sequence import Missing
from bridge.inbox import Dropped
from bridge.notices import Gap, TailUnknown
from bridge.recorder.capture import NO_ROOM, Capture, Windows
from tests.unit.recorder.recorder_stories import START, Notebook, S, heard, message


def is_critical(event: AnyEvent) -> bool:
    """The trigger of these stories."""
    return event.severity is Severity.CRITICAL


class Story:
    """A capture of 10 s before and 5 s after, fed second by second."""

    def __init__(self, before_s: float = 10, after_s: float = 5, max_events: int = 1000, max_bytes: int = 10**9) -> None:
        self.out = Notebook()
        capture = Capture(
            trigger="severity = critical", before_s=before_s, after_s=after_s, max_events=max_events, max_bytes=max_bytes
        )
        self.windows = Windows(capture, is_critical, self.out)

    def events(self, *seconds: float, triggers: tuple[float, ...] = ()) -> "Story":
        """An event at each second, numbered by it; those in `triggers` are critical."""
        for second in sorted({*seconds, *triggers}):
            severity = Severity.CRITICAL if second in triggers else Severity.INFO
            self.windows.take(heard(message(round(second * 10), severity), second), START + round(second * S))
        return self

    def at(self, second: float) -> int:
        """A second of the story as a time."""
        return START + round(second * S)


def test_a_window_reaches_from_before_to_after_its_trigger_both_ends_included() -> None:
    """Events 10 s before and 5 s after belong to it, those a tenth of a second further do not."""
    story = Story().events(9.9, 10, 15, 24.9, 25, 25.1, triggers=(20,))
    (window,) = story.out.windows
    assert window.events == [100, 150, 200, 249, 250]
    assert [at_ns for _, at_ns in window.items] == [story.at(second) for second in (10, 15, 20, 24.9, 25)]
    assert window.at_ns == story.at(10)
    assert window.why == "message_sent 54cc5482-ad79-4cdc-8c3e-b3983b36ed66 200 of plc1"


def test_what_left_before_a_window_is_passed_over_first() -> None:
    """The state at its first moment is that of everything before it, and of nothing else."""
    story = Story().events(*range(30), triggers=(25,))
    (window,) = story.out.windows
    assert window.passed == 15
    assert [item.event.event_id for item in story.out.passed if hasattr(item, "event")] == [n * 10 for n in range(30)]


def test_windows_that_overlap_are_one_file() -> None:
    """A second trigger within the first window, and one whose ten seconds before reach into it."""
    story = Story().events(*range(60), triggers=(20, 24, 39))
    (window,) = story.out.windows
    assert window.events == [n * 10 for n in range(10, 45)]
    assert story.windows.triggers == 3


def test_windows_that_do_not_touch_are_two_files() -> None:
    """The second begins later than the first ended: what is between them is in neither."""
    story = Story().events(*range(60), triggers=(20, 36))
    first, second = story.out.windows
    assert first.events == [n * 10 for n in range(10, 26)]
    assert second.events == [n * 10 for n in range(26, 42)]
    assert first.ended


def test_a_file_is_ended_when_no_trigger_can_reach_it_any_more() -> None:
    """It stays open for `before` after its window; time alone ends it."""
    story = Story().events(20, triggers=(21,))
    story.windows.tick(story.at(36))
    assert story.windows.is_open
    story.windows.tick(story.at(36.1))
    assert not story.windows.is_open
    assert story.out.windows[0].ended


def test_what_must_leave_memory_early_is_a_gap_of_the_window_that_wanted_it() -> None:
    """With room for four events a window of ten seconds says how many are missing, at its start."""
    story = Story(max_events=4).events(*range(30), triggers=(25,))
    (window,) = story.out.windows
    assert window.items[0] == (Gap(Missing("", "", 0, 5), NO_ROOM), story.at(15))
    assert window.events == [n * 10 for n in range(21, 30)]


def test_early_leavers_are_counted_one_by_one() -> None:
    """Also when many come at once; those of 1/256 of the time before, in which the window begins, are all counted."""
    story = Story(max_events=10)
    for number in range(1000):
        story.windows.take(heard(message(number)), story.at(20) + number)
    story.events(triggers=(25,))
    (window,) = story.out.windows
    gap = window.items[0][0]
    assert isinstance(gap, Gap)
    assert gap.missing.count == 990
    assert window.events == [*range(990, 1000), 250]


def test_early_leavers_of_long_ago_are_no_loss() -> None:
    """What left early and would have been too old anyway is not missing."""
    story = Story(max_events=4).events(*range(10), *range(40, 44), triggers=(43.5,))
    (window,) = story.out.windows
    assert window.events == [400, 410, 420, 430, 435]
    assert not any(isinstance(item, Gap) for item, _ in window.items)


def test_the_memory_is_bounded_in_bytes_too() -> None:
    """Events of about 1.2 kB each: 10,000 bytes hold eight of them, beside the trigger."""
    story = Story(max_bytes=10_000).events(*range(30), triggers=(29,))
    (window,) = story.out.windows
    assert len(window.events) <= 9
    gap = window.items[0][0]
    assert isinstance(gap, Gap)
    assert gap.missing.count + len(window.events) == 11


@pytest.mark.parametrize("loss", [Gap(Missing("s", "k", 3, 4), "lost"), Dropped(3), TailUnknown("plc1", "s")])
def test_a_loss_that_is_noticed_shortly_after_a_window_is_in_it(loss: Gap | Dropped | TailUnknown) -> None:
    """It may be the window's end that is missing: a beat reveals it up to a second later. Later losses are not its own."""
    story = Story().events(18, triggers=(20,))
    story.windows.take(loss, story.at(26.9))
    story.windows.take(loss, story.at(27.1))
    (window,) = story.out.windows
    assert [item for item, _ in window.items][2:] == [loss]


def test_a_capture_can_be_asked_for() -> None:
    """Without an event: what is in memory and what follows."""
    story = Story().events(*range(20))
    story.windows.trigger(story.at(19.5), "asked for")
    story.events(*range(20, 40))
    (window,) = story.out.windows
    assert (window.events[0], window.events[-1], window.why) == (100, 240, "asked for")


def test_while_it_is_not_armed_nothing_triggers() -> None:
    """Events are kept in memory all the same."""
    story = Story()
    story.windows.armed = False
    story.events(*range(10), triggers=(5,))
    assert story.out.windows == []
    story.windows.armed = True
    story.events(triggers=(11,))
    assert story.out.windows[0].events == [*(n * 10 for n in range(1, 10)), 110]


@pytest.mark.parametrize("wrong", [{"before_s": -1.0}, {"after_s": -0.1}, {"before_s": float("nan")}])
def test_seconds_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    """Negative, infinite or not a number."""
    with pytest.raises(ValueError, match="seconds"):
        Capture(trigger="severity = critical", **wrong)  # type: ignore[arg-type]


def test_without_room_nothing_can_be_captured() -> None:
    """At least one event."""
    with pytest.raises(ValueError, match="room"):
        Capture(trigger="severity = critical", max_events=0)
