"""A part of a recording: just the events that match, from just the chunks that can hold them."""

import io
import random
from pathlib import Path

import pytest
from mcap.records import Channel
from msgspec.structs import replace

from bridge.core import codec
from bridge.core.alarms import fold
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse
from bridge.edges.recording import (
    EVERYTHING,
    Compression,
    Part,
    Recorded,
    RecordedEvent,
    RecordedGap,
    RecordedState,
    RecordingWriter,
    StateFrame,
    read_events,
    scan,
    summary,
)
from bridge.edges.recording.index import IndexFault, read_index
from tests.unit.edges.recording_stories import (
    ABOUT,
    AXIS,
    GAP,
    PUMP,
    START,
    cleared,
    events_of,
    everything,
    kinds,
    message,
    raised,
    record,
    write_story,
)

TARGETS = ("plc1", "plc2")
STEP = 20_000


def write_plant(path: Path, *, events: int = 60, compression: Compression = "zstd") -> list[Recorded]:
    """Two targets, two classes, both encodings, ten events a chunk; the classes change slowly. What reading must give."""
    with RecordingWriter(path, about=ABOUT, compression=compression) as writer:
        for target in TARGETS:
            writer.add_state(StateFrame(realm="live", target=target, session="s1", seq=0), START)
        for number in range(events):
            event = message(number, (AXIS, PUMP)[number // 15 % 2], TARGETS[number % 2])
            record(writer, event, START + STEP * number, (codec.JSON, codec.MSGPACK)[number // 4 % 2])
            if number == 33:
                writer.add_gap(GAP, START + STEP * number + 1)
                writer.add_rejected("tc3/1/live/plc2/event/x", codec.JSON, b"\xff{", "no JSON", START + STEP * number + 2)
            if number % 10 == 9:
                writer.flush()
        record(writer, raised(90), START + STEP * events)
        record(writer, cleared(90), START + STEP * events + 1)
    return everything(path)


def read(path: Path, part: Part) -> list[Recorded]:
    """The part; the index must have been used."""
    with read_events(path, part) as reader:
        items = list(reader)
        assert reader.read_through == ""
        assert reader.damage is None
        return items


def by_hand(items: list[Recorded], part: Part) -> list[Recorded]:
    """The part of what reading everything gave, by the words of its description."""
    end = part.end_ns if part.end_ns is not None else 2**64
    found: list[Recorded] = []
    for item in items:
        if not part.start_ns <= item.log_time_ns < end:
            continue
        match item:
            case RecordedEvent(event=event):
                named = part.classes is None or event.event_class in part.classes
                named &= part.targets is None or event.target in part.targets
                if named and "events" in part.only:
                    found.append(item)
            case RecordedGap():  # of a message of plc1 and AXIS
                named = part.classes is None or AXIS in part.classes
                if named and (part.targets is None or "plc1" in part.targets) and "gaps" in part.only:
                    found.append(item)
            case RecordedState(state=state):
                if "states" in part.only and (part.targets is None or state.target in part.targets):
                    found.append(item)
            case _:
                if "rejected" in part.only:  # its key says nothing
                    found.append(item)
    return found


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_part_is_what_reading_everything_finds(tmp_path: Path, compression: Compression) -> None:
    """Times at, before and behind every edge, with classes, targets and sorts, against the whole list cut by hand."""
    path = tmp_path / "a.mcap"
    items = write_plant(path, compression=compression)
    chance = random.Random(3)
    edges = [0, *(item.log_time_ns + step for item in items for step in (0, 1)), START * 2]
    for case in range(300):
        part = Part(
            start_ns=chance.choice(edges),
            end_ns=chance.choice([None, chance.choice(edges)]),
            classes=chance.choice([None, frozenset({AXIS}), frozenset({AXIS, PUMP}), frozenset()]),
            targets=chance.choice([None, frozenset({"plc2"}), frozenset({"plc1", "plc9"})]),
            only=chance.choice([EVERYTHING.only, frozenset({"events"}), frozenset({"states", "gaps"})]),
        )
        if not part.is_all:
            assert read(path, part) == by_hand(items, part), f"case {case}: {part}"


@pytest.mark.parametrize(
    "text",
    [
        "severity >= error",
        f"event_class = '{PUMP}'",
        f"event_class != '{PUMP}' and severity > info",
        "target = 'plc2' or is_alarm",
        "not (target = 'plc1')",
        "target = 'nobody'",
        "event_id between 7 and 9 or source_name like '%[40]%'",
    ],
)
def test_a_filter_gives_exactly_what_matches(tmp_path: Path, text: str) -> None:
    """The key part of the filter chooses chunks, the rest is asked of each event. Other sorts stay where the key may match."""
    path = tmp_path / "a.mcap"
    write_plant(path)
    expr = parse(text)
    whole = events_of(everything(path))
    with read_events(path, Part(filter=expr, only=frozenset({"events"}))) as reader:
        found = events_of(list(reader))
        assert reader.read_through == ""
    assert found == [event for event in whole if compile_filter(expr)(event)]


def test_only_chunks_that_can_match_are_opened(tmp_path: Path) -> None:
    """With every other chunk overwritten by nonsense the part is still whole: they are not looked at."""
    path = tmp_path / "a.mcap"
    items = write_plant(path, compression="none")
    part = Part(start_ns=START + 15 * STEP, end_ns=START + 19 * STEP, only=frozenset({"events"}))
    wanted = by_hand(items, part)
    data = bytearray(path.read_bytes())
    with open(path, "rb") as file:
        chunks = read_index(file, len(data), lambda channel: True).chunks
        needed = read_index(file, len(data), lambda channel: True, part.start_ns, START + 19 * STEP).chunks
    assert 0 < len(needed) < len(chunks) - 3
    for chunk in chunks:
        if chunk not in needed:
            data[chunk.offset : chunk.offset + chunk.length] = b"\xee" * chunk.length
    path.write_bytes(bytes(data))
    assert read(path, part) == wanted
    assert len(everything(path)) == 0


def test_a_class_is_found_by_the_channels_of_a_chunk(tmp_path: Path) -> None:
    """Chunks without the class are passed over, also when their times match."""
    path = tmp_path / "a.mcap"
    write_plant(path)

    def is_pump(channel: Channel) -> bool:
        return PUMP in channel.topic

    with open(path, "rb") as file:
        every = read_index(file, path.stat().st_size, lambda channel: True).chunks
        pump = read_index(file, path.stat().st_size, is_pump).chunks
    assert len(every) == 7
    assert len(pump) == 4
    assert pump == [every[place] for place in (1, 2, 4, 5)]


def test_damage_in_a_chunk_that_is_needed_is_told(tmp_path: Path) -> None:
    """What stands before it is given, what stands behind it is not, and the place is named."""
    path = tmp_path / "a.mcap"
    write_plant(path, compression="none")
    data = bytearray(path.read_bytes())
    with open(path, "rb") as file:
        chunks = read_index(file, len(data), lambda channel: True).chunks
    data[chunks[2].offset + chunks[2].length - 20] ^= 1
    path.write_bytes(bytes(data))
    with read_events(path, Part(targets=frozenset({"plc1"}), only=frozenset({"events"}))) as reader:
        assert len(list(reader)) == 10
        assert reader.damage is not None
        assert (reader.damage.offset, reader.damage.torn) == (chunks[2].offset, False)


def test_an_index_that_points_elsewhere_loses_nothing_in_silence(tmp_path: Path) -> None:
    """Two chunks of equal length exchanged under an index that is right in itself: their heads tell other times."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, compression="none") as writer:
        for number in range(10, 20):
            record(writer, replace(message(14), seq=number), START + number)
            writer.flush()
    data = bytearray(path.read_bytes())
    with open(path, "rb") as file:
        chunks = read_index(file, len(data), lambda channel: True).chunks
    one, other = chunks[2], chunks[5]
    assert one.length == other.length
    first, second = (bytes(data[place.offset : place.offset + place.length]) for place in (one, other))
    data[one.offset : one.offset + one.length], data[other.offset : other.offset + other.length] = second, first
    path.write_bytes(bytes(data))
    with read_events(path, Part(start_ns=START + 12, end_ns=START + 13)) as reader:
        assert list(reader) == []
        assert reader.damage is not None
        assert (reader.damage.offset, reader.damage.torn) == (one.offset, False)


@pytest.mark.parametrize("place", [-9, -20, -60, -200, -400])
def test_a_damaged_index_is_not_asked(tmp_path: Path, place: int) -> None:
    """The file is read from end to end instead, gives the same, and says why."""
    path = tmp_path / "a.mcap"
    items = write_plant(path)
    data = bytearray(path.read_bytes())
    data[place] ^= 4
    path.write_bytes(bytes(data))
    part = Part(start_ns=START + 10 * STEP, classes=frozenset({PUMP}))
    with read_events(path, part) as reader:
        assert list(reader) == by_hand(items, part)
        assert reader.read_through != ""
        assert reader.truncated


def test_an_unfinished_file_is_read_through(tmp_path: Path) -> None:
    """It has no index yet; the part is cut from what was flushed."""
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for number in range(9):
            record(writer, message(number, (AXIS, PUMP)[number % 2]), START + number)
        writer.flush()
        with read_events(writer.active_path, Part(classes=frozenset({PUMP}), start_ns=START + 3)) as reader:
            assert [event.event_id for event in events_of(list(reader))] == [3, 5, 7]
            assert reader.read_through == "there is no summary"
            assert reader.truncated


def test_every_byte_of_the_summary_is_guarded(tmp_path: Path) -> None:
    """A flip anywhere in it is noticed: the index is not believed, and the same items come by reading through."""
    path = tmp_path / "a.mcap"
    items = write_story(path, events=4)
    data = path.read_bytes()
    start = int.from_bytes(data[-28:-20], "little")
    for place in range(start, len(data)):
        changed = bytearray(data)
        changed[place] ^= 1 << place % 8
        with pytest.raises(IndexFault):
            read_index(io.BytesIO(changed), len(data))
        if place % 100 == 0:
            path.write_bytes(bytes(changed))
            with read_events(path, Part(start_ns=1)) as reader:
                assert list(reader) == items
                assert reader.read_through


def test_another_programs_index_is_not_trusted(tmp_path: Path) -> None:
    """It may have taken events out or put them in any order; the file is read from end to end."""
    path = tmp_path / "a.mcap"
    items = write_plant(path)
    path.write_bytes(path.read_bytes().replace(b"tcbridge/", b"xcbridge/", 1))
    part = Part(targets=frozenset({"plc2"}))
    with read_events(path, part) as reader:
        assert list(reader) == by_hand(items, part)
        assert reader.read_through == "another program wrote it"


def test_who_recorded_is_known_from_the_index_too(tmp_path: Path) -> None:
    """Also when no chunk is read at all."""
    path = tmp_path / "a.mcap"
    write_plant(path)
    with read_events(path, Part(start_ns=START * 2)) as reader:
        assert list(reader) == []
        assert reader.about == ABOUT
        assert [place.name for place in reader.frames.attachments] == ["event.schema.json"]


def test_a_keyframe_of_many_parts_is_whole_or_not_there(tmp_path: Path) -> None:
    """It is of the time of its last part: what begins inside it has it, what ends inside it has not, and nobody loses it."""
    alarms = tuple(fold(raised(number + 1) for number in range(2500)).active())
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        last = writer.add_state(StateFrame(realm="live", target="plc1", session="s", seq=9, alarms=alarms), START)
        record(writer, message(1), START + 10)
    assert kinds(read(path, Part(start_ns=START, only=frozenset({"states"})))) == ["s"]
    for start_ns in range(START, last + 1):
        (state, _) = read(path, Part(start_ns=start_ns))
        assert isinstance(state, RecordedState)
        assert state.state.alarms == alarms
    assert kinds(read(path, Part(start_ns=last + 1))) == ["e"]
    assert kinds(read(path, Part(start_ns=START, end_ns=last))) == []
    assert scan(path).totals == summary(path).totals
