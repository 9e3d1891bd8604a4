"""One record of an MCAP file and one chunk: bytes to parts, with every size checked before memory is asked for."""

import struct
import zlib
from typing import BinaryIO, Final, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from bridge.edges.recording.layout import MAX_CHUNK_BYTES

MAGIC: Final = b"\x89MCAP0\r\n"
HEAD: Final = struct.Struct("<BQ")
U32: Final = struct.Struct("<I")
U64: Final = struct.Struct("<Q")
_CHUNK: Final = struct.Struct("<QQQII")
HOSTILE: Final = (McapError, struct.error, UnicodeDecodeError, OverflowError, MemoryError)
"""What mcap's parsers raise on bytes that are no record."""


class AttachmentPlace(NamedTuple):
    """An attachment: where it stands, what it is called and how large it is."""

    offset: int
    name: str
    size: int


def opcode_name(opcode: int) -> str:
    """The record's name in the words of MCAP's specification."""
    try:
        return Opcode(opcode).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown (opcode {opcode})"


def _unpacked(compression: bytes, data: bytes, size: int) -> bytes:
    """The chunk's data, at most one byte more than `size`. ValueError when it does not unpack."""
    try:
        match compression:
            case b"":
                return data
            case b"zstd":
                decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
                with decompressor.stream_reader(data) as stream:
                    return stream.read(size + 1)
            case b"lz4":
                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"does not unpack: {error}") from None
    raise ValueError(f"compression {compression!r} is not known")


def record_body(file: BinaryIO) -> bytes:
    """The body of the record at the file's position; b"" when it is longer than is read."""
    head = file.read(HEAD.size)
    length = HEAD.unpack(head)[1] if len(head) == HEAD.size else 0
    return file.read(length) if length <= MAX_CHUNK_BYTES else b""


def chunk_data(body: bytes, strict: bool) -> bytes:
    """The records inside a chunk record. ValueError says what is wrong with it."""
    try:
        _, _, size, crc, name_size = _CHUNK.unpack_from(body)
        place = _CHUNK.size + name_size
        (packed_size,) = U64.unpack_from(body, place)
    except struct.error:
        raise ValueError("is shorter than its head") from None
    packed = body[place + 8 : place + 8 + packed_size]
    if len(packed) != packed_size or (strict and place + 8 + packed_size != len(body)):
        raise ValueError("has a length that disagrees with its content")
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"claims {size} bytes, more than the {MAX_CHUNK_BYTES} that are read")
    data = _unpacked(body[_CHUNK.size : place], packed, size)
    if len(data) != size:
        raise ValueError("unpacks to another size than it says")
    if (crc or strict) and zlib.crc32(data) != crc:
        raise ValueError("has a wrong CRC")
    return data
