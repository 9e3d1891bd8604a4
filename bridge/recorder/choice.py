"""What a recording takes: a filter, targets, a trigger, and what has to be listened to for them.

Rule 1: recorded is what the filter or the trigger takes, of the chosen targets.
Rule 2: every alarm transition of those targets is listened to, recorded or not: a keyframe is right only if no transition of
its alarms went by unseen.
"""

from collections.abc import Callable, Sequence

from bridge.core import keys
from bridge.core.events import AnyEvent
from bridge.core.filters.ast import And, Everything, Expr, Flag, In, Or
from bridge.core.filters.ast import resolve as resolved
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse
from bridge.core.hresult import AdsError
from bridge.sieve import Sieve


class Choice:
    """A choice made ready. FilterSyntaxError, UnknownClassError, ValueError or AdsError for a bad filter or trigger."""

    def __init__(
        self,
        filter: Expr | str | None,
        targets: Sequence[str] = (),
        trigger: Expr | str | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
    ) -> None:
        """filter None takes everything, no targets means all of them."""
        fires = None if trigger is None else _expr(trigger, resolve_class)
        wanted = Everything() if filter is None else _expr(filter, resolve_class)
        self.filter = wanted
        """The filter alone, class names resolved."""
        self.trigger = fires
        self.fires: Callable[[AnyEvent], bool] = (lambda event: False) if fires is None else _predicate(fires)
        """Whether an event is a trigger."""
        if fires is not None:
            wanted = Everything() if Everything() in (wanted, fires) else Or((wanted, fires))
        if targets:
            mine = In("target", tuple(targets))
            wanted = mine if isinstance(wanted, Everything) else And((mine, wanted))
        self._sieve = Sieve(wanted)
        self.takes = self._sieve.matches
        """Whether an event is recorded, and an alarm in the keyframes; None takes all."""
        self.listens = self._with_alarms(wanted)
        """What a listener has to subscribe to."""

    def wants(self, key: str) -> bool:
        """Whether what is wrong on this key concerns the recording; what is no key of an event does."""
        try:
            keys.parse_event_key(key)
        except keys.KeyFormatError:
            return True
        return self._sieve.wants(key)

    def _with_alarms(self, wanted: Expr) -> Expr:
        if isinstance(wanted, Everything):
            return wanted
        targets = tuple(target for target in self._sieve.targets if target is not None)
        alarms: Expr = And((In("target", targets), Flag("is_alarm"))) if targets else Flag("is_alarm")
        try:
            return Or((wanted, alarms))
        except AdsError:  # together they are too large for one filter
            return In("target", targets) if targets else Everything()


def _expr(filter: Expr | str, resolve_class: Callable[[str], Sequence[str]] | None) -> Expr:
    return resolved(parse(filter, resolve_class=resolve_class) if isinstance(filter, str) else filter, resolve_class)


def _predicate(expr: Expr) -> Callable[[AnyEvent], bool]:
    return (lambda event: True) if isinstance(expr, Everything) else compile_filter(expr)
