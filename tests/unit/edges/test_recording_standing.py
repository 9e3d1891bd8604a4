"""Which alarms there are at a place of a recording."""

from msgspec.structs import replace

from bridge.core.alarms import Alarm, fold
from bridge.core.events import AlarmDisposed, AlarmRaised
from bridge.edges.recording import StateFrame
from bridge.edges.recording.standing import Standing
from tests.unit.edges.recording_stories import cleared, raised


def alarm(number: int, session: str = "s1") -> Alarm:
    """The alarm that raised(number) makes."""
    return replace(fold([raised(number)]).active()[0], session=session)


def frame(seq: int, *alarms: Alarm, session: str = "s1", target: str = "plc1", realm: str = "live") -> StateFrame:
    """A keyframe."""
    return StateFrame(realm=realm, target=target, session=session, seq=seq, alarms=alarms)


def of(session: str, event: AlarmRaised) -> AlarmRaised:
    """The same event of another session."""
    return replace(event, session=session)


def disposed(number: int, seq: int) -> AlarmDisposed:
    """The end of the alarm."""
    event = raised(number)
    return AlarmDisposed(
        target=event.target,
        event_class=event.event_class,
        event_id=event.event_id,
        severity=event.severity,
        session=event.session,
        seq=seq,
    )


def ids(standing: Standing) -> list[int]:
    """The ids of the active alarms."""
    return [alarm.event_id for alarm in standing.active()]


def test_transitions_are_folded() -> None:
    """As everywhere."""
    standing = Standing()
    standing.event("live", raised(1))
    standing.event("live", raised(5))
    standing.event("live", cleared(1))
    assert ids(standing) == [5]
    assert [alarm.event_id for alarm in standing.alarms()] == [1, 5]


def test_a_keyframe_after_a_gap_makes_the_state_right_again() -> None:
    """What was lost in the gap is in it: an alarm that came, and one that went."""
    standing = Standing()
    standing.event("live", raised(1))
    standing.state(frame(20, alarm(7)))
    assert ids(standing) == [7]


def test_a_keyframe_that_is_older_than_what_went_by_changes_nothing_of_that() -> None:
    """Events that the keyframe does not know of yet may stand before it: a raise, and a dispose."""
    standing = Standing()
    standing.event("live", raised(1))
    standing.event("live", raised(30))
    standing.event("live", disposed(2, 31))
    standing.state(frame(20, alarm(1), alarm(2), alarm(3)))
    assert ids(standing) == [1, 3, 30]


def test_a_keyframe_folded_from_what_went_by_counts_by_its_alarms() -> None:
    """A recorder that starts a new file tells the seq its logger told last; each alarm in it is newer."""
    standing = Standing()
    standing.event("live", raised(30))
    standing.event("live", disposed(2, 31))
    standing.state(frame(4, alarm(30)))
    assert ids(standing) == [30]


def test_sessions_follow_each_other() -> None:
    """The keyframe of the next session replaces all; what the former one said later is stale."""
    standing = Standing()
    standing.event("live", raised(1))
    standing.state(frame(0, alarm(2, "s2"), session="s2"))
    standing.event("live", raised(9))
    standing.state(frame(50, alarm(3)))
    assert ids(standing) == [2]
    standing.event("live", of("s3", raised(4)))
    standing.state(frame(60, session="s2"))
    assert ids(standing) == [2, 4]


def test_targets_and_realms_do_not_touch_each_other() -> None:
    """Neither by keyframes nor by transitions."""
    standing = Standing()
    standing.event("live", raised(1))
    standing.event("replay-1", raised(2))
    standing.state(frame(50, target="plc2"))
    standing.state(frame(50, session="s9", realm="replay-1"))
    assert ids(standing) == [1]


def test_keyframes_made_of_it_give_the_same_again() -> None:
    """As a recording that begins here needs them."""
    standing, again = Standing(), Standing()
    standing.state(frame(12, alarm(11), alarm(12)))
    standing.event("live", cleared(12))
    standing.event("live", replace(raised(8), target="plc2", session="s2"))
    for each in standing.frames():
        again.state(each)
    assert ids(again) == ids(standing) == [8, 11]
    assert list(again.alarms()) == list(standing.alarms())
    again.event("live", raised(12))
    assert ids(again) == [8, 11], "an event that is in the keyframe already"
