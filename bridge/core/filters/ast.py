"""What somebody wants, as a plain tree: the meeting point of the spellings and the back ends.

Rule 1: a tree that exists is valid. Nodes check their field, operator and value, and bring values into canonical form.
Rule 2: two-valued and total. A comparison with a missing value is false, so its NOT is true; `is empty` asks. `!=` is a
        comparison like the others: false for a missing value.
Rule 3: bounded. At most 255 conditions (each value of IN counts as one, BETWEEN as two) and 64 levels, so that a filter
        from another machine costs a bounded time and no back end can run out of stack.
Rule 4: and/or are n-ary and flat. Nothing is simplified: what was written can be shown again.

What LIKE matches is in like.py, how a JSON value meets an operand in pointer.py.
"""

import math
import re
from collections.abc import Iterator
from typing import Final, Literal, NoReturn, TypeAlias

import msgspec

from bridge.core.filters.fields import (
    COMPARISONS,
    FIELDS,
    FLAGS,
    JSON_OPERATORS,
    ClassResolver,
    Comparison,
    Field,
    Operator,
    Value,
    canonical,
    check_integer,
    check_text,
    is_guid,
)
from bridge.core.hresult import ADS_E_INVALIDDATA, ADS_E_NOMOREHDL, AdsError

MAX_CONDITIONS: Final = 255
MAX_DEPTH: Final = 64
_POINTER: Final = re.compile(r"(?:/(?:[^~/]|~[01])*)*")

FlagName: TypeAlias = Literal[
    "is_message", "is_alarm", "is_raised", "is_active", "is_wait_for_confirmation", "is_ethercat_device"
]


class JsonPointer(msgspec.Struct, frozen=True):
    """A place in the JSON attribute; "" is the whole document. AdsError ADS_E_INVALIDDATA when it is no RFC 6901 pointer."""

    pointer: str

    def __post_init__(self) -> None:
        try:
            if _POINTER.fullmatch(check_text(self.pointer, "a JSON pointer")) is None:
                raise AdsError(
                    ADS_E_INVALIDDATA, f"{self.pointer!r} is no JSON pointer: each step starts with / and ~ is ~0 or ~1"
                )
        except ValueError as error:
            raise AdsError(ADS_E_INVALIDDATA, f"JSON pointer: {error}") from None

    @property
    def steps(self) -> tuple[str, ...]:
        """The names on the way, unescaped."""
        return tuple(step.replace("~1", "/").replace("~0", "~") for step in self.pointer.split("/")[1:])


Operand: TypeAlias = str | JsonPointer
"""What is compared: the name of a field, or a place in the JSON attribute."""


def _checked(operand: Operand, operator: Operator) -> Field | None:
    """The field of the operand, None for a JSON pointer. ValueError when it is unknown or has no such operator."""
    if isinstance(operand, JsonPointer):
        if operator not in JSON_OPERATORS:
            raise ValueError(f"a JSON value has no {operator!r}; it has {', '.join(sorted(JSON_OPERATORS))}")
        return None
    field = FIELDS.get(operand)
    if field is None:
        raise ValueError(f"{operand!r} is no field; expected one of {', '.join(FIELDS)}")
    if operator not in field.operators:
        reason = "it is never empty" if operator == "is empty" else f"it has {', '.join(sorted(field.operators))}"
        raise ValueError(f"{field.name} has no {operator!r}: {reason}")
    return field


def _value(field: Field | None, value: object, ordered: bool = False) -> Value:
    if field is not None:
        return canonical(field, value)
    if isinstance(value, str):
        if ordered:
            raise TypeError("texts have no order; compare a JSON value with a number")
        return check_text(value, "a JSON value")
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} is no JSON number")
        return value
    return check_integer(value, "a JSON value")


def _set(node: msgspec.Struct, **values: object) -> None:
    for name, value in values.items():
        msgspec.structs.force_setattr(node, name, value)


