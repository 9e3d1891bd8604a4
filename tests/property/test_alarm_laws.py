"""Laws of the alarm table: it does not matter how the events of its alarms are cut, repeated or interleaved."""

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.core.alarms import (
    NEXT,
    Alarm,
    AlarmCommand,
    AlarmKey,
    AlarmTable,
    Clear,
    Confirm,
    Create,
    Dispose,
    Raise,
    alarm_key,
    created,
    decide,
    fold,
    phase,
    row,
    step,
)
from bridge.core.arguments import Argument
from bridge.core.events import AlarmEvent, ConfirmationState, Severity, is_active
from bridge.core.hresult import AdsError
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS

KEYS = [
    AlarmKey("plc1", EVENT_CLASS, 1),
    AlarmKey("plc1", EVENT_CLASS, 1, 0),
    AlarmKey("plc1", EVENT_CLASS, 1, None, ""),
    AlarmKey("plc1", OTHER_CLASS, 1, 7, "MAIN", EVENT_CLASS),
]


@st.composite
def commands(draw: st.DrawFn) -> AlarmCommand:
    """Any call on one of a few alarms, legal or not, with explicit times in any order."""
    key, time_ns = draw(st.sampled_from(KEYS)), draw(st.integers(1, 50))
    arguments = draw(st.sampled_from([None, (), (Argument(1, "true"),)]))
    json_attribute = draw(st.sampled_from([None, "", "{}"]))
    match draw(st.sampled_from(["create", "raise", "raise", "clear", "clear_reset", "confirm", "dispose"])):
        case "create":
            severity, asked = draw(st.sampled_from(Severity)), draw(st.booleans())
            return Create(key=key, time_ns=time_ns, severity=severity, with_confirmation=asked, arguments=arguments)
        case "raise":
            return Raise(key=key, time_ns=time_ns, arguments=arguments, json_attribute=json_attribute)
        case "confirm":
            return Confirm(key=key, time_ns=time_ns, operator="op", comment=json_attribute or "")
        case "dispose":
            return Dispose(key=key, time_ns=time_ns)
        case call:
            return Clear(key=key, time_ns=time_ns, reset_confirmation=call == "clear_reset", arguments=arguments)


def run(calls: Sequence[AlarmCommand], session: str, alarms: dict[AlarmKey, Alarm]) -> list[AlarmEvent]:
    """What a logger publishes for the calls; alarms that do not exist are created first. `alarms` is its memory."""
    events: list[AlarmEvent] = []
    for call in calls:
        if call.key not in alarms and not isinstance(call, Create):
            alarms[call.key] = created(Create(key=call.key, severity=Severity.ERROR, with_confirmation=True))
        try:
            decided = decide(alarms.get(call.key), call)
        except AdsError:
            continue
        if isinstance(call, Create):
            alarms.setdefault(call.key, created(call))
        for event in decided:
            numbered = msgspec.structs.replace(event, session=session, seq=len(events) + 1)
            events.append(numbered)
            after = step(alarms.get(call.key), numbered)
            if after is None:
                del alarms[call.key]
            else:
                alarms[call.key] = after
    return events


calls = st.lists(commands(), max_size=30)


@st.composite
def histories(draw: st.DrawFn) -> list[AlarmEvent]:
    """What up to three runs of one logger published, one after the other; alarms live on from run to run."""
    alarms: dict[AlarmKey, Alarm] = {}
    return [event for n in range(draw(st.integers(1, 3))) for event in run(draw(calls), f"s{n}", alarms)]


@st.composite
def interleaved(draw: st.DrawFn) -> tuple[list[AlarmEvent], list[AlarmEvent]]:
    """A history, and the same events in another order that keeps the order of each alarm."""
    history = draw(histories())
    waiting: dict[AlarmKey, list[AlarmEvent]] = {}
    for event in history:
        waiting.setdefault(alarm_key(event), []).append(event)
    order = draw(st.permutations([alarm_key(event) for event in history]))
    return history, [waiting[key].pop(0) for key in order]


