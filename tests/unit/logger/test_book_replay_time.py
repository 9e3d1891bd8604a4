"""A book that takes in a recording runs on replay time."""

from bridge.core.questions import LogQuestion
from bridge.core.times import NS_PER_S
from bridge.edges.cache import Cache
from bridge.logger import Book
from bridge.testing.builders import TIME_NS, message_sent

DAY_S = 86_400


def test_what_is_too_old_is_told_by_replay_time() -> None:
    """A log that keeps an hour keeps the last hour of a recording, however long ago that was."""
    with Book(None, Cache(max_age_s=3600)) as book:
        for number in range(1, 6):
            at_ns = TIME_NS + number * 1800 * NS_PER_S - 400 * DAY_S * NS_PER_S
            book.replay(message_sent(event_id=number, session="a", seq=number, key_seq=number), at_ns)
            book.flush()
        assert [stored.event.event_id for stored in book.log(LogQuestion(newest_first=False))] == [3, 4, 5]
