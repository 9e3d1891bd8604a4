"""What the tests of the cache put into it."""

from collections.abc import Iterable

from bridge.core.alarms import Alarm
from bridge.core.arguments import Argument
from bridge.core.events import AnyEvent, ConfirmationState, MessageSent, Origin, Severity
from bridge.edges.cache import StoreBatch, Stored, StoredAlarm, StoredEvent
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    TIME_NS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

NASTY_TEXTS = (
    "",
    "\0",
    "a\0b",
    "\ud800",
    "x\udfff\0",
    "?",
    "%_",
    "'\"\n\\",
    "Kelvin \u212a",
    "\U0001f525 Näht",
    "true",
    "9223372036854775808",
)


def message(number: int, session: str = "s1") -> MessageSent:
    """The number-th event of a session, different from its neighbours in class, severity, source and JSON."""
    return message_sent(
        event_class=EVENT_CLASS if number % 3 else OTHER_CLASS,
        event_id=number % 10,
        severity=Severity(number % 5),
        session=session,
        seq=number,
        key_seq=number,
        time_ns=TIME_NS + number // 2,
        source_name=f"Main.fbAxis[{number % 7}]",
        json_attribute=f'{{"axis": {number % 4}}}',
    )


def stored(events: Iterable[AnyEvent], first_id: int = 1) -> tuple[Stored, ...]:
    """Events with unique ids and arrival times that follow each other."""
    return tuple(Stored(first_id + n, TIME_NS + n, event) for n, event in enumerate(events))


def messages(first: int, last: int, session: str = "s1") -> StoreBatch:
    """A batch of the messages first to last; their unique ids are their numbers."""
    return StoreBatch(stored((message(n, session) for n in range(first, last + 1)), first))


def alarm(event_id: int = 1, unique_id: int = 7, source_name: str | None = "Main", raised: bool = True) -> StoredAlarm:
    """A state of an alarm that waits for confirmation."""
    state = Alarm(
        target="plc1",
        event_class=EVENT_CLASS,
        event_id=event_id,
        severity=Severity.ERROR,
        source_name=source_name,
        raised=raised,
        confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION,
        time_raised_ns=TIME_NS,
        arguments=(Argument.of(1.5), Argument.of("x")),
        session="s1",
        seq=4,
    )
    return StoredAlarm(unique_id, state)


def one_of_each_kind() -> tuple[AnyEvent, ...]:
    """Five kinds with everything filled in that an event can have, and a message with nothing."""
    return (
        message_sent(
            source_id=0,
            source_name="",
            source_guid=OTHER_CLASS,
            arguments=(Argument.of(2**63), Argument.of(b"\xff"), Argument(99, "unknown")),
            json_attribute="not json {",
            vendor_id=0,
            product_code=2**32 - 1,
            revision_no=1,
            session="s1",
            seq=2**63 - 1,
            key_seq=3,
            time_ns=2**63 - 1,
            origin=Origin("live", "s0", 5, 6),
        ),
        alarm_raised(seq=2, operator="anna", client="hmi", comment="why"),
        alarm_cleared(seq=3),
        alarm_confirmed(seq=4, severity=Severity.CRITICAL),
        alarm_disposed(seq=5),
        MessageSent(target="p", event_class=EVENT_CLASS, event_id=0, severity=Severity.VERBOSE),
    )


def events_of(found: Iterable[StoredEvent]) -> list[AnyEvent]:
    """The events alone."""
    return [one.event for one in found]


def ids_of(found: Iterable[StoredEvent]) -> list[int]:
    """Their unique ids."""
    return [one.unique_id for one in found]
