"""What the end of a finished file says: its channels, their counts, and where chunks, attachments and metadata stand.

Rule 1: it is believed only when the footer and its CRC are right and the places fit the file and each other; else IndexFault
says why not, and the file has to be read through.
Rule 2: memory is bounded by the chunks that can match: places of the others are checked and forgotten.
Rule 3: only for files of our own writer. In those log times never go back, and channels never change.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import BinaryIO, Final, NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Footer, MetadataIndex, Schema, Statistics

from bridge.edges.recording.layout import MAX_CHUNK_BYTES
from bridge.edges.recording.records import HEAD, HOSTILE, MAGIC, AttachmentPlace, opcode_name

LATEST: Final = 2**64 - 1
_FOOTER_BYTES: Final = HEAD.size + 20
_DATA_END_BYTES: Final = HEAD.size + 4
_BLOCK: Final = 1 << 20
_CHUNK_INDEX: Final = struct.Struct("<QQQQI")
_OFFSET_BYTES: Final = 10


class IndexFault(ValueError):
    """What is wrong with the end of a file; torn: it merely stops."""

    def __init__(self, reason: str, *, torn: bool = False) -> None:
        self.reason, self.torn = reason, torn
        super().__init__(reason)


class ChunkPlace(NamedTuple):
    """A chunk record: where it stands, how long it is, the log times of its first and last message, and its channels."""

    offset: int
    length: int
    first_ns: int
    last_ns: int
    channels: frozenset[int]


class Index(msgspec.Struct):
    """What the summary section holds. metadata: names and offsets; chunks: those that can match."""

    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    counts: dict[int, int] = {}
    attachments: list[AttachmentPlace] = []
    metadata: list[tuple[str, int]] = []
    chunks: list[ChunkPlace] = []
    chunk_count: int = 0


def check_footer(file: BinaryIO, start: int, size: int) -> Footer:
    """The footer of a file whose summary starts at `start`, with its CRC checked. IndexFault when something is wrong."""
    place = size - len(MAGIC) - _FOOTER_BYTES
    file.seek(max(start, place))
    end = file.read(_FOOTER_BYTES + len(MAGIC))
    if place < start or not end.endswith(MAGIC):
        raise IndexFault("the file ends inside its summary", torn=True)
    opcode, length = HEAD.unpack_from(end)
    if opcode != Opcode.FOOTER or length != _FOOTER_BYTES - HEAD.size:
        raise IndexFault("the footer is damaged")
    footer: Footer = Footer.read(ReadDataStream(BytesIO(end[HEAD.size :])))
    if footer.summary_start not in (0, start):
        raise IndexFault("the footer points elsewhere")
    if footer.summary_crc and _crc(file, start, size - len(MAGIC) - 4) != footer.summary_crc:
        raise IndexFault("the summary has a wrong CRC")
    return footer


def _crc(file: BinaryIO, start: int, end: int) -> int:
    file.seek(start)
    crc = 0
    while (left := end - file.tell()) > 0:
        block = file.read(min(left, _BLOCK))
        if not block:
            raise IndexFault("the file ends inside its summary", torn=True)
        crc = zlib.crc32(block, crc)
    return crc


def read_index(
    file: BinaryIO,
    size: int,
    takes: Callable[[Channel], bool] = lambda channel: False,
    start_ns: int = 0,
    end_ns: int = LATEST,
) -> Index:
    """The summary of a file of our own writer, with the chunks that may hold messages of channels that `takes` picks.

    They are those with log times in start_ns <= t < end_ns. IndexFault when the summary cannot be believed.
    """
    file.seek(max(0, size - len(MAGIC) - _FOOTER_BYTES))
    start = int.from_bytes(file.read(_FOOTER_BYTES)[HEAD.size :][:8], "little")
    if not len(MAGIC) + _DATA_END_BYTES <= start < size:
        raise IndexFault("there is no summary")
    footer = check_footer(file, start, size)
    file.seek(start - _DATA_END_BYTES)
    if HEAD.unpack(file.read(HEAD.size)) != (Opcode.DATA_END, 4) or not footer.summary_crc:
        raise IndexFault("the summary does not follow the data")
    try:
        return _read(_records(file, start, size), start - _DATA_END_BYTES, takes, start_ns, end_ns)
    except HOSTILE as error:
        raise IndexFault(f"the summary cannot be read: {error or type(error).__name__}") from None


def _records(file: BinaryIO, start: int, size: int) -> Iterator[tuple[int, bytes]]:
    file.seek(start)
    place, end = start, size - len(MAGIC) - _FOOTER_BYTES
    while place < end:
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        place += HEAD.size + length
        if place > end or length > MAX_CHUNK_BYTES:
            raise IndexFault(f"{opcode_name(opcode)} record in the summary is too long")
        yield opcode, file.read(length)


def _read(
    records: Iterator[tuple[int, bytes]], data_end: int, takes: Callable[[Channel], bool], start_ns: int, end_ns: int
) -> Index:
    index = Index()
    wanted: dict[int, bool] = {}
    sets: dict[tuple[bytes, bytes], tuple[frozenset[int], bool]] = {}
    place, last_ns = len(MAGIC), -1
    statistics: Statistics | None = None
    for opcode, body in records:
        if opcode == Opcode.CHUNK_INDEX:  # there are as many as flushes: taken apart here, and most have the same channels
            first, last, offset, length, size = _CHUNK_INDEX.unpack_from(body)
            end = _CHUNK_INDEX.size + size
            ids = body[_CHUNK_INDEX.size : end : _OFFSET_BYTES], body[_CHUNK_INDEX.size + 1 : end : _OFFSET_BYTES]
            found = sets.get(ids)
            if found is None:
                if size % _OFFSET_BYTES or end > len(body):
                    raise IndexFault("the chunk index contradicts itself")
                channels = frozenset(low | high << 8 for low, high in zip(*ids, strict=True))
                if not channels <= wanted.keys():
                    raise IndexFault("the chunk index contradicts itself")
                found = sets[ids] = channels, any(wanted[number] for number in channels)
            index.chunk_count += 1
            if offset < place:
                raise IndexFault("the chunk index contradicts itself")
            place = offset + length
            if not size:
                continue
            if not last_ns <= first <= last or place > data_end:
                raise IndexFault("the chunk index contradicts itself")
            last_ns = last
            if last >= start_ns and first < end_ns and found[1]:
                index.chunks.append(ChunkPlace(offset, length, first, last, found[0]))
            continue
        stream = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(stream)
                index.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                index.channels[channel.id] = channel
                wanted[channel.id] = takes(channel)
            case Opcode.STATISTICS:
                statistics = Statistics.read(stream)
                index.counts = statistics.channel_message_counts
            case Opcode.ATTACHMENT_INDEX:
                attachment = AttachmentIndex.read(stream)
                index.attachments.append(AttachmentPlace(attachment.offset, attachment.name, attachment.data_size))
            case Opcode.METADATA_INDEX:
                metadata = MetadataIndex.read(stream)
                index.metadata.append((metadata.name, metadata.offset))
            case _:
                pass
    if statistics is None or statistics.chunk_count != index.chunk_count:
        raise IndexFault("the chunk index is not whole")
    return index
