"""A recording of many events: what each step takes, beside plain mcap with msgspec on the same bytes in the same run.

    python benches/recording.py [--events 1000000] [--keep FOLDER]

One process per step, started from a small one, so that a peak of memory is that of the step. The events are of 100 classes
whose share of the recording differs by a factor of 50, a tenth of them alarm transitions, flushed each 100 events, as a
recorder at 20,000 events/s does. "plain" writes the same bytes with the library's writer in its default settings, and reads
with its reader and one decoder of our structs: no checks of events, times, order or checksums of the file, no counts.

    write                  RecordingWriter.add() of bytes that exist        plain: Writer.add_message()
    write, with texts      the same with what viewers show beside the events
    convert                convert() of the file without it
    info                   summary()
    read                   read_events() to the end                         plain: make_reader().iter_messages(), decoded
    read 1 % by class      read_events() of one class, 1 % of the events    plain: the same with topics=
    read 1 % by time       read_events() of a hundredth of the time         plain: the same with starting_at=, ending_before=
    replay                 replay_into() a fresh logger's book, in a file
    state at 90 %          standing_at()
    cut 1 %                copy_part() of a hundredth of the time

Only the ratios mean something: machines and hours differ.
"""

import argparse
import itertools
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from mcap.reader import make_reader
from mcap.writer import Writer

from bridge.core import codec
from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import AlarmCleared, AlarmRaised, AnyEvent, MessageSent, Severity
from bridge.core.keys import EventKey
from bridge.edges.recording import (
    EventChannel,
    Part,
    RecordedEvent,
    RecordingWriter,
    StateFrame,
    Viewer,
    convert,
    copy_part,
    read_events,
    standing_at,
    summary,
)

START_NS = 1_795_300_000_000_000_000
STEP_NS = 50_000
FLUSH_EVENTS = 100  # 5 ms at 20,000 events/s: there is a transition in each
CLASSES = [f"54cc5482-ad79-4cdc-8c3e-{number:012x}" for number in range(100)]
ONE_PERCENT = CLASSES[1]


def class_of(number: int) -> str:
    """Of 100 events one is of the second class, the first and some others have more, the rest share what is left."""
    place = number % 100
    return ONE_PERCENT if place == 7 else CLASSES[0] if place < 50 else CLASSES[2 + (number * 31) % 98]


def made(count: int) -> Iterator[tuple[int, AnyEvent]]:
    """The events and when they arrive; an alarm comes or goes at each tenth."""
    dice = random.Random(1)
    up: set[int] = set()
    for number in range(count):
        arrival = START_NS + number * STEP_NS
        if number % 10 == 9:
            which = dice.randrange(500)
            kind = AlarmCleared if which in up else AlarmRaised
            up ^= {which}
            yield (
                arrival,
                kind(
                    target="plc1",
                    event_class=CLASSES[99],
                    event_id=which,
                    severity=Severity.ERROR,
                    session="s1",
                    seq=number + 1,
                    key_seq=number // 10 + 1,
                    time_ns=arrival,
                    source_name=f"MAIN.fbStation{which}",
                    raised=kind is AlarmRaised,
                    time_raised_ns=arrival,
                    time_cleared_ns=0 if kind is AlarmRaised else arrival,
                ),
            )
            continue
        yield (
            arrival,
            MessageSent(
                target="plc1",
                event_class=class_of(number),
                event_id=number % 50,
                severity=Severity(number % 5),
                session="s1",
                seq=number + 1,
                key_seq=number + 1,
                time_ns=arrival,
                source_id=0x08502000,
                source_name=f"MAIN.fbStation{dice.randrange(30)}",
                arguments=(Argument.of(dice.randrange(1000)), Argument.of(dice.random()), Argument.of("axis")),
                json_attribute='{"axis":3,"unit":"mm","limit":250.5}',
            ),
        )


