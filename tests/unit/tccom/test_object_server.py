"""Objects come, are found, held and moved, and go."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from bridge.core.hresult import (
    ADS_E_ACCESSDENIED,
    ADS_E_EXCEPTION,
    ADS_E_EXISTS,
    ADS_E_INVALIDCLSID,
    ADS_E_INVALIDOBJID,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSTATE,
    ADS_E_NOINTERFACE,
    ADS_E_NOTFOUND,
    E_NOTIMPL,
    E_POINTER,
    S_FALSE,
    AdsError,
)
from bridge.tccom.declarations import Parameter
from bridge.tccom.general import IObject, IObjectServer
from bridge.tccom.identity import CREATE_NEW_ID, FIRST_FREE_ID, LAST_FREE_ID, OBJECT_SERVER_ID
from bridge.tccom.interfaces import Answer
from bridge.tccom.module import Module
from bridge.tccom.references import Reference
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from tests.unit.tccom.tccom_stories import Calculation, Caller, ICalculation, Scripted


def test_an_object_is_created_called_and_deleted() -> None:
    """Create, use through the reference, delete: one object more, and one less."""
    with ObjectServer() as server:
        with server.create(Calculation, ICalculation, name="calc", state=State.OP) as calculation:
            assert calculation.addition(1, 2) == Answer(3)
            assert calculation.subtraction(a=1, b=2) == Answer(-1, S_FALSE)
        (info,) = server.objects(class_id=Calculation.class_id)
        assert (info.object_id, info.name, info.state, info.references) == (FIRST_FREE_ID, "calc", State.OP, 1)
        server.delete(info.object_id)
        assert [one.object_id for one in server.objects()] == [OBJECT_SERVER_ID]
        assert server.living == 1
    assert server.living == 0


def test_an_object_lives_as_long_as_it_is_held() -> None:
    """Deleted while somebody holds it, it is found no more, but can be called until the last holder lets go."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation, state=State.OP)
        server.delete(reference.object_id)
        with pytest.raises(AdsError) as failure:
            server.get(reference.object_id, ICalculation)
        assert failure.value.code == ADS_E_NOTFOUND
        assert reference.interface.addition(1, 1).value == 2
        with reference.query(IObject) as found, pytest.raises(AdsError) as failure:
            found.set_state(State.PREOP)
        assert failure.value.code == ADS_E_INVALIDSTATE
        assert server.living == 2
        assert reference.release() == 0
        assert server.living == 1
        with pytest.raises(AdsError) as failure:
            reference.interface.addition(1, 1)
        assert failure.value.code == E_POINTER


def test_holders_are_counted() -> None:
    """The object server is one; add_ref and release answer the count; what was given back is not taken again."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation)
        assert [reference.add_ref(), reference.add_ref()] == [3, 4]
        with reference.query(IObject) as found:
            assert found.get_object_id().value == reference.object_id
            assert server.object_info(reference.object_id).references == 5
        assert [reference.release(), reference.release(), reference.release()] == [3, 2, 1]
        calls = (reference.release, reference.add_ref, reference.turn, lambda: reference.query(IObject), reference.__enter__)
        for call in calls:
            with pytest.raises(AdsError) as failure:
                call()
            assert failure.value.code == E_POINTER
        reference.safe_release()
        assert server.object_info(reference.object_id).references == 1


def test_who_is_gone_is_not_held_again() -> None:
    """Also by somebody who found it a moment before."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation)
        server.delete(reference.object_id)
        reference.safe_release()
        with pytest.raises(AdsError) as failure:
            Reference(reference.held, ICalculation)
        assert failure.value.code == ADS_E_NOTFOUND


def test_references_of_a_dead_owner_are_released() -> None:
    """A process that died does not keep objects alive."""
    with ObjectServer() as server:
        mine = server.create(Calculation, ICalculation)
        theirs = [server.get(mine.object_id, ICalculation, owner="session") for _ in range(3)]
        theirs[0].add_ref()
        theirs[1].safe_release()
        assert server.object_info(mine.object_id).references == 5
        assert server.release_owner("session") == 2
        assert server.release_owner("session") == 0
        assert server.object_info(mine.object_id).references == 2


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda server: server.get(1, ICalculation), ADS_E_NOTFOUND),
        (lambda server: server.get(OBJECT_SERVER_ID, ICalculation), ADS_E_NOINTERFACE),
        (lambda server: server.create("Calculation", ICalculation), ADS_E_INVALIDCLSID),
        (lambda server: server.create(Calculation, ICalculation, object_id=0), ADS_E_INVALIDOBJID),
        (lambda server: server.create(Calculation, ICalculation, object_id=OBJECT_SERVER_ID), ADS_E_EXISTS),
        (lambda server: server.create(Calculation, IObjectServer), ADS_E_NOINTERFACE),
        (lambda server: server.create(Calculation, ICalculation, parameters={"ofset": 1}), ADS_E_NOTFOUND),
        (lambda server: server.create(Calculation, ICalculation, state=State.INIT), ADS_E_INVALIDSTATE),
        (lambda server: server.delete(1), ADS_E_NOTFOUND),
    ],
)
def test_what_cannot_be_is_refused_with_its_code(call: object, code: int) -> None:
    """Each refusal has the code of the manual's table, and leaves no object behind."""
    assert callable(call)
    with ObjectServer() as server:
        with pytest.raises(AdsError) as failure:
            call(server)
        assert failure.value.code == code
        assert server.living == len(server.objects()) == 1


