"""What was recorded: events, gaps, rejected payloads and keyframes in the order (log_time, place in the file).

Rule 1: an unfinished, cut or damaged file gives an exact prefix, and `truncated` says so once it has been read to its end.
Rule 2: nothing that was recorded is passed over in silence: an element that is no event comes out as RecordedRejected.
Only channels that are not ours to read (other programs, what viewers are given beside the events) are skipped.
Rule 3: memory is bounded. Our own files are in log order (checked while reading); a file another tool wrote is sorted as
far as its chunks overlap, and refused when that takes more than SORT_BYTES.
Rule 4: who asks for a part (times, classes, targets, a filter) of a finished file gets it from the chunks that can hold it,
found by the file's index. A file without an index to trust is read from end to end, and `read_through` says why.
"""

import heapq
import os
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self, TypeAlias, assert_never

import msgspec
from mcap.records import Channel

from bridge.core import codec
from bridge.core.events import DEFAULT_LIMITS, AnyEvent, Limits
from bridge.core.filters.ast import Expr
from bridge.core.filters.cover import places
from bridge.core.filters.predicate import compile_filter
from bridge.core.keys import EventKey, KeyFormatError, event_key, parse_event_key
from bridge.edges.recording.frames import Damage, Frames, RawMessage
from bridge.edges.recording.layout import (
    ABOUT_METADATA,
    GAPS_TOPIC,
    REJECTED_TOPIC,
    STATE_TOPIC,
    VIEWER_TOPICS,
    About,
    EventChannel,
    Gap,
    RecordingError,
    RejectedPayload,
    StateFrame,
    StatePart,
    event_channel,
)
from bridge.edges.recording.tally import Tally

SORT_BYTES: Final = 128 << 20
_MESSAGE_COST: Final = 250
_KEYFRAME_NS: Final = 10_000
"""More than the parts of a keyframe have: each has the nanosecond behind the one before."""
_LATEST: Final = 2**64
_HOSTILE: Final = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


class RecordedEvent(msgspec.Struct, frozen=True, gc=False):
    """One event: the bytes that were on the wire, and what they say."""

    log_time_ns: int
    publish_time_ns: int
    realm: str
    encoding: str
    element: bytes
    event: AnyEvent

    @property
    def key(self) -> EventKey:
        """The parts of the key it came on."""
        event = self.event
        return EventKey(self.realm, event.target, event.event_class, event.is_alarm, event.severity)

    @property
    def key_text(self) -> str:
        """The key it came on."""
        return event_key(self.realm, self.event)


class RecordedGap(msgspec.Struct, frozen=True):
    """Here something is missing."""

    log_time_ns: int
    gap: Gap


class RecordedRejected(msgspec.Struct, frozen=True):
    """Here came something that could not be decoded, or can no longer be."""

    log_time_ns: int
    rejected: RejectedPayload


class RecordedState(msgspec.Struct, frozen=True):
    """A keyframe: all alarms of a logger."""

    log_time_ns: int
    state: StateFrame


Recorded: TypeAlias = RecordedEvent | RecordedGap | RecordedRejected | RecordedState
Interpreter: TypeAlias = Callable[[RawMessage], Recorded | None]


def _rejection(key: str, encoding: str, raw: RawMessage, reason: str) -> RecordedRejected:
    body = RejectedPayload(key=key, encoding=encoding, payload=raw.data, size=len(raw.data), reason=reason)
    return RecordedRejected(raw.log_time, body)


def _events(channel: EventChannel, limits: Limits, tally: Tally | None) -> Interpreter:
    realm, target, event_class, encoding = channel.realm, channel.target, channel.event_class, channel.encoding
    key = channel.metadata()["key"]
    decode = codec.decode_one
    counts = tally.channel(channel) if tally is not None else None

    def interpret(raw: RawMessage) -> Recorded:
        try:
            event = decode(raw.data, encoding, limits)
        except codec.CodecError as error:
            return _rejection(key, encoding, raw, error.reason)
        if event.target != target or event.event_class != event_class:
            return _rejection(key, encoding, raw, "target or event_class disagrees with the channel")
        if counts is not None:
            counts.add(event)
        return RecordedEvent(raw.log_time, raw.publish_time, realm, encoding, raw.data, event)

    return interpret


def _gaps(raw: RawMessage) -> Recorded:
    return RecordedGap(raw.log_time, msgspec.json.decode(raw.data, type=Gap))


def _rejected(raw: RawMessage) -> Recorded:
    return RecordedRejected(raw.log_time, msgspec.json.decode(raw.data, type=RejectedPayload))


