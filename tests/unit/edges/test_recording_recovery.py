"""After a crash: nothing that was flushed is lost, and nothing is thrown away that might still be of use."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from bridge.edges.recording import (
    Attachment,
    RecordingError,
    RecordingWriter,
    leftovers,
    read_events,
    recover,
    scan,
    summary,
)
from bridge.edges.recording import recovery as recovery_module
from tests.unit.edges.recording_stories import (
    ABOUT,
    START,
    events_of,
    everything,
    message,
    record,
    write_story,
)

CRASHER = """
import sys
from bridge.edges.recording import RecordingWriter
from tests.unit.edges.recording_stories import START, message, record
writer = RecordingWriter(sys.argv[1], compression=sys.argv[2], chunk_size=4096)
flush_every = int(sys.argv[3])
for number in range(10**9):
    record(writer, message(number), START + number)
    if number % flush_every == flush_every - 1:
        writer.flush()
        print(number + 1, flush=True)
"""


def crashed(path: Path, compression: str, flush_every: int, after: int) -> int:
    """Let a writer process be killed -9 in full flight; how many events it had flushed for sure."""
    command = [sys.executable, "-c", CRASHER, str(path), compression, str(flush_every)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(after)]
        process.kill()
        rest = process.stdout.read().split("\n")
    assert process.returncode == -signal.SIGKILL
    told = [int(line) for line in [*lines, *rest[:-1]] if line.strip()]
    return told[-1]


@pytest.mark.parametrize(("compression", "flush_every", "after"), [("zstd", 7, 30), ("lz4", 1, 20), ("none", 100, 9)])
def test_a_killed_writer_loses_nothing_it_had_flushed(tmp_path: Path, compression: str, flush_every: int, after: int) -> None:
    """kill -9 in full flight: all that was flushed is read back at once, and stands in the recovered file."""
    path = tmp_path / "night.mcap"
    flushed = crashed(path, compression, flush_every, after)
    assert leftovers(tmp_path) == [tmp_path / "night.mcap.active"]
    got = [event.event_id for event in events_of(everything(leftovers(tmp_path)[0]))]
    assert got == list(range(len(got)))
    assert len(got) >= flushed
    recovered = recover(tmp_path / "night.mcap.active")
    assert (recovered.path, recovered.messages) == (path, len(got))
    assert [event.event_id for event in events_of(everything(path))] == got
    info = summary(path)
    assert (info.from_summary, info.complete, info.totals.events) == (True, "tail unknown", len(got))


@pytest.mark.slow
@pytest.mark.parametrize("after", range(1, 200, 13))
def test_a_kill_at_any_moment_is_recovered(tmp_path: Path, after: int) -> None:
    """Many moments, small flushes."""
    path = tmp_path / "night.mcap"
    flushed = crashed(path, "zstd", 3, after)
    assert recover(tmp_path / "night.mcap.active").messages >= flushed
    assert not scan(path).truncated


def leftover(tmp_path: Path, cut: int = 0) -> Path:
    """What a crash leaves of the story, with everything in it but an end; `cut` bytes are missing."""
    whole = tmp_path / "whole.mcap"
    write_story(whole)
    active = tmp_path / "night.mcap.active"
    with read_events(whole) as reader:
        list(reader)
        end = scan(whole)
        assert not end.truncated
        place = reader.frames.end
    active.write_bytes(whole.read_bytes()[: place - cut])
    return active


def test_a_recovered_file_is_whole_for_every_reader(tmp_path: Path) -> None:
    """Items, metadata and attachments are there; mcap's own indexed reader reads it."""
    active = leftover(tmp_path)
    items = everything(active)
    recovered = recover(active)
    assert recovered.lost_bytes == 0
    assert recovered.damaged_path is None
    assert sorted(os.listdir(tmp_path)) == ["night.mcap", "whole.mcap"]
    with read_events(recovered.path) as reader:
        assert list(reader) == items
        assert not reader.truncated
        assert reader.about == ABOUT
    with open(recovered.path, "rb") as file:
        mcap = make_reader(file, validate_crcs=True)
        assert len(list(mcap.iter_messages())) == recovered.messages == len(items)
        names = [entry.name for entry in mcap.iter_metadata()]
        (attached,) = mcap.iter_attachments()
    assert names == ["tcbridge", "tcbridge.recovered", "tcbridge.summary"]
    assert attached.name == "event.schema.json"
    assert summary(recovered.path).totals.named_gaps == summary(tmp_path / "whole.mcap").totals.named_gaps


def test_a_torn_index_is_no_loss_but_a_torn_chunk_is_set_aside(tmp_path: Path) -> None:
    """The leftover stays as .damaged exactly when what was cut off could have held an event."""
    whole = tmp_path / "whole.mcap"
    write_story(whole)
    data = whole.read_bytes()
    seen: set[tuple[bool, bool]] = set()
    for length in range(100, len(data), 61):
        folder = tmp_path / str(length)
        folder.mkdir()
        active = folder / "night.mcap.active"
        active.write_bytes(data[:length])
        items = everything(active)
        recovered = recover(active)
        assert everything(recovered.path) == items
        with read_events(recovered.path) as reader:
            list(reader)
            assert not reader.truncated
        lost = recovered.damaged_path is not None
        assert sorted(os.listdir(folder)) == ["night.mcap", *(["night.mcap.damaged"] if lost else [])]
        if lost:
            assert (folder / "night.mcap.damaged").read_bytes() == data[:length]
        seen.add((lost, recovered.lost_bytes > 0))
    assert {(True, True), (False, True)} <= seen


