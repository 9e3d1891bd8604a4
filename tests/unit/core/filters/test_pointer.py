"""How a value in the JSON attribute meets an operand: the table of pointer.py, row by row."""

import json

import pytest

from bridge.core.filters.ast import Between, Compare, Expr, In, IsEmpty, JsonPointer, Like
from bridge.core.filters.pointer import MAX_NESTING, NOTHING, JsonNumber, find, json_test, read_json
from bridge.core.filters.spelling import where

P = where.json("/v")


def meets(expr: Expr, attribute: str) -> bool:
    """Ask one document."""
    return json_test(expr)(read_json(attribute))


def document(value: str) -> str:
    """A document with the value, written as JSON, at /v."""
    return f'{{"v": {value}}}'


ROWS: list[tuple[str, Expr, bool]] = [
    # a string: exactly its characters, and no number
    ('"3"', P == "3", True),
    ('"3"', P == 3, False),
    ('"3"', P != 3, False),
    ('"a"', P != "b", True),
    ('"A"', P == "a", False),
    ('"Axis"', P.like("a%"), True),
    ('"\\u00e4"', P == "ä", True),
    ('"\\u0000"', P == "\0", True),
    ('"a\\nb"', P.like("a_b"), True),
    ('""', P == "", True),
    ('""', P.is_empty(), True),
    ('"x"', P.is_empty(), False),
    # a number: its written form meets a text, its value a number
    ("3", P == 3, True),
    ("3", P == "3", True),
    ("3.0", P == 3, True),
    ("3.0", P == "3", False),
    ("1.50", P == "1.50", True),
    ("1.50", P == 1.5, True),
    ("1e3", P == 1000, True),
    ("1e3", P.like("1e%"), True),
    ("-0", P == 0, True),
    ("-0.0", P == 0, True),
    ("3", P != 4, True),
    ("3", P != "4", True),
    ("3", P != 3.0, False),
    ("3", P < 4, True),
    ("3", P >= 3, True),
    ("3", P > 3, False),
    ("3", P <= 2.5, False),
    ("3", P.between(1, 5), True),
    ("3", P.between(5, 1), False),
    ("3", P.in_(1, 3.0), True),
    ("3", P.in_("3"), True),
    ("3", P.in_("x", 4), False),
    ("9007199254740993", P == 9007199254740993, True),
    ("9007199254740993", P == 9007199254740992, False),
    ("9007199254740993", P == 9007199254740992.0, False),
    ("9007199254740993.0", P == 9007199254740992, True),
    ("18446744073709551616", P == 2**64, True),
    ("18446744073709551616", P > 2**64 - 1, True),
    ("9223372036854775808", P > 9223372036854775807, True),
    ("0.1", P == 0.1, True),
    ("0.10000000000000001", P == 0.1, True),
    ("1e400", P > 10**300, True),
    ("-1e400", P < 0, True),
    ("9" * 5000, P > 10**399, True),
    ("9" * 5000, P.like("99%"), True),
    ("3", P.is_empty(), False),
    ("0", P.is_empty(), False),
    # true, false, null: words
    ("true", P == "true", True),
    ("true", P == True, True),  # noqa: E712  it builds a filter
    ("true", P == 1, False),
    ("true", P != 1, False),
    ("false", P == "", False),
    ("false", P != "true", True),
    ("null", P == "null", True),
    ("null", P == None, True),  # noqa: E711  it builds a filter
    ("null", P.is_empty(), False),
    ("true", P.in_(True, 1), True),
    # objects and arrays: there, but compared with nothing
    ("{}", P.is_empty(), False),
    ("[]", P.is_empty(), False),
    ("{}", P == "{}", False),
    ("[1]", P != "x", False),
    ("[1]", P != 1, False),
    ("{}", P.like("%"), False),
]


@pytest.mark.parametrize(("value", "expr", "answer"), ROWS)
def test_the_table(value: str, expr: Expr, answer: bool) -> None:
    """Each row: a JSON value, a condition, the answer."""
    assert meets(expr, document(value)) is answer


