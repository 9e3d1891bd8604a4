"""Hypothesis strategies: events, their relatives, and filters that are built from an event.

Rule 1: a filter is built from the event it will meet. Its operands are the event's values, those beside them, and its texts
with letters, cases and wildcards changed; of independent pairs nearly none would match and a wrong LIKE would go unseen.
Rule 2: texts are made of pieces that have broken matchers before: NUL, line ends, both quotes, `%`, `_`, backslash, and the
letters that fold onto ASCII in Unicode (Kelvin sign, long s, dotted I).
"""

import json
from typing import Final, cast

import msgspec
from hypothesis import strategies as st

from bridge.core.events import KIND_NAMES, KINDS, AnyEvent, ConfirmationState, Severity
from bridge.core.filters.ast import (
    MAX_DEPTH,
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
    Operand,
    Or,
)
from bridge.core.filters.fields import FIELDS, FLAGS, Comparison, Field, Value
from bridge.core.times import MAX_TIME_NS
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, TIME_NS

PIECES: Final = [
    "a",
    "A",
    "b",
    "Main",
    "MAIN",
    "%",
    "_",
    "'",
    '"',
    "\0",
    "\n",
    "\u212a",
    "k",
    "\u017f",
    "s",
    "\u0130",
    "i",
    "ä",
    "Ä",
]
PIECES.extend(["\\", ".", "*", "[", "]", " ", "and", "1", "\U0001f600", "{", "/", "~"])
_GUIDS: Final = [EVENT_CLASS, OTHER_CLASS, "00000000-0000-0000-0000-000000000000"]
_U32: Final = st.sampled_from([0, 1, 2, 7, 2**31, 2**32 - 1])
_TIMES: Final = st.sampled_from([0, 1, TIME_NS, TIME_NS + 1, MAX_TIME_NS])
_NUMBERS: Final = [
    "0",
    "-0",
    "1",
    "3",
    "3.0",
    "1.50",
    "1e3",
    "-1.5e-3",
    "9007199254740993",
    "9223372036854775808",
    "1e400",
    "-1e400",
]
_NUMBERS.extend(["18446744073709551616", "9" * 450, "0.1", "0.10000000000000001"])
_INVALID: Final = ["x", "{", "NaN", '{"a": NaN}', "[1,]", '"a\nb"', "01", "{'a': 1}", '{"a": 1} x', "[Infinity]", '"\\x"']
_NAMES: Final = ["", "a", "b", "0", "00", "-", "a/b", "~", "~1", "ä", "\n"]
_COMPARISONS: Final[list[Comparison]] = ["=", "!=", "<", "<=", ">", ">="]

texts: Final = st.lists(st.sampled_from(PIECES), max_size=5).map("".join)
"""Short texts of nasty pieces."""

_names: Final = st.sampled_from(_NAMES).map(json.dumps)
_scalars: Final = st.one_of(
    st.sampled_from(_NUMBERS),
    st.sampled_from(["true", "false", "null", '"\\ud800"', '"\\u0041"']),
    texts.map(json.dumps),
)


def _array(items: list[str]) -> str:
    return f"[{', '.join(items)}]"


def _object(items: list[tuple[str, str]]) -> str:
    return f"{{{', '.join(f'{name}: {value}' for name, value in items)}}}"


_values: Final = st.recursive(
    _scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(_array),
        st.lists(st.tuples(_names, inner), max_size=3).map(_object),
    ),
    max_leaves=5,
)
json_attributes: Final = st.one_of(
    st.just(""),
    _values,
    st.lists(st.tuples(_names, _values), min_size=1, max_size=4).map(_object),
    st.sampled_from(_INVALID),
    texts,
)
"""JSON with odd numbers, duplicate names and escapes; invalid JSON; none."""

_fields: Final = st.fixed_dictionaries(
    {
        "target": st.sampled_from(["plc1", "PLC1", "it's", "a%b_c"]),
        "event_class": st.sampled_from(_GUIDS),
        "event_id": _U32,
        "severity": st.sampled_from(Severity),
        "time_ns": _TIMES,
        "source_id": st.none() | _U32,
        "source_name": st.none() | texts,
        "source_guid": st.none() | st.sampled_from(_GUIDS),
        "json_attribute": json_attributes,
        "raised": st.booleans(),
        "confirmation_state": st.sampled_from(ConfirmationState),
        "time_raised_ns": _TIMES,
        "time_cleared_ns": _TIMES,
        "time_confirmed_ns": _TIMES,
        "vendor_id": st.none() | _U32,
        "product_code": st.none() | _U32,
        "revision_no": st.none() | _U32,
    }
)


@st.composite
def events(draw: st.DrawFn) -> AnyEvent:
    """An event of any kind with every field that a filter may ask."""
    return cast(AnyEvent, msgspec.convert({"kind": draw(st.sampled_from(KIND_NAMES)), **draw(_fields)}, AnyEvent, strict=False))


@st.composite
def families(draw: st.DrawFn, size: int = 12) -> list[AnyEvent]:
    """An event and relatives: each has the fields of the first, but for some that it has from another event."""
    first, other = draw(events()), draw(events())
    names = first.__struct_fields__
    family = [first, other]
    mixes = draw(st.lists(st.integers(0, 2 ** len(names) - 1), min_size=size - 2, max_size=size - 2))
    for number, mix in enumerate(mixes):
        # Two random bits out of four keep most relatives close to the first.
        mix &= mixes[number - 1]
        taken = {name: getattr(other if mix >> bit & 1 else first, name) for bit, name in enumerate(names)}
        family.append(KINDS[mix % len(KINDS)](**taken))
    return family


