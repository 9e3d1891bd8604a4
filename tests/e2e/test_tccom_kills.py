"""A provider of objects is killed or stopped in the middle of calls: what its callers hear, when, and that they go on."""

import contextlib
import signal
import threading
import time
from collections.abc import Iterator
from typing import Protocol

import pytest

from bridge.core.hresult import ADS_E_NOTFOUND, ADS_E_TIMEOUT
from bridge.edges.bus import BusConfig, open_bus
from bridge.tccom import AdsError, Answer, interface
from bridge.tccom.proxy import RemoteObjects
from tests.e2e.fault_stories import WAIT_S, Program, eventually, program

OBJECT_ID = 0x71010001
THREADS = 4
ERROR_S = 2.0
PROVIDER = """
import sys, threading
from typing import Protocol
from bridge import BusConfig, open_bus
from bridge.tccom import Answer, ObjectServer, RegisteredModule, interface
from bridge.tccom.service import ObjectService

@interface("9a1b0c3d-5e6f-4a7b-8c9d-0e1f2a3b4c01")
class IWork(Protocol):
    def double(self, number: int) -> Answer[int]: ...
    def for_ever(self) -> Answer[int]: ...

class Work(RegisteredModule, IWork):
    thread_safe = True
    def double(self, number: int) -> Answer[int]:
        return Answer(2 * number)
    def for_ever(self) -> Answer[int]:
        print("working", flush=True)
        threading.Event().wait()
        return Answer(0)

with (
    open_bus(BusConfig(scouting_group=sys.argv[1])) as bus,
    ObjectServer() as server,
    Work(server, object_id=0x71010001),
    ObjectService(server, bus, "plc1"),
):
    print("ready", flush=True)
    sys.stdin.readline()
"""


@interface("9a1b0c3d-5e6f-4a7b-8c9d-0e1f2a3b4c01")
class IWork(Protocol):
    """As the provider declares it."""

    def double(self, number: int) -> Answer[int]: ...
    def for_ever(self) -> Answer[int]: ...


@contextlib.contextmanager
def provider(config: BusConfig) -> Iterator[Program]:
    """A provider that is ready."""
    with program(config.scouting_group, code=PROVIDER) as started:
        assert started.line() == "ready"
        yield started


class Caller(threading.Thread):
    """Calls through one reference without a pause, and keeps what it heard."""

    def __init__(self, work: IWork) -> None:
        super().__init__()
        self._work = work
        self.stop = threading.Event()
        self.answers = 0
        self.errors: list[tuple[float, int]] = []
        self.longest_s = 0.0
        self.failure: BaseException | None = None

    def run(self) -> None:
        number = 0
        while not self.stop.is_set():
            number += 1
            begun = time.monotonic()
            try:
                assert self._work.double(number).value == 2 * number
                self.answers += 1
            except AdsError as error:
                self.errors.append((time.monotonic(), error.code))
                self.stop.wait(0.005)
            except BaseException as error:
                self.failure = error
                raise
            self.longest_s = max(self.longest_s, time.monotonic() - begun)


@contextlib.contextmanager
def calling(remote: RemoteObjects) -> Iterator[list[Caller]]:
    """Several callers with a reference each, all of which have had answers."""
    with contextlib.ExitStack() as stack:
        callers = [Caller(stack.enter_context(remote.get(OBJECT_ID, IWork))) for _ in range(THREADS)]
        try:
            for caller in callers:
                caller.start()
            assert eventually(lambda: all(caller.answers > 10 for caller in callers))
            yield callers
        finally:
            for caller in callers:
                caller.stop.set()
            for caller in callers:
                caller.join(WAIT_S)
    assert [caller.failure for caller in callers] == [None] * THREADS


def go_on(callers: list[Caller]) -> bool:
    """Whether every caller has more answers than it has now, soon."""
    before = [caller.answers for caller in callers]
    return eventually(lambda: all(caller.answers > count for caller, count in zip(callers, before, strict=True)))


def test_many_callers_hear_of_a_kill_within_two_seconds_and_go_on(bus_config: BusConfig) -> None:
    """Every caller gets an error, no call takes longer, and the same references work when the provider is back; three times."""
    with open_bus(bus_config) as bus, RemoteObjects(bus, "plc1") as remote, contextlib.ExitStack() as stack:
        there = stack.enter_context(provider(bus_config))
        callers = stack.enter_context(calling(remote))
        for _ in range(3):
            for caller in callers:
                caller.errors.clear()
            there.kill()
            killed = time.monotonic()
            assert eventually(lambda: all(caller.errors for caller in callers))
            assert all(caller.errors[0][0] - killed < ERROR_S for caller in callers)
            assert {code for caller in callers for _, code in caller.errors} <= {ADS_E_NOTFOUND, ADS_E_TIMEOUT}
            there = stack.enter_context(provider(bus_config))
            assert go_on(callers)
        assert max(caller.longest_s for caller in callers) < ERROR_S


def test_a_call_that_is_under_way_ends_with_its_provider(bus_config: BusConfig) -> None:
    """However long the caller would wait: it is told that the provider is gone, and that what became of the call is unknown."""
    with open_bus(bus_config) as bus, RemoteObjects(bus, "plc1", timeout_s=WAIT_S) as remote, provider(bus_config) as there:
        with remote.get(OBJECT_ID, IWork) as work:
            heard: list[AdsError] = []

            def call() -> None:
                with pytest.raises(AdsError) as caught:
                    work.for_ever()
                heard.append(caught.value)

            caller = threading.Thread(target=call)
            caller.start()
            assert there.line() == "working"
            there.kill()
            caller.join(ERROR_S)
            assert [error.code for error in heard] == [ADS_E_TIMEOUT]
        caller.join(WAIT_S)


def test_a_stopped_provider_is_a_timeout_and_goes_on(bus_config: BusConfig) -> None:
    """SIGSTOP: nobody knows that it is stopped; calls end all the same, and work again after SIGCONT."""
    with (
        open_bus(bus_config) as bus,
        RemoteObjects(bus, "plc1") as remote,
        provider(bus_config) as there,
        calling(remote) as callers,
    ):
        there.signal(signal.SIGSTOP)
        stopped = time.monotonic()
        assert eventually(lambda: all(caller.errors for caller in callers))
        assert all(caller.errors[0][0] - stopped < ERROR_S for caller in callers)
        assert {code for caller in callers for _, code in caller.errors} <= {ADS_E_NOTFOUND, ADS_E_TIMEOUT}
        there.signal(signal.SIGCONT)
        assert go_on(callers)
        assert max(caller.longest_s for caller in callers) < ERROR_S
