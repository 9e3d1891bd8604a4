"""Loggers, proxies and mirrors in processes of their own."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge.core import keys
from bridge.core.alarms import Raise
from bridge.core.events import Severity, Source
from bridge.core.hresult import ADS_E_INVALIDSTATE, AdsError
from bridge.core.questions import CommandAnswer, CommandQuestion
from bridge.edges.bus import Bus, BusConfig, open_bus
from bridge.listener import Listener
from bridge.logger import EventLogger, LoggerProxy, Mirror, TargetTakenError
from tests.unit.logger.logger_stories import eventually

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
PUMP = Source(name="MAIN.pump")

SERVE = """
import sys
from bridge.edges.bus import BusConfig
from bridge.logger import EventLogger
group, cache = sys.argv[1:]
with EventLogger("plc1", config=BusConfig(scouting_group=group), cache=cache) as logger:
    print(logger.session, flush=True)
    sys.stdin.readline()
"""

CONFIRM = """
import sys
from bridge.core.hresult import AdsError
from bridge.core.events import Source
from bridge.edges.bus import BusConfig, open_bus
from bridge.logger import LoggerProxy
group, event_class, times = sys.argv[1:]
with open_bus(BusConfig(scouting_group=group)) as bus, LoggerProxy(bus, "plc1", timeout_s=20) as proxy:
    alarm = proxy.get_alarm(event_class, 1, Source(name="MAIN.pump"))
    print("ready", flush=True)
    sys.stdin.readline()
    done = 0
    for _ in range(int(times)):
        try:
            proxy.confirm_alarm(alarm)
            done += 1
        except AdsError:
            pass
    print(done, flush=True)
"""


@contextlib.contextmanager
def process(code: str, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """A Python program that is killed at the end if it is still there."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def line(child: "subprocess.Popen[str]") -> str:
    """The next line a program prints."""
    assert child.stdout is not None
    return child.stdout.readline().strip()


def tell(child: "subprocess.Popen[str]") -> None:
    """Let a program go on."""
    assert child.stdin is not None
    child.stdin.write("\n")
    child.stdin.flush()


@pytest.fixture
def bus(bus_config: BusConfig) -> Iterator[Bus]:
    """This process's own bus."""
    with open_bus(bus_config) as bus:
        yield bus


def test_a_logger_elsewhere_by_proxy_and_mirror(bus_config: BusConfig, bus: Bus) -> None:
    """Commands are answered, the mirror follows, and a clean end disposes of what is raised."""
    with process(SERVE, bus_config.scouting_group, ":memory:") as served:
        session = line(served)
        with LoggerProxy(bus, "plc1", timeout_s=20) as proxy, Mirror(bus, "plc1") as mirror:
            assert proxy.is_connected
            assert mirror.wait_for_promise(session)
            alarm = proxy.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, source=PUMP).alarm
            assert alarm is not None
            proxy.raise_alarm(alarm, operator="anna", comment="too hot")
            proxy.send_message(CLASS, 2, Severity.INFO)
            assert mirror.wait_for(session, 1)
            assert mirror.alarms == proxy.active_alarms() == [proxy.get_alarm(CLASS, 1, PUMP)]
            tell(served)
            served.wait(20)
            assert mirror.wait_for(session, 2)
            assert mirror.wait_for_logger(there=False)
            assert mirror.alarms == []
            assert not proxy.is_connected


def test_the_same_id_twice_makes_one_transition(bus_config: BusConfig, bus: Bus) -> None:
    """The second asking gets the first answer, byte for byte."""
    with process(SERVE, bus_config.scouting_group, ":memory:") as served:
        line(served)
        with LoggerProxy(bus, "plc1", timeout_s=20) as proxy:
            alarm = proxy.create_alarm(CLASS, 1, Severity.ERROR, source=PUMP).alarm
            assert alarm is not None
            question = CommandQuestion(id="mine", command=Raise(key=alarm.key))
            key, payload = keys.verb_key("live", "plc1", "@do", "raise"), msgspec.json.encode(question)
            answers = [answer.payload for _ in range(2) for answer in bus.ask(key, payload)]
            assert len(answers) == 2
            assert answers[0] == answers[1]
            assert msgspec.json.decode(answers[0], type=CommandAnswer).seq == 1
            assert len(list(proxy.log())) == 1


