"""Asking: pages, cursors, filters that SQL cannot answer alone, and rows that arrive or go meanwhile."""

import threading
from collections.abc import Callable, Iterator

import pytest

from bridge.core.events import AnyEvent, Severity
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.spelling import where
from bridge.core.filters.sql import sql
from bridge.core.keys import EventKey
from bridge.edges.cache import Cache, SessionRange, StoreBatch
from bridge.edges.cache.queries import PAGE
from bridge.edges.cache.rows import EVENT_COLUMNS
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, TIME_NS, alarm_raised, message_sent
from tests.unit.edges.cache_stories import NASTY_TEXTS, events_of, ids_of, message, messages, one_of_each_kind, stored

COUNT = 2 * PAGE + 700


@pytest.fixture(scope="module")
def cache() -> Iterator[Cache]:
    """COUNT messages with the unique ids 1, 2, ..."""
    with Cache() as made:
        made.append(messages(1, COUNT))
        made.flush()
        yield made


ALL = list(range(1, COUNT + 1))


def test_all_pages_come_in_order_of_arrival(cache: Cache) -> None:
    """Newest first unless told otherwise; no row twice, none left out at the seams."""
    assert ids_of(cache.query()) == ALL[::-1]
    assert ids_of(cache.query(newest_first=False)) == ALL
    assert events_of(cache.query(newest_first=False)) == [message(n) for n in ALL]
    assert cache.count() == COUNT


@pytest.mark.parametrize("limit", [0, 1, PAGE - 1, PAGE, PAGE + 1, COUNT + 5])
@pytest.mark.parametrize("offset", [0, 3, PAGE, COUNT])
def test_limit_and_offset(cache: Cache, limit: int, offset: int) -> None:
    """As a slice of all, whatever the size of a page."""
    assert ids_of(cache.query(limit=limit, offset=offset)) == ALL[::-1][offset : offset + limit]
    assert ids_of(cache.query(limit=limit, offset=offset, newest_first=False)) == ALL[offset : offset + limit]


def test_cursors(cache: Cache) -> None:
    """after and before are excluded, and a page of a client follows the one before."""
    assert ids_of(cache.query(after=10, before=14)) == [13, 12, 11]
    assert ids_of(cache.query(after=COUNT)) == []
    seen: list[int] = []
    row = None
    for _ in range(COUNT):
        page = list(cache.query(limit=300, before=row))
        if not page:
            break
        seen += ids_of(page)
        row = page[-1].row
    assert seen == ALL[::-1]


@pytest.mark.parametrize("order", ["time_ns", "severity", "source_name", "unique_id"])
@pytest.mark.parametrize("newest_first", [True, False])
def test_any_column_sorts(cache: Cache, order: str, newest_first: bool) -> None:
    """Equal values in order of arrival, in the same direction; pages end in the middle of equal values."""
    keys = [(n if order == "unique_id" else getattr(message(n), order), n) for n in ALL]
    expected = [n for _, n in sorted(keys, reverse=newest_first)]
    assert ids_of(cache.query(order=order, newest_first=newest_first)) == expected
    assert ids_of(cache.query(order=order, newest_first=newest_first, limit=7, offset=1_100)) == expected[1_100:1_107]


def test_wrong_questions_are_refused_at_the_call(cache: Cache) -> None:
    """Not when the first row is taken."""
    for order in ("body", "inexact_text", "nothing", "id; DROP TABLE events"):
        with pytest.raises(ValueError, match="sort"):
            cache.query(order=order)
    with pytest.raises(ValueError, match="negative"):
        cache.query(limit=-1)
    with pytest.raises(ValueError, match="negative"):
        cache.query(offset=-1)
    with pytest.raises(ValueError, match="event class"):
        cache.query(where.event_class == "a name")


EXACT = (
    Everything(),
    where.severity >= Severity.ERROR,
    (where.event_class == OTHER_CLASS) & (where.unique_id > 1_200),
    where.source_name.like("%AXIS[3]"),
    ~where.event_id.in_(1, 2, 3),
    where.unique_id.between(990, 1_010),
)
INEXACT = (
    where.json("/axis") == 3,
    ~(where.json("/axis") == 3),
    (where.json("/axis") >= 2) & where.source_name.like("main.%_[5]"),
    (where.json("/axis") == 3) | (where.unique_id < 5),
    ((where.json("/axis") == 1) | (where.unique_id != 8)) & ~where.unique_id.in_(5, 9),
    where.json("/nothing") == 3,
)


