"""What goes from the cache: over a limit, on demand, or aside as a whole; and rows sorted by what only Python knows."""

import sqlite3
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep, time_ns

import pytest

from bridge.core.events import AnyEvent
from bridge.core.filters.text import parse
from bridge.core.hresult import AdsError
from bridge.edges.cache import Cache, CacheError, Drop, StoreBatch, Stored, StoredEvent, move_aside
from bridge.edges.cache import queries as queries_module
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    TIME_NS,
    alarm_cleared,
    alarm_confirmed,
    alarm_raised,
    message_sent,
)
from tests.unit.edges.cache_stories import alarm, ids_of, message, messages, stored

S = 1_000_000_000


def text(found: StoredEvent) -> str:
    """A text that SQL does not know: the same for each ten."""
    return f"{found.unique_id % 10} of {found.unique_id // 1000}"


def until(condition: Callable[[], bool]) -> None:
    """Wait for what the writer does after a commit."""
    end = monotonic() + 30
    while not condition():
        assert monotonic() < end, "the condition did not come true"
        sleep(0.005)


def lives() -> StoreBatch:
    """Two alarm lives and two messages between their transitions."""
    events: list[tuple[int, AnyEvent]] = [
        (1, alarm_raised(seq=1)),
        (2, message_sent(seq=2)),
        (3, alarm_raised(seq=3, event_id=2)),
        (1, alarm_confirmed(seq=4)),
        (1, alarm_cleared(seq=5)),
        (4, message_sent(seq=6)),
    ]
    return StoreBatch([Stored(unique_id, TIME_NS, event) for unique_id, event in events])


def test_the_older_half_goes_when_there_are_too_many() -> None:
    """Also when rows in between were cleared before; the newest are whole, and the reason is told."""
    told: list[Drop] = []
    with Cache(max_events=100, on_dropped=told.append) as cache:
        cache.append(StoreBatch(alarms=(alarm(1),)))
        cache.append(messages(1, 100))
        cache.flush()
        assert cache.forget(range(41, 61)) == 20
        cache.append(messages(101, 120))
        cache.flush()
        assert (cache.count(), told) == (100, [])
        cache.append(messages(121, 121))
        cache.flush()
        until(lambda: told == [Drop(51, "max_events")])
        assert ids_of(cache.query(newest_first=False)) == list(range(72, 122))
        assert cache.load_alarms() == [alarm(1)]


def test_what_is_too_old_goes_by_itself() -> None:
    """Nobody needs to write for it; younger ones stay."""
    now = TIME_NS + 100 * S
    told: list[Drop] = []
    batch = StoreBatch([Stored(n, TIME_NS + n * S, message(n)) for n in range(1, 31)])
    with Cache(max_age_s=80.0, on_dropped=told.append, clock=lambda: now) as cache:
        cache.append(batch)
        until(lambda: told == [Drop(19, "max_age")])
        assert ids_of(cache.query(newest_first=False)) == list(range(20, 31))


def test_age_is_looked_at_while_nothing_is_written() -> None:
    """A cache that nobody writes into drops what became too old."""
    with Cache(max_age_s=0.05) as cache:
        cache.append(StoreBatch([Stored(n, time_ns(), message(n)) for n in range(1, 6)]))
        until(lambda: cache.counts.dropped == 5)
        assert cache.count() == 0


def test_a_clock_that_jumps_drops_nothing_too_early() -> None:
    """An event that seems to be from yesterday stays as long as one before it is young; the order is that of arrival."""
    times = [TIME_NS, TIME_NS + S, TIME_NS - 3_600 * S, TIME_NS + 2 * S]
    now = TIME_NS + 10 * S
    with Cache(max_age_s=60, clock=lambda: now) as cache:
        cache.append(StoreBatch([Stored(n, time_ns, message(n + 1)) for n, time_ns in enumerate(times)]))
        cache.flush()
        assert ids_of(cache.query(newest_first=False)) == [0, 1, 2, 3]
        now = TIME_NS + 62 * S
        cache.append(StoreBatch(meta={"a": "b"}))
        until(lambda: cache.counts.dropped == 3)
        assert ids_of(cache.query(newest_first=False)) == [3]


