"""What a recording carries beside its messages: who recorded it, files, further metadata, and which channels there are."""

import os
from collections.abc import Mapping

import msgspec

from bridge.edges.recording.frames import Frames
from bridge.edges.recording.layout import ABOUT_METADATA, LOG_TOPIC, SUMMARY_METADATA, VIEWER_TOPICS, About, Attachment
from bridge.edges.recording.records import HOSTILE
from bridge.edges.recording.tally import Totals


class Carried(msgspec.Struct, frozen=True):
    """What carried() found. metadata are the records that are neither `about` nor the summary; summary is None without one.

    language is that of the log for viewers, "" when there is none or it is not told.
    """

    about: About
    summary: Totals | None
    attachments: tuple[Attachment, ...]
    metadata: tuple[tuple[str, Mapping[str, str]], ...]
    topics: frozenset[str]
    language: str

    @property
    def has_log(self) -> bool:
        """Whether there are channels for viewers."""
        return not self.topics.isdisjoint(VIEWER_TOPICS)


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
        return Carried(
            about=About.of(metadata.get(ABOUT_METADATA, {})),
            summary=Totals.of(metadata.get(SUMMARY_METADATA, {})),
            attachments=tuple(attachments),
            metadata=tuple(each for each in frames.metadata if each[0] not in (ABOUT_METADATA, SUMMARY_METADATA)),
            topics=frozenset(channel.topic for channel in frames.channels.values()),
            language=next(
                (each.metadata.get("language", "") for each in frames.channels.values() if each.topic == LOG_TOPIC), ""
            ),
        )
