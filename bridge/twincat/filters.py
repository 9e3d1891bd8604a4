"""How a filter is written in a PLC: `FB_TcEventFilter().Clear().IsAlarm().AND_OP().Source.Name.Like("%Main%")`.

Rule 1: two classes take turns. BinaryExpression expects an operand, LogicalExpression an operator or the end, so that a type
        checker refuses a wrong chain.
Rule 2: as in a PLC the chain writes into its filter: `fbFilter.Clear()...` and then `fbFilter` is handed over.
Rule 3: checked when it is applied, not while it is built (manual 5.10.1): `expression` raises AdsError, ADS_E_INVALIDPARM for
        a chain that no type checker has seen, ADS_E_NOMOREHDL beyond 255 conditions.
Rule 4: NOT before AND before OR. The manual leaves open which of AND_OP and OR_OP binds first, so that a chain with both and
        no group warns: MixedOperatorsWarning. FilterExpression(...) makes a group.

What is built is the tree of bridge.core.filters.ast and nothing else. Times are FILETIME ticks of 100 ns. Manual 6.1.2.3;
the names and types are those of the library (EqualTo, not EqualsTo; EtherCATDevice is a property).
"""

import warnings
from typing import Literal, Protocol, TypeAlias

from bridge.core.events import ConfirmationState, Severity
from bridge.core.filters.ast import (
    And,
    Compare,
    Everything,
    Expr,
    Flag,
    FlagName,
    IsEmpty,
    JsonPointer,
    Like,
    Not,
    Operand,
    Or,
)
from bridge.core.filters.fields import Comparison, Value
from bridge.core.hresult import ADS_E_INVALIDPARM, AdsError
from bridge.core.times import from_filetime

_Operator: TypeAlias = Literal["AND_OP", "OR_OP", "NOT_OP"]


class MixedOperatorsWarning(UserWarning):
    """AND_OP and OR_OP stand in one chain without a group: AND binds first. FilterExpression(...) groups."""


class EventFilterBase(Protocol):
    """What can be grouped or subscribed: a filter, or the end of a chain (I_TcEventFilterBase)."""

    @property
    def expression(self) -> Expr:
        """The filter as a tree."""


class _Tokens:
    """What a chain has said so far, in the order in which it was said."""

    def __init__(self) -> None:
        self.items: list[Expr | _Operator] = []

    def join(self, operator: Literal["AND_OP", "OR_OP"]) -> None:
        other = "OR_OP" if operator == "AND_OP" else "AND_OP"
        if other in self.items and operator not in self.items:
            warnings.warn(
                f"{operator} beside {other} without a group: AND binds before OR; use FilterExpression(...) to group",
                MixedOperatorsWarning,
                stacklevel=3,
            )
        self.items.append(operator)

    def tree(self) -> Expr:
        """Or of Ands of what may be negated; AdsError ADS_E_INVALIDPARM when an operand or an operator is missing."""
        if not self.items:
            return Everything()
        alternatives: list[list[Expr]] = [[]]
        negations, expected = 0, True
        for item in self.items:
            if isinstance(item, str) and item != "NOT_OP":
                if expected:
                    raise AdsError(ADS_E_INVALIDPARM, f"{item} without a condition before it")
                expected = True
                if item == "OR_OP":
                    alternatives.append([])
                continue
            if not expected:
                raise AdsError(ADS_E_INVALIDPARM, "two conditions without AND_OP or OR_OP between them")
            if isinstance(item, str):
                negations += 1
                continue
            for _ in range(negations):
                item = Not(item)
            negations, expected = 0, False
            alternatives[-1].append(item)
        if expected:
            raise AdsError(ADS_E_INVALIDPARM, "the filter ends with an operator")
        parts = [And(tuple(items)) if len(items) > 1 else items[0] for items in alternatives]
        return Or(tuple(parts)) if len(parts) > 1 else parts[0]


class LogicalExpression:
    """After a condition: an operator, or the end."""

    def __init__(self, tokens: _Tokens) -> None:
        self._tokens = tokens

    def AND_OP(self) -> "BinaryExpression":
        """And what follows."""
        self._tokens.join("AND_OP")
        return BinaryExpression(self._tokens)

    def OR_OP(self) -> "BinaryExpression":
        """Or what follows."""
        self._tokens.join("OR_OP")
        return BinaryExpression(self._tokens)

    @property
    def expression(self) -> Expr:
        """The filter as a tree."""
        return self._tokens.tree()


