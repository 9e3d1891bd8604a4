"""Writing: what goes in comes out, together or not at all, and a disk that fails is heard."""

import os
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep

import msgspec
import pytest

from bridge.core.codec import encode
from bridge.core.events import AnyEvent
from bridge.edges.cache import Cache, CacheCounts, CacheError, Drop, RowError, StoreBatch, Stored, StoredAnswer
from bridge.edges.cache import store as store_module
from bridge.testing.builders import TIME_NS, alarm_raised, message_sent
from tests.unit.edges.cache_stories import NASTY_TEXTS, alarm, events_of, ids_of, message, messages, one_of_each_kind, stored


@pytest.fixture(params=["file", "memory"])
def cache(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Cache]:
    """The same class on disk and in memory."""
    with Cache(tmp_path / "cache.db" if request.param == "file" else ":memory:") as made:
        yield made


def until(condition: object, seconds: float = 10.0) -> None:
    """Wait for a condition with a deadline."""
    assert callable(condition)
    end = monotonic() + seconds
    while not condition():
        assert monotonic() < end, "the condition did not come true"
        sleep(0.005)


def test_every_kind_comes_out_as_it_went_in(cache: Cache) -> None:
    """All fields, also those without a column; absent, 0 and "" stay different."""
    events = one_of_each_kind()
    cache.append(StoreBatch(stored(events, first_id=40)))
    cache.flush()
    found = list(cache.query(newest_first=False))
    assert events_of(found) == list(events)
    assert [(one.row, one.unique_id, one.arrival_ns) for one in found] == [(n + 1, 40 + n, TIME_NS + n) for n in range(6)]


def test_an_event_over_a_limit_comes_out_too(cache: Cache) -> None:
    """Limits are judged where events come in, not here."""
    event = message_sent(json_attribute="x" * 100_000, source_name="y" * 5_000, event_class="no guid")
    cache.append(StoreBatch(stored([event])))
    cache.flush()
    assert events_of(cache.query()) == [event]


@pytest.mark.parametrize("text", NASTY_TEXTS)
def test_nasty_texts_come_out_as_they_went_in(cache: Cache, text: str) -> None:
    """NUL, lone surrogates, quotes, wildcards: in events and in alarms, as text and as part of the key."""
    event = message_sent(source_name=text, json_attribute=text, comment=text)
    plain = alarm(2, source_name="?")
    nasty = alarm(2, source_name=text)
    cache.append(StoreBatch(stored([event]), (plain, nasty)))
    cache.flush()
    assert events_of(cache.query()) == [event]
    assert {kept.alarm.key for kept in cache.load_alarms()} == {plain.alarm.key, nasty.alarm.key}
    assert nasty in cache.load_alarms("plc1")


def test_the_bytes_of_the_sender_are_taken_when_given(cache: Cache) -> None:
    """Who has encoded the event already need not do it twice."""
    event = message(1)
    cache.append(StoreBatch((Stored(1, 2, event, encode(event)),)))
    cache.flush()
    assert events_of(cache.query()) == [event]


@pytest.mark.parametrize("bad", [2**63, -(2**63) - 1, 1.5, "1", None])
def test_what_fits_no_column_is_refused_at_the_call(cache: Cache, bad: object) -> None:
    """The caller hears it, nothing of the batch is taken, and the writer never meets it."""
    broken: AnyEvent = message(2)
    msgspec.structs.force_setattr(broken, "time_ns", bad)
    with pytest.raises(RowError):
        cache.append(StoreBatch(stored([message(1), broken])))
    cache.append(messages(3, 3))
    cache.flush()
    assert events_of(cache.query()) == [message(3)]


def test_texts_that_are_none_are_refused_at_the_call(cache: Cache) -> None:
    """A number for a text, a lone surrogate or a number in meta, an id of an alarm that is none."""
    broken: AnyEvent = message(2)
    msgspec.structs.force_setattr(broken, "json_attribute", 5)
    text: object = 5
    batches = [
        StoreBatch(stored([broken])),
        StoreBatch(meta={"a": "\ud800"}),
        StoreBatch(meta={"a": text}),  # type: ignore[dict-item]
        StoreBatch(alarms=(alarm(unique_id=2**63),)),
        StoreBatch(alarms=(alarm(unique_id=-1),)),
    ]
    for batch in batches:
        with pytest.raises(RowError):
            cache.append(batch)
    assert cache.counts == CacheCounts()