def batches(count: int) -> Iterator[list[tuple[int, AnyEvent, bytes]]]:
    """The same as a recorder gets them, some thousand at a time, with their bytes."""
    events = made(count)
    while batch := list(itertools.islice(events, 10_000)):
        yield [(arrival, event, codec.encode(event)) for arrival, event in batch]


def write(folder: Path, count: int) -> tuple[int, float]:
    """Ours. What it takes to make the events is not counted."""
    return _write(folder / "ours.mcap", count, None)


def viewer() -> Viewer:
    """A text with three arguments for each event."""
    entries = {number: EventEntry(number, "Moved", Severity.INFO, "Axis {0} moved {1,f} mm of {2}") for number in range(500)}
    known = Catalog(EventClass(guid, f"Class{number}", "Class", entries) for number, guid in enumerate(CLASSES))
    return Viewer(lambda event: known, own=known)


def _write(path: Path, count: int, eyes: Viewer | None) -> tuple[int, float]:
    spent = 0.0
    with RecordingWriter(path, viewer=eyes) as writer:
        writer.add_state(StateFrame(realm="live", target="plc1", session="s1", seq=0), START_NS - 1)
        for batch in batches(count):
            began = time.perf_counter()
            for number, (arrival, event, element) in enumerate(batch):
                key = EventKey("live", event.target, event.event_class, event.is_alarm, event.severity)
                writer.add(element, codec.JSON, key, event, arrival)
                if number % FLUSH_EVENTS == 0:
                    writer.flush()
            spent += time.perf_counter() - began
        began = time.perf_counter()
        writer.finish()
    return count, spent + time.perf_counter() - began


