"""A recorder is killed at random moments under load: what it had is lost for a flush interval at most, and is recovered.

The recorder notes in shared memory when each event came out of the bus, which survives its death; what a file lacks is compared
with that.
"""

import random
import sys
import time
from array import array
from pathlib import Path

import pytest

from bridge.core.events import MessageSent
from bridge.edges.bus import BusConfig
from bridge.edges.recording import RecordedEvent, leftovers, read_events, summary
from tests.e2e.fault_stories import eventually, program

FLUSH_MS = 250.0
TRANSITION_MS = 50.0
ROOM = 4_000_000

RECORDER = """
import array, mmap, sys, threading
from bridge import Recorder, open_bus
from bridge.core.events import MessageSent
from bridge.edges.bus import BusConfig
from bridge.notices import Heard
with open(sys.argv[3], "r+b") as file, mmap.mmap(file.fileno(), 0) as memory, memoryview(memory).cast("q") as noted:
    with open_bus(BusConfig(scouting_group=sys.argv[1])) as bus, Recorder(bus, sys.argv[2]) as recorder:
        inbox = recorder.listener._inbox
        put = inbox.put
        def noting(items):
            for item in items:
                if isinstance(item, Heard):
                    event = item.event
                    noted[event.event_id if isinstance(event, MessageSent) else -event.seq] = item.arrival_ns
            put(items)
        inbox.put = noting
        assert recorder.listener.wait_for_beat(count=2)
        print("recording", flush=True)
        sys.stdin.readline()
"""

PLANT = """
import sys, threading, time
from bridge import EventLogger, Publisher, Severity, open_bus
from bridge.edges.bus import BusConfig
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
rate = int(sys.argv[2])
with open_bus(BusConfig(scouting_group=sys.argv[1])) as bus, EventLogger("plc1", bus=bus) as logger:
    with Publisher(bus, "plc2") as publisher:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR).alarm
        print("running", flush=True)
        ended = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
        started_s, number = time.monotonic(), 0
        while not ended.is_set():
            due = int((time.monotonic() - started_s) * rate)
            while number < due:
                number += 1
                publisher.send_message(CLASS, number, Severity.INFO, arguments=(number,))
                if number % (400 if number // rate % 2 else 8000) == 0:  # a second with many transitions, one with few
                    (logger.clear_alarm if logger.is_raised(alarm) else logger.raise_alarm)(alarm)
            time.sleep(0.002)
"""


def places(path: Path) -> list[int]:
    """Where the events of a file are noted in memory: messages from the start, transitions from the end."""
    events = [item.event for item in read_events(path) if isinstance(item, RecordedEvent)]
    return [event.event_id if isinstance(event, MessageSent) else ROOM - event.seq for event in events]


def lost_ms(there: set[int], noted: "array[int]", killed_ns: int) -> tuple[float, float]:
    """How long before the kill the oldest message and the oldest transition came that are not there; 0 for none."""
    ages = [0.0, 0.0]
    for place, arrival_ns in enumerate(noted):
        if 0 < arrival_ns < killed_ns and place not in there:
            ages[place > ROOM // 2] = max(ages[place > ROOM // 2], (killed_ns - arrival_ns) / 1e6)
    return ages[0], ages[1]


@pytest.mark.parametrize(
    ("kills", "rate"),
    [(1, 20_000), pytest.param(20, 20_000, marks=pytest.mark.slow), pytest.param(8, 1000, marks=pytest.mark.slow)],
)
def test_a_recorder_that_is_killed_at_random_moments(kills: int, rate: int, bus_config: BusConfig, tmp_path: Path) -> None:
    """At most the flush interval of messages is lost, no transition older than 50 ms, and the next start recovers the file.

    At 20,000 events/s chunks get full faster than the flush interval, at 1,000 it is the timer that writes them.
    """
    seed = random.randrange(2**32)
    sys.stdout.write(f"seed {seed}\n")
    moments = random.Random(seed)
    folder = tmp_path / "night"
    ages, readable = [], []
    with program(bus_config.scouting_group, str(rate), code=PLANT) as plant:
        assert plant.line() == "running"
        for number in range(kills):
            notes = tmp_path / f"arrivals{number}"
            notes.touch()
            with open(notes, "r+b") as file:
                file.truncate(8 * ROOM)
            with program(bus_config.scouting_group, str(folder), str(notes), code=RECORDER) as recorder:
                assert recorder.line() == "recording"
                time.sleep(moments.uniform(0.3, 1.5))
                killed_ns = time.time_ns()
                recorder.kill()
            noted = array("q", notes.read_bytes())
            (left,) = leftovers(folder)
            readable.append(places(left))
            ages.append(lost_ms(set(readable[-1]), noted, killed_ns))
            assert sum(1 for arrival_ns in noted if arrival_ns) > rate / 20
        notes.unlink()
        notes.touch()
        with open(notes, "r+b") as file:
            file.truncate(8 * ROOM)
        with program(bus_config.scouting_group, str(folder), str(notes), code=RECORDER) as recorder:
            assert recorder.line() == "recording"
            assert leftovers(folder) != []
            recorder.tell()
            assert recorder.process.wait(60) == 0
        plant.tell()
    sys.stdout.write(f"lost before the kill, ms of messages and of transitions: {ages}\n")
    files = sorted(folder.glob("*.mcap"))
    assert eventually(lambda: leftovers(folder) == [])
    assert len(files) == kills + 1
    assert [places(path) for path in files[:-1]] == readable
    assert [summary(path).complete for path in files[:-1]] == ["tail unknown"] * kills
    assert max(messages for messages, _ in ages) <= FLUSH_MS
    assert max(transitions for _, transitions in ages) <= TRANSITION_MS
