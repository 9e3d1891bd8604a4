"""Who calls cyclic modules: a task, with a cycle time of its own.

    class Counter(CyclicModule):
        def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]: ...

Rule 1: a task is a module. In OP it has one thread, which calls the modules that registered, in order of registration.
Rule 2: a cyclic module joins in SO the task that its pointer cyclic_caller names, and leaves it in OS.
Rule 3: cycles begin at multiples of the cycle time since the first. A cycle that is still running when the next should begin
is not interrupted: the ones it missed are skipped and counted as overruns, so that the task never falls behind for long.
Rule 4: a module whose cycle fails is called again in the next one; the others are not affected. The first failure of a row is
reported, and the first success after it.
Rule 5: the priority is told, as ITcTask does. It is not enforced: threads of Python share one processor in turn.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Final

from bridge.core.hresult import ADS_E_EXISTS, ADS_E_INVALIDPARM, ADS_E_NOTFOUND, ADS_E_TIMEOUT, AdsError
from bridge.tccom.declarations import InterfacePointer, Parameter, Resolved
from bridge.tccom.general import ICyclic, ICyclicCaller, ITask, TaskInfo
from bridge.tccom.identity import PID_CYCLIC_CALLER, ContextId, ObjectId, id_text
from bridge.tccom.interfaces import DONE, Answer
from bridge.tccom.module import Module
from bridge.tccom.references import Reference
from bridge.tccom.reports import ReportKind

SHORTEST_NS: Final = 100_000
LONGEST_NS: Final = 3_600_000_000_000
"""A cycle takes 100 us to 1 h."""
JOIN_S: Final = 1.5
"""How long at most OS waits for a cycle that is running."""


class CyclicModule(Module, ICyclic):
    """A module that is called once per cycle. Who overrides on_so calls the base's where it wants to join the task."""

    cyclic_caller = InterfacePointer(PID_CYCLIC_CALLER, ICyclicCaller, resolved=Resolved.SO, comment="the task that calls it")

    def on_so(self) -> None:
        """Join the task; after on_os it is left."""
        self.cyclic_caller.add_module(self.object_id)
        left = contextlib.ExitStack()
        left.callback(self.leave_task)
        self.enter(left)

    def leave_task(self) -> None:
        """Leave the task (RemoveModuleFromCaller), for those who want it to happen at a certain moment of on_os."""
        with contextlib.suppress(AdsError):
            self.cyclic_caller.remove_module(self.object_id)


class _Member:
    def __init__(self, reference: Reference[ICyclic], context_id: ContextId) -> None:
        self.reference, self.context_id = reference, context_id
        self.active = True
        self.failing = False


