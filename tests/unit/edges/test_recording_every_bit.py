"""A small file cut at every byte and with every bit flipped: recovered to an exact prefix, or refused, in little memory."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.edges.recording import (
    Recorded,
    RecordingError,
    RecordingWriter,
    StateFrame,
    diagnose,
    read_events,
    recover,
)
from bridge.edges.recording import writer as writer_module
from bridge.edges.recording.layout import Compression
from bridge.edges.recording.records import MAGIC
from tests.unit.edges.recording_stories import GAP, START, everything, message, raised, record

COMPRESSIONS: list[Compression] = ["zstd", "lz4", "none"]
CHILD = """
import sys
from pathlib import Path
from tests.unit.edges.test_recording_every_bit import STORIES, peak
STORIES[sys.argv[1]](Path(sys.argv[2]), sys.argv[3])
print(peak())
"""


def peak() -> int:
    """The most memory this process had, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def small(folder: Path, compression: Compression) -> tuple[bytes, list[Recorded]]:
    """A file with an entry of each sort in two chunks, but without long schemas, and what it holds. No disk need keep it."""
    os.fsync = lambda fd: None
    vars(writer_module).update(event_schema=lambda: b"{}", _SCHEMAS={name: lambda: b"{}" for name in writer_module._SCHEMAS})
    with RecordingWriter(folder / "small.mcap", compression=compression) as writer:
        record(writer, message(1), START)
        writer.flush()
        record(writer, raised(2), START + 1)
        writer.add_gap(GAP, START + 2)
        writer.add_state(StateFrame(realm="live", target="plc1", session="s1", seq=2), START + 3)
    return (folder / "small.mcap").read_bytes(), everything(folder / "small.mcap")


def read(path: Path, whole: list[Recorded]) -> int:
    """How many items come, which must be the first; that more is missing must be told."""
    with read_events(path) as reader:
        items = list(reader)
        assert items == whole[: len(items)]
        assert reader.truncated
    return len(items)


def recovered(path: Path, whole: list[Recorded]) -> int:
    """The same of what recover() makes of it: a finished file that is not damaged, and never claims to be complete."""
    target = path.with_name("again.mcap")
    target.unlink(missing_ok=True)
    recover(path, target)
    items = everything(target)
    assert items == whole[: len(items)]
    with read_events(target) as reader:
        list(reader)
        assert not reader.truncated
    return len(items)


def cuts(folder: Path, compression: Compression) -> None:
    """Every length but the whole: read and recovered alike, and never less than of a shorter one."""
    data, whole = small(folder, compression)
    cut = folder / "cut.mcap"
    last = 0
    for length in range(len(data)):
        cut.write_bytes(data[:length])
        if length < len(MAGIC):
            with pytest.raises(RecordingError):
                read_events(cut)
            with pytest.raises(RecordingError):
                recover(cut, folder / "none.mcap")
            continue
        count = read(cut, whole)
        assert count >= last
        assert recovered(cut, whole) == count
        last = count
    assert last == len(whole)


def flips(folder: Path, compression: Compression) -> None:
    """Every bit is noticed and gives a prefix; of one bit in each byte also what is recovered, and what the doctor says."""
    data, whole = small(folder, compression)
    bad = folder / "bad.mcap"
    for bit in range(len(data) * 8):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        bad.write_bytes(bytes(changed))
        if bit < len(MAGIC) * 8:
            with pytest.raises(RecordingError):
                read_events(bad)
            continue
        count = read(bad, whole)
        if bit % 8 == bit // 8 % 8:
            assert recovered(bad, whole) == count
            assert any(each.fault for each in diagnose(bad))


STORIES = {"cuts": cuts, "flips": flips}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("story", STORIES)
def test_every_cut_and_every_flip(tmp_path: Path, story: str, compression: Compression) -> None:
    """In a process of their own, below 512 MB."""
    command = [sys.executable, "-c", CHILD, story, str(tmp_path), compression]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=590)
    assert int(done.stdout) < 512
