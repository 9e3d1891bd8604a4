"""What a listener wants: its filter, as keys to subscribe to and as tests for what comes through them.

Rule: a sieve never changes. A listener with another filter has another sieve.
"""

from collections.abc import Callable, Sequence

from bridge.core import keys
from bridge.core.filters.ast import And, Compare, Everything, Expr, resolve
from bridge.core.filters.cover import cover, residual
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse


class Sieve:
    """A filter made ready. FilterSyntaxError, UnknownClassError, ValueError or AdsError for a bad one."""

    def __init__(
        self,
        filter: Expr | str | None,
        target: str | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
    ) -> None:
        """filter: None takes everything; target: only of this one."""
        if filter is None:
            filter = Everything()
        expr = parse(filter, resolve_class=resolve_class) if isinstance(filter, str) else filter
        expr = resolve(expr, resolve_class)
        if target is not None:
            mine = Compare("target", "=", target)
            expr = mine if isinstance(expr, Everything) else And((mine, expr))
        self.filter = expr
        self.matches = None if isinstance(expr, Everything) else compile_filter(expr)
        """The whole filter; None takes all."""
        self.selections = cover(expr).selections
        left = residual(expr)
        self.check = None if isinstance(left, Everything) else compile_filter(left)
        """What is left to ask of an event whose key is wanted; None takes all."""
        targets = {selection.target for selection in self.selections} or {None}
        self.targets: list[str | None] = [None] if None in targets else [*sorted(t for t in targets if t is not None)]
        """Whose senders matter; [None] is everybody's."""
        self._wanted: dict[str, bool] = {}

    def wants(self, key: str) -> bool:
        """Whether events of this key may be taken."""
        known = self._wanted.get(key)
        if known is None:
            try:
                parsed = keys.parse_event_key(key)
            except keys.KeyFormatError:
                known = False
            else:
                known = any(keys.includes(selection, parsed) for selection in self.selections)
            self._wanted[key] = known
        return known