def wanted(filter: Expr, unique_id: int) -> bool:
    """What the predicate says of message(unique_id), its unique id put in the place of the event id."""
    unique: dict[Expr, Callable[[int], bool]] = {
        EXACT[2]: lambda n: message(n).event_class == OTHER_CLASS and n > 1_200,
        EXACT[5]: lambda n: 990 <= n <= 1_010,
        INEXACT[3]: lambda n: n % 4 == 3 or n < 5,
        INEXACT[4]: lambda n: (n % 4 == 1 or n != 8) and n not in (5, 9),
    }
    if filter in unique:
        return unique[filter](unique_id)
    return compile_filter(filter)(message(unique_id))


@pytest.mark.parametrize("filter", EXACT + INEXACT, ids=range(len(EXACT + INEXACT)))
def test_a_filter_with_limit_and_offset(cache: Cache, filter: Expr) -> None:
    """LIMIT and OFFSET count what the filter wants, also where SQL lets more through."""
    assert sql(filter).exact is (filter in EXACT)
    expected = [n for n in reversed(ALL) if wanted(filter, n)]
    assert ids_of(cache.query(filter)) == expected
    assert ids_of(cache.query(filter, limit=5)) == expected[:5]
    assert ids_of(cache.query(filter, limit=5, offset=7)) == expected[7:12]
    assert ids_of(cache.query(filter, limit=1_100, offset=1, newest_first=False)) == expected[::-1][1:1_101]
    assert cache.count(filter) == len(expected)


def test_rows_that_sql_cannot_hold_are_judged_by_the_predicate() -> None:
    """Among plain rows, lone surrogates and NUL: what a filter wants is what its predicate says, counted and limited."""
    events: list[AnyEvent] = [message_sent(source_name=text, json_attribute=text) for text in NASTY_TEXTS]
    events += one_of_each_kind()
    events += [message(n) for n in range(1, 40)]
    filters = [
        Everything(),
        where.source_name == "?",
        where.source_name != "?",
        ~(where.source_name == "x?\0"),
        where.source_name.like("x_\0"),
        where.source_name.like("%b"),
        ~where.source_name.like("%?%"),
        where.source_name.is_empty(),
        where.severity >= Severity.WARNING,
        where.json("") == True,  # noqa: E712 - builds a filter
        where.json("/axis") == 3,
    ]
    with Cache() as cache:
        cache.append(StoreBatch(stored(events)))
        cache.flush()
        for filter in filters:
            matches = compile_filter(filter)
            expected = [event for event in events if matches(event)]
            assert events_of(cache.query(filter, newest_first=False)) == expected
            assert events_of(cache.query(filter, newest_first=False, limit=3, offset=1)) == expected[1:4]
            assert cache.count(filter) == len(expected)


def test_a_query_ends_while_events_arrive_without_end() -> None:
    """Rows that come after the question are not in the answer; each that was there is, once, in both directions."""
    stop = threading.Event()
    with Cache() as cache:
        cache.append(messages(1, 3_000))
        cache.flush()

        def send() -> None:
            for n in range(3_001, 200_000, 20):
                if stop.is_set():
                    return
                cache.append(messages(n, n + 19))

        sender = threading.Thread(target=send)
        sender.start()
        try:
            for newest_first in (True, False, True, False):
                found = ids_of(cache.query(newest_first=newest_first))
                assert len(found) >= 3_000
                assert sorted(found) == list(range(1, len(found) + 1))
                assert found == sorted(found, reverse=newest_first)
        finally:
            stop.set()
            sender.join(30)


@pytest.mark.parametrize("filter", [None, where.json("/axis") == 3])
@pytest.mark.parametrize("order", ["id", "time_ns"])
def test_what_arrives_after_the_question_is_not_in_the_answer(filter: Expr | None, order: str) -> None:
    """Also when the answer is read later, in pages."""
    with Cache() as cache:
        cache.append(messages(1, 1_500))
        cache.flush()
        answers = [cache.query(filter, newest_first=newest_first, order=order) for newest_first in (True, False)]
        before = [ids_of(cache.query(filter, newest_first=newest_first, order=order)) for newest_first in (True, False)]
        cache.append(messages(1_501, 3_000))
        cache.flush()
        assert [ids_of(answer) for answer in answers] == before


def test_a_query_survives_that_its_rows_are_dropped() -> None:
    """Pages already taken stay, rows that are gone are left out, nothing breaks."""
    with Cache() as cache:
        cache.append(messages(1, 3_000))
        cache.flush()
        answer = cache.query(newest_first=False)
        first = ids_of(next(answer) for _ in range(PAGE))
        with cache._file.turn() as connection:
            connection.execute("DELETE FROM events WHERE id <= 2500")
        assert first + ids_of(answer) == [*range(1, PAGE + 1), *range(2_501, 3_001)]


