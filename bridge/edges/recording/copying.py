"""Recordings cut, filtered and merged: a part of one or several, written as a new one.

Rule 1: bytes of events, log times, gaps, rejected payloads and keyframes stay as they are, attachments and metadata come along.
Rule 2: who starts in the middle starts with a keyframe of each logger: the alarms as they were right before.
Rule 3: an event that is in several files is written once. A gap record loses what another of the files has.
Rule 4: the new file is as complete as its part of the old ones: a tail is unknown when it reaches to the end of a file whose
tail is unknown, or that is cut or damaged; also when a damage was met on the way, or stands before the start.
Rule 5: with a filter, keyframes have the alarms that it takes by their state.
"""

import bisect
import contextlib
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Final, assert_never

import msgspec

from bridge.core.alarms import Alarm
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import to_text
from bridge.core.keys import KeyFormatError, parse_event_key
from bridge.edges.recording.carried import Carried, carried
from bridge.edges.recording.frames import Damage
from bridge.edges.recording.info import RecordingInfo, summary
from bridge.edges.recording.layout import (
    ALARMS_PER_MESSAGE,
    RECOVERED_METADATA,
    SCHEMA_ATTACHMENT,
    About,
    Attachment,
    Compression,
    Gap,
    StateFrame,
)
from bridge.edges.recording.moment import standing_at
from bridge.edges.recording.reader import (
    EVERYTHING,
    Part,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
)
from bridge.edges.recording.series import Series, read_series
from bridge.edges.recording.standing import Standing
from bridge.edges.recording.viewer import Viewer
from bridge.edges.recording.writer import RecordingWriter

PROGRESS_EVENTS: Final = 1000


class Copied(msgspec.Struct):
    """What was written. filled counts the events of gap records that another file had; damages are of the sources."""

    path: Path
    events: int = 0
    gaps: int = 0
    missing: int = 0
    filled: int = 0
    rejected: int = 0
    keyframes: int = 0
    damages: dict[Path, Damage] = {}


def copy_part(
    sources: Sequence[str | os.PathLike[str]],
    target: str | os.PathLike[str],
    part: Part = EVERYTHING,
    *,
    compression: Compression = "zstd",
    viewer: Viewer | None = None,
    version: str = "",
    on_progress: Callable[[int], None] | None = None,
) -> Copied:
    """Write a part of the sources as `target`. on_progress is told every 1,000 events how many were read for the state at the
    start, and then how many are written.

    RecordingError when a source is no recording, the target exists, or the disk refuses; ValueError when the target's name does
    not end in .mcap. What was written is taken away again when it does not come to its end.
    """
    infos = [summary(source) for source in sources]
    brought = [carried(source) for source in sources]
    before = standing_at(sources, part.start_ns - 1, on_progress=on_progress) if part.start_ns else Standing()
    fills = _fills(infos, part)
    writer = RecordingWriter(
        target,
        about=_about(brought, infos, part, version),
        attachments=_attachments(brought),
        compression=compression,
        viewer=viewer,
    )
    try:
        report = Copied(writer.path)
        with read_series(sources, part) as series:
            _write(series, writer, part, before.frames(), fills, report, on_progress)
            report.damages, report.filled = before.damages | series.damages, fills.filled
        for each in brought:
            for name, texts in each.metadata:
                if name != RECOVERED_METADATA:
                    writer.add_metadata(name, texts)
        writer.finish(_unknown_tails(infos, part, report.damages, before.damages))
    except BaseException:
        writer.abandon()
        with contextlib.suppress(OSError):
            writer.active_path.unlink()
        raise
    return report


def _write(
    series: Series,
    writer: RecordingWriter,
    part: Part,
    before: Sequence[StateFrame],
    fills: "Fills",
    report: Copied,
    on_progress: Callable[[int], None] | None,
) -> None:
    takes = _of_keyframes(part)
    kept = [msgspec.structs.replace(frame, alarms=takes(frame.alarms)) for frame in before]
    at_ns = part.start_ns - sum(map(_parts, kept))
    for frame in kept:
        if part.targets is None or frame.target in part.targets:
            at_ns = writer.add_state(frame, max(at_ns, 0)) + 1
            report.keyframes += 1
    for item in series:
        match item:
            case RecordedEvent(log_time_ns=at_ns, encoding=encoding, element=element, event=event):
                writer.add(element, encoding, item.key, event, at_ns)
                report.events += 1
                if on_progress is not None and report.events % PROGRESS_EVENTS == 0:
                    on_progress(report.events)
            case RecordedGap(log_time_ns=at_ns, gap=gap):
                for each in fills.left(gap):
                    writer.add_gap(each, at_ns)
                    report.gaps += 1
                    report.missing += each.count
            case RecordedRejected(log_time_ns=at_ns, rejected=rejected):
                writer.copy_rejected(rejected, at_ns)
                report.rejected += 1
            case RecordedState(log_time_ns=at_ns, state=state):
                frame = msgspec.structs.replace(state, alarms=takes(state.alarms))
                writer.add_state(frame, at_ns - (_parts(frame) - 1))  # its last part has the time of the last part
                report.keyframes += 1
            case _:
                assert_never(item)


