"""Events for tests with every field that must be there filled in; name only what the test is about."""

from typing import Final, TypedDict, Unpack

from bridge.core.arguments import Argument
from bridge.core.events import (
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmRaised,
    ConfirmationState,
    MessageSent,
    Origin,
    Severity,
)

TARGET: Final = "plc1"
EVENT_CLASS: Final = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER_CLASS: Final = "5819b654-acc7-4328-a54f-a5886769f484"
TIME_NS: Final = 1_795_334_400_000_000_000
"""2026-11-22T08:00:00Z."""


class Fields(TypedDict, total=False):
    """The fields of an event, each of them optional here."""

    target: str
    event_class: str
    event_id: int
    severity: Severity
    session: str
    seq: int
    key_seq: int
    time_ns: int
    source_id: int | None
    source_name: str | None
    source_guid: str | None
    arguments: tuple[Argument, ...]
    json_attribute: str
    raised: bool
    confirmation_state: ConfirmationState
    time_raised_ns: int
    time_cleared_ns: int
    time_confirmed_ns: int
    vendor_id: int | None
    product_code: int | None
    revision_no: int | None
    operator: str
    client: str
    comment: str
    origin: Origin | None


def _filled(fields: Fields, **defaults: Unpack[Fields]) -> Fields:
    base: Fields = {
        "target": TARGET,
        "event_class": EVENT_CLASS,
        "event_id": 1,
        "severity": Severity.INFO,
        "time_ns": TIME_NS,
    }
    return {**base, **defaults, **fields}


def message_sent(**fields: Unpack[Fields]) -> MessageSent:
    """An info message of event 1 of plc1."""
    return MessageSent(**_filled(fields))


def alarm_raised(**fields: Unpack[Fields]) -> AlarmRaised:
    """An alarm that has just been raised."""
    return AlarmRaised(**_filled(fields, raised=True, time_raised_ns=fields.get("time_ns", TIME_NS)))


def alarm_cleared(**fields: Unpack[Fields]) -> AlarmCleared:
    """An alarm that has just been cleared."""
    return AlarmCleared(**_filled(fields, time_raised_ns=TIME_NS, time_cleared_ns=fields.get("time_ns", TIME_NS)))


def alarm_confirmed(**fields: Unpack[Fields]) -> AlarmConfirmed:
    """An alarm that has just been confirmed while raised."""
    state = ConfirmationState.CONFIRMED
    time_ns = fields.get("time_ns", TIME_NS)
    return AlarmConfirmed(
        **_filled(fields, raised=True, confirmation_state=state, time_raised_ns=TIME_NS, time_confirmed_ns=time_ns)
    )


def alarm_disposed(**fields: Unpack[Fields]) -> AlarmDisposed:
    """An alarm that is gone, cleared before."""
    return AlarmDisposed(**_filled(fields, time_raised_ns=TIME_NS, time_cleared_ns=TIME_NS))