def _states() -> Interpreter:
    """Joins the parts of a keyframe; one whose parts do not follow each other is dropped."""
    parts: list[StatePart] = []

    def interpret(raw: RawMessage) -> Recorded | None:
        part = msgspec.json.decode(raw.data, type=StatePart)
        if part.part == 1:
            parts.clear()
        elif not parts or (part.part, part.parts) != (parts[-1].part + 1, parts[-1].parts):
            parts.clear()
            return None
        parts.append(part)
        if part.part < part.parts:
            return None
        alarms = tuple(alarm for piece in parts for alarm in piece.alarms)
        parts.clear()
        state = StateFrame(
            realm=part.realm,
            target=part.target,
            session=part.session,
            seq=part.seq,
            alarms=alarms,
            last_seq=part.last_seq,
        )
        return RecordedState(raw.log_time, state)

    return interpret


class Interpretation:
    """What the messages of a file mean, channel by channel; with a tally it counts what it finds."""

    def __init__(self, frames: Frames, limits: Limits = DEFAULT_LIMITS, tally: Tally | None = None) -> None:
        self._frames, self._limits, self._tally = frames, limits, tally
        self._known: dict[int, tuple[Channel, Interpreter | None]] = {}
        self._topics: dict[str, Interpreter] = {GAPS_TOPIC: _gaps, REJECTED_TOPIC: _rejected, STATE_TOPIC: _states()}

    def __call__(self, raw: RawMessage) -> Recorded | None:
        """What the message means; None for another program's, and for all but the last part of a keyframe."""
        channel = self._frames.channels[raw.channel_id]
        known = self._known.get(raw.channel_id)
        if known is None or known[0] is not channel:
            known = self._known[raw.channel_id] = (channel, self._interpreter(channel))
        interpret = known[1]
        if interpret is None:
            return None
        try:
            item = interpret(raw)
        except _HOSTILE as error:
            item = _rejection(channel.topic, channel.message_encoding, raw, str(error))
        if self._tally is not None:
            self._tally.time(raw.log_time)
            if item is not None:
                _count(self._tally, item)
        return item

    def _interpreter(self, channel: Channel) -> Interpreter | None:
        if channel.message_encoding == "json" and channel.topic in self._topics:
            return self._topics[channel.topic]
        place = event_channel(channel.message_encoding, channel.metadata)
        return None if place is None else _events(place, self._limits, self._tally)


def _count(tally: Tally, item: Recorded) -> None:
    match item:
        case RecordedEvent():
            tally.event_time(item.event.time_ns)
        case RecordedGap():
            tally.gap(item.gap)
        case RecordedRejected():
            tally.rejected += 1
        case RecordedState():
            tally.state(item.state)
        case _:
            assert_never(item)


Sort: TypeAlias = Literal["events", "gaps", "rejected", "states"]
SORTS: Final[frozenset[Sort]] = frozenset(("events", "gaps", "rejected", "states"))
_SORT_TOPICS: Final[dict[str, Sort]] = {GAPS_TOPIC: "gaps", REJECTED_TOPIC: "rejected", STATE_TOPIC: "states"}


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """Which part of a recording. None is every one; times are log times (when it arrived), start_ns <= t < end_ns.

    A gap, a rejected payload or a keyframe is left out only when its key or target says that it is of something else.
    A keyframe in several messages is of the time of the last.
    `filter` is asked about events; it may name a class only by its GUID, unless it was resolved.
    """

    start_ns: int = 0
    end_ns: int | None = None
    classes: frozenset[str] | None = None
    targets: frozenset[str] | None = None
    filter: Expr | None = None
    only: frozenset[Sort] = SORTS

    @property
    def is_all(self) -> bool:
        """Whether nothing is left out."""
        return self == EVERYTHING

    def places(self) -> Callable[[str, str], bool]:
        """Whether events of a target and a class may be of this part."""
        takes = places(self.filter) if self.filter is not None else None
        classes, targets = self.classes, self.targets
        return lambda target, event_class: (
            (targets is None or target in targets)
            and (classes is None or event_class in classes)
            and (takes is None or takes(target, event_class))
        )


EVERYTHING: Final = Part()


