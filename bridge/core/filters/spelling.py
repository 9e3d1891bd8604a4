"""How a filter is written in Python: `(where.severity >= Severity.ERROR) & where.source_name.like("%Main%")`.

Rule 1: what is built is the tree of ast.py and nothing else; a wrong value raises TypeError or ValueError at the call.
Rule 2: combine with `&`, `|`, `~` and parentheses: `and`, `or` and `not` raise, because they would drop one side silently.
Rule 3: the attributes of `where` are the rows of fields.FIELDS and fields.FLAGS; a test compares them.

The classes below only say which operators a type of field has; the nodes check the rest.
"""

from typing import Final, Generic, TypeVar

from bridge.core.events import ConfirmationState, KindName, Severity
from bridge.core.filters.ast import Between, Compare, Everything, Expr, Flag, In, IsEmpty, JsonPointer, Like, Not, Operand
from bridge.core.filters.fields import Value

T = TypeVar("T", bound=Value)
N = TypeVar("N", bound=int | float)


class Equality(Generic[T]):
    """A field that is equal or not: `==`, `!=`, in_()."""

    __slots__ = ("operand",)
    __hash__ = None  # type: ignore[assignment]  # == builds a filter, so that a set of fields would be wrong

    def __init__(self, operand: Operand) -> None:
        self.operand = operand

    def __eq__(self, value: T) -> Expr:  # type: ignore[override]  # it builds a filter
        return Compare(self.operand, "=", value)

    def __ne__(self, value: T) -> Expr:  # type: ignore[override]  # it builds a filter
        return Compare(self.operand, "!=", value)

    def in_(self, *values: T) -> Expr:
        """One of the values, at least one."""
        return In(self.operand, values)


class Order(Equality[N]):
    """A field with an order: also `<`, `<=`, `>`, `>=` and between()."""

    __slots__ = ()

    def __lt__(self, value: N) -> Expr:
        return Compare(self.operand, "<", value)

    def __le__(self, value: N) -> Expr:
        return Compare(self.operand, "<=", value)

    def __gt__(self, value: N) -> Expr:
        return Compare(self.operand, ">", value)

    def __ge__(self, value: N) -> Expr:
        return Compare(self.operand, ">=", value)

    def between(self, low: N, high: N) -> Expr:
        """From low to high, both included."""
        return Between(self.operand, low, high)


class Emptiness:
    """A field that can be missing."""

    __slots__ = ()
    operand: Operand

    def is_empty(self) -> Expr:
        """It is missing or ""."""
        return IsEmpty(self.operand)

    def is_not_empty(self) -> Expr:
        """It is there and not ""."""
        return Not(IsEmpty(self.operand))


class Text(Equality[str], Emptiness):
    """A text: `==`, `!=`, in_(), like(), and whether it is empty."""

    __slots__ = ()

    def like(self, pattern: str) -> Expr:
        """`%` is any characters or none, `_` one character; ASCII letters match in either case."""
        return Like(self.operand, pattern)


class Guid(Equality[str], Emptiness):
    """A GUID in any spelling."""

    __slots__ = ()


class Integer(Order[int], Emptiness):
    """An integer or a time in ns."""

    __slots__ = ()


class Json(Order[float], Emptiness):
    """A place in the JSON attribute, compared with a text (also true, false or None) or with a number; see pointer.py."""

    __slots__ = ()

    def __init__(self, pointer: str) -> None:
        super().__init__(JsonPointer(pointer))

    def __eq__(self, value: Value | None) -> Expr:  # type: ignore[override]  # it builds a filter
        return Compare(self.operand, "=", _json(value))

    def __ne__(self, value: Value | None) -> Expr:  # type: ignore[override]  # it builds a filter
        return Compare(self.operand, "!=", _json(value))

    def in_(self, *values: Value | None) -> Expr:
        """One of the values, at least one; texts and numbers may be mixed."""
        return In(self.operand, tuple(map(_json, values)))

    def like(self, pattern: str) -> Expr:
        """As for texts; a number is the text that is written in the document."""
        return Like(self.operand, pattern)


def _json(value: Value | None) -> Value:
    # bool before the rest: it is an int in Python, and a word of its own in JSON.
    if value is None:
        return "null"
    return ("true" if value else "false") if isinstance(value, bool) else value


class Where:
    """The fields of an event; `where` is the one instance."""

    target: Final = Text("target")
    kind: Final[Equality[KindName]] = Equality("kind")
    event_class: Final[Equality[str]] = Equality("event_class")
    event_id: Final[Order[int]] = Order("event_id")
    severity: Final[Order[Severity]] = Order("severity")
    source_id: Final = Integer("source_id")
    source_name: Final = Text("source_name")
    source_guid: Final = Guid("source_guid")
    json_attribute: Final = Text("json_attribute")
    time_ns: Final = Integer("time_ns")
    time_raised_ns: Final = Integer("time_raised_ns")
    time_cleared_ns: Final = Integer("time_cleared_ns")
    time_confirmed_ns: Final = Integer("time_confirmed_ns")
    confirmation_state: Final[Equality[ConfirmationState]] = Equality("confirmation_state")
    vendor_id: Final = Integer("vendor_id")
    product_code: Final = Integer("product_code")
    revision_no: Final = Integer("revision_no")
    unique_id: Final[Order[int]] = Order("unique_id")
    is_message: Final = Flag("is_message")
    is_alarm: Final = Flag("is_alarm")
    is_raised: Final = Flag("is_raised")
    is_active: Final = Flag("is_active")
    is_wait_for_confirmation: Final = Flag("is_wait_for_confirmation")
    is_ethercat_device: Final = Flag("is_ethercat_device")
    everything: Final = Everything()

    def json(self, pointer: str) -> Json:
        """A place in the JSON attribute (RFC 6901); AdsError ADS_E_INVALIDDATA when it is no pointer."""
        return Json(pointer)


where: Final = Where()
