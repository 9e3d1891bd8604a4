"""Tasks call cyclic modules."""

import threading
import time

import pytest

from bridge.core.hresult import ADS_E_EXCEPTION, ADS_E_EXISTS, ADS_E_INVALIDPARM, ADS_E_NOTFOUND, AdsError
from bridge.tccom.general import ICyclic, ICyclicCaller, ITask
from bridge.tccom.identity import FIRST_TASK_ID
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from bridge.tccom.tasks import Task, next_cycle
from tests.unit.tccom.tccom_stories import Counter

PATIENCE_S = 30.0


def test_a_module_is_called_in_op_only() -> None:
    """It joins its task in SO and leaves it in OS; the task lets go of it."""
    with ObjectServer() as server:
        task = server.create(Task, ITask, object_id=FIRST_TASK_ID, parameters={"cycle_ns": 1_000_000}, state=State.OP)
        counter = Counter()
        object_id = server.add(counter, parameters={"cyclic_caller": FIRST_TASK_ID}, state=State.OP)
        assert counter.reached.wait(PATIENCE_S)
        assert task.interface.task_info().value.modules == (object_id,)
        server.set_state(object_id, State.SAFEOP)
        after = counter.cycles
        assert task.interface.task_info().value.modules == ()
        assert server.object_info(object_id).references == 1
        counter.reached.clear()
        server.set_state(object_id, State.OP)
        assert counter.reached.wait(PATIENCE_S)
        assert counter.cycles > after
        assert task.interface.task_info().value.failures == 0


def test_no_thread_outlives_its_task() -> None:
    """Closing the object server ends them; none is left."""
    before = set(threading.enumerate())
    with ObjectServer() as server:
        for number in range(3):
            server.create(Task, ITask, object_id=FIRST_TASK_ID + 16 * number, state=State.OP).safe_release()
        assert len(set(threading.enumerate()) - before) == 3
    assert set(threading.enumerate()) <= before


def test_a_task_that_is_restarted_from_its_own_cycle_has_one_thread() -> None:
    """The old one ends with the cycle that it is in."""
    with ObjectServer() as server:
        task_id = server.add(Task(), name="Restarted", parameters={"cycle_ns": 1_000_000}, state=State.OP)

        def restart(counter: Counter) -> None:
            if counter.cycles == 1:
                server.set_state(task_id, State.SAFEOP)
                server.set_state(task_id, State.OP)
                first.append(threading.current_thread())

        first: list[threading.Thread] = []
        counter = Counter(restart)
        server.add(counter, parameters={"cyclic_caller": task_id}, state=State.OP)
        assert counter.reached.wait(PATIENCE_S)
        first[0].join(PATIENCE_S)
        assert [thread.name for thread in threading.enumerate()].count("task Restarted") == 1


def test_a_task_called_in_safeop_keeps_its_modules_for_op() -> None:
    """Its thread ends and begins again; who has joined stays."""
    with ObjectServer() as server:
        task_id = server.add(Task(), parameters={"cycle_ns": 1_000_000}, state=State.SAFEOP)
        counter = Counter()
        server.add(counter, parameters={"cyclic_caller": task_id}, state=State.OP)
        assert counter.cycles == 0
        server.set_state(task_id, State.OP)
        assert counter.reached.wait(PATIENCE_S)
        server.set_state(task_id, State.SAFEOP)
        cycles = counter.cycles
        counter.reached.clear()
        server.set_state(task_id, State.OP)
        assert counter.reached.wait(PATIENCE_S)
        assert counter.cycles > cycles


def test_a_cycle_that_fails_is_told_once_and_harms_nobody_else() -> None:
    """The others go on; the first failure of a row and the first success after it are reported."""
    reports: list[Report] = []
    recovered = threading.Event()

    def hear(report: Report) -> None:
        reports.append(report)
        if report.kind is ReportKind.CYCLE_RECOVERED:
            recovered.set()

    def fail(counter: Counter) -> None:
        if 3 <= counter.cycles < 6:
            raise ZeroDivisionError

    with ObjectServer(report=hear) as server:
        task = server.create(Task, ITask, parameters={"cycle_ns": 1_000_000}, state=State.OP)
        other = Counter()
        pointer = {"cyclic_caller": task.object_id}
        broken_id = server.add(Counter(fail), parameters=pointer, name="broken", state=State.OP)
        server.add(other, parameters=pointer, state=State.OP)
        assert recovered.wait(PATIENCE_S)
        assert other.reached.wait(PATIENCE_S)
        assert task.interface.task_info().value.failures == 3
    told = [(one.kind, one.object_id, one.code) for one in reports if one.kind.startswith("cycle")]
    assert told == [(ReportKind.CYCLE_FAILED, broken_id, ADS_E_EXCEPTION), (ReportKind.CYCLE_RECOVERED, broken_id, 0)]


def test_a_module_that_leaves_is_not_called_again() -> None:
    """Also when its task is waiting for its turn at that moment: after OS there is no cycle."""
    inside, go_on = threading.Event(), threading.Event()

    def linger(_: Counter) -> None:
        inside.set()
        assert go_on.wait(PATIENCE_S)

    with ObjectServer() as server:
        task_id = server.add(Task(), parameters={"cycle_ns": 1_000_000}, state=State.OP)
        counter = Counter(linger)
        object_id = server.add(counter, parameters={"cyclic_caller": task_id}, state=State.OP)
        assert inside.wait(PATIENCE_S)
        leaving = threading.Thread(target=server.set_state, args=(object_id, State.PREOP))
        leaving.start()
        go_on.set()
        leaving.join(PATIENCE_S)
        cycles = counter.cycles
        with server.get(task_id, ITask) as task:
            begun = task.task_info().value.cycles
            while task.task_info().value.cycles < begun + 5:
                go_on.wait(0.001)
        assert counter.cycles == cycles


