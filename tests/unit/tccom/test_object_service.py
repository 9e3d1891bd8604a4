"""Stories of objects that are called from elsewhere: the same results and errors, and nothing hangs."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final, Protocol

import msgspec
import pytest

from bridge.asking import new_id
from bridge.core import keys
from bridge.core.hresult import (
    ADS_E_ACCESSDENIED,
    ADS_E_BUSY,
    ADS_E_EXCEPTION,
    ADS_E_INCOMPATIBLE,
    ADS_E_INVALIDCLSID,
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSTATE,
    ADS_E_NOINTERFACE,
    ADS_E_NOTFOUND,
    ADS_E_NOTREADY,
    ADS_E_OUTOFRANGE,
    ADS_E_SRVNOTSUPP,
    ADS_E_TIMEOUT,
    E_POINTER,
    S_FALSE,
    AdsError,
)
from bridge.edges.bus import ALONE, Bus, BusConfig, Question, Reply, open_bus
from bridge.logger.presence import OBJECTS, token_key
from bridge.tccom import (
    DONE,
    Answer,
    DataArea,
    InterfacePointer,
    Module,
    ObjectServer,
    Parameter,
    Settable,
    State,
    interface,
)
from bridge.tccom.calls import HOLDER, MSGPACK, OBJECTS_VERB, Access, Call, CallAnswer, Hold
from bridge.tccom.factories import Factories
from bridge.tccom.general import IObject
from bridge.tccom.identity import OBJECT_SERVER_ID, id_text
from bridge.tccom.interfaces import describe
from bridge.tccom.proxy import RemoteObjects, RemoteTargets
from bridge.tccom.service import THREADS, WAITING, ObjectService, ObjectsTakenError, _Once
from tests.e2e.fault_stories import eventually

ID = 0x71010000


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0001")
class IPump(Protocol):
    """What the pump of these stories does."""

    def start(self, speed: float) -> Answer[float]: ...
    def echo(self, data: bytes, numbers: dict[str, int]) -> Answer[tuple[bytes, dict[str, int]]]: ...
    def hold(self) -> Answer[None]: ...
    def break_down(self) -> Answer[None]: ...


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0002")
class IValve(Protocol):
    """Nobody offers it."""

    def open(self) -> Answer[None]: ...


class Level(msgspec.Struct):
    """Symbols."""

    height: float = 1.5
    full: bool = False


class Pump(Module, IPump):
    """Counts what it does."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1001"
    gain = Parameter(0x1, float, default=1.0, settable=Settable.INIT | Settable.OP)
    level = DataArea(1, Level, writable=True)
    thread_safe = True
    started = 0
    blocked = threading.Event()

    def start(self, speed: float) -> Answer[float]:
        self.started += 1
        if speed > 100:
            raise AdsError(ADS_E_OUTOFRANGE, "100 at most")
        return Answer(speed * self.gain, S_FALSE if speed == 0 else 0)

    def echo(self, data: bytes, numbers: dict[str, int]) -> Answer[tuple[bytes, dict[str, int]]]:
        return Answer((data, numbers))

    def hold(self) -> Answer[None]:
        self.blocked.wait(30)
        return DONE

    def break_down(self) -> Answer[None]:
        raise ZeroDivisionError("oh")


class Plant:
    """An object server with a pump, in front of it a service, and a caller."""

    def __init__(self, bus: Bus, *, allow: frozenset[Access] = frozenset(Access)) -> None:
        self.pump, self.bus = Pump(), bus
        factories = Factories(installed=False)
        factories.register(Pump)
        self.server = ObjectServer(factories=factories)
        self.server.add(self.pump, object_id=ID, name="Pump", state=State.OP)
        self.service = ObjectService(self.server, bus, "plc1", allow=allow)

    def close(self) -> None:
        self.service.close()
        self.server.close()

    def ask(self, question: object, access: Access) -> CallAnswer:
        """A question that the proxy would not ask."""
        key = keys.verb_key("live", "plc1", OBJECTS_VERB, access, self.service.session)
        payload = question if isinstance(question, bytes) else msgspec.msgpack.encode(question)
        [answer] = self.bus.ask(key, payload, encoding=MSGPACK)
        return msgspec.msgpack.decode(answer.payload, type=CallAnswer)


def code_of(call: Callable[[], object]) -> int:
    """The HRESULT that it is refused with, 0 when it is not."""
    try:
        call()
    except AdsError as error:
        return error.code
    return 0


