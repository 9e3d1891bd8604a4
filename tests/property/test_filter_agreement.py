"""The back ends of a filter agree: with a slow evaluator that is written here a second time, with SQLite, and with the keys.

A new back end gets one line in BACK_ENDS.
"""

import json
import sqlite3
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple, TypeAlias

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bridge.core.events import AnyEvent, ConfirmationState
from bridge.core.filters.ast import (
    And,
    Between,
    Compare,
    Everything,
    Expr,
    Flag,
    In,
    IsEmpty,
    JsonPointer,
    Like,
    Not,
    Operand,
    Or,
)
from bridge.core.filters.cover import MAX_SELECTIONS, cover, residual
from bridge.core.filters.like import fold, like_regex, simple_like
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.sql import sql
from bridge.core.filters.text import parse, to_text
from bridge.core.keys import includes
from bridge.testing.rows import SCHEMA, row_of
from bridge.testing.strategies import events, families, filters, patterns, texts

PAIRS = 20_000
FAMILY = 12
FILTERS = 6


# The reference: nothing of it is shared with the package but the tree.


class Number(NamedTuple):
    """A JSON number as it is written."""

    written: str


class Absent:
    """Nothing is there."""


ABSENT = Absent()


def refuse(constant: str) -> None:
    """NaN and Infinity are no JSON."""
    raise ValueError(constant)


def document_of(event: AnyEvent) -> object:
    """The JSON attribute, its numbers unread."""
    try:
        return json.loads(event.json_attribute, parse_int=Number, parse_float=Number, parse_constant=refuse)
    except ValueError:
        return ABSENT


def pointed(document: object, pointer: str) -> object:
    """What RFC 6901 finds."""
    for step in pointer.split("/")[1:]:
        name = step.replace("~1", "/").replace("~0", "~")
        if isinstance(document, dict) and name in document:
            document = document[name]
        elif isinstance(document, list) and name in [str(index) for index in range(len(document))]:
            document = document[int(name)]
        else:
            return ABSENT
    return document


def by_value(number: Number) -> Fraction | float:
    """An exact integer, or the nearest double; infinite beyond every double or 400 digits."""
    if number.written.lstrip("-").isdigit() and len(number.written) <= 400:
        return Fraction(int(number.written))
    double = float(number.written)
    return double if double in (float("inf"), float("-inf")) else Fraction(double)


def like(text: str, pattern: str) -> bool:
    """Row by row: reachable[i] says whether the pattern so far matches the first i characters."""
    reachable = [True] + [False] * len(text)
    for mark in pattern:
        if mark == "%":
            first = reachable.index(True) if True in reachable else len(reachable)
            reachable = [index >= first for index in range(len(reachable))]
        else:
            same = [mark == "_" or char == mark or ((char + mark).isascii() and char.lower() == mark.lower()) for char in text]
            reachable = [False] + [reachable[index] and same[index] for index in range(len(text))]
    return reachable[-1]


def seen(event: AnyEvent, operand: Operand) -> object:
    """The value as a text or a number, ABSENT when it is missing."""
    if isinstance(operand, JsonPointer):
        return pointed(document_of(event), operand.pointer)
    value = getattr(event, operand)
    missing = value is None or (operand.startswith("time") and value == 0) or (operand == "json_attribute" and value == "")
    return ABSENT if missing else value


def as_text(value: object) -> str | None:
    """The text form."""
    if isinstance(value, Number):
        return value.written
    return (
        {True: "true", False: "false", None: "null"}[value]
        if value is None or isinstance(value, bool)
        else (value if isinstance(value, str) else None)
    )


def holds(value: object, op: str, operand: str | int | float) -> bool:
    """One comparison."""
    if isinstance(operand, str):
        text = as_text(value)
        return text is not None and (text == operand) == (op == "=")
    if isinstance(value, Number):
        number: Fraction | float = by_value(value)
    elif isinstance(value, int) and not isinstance(value, bool):
        number = Fraction(int(value))
    else:
        return False
    other = Fraction(operand)
    return {
        "=": number == other,
        "!=": number != other,
        "<": number < other,
        "<=": number <= other,
        ">": number > other,
        ">=": number >= other,
    }[op]


def reference(expr: Expr, event: AnyEvent) -> bool:
    """The answer, by a walk over the tree."""
    match expr:
        case Everything():
            return True
        case And(items):
            return all(reference(item, event) for item in items)
        case Or(items):
            return any(reference(item, event) for item in items)
        case Not(item):
            return not reference(item, event)
        case Compare(operand, op, value):
            return holds(seen(event, operand), op, value)
        case In(operand, values):
            return any(holds(seen(event, operand), "=", value) for value in values)
        case Between(operand, low, high):
            return holds(seen(event, operand), ">=", low) and holds(seen(event, operand), "<=", high)
        case Like(operand, pattern):
            text = as_text(seen(event, operand)) if seen(event, operand) is not ABSENT else None
            return text is not None and like(text, pattern)
        case IsEmpty(operand):
            return seen(event, operand) is ABSENT or seen(event, operand) == ""
        case Flag(name):
            waiting = event.confirmation_state == ConfirmationState.WAIT_FOR_CONFIRMATION
            return {
                "is_message": event.kind == "message_sent",
                "is_alarm": event.kind != "message_sent",
                "is_raised": event.kind != "message_sent" and event.raised,
                "is_active": event.kind != "message_sent" and (event.raised or waiting),
                "is_wait_for_confirmation": event.kind != "message_sent" and waiting,
                "is_ethercat_device": event.vendor_id is not None,
            }[name]


