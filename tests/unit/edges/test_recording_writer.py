"""What is written: names, times, bytes, refusals."""

import errno
import io
import json
import os
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from bridge.core import codec
from bridge.core.events import MessageSent, Severity
from bridge.core.keys import event_key, parse_event_key
from bridge.core.times import MAX_TIME_NS, TimeError
from bridge.edges.recording import About, Attachment, RecordedEvent, RecordingError, RecordingWriter, StateFrame, read_events
from bridge.edges.recording import writer as writer_module
from bridge.edges.recording.layout import ALARMS_PER_MESSAGE, Compression
from tests.unit.edges.recording_stories import (
    ABOUT,
    ALARM,
    AXIS,
    GAP,
    START,
    events_of,
    everything,
    kinds,
    message,
    record,
    write_story,
)


def test_the_file_has_its_name_only_when_it_is_finished(tmp_path: Path) -> None:
    """name.mcap.active while it is written, name.mcap afterwards, never both."""
    path = tmp_path / "night.mcap"
    writer = RecordingWriter(path)
    assert os.listdir(tmp_path) == ["night.mcap.active"]
    record(writer, message(1), START)
    assert writer.finish() == path
    assert os.listdir(tmp_path) == ["night.mcap"]


def test_nothing_that_exists_is_overwritten(tmp_path: Path) -> None:
    """A finished recording, an active one and a file that appears meanwhile keep their contents."""
    path = tmp_path / "night.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="never overwrites"):
        RecordingWriter(path)
    path.unlink()
    with RecordingWriter(path) as first:
        with pytest.raises(RecordingError, match="exists: it is being written"):
            RecordingWriter(path)
        record(first, message(1), START)
        path.write_bytes(b"precious")
        with pytest.raises(RecordingError, match="appeared meanwhile"):
            first.finish()
    assert path.read_bytes() == b"precious"
    assert events_of(everything(tmp_path / "night.mcap.active")) == [message(1)]


