"""Recordings into a book, without a bus, as fast as it can.

Rule 1: the order is (log_time, place in the file). Events keep their numbers; their origin says that they are replayed.
Rule 2: keyframes are taken where they stand: at the start they are the state, after a gap they make it right again.
Rule 3: from a place in the middle the state is rebuilt first.
Rule 4: it runs on replay time: what arrives, arrives when it was recorded.
"""

import os
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Final, Protocol

import msgspec

from bridge.core.alarms import Alarm
from bridge.core.events import AnyEvent, Event
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.predicate import compile_filter
from bridge.edges.recording import (
    Part,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    StateFrame,
    read_series,
    standing_at,
)
from bridge.replayer.origins import origin_of, replayed_frame

PROGRESS_EVENTS: Final = 1000


class ReplayReport(msgspec.Struct):
    """What a replay did, in all rounds of a loop. truncated: a file ended before its end, so its last events are not known."""

    realm: str = ""
    events: int = 0
    filtered_out: int = 0
    gaps: int = 0
    missing: int = 0
    rejected: int = 0
    keyframes: int = 0
    unsent: int = 0
    first_ns: int = 0
    last_ns: int = 0
    truncated: bool = False


class Sink(Protocol):
    """What a replay without a bus needs: a book that takes events as they were, and keyframes."""

    def replay(self, event: AnyEvent, arrival_ns: int) -> None:
        """Take one recorded event."""

    def load_state(self, state: StateFrame) -> None:
        """Take a keyframe: the alarms of a target after `seq` events of `session`."""


def matcher(filter: Expr | None) -> Callable[[Event | Alarm], bool] | None:
    """The filter as a function of events and alarms; None when it takes everything."""
    return None if filter is None or isinstance(filter, Everything) else compile_filter(filter)


def entries(
    paths: Sequence[str | os.PathLike[str]], part: Part, report: ReplayReport
) -> Generator[RecordedEvent | RecordedState, None, None]:
    """The events and keyframes of a part of recordings; the rest is counted."""
    with read_series(paths, part) as items:
        for item in items:
            match item:
                case RecordedEvent():
                    yield item
                case RecordedState():
                    report.keyframes += 1
                    yield item
                case RecordedGap(gap=gap):
                    report.gaps += 1
                    report.missing += gap.count
                case RecordedRejected():
                    report.rejected += 1
        report.truncated |= bool(items.damages)


def replay_into(
    paths: Sequence[str | os.PathLike[str]],
    sink: Sink,
    filter: Expr | None = None,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    remap: Mapping[str, str] | None = None,
    on_progress: Callable[[ReplayReport], None] | None = None,
) -> ReplayReport:
    """Fold what was recorded from start_ns on and before end_ns into a book. RecordingError for a file that is no recording.

    remap renames targets. Alarms that were there before, or that a keyframe holds, are taken when the filter takes them.
    """
    report = ReplayReport()
    matches = matcher(filter)
    remap = {} if remap is None else remap

    def load(frame: StateFrame) -> None:
        frame = replayed_frame(frame, remap.get(frame.target))
        if matches is not None:
            frame = msgspec.structs.replace(frame, alarms=tuple(filter_alarms(frame.alarms, matches)))
        sink.load_state(frame)

    if start_ns is not None:
        scene = standing_at(paths, start_ns - 1)
        report.truncated = bool(scene.damages)
        for frame in scene.frames():
            load(frame)
    for item in entries(paths, Part(start_ns=start_ns or 0, end_ns=end_ns), report):
        if isinstance(item, RecordedState):
            load(item.state)
            continue
        event = item.event
        if matches is not None and not matches(event):
            report.filtered_out += 1
            continue
        report.events += 1
        report.first_ns = report.first_ns or item.log_time_ns
        report.last_ns = item.log_time_ns
        target = remap.get(event.target, event.target)
        sink.replay(msgspec.structs.replace(event, target=target, origin=origin_of(event, item.realm)), item.log_time_ns)
        if on_progress is not None and report.events % PROGRESS_EVENTS == 0:
            on_progress(report)
    return report


def filter_alarms(alarms: Sequence[Alarm], matches: Callable[[Event | Alarm], bool] | None) -> Sequence[Alarm]:
    """Those that the filter takes as they are."""
    return alarms if matches is None else [alarm for alarm in alarms if matches(alarm)]