@st.composite
def patterns(draw: st.DrawFn, text: str) -> str:
    """A pattern near the text: pieces replaced by wildcards, cases swapped, something added or lost."""
    chars = list(text)
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(chars)))
        until = min(len(chars), at + draw(st.integers(0, 3)))
        match draw(st.integers(0, 4)):
            case 0:
                chars[at:until] = ["%"]
            case 1:
                chars[at:until] = ["_"] * (until - at)
            case 2:
                chars[at:until] = [char.swapcase() for char in chars[at:until]]
            case 3:
                chars[at:at] = [draw(st.sampled_from(PIECES))]
            case _:
                del chars[at:until]
    return "".join(chars)


@st.composite
def _near(draw: st.DrawFn, field: Field, value: Value | None) -> Value:
    """A value to compare the field with, when the event has `value` there."""
    match field.type:
        case "text":
            return value if isinstance(value, str) and draw(st.booleans()) else draw(patterns(str(value or "")))
        case "guid" | "class":
            return value if isinstance(value, str) and draw(st.booleans()) else draw(st.sampled_from(_GUIDS))
        case "kind":
            return str(value) if draw(st.booleans()) else draw(st.sampled_from(KIND_NAMES))
        case "severity" | "confirmation":
            return draw(st.integers(0, 4))
        case "integer" | "time":
            near = int(value or 0) + draw(st.integers(-1, 1))
            return near if draw(st.integers(0, 5)) else draw(st.sampled_from([-1, 0, 2**63, 2**64, -(2**63) - 1, MAX_TIME_NS]))


def _places(document: object, pointer: str = "") -> list[tuple[str, object]]:
    found = [(pointer, document)]
    if isinstance(document, dict):
        for name, value in document.items():
            found += _places(value, f"{pointer}/{name.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(document, list):
        for index, value in enumerate(document):
            found += _places(value, f"{pointer}/{index}")
    return found


def _loaded(attribute: str) -> object:
    try:
        return json.loads(attribute)
    except ValueError:
        return None


@st.composite
def _json_condition(draw: st.DrawFn, event: AnyEvent) -> Expr:
    pointer, value = draw(st.sampled_from(_places(_loaded(event.json_attribute))))
    if not draw(st.integers(0, 7)):
        pointer += draw(st.sampled_from(["/0", "/a", "/-", "/00", "/"]))
    if isinstance(value, int | float) and not abs(value) < 10**300:
        value = 2**70
    operand = JsonPointer(pointer)
    written = value if isinstance(value, str) else json.dumps(value)
    text = draw(patterns(written.encode("utf-8", "replace").decode()))
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else 3
    number = draw(st.sampled_from([number, number + 1, number - 0.5 if abs(number) < 2**53 else number - 1, 0.1, 1.5, 0]))
    match draw(st.integers(0, 6)):
        case 0:
            return Compare(operand, draw(st.sampled_from(_COMPARISONS[:2])), text)
        case 1 | 2:
            return Compare(operand, draw(st.sampled_from(_COMPARISONS)), number)
        case 3:
            return Like(operand, text)
        case 4:
            return In(operand, (text, number))
        case 5:
            return Between(operand, number - 1, number)
        case _:
            return IsEmpty(operand)


@st.composite
def conditions(draw: st.DrawFn, event: AnyEvent) -> Expr:
    """One condition on a field, a flag or the JSON attribute, near what the event holds."""
    match draw(st.integers(0, 9)):
        case 0:
            return Flag(cast(FlagName, draw(st.sampled_from(list(FLAGS)))))
        case 1 | 2 if event.json_attribute:
            return draw(_json_condition(event))
        case 3:
            return Like("source_name", draw(patterns(event.source_name or "")))
        case _:
            field = draw(st.sampled_from([field for field in FIELDS.values() if not field.log_only]))
            return draw(_field_condition(field, getattr(event, field.name)))


@st.composite
def _field_condition(draw: st.DrawFn, field: Field, value: Value | None) -> Expr:
    operand: Operand = field.name
    operator = draw(st.sampled_from(sorted(field.operators)))
    near = _near(field, value)
    match operator:
        case "like":
            return Like(operand, draw(patterns(str(value or ""))))
        case "in":
            return In(operand, tuple(draw(st.lists(near, min_size=1, max_size=3))))
        case "between":
            low, high = draw(near), draw(near)
            return Between(operand, cast(int, low), cast(int, high))
        case "is empty":
            return IsEmpty(operand)
        case _:
            return Compare(operand, operator, draw(near))


@st.composite
def filters(draw: st.DrawFn, event: AnyEvent, levels: int = 3) -> Expr:
    """A filter of up to a few levels, near the event. At most MAX_DEPTH levels."""
    assert levels <= MAX_DEPTH
    shape = draw(st.integers(0, 9)) if levels > 1 else 0
    match shape:
        case 1 | 2 | 3:
            return And((draw(filters(event, levels - 1)), draw(filters(event, levels - 1))))
        case 4 | 5:
            return Or((draw(filters(event, levels - 1)), draw(filters(event, levels - 1))))
        case 6 | 7:
            return Not(draw(filters(event, levels - 1)))
        case 8 if not draw(st.integers(0, 9)):
            return Everything()
        case _:
            return draw(conditions(event))