def test_an_event_seen_twice_is_stored_once(cache: Cache) -> None:
    """Same target, session and seq: counted as a duplicate, the first one stays. seq 0 is no number."""
    cache.append(messages(1, 10))
    cache.append(messages(6, 15))
    unnumbered = message_sent()
    cache.append(StoreBatch(stored([unnumbered, unnumbered, message(1, "s2")])))
    cache.flush()
    counts = cache.counts
    assert (counts.stored, counts.duplicates, counts.pending) == (18, 5, 0)
    assert cache.count() == 18
    assert ids_of(cache.query(newest_first=False, limit=15)) == list(range(1, 16))


def test_alarm_states_are_kept_by_key(cache: Cache) -> None:
    """The latest state of a key counts, also within one transaction; a removal in a batch comes after its states."""
    first, second, third = alarm(1), alarm(2), alarm(3, source_name=None)
    cache.append(StoreBatch(alarms=(first, second, third)))
    cache.append(StoreBatch(alarms=(alarm(1, raised=False),), removals=(second.alarm.key,)))
    cache.append(StoreBatch(alarms=(alarm(4),), removals=(alarm(4).alarm.key,)))
    cache.append(StoreBatch(removals=(third.alarm.key,)))
    cache.append(StoreBatch(alarms=(alarm(3, unique_id=9, source_name=None),)))
    cache.flush()
    assert cache.load_alarms() == [alarm(1, raised=False), alarm(3, unique_id=9, source_name=None)]
    assert cache.load_alarms("plc2") == []


def test_the_absence_of_a_source_is_part_of_the_key(cache: Cache) -> None:
    """No name and an empty name are two alarms."""
    both = (alarm(1, source_name=None), alarm(1, source_name=""))
    cache.append(StoreBatch(alarms=both))
    cache.flush()
    assert {kept.unique_id for kept in cache.load_alarms()} == {7}
    assert len(cache.load_alarms()) == 2


def test_facts_are_kept_by_name(tmp_path: Path) -> None:
    """Next unique id, session, mark of a clean stop: the last value counts, also after reopening."""
    with Cache(tmp_path / "cache.db") as cache:
        cache.append(StoreBatch(meta={"next_unique_id": "5", "session": "a b\nc"}))
        cache.append(StoreBatch(meta={"next_unique_id": "6"}))
    with Cache(tmp_path / "cache.db") as cache:
        assert cache.meta() == {"next_unique_id": "6", "session": "a b\nc"}


def test_state_that_must_survive_a_power_cut_is_synced(cache: Cache) -> None:
    """append(durable=True) commits once, with synchronous FULL; flush(durable=True) syncs what was committed without."""
    traced: list[str] = []
    with cache._file.turn() as connection:
        connection.set_trace_callback(traced.append)
    cache.append(messages(1, 1))
    cache.flush()
    assert not any("synchronous" in line for line in traced)
    traced.clear()
    cache.flush(durable=True)
    modes = [line for line in traced if line.startswith(("BEGIN", "COMMIT", "PRAGMA sync"))]
    assert modes == ["PRAGMA synchronous=FULL", "BEGIN IMMEDIATE", "COMMIT", "PRAGMA synchronous=NORMAL"]
    assert any("UPDATE" in line or "INSERT" in line for line in traced), "without a change there is no commit to sync"
    traced.clear()
    cache.append(messages(2, 2), durable=True)
    cache.flush(durable=True)
    assert [line for line in traced if line.startswith(("COMMIT", "PRAGMA synchronous=F"))] == [*modes[:1], "COMMIT"]
    traced.clear()
    cache.flush(durable=True)
    assert traced == []


