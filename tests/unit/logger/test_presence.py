"""Which loggers of a target there are, and what listeners make of two at once."""

from collections.abc import Iterator

import msgspec
import pytest

from bridge.attendance import Token
from bridge.core import keys
from bridge.core.alarms import Alarm
from bridge.core.events import Severity
from bridge.core.questions import LogQuestion, StatePart
from bridge.core.sequence import Beat
from bridge.edges.bus import Bus, Closable, Reply
from bridge.listener import Listener
from bridge.logger import EventLogger, Mirror
from bridge.logger.presence import Presence, loggers, session_of, token_key
from bridge.notices import TwoLoggers, TwoLoggersError
from bridge.testing.builders import EVENT_CLASS, alarm_raised
from tests.unit.logger.logger_stories import alone, eventually, new_alarm, put


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


def alarm(event_id: int, session: str, seq: int) -> Alarm:
    return Alarm(
        target="plc1",
        event_class=EVENT_CLASS,
        event_id=event_id,
        severity=Severity.INFO,
        raised=True,
        time_raised_ns=1,
        session=session,
        seq=seq,
    )


class Actor:
    """Somebody who plays the logger of plc1: answers @state with what the test says, and beats."""

    def __init__(self, bus: Bus, session: str, *alarms: Alarm) -> None:
        self.bus, self.session, self.alarms, self.seq = bus, session, alarms, 0
        self.answer: Closable = bus.answer(keys.verb_key("live", "plc1", "@state"), lambda _question: [self.state()])

    def state(self) -> Reply:
        return Reply(
            msgspec.json.encode(StatePart(target="plc1", session=self.session, seq=self.seq, alarms=tuple(self.alarms)))
        )

    def beat(self) -> None:
        beat = Beat(target="plc1", session=self.session, role="logger", seq=self.seq)
        self.bus.put(keys.verb_key("live", "plc1", "@beat", self.session), msgspec.json.encode(beat))


def test_who_holds_a_name(bus: Bus) -> None:
    """The sessions of the tokens, of this target and realm alone."""
    for target, realm in (("plc1", "live"), ("plc2", "live"), ("plc1", "replay-1")):
        bus.alive(token_key(target, realm, f"{target} {realm}"))
    assert loggers(bus, "plc1") == {"plc1 live"}
    assert session_of(keys.verb_key("live", "plc1", "@alive", "logger")) is None


def test_a_token_that_is_none_of_ours_hurts_nobody(bus: Bus) -> None:
    """A stranger's key that cannot be read: the name stays free, and who comes afterwards is still seen."""
    bus.alive(token_key("plc1", "live", "?").replace("%3F", "%zz"))
    presence = Presence(bus, "plc1", "live")
    assert loggers(bus, "plc1") == set()
    with EventLogger("plc1", bus=bus) as logger:
        assert presence.wait(30)
        assert presence.sessions == {logger.session}
        assert logger.read_only == ""
    assert presence.wait(30, there=False)
    presence.close()


def test_who_is_told_badly_is_told_again(bus: Bus, caplog: pytest.LogCaptureFixture) -> None:
    """An error of the program that is told of the first logger is logged, and the next one is seen all the same."""
    told: list[bool] = []

    def changed(there: bool) -> None:
        told.append(there)
        if there:
            raise RuntimeError("not now")

    presence = Presence(bus, "plc1", "live", changed)
    for _ in range(2):
        token = bus.alive(token_key("plc1", "live", "one"))
        assert presence.wait(30)
        token.close()
        assert presence.wait(30, there=False)
    assert eventually(lambda: told == [True, False, True, False])
    assert "not now" in caplog.text
    presence.close()


