"""A recording made again for programs that read JSON only: msgpack becomes JSON, and what viewers show is beside the events.

Rule 1: nothing is lost: events, gaps, rejected payloads, keyframes, attachments and metadata are in the new file in the same
order with the same times. Only channels of other programs are left out, and named.
Rule 2: bytes of events that are JSON already stay as they are; of msgpack also fields that this version does not know are kept.
Rule 3: converting once more changes nothing.
Rule 4: the new file is as complete as the old one: of one that was cut or damaged it has an unknown tail.
"""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, assert_never

import msgspec
from mcap.records import Channel

from bridge.core import codec
from bridge.core.events import DEFAULT_LIMITS, Limits
from bridge.edges.recording.carried import carried, is_for_viewers
from bridge.edges.recording.frames import Damage, Frames
from bridge.edges.recording.layout import (
    ALARMS_PER_MESSAGE,
    GAPS_TOPIC,
    REJECTED_TOPIC,
    SCHEMA_ATTACHMENT,
    STATE_TOPIC,
    Compression,
    event_channel,
)
from bridge.edges.recording.reader import (
    Interpretation,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    in_log_order,
)
from bridge.edges.recording.viewer import Viewer
from bridge.edges.recording.writer import RecordingWriter

PROGRESS_EVENTS: Final = 1000


class Converted(msgspec.Struct):
    """What was done. from_msgpack counts the events that were msgpack; left_out names channels of other programs."""

    path: Path
    events: int = 0
    from_msgpack: int = 0
    left_out: tuple[str, ...] = ()
    damage: Damage | None = None


def convert(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    viewer: Viewer | None = None,
    *,
    compression: Compression = "zstd",
    limits: Limits = DEFAULT_LIMITS,
    on_progress: Callable[[Converted], None] | None = None,
) -> Converted:
    """Write `source` again as `target`. With a viewer its texts are made anew; without one those that are there are kept.

    RecordingError when the source is no recording, the target exists, or the disk refuses; ValueError when the target's name
    does not end in .mcap. What was written is taken away again when it does not come to its end.
    """
    found = carried(source)
    attachments = tuple(each for each in found.attachments if each.name != SCHEMA_ATTACHMENT)
    writer = RecordingWriter(target, about=found.about, attachments=attachments, compression=compression, viewer=viewer)
    try:
        with Frames(source) as frames:
            report = _copy(frames, writer, viewer is None, limits, on_progress)
        for name, texts in found.metadata:
            writer.add_metadata(name, texts)
        whole = found.summary if report.damage is None else None
        tails, following = (whole.unknown_tails, whole.next_file) if whole is not None else (("*",), "")
        writer.finish(tails, following)
    except BaseException:
        writer.abandon()
        with contextlib.suppress(OSError):
            writer.active_path.unlink()
        raise
    return report


def _copy(
    frames: Frames,
    writer: RecordingWriter,
    keep_viewers: bool,
    limits: Limits,
    on_progress: Callable[[Converted], None] | None,
) -> Converted:
    report = Converted(writer.path)
    interpret = Interpretation(frames, limits)
    for raw in in_log_order(frames):
        item = interpret(raw)
        match item:
            case RecordedEvent(log_time_ns=at_ns, encoding=encoding, element=element, event=event):
                report.events += 1
                if encoding != codec.JSON:
                    element = _as_json(element) or codec.encode(event)
                    report.from_msgpack += 1
                writer.add(element, codec.JSON, item.key, event, at_ns)
                if on_progress is not None and report.events % PROGRESS_EVENTS == 0:
                    on_progress(report)
            case RecordedGap(log_time_ns=at_ns, gap=gap):
                writer.add_gap(gap, at_ns)
            case RecordedRejected(log_time_ns=at_ns, rejected=rejected):
                writer.copy_rejected(rejected, at_ns)
            case RecordedState(log_time_ns=at_ns, state=state):
                parts = max(1, -(-len(state.alarms) // ALARMS_PER_MESSAGE))
                writer.add_state(state, at_ns - (parts - 1))  # so that its last part has the time of the last part
            case None:
                channel = frames.channels[raw.channel_id]
                if keep_viewers and is_for_viewers(frames, channel):
                    writer.add_for_viewers(channel.topic, raw.data, channel.metadata)
            case _:
                assert_never(item)
    report.left_out = tuple(sorted({channel.topic for channel in frames.channels.values() if not _is_ours(frames, channel)}))
    report.damage = frames.damage
    return report


def _is_ours(frames: Frames, channel: Channel) -> bool:
    if channel.message_encoding == "json" and channel.topic in (GAPS_TOPIC, REJECTED_TOPIC, STATE_TOPIC):
        return True
    return is_for_viewers(frames, channel) or event_channel(channel.message_encoding, channel.metadata) is not None


def _as_json(element: bytes) -> bytes:
    """The element with everything in it; b"" when it holds what JSON cannot say."""
    try:
        return msgspec.json.encode(msgspec.msgpack.decode(element))
    except (msgspec.MsgspecError, TypeError, ValueError, RecursionError):
        return b""