def test_a_task_that_waits_while_a_module_leaves_does_not_call_it() -> None:
    """The task has begun a cycle when the module is in OS: when it gets its turn, the module has left."""
    leaving, begun = threading.Event(), threading.Event()

    def clock() -> int:
        if leaving.is_set():
            begun.set()
        return time.monotonic_ns()

    class Slow(Counter):
        def on_os(self) -> None:
            self.reached.wait(PATIENCE_S)
            leaving.set()
            assert begun.wait(PATIENCE_S)
            threading.Event().wait(0.05)
            self.cycles = 0

    with ObjectServer() as server:
        task_id = server.add(Task(clock), parameters={"cycle_ns": 1_000_000}, state=State.OP)
        module = Slow()
        object_id = server.add(module, parameters={"cyclic_caller": task_id}, state=State.OP)
        assert module.reached.wait(PATIENCE_S)
        server.set_state(object_id, State.PREOP)
        begun.clear()
        assert begun.wait(PATIENCE_S)
        assert module.cycles == 0


def test_os_that_fails_leaves_the_module_in_its_task() -> None:
    """A failed step leaves what the last completed one left: it is called on."""

    class Stubborn(Counter):
        def on_os(self) -> None:
            if not self.reached.is_set():
                raise OSError("not yet")

    with ObjectServer() as server:
        task_id = server.add(Task(), parameters={"cycle_ns": 1_000_000}, state=State.OP)
        module = Stubborn()
        object_id = server.add(module, parameters={"cyclic_caller": task_id}, state=State.OP)
        module.reached.clear()
        with pytest.raises(AdsError, match="not yet"):
            server.set_state(object_id, State.PREOP)
        assert server.object_info(object_id).state is State.OP
        assert module.reached.wait(PATIENCE_S)
        server.set_state(object_id, State.PREOP)


@pytest.mark.parametrize("cycle_ns", [0, -1, 99_999, 3_600_000_000_001])
def test_a_cycle_time_that_is_none_is_refused(cycle_ns: int) -> None:
    """100 us to 1 h."""
    with ObjectServer() as server:
        with pytest.raises(AdsError) as failure:
            server.add(Task(), parameters={"cycle_ns": cycle_ns})
        assert failure.value.code == ADS_E_INVALIDPARM


def test_joining_twice_and_leaving_twice_are_refused() -> None:
    """Each object is called once per cycle."""
    with ObjectServer() as server:
        task = server.create(Task, ICyclicCaller, state=State.SAFEOP)
        counter = server.create(Counter, ICyclic)
        task.interface.add_module(counter.object_id)
        with pytest.raises(AdsError) as failure:
            task.interface.add_module(counter.object_id)
        assert failure.value.code == ADS_E_EXISTS
        task.interface.remove_module(counter.object_id)
        with pytest.raises(AdsError) as failure:
            task.interface.remove_module(counter.object_id)
        assert failure.value.code == ADS_E_NOTFOUND
        assert server.object_info(counter.object_id).references == 2


@pytest.mark.parametrize(
    ("due_ns", "now_ns", "then_ns", "missed"),
    [(0, 3, 10, 0), (0, 9, 10, 0), (0, 10, 20, 1), (0, 35, 40, 3), (20, 15, 30, 0)],
)
def test_cycles_stay_on_their_grid(due_ns: int, now_ns: int, then_ns: int, missed: int) -> None:
    """The next begins at a multiple of the cycle time after now; what lay in between was missed."""
    assert next_cycle(due_ns, now_ns, 10) == (then_ns, missed)


def test_overruns_are_counted_and_told_once_in_a_row() -> None:
    """With a clock that runs 2.5 cycles during each call: what was not called was missed."""
    reports: list[Report] = []
    now = [0]

    def clock() -> int:
        return now[0]

    def slow(_: Counter) -> None:
        now[0] += 2_500_000

    with ObjectServer(report=reports.append) as server:
        task = Task(clock)
        task_id = server.add(task, parameters={"cycle_ns": 1_000_000}, state=State.SAFEOP)
        counter = Counter(slow)
        server.add(counter, parameters={"cyclic_caller": task_id}, state=State.OP)
        server.set_state(task_id, State.OP)
        assert counter.reached.wait(PATIENCE_S)
        server.set_state(task_id, State.SAFEOP)
        info = task.task_info().value
    assert info.cycles + info.overruns == now[0] // 1_000_000 + 1
    assert info.longest_ns == 2_500_000
    assert [report.kind for report in reports].count(ReportKind.LATE) == 1


def test_tasks_that_hang_do_not_hold_up_closing() -> None:
    """Three cycles that do not end: their modules are told within 2 s, and the threads end when the cycles do."""
    go_on = threading.Event()
    stuck = threading.Barrier(4, timeout=PATIENCE_S)

    def hang(_: Counter) -> None:
        stuck.wait()
        assert go_on.wait(PATIENCE_S)

    before = set(threading.enumerate())
    server = ObjectServer()
    for _ in range(3):
        task_id = server.add(Task(), parameters={"cycle_ns": 1_000_000}, state=State.OP)
        server.add(Counter(hang), parameters={"cyclic_caller": task_id}, state=State.OP)
    stuck.wait()
    begun_s = time.monotonic()
    assert server.close() == 3
    assert time.monotonic() - begun_s < 4
    go_on.set()
    for thread in set(threading.enumerate()) - before:
        thread.join(PATIENCE_S)
    assert set(threading.enumerate()) <= before
    assert server.close() == 0
