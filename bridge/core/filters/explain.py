"""What becomes of a filter: its tree, the keys it subscribes to, its SQL, and what is left for the predicate.

A pure function; the command prints it. A filter on the unique id has no keys, because live events do not have one.
"""

import msgspec

from bridge.core.filters.ast import And, Everything, Expr, Not, Or, for_events, resolve
from bridge.core.filters.cover import cover, residual
from bridge.core.filters.fields import ClassResolver
from bridge.core.filters.sql import sql
from bridge.core.filters.text import to_text
from bridge.core.keys import expression


class Explanation(msgspec.Struct, frozen=True):
    """A filter as each back end sees it. `residual` is what the keys leave open, "" when they decide; `keys` is None with
    `no_keys` saying why when it is a filter for the log only."""

    text: str
    tree: tuple[str, ...]
    keys: tuple[str, ...] | None
    keys_exact: bool
    no_keys: str
    residual: str
    where: str
    parameters: tuple[str | int, ...]
    sql_exact: bool

    def lines(self) -> list[str]:
        """The explanation for a person."""
        lines = [f"filter    {self.text or 'everything'}", "tree", *(f"  {line}" for line in self.tree)]
        if self.keys is None:
            lines.append(f"keys      none: {self.no_keys}")
        else:
            lines += [f"keys      {_exactness(self.keys_exact)}", *(f"  {key}" for key in self.keys or ("nothing can match",))]
            lines.append(f"predicate {self.residual or 'nothing is left to check'}")
        lines += [f"SQL       {_exactness(self.sql_exact)}", f"  WHERE {self.where}"]
        lines += [f"  ?{number} = {value!r}" for number, value in enumerate(self.parameters, 1)]
        return lines


def _exactness(exact: bool) -> str:
    return "exact" if exact else "may let too much through"


def explain(expr: Expr, realm: str, *, resolve_class: ClassResolver | None = None) -> Explanation:
    """Explain a filter for listeners in a realm. UnknownClassError for a class name that cannot be looked up."""
    expr = resolve(expr, resolve_class)
    clause = sql(expr)
    keys, keys_exact, rest, no_keys = None, False, "", ""
    try:
        for_events(expr)
    except ValueError as error:
        no_keys = str(error)
    else:
        covered = cover(expr)
        keys = tuple(expression(realm, selection) for selection in covered.selections)
        keys_exact = covered.exact
        rest = to_text(residual(expr))
    return Explanation(
        text=to_text(expr),
        tree=tuple(_tree(expr)),
        keys=keys,
        keys_exact=keys_exact,
        no_keys=no_keys,
        residual=rest,
        where=clause.where,
        parameters=clause.parameters,
        sql_exact=clause.exact,
    )


def _tree(expr: Expr, level: int = 0) -> list[str]:
    indent = "  " * level
    match expr:
        case And(items):
            return [f"{indent}and", *(line for item in items for line in _tree(item, level + 1))]
        case Or(items):
            return [f"{indent}or", *(line for item in items for line in _tree(item, level + 1))]
        case Not(item):
            return [f"{indent}not", *_tree(item, level + 1)]
        case Everything():
            return [f"{indent}everything"]
        case _:
            return [indent + to_text(expr)]