def test_a_name_taken_by_another_process_is_refused(bus_config: BusConfig) -> None:
    """Whoever holds the name is named; after it was killed the name is free, and its file can be opened again."""
    with process(SERVE, bus_config.scouting_group, ":memory:") as served:
        session = line(served)
        with pytest.raises(TargetTakenError) as taken:
            EventLogger("plc1", config=bus_config)
        assert taken.value.session == session
        os.kill(served.pid, signal.SIGKILL)
        served.wait(20)
        EventLogger("plc1", config=bus_config).close()


def test_after_a_kill_the_alarms_are_back(bus_config: BusConfig, bus: Bus, tmp_path: Path) -> None:
    """What was answered is in the cache: raised alarms are raised, waiting ones wait, ids go on, the log has all of it."""
    path = str(tmp_path / "plc1.db")
    proxy = LoggerProxy(bus, "plc1", timeout_s=20)
    with process(SERVE, bus_config.scouting_group, path) as served:
        line(served)
        alarms = []
        for number in range(1, 21):
            alarm = proxy.create_alarm(CLASS, number, Severity.ERROR, with_confirmation=True, source=PUMP).alarm
            assert alarm is not None
            alarms.append(alarm)
            proxy.raise_alarm(alarm)
            if number % 2:
                proxy.clear_alarm(alarm)
        before = {alarm.key: alarm for alarm in proxy.active_alarms()}
        ids = {stored.unique_id for stored in proxy.log()}
        assert len(before) == 20
        os.kill(served.pid, signal.SIGKILL)
        served.wait(20)
    with process(SERVE, bus_config.scouting_group, path) as served:
        session = line(served)
        after = {alarm.key: alarm for alarm in proxy.active_alarms()}
        assert {key: msgspec.structs.replace(alarm, suspect=False) for key, alarm in after.items()} == before
        assert all(alarm.suspect == alarm.raised for alarm in after.values())
        assert {stored.unique_id for stored in proxy.log()} == ids
        with pytest.raises(AdsError):
            proxy.raise_alarm(alarms[1])
        assert proxy.confirm_alarm(alarms[0]).session == session
        proxy.raise_alarm(alarms[0])
        assert next(iter(proxy.log())).unique_id == max(ids) + 1


def test_confirms_from_four_processes_make_one_transition(bus_config: BusConfig, bus: Bus) -> None:
    """Two hundred confirms of one alarm: one is carried out, all others are told that there is nothing to confirm."""
    with EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, source=PUMP).alarm
        assert alarm is not None
        logger.raise_alarm(alarm)
        with (
            process(CONFIRM, bus_config.scouting_group, CLASS, "50") as one,
            process(CONFIRM, bus_config.scouting_group, CLASS, "50") as two,
            process(CONFIRM, bus_config.scouting_group, CLASS, "50") as three,
            process(CONFIRM, bus_config.scouting_group, CLASS, "50") as four,
        ):
            clients = (one, two, three, four)
            assert [line(client) for client in clients] == ["ready"] * 4
            for client in clients:
                tell(client)
            assert sum(int(line(client)) for client in clients) == 1
        assert logger.publisher.seq == 2
        assert logger.counters.commands == 202


