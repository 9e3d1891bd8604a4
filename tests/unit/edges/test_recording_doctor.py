"""What the doctor finds: everything that is made wrong here, and nothing in a recording that is right."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest
from mcap.records import Channel
from mcap.writer import Writer
from msgspec.structs import replace

from bridge.core import codec
from bridge.edges.recording import (
    EventChannel,
    Gap,
    RecordingError,
    RecordingWriter,
    diagnose,
)
from bridge.edges.recording import doctor as doctor_module
from bridge.edges.recording.index import Index, read_index
from bridge.edges.recording.layout import PROFILE
from bridge.edges.recording.tally import Tally, Totals
from tests.unit.edges.recording_stories import ABOUT, AXIS, GAP, PUMP, START, STATE, message, raised, record

KEY = f"tc3/1/live/plc1/event/{AXIS}/message/info"


def numbered(numbers: list[int], path: Path, gaps: tuple[Gap, ...] = (), filter: str = "") -> Path:
    """A recording of one key with these numbers."""
    with RecordingWriter(path, about=replace(ABOUT, filter=filter)) as writer:
        writer.add_state(STATE, START)
        for number in numbers:
            record(writer, replace(message(1), seq=number, key_seq=number), START + number)
            if number % 3 == 0:
                writer.flush()
        for gap in gaps:
            writer.add_gap(gap, START + 1000)
    return path


def faults(path: Path) -> list[str]:
    """What is wrong."""
    return [each.text for each in diagnose(path) if each.fault]


def remarks(path: Path) -> list[str]:
    """What is to know."""
    return [each.text for each in diagnose(path) if not each.fault]


def test_a_recording_that_is_right_has_no_findings(tmp_path: Path) -> None:
    """Whatever is in it."""
    assert diagnose(numbered([1, 2, 3, 4], tmp_path / "a.mcap")) == []
    with RecordingWriter(tmp_path / "b.mcap", about=ABOUT) as writer:
        record(writer, replace(message(1, PUMP), key_seq=7), START, codec.MSGPACK)
        record(writer, raised(5), START + 1)
    assert diagnose(tmp_path / "b.mcap") == []


def test_what_a_recording_says_of_itself_is_a_remark(tmp_path: Path) -> None:
    """Gaps, rejected payloads, unknown tails, parts elsewhere."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, about=replace(ABOUT, previous="0.mcap", part=2)) as writer:
        writer.add_gap(GAP, START)
        writer.add_rejected("x", codec.JSON, b"{", "no JSON", START)
        writer.finish(["s1"], "2.mcap")
    assert faults(path) == []
    assert remarks(path) == [
        "7 events are missing in 1 gaps, as the file says",
        "1 payloads came that were no events",
        "the end of some sessions is not known",
        "0.mcap, a part of the same recording, is not beside it",
        "2.mcap, a part of the same recording, is not beside it",
    ]


@pytest.mark.parametrize(
    ("numbers", "gap", "missing"),
    [
        ([5, 6, 9], None, "7..8"),
        ([5, 6, 9], (7, 8), ""),
        ([5, 6, 9], (7, 7), "8..8"),
        ([1, 9, 5, 6, 7, 2, 3, 4, 8], None, ""),
        ([4, 9, 5], (1, 3), "6..8"),
        ([4], (5, 9), ""),
    ],
)
def test_a_missing_number_needs_a_gap_record(
    tmp_path: Path, numbers: list[int], gap: tuple[int, int] | None, missing: str
) -> None:
    """In whatever order they came; what came before the first is nobody's promise."""
    gaps = () if gap is None else (Gap(session="s1", key=KEY, first_key_seq=gap[0], last_key_seq=gap[1], count=1),)
    found = faults(numbered(numbers, tmp_path / "a.mcap", gaps))
    wanted = f"numbers {missing} of session s1 on {KEY} are missing, and no gap record says so"
    assert found == ([wanted] if missing else [])


def test_a_gap_of_nobody_knows_whom_explains_every_number(tmp_path: Path) -> None:
    """The recorder's own memory was full: it cannot say of which key the events were."""
    gap = Gap(session="", key="", first_key_seq=0, last_key_seq=0, count=3)
    assert faults(numbered([1, 2, 6], tmp_path / "a.mcap", (gap,))) == []


