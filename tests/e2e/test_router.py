"""The router is killed and comes back: a lost bus is no lost logger, and what was missed is repaired or named."""

import contextlib
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.events import AlarmDisposed, Event, Severity, Source
from bridge.edges.bus import BusConfig, open_bus
from bridge.listener import (
    BusBack,
    BusLost,
    Gap,
    Item,
    Listener,
    LoggerBack,
    LoggerGone,
    SuspectsChanged,
    TailUnknown,
)
from bridge.logger import EventLogger, LoggerProxy
from tests.e2e.fault_stories import CLASS, Program, eventually, program

CONVERGE_S = 2.0


@pytest.fixture
def endpoint() -> str:
    """An address that is free now and that no other test is given."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def router_at(endpoint: str) -> Iterator[Program]:
    """A router that is ready."""
    with program("router", "--listen", endpoint) as router:
        assert "listens on" in router.line()
        yield router


@pytest.mark.parametrize("down_s", [0.2, pytest.param(3.0, marks=pytest.mark.slow), pytest.param(8.0, marks=pytest.mark.slow)])
def test_a_router_is_killed_in_the_middle_of_a_stream(down_s: float, endpoint: str) -> None:
    """Within 2 s of its return every event is there or named in a gap, the alarms are right, and nobody was called gone."""
    config = BusConfig(connect=(endpoint,), scouting=False)
    stop = threading.Event()
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(router_at(endpoint))
        one, two = (stack.enter_context(open_bus(config)) for _ in range(2))
        logger = stack.enter_context(EventLogger("plc1", bus=one))
        listener = stack.enter_context(Listener(two, target="plc1", with_state=True))
        assert listener.wait_for_beat(logger.session, timeout_s=30)
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, source=Source(name="MAIN")).alarm
        assert alarm is not None

        def stream() -> None:
            number = 0
            while not stop.wait(0.002):
                logger.send_message(CLASS, number % 1000, Severity.INFO, source=Source(name="MAIN"))
                if number % 10 == 0:
                    (logger.clear_alarm if logger.is_raised(alarm) else logger.raise_alarm)(alarm)
                number += 1

        sender = threading.Thread(target=stream)
        sender.start()
        stack.callback(sender.join)
        stack.callback(stop.set)
        assert len(listener.take(200, 30)) == 200
        router.kill()
        time.sleep(down_s)
        stack.enter_context(router_at(endpoint))
        stop.set()
        sender.join()
        items: list[Item] = []

        def complete() -> bool:
            items.extend(taken(listener))
            return accounted(items) + 200 >= logger.publisher.seq

        assert eventually(complete, CONVERGE_S)
        assert accounted(items) + 200 == logger.publisher.seq
        assert listener.table.state() == logger.book.logbook.table.state()
        assert [item for item in items if not isinstance(item, Event | Gap)] == [BusLost(), BusBack()]
        assert listener.counters.missing == sum(item.missing.count for item in items if isinstance(item, Gap))
        assert listener.counters.repaired > 0


def test_a_logger_that_dies_with_the_router_is_gone_when_the_bus_is_back(endpoint: str) -> None:
    """While the bus is lost nobody is called gone; who does not come back with it is, and its alarms are suspect."""
    serve = ("serve", "--target", "plc1", "--connect", endpoint)
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(router_at(endpoint))
        logger = stack.enter_context(program(*serve))
        assert "is ready" in logger.line()
        bus = stack.enter_context(open_bus(BusConfig(connect=(endpoint,), scouting=False)))
        proxy = stack.enter_context(LoggerProxy(bus, "plc1", timeout_s=30))
        alarm = proxy.create_alarm(CLASS, 1, Severity.ERROR, source=Source(name="MAIN")).alarm
        assert alarm is not None
        proxy.raise_alarm(alarm)
        listener = stack.enter_context(Listener(bus, target="plc1", with_state=True))
        assert listener.wait_for_beat(timeout_s=30)
        router.kill()
        logger.kill()
        assert notice(listener) == BusLost()
        assert [alarm.suspect for alarm in listener.alarms] == [False]
        stack.enter_context(router_at(endpoint))
        assert notice(listener) == BusBack()
        gone = notice(listener)
        assert isinstance(gone, LoggerGone)
        assert not gone.clean
        assert notice(listener) == TailUnknown("plc1", gone.session)
        assert [alarm.suspect for alarm in listener.alarms] == [True]


def test_a_logger_that_dies_alone_is_gone_and_comes_back(bus_config: BusConfig, tmp_path: Path) -> None:
    """Its alarms are suspect until it is back and their source has spoken; the bus was never lost."""
    serve = ("serve", "--target", "plc1", "--cache", str(tmp_path / "plc1.db"), "--scouting-group", bus_config.scouting_group)
    with open_bus(bus_config) as bus, Listener(bus, target="plc1", with_state=True) as listener:
        proxy = LoggerProxy(bus, "plc1", timeout_s=30)
        with program(*serve) as logger:
            assert "is ready" in logger.line()
            assert listener.wait_for_beat(timeout_s=30)
            alarm = proxy.create_alarm(CLASS, 1, Severity.ERROR, source=Source(name="MAIN")).alarm
            assert alarm is not None
            proxy.raise_alarm(alarm)
            assert len(listener.take(1, 30)) == 1
            logger.kill()
        gone = notice(listener)
        assert isinstance(gone, LoggerGone)
        assert not gone.clean
        assert notice(listener) == TailUnknown("plc1", gone.session)
        assert [alarm.suspect for alarm in listener.alarms] == [True]
        with program(*serve) as logger:
            assert "is ready" in logger.line()
            back = notice(listener)
            assert isinstance(back, LoggerBack)
            assert back.session != gone.session
            proxy.clear_alarm(alarm)
            proxy.raise_alarm(alarm)
            assert len(listener.take(2, 30)) == 2
            assert [alarm.suspect for alarm in listener.alarms] == [False]
            logger.signal(signal.SIGTERM)
            logger.process.wait(30)
        assert isinstance(listener.get(30), AlarmDisposed)
        assert notice(listener) == LoggerGone("plc1", back.session, True)


SOURCE = f"""
import sys
from bridge import BusConfig, LoggerProxy, Severity, Source, open_bus
config = BusConfig(connect=(sys.argv[1],), scouting=False)
with open_bus(config) as bus, LoggerProxy(bus, "plc1", timeout_s=60) as proxy:
    for number in range(2):
        proxy.raise_alarm(proxy.create_alarm("{CLASS}", number, Severity.ERROR, source=Source(name="MAIN")).alarm)
        print("raised", flush=True)
        sys.stdin.readline()
