"""Which alarms there are at one place of the stream, so that a keyframe fits what stands before and behind it in a file.

Rule 1: what goes by is folded in the order in which it goes by; nothing that is still to come is in it.
Rule 2: a keyframe has the alarms of a logger that the recording's filter takes by their state. Its seq is that of the state the
logger told last, not that of the last event: between keys the order is not promised, so an event with a smaller seq may follow.
The last event's is last_seq: an alarm that a reader knows from an event up to that, and that is not in the keyframe, is gone.
"""

from collections.abc import Callable

from bridge.core.alarms import Alarm, AlarmTable
from bridge.core.events import MessageSent
from bridge.edges.recording import StateFrame
from bridge.notices import Heard, Item, LoggerGone, Snapshot, SuspectsChanged


class States:
    """The alarms of every target whose logger was heard."""

    def __init__(self) -> None:
        self._table = AlarmTable()
        self._sessions: dict[str, str] = {}
        self._last: dict[str, int] = {}

    def take(self, item: Item) -> None:
        """Fold in what goes by."""
        match item:
            case Heard(event=event):
                if not isinstance(event, MessageSent) and self._table.apply(event):
                    before = self._last.get(event.target, 0) if self._sessions.get(event.target) == event.session else 0
                    self._sessions[event.target], self._last[event.target] = event.session, max(before, event.seq)
            case Snapshot(target, session, seq, alarms):
                self._table.load(alarms, session, seq, target)
                self._sessions[target], self._last[target] = session, seq
            case LoggerGone(target=target, clean=False):
                self._table.suspect(target)
            case SuspectsChanged(target=target, suspects=suspects):
                self._table.mark(set(self._table.suspects(target)) - set(suspects), suspect=False)
                self._table.mark(suspects, suspect=True)
            case _:
                pass

    def frames(self, realm: str, takes: Callable[[Alarm], bool] | None) -> list[StateFrame]:
        """A keyframe for each target, of the alarms that were raised and not disposed and that `takes` takes (None: all)."""
        alarms: dict[str, list[Alarm]] = {target: [] for target in self._sessions}
        for key, alarm in self._table.alarms.items():
            if key.target in alarms and alarm.was_raised and (takes is None or takes(alarm)):
                alarms[key.target].append(alarm)
        return [
            StateFrame(
                realm=realm,
                target=target,
                session=session,
                seq=self._table.base(session),
                alarms=tuple(alarms[target]),
                last_seq=self._last.get(target, 0),
            )
            for target, session in self._sessions.items()
        ]