def test_the_older_half_is_dropped_when_the_file_is_full(tmp_path: Path) -> None:
    """Used bytes stay under the maximum plus one batch, the newest half is whole, alarms stay, the number is told and kept."""
    told: list[Drop] = []
    limit = 400_000
    with Cache(tmp_path / "cache.db", max_bytes=limit, on_dropped=told.append) as cache:
        cache.append(StoreBatch(alarms=(alarm(1), alarm(2)), meta={"session": "s1"}))
        most = 0
        for n in range(1, 3_000, 100):
            cache.append(messages(n, n + 99))
            cache.flush()
            most = max(most, cache.used_bytes())
        kept = ids_of(cache.query(newest_first=False))
        assert len(told) >= 3
        assert most < limit + 130_000
        assert kept == list(range(kept[0], 3_001))
        assert len(kept) > 300
        assert kept[0] - 1 == sum(drop.count for drop in told) == cache.counts.dropped == int(cache.meta()["dropped_events"])
        assert cache.load_alarms() == [alarm(1), alarm(2)]
        assert cache.meta()["session"] == "s1"


def test_a_row_number_is_never_used_twice(tmp_path: Path) -> None:
    """A cursor that somebody holds stays true when everything was dropped and the file was opened again."""
    path = tmp_path / "cache.db"
    with Cache(path) as cache:
        cache.append(messages(1, 10))
        cache.flush()
        with cache._file.turn() as connection:
            connection.execute("DELETE FROM events")
    with Cache(path) as cache:
        cache.append(messages(11, 11))
        cache.flush()
        assert [one.row for one in cache.query(after=10)] == [11]


def test_the_report_of_a_drop_can_be_an_event(tmp_path: Path) -> None:
    """on_dropped runs on the writer's thread and may append, even while the queue is full."""
    reports = iter(range(1, 1_000))

    def report(drop: Drop) -> None:
        text = str(drop.count)
        made.append(StoreBatch(stored([message_sent(event_id=99, session="r", seq=next(reports), json_attribute=text)])))

    with Cache(max_bytes=store_module.MIN_BYTES, on_dropped=report, max_pending=200) as made:
        for n in range(1, 5_000, 100):
            made.append(messages(n, n + 99))
        made.flush()
        assert any(event.event_id == 99 for event in events_of(made.query()))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_writer_that_breaks_is_heard(tmp_path: Path) -> None:
    """An unforeseen exception on the writer's thread: each later call says so, and nothing waits for ever."""

    def broken(_: Drop) -> None:
        raise ZeroDivisionError("a fault of ours")

    cache = Cache(tmp_path / "cache.db", max_bytes=store_module.MIN_BYTES, on_dropped=broken)
    cache.append(messages(1, 2_000))
    until(lambda: cache.error is not None)
    with pytest.raises(CacheError, match="a fault of ours"):
        cache.append(messages(2_001, 2_001))
    assert cache.counts.refused == 1
    cache.close()


def flushed(cache: Cache) -> bool:
    """Whether everything could be written."""
    try:
        cache.flush()
    except CacheError:
        return False
    return True


def _limit_pages(cache: Cache, pages: int) -> None:
    with cache._file.turn() as connection:
        connection.execute(f"PRAGMA max_page_count={pages}")


