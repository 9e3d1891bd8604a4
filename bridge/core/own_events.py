"""Events of tcbridge itself: one event class with a GUID that never changes, known to every catalog of ours.

Rule 1: what a program of ours has done to a log, and nobody asked for, is in the log: here as a message of the target.
Rule 2: a report is never about reports alone, so that dropping one does not make another.

| id | name         | severity | arguments                                                        |
|----|--------------|----------|------------------------------------------------------------------|
| 1  | CacheDropped | Warning  | how many events, why (max_bytes, max_age, max_events)             |
| 2  | LogCleared   | Info     | how many events, operator, client, comment                       |
| 3  | SourceGone   | Warning  | how many alarms are suspect now, client that raised the last     |
| 4  | SystemError  | Error    | what, where; its severity is that of the error                   |

Those of modules (TcCOM) have the module as their source, with its object id and name:

| id | name             | severity | arguments                                                    |
|----|------------------|----------|--------------------------------------------------------------|
| 10 | ModuleStep       | Info     | name, transition, state, ms                                  |
| 11 | ModuleStepFailed | Error    | name, transition, state, HRESULT, why                        |
| 12 | ModuleUndoFailed | Error    | name, transition, HRESULT, why                               |
| 13 | ModuleSlow       | Warning  | name, transition, ms                                         |
| 14 | ModuleBroken     | Error    | name, HRESULT, why                                           |
| 15 | CycleFailed      | Error    | name, HRESULT, why                                           |
| 16 | CycleRecovered   | Info     | name                                                         |
| 17 | CyclesMissed     | Warning  | name, how many                                               |
| 18 | ModuleNotStarted | Error    | name, why                                                    |
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
MODULE_STEP: Final = 10
MODULE_STEP_FAILED: Final = 11
MODULE_UNDO_FAILED: Final = 12
MODULE_SLOW: Final = 13
MODULE_BROKEN: Final = 14
CYCLE_FAILED: Final = 15
CYCLE_RECOVERED: Final = 16
CYCLES_MISSED: Final = 17
MODULE_NOT_STARTED: Final = 18
SHOWN_BYTES: Final = 200
"""Of a text in the arguments of an event of ours; operator, client and comment are whole in its own fields."""

_DROPPED: Final = "The log dropped its {0} oldest events ({1})"
_CLEARED: Final = "{0} events of the log were cleared by {1} at {2}: {3}"
_GONE: Final = "A source is gone without a last word: {0} raised alarms are suspect, the last of {1}"
_STEP: Final = "{0}: {1} done in {3} ms, now {2}"
_STEP_FAILED: Final = "{0}: {1} failed, still {2}: {3}: {4}"
_UNDO_FAILED: Final = "{0}: something was not given back in {1}: {2}: {3}"
_SLOW: Final = "{0}: {1} took {2} ms, too long for real time"
_BROKEN: Final = "{0} does not work any more: {1}: {2}"
_CYCLE_FAILED: Final = "{0}: a cycle failed: {1}: {2}"
_CYCLE_RECOVERED: Final = "{0}: cycles work again"
_CYCLES_MISSED: Final = "{0}: {1}"
_NOT_STARTED: Final = "{0} is not started: {1}"
OWN_EVENTS: Final = EventClass(
    guid=OWN_CLASS,
    name="TcBridge",
    display_text="tcbridge",
    events={
        CACHE_DROPPED: EventEntry(CACHE_DROPPED, "CacheDropped", Severity.WARNING, _DROPPED),
        LOG_CLEARED: EventEntry(LOG_CLEARED, "LogCleared", Severity.INFO, _CLEARED),
        SYSTEM_ERROR: EventEntry(SYSTEM_ERROR, "SystemError", Severity.ERROR, "{0} [{1}]"),
        SOURCE_GONE: EventEntry(SOURCE_GONE, "SourceGone", Severity.WARNING, _GONE),
        MODULE_STEP: EventEntry(MODULE_STEP, "ModuleStep", Severity.INFO, _STEP),
        MODULE_STEP_FAILED: EventEntry(MODULE_STEP_FAILED, "ModuleStepFailed", Severity.ERROR, _STEP_FAILED),
        MODULE_UNDO_FAILED: EventEntry(MODULE_UNDO_FAILED, "ModuleUndoFailed", Severity.ERROR, _UNDO_FAILED),
        MODULE_SLOW: EventEntry(MODULE_SLOW, "ModuleSlow", Severity.WARNING, _SLOW),
        MODULE_BROKEN: EventEntry(MODULE_BROKEN, "ModuleBroken", Severity.ERROR, _BROKEN),
        CYCLE_FAILED: EventEntry(CYCLE_FAILED, "CycleFailed", Severity.ERROR, _CYCLE_FAILED),
        CYCLE_RECOVERED: EventEntry(CYCLE_RECOVERED, "CycleRecovered", Severity.INFO, _CYCLE_RECOVERED),
        CYCLES_MISSED: EventEntry(CYCLES_MISSED, "CyclesMissed", Severity.WARNING, _CYCLES_MISSED),
        MODULE_NOT_STARTED: EventEntry(MODULE_NOT_STARTED, "ModuleNotStarted", Severity.ERROR, _NOT_STARTED),
    },
    translations={
        _DROPPED: {1031: "Das Protokoll hat seine {0} ältesten Ereignisse verworfen ({1})"},
        _CLEARED: {1031: "{0} Ereignisse des Protokolls wurden von {1} an {2} gelöscht: {3}"},
        _GONE: {1031: "Eine Quelle ist ohne letztes Wort fort: {0} anstehende Alarme sind zweifelhaft, der letzte von {1}"},
        _STEP: {1031: "{0}: {1} in {3} ms ausgeführt, nun {2}"},
        _STEP_FAILED: {1031: "{0}: {1} fehlgeschlagen, weiterhin {2}: {3}: {4}"},
        _UNDO_FAILED: {1031: "{0}: in {1} wurde etwas nicht zurückgegeben: {2}: {3}"},
        _SLOW: {1031: "{0}: {1} dauerte {2} ms, zu lange für Echtzeit"},
        _BROKEN: {1031: "{0} arbeitet nicht mehr: {1}: {2}"},
        _CYCLE_FAILED: {1031: "{0}: ein Zyklus ist fehlgeschlagen: {1}: {2}"},
        _CYCLE_RECOVERED: {1031: "{0}: Zyklen laufen wieder"},
        _CYCLES_MISSED: {1031: "{0}: {1}"},
        _NOT_STARTED: {1031: "{0} ist nicht gestartet: {1}"},
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
