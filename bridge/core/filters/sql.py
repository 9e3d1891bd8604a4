"""Which rows of the log match: the filter as the WHERE clause of an SQLite query.

Rule 1: the clause may let too much through, never too little, and says whether it is exact. A LIMIT belongs into the query
        only when it is.
Rule 2: a value is a parameter, never part of the text.
Rule 3: no NULL. With the columns below every condition is 0 or 1, so that NOT is the opposite and missing is not unknown.

The table has a column for each field, spelled like it, and three more:

| column                                                       | type            | missing is                              |
|--------------------------------------------------------------|-----------------|-----------------------------------------|
| target, kind, event_class                                    | TEXT            | never missing                           |
| event_id, severity, confirmation_state, unique_id            | INTEGER         | never missing                           |
| source_id, vendor_id, product_code, revision_no              | INTEGER         | -1                                      |
| source_guid, json_attribute                                  | TEXT            | ''                                      |
| source_name                                                  | TEXT            | '' with has_source_name 0               |
| time_ns, time_raised_ns, time_cleared_ns, time_confirmed_ns  | INTEGER         | 0                                       |
| is_alarm, raised, has_source_name                            | INTEGER, 0 or 1 | never missing                           |

Two things cannot be asked exactly. JSON pointers: SQLite's json_extract() reads numbers, duplicate names and invalid documents
in another way, so that only "there is a JSON attribute" is asked. LIKE stops at NUL in SQLite: a pattern with `%` at its ends
only is asked with instr() and lower(), which do not; any other lets rows with NUL through. NOT is pushed to the conditions
first, because the opposite of too much would be too little.
"""

from typing import Final, assert_never

import msgspec

from bridge.core.events import ConfirmationState
from bridge.core.filters.ast import (
    And,
    Between,
    Compare,
    Everything,
    Expr,
    Flag,
    FlagName,
    In,
    IsEmpty,
    JsonPointer,
    Like,
    Not,
    Or,
    int_range,
    resolve,
)
from bridge.core.filters.fields import FIELDS, ClassResolver, Field, Value
from bridge.core.filters.like import simple_like

MAX_LIKE_BYTES: Final = 50_000
"""SQLite's limit for a pattern (SQLITE_MAX_LIKE_PATTERN_LENGTH)."""


class SqlFilter(msgspec.Struct, frozen=True):
    """A WHERE clause with `?` for each parameter; exact when it lets through what the filter matches and nothing else."""

    where: str
    parameters: tuple[str | int, ...] = ()
    exact: bool = True


_ALL: Final = SqlFilter("1")
_NONE: Final = SqlFilter("0")
_WAITING: Final = int(ConfirmationState.WAIT_FOR_CONFIRMATION)
_FLAGS: Final[dict[FlagName, str]] = {
    "is_message": "is_alarm = 0",
    "is_alarm": "is_alarm = 1",
    "is_raised": "(is_alarm = 1 AND raised = 1)",
    "is_active": f"(is_alarm = 1 AND (raised = 1 OR confirmation_state = {_WAITING}))",
    "is_wait_for_confirmation": f"(is_alarm = 1 AND confirmation_state = {_WAITING})",
    "is_ethercat_device": "vendor_id >= 0",
}


def sql(expr: Expr, *, resolve_class: ClassResolver | None = None) -> SqlFilter:
    """The filter as a WHERE clause. UnknownClassError for a class name that cannot be looked up."""
    return _clause(resolve(expr, resolve_class), True)


def _clause(expr: Expr, wanted: bool) -> SqlFilter:
    """The rows for which the answer is `wanted`."""
    match expr:
        case Everything():
            return _ALL if wanted else _NONE
        case Not(item):
            return _clause(item, not wanted)
        case And(items):
            return _joined([_clause(item, wanted) for item in items], "AND" if wanted else "OR")
        case Or(items):
            return _joined([_clause(item, wanted) for item in items], "OR" if wanted else "AND")
        case Flag(name):
            return _exact(SqlFilter(_FLAGS[name]), wanted)
        case _ if isinstance(expr.field, JsonPointer):
            # Missing, or equal to nothing: only what is positive needs a document.
            needs_one = wanted is not isinstance(expr, IsEmpty)
            return SqlFilter("json_attribute <> ''" if needs_one else "1", (), False)
        case Like(name, pattern):
            return _like(FIELDS[str(name)], pattern, wanted)
        case _:
            return _exact(_condition(expr, FIELDS[str(expr.field)]), wanted)