def test_the_object_server_stays_until_it_is_closed() -> None:
    """Nobody deletes or stops it through itself, by force or over the bus; closing does."""
    with ObjectServer() as server:
        with server.get(OBJECT_SERVER_ID, IObjectServer) as itself, server.get(OBJECT_SERVER_ID, IObject) as found:
            attempts: list[Callable[[], object]] = [
                lambda: server.delete(OBJECT_SERVER_ID),
                lambda: server.delete(OBJECT_SERVER_ID, force=True),
                lambda: server.set_state(OBJECT_SERVER_ID, State.PREOP),
                lambda: itself.delete_instance(OBJECT_SERVER_ID),
                lambda: found.set_state(State.INIT),
            ]
            for attempt in attempts:
                with pytest.raises(AdsError) as failure:
                    attempt()
                assert failure.value.code == ADS_E_ACCESSDENIED
        assert server.object_info(OBJECT_SERVER_ID).state is State.OP
    assert server.objects() == ()


def test_only_interfaces_are_asked_for() -> None:
    """A class that is no interface is the caller's mistake, and told as such."""
    with ObjectServer() as server, pytest.raises(TypeError, match="@interface"):
        server.get(OBJECT_SERVER_ID, Calculation)


def test_a_method_that_breaks_is_an_error_for_its_caller_only() -> None:
    """A wrong argument list is ADS_E_INVALIDPARM, an exception in the method ADS_E_EXCEPTION; the object stays usable."""

    class Broken(Calculation):
        def addition(self, a: int, b: int) -> Answer[int]:
            return Answer(a // b)

    with ObjectServer() as server:
        reference = server.create(Broken, ICalculation)
        with pytest.raises(AdsError) as failure:
            reference.interface.addition(1, 0)
        assert failure.value.code == ADS_E_EXCEPTION
        assert "ZeroDivisionError" in str(failure.value)
        with pytest.raises(AdsError) as failure:
            reference.interface.addition(1, c=2)  # type: ignore[call-arg] # the mistake the test is about
        assert failure.value.code == ADS_E_INVALIDPARM
        assert reference.interface.addition(7, 2).value == 3


def test_an_interface_pointer_holds_its_object_from_ps_to_sp() -> None:
    """The id is given at creation, the reference taken in PS and released in SP."""
    with ObjectServer() as server:
        provider = server.create(Calculation, ICalculation, state=State.OP)
        module = Caller()
        caller = server.add(module, parameters={"calculation": provider.object_id})
        assert server.object_info(provider.object_id).references == 2
        server.set_state(caller, State.OP)
        assert server.object_info(provider.object_id).references == 3
        assert module.calculation.addition(2, 3).value == 5
        server.set_state(caller, State.PREOP)
        assert server.object_info(provider.object_id).references == 2


def test_a_hook_that_fails_leaves_what_the_last_completed_step_left() -> None:
    """What the failing hook acquired is given back, what earlier ones did stays, and it can be tried again."""
    with ObjectServer() as server:
        provider = server.create(Calculation, ICalculation)
        fail = [True]

        def connect_and_fail(module: Scripted) -> None:
            module.connect(provider.object_id, ICalculation)
            if fail.pop():
                raise OSError("no such device")

        module = Scripted(PS=lambda module: module.connect(provider.object_id, ICalculation), SO=connect_and_fail)
        object_id = server.add(module)
        with pytest.raises(AdsError, match="no such device") as failure:
            server.set_state(object_id, State.OP)
        assert failure.value.code == ADS_E_EXCEPTION
        assert server.object_info(object_id).state is State.SAFEOP
        assert server.object_info(provider.object_id).references == 3
        fail.append(False)
        server.set_state(object_id, State.OP)
        assert server.object_info(provider.object_id).references == 4
        server.delete(object_id)
        assert server.object_info(provider.object_id).references == 2
        assert module.noted == ["IP", "PS", "SO", "SO", "OS", "SP", "PI"]


def test_a_hook_that_ends_the_program_has_failed() -> None:
    """sys.exit() in a hook is a failure like any other: the thread that moves the object is somebody else's."""
    with ObjectServer() as server:
        object_id = server.add(Scripted(PS=lambda _: sys.exit(1), SP=lambda _: sys.exit(1)))
        with pytest.raises(AdsError, match="SystemExit"):
            server.set_state(object_id, State.OP)
        assert server.object_info(object_id).state is State.PREOP


def test_a_hook_that_is_interrupted_has_failed_too() -> None:
    """Ctrl-C in the middle of a step up: what it acquired is given back, and the interrupt goes on to whoever waits for it."""
    reports: list[Report] = []

    def acquire_and_stop(module: Scripted) -> None:
        module.connect(OBJECT_SERVER_ID, IObjectServer)
        raise KeyboardInterrupt

    with ObjectServer(report=reports.append) as server:
        object_id = server.add(Scripted(PS=acquire_and_stop))
        with pytest.raises(KeyboardInterrupt):
            server.set_state(object_id, State.OP)
        assert server.object_info(object_id).state is State.PREOP
        assert server.object_info(OBJECT_SERVER_ID).references == 1
        assert reports[-1].kind is ReportKind.FAILED


def test_what_cannot_be_given_back_in_good_order_is_reported() -> None:
    """The rest is given back, the step is done: nobody could try it again."""
    reports: list[Report] = []

    @contextmanager
    def awkward() -> Iterator[None]:
        yield
        raise OSError("the disk is gone")

    def acquire(module: Scripted) -> None:
        module.connect(OBJECT_SERVER_ID, IObjectServer)
        module.enter(awkward())

    with ObjectServer(report=reports.append) as server:
        object_id = server.add(Scripted(PS=acquire), state=State.OP)
        reports.clear()
        server.set_state(object_id, State.PREOP)
        assert server.object_info(OBJECT_SERVER_ID).references == 1
    told = [(one.kind, one.transition, one.detail.partition(" (")[0]) for one in reports if one.object_id == object_id][:3]
    assert told == [
        (ReportKind.DONE, "OS", ""),
        (ReportKind.UNDO_FAILED, "SP", "OSError: the disk is gone"),
        (ReportKind.DONE, "SP", ""),
    ]


def test_what_is_acquired_between_transitions_is_given_back_with_the_last_one_up() -> None:
    """In OP at OS, in SAFEOP at SP; an object that has signed off acquires nothing."""
    with ObjectServer() as server:
        module = Scripted()
        object_id = server.add(module, state=State.SAFEOP)
        module.connect(OBJECT_SERVER_ID, IObjectServer)
        server.set_state(object_id, State.OP)
        module.connect(OBJECT_SERVER_ID, IObjectServer)
        counts = [server.object_info(OBJECT_SERVER_ID).references]
        for state in (State.SAFEOP, State.PREOP):
            server.set_state(object_id, state)
            counts.append(server.object_info(OBJECT_SERVER_ID).references)
        assert counts == [3, 2, 1]
        server.delete(object_id)
        with pytest.raises(AdsError) as failure:
            module.connect(OBJECT_SERVER_ID, IObjectServer)
        assert failure.value.code == ADS_E_INVALIDSTATE
        assert server.object_info(OBJECT_SERVER_ID).references == 1


def test_a_module_that_does_not_do_what_it_offers_is_refused() -> None:
    """Also when it has no class id."""

    class Lazy(Module, ICalculation):
        pass

    with ObjectServer() as server:
        with pytest.raises(AdsError, match=r"ICalculation\.addition") as failure:
            server.add(Lazy())  # type: ignore[abstract] # the mistake the test is about
        assert failure.value.code == E_NOTIMPL


@pytest.mark.parametrize("address", [OBJECT_SERVER_ID, "plc2/0x71010000"])
def test_connecting_in_ip_is_refused(address: int | str) -> None:
    """Others may not be there yet (manual 8.1.1.2, IP), here or elsewhere: the object is not created."""
    with ObjectServer() as server:
        module = Scripted(IP=lambda module: module.connect(address, IObjectServer))
        with pytest.raises(AdsError) as failure:
            server.add(module, object_id=CREATE_NEW_ID)
        assert failure.value.code == ADS_E_INVALIDSTATE
        assert server.living == 1


def test_every_transition_and_failure_is_reported() -> None:
    """In order, with the object and the code."""
    reports: list[Report] = []
    with ObjectServer(report=reports.append) as server:
        reports.clear()
        with pytest.raises(AdsError):
            server.add(Scripted(SO=lambda _: 1 / 0), name="broken", state=State.OP)
    told = [(report.kind, report.transition, report.code) for report in reports if report.object_name == "broken"]
    assert told == [
        (ReportKind.DONE, "IP", 0),
        (ReportKind.DONE, "PS", 0),
        (ReportKind.FAILED, "SO", ADS_E_EXCEPTION),
        (ReportKind.DONE, "SP", 0),
        (ReportKind.DONE, "PI", 0),
    ]


def test_a_real_time_step_that_takes_long_is_reported() -> None:
    """SO and OS belong to the real-time context: "not for long-running tasks" (manual 8.1.1.2). PS may be slow."""
    reports: list[Report] = []
    now = [0]

    def work(_: Scripted) -> None:
        now[0] += 200_000_000

    with ObjectServer(report=reports.append, clock=lambda: now[0]) as server:
        server.add(Scripted(PS=work, SO=work), name="slow", state=State.OP)
    slow = [(one.object_name, one.transition, one.duration_ns) for one in reports if one.kind is ReportKind.SLOW]
    assert slow == [("slow", "SO", 200_000_000)]


def test_a_class_whose_objects_cannot_be_made_is_refused() -> None:
    """Whatever its constructor raises."""

    class Unlucky(Calculation):
        def __init__(self) -> None:
            raise OSError("no licence")

    with ObjectServer() as server:
        with pytest.raises(AdsError, match="no licence") as failure:
            server.create(Unlucky, ICalculation)
        assert failure.value.code == ADS_E_EXCEPTION
        assert server.living == 1


def test_nobody_ends_the_thread_of_somebody_else(caplog: pytest.LogCaptureFixture) -> None:
    """A module that calls sys.exit() in its making, over a parameter or while it gives back has failed, and no more."""

    class Leaver(Module):
        leaves = True
        gain = Parameter(0x1, int, default=0)

        def __init__(self) -> None:
            if self.leaves:
                sys.exit(1)

        def on_parameter(self, name: str) -> None:
            sys.exit(2)

        def on_ps(self) -> None:
            self.enter(contextlib.ExitStack()).callback(sys.exit, 3)

    told: list[Report] = []
    with ObjectServer(report=told.append) as server:
        with pytest.raises(AdsError, match="SystemExit: 1"):
            server.create(Leaver, IObject)
        Leaver.leaves = False
        object_id = server.create(Leaver, IObject).object_id
        with pytest.raises(AdsError, match="SystemExit: 2"):
            server.set_parameter(object_id, "gain", 1)
        assert server.get_parameter(object_id, "gain") == 0
        server.watch(object_id, "gain", lambda _: sys.exit(4))
        assert "a watch failed" in caplog.text
        server.set_state(object_id, State.SAFEOP)
        server.set_state(object_id, State.PREOP)
        assert server.object_info(object_id).state is State.PREOP
    assert [one.detail for one in told if one.kind is ReportKind.UNDO_FAILED] == ["SystemExit: 3"]


def test_an_object_that_comes_while_the_server_closes_does_not_stay() -> None:
    """Its IP is still running when the server closes: it is taken down again, and its maker is told."""
    with ObjectServer() as server:
        module = Scripted(IP=lambda module: server.close())
        with pytest.raises(AdsError) as failure:
            server.add(module, state=State.OP)
        assert failure.value.code == ADS_E_INVALIDSTATE
        assert (server.living, module.noted) == (0, ["IP", "PI"])


def test_whoever_takes_down_what_is_down_is_content() -> None:
    """Two end an object at the same time, say close() and its last holder: the second finds done what it wanted."""
    with ObjectServer() as server, server.create(Calculation, ICalculation) as _:
        (live,) = [one for one in server._living if isinstance(one.module, Calculation)]
        server.delete(live.object_id)
        live.walk(State.INIT, force=True)
        with pytest.raises(AdsError, match="has signed off"):
            live.walk(State.INIT)


def test_ids_go_round() -> None:
    """The id of a deleted object is not soon another's: who kept it finds nobody rather than a stranger."""
    with ObjectServer() as server:
        ids = []
        for _ in range(3):
            object_id = server.add(Scripted())
            server.delete(object_id)
            ids.append(object_id)
        assert ids == [FIRST_FREE_ID, FIRST_FREE_ID + 1, FIRST_FREE_ID + 2]
        server._next_id = LAST_FREE_ID
        kept = server.add(Scripted(), object_id=FIRST_FREE_ID)
        assert [server.add(Scripted()) for _ in range(2)] == [LAST_FREE_ID, kept + 1]
