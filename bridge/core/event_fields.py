"""What a row of the log shows: one table of fields, read by sorting, the CSV export, the commands and the documentation.

Rule 1: the numbers 0 to 12 are those of TcEventField (library 3.1.27); those from 100 on are ours.
Rule 2: `sql` is the column or expression of the log that sorts like the field; "" when only Python can tell, because the value
comes from the event classes and depends on the language.
Rule 3: missing sorts as the smallest value. Texts sort by code point, GUIDs as they are written.

A row is one transition. In the view of occurrences it is the newest transition of an alarm's life, which carries the times of
those before it. TimeRaised of a message is the time it was sent (manual 6.1.2.3).
"""

from enum import IntEnum
from typing import Final, Literal, Protocol, TypeAlias

import msgspec

from bridge.core.catalog import ENGLISH, Language
from bridge.core.events import AnyEvent, ConfirmationState


class EventField(IntEnum):
    """TcEventField, and fields of ours."""

    ID = 0
    SEVERITY_LEVEL = 1
    EVENT_CLASS = 2
    EVENT_CLASS_NAME = 3
    EVENT_ID = 4
    EVENT_TEXT = 5
    TIME_RAISED = 6
    TIME_CONFIRMED = 7
    TIME_CLEARED = 8
    SOURCE_NAME = 9
    SOURCE_ID = 10
    SOURCE_GUID = 11
    JSON_ATTRIBUTE = 12
    TIME = 100
    KIND = 101
    TARGET = 102
    ALARM_STATE = 103
    DURATION = 104
    OPERATOR = 105
    CLIENT = 106
    COMMENT = 107


SortName: TypeAlias = Literal[
    "id",
    "severity_level",
    "event_class",
    "event_class_name",
    "event_id",
    "event_text",
    "time_raised",
    "time_confirmed",
    "time_cleared",
    "source_name",
    "source_id",
    "source_guid",
    "json_attribute",
    "time",
    "kind",
    "target",
]
"""What a question about the log may be sorted by: every TcEventField, and the first three of ours."""


class Row(Protocol):
    """A stored event."""

    @property
    def event(self) -> AnyEvent: ...
    @property
    def unique_id(self) -> int: ...


class Names(Protocol):
    """What knows texts and class names: a Catalog, or what stands for one that still learns."""

    def class_name(self, event_class: str, language: Language = ENGLISH) -> str: ...
    def event_text(self, event: AnyEvent, language: Language = ENGLISH) -> str: ...


class FieldRow(msgspec.Struct, frozen=True):
    """A field: its heading in a table, how it is written, and what sorts like it in the log."""

    field: EventField
    heading: str
    form: Literal["number", "text", "time"]
    sql: str = ""


FIELD_ROWS: Final = {
    row.field: row
    for row in (
        FieldRow(EventField.ID, "Unique Id", "number", "unique_id"),
        FieldRow(EventField.SEVERITY_LEVEL, "Severity Level", "text", "severity"),
        FieldRow(EventField.EVENT_CLASS, "Event Class", "text", "event_class"),
        FieldRow(EventField.EVENT_CLASS_NAME, "Event Class Name", "text"),
        FieldRow(EventField.EVENT_ID, "Event Id", "number", "event_id"),
        FieldRow(EventField.EVENT_TEXT, "Event Text", "text"),
        FieldRow(EventField.TIME_RAISED, "Time Raised", "time", "iif(is_alarm, time_raised_ns, time_ns)"),
        FieldRow(EventField.TIME_CONFIRMED, "Time Confirmed", "time", "time_confirmed_ns"),
        FieldRow(EventField.TIME_CLEARED, "Time Cleared", "time", "time_cleared_ns"),
        FieldRow(EventField.SOURCE_NAME, "Source Name", "text", "source_name"),
        FieldRow(EventField.SOURCE_ID, "Source Id", "number", "source_id"),
        FieldRow(EventField.SOURCE_GUID, "Source Guid", "text", "source_guid"),
        FieldRow(EventField.JSON_ATTRIBUTE, "Json Attribute", "text", "json_attribute"),
        FieldRow(EventField.TIME, "Time", "time", "time_ns"),
        FieldRow(EventField.KIND, "Event", "text", "kind"),
        FieldRow(EventField.TARGET, "Target", "text", "target"),
        FieldRow(EventField.ALARM_STATE, "Alarm State", "text"),
        FieldRow(EventField.DURATION, "Duration", "number"),
        FieldRow(EventField.OPERATOR, "Operator", "text"),
        FieldRow(EventField.CLIENT, "Client", "text"),
        FieldRow(EventField.COMMENT, "Comment", "text"),
    )
}
NAMES: Final = {field.name.lower(): field for field in EventField}
"""Fields by their names in questions and options."""

_CONFIRMATION: Final = {
    ConfirmationState.NOT_SUPPORTED: "",
    ConfirmationState.NOT_REQUIRED: ",NotRequired",
    ConfirmationState.WAIT_FOR_CONFIRMATION: ",WaitForConfirmation",
    ConfirmationState.CONFIRMED: ",Confirmed",
    ConfirmationState.RESET: ",Reset",
}


def alarm_state(event: AnyEvent) -> str:
    """The state after the event as the Logged Events window writes it: "Inactive(Cleared,Confirmed)", "<message>"."""
    if not event.is_alarm:
        return "<message>"
    active = event.raised or event.confirmation_state is ConfirmationState.WAIT_FOR_CONFIRMATION
    words = ("Raised" if event.raised else "Cleared") + _CONFIRMATION[event.confirmation_state]
    return f"{'Active' if active else 'Inactive'}({words})"


def duration_ns(event: AnyEvent) -> int | None:
    """From raised to cleared, None while that is not known; below 0 when the times given with the commands say so."""
    if not event.is_alarm or not event.time_raised_ns or not event.time_cleared_ns:
        return None
    return event.time_cleared_ns - event.time_raised_ns


def value(field: EventField, row: Row, catalog: Names, language: Language) -> int | str | None:
    """The field's value: times in Unix ns (0: not set), a duration in ns, the severity as its number; None when absent."""
    event = row.event
    match field:
        case EventField.ID:
            return row.unique_id
        case EventField.SEVERITY_LEVEL:
            return int(event.severity)
        case EventField.EVENT_CLASS_NAME:
            return catalog.class_name(event.event_class, language)
        case EventField.EVENT_TEXT:
            return catalog.event_text(event, language)
        case EventField.TIME_RAISED:
            return event.time_raised_ns if event.is_alarm else event.time_ns
        case EventField.ALARM_STATE:
            return alarm_state(event)
        case EventField.DURATION:
            return duration_ns(event)
        case _:
            found: int | str | None = getattr(event, _ATTRIBUTES[field])
            return found


_ATTRIBUTES: Final = {
    EventField.EVENT_CLASS: "event_class",
    EventField.EVENT_ID: "event_id",
    EventField.TIME_CONFIRMED: "time_confirmed_ns",
    EventField.TIME_CLEARED: "time_cleared_ns",
    EventField.SOURCE_NAME: "source_name",
    EventField.SOURCE_ID: "source_id",
    EventField.SOURCE_GUID: "source_guid",
    EventField.JSON_ATTRIBUTE: "json_attribute",
    EventField.TIME: "time_ns",
    EventField.KIND: "kind",
    EventField.TARGET: "target",
    EventField.OPERATOR: "operator",
    EventField.CLIENT: "client",
    EventField.COMMENT: "comment",
}
