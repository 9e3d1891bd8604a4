"""A read-only copy of another logger."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.alarms import Alarm
from bridge.core.events import Severity
from bridge.core.questions import LogQuestion
from bridge.edges.bus import Bus
from bridge.edges.cache import Cache
from bridge.logger import EventLogger, Mirror
from bridge.publisher import Publisher
from bridge.testing.builders import alarm_cleared, alarm_raised
from tests.unit.logger.logger_stories import CLASS, alone, eventually, new_alarm, put


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


def test_a_mirror_has_the_alarms_and_the_events(bus: Bus) -> None:
    """Those before it by state, those after it by event; messages of other publishers too."""
    with EventLogger("plc1", bus=bus) as logger:
        before, after = new_alarm(logger, 1), new_alarm(logger, 2)
        logger.raise_alarm(before)
        with Mirror(bus, "plc1") as mirror, Publisher(bus, "plc1") as publisher:
            assert mirror.wait_for(logger.session, 1)
            assert [alarm.event_id for alarm in mirror.alarms] == [1]
            assert mirror.wait_for_promise(logger.session)
            logger.raise_alarm(after)
            logger.confirm_alarm(before)
            logger.clear_alarm(before)
            sent = [publisher.send_message(CLASS, 7, Severity.INFO), logger.send_message(CLASS, 8, Severity.INFO)]
            assert mirror.wait_for(logger.session, logger.publisher.seq)
            assert mirror.wait_for(publisher.session, 1)
            assert mirror.table.state() == logger.book.logbook.table.state()
            assert [alarm.event_id for alarm in mirror.alarms] == [2]
            events = [stored.event for stored in mirror.book.log(LogQuestion())]
            assert {event.kind for event in events} == {"alarm_raised", "alarm_confirmed", "alarm_cleared", "message_sent"}
            assert {event.session: event for event in events if not event.is_alarm} == {event.session: event for event in sent}
            assert mirror.counters.stored == 5


def test_a_mirror_says_when_its_logger_is_gone(bus: Bus) -> None:
    """It tells, keeps what it knows, and follows the next session."""
    changes: list[bool] = []
    with Mirror(bus, "plc1", on_connection=changes.append) as mirror:
        assert not mirror.is_connected
        with EventLogger("plc1", bus=bus) as logger:
            assert mirror.wait_for_logger()
            alarm = new_alarm(logger)
            logger.raise_alarm(alarm)
            logger.clear_alarm(alarm)
            assert mirror.wait_for(logger.session, 2)
        assert mirror.wait_for_logger(there=False)
        assert [alarm.event_id for alarm in mirror.alarms] == [1]
        with EventLogger("plc1", bus=bus) as other:
            other.raise_alarm(new_alarm(other, 5))
            assert mirror.wait_for(other.session, 1)
            assert mirror.table.state() == other.book.logbook.table.state()
            assert eventually(lambda: changes == [True, False, True])
    assert changes == [True, False, True, False]


def test_a_mirrors_cache_holds_the_alarms_as_they_are(bus: Bus, tmp_path: Path) -> None:
    """After a logger was replaced while the mirror was away, its file has the new state, not the old one with additions."""
    path = tmp_path / "mirror.db"
    with EventLogger("plc1", bus=bus) as logger, Mirror(bus, "plc1", cache=path) as mirror:
        logger.raise_alarm(new_alarm(logger, 1))
        assert mirror.wait_for(logger.session, 1)
    with Cache(path) as cache:
        assert _ids([kept.alarm for kept in cache.load_alarms()]) == [1]
    with EventLogger("plc1", bus=bus) as logger:
        logger.raise_alarm(new_alarm(logger, 2))
        assert logger.publisher.flush()
        with Mirror(bus, "plc1", cache=path) as mirror:
            assert [alarm.event_id for alarm in mirror.alarms] == [2]
    with Cache(path) as cache:
        assert _ids([kept.alarm for kept in cache.load_alarms()]) == [2]


def _ids(alarms: list[Alarm]) -> list[int]:
    return sorted(alarm.event_id for alarm in alarms)


def test_a_stranger_moves_no_alarm_of_a_mirror(bus: Bus) -> None:
    """A transition that is not the logger's is counted as rejected."""
    with EventLogger("plc1", bus=bus) as logger, Mirror(bus, "plc1") as mirror:
        logger.raise_alarm(new_alarm(logger))
        assert mirror.wait_for(logger.session, 1)
        put(bus, alarm_raised(session="stranger", seq=1, key_seq=1, event_id=9))
        put(bus, alarm_cleared(session="stranger", seq=2, key_seq=2, event_id=9))
        assert eventually(lambda: mirror.counters.rejected == 2)
        assert mirror.table.state() == logger.book.logbook.table.state()
