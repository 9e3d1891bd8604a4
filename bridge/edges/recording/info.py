"""What a recording holds: from its summary when that is whole, else by reading all of it.

Rule 1: the summary is believed only when the footer, its CRC and the CRC of the counts are right.
Rule 2: a file that was not finished, or is damaged, is never "complete": a torn one has an unknown tail, one with wrong
bytes inside is not complete.
"""

import os
from collections.abc import Callable, Iterable
from io import BytesIO
from typing import BinaryIO, Final

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.records import Channel, Metadata

from bridge.core.events import DEFAULT_LIMITS, Limits
from bridge.edges.recording.frames import Damage, Frames
from bridge.edges.recording.index import read_index
from bridge.edges.recording.layout import (
    ABOUT_METADATA,
    SUMMARY_METADATA,
    About,
    Completeness,
    EventChannel,
    RecordingError,
    event_channel,
)
from bridge.edges.recording.reader import Interpretation
from bridge.edges.recording.records import HOSTILE, record_body
from bridge.edges.recording.tally import Tally, Totals

PROGRESS_MESSAGES: Final = 1000
MAX_PARTS: Final = 10_000
"""How far parts are counted: a number in a file is a claim."""


class ChannelInfo(msgspec.Struct, frozen=True):
    """One channel; `place` is None for those that do not carry events."""

    topic: str
    message_encoding: str
    messages: int
    place: EventChannel | None


class RecordingInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What `tcbridge info` tells. from_summary: only the file's head and end were read."""

    path: str
    size_bytes: int
    about: About
    totals: Totals
    complete: Completeness
    damage: Damage | None
    channels: tuple[ChannelInfo, ...]
    attachments: tuple[str, ...]
    from_summary: bool

    @property
    def truncated(self) -> bool:
        """Whether the file ends before its end."""
        return self.damage is not None


def summary(
    path: str | os.PathLike[str],
    *,
    limits: Limits = DEFAULT_LIMITS,
    on_progress: Callable[[int], None] = lambda messages: None,
) -> RecordingInfo:
    """What the recording holds; a file of any size is told in milliseconds when it was finished.

    Else it is read through, and on_progress hears how many messages were read.

    RecordingError when it cannot be opened or is no MCAP file.
    """
    try:
        return _from_summary(path) or scan(path, limits=limits, on_progress=on_progress)
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(path, error.strerror or str(error)) from error


def missing_parts(infos: Iterable[RecordingInfo]) -> list[tuple[str, int]]:
    """Parts of split recordings that are not among the files though an earlier and a later one is: recording and number."""
    parts: dict[str, set[int]] = {}
    for info in infos:
        if info.about.recording and info.about.part:
            parts.setdefault(info.about.recording, set()).add(info.about.part)
    return [
        (recording, part)
        for recording, there in parts.items()
        for part in range(min(there), min(max(there), min(there) + MAX_PARTS))
        if part not in there
    ]


def scan(
    path: str | os.PathLike[str],
    *,
    limits: Limits = DEFAULT_LIMITS,
    on_progress: Callable[[int], None] = lambda messages: None,
) -> RecordingInfo:
    """The same, by reading and decoding everything."""
    tally = Tally()
    messages: dict[int, int] = {}
    with Frames(path) as frames:
        interpret = Interpretation(frames, limits, tally)
        for done, raw in enumerate(frames.messages(), 1):
            if done % PROGRESS_MESSAGES == 0:
                on_progress(done)
            messages[raw.channel_id] = messages.get(raw.channel_id, 0) + 1
            interpret(raw)
        metadata = dict(frames.metadata)
        written = Totals.of(metadata.get(SUMMARY_METADATA, {}))
        totals = tally.totals(written.unknown_tails if written is not None else ("*",))
        complete: Completeness = totals.complete
        if frames.damage is not None and complete == "yes":
            complete = "tail unknown"
        if frames.damage is not None and not frames.damage.torn:
            complete = "no"
        return RecordingInfo(
            path=os.fspath(path),
            size_bytes=frames.size,
            about=About.of(metadata.get(ABOUT_METADATA, {})),
            totals=totals,
            complete=complete,
            damage=frames.damage,
            channels=_channels(frames.channels, messages),
            attachments=tuple(place.name for place in frames.attachments),
            from_summary=False,
        )


def _channels(channels: dict[int, Channel], messages: dict[int, int]) -> tuple[ChannelInfo, ...]:
    infos = []
    for channel in channels.values():
        place = event_channel(channel.message_encoding, channel.metadata)
        infos.append(ChannelInfo(channel.topic, channel.message_encoding, messages.get(channel.id, 0), place))
    return tuple(infos)


def _from_summary(path: str | os.PathLike[str]) -> RecordingInfo | None:
    with Frames(path) as frames, open(path, "rb") as file:
        if not frames.strict or frames.damage is not None:
            return None  # another tool wrote or changed it: its messages may not be those of the summary
        try:
            return _told(os.fspath(path), file, frames.size)
        except (*HOSTILE, ValueError, OSError):
            return None


def _told(path: str, file: BinaryIO, size: int) -> RecordingInfo | None:
    index = read_index(file, size)
    places = dict(index.metadata)
    infos = _channels(index.channels, index.counts)
    totals = Totals.of(_metadata(file, places.get(SUMMARY_METADATA)))
    if totals is None or totals.events != sum(info.messages for info in infos if info.place is not None):
        return None
    return RecordingInfo(
        path=path,
        size_bytes=size,
        about=About.of(_metadata(file, places.get(ABOUT_METADATA))),
        totals=totals,
        complete=totals.complete,
        damage=None,
        channels=infos,
        attachments=tuple(place.name for place in index.attachments),
        from_summary=True,
    )


def _metadata(file: BinaryIO, offset: int | None) -> dict[str, str]:
    if offset is None:
        return {}
    file.seek(offset)
    record: Metadata = Metadata.read(ReadDataStream(BytesIO(record_body(file))))
    return record.metadata
