"""What is wrong with a recording: every part of the file is read and compared with every other.

Rule 1: a fault is something that should not be so: damage, an index or a summary that tells otherwise than the file, a channel
that is not what its name says, an event that is none or stands there twice, a number that is missing without a gap record.
Rule 2: a remark is something to know: that a file is not finished, gaps and tails that it tells of itself, channels of other
programs, an order in which only another program writes, a part of the recording that is not beside it.
Rule 3: missing numbers are looked for only where nothing but a filter on the key chose what was recorded.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from bridge.core.events import AnyEvent
from bridge.core.filters.cover import cover
from bridge.core.filters.text import parse
from bridge.core.hresult import AdsError
from bridge.edges.recording.frames import Frames
from bridge.edges.recording.index import IndexFault, read_index
from bridge.edges.recording.layout import (
    ABOUT_METADATA,
    ACTIVE_SUFFIX,
    GAPS_TOPIC,
    REJECTED_TOPIC,
    STATE_TOPIC,
    SUMMARY_METADATA,
    VIEWER_TOPICS,
    About,
    Gap,
    event_channel,
    event_schema,
)
from bridge.edges.recording.reader import Interpretation, RecordedEvent, RecordedGap, RecordedRejected
from bridge.edges.recording.series import Once
from bridge.edges.recording.tally import Tally, Totals

PROGRESS_EVENTS: Final = 1000
TOLD_EACH: Final = 20
"""How many findings of one sort are told one by one."""


class Finding(msgspec.Struct, frozen=True):
    """Something about a file; a fault when it should not be so."""

    text: str
    fault: bool = True


class _Findings:
    def __init__(self) -> None:
        self.all: list[Finding] = []
        self._counts: dict[str, int] = {}

    def fault(self, text: str, sort: str = "") -> None:
        """Note a fault; of one sort only the first are noted, and how many there were."""
        if sort:
            self._counts[sort] = self._counts.get(sort, 0) + 1
            if self._counts[sort] > TOLD_EACH:
                return
        self.all.append(Finding(text))

    def remark(self, text: str) -> None:
        """Note something to know."""
        self.all.append(Finding(text, fault=False))

    def finish(self) -> list[Finding]:
        """All of them, with how many were not told."""
        for sort, count in self._counts.items():
            if count > TOLD_EACH:
                self.all.append(Finding(f"and {count - TOLD_EACH:,} more: {sort}"))
        return self.all


def diagnose(path: str | os.PathLike[str], *, on_progress: Callable[[int], None] | None = None) -> list[Finding]:
    """Read a recording and say what is wrong with it; on_progress is told every 1,000 messages how many were read.

    RecordingError when it cannot be opened or is no MCAP file.
    """
    found = _Findings()
    tally = Tally()
    numbers = _Numbers(found)
    counts: dict[int, int] = {}
    chunks: dict[int, _Chunk] = {}
    last_ns, back, rejected_payloads = -1, 0, 0
    with Frames(path) as frames:
        interpret = Interpretation(frames, tally=tally)
        for done, raw in enumerate(frames.messages(), 1):
            counts[raw.channel_id] = counts.get(raw.channel_id, 0) + 1
            if frames.end not in chunks:
                chunks[frames.end] = _Chunk(raw.log_time)
            chunks[frames.end].take(raw.log_time, raw.channel_id)
            item = interpret(raw)
            if raw.log_time < last_ns or (raw.log_time == last_ns and item is not None):
                back += 1
            last_ns = max(last_ns, raw.log_time)
            match item:
                case RecordedEvent(event=event):
                    numbers.event(item.key_text, event)
                case RecordedGap(gap=gap):
                    numbers.gap(gap)
                case RecordedRejected() if frames.channels[raw.channel_id].topic == REJECTED_TOPIC:
                    rejected_payloads += 1
                case RecordedRejected(rejected=rejected):
                    found.fault(f"an entry of {rejected.key or 'a channel'} cannot be read: {rejected.reason}", "entries")
                case _:
                    pass
            if on_progress is not None and done % PROGRESS_EVENTS == 0:
                on_progress(done)
        if frames.damage is not None:
            unfinished = frames.damage.torn and frames.path.suffix == ACTIVE_SUFFIX
            (found.remark if unfinished else found.fault)(frames.damage.text(frames.path))
        if back:
            (found.fault if frames.strict else found.remark)(f"{back:,} entries are not in the order of time")
        _check_channels(frames, found)
        metadata = dict(frames.metadata)
        about = About.of(metadata.get(ABOUT_METADATA, {}))
        if frames.strict and frames.damage is None:
            _check_index(frames.path, counts, chunks, found)
            _check_totals(Totals.of(metadata.get(SUMMARY_METADATA, {})), tally, found)
    if _by_key_alone(about.filter):
        numbers.check()
    else:
        found.remark(f"missing numbers were not looked for: recorded with the filter {about.filter}")
    if tally.gaps:
        found.remark(f"{tally.gap_events:,} events are missing in {tally.gaps:,} gaps, as the file says")
    if rejected_payloads:
        found.remark(f"{rejected_payloads:,} payloads came that were no events")
    _remark_on_ends(Path(path), about, Totals.of(metadata.get(SUMMARY_METADATA, {})), found)
    return found.finish()


class _Chunk:
    """What a chunk was found to hold."""

    def __init__(self, first_ns: int) -> None:
        self.first_ns = self.last_ns = first_ns
        self.channels: set[int] = set()

    def take(self, log_time_ns: int, channel: int) -> None:
        self.last_ns = log_time_ns
        self.channels.add(channel)


class _Numbers:
    """The numbers of each session and key: as ranges, in whatever order they come."""

    def __init__(self, found: _Findings) -> None:
        self._found = found
        self._once = Once()
        self._there: dict[tuple[str, str], list[list[int]]] = {}
        self._told: dict[tuple[str, str], list[tuple[int, int]]] = {}
        self._sessions_told: set[str] = set()

    def event(self, key: str, event: AnyEvent) -> None:
        if not event.key_seq or not event.session:
            return
        if not self._once.is_new(event):
            self._found.fault(f"event {event.seq} of session {event.session} stands there twice", "doubled events")
            return
        ranges = self._there.setdefault((event.session, key), [])
        number = event.key_seq
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])

    def gap(self, gap: Gap) -> None:
        if gap.last_key_seq:
            self._told.setdefault((gap.session, gap.key), []).append((gap.first_key_seq, gap.last_key_seq))
        else:
            self._sessions_told.add(gap.session)

    def check(self) -> None:
        if "" in self._sessions_told:  # something of nobody knows whom is missing, and the file says so
            return
        for (session, key), ranges in self._there.items():
            if session in self._sessions_told:
                continue
            last = 0
            for first, end in sorted([*((one, two) for one, two in ranges), *self._told.get((session, key), [])]):
                if last and first > last + 1:
                    self._found.fault(
                        f"numbers {last + 1}..{first - 1} of session {session} on {key} are missing, and no gap record says so",
                        "missing numbers",
                    )
                last = max(last, end)


def _check_channels(frames: Frames, found: _Findings) -> None:
    own = event_schema()
    for channel in frames.channels.values():
        schema = frames.schemas.get(channel.schema_id)
        if channel.message_encoding == "json" and channel.topic in (GAPS_TOPIC, REJECTED_TOPIC, STATE_TOPIC, *VIEWER_TOPICS):
            continue
        place = event_channel(channel.message_encoding, channel.metadata)
        if place is None:
            found.remark(f"channel {channel.topic} is of another program: {channel.message_encoding}")
            continue
        if place.topic != channel.topic:
            found.fault(f"channel {channel.topic} says that it holds what belongs into {place.topic}")
        if channel.schema_id and schema is None:
            found.fault(f"channel {channel.topic} has a schema that is not in the file")
        elif schema is not None and (schema.encoding != "jsonschema" or schema.name != "tcbridge.Event"):
            found.fault(f"channel {channel.topic} has the unknown schema {schema.name!r} ({schema.encoding})")
        elif schema is not None and schema.data != own:
            found.remark(f"channel {channel.topic} has the event schema of another version")


def _check_index(path: Path, counts: dict[int, int], chunks: dict[int, _Chunk], found: _Findings) -> None:
    try:
        with open(path, "rb") as file:
            index = read_index(file, path.stat().st_size, lambda channel: True)
    except IndexFault as fault:
        found.fault(f"the index cannot be used: {fault.reason}")
        return
    told = {chunk.offset: (chunk.first_ns, chunk.last_ns, chunk.channels) for chunk in index.chunks}
    there = {offset: (chunk.first_ns, chunk.last_ns, frozenset(chunk.channels)) for offset, chunk in chunks.items()}
    for offset in sorted({offset for offset in {**told, **there} if told.get(offset) != there.get(offset)}):
        found.fault(f"the index tells otherwise of the chunk at byte {offset:,} than the file", "chunks")
    if {channel: count for channel, count in index.counts.items() if count} != counts:
        found.fault("the statistics count other messages than there are")


def _check_totals(told: Totals | None, tally: Tally, found: _Findings) -> None:
    if told is None:
        found.fault("the counts of the summary are missing or damaged")
        return
    counted = tally.totals(told.unknown_tails, told.next_file)
    for name in told.__struct_fields__:
        if getattr(told, name) != getattr(counted, name):
            found.fault(f"the summary tells other {name} than the file holds")


def _by_key_alone(text: str) -> bool:
    """Whether a filter picks whole keys, so that their numbers must follow each other."""
    try:
        return cover(parse(text)).exact
    except (ValueError, LookupError, AdsError):  # a filter that this version cannot read
        return False


def _remark_on_ends(path: Path, about: About, told: Totals | None, found: _Findings) -> None:
    if told is not None and told.unknown_tails:
        found.remark("the end of some sessions is not known")
    for name in (about.previous, told.next_file if told is not None else ""):
        if name and not (path.parent / name).exists():
            found.remark(f"{name}, a part of the same recording, is not beside it")