def _exact(clause: SqlFilter, wanted: bool) -> SqlFilter:
    return clause if wanted else SqlFilter(f"NOT ({clause.where})", clause.parameters)


def _joined(parts: list[SqlFilter], word: str) -> SqlFilter:
    neutral, absorbing = ("1", "0") if word == "AND" else ("0", "1")
    if any(part.where == absorbing for part in parts):
        return SqlFilter(absorbing, (), any(part.exact for part in parts if part.where == absorbing))
    exact = all(part.exact for part in parts)
    parts = [part for part in parts if part.where != neutral]
    if len(parts) < 2:
        return SqlFilter(parts[0].where, parts[0].parameters, exact) if parts else SqlFilter(neutral, (), exact)
    parameters = tuple(parameter for part in parts for parameter in part.parameters)
    return SqlFilter(f"({f' {word} '.join(part.where for part in parts)})", parameters, exact)


def _present(field: Field) -> str:
    """The condition that an optional field is set; "" for the others."""
    if not field.optional:
        return ""
    if field.name == "source_name":
        return "has_source_name = 1 AND "
    return f"{field.name} <> '' AND " if field.type in ("text", "guid") else f"{field.name} >= {field.lowest} AND "


def _condition(expr: Compare | In | Between | IsEmpty, field: Field) -> SqlFilter:
    name = field.name
    match expr:
        case IsEmpty():
            return SqlFilter(f"{name} = ''" if field.type in ("text", "guid") else f"{name} < {field.lowest}")
        case In(_, values):
            known = _storable(field, values)
            marks = ", ".join("?" * len(known))
            return SqlFilter(f"({_present(field)}{name} IN ({marks}))", known) if known else _NONE
        case Compare(_, "=", value):
            known = _storable(field, (value,))
            return SqlFilter(f"({_present(field)}{name} = ?)", known) if known else _NONE
        case Compare(_, "!=", value):
            known = _storable(field, (value,))
            return SqlFilter(f"({_present(field)}{name} <> ?)" if known else f"({_present(field)}1)", known)
        case Compare() | Between():
            return _range(field, *int_range(expr))
        case _:
            assert_never(expr)


def _storable(field: Field, values: tuple[Value, ...]) -> tuple[str | int, ...]:
    """The values that a row can hold at all; SQLite has 64 bits, a filter has as many as it likes."""
    numbers = [value for value in values if isinstance(value, int) and field.lowest <= value <= field.highest]
    return (*numbers, *(value for value in values if isinstance(value, str) and value != field.missing))


def _range(field: Field, low: int | None, high: int | None) -> SqlFilter:
    low = field.lowest if low is None else max(low, field.lowest)
    high = field.highest if high is None else min(high, field.highest)
    if low > high:
        return _NONE
    if high == field.highest:
        return SqlFilter(f"{field.name} >= ?", (low,))
    return SqlFilter(f"{field.name} BETWEEN ? AND ?", (low, high))


def _like(field: Field, pattern: str, wanted: bool) -> SqlFilter:
    name, present = field.name, _present(field)
    match simple_like(pattern):
        case "is", text:
            return _exact(SqlFilter(f"({present}lower({name}) = ?)", (text,)), wanted)
        case "contains", "":
            return _exact(SqlFilter(f"({present}1)"), wanted)
        case "contains", text:
            return _exact(SqlFilter(f"({present}instr(lower({name}), ?) > 0)", (text,)), wanted)
        case "starts", text:
            return _exact(SqlFilter(f"({present}instr(lower({name}), ?) = 1)", (text,)), wanted)
        case "ends", text:
            # IS, because substr() of an empty blob is NULL.
            end = f"substr(CAST(lower({name}) AS BLOB), -{len(text.encode())})"
            return _exact(SqlFilter(f"({present}{end} IS CAST(? AS BLOB))", (text,)), wanted)
        case _:
            pass
    if "\0" in pattern or len(pattern.encode()) > MAX_LIKE_BYTES:
        return SqlFilter(f"({present}1)" if wanted else "1", (), False)
    question = f"({present}{name} LIKE ?)" if wanted else f"NOT ({present}{name} LIKE ?)"
    return SqlFilter(f"({question} OR instr({name}, char(0)) > 0)", (pattern,), False)