def test_a_full_disk_is_heard_and_nothing_is_lost(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error is kept, append and flush raise it, what waits is counted; with room again all of it is written, in order."""
    monkeypatch.setattr(store_module, "_RETRY_S", 0.02)
    cache.append(StoreBatch(alarms=(alarm(1),)))
    cache.append(messages(1, 100))
    cache.flush()
    _limit_pages(cache, 1)
    accepted = 0
    for n in range(101, 3_000, 100):
        cache.append(StoreBatch(messages(n, n + 99).events, meta={"upto": str(n + 99)}))
        accepted = n + 99
        if not flushed(cache):
            break
    assert cache.error is not None
    assert cache.error.code == "SQLITE_FULL"
    with pytest.raises(CacheError) as caught:
        cache.append(messages(accepted + 1, accepted + 100))
    assert caught.value is cache.error
    counts = cache.counts
    assert counts.refused == 100
    assert counts.pending == accepted - counts.stored > 0
    assert cache.load_alarms() == [alarm(1)], "what is kept can be read meanwhile"
    assert cache.count() == counts.stored
    _limit_pages(cache, 1_000_000)
    until(lambda: cache.error is None)
    cache.append(messages(accepted + 1, accepted + 10))
    cache.flush()
    assert ids_of(cache.query(newest_first=False)) == list(range(1, accepted + 11))
    assert cache.meta()["upto"] == str(accepted)


def test_closing_on_a_full_disk_says_how_much_is_lost(tmp_path: Path) -> None:
    """close() returns the number of rows, leaving the block raises, and neither waits for the disk."""
    cache = Cache(tmp_path / "a.db")
    _limit_pages(cache, 1)
    cache.append(messages(1, 500))
    with pytest.raises(CacheError, match="full"):
        cache.__exit__(None, None, None)
    cache = Cache(tmp_path / "b.db")
    _limit_pages(cache, 1)
    cache.append(messages(1, 500))
    assert cache.close() == 500
    with Cache(tmp_path / "b.db") as again:
        assert again.count() == 0


def test_a_batch_is_kept_whole_or_not_at_all(tmp_path: Path) -> None:
    """Events, alarms and facts of one batch share a transaction, however large it is."""
    with Cache(tmp_path / "cache.db") as cache:
        cache.append(messages(1, 10))
        cache.flush()
        _limit_pages(cache, 60)
        cache.append(StoreBatch(messages(11, 2_500).events, (alarm(1),), meta={"upto": "2500"}))
        with pytest.raises(CacheError):
            cache.flush()
        assert (cache.count(), cache.load_alarms(), cache.meta()) == (10, [], {})
        _limit_pages(cache, 1_000_000)
        until(lambda: cache.error is None)
        assert (cache.count(), cache.load_alarms(), cache.meta()) == (2_500, [alarm(1)], {"upto": "2500"})


def test_a_transaction_that_breaks_in_the_middle_leaves_nothing() -> None:
    """Also when SQLite leaves it open: events that went in before the fault are taken back, and it is not tried for ever."""
    cache = Cache()
    with cache._file.turn() as connection:
        connection.execute("CREATE TEMP TRIGGER fault BEFORE INSERT ON alarms BEGIN SELECT RAISE(ABORT, 'a fault'); END")
    cache.append(StoreBatch(messages(1, 10).events, (alarm(1),)))
    with pytest.raises(CacheError, match="a fault"):
        cache.flush()
    assert cache.count() == 0
    assert cache.counts.pending == 10
    assert cache.close() == 11


def test_closing_never_hangs(cache: Cache) -> None:
    """A disk that does not answer: close() returns after its time with the number of rows that are not written."""
    with cache._file.turn():
        cache.append(messages(1, 5))
        with pytest.raises(TimeoutError):
            cache.flush(0.05)
        started = monotonic()
        assert cache.close(0.2) == 5
        assert monotonic() - started < 2
        with pytest.raises(CacheError, match="closed"):
            cache.append(messages(6, 6))
    cache._writer.join(10)
    assert cache.close() == 0, "what waited was written when the disk answered again"


def test_a_closed_cache_says_so() -> None:
    """Every call after close() raises CacheError; closing again does nothing."""
    cache = Cache()
    cache.append(messages(1, 1_500))
    cache.flush()
    asked = cache.query(newest_first=False)
    next(asked)
    assert cache.close() == 0
    assert cache.counts.stored == 1_500
    cache.flush()
    for call in (
        lambda: cache.append(messages(2, 2)),
        cache.query,
        cache.count,
        cache.load_alarms,
        cache.meta,
        lambda: list(asked),
    ):
        with pytest.raises(CacheError, match="closed"):
            call()
    assert cache.close() == 0


def test_close_writes_what_waits(tmp_path: Path) -> None:
    """Nothing that was taken is lost by leaving the block without a flush."""
    with Cache(tmp_path / "cache.db") as cache:
        for n in range(1, 20_001, 10):
            cache.append(messages(n, n + 9))
    with Cache(tmp_path / "cache.db") as cache:
        assert cache.count() == 20_000


def test_a_full_queue_makes_the_sender_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """append() waits for room, and after a time refuses; a batch larger than the queue still goes."""
    monkeypatch.setattr(store_module, "_ROOM_S", 0.05)
    with Cache(max_pending=10) as cache:
        cache.append(messages(1, 50))
        cache.flush()
        with cache._file.turn():
            cache.append(messages(51, 58))
            with pytest.raises(CacheError, match="waiting"):
                cache.append(messages(59, 68))
            assert cache.counts.refused == 10
        monkeypatch.setattr(store_module, "_ROOM_S", 10.0)
        cache.append(messages(59, 68))
        cache.flush()
        assert cache.count() == 68


def test_many_threads_append(cache: Cache) -> None:
    """Each thread's events are there once and in its order."""

    def send(session: str) -> None:
        for n in range(1, 301, 3):
            cache.append(messages(n, n + 2, session))

    threads = [threading.Thread(target=send, args=(f"s{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    cache.flush()
    for n in range(4):
        assert events_of(cache.numbered("plc1", f"s{n}")) == [message(i, f"s{n}") for i in range(1, 301)]


def test_a_maximum_too_small_for_the_tables_is_refused() -> None:
    """Else every event would be dropped at once."""
    with pytest.raises(ValueError, match="max_bytes"):
        Cache(max_bytes=store_module.MIN_BYTES - 1)


def test_an_alarm_life_shares_its_unique_id(cache: Cache) -> None:
    """unique_id is one per life, so transitions repeat it."""
    lives = [Stored(5, TIME_NS, alarm_raised(seq=n)) for n in (1, 2, 3)]
    cache.append(StoreBatch(lives))
    cache.flush()
    assert ids_of(cache.query()) == [5, 5, 5]


def fill(path: Path) -> None:
    """Write zeros until the disk is full."""
    try:
        with path.open("wb", buffering=0) as file:
            for _ in range(100_000):
                file.write(bytes(4096))
    except OSError:
        return
    pytest.fail("the disk is larger than it should be")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 2 MB."""
    if os.geteuid() != 0:
        pytest.skip("mounting a small tmpfs needs root")
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(place)], capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_real_full_disk(small_disk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Heard, readable, opened again while full, and written on when there is room."""
    monkeypatch.setattr(store_module, "_RETRY_S", 0.02)
    path = small_disk / "cache.db"
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(800_000))
    cache = Cache(path, max_bytes=100_000_000)
    cache.append(StoreBatch(alarms=(alarm(1),)))
    last = 0
    for n in range(1, 10_000, 100):
        cache.append(messages(n, n + 99))
        if not flushed(cache):
            break
        last = n + 99
    assert cache.error is not None
    assert cache.error.code == "SQLITE_FULL"
    assert last > 100
    assert cache.load_alarms() == [alarm(1)]
    assert ids_of(cache.query(newest_first=False)) == list(range(1, last + 1))
    assert cache.close() == 100
    fill(small_disk / "rest")
    cache = Cache(path, max_bytes=100_000_000)
    try:
        assert cache.load_alarms() == [alarm(1)]
        assert ids_of(cache.query(newest_first=False)) == list(range(1, last + 1))
        cache.append(messages(last + 1, last + 100))
        with pytest.raises(CacheError):
            cache.flush()
        ballast.unlink()
        (small_disk / "rest").unlink()
        until(lambda: cache.error is None)
        assert cache.count() == last + 100
    finally:
        assert cache.close() == 0


def test_the_last_answers_are_kept(cache: Cache) -> None:
    """Oldest first, each once, and no more than a thousand, however they come."""
    made = [StoredAnswer(number.to_bytes(16), "s1", number, number % 2 == 0) for number in range(2_500)]
    for start in range(0, 2_500, 50):
        cache.append(StoreBatch(answers=made[start : start + 50]))
    cache.append(StoreBatch(answers=made[-3:]))
    cache.flush()
    assert cache.load_answers() == made[-1_000:]