@pytest.fixture
def plant() -> Iterator[Plant]:
    """On a bus of its own."""
    with open_bus(ALONE) as bus:
        made = Plant(bus)
        yield made
        made.close()


@pytest.fixture
def remote(plant: Plant) -> Iterator[RemoteObjects]:
    """Its caller."""
    with RemoteObjects(plant.bus, "plc1") as made:
        yield made


def test_a_call_gives_what_the_method_gives(remote: RemoteObjects) -> None:
    """Values exactly, also those that JSON has no word for, and HRESULTs that inform."""
    with remote.get(ID, IPump) as pump:
        assert pump.start(2.5) == Answer(2.5)
        assert pump.start(speed=0) == Answer(0.0, S_FALSE)
        assert math.isnan(pump.start(math.nan).value)
        assert pump.echo(b"\x00\xff", {"a": 2**63}) == Answer((b"\x00\xff", {"a": 2**63}))


@pytest.mark.parametrize(
    ("code", "call"),
    [
        (ADS_E_OUTOFRANGE, lambda pump: pump.start(101)),
        (ADS_E_EXCEPTION, lambda pump: pump.break_down()),
        (ADS_E_INVALIDPARM, lambda pump: pump.start()),
        (ADS_E_INVALIDPARM, lambda pump: pump.start("fast")),
        (ADS_E_INVALIDPARM, lambda pump: pump.echo(b"", {"a": 2**70})),
    ],
)
def test_errors_are_those_of_the_object(remote: RemoteObjects, code: int, call: Callable[[IPump], object]) -> None:
    """The same code, and the detail of who refused."""
    with remote.get(ID, IPump) as pump, pytest.raises(AdsError) as raised:
        call(pump)
    assert raised.value.code == code
    assert raised.value.detail


def test_what_is_not_there_is_said(remote: RemoteObjects) -> None:
    """No object, no interface, no class; a released reference; a turn, which nobody has over the bus."""
    cases: list[tuple[int, Callable[[], object]]] = [
        (ADS_E_NOTFOUND, lambda: remote.get(5, IPump)),
        (ADS_E_NOINTERFACE, lambda: remote.get(ID, IValve)),
        (ADS_E_INVALIDCLSID, lambda: remote.create("7a1f5a0e-0000-4c60-8f0e-1d1d1d1d1001", IObject)),
        (ADS_E_NOTFOUND, lambda: remote.set_state(5, State.OP)),
        (ADS_E_SRVNOTSUPP, lambda: remote.get(ID, IPump).turn()),
    ]
    for code, case in cases:
        with pytest.raises(AdsError) as raised:
            case()
        assert raised.value.code == code
    reference = remote.get(ID, IPump)
    reference.release()
    with pytest.raises(AdsError) as raised:
        reference.interface.start(1)
    assert raised.value.code == E_POINTER


def test_an_interface_that_was_changed_is_refused(plant: Plant) -> None:
    """Two programs that declare one id differently do not call each other by mistake."""
    with RemoteObjects(plant.bus, "plc1") as remote:
        remote.show()
        info = describe(IPump)
        hold = Hold(id=new_id(), owner=remote.owner, object_id=ID, interface=info.id, fingerprint="0" * 16)
        assert plant.ask(hold, Access.CALL).result == ADS_E_INCOMPATIBLE
        call = Call(
            id=new_id(), object_id=ID, interface=info.id, method="start", arguments=msgspec.Raw(b"\x80"), fingerprint="x"
        )
        assert plant.ask(call, Access.CALL).result == ADS_E_INCOMPATIBLE


def test_parameters_symbols_and_states(plant: Plant, remote: RemoteObjects) -> None:
    """By the names that the object server itself has for them."""
    remote.set_parameter(ID, "gain", 3)
    assert remote.get_parameter(ID, 0x1) == plant.pump.gain == 3.0
    remote.write_symbol(ID, "level.full", True)
    assert remote.read_symbol(ID, "") == {"level": {"height": 1.5, "full": True}}
    remote.set_state(ID, State.SAFEOP)
    with pytest.raises(AdsError) as raised:
        remote.set_parameter(ID, "gain", 4)
    assert raised.value.code == ADS_E_INVALIDSTATE
    assert remote.object_info(ID) == plant.server.object_info(ID)
    assert remote.objects()[1:] == plant.server.objects()[1:]
    assert [info.object_id for info in remote.objects(class_id=Pump.class_id)] == [ID]
    assert remote.class_info("Pump").symbols[0].path == "level.height"
    assert {info.name for info in remote.classes()} == {"Pump", "Task"}
    remote.delete(ID)
    assert ID not in {info.object_id for info in plant.server.objects()}