def test_a_drop_of_reports_alone_is_quiet() -> None:
    """So that who reports a drop as an event does not go on for ever."""
    told: list[Drop] = []
    with Cache(max_events=2, on_dropped=told.append, quiet_class=OTHER_CLASS) as cache:
        for n, event_class in enumerate((EVENT_CLASS, OTHER_CLASS, OTHER_CLASS, OTHER_CLASS)):
            cache.append(StoreBatch(stored([message_sent(event_class=event_class)], n)))
            cache.flush()
        until(lambda: told == [Drop(2, "max_events")])
        cache.append(StoreBatch(stored([message_sent(event_class=OTHER_CLASS)], 9)))
        until(lambda: told[1:] == [Drop(2, "max_events", quiet=True)])


def test_limits_that_leave_nothing_are_refused() -> None:
    """With the number that was given."""
    with pytest.raises(ValueError, match="max_events 1 "):
        Cache(max_events=1)
    for age in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="max_age_s"):
            Cache(max_age_s=age)


# Occurrences and order.


def test_an_occurrence_is_the_newest_row_of_a_life() -> None:
    """Messages are rows of their own; the filter is asked about that newest row; counted the same way."""
    with Cache() as cache:
        cache.append(lives())
        cache.flush()
        assert ids_of(cache.query(occurrences=True, newest_first=False)) == [2, 3, 1, 4]
        newest = [one.event.seq for one in cache.query(occurrences=True)]
        assert newest == [6, 5, 3, 2]
        assert cache.count(occurrences=True) == 4
        raised = parse("is_raised")
        assert ids_of(cache.query(raised, occurrences=True)) == [3]
        assert cache.count(raised, occurrences=True) == 1
        assert cache.count(raised) == 3
        assert ids_of(cache.query(occurrences=True, limit=2, offset=1)) == [1, 3]
        by_text = cache.query_by(lambda found: found.event.kind, occurrences=True)
        assert [one.event.kind for one in by_text] == ["alarm_cleared", "alarm_raised", "message_sent", "message_sent"]


@pytest.mark.parametrize("order", ["id", "severity", "time_ns", "iif(is_alarm, time_raised_ns, time_ns)", "source_name"])
@pytest.mark.parametrize("newest_first", [True, False])
@pytest.mark.parametrize("filter", ["", "severity >= error", "json('/axis') = 2"])
def test_the_last_of_them(order: str, newest_first: bool, filter: str) -> None:
    """The last n, without the last few, in the order asked for: what slicing the whole would give."""
    with Cache() as cache:
        cache.append(messages(1, 2_500))
        cache.flush()
        expr = parse(filter) if filter else None
        whole = ids_of(cache.query(expr, order=order, newest_first=newest_first))
        assert len(whole) >= 600
        for limit, offset in ((10, 0), (10, 5), (1_500, 700), (None, 7), (3_000, 0), (5, 5_000)):
            found = cache.query(expr, order=order, newest_first=newest_first, limit=limit, offset=offset, take_last=True)
            end = max(0, len(whole) - offset)
            assert ids_of(found) == whole[0 if limit is None else max(0, end - limit) : end]


@pytest.mark.parametrize("largest_first", [True, False])
@pytest.mark.parametrize("take_last", [True, False])
@pytest.mark.parametrize("window", [(None, 0), (10, 0), (10, 995), (None, 990), (0, 0)])
def test_rows_sorted_by_a_text(largest_first: bool, take_last: bool, window: tuple[int | None, int]) -> None:
    """The same rows as sorting everything and slicing; equal texts by arrival."""
    limit, offset = window
    with Cache() as cache:
        cache.append(messages(1, 1_500))
        cache.flush()
        expr = parse("not source_name is empty")
        whole = [one.unique_id for one in sorted(cache.query(), key=lambda one: (text(one), one.row), reverse=largest_first)]
        found = cache.query_by(text, expr, limit=limit, offset=offset, largest_first=largest_first, take_last=take_last)
        end = max(0, len(whole) - offset)
        wanted = whole[0 if limit is None else max(0, end - limit) : end] if take_last else whole[offset:]
        assert ids_of(found) == (wanted if limit is None or take_last else wanted[:limit])