class RecordingReader:
    """An iterator over a recording, and a context manager. It closes the file at the end of the iteration.

    RecordingError when the file cannot be opened or is no MCAP file. limits are those the recorder was told. `read_through`
    says why the file is read from end to end, "" when only the chunks are read that can match.
    """

    def __init__(self, path: str | os.PathLike[str], part: Part = EVERYTHING, *, limits: Limits = DEFAULT_LIMITS) -> None:
        self._part = part
        self._places = part.places()
        self._matches = None if part.filter is None else compile_filter(part.filter)
        self._frames = Frames(path)
        self._interpret = Interpretation(self._frames, limits)
        first_ns = max(0, part.start_ns - _KEYFRAME_NS)  # a keyframe is of the time of its last part
        self._frames.only(self._may_hold, first_ns, _LATEST if part.end_ns is None else part.end_ns)
        self.read_through = "everything was asked for" if part.is_all else self._frames.use_index()
        self._items = self._read()

    def __iter__(self) -> Iterator[Recorded]:
        return self

    def __next__(self) -> Recorded:
        return next(self._items)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; the iteration ends."""
        self._items.close()
        self._frames.close()

    @property
    def path(self) -> Path:
        """The file."""
        return self._frames.path

    @property
    def truncated(self) -> bool:
        """Whether the file ended before its end; known when the iteration is over."""
        return self._frames.damage is not None

    @property
    def damage(self) -> Damage | None:
        """Where and why the file ended before its end. What a part does not need is not looked at."""
        return self._frames.damage

    @property
    def about(self) -> About:
        """Who recorded what; known from the first item on."""
        return About.of(dict(self._frames.metadata).get(ABOUT_METADATA, {}))

    @property
    def frames(self) -> Frames:
        """The records underneath: channels, metadata and attachments passed so far."""
        return self._frames

    def _may_hold(self, channel: Channel) -> bool:
        sort = _SORT_TOPICS.get(channel.topic)
        if sort is not None:
            return sort in self._part.only
        place = event_channel(channel.message_encoding, channel.metadata)
        return place is not None and "events" in self._part.only and self._places(place.target, place.event_class)

    def _read(self) -> Generator[Recorded, None, None]:
        interpret, whole, start_ns = self._interpret, self._part.is_all, self._part.start_ns
        try:
            for raw in in_log_order(self._frames):
                item = interpret(raw)
                if item is not None and (whole or (raw.log_time >= start_ns and self._is_of_part(item))):
                    yield item
        finally:
            self._frames.close()

    def _is_of_part(self, item: Recorded) -> bool:
        match item:
            case RecordedEvent(event=event):
                return self._matches is None or self._matches(event)
            case RecordedGap(gap=gap):
                return self._key_may_match(gap.key)
            case RecordedRejected(rejected=rejected):
                return self._key_may_match(rejected.key)
            case RecordedState(state=state):
                return self._part.targets is None or state.target in self._part.targets
            case _:
                assert_never(item)

    def _key_may_match(self, text: str) -> bool:
        try:
            key = parse_event_key(text)
        except KeyFormatError:
            return True
        return self._places(key.target, key.event_class)


def read_events(path: str | os.PathLike[str], part: Part = EVERYTHING, *, limits: Limits = DEFAULT_LIMITS) -> RecordingReader:
    """Read a recording, or a part of it: iterate it, then ask `truncated`. Use it in a `with` unless you iterate to the end.

    Of a finished file only the chunks that can hold something of the part are read.
    """
    return RecordingReader(path, part, limits=limits)


def in_log_order(frames: Frames) -> Iterator[RawMessage]:
    """The messages by (log_time, place in the file).

    RecordingError for a foreign file whose chunks overlap by more than SORT_BYTES, or that lies about their times.
    """
    if frames.strict:
        return _checked(frames)
    return _sorted(frames)


def _checked(frames: Frames) -> Iterator[RawMessage]:
    last = -1
    for raw in frames.messages():
        if raw.log_time <= last and not (raw.log_time == last and frames.channels[raw.channel_id].topic in VIEWER_TOPICS):
            raise RecordingError(
                frames.path, f"log time goes from {last} back to {raw.log_time} in a file that says it is ours"
            )
        last = raw.log_time
        yield raw


def _sorted(frames: Frames) -> Iterator[RawMessage]:
    starts = frames.chunk_starts()
    for place in range(len(starts) - 2, -1, -1):
        starts[place] = min(starts[place], starts[place + 1])  # now: the earliest from this record on
    waiting: list[tuple[int, int, RawMessage]] = []
    held, record, last = 0, -1, -1

    def released(until: int) -> Iterator[RawMessage]:
        nonlocal held, last
        while waiting and waiting[0][0] <= until:
            raw = heapq.heappop(waiting)[2]
            held -= len(raw.data) + _MESSAGE_COST
            if raw.log_time < last:
                raise RecordingError(
                    frames.path, "a chunk holds messages earlier than it says; sort the file with an mcap tool"
                )
            last = raw.log_time
            yield raw

    for number, raw in enumerate(frames.messages()):
        if frames.record != record:
            record = frames.record
            yield from released(starts[record] if record < len(starts) else -1)
        held += len(raw.data) + _MESSAGE_COST
        if held > SORT_BYTES:
            raise RecordingError(frames.path, f"is not in log order and needs more than {SORT_BYTES >> 20} MiB to sort")
        heapq.heappush(waiting, (raw.log_time, number, raw))
    yield from released(_LATEST)
