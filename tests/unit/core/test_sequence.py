"""Numbers that reveal loss: gaps, duplicates, lost tails, and where the promise begins."""

from bridge.core.sequence import Beat, Missing, Tracker

KEY = "tc3/1/live/plc1/event/54cc5482-ad79-4cdc-8c3e-b3983b36ed66/alarm/error"
OTHER = "tc3/1/live/plc1/event/54cc5482-ad79-4cdc-8c3e-b3983b36ed66/message/info"


def beat(seq: int = 0, *, session: str = "s1", final: bool = False, **keys: int) -> Beat:
    """A beat of plc1; keys by short name."""
    names = {"key": KEY, "other": OTHER}
    numbers = {names[name]: number for name, number in keys.items()}
    return Beat(target="plc1", session=session, seq=seq, keys=numbers, final=final)


def test_events_that_follow_each_other_miss_nothing() -> None:
    """1, then 2 to 4, then 5: nothing to ask for."""
    tracker = Tracker()
    assert [tracker.see("s1", KEY, first, last) for first, last in ((1, 1), (2, 4), (5, 5))] == [None] * 3
    assert tracker.last("s1", KEY) == 5


def test_a_jump_names_what_is_missing() -> None:
    """After 3 comes 7: 4 to 6 are missing, three events."""
    tracker = Tracker()
    tracker.see("s1", KEY, 1, 3)
    missing = tracker.see("s1", KEY, 7, 9)
    assert missing == Missing("s1", KEY, 4, 6)
    assert missing.count == 3
    assert tracker.last("s1", KEY) == 9
    assert Missing("s1", KEY, 5, 5).count == 1


def test_each_session_and_key_is_counted_by_itself() -> None:
    """A receiver of only some keys still sees each loss; another sender on the same key does not disturb."""
    tracker = Tracker()
    for session, key in (("s1", KEY), ("s1", OTHER), ("s2", KEY)):
        assert tracker.see(session, key, 1, 1) is None
    assert tracker.see("s1", OTHER, 3, 3) == Missing("s1", OTHER, 2, 2)
    assert tracker.see("s1", KEY, 2, 2) is None
    assert tracker.see("s2", KEY, 2, 2) is None


def test_a_number_passed_before_is_a_duplicate() -> None:
    """At or below the last one; the next is none, and neither is anything of a key never seen."""
    tracker = Tracker()
    assert not tracker.is_duplicate("s1", KEY, 1)
    tracker.see("s1", KEY, 1, 3)
    assert [tracker.is_duplicate("s1", KEY, number) for number in (1, 3, 4)] == [True, True, False]
    assert not tracker.is_duplicate("s1", OTHER, 1)


def test_an_old_range_does_not_take_the_last_number_back() -> None:
    """A duplicate that is seen all the same changes nothing."""
    tracker = Tracker()
    tracker.see("s1", KEY, 1, 9)
    assert tracker.see("s1", KEY, 2, 3) is None
    assert tracker.last("s1", KEY) == 9


def test_before_the_first_beat_nothing_is_promised() -> None:
    """Who subscribes in the middle meets number 42 first: what came before is not missing."""
    tracker = Tracker()
    assert tracker.see("s1", KEY, 42, 42) is None
    assert not tracker.started("s1")


def test_the_first_beat_is_the_start() -> None:
    """What it names counts as seen; the next event of each key must follow it."""
    tracker = Tracker()
    assert tracker.beat(beat(20, key=10)) == []
    assert tracker.started("s1")
    assert tracker.last("s1", KEY) == 10
    assert tracker.see("s1", KEY, 13, 13) == Missing("s1", KEY, 11, 12)


def test_events_still_on_their_way_at_the_first_beat_are_no_duplicates() -> None:
    """The beat overtook 8 to 10: they come, in order, and a hole among them is a gap."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10))
    assert not tracker.is_duplicate("s1", KEY, 8)
    assert tracker.see("s1", KEY, 8, 8) is None
    assert tracker.see("s1", KEY, 10, 10) == Missing("s1", KEY, 9, 9)
    assert tracker.is_duplicate("s1", KEY, 9)
    assert tracker.see("s1", KEY, 11, 11) is None


def test_the_first_beat_does_not_undo_what_was_seen() -> None:
    """Events 1 to 12 came before the beat that says 10: 12 is the last, and 11 again is a duplicate."""
    tracker = Tracker()
    tracker.see("s1", KEY, 1, 12)
    tracker.beat(beat(20, key=10))
    assert tracker.last("s1", KEY) == 12
    assert tracker.is_duplicate("s1", KEY, 11)


def test_a_key_that_begins_after_the_start_begins_with_1() -> None:
    """Its first number we meet is 3: 1 and 2 are missing, as far as they came after the first beat's seq."""
    tracker = Tracker()
    tracker.beat(beat(20))
    assert tracker.see("s1", KEY, 3, 3) == Missing("s1", KEY, 1, 2, after_seq=20)
    assert tracker.see("s1", OTHER, 1, 1) is None


