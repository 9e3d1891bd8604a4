"""The WHERE clause, asked of a real SQLite: never too little, and exact where it says so."""

import sqlite3
from collections.abc import Iterable

import pytest

from bridge.core.events import AnyEvent, ConfirmationState, Severity
from bridge.core.filters.ast import Everything, Expr, Like, UnknownClassError
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.spelling import where
from bridge.core.filters.sql import MAX_LIKE_BYTES, SqlFilter, sql
from bridge.core.times import MAX_TIME_NS
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, alarm_cleared, alarm_raised, message_sent
from bridge.testing.rows import SCHEMA, row_of

EVENTS: list[AnyEvent] = [
    message_sent(),
    message_sent(event_class=OTHER_CLASS, event_id=0, severity=Severity.CRITICAL, source_id=0, source_name="", time_ns=0),
    message_sent(event_id=2**32 - 1, source_id=2**32 - 1, source_name="PLC.Main.fbAxis", json_attribute='{"axis": 3}'),
    message_sent(source_name="Main\0x", source_guid="00000000-0000-0000-0000-000000000000", vendor_id=2, product_code=0),
    message_sent(source_name="it's 100%_\n\"", json_attribute="not json", time_ns=MAX_TIME_NS),
    message_sent(source_name="\u212aelvin \u017f \u0130 ä", target="plc2", json_attribute='{"axis": 1, "axis": 2}'),
    message_sent(source_name="\0"),
    alarm_raised(source_name="main", severity=Severity.ERROR),
    alarm_cleared(confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION, source_name="MAIN"),
    alarm_cleared(confirmation_state=ConfirmationState.RESET),
]


def selected(clause: SqlFilter, events: Iterable[AnyEvent]) -> list[int]:
    """The positions of the events that SQLite selects."""
    connection = sqlite3.connect(":memory:")
    try:
        connection.execute(SCHEMA)
        marks = ", ".join("?" * len(row_of(EVENTS[0], 1)))
        connection.executemany(f"INSERT INTO events VALUES ({marks})", [row_of(event, n) for n, event in enumerate(events)])
        query = f"SELECT unique_id FROM events WHERE {clause.where} ORDER BY unique_id"
        return [unique_id for (unique_id,) in connection.execute(query, clause.parameters)]
    finally:
        connection.close()


s, j = where.source_name, where.json("/axis")
EXACT: list[Expr] = [
    Everything(),
    ~Everything(),
    where.is_message,
    ~where.is_alarm,
    where.is_raised,
    where.is_active,
    ~where.is_active,
    where.is_wait_for_confirmation,
    where.is_ethercat_device,
    ~where.is_ethercat_device,
    where.kind == "alarm_raised",
    ~where.kind.in_("alarm_cleared", "message_sent"),
    where.event_class == OTHER_CLASS,
    where.target != "plc1",
    where.severity >= Severity.ERROR,
    where.severity.between(Severity.INFO, Severity.ERROR),
    where.severity.between(Severity.ERROR, Severity.INFO),
    where.confirmation_state == ConfirmationState.RESET,
    where.event_id == 0,
    where.event_id == -1,
    where.event_id != -1,
    where.event_id != 2**64,
    where.event_id > 2**63,
    where.event_id < 2**64,
    where.event_id >= 2**32 - 1,
    where.event_id.in_(0, -1, 2**70),
    where.event_id.in_(-5),
    where.source_id < 5,
    where.source_id >= 0,
    where.source_id != 0,
    where.source_id == -1,
    ~(where.source_id != -1),
    where.source_id.is_empty(),
    ~where.source_id.in_(0, 7),
    where.time_ns < 2**70,
    where.time_ns > 2**63,
    where.time_ns <= 0,
    where.time_ns == 0,
    where.time_ns != 0,
    where.time_ns.in_(0, MAX_TIME_NS),
    where.time_ns.is_empty(),
    ~(where.time_cleared_ns > 5),
    s == "",
    s != "",
    s.is_empty(),
    s.is_not_empty(),
    ~(s != "main"),
    s == "Main\0x",
    s.in_("", "main"),
    s.like("main"),
    s.like("%main%"),
    ~s.like("%main%"),
    s.like("main%"),
    s.like("%x"),
    s.like("%\0x"),
    s.like("\0"),
    s.like(""),
    s.like("%"),
    ~s.like("%"),
    s.like("%\u212a%"),
    s.like("%k%"),
    s.like("%i̇%"),
    s.like("%ä"),
    s.like("%longer than any name that is here, by far%"),
    s.like("%longer than any name that is here, by far"),
    where.source_guid == "00000000-0000-0000-0000-000000000000",
    where.source_guid.is_empty(),
    where.source_guid != OTHER_CLASS,
    where.json_attribute == "",
    where.json_attribute != "",
    where.json_attribute.in_("", "not json"),
    where.json_attribute.is_empty(),
    where.json_attribute == '{"axis": 3}',
    where.unique_id < 3,
    where.unique_id != 1,
    (where.is_alarm & (where.severity == Severity.ERROR)) | ~(s.like("%i%") | where.is_message),
]
WIDE: list[Expr] = [
    j == 3,
    j != 3,
    ~(j == 3),
    ~(j != 3),
    j.is_empty(),
    j.is_not_empty(),
    j.like("%"),
    ~j.like("%"),
    s.like("m_in%"),
    ~s.like("m_in%"),
    s.like("%a%n%x%"),
    ~s.like("%_x"),
    s.like("_"),
    ~s.like("a_\0"),
    s.like("a_\0"),
    s.like("_" + "x" * MAX_LIKE_BYTES),
    ~s.like("_" + "x" * MAX_LIKE_BYTES),
    where.is_message & ~((j == 3) | (where.event_id == 0)),
    ~(where.is_message & (j == 3)),
]


