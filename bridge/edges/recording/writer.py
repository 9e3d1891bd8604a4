"""Writes a recording so that a crash costs at most what was not yet flushed.

Rule 1: the file is `name.mcap.active` until finish() has written everything; then it gets its name. Nothing that exists is
ever overwritten, and two writers never share a file (the active file is locked while it is open).
Rule 2: no thread and no clock in here. Arrival times come in, and who calls decides when to flush().
Rule 3: values are checked before mcap sees them: one bad number inside mcap's writer spoils the whole file.
Rule 4: after an error of the disk, or an interruption in the middle of a write, the writer refuses everything. What was
flushed before is on disk and can be read and recovered. A file that somebody deletes meanwhile is such an error.

What survives: after flush() a killed process loses nothing; with sync=True a power cut neither, at the price of one
fsync per flush (measured: 236,000 events/s fall to 56,000 when each 100 are synced).
"""

import contextlib
import errno
import os
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import index
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import BinaryIO, Final, Self

import msgspec
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from bridge.core import codec
from bridge.core.events import AnyEvent
from bridge.core.keys import EventKey, event_key
from bridge.core.times import MAX_TIME_NS, check_time
from bridge.edges.recording.frames import OWN_LIBRARY
from bridge.edges.recording.layout import (
    ABOUT_METADATA,
    ACTIVE_SUFFIX,
    ALARMS_PER_MESSAGE,
    GAPS_TOPIC,
    MAX_ATTACHMENT_BYTES,
    MAX_ELEMENT_BYTES,
    MAX_EVENT_CHANNELS,
    MAX_REJECTED_BYTES,
    MESSAGE_ENCODINGS,
    PROFILE,
    REJECTED_TOPIC,
    SCHEMA_ATTACHMENT,
    STATE_TOPIC,
    SUMMARY_METADATA,
    VIEWER_SCHEMAS,
    About,
    Attachment,
    Compression,
    EventChannel,
    Gap,
    RecordingError,
    RejectedPayload,
    StateFrame,
    StatePart,
    event_schema,
    gap_schema,
    plain,
    state_schema,
)
from bridge.edges.recording.tally import ChannelTally, Tally, Totals
from bridge.edges.recording.viewer import Viewer, log_schema, span_schema

try:
    import fcntl
except ImportError:  # no POSIX locks here: two writers are still kept apart by exclusive creation
    fcntl = None  # type: ignore[assignment]

COMPRESSIONS: Final[dict[Compression, CompressionType]] = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
_NONE: Final[Mapping[str, str]] = MappingProxyType({})
CHUNK_SIZES: Final = range(1 << 10, (16 << 20) + 1)