class _Node(msgspec.Struct, frozen=True):
    """What every node can do: be combined with & | ~. It has no truth value."""

    def __and__(self, other: "Expr") -> "And":
        if not isinstance(other, _Node):
            return NotImplemented
        return And((_known(self), other))

    def __or__(self, other: "Expr") -> "Or":
        if not isinstance(other, _Node):
            return NotImplemented
        return Or((_known(self), other))

    def __invert__(self) -> "Not":
        return Not(_known(self))

    def __bool__(self) -> NoReturn:
        raise TypeError("a filter has no truth value: combine filters with & | ~ and parentheses, not with and, or, not, in")


class Everything(_Node, frozen=True):
    """The empty filter: every event."""


class Compare(_Node, frozen=True):
    """`severity >= error`. The order exists for numbers only."""

    field: Operand
    op: Comparison
    value: Value

    def __post_init__(self) -> None:
        if self.op not in COMPARISONS:
            raise ValueError(f"{self.op!r} is no comparison; expected one of {' '.join(COMPARISONS)}")
        field = _checked(self.field, self.op)
        _set(self, value=_value(field, self.value, self.op not in ("=", "!=")))


class Like(_Node, frozen=True):
    """`source_name like '%Main%'`."""

    field: Operand
    pattern: str

    def __post_init__(self) -> None:
        _checked(self.field, "like")
        check_text(self.pattern, "like")


class In(_Node, frozen=True):
    """`event_id in (1, 2)`; a value that is given twice counts once."""

    field: Operand
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        field = _checked(self.field, "in")
        values = tuple(dict.fromkeys(_value(field, value) for value in self.values))
        if not values:
            raise ValueError("in needs at least one value")
        _set(self, values=values)
        _bounded(self)


class Between(_Node, frozen=True):
    """`event_id between 1 and 5`, both ends included; nothing when low is above high."""

    field: Operand
    low: int | float
    high: int | float

    def __post_init__(self) -> None:
        field = _checked(self.field, "between")
        _set(self, low=_value(field, self.low, True), high=_value(field, self.high, True))


class IsEmpty(_Node, frozen=True):
    """`source_name is empty`: missing, or ""."""

    field: Operand

    def __post_init__(self) -> None:
        _checked(self.field, "is empty")


class Flag(_Node, frozen=True):
    """A test without a value: `is_alarm`."""

    name: FlagName

    def __post_init__(self) -> None:
        if self.name not in FLAGS:
            raise ValueError(f"{self.name!r} is no flag; expected one of {', '.join(FLAGS)}")


class And(_Node, frozen=True):
    """All of two or more; an And inside is taken into it."""

    items: tuple["Expr", ...]

    def __post_init__(self) -> None:
        flat: list[Expr] = []
        for item in self.items:
            flat.extend(item.items if isinstance(item, And) else (item,))
        _set(self, items=_operands(flat))
        _bounded(self)


class Or(_Node, frozen=True):
    """One of two or more; an Or inside is taken into it."""

    items: tuple["Expr", ...]

    def __post_init__(self) -> None:
        flat: list[Expr] = []
        for item in self.items:
            flat.extend(item.items if isinstance(item, Or) else (item,))
        _set(self, items=_operands(flat))
        _bounded(self)


class Not(_Node, frozen=True):
    """The opposite."""

    item: "Expr"

    def __post_init__(self) -> None:
        _operands([self.item, self.item])
        _bounded(self)


Expr: TypeAlias = Everything | Compare | Like | In | Between | IsEmpty | Flag | And | Or | Not
"""A filter."""


def _known(node: _Node) -> Expr:
    assert isinstance(node, Expr)
    return node


def _operands(items: list[Expr]) -> tuple[Expr, ...]:
    for item in items:
        if not isinstance(item, Expr):
            raise TypeError(f"{type(item).__name__} is no filter")
    if len(items) < 2:
        raise ValueError("and/or need two filters or more")
    return tuple(items)


