"""Which keys a listener must subscribe to: the filter seen through target, event class, message or alarm, and severity.

Rule 1: the cover may let too much through, never too little, and says whether it is exact.
Rule 2: selections are disjoint, so that no event arrives twice, and at most 8; else the cover is widened.
Rule 3: a filter that nothing can match has no selections.

How it works. The targets and classes that the filter names, and "another one" for each, span a grid of cells; a cell has ten
bits, one for each pair of type and severity. In a cell every condition on the key is decided and every other one is open, so
the filter has two masks there: the pairs that must match and those that may. And, or and not of filters are and, or and not
of their bits; a condition that is open stays open when it is negated. What may match in some cell is covered, and the cover
is exact when that is what must match.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import combinations
from typing import Final, TypeAlias

import msgspec

from bridge.core.events import KINDS, Severity
from bridge.core.filters.ast import (
    And,
    Between,
    Compare,
    Everything,
    Expr,
    Flag,
    In,
    Not,
    Or,
    for_events,
    int_range,
    leaves,
    resolve,
)
from bridge.core.filters.fields import ClassResolver, Value
from bridge.core.keys import Selection

MAX_SELECTIONS: Final = 8
MAX_CELLS: Final = 512
"""Cells that are looked at; a filter that names more pairs of targets and classes is not narrowed by them."""

_SEVERITIES: Final = tuple(Severity)
_PAIRS: Final = tuple((is_alarm, severity) for is_alarm in (False, True) for severity in _SEVERITIES)
_ALL: Final = (1 << len(_PAIRS)) - 1
_MESSAGES: Final = sum(1 << bit for bit, (is_alarm, _) in enumerate(_PAIRS) if not is_alarm)
_ALARMS: Final = _ALL & ~_MESSAGES

Masks: TypeAlias = tuple[int, int]
"""The pairs that must match, and those that may."""
Cell: TypeAlias = tuple[str | None, str | None]
"""A target and a class; None is one that the filter does not name."""
Region: TypeAlias = dict[Cell, int]
"""Bits per cell."""

_OPEN: Final[Masks] = (0, _ALL)


class Cover(msgspec.Struct, frozen=True):
    """Key selections for a filter; exact when an event matches just because its key is selected."""

    selections: tuple[Selection, ...]
    exact: bool


def cover(expr: Expr, *, resolve_class: ClassResolver | None = None) -> Cover:
    """The keys of every event that may match.

    UnknownClassError for a class name that cannot be looked up, ValueError for a field that only the log has.
    """
    return _Grid(_for_keys(expr, resolve_class)).cover()


def residual(expr: Expr, *, resolve_class: ClassResolver | None = None) -> Expr:
    """What is left to ask of an event whose key is in the cover; Everything() when the cover is exact."""
    expr = _for_keys(expr, resolve_class)
    grid = _Grid(expr)
    return grid.rest(expr, grid.covered(grid.cover().selections))


def places(expr: Expr, *, resolve_class: ClassResolver | None = None) -> Callable[[str, str], bool]:
    """Whether an event of a target and a class may match; not widened, however many the filter names. Errors as cover()."""
    grid = _Grid(_for_keys(expr, resolve_class))
    may = {cell: bool(grid.masks(grid.expr, cell)[1]) for cell in grid.cells}
    targets, classes = {cell[0] for cell in may}, {cell[1] for cell in may}
    return lambda target, event_class: may[
        target if target in targets else None, event_class if event_class in classes else None
    ]


def _for_keys(expr: Expr, resolve_class: ClassResolver | None) -> Expr:
    expr = resolve(expr, resolve_class)
    for_events(expr)
    return expr


class _Grid:
    """The cells of one filter and what may match in them."""

    def __init__(self, expr: Expr) -> None:
        self.expr = expr
        targets, classes = _named(expr, "target"), _named(expr, "event_class")
        self.narrow = len(targets) * len(classes) <= MAX_CELLS
        if not self.narrow:
            targets = classes = (None,)
        self.cells: list[Cell] = [(target, event_class) for target in targets for event_class in classes]

    def cover(self) -> Cover:
        masks = {cell: self.masks(self.expr, cell) for cell in self.cells}
        must = {cell: bits for cell, (bits, _) in masks.items()}
        may = {cell: bits for cell, (_, bits) in masks.items()}
        if not any(may.values()):
            return Cover((), True)
        selections = next(found for found in _candidates(may) if len(found) <= MAX_SELECTIONS and _disjoint(found))
        return Cover(selections, self.covered(selections) == must)

    def covered(self, selections: tuple[Selection, ...]) -> Region:
        """What the selections take in each cell."""
        return {
            cell: sum(
                1 << bit
                for bit, pair in enumerate(_PAIRS)
                if any(_takes(selection, (*cell, *pair)) for selection in selections)
            )
            for cell in self.cells
        }

    def rest(self, expr: Expr, covered: Region) -> Expr:
        """The filter without what is decided wherever something is covered."""
        masks = {cell: self.masks(expr, cell) for cell in self.cells}
        if all(covered[cell] & ~must == 0 for cell, (must, _) in masks.items()):
            return Everything()
        if all(covered[cell] & may == 0 for cell, (_, may) in masks.items()):
            return Not(Everything())
        match expr:
            case And(items):
                left = tuple(part for part in (self.rest(item, covered) for item in items) if part != Everything())
                return And(left) if len(left) > 1 else left[0]
            case Or(items):
                left = tuple(part for part in (self.rest(item, covered) for item in items) if part != Not(Everything()))
                return Or(left) if len(left) > 1 else left[0]
            case Not(item):
                return Not(self.rest(item, covered))
            case _:
                return expr

    def masks(self, expr: Expr, cell: Cell) -> Masks:
        match expr:
            case Everything():
                return _ALL, _ALL
            case Not(item):
                must, may = self.masks(item, cell)
                return _ALL & ~may, _ALL & ~must
            case And(items):
                must = may = _ALL
                for item in items:
                    one, other = self.masks(item, cell)
                    must, may = must & one, may & other
                return must, may
            case Or(items):
                must = may = 0
                for item in items:
                    one, other = self.masks(item, cell)
                    must, may = must | one, may | other
                return must, may
            case _:
                return self.leaf(expr, cell)

    def leaf(self, expr: Expr, cell: Cell) -> Masks:
        target, event_class = cell
        match expr:
            case Flag("is_message"):
                return _MESSAGES, _MESSAGES
            case Flag("is_alarm"):
                return _ALARMS, _ALARMS
            case Flag("is_raised" | "is_active" | "is_wait_for_confirmation"):
                return 0, _ALARMS
            case Compare("severity", "!=", value):
                return _both(_pairs(severity for severity in _SEVERITIES if severity != value))
            case Compare("severity") | Between("severity"):
                low, high = int_range(expr)
                return _both(_pairs(s for s in _SEVERITIES if (low is None or s >= low) and (high is None or s <= high)))
            case In("severity", values):
                return _both(_pairs(values))
            case Compare("kind", op, value):
                return _kinds((value,), op == "=")
            case In("kind", values):
                return _kinds(values, True)
            case Compare("target", op, value):
                return self.chunk(target, (value,), op == "=")
            case In("target", values):
                return self.chunk(target, values, True)
            case Compare("event_class", op, value):
                return self.chunk(event_class, (value,), op == "=")
            case In("event_class", values):
                return self.chunk(event_class, values, True)
            case _:
                return _OPEN

    def chunk(self, found: str | None, values: tuple[Value, ...], wanted: bool) -> Masks:
        if not self.narrow:
            return _OPEN
        return _both(_ALL if (found in values) is wanted else 0)


def _named(expr: Expr, name: str) -> tuple[str | None, ...]:
    """The values of the field that the filter names, and None for any other. No key has an empty name."""
    named: dict[str | None, None] = {None: None}
    for leaf in leaves(expr):
        match leaf:
            case Compare(field, _, str(value)) if field == name and value:
                named[value] = None
            case In(field, values) if field == name:
                named.update((str(value), None) for value in values if value)
            case _:
                pass
    return tuple(named)


def _both(mask: int) -> Masks:
    return mask, mask


def _pairs(severities: Iterable[Value]) -> int:
    chosen = frozenset(severities)
    return sum(1 << bit for bit, (_, severity) in enumerate(_PAIRS) if severity in chosen)


def _kinds(values: Iterable[Value], wanted: bool) -> Masks:
    """The key tells messages from alarms, and no alarm event from another."""
    kinds = {kind for kind in KINDS if (kind.kind in frozenset(values)) is wanted}
    alarms = {kind for kind in KINDS if kind.is_alarm}
    messages = 0 if kinds <= alarms else _MESSAGES
    return messages | (_ALARMS if kinds >= alarms else 0), messages | (_ALARMS if kinds & alarms else 0)


def _takes(selection: Selection, place: tuple[str | None, str | None, bool, Severity]) -> bool:
    return all(chosen is None or chosen == found for chosen, found in zip(_chunks(selection), place, strict=True))


def _chunks(selection: Selection) -> tuple[str | bool | Severity | None, ...]:
    return selection.target, selection.event_class, selection.is_alarm, selection.severity


def _disjoint(selections: tuple[Selection, ...]) -> bool:
    return not any(
        all(a is None or b is None or a == b for a, b in zip(_chunks(one), _chunks(other), strict=True))
        for one, other in combinations(selections, 2)
    )


def _candidates(may: Region) -> Iterator[tuple[Selection, ...]]:
    """Covers of the region, the narrowest first; the last one is always good."""
    any_target = _merged(may, lambda cell: (None, cell[1]))
    any_class = _merged(may, lambda cell: (cell[0], None))
    either = _merged(may, lambda cell: (None, None))
    for region in (may, any_target, any_class, either):
        yield _selections(region)
    yield (Selection(),)


def _merged(region: Region, place: Callable[[Cell], Cell]) -> Region:
    merged: Region = {}
    for cell, bits in region.items():
        merged[place(cell)] = merged.get(place(cell), 0) | bits
    return merged


def _selections(region: Region) -> tuple[Selection, ...]:
    """What is wanted of any target and class, and of those that are named what that leaves."""
    taken: Region = {}
    for target, event_class in sorted(region, key=lambda cell: (cell[0] is not None) + (cell[1] is not None)):
        wider = {(None, None), (None, event_class), (target, None)} - {(target, event_class)}
        bits = region[target, event_class]
        for cell in wider:
            bits &= ~taken.get(cell, 0)
        taken[target, event_class] = bits
    return tuple(Selection(*cell, *pair) for cell, bits in taken.items() for pair in _rectangles(bits))


def _rectangles(bits: int) -> list[tuple[bool | None, Severity | None]]:
    """The fewest disjoint (type, severity) that make up the pairs, None for every one: by rows or by columns."""
    rows = {
        is_alarm: [s for bit, (a, s) in enumerate(_PAIRS) if bits >> bit & 1 and a is is_alarm] for is_alarm in (False, True)
    }
    by_row: list[tuple[bool | None, Severity | None]] = []
    for is_alarm, severities in rows.items():
        by_row += [(is_alarm, None)] if len(severities) == len(_SEVERITIES) else [(is_alarm, s) for s in severities]
    if rows[False] == rows[True]:
        by_row = [(None, severity) for is_alarm, severity in by_row if is_alarm]
    by_column: list[tuple[bool | None, Severity | None]] = []
    for severity in _SEVERITIES:
        types = [is_alarm for is_alarm, severities in rows.items() if severity in severities]
        by_column += [(None, severity)] if len(types) == 2 else [(is_alarm, severity) for is_alarm in types]
    return min(by_row, by_column, key=len)
