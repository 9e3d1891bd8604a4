"""What SQL leaves to Python: the filter as a predicate over rows.

Rule 1: the answer is that of the compiled predicate; this file only supplies what an event does not know, its unique id.
Rule 2: conditions on the unique id are answered first; the rest is compiled once for each combination of their answers.
"""

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from bridge.core.events import AnyEvent, MessageSent, Severity
from bridge.core.filters.ast import And, Between, Compare, Everything, Expr, In, Not, Or, leaves
from bridge.core.filters.fields import FIELDS
from bridge.core.filters.predicate import Predicate, compile_filter

RowPredicate: TypeAlias = Callable[[int, AnyEvent], bool]
_UNIQUE_ID = "unique_id"
_NOTHING = Compare("event_id", "<", 0)


def row_predicate(expr: Expr) -> RowPredicate:
    """The filter as a function of unique id and event."""
    asked = [leaf for leaf in leaves(expr) if _is_log_only(leaf)]
    if not asked:
        matches = compile_filter(expr)
        return lambda _, event: matches(event)
    tests = [compile_filter(msgspec.structs.replace(leaf, field="event_id")) for leaf in asked]
    compiled: dict[tuple[bool, ...], Predicate] = {}

    def both(unique_id: int, event: AnyEvent) -> bool:
        bearer = MessageSent(target="", event_class="", event_id=unique_id, severity=Severity.VERBOSE)
        answers = tuple(test(bearer) for test in tests)
        matches = compiled.get(answers)
        if matches is None:
            matches = compiled[answers] = compile_filter(_answered(expr, dict(zip(map(id, asked), answers, strict=True))))
        return matches(event)

    return both


def _is_log_only(leaf: Expr) -> bool:
    match leaf:
        case Compare(str(name)) | In(str(name)) | Between(str(name)) if FIELDS[name].log_only:
            assert name == _UNIQUE_ID, name
            return True
        case _:
            return False


def _answered(expr: Expr, answers: dict[int, bool]) -> Expr:
    match expr:
        case And(items):
            return And(tuple(_answered(item, answers) for item in items))
        case Or(items):
            return Or(tuple(_answered(item, answers) for item in items))
        case Not(item):
            return Not(_answered(item, answers))
        case _ if id(expr) in answers:
            return Everything() if answers[id(expr)] else _NOTHING
        case _:
            return expr