def test_a_later_beat_reveals_a_lost_tail() -> None:
    """Nobody can see that the last events are missing until the sender says how far it is."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10))
    tracker.see("s1", KEY, 11, 12)
    assert tracker.beat(beat(22, key=12)) == []
    assert tracker.beat(beat(25, key=15)) == [Missing("s1", KEY, 13, 15)]


def test_a_later_beat_reveals_a_key_nobody_saw() -> None:
    """All of it is missing, as far as it came after the start."""
    tracker = Tracker()
    tracker.beat(beat(20))
    assert tracker.beat(beat(22, other=2)) == [Missing("s1", OTHER, 1, 2, after_seq=20)]


def test_a_beat_is_asked_about_wanted_keys_only() -> None:
    """A receiver of KEY does not miss what was sent on OTHER."""
    tracker = Tracker()
    tracker.beat(beat(0), {})
    assert tracker.beat(beat(5, key=2, other=3), {KEY: 2}) == [Missing("s1", KEY, 1, 2)]
    tracker = Tracker()
    tracker.beat(beat(5, key=2, other=3), {KEY: 2})
    assert tracker.last("s1", OTHER) is None


def test_a_tail_is_reported_until_it_is_dealt_with() -> None:
    """Looking changes nothing; passing over does, and never goes back."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10))
    tail = Missing("s1", KEY, 11, 12)
    assert tracker.beat(beat(22, key=12)) == tracker.beat(beat(22, key=12)) == [tail]
    tracker.pass_over(tail)
    assert tracker.beat(beat(22, key=12)) == []
    tracker.pass_over(Missing("s1", KEY, 3, 4))
    assert tracker.last("s1", KEY) == 12
    assert tracker.see("s1", KEY, 13, 13) is None


def test_a_session_that_is_over_is_forgotten() -> None:
    """Its numbers and its start are gone, those of others stay."""
    tracker = Tracker()
    tracker.beat(beat(2, key=2))
    tracker.beat(beat(2, session="s2", key=2))
    tracker.forget("s1")
    assert not tracker.started("s1")
    assert tracker.last("s1", KEY) is None
    assert tracker.started("s2")
    assert tracker.see("s1", KEY, 9, 9) is None
    assert tracker.see("s2", KEY, 4, 4) == Missing("s2", KEY, 3, 3)


def test_keys_wanted_later_are_promised_from_the_next_beat() -> None:
    """What the new key had before is not missing, neither as a gap before the beat nor as a tail in it; later losses are."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10, other=7), {KEY: 10})
    tracker.see("s1", KEY, 11, 11)
    tracker.join(lambda key: key == OTHER)
    assert tracker.see("s1", OTHER, 9, 9) is None
    assert tracker.see("s1", OTHER, 11, 11) == Missing("s1", OTHER, 10, 10)
    assert tracker.beat(beat(25, key=11, other=12)) == [Missing("s1", OTHER, 12, 12)]


def test_keys_wanted_before_stay_promised_over_a_join() -> None:
    """A loss on them is found, in an event and in a beat."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10))
    tracker.join(lambda key: key == OTHER)
    assert tracker.see("s1", KEY, 13, 13) == Missing("s1", KEY, 11, 12)
    assert tracker.beat(beat(26, key=15, other=4)) == [Missing("s1", KEY, 14, 15)]
    assert tracker.last("s1", OTHER) == 4
    assert not tracker.is_duplicate("s1", OTHER, 4)


def test_an_idle_key_wanted_later_is_promised_after_the_beat_of_the_join() -> None:
    """A beat names only keys of the last minute: a later event of another key misses what came after that beat, no more."""
    tracker = Tracker()
    tracker.beat(beat(20))
    tracker.join(lambda key: key == OTHER)
    tracker.beat(beat(30))
    assert tracker.see("s1", OTHER, 501, 501) == Missing("s1", OTHER, 1, 500, after_seq=30)
    assert tracker.see("s1", KEY, 3, 3) == Missing("s1", KEY, 1, 2, after_seq=20)


def test_a_key_that_was_left_and_is_wanted_again_starts_anew() -> None:
    """What it had meanwhile is not missing."""
    tracker = Tracker()
    tracker.beat(beat(20, key=10))
    tracker.join(lambda key: key == OTHER)
    tracker.beat(beat(22, other=1), {OTHER: 1})
    tracker.join(lambda key: key == KEY)
    assert tracker.beat(beat(90, key=70, other=1)) == []
    assert tracker.beat(beat(91, key=71, other=1)) == [Missing("s1", KEY, 71, 71)]


def test_a_session_that_starts_after_a_join_is_promised_as_any() -> None:
    """Its first beat counts for all keys."""
    tracker = Tracker()
    tracker.beat(beat(20))
    tracker.join(lambda key: key == OTHER)
    assert tracker.beat(beat(5, session="s2", other=3)) == []
    assert tracker.beat(beat(6, session="s2", other=4)) == [Missing("s2", OTHER, 4, 4)]
