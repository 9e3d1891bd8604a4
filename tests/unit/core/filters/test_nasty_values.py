"""Values that have broken filters before, each against each, through predicate, SQL and text."""

import json
import sqlite3
from itertools import product

import pytest

from bridge.core.filters.ast import Compare, Expr, In, JsonPointer, Like
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.sql import sql
from bridge.core.filters.text import parse, to_text
from bridge.testing.builders import message_sent
from bridge.testing.rows import SCHEMA, row_of

TEXTS = {
    "empty": "",
    "NUL": "\0",
    "NUL inside": "a\0b",
    "line end": "a\nb",
    "carriage return": "\r",
    "percent": "%",
    "underscore": "_",
    "single quote": "it's",
    "double quote": 'say "x"',
    "both quotes doubled": "''\"\"",
    "backslash": "\\",
    "Kelvin sign": "\u212a",
    "k": "k",
    "K": "K",
    "long s": "\u017f",
    "s": "s",
    "dotted I": "\u0130",
    "i": "i",
    "i with a dot above": "i\u0307",
    "umlaut": "ä",
    "capital umlaut": "Ä",
    "beyond the BMP": "\U0001f600",
    "keyword": "and",
    "comment": "-- /* */",
    "null": "null",
    "number": "9223372036854775808",
    "not a number": "NaN",
    "blank": " ",
}
NUMBERS = [0, 1, -1, 2**31, 2**32, 2**53 + 1, 2**63 - 1, 2**63, 2**64, -(2**63), -(2**63) - 1, 2**200]
EVENTS = [message_sent(), *(message_sent(source_name=text) for text in TEXTS.values())]


@pytest.fixture(scope="module")
def database() -> sqlite3.Connection:
    """The events as rows; unique_id is the position."""
    connection = sqlite3.connect(":memory:")
    connection.execute(SCHEMA)
    marks = ", ".join("?" * len(row_of(EVENTS[0], 0)))
    connection.executemany(f"INSERT INTO events VALUES ({marks})", [row_of(event, n) for n, event in enumerate(EVENTS)])
    return connection


def selected(database: sqlite3.Connection, expr: Expr) -> set[int]:
    """The positions that SQLite selects."""
    clause = sql(expr)
    return {n for (n,) in database.execute(f"SELECT unique_id FROM events WHERE {clause.where}", clause.parameters)}


def test_texts_against_texts(database: sqlite3.Connection) -> None:
    """Equality is exact; SQLite agrees; the text spelling reads back."""
    for value in TEXTS.values():
        equal, differs = Compare("source_name", "=", value), Compare("source_name", "!=", value)
        assert [n for n, event in enumerate(EVENTS) if compile_filter(equal)(event)] == sorted(selected(database, equal))
        assert {n for n, event in enumerate(EVENTS) if event.source_name == value} == selected(database, equal)
        assert {n for n, event in enumerate(EVENTS) if event.source_name not in (None, value)} == selected(database, differs)
        for expr in (equal, differs, ~equal, In("source_name", (value, "x")), Like("source_name", value)):
            assert parse(to_text(expr)) == expr


@pytest.mark.parametrize("frame", ["{}", "%{}", "{}%", "%{}%", "_{}", "{}_", "%{}_"])
def test_texts_as_patterns(database: sqlite3.Connection, frame: str) -> None:
    """Each text in each place of a pattern, and its opposite: SQLite never selects too little, and exactly where it says so."""
    for value in TEXTS.values():
        like = Like("source_name", frame.format(value))
        for expr in (like, ~like):
            matching = {n for n, event in enumerate(EVENTS) if compile_filter(expr)(event)}
            assert matching <= selected(database, expr)
            if sql(expr).exact:
                assert matching == selected(database, expr)


def test_numbers_against_numbers() -> None:
    """Beyond 64 bits too, for JSON values: exact and with an order."""
    for number, other in product(NUMBERS, NUMBERS):
        event = message_sent(json_attribute=json.dumps({"v": number}))
        for op, answer in [("=", number == other), ("!=", number != other), ("<", number < other), (">=", number >= other)]:
            expr = parse(f"json('/v') {op} {other}")
            assert compile_filter(expr)(event) is answer
            assert parse(to_text(expr)) == expr


def test_numbers_against_fields(database: sqlite3.Connection) -> None:
    """A value that no field can have is compared all the same, in Python as in SQLite."""
    for number, field, op in product(NUMBERS, ("event_id", "source_id", "time_ns"), ("=", "!=", "<", "<=", ">", ">=")):
        expr = parse(f"{field} {op} {number}")
        for each in (expr, ~expr):
            assert {n for n, event in enumerate(EVENTS) if compile_filter(each)(event)} == selected(database, each)
            assert parse(to_text(each)) == each


@pytest.mark.parametrize(
    ("attribute", "pointer", "value", "answer"),
    [
        ('{"a": 1, "a": 2}', "/a", 2, True),
        ('{"a": 1, "a": 2}', "/a", 1, False),
        ('["x"]', "/0", "x", True),
        ('{"0": "x"}', "/0", "x", True),
        ('"x"', "/0", "x", False),
        ('{"a": NaN}', "/a", "NaN", False),
        ('{"a": "NaN"}', "/a", "NaN", True),
        ('{"a": "\u212a"}', "/a", "K", False),
        ('{"a": "\\u212a"}', "/a", "\u212a", True),
        ('{"a": "\\u0000"}', "/a", "\0", True),
        ('{"it\'s": "it\'s"}', "/it's", "it's", True),
        ('{"a\\nb": 3}', "/a\nb", 3, True),
        ('{"": {"": 0}}', "//", 0, True),
        ("9223372036854775808", "", 2**63, True),
        ("18446744073709551616.0", "", 2**64, True),
    ],
)
def test_nasty_json(attribute: str, pointer: str, value: str | int, answer: bool) -> None:
    """Duplicate names, /0 on arrays, objects and scalars, NaN, escapes; and the text spelling reads back."""
    expr = Compare(JsonPointer(pointer), "=", value)
    assert compile_filter(expr)(message_sent(json_attribute=attribute)) is answer
    assert parse(to_text(expr)) == expr
