"""What is read: everything, in order, from our files and from those of other tools."""

import random
from pathlib import Path

import msgspec
import pytest
from mcap.writer import Writer

from bridge.core import codec
from bridge.core.events import Limits
from bridge.edges.recording import (
    EventChannel,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    RecordingError,
    RecordingWriter,
    read_events,
)
from bridge.edges.recording import reader as reader_module
from bridge.edges.recording.layout import PROFILE, StatePart
from tests.unit.edges.recording_stories import (
    ABOUT,
    AXIS,
    GAP,
    PUMP,
    START,
    STATE,
    cleared,
    events_of,
    everything,
    kinds,
    message,
    raised,
    record,
    write_story,
)

CHANNEL = EventChannel("live", "plc1", AXIS, codec.JSON)


def foreign(path: Path, times: list[list[int]], *, chunked: bool = True, profile: str = "") -> None:
    """A file as another tool writes it: one chunk per list of log times, event ids counting up in file order."""
    with open(path, "wb") as file:
        writer = Writer(file, use_chunking=chunked)
        writer.start(profile, "another tool")
        other = writer.register_channel("/camera", "protobuf", 0)
        channel = writer.register_channel(CHANNEL.topic, "json", 0, CHANNEL.metadata())
        number = 0
        for chunk in times:
            for time in chunk:
                writer.add_message(channel, time, codec.encode(message(number)), time)
                number += 1
            writer.add_message(other, chunk[-1], b"\x00picture", chunk[-1])
            writer.flush()  # type: ignore[no-untyped-call]
        writer.finish()  # type: ignore[no-untyped-call]


def ids(path: Path) -> list[int]:
    """The event ids in the order in which they are read."""
    return [event.event_id for event in events_of(everything(path))]


def test_everything_comes_back_in_its_place(tmp_path: Path) -> None:
    """Keyframe, events of both encodings, gap and rejected payload, in the order in which they were recorded."""
    items = write_story(tmp_path / "a.mcap")
    assert "".join(kinds(items)) == "s" + "e" * 12 + "egre"
    assert events_of(items) == [*(message(n, (AXIS, PUMP)[n % 2]) for n in range(12)), raised(90), cleared(90)]
    state, event, gap, rejected = items[0], items[1], items[-3], items[-2]
    assert isinstance(state, RecordedState)
    assert isinstance(event, RecordedEvent)
    assert isinstance(gap, RecordedGap)
    assert isinstance(rejected, RecordedRejected)
    assert (state.log_time_ns, state.state) == (START, STATE)
    assert (event.log_time_ns, event.publish_time_ns, event.realm) == (START + 1, START, "live")
    assert (event.encoding, event.element) == (codec.JSON, codec.encode(message(0)))
    assert gap.gap == GAP
    assert (rejected.rejected.payload, rejected.rejected.reason, rejected.rejected.size) == (b"\xff{", "no JSON", 2)


def test_a_whole_file_is_not_truncated_and_tells_who_recorded_it(tmp_path: Path) -> None:
    """`about` is known from the first item on."""
    write_story(tmp_path / "a.mcap")
    with read_events(tmp_path / "a.mcap") as reader:
        next(reader)
        assert reader.about == ABOUT
        assert len(list(reader)) == 16
        assert not reader.truncated
        assert reader.damage is None


def test_an_empty_recording_is_empty(tmp_path: Path) -> None:
    """Opened and finished, nothing in between."""
    with RecordingWriter(tmp_path / "a.mcap"):
        pass
    assert everything(tmp_path / "a.mcap") == []


