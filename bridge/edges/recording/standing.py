"""Which alarms there are at a place of a recording: keyframes and transitions, folded in the order of the file.

Rule 1: both go through the same table as everywhere (core/alarms.py). A keyframe is taken wherever it stands: after a gap it is
what makes the state right again.
Rule 2: sessions of a target follow each other; a keyframe of a session that another one has replaced is stale.
Rule 3: it can be cut: what frames() gives, followed by the rest of the recording, is the fold of all of it.
"""

from collections.abc import Iterable
from pathlib import Path

from bridge.core.alarms import Alarm, AlarmTable
from bridge.core.events import AlarmEvent
from bridge.edges.recording.frames import Damage
from bridge.edges.recording.layout import StateFrame


class Standing:
    """The alarms of all realms and targets of a recording, so far."""

    def __init__(self) -> None:
        self._tables: dict[str, AlarmTable] = {}
        self._session: dict[tuple[str, str], str] = {}
        self._last: dict[tuple[str, str], int] = {}
        self.missing = 0
        """How many events are missing since the last keyframes that may have been transitions."""
        self.damages: dict[Path, Damage] = {}
        """What is wrong with files in which transitions may have been that were not read."""

    def event(self, realm: str, event: AlarmEvent) -> None:
        """Fold in a transition."""
        table = self._tables.get(realm)
        if table is None:
            table = self._tables[realm] = AlarmTable()
        if table.apply(event):
            place = (realm, event.target)
            before = self._last.get(place, 0) if self._session.get(place) == event.session else 0
            self._session[place], self._last[place] = event.session, max(before, event.seq)

    def state(self, state: StateFrame) -> bool:
        """Fold in a keyframe; whether it corrected what was known of its target."""
        place = (state.realm, state.target)
        table = self._tables.setdefault(state.realm, AlarmTable())
        before = _of(table, state.target)
        if table.refresh(state.alarms, state.session, state.seq, state.target, state.last_seq):
            last = self._last.get(place, 0) if self._session.get(place) == state.session else 0
            self._session[place], self._last[place] = state.session, max(last, state.last_seq)
        return _of(table, state.target) != before

    def alarms(self) -> Iterable[Alarm]:
        """All that were raised and not disposed."""
        return (alarm for table in self._tables.values() for alarm in table.alarms.values() if alarm.was_raised)

    def active(self) -> list[Alarm]:
        """Those that are raised or wait for confirmation, by the time of their last transition."""
        return sorted((alarm for alarm in self.alarms() if alarm.is_active), key=lambda alarm: (alarm.time_ns, alarm.seq))

    def frames(self, target: str | None = None) -> list[StateFrame]:
        """A keyframe of each realm and target (of one, if it is named), as a recording that begins here needs it."""
        return [
            StateFrame(
                realm=realm,
                target=name,
                session=session,
                seq=self._tables[realm].base(session),
                alarms=tuple(a for a in self._tables[realm].alarms.values() if a.target == name and a.was_raised),
                last_seq=self._last[realm, name],
            )
            for (realm, name), session in self._session.items()
            if target in (None, name)
        ]


def _of(table: AlarmTable, target: str) -> dict[object, object]:
    return {key: state for key, state in table.state().items() if key.target == target}
