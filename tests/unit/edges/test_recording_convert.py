"""Converting: the same recording for programs that read JSON only."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader
from mcap.well_known import MessageEncoding
from mcap.writer import Writer

from bridge.core import codec
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.keys import event_key, parse_event_key
from bridge.edges.recording import (
    Attachment,
    Compression,
    Recorded,
    RecordedEvent,
    RecordingError,
    RecordingWriter,
    StateFrame,
    Viewer,
    convert,
    recover,
    summary,
)
from bridge.edges.recording.carried import carried
from tests.unit.edges.recording_stories import ABOUT, ALARM, AXIS, START, everything, message, record, write_story

AXES = EventClass(AXIS, "Axis", "", {n: EventEntry(n, f"E{n}", Severity.INFO, "Event {0}") for n in range(100)})
CATALOG = Catalog([msgspec.structs.replace(AXES, translations={"Event {0}": {1031: "Ereignis {0}"}})])


def viewer(language: str = "en") -> Viewer:
    """Texts of a class that is the program's own."""
    return Viewer(lambda event: CATALOG, language, CATALOG)


def alike(items: list[Recorded]) -> list[Recorded]:
    """The items without the bytes that differ between encodings."""
    return [
        msgspec.structs.replace(item, element=b"", encoding="") if isinstance(item, RecordedEvent) else item for item in items
    ]


def lines(path: Path) -> list[str]:
    """What the log channel says."""
    with open(path, "rb") as file:
        return [json.loads(raw.data)["message"] for _, _, raw in make_reader(file).iter_messages(topics=["/log"])]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_everything_is_there_and_all_of_it_is_json(tmp_path: Path, compression: Compression) -> None:
    """Events, gap, rejected payload and keyframe, in the order and at the times of the first file, with the same counts."""
    items = write_story(tmp_path / "a.mcap", compression=compression)
    report = convert(tmp_path / "a.mcap", tmp_path / "b.mcap", viewer(), compression=compression)
    assert (report.events, report.from_msgpack, report.left_out, report.damage) == (14, 6, (), None)
    converted = everything(tmp_path / "b.mcap")
    assert alike(converted) == alike(items)
    assert {item.encoding for item in converted if isinstance(item, RecordedEvent)} == {codec.JSON}
    before, after = summary(tmp_path / "a.mcap"), summary(tmp_path / "b.mcap")
    assert after.totals == before.totals
    assert after.about == before.about