def write_plain(folder: Path, count: int) -> tuple[int, float]:
    """The library's writer as it is."""
    spent = 0.0
    with open(folder / "plain.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for batch in batches(count):
            began = time.perf_counter()
            for arrival, event, element in batch:
                channel = channels.get(event.event_class)
                if channel is None:
                    place = EventChannel("live", event.target, event.event_class, codec.JSON)
                    channel = channels[event.event_class] = writer.register_channel(place.topic, "json", 0, place.metadata())
                writer.add_message(channel, arrival, element, event.time_ns, event.key_seq)
            spent += time.perf_counter() - began
        began = time.perf_counter()
        writer.finish()  # type: ignore[no-untyped-call]
    return count, spent + time.perf_counter() - began


def timed(work: Callable[[], int]) -> tuple[int, float]:
    """How many, and seconds."""
    began = time.perf_counter()
    return work(), time.perf_counter() - began


def middle(count: int) -> tuple[int, int]:
    """A hundredth of the time, from 60 % on."""
    return START_NS + count * 6 // 10 * STEP_NS, START_NS + (count * 6 // 10 + count // 100) * STEP_NS


def read_ours(folder: Path, part: Part) -> int:
    """Events of a part."""
    with read_events(folder / "ours.mcap", part) as reader:
        found = sum(isinstance(item, RecordedEvent) for item in reader)
        assert part.is_all or not reader.read_through
        return found


def read_plain(folder: Path, topics: str = "", start_ns: int = 0, end_ns: int = 0) -> int:
    """The same with the library's reader."""
    decode = msgspec.json.Decoder(AnyEvent).decode
    with open(folder / "plain.mcap", "rb") as file:
        window = {"starting_at": start_ns, "ending_before": end_ns} if end_ns else {}
        messages = make_reader(file).iter_messages(topics=topics or None, **window)  # type: ignore[arg-type]
        return sum(decode(message.data) is not None for _, _, message in messages)


def replay(folder: Path) -> int:
    """Into the cache file of a fresh logger."""
    from bridge.edges.cache import Cache
    from bridge.logger import Book
    from bridge.replayer import replay_into

    with Book(None, Cache(folder / "fresh.db", max_bytes=sys.maxsize)) as book:
        report = replay_into([folder / "ours.mcap"], book)
        book.flush(60.0)
        return report.events


def state(folder: Path, count: int) -> int:
    """How many alarms are active after nine tenths."""
    return len(standing_at([folder / "ours.mcap"], START_NS + count * 9 // 10 * STEP_NS).active())


def cut(folder: Path, count: int) -> int:
    """A hundredth as a new file."""
    start_ns, end_ns = middle(count)
    return copy_part([folder / "ours.mcap"], folder / "part.mcap", Part(start_ns=start_ns, end_ns=end_ns)).events


def topic() -> str:
    """Of the class that has one in a hundred events."""
    return EventChannel("live", "plc1", ONE_PERCENT, codec.JSON).topic


STEPS: dict[str, Callable[[Path, int], tuple[int, float]]] = {
    "write": write,
    "write, plain": write_plain,
    "write, with texts": lambda folder, count: _write(folder / "texts.mcap", count, viewer()),
    "convert": lambda folder, count: timed(lambda: convert(folder / "ours.mcap", folder / "converted.mcap", viewer()).events),
    "info": lambda folder, count: timed(lambda: summary(folder / "ours.mcap").totals.events),
    "read": lambda folder, count: timed(lambda: read_ours(folder, Part())),
    "read, plain": lambda folder, count: timed(lambda: read_plain(folder)),
    "read 1 % by class": lambda folder, count: timed(lambda: read_ours(folder, Part(classes=frozenset((ONE_PERCENT,))))),
    "read 1 % by class, plain": lambda folder, count: timed(lambda: read_plain(folder, topic())),
    "read 1 % by time": lambda folder, count: timed(
        lambda: read_ours(folder, Part(start_ns=middle(count)[0], end_ns=middle(count)[1]))
    ),
    "read 1 % by time, plain": lambda folder, count: timed(lambda: read_plain(folder, "", *middle(count))),
    "replay": lambda folder, count: timed(lambda: replay(folder)),
    "state at 90 %": lambda folder, count: timed(lambda: state(folder, count)),
    "cut 1 %": lambda folder, count: timed(lambda: cut(folder, count)),
}
PEAK = """
import os, sys
child = os.spawnv(os.P_NOWAIT, sys.executable, [sys.executable, *sys.argv[1:]])
_, status, used = os.wait4(child, 0)
print(used.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def step(name: str, folder: Path, count: int) -> tuple[int, float, float]:
    """Run one step in its own process: how many, seconds, peak memory in MB."""
    command = [sys.executable, "-c", PEAK, __file__, "--events", str(count), "--keep", str(folder), "--step", name]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    told, peak = done.stdout.splitlines()
    number, seconds = json.loads(told)
    return number, seconds, int(peak) / 1024


def main() -> None:
    """All steps, one line each, ours before the plain one with the ratio."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--events", type=int, default=1_000_000)
    arguments.add_argument("--keep", type=Path)
    arguments.add_argument("--step", help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.step:
        print(json.dumps(STEPS[given.step](given.keep, given.events)))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        print(f"{'':26}{'count':>12}{'seconds':>10}{'per s':>12}{'peak MB':>10}{'of plain':>10}")
        found = {}
        for name in STEPS:
            found[name] = number, seconds, peak = step(name, folder, given.events)
            against = ""
            if name.endswith(", plain"):
                ours = found[name.removesuffix(", plain")]
                assert ours[0] == number, f"{name}: {ours[0]} against {number}"
                against = f"{seconds / ours[1]:9.2f}x"
            print(f"{name:26}{number:12,}{seconds:10.3f}{number / seconds:12,.0f}{peak:10.0f}{against:>10}", flush=True)
        names = ("ours", "plain", "texts")
        sizes = [os.path.getsize(folder / f"{name}.mcap") / given.events for name in names]
        print(f"bytes per event: {sizes[0]:.1f}, plain {sizes[1]:.1f}, with texts {sizes[2]:.1f}")


if __name__ == "__main__":
    main()
