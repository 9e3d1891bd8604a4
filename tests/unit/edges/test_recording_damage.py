"""Cut files and flipped bits: an exact prefix, or a clear refusal; never a wrong event, never a crash."""

import random
import resource
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
import zstandard

from bridge.edges.recording import Recorded, RecordingError, read_events, scan, summary
from bridge.edges.recording.layout import Compression
from bridge.edges.recording.records import MAGIC, chunk_data
from tests.unit.edges.recording_stories import everything, write_story

COMPRESSIONS: list[Compression] = ["zstd", "lz4", "none"]


def prefix_of(path: Path, whole: list[Recorded]) -> tuple[int, bool]:
    """How many items are read before the end, and whether the reader says that it is cut. They must be the first ones."""
    with read_events(path) as reader:
        items = list(reader)
        assert items == whole[: len(items)]
        return len(items), reader.truncated


def check_cuts(tmp_path: Path, compression: Compression, step: int) -> None:
    """The prefix grows with the file, is whole once the last chunk is there, and only the whole file is not truncated."""
    path, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    whole = write_story(path, events=6, compression=compression)
    data = path.read_bytes()
    places = {length for place in chunk_places(data) for length in range(place - 12, place + 12)}
    last = 0
    for length in sorted(places | set(range(10)) | set(range(0, len(data), step)) | set(range(len(data) - 50, len(data)))):
        cut.write_bytes(data[:length])
        if length < len(MAGIC):
            with pytest.raises(RecordingError):
                read_events(cut)
            continue
        count, truncated = prefix_of(cut, whole)
        assert truncated
        assert count >= last
        last = count
    assert last == len(whole)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_cut_file_gives_an_exact_prefix(tmp_path: Path, compression: Compression) -> None:
    """Cut around every chunk, in head and tail, and at each 37th byte between."""
    check_cuts(tmp_path, compression, 37)


def flipped(data: bytes, bit: int) -> bytes:
    """The data with one bit turned."""
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def check_flips(tmp_path: Path, compression: Compression, chosen: list[int]) -> None:
    """Every flip is noticed, gives a prefix, and nothing claims the damaged file complete."""
    path, bad = tmp_path / "a.mcap", tmp_path / "bad.mcap"
    whole = write_story(path, events=3, compression=compression, flush_every=2)
    data = path.read_bytes()
    for bit in (number % (len(data) * 8) for number in chosen):
        bad.write_bytes(flipped(data, bit))
        if bit < len(MAGIC) * 8:
            with pytest.raises(RecordingError):
                read_events(bad)
            continue
        _, truncated = prefix_of(bad, whole)
        assert truncated, f"bit {bit} went unseen"
        assert scan(bad).complete != "yes"


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_sampled_bit_flips_never_give_a_wrong_event(tmp_path: Path, compression: Compression) -> None:
    """Some hundred flips anywhere in the file."""
    chance = random.Random(7)
    check_flips(tmp_path, compression, [chance.randrange(1 << 30) for _ in range(400)])


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_flip_in_the_frame_of_a_chunk_does_not_hide_it(tmp_path: Path, compression: Compression) -> None:
    """MCAP readers skip records they do not know; a chunk with a flipped opcode or length would vanish in silence."""
    path, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    whole = write_story(path, compression=compression)
    data = path.read_bytes()
    places = chunk_places(data)
    assert len(places) > 4
    for place in places[1:]:
        for bit in range(9 * 8):
            cut.write_bytes(flipped(data, place * 8 + bit)[: places[-1]])
            count, truncated = prefix_of(cut, whole)
            assert truncated
            assert count < len(whole)


def chunk_places(data: bytes) -> list[int]:
    """Where the chunk records of a file begin."""
    places, place = [], len(MAGIC)
    while data[place] != 0x0F:
        if data[place] == 0x06:
            places.append(place)
        place += 9 + int.from_bytes(data[place + 1 : place + 9], "little")
    return places


def test_garbage_behind_the_end_is_reported(tmp_path: Path) -> None:
    """All events are there, but the file is not what was written."""
    path = tmp_path / "a.mcap"
    whole = write_story(path)
    path.write_bytes(path.read_bytes() + b"more")
    assert prefix_of(path, whole) == (len(whole), True)


def test_random_bytes_behind_the_magic_are_no_events(tmp_path: Path) -> None:
    """They are damage, not an exception."""
    chance = random.Random(1)
    path = tmp_path / "a.mcap"
    for _ in range(300):
        path.write_bytes(MAGIC + chance.randbytes(chance.randrange(200)))
        assert prefix_of(path, []) == (0, True)
        assert summary(path).complete in ("no", "tail unknown")


def bomb(compression: bytes, packed: bytes, size: int) -> bytes:
    """A chunk record's body that claims `size` bytes."""
    return struct.pack("<QQQII", 0, 0, size, 0, len(compression)) + compression + struct.pack("<Q", len(packed)) + packed