def test_converting_once_more_changes_nothing(tmp_path: Path) -> None:
    """Not one byte, with the texts made anew or kept."""
    write_story(tmp_path / "a.mcap")
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap", viewer())
    convert(tmp_path / "b.mcap", tmp_path / "c.mcap", viewer())
    convert(tmp_path / "b.mcap", tmp_path / "d.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == (tmp_path / "c.mcap").read_bytes() == (tmp_path / "d.mcap").read_bytes()


def test_the_log_is_added_made_anew_or_kept(tmp_path: Path) -> None:
    """A file without it gets it, one in another language gets that, and without a viewer what is there stays as it is."""
    write_story(tmp_path / "a.mcap")
    assert not carried(tmp_path / "a.mcap").has_log
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap", viewer())
    convert(tmp_path / "b.mcap", tmp_path / "c.mcap", viewer("de"))
    convert(tmp_path / "c.mcap", tmp_path / "d.mcap")
    assert carried(tmp_path / "b.mcap").has_log
    assert lines(tmp_path / "b.mcap")[0] == "Event 0 ()"
    assert lines(tmp_path / "d.mcap") == lines(tmp_path / "c.mcap")
    assert lines(tmp_path / "d.mcap")[0] == "Ereignis 0 ()"
    assert len(lines(tmp_path / "d.mcap")) == 16


def test_what_explains_the_file_comes_along(tmp_path: Path) -> None:
    """Attachments with their times, further metadata, and where a recovered file came from."""
    files = [Attachment("plant.tmc", b"<x/>", "application/xml", START), Attachment("plant.toml", b"", "text/plain")]
    about = msgspec.structs.replace(ABOUT, part=3, previous="p2.mcap", more={"trigger": "severity = critical"})
    writer = RecordingWriter(tmp_path / "a.mcap", about=about, attachments=files)
    record(writer, message(1), START)
    writer.add_metadata("shift", {"crew": "night"})
    writer.flush()
    writer.abandon()
    recover(tmp_path / "a.mcap.active")
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap")
    first, second = carried(tmp_path / "a.mcap"), carried(tmp_path / "b.mcap")
    assert second.about == about
    assert [each for each in second.attachments if each in files] == files
    assert [each.name for each in second.attachments].count("event.schema.json") == 1
    assert dict(second.metadata) == dict(first.metadata)
    assert {"shift", "tcbridge.recovered"} <= dict(second.metadata).keys()
    assert summary(tmp_path / "b.mcap").complete == "tail unknown"


def test_the_next_file_and_unknown_tails_are_kept(tmp_path: Path) -> None:
    """The new file is as complete as the old one, and leads to the same neighbours."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    record(writer, message(1), START)
    writer.finish(("s9",), "a2.mcap")
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap")
    totals = summary(tmp_path / "b.mcap").totals
    assert (totals.unknown_tails, totals.next_file) == (("s9",), "a2.mcap")


def test_of_a_cut_file_there_is_what_can_be_read(tmp_path: Path) -> None:
    """It says where reading ended, and never claims to be complete."""
    write_story(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    report = convert(tmp_path / "cut.mcap", tmp_path / "b.mcap", viewer())
    assert report.damage is not None
    assert alike(everything(tmp_path / "b.mcap")) == alike(everything(tmp_path / "cut.mcap"))
    assert summary(tmp_path / "b.mcap").complete == "tail unknown"


def test_of_a_damaged_file_there_is_what_can_be_read(tmp_path: Path) -> None:
    """Its summary, which is whole, is not believed."""
    write_story(tmp_path / "a.mcap", compression="none")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    place = data.index(b"Main.fbAxis[9]")
    data[place] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data)
    assert carried(tmp_path / "bad.mcap").summary is not None
    report = convert(tmp_path / "bad.mcap", tmp_path / "b.mcap", viewer())
    assert report.damage is not None
    assert 0 < report.events < 10
    assert summary(tmp_path / "b.mcap").complete == "tail unknown"


def test_a_large_keyframe_keeps_its_place(tmp_path: Path) -> None:
    """Written in several messages, it still stands where it stood."""
    alarms = tuple(msgspec.structs.replace(ALARM, event_id=number) for number in range(2500))
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        record(writer, message(1), START)
        writer.add_state(StateFrame(realm="live", target="plc1", session="s1", seq=4, alarms=alarms), START)
        record(writer, message(2), START)
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert everything(tmp_path / "b.mcap") == everything(tmp_path / "a.mcap")


def test_fields_of_a_later_version_are_kept(tmp_path: Path) -> None:
    """msgpack with a field that this version does not know becomes JSON with it."""
    event = message(1)
    fields: dict[str, Any] = msgspec.msgpack.decode(codec.encode(event, codec.MSGPACK)) | {"mood": "calm"}
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        key = parse_event_key(event_key("live", event))
        writer.add(msgspec.msgpack.encode(fields), codec.MSGPACK, key, event, START)
        writer.add(msgspec.msgpack.encode(fields | {"mood": msgspec.msgpack.Ext(3, b"x")}), codec.MSGPACK, key, event, START)
    convert(tmp_path / "a.mcap", tmp_path / "b.mcap")
    with_it, without = [item for item in everything(tmp_path / "b.mcap") if isinstance(item, RecordedEvent)]
    assert json.loads(with_it.element)["mood"] == "calm"
    assert without.element == codec.encode(event)


def test_channels_of_other_programs_are_named(tmp_path: Path) -> None:
    """They are not ours to rewrite: the events come along, the others are left out and told, also one that is called /log."""
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        camera = writer.register_channel("/camera", MessageEncoding.JSON, 0)
        rosout = writer.register_channel("/log", MessageEncoding.JSON, writer.register_schema("rosgraph_msgs/Log", "", b""))
        events = writer.register_channel(
            "/plc1/x", MessageEncoding.JSON, 0, {"realm": "live", "target": "plc1", "event_class": AXIS}
        )
        writer.add_message(camera, START, b"{}", START)
        writer.add_message(rosout, START, b"{}", START)
        writer.add_message(events, START + 1, codec.encode(message(1)), START)
        writer.finish()  # type: ignore[no-untyped-call]
    assert not carried(tmp_path / "a.mcap").has_log
    report = convert(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert (report.events, report.left_out) == (1, ("/camera", "/log"))
    assert len(everything(tmp_path / "b.mcap")) == 1


def test_an_interruption_leaves_nothing_behind(tmp_path: Path) -> None:
    """No half a file under any name; a target that exists is left alone."""
    write_story(tmp_path / "a.mcap")

    def stop(event: object) -> Catalog:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        convert(tmp_path / "a.mcap", tmp_path / "b.mcap", Viewer(stop))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    with pytest.raises(RecordingError, match="exists"):
        convert(tmp_path / "a.mcap", tmp_path / "a.mcap")
    with pytest.raises(ValueError, match=r"\.mcap"):
        convert(tmp_path / "a.mcap", tmp_path / "b.json")