class RecordingWriter:
    """One recording being written. A context manager: it finishes the file on leaving, unless writing has failed.

    path: the name it will have, ending in .mcap. ValueError for another name or a size out of range; RecordingError when the
    file or its active form exists, or cannot be created. about and attachments explain the recording to whoever opens it.
    With a viewer every event, gap and rejected payload is followed by what viewers show of it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        about: About | None = None,
        attachments: Iterable[Attachment] = (),
        compression: Compression = "zstd",
        chunk_size: int = 1 << 20,
        sync: bool = False,
        viewer: Viewer | None = None,
    ) -> None:
        about = about or About()
        self.path = Path(path)
        self.active_path = self.path.with_name(self.path.name + ACTIVE_SUFFIX)
        if self.path.suffix != ".mcap":
            raise ValueError(f"{self.path.name!r} does not end in .mcap")
        if compression not in COMPRESSIONS:
            raise ValueError(f"compression {compression!r} is not one of {', '.join(COMPRESSIONS)}")
        if chunk_size not in CHUNK_SIZES:
            raise ValueError(f"chunk_size {chunk_size} is outside {CHUNK_SIZES.start}..{CHUNK_SIZES.stop - 1}")
        self._sync = sync
        self._started_ns = check_time(index(about.started_ns))
        self._last_log_ns = 0
        self._channels: dict[tuple[str, str, str, str], tuple[int, ChannelTally]] = {}
        self._own_channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._viewer = viewer
        if viewer is not None:
            viewer.begin()
        self._unexplained: dict[str, AnyEvent] = {}
        self._explained: set[str] = set()
        self._tally = Tally()
        self._done = False
        self._fault = ""
        carried = [Attachment(SCHEMA_ATTACHMENT, event_schema(), "application/schema+json"), *attachments]
        for attachment in carried:
            _check_attachment(attachment)
        self._file = self._create()
        self._mcap = Writer(self._file, chunk_size, COMPRESSIONS[compression], enable_data_crcs=True)
        try:
            with self._writing():
                self._mcap.start(PROFILE, plain(f"{OWN_LIBRARY}{about.version} {LIBRARY_IDENTIFIER}"))
                self._mcap.add_metadata(ABOUT_METADATA, about.metadata())
            for attachment in carried:
                self.attach(attachment)
            self.flush()
        except RecordingError:
            with contextlib.suppress(OSError):
                self.active_path.unlink()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._done:
            return
        if self._fault:
            self.abandon()
        else:
            self.finish()

    @property
    def size_bytes(self) -> int:
        """Bytes handed to the file so far; what is still in the open chunk is not counted."""
        return 0 if self._file.closed else self._file.tell()

    @property
    def last_log_time_ns(self) -> int:
        """The log time of the last message, 0 before the first."""
        return self._last_log_ns

    @property
    def totals(self) -> Totals:
        """What the file holds so far."""
        return self._tally.totals()

    def add(self, element: bytes, encoding: str, key: EventKey, event: AnyEvent, arrival_ns: int) -> int:
        """Record one event: its bytes as they were on the wire, and what they say. Returns its log time.

        ValueError or TypeError, and nothing written, for values a recording cannot hold.
        """
        place = (key.realm, key.target, key.event_class, encoding)
        known = self._channels.get(place)
        if known is None:
            if encoding not in MESSAGE_ENCODINGS:
                raise ValueError(f"encoding {encoding!r} is not one of {', '.join(MESSAGE_ENCODINGS)}")
            if len(self._channels) >= MAX_EVENT_CHANNELS:
                reason = f"more than {MAX_EVENT_CHANNELS} targets and classes in one recording"
                return self.add_rejected(event_key(key.realm, event), encoding, element, reason, arrival_ns)
        if not isinstance(element, bytes) or len(element) > MAX_ELEMENT_BYTES:
            raise ValueError(f"an element is bytes, at most {MAX_ELEMENT_BYTES}")
        log_time = self._log_time(arrival_ns)
        time_ns = check_time(index(event.time_ns))
        sequence = index(event.key_seq) & 0xFFFFFFFF
        if known is None:
            known = self._channels[place] = self._register(EventChannel(*place))
            if self._viewer is not None and key.event_class not in self._explained:
                self._unexplained[key.event_class] = event
        channel_id, counts = known
        self._put(channel_id, log_time, element, time_ns or log_time, sequence)
        counts.add(event)
        self._tally.event_time(time_ns)
        if self._viewer is not None:
            for said in self._viewer.event(event, log_time):
                self.add_for_viewers(*said, self._viewer.metadata)
        return log_time

    def add_rejected(self, key: str, encoding: str, payload: bytes, reason: str, arrival_ns: int) -> int:
        """Record a payload that could not be decoded, with the key it came on; returns its log time."""
        kept = bytes(payload[:MAX_REJECTED_BYTES])
        body = RejectedPayload(key=plain(key), encoding=plain(encoding), payload=kept, size=len(payload), reason=plain(reason))
        return self.copy_rejected(body, arrival_ns)

    def copy_rejected(self, body: RejectedPayload, arrival_ns: int) -> int:
        """Record what another recording has of a payload that could not be decoded; returns its log time."""
        log_time = self._add_own(REJECTED_TOPIC, body, arrival_ns, self._tally.rejected + 1)
        self._tally.rejected += 1
        if self._viewer is not None:
            self.add_for_viewers(*self._viewer.rejected(body, log_time), self._viewer.metadata)
        return log_time

    def add_gap(self, gap: Gap, arrival_ns: int) -> int:
        """Record that something is missing here; returns its log time."""
        log_time = self._add_own(GAPS_TOPIC, gap, arrival_ns, self._tally.gaps + 1)
        self._tally.gap(gap)
        if self._viewer is not None:
            self.add_for_viewers(*self._viewer.gap(gap, log_time), self._viewer.metadata)
        return log_time

    def add_state(self, state: StateFrame, arrival_ns: int) -> int:
        """Record a keyframe; one with many alarms in several messages. Returns the log time of the last."""
        alarms = state.alarms
        parts = max(1, -(-len(alarms) // ALARMS_PER_MESSAGE))
        log_time = 0
        for part in range(1, parts + 1):
            body = StatePart(
                realm=state.realm,
                target=state.target,
                session=state.session,
                seq=state.seq,
                alarms=alarms[(part - 1) * ALARMS_PER_MESSAGE : part * ALARMS_PER_MESSAGE],
                last_seq=state.last_seq,
                part=part,
                parts=parts,
            )
            log_time = self._add_own(STATE_TOPIC, body, arrival_ns, part)
        self._tally.state(state)
        if self._viewer is not None:
            self._viewer.state(alarms)
        return log_time

    def add_for_viewers(self, topic: str, data: bytes, metadata: Mapping[str, str] = _NONE) -> None:
        """Put a message for viewers (viewer.py) behind what was written last, at its log time. It is not counted.

        metadata is that of the channel, and counts when the channel is new.
        """
        self._put(self._own_channel(topic, metadata), self._last_log_ns, data, self._last_log_ns, 0)

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Carry a table of texts. It is on disk after the next flush()."""
        with self._writing():
            self._mcap.add_metadata(plain(name), {plain(key): plain(text) for key, text in texts.items()})

    def _explain(self) -> None:
        """Attach the definitions of classes that are known by now, if nobody else has them."""
        for event in tuple(self._unexplained.values()):
            found = self._viewer.known(event).lookup(event.event_class) if self._viewer is not None else None
            if self._viewer is not None and found is not None:
                del self._unexplained[event.event_class]
                self._explained.add(event.event_class)
                definition = self._viewer.definition(found)
                if definition is not None:
                    self.attach(definition)

    def attach(self, attachment: Attachment) -> None:
        """Carry a file in the recording. It is on disk after the next flush()."""
        _check_attachment(attachment)
        created, log_time = attachment.create_time_ns, self._last_log_ns or self._started_ns
        with self._writing():
            self._mcap.add_attachment(created, log_time, plain(attachment.name), plain(attachment.media_type), attachment.data)

    def flush(self) -> None:
        """Hand everything to the operating system: what was added survives the death of this process."""
        self._explain()
        with self._writing():
            self._mcap.flush()  # type: ignore[no-untyped-call]
            if self._sync:
                os.fsync(self._file.fileno())
            if not os.fstat(self._file.fileno()).st_nlink:
                raise FileNotFoundError(errno.ENOENT, "it was deleted while it was written")

    def finish(self, unknown_tails: Sequence[str] = (), next_file: str = "") -> Path:
        """Write the summary, close, and give the file its name, which is returned.

        unknown_tails: the sessions that were heard but did not say where they ended; with any, the recording is not complete.
        next_file: the name of the file in which the recording goes on.
        """
        self._explain()
        summary = self._tally.totals(tuple(unknown_tails), plain(next_file)).metadata()
        with self._writing():
            self._mcap.add_metadata(SUMMARY_METADATA, summary)
            self._mcap.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            os.fsync(self._file.fileno())
            name_finished(self.active_path, self.path)
            self._file.close()
        self._done = True
        return self.path

    def abandon(self) -> None:
        """Close without finishing: the active file stays, readable up to the last flush() and recoverable."""
        self._done = True
        self._fault = self._fault or "was abandoned"
        with contextlib.suppress(OSError):
            self._file.close()

    def _create(self) -> BinaryIO:
        if os.path.lexists(self.path):
            raise RecordingError(self.path, "exists, and a recording never overwrites a file")
        try:
            file = open(self.active_path, "xb")  # noqa: SIM115 - closed by finish() or abandon()
        except FileExistsError:
            raise RecordingError(self.active_path, "exists: it is being written, or was left by a crash; recover it") from None
        except OSError as error:
            raise RecordingError(self.active_path, error.strerror or str(error)) from error
        lock(file, self.active_path)
        return file

    def _log_time(self, arrival_ns: int) -> int:
        arrival = check_time(index(arrival_ns))
        log_time = arrival if arrival > self._last_log_ns else self._last_log_ns + 1
        return log_time if log_time <= MAX_TIME_NS else check_time(log_time)

    def _register(self, channel: EventChannel) -> tuple[int, ChannelTally]:
        topic, metadata = channel.topic, channel.metadata()
        with self._writing():
            schema = self._schema("tcbridge.Event") if channel.encoding == codec.JSON else 0
            number = self._mcap.register_channel(topic, MESSAGE_ENCODINGS[channel.encoding], schema, metadata)
        return number, self._tally.channel(channel)

    def _schema(self, name: str) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._mcap.register_schema(name, "jsonschema", _SCHEMAS[name]())
        return self._schemas[name]

    def _add_own(self, topic: str, body: msgspec.Struct, arrival_ns: int, number: int) -> int:
        data = msgspec.json.encode(body)
        log_time = self._log_time(arrival_ns)
        self._put(self._own_channel(topic), log_time, data, log_time, number & 0xFFFFFFFF)
        return log_time

    def _own_channel(self, topic: str, metadata: Mapping[str, str] = _NONE) -> int:
        if topic not in self._own_channels:
            with self._writing():
                schema = self._schema(_OWN_SCHEMAS[topic]) if topic in _OWN_SCHEMAS else 0
                self._own_channels[topic] = self._mcap.register_channel(topic, "json", schema, dict(metadata))
        return self._own_channels[topic]

    def _put(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int) -> None:
        # The same as _writing(), spelled out: this is called for every event.
        if self._fault or self._done:
            self._refuse()
        self._fault = _INTERRUPTED
        try:
            self._mcap.add_message(channel_id, log_time, data, publish_time, sequence)
        except _FAILURES as error:
            raise self._failed(error) from error
        self._fault = ""
        self._last_log_ns = log_time
        self._tally.time(log_time)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        if self._fault or self._done:
            self._refuse()
        self._fault = _INTERRUPTED
        try:
            yield
        except _FAILURES as error:
            raise self._failed(error) from error
        self._fault = ""

    def _refuse(self) -> None:
        raise RecordingError(self.path, "is finished" if self._done and not self._fault else self._fault)

    def _failed(self, error: Exception) -> RecordingError:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        self._fault = f"cannot be written: {reason or type(error).__name__}"
        with contextlib.suppress(OSError):
            self._file.close()
        return error if isinstance(error, RecordingError) else RecordingError(self.active_path, self._fault)


