"""Stories of a plant in this process: up in order, failures that stay where they are, down in reverse."""

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.config import Settings
from bridge.core.builtin import builtin_catalog
from bridge.core.catalog import Catalog
from bridge.core.events import MessageSent, Severity
from bridge.core.hresult import ADS_E_INVALIDPARM, ADS_E_INVALIDSTATE, S_FALSE, AdsError
from bridge.core.module_instances import read_plant
from bridge.core.own_events import OWN_CLASS, OWN_EVENTS
from bridge.edges.bus import ALONE, Bus, open_bus
from bridge.edges.recording import RecordedEvent, read_events, summary
from bridge.host import Host, IEventLog, Surroundings, make_plan
from bridge.host.system import IRecorder
from bridge.listener import Listener
from bridge.tccom import InterfacePointer, Module, Parameter, State
from bridge.tccom.factories import Factories
from bridge.tccom.states import Transition
from tests.e2e.fault_stories import eventually

TEXTS = Catalog([OWN_EVENTS])
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


class Fragile(Module):
    """Fails in the transition that it is told."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1021"
    fails = Parameter(0x1, Transition)
    log = InterfacePointer(0x2, IEventLog)

    def _step(self, transition: Transition) -> None:
        if self.fails is transition:
            raise ValueError("as it was told")

    def on_ip(self) -> None:
        self._step(Transition.IP)

    def on_ps(self) -> None:
        self._step(Transition.PS)

    def on_so(self) -> None:
        self._step(Transition.SO)
        self.log.raise_alarm(CLASS, 3, "error", self.object_id, self.name, (1, "x"))

    def on_os(self) -> None:
        self._step(Transition.OS)
        self.log.clear_alarm(CLASS, 3, self.object_id, self.name)

    def on_sp(self) -> None:
        self._step(Transition.SP)

    def on_pi(self) -> None:
        self._step(Transition.PI)


class Simple(Module):
    """Does nothing."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1022"


USER = """class = "Fragile"
parameters = {{ fails = "{fails}" }}
pointers = {{ log = "Log" }}"""
PLANT = """
[[modules]]
name = "Log"
class = "Logger"

[[modules]]
name = "Lines"
class = "Listener"
parameters = {{ path = "lines.jsonl", filter = "event_class = '{own}'" }}

[[modules]]
name = "Rec"
class = "Recorder"
parameters = {{ path = "rec.mcap" }}

[[modules]]
name = "User"
@USER@

[[modules]]
name = "Depends"
class = "Simple"
needs = ["User"]

[[modules]]
name = "Other"
class = "Simple"
""".replace("@USER@", USER)


class Running:
    """A plant, what it told, and the events of its steps."""

    def __init__(self, bus: Bus, folder: Path, text: str, settings: Settings) -> None:
        self.told: list[MessageSent] = []
        self.lines: list[str] = []
        self.folder = folder
        factories = Factories(installed=False)
        factories.register(Fragile, Simple, Stuck, Slow)
        plan = make_plan(read_plant(text.encode(), "plant.toml"), factories)
        self.around = Surroundings(
            bus, settings, builtin_catalog().merged((OWN_EVENTS,)), folder=folder, told=self.lines.append
        )
        self.host = Host(plan, self.around, factories, told=self.told.append)
        self.host.start()

    @property
    def states(self) -> dict[str, State]:
        return {info.name: info.state for info in self.host.server.objects()}

    def steps(self, name: str) -> list[str]:
        """The texts of the events of one module."""
        return [TEXTS.event_text(event) for event in self.told if event.source_name == name]


@contextlib.contextmanager
def running(folder: Path, text: str) -> Iterator[Running]:
    """A plant on a bus of its own."""
    with open_bus(ALONE) as bus:
        plant = Running(bus, folder, text, Settings(target="plc1"))
        try:
            yield plant
        finally:
            plant.host.close()


def test_a_plant_comes_up_in_order_and_goes_down_in_reverse(tmp_path: Path) -> None:
    """Created first, then brought up one after another; the logger is the last that goes."""
    with running(tmp_path, PLANT.replace(USER, 'class = "Simple"').format(own=OWN_CLASS)) as plant:
        up = [(event.source_name, event.arguments[1].value) for event in plant.told if event.source_name != "ObjectServer"]
        order = ["Log", "Rec", "Lines", "User", "Depends", "Other"]
        assert up == [(name, "IP") for name in order] + [(name, step) for name in order for step in ("PS", "SO")]
        assert plant.host.not_up() == ()
        count = len(plant.told)
    down = [(event.source_name, event.arguments[1].value) for event in plant.told[count:]]
    assert down == [(name, step) for name in [*order[::-1], "ObjectServer"] for step in ("OS", "SP", "PI")]


