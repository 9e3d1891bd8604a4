"""The same state: what is compared, and how a difference is named."""

from msgspec.structs import replace

from bridge.core.alarms import Alarm, step
from bridge.core.arguments import Argument
from bridge.core.events import AlarmCleared, AlarmRaised, AnyEvent, ConfirmationState, MessageSent, Severity
from bridge.logger import Book
from bridge.logger.compare import State, compare, state_of

GUID = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
SENT = MessageSent(target="plc1", event_class=GUID, event_id=1, severity=Severity.INFO, session="a", seq=1, time_ns=5)
RAISED = AlarmRaised(
    target="plc1", event_class=GUID, event_id=7, severity=Severity.ERROR, session="b", seq=1, time_raised_ns=6, raised=True
)


def alarm(event: AlarmRaised = RAISED) -> Alarm:
    """The alarm after the event."""
    after = step(None, event)
    assert after is not None
    return after


def state(*events: AnyEvent, alarms: tuple[Alarm, ...] = ()) -> State:
    """A state of these events and alarms."""
    return State(alarms=alarms, events=events)


def test_equal_states_in_any_order_are_equal() -> None:
    """The order does not count; events and alarms are counted."""
    found = compare(state(SENT, RAISED, alarms=(alarm(),)), state(RAISED, SENT, alarms=(alarm(),)))
    assert found.equal
    assert (found.events, found.alarms) == (2, 1)


def test_an_event_that_is_missing_is_named_with_its_side() -> None:
    """Session and number say which."""
    assert compare(state(SENT, RAISED), state(RAISED)).differences == ("event 1 of session a of plc1 is only live",)
    assert compare(state(RAISED), state(SENT, RAISED)).differences == ("event 1 of session a of plc1 is only replayed",)


def test_one_changed_field_of_an_event_is_named_with_both_values() -> None:
    """Whatever field it is."""
    changed = replace(SENT, arguments=(Argument.of(3),), comment="x")
    found = compare(state(SENT), state(changed))
    head = f"event 1 of session a of plc1 (message_sent {GUID} 1)"
    assert found.differences == (
        f'{head}: arguments is [] live, [{{"type":4,"value":"3"}}] replayed',
        f'{head}: comment is "" live, "x" replayed',
    )


def test_another_kind_of_event_is_one_difference() -> None:
    """A cleared where a raised was is named by kind."""
    cleared = AlarmCleared(target="plc1", event_class=GUID, event_id=7, severity=Severity.ERROR, session="b", seq=1)
    assert compare(state(RAISED), state(cleared)).differences == (
        "event 1 of session b of plc1: kind is alarm_raised live, alarm_cleared replayed",
    )


def test_alarms_differ_by_state_times_and_confirmation_only() -> None:
    """Who commanded it, its session and its arguments are no part of an alarm's state; its five state fields are."""
    one = alarm()
    same = replace(one, session="c", seq=9, operator="x", arguments=(Argument.of(1),))
    assert compare(state(alarms=(one,)), state(alarms=(same,))).equal
    for field, value in (
        ("raised", False),
        ("confirmation_state", ConfirmationState.CONFIRMED),
        ("time_raised_ns", 7),
        ("time_cleared_ns", 7),
        ("time_confirmed_ns", 7),
    ):
        (difference,) = compare(state(alarms=(one,)), state(alarms=(replace(one, **{field: value}),))).differences
        assert difference.startswith(f"alarm {GUID} 7 of -: {field} is ")


def test_an_alarm_that_was_never_raised_is_no_part_of_the_state() -> None:
    """No event told of it, so no recording can hold it."""
    created = Alarm(target="plc1", event_class=GUID, event_id=9, severity=Severity.INFO)
    assert compare(state(alarms=(created,)), state()).equal
    assert compare(state(alarms=(alarm(),)), state()).differences == (f"alarm {GUID} 7 of - is only live",)


def test_a_long_value_is_cut_in_the_message() -> None:
    """A difference stays a line."""
    (difference,) = compare(state(SENT), state(replace(SENT, json_attribute="x" * 5000))).differences
    assert len(difference) < 300


def test_the_state_of_a_book_is_what_was_folded_into_it() -> None:
    """Events as they were and the alarms they lead to; unique ids and arrival times are not in it."""
    with Book(None) as book:
        book.replay(SENT, 100)
        book.replay(RAISED, 101)
        book.flush()
        found = state_of(book)
    assert found.events == (SENT, RAISED)
    assert [each.key for each in found.alarms] == [alarm().key]
    assert compare(found, state(SENT, RAISED, alarms=(alarm(),))).equal