def test_sessions_and_their_events_by_number() -> None:
    """Events that came late stand where they belong; ranges are inclusive; unnumbered ones are in no session."""
    with Cache() as cache:
        cache.append(messages(1_500, 2_600, "b"))
        cache.append(messages(1, 1_499, "b"))
        cache.append(messages(3, 9, "a"))
        cache.append(StoreBatch(stored([message_sent(target="plc2", session="a", seq=4), message_sent(session="b")])))
        cache.flush()
        assert cache.sessions() == [
            SessionRange("plc1", "b", 2_600, 1, 2_600),
            SessionRange("plc1", "a", 7, 3, 9),
            SessionRange("plc2", "a", 1, 4, 4),
        ]
        assert cache.sessions("plc2") == [SessionRange("plc2", "a", 1, 4, 4)]
        assert events_of(cache.numbered("plc1", "b")) == [message(n, "b") for n in range(1, 2_601)]
        assert ids_of(cache.numbered("plc1", "b", 1_498, 1_501)) == [1_498, 1_499, 1_500, 1_501]
        assert ids_of(cache.numbered("plc1", "none")) == []


def test_a_gap_of_a_key_is_found_by_its_numbers() -> None:
    """Exactly the events of that session, class, severity and type whose key_seq is in the range."""
    events: list[AnyEvent] = [
        message_sent(session="s1", seq=n, key_seq=(n + 1) // 2, event_class=EVENT_CLASS if n % 2 else OTHER_CLASS)
        for n in range(1, 5_001)
    ]
    events += [alarm_raised(session="s1", seq=5_001, key_seq=5), message_sent(session="s2", seq=9, key_seq=5)]
    key = EventKey("live", "plc1", OTHER_CLASS, False, Severity.INFO)
    with Cache() as cache:
        cache.append(StoreBatch(stored(events)))
        cache.flush()
        assert ids_of(cache.numbered_of_key("s1", key, 5, 7)) == [10, 12, 14]
        assert ids_of(cache.numbered_of_key("s1", key, 1, 9_999)) == list(range(2, 5_001, 2))
        assert ids_of(cache.numbered_of_key("s1", key, 2_501, 2_600)) == []
        assert ids_of(cache.numbered_of_key("s2", key, 5, 5)) == []


KEY = EventKey("live", "plc1", OTHER_CLASS, False, Severity.INFO)
PLANS: tuple[tuple[str, Callable[[Cache], object]], ...] = (
    ("INTEGER PRIMARY KEY", lambda cache: list(cache.query(limit=100, offset=3))),
    ("INTEGER PRIMARY KEY", lambda cache: list(cache.query(newest_first=False))),
    ("events_by_class", lambda cache: list(cache.query(where.event_class == OTHER_CLASS, limit=100))),
    (
        "events_by_class",
        lambda cache: list(
            cache.query(
                (where.event_class == OTHER_CLASS) & (where.severity >= Severity.ERROR) & where.source_name.like("%[3]")
            )
        ),
    ),
    ("events_by_time", lambda cache: list(cache.query(order="time_ns"))),
    ("events_by_number", lambda cache: list(cache.numbered("plc1", "s1"))),
    ("events_by_number", lambda cache: list(cache.numbered_of_key("s1", KEY, 3, 7))),
)


@pytest.mark.parametrize(("index", "ask"), PLANS)
def test_the_plans_use_an_index_and_sort_nothing(cache: Cache, index: str, ask: Callable[[Cache], object]) -> None:
    """The common questions cost what their answer costs, not what the file holds; each page of them."""
    asked: list[str] = []
    with cache._file.turn() as connection:
        connection.set_trace_callback(asked.append)
    try:
        ask(cache)
    finally:
        with cache._file.turn() as connection:
            connection.set_trace_callback(None)
    pages = [question for question in asked if " ORDER BY " in question]
    assert pages
    for question in pages:
        plan = " ".join(row[3] for row in cache._file.read(f"EXPLAIN QUERY PLAN {question}"))
        assert index in plan
        assert "TEMP B-TREE" not in plan


def test_the_columns_are_those_of_the_table(cache: Cache) -> None:
    """The table of the newest version has the columns that rows are made for, and none of them may be NULL."""
    columns = cache._file.read("SELECT name, \"notnull\" FROM pragma_table_info('events')")
    assert [name for name, _ in columns] == ["id", *EVENT_COLUMNS]
    assert {name for name, required in columns if not required} == {"id"}


def test_arrival_times_are_kept(cache: Cache) -> None:
    """When the logger got it, apart from the event's own time."""
    assert [one.arrival_ns - TIME_NS for one in cache.query(limit=2)] == [COUNT - 1, COUNT - 2]
