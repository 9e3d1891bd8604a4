"""Which alarms there were at a time of one or several recordings.

Rule 1: the answer is what folding everything from the first file on would give. It is found from the latest file that begins
with a keyframe of every logger that the earlier ones knew alarms of; what stands before that file is not read. In it and in
those that follow, of each logger only what comes after its last keyframe is folded.
Rule 2: of finished files only the classes that had alarms are read.
Rule 3: events that are missing since the last keyframe and may have been transitions are counted (Standing.missing); a file
that is damaged before the time is named (Standing.damages).
"""

import os
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from bridge.core.events import MessageSent
from bridge.core.keys import KeyFormatError, parse_event_key
from bridge.edges.recording.frames import Damage
from bridge.edges.recording.info import RecordingInfo, summary
from bridge.edges.recording.layout import Gap
from bridge.edges.recording.reader import Part, RecordedEvent, RecordedGap, RecordedState, read_events
from bridge.edges.recording.series import read_series
from bridge.edges.recording.standing import Standing

PROGRESS_EVENTS: Final = 1000
_Place: TypeAlias = tuple[str, str]


def standing_at(
    paths: Sequence[str | os.PathLike[str]],
    time_ns: int,
    *,
    on_progress: Callable[[int], None] | None = None,
) -> Standing:
    """The alarms after everything that was logged up to and including `time_ns`. RecordingError for what is no recording.

    on_progress is told every 1,000 events how many were read.
    """
    standing = Standing()
    infos = sorted((summary(path) for path in paths), key=lambda info: info.totals.first_log_time_ns)
    infos = [info for info in infos if info.totals.first_log_time_ns <= time_ns]
    infos = infos[next((place for place in range(len(infos) - 1, 0, -1) if _begins_anew(infos, place, time_ns)), 0) :]
    files = [info.path for info in infos]
    if not files:
        return standing
    places = {(row.realm, row.target) for info in infos for row in info.totals.counts if row.kind != MessageSent.kind}
    nearest: dict[_Place, int] = {}
    damages: dict[Path, Damage] = {}
    if any(info.totals.states for info in infos):
        with read_series(files, Part(end_ns=time_ns + 1, only=frozenset(("states",)))) as frames:
            for item in frames:
                if isinstance(item, RecordedState):
                    nearest[item.state.realm, item.state.target] = item.log_time_ns
            damages = dict(frames.damages)
    start_ns = 0 if places - nearest.keys() else min(nearest.values(), default=time_ns + 1)
    part = Part(
        start_ns=start_ns, end_ns=time_ns + 1, classes=_alarm_classes(infos), only=frozenset(("events", "states", "gaps"))
    )
    events = 0
    with read_series(files, part) as series:
        for item in series:
            match item:
                case RecordedEvent(log_time_ns=at_ns, realm=realm, event=event):
                    if not isinstance(event, MessageSent) and at_ns >= nearest.get((realm, event.target), 0):
                        standing.event(realm, event)
                    events += 1
                    if on_progress is not None and events % PROGRESS_EVENTS == 0:
                        on_progress(events)
                case RecordedState(log_time_ns=at_ns, state=state):
                    if at_ns >= nearest[state.realm, state.target]:
                        standing.state(state)
                case RecordedGap(log_time_ns=at_ns, gap=gap):
                    if any(at_ns >= nearest.get(place, 0) for place in _may_concern(gap, places | nearest.keys())):
                        standing.missing += gap.count
                case _:
                    pass
        damages |= series.damages
    for info in infos:
        path = Path(info.path)
        if path in damages and (info.damage is None or info.totals.last_log_time_ns < time_ns):
            standing.damages[path] = damages[path]
    return standing


def keyframe_places(path: str | os.PathLike[str]) -> set[tuple[str, str]]:
    """The realms and targets that a recording has keyframes of."""
    with read_events(path, Part(only=frozenset(("states",)))) as reader:
        return {(item.state.realm, item.state.target) for item in reader if isinstance(item, RecordedState)}


def _begins_anew(infos: Sequence[RecordingInfo], place: int, time_ns: int) -> bool:
    """Whether the keyframes at the start of a file, up to the time, say all that the files before it know."""
    needed = {(row.realm, row.target) for info in infos[:place] for row in info.totals.counts if row.kind != MessageSent.kind}
    here = infos[place]
    if any(info.totals.last_log_time_ns >= here.totals.first_log_time_ns for info in infos[:place]):
        return False  # they overlap: what comes out of the others is not behind us
    told: set[tuple[str, str]] = set()
    with read_events(here.path) as reader:
        for item in reader:
            if not isinstance(item, RecordedState) or item.log_time_ns > time_ns:
                break
            told.add((item.state.realm, item.state.target))
    if not needed <= told:
        return False
    others = (info for info in infos[:place] if info.totals.states and not _goes_on(info, here))
    return all(keyframe_places(info.path) <= told for info in others)


def _goes_on(info: RecordingInfo, here: RecordingInfo) -> bool:
    """Whether a file is a later part of the same recording: its keyframes are of all that were heard before."""
    return bool(here.about.recording) and info.about.recording == here.about.recording and info.about.part < here.about.part


def _may_concern(gap: Gap, places: Collection[_Place]) -> Collection[_Place]:
    """Whose transitions may be missing: of a gap that is nobody's, everybody's."""
    try:
        key = parse_event_key(gap.key)
    except KeyFormatError:
        return places
    return [(key.realm, key.target)] if key.is_alarm else []


def _alarm_classes(infos: Sequence[RecordingInfo]) -> frozenset[str] | None:
    if not all(info.from_summary for info in infos):
        return None
    return frozenset(row.event_class for info in infos for row in info.totals.counts if row.kind != MessageSent.kind)