NOT_JSON = [
    "",
    "x",
    "{",
    '{"v": NaN}',
    '{"v": Infinity}',
    '{"v": -Infinity}',
    "{'v': 3}",
    '{"v": 03}',
    '{"v": 3,}',
    '{"v": 3} x',
]
NOT_JSON += ['{"v": "a\nb"}', '\ufeff{"v": 3}', '{"v": +3}', '{"v": .5}', '{"v": 3}\0', '{"v": "\\x"}', '\u00a0{"v": 3}']


@pytest.mark.parametrize("attribute", NOT_JSON)
def test_in_invalid_json_a_pointer_finds_nothing(attribute: str) -> None:
    """Every comparison is false, and is empty is true."""
    assert read_json(attribute) is NOTHING
    assert meets(P.is_empty(), attribute)
    assert not meets(P != "x", attribute)
    assert not meets(P != 5, attribute)
    assert not meets(P.like("%"), attribute)


def test_of_duplicate_names_the_last_counts() -> None:
    """As in nearly every reader."""
    assert meets(P == 2, '{"v": 1, "v": 2}')
    assert not meets(P == 1, '{"v": 1, "v": 2}')


@pytest.mark.parametrize(
    ("pointer", "attribute", "found"),
    [
        ("", "3", 3),
        ("", ' "x"\r\n', "x"),
        ("/0", "[7, 8]", 7),
        ("/1", "[7, 8]", 8),
        ("/2", "[7, 8]", NOTHING),
        ("/-", "[7, 8]", NOTHING),
        ("/00", "[7, 8]", NOTHING),
        ("/-1", "[7, 8]", NOTHING),
        ("/٠", "[7, 8]", NOTHING),
        ("/" + "9" * 5000, "[7, 8]", NOTHING),
        ("/0", '{"0": "zero"}', "zero"),
        ("/00", '{"00": "zeros"}', "zeros"),
        ("/", '{"": "empty"}', "empty"),
        ("/a~1b", '{"a/b": 1}', 1),
        ("/a~0b", '{"a~b": 1}', 1),
        ("/~01", '{"~1": 1}', 1),
        ("/a/1/b", '{"a": [0, {"b": "deep"}]}', "deep"),
        ("/a/b", '{"a": "text"}', NOTHING),
        ("/a/0", '{"a": "text"}', NOTHING),
        ("/a/b", '{"a": null}', NOTHING),
        ("/A", '{"a": 1}', NOTHING),
    ],
)
def test_pointers_walk_as_rfc_6901_says(pointer: str, attribute: str, found: object) -> None:
    """Names in objects, numbers in arrays, nothing in scalars."""
    result = find(read_json(attribute), JsonPointer(pointer).steps)
    assert (result.value if isinstance(result, JsonNumber) else result) == found


def test_a_lone_surrogate_in_the_document_raises_nothing() -> None:
    """A text operand cannot hold one, so it equals none, and LIKE takes it as one character."""
    attribute = document('"\\ud800"')
    assert not meets(P == "x", attribute)
    assert meets(P != "x", attribute)
    assert meets(P.like("_"), attribute)


def test_nesting_is_bounded_whatever_the_stack() -> None:
    """200 levels are read, 201 are invalid; brackets inside strings do not count."""

    def nested(levels: int) -> str:
        return "[" * levels + "]" * levels

    assert read_json(nested(MAX_NESTING)) is not NOTHING
    assert read_json(nested(MAX_NESTING + 1)) is NOTHING
    assert read_json(nested(100_000)) is NOTHING
    assert read_json("[" * 100_000) is NOTHING
    assert read_json(json.dumps(["[" * 1000])) is not NOTHING
    assert read_json(json.dumps(['\\"' + "[" * 1000])) is not NOTHING
    assert read_json(json.dumps([[]] * 1000)) is not NOTHING


def test_only_conditions_on_pointers_are_tests_of_a_document() -> None:
    """Anything else is a mistake of the caller."""
    for expr in (Compare("event_id", "=", 1), Like("target", "%"), In("event_id", (1,)), Between("event_id", 1, 2)):
        with pytest.raises(TypeError):
            json_test(expr)
    with pytest.raises(TypeError):
        json_test(IsEmpty("source_name"))