def test_a_state_taken_in_the_middle_of_a_burst_fits(bus_config: BusConfig, bus: Bus) -> None:
    """Whoever joins while alarms come and go has the logger's state in the end, and every event from the joining on."""
    with contextlib.ExitStack() as stack:
        other = stack.enter_context(open_bus(bus_config))
        logger = stack.enter_context(EventLogger("plc1", bus=bus))
        alarms = []
        for number in range(20):
            alarm = logger.create_alarm(CLASS, number, Severity(number % 5), with_confirmation=True, source=PUMP).alarm
            assert alarm is not None
            alarms.append(alarm)
        stop = threading.Event()

        def burst() -> None:
            while not stop.is_set():
                for alarm in alarms:
                    logger.raise_alarm(alarm)
                    logger.send_message(CLASS, 1, Severity.INFO, source=PUMP)
                    logger.clear_alarm(alarm)
                logger.publisher.flush()

        sender = threading.Thread(target=burst)
        sender.start()
        try:
            mirrors = [stack.enter_context(Mirror(other, "plc1")) for _ in range(5)]
            for mirror in mirrors:
                assert mirror.wait_for_promise(logger.session)
        finally:
            stop.set()
            sender.join()
        logger.raise_alarm(alarms[0])
        last = logger.publisher.seq
        for mirror in mirrors:
            assert mirror.wait_for(logger.session, last, 30)
            assert mirror.table.state() == logger.book.logbook.table.state()
            assert 0 < mirror.table.base(logger.session) < last
            assert (mirror.counters.missing, mirror.counters.dropped, mirror.counters.rejected) == (0, 0, 0)


def test_of_two_that_meet_the_older_one_stays(tmp_path: Path) -> None:
    """Opened apart, as behind a cut network, then joined: the younger one steps back, listeners follow the older one."""
    ends = [f"unixsock-stream/{tmp_path}/{side}" for side in ("here", "there")]
    stepped_back = threading.Event()
    with contextlib.ExitStack() as stack:
        here, there = (stack.enter_context(open_bus(BusConfig(scouting=False, listen=(end,)))) for end in ends)
        older = stack.enter_context(EventLogger("plc1", bus=here))
        younger = stack.enter_context(EventLogger("plc1", bus=there, on_read_only=lambda _reason: stepped_back.set()))
        listener = stack.enter_context(Listener(there, target="plc1", with_state=True))
        kept, lost = (
            logger.create_alarm(CLASS, number, Severity.ERROR, source=PUMP).alarm
            for number, logger in enumerate((older, younger))
        )
        assert kept is not None
        assert lost is not None
        older.raise_alarm(kept)
        younger.raise_alarm(lost)
        assert listener.wait_for_beat(younger.session)
        assert set(listener.table.alarms) == {lost.key}

        stack.enter_context(open_bus(BusConfig(mode="router", scouting=False, connect=tuple(ends))))
        assert stepped_back.wait(20)
        assert older.session in younger.read_only
        assert not older.read_only
        with pytest.raises(AdsError) as refused:
            younger.clear_alarm(lost)
        assert refused.value.code == ADS_E_INVALIDSTATE
        with LoggerProxy(there, "plc1", timeout_s=20) as proxy:
            assert [alarm.key for alarm in proxy.active_alarms()] == [kept.key]
            assert proxy.clear_alarm(kept).session == older.session
            assert [stored.event.event_id for stored in proxy.log()] == [0, 0]
        assert listener.wait_for_beat(older.session, timeout_s=20)
        assert eventually(lambda: set(listener.table.alarms) == {kept.key})
        assert not listener.table.alarms[kept.key].raised


def test_two_that_open_at_the_same_moment(bus_config: BusConfig) -> None:
    """However it turns out, exactly one of them is the logger: the other is refused or read-only."""
    opened: list[EventLogger] = []
    refused: list[TargetTakenError] = []
    together = threading.Barrier(4)

    def open_one() -> None:
        with open_bus(bus_config) as bus:
            together.wait(20)
            try:
                logger = EventLogger("plc1", bus=bus)
            except TargetTakenError as error:
                refused.append(error)
                together.wait(20)
            else:
                opened.append(logger)
                together.wait(20)
                assert eventually(lambda: sum(not each.read_only for each in opened) == 1)
                together.wait(20)
                logger.close()
                return
            together.wait(20)

    threads = [threading.Thread(target=open_one) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(opened) + len(refused) == 4
    oldest = min(opened, key=lambda logger: logger.session)
    assert not oldest.read_only
    assert all(logger.read_only for logger in opened if logger is not oldest)
