"""What `info` tells: from the summary in milliseconds, the same by reading everything, and never more than is true."""

from pathlib import Path

import pytest
from mcap.writer import Writer

from bridge.core import codec
from bridge.core.events import Severity
from bridge.edges.recording import (
    ChannelInfo,
    EventChannel,
    EventCount,
    RecordingError,
    RecordingWriter,
    StateFrame,
    Totals,
    read_events,
    scan,
    summary,
)
from tests.unit.edges.recording_stories import (
    ABOUT,
    ALARM,
    AXIS,
    GAP,
    PUMP,
    START,
    STATE,
    cleared,
    message,
    raised,
    record,
    write_story,
)


def test_the_summary_says_what_a_scan_finds(tmp_path: Path) -> None:
    """Counts, times, channels, attachments and who recorded it are the same either way."""
    path = tmp_path / "a.mcap"
    write_story(path)
    told, found = summary(path), scan(path)
    assert told.from_summary
    assert not found.from_summary
    assert (told.totals, told.channels, told.attachments, told.about) == (
        found.totals,
        found.channels,
        found.attachments,
        found.about,
    )
    assert told.about == ABOUT
    assert told.attachments == ("event.schema.json",)
    assert told.size_bytes == path.stat().st_size
    assert not told.truncated


def test_counts_are_by_class_kind_and_severity(tmp_path: Path) -> None:
    """And a gap makes the recording incomplete, by name."""
    path = tmp_path / "a.mcap"
    write_story(path)
    info = summary(path)
    totals = info.totals
    assert (totals.events, totals.gaps, totals.gap_events, totals.rejected, totals.states) == (14, 1, 7, 1, 1)
    assert totals.named_gaps == (GAP,)
    assert info.complete == "no"
    assert EventCount("live", "plc1", AXIS, "alarm_raised", Severity.ERROR, 1) in totals.counts
    assert EventCount("live", "plc1", PUMP, "message_sent", Severity.INFO, 2) in totals.counts
    assert sum(row.count for row in totals.counts) == 14
    assert (totals.first_log_time_ns, totals.last_log_time_ns) == (START, START + 103)
    assert (totals.first_time_ns, totals.last_time_ns) == (START, START + 11_000)
    place = EventChannel("live", "plc1", AXIS, codec.JSON)
    assert ChannelInfo(place.topic, "json", 3 + 2, place) in info.channels


@pytest.mark.parametrize(("gap", "tails", "complete"), [(0, (), "yes"), (0, ("s1",), "tail unknown"), (1, ("s1",), "no")])
def test_complete_is_yes_only_without_gaps_and_unknown_tails(
    tmp_path: Path, gap: int, tails: tuple[str, ...], complete: str
) -> None:
    """A session that went away without saying how far it had come is "tail unknown"."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        record(writer, raised(1), START)
        for _ in range(gap):
            writer.add_gap(GAP, START)
        writer.finish(tails)
    for info in (summary(path), scan(path)):
        assert info.complete == complete
        assert info.totals.unknown_tails == tails


def test_an_unfinished_file_is_never_complete(tmp_path: Path) -> None:
    """Its tail is unknown; what was flushed is counted."""
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        record(writer, message(1), START)
        writer.flush()
        info = summary(writer.active_path)
        assert (info.complete, info.totals.events, info.from_summary, info.truncated) == ("tail unknown", 1, False, True)
        writer.add_gap(GAP, START)
        writer.flush()
        assert summary(writer.active_path).complete == "no"


def test_a_damaged_file_is_not_complete(tmp_path: Path) -> None:
    """Wrong bytes in the middle are a loss; the summary behind them is not asked when it is itself in doubt."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, compression="none") as writer:
        record(writer, message(1), START)
    data = bytearray(path.read_bytes())
    assert (summary(path).complete, scan(path).complete) == ("yes", "yes")
    place = data.index(codec.encode(message(1)))
    data[place + 20] ^= 4
    path.write_bytes(bytes(data))
    assert scan(path).complete == "no"
    data[place + 20] ^= 4
    data[data.rindex(b"events")] ^= 4  # in the counts: their own CRC notices, everything is read, and the fault is found
    path.write_bytes(bytes(data))
    info = summary(path)
    assert (info.from_summary, info.totals.events, info.complete) == (False, 1, "no")


def test_a_summary_in_doubt_is_not_asked(tmp_path: Path) -> None:
    """Neither one with a wrong CRC nor one in a file whose header names another tool."""
    path = tmp_path / "a.mcap"
    write_story(path)
    whole = path.read_bytes()
    assert summary(path).from_summary
    path.write_bytes(whole[:-200] + bytes((whole[-200] ^ 1,)) + whole[-199:])
    assert not summary(path).from_summary
    path.write_bytes(whole.replace(b"tcbridge/", b"xcbridge/", 1))
    assert not summary(path).from_summary


def test_a_file_without_counts_is_read_through(tmp_path: Path) -> None:
    """A foreign tool's file has no counts of ours; nobody can say whether it is complete."""
    path = tmp_path / "a.mcap"
    place = EventChannel("live", "plc1", AXIS, codec.JSON)
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("", "another tool")
        channel = writer.register_channel(place.topic, "json", 0, place.metadata())
        writer.add_message(channel, 5, codec.encode(message(1)), 5)
        writer.finish()  # type: ignore[no-untyped-call]
    info = summary(path)
    assert (info.from_summary, info.totals.events, info.complete, info.truncated) == (False, 1, "tail unknown", False)


def test_a_tool_that_removed_messages_does_not_inherit_the_counts(tmp_path: Path) -> None:
    """Our metadata copied into a filtered file would lie: it is believed only from our own writer."""
    path, other = tmp_path / "a.mcap", tmp_path / "b.mcap"
    write_story(path)
    with read_events(path) as reader, open(other, "wb") as file:
        writer = Writer(file)
        writer.start(reader.frames.profile, "a filter")
        list(reader)
        for name, metadata in reader.frames.metadata:
            writer.add_metadata(name, metadata)
        writer.finish()  # type: ignore[no-untyped-call]
    assert summary(other).totals.events == 0


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    """With the same errors as reading."""
    (tmp_path / "a.mcap").write_bytes(b"hello, world")
    with pytest.raises(RecordingError, match="no MCAP file"):
        summary(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="No such file"):
        summary(tmp_path / "b.mcap")


def test_counts_survive_being_texts() -> None:
    """They travel as metadata; a changed text is noticed."""
    totals = Totals(events=3, counts=(EventCount("r", "t", AXIS, "message_sent", 1, 3),), named_gaps=(GAP,), gaps=1)
    texts = totals.metadata()
    assert Totals.of(texts) == totals
    assert Totals.of(texts | {"events": "4"}) is None
    assert Totals.of({}) is None


def test_alarms_active_at_start_and_end_are_told(tmp_path: Path) -> None:
    """At the start those of the keyframes before the first event; at the end what all of it folds to, however many."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.add_state(STATE, START)
        for number in range(20, 320, 2):
            record(writer, raised(number), START + number)
        writer.add_state(StateFrame(realm="live", target="plc2", session="s2", seq=0), START + 900)
        record(writer, cleared(20), START + 1000)
    for info in (summary(path), scan(path)):
        assert (info.totals.active_at_start.count, info.totals.active_at_start.named) == (1, (ALARM,))
        assert info.totals.active_at_end.count == 150
        assert [alarm.event_id for alarm in info.totals.active_at_end.named] == list(range(120, 320, 2))