def test_an_active_file_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    """What was flushed is there, and the reader says that the file has no end yet."""
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        for number in range(5):
            record(writer, message(number), START)
        writer.flush()
        record(writer, message(5), START)
        with read_events(writer.active_path) as reader:
            assert [event.event_id for event in events_of(list(reader))] == [0, 1, 2, 3, 4]
            assert reader.truncated
            assert reader.damage is not None
            assert reader.damage.torn


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"SQLite format 3\x00" * 10, b"{}" * 100])
def test_a_file_that_is_no_recording_is_refused_clearly(tmp_path: Path, content: bytes) -> None:
    """The error names the file and says what is wrong with it."""
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"a\.mcap: is (empty|no MCAP file)"):
        read_events(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    """As every other error of a recording."""
    with pytest.raises(RecordingError, match=r"none\.mcap: No such file"):
        read_events(tmp_path / "none.mcap")
    with pytest.raises(RecordingError, match="directory"):
        read_events(tmp_path)


def test_an_element_that_is_no_event_is_shown_not_hidden(tmp_path: Path) -> None:
    """A channel that claims to hold events but holds something else gives rejected items with key and reason."""
    path = tmp_path / "a.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(CHANNEL.topic, "json", 0, CHANNEL.metadata())
        gaps = writer.register_channel("/gaps", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.add_message(channel, 2, codec.encode(message(1, target="other")), 2)
        writer.add_message(gaps, 3, b"[]", 3)
        writer.finish()  # type: ignore[no-untyped-call]
    items = everything(path)
    assert kinds(items) == ["r", "r", "r"]
    reasons = [item.rejected.reason for item in items if isinstance(item, RecordedRejected)]
    assert "missing required field" in reasons[0]
    assert "disagrees with the channel" in reasons[1]


def test_a_keyframe_with_a_missing_part_is_not_a_keyframe(tmp_path: Path) -> None:
    """Half of the alarms would be a wrong state; the next whole keyframe is taken."""
    path = tmp_path / "a.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/state", "json", 0)
        for number, (part, parts) in enumerate([(2, 2), (1, 3), (3, 3), (1, 2), (2, 3), (1, 2), (2, 2)]):
            body = StatePart(realm="live", target="t", session="s", seq=number, part=part, parts=parts)
            writer.add_message(channel, number, msgspec.json.encode(body), number)
        writer.finish()  # type: ignore[no-untyped-call]
    assert [item.log_time_ns for item in everything(path)] == [6]


def test_limits_are_those_the_recorder_was_told(tmp_path: Path) -> None:
    """A recording made with longer source names is read with them; without them its events are shown as rejected."""
    path = tmp_path / "a.mcap"
    event = msgspec.structs.replace(message(1), source_name="x" * 300)
    with RecordingWriter(path) as writer:
        record(writer, event, START)
    assert kinds(everything(path)) == ["r"]
    with read_events(path, limits=Limits(source_name_chars=400)) as reader:
        assert events_of(list(reader)) == [event]


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize(
    "times",
    [
        [[1, 2, 3], [4, 5]],
        [[3, 1, 2], [5, 4]],
        [[1, 5, 9], [2, 6, 7], [8, 10], [3]],
        [[9], [8], [7], [1]],
        [[0, 2, 1, 3, 3], [5, 4, 7, 8, 9]],
        [[5, 5, 5], [5, 5], [5]],
        [[0], [0, 1], [0]],
    ],
)
def test_a_foreign_file_is_read_in_log_order_with_ties_in_file_order(
    tmp_path: Path, times: list[list[int]], chunked: bool
) -> None:
    """Whatever the order in the file and however its chunks overlap; channels of other programs are skipped."""
    path = tmp_path / "a.mcap"
    foreign(path, times, chunked=chunked)
    flat = [time for chunk in times for time in chunk]
    assert ids(path) == sorted(range(len(flat)), key=lambda number: flat[number])


def test_shuffled_chunks_are_sorted(tmp_path: Path) -> None:
    """Many random overlaps against a plain stable sort."""
    chance = random.Random(4)
    for case in range(30):
        times = [[chance.randrange(40) for _ in range(chance.randrange(1, 6))] for _ in range(chance.randrange(1, 12))]
        path = tmp_path / f"{case}.mcap"
        foreign(path, times)
        flat = [time for chunk in times for time in chunk]
        assert ids(path) == sorted(range(len(flat)), key=lambda number: flat[number])


def test_sorting_takes_a_bounded_part_of_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A foreign file in reverse order is refused when it is too large to hold, and one in order never is."""
    monkeypatch.setattr(reader_module, "SORT_BYTES", 5000)
    foreign(tmp_path / "back.mcap", [[time, time + 1] for time in range(100, 0, -2)])
    foreign(tmp_path / "forth.mcap", [[time, time + 1] for time in range(0, 100, 2)])
    with pytest.raises(RecordingError, match="not in log order"):
        everything(tmp_path / "back.mcap")
    assert len(everything(tmp_path / "forth.mcap")) == 100


def test_a_foreign_tool_that_keeps_our_profile_is_still_foreign(tmp_path: Path) -> None:
    """The order is taken on trust only from our own writer."""
    foreign(tmp_path / "a.mcap", [[5], [1]], profile=PROFILE)
    assert ids(tmp_path / "a.mcap") == [1, 0]


def test_a_reader_closed_early_ends(tmp_path: Path) -> None:
    """Leaving the `with` closes the file; going on afterwards gives nothing."""
    write_story(tmp_path / "a.mcap")
    with read_events(tmp_path / "a.mcap") as reader:
        next(reader)
    assert list(reader) == []