def test_a_chunk_that_unpacks_to_more_than_it_says_is_refused() -> None:
    """It is unpacked only as far as it says."""
    packed = zstandard.compress(bytes(50 << 20))
    with pytest.raises(ValueError, match="another size"):
        chunk_data(bomb(b"zstd", packed, 100), strict=False)
    with pytest.raises(ValueError, match="more than"):
        chunk_data(bomb(b"zstd", packed, 1 << 40), strict=False)
    with pytest.raises(ValueError, match="not known"):
        chunk_data(bomb(b"brotli", packed, 100), strict=False)
    with pytest.raises(ValueError, match="does not unpack"):
        chunk_data(bomb(b"lz4", b"nonsense", 100), strict=False)
    with pytest.raises(ValueError, match="length that disagrees"):
        chunk_data(bomb(b"", b"abc", 3) + b"x", strict=True)
    assert chunk_data(bomb(b"", b"abc", 3) + b"x", strict=False) == b"abc"
    assert chunk_data(bomb(b"zstd", packed, 50 << 20), strict=False) == bytes(50 << 20)
    with pytest.raises(ValueError, match="CRC"):
        chunk_data(bomb(b"zstd", packed, 50 << 20), strict=True)


HUNGRY = """
import resource, sys
from bridge.edges.recording import read_events, scan
for path in sys.argv[1:]:
    with read_events(path) as reader:
        assert list(reader) == [] and reader.truncated
    scan(path)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""


def packed_zeros(mebibytes: int) -> bytes:
    """A packed frame of zeros that does not say how long it is."""
    packer = zstandard.ZstdCompressor().compressobj()
    return b"".join(packer.compress(bytes(1 << 20)) for _ in range(mebibytes)) + packer.flush()


def test_a_hostile_file_cannot_claim_much_memory(tmp_path: Path) -> None:
    """Claims of gigabytes in records, chunks, names and packed frames: read and summed up below 512 MB."""
    header = b"\x01" + struct.pack("<Q", 8) + bytes(8)
    zeros, gibibyte = zstandard.compress(bytes(64 << 20)), packed_zeros(1024)
    bodies = [
        b"\x06" + struct.pack("<Q", 1 << 62),
        b"\x06" + struct.pack("<Q", 2000) + bytes(2000),
        b"\x0c" + struct.pack("<QI", 2000, 0xFFFFFFFF) + bytes(1996),
        b"\x05" + struct.pack("<Q", 0),
        b"\x04" + struct.pack("<QHHI", 2000, 1, 0, 0x7FFFFFFF) + bytes(1992),
        *(
            b"\x06" + struct.pack("<Q", len(body)) + body
            for body in (bomb(b"zstd", zeros, 64 << 20), bomb(b"zstd", zeros, 1 << 63), bomb(b"zstd", gibibyte, 1000))
        ),
    ]
    for number, body in enumerate(bodies):
        (tmp_path / f"{number}.mcap").write_bytes(MAGIC + header + body)
    huge = tmp_path / "huge.mcap"
    with open(huge, "wb") as file:
        file.write(MAGIC + header + b"\x06" + struct.pack("<Q", 2 << 30))
        file.truncate(3 << 30)
    files = sorted(str(path) for path in tmp_path.glob("*.mcap"))
    done = subprocess.run([sys.executable, "-c", HUNGRY, *files], check=True, capture_output=True, text=True, timeout=100)
    assert int(done.stdout) < 512


def test_own_memory_is_bounded_by_the_chunk(tmp_path: Path) -> None:
    """Reading a recording never holds more than a chunk: the peak does not grow with the file."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path = tmp_path / "a.mcap"
    write_story(path, events=20_000, flush_every=500)
    with read_events(path) as reader:
        assert sum(1 for _ in reader) == 20_005
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def test_a_wrong_crc_in_the_middle_stops_there(tmp_path: Path) -> None:
    """Good chunks behind a bad one are not shown: what is shown is a prefix, and the place of the fault is told."""
    path = tmp_path / "a.mcap"
    whole = write_story(path, compression="none")
    data = path.read_bytes()
    place = chunk_places(data)[1]
    size = int.from_bytes(data[place + 1 : place + 9], "little")
    path.write_bytes(flipped(data, (place + 9 + size - 3) * 8))
    with read_events(path) as reader:
        items = list(reader)
        assert reader.damage is not None
        assert (reader.damage.offset, reader.damage.torn) == (place, False)
        assert "CRC" in reader.damage.reason
    assert 0 < len(items) < len(whole)
    assert items == whole[: len(items)]
    assert everything(path) == items
    assert zlib.crc32(data) != zlib.crc32(path.read_bytes())