def test_a_fault_in_the_middle_is_set_aside_whatever_it_hit(tmp_path: Path) -> None:
    """Even a damaged index between two chunks: good chunks may stand behind it."""
    active = leftover(tmp_path)
    data = bytearray(active.read_bytes())
    index = next(place for place in range(len(data)) if data[place] == 0x07 and data[place + 2 : place + 9] == bytes(7))
    data[index + 11] ^= 1
    active.write_bytes(bytes(data))
    recovered = recover(active)
    assert recovered.damage is not None
    assert "message index" in recovered.damage.reason
    assert recovered.damaged_path == tmp_path / "night.mcap.damaged"


def test_an_earlier_damaged_file_is_kept(tmp_path: Path) -> None:
    """The next one gets a number."""
    (tmp_path / "night.mcap.damaged").write_bytes(b"earlier")
    active = leftover(tmp_path)
    data = active.read_bytes()
    active.write_bytes(data + b"\x06" + (1000).to_bytes(8, "little") + bytes(20))
    recovered = recover(active)
    assert recovered.damaged_path == tmp_path / "night.mcap.damaged.2"
    assert (tmp_path / "night.mcap.damaged").read_bytes() == b"earlier"


def test_a_finished_file_that_missed_its_rename_is_just_renamed(tmp_path: Path) -> None:
    """Killed between the last byte and the rename: the very same bytes get their name."""
    whole = tmp_path / "whole.mcap"
    items = write_story(whole)
    data = whole.read_bytes()
    active = whole.rename(tmp_path / "night.mcap.active")
    recovered = recover(active)
    assert (recovered.path.read_bytes(), recovered.messages) == (data, len(items))
    assert os.listdir(tmp_path) == ["night.mcap"]


def test_a_finished_file_that_has_both_names_loses_the_one_of_an_active_file(tmp_path: Path) -> None:
    """Killed between getting its name and giving up the other: both are the same file."""
    whole = tmp_path / "whole.mcap"
    items = write_story(whole)
    os.link(whole, tmp_path / "whole.mcap.active")
    recovered = recover(tmp_path / "whole.mcap.active")
    assert (recovered.path, recovered.messages) == (whole, len(items))
    assert os.listdir(tmp_path) == ["whole.mcap"]


def test_a_file_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    """A second recorder that starts in the same folder does not take the first one's file."""
    with RecordingWriter(tmp_path / "night.mcap") as writer:
        record(writer, message(1), START)
        writer.flush()
        with pytest.raises(RecordingError, match="being written"):
            recover(writer.active_path)
    assert events_of(everything(tmp_path / "night.mcap")) == [message(1)]


def test_no_name_is_taken_from_another_file(tmp_path: Path) -> None:
    """With a night.mcap of other origin there, the leftover stays a leftover."""
    active = leftover(tmp_path)
    shutil.copy(tmp_path / "whole.mcap", tmp_path / "night.mcap")
    before = active.read_bytes()
    with pytest.raises(RecordingError, match="exists"):
        recover(active)
    assert active.read_bytes() == before


@pytest.mark.parametrize("cut", [0, 30])
def test_a_recovery_killed_in_the_middle_is_taken_up_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: int) -> None:
    """Killed after the file got its name and before the leftover was dealt with: the next one only tidies up."""
    active = leftover(tmp_path, cut)
    items = everything(active)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    (tmp_path / "night.mcap.recovering").write_bytes(b"of an even earlier one")
    with monkeypatch.context() as patch:
        patch.setattr(recovery_module, "_set_aside", killed)
        with pytest.raises(KeyboardInterrupt):
            recover(active)
    assert (tmp_path / "night.mcap").exists()
    assert active.exists()
    again = recover(active)
    assert again.messages == len(items)
    assert everything(tmp_path / "night.mcap") == items
    assert not active.exists()
    assert (again.lost_bytes > 0) == (cut > 0)


def test_any_file_can_be_recovered_into_another(tmp_path: Path) -> None:
    """A copy that was cut keeps its name and its bytes; where the result goes must be said."""
    whole = tmp_path / "whole.mcap"
    write_story(whole)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(whole.read_bytes()[:-300])
    before = copy.read_bytes()
    with pytest.raises(ValueError, match="say where"):
        recover(copy)
    recovered = recover(copy, tmp_path / "mended.mcap")
    assert recovered.damaged_path == copy
    assert copy.read_bytes() == before
    assert everything(tmp_path / "mended.mcap") == everything(copy)


def test_a_leftover_without_a_header_becomes_an_empty_recording(tmp_path: Path) -> None:
    """Killed in the first millisecond. An empty leftover is refused: nothing says that it is ours."""
    active = tmp_path / "night.mcap.active"
    active.write_bytes(b"")
    with pytest.raises(RecordingError, match="is empty"):
        recover(active)
    assert os.listdir(tmp_path) == ["night.mcap.active"]
    active.write_bytes(b"\x89MCAP0\r\n\x01")
    assert recover(active).messages == 0
    assert everything(tmp_path / "night.mcap") == []


def test_attachments_are_carried_over(tmp_path: Path) -> None:
    """Class files that explain the recording survive its recovery."""
    with RecordingWriter(tmp_path / "night.mcap", attachments=[Attachment("plc.tmc", b"<Tmc/>", "text/xml", 5)]) as writer:
        record(writer, message(1), START)
        writer.flush()
        data = writer.active_path.read_bytes()
    (tmp_path / "other.mcap.active").write_bytes(data)
    assert summary(recover(tmp_path / "other.mcap.active").path).attachments == ("event.schema.json", "plc.tmc")
