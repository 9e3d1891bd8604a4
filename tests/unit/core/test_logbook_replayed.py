"""What a logbook does with alarms that were replayed: it keeps them as they were recorded."""

import msgspec
import pytest

from bridge.core.alarms import AlarmCommand, AlarmKey, Clear, Confirm, Create, Dispose, Raise
from bridge.core.events import AnyEvent, Origin, Severity
from bridge.core.hresult import ADS_E_INVALIDACCESS, ERROR_ALREADY_EXISTS, S_OK
from bridge.core.logbook import Logbook, Plan
from bridge.core.questions import CommandAnswer, CommandQuestion
from bridge.testing.builders import EVENT_CLASS, TARGET, TIME_NS, alarm_cleared, alarm_raised

KEY = AlarmKey(TARGET, EVENT_CLASS, 1)
ORIGIN = Origin(realm="live", session="old", seq=7, key_seq=1)


def replayed() -> Logbook:
    """A logbook that took in a recording: one alarm is raised."""
    book = Logbook(TARGET, "s1")
    book.replay(alarm_raised(session="old", seq=7, key_seq=1, origin=ORIGIN), TIME_NS)
    return book


@pytest.mark.parametrize(
    "command", [Raise(key=KEY), Clear(key=KEY), Clear(key=KEY, reset_confirmation=True), Confirm(key=KEY), Dispose(key=KEY)]
)
def test_commands_to_a_replayed_alarm_are_refused(command: AlarmCommand) -> None:
    """With ADS_E_INVALIDACCESS and where it came from; the alarm stays as it was."""
    book = replayed()
    before = dict(book.table.alarms)
    answer = book.decide(CommandQuestion(id="1", command=command), TIME_NS)
    assert isinstance(answer, CommandAnswer)
    assert (answer.result, answer.alarm) == (ADS_E_INVALIDACCESS, before[KEY])
    assert answer.detail == "the alarm is replayed: session old of realm live, event 7"
    assert book.table.alarms == before


def test_a_replayed_alarm_exists_and_others_can_be_made_beside_it() -> None:
    """A create of it is answered as of any alarm; an alarm of its own a logger commands as ever."""
    book = replayed()
    known = book.decide(CommandQuestion(id="1", command=Create(key=KEY, severity=Severity.INFO)), TIME_NS)
    assert isinstance(known, CommandAnswer)
    assert known.result == ERROR_ALREADY_EXISTS
    other = AlarmKey(TARGET, EVENT_CLASS, 2)
    plan = book.decide(CommandQuestion(id="2", command=Create(key=other, severity=Severity.INFO)), TIME_NS)
    assert isinstance(plan, Plan)
    assert book.sent(plan, (), TIME_NS).answer.result == S_OK
    assert isinstance(book.decide(CommandQuestion(id="3", command=Raise(key=other)), TIME_NS), Plan)


def test_a_clean_stop_leaves_replayed_alarms_raised() -> None:
    """They are not this logger's to dispose of."""
    assert replayed().stop(TIME_NS) == ()


def test_a_snapshot_after_a_gap_writes_what_it_corrects() -> None:
    """A raise that was missed begins another life; what was right already is not written again."""
    book = Logbook(None)
    book.replay(alarm_raised(event_id=1, session="a", seq=1, key_seq=1), TIME_NS)
    book.replay(alarm_raised(event_id=2, session="a", seq=2, key_seq=2), TIME_NS)
    book.replay(alarm_raised(event_id=3, session="a", seq=3, key_seq=3), TIME_NS)
    one, two, _ = book.table.alarms.values()
    again = msgspec.structs.replace(two, time_raised_ns=TIME_NS + 9, seq=6)
    changes = book.load_state(TARGET, "a", 8, [one, again])
    assert [(kept.unique_id, kept.alarm) for kept in changes.alarms] == [(4, again)]
    assert [key.event_id for key in changes.gone] == [3]
    events: list[AnyEvent] = [alarm_cleared(event_id=2, session="a", seq=9, key_seq=9)]
    assert [stored.unique_id for event in events for stored in book.replay(event, TIME_NS).events] == [4]
