"""A recorded snapshot among the events of its session: it corrects what a gap has hidden, and nothing else."""

import msgspec

from bridge.core.alarms import Alarm, AlarmKey, AlarmTable, step
from bridge.core.events import AlarmEvent, Origin
from bridge.testing.builders import TARGET, alarm_cleared, alarm_disposed, alarm_raised


def alarm(event: AlarmEvent) -> Alarm:
    made = step(None, event)
    assert made is not None
    return made


ONE = alarm_raised(event_id=1, session="a", seq=1, key_seq=1)
TWO = alarm_raised(event_id=2, session="a", seq=2, key_seq=1)
ONE_GONE = alarm_disposed(event_id=1, session="a", seq=3, key_seq=2)
TWO_CLEARED = alarm_cleared(event_id=2, session="a", seq=4, key_seq=2)


def after(*events: AlarmEvent) -> AlarmTable:
    table = AlarmTable()
    for event in events:
        table.apply(event)
    return table


def ids(table: AlarmTable) -> dict[int, bool]:
    return {key.event_id: found.raised for key, found in table.alarms.items()}


def test_the_first_snapshot_of_a_session_is_the_state() -> None:
    """What was known of the target from another session is replaced; other targets are left alone."""
    elsewhere = alarm_raised(target="plc2", event_id=9, session="b", seq=1, key_seq=1)
    table = after(msgspec.structs.replace(TWO, session="before"), elsewhere)
    table.refresh([alarm(ONE)], "a", 1, TARGET)
    assert ids(table) == {9: True, 1: True}
    assert not table.apply(msgspec.structs.replace(TWO_CLEARED, session="before"))


def test_a_later_snapshot_ends_a_gap() -> None:
    """A disposal, a raise and a clear that were missed show in it."""
    three = alarm(alarm_raised(event_id=3, session="a", seq=5, key_seq=1))
    table = after(ONE, TWO)
    table.refresh([alarm(TWO_CLEARED), three], "a", 5, TARGET)
    assert ids(table) == {2: False, 3: True}
    assert not table.apply(ONE_GONE)
    assert table.apply(alarm_cleared(event_id=3, session="a", seq=6, key_seq=2))


def test_where_nothing_is_missing_it_changes_nothing() -> None:
    """Whatever its place among the events of its session: what is later than it stays."""
    events = (ONE, TWO, ONE_GONE, TWO_CLEARED)
    snapshots: list[tuple[tuple[AlarmEvent, ...], int]] = [
        ((), 0),
        ((ONE,), 1),
        ((ONE, TWO), 2),
        ((TWO,), 3),
        ((TWO_CLEARED,), 4),
    ]
    for alarms, seq in snapshots:
        table = after(*events)
        table.refresh([alarm(event) for event in alarms], "a", seq, TARGET)
        assert table.state() == after(*events).state()


def test_a_snapshot_that_holds_more_than_its_seq_counts() -> None:
    """Each of its alarms says up to which event it goes."""
    table = after(TWO)
    table.refresh([alarm(TWO_CLEARED)], "a", 1, TARGET)
    assert ids(table) == {2: False}
    assert not table.apply(TWO_CLEARED)


def test_an_alarm_that_an_earlier_session_left_stays_as_it_is() -> None:
    """It stands in the snapshot with the session of its last event; the next event of this session counts."""
    left = msgspec.structs.replace(alarm(TWO), session="before", seq=77)
    table = after(ONE)
    table.refresh([alarm(ONE), left], "a", 1, TARGET)
    assert ids(table) == {1: True, 2: True}
    assert table.apply(TWO_CLEARED)
    table.refresh([alarm(ONE), left], "a", 1, TARGET)
    assert ids(table) == {1: True, 2: False}


def test_a_snapshot_of_a_session_that_was_replaced_says_nothing() -> None:
    """The logger was started again; its old state comes too late."""
    table = after(ONE)
    table.refresh([], "b", 0, TARGET)
    table.refresh([alarm(ONE)], "a", 1, TARGET)
    assert ids(table) == {}


def test_a_replayed_alarm_says_where_it_came_from() -> None:
    """The origin of its last event."""
    origin = Origin(realm="live", session="x", seq=3)
    table = after(msgspec.structs.replace(ONE, origin=origin))
    (found,) = table.alarms.values()
    assert found.origin == origin
    assert found.key == AlarmKey(TARGET, ONE.event_class, 1)


def test_what_a_snapshot_has_seen_go_is_gone() -> None:
    """A recorder that paused folds on: its seq is old, its last_seq tells that it was there when the alarm went."""
    for last_seq, left in ((0, {1: True, 2: True}), (3, {2: True})):
        table = after(ONE, TWO)
        table.refresh([alarm(TWO)], "a", 0, TARGET, last_seq)
        assert ids(table) == left


def test_a_session_that_another_has_followed_is_stale_without_a_snapshot_too() -> None:
    """Its snapshot comes late; the events of the newer one count."""
    table = AlarmTable()
    table.refresh([alarm(ONE)], "a", 1, TARGET)
    table.apply(msgspec.structs.replace(TWO, session="b"))
    assert not table.refresh([], "a", 9, TARGET)
    assert ids(table) == {1: True, 2: True}