@pytest.mark.parametrize(
    ("fails", "state"),
    [("IP", None), ("PS", State.PREOP), ("SO", State.SAFEOP), ("OS", State.OP), ("SP", State.OP), ("PI", State.OP)],
)
def test_a_module_that_fails_stays_where_it_is_and_the_others_run(tmp_path: Path, fails: str, state: State | None) -> None:
    """In each transition in turn: it is told, who needs it is left in PREOP, everybody else is up and goes down in order."""
    with running(tmp_path, PLANT.format(fails=fails, own=OWN_CLASS)) as plant:
        assert plant.states.get("User") is state
        starts = fails in ("IP", "PS", "SO")
        assert plant.states["Depends"] is (State.PREOP if starts else State.OP)
        assert plant.states["Log"] is plant.states["Rec"] is plant.states["Lines"] is plant.states["Other"] is State.OP
        assert plant.host.not_up() == (("User", "Depends") if starts else ())
        if starts:
            assert plant.steps("Depends")[-1] == "Depends is not started: it needs User"
        assert not any("not started" in text for text in plant.steps("User"))  # why it failed is told, and once
    failure = [event for event in plant.told if event.event_id == 11]
    assert [(event.source_name, event.arguments[1].value) for event in failure] == [("User", fails)]
    assert failure[0].severity is Severity.ERROR
    assert "ValueError: as it was told" in TEXTS.event_text(failure[0])
    assert plant.host.not_ended() == (() if starts else ("User",))
    assert plant.host.server.living == 0
    lines = [json.loads(line) for line in (tmp_path / "lines.jsonl").read_text().splitlines()]
    ups = [line for line in lines if line["source_name"] == "Log" and line["event_id"] == 10]
    assert [line["arguments"][1]["value"] for line in ups] == ["IP", "PS", "SO"]
    items = list(read_events(tmp_path / "rec.mcap"))
    recorded = [item.event for item in items if isinstance(item, RecordedEvent) and item.event.source_name == "Log"]
    assert [event.arguments[1].value for event in recorded] == ["IP", "PS", "SO"]
    assert plant.around.lost == 0


def test_events_are_held_until_the_logger_is_in_op(tmp_path: Path) -> None:
    """With the time at which they happened, and before what happens then."""
    with running(tmp_path, '[[modules]]\nname = "Log"\nclass = "Logger"\nstate = "preop"\n') as plant:
        with Listener(plant.around.bus, target="plc1") as listener:
            plant.host.server.set_state(0x71000100, State.OP)
            heard = [event for event in listener.take(6) if isinstance(event, MessageSent)]
        assert [event.source_name for event in heard] == ["ObjectServer"] * 3 + ["Log"] * 3
        assert [event.seq for event in heard] == [1, 2, 3, 4, 5, 6]
        assert [event.time_ns for event in heard] == sorted(event.time_ns for event in heard)


def test_a_plant_without_a_logger_tells_all_the_same(tmp_path: Path) -> None:
    """Under its target, as messages of a publisher."""
    with open_bus(ALONE) as bus, Listener(bus, target="plc1") as listener:
        plant = Running(bus, tmp_path, '[[modules]]\nname = "A"\nclass = "Simple"\n', Settings(target="plc1"))
        heard = [event.source_name for event in listener.take(6) if isinstance(event, MessageSent)]
        plant.host.close()
    assert heard == ["ObjectServer"] * 3 + ["A"] * 3


def test_modules_send_through_the_logger(tmp_path: Path) -> None:
    """The source is the module; raising what is raised, and clearing what is not, informs and does nothing."""
    with running(tmp_path, PLANT.format(fails="PI", own=OWN_CLASS)) as plant:
        user = next(info for info in plant.host.server.objects() if info.name == "User")
        logger = plant.around.logger()
        assert logger is not None
        [alarm] = logger.active_alarms()
        assert (alarm.source_id, alarm.source_name, alarm.event_id) == (user.object_id, "User", 3)
        with plant.host.server.get(0x71000100, IEventLog) as log:
            assert log.raise_alarm(CLASS, 3, "error", user.object_id, "User").result == S_FALSE
            assert log.is_raised(CLASS, 3, user.object_id, "User").value
            log.send_message(CLASS, 1, "info", user.object_id, "User", (True, 2, 2.5, "x"))
            assert log.clear_alarm(CLASS, 3, user.object_id, "User").result == 0
            assert log.clear_alarm(CLASS, 3, user.object_id, "User").result == S_FALSE
        sent = [stored.event for stored in logger.log() if stored.event.event_class == CLASS]
        assert [event.kind for event in sent] == ["alarm_cleared", "message_sent", "alarm_raised"]


