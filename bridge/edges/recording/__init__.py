"""Recordings: MCAP files of events, gaps, rejected payloads and keyframes. The only package that imports mcap."""

from bridge.edges.recording.carried import Carried, carried
from bridge.edges.recording.convert import Converted, convert
from bridge.edges.recording.copying import Copied, copy_part
from bridge.edges.recording.doctor import Finding, diagnose
from bridge.edges.recording.frames import Damage
from bridge.edges.recording.info import ChannelInfo, RecordingInfo, missing_parts, scan, summary
from bridge.edges.recording.layout import (
    ACTIVE_SUFFIX,
    About,
    Attachment,
    Completeness,
    Compression,
    EventChannel,
    Gap,
    RecordingError,
    RejectedPayload,
    StateFrame,
)
from bridge.edges.recording.moment import keyframe_places, standing_at
from bridge.edges.recording.reader import (
    EVERYTHING,
    Part,
    Recorded,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    RecordingReader,
    read_events,
)
from bridge.edges.recording.recovery import Recovered, leftovers, recover
from bridge.edges.recording.series import Series, read_series
from bridge.edges.recording.standing import Standing
from bridge.edges.recording.tally import Active, EventCount, Totals, joined
from bridge.edges.recording.viewer import Viewer
from bridge.edges.recording.writer import RecordingWriter

__all__ = [
    "ACTIVE_SUFFIX",
    "EVERYTHING",
    "About",
    "Active",
    "Attachment",
    "Carried",
    "ChannelInfo",
    "Completeness",
    "Compression",
    "Converted",
    "Copied",
    "Damage",
    "EventChannel",
    "EventCount",
    "Finding",
    "Gap",
    "Part",
    "Recorded",
    "RecordedEvent",
    "RecordedGap",
    "RecordedRejected",
    "RecordedState",
    "RecordingError",
    "RecordingInfo",
    "RecordingReader",
    "RecordingWriter",
    "Recovered",
    "RejectedPayload",
    "Series",
    "Standing",
    "StateFrame",
    "Totals",
    "Viewer",
    "carried",
    "convert",
    "copy_part",
    "diagnose",
    "joined",
    "keyframe_places",
    "leftovers",
    "missing_parts",
    "read_events",
    "read_series",
    "recover",
    "scan",
    "standing_at",
    "summary",
]