def test_who_declares_nothing_can_look_and_call(remote: RemoteObjects) -> None:
    """The interfaces come as text, and methods are called with plain data."""
    text = remote.describe(ID)
    [pump] = [one for one in text.interfaces if one.name == "IPump"]
    assert pump.methods[0].name == "start"
    assert pump.methods[0].parameters == {"speed": "float"}
    assert text.about.name == "Pump"
    assert remote.call(ID, pump.id, "start", {"speed": 4}) == Answer(4.0)
    with pytest.raises(AdsError) as raised:
        remote.call(ID, pump.id, "stop", {})
    assert raised.value.code == ADS_E_INVALIDPARM


def test_references_hold_and_let_go(plant: Plant, remote: RemoteObjects) -> None:
    """All references of one caller to one get() count once; the object outlives its deletion as long as it is held."""
    before = plant.server.object_info(ID).references
    with remote.get(ID, IPump) as pump:
        assert plant.server.object_info(ID).references == before + 1
        plant.server.delete(ID)
        assert pump.start(1) == Answer(1.0)
        assert plant.server.living == 2
    assert plant.server.living == 1


def test_a_transient_object_goes_with_its_reference(plant: Plant, remote: RemoteObjects) -> None:
    """One that is not stays; one that cannot be brought to its state is not there."""
    with remote.create(Pump.class_id, IPump, name="P2", parameters={"gain": 2}, state=State.OP, transient=True) as pump:
        assert pump.start(3) == Answer(6.0)
        assert len(plant.server.objects()) == 3
    assert len(plant.server.objects()) == 2
    remote.create("Pump", IPump).safe_release()
    assert len(plant.server.objects()) == 3
    with pytest.raises(AdsError) as raised:
        remote.create("Pump", IPump, parameters={"gain": "much"})
    assert raised.value.code == ADS_E_INVALIDDATA
    assert len(plant.server.objects()) == 3


def test_what_a_dead_caller_held_is_released(plant: Plant, bus_config: BusConfig) -> None:
    """Its token goes, and with it its references and the objects that it had made for itself."""
    with open_bus(bus_config) as here:
        service = ObjectService(plant.server, here, "plc2")
        there = open_bus(bus_config)
        remote = RemoteObjects(there, "plc2", timeout_s=20)
        held, made = remote.get(ID, IPump), remote.create("Pump", IPump, transient=True)
        before = plant.server.object_info(ID).references
        there.close()
        assert eventually(lambda: plant.server.object_info(ID).references == before - 1)
        assert eventually(lambda: len(plant.server.objects()) == 2)
        assert held.object_id != made.object_id
        service.close()


def test_a_service_that_ends_releases_what_others_held(plant: Plant, remote: RemoteObjects) -> None:
    """The object server may go on without it; nobody could ever let go of them."""
    reference = remote.get(ID, IPump)
    assert plant.server.object_info(ID).references == 2
    plant.service.close()
    assert plant.server.object_info(ID).references == 1
    assert code_of(lambda: reference.interface.start(1)) in (ADS_E_NOTFOUND, ADS_E_TIMEOUT)


