"""Listeners are stopped while events flow: others and sender go on; who was stopped ends with all, or the number lost."""

import contextlib
import json
import signal
import threading
import time

import pytest

from bridge.core.events import Severity, Source
from bridge.edges.bus import BusConfig, open_bus
from bridge.edges.cache import Cache
from bridge.logger import EventLogger
from tests.e2e.fault_stories import CLASS, Program, program

EVENTS = 20_000
TEXT = "x" * 1000
"""20 MB in all: more than the sockets hold for who does not read, less than the ring."""
SEND_S = 0.05
DELAY_PER_STOPPED_S = 1.0
DELAY_S = 0.5

LISTEN = """
import json, sys, threading, time
from bridge.core.events import Event
from bridge.edges.bus import BusConfig, open_bus
from bridge.listener import Gap, Listener
with open_bus(BusConfig(scouting_group=sys.argv[1])) as bus, Listener(
    bus, target="plc1", with_state=True, queue_events=200_000
) as listener:
    assert listener.wait_for_beat(timeout_s=60)
    print("ready", flush=True)
    session = ""
    count = last = worst_ns = 0
    numbers = set()
    gaps = 0
    told = threading.Event()
    def end():
        global last
        last = int(sys.stdin.readline())
        told.set()
    threading.Thread(target=end, daemon=True).start()
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline and not (told.is_set() and len(numbers) + gaps >= last and listener.snapshot()):
        item = listener.get(0.05)
        if isinstance(item, Event):
            numbers.add(item.seq)
            count += 1
            worst_ns = max(worst_ns, time.time_ns() - item.time_ns)
        elif isinstance(item, Gap):
            gaps += item.missing.count
    table = listener.table.alarms
    state = sorted((key.event_id, alarm.raised, alarm.time_raised_ns, alarm.time_cleared_ns) for key, alarm in table.items())
    said = {"count": count, "different": len(numbers), "gaps": gaps, "worst_ns": worst_ns, "state": state}
    print(json.dumps({**said, "repaired": listener.counters.repaired}), flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("stopped", "stop_s"), [(1, 4.0), (1, 9.0), (1, 20.0), (3, 9.0)])
def test_stopped_listeners_cost_the_others_nothing(stopped: int, stop_s: float, bus_config: BusConfig) -> None:
    """send() stays short, the healthy one has all in time, the stopped ones all or exact gaps, and the right alarms."""
    with contextlib.ExitStack() as stack:
        bus = stack.enter_context(open_bus(bus_config))
        logger = stack.enter_context(EventLogger("plc1", bus=bus, on_full="drop", cache=Cache(max_bytes=200_000_000)))
        group = bus_config.scouting_group
        listeners = [stack.enter_context(program(group, code=LISTEN)) for _ in range(1 + stopped)]
        assert [listener.line() for listener in listeners] == ["ready"] * (1 + stopped)
        alarms = [logger.create_alarm(CLASS, number, Severity.ERROR, source=Source(name="MAIN")).alarm for number in range(10)]
        for victim in listeners[1:]:
            victim.signal(signal.SIGSTOP)
        resume = threading.Timer(stop_s, _resume, (listeners[1:],))
        resume.start()
        stack.callback(resume.cancel)
        longest_s = 0.0
        pause = threading.Event()
        for number in range(EVENTS):
            started_s = time.perf_counter()
            if number % 100 == 0 and (alarm := alarms[number // 100 % 10]) is not None:
                (logger.clear_alarm if logger.is_raised(alarm) else logger.raise_alarm)(alarm)
            else:
                logger.send_message(CLASS, number % 1000, Severity.INFO, source=Source(name="MAIN"), json_attribute=TEXT)
            longest_s = max(longest_s, time.perf_counter() - started_s)
            if number % 20 == 19:
                pause.wait(min(0.8 * stop_s, 8.0) * 20 / EVENTS)  # so that they flow while it is stopped, not before
        resume.join()
        for listener in listeners:
            listener.tell(str(logger.publisher.seq))
        healthy, *victims = [json.loads(listener.line()) for listener in listeners]
        state = sorted(
            [key.event_id, alarm.raised, alarm.time_raised_ns, alarm.time_cleared_ns]
            for key, alarm in logger.book.alarms.items()
        )
        assert (healthy["different"], healthy["gaps"]) == (EVENTS, 0)
        assert healthy["worst_ns"] / 1e9 < DELAY_PER_STOPPED_S * stopped + DELAY_S
        assert longest_s < SEND_S
        for victim in victims:
            assert victim["different"] + victim["gaps"] == EVENTS
        for each in (healthy, *victims):
            assert each["count"] == each["different"]
            assert each["state"] == state
        assert logger.publisher.counters.dropped == 0


def _resume(victims: list[Program]) -> None:
    for victim in victims:
        victim.signal(signal.SIGCONT)
