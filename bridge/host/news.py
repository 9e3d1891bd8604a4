"""What happens to the modules of a plant, as events of the built-in class TcBridge, and as lines for people.

Rule 1: the source of such an event is the module, with its object id and name.
Rule 2: events are held until the logger is in OP and those who listen had their turn: so a listener and a recorder of the same
plant see it starting. What is held has the time at which it happened. Without a logger in the plant they are sent as they come.
Rule 3: telling never fails whoever did something, and never waits.
Rule 4: of a text with several lines (a filter with a caret under the fault, say) an event has the first.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from bridge.core.events import MessageSent
from bridge.core.hresult import ADS_E_TIMEOUT, name_of
from bridge.core.own_events import (
    CYCLE_FAILED,
    CYCLE_RECOVERED,
    CYCLES_MISSED,
    MODULE_BROKEN,
    MODULE_NOT_STARTED,
    MODULE_SLOW,
    MODULE_STEP,
    MODULE_STEP_FAILED,
    MODULE_UNDO_FAILED,
    own_event,
)
from bridge.tccom.identity import ObjectId, id_text
from bridge.tccom.reports import Report, ReportKind

HELD: Final = 10_000
"""So many events are held; the oldest go."""


def _step(report: Report) -> str:
    return "" if report.transition is None else report.transition.value


def _ms(report: Report) -> int:
    return report.duration_ns // 1_000_000


_ROWS: Final[dict[ReportKind, tuple[int, Callable[[Report], tuple[int | str, ...]]]]] = {
    ReportKind.DONE: (MODULE_STEP, lambda one: (_step(one), one.state.name, _ms(one))),
    ReportKind.FAILED: (MODULE_STEP_FAILED, lambda one: (_step(one), one.state.name, name_of(one.code), one.detail)),
    ReportKind.UNDO_FAILED: (MODULE_UNDO_FAILED, lambda one: (_step(one), name_of(one.code), one.detail)),
    ReportKind.SLOW: (MODULE_SLOW, lambda one: (_step(one), _ms(one))),
    ReportKind.BROKEN: (MODULE_BROKEN, lambda one: (name_of(one.code), one.detail)),
    ReportKind.CYCLE_FAILED: (CYCLE_FAILED, lambda one: (name_of(one.code), one.detail)),
    ReportKind.CYCLE_RECOVERED: (CYCLE_RECOVERED, lambda _: ()),
    ReportKind.LATE: (CYCLES_MISSED, lambda one: (one.detail,)),
}


class News:
    """Makes events of reports and keeps them until somebody can be told."""

    def __init__(self, target: str, send: Callable[[MessageSent], bool], told: Callable[[MessageSent], None]) -> None:
        """send hands an event to the logger, False when there is none now. told hears of each at once."""
        self._target, self._send, self._told = target, send, told
        self._held: deque[MessageSent] = deque(maxlen=HELD)
        self._open = False
        self._lock = threading.RLock()

    def report(self, report: Report) -> None:
        """What an object server reports."""
        event_id, arguments = _ROWS[report.kind]
        self._tell(report.object_id, report.object_name, event_id, arguments(report))

    def not_started(self, object_id: ObjectId, name: str, why: str) -> None:
        """A module was left where it is."""
        self._tell(object_id, name, MODULE_NOT_STARTED, (why,))

    def not_ended(self, object_id: ObjectId, name: str) -> None:
        """A module did not end in time."""
        self._tell(object_id, name, MODULE_BROKEN, (name_of(ADS_E_TIMEOUT), "it does not end and is left behind"))

    def _tell(self, object_id: ObjectId, name: str, event_id: int, arguments: tuple[int | str, ...]) -> None:
        shown = [one.partition("\n")[0] if isinstance(one, str) else one for one in arguments]
        event = msgspec.structs.replace(
            own_event(self._target, "modules", event_id, name or id_text(object_id), *shown),
            source_id=object_id,
            source_name=name[:255],
            time_ns=time.time_ns(),
        )
        with contextlib.suppress(Exception):  # whoever is told is no part of what has happened
            self._told(event)
        with self._lock:
            self._held.append(event)
        self.flush()

    def open(self) -> None:
        """From now on events may go out."""
        self._open = True
        self.flush()

    def flush(self) -> None:
        """Send what is held, as far as somebody takes it."""
        with self._lock:
            while self._open and self._held:
                try:
                    if not self._send(self._held[0]):
                        return
                except Exception:  # noqa: BLE001 # a logger that is being closed, say
                    return
                self._held.popleft()
