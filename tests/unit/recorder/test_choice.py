"""What a recording takes, and what is listened to for it."""

import pytest

from bridge.core.filters.ast import And, Compare, Everything, Or
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import to_text
from bridge.core.hresult import AdsError
from bridge.recorder.choice import Choice
from tests.unit.recorder.recorder_stories import CLASS, OTHER, message, raised

MINE = f"event_class = '{CLASS}'"


def listens(choice: Choice, *, target: str = "plc1") -> list[bool]:
    """Whether it listens to a message and to an alarm, of the class of these stories and of another one."""
    takes = (lambda event: True) if isinstance(choice.listens, Everything) else compile_filter(choice.listens)
    return [
        takes(event)
        for event_class in (CLASS, OTHER)
        for event in (message(1, event_class=event_class), raised(1, 1, event_class=event_class, target=target))
    ]


def test_everything_is_everything() -> None:
    """Nothing is asked of an event then."""
    choice = Choice(None)
    assert isinstance(choice.listens, Everything)
    assert choice.takes is None
    assert not choice.fires(message(1))


def test_all_alarms_are_listened_to_and_only_chosen_ones_recorded() -> None:
    """A keyframe is right only when no transition went by unseen."""
    choice = Choice(MINE)
    assert choice.takes is not None
    assert [choice.takes(raised(1, 1)), choice.takes(raised(1, 1, event_class=OTHER))] == [True, False]
    assert listens(choice) == [True, True, False, True]


def test_alarms_of_other_targets_are_not_listened_to() -> None:
    """Neither with targets given beside the filter, nor with those that it names."""
    for choice in (Choice(MINE, ("plc1", "plc2")), Choice(f"target in ('plc1', 'plc2') and {MINE}")):
        assert listens(choice) == [True, True, False, True]
        assert listens(choice, target="plc9") == [True, False, False, False]


def test_a_trigger_is_recorded_too_of_the_chosen_targets() -> None:
    """Whatever the filter says about it."""
    choice = Choice(MINE, ("plc1",), f"event_class = '{OTHER}' and is_message")
    assert choice.takes is not None
    assert choice.fires(message(1, event_class=OTHER))
    assert choice.takes(message(1, event_class=OTHER))
    assert not choice.takes(raised(1, 1, event_class=OTHER))
    assert to_text(choice.filter) == to_text(Choice(MINE).filter)


def test_the_largest_filter_can_be_recorded() -> None:
    """255 conditions leave no room for alarms beside them: more is listened to then, and nothing more recorded."""
    filter = Or(tuple(Compare("event_id", "=", number) for number in range(255)))
    choice = Choice(filter)
    assert choice.takes is not None
    assert [choice.takes(message(7)), choice.takes(message(300))] == [True, False]
    assert isinstance(choice.listens, Everything)
    bounded = Choice(And((Compare("target", "=", "plc1"), Or(tuple(Compare("event_id", "=", n) for n in range(254))))))
    assert to_text(bounded.listens) == "target in ('plc1')"
    with pytest.raises(AdsError):
        Choice(filter, ("plc1",))


def test_what_is_wrong_on_unknown_keys_concerns_the_recording() -> None:
    """What is no key of an event cannot be judged."""
    choice = Choice(MINE)
    key = f"tc3/1/live/plc1/event/{CLASS}/message/info"
    assert [choice.wants(key), choice.wants(key.replace(CLASS, OTHER)), choice.wants("nonsense")] == [True, False, True]