def conditions(expr: Expr) -> int:
    """How many conditions the filter has: each value of IN is one, BETWEEN is two."""
    match expr:
        case And(items) | Or(items):
            return sum(map(conditions, items))
        case Not(item):
            return conditions(item)
        case In(_, values):
            return len(values)
        case Between():
            return 2
        case Everything():
            return 0
        case _:
            return 1


def depth(expr: Expr) -> int:
    """How many levels the filter has: a condition is one."""
    match expr:
        case And(items) | Or(items):
            return 1 + max(map(depth, items))
        case Not(item):
            return 1 + depth(item)
        case _:
            return 1


def _bounded(expr: Expr) -> None:
    # The parts were bounded when they were built, so that these walks cannot run out of stack.
    number = conditions(expr)
    if number > MAX_CONDITIONS:
        raise AdsError(ADS_E_NOMOREHDL, f"{number} conditions in a filter, at most {MAX_CONDITIONS} are allowed")
    if depth(expr) > MAX_DEPTH:
        raise too_deep()


def too_deep() -> AdsError:
    """The refusal of a filter with more than MAX_DEPTH levels."""
    return AdsError(ADS_E_NOMOREHDL, f"filter nested deeper than {MAX_DEPTH} levels")


def leaves(expr: Expr) -> Iterator[Expr]:
    """The conditions, in the order in which they were written."""
    match expr:
        case And(items) | Or(items):
            for item in items:
                yield from leaves(item)
        case Not(item):
            yield from leaves(item)
        case _:
            yield expr


class UnknownClassError(ValueError):
    """A class name that no catalog knows, or that met no catalog; `name` is it."""

    def __init__(self, name: str, reason: str) -> None:
        self.name = name
        super().__init__(f"event class {name!r} {reason}")


def class_guids(name: str, resolve_class: ClassResolver | None) -> tuple[str, ...]:
    """The GUIDs of a class name, or the GUID itself. UnknownClassError when there are none."""
    if is_guid(name):
        return (name,)
    if resolve_class is None:
        raise UnknownClassError(name, "is a name, and no catalog of event classes was given to look it up; use its GUID")
    guids = tuple(dict.fromkeys(resolve_class(name)))
    if not guids:
        raise UnknownClassError(name, "is unknown")
    return guids


def resolve(expr: Expr, resolve_class: ClassResolver | None = None) -> Expr:
    """The filter with every class name replaced by its GUIDs (one: a comparison; several: IN). UnknownClassError else."""
    match expr:
        case And(items):
            return And(tuple(resolve(item, resolve_class) for item in items))
        case Or(items):
            return Or(tuple(resolve(item, resolve_class) for item in items))
        case Not(item):
            return Not(resolve(item, resolve_class))
        case Compare("event_class", op, value):
            guids = class_guids(str(value), resolve_class)
            if len(guids) == 1:
                return Compare("event_class", op, guids[0])
            several = In("event_class", guids)
            return several if op == "=" else Not(several)
        case In("event_class", values):
            return In("event_class", tuple(guid for value in values for guid in class_guids(str(value), resolve_class)))
        case _:
            return expr


def for_events(expr: Expr) -> None:
    """Return when the filter asks only what an event knows; ValueError when it asks for something that only the log has."""
    for leaf in leaves(expr):
        match leaf:
            case Compare(str(name)) | In(str(name)) | Between(str(name)) if FIELDS[name].log_only:
                raise ValueError(f"{name} is given when an event is stored: it can be asked of the log, not of live events")
            case _:
                pass


def int_range(node: Compare | Between) -> tuple[int | None, int | None]:
    """The whole numbers, both ends included and None for no end, that an order or an equality of a field takes; not for !=."""
    match node:
        case Between(_, low, high):
            return int(low), int(high)
        case Compare(_, op, value):
            number = int(value)
    match op:
        case "=":
            return number, number
        case "<":
            return None, number - 1
        case "<=":
            return None, number
        case ">":
            return number + 1, None
        case ">=":
            return number, None
        case "!=":
            raise ValueError("!= takes no range")