def test_presence_changes_with_the_first_and_the_last(bus: Bus) -> None:
    """Two tokens, as after a healed partition: that is one presence."""
    changes: list[bool] = []
    presence = Presence(bus, "plc1", "live", changes.append)
    tokens = [bus.alive(token_key("plc1", "live", session)) for session in "ab"]
    assert eventually(lambda: presence.sessions == {"a", "b"})
    tokens[0].close()
    assert eventually(lambda: presence.sessions == {"b"})
    assert changes == [True]
    tokens[1].close()
    assert presence.wait(10, there=False)
    assert eventually(lambda: changes == [True, False])
    presence.close()
    presence.close()
    assert changes == [True, False]


def test_two_loggers_at_the_opening_are_an_error(bus: Bus) -> None:
    """Nobody knows whose state is right."""
    Actor(bus, "a")
    Actor(bus, "b")
    with pytest.raises(TwoLoggersError, match="2 loggers"):
        Listener(bus, target="plc1", with_state=True)


def test_two_loggers_later_are_told_and_change_nothing(bus: Bus) -> None:
    """The state stays that of the first, said once, until the other one is alone; then it is the other one's."""
    first = Actor(bus, "a", alarm(1, "a", 0))
    with Listener(bus, target="plc1", with_state=True) as listener:
        second = Actor(bus, "b", alarm(2, "b", 0))
        for _ in range(3):
            second.beat()
        assert listener.get(10) == TwoLoggers("plc1", ("a", "b"))
        put(bus, alarm_raised(event_id=3, session="a", seq=1, key_seq=1))
        item = listener.get(10)
        assert item == alarm_raised(event_id=3, session="a", seq=1, key_seq=1)
        assert {key.event_id for key in listener.table.alarms} == {1, 3}
        first.answer.close()
        second.beat()
        assert eventually(lambda: {key.event_id for key in listener.table.alarms} == {2})
        assert listener.get(0) is None


def test_a_logger_that_steps_back_is_no_lost_end(bus: Bus) -> None:
    """It changes its role, and its session lives on: no listener calls its tail unknown."""
    with EventLogger("plc1", bus=bus) as logger, Listener(bus, target="plc1", with_state=True) as listener:
        assert listener.wait_for_beat(logger.session)
        older = bus.alive(token_key("plc1", "live", "0000"))
        assert eventually(lambda: bool(logger.read_only))
        reader = Token("plc1", "reader", logger.session)
        assert eventually(lambda: reader in listener._attendance._there.get(logger.session, ()))
        listener._attendance._token_changed(token_key("plc1", "live", logger.session), False)
        older.close()
        logger.close()
        assert listener.wait_for_final(logger.session)
        assert listener.counters.tails_unknown == 0


def test_a_mirror_takes_the_state_anew_after_a_gap(bus: Bus) -> None:
    """A transition was lost for good: the alarms, in the cache too, are what the logger says they are."""
    actor = Actor(bus, "a")
    with Mirror(bus, "plc1") as mirror:
        put(bus, alarm_raised(event_id=1, session="a", seq=1, key_seq=1))
        actor.alarms, actor.seq = (alarm(1, "a", 1), alarm(2, "a", 2), alarm(3, "a", 3)), 3
        put(bus, alarm_raised(event_id=3, session="a", seq=3, key_seq=3))
        assert eventually(lambda: mirror.counters.stored == 2)
        assert mirror.counters.missing == 1
        assert {key.event_id for key in mirror.table.alarms} == {1, 2, 3}
        mirror.book.flush()
        assert {kept.alarm.event_id for kept in mirror.book.cache.load_alarms()} == {1, 2, 3}
        assert sorted(stored.event.seq for stored in mirror.book.log(LogQuestion())) == [1, 3]


def test_a_mirror_starts_with_the_state_in_its_cache(bus: Bus) -> None:
    """At once, not only at its end: it may be killed."""
    with EventLogger("plc1", bus=bus) as logger:
        logger.raise_alarm(new_alarm(logger))
        assert logger.publisher.flush()
        with Mirror(bus, "plc1") as mirror:
            mirror.book.flush()
            assert [kept.alarm for kept in mirror.book.cache.load_alarms()] == mirror.alarms == logger.active_alarms()
