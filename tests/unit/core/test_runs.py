"""Two runs compared: what is new, gone, later, longer."""

import random
from itertools import combinations

from bridge.core.alarms import fold
from bridge.core.events import AlarmCleared, AlarmDisposed, AlarmRaised, AnyEvent
from bridge.core.runs import Difference, Life, Run, alarm_differences, message_differences, paired
from bridge.testing.builders import TIME_NS, alarm_cleared, alarm_confirmed, alarm_disposed, alarm_raised, message_sent

S = 1_000_000_000


def raised(number: int, at_s: float) -> AlarmRaised:
    """The alarm comes."""
    at_ns = TIME_NS + int(at_s * S)
    return alarm_raised(event_id=number, time_ns=at_ns, time_raised_ns=at_ns)


def cleared(number: int, at_s: float) -> AlarmCleared:
    """The alarm goes."""
    at_ns = TIME_NS + int(at_s * S)
    return alarm_cleared(event_id=number, time_ns=at_ns, time_cleared_ns=at_ns)


def disposed(number: int, at_s: float) -> AlarmDisposed:
    """Its end, raised or not."""
    return alarm_disposed(event_id=number, time_ns=TIME_NS + int(at_s * S), time_cleared_ns=0)


def run(*events: AnyEvent, zero_ns: int = 0) -> Run:
    """A run that starts with a message at 0 s."""
    made = Run(zero_ns)
    made.event(message_sent(event_id=99, time_ns=TIME_NS))
    for event in events:
        made.event(event)
    return made


def told(first: Run, second: Run, tolerance_s: float = 1.0) -> list[tuple[str, int, int, float]]:
    """The differences: what, event id, which occurrence, by how many seconds."""
    found: list[Difference] = alarm_differences(first, second, int(tolerance_s * S))
    return [(each.what, each.key.event_id, each.occurrence, each.by_ns / S) for each in found]


def test_the_same_run_does_not_differ() -> None:
    """Nor within the tolerance."""
    one = run(raised(1, 5), cleared(1, 8))
    assert told(one, one) == []
    assert told(one, run(raised(1, 5.9), cleared(1, 9.8))) == []


def test_new_gone_later_longer() -> None:
    """Each is named with its occurrence and by how much, in the order of time."""
    one = run(raised(1, 5), cleared(1, 8), raised(2, 10), cleared(2, 12), raised(3, 20), cleared(3, 21))
    other = run(raised(2, 14), cleared(2, 16), raised(3, 20), cleared(3, 26), raised(4, 30), cleared(4, 31))
    assert told(one, other) == [("gone", 1, 1, 0), ("later", 2, 1, 4), ("longer", 3, 1, 5), ("new", 4, 1, 0)]
    assert told(other, one) == [("new", 1, 1, 0), ("earlier", 2, 1, 4), ("shorter", 3, 1, 5), ("gone", 4, 1, 0)]


def test_one_of_many_lives_that_is_gone_is_found() -> None:
    """The others keep their partners: they are not all told as later."""
    times = [1, 11, 20.5, 32, 40, 55]
    one = run(*(event for at in times for event in (raised(1, at), cleared(1, at + 3))))
    for missing in range(len(times)):
        left = times[:missing] + times[missing + 1 :]
        other = run(*(event for at in left for event in (raised(1, at + 0.4), cleared(1, at + 3.4))))
        assert told(one, other) == [("gone", 1, missing + 1, 0)]
        assert told(other, one) == [("new", 1, missing + 1, 0)]


def test_pairs_have_the_least_sum_of_shifts() -> None:
    """Against trying every way, for many small cases."""
    chance = random.Random(8)
    for _ in range(200):
        some = sorted(chance.sample(range(30), chance.randrange(1, 5)))
        more = sorted(chance.sample(range(30), chance.randrange(len(some), 8)))
        one = [Life(at, at + 1, raised(1, at)) for at in some]
        other = [Life(at, at + 1, raised(1, at)) for at in more]
        pairs = paired(one, other)
        assert [right for _, right in pairs] == list(range(len(more)))
        assert [left for left, _ in pairs if left is not None] == list(range(len(some)))
        cost = sum(abs(some[left] - more[right]) for left, right in pairs if left is not None and right is not None)
        assert cost == min(
            sum(abs(a - b) for a, b in zip(some, chosen, strict=True)) for chosen in combinations(more, len(some))
        )


def test_an_alarm_that_is_not_over_is_told_against_one_that_is() -> None:
    """Its length is not known."""
    one, other = run(raised(1, 5), cleared(1, 8)), run(raised(1, 5))
    assert told(one, other) == [("not cleared", 1, 1, 0)]
    assert told(other, one) == [("cleared", 1, 1, 0)]
    assert told(other, other) == []


def test_alarms_that_began_before_their_run_have_no_start_to_compare() -> None:
    """From a keyframe, or from a transition that says that it is raised."""
    before = fold([raised(1, -100)]).active()
    one, other = Run(), Run()
    one.state(before)
    one.state(before)
    one.event(message_sent(time_ns=TIME_NS))
    one.event(cleared(1, 5))
    other.event(message_sent(time_ns=TIME_NS))
    other.event(alarm_confirmed(event_id=1, raised=True, time_ns=TIME_NS))
    other.event(cleared(1, 50))
    assert told(one, other) == []
    assert [len(lives) for lives in (*one.lives.values(), *other.lives.values())] == [1, 1]


def test_a_life_ends_with_dispose_and_with_the_next_raise() -> None:
    """A raise whose clear was lost ends the life before it; the same raise twice is one."""
    made = run(raised(1, 1), raised(1, 1), raised(1, 9), disposed(1, 12), disposed(1, 13), cleared(1, 14))
    (lives,) = made.lives.values()
    assert [(life.start_ns, life.end_ns) for life in lives] == [(1 * S, 9 * S), (9 * S, 12 * S)]


def test_times_count_from_the_zero_of_each_run() -> None:
    """The first event with a time, or what was chosen."""
    one = Run()
    other = Run(TIME_NS + 7 * S)
    for made, ahead in ((one, 0), (other, 7)):
        made.event(message_sent(time_ns=0))
        made.event(message_sent(time_ns=TIME_NS))
        made.event(raised(1, 3 + ahead))
    assert told(one, other) == []


def test_messages_are_counted() -> None:
    """Per target, class and id; what is equal is not told."""
    one = run(message_sent(event_id=1), message_sent(event_id=1), message_sent(event_id=2))
    other = run(message_sent(event_id=1), message_sent(event_id=3), message_sent(event_id=2))
    found = [(each.event_id, each.first, each.second) for each in message_differences(one, other)]
    assert found == [(1, 2, 1), (3, 0, 1)]