class _Part:
    def __init__(self, tokens: _Tokens) -> None:
        self._tokens = tokens

    def _add(self, condition: Expr) -> LogicalExpression:
        self._tokens.items.append(condition)
        return LogicalExpression(self._tokens)


class _Compared(_Part):
    def __init__(self, tokens: _Tokens, operand: Operand) -> None:
        super().__init__(tokens)
        self._operand = operand

    def _compare(self, op: Comparison, value: Value) -> LogicalExpression:
        return self._add(Compare(self._operand, op, value))


class GuidCompare(_Compared):
    """A GUID in any spelling; of an event class also its name."""

    def EqualTo(self, value: str) -> LogicalExpression:
        return self._compare("=", value)

    def NotEqualTo(self, value: str) -> LogicalExpression:
        return self._compare("!=", value)


class UDIntCompare(_Compared):
    """A number."""

    def EqualTo(self, value: int) -> LogicalExpression:
        return self._compare("=", value)

    def NotEqualTo(self, value: int) -> LogicalExpression:
        return self._compare("!=", value)

    def LessThan(self, value: int) -> LogicalExpression:
        return self._compare("<", value)

    def LessThanOrEqualTo(self, value: int) -> LogicalExpression:
        return self._compare("<=", value)

    def GreaterThan(self, value: int) -> LogicalExpression:
        return self._compare(">", value)

    def GreaterThanOrEqualTo(self, value: int) -> LogicalExpression:
        return self._compare(">=", value)


class ULIntCompare(UDIntCompare):
    """A time in FILETIME ticks of 100 ns; a time of ours with a finer part lies after its tick."""

    def _compare(self, op: Comparison, value: Value) -> LogicalExpression:
        if not isinstance(value, int):
            raise TypeError(f"a time is compared with FILETIME ticks, not with {type(value).__name__}")
        return super()._compare(op, from_filetime(value))


class SeverityCompare(_Compared):
    """A severity."""

    def EqualTo(self, value: Severity) -> LogicalExpression:
        return self._compare("=", value)

    def NotEqualTo(self, value: Severity) -> LogicalExpression:
        return self._compare("!=", value)

    def LessThan(self, value: Severity) -> LogicalExpression:
        return self._compare("<", value)

    def LessThanOrEqualTo(self, value: Severity) -> LogicalExpression:
        return self._compare("<=", value)

    def GreaterThan(self, value: Severity) -> LogicalExpression:
        return self._compare(">", value)

    def GreaterThanOrEqualTo(self, value: Severity) -> LogicalExpression:
        return self._compare(">=", value)


class ConfirmationStateCompare(_Compared):
    """A confirmation state."""

    def EqualTo(self, value: ConfirmationState) -> LogicalExpression:
        return self._compare("=", value)

    def NotEqualTo(self, value: ConfirmationState) -> LogicalExpression:
        return self._compare("!=", value)


class StringCompare(_Compared):
    """A text: `%` is any characters or none, `_` one."""

    def EqualTo(self, value: str) -> LogicalExpression:
        return self._compare("=", value)

    def NotEqualTo(self, value: str) -> LogicalExpression:
        return self._compare("!=", value)

    def Like(self, value: str) -> LogicalExpression:
        return self._add(Like(self._operand, value))

    def IsEmpty(self) -> LogicalExpression:
        return self._add(IsEmpty(self._operand))

    def IsNotEmpty(self) -> LogicalExpression:
        return self._add(Not(IsEmpty(self._operand)))


class _Flags(_Part):
    def _flag(self, name: FlagName) -> LogicalExpression:
        return self._add(Flag(name))


class AlarmFilterExpression(_Flags):
    """The state of an alarm: active is raised or waiting for its confirmation."""

    @property
    def ConfirmationState(self) -> ConfirmationStateCompare:
        return ConfirmationStateCompare(self._tokens, "confirmation_state")

    def IsActive(self) -> LogicalExpression:
        return self._flag("is_active")

    def IsRaised(self) -> LogicalExpression:
        return self._flag("is_raised")

    def IsWaitForConfirmation(self) -> LogicalExpression:
        return self._flag("is_wait_for_confirmation")


