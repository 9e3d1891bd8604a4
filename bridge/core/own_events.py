"""Events of tcbridge itself: one event class with a GUID that never changes, known to every catalog of ours.

Rule 1: what a program of ours has done to a log, and nobody asked for, is in the log: here as a message of the target.
Rule 2: a report is never about reports alone, so that dropping one does not make another.

| id | name         | severity | arguments                                                        |
|----|--------------|----------|------------------------------------------------------------------|
| 1  | CacheDropped | Warning  | how many events, why (max_bytes, max_age, max_events)             |
| 2  | LogCleared   | Info     | how many events, operator, client, comment                       |
| 3  | SourceGone   | Warning  | how many alarms are suspect now, client that raised the last     |
| 4  | SystemError  | Error    | what, where; its severity is that of the error                   |
"""

from typing import Final

from bridge.core.arguments import Argument
from bridge.core.catalog import EventClass, EventEntry
from bridge.core.events import MessageSent, Severity

OWN_CLASS: Final = "7c1b6f0e-54c3-4b52-9b0a-7463627269d6"
CACHE_DROPPED: Final = 1
LOG_CLEARED: Final = 2
SOURCE_GONE: Final = 3
SYSTEM_ERROR: Final = 4
SHOWN_BYTES: Final = 200
"""Of a text in the arguments of an event of ours; operator, client and comment are whole in its own fields."""

_DROPPED: Final = "The log dropped its {0} oldest events ({1})"
_CLEARED: Final = "{0} events of the log were cleared by {1} at {2}: {3}"
_GONE: Final = "A source is gone without a last word: {0} raised alarms are suspect, the last of {1}"
OWN_EVENTS: Final = EventClass(
    guid=OWN_CLASS,
    name="TcBridge",
    display_text="tcbridge",
    events={
        CACHE_DROPPED: EventEntry(CACHE_DROPPED, "CacheDropped", Severity.WARNING, _DROPPED),
        LOG_CLEARED: EventEntry(LOG_CLEARED, "LogCleared", Severity.INFO, _CLEARED),
        SYSTEM_ERROR: EventEntry(SYSTEM_ERROR, "SystemError", Severity.ERROR, "{0} [{1}]"),
        SOURCE_GONE: EventEntry(SOURCE_GONE, "SourceGone", Severity.WARNING, _GONE),
    },
    translations={
        _DROPPED: {1031: "Das Protokoll hat seine {0} ältesten Ereignisse verworfen ({1})"},
        _CLEARED: {1031: "{0} Ereignisse des Protokolls wurden von {1} an {2} gelöscht: {3}"},
        _GONE: {1031: "Eine Quelle ist ohne letztes Wort fort: {0} anstehende Alarme sind zweifelhaft, der letzte von {1}"},
    },
)


def own_event(
    target: str, source: str, event_id: int, *arguments: int | str, operator: str = "", client: str = "", comment: str = ""
) -> MessageSent:
    """A message about ourselves, not yet numbered, from the part `source` of us (tcbridge.cache). Long texts are cut."""
    shown = [_cut(item) if isinstance(item, str) else item for item in arguments]
    return MessageSent(
        target=target,
        event_class=OWN_CLASS,
        event_id=event_id,
        severity=OWN_EVENTS.events[event_id].severity,
        source_name=f"tcbridge.{source}",
        arguments=tuple(map(Argument.of, shown)),
        operator=operator,
        client=client,
        comment=comment,
    )


def _cut(text: str) -> str:
    return text.encode("utf-8", "replace")[:SHOWN_BYTES].decode("utf-8", "ignore")
