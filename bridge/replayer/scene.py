"""Which alarms there were at a moment: the nearest keyframe before it, and the fold of what follows.

Rule 1: keyframes and transitions go through the same table as everywhere (core/alarms.py), with their recorded numbers.
Rule 2: of each target only what comes after its last keyframe is read. A target without one is read from the start.
Rule 3: a scene can be cut: what frames() gives, followed by the rest of the recording, is the fold of all of it.
"""

import os
from collections.abc import Sequence
from typing import TypeAlias

import msgspec

from bridge.core.alarms import Alarm, AlarmKey, AlarmTable
from bridge.core.events import ConfirmationState, Event, MessageSent, Origin
from bridge.edges.recording import Part, RecordedEvent, RecordedState, StateFrame, read_series
from bridge.replayer.span import Span, span_of

_State: TypeAlias = dict[AlarmKey, tuple[bool, ConfirmationState, int, int, int]]


def origin_of(item: Event | Alarm, realm: str) -> Origin:
    """Where something recorded came from; of what was a replay already, where that came from."""
    if item.origin is not None:
        return item.origin
    return Origin(realm=realm, session=item.session, seq=item.seq, key_seq=item.key_seq if isinstance(item, Event) else 0)


def replayed_frame(frame: StateFrame, target: str | None = None) -> StateFrame:
    """The frame with alarms that say where they came from, under another name if one is given."""
    target = frame.target if target is None else target
    alarms = tuple(
        msgspec.structs.replace(alarm, target=target, origin=origin_of(alarm, frame.realm)) for alarm in frame.alarms
    )
    return msgspec.structs.replace(frame, target=target, alarms=alarms)


class Scene:
    """The alarms of every target of a recording, as far as it was folded in."""

    def __init__(self) -> None:
        self.table = AlarmTable()
        self._realms: dict[str, str] = {}
        self._owners: dict[str, str] = {}

    def take(self, item: RecordedEvent | RecordedState) -> bool:
        """Fold in the next entry; whether a keyframe corrected what was known."""
        if isinstance(item, RecordedState):
            state = item.state
            before = self._state(state.target)
            self._realms[state.target] = state.realm
            if self.table.refresh(state.alarms, state.session, state.seq, state.target):
                self._owners[state.target] = state.session
            return self._state(state.target) != before
        event = item.event
        if not isinstance(event, MessageSent) and self.table.apply(event):
            self._realms.setdefault(event.target, item.realm)
            if self._owners.setdefault(event.target, "") != event.session:
                self._owners[event.target] = ""
        return False

    def _state(self, target: str) -> _State:
        return {key: state for key, state in self.table.state().items() if key.target == target}

    @property
    def targets(self) -> frozenset[str]:
        """Those whose alarms are known."""
        return frozenset(self._realms)

    def frame(self, target: str) -> StateFrame | None:
        """The state of a target as a keyframe; None when nothing is known of its alarms.

        Its session is "" when the last keyframe is of a session that others have followed.
        """
        if target not in self._realms:
            return None
        session = self._owners.get(target, "")
        alarms = (alarm for alarm in self.table.alarms.values() if alarm.target == target and alarm.was_raised)
        seq = self.table.base(session) if session else 0
        return StateFrame(realm=self._realms[target], target=target, session=session, seq=seq, alarms=tuple(alarms))

    def frames(self) -> list[StateFrame]:
        """The state of every target."""
        return [frame for target in sorted(self.targets) if (frame := self.frame(target)) is not None]


def scene_before(paths: Sequence[str | os.PathLike[str]], end_ns: int, span: Span | None = None) -> Scene:
    """The alarms after everything that was recorded before end_ns. RecordingError for a file that is no recording."""
    span = span_of(paths) if span is None else span
    nearest: dict[str, int] = {}
    with read_series(paths, Part(end_ns=end_ns, only=frozenset(("states",)))) as frames:
        for item in frames:
            if isinstance(item, RecordedState):
                nearest[item.state.target] = item.log_time_ns
    scene = Scene()
    for targets, start_ns in (
        (span.alarm_targets - nearest.keys(), 0),
        (frozenset(nearest), min(nearest.values(), default=0)),
    ):
        if not targets:
            continue
        part = Part(
            start_ns=start_ns,
            end_ns=end_ns,
            classes=span.alarm_classes,
            targets=targets,
            only=frozenset(("events", "states")),
        )
        with read_series(paths, part) as items:
            for item in items:
                match item:
                    case RecordedEvent(log_time_ns=at_ns, event=event) if at_ns >= nearest.get(event.target, 0):
                        scene.take(item)
                    case RecordedState(log_time_ns=at_ns, state=state) if at_ns >= nearest[state.target]:
                        scene.take(item)
                    case _:
                        pass
    return scene