def test_many_threads_hold_an_object_anew_once(plant: Plant, remote: RemoteObjects) -> None:
    """One handle per reference, however many of its calls come at the same time."""
    with remote.get(ID, IPump) as pump:
        plant.close()
        with contextlib.closing(Plant(plant.bus)) as again:
            start = threading.Barrier(8)

            def work() -> None:
                start.wait(30)
                assert eventually(lambda: code_of(lambda: pump.start(1)) == 0)

            threads = [threading.Thread(target=work) for _ in range(8)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(60)
            assert again.pump.started >= 8
            assert again.server.object_info(ID).references == 2


def test_who_shows_no_token_holds_nothing(plant: Plant) -> None:
    """Nobody would notice its death."""
    before = plant.server.object_info(ID).references
    hold = Hold(id=new_id(), owner="nobody", object_id=ID, interface=describe(IPump).id)
    assert plant.ask(hold, Access.CALL).result == ADS_E_NOTREADY
    assert plant.server.object_info(ID).references == before


ALLOWED: Final[dict[Access, Callable[[RemoteObjects], object]]] = {
    Access.READ: lambda remote: remote.get_parameter(ID, "gain"),
    Access.SET: lambda remote: remote.set_parameter(ID, "gain", 2.0),
    Access.CALL: lambda remote: remote.call(ID, describe(IPump).id, "start", {"speed": 1}),
    Access.STATE: lambda remote: remote.set_state(ID, State.SAFEOP),
}


@pytest.mark.parametrize("allowed", list(Access))
def test_each_access_can_be_switched_off(allowed: Access) -> None:
    """What is allowed is done, the rest is refused and not done."""
    with (
        open_bus(ALONE) as bus,
        contextlib.closing(Plant(bus, allow=frozenset({allowed}))) as plant,
        RemoteObjects(bus, "plc1") as remote,
    ):
        for access, act in ALLOWED.items():
            if access is allowed:
                act(remote)
                continue
            with pytest.raises(AdsError) as raised:
                act(remote)
            assert raised.value.code == ADS_E_ACCESSDENIED
        assert (plant.pump.gain, plant.pump.started, plant.pump.state) == (
            2.0 if allowed is Access.SET else 1.0,
            int(allowed is Access.CALL),
            State.SAFEOP if allowed is Access.STATE else State.OP,
        )


def test_a_question_comes_on_the_key_of_what_it_needs(plant: Plant) -> None:
    """Else access rules for keys would be worth nothing."""
    call = Call(id=new_id(), object_id=ID, interface=describe(IPump).id, method="start", arguments=msgspec.Raw(b"\x80"))
    assert plant.ask(call, Access.READ).result == ADS_E_ACCESSDENIED
    assert plant.pump.started == 0


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93" * 5000, msgspec.msgpack.encode({"do": "nothing"})])
def test_what_is_no_question_is_refused(plant: Plant, payload: bytes) -> None:
    """And the service goes on."""
    assert plant.ask(payload, Access.CALL).result == ADS_E_INVALIDDATA
    assert RemoteObjects(plant.bus, "plc1").object_info(ID).name == "Pump"


def test_a_question_is_carried_out_once(plant: Plant) -> None:
    """Asked again with its id, also while it is being carried out, it has the same answer and no second effect."""
    arguments = msgspec.Raw(msgspec.msgpack.encode({"speed": 1.0}))
    call = Call(id=new_id(), object_id=ID, interface=describe(IPump).id, method="start", arguments=arguments)
    assert plant.ask(call, Access.CALL) == plant.ask(call, Access.CALL)
    assert plant.pump.started == 1
    plant.ask(msgspec.structs.replace(call, id=new_id()), Access.CALL)
    assert plant.pump.started == 2


def test_a_busy_object_does_not_keep_the_others_from_being_called(plant: Plant, remote: RemoteObjects) -> None:
    """So many calls of one object wait or run; the next is refused, everybody else is served."""
    Pump.blocked.clear()
    with (
        RemoteObjects(plant.bus, "plc1", timeout_s=30) as patient,
        patient.get(ID, IPump) as pump,
        remote.get(ID, IPump) as other,
    ):
        threads = [threading.Thread(target=pump.hold) for _ in range(WAITING)]
        for thread in threads:
            thread.start()
        try:
            assert eventually(lambda: code_of(lambda: other.start(1)) == ADS_E_BUSY)
            assert remote.object_info(OBJECT_SERVER_ID).name == "ObjectServer"
            assert remote.get_parameter(ID, "gain") == 1.0
        finally:
            Pump.blocked.set()
            for thread in threads:
                thread.join(30)
        assert other.start(1) == Answer(1.0)


def test_who_reads_a_busy_object_does_not_keep_the_others_from_being_called(plant: Plant, remote: RemoteObjects) -> None:
    """Symbols are read in the object's turn: so many readers wait for it, the next are refused."""
    plant.server.add(Pump(), object_id=ID + 1, state=State.OP)
    codes: list[int] = []

    def read() -> None:
        codes.append(code_of(lambda: remote.read_symbol(ID, "level.height")))

    with plant.server.get(ID, IPump) as pump, plant.server.get(ID, IPump).turn():
        threads = [threading.Thread(target=read) for _ in range(THREADS)]
        for thread in threads:
            thread.start()
        assert eventually(lambda: codes.count(ADS_E_BUSY) == THREADS - WAITING)
        assert code_of(lambda: remote.set_parameter(ID + 1, "gain", 2.0)) == 0
        assert pump.start(1) == Answer(1.0)
    for thread in threads:
        thread.join(30)


def test_an_error_that_is_no_text_is_told(plant: Plant) -> None:
    """What a module says may be made of a file's name; a caller is told all the same, and at once."""
    error = AdsError(ADS_E_EXCEPTION, "no file \udcff")
    answer = msgspec.msgpack.decode(plant.service._refused(error), type=CallAnswer)
    assert (answer.result, answer.detail) == (ADS_E_EXCEPTION, "no file \\udcff")


def test_answers_that_are_kept_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of their number, and of their bytes: what a module answers may be large."""
    monkeypatch.setattr("bridge.tccom.service.ANSWERS_BYTES", 10)
    once = _Once()
    for number in range(5):
        assert once.answer(str(number), lambda: b"1234") == b"1234"
    assert list(once._answers) == ["3", "4"]
    assert once.answer("large", lambda: b"1" * 100) == once.answer("large", lambda: b"another") == b"1" * 100
    assert list(once._answers) == ["large"]


def test_what_a_dead_caller_leaves_behind_keeps_nobody_waiting(plant: Plant, remote: RemoteObjects) -> None:
    """An object that was made for it is slow to end: others come and hold meanwhile."""
    Pump.blocked.clear()
    dead = RemoteObjects(plant.bus, "plc1")
    made = dead.create("Pump", IPump, state=State.OP, transient=True)
    with plant.server.get(made.object_id, IPump).turn():
        dead.close()
        assert eventually(lambda: dead.owner not in plant.service._owners)
        with remote.get(ID, IPump) as pump:
            assert pump.start(1) == Answer(1.0)
        assert len(plant.server.objects()) == 3
    assert eventually(lambda: len(plant.server.objects()) == 2)


def test_a_strangers_token_releases_nothing_of_ours(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    """Objects of the plant hold others under their ids; nobody on the bus is taken for one of them."""
    released: list[int] = []
    release = plant.server.release_owner
    monkeypatch.setattr(plant.server, "release_owner", lambda owner: released.append(release(owner)))
    plant.server.add(Controller(), object_id=ID + 1, parameters={"pump": ID}, state=State.OP)
    stranger = plant.bus.alive(keys.verb_key("live", "plc1", "@alive", HOLDER, id_text(ID + 1)))
    assert eventually(lambda: id_text(ID + 1) in plant.service._owners)
    stranger.close()
    assert eventually(lambda: id_text(ID + 1) not in plant.service._owners)
    assert eventually(lambda: released == [0])
    assert plant.server.object_info(ID).references == 2


def test_a_handle_is_for_its_object(plant: Plant, remote: RemoteObjects) -> None:
    """A call with the handle of another object, e.g. one from before a restart, is not carried out."""
    with remote.get(ID, IPump) as pump:
        assert pump.start(1) == Answer(1.0)
        arguments = msgspec.Raw(msgspec.msgpack.encode({"speed": 1.0}))
        info = describe(IPump)
        call = Call(
            id=new_id(),
            object_id=ID + 1,
            owner=remote.owner,
            handle=1,
            interface=info.id,
            method="start",
            arguments=arguments,
        )
        assert plant.ask(call, Access.CALL).unheld
        assert not plant.ask(msgspec.structs.replace(call, id=new_id(), object_id=ID), Access.CALL).unheld
        assert plant.pump.started == 2


def test_a_call_that_takes_too_long_is_unknown(plant: Plant) -> None:
    """The caller gets its thread back; that the call goes on there, it is told that it cannot know."""
    Pump.blocked.clear()
    begun = time.monotonic()
    with RemoteObjects(plant.bus, "plc1", timeout_s=0.3) as hurried, hurried.get(ID, IPump) as pump:
        with pytest.raises(AdsError) as raised:
            pump.hold()
        Pump.blocked.set()
    assert raised.value.code == ADS_E_TIMEOUT
    assert time.monotonic() - begun < 10


def test_no_call_waits_for_another_one_and_then_for_itself() -> None:
    """A provider is there and does not answer: each of many calls of one reference ends as early as if it were the only one."""
    ended = threading.Event()

    def silent(_: Question) -> Iterator[Reply]:
        ended.wait(30)
        yield Reply(b"", MSGPACK)

    with open_bus(ALONE) as bus, RemoteTargets(bus, timeout_s=0.5) as targets:
        bus.alive(token_key("plc9", "live", "s", role=OBJECTS))
        bus.answer(keys.verb_key("live", "plc9", OBJECTS_VERB, None, "s"), silent, threads=8)
        took: list[float] = []

        def work() -> None:
            begun = time.monotonic()
            assert code_of(lambda: reference.start(1)) == ADS_E_TIMEOUT
            took.append(time.monotonic() - begun)

        with targets("plc9", ID, IPump) as reference:
            threads = [threading.Thread(target=work) for _ in range(8)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(30)
        ended.set()
    assert len(took) == 8
    assert max(took) < 2.0


def test_a_call_that_is_late_holds_nothing_anew(plant: Plant, remote: RemoteObjects) -> None:
    """Its reference was released meanwhile by another thread: nobody would ever let go of the object."""
    reference = remote.get(ID, IPump)
    method = reference.info.methods["start"]
    arguments = method.bind((1.0,), {})
    reference.safe_release()
    assert code_of(lambda: reference.held.call(reference.info, method, arguments)) == E_POINTER
    assert plant.server.object_info(ID).references == 1


def test_a_bus_that_is_closed_is_an_error_like_others() -> None:
    """Who calls knows one kind of error."""
    bus = open_bus(ALONE)
    plant, remote = Plant(bus), RemoteObjects(bus, "plc1")
    reference = remote.get(ID, IPump)
    bus.close()
    assert code_of(lambda: reference.interface.start(1)) == ADS_E_NOTFOUND
    assert code_of(lambda: remote.get(ID, IPump)) == ADS_E_NOTFOUND
    reference.safe_release()
    remote.close()
    plant.close()


def test_a_target_has_one_object_server(plant: Plant) -> None:
    """The second is refused, with the session of the first."""
    with pytest.raises(ObjectsTakenError) as raised:
        ObjectService(plant.server, plant.bus, "plc1")
    assert raised.value.session == plant.service.session


def test_a_reference_survives_its_provider(plant: Plant, remote: RemoteObjects) -> None:
    """While nobody is there its calls answer ADS_E_NOTFOUND, and at once; then they reach the new object of that id."""
    with remote.get(ID, IPump) as pump:
        pump.start(1)
        plant.close()
        assert eventually(lambda: code_of(lambda: pump.start(1)) == ADS_E_NOTFOUND)
        with contextlib.closing(Plant(plant.bus)) as again:
            assert eventually(lambda: code_of(lambda: pump.start(7)) == 0)
            assert again.pump.started == 1
            assert again.server.object_info(ID).references == 2


def test_it_does_not_matter_who_is_first() -> None:
    """get() waits for the target as long as a call may take."""
    with open_bus(ALONE) as bus, RemoteObjects(bus, "plc1", timeout_s=30) as remote:
        plants: list[Plant] = []
        late = threading.Timer(0.2, lambda: plants.append(Plant(bus)))
        late.start()
        with remote.get(ID, IPump) as pump:
            assert pump.start(1) == Answer(1.0)
        late.join()
        plants[0].close()
    with open_bus(ALONE) as bus, RemoteObjects(bus, "plc1", timeout_s=0.1) as remote, pytest.raises(AdsError) as raised:
        remote.get(ID, IPump)
    assert raised.value.code == ADS_E_NOTFOUND


class Controller(Module):
    """Uses a pump that lives elsewhere."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1002"
    pump = InterfacePointer(0x1, IPump)


def test_an_interface_pointer_may_lead_to_another_target() -> None:
    """It is resolved whether the other is there or not; calls answer ADS_E_NOTFOUND until it is."""
    with (
        open_bus(ALONE) as bus,
        RemoteTargets(bus, timeout_s=0.3) as targets,
        ObjectServer(factories=Factories(installed=False), remote=targets) as server,
    ):
        controller = Controller()
        server.add(controller, parameters={"pump": f"plc1/{ID}"}, state=State.OP)
        with pytest.raises(AdsError) as raised:
            controller.pump.start(1)
        assert raised.value.code == ADS_E_NOTFOUND
        with contextlib.closing(Plant(bus)):
            assert eventually(lambda: code_of(lambda: controller.pump.start(2)) == 0)
            with pytest.raises(AdsError) as raised, targets("plc1", ID, IValve):
                pass
            assert raised.value.code == ADS_E_NOINTERFACE