# The back ends, each against the answers of the reference.

Check: TypeAlias = Callable[[Expr, list[AnyEvent], list[bool]], None]


def predicate_agrees(expr: Expr, family: list[AnyEvent], answers: list[bool]) -> None:
    """The compiled predicate gives the answers, as bools."""
    matches = compile_filter(expr)
    assert [matches(event) for event in family] == answers
    assert all(isinstance(matches(event), bool) for event in family)


def sql_agrees(expr: Expr, family: list[AnyEvent], answers: list[bool]) -> None:
    """SQLite selects every match, and nothing else when the clause says so."""
    clause = sql(expr)
    rows = DATABASE.execute(f"SELECT unique_id FROM events WHERE {clause.where}", clause.parameters).fetchall()
    selected = {unique_id for (unique_id,) in rows}
    matching = {number for number, answer in enumerate(answers) if answer}
    assert matching <= selected
    if clause.exact:
        assert matching == selected
    opposite = sql(Not(expr))
    rows = DATABASE.execute(f"SELECT unique_id FROM events WHERE {opposite.where}", opposite.parameters).fetchall()
    assert {number for number, answer in enumerate(answers) if not answer} <= {unique_id for (unique_id,) in rows}


def cover_agrees(expr: Expr, family: list[AnyEvent], answers: list[bool]) -> None:
    """Every match is under exactly one selection; under an exact cover nothing else is; the residual decides the rest."""
    found = cover(expr)
    rest = compile_filter(residual(expr))
    assert len(found.selections) <= MAX_SELECTIONS
    for event, answer in zip(family, answers, strict=True):
        taken = sum(includes(selection, event) for selection in found.selections)
        assert taken == 1 if answer else taken <= 1
        if found.exact:
            assert bool(taken) is answer
        if taken:
            assert rest(event) is answer


def text_agrees(expr: Expr, family: list[AnyEvent], answers: list[bool]) -> None:
    """What is written is read again as the same tree."""
    assert parse(to_text(expr)) == expr


BACK_ENDS: tuple[Check, ...] = (predicate_agrees, sql_agrees, cover_agrees, text_agrees)

DATABASE = sqlite3.connect(":memory:")
DATABASE.execute(SCHEMA)
INSERT = f"INSERT INTO events VALUES ({', '.join('?' * SCHEMA.count('NOT NULL'))})"


def test_back_ends_agree_on_twenty_thousand_pairs() -> None:
    """Filters built from an event meet that event and its relatives in every back end."""
    pairs = matches = 0

    @settings(max_examples=-(-PAIRS // (FAMILY * FILTERS)) + 20, suppress_health_check=list(HealthCheck))
    @given(families(FAMILY), st.data())
    def agree(family: list[AnyEvent], data: st.DataObject) -> None:
        nonlocal pairs, matches
        DATABASE.execute("DELETE FROM events")
        DATABASE.executemany(INSERT, [row_of(event, number) for number, event in enumerate(family)])
        for _ in range(FILTERS):
            expr = data.draw(filters(family[0]))
            answers = [reference(expr, event) for event in family]
            for check in BACK_ENDS:
                check(expr, family, answers)
            pairs += len(family)
            matches += sum(answers)

    agree()
    assert pairs >= PAIRS
    # Without a fair share of matches the agreement would say little.
    assert 0.2 < matches / pairs < 0.8


@settings(max_examples=1500)
@given(st.data())
def test_like_is_what_sqlite_says(data: st.DataObject) -> None:
    """SQLite is the oracle for texts without NUL, the row-by-row matcher for all."""
    text = data.draw(texts)
    pattern = data.draw(patterns(text))
    answer = like_regex(pattern).match(text) is not None
    assert answer == like(text, pattern)
    if "\0" not in text + pattern:
        (oracle,) = DATABASE.execute("SELECT ? LIKE ?", (text, pattern)).fetchone()
        assert answer == bool(oracle)


@settings(max_examples=500)
@given(st.data())
def test_simple_patterns_mean_the_same_as_their_regular_expression(data: st.DataObject) -> None:
    """The quick ways around the regular expression give its answer."""
    text = data.draw(texts)
    pattern = data.draw(st.sampled_from(["{}", "%{}", "{}%", "%{}%"])).format(
        data.draw(patterns(text)).strip("%").replace("_", "a")
    )
    simple = simple_like(pattern)
    if simple is None:
        return
    kind, asked = simple
    folded = fold(text)
    answer = {
        "is": folded == asked,
        "contains": asked in folded,
        "starts": folded.startswith(asked),
        "ends": folded.endswith(asked),
    }
    assert answer[kind] == (like_regex(pattern).match(text) is not None)


@settings(max_examples=300)
@given(events(), st.data())
def test_order_comparisons_are_what_sqlite_says(event: AnyEvent, data: st.DataObject) -> None:
    """SQLite compares two bound integers as the predicate compares a field with a value."""
    value = data.draw(st.sampled_from([event.event_id + step for step in (-1, 0, 1)]))
    for op in ("=", "!=", "<", "<=", ">", ">="):
        (oracle,) = DATABASE.execute(f"SELECT ? {op} ?", (event.event_id, value)).fetchone()
        assert compile_filter(parse(f"event_id {op} {value}"))(event) == bool(oracle)
