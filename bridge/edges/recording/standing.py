"""Which alarms there are at a place of a recording: keyframes and transitions, folded in the order of the file.

Rule 1: transitions are folded as everywhere (core/alarms.py). A keyframe is taken wherever it stands: after a gap it is what
makes the state right again.
Rule 2: what a keyframe says of an alarm counts unless a later transition of the same session went by before it.
Rule 3: sessions of a target follow each other; a keyframe of a session that another one has replaced is stale.
"""

from collections.abc import Iterable

from bridge.core.alarms import Alarm, AlarmKey, AlarmTable, alarm_key
from bridge.core.events import AlarmEvent
from bridge.edges.recording.layout import StateFrame


class Standing:
    """The alarms of all realms and targets of a recording, so far."""

    def __init__(self) -> None:
        self._tables: dict[str, AlarmTable] = {}
        self._newest: dict[tuple[str, str], dict[AlarmKey, int]] = {}
        self._session: dict[tuple[str, str], str] = {}
        self._past: set[tuple[str, str, str]] = set()

    def event(self, realm: str, event: AlarmEvent) -> None:
        """Fold in a transition."""
        table = self._tables.get(realm)
        if table is None:
            table = self._tables[realm] = AlarmTable()
        if table.apply(event):
            place = (realm, event.target)
            if self._session.get(place) != event.session:
                if (*place, event.session) in self._past:
                    return  # of another alarm than those that the next session has spoken of
                self._follow(place, event.session)
            self._newest[place][alarm_key(event)] = event.seq

    def state(self, state: StateFrame) -> None:
        """Fold in a keyframe."""
        place = (state.realm, state.target)
        if (*place, state.session) in self._past:
            return
        table = self._tables.setdefault(state.realm, AlarmTable())
        if self._session.get(place) != state.session:
            self._follow(place, state.session)
        told = {alarm.key: alarm.seq for alarm in state.alarms}
        newest = self._newest[place]
        later = {key: table.alarms.get(key) for key, seq in newest.items() if seq > max(state.seq, told.get(key, 0))}
        table.load(state.alarms, state.session, state.seq, state.target)
        for key, alarm in later.items():
            if alarm is None:
                table.alarms.pop(key, None)
            else:
                table.put(alarm)

    def _follow(self, place: tuple[str, str], session: str) -> None:
        before = self._session.get(place)
        if before is not None:
            self._past.add((*place, before))
        self._session[place] = session
        self._newest[place] = {}

    def alarms(self) -> Iterable[Alarm]:
        """All that were raised and not disposed."""
        return (alarm for table in self._tables.values() for alarm in table.alarms.values() if alarm.was_raised)

    def active(self) -> list[Alarm]:
        """Those that are raised or wait for confirmation, by the time of their last transition."""
        return sorted((alarm for alarm in self.alarms() if alarm.is_active), key=lambda alarm: (alarm.time_ns, alarm.seq))

    def frames(self) -> list[StateFrame]:
        """A keyframe of each realm and target, as a recording that begins here needs it."""
        frames = []
        for (realm, target), session in self._session.items():
            table = self._tables[realm]
            alarms = tuple(alarm for alarm in table.alarms.values() if alarm.target == target and alarm.was_raised)
            frames.append(StateFrame(realm=realm, target=target, session=session, seq=table.base(session), alarms=alarms))
        return frames