@given(histories(), st.data())
def test_folding_in_parts_is_folding_at_once(history: list[AlarmEvent], data: st.DataObject) -> None:
    """fold(rest, fold(first)) == fold(all), wherever it is cut."""
    cut = data.draw(st.integers(0, len(history)))
    assert fold(history[cut:], fold(history[:cut])).alarms == fold(history).alarms


@given(histories(), st.data())
def test_a_snapshot_is_as_good_as_the_events_before_it(history: list[AlarmEvent], data: st.DataObject) -> None:
    """Who loads the state after some events, and then meets any of them again and all later ones, ends in the same state."""
    cut, again = data.draw(st.integers(0, len(history))), data.draw(st.integers(0, len(history)))
    before = fold(history[:cut])
    table = AlarmTable()
    if cut:
        table.load(before.alarms.values(), history[cut - 1].session, history[cut - 1].seq, "plc1")
    same_run = [event for event in history[again:cut] if event.session == history[cut - 1].session]
    assert fold([*same_run, *history[cut:]], table).alarms == fold(history).alarms


@given(histories(), st.data())
def test_an_event_seen_twice_changes_nothing(history: list[AlarmEvent], data: st.DataObject) -> None:
    """Any event again, at any place after it first came, leaves every table after it as it was."""
    if not history:
        return
    place = data.draw(st.integers(0, len(history) - 1))
    again = data.draw(st.integers(place + 1, len(history)))
    table = fold(history[:again])
    before = dict(table.alarms)
    assert table.apply(history[place]) is False
    assert table.alarms == before
    assert fold(history[again:], table).alarms == fold(history).alarms


@given(interleaved())
def test_the_order_between_alarms_does_not_matter(pair: tuple[list[AlarmEvent], list[AlarmEvent]]) -> None:
    """Any interleaving that keeps the order of each alarm gives the same table, also across runs of the logger."""
    history, other = pair
    assert fold(other).alarms == fold(history).alarms


@given(interleaved())
def test_all_of_it_again_changes_nothing(pair: tuple[list[AlarmEvent], list[AlarmEvent]]) -> None:
    """The whole history a second time, in another order, is stale from end to end."""
    history, other = pair
    table = fold(history)
    before = dict(table.alarms)
    assert [table.apply(event) for event in other] == [False] * len(other)
    assert table.alarms == before


@given(calls)
def test_the_folded_table_is_the_loggers_memory(made: list[AlarmCommand]) -> None:
    """Who folds what a logger published knows what it knows of every alarm that was raised (created ones nobody announced)."""
    alarms: dict[AlarmKey, Alarm] = {}
    events = run(made, "s1", alarms)
    assert fold(events).alarms == {key: alarm for key, alarm in alarms.items() if alarm.was_raised}


@given(calls)
def test_a_life_makes_sense(made: list[AlarmCommand]) -> None:
    """Raise and clear alternate; severity and confirmation never change within a life; disposed alarms are not active."""
    for key in KEYS:
        events = [event for event in run(made, "s1", {}) if alarm_key(event) == key]
        for before, after in pairwise(events):
            if before.kind == "alarm_disposed":
                continue
            assert after.severity is before.severity
            assert (after.confirmation_state is ConfirmationState.NOT_SUPPORTED) == (
                before.confirmation_state is ConfirmationState.NOT_SUPPORTED
            )
            assert (after.kind == "alarm_raised") == (after.raised and not before.raised)
        for event in events:
            assert not (event.kind == "alarm_disposed" and is_active(event))
            assert event.kind != "alarm_raised" or event.time_raised_ns == event.time_ns
            assert event.kind != "alarm_confirmed" or event.time_confirmed_ns == event.time_ns


@given(calls)
def test_every_call_has_an_answer(made: list[AlarmCommand]) -> None:
    """In every phase every call is either refused with a negative HRESULT or causes at most one event."""
    alarms: dict[AlarmKey, Alarm] = {}
    for n, call in enumerate(made):
        before = alarms.get(call.key)
        answer = row(before, call)
        assert (phase(before), answer.result) in {(where, known.result) for (where, _), known in NEXT.items()}
        if answer.result >= 0x8000_0000:
            with pytest.raises(AdsError) as refused:
                decide(before, call)
            assert refused.value.code == answer.result
        else:
            assert len(decide(before, call)) <= 1
        run([call], f"s{n}", alarms)
