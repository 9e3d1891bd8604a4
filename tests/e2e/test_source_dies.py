"""A program that raised alarms through the logger is killed, leaves, or cannot be reached for a while."""

import contextlib
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.alarms import AlarmKey
from bridge.core.events import Severity
from bridge.core.hresult import AdsError
from bridge.core.own_events import OWN_CLASS, SOURCE_GONE
from bridge.core.questions import LogQuestion
from bridge.edges.bus import Bus, BusConfig, open_bus
from bridge.listener import Item, Listener, SuspectsChanged
from bridge.logger import LoggerProxy, Mirror
from tests.e2e.fault_stories import CLASS, ROOT, WAIT_S, Program, eventually, program

RAISE_THREE = f"""
import sys
from bridge import BusConfig, LoggerProxy, Severity, Source, open_bus
config = BusConfig(scouting_group=sys.argv[1])
with open_bus(config) as bus, LoggerProxy(bus, "plc1", timeout_s=60, client="pump:main") as proxy:
    for number in range(3):
        proxy.raise_alarm(proxy.create_alarm("{CLASS}", number, Severity.ERROR, source=Source(name="MAIN.pump")).alarm)
    proxy.clear_alarm(proxy.get_alarm("{CLASS}", 2, Source(name="MAIN.pump")))
    print("raised", flush=True)
    sys.stdin.readline()
"""
MARKED = (AlarmKey("plc1", CLASS, 0, None, "MAIN.pump"), AlarmKey("plc1", CLASS, 1, None, "MAIN.pump"))


@pytest.fixture
def bus(bus_config: BusConfig) -> Iterator[Bus]:
    """The bus that the programs are on."""
    with open_bus(bus_config) as bus:
        yield bus


@contextlib.contextmanager
def serving(config: BusConfig, cache: Path) -> Iterator[Program]:
    """A logger of plc1 in a program of its own."""
    with program("serve", "--target", "plc1", "--cache", str(cache), "--scouting-group", config.scouting_group) as logger:
        assert "is ready" in logger.line()
        yield logger


def suspects_told(listener: Listener) -> SuspectsChanged:
    """The next notice of that kind."""
    item: Item | None = None
    while not isinstance(item, SuspectsChanged):
        item = listener.get(WAIT_S)
        assert item is not None
    return item


def shown(config: BusConfig) -> dict[int, bool]:
    """What `tcbridge alarms` says: which are suspect, by event id."""
    command = [sys.executable, "-m", "bridge.cli", "alarms", "--json", "--all", "--target", "plc1", "--wait", "30"]
    done = subprocess.run(
        [*command, "--scouting-group", config.scouting_group],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=True,
        env={"PYTHONPATH": str(ROOT)},
    )
    alarms = [json.loads(line) for line in done.stdout.splitlines()]
    return {alarm["event_id"]: alarm.get("suspect", False) for alarm in alarms}


def test_a_source_that_is_killed_leaves_suspect_alarms(bus_config: BusConfig, bus: Bus, tmp_path: Path) -> None:
    """Those it left raised, in the logger, in listeners and mirrors, and in what people see, until somebody speaks for them."""
    with (
        serving(bus_config, tmp_path / "plc1.db"),
        Listener(bus, target="plc1", with_state=True) as listener,
        Mirror(bus, "plc1") as mirror,
        LoggerProxy(bus, "plc1", timeout_s=WAIT_S) as proxy,
    ):
        assert listener.wait_for_beat(timeout_s=WAIT_S)
        with program(bus_config.scouting_group, code=RAISE_THREE) as source:
            assert source.line() == "raised"
            assert not any(alarm.suspect for alarm in proxy.active_alarms())
            source.kill()
        told = suspects_told(listener)
        assert told.suspects == MARKED
        assert {alarm.key for alarm in listener.alarms if alarm.suspect} == set(MARKED)
        assert {alarm.key for alarm in proxy.active_alarms() if alarm.suspect} == set(MARKED)
        assert eventually(lambda: {alarm.key for alarm in mirror.alarms if alarm.suspect} == set(MARKED))
        assert shown(bus_config) == {0: True, 1: True, 2: False}
        question = LogQuestion(filter=f"event_class = {OWN_CLASS} AND event_id = {SOURCE_GONE}")
        assert eventually(lambda: bool(list(proxy.log(question))))
        (report,) = proxy.log(question)
        assert [argument.value for argument in report.event.arguments] == ["2", "pump:main"]
        with pytest.raises(AdsError):  # it is raised already; but who says so is there
            proxy.raise_alarm(MARKED[0])
        assert suspects_told(listener).suspects == MARKED[1:]
        proxy.clear_alarm(MARKED[1])
        assert eventually(lambda: not any(alarm.suspect for alarm in [*listener.alarms, *mirror.alarms]))
        assert shown(bus_config) == {0: False, 1: False, 2: False}


