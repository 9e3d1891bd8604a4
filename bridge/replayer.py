"""File to bus or to a book: recorded events in their order, at a chosen speed.

Rule 1: the order is (log_time, place in the file); the pace is that of the log times, divided by the rate.
Rule 2: onto the bus every event gets a new session, seq and key_seq; the old ones are in its `origin`. It goes to a realm of
its own unless told otherwise, so that nobody takes yesterday for today.
Rule 3: into a book events keep their numbers, and a keyframe is loaded where no event of that session came before it.
Rule 4: the clock is handed in.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, Protocol

import msgspec

from bridge.core import codec
from bridge.core.events import AnyEvent, Origin
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.predicate import compile_filter
from bridge.edges.bus import Bus
from bridge.edges.recording import (
    Recorded,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    StateFrame,
    read_events,
)
from bridge.publisher import Publisher

PROGRESS_EVENTS: Final = 1000


class ReplayReport(msgspec.Struct):
    """What a replay did. truncated: a file ended before its end, so its last events are not known."""

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


def new_realm() -> str:
    """A realm for one replay: replay-<8 hex>."""
    return f"replay-{os.urandom(4).hex()}"


def _items(paths: Sequence[str | Path], report: ReplayReport) -> Iterator[Recorded]:
    for path in paths:
        with read_events(path) as reader:
            yield from reader
            report.truncated |= reader.truncated


def _chosen(paths: Sequence[str | Path], filter: Expr | None, report: ReplayReport) -> Iterator[RecordedEvent | RecordedState]:
    matches = None if filter is None or isinstance(filter, Everything) else compile_filter(filter)
    for item in _items(paths, report):
        match item:
            case RecordedEvent():
                if matches is not None and not matches(item.event):
                    report.filtered_out += 1
                    continue
                report.events += 1
                report.first_ns = report.first_ns or item.log_time_ns
                report.last_ns = item.log_time_ns
                yield item
            case RecordedState():
                report.keyframes += 1
                yield item
            case RecordedGap(gap=gap):
                report.gaps += 1
                report.missing += gap.count
            case RecordedRejected():
                report.rejected += 1


def replay_into(
    paths: Sequence[str | Path],
    sink: Sink,
    filter: Expr | None = None,
    *,
    on_progress: Callable[[ReplayReport], None] | None = None,
) -> ReplayReport:
    """Fold recordings into a book, without a bus, as fast as it can. RecordingError for a file that is no recording."""
    report = ReplayReport()
    seen: set[tuple[str, str]] = set()
    for item in _chosen(paths, filter, report):
        match item:
            case RecordedEvent(event=event):
                if event.is_alarm:
                    seen.add((event.target, event.session))
                sink.replay(event, item.log_time_ns)
            case RecordedState(state=state):
                if (state.target, state.session) not in seen:
                    seen.add((state.target, state.session))
                    sink.load_state(state)
        if on_progress is not None and report.events % PROGRESS_EVENTS == 0:
            on_progress(report)
    return report


def replay_to_bus(
    paths: Sequence[str | Path],
    bus: Bus,
    filter: Expr | None = None,
    *,
    realm: str | None = None,
    rate: float = 1.0,
    encoding: codec.Encoding = codec.JSON,
    wait_for_listener_s: float = 0.0,
    on_progress: Callable[[ReplayReport], None] | None = None,
    clock_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ReplayReport:
    """Send recordings again, into a realm of their own (a new one unless named), at `rate` times their speed.

    rate 0 is as fast as it can, waiting rather than dropping. ValueError for a negative rate, RecordingError for a file that is
    no recording. Keyframes are not sent: who joins later asks the book that a replay was folded into.
    """
    if not rate >= 0:
        raise ValueError(f"rate {rate} is negative")
    report = ReplayReport(realm=realm or new_realm())
    publishers: dict[str, Publisher] = {}
    started_s = clock_s()
    try:
        for item in _chosen(paths, filter, report):
            if isinstance(item, RecordedState):
                continue
            event = item.event
            publisher = publishers.get(event.target)
            if publisher is None:
                publisher = publishers[event.target] = Publisher(
                    bus, event.target, realm=report.realm, role="replay", encoding=encoding, on_full="wait"
                )
                if wait_for_listener_s:
                    publisher.wait_for_listener(wait_for_listener_s)
            if rate:
                due_s = started_s + (item.log_time_ns - report.first_ns) / 1e9 / rate
                while (left := due_s - clock_s()) > 0:
                    sleep(min(left, 0.5))
            origin = Origin(realm=item.realm, session=event.session, seq=event.seq, key_seq=event.key_seq)
            publisher.send(msgspec.structs.replace(event, origin=event.origin or origin))
            if on_progress is not None and report.events % PROGRESS_EVENTS == 0:
                on_progress(report)
        for publisher in publishers.values():
            publisher.flush(30.0)
    finally:
        for publisher in publishers.values():
            report.unsent += publisher.close()
    return report
