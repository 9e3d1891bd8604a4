"""A small recording that has everything in it, and what it must read back as."""

from pathlib import Path

from bridge.core import codec
from bridge.core.alarms import Alarm
from bridge.core.arguments import Argument
from bridge.core.events import AlarmCleared, AlarmRaised, AnyEvent, ConfirmationState, MessageSent, Severity
from bridge.core.keys import event_key, parse_event_key
from bridge.edges.recording import (
    About,
    Compression,
    Gap,
    Recorded,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    RecordingWriter,
    StateFrame,
    read_events,
)

AXIS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
PUMP = "0a0b0c0d-0000-4000-8000-000000000001"
START = 1_800_000_000_000_000_000
ABOUT = About(started_ns=START, version="0.1.0", host="line 4", realm="live", filter="severity >= info", comment="näht")
GAP = Gap(
    session="s1", key=f"tc3/1/live/plc1/event/{AXIS}/message/info", first_key_seq=3, last_key_seq=9, count=7, reason="lost"
)
ALARM = Alarm(
    target="plc1",
    event_class=AXIS,
    event_id=7,
    severity=Severity.ERROR,
    raised=True,
    confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION,
    time_ns=START,
    time_raised_ns=START,
    arguments=(Argument.of(1.5),),
    session="s1",
    seq=4,
)
STATE = StateFrame(realm="live", target="plc1", session="s1", seq=4, alarms=(ALARM,))


def message(number: int, event_class: str = AXIS, target: str = "plc1") -> MessageSent:
    """A message that differs with its number in many fields."""
    return MessageSent(
        target=target,
        event_class=event_class,
        event_id=number,
        severity=Severity(number % 5),
        session="s1",
        seq=number + 1,
        key_seq=number + 1,
        time_ns=START + number * 1000,
        source_name=f"Main.fbAxis[{number}] é",
        arguments=(Argument.of(number), Argument.of("x" * (number % 7))),
        json_attribute=f'{{"axis": {number}}}',
    )


def raised(number: int) -> AlarmRaised:
    """A raised alarm."""
    return AlarmRaised(
        target="plc1",
        event_class=AXIS,
        event_id=number,
        severity=Severity.ERROR,
        session="s1",
        seq=number,
        key_seq=number,
        time_ns=START + number,
        raised=True,
        time_raised_ns=START + number,
    )


def cleared(number: int) -> AlarmCleared:
    """The same alarm, cleared."""
    return AlarmCleared(
        target="plc1",
        event_class=AXIS,
        event_id=number,
        severity=Severity.ERROR,
        session="s1",
        seq=number + 1,
        key_seq=number + 1,
        time_ns=START + number + 5,
        time_raised_ns=START + number,
        time_cleared_ns=START + number + 5,
    )


def record(writer: RecordingWriter, event: AnyEvent, arrival_ns: int, encoding: str = codec.JSON, realm: str = "live") -> int:
    """Record an event as the recorder does: bytes and key as they were on the bus."""
    return writer.add(codec.encode(event, encoding), encoding, parse_event_key(event_key(realm, event)), event, arrival_ns)


def write_story(path: Path, *, events: int = 12, compression: Compression = "zstd", flush_every: int = 3) -> list[Recorded]:
    """Write everything a recording can hold to `path`, in several chunks; what reading it must give."""
    with RecordingWriter(path, about=ABOUT, compression=compression) as writer:
        writer.add_state(STATE, START)
        for number in range(events):
            record(
                writer, message(number, (AXIS, PUMP)[number % 2]), START + number, (codec.JSON, codec.MSGPACK)[number // 2 % 2]
            )
            if number % flush_every == flush_every - 1:
                writer.flush()
        record(writer, raised(90), START + 100)
        writer.add_gap(GAP, START + 101)
        writer.add_rejected("tc3/1/live/plc1/event/x", codec.JSON, b"\xff{", "no JSON", START + 102)
        record(writer, cleared(90), START + 103)
    return everything(path)


def everything(path: Path) -> list[Recorded]:
    """All that can be read, whatever the file's state."""
    with read_events(path) as reader:
        return list(reader)


def events_of(items: list[Recorded]) -> list[AnyEvent]:
    """The events among the items."""
    return [item.event for item in items if isinstance(item, RecordedEvent)]


def kinds(items: list[Recorded]) -> list[str]:
    """What sort of item each is, one letter each."""
    letters = {RecordedEvent: "e", RecordedGap: "g", RecordedRejected: "r", RecordedState: "s"}
    return [letters[type(item)] for item in items]
