"""What happened: messages and alarm transitions as flat records.

Rule 1: every event carries the same fields, so that a filter needs no memory and every back end sees the same thing.
Rule 2: absent is not empty. source_id None, 0; source_name None, ""; source_guid None, ZERO_GUID are six different things.
Rule 3: the text is not in the event. Receivers resolve it from the event class, as TwinCAT does (facts 3.2).
Rule 4: sizes are native: measure() counts what TwinCAT would transmit, whatever the encoding or the language here.

Source: manual 5.1, 5.7 to 5.9 and chapter 4 (limits); record layout from the port-132 capture (facts 3.2): 120 bytes of
header, 12 bytes per source-info entry, 2 bytes per argument type, then packed argument data and the JSON attribute.
"""

from enum import IntEnum
from typing import Annotated, ClassVar, Final, Literal, NamedTuple, TypeAlias

import msgspec

from bridge.core.arguments import Argument, guid, native_size, utf8_size
from bridge.core.times import MAX_TIME_NS

MAX_U32: Final = 2**32 - 1
U32 = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Time = Annotated[int, msgspec.Meta(ge=0, le=MAX_TIME_NS)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]


class Severity(IntEnum):
    """TcEventSeverity (manual 6.3.2)."""

    VERBOSE = 0
    INFO = 1
    WARNING = 2
    ERROR = 3
    CRITICAL = 4


class EventDefinition(NamedTuple):
    """Which event: class, id and usual severity. TcEventEntry (manual 6.3.1); catalog.EventEntry is what a class says of it.

    A tuple, so that it stands for the first three arguments of a send: send_message(*TC_EVENTS.Line.Homed).
    """

    event_class: str
    event_id: int
    severity: Severity


class ConfirmationState(IntEnum):
    """TcEventConfirmationState (manual 6.3.3)."""

    NOT_SUPPORTED = 0
    NOT_REQUIRED = 1
    WAIT_FOR_CONFIRMATION = 2
    CONFIRMED = 3
    RESET = 4


class Source(msgspec.Struct, frozen=True, gc=False):
    """Where it happened: object id, path and GUID, each possibly absent (manual 5.8, 6.1.11)."""

    id: int | None = None
    name: str | None = None
    guid: str | None = None

    def __post_init__(self) -> None:
        if self.id is not None and not 0 <= self.id < 2**32:
            raise ValueError(f"source id {self.id} is outside 0..4294967295")
        if self.guid is not None:
            msgspec.structs.force_setattr(self, "guid", guid(self.guid))

    def extended(self, extension: str, limit: int = 255) -> tuple["Source", bool]:
        """The source with `extension` appended to its name, cut at `limit` characters; False when it was cut (ExtendName)."""
        name = (self.name or "") + extension
        return Source(self.id, name[:limit], self.guid), len(name) <= limit


