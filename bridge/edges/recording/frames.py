"""The records of an MCAP file, one after the other, up to the first that is damaged.

Rule 1: what is yielded is an exact prefix of what was written. A chunk counts whole, with its CRC right, or not at all.
Rule 2: at the first fault reading stops and `damage` says where and why. It never skips a fault to find more behind it.
Rule 3: in files of our own writer only records that writer makes are accepted, spelled as it spells them, because MCAP
itself tells readers to skip what they do not know: one flipped bit in an opcode or a length would hide a chunk of events.
Rule 4: sizes are checked against the file and MAX_CHUNK_BYTES before memory is asked for.

mcap's own indexed reader gives nothing at all on a file that was cut, and its stream reader skips unknown records; hence this.
"""

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, NamedTuple, Self

import msgspec
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, McapRecord, Metadata, Schema

from bridge.edges.recording.index import LATEST, ChunkPlace, IndexFault, check_footer, read_index
from bridge.edges.recording.layout import ACTIVE_SUFFIX, MAX_CHUNK_BYTES, PROFILE, RecordingError
from bridge.edges.recording.records import (
    HEAD,
    HOSTILE,
    MAGIC,
    U32,
    U64,
    AttachmentPlace,
    chunk_data,
    opcode_name,
    record_body,
)

OWN_LIBRARY: Final = "tcbridge/"
_MESSAGE: Final = struct.Struct("<HIQQ")
_OWN_RECORDS: Final = (Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA)
_CARRIES_EVENTS: Final = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)


class Damage(msgspec.Struct, frozen=True):
    """Where reading ended before the end, and why.

    torn: the file merely stops (not finished, killed, cut); else what is there is wrong.
    """

    offset: int
    reason: str
    torn: bool

    def text(self, path: str | os.PathLike[str]) -> str:
        """What people are told of it. A file that is being written merely stops, and is not called damaged."""
        if self.torn and Path(path).suffix == ACTIVE_SUFFIX:
            return "not finished: it is being written, or was left by a crash"
        return f"damaged at byte {self.offset:,}: {self.reason}"


class RawMessage(NamedTuple):
    """A message as MCAP has it."""

    log_time: int
    publish_time: int
    sequence: int
    channel_id: int
    data: bytes


class _Damaged(ValueError):
    def __init__(self, offset: int, reason: str, torn: bool = False) -> None:
        self.damage = Damage(offset, reason, torn)
        super().__init__(reason)


def _spelled(record: McapRecord, body: bytes) -> bool:
    builder = RecordBuilder()
    record.write(builder)
    spelled: bytes = builder.end()  # type: ignore[no-untyped-call]
    return spelled[HEAD.size :] == body


def _every(channel: Channel) -> bool:
    return True


def _times(body: bytes) -> tuple[int, int]:
    """The log times of the first and last message of a chunk, as its head has them."""
    return U64.unpack_from(body)[0], U64.unpack_from(body, 8)[0]


