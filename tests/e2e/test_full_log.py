"""A log at its limits: full while it is written and asked, a million events asked for, a million rows as CSV."""

import resource
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.catalog import Catalog
from bridge.core.csv_export import Column, CsvSettings, export_csv, import_csv, read_csv
from bridge.core.event_fields import EventField
from bridge.core.events import MessageSent, Severity, Source
from bridge.core.filters.sql import sql
from bridge.core.filters.text import parse
from bridge.core.own_events import CACHE_DROPPED, OWN_CLASS
from bridge.core.questions import LogQuestion, Stored
from bridge.edges.bus import ALONE, open_bus
from bridge.edges.cache import Cache, StoreBatch
from bridge.edges.cache import Stored as Row
from bridge.logger import EventLogger, LoggerProxy
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, TIME_NS

MILLION = 1_000_000
PUMP = Source(name="MAIN.pump")
BATCH_BYTES = 1_000 * 1_200
"""What a transaction of 1,000 of these events adds at most, with its indexes."""


@pytest.mark.timeout(180)
def test_a_full_log_under_load(tmp_path: Path) -> None:
    """Used pages stay under the maximum plus one batch, the newest are whole, drops are reported, queries and alarms go on."""
    limit = 2_000_000
    cache = Cache(tmp_path / "log.db", max_bytes=limit)
    used: list[int] = []
    asked: list[int] = []
    done = threading.Event()
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus, cache=cache, queue_events=1_000_000) as logger:
        created = logger.create_alarm(EVENT_CLASS, 9, Severity.ERROR, with_confirmation=True, source=PUMP).alarm
        assert created is not None
        alarm = logger.raise_alarm(created)

        def watch() -> None:
            while not done.is_set():
                used.append(cache.used_bytes())
                rows = list(logger.log(LogQuestion(filter="severity >= info", limit=50)))
                numbers = [row.unique_id for row in rows]
                assert numbers == sorted(numbers, reverse=True)
                asked.append(len(rows))
                done.wait(0.01)

        watcher = threading.Thread(target=watch)
        watcher.start()
        sent, padding = 0, "y" * 99
        while sent < 15_000 or (len(asked) < 5 and sent < 400_000):
            attribute = f'{{"n": {sent}, "x": "{padding}"}}'
            logger.send_message(EVENT_CLASS, sent, Severity.INFO, source=PUMP, json_attribute=attribute)
            sent += 1
        done.set()
        watcher.join(60)
        assert not watcher.is_alive()
        logger.book.flush(30)
        kept = list(logger.log(LogQuestion(newest_first=False)))
        messages = [row.event.event_id for row in kept if row.event.event_class == EVENT_CLASS]
        drops = cache.counts.dropped
        assert drops > 0
        assert messages == list(range(messages[0], sent))
        assert len(kept) >= limit // 2_500
        assert max(used) <= limit + BATCH_BYTES
        assert len(asked) >= 5
        assert max(asked) == 50
        assert logger.is_raised(alarm)
        deadline = time.monotonic() + 30
        own = LogQuestion(filter=f"event_class = '{OWN_CLASS}'")
        while not (reports := list(logger.log(own))) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert {row.event.event_id for row in reports} == {CACHE_DROPPED}
        assert {row.event.arguments[1].value for row in reports} == {"max_bytes"}
        assert logger.confirm_alarm(alarm).raised


def say(text: str) -> None:
    """For who runs it with -s, and in the report of a failure."""
    sys.stdout.write(f"{text}\n")


