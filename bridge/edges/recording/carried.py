"""What a recording carries beside its messages: who recorded it, files, further metadata, and what viewers are given."""

import os
from collections.abc import Mapping

import msgspec
from mcap.records import Channel

from bridge.edges.recording.frames import Frames
from bridge.edges.recording.layout import ABOUT_METADATA, SUMMARY_METADATA, VIEWER_SCHEMAS, About, Attachment
from bridge.edges.recording.records import HOSTILE
from bridge.edges.recording.tally import Totals


class Carried(msgspec.Struct, frozen=True):
    """What carried() found. metadata are the records that are neither `about` nor the summary; summary is None without one.

    has_log says whether there are channels for viewers, language is that of their texts, "" when it is not told.
    """

    about: About
    summary: Totals | None
    attachments: tuple[Attachment, ...]
    metadata: tuple[tuple[str, Mapping[str, str]], ...]
    has_log: bool
    language: str


def is_for_viewers(frames: Frames, channel: Channel) -> bool:
    """Whether the channel is one that we give to viewers, not another program's of the same name."""
    schema = frames.schemas.get(channel.schema_id)
    return schema is not None and VIEWER_SCHEMAS.get(channel.topic) == schema.name


def carried(path: str | os.PathLike[str]) -> Carried:
    """What the recording carries: of a finished file by its index, else by reading through it.

    RecordingError when it cannot be opened or is no MCAP file.
    """
    with Frames(path) as frames:
        frames.only(lambda channel: False)
        frames.use_index()
        for _ in frames.messages():
            pass
        attachments = []
        for place in frames.attachments:
            try:
                found = frames.attachment(place)
            except HOSTILE:  # the index points elsewhere
                continue
            attachments.append(Attachment(found.name, found.data, found.media_type, found.create_time))
        metadata = dict(frames.metadata)
        languages = [each.metadata.get("language", "") for each in frames.channels.values() if is_for_viewers(frames, each)]
        return Carried(
            about=About.of(metadata.get(ABOUT_METADATA, {})),
            summary=Totals.of(metadata.get(SUMMARY_METADATA, {})),
            attachments=tuple(attachments),
            metadata=tuple(each for each in frames.metadata if each[0] not in (ABOUT_METADATA, SUMMARY_METADATA)),
            has_log=bool(languages),
            language=next(filter(None, languages), ""),
        )