def test_who_watches_the_alarms_sees_the_mark(bus_config: BusConfig, bus: Bus, tmp_path: Path) -> None:
    """`tcbridge alarms --watch` shows an alarm anew when it becomes suspect, although no event says so."""
    where = ("--target", "plc1", "--scouting-group", bus_config.scouting_group)
    with (
        serving(bus_config, tmp_path / "plc1.db"),
        program("alarms", "--watch", "--json", *where) as watch,
        program(bus_config.scouting_group, code=RAISE_THREE) as source,
    ):
        assert source.line() == "raised"
        shown: dict[int, bool] = {}
        while set(shown) < {0, 1}:
            alarm = json.loads(watch.line())
            shown[alarm.get("event_id", -1)] = alarm.get("suspect", False)
        assert not any(shown.values())
        source.kill()
        marked: set[int] = set()
        while marked < {0, 1}:
            alarm = json.loads(watch.line())
            marked |= {alarm["event_id"]} if alarm.get("suspect") else set()


def test_a_source_that_leaves_leaves_its_alarms_as_they_are(bus_config: BusConfig, bus: Bus, tmp_path: Path) -> None:
    """A proxy that is closed has said what it had to say. One that is killed beside it has not."""
    with (
        serving(bus_config, tmp_path / "plc1.db"),
        Listener(bus, target="plc1", with_state=True) as listener,
        LoggerProxy(bus, "plc1", timeout_s=WAIT_S) as proxy,
    ):
        assert listener.wait_for_beat(timeout_s=WAIT_S)
        with program(bus_config.scouting_group, code=RAISE_THREE) as leaving:
            assert leaving.line() == "raised"
            other = proxy.create_alarm(CLASS, 9, Severity.ERROR).alarm
            proxy.raise_alarm(other)
            leaving.tell()
            assert leaving.process.wait(WAIT_S) == 0
        with program(
            bus_config.scouting_group, code=RAISE_THREE.replace("range(3)", "range(5, 8)").replace(", 2,", ", 7,")
        ) as dying:
            assert dying.line() == "raised"
            dying.kill()
        assert [key.event_id for key in suspects_told(listener).suspects] == [5, 6]
        assert sorted(alarm.event_id for alarm in listener.alarms) == [0, 1, 5, 6, 9]


def test_a_source_that_is_stopped_for_long_is_trusted_when_it_is_back(bus_config: BusConfig, bus: Bus, tmp_path: Path) -> None:
    """It is the same session, so it never died; its alarms were suspect only while nobody could know."""
    with (
        serving(bus_config, tmp_path / "plc1.db"),
        Listener(bus, target="plc1", with_state=True) as listener,
    ):
        assert listener.wait_for_beat(timeout_s=WAIT_S)
        with program(bus_config.scouting_group, code=RAISE_THREE) as source:
            assert source.line() == "raised"
            source.signal(signal.SIGSTOP)
            assert suspects_told(listener).suspects == MARKED
            source.signal(signal.SIGCONT)
            assert suspects_told(listener).suspects == ()
            source.tell()
            assert source.process.wait(WAIT_S) == 0