def test_a_file_system_without_hard_links_gets_a_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where link() is not allowed the file still gets its name, and still takes no other file's."""

    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", refuse)
    with RecordingWriter(tmp_path / "a.mcap"):
        pass
    assert os.listdir(tmp_path) == ["a.mcap"]
    other = RecordingWriter(tmp_path / "b.mcap")
    (tmp_path / "b.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="appeared meanwhile"):
        other.finish()
    assert (tmp_path / "b.mcap").read_bytes() == b"precious"


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_another_reader_finds_everything(tmp_path: Path, compression: Compression) -> None:
    """mcap's own indexed reader sees the channels, the bytes, the schema, the metadata and the attachments."""
    path = tmp_path / "a.mcap"
    write_story(path, compression=compression)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = list(reader.iter_messages())
        summary = reader.get_summary()
        assert [entry.name for entry in reader.iter_metadata()] == ["tcbridge", "tcbridge.summary"]
        (schema,) = [entry for entry in reader.iter_attachments() if entry.name == "event.schema.json"]
    assert schema.data == msgspec.json.encode(codec.schema())
    assert summary is not None
    assert {(channel.topic, channel.message_encoding) for channel in summary.channels.values()} == {
        (f"/plc1/{AXIS}", "json"),
        (f"/plc1/{AXIS}/msgpack", "msgpack"),
        ("/plc1/0a0b0c0d-0000-4000-8000-000000000001", "json"),
        ("/plc1/0a0b0c0d-0000-4000-8000-000000000001/msgpack", "msgpack"),
        ("/gaps", "json"),
        ("/rejected", "json"),
        ("/state", "json"),
    }
    for schema_record, channel, _ in messages:
        if channel.message_encoding == "msgpack" or channel.topic == "/rejected":
            assert schema_record is None
        else:
            assert schema_record is not None
            assert schema_record.encoding == "jsonschema"
            root = json.loads(schema_record.data)
            assert root["type"] == "object"
            assert "$ref" not in schema_record.data.decode()
    assert len(messages) == 12 + 2 + 3
    assert codec.encode(message(0)) in [entry.data for _, _, entry in messages]


def test_a_channel_tells_the_whole_key(tmp_path: Path) -> None:
    """Realm, target, class and encoding stand in the channel's metadata, names escaped only inside the key."""
    path = tmp_path / "a.mcap"
    event = MessageSent(target="Halle 4/Süd", event_class=AXIS, event_id=1, severity=Severity.INFO)
    with RecordingWriter(path) as writer:
        record(writer, event, START, codec.MSGPACK, realm="replay-1")
    with open(path, "rb") as file:
        ((_, channel, _),) = make_reader(file).iter_messages()
    assert channel.metadata == {
        "realm": "replay-1",
        "target": "Halle 4/Süd",
        "event_class": AXIS,
        "encoding": codec.MSGPACK,
        "wire": "1",
        "key": f"tc3/1/replay-1/Halle%204%2FS%C3%BCd/event/{AXIS}/*/*",
    }
    (item,) = everything(path)
    assert isinstance(item, RecordedEvent)
    assert item.key == parse_event_key(event_key("replay-1", event))
    assert item.key_text == event_key("replay-1", event)


def test_log_time_grows_strictly_when_the_clock_does_not(tmp_path: Path) -> None:
    """Equal arrivals and a clock that jumps back keep the order in which events came."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        times = [record(writer, message(n), START + offset) for n, offset in enumerate([0, 0, -5_000_000_000, 10, 3])]
        assert writer.last_log_time_ns == times[-1]
    assert times == [START, START + 1, START + 2, START + 10, START + 11]
    assert [event.event_id for event in events_of(everything(path))] == [0, 1, 2, 3, 4]


def test_publish_time_is_the_events_own_and_sequence_its_number(tmp_path: Path) -> None:
    """An event without a time was published when it was logged, as MCAP wants it; key_seq is cut to 32 bits."""
    path = tmp_path / "a.mcap"
    timeless = MessageSent(target="t", event_class=AXIS, event_id=1, severity=Severity.INFO, key_seq=2**32 + 5)
    with RecordingWriter(path) as writer:
        record(writer, message(3), START + 99)
        record(writer, timeless, START + 100)
    with open(path, "rb") as file:
        entries = [entry for _, _, entry in make_reader(file).iter_messages()]
    assert [(entry.publish_time, entry.log_time, entry.sequence) for entry in entries] == [
        (START + 3000, START + 99, 4),
        (START + 100, START + 100, 5),
    ]


def test_bytes_that_no_writer_of_ours_would_make_are_kept(tmp_path: Path) -> None:
    """A foreign sender's spaces and unknown fields are in the file as they were on the wire."""
    path = tmp_path / "a.mcap"
    element = b' {"kind":"message_sent" , "target":"t","event_class":"%s","event_id":1,"severity":1,"new":[1]}' % AXIS.encode()
    event = codec.decode_one(element)
    with RecordingWriter(path) as writer:
        writer.add(element, codec.JSON, parse_event_key(event_key("live", event)), event, START)
    (item,) = everything(path)
    assert isinstance(item, RecordedEvent)
    assert item.element == element


@pytest.mark.parametrize("arrival", [-1, 2**64, MAX_TIME_NS + 1, 1.5])
def test_a_wrong_value_is_refused_and_spoils_nothing(tmp_path: Path, arrival: int) -> None:
    """A time that MCAP cannot hold is an error at the call, and the file goes on."""
    path = tmp_path / "a.mcap"
    event = message(1)
    key = parse_event_key(event_key("live", event))
    with RecordingWriter(path) as writer:
        with pytest.raises((TimeError, TypeError)):
            record(writer, event, arrival)
        with pytest.raises((TimeError, TypeError)):
            writer.add_gap(GAP, arrival)
        with pytest.raises(ValueError, match="encoding"):
            writer.add(b"{}", "text/plain", key, event, START)
        with pytest.raises(ValueError, match="element"):
            writer.add(b" " * (2 << 20), codec.JSON, key, event, START)
        with pytest.raises(ValueError, match="attachment"):
            writer.attach(Attachment("big", bytes((32 << 20) + 1)))
        record(writer, event, START)
    assert events_of(everything(path)) == [event]


@pytest.mark.parametrize(
    ("name", "chunk_size", "compression"), [("a", 1024, "zstd"), ("a.mcap", 5, "lz4"), ("a.mcap", 1024, "gz")]
)
def test_settings_that_make_no_recording_are_refused(
    tmp_path: Path, name: str, chunk_size: int, compression: Compression
) -> None:
    """A name without .mcap, a chunk size out of range and an unknown compression leave nothing behind."""
    with pytest.raises(ValueError, match=r"mcap|chunk_size|compression"):
        RecordingWriter(tmp_path / name, chunk_size=chunk_size, compression=compression)
    assert os.listdir(tmp_path) == []


def test_texts_that_are_not_utf8_do_not_stop_a_recording(tmp_path: Path) -> None:
    """A host name or comment with bytes that are no UTF-8 is written with question marks."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, about=About(host="h\udcff", comment="c\udc80")) as writer:
        writer.add_rejected("k\udcff", codec.JSON, b"\xff", "why \udcff", START)
        writer.attach(Attachment("n\udcff", b"x"))
    with read_events(path) as reader:
        (item,) = reader
        assert reader.about.host == "h?"
    assert kinds([item]) == ["r"]


def test_a_huge_rejected_payload_is_kept_in_part_with_its_size(tmp_path: Path) -> None:
    """Somebody's gigabyte must not fill the disk: its first MiB and its size tell enough."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.add_rejected("k", codec.JSON, b"ab" * (1 << 20), "too long", START)
    (item,) = everything(path)
    assert not isinstance(item, RecordedEvent)
    with read_events(path) as reader:
        rejected = next(reader)
    assert (len(rejected.rejected.payload), rejected.rejected.size) == (1 << 20, 2 << 20)  # type: ignore[union-attr]


def test_more_classes_than_channels_are_kept_as_rejected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MCAP has 65,535 channels; a sender who invents more classes loses the channel, not the event."""
    monkeypatch.setattr(writer_module, "MAX_EVENT_CHANNELS", 2)
    path = tmp_path / "a.mcap"
    classes = [f"{AXIS[:-1]}{digit}" for digit in "0121"]
    with RecordingWriter(path) as writer:
        for number, event_class in enumerate(classes):
            record(writer, message(number, event_class), START)
    assert kinds(everything(path)) == ["e", "e", "r", "e"]


def test_a_keyframe_with_many_alarms_comes_back_as_one(tmp_path: Path) -> None:
    """It is written in messages of a thousand alarms, so that no record grows without bound."""
    path = tmp_path / "a.mcap"
    alarms = tuple([ALARM] * (2 * ALARMS_PER_MESSAGE + 1))
    frames = [StateFrame(realm="live", target="t", session="s", seq=n, alarms=alarms[: n * 1500]) for n in (0, 1, 2)]
    with RecordingWriter(path) as writer:
        for frame in frames:
            writer.add_state(frame, START)
    assert [item.state for item in everything(path)] == frames  # type: ignore[union-attr]
    with open(path, "rb") as file:
        assert len(list(make_reader(file).iter_messages())) == 1 + 2 + 3


class FullDisk(io.FileIO):
    """A file on a disk that is full after `room` bytes."""

    room = 0

    def write(self, data: object) -> int:
        size = len(memoryview(data))  # type: ignore[arg-type]
        if self.room < size:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= size
        return super().write(data)  # type: ignore[arg-type]


@pytest.mark.parametrize("room", [20_000, 100_000])
def test_a_full_disk_stops_the_writer_loudly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    """The error names the file, the writer refuses from then on, and what was flushed is still read."""
    path = tmp_path / "a.mcap"
    disks: list[FullDisk] = []

    def opened(name: Path, mode: str) -> io.BufferedWriter:
        disks.append(FullDisk(name, mode))
        disks[0].room = room
        return io.BufferedWriter(disks[0])

    monkeypatch.setattr(writer_module, "open", opened, raising=False)
    flushed = 0
    with RecordingWriter(path, compression="none") as writer:

        def fill() -> None:
            nonlocal flushed
            for number in range(10_000):
                record(writer, message(number), START + number)
                if number % 10 == 9:
                    writer.flush()
                    flushed = number + 1

        with pytest.raises(RecordingError, match=r"a\.mcap\.active: cannot be written: No space") as caught:
            fill()
        assert caught.value.path == str(path) + ".active"
        disks[0].room = 1 << 30
        with pytest.raises(RecordingError, match="No space"):
            record(writer, message(1), START)
        with pytest.raises(RecordingError, match="No space"):
            writer.flush()
        with pytest.raises(RecordingError, match="No space"):
            writer.finish()
    assert os.listdir(tmp_path) == ["a.mcap.active"]
    got = [event.event_id for event in events_of(everything(tmp_path / "a.mcap.active"))]
    assert got[:flushed] == list(range(flushed))
    assert flushed


def test_a_disk_that_is_full_from_the_start_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording that could not even begin does not leave a half-named file."""
    monkeypatch.setattr(writer_module, "open", lambda name, mode: io.BufferedWriter(FullDisk(name, mode)), raising=False)
    with pytest.raises(RecordingError, match="No space"):
        RecordingWriter(tmp_path / "a.mcap")
    assert os.listdir(tmp_path) == []


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    """The error says which file could not be made."""
    with pytest.raises(RecordingError, match=r"gone/a\.mcap\.active: No such file"):
        RecordingWriter(tmp_path / "gone" / "a.mcap")


def test_an_interruption_inside_a_write_is_not_papered_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A KeyboardInterrupt inside mcap's writer leaves it unsound: the writer refuses, the flushed part is recoverable."""
    path = tmp_path / "a.mcap"

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with RecordingWriter(path) as writer:
        record(writer, message(1), START)
        writer.flush()
        monkeypatch.setattr(writer._mcap, "add_message", interrupt)
        with pytest.raises(KeyboardInterrupt):
            record(writer, message(2), START)
        monkeypatch.undo()
        with pytest.raises(RecordingError, match="interruption"):
            record(writer, message(3), START)
    assert events_of(everything(tmp_path / "a.mcap.active")) == [message(1)]


def test_leaving_by_an_exception_still_finishes_the_file(tmp_path: Path) -> None:
    """Ctrl-C between two events is no reason to lose the summary."""
    path = tmp_path / "a.mcap"

    def interrupted() -> None:
        with RecordingWriter(path) as writer:
            record(writer, message(1), START)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with read_events(path) as reader:
        assert events_of(list(reader)) == [message(1)]
        assert not reader.truncated


def test_a_finished_writer_says_so(tmp_path: Path) -> None:
    """Using it again is the caller's fault."""
    with RecordingWriter(tmp_path / "a.mcap", about=ABOUT, sync=True) as writer:
        record(writer, message(1), START)
        writer.flush()
        assert writer.size_bytes > 1000
        writer.finish()
    with pytest.raises(RecordingError, match="is finished"):
        record(writer, message(2), START)
    with pytest.raises(RecordingError, match="is finished"):
        writer.finish()
    assert writer.totals.events == 1
