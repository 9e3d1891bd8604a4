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
from tests.e2e.fault_stories import program

FLUSH_MS = 250.0
TRANSITION_MS = 50.0
BUSY_MS = 2000.0
"""What a machine that runs other tests beside this one may add; the slow ones run alone."""
ROOM = 4_000_000

RECORDER = """
import array, mmap, sys, threading
from bridge import Recorder, open_bus
from bridge.core.events import MessageSent
from bridge.edges.bus import BusConfig
from bridge.notices import Heard
from bridge.recorder import Split
split = Split(size_bytes=100_000)
with open(sys.argv[3], "r+b") as file, mmap.mmap(file.fileno(), 0) as memory, memoryview(memory).cast("q") as noted:
    with open_bus(BusConfig(scouting_group=sys.argv[1])) as bus, Recorder(bus, sys.argv[2], split=split) as recorder:
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
    ("kills", "rate", "busy_ms"),
    [
        (1, 20_000, BUSY_MS),
        pytest.param(20, 20_000, 0.0, marks=pytest.mark.slow),
        pytest.param(8, 1000, 0.0, marks=pytest.mark.slow),
    ],
)
def test_a_recorder_that_is_killed_at_random_moments(
    kills: int, rate: int, busy_ms: float, bus_config: BusConfig, tmp_path: Path
) -> None:
    """At most the flush interval of messages is lost, no transition older than 50 ms, and the next start recovers the file.

    The recorder splits its files, so that some kills hit it between two.

    At 20,000 events/s chunks get full faster than the flush interval, at 1,000 it is the timer that writes them.
    """
    seed = random.randrange(2**32)
    sys.stdout.write(f"seed {seed}\n")
    moments = random.Random(seed)
    folder = tmp_path / "night"
    ages: list[tuple[float, float]] = []
    recorded: list[tuple[set[Path], list[int]]] = []
    with program(bus_config.scouting_group, str(rate), code=PLANT) as plant:
        assert plant.line() == "running"
        for number in range(kills + 1):
            notes = tmp_path / f"arrivals{number}"
            with open(notes, "wb") as file:
                file.truncate(8 * ROOM)
            with program(bus_config.scouting_group, str(folder), str(notes), code=RECORDER) as recorder:
                assert recorder.line() == "recording"
                if number == kills:
                    recorder.tell()
                    assert recorder.process.wait(60) == 0
                    break
                time.sleep(moments.uniform(0.3, 1.5))
                killed_ns = time.time_ns()
                recorder.kill()
            noted = array("q", notes.read_bytes())
            assert sum(1 for arrival_ns in noted if arrival_ns) > rate / 20
            left = [path for path in leftovers(folder) if not path.with_suffix("").exists()]  # one may have both names
            assert 1 <= len(left) <= 2  # two when it is killed while it finishes one
            new = sorted({*folder.glob("*.mcap"), *left}.difference(*(paths for paths, _ in recorded)))
            readable = [place for path in new for place in places(path)]
            assert len(set(readable)) == len(readable)
            recorded.append(({path.with_suffix("") if path in left else path for path in new}, readable))
            ages.append(lost_ms(set(readable), noted, killed_ns))
        plant.tell()
    sys.stdout.write(f"lost before the kill, ms of messages and of transitions: {ages}\n")
    assert leftovers(folder) == []
    for paths, readable in recorded:
        assert [place for path in sorted(paths) for place in places(path)] == readable
        assert [summary(path).complete for path in sorted(paths)[:-2]] == ["yes"] * max(0, len(paths) - 2)
    assert max(messages for messages, _ in ages) <= FLUSH_MS + busy_ms
    assert max(transitions for _, transitions in ages) <= TRANSITION_MS + busy_ms
