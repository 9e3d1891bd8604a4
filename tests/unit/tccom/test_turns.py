"""Calls from many threads: an object serves one at a time, and nobody waits for ever."""

import threading
import time
from collections.abc import Callable
from typing import Protocol

import pytest

from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOTFOUND, ADS_E_TIMEOUT, AdsError
from bridge.tccom.general import IObject
from bridge.tccom.interfaces import Answer, interface
from bridge.tccom.module import Module
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from tests.unit.tccom.tccom_stories import Calculation, ICalculation, Scripted

PATIENCE_S = 30.0


@interface("66666666-0000-4000-8000-000000000001")
class IWork(Protocol):
    def work(self) -> Answer[int]: ...


class Worker(Module, IWork):
    """Does what a test asks for, and counts how many are inside at once."""

    class_id = "66666666-0000-4000-8000-000000000002"

    def __init__(self, does: Callable[[], object] = lambda: None) -> None:
        self.does = does
        self.inside = self.most = self.total = 0

    def work(self) -> Answer[int]:
        self.inside += 1
        self.most = max(self.most, self.inside)
        total = self.total
        self.does()
        self.total = total + 1
        self.inside -= 1
        return Answer(self.total)


class SafeWorker(Worker):
    """Sees to its own safety."""

    class_id = "66666666-0000-4000-8000-000000000003"
    thread_safe = True