def test_sorting_too_many_rows_by_a_text_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the manual's error, at once; a limit makes it possible again, however many rows there are."""
    monkeypatch.setattr(queries_module, "SORT_ROWS", 100)
    with Cache() as cache:
        cache.append(messages(1, 101))
        cache.flush()
        with pytest.raises(AdsError, match="more than 100 events"):
            cache.query_by(text)
        with pytest.raises(AdsError, match="more than 100 events"):
            cache.query_by(text, limit=99, offset=2)
        assert len(ids_of(cache.query_by(text, limit=99, offset=1))) == 99
        assert len(ids_of(cache.query_by(text, parse("event_id < 5")))) == 51


# Forgetting.


def test_forgetting_rows_and_lives() -> None:
    """All transitions of a life go with it; alarm states, other rows and numbers stay."""
    with Cache() as cache:
        cache.append(lives())
        cache.append(StoreBatch(alarms=(alarm(1),)))
        cache.flush()
        assert cache.forget([2], [1]) == 4
        assert ids_of(cache.query(newest_first=False)) == [3, 4]
        assert cache.forget([2], [1]) == 0
        assert cache.forget() == 2
        assert (cache.count(), cache.load_alarms()) == (0, [alarm(1)])
        cache.append(messages(7, 7))
        cache.flush()
        assert [one.row for one in cache.query()] == [7]


def test_forgetting_everything_goes_in_pieces(tmp_path: Path) -> None:
    """Twelve thousand rows, and the pages are free again."""
    with Cache(tmp_path / "cache.db") as cache:
        for n in range(1, 12_001, 1_000):
            cache.append(messages(n, n + 999))
        cache.flush()
        full = cache.used_bytes()
        assert cache.forget() == 12_000
        assert cache.used_bytes() < full / 5


# Bad files.


def foreign(path: Path) -> None:
    """Another program's database."""
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE events (id)")
    connection.close()


def test_a_bad_file_is_moved_aside_only_on_demand(tmp_path: Path) -> None:
    """Refused and left alone; moved aside it is whole under another name, each time a new one."""
    path = tmp_path / "cache.db"
    for number in (1, 2):
        foreign(path)
        before = path.read_bytes()
        with pytest.raises(CacheError, match="another program") as refused:
            Cache(path)
        assert refused.value.bad
        assert path.read_bytes() == before
        (tmp_path / "cache.db-wal").write_bytes(b"left over")
        assert move_aside(str(path)) == tmp_path / f"cache.db.bad-{number}"
        assert (tmp_path / f"cache.db.bad-{number}").read_bytes() == before
        assert (tmp_path / f"cache.db.bad-{number}-wal").read_bytes() == b"left over"
        assert not path.exists()
    Cache(path).close()


def test_a_file_in_use_is_not_bad(tmp_path: Path) -> None:
    """Nobody may move aside what another logger writes into; nor what a newer program wrote."""
    with Cache(tmp_path / "cache.db"), pytest.raises(CacheError) as refused:
        Cache(tmp_path / "cache.db")
    assert not refused.value.bad
    connection = sqlite3.connect(tmp_path / "cache.db")
    connection.execute("PRAGMA user_version=99")
    connection.close()
    with pytest.raises(CacheError, match="newer") as refused:
        Cache(tmp_path / "cache.db")
    assert not refused.value.bad


def test_a_damaged_file_is_bad(tmp_path: Path) -> None:
    """Also when only its middle is destroyed."""
    path = tmp_path / "cache.db"
    with Cache(path) as cache:
        cache.append(messages(1, 2_000))
        cache.flush()
    data = bytearray(path.read_bytes())
    for at in range(4096 * 3, len(data) - 4096, 4096):
        data[at : at + 600] = b"\xff" * 600
    path.write_bytes(data)
    with pytest.raises(CacheError) as refused:
        Cache(path)
    assert refused.value.bad
