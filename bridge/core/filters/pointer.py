"""What a JSON pointer finds in an event's JSON attribute, and how that meets an operand.

| the pointer finds      | operand is a text: = != like in    | operand is a number: = != < <= > >= in between | is empty    |
|------------------------|------------------------------------|------------------------------------------------|-------------|
| nothing                | false                              | false                                          | true        |
| a string               | exactly its characters             | false (also !=)                                | if it is "" |
| a number               | as it is written: 1.50 is '1.50'   | by value: 1.50 is 1.5, 1e3 is 1000             | false       |
| true, false, null      | as 'true', 'false', 'null'         | false (also !=)                                | false       |
| an object or an array  | false (also !=)                    | false (also !=)                                | false       |

Rule 1: a value that cannot meet the operand counts as missing: each comparison is false, `!=` too.
Rule 2: by value means: a number without fraction and exponent is an exact integer (beyond 400 digits: infinite), any other the
        nearest double, and the two compare exactly. 9007199254740993 is not 9007199254740992; 1 is 1.0.
Rule 3: valid is what RFC 8259 allows, so neither NaN nor Infinity, nested at most 200 levels. Of duplicate names the last
        counts. In a text that is not valid JSON a pointer finds nothing.
Rule 4: steps are those of RFC 6901: in an object a name, in an array a number without leading zeros; "-" finds nothing.

The PLC library compares JSON values as strings only and does not say how a number becomes one (facts 1.4).
"""

import json
import re
from collections.abc import Callable
from typing import Final, NoReturn, TypeAlias

from bridge.core.filters.ast import Between, Compare, Expr, In, IsEmpty, JsonPointer, Like
from bridge.core.filters.fields import MAX_DIGITS, Comparison, Value
from bridge.core.filters.like import like_regex

JsonTest: TypeAlias = Callable[[object], bool]

MAX_NESTING: Final = 200
"""Levels of a JSON document; a deeper one counts as invalid, so that the answer does not depend on the stack left."""
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_INDEX: Final = re.compile(r"0|[1-9][0-9]{0,8}")
_INTEGER: Final = re.compile(r"-?[0-9]+")


class _Nothing:
    """What a pointer finds where nothing is; JSON's null is something."""


NOTHING: Final = _Nothing()


class JsonNumber(str):
    """A number as it is written in the document."""

    __slots__ = ()

    @property
    def value(self) -> int | float:
        """The exact integer or the nearest double."""
        return int(self) if len(self) <= MAX_DIGITS and _INTEGER.fullmatch(self) else float(self)


def _no_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no JSON")


_DECODER: Final = json.JSONDecoder(parse_int=JsonNumber, parse_float=JsonNumber, parse_constant=_no_constant)


def _nesting(text: str) -> int:
    level = deepest = 0
    for char in _STRING.sub("", text):
        if char in "[{":
            level += 1
            deepest = max(deepest, level)
        elif char in "]}":
            level -= 1
    return deepest


def read_json(text: str) -> object:
    """The document with its numbers as JsonNumber; NOTHING when it is not valid. Never raises."""
    if not text or (text.count("[") + text.count("{") > MAX_NESTING and _nesting(text) > MAX_NESTING):
        return NOTHING
    # raw_decode() costs a third of decode(), which looks for white space with regular expressions.
    text = text.strip(" \t\n\r")
    try:
        document, end = _DECODER.raw_decode(text)
    except (ValueError, RecursionError):
        return NOTHING
    return document if end == len(text) else NOTHING


def find(document: object, steps: tuple[str, ...]) -> object:
    """What is at the place, or NOTHING."""
    for step in steps:
        match document:
            case dict():
                document = document.get(step, NOTHING)
            case list() if _INDEX.fullmatch(step) and int(step) < len(document):
                document = document[int(step)]
            case _:
                return NOTHING
    return document


_WORDS: Final = {True: "true", False: "false", None: "null"}


def text_of(found: object) -> str | None:
    """A scalar as a text; None for anything else."""
    if isinstance(found, str):
        return str(found)
    if found is None or isinstance(found, bool):
        return _WORDS[found]
    return None


def number_of(found: object) -> int | float | None:
    """A number by value; None for anything else."""
    return found.value if isinstance(found, JsonNumber) else None


def json_test(expr: Expr) -> JsonTest:
    """The test of a document (of read_json) for a condition on a JSON pointer."""
    match expr:
        case IsEmpty(JsonPointer() as pointer):
            steps = pointer.steps
            return lambda document: (found := find(document, steps)) is NOTHING or found == ""
        case Like(JsonPointer() as pointer, pattern):
            return _on_text(pointer, _matcher(pattern))
        case Compare(JsonPointer() as pointer, op, str(text)):
            return _on_text(pointer, (lambda found: found == text) if op == "=" else (lambda found: found != text))
        case Compare(JsonPointer() as pointer, op, int() | float() as number):
            return _on_number(pointer, _comparison(op, number))
        case Between(JsonPointer() as pointer, low, high):
            return _on_number(pointer, lambda found: low <= found <= high)
        case In(JsonPointer() as pointer, values):
            return _among(pointer, values)
        case _:
            raise TypeError(f"{expr} is no condition on a JSON pointer")


def _comparison(op: Comparison, value: int | float) -> Callable[[int | float], bool]:
    match op:
        case "=":
            return lambda found: found == value
        case "!=":
            return lambda found: found != value
        case "<":
            return lambda found: found < value
        case "<=":
            return lambda found: found <= value
        case ">":
            return lambda found: found > value
        case ">=":
            return lambda found: found >= value


def _matcher(pattern: str) -> Callable[[str], bool]:
    match = like_regex(pattern).match
    return lambda text: match(text) is not None


def _on_text(pointer: JsonPointer, test: Callable[[str], bool]) -> JsonTest:
    steps = pointer.steps
    return lambda document: (text := text_of(find(document, steps))) is not None and test(text)


def _on_number(pointer: JsonPointer, test: Callable[[int | float], bool]) -> JsonTest:
    steps = pointer.steps
    return lambda document: (number := number_of(find(document, steps))) is not None and test(number)


def _among(pointer: JsonPointer, values: tuple[Value, ...]) -> JsonTest:
    steps = pointer.steps
    texts = frozenset(value for value in values if isinstance(value, str))
    numbers = frozenset(value for value in values if not isinstance(value, str))

    def test(document: object) -> bool:
        found = find(document, steps)
        return text_of(found) in texts or number_of(found) in numbers

    return test