def _parts(frame: StateFrame) -> int:
    return max(1, -(-len(frame.alarms) // ALARMS_PER_MESSAGE))


def _of_keyframes(part: Part) -> Callable[[tuple[Alarm, ...]], tuple[Alarm, ...]]:
    """The alarms of a keyframe that belong to the part."""
    classes = part.classes
    matches = None if part.filter is None else compile_filter(part.filter)
    if classes is None and matches is None:
        return lambda alarms: alarms
    return lambda alarms: tuple(
        alarm for alarm in alarms if (classes is None or alarm.event_class in classes) and (matches is None or matches(alarm))
    )


def _about(brought: Sequence[Carried], infos: Sequence[RecordingInfo], part: Part, version: str) -> About:
    first = min(zip(brought, infos, strict=True), key=lambda each: each[1].totals.first_log_time_ns)[0].about
    texts = dict.fromkeys(each.about.filter for each in brought)
    known = "" if "" in texts else _joined(" or ", texts)
    return msgspec.structs.replace(
        first,
        version=version or first.version,
        filter=_joined(" and ", [text for text in (known, "" if part.filter is None else to_text(part.filter)) if text]),
        comment="; ".join(dict.fromkeys(each.about.comment for each in brought if each.about.comment)),
        recording="",
        part=0,
        previous="",
        more=first.more | {"made_of": ", ".join(Path(info.path).name for info in infos)},
    )


def _joined(word: str, texts: Collection[str]) -> str:
    return word.join(f"({text})" if len(texts) > 1 else text for text in texts)


def _attachments(brought: Iterable[Carried]) -> list[Attachment]:
    found: dict[tuple[str, bytes], Attachment] = {}
    for each in brought:
        for attachment in each.attachments:
            if attachment.name != SCHEMA_ATTACHMENT:
                found.setdefault((attachment.name, attachment.data), attachment)
    return list(found.values())


def _unknown_tails(
    infos: Sequence[RecordingInfo], part: Part, damages: Collection[Path], before: Collection[Path]
) -> tuple[str, ...]:
    """The tails that are unknown in the new file: of the sources to whose end it reaches, or whose damage was met."""
    tails: dict[str, None] = {}
    for info in infos:
        path = Path(info.path)
        if path in before or (info.damage is None and path in damages):  # the summary did not tell of it
            tails["*"] = None
        elif part.end_ns is None or part.end_ns > info.totals.last_log_time_ns:
            tails.update(dict.fromkeys(("*",) if info.damage is not None else info.totals.unknown_tails))
    return tuple(tails)


class Fills:
    """Which numbers of gap records are in another file. `filled` counts those that were asked for."""

    def __init__(self) -> None:
        self.filled = 0
        self._missing: dict[tuple[str, str], list[tuple[int, int]]] = {}
        self._there: dict[tuple[str, str], list[int]] = {}
        self._told: set[Gap] = set()

    def want(self, gaps: Iterable[Gap]) -> None:
        """Take note of what is missing somewhere; before there()."""
        found: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for gap in gaps:
            if gap.session and gap.first_key_seq:
                found.setdefault((gap.session, gap.key), []).append((gap.first_key_seq, gap.last_key_seq))
        self._missing = {place: _joined_ranges(ranges) for place, ranges in found.items()}

    @property
    def wanted(self) -> list[str]:
        """The keys of which something is missing."""
        return [key for _, key in self._missing]

    def there(self, session: str, key: str, number: int) -> None:
        """Take note of a number that a file has; those that nobody misses are forgotten."""
        missing = self._missing.get((session, key), ())
        place = bisect.bisect_right(missing, number, key=lambda each: each[0]) - 1
        if place >= 0 and number <= missing[place][1]:
            bisect.insort(self._there.setdefault((session, key), []), number)

    def left(self, gap: Gap) -> list[Gap]:
        """What still is missing of a gap, as ranges; what two files miss alike is told once."""
        if (gap.session, gap.key) not in self._missing:
            return [gap]
        ranges = self._ranges(gap)
        self.filled += gap.count - sum(each.count for each in ranges)
        named = {msgspec.structs.replace(each, reason=""): each for each in ranges}
        fresh = [each for name, each in named.items() if name not in self._told]
        self._told.update(named)
        return fresh

    def _ranges(self, gap: Gap) -> list[Gap]:
        numbers = self._there.get((gap.session, gap.key), [])
        first, last = gap.first_key_seq, gap.last_key_seq
        inside = numbers[bisect.bisect_left(numbers, first) : bisect.bisect_right(numbers, last)]
        if not inside:
            return [gap]
        left = []
        for number in (*inside, last + 1):
            if number > first:
                left.append(msgspec.structs.replace(gap, first_key_seq=first, last_key_seq=number - 1, count=number - first))
            first = number + 1
        return left


def _joined_ranges(ranges: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """The same numbers as ranges that do not overlap, in order."""
    joined: list[tuple[int, int]] = []
    for first, last in sorted(ranges):
        if joined and first <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], last))
        else:
            joined.append((first, last))
    return joined


def _fills(infos: Sequence[RecordingInfo], part: Part) -> Fills:
    """What the files have of each other's gaps; one file has nothing of its own."""
    fills = Fills()
    paths = [info.path for info in infos]
    if len(paths) < 2 or not any(info.totals.gaps for info in infos):
        return fills
    with read_series(paths, msgspec.structs.replace(part, only=frozenset(("gaps",)))) as series:
        fills.want(item.gap for item in series if isinstance(item, RecordedGap))
    places = set()
    for key in fills.wanted:
        with contextlib.suppress(KeyFormatError):
            found = parse_event_key(key)
            places.add((found.target, found.event_class))
    if not places:
        return fills
    part = Part(
        start_ns=part.start_ns,
        end_ns=part.end_ns,
        targets=frozenset(target for target, _ in places),
        classes=frozenset(event_class for _, event_class in places),
        only=frozenset(("events",)),
    )
    with read_series(paths, part) as series:
        for item in series:
            if isinstance(item, RecordedEvent):
                fills.there(item.event.session, item.key_text, item.event.key_seq)
    return fills
