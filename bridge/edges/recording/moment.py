"""Which alarms there were at a time of one or several recordings.

Rule 1: the answer is what folding everything from the first file on would give. It is found from the latest file that begins
with a keyframe of every logger that the earlier ones knew alarms of; what stands before that file is not read.
Rule 2: of finished files only the classes that had alarms are read.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from bridge.core.events import MessageSent
from bridge.edges.recording.info import RecordingInfo, summary
from bridge.edges.recording.reader import Part, RecordedEvent, RecordedState, read_events
from bridge.edges.recording.series import read_series
from bridge.edges.recording.standing import Standing

PROGRESS_EVENTS: Final = 1000


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
    if not infos:
        return standing
    first = next((place for place in range(len(infos) - 1, 0, -1) if _begins_anew(infos, place)), 0)
    part = Part(end_ns=time_ns + 1, classes=_alarm_classes(infos[first:]), only=frozenset(("events", "states")))
    events = 0
    with read_series([Path(info.path) for info in infos[first:]], part) as series:
        for item in series:
            match item:
                case RecordedEvent(realm=realm, event=event):
                    if not isinstance(event, MessageSent):
                        standing.event(realm, event)
                    events += 1
                    if on_progress is not None and events % PROGRESS_EVENTS == 0:
                        on_progress(events)
                case RecordedState(state=state):
                    standing.state(state)
                case _:
                    pass
    return standing


def _begins_anew(infos: Sequence[RecordingInfo], place: int) -> bool:
    """Whether the keyframes at the start of a file say all that the files before it know."""
    needed = {(row.realm, row.target) for info in infos[:place] for row in info.totals.counts if row.kind != MessageSent.kind}
    here = infos[place]
    if not needed:
        return all(not info.totals.states for info in infos[:place])
    if any(info.totals.last_log_time_ns >= here.totals.first_log_time_ns for info in infos[:place]):
        return False  # they overlap: what comes out of the others is not behind us
    told: set[tuple[str, str]] = set()
    with read_events(here.path) as reader:
        for item in reader:
            if not isinstance(item, RecordedState):
                break
            told.add((item.state.realm, item.state.target))
    return needed <= told


def _alarm_classes(infos: Sequence[RecordingInfo]) -> frozenset[str] | None:
    if not all(info.from_summary for info in infos):
        return None
    return frozenset(row.event_class for info in infos for row in info.totals.counts if row.kind != MessageSent.kind)
