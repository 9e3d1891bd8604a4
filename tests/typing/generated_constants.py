"""User code for the type checker: what it takes from a generated module, and what it refuses.

Nobody runs this. mypy --strict reports an ignore that nothing needs: a misspelt event that is taken fails the check.
"""

from bridge import EventLogger, LoggerProxy, Severity, where
from bridge.core.events import EventDefinition
from tests.typing.plant_events import TC_EVENT_CLASSES, TC_EVENTS


def report(logger: EventLogger | LoggerProxy) -> None:
    """A constant stands for class, id and severity of a send, and of an alarm."""
    logger.send_message(*TC_EVENTS.Line.Homed, arguments=[3])
    logger.create_alarm(*TC_EVENTS.Faults.DoorOpen, with_confirmation=True)
    logger.send_message(*TC_EVENTS.Line.Homedd)  # type: ignore[attr-defined]  # a misspelt event
    logger.send_message(*TC_EVENTS.Lien.Homed)  # type: ignore[attr-defined]  # a misspelt class
    logger.send_message(TC_EVENTS.Line.Homed)  # type: ignore[call-arg,arg-type]  # the star is missing
    logger.send_message(*TC_EVENTS.Line.Homed, Severity.INFO)  # type: ignore[call-arg,arg-type]  # a severity too many


event: EventDefinition = TC_EVENTS.Faults.LagError
severity: Severity = TC_EVENTS.Faults.LagError.severity
event_class: str = TC_EVENT_CLASSES.Faults
only = where.event_class == TC_EVENT_CLASSES.Line
TC_EVENTS.Line.Homed = event  # type: ignore[misc]  # a constant stays what it is
TC_EVENTS.Line.Homed.event_id = 7  # type: ignore[misc]
event_class = TC_EVENT_CLASSES.Lien  # type: ignore[attr-defined]