def expected(expr: Expr) -> list[int]:
    """What the predicate says; the log's own field is the position."""
    return [n for n, event in enumerate(EVENTS) if compile_filter(expr)(event)]


@pytest.mark.parametrize("expr", EXACT, ids=repr)
def test_exact_clauses_select_just_what_the_predicate_matches(expr: Expr) -> None:
    """Missing values, 64 bits and more, quotes, NUL and characters that fold elsewhere."""
    clause = sql(expr)
    assert clause.exact
    if "unique_id" not in repr(expr):
        assert selected(clause, EVENTS) == expected(expr)


def test_the_unique_id_is_asked_of_the_log() -> None:
    """It is the one field that only stored events have."""
    assert selected(sql(where.unique_id < 3), EVENTS) == [0, 1, 2]
    assert selected(sql(where.unique_id != 1), EVENTS[:3]) == [0, 2]


@pytest.mark.parametrize("expr", WIDE, ids=lambda expr: repr(expr)[:80])
def test_wide_clauses_say_so_and_lose_nothing(expr: Expr) -> None:
    """JSON pointers, wildcards inside, and their opposites: the opposite of too much must not be too little."""
    clause = sql(expr)
    assert not clause.exact
    assert set(expected(expr)) <= set(selected(clause, EVENTS))


def test_a_condition_that_no_row_can_meet_costs_nothing() -> None:
    """Values outside a column's range are answered without a parameter."""
    assert sql(where.event_id > 2**64) == SqlFilter("0")
    assert sql(where.json_attribute == "") == SqlFilter("0")


def test_values_are_parameters() -> None:
    """What a user writes never becomes SQL."""
    clause = sql((where.source_name == "'; DROP TABLE events; --") & (where.event_id >= 7))
    assert clause == SqlFilter(
        "((has_source_name = 1 AND source_name = ?) AND event_id >= ?)", ("'; DROP TABLE events; --", 7), exact=True
    )


def test_the_largest_filters_are_taken_by_sqlite() -> None:
    """255 conditions, and 64 levels."""
    expr: Expr = where.source_name.in_(*(str(number) for number in range(255)))
    assert selected(sql(expr), EVENTS) == []
    deep: Expr = where.is_message
    for _ in range(31):
        deep = ~(deep & where.is_message)
    assert selected(sql(deep), EVENTS) == [n for n, event in enumerate(EVENTS) if compile_filter(deep)(event)]


def test_class_names_are_looked_up() -> None:
    """As in the other back ends."""
    expr = where.event_class == "Motion"
    assert selected(sql(expr, resolve_class=lambda _: [EVENT_CLASS, OTHER_CLASS]), EVENTS) == list(range(len(EVENTS)))
    with pytest.raises(UnknownClassError):
        sql(Like("target", "%") & expr)
