"""User code for the type checker: chains that it must take, and chains that it must refuse.

Nobody runs this. mypy --strict reports an ignore that nothing needs: a wrong chain that is taken fails the check.
"""

from bridge.core.events import Severity
from bridge.twincat.filters import BinaryExpression, FB_TcEventFilter, LogicalExpression

fbFilter = FB_TcEventFilter()

operand: BinaryExpression = fbFilter.Clear()
end: LogicalExpression = operand.Severity.GreaterThan(Severity.ERROR).AND_OP().Source.Name.Like("%Main%")
operand = end.OR_OP().NOT_OP()
end = fbFilter.FilterExpression(fbFilter).AND_OP().FilterExpression(end)

fbFilter.AND_OP()  # type: ignore[attr-defined]  # an operator where a condition is expected
fbFilter.Clear().OR_OP()  # type: ignore[attr-defined]
fbFilter.IsAlarm().IsMessage()  # type: ignore[attr-defined]  # two conditions without an operator
fbFilter.IsAlarm().NOT_OP()  # type: ignore[attr-defined]  # a negation where an operator is expected
fbFilter.IsAlarm().AND_OP().AND_OP()  # type: ignore[attr-defined]  # two operators
fbFilter.IsAlarm().AND_OP().Clear()  # type: ignore[attr-defined]  # only the filter itself is cleared
fbFilter.Severity.Like("%")  # type: ignore[attr-defined]  # a severity is no text
fbFilter.Source.Name.GreaterThan("a")  # type: ignore[attr-defined]  # texts have no order
fbFilter.EventId.EqualTo("1")  # type: ignore[arg-type]  # a number is no text
fbFilter.EventClass.EqualsTo("x")  # type: ignore[attr-defined]  # the library's name is EqualTo
fbFilter.EtherCATDevice()  # type: ignore[operator]  # a property, not a method
fbFilter.FilterExpression(fbFilter.IsAlarm().AND_OP())  # type: ignore[arg-type]  # a chain that has not ended