def _in_threads(count: int, work: Callable[[], object]) -> None:
    threads = [threading.Thread(target=work) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def test_calls_of_one_object_never_overlap() -> None:
    """Eight threads, each gives way in the middle of its calls: no update is lost."""
    with ObjectServer() as server:
        give_way = threading.Event()
        worker = Worker(lambda: give_way.wait(0.0001))
        object_id = server.add(worker, state=State.OP)

        def calls() -> None:
            with server.get(object_id, IWork) as reference:
                for _ in range(50):
                    reference.work()

        _in_threads(8, calls)
        assert (worker.total, worker.most) == (400, 1)
        assert server.object_info(object_id).references == 1


def test_calls_of_a_thread_safe_class_may_overlap() -> None:
    """All are inside together: each waits for the others there."""
    with ObjectServer() as server:
        together = threading.Barrier(4, timeout=PATIENCE_S)
        worker = SafeWorker(together.wait)
        object_id = server.add(worker, state=State.OP)

        def call() -> None:
            with server.get(object_id, IWork) as reference:
                reference.work()

        _in_threads(4, call)
        assert worker.most == 4


def test_a_thread_safe_object_can_be_watched_too() -> None:
    """What its calls change is told after each."""

    class Open(Calculation):
        thread_safe = True

    with ObjectServer() as server:
        reference = server.create(Open, ICalculation, state=State.OP)
        told: list[object] = []
        with server.watch(reference.object_id, "outputs.total", told.append):
            assert reference.interface.addition(1, 2).value == 3
        assert told == [0, 3]


def test_a_transition_waits_for_the_call_that_is_running() -> None:
    """And a call that comes meanwhile waits for the transition."""
    inside, go_on = threading.Event(), threading.Event()

    def linger() -> None:
        inside.set()
        assert go_on.wait(PATIENCE_S)

    with ObjectServer(patience_s=PATIENCE_S) as server:
        worker = Worker(linger)
        object_id = server.add(worker, state=State.OP)
        reference = server.get(object_id, IWork)
        calling = threading.Thread(target=reference.interface.work)
        calling.start()
        assert inside.wait(PATIENCE_S)
        moving = threading.Thread(target=server.set_state, args=(object_id, State.PREOP))
        moving.start()
        assert server.object_info(object_id).state is State.OP
        with reference.query(IObject) as found:
            assert found.get_state().value is State.OP
        go_on.set()
        for thread in (calling, moving):
            thread.join(PATIENCE_S)
        assert (worker.total, server.object_info(object_id).state) == (1, State.PREOP)


def test_two_objects_that_wait_for_each_other_are_told_so() -> None:
    """Each calls the other from its own call, in two threads: at least one gets ADS_E_TIMEOUT, and both work again."""
    both = threading.Barrier(2, timeout=PATIENCE_S)
    errors: list[AdsError] = []
    with ObjectServer(patience_s=0.2) as server:
        workers = [Worker(), Worker()]
        ids = [server.add(worker, state=State.OP) for worker in workers]

        def start(mine: int) -> None:
            def call_the_other() -> None:
                workers[mine].does = lambda: None
                both.wait()
                with server.get(ids[1 - mine], IWork) as other:
                    other.work()

            workers[mine].does = call_the_other
            try:
                with server.get(ids[mine], IWork) as reference:
                    reference.work()
            except AdsError as error:
                errors.append(error)

        threads = [threading.Thread(target=start, args=(number,)) for number in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
        assert {error.code for error in errors} == {ADS_E_TIMEOUT}
        for object_id in ids:
            with server.get(object_id, IWork) as reference:
                reference.work()


def test_an_object_may_call_itself_through_another() -> None:
    """The thread that has the turn gets it again."""
    with ObjectServer(patience_s=0.2) as server:
        depth = [3]

        def again() -> None:
            depth[0] -= 1
            if depth[0]:
                with server.get(object_id, IWork) as reference:
                    reference.work()

        worker = Worker(again)
        object_id = server.add(worker, state=State.OP)
        with server.get(object_id, IWork) as reference:
            reference.work()
        assert worker.most == 3


def test_a_turn_may_be_kept_for_several_calls() -> None:
    """Nobody comes in between."""
    with ObjectServer(patience_s=PATIENCE_S) as server:
        reference = server.create(Calculation, ICalculation, state=State.OP)

        def others() -> None:
            with server.get(reference.object_id, ICalculation) as calculation:
                calculation.addition(100, 100)

        with reference.turn():
            other = threading.Thread(target=others)
            other.start()
            reference.interface.addition(1, 2)
            with reference.query(IObject) as found:
                assert found.get_object_name().value == "Calculation"
            other.join(0.05)
            assert other.is_alive()
        other.join(PATIENCE_S)
        assert not other.is_alive()


def test_a_module_does_not_move_itself_from_a_hook() -> None:
    """A transition within a transition is refused; the outer one fails and the object stays."""
    with ObjectServer() as server:
        module = Scripted(PS=lambda module: module.set_state(State.OP))
        object_id = server.add(module)
        with pytest.raises(AdsError) as failure:
            server.set_state(object_id, State.OP)
        assert failure.value.code == ADS_E_INVALIDSTATE
        assert server.object_info(object_id).state is State.PREOP


def test_a_parent_makes_its_children_and_takes_them_with_it() -> None:
    """A transient object entered in PS is deleted in SP; what the parent passes on is there before the child's own PS."""
    made: list[int] = []

    def make(module: Scripted) -> None:
        child = module.server.create(Calculation, IObject, parent_id=module.object_id, transient=True)
        made.append(child.object_id)
        module.enter(child).set_parameter("offset", 7)
        child.interface.set_state(State.OP)

    with ObjectServer() as server:
        parent_id = server.add(Scripted(PS=make), state=State.OP)
        (child,) = server.objects(parent_id=parent_id)
        assert (child.object_id, child.state, server.get_parameter(child.object_id, "offset")) == (made[0], State.OP, 7)
        server.set_state(parent_id, State.PREOP)
        assert server.objects(parent_id=parent_id) == ()
        assert server.living == 2


def test_closing_takes_down_the_youngest_first_and_goes_on_past_failures() -> None:
    """Each failing step is reported, and the way down goes on: nothing is left."""
    reports: list[Report] = []
    with ObjectServer(report=reports.append) as server:
        for name in ("one", "two", "three"):
            server.add(Scripted(OS=lambda _: 1 / 0, PI=lambda _: 1 / 0), name=name, state=State.OP)
        reports.clear()
        assert server.close() == 0
        assert server.living == 0
        with pytest.raises(AdsError) as failure:
            server.add(Scripted())
        assert failure.value.code == ADS_E_INVALIDSTATE
    told = [(one.object_name, one.transition) for one in reports if one.kind is ReportKind.DONE]
    assert told == [(name, step) for name in ("three", "two", "one", "ObjectServer") for step in ("OS", "SP", "PI")]
    assert len([one for one in reports if one.kind is ReportKind.FAILED]) == 6


def test_closing_does_not_wait_for_an_object_that_is_stuck() -> None:
    """It says how many are left: this one. A second close finds it free."""
    inside, go_on = threading.Event(), threading.Event()

    def linger() -> None:
        inside.set()
        assert go_on.wait(PATIENCE_S)

    server = ObjectServer(patience_s=2 * PATIENCE_S)
    worker = Worker(linger)
    object_id = server.add(worker, state=State.OP)
    stuck = threading.Thread(target=server.get(object_id, IWork).interface.work)
    stuck.start()
    assert inside.wait(PATIENCE_S)
    begun_s = time.monotonic()
    assert server.close() == 1
    assert time.monotonic() - begun_s < PATIENCE_S
    go_on.set()
    stuck.join(PATIENCE_S)
    assert server.close() == 0
    with pytest.raises(AdsError) as failure:
        server.get(object_id, IWork)
    assert failure.value.code == ADS_E_NOTFOUND


def test_the_transient_objects_of_a_dead_owner_are_deleted(caplog: pytest.LogCaptureFixture) -> None:
    """One that is busy meanwhile does not keep the others alive, and is named in the log."""
    inside, go_on = threading.Event(), threading.Event()

    class Slow(Worker):
        class_id = "66666666-0000-4000-8000-000000000004"

        def work(self) -> Answer[int]:
            inside.set()
            assert go_on.wait(PATIENCE_S)
            return Answer(1)

    with ObjectServer(patience_s=0.1) as server:
        made = [server.create(kind, IWork, owner="dead", transient=True) for kind in (Worker, Slow, Worker)]
        busy = threading.Thread(target=made[1].interface.work)
        busy.start()
        assert inside.wait(PATIENCE_S)
        assert server.release_owner("dead") == 3
        assert [one.name for one in server.objects()] == ["ObjectServer", "Slow"]
        assert "Slow (0x71010001) is not deleted" in caplog.text
        go_on.set()
        busy.join(PATIENCE_S)


def test_a_watch_ends_although_its_object_is_busy() -> None:
    """Closing it waits for nobody's turn."""
    with ObjectServer(patience_s=PATIENCE_S) as server:
        reference = server.create(Calculation, ICalculation, state=State.OP)
        told: list[object] = []
        watch = server.watch(reference.object_id, "outputs.total", told.append)
        with reference.turn():
            ending = threading.Thread(target=watch.close)
            ending.start()
            ending.join(PATIENCE_S)
            assert not ending.is_alive()
            reference.interface.addition(1, 2)
        assert told == [0]