"""


def test_sources_outlive_the_router(endpoint: str) -> None:
    """While it is gone nobody dies; a source that is still there afterwards is trusted all along, until it is killed itself."""
    config = BusConfig(connect=(endpoint,), scouting=False)
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(router_at(endpoint))
        one, two = (stack.enter_context(open_bus(config)) for _ in range(2))
        logger = stack.enter_context(EventLogger("plc1", bus=one))
        listener = stack.enter_context(Listener(two, target="plc1", with_state=True))
        assert listener.wait_for_beat(logger.session, timeout_s=30)
        source = stack.enter_context(program(endpoint, code=SOURCE))
        assert source.line() == "raised"
        router.kill()
        assert notice(listener) == BusLost()
        stack.enter_context(router_at(endpoint))
        assert notice(listener) == BusBack()
        source.tell()
        assert source.line() == "raised"
        source.kill()
        told = notice(listener)
        assert isinstance(told, SuspectsChanged)
        assert sorted(key.event_id for key in told.suspects) == [0, 1]
        assert logger.book.logbook.marks == 1


def notice(listener: Listener) -> Item | None:
    """The next that is no event."""
    while isinstance(item := listener.get(30), Event):
        pass
    return item


def taken(listener: Listener) -> list[Item]:
    """What is there now."""
    items = []
    while (item := listener.get(0)) is not None:
        items.append(item)
    return items


def accounted(items: list[Item]) -> int:
    """How many events there are, with those that a gap names."""
    return sum(item.missing.count if isinstance(item, Gap) else isinstance(item, Event) for item in items)