def test_numbers_are_looked_for_only_where_whole_keys_were_recorded(tmp_path: Path) -> None:
    """A filter on what is inside an event leaves holes that are none."""
    assert faults(numbered([1, 5], tmp_path / "a.mcap", filter="event_id = 1")) == []
    assert "not looked for" in remarks(tmp_path / "a.mcap")[0]
    assert len(faults(numbered([1, 5], tmp_path / "b.mcap", filter="severity >= info"))) == 1
    assert "not looked for" in remarks(numbered([1, 5], tmp_path / "c.mcap", filter="of the future ~ 3"))[0]


def test_an_event_that_stands_there_twice_is_a_fault(tmp_path: Path) -> None:
    """A reader would count it twice; of many only some are told one by one."""
    assert faults(numbered([1, 2, 2, 3], tmp_path / "a.mcap")) == ["event 2 of session s1 stands there twice"]
    found = faults(numbered([*range(1, 31), *range(1, 31)], tmp_path / "b.mcap"))
    assert len(found) == 21
    assert found[-1] == "and 10 more: doubled events"


def test_damage_is_a_fault_and_every_bit_is_looked_at(tmp_path: Path) -> None:
    """A flip anywhere is found."""
    path = numbered([1, 2, 3, 4], tmp_path / "a.mcap")
    data = path.read_bytes()
    chance = random.Random(1)
    for _ in range(150):
        changed = bytearray(data)
        changed[chance.randrange(8, len(data))] ^= 1 << chance.randrange(8)
        path.write_bytes(bytes(changed))
        assert faults(path)
    path.write_bytes(data[:-30])
    (fault,) = faults(path)
    assert fault.endswith("the file ends inside its summary")
    path.write_bytes(b"no recording")
    with pytest.raises(RecordingError):
        diagnose(path)


def test_a_summary_that_counts_wrong_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its checksum is right: only who reads the file knows better."""
    right = Tally.totals

    def wrong(tally: Tally, *more: object) -> Totals:
        totals = right(tally)
        return replace(totals, events=totals.events + 1, gaps=totals.gaps + 3)

    monkeypatch.setattr(Tally, "totals", wrong)
    path = numbered([1, 2], tmp_path / "a.mcap")
    monkeypatch.undo()
    assert faults(path) == [
        "the summary tells other events than the file holds",
        "the summary tells other gaps than the file holds",
    ]


def test_an_index_that_tells_otherwise_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A class that the index hides would be lost to who reads by it."""
    path = numbered([1, 2, 3, 4, 5, 6, 7], tmp_path / "a.mcap")

    def forgetful(file: BinaryIO, size: int, takes: Callable[[Channel], bool]) -> Index:
        index = read_index(file, size, takes)
        index.chunks[1] = index.chunks[1]._replace(channels=frozenset())
        index.counts = {channel: count + 1 for channel, count in index.counts.items()}
        return index

    monkeypatch.setattr(doctor_module, "read_index", forgetful)
    found = faults(path)
    assert len(found) == 2
    assert found[0].startswith("the index tells otherwise of the chunk at byte ")
    assert found[1] == "the statistics count other messages than there are"


def foreign(path: Path, write: Callable[[Writer], None], profile: str = "") -> Path:
    """A file of another program."""
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile, "another tool")
        write(writer)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_what_other_programs_write_is_told(tmp_path: Path) -> None:
    """Their channels and order are remarks; entries that are no events, and channels that are not what they say, faults."""
    place = EventChannel("live", "plc1", AXIS, codec.JSON)

    def write(writer: Writer) -> None:
        camera = writer.register_channel("/camera", "protobuf", 0)
        schema = writer.register_schema("other.Event", "jsonschema", b"{}")
        other = writer.register_schema("tcbridge.Event", "jsonschema", b"{}")
        events = writer.register_channel(place.topic, "json", schema, place.metadata())
        moved = writer.register_channel("/elsewhere", "json", other, place.metadata())
        writer.add_message(events, 9, codec.encode(message(1)), 9)
        writer.add_message(camera, 5, b"picture", 5)
        writer.add_message(moved, 6, b"{}", 6)

    path = foreign(tmp_path / "a.mcap", write, PROFILE)
    assert faults(path)[1:] == [
        f"channel {place.topic} has the unknown schema 'other.Event' (jsonschema)",
        f"channel /elsewhere says that it holds what belongs into {place.topic}",
    ]
    assert faults(path)[0].endswith("cannot be read: Object missing required field `kind`")
    assert remarks(path) == [
        "2 entries are not in the order of time",
        "channel /camera is of another program: protobuf",
        "channel /elsewhere has the event schema of another version",
    ]
