"""The recorder: from the bus into MCAP files, everything or what is around a trigger, in one file or in many."""

from bridge.edges.recording.folder import Keep
from bridge.recorder.capture import Capture
from bridge.recorder.files import Split
from bridge.recorder.news import Began, Deleted, Finished, News, NotDeleted, NotRecovered, Recovered, Status
from bridge.recorder.remote import controlled
from bridge.recorder.service import Recorder

__all__ = [
    "Began",
    "Capture",
    "Deleted",
    "Finished",
    "Keep",
    "News",
    "NotDeleted",
    "NotRecovered",
    "Recorder",
    "Recovered",
    "Split",
    "Status",
    "controlled",
]