_INTERRUPTED: Final = "an interruption in the middle of a write left it unsound; what was flushed can be recovered"
_FAILURES: Final = (OSError, MemoryError, struct.error, ValueError)
_SCHEMAS: Final = {
    "tcbridge.Event": event_schema,
    "tcbridge.Gap": gap_schema,
    "tcbridge.State": state_schema,
    "foxglove.Log": log_schema,
    "foxglove.Event": span_schema,
}
_OWN_SCHEMAS: Final = {GAPS_TOPIC: "tcbridge.Gap", STATE_TOPIC: "tcbridge.State", **VIEWER_SCHEMAS}


def _check_attachment(attachment: Attachment) -> None:
    if not isinstance(attachment.data, bytes) or len(attachment.data) > MAX_ATTACHMENT_BYTES:
        raise ValueError(f"attachment {attachment.name!r}: data is bytes, at most {MAX_ATTACHMENT_BYTES}")
    check_time(index(attachment.create_time_ns))


def lock(file: BinaryIO | int, path: str | os.PathLike[str], held: str = "is being written by a running recorder") -> None:
    """Hold an open file or folder until it is closed. RecordingError, saying `held`, when another process holds it."""
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise RecordingError(path, held) from None
    except OSError:  # a file system without locks
        return


def name_finished(active: Path, path: Path) -> None:
    """Give a finished file its name, never taking the place of another. RecordingError when there is one."""
    try:
        try:
            os.link(active, path)
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            if os.path.lexists(path):
                raise FileExistsError from None
            os.rename(active, path)
        else:
            os.unlink(active)
    except FileExistsError:
        raise RecordingError(path, f"appeared meanwhile; the finished recording stays in {active.name}") from None
    with contextlib.suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