class Origin(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """Where a replayed event came from: realm, session, seq and key_seq of the recording."""

    realm: str = ""
    session: str = ""
    seq: Count = 0
    key_seq: Count = 0


class Event(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """The fields every event has. Use one of the five kinds; times are Unix ns with 0 for "not set".

    session, seq and key_seq are stamped by the publisher (1, 2, ... of the session; 1, 2, ... of session and key);
    seq 0 means that the sender does not number, so its losses cannot be seen. operator, client and comment say who did it, from
    where and why when a person commanded the transition. client is the program or host the command came from.
    """

    target: str
    event_class: str
    event_id: U32
    severity: Severity
    session: str = ""
    seq: Count = 0
    key_seq: Count = 0
    time_ns: Time = 0
    source_id: U32 | None = None
    source_name: str | None = None
    source_guid: str | None = None
    arguments: tuple[Argument, ...] = ()
    json_attribute: str = ""
    raised: bool = False
    confirmation_state: ConfirmationState = ConfirmationState.NOT_SUPPORTED
    time_raised_ns: Time = 0
    time_cleared_ns: Time = 0
    time_confirmed_ns: Time = 0
    vendor_id: U32 | None = None
    product_code: U32 | None = None
    revision_no: U32 | None = None
    operator: str = ""
    client: str = ""
    comment: str = ""
    origin: Origin | None = None

    kind: ClassVar[str]
    is_alarm: ClassVar[bool] = True

    @property
    def source(self) -> Source:
        """id, name and GUID of the source as one value."""
        return Source(self.source_id, self.source_name, self.source_guid)


class MessageSent(Event, frozen=True, kw_only=True, omit_defaults=True, gc=False, tag_field="kind", tag="message_sent"):
    """A stateless message."""

    kind: ClassVar[str] = "message_sent"
    is_alarm: ClassVar[bool] = False


class AlarmRaised(Event, frozen=True, kw_only=True, omit_defaults=True, gc=False, tag_field="kind", tag="alarm_raised"):
    """An alarm became raised."""

    kind: ClassVar[str] = "alarm_raised"


class AlarmCleared(Event, frozen=True, kw_only=True, omit_defaults=True, gc=False, tag_field="kind", tag="alarm_cleared"):
    """An alarm is no longer raised; with confirmation state RESET it was cleared with reset of the confirmation."""

    kind: ClassVar[str] = "alarm_cleared"


class AlarmConfirmed(Event, frozen=True, kw_only=True, omit_defaults=True, gc=False, tag_field="kind", tag="alarm_confirmed"):
    """Somebody confirmed the alarm, raised or not."""

    kind: ClassVar[str] = "alarm_confirmed"


class AlarmDisposed(Event, frozen=True, kw_only=True, omit_defaults=True, gc=False, tag_field="kind", tag="alarm_disposed"):
    """The alarm instance is gone. If it was raised, its clear time is set here (manual 5, run to config)."""

    kind: ClassVar[str] = "alarm_disposed"


AlarmEvent: TypeAlias = AlarmRaised | AlarmCleared | AlarmConfirmed | AlarmDisposed
AnyEvent: TypeAlias = MessageSent | AlarmRaised | AlarmCleared | AlarmConfirmed | AlarmDisposed
KindName: TypeAlias = Literal["message_sent", "alarm_raised", "alarm_cleared", "alarm_confirmed", "alarm_disposed"]
KINDS: Final = (MessageSent, AlarmRaised, AlarmCleared, AlarmConfirmed, AlarmDisposed)
KIND_NAMES: Final = tuple(kind.kind for kind in KINDS)


def is_active(event: Event) -> bool:
    """Raised, or cleared but still waiting for confirmation (library comment on IsActive)."""
    return event.raised or event.confirmation_state is ConfirmationState.WAIT_FOR_CONFIRMATION


class Limits(msgspec.Struct, frozen=True):
    """The manual's limits (chapter 4, 5.7; cSourceNameSize 81..10000 counts the terminator, so 255 characters by default)."""

    event_bytes: int = 8192
    arguments: int = 128
    argument_bytes: int = 1024
    source_name_chars: int = 255

    def __post_init__(self) -> None:
        if not 80 <= self.source_name_chars <= 9999:
            raise ValueError(f"source_name_chars {self.source_name_chars} is outside 80..9999 (manual 6.4.3)")


DEFAULT_LIMITS: Final = Limits()
HEADER_BYTES: Final = 0x78
_SOURCE_ENTRY_BYTES: Final = 12
_ARGUMENT_TYPE_BYTES: Final = 2


class LimitError(ValueError):
    """An event over a limit: which limit, which field, measured and allowed."""

    def __init__(self, limit: str, field: str, measured: int, allowed: int) -> None:
        self.limit, self.field, self.measured, self.allowed = limit, field, measured, allowed
        super().__init__(f"{field}: {measured} is over the limit {limit} = {allowed}")


def check_values(event: Event) -> None:
    """Return when every number is in range; else ValueError with the field, the value and the range."""
    for name, top in (
        ("event_id", MAX_U32),
        ("time_ns", MAX_TIME_NS),
        ("vendor_id", MAX_U32),
        ("product_code", MAX_U32),
        ("revision_no", MAX_U32),
    ):
        value = getattr(event, name)
        if value is not None and not 0 <= value <= top:
            raise ValueError(f"{name}: {value} is outside 0..{top}")


def argument_bytes(arguments: tuple[Argument, ...]) -> int:
    """Bytes of the packed argument data."""
    return sum(map(native_size, arguments))


def measure(event: Event) -> int:
    """Bytes TwinCAT would transmit for the event: header, source info, argument types and data, JSON attribute."""
    size = HEADER_BYTES
    if event.source_id is not None:
        size += _SOURCE_ENTRY_BYTES + 4
    if event.source_guid is not None:
        size += _SOURCE_ENTRY_BYTES + 16
    if event.source_name is not None:
        size += _SOURCE_ENTRY_BYTES + utf8_size(event.source_name) + 1
    if event.arguments:
        size += _ARGUMENT_TYPE_BYTES * len(event.arguments) + argument_bytes(event.arguments)
    if event.json_attribute:
        size += utf8_size(event.json_attribute) + 1
    return size


def check_limits(event: Event, limits: Limits = DEFAULT_LIMITS) -> None:
    """Return when the event fits; else LimitError with the limit, the measured size and the field."""
    name, arguments = event.source_name, event.arguments
    bound = 512 + 4 * len(event.json_attribute)
    if name is not None:
        if len(name) > limits.source_name_chars:
            raise LimitError("source_name_chars", "source_name", len(name), limits.source_name_chars)
        bound += 4 * len(name)
    if arguments:
        # Most events are far below: an argument is at most 24 bytes and four per character.
        count, chars = len(arguments), 0
        for argument in arguments:
            chars += len(argument.value)
        packed = 24 * count + 4 * chars
        if count > limits.arguments:
            raise LimitError("arguments", "arguments", count, limits.arguments)
        if packed > limits.argument_bytes and (packed := argument_bytes(arguments)) > limits.argument_bytes:
            raise LimitError("argument_bytes", "arguments", packed, limits.argument_bytes)
        bound += packed + _ARGUMENT_TYPE_BYTES * count
    if bound <= limits.event_bytes:
        return
    size = measure(event)
    if size > limits.event_bytes:
        sizes = {"json_attribute": utf8_size(event.json_attribute), "source_name": utf8_size(name or "")}
        sizes["arguments"] = argument_bytes(arguments)
        raise LimitError("event_bytes", max(sizes, key=sizes.__getitem__), size, limits.event_bytes)