class EtherCATDeviceExpression(_Flags):
    """The device that an event came from."""

    def IsEtherCATDevice(self) -> LogicalExpression:
        return self._flag("is_ethercat_device")

    @property
    def VendorId(self) -> UDIntCompare:
        return UDIntCompare(self._tokens, "vendor_id")

    @property
    def ProductCode(self) -> UDIntCompare:
        return UDIntCompare(self._tokens, "product_code")

    @property
    def RevisionNo(self) -> UDIntCompare:
        return UDIntCompare(self._tokens, "revision_no")


class JsonAttributeExpression(_Part):
    """The JSON attribute: the text as a whole, or a value in it."""

    @property
    def Value(self) -> StringCompare:
        return StringCompare(self._tokens, "json_attribute")

    def JsonPointer(self, value: str) -> StringCompare:
        """A value inside (RFC 6901); AdsError ADS_E_INVALIDDATA when it is no pointer."""
        return StringCompare(self._tokens, JsonPointer(value))


class SourceInfoExpression(_Part):
    """Where an event came from."""

    @property
    def Guid(self) -> GuidCompare:
        return GuidCompare(self._tokens, "source_guid")

    @property
    def Id(self) -> UDIntCompare:
        return UDIntCompare(self._tokens, "source_id")

    @property
    def Name(self) -> StringCompare:
        return StringCompare(self._tokens, "source_name")


class BinaryExpression(_Flags):
    """Where a condition is expected."""

    @property
    def AlarmState(self) -> AlarmFilterExpression:
        return AlarmFilterExpression(self._tokens)

    @property
    def EtherCATDevice(self) -> EtherCATDeviceExpression:
        return EtherCATDeviceExpression(self._tokens)

    @property
    def EventClass(self) -> GuidCompare:
        return GuidCompare(self._tokens, "event_class")

    @property
    def EventId(self) -> UDIntCompare:
        return UDIntCompare(self._tokens, "event_id")

    @property
    def JsonAttribute(self) -> JsonAttributeExpression:
        return JsonAttributeExpression(self._tokens)

    @property
    def Severity(self) -> SeverityCompare:
        return SeverityCompare(self._tokens, "severity")

    @property
    def Source(self) -> SourceInfoExpression:
        return SourceInfoExpression(self._tokens)

    @property
    def TimeCleared(self) -> ULIntCompare:
        return ULIntCompare(self._tokens, "time_cleared_ns")

    @property
    def TimeConfirmed(self) -> ULIntCompare:
        return ULIntCompare(self._tokens, "time_confirmed_ns")

    @property
    def TimeRaised(self) -> ULIntCompare:
        return ULIntCompare(self._tokens, "time_raised_ns")

    @property
    def UniqueId(self) -> UDIntCompare:
        """The number the logger gave; the log knows it, a live event does not."""
        return UDIntCompare(self._tokens, "unique_id")

    def IsAlarm(self) -> LogicalExpression:
        return self._flag("is_alarm")

    def IsMessage(self) -> LogicalExpression:
        return self._flag("is_message")

    def FilterExpression(self, ipExpression: EventFilterBase) -> LogicalExpression:
        """A group: another filter as one condition, as it is now."""
        return self._add(ipExpression.expression)

    def NOT_OP(self) -> "BinaryExpression":
        """The opposite of the condition or group that follows."""
        self._tokens.items.append("NOT_OP")
        return BinaryExpression(self._tokens)


class FB_TcEventFilter(BinaryExpression):
    """A filter to be filled by a chain; an empty one takes every event."""

    def __init__(self) -> None:
        super().__init__(_Tokens())

    def Clear(self) -> BinaryExpression:
        """Forget what was said."""
        self._tokens.items.clear()
        return BinaryExpression(self._tokens)

    @property
    def expression(self) -> Expr:
        """The filter as a tree, as it is now; AdsError when the chain is not valid."""
        return self._tokens.tree()