class Task(Module, ICyclicCaller, ITask):
    """Calls modules once per cycle, on a thread of its own."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b002"
    thread_safe = True

    cycle_ns = Parameter(0x1, int, default=10_000_000, comment="ns from the beginning of one cycle to that of the next")
    priority = Parameter(0x2, int, default=20, comment="told, not enforced; 1 is the highest")

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """clock gives ns and never goes back."""
        self._clock = clock
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._members: dict[ObjectId, _Member] = {}
        self._lock = threading.Lock()
        self._cycles = self._overruns = self._failures = self._longest_ns = 0
        self._late = False

    # Its life.

    def on_ip(self) -> None:
        """Refuse a cycle time that is none."""
        if not SHORTEST_NS <= self.cycle_ns <= LONGEST_NS:
            raise AdsError(ADS_E_INVALIDPARM, f"a cycle of {self.cycle_ns} ns; expected {SHORTEST_NS} to {LONGEST_NS}")

    def on_so(self) -> None:
        """Begin to call."""
        self._stop = threading.Event()  # its own: a thread that was told to end from its own cycle must not go on
        self._thread = threading.Thread(target=self._run, args=(self._stop,), name=f"task {self.name}", daemon=True)
        self._thread.start()

    def on_os(self) -> None:
        """End the thread. Who is registered stays so, and is called again in the next OP."""
        self._stop.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            patience_s = min(JOIN_S, self.place.patience_s())
            self._thread.join(patience_s)
            if self._thread.is_alive():
                self._stop.clear()
                raise AdsError(ADS_E_TIMEOUT, f"a cycle did not end within {patience_s:.1f} s")
        self._thread = None

    def on_pi(self) -> None:
        """Let go of whoever has not left, and of a thread that OS could not wait for: it ends with its cycle."""
        self._stop.set()
        with self._lock:
            members, self._members = list(self._members.values()), {}
        for member in members:
            self._drop(member)

    # ITcCyclicCaller and ITcTask.

    def add_module(self, object_id: ObjectId, context_id: ContextId = 0) -> Answer[None]:
        """Call this object from the next cycle on; AdsError: ADS_E_NOTFOUND, ADS_E_NOINTERFACE, ADS_E_EXISTS."""
        member = _Member(self.server.get(object_id, ICyclic), context_id)
        with self._lock:
            known = self._members.setdefault(object_id, member)
        if known is not member:
            member.reference.safe_release()
            raise AdsError(ADS_E_EXISTS, f"{self.name} calls {id_text(object_id)} already")
        return DONE

    def remove_module(self, object_id: ObjectId) -> Answer[None]:
        """Call it no more; AdsError (ADS_E_NOTFOUND). A call that is under way ends first, when the object itself asks."""
        with self._lock:
            member = self._members.pop(object_id, None)
        if member is None:
            raise AdsError(ADS_E_NOTFOUND, f"{self.name} does not call {id_text(object_id)}")
        self._drop(member)
        return DONE

    def task_info(self) -> Answer[TaskInfo]:
        """What it does, and how it keeps its times."""
        with self._lock:
            modules = tuple(self._members)
        return Answer(
            TaskInfo(
                cycle_ns=self.cycle_ns,
                priority=self.priority,
                modules=modules,
                cycles=self._cycles,
                overruns=self._overruns,
                failures=self._failures,
                longest_ns=self._longest_ns,
            )
        )

    def _drop(self, member: _Member) -> None:
        member.active = False
        member.reference.safe_release()

    # Its thread.

    def _run(self, stop: threading.Event) -> None:
        due_ns = self._clock()
        while not stop.is_set():
            begun_ns = self._clock()
            with self._lock:
                members = list(self._members.values())
            for member in members:
                self._call(member)
            now_ns = self._clock()
            self._longest_ns = max(self._longest_ns, now_ns - begun_ns)
            self._cycles += 1
            due_ns, missed = next_cycle(due_ns, now_ns, self.cycle_ns)
            self._overruns += missed
            if missed and not self._late:
                self.place.report(ReportKind.LATE, duration_ns=now_ns - begun_ns, detail=f"missed {missed} cycles")
            self._late = missed > 0
            stop.wait((due_ns - now_ns) / 1e9)

    def _call(self, member: _Member) -> None:
        try:
            with member.reference.turn():
                # Whoever leaves has its turn while it does: from then on it is not called.
                if member.active:
                    member.reference.interface.cycle_update(member.context_id, self.cycle_ns)
        except AdsError as error:
            if not member.active:
                return
            self._failures += 1
            if not member.failing:
                member.failing = True
                member.reference.held.report(ReportKind.CYCLE_FAILED, code=error.code, detail=error.detail or error.text)
        else:
            if member.failing:
                member.failing = False
                member.reference.held.report(ReportKind.CYCLE_RECOVERED)


def next_cycle(due_ns: int, now_ns: int, cycle_ns: int) -> tuple[int, int]:
    """When the cycle after the one due at due_ns begins, and how many were missed: it lies after now, on the grid."""
    missed = max(0, (now_ns - due_ns) // cycle_ns)
    return due_ns + (missed + 1) * cycle_ns, missed
