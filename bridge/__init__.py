"""tcbridge: events, alarms, filters, recording and replay on a Zenoh bus. The public names, nothing else."""

from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.arguments import Argument, ArgumentType, EventReference
from bridge.core.events import (
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmRaised,
    ConfirmationState,
    LimitError,
    MessageSent,
    Severity,
    Source,
)
from bridge.core.filters.spelling import where
from bridge.core.filters.text import FilterSyntaxError
from bridge.core.hresult import AdsError
from bridge.edges.bus import Bus, BusConfig, BusError, open_bus
from bridge.inbox import Dropped
from bridge.listener import Gap, Listener, Rejected, TailUnknown
from bridge.logger import EventLogger, LoggerProxy
from bridge.publisher import Publisher
from bridge.recorder import Recorder

__all__ = [
    "AdsError",
    "Alarm",
    "AlarmCleared",
    "AlarmConfirmed",
    "AlarmDisposed",
    "AlarmKey",
    "AlarmRaised",
    "Argument",
    "ArgumentType",
    "Bus",
    "BusConfig",
    "BusError",
    "ConfirmationState",
    "Dropped",
    "EventLogger",
    "EventReference",
    "FilterSyntaxError",
    "Gap",
    "LimitError",
    "Listener",
    "LoggerProxy",
    "MessageSent",
    "Publisher",
    "Recorder",
    "Rejected",
    "Severity",
    "Source",
    "TailUnknown",
    "open_bus",
    "where",
]
