"""What an object server tells about its objects: one flat record per transition and failure.

Who wants to know hands a function to the object server. It is called while the object has its turn, in whichever thread
moved it: it takes note and returns.
"""

from collections.abc import Callable
from enum import StrEnum
from typing import TypeAlias

import msgspec

from bridge.core.hresult import S_OK
from bridge.tccom.identity import ObjectId
from bridge.tccom.states import State, Transition


class ReportKind(StrEnum):
    """done: a transition is complete. failed: it is not, and the object stays where it was. undo_failed: what was acquired
    could not be given back in good order. slow: a real-time transition took too long. cycle_failed: a cyclic call raised, and
    the ones before had not; cycle_recovered: it works again. late: a task skipped cycles. broken: a module says that it does
    not work any more.
    """

    DONE = "done"
    FAILED = "failed"
    UNDO_FAILED = "undo_failed"
    SLOW = "slow"
    CYCLE_FAILED = "cycle_failed"
    CYCLE_RECOVERED = "cycle_recovered"
    LATE = "late"
    BROKEN = "broken"


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """What happened to an object. state: the one it is in now; code and detail: why it failed."""

    kind: ReportKind
    object_id: ObjectId
    object_name: str
    class_name: str
    state: State
    transition: Transition | None = None
    duration_ns: int = 0
    code: int = S_OK
    detail: str = ""


ReportTo: TypeAlias = Callable[[Report], None]