def million() -> Iterator[StoreBatch]:
    """A million messages, two classes, five severities, a hundred sources."""
    sources = [f"MAIN.axis[{n}]" for n in range(100)]
    for start in range(1, MILLION + 1, 5_000):
        yield StoreBatch(
            [
                Row(
                    n,
                    TIME_NS + n,
                    MessageSent(
                        target="plc1",
                        event_class=EVENT_CLASS if n % 3 else OTHER_CLASS,
                        event_id=n % 50,
                        severity=Severity(n % 5),
                        session="s",
                        seq=n,
                        key_seq=n,
                        time_ns=TIME_NS + n * 1_000,
                        source_name=sources[n % 100],
                    ),
                )
                for n in range(start, start + 5_000)
            ],
            meta={"next_unique_id": str(MILLION + 1)},
        )


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_newest_hundred_of_a_million(tmp_path: Path) -> None:
    """Unfiltered and with class, severity and source: an index finds them; through the bus too. The times are printed."""
    narrow = f"event_class = '{EVENT_CLASS}' and severity >= error and source_name = 'MAIN.axis[43]'"
    cache = Cache(tmp_path / "log.db", max_bytes=2**40)
    for batch in million():
        cache.append(batch)
    cache.flush(120)
    where = sql(parse(narrow))
    for clause, values in (("1", ()), (where.where, where.parameters)):
        plan = cache._file.read(
            f"EXPLAIN QUERY PLAN SELECT body FROM events WHERE ({clause}) AND id BETWEEN ? AND ? ORDER BY id DESC LIMIT 100",
            (*values, 0, 2 * MILLION),
        )
        steps = [row[3] for row in plan]
        say(str(steps))
        assert len(steps) == 1
        assert steps[0].startswith("SEARCH events USING ")
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus, cache=cache) as logger, LoggerProxy(bus, "plc1") as proxy:
        for name, asked in (("inside", logger), ("through the bus", proxy)):
            for filter, wanted in (
                ("", None),
                (narrow, [n for n in range(MILLION, 0, -1) if n % 100 == 43 and n % 5 >= 3 and n % 3]),
            ):
                began = time.perf_counter()
                found = [row.unique_id for row in asked.log(LogQuestion(filter=filter, limit=100))]
                took = time.perf_counter() - began
                say(f"{name}, {filter or 'unfiltered'}: {took * 1000:.1f} ms")
                assert found == (wanted or list(range(MILLION, 0, -1)))[:100]
                assert took < 5
        began = time.perf_counter()
        count = sum(1 for _ in proxy.log(LogQuestion(limit=50_000)))
        say(f"50,000 in packed replies: {time.perf_counter() - began:.2f} s")
        assert count == 50_000


HOSTILE = (
    'a "quoted" text',
    "two\r\nlines; and a delimiter",
    "=cmd|' /C calc'!A0",
    "+1",
    "-1",
    "@SUM(1)",
    "\t=1",
    "'",
    "''=",
    "Ω 日本語 العربية हिन्दी 🔥 e\u0301 \u2028 \x85",
    "\0\x0b",
    "",
)


def hostile_rows() -> Iterator[Stored]:
    """A million rows that all differ."""
    for n in range(MILLION):
        text = f"{HOSTILE[n % len(HOSTILE)]}{n if n % 2 else ''}"
        event = MessageSent(
            target="plc1", event_class=EVENT_CLASS, event_id=n, severity=Severity.INFO, source_name=text, json_attribute=text
        )
        yield Stored(event=event, unique_id=n + 1, arrival_ns=n)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_million_rows_as_csv(tmp_path: Path) -> None:
    """Written, read and imported again without a difference; the first row at once, the memory that of some hundred rows."""
    settings = CsvSettings(columns=(Column(EventField.SOURCE_NAME), Column(EventField.EVENT_ID)), lossless=True)
    path = tmp_path / "all.csv"
    began = time.perf_counter()
    pieces = export_csv(hostile_rows(), Catalog(), settings)
    next(pieces)
    first = next(pieces)
    assert time.perf_counter() - began < 1
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write("Source Name;Event Id;Record\r\n" + first)
        file.writelines(pieces)
    with path.open(encoding="utf-8", newline="") as file:
        cells = read_csv(file)
        assert next(cells) == ["Source Name", "Event Id", "Record"]
        same = sum(found[0] == row.event.source_name for found, row in zip(cells, hostile_rows(), strict=True))
    assert same == MILLION
    with path.open(encoding="utf-8", newline="") as file:
        same = sum(found == row for found, row in zip(import_csv(file), hostile_rows(), strict=True))
    assert same == MILLION
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000, "KiB more than at the start"


def test_the_memory_of_an_export_does_not_grow() -> None:
    """Twenty thousand rows take no more at once than two thousand."""

    def most(count: int) -> int:
        rows = (row for row, _ in zip(hostile_rows(), range(count), strict=False))
        tracemalloc.start()
        try:
            for _ in export_csv(rows, Catalog(), CsvSettings(lossless=True)):
                pass
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    most(500)
    assert most(20_000) < most(2_000) + 200_000
