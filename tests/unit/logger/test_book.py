"""What a logger keeps, and how a recording is folded into it without a bus."""

from pathlib import Path

import pytest

from bridge.core.alarms import Alarm, fold
from bridge.core.events import AnyEvent, Severity
from bridge.core.questions import LogQuestion
from bridge.edges.cache import Cache, CacheError, StoreBatch
from bridge.edges.recording import StateFrame
from bridge.logger import Book, NotFreshError
from bridge.testing.builders import EVENT_CLASS, alarm_cleared, alarm_confirmed, alarm_disposed, alarm_raised, message_sent


def story() -> list[AnyEvent]:
    """Two targets, two sessions of one of them, a message in between."""
    return [
        alarm_raised(session="a", seq=1, key_seq=1),
        message_sent(session="a", seq=2, key_seq=1),
        alarm_raised(session="a", seq=3, key_seq=2, event_id=2),
        alarm_disposed(session="a", seq=4, key_seq=3),
        alarm_raised(target="plc2", session="b", seq=1, key_seq=1),
        alarm_confirmed(session="c", seq=1, key_seq=1, event_id=2),
        alarm_cleared(target="plc2", session="b", seq=2, key_seq=2),
    ]


def replayed(book: Book, events: list[AnyEvent]) -> None:
    for number, event in enumerate(events):
        book.replay(event, 1000 + number)


def test_a_recording_goes_into_a_book_as_it_was() -> None:
    """Every event with its own numbers and its arrival time, every alarm of every target as its events say."""
    with Book() as book:
        replayed(book, story())
        rows = list(book.log(LogQuestion(newest_first=False)))
        assert [row.event for row in rows] == story()
        assert [row.arrival_ns for row in rows] == list(range(1000, 1007))
        assert book.alarms == fold(story()).alarms


def test_a_replay_into_a_file_is_there_afterwards(tmp_path: Path) -> None:
    """The cache file holds events and alarms, as a logger would have left them."""
    path = tmp_path / "replayed.db"
    with Book(None, path) as book:
        replayed(book, story())
    with Book(None, path) as book:
        assert book.alarms == fold(story()).alarms
        assert len(list(book.log(LogQuestion()))) == 7
        with pytest.raises(NotFreshError, match=r"replayed\.db holds events or alarms already"):
            book.replay(story()[0], 0)
    with Book("plc2", path) as book:
        assert {key.target for key in book.alarms} == {"plc2"}


def test_the_same_recording_twice_is_the_same_book() -> None:
    """An event with the same session and number is stored once and changes no alarm."""
    with Book() as book:
        replayed(book, story() + story())
        assert [row.event for row in book.log(LogQuestion(newest_first=False))] == story()
        assert book.alarms == fold(story()).alarms


def test_a_keyframe_is_where_a_recording_may_begin() -> None:
    """The alarms of a recorded state are there, and what it had folded in already changes them no more."""
    alarm = Alarm(target="plc1", event_class=EVENT_CLASS, event_id=1, severity=Severity.INFO, raised=True, session="a", seq=9)
    with Book() as book:
        book.load_state(StateFrame(realm="live", target="plc1", session="a", seq=9, alarms=(alarm,)))
        book.replay(alarm_cleared(session="a", seq=8, key_seq=1), 1)
        assert book.alarms == {alarm.key: alarm}
        book.replay(alarm_cleared(session="a", seq=10, key_seq=2), 2)
        assert not book.alarms[alarm.key].raised
        book.flush()
        assert [kept.alarm for kept in book.cache.load_alarms()] == list(book.alarms.values())


class _Failing(Cache):
    """A cache whose disk is full whenever the test says so."""

    full = False
    alarm_rows = 0

    def append(self, batch: StoreBatch, *, durable: bool = False) -> None:
        if self.full:
            raise CacheError(self.path, "disk is full")
        self.alarm_rows += len(batch.alarms) + len(batch.removals)
        super().append(batch, durable=durable)


def test_alarm_states_that_could_not_be_stored_are_stored_later() -> None:
    """Events that the disk did not take are lost and counted; the state of the alarms is made good with the next write."""
    cache = _Failing()
    with Book("plc1", cache) as book:
        raised, cleared = alarm_raised(session="a", seq=1, key_seq=1), alarm_cleared(session="a", seq=2, key_seq=2)
        assert book.store((book.logbook.replay(raised, 0),))
        cache.full = True
        assert not book.store((book.logbook.replay(cleared, 0), book.logbook.replay(alarm_raised(event_id=2), 0)))
        assert book.unstored == 2
        cache.full = False
        book.flush()
        kept = {kept.alarm.event_id: kept.alarm.raised for kept in cache.load_alarms()}
        assert kept == {1: False, 2: True}
        assert [row.event for row in book.log(LogQuestion())] == [raised]
        assert cache.alarm_rows == 3, "each state is written once, not again with every later event"