def test_a_taken_target_and_a_bad_filter_fail_alone(tmp_path: Path) -> None:
    """The second logger of a target is in PREOP, a recorder whose filter names an unknown class is gone; the reason is told."""
    text = """
[[modules]]
name = "Log"
class = "Logger"
[[modules]]
name = "Twin"
class = "Logger"
[[modules]]
name = "Rec"
class = "Recorder"
parameters = { path = "x.mcap", filter = "event_class = 'Nix'" }
"""
    with running(tmp_path, text) as plant:
        assert plant.states == {"ObjectServer": State.OP, "Log": State.OP, "Twin": State.PREOP}
        assert "has a logger already" in plant.steps("Twin")[-1]
        assert "ADS_E_INVALIDPARM" in plant.steps("Rec")[-1]
        assert "\n" not in "".join(plant.steps("Rec"))
        assert [len([text for text in plant.steps(name) if "ADS_E" in text]) for name in ("Twin", "Rec")] == [1, 1]
        assert plant.host.not_up() == ("Twin", "Rec")


class Stuck(Module):
    """Does not end."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1023"
    let_go = threading.Event()

    def on_os(self) -> None:
        self.let_go.wait(30)


class Slow(Module):
    """Does not come up."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1024"
    let_go = threading.Event()

    def on_so(self) -> None:
        self.let_go.wait(30)


def test_a_module_that_does_not_come_up_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told about; who needs it waits in PREOP, the others run, and the plant ends in time."""
    monkeypatch.setattr("bridge.host.host.UP_S", 0.5)
    Slow.let_go.clear()
    try:
        with running(tmp_path, PLANT.replace(USER, 'class = "Slow"').format(own=OWN_CLASS)) as plant:
            assert plant.host.not_up() == ("User", "Depends")
            assert plant.states["Other"] is State.OP
            assert plant.steps("User")[-1].endswith("it is not up after 0.5 s")
            begun = time.monotonic()
            plant.host.close()
            assert time.monotonic() - begun < 3.0
    finally:
        Slow.let_go.set()
    assert summary(tmp_path / "rec.mcap").complete == "yes"


def test_a_module_that_does_not_end_is_left_behind(tmp_path: Path) -> None:
    """It is told about; the recording is finished, the log is closed, and all that within 3 s."""
    Stuck.let_go.clear()
    with running(tmp_path, PLANT.replace(USER, 'class = "Stuck"').format(own=OWN_CLASS)) as plant:
        begun = time.monotonic()
        plant.host.close()
        assert time.monotonic() - begun < 3.0
    Stuck.let_go.set()
    assert plant.steps("User")[-1] == "User does not work any more: ADS_E_TIMEOUT: it does not end and is left behind"
    assert plant.host.not_ended() == ("User",)
    assert summary(tmp_path / "rec.mcap").complete == "yes"
    assert plant.steps("Log")[-1] == "Log: PI done in 0 ms, now INIT"


def test_a_recorder_of_a_plant_is_told_things_by_calls(tmp_path: Path) -> None:
    """As 'tcbridge control' tells one that is a program of its own; what makes no sense is refused."""
    text = '[[modules]]\nname = "Rec"\nclass = "Recorder"\nparameters = { path = "night" }\n'
    with running(tmp_path, text) as plant, plant.host.server.get(0x71000200, IRecorder) as recorder:
        recorder.pause()
        assert recorder.recorder_info().value.state == "paused"
        recorder.resume()
        recorder.split()
        assert recorder.recorder_info().value.file.endswith("-000002.mcap")
        with pytest.raises(AdsError) as raised:
            recorder.capture()
        assert raised.value.code == ADS_E_INVALIDPARM
        plant.host.server.set_state(0x71000200, State.PREOP)
        with pytest.raises(AdsError) as raised:
            recorder.split()
        assert raised.value.code == ADS_E_INVALIDSTATE
    assert len(list((tmp_path / "night").glob("*.mcap"))) == 2


def test_a_sink_that_cannot_write_says_so_and_when_it_can_again(tmp_path: Path) -> None:
    """As an event, once; what was not written counts at the end."""
    address = tmp_path / "log"
    text = f'''
[[modules]]
name = "Log"
class = "Logger"
[[modules]]
name = "Syslog"
class = "Sink"
parameters = {{ types = "messages", address = "{address}" }}
'''
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as system_log, running(tmp_path, text) as plant:
        logger = plant.around.logger()
        assert logger is not None
        assert eventually(lambda: any(event.event_id == 14 for event in plant.told))
        system_log.bind(str(address))
        system_log.settimeout(30)
        logger.send_message(CLASS, 1, Severity.INFO)
        assert system_log.recv(4096)
        assert eventually(lambda: any("can be written to again" in line for line in plant.lines))
    assert [event.event_id for event in plant.told].count(14) == 1
    assert plant.around.lost > 0
    assert "lines were not written" in plant.lines[-1]