class Frames:
    """The records of one file. RecordingError when it cannot be opened or is no MCAP file; a context manager.

    While reading goes on, channels, schemas, metadata and attachments fill up, and `record` counts, from 0, the records that
    chunk_starts() tells of; at its end `damage` is None only when the
    file was finished, every CRC in it is right, and nothing follows.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.damage: Damage | None = None
        self.end = len(MAGIC)
        self.strict = True
        self.record = -1
        self.profile = self.library = ""
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.attachments: list[AttachmentPlace] = []
        self._crc: int | None = zlib.crc32(MAGIC)
        self._takes: Callable[[Channel], bool] | None = None
        self._start_ns, self._end_ns = 0, LATEST + 1
        self._passed_over: set[int] = set()
        self._chunks: list[ChunkPlace] | None = None
        self._known_size = 0
        try:
            self._file: BinaryIO = open(self.path, "rb")  # noqa: SIM115 - closed by close()
        except OSError as error:
            raise RecordingError(path, error.strerror or str(error)) from error
        magic = self._read(len(MAGIC))
        if magic != MAGIC:
            self.close()
            what = "is empty" if not magic else "is no MCAP file: it does not start with MCAP's eight bytes"
            raise RecordingError(path, what)
        try:
            self._header()
        except _Damaged as error:
            self.damage = error.damage

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; more than once is fine."""
        self._file.close()

    @property
    def size(self) -> int:
        """Bytes of the file now: one that is being written grows."""
        self._known_size = os.fstat(self._file.fileno()).st_size
        return self._known_size

    def messages(self) -> Iterator[RawMessage]:
        """All messages in file order, once. A message whose channel was not announced is damage."""
        if self.damage is not None:
            return
        try:
            for opcode, offset, body in self._data_section() if self._chunks is None else self._indexed(self._chunks):
                try:
                    yield from self._messages_of(opcode, offset, body)
                except HOSTILE as error:
                    raise _Damaged(offset, f"{opcode_name(opcode)} record: {error or type(error).__name__}") from None
        except _Damaged as error:
            self.damage = error.damage

    def only(self, takes: Callable[[Channel], bool], start_ns: int = 0, end_ns: int = LATEST + 1) -> None:
        """Let messages() give only those of channels that `takes` picks with log times in start_ns <= t < end_ns."""
        self._takes, self._start_ns, self._end_ns = takes, start_ns, end_ns

    def use_index(self) -> str:
        """Let messages() read only the chunks that may hold what only() chose, by the index of a finished file.

        What the index tells is then there at once, and the rest of the file is neither read nor checked. Returns why the file
        is read through nevertheless, "" when it is not.
        """
        if not self.strict:
            return "another program wrote it"
        if self.damage is not None:
            return self.damage.reason
        try:
            index = read_index(self._file, self.size, self._takes or _every, self._start_ns, self._end_ns)
            self.metadata = [(name, self._metadata_at(offset)) for name, offset in index.metadata]
        except IndexFault as fault:
            self.metadata = []
            self._file.seek(self.end)
            return fault.reason
        self.schemas, self.attachments = index.schemas, index.attachments
        for channel in index.channels.values():
            self._announced(channel)
        self._chunks = index.chunks
        return ""

    def _metadata_at(self, offset: int) -> dict[str, str]:
        self._file.seek(offset)
        try:
            record: Metadata = Metadata.read(ReadDataStream(BytesIO(record_body(self._file))))
        except HOSTILE:
            raise IndexFault("metadata stands elsewhere than the index says") from None
        return record.metadata

    def _announced(self, channel: Channel) -> None:
        self.channels[channel.id] = channel
        if self._takes is not None and not self._takes(channel):
            self._passed_over.add(channel.id)
        else:
            self._passed_over.discard(channel.id)

    def _indexed(self, chunks: list[ChunkPlace]) -> Iterator[tuple[int, int, bytes]]:
        for chunk in chunks:
            self._file.seek(chunk.offset)
            opcode, head, body = self._next(chunk.offset)
            if opcode != Opcode.CHUNK or len(head) + len(body) != chunk.length or _times(body) != chunk[2:4]:
                raise _Damaged(chunk.offset, f"{opcode_name(opcode)} record where the index has another chunk")
            self.record += 1
            yield opcode, chunk.offset, body

    def chunk_starts(self) -> list[int]:
        """The earliest log time of each record that holds messages, in file order; from the heads only, before messages()."""
        starts = []
        offset = self.end
        size = self.size
        while offset + HEAD.size <= size:
            self._file.seek(offset)
            opcode, length = HEAD.unpack(self._read(HEAD.size))
            if opcode in (0, Opcode.DATA_END) or (length > MAX_CHUNK_BYTES and opcode in _CARRIES_EVENTS):
                break
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                head = self._read(16)
                if len(head) < 16:
                    break
                starts.append(U64.unpack_from(head, 6 if opcode == Opcode.MESSAGE else 0)[0])
            offset += HEAD.size + length
        self._file.seek(self.end)
        return starts

    def attachment(self, place: AttachmentPlace) -> Attachment:
        """An attachment that was passed. Call it when reading is over."""
        self._file.seek(place.offset)
        attachment: Attachment = Attachment.read(ReadDataStream(BytesIO(record_body(self._file))))
        return attachment

    def _read(self, size: int) -> bytes:
        try:
            return self._file.read(size)
        except OSError as error:
            raise RecordingError(self.path, error.strerror or str(error)) from error

    def _next(self, offset: int) -> tuple[int, bytes, bytes]:
        """Opcode, head and body of the next record. Large records of no interest are passed over (foreign files only)."""
        head = self._read(HEAD.size)
        if len(head) < HEAD.size:
            raise _Damaged(offset, "the file ends without its footer", torn=True)
        opcode, length = HEAD.unpack(head)
        if not opcode:
            raise _Damaged(offset, "zeros where a record should stand")
        if offset + HEAD.size + length > self._known_size and offset + HEAD.size + length > self.size:
            raise _Damaged(offset, f"the file ends inside a {opcode_name(opcode)} record", torn=True)
        if length > MAX_CHUNK_BYTES:
            if self.strict or opcode in _CARRIES_EVENTS:
                raise _Damaged(offset, f"{opcode_name(opcode)} record of {length} bytes, more than are read")
            self._file.seek(length, os.SEEK_CUR)
            self._crc = None
            self.end = offset + HEAD.size + length
            return self._next(self.end)
        body = self._read(length)
        if len(body) < length:
            raise _Damaged(offset, f"the file ends inside a {opcode_name(opcode)} record", torn=True)
        return opcode, head, body

    def _taken(self, head: bytes, body: bytes) -> None:
        self.end += len(head) + len(body)
        if self._crc is not None:
            self._crc = zlib.crc32(body, zlib.crc32(head, self._crc))

    def _header(self) -> None:
        opcode, head, body = self._next(self.end)
        if opcode != Opcode.HEADER:
            raise _Damaged(self.end, f"{opcode_name(opcode)} record where the header should stand")
        try:
            header = Header.read(ReadDataStream(BytesIO(body)))
        except HOSTILE as error:
            raise _Damaged(self.end, f"header record: {error or type(error).__name__}") from None
        self.profile, self.library = header.profile, header.library
        self.strict = header.profile == PROFILE and header.library.startswith(OWN_LIBRARY)
        self._taken(head, body)

    def _data_section(self) -> Iterator[tuple[int, int, bytes]]:
        while True:
            opcode, head, body = self._next(self.end)
            offset = self.end
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._check_end(opcode, offset, head + body)
                return
            if self.strict:
                self._check_own(opcode, offset, body)
                if opcode == Opcode.MESSAGE_INDEX:  # most of the records, and nothing in them for who reads in order
                    self._taken(head, body)
                    continue
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                self.record += 1
            yield opcode, offset, body
            self._taken(head, body)

    def _check_own(self, opcode: int, offset: int, body: bytes) -> None:
        if opcode not in _OWN_RECORDS:
            raise _Damaged(offset, f"{opcode_name(opcode)} record where none is written")
        try:
            match opcode:
                case Opcode.MESSAGE_INDEX:
                    right = U32.unpack_from(body, 2)[0] == len(body) - 6
                case Opcode.ATTACHMENT:
                    right = _spelled(Attachment.read(ReadDataStream(BytesIO(body))), body)
                case Opcode.METADATA:
                    right = _spelled(Metadata.read(ReadDataStream(BytesIO(body))), body)
                case _:
                    right = True
        except HOSTILE:
            right = False
        if not right:
            raise _Damaged(offset, f"{opcode_name(opcode)} record is damaged")

    def _messages_of(self, opcode: int, offset: int, body: bytes) -> Iterator[RawMessage]:
        match opcode:
            case Opcode.CHUNK:
                try:
                    data = chunk_data(body, self.strict)
                except ValueError as error:
                    raise _Damaged(offset, f"chunk {error}") from None
                yield from self._in_chunk(offset, data)
            case Opcode.METADATA:
                metadata = Metadata.read(ReadDataStream(BytesIO(body)))
                self.metadata.append((metadata.name, metadata.metadata))
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(ReadDataStream(BytesIO(body)))
                self.attachments.append(AttachmentPlace(offset, attachment.name, len(attachment.data)))
            case Opcode.MESSAGE | Opcode.CHANNEL | Opcode.SCHEMA:
                yield from self._in_chunk(offset, HEAD.pack(opcode, len(body)) + body)

    def _in_chunk(self, offset: int, data: bytes) -> Iterator[RawMessage]:
        place, end = 0, len(data)
        channels, passed_over, start_ns, end_ns = self.channels, self._passed_over, self._start_ns, self._end_ns
        head, message = HEAD.unpack_from, _MESSAGE.unpack_from
        while place < end:
            opcode, length = head(data, place)
            place += 9
            stop = place + length
            if stop > end:
                raise _Damaged(offset, f"chunk ends inside a {opcode_name(opcode)} record")
            if opcode == Opcode.MESSAGE:
                channel_id, sequence, log_time, publish_time = message(data, place)
                if channel_id not in channels:
                    raise _Damaged(offset, f"message of channel {channel_id}, which was not announced")
                if start_ns <= log_time < end_ns and channel_id not in passed_over:
                    yield RawMessage(log_time, publish_time, sequence, channel_id, data[place + 22 : stop])
            elif not opcode:
                raise _Damaged(offset, "zeros in a chunk where a record should stand")
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(data[place:stop])))
                self._announced(channel)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(data[place:stop])))
                self.schemas[schema.id] = schema
            place = stop

    def _check_end(self, opcode: int, offset: int, record: bytes) -> None:
        if opcode == Opcode.DATA_END:
            if len(record) != HEAD.size + 4:
                raise _Damaged(offset, "data end record is damaged")
            (crc,) = U32.unpack_from(record, HEAD.size)
            if crc and self._crc is not None and crc != self._crc:
                raise _Damaged(offset, "the data before it has another CRC than the data end record says")
            if self.strict and not crc:
                raise _Damaged(offset, "data end record is damaged")
            start = offset + len(record)
        else:
            start = offset
        try:
            check_footer(self._file, start, self.size)
        except IndexFault as fault:
            raise _Damaged(start, fault.reason, fault.torn) from None
