"""Events of tcbridge itself: one event class with a GUID that never changes, known to every catalog of ours.

Rule 1: what a program of ours has done to a log, and nobody asked for, is in the log: here as a message of the target.
Rule 2: a report is never about reports alone, so that dropping one does not make another.

| id | name         | severity | arguments                                                        |
|----|--------------|----------|------------------------------------------------------------------|
| 1  | CacheDropped | Warning  | how many events, why (max_bytes, max_age, max_events)             |
| 2  | LogCleared   | Info     | how many events, operator, client, comment                       |
"""

from typing import Final

from bridge.core.catalog import EventClass, EventEntry
from bridge.core.events import Severity

OWN_CLASS: Final = "7c1b6f0e-54c3-4b52-9b0a-7463627269d6"
CACHE_DROPPED: Final = 1
LOG_CLEARED: Final = 2
SOURCE_NAME: Final = "tcbridge.cache"

_DROPPED: Final = "The log dropped its {0} oldest events ({1})"
_CLEARED: Final = "{0} events of the log were cleared by {1} at {2}: {3}"
OWN_EVENTS: Final = EventClass(
    guid=OWN_CLASS,
    name="TcBridge",
    display_text="tcbridge",
    events={
        CACHE_DROPPED: EventEntry(CACHE_DROPPED, "CacheDropped", Severity.WARNING, _DROPPED),
        LOG_CLEARED: EventEntry(LOG_CLEARED, "LogCleared", Severity.INFO, _CLEARED),
    },
    translations={
        _DROPPED: {1031: "Das Protokoll hat seine {0} ältesten Ereignisse verworfen ({1})"},
        _CLEARED: {1031: "{0} Ereignisse des Protokolls wurden von {1} an {2} gelöscht: {3}"},
    },
)
