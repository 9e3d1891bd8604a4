"""What a recording says to viewers that know nothing of us: a log line per event, and a time span per finished alarm.

    channel /log     foxglove.Log: the text of each event, gap and rejected payload, for log panels
    channel /alarms  foxglove.Event: one message per finished life of an alarm, from raised to cleared, for time lines
    attachments      classes that only somebody on the bus knew, as .tmc

Rule 1: these channels repeat what the others hold, for eyes. Readers of ours pass them over, and they count nowhere.
Rule 2: a message stands right behind the one it speaks of and has its log time.
Rule 3: texts are those of the language and classes known at that moment; of an unknown class "<GUID>#7 (a, b)".
Rule 4: the definition of a class that neither the program nor an attachment has is attached with the first flush after it is
known, so that texts can be made again from the file alone, in another language too.
Rule 5: a life begins with its raise, as in the log. It is finished when it is neither raised nor waits for confirmation, or
when the alarm is raised again before it was confirmed.

Sources: https://docs.foxglove.dev/docs/sdk/schemas/log and .../event for the fields and names; the rules for a JSON Schema that
opens without a plug-in are in docs/recordings.md.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec

from bridge.core.alarms import Alarm, AlarmKey, alarm_key
from bridge.core.catalog import ENGLISH, Catalog, EventClass, Language, language_id, language_tag
from bridge.core.events import AlarmDisposed, AlarmEvent, AlarmRaised, AnyEvent, MessageSent, Severity, is_active
from bridge.core.keys import KeyFormatError, parse_event_key
from bridge.core.times import NS_PER_S, time_text
from bridge.core.tmc_writer import write_classes
from bridge.edges.recording.layout import ALARMS_TOPIC, LOG_TOPIC, Attachment, Gap, RejectedPayload, object_schema, plain

log: Final = logging.getLogger(__name__)

Classes: TypeAlias = Callable[[AnyEvent | Alarm], Catalog]
"""The classes known now, with that of the event if anybody has it; it must not wait."""

LEVELS: Final = {"UNKNOWN": 0, "DEBUG": 1, "INFO": 2, "WARNING": 3, "ERROR": 4, "FATAL": 5}
"""foxglove.LogLevel; severities are 1..5 in their order."""
_WARNING: Final = LEVELS["WARNING"]
_WORDS: Final = {
    "message_sent": "",
    "alarm_raised": "raised",
    "alarm_cleared": "cleared",
    "alarm_confirmed": "confirmed",
    "alarm_disposed": "disposed",
}


class Stamp(msgspec.Struct, frozen=True, gc=False):
    """A time as viewers want it; the halves are exact in JavaScript."""

    sec: int
    nsec: int


class LogLine(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Log. name is the source, or the target of an event without one; file and line are event class and id."""

    timestamp: Stamp
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class Pair(msgspec.Struct, frozen=True, gc=False):
    """foxglove.KeyValuePair."""

    key: str
    value: str


class Span(msgspec.Struct, frozen=True):
    """foxglove.Event: something between two times."""

    start_time: Stamp
    end_time: Stamp
    metadata: tuple[Pair, ...] = ()


_encode: Final = msgspec.json.Encoder().encode


def _stamp(time_ns: int) -> Stamp:
    return Stamp(*divmod(time_ns, NS_PER_S))


def log_schema() -> bytes:
    """The JSON Schema of /log."""
    level = {"type": "integer", "oneOf": [{"title": title, "const": const} for title, const in LEVELS.items()]}
    text, line = {"type": "string"}, {"type": "integer", "minimum": 0}
    fields = {"timestamp": _TIME, "level": level, "message": text, "name": text, "file": text, "line": line}
    return _encode(object_schema("foxglove.Log", fields))


def span_schema() -> bytes:
    """The JSON Schema of /alarms."""
    pair = _part("foxglove.KeyValuePair", {"key": {"type": "string"}, "value": {"type": "string"}})
    fields = {"start_time": _TIME, "end_time": _TIME, "metadata": {"type": "array", "items": pair}}
    return _encode(object_schema("foxglove.Event", fields))


def _part(title: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "title": title, "properties": properties, "required": list(properties)}


_TIME: Final = _part(
    "time", {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0, "maximum": NS_PER_S - 1}}
)


class Said(NamedTuple):
    """One message for viewers: its channel and its bytes."""

    topic: str
    data: bytes


class _Life(NamedTuple):
    """The last transition of an alarm, or what a keyframe has of it; whether its span was told."""

    last: AlarmEvent | Alarm
    told: bool


class Viewer:
    """Makes the messages for viewers, in the order of the recording, over several files if there are."""

    def __init__(self, known: Classes, language: Language = ENGLISH, own: Catalog | None = None) -> None:
        """known says which classes there are, own those that need not be attached. LanguageError for an unknown language."""
        self.known, self._language = known, language_id(language)
        self.metadata: Final = {"language": language_tag(self._language)}
        """The metadata of the channels for viewers."""
        self._own = Catalog() if own is None else own
        self._lives: dict[AlarmKey, _Life] = {}

    def begin(self) -> None:
        """Begin a file. What was open before it comes again with its keyframe."""
        self._lives.clear()

    def state(self, alarms: Iterable[Alarm]) -> None:
        """Take a keyframe: lives that began before it are told when they end, finished ones no more."""
        self._lives.update((alarm.key, _Life(alarm, not alarm.is_active)) for alarm in alarms)

    def definition(self, found: EventClass) -> Attachment | None:
        """The class as an attachment; None when it need not be attached, or cannot be written."""
        if found.guid in self._own:
            return None
        try:
            return Attachment(f"{found.name}-{found.guid[:8]}.tmc", write_classes([found]), "application/xml")
        except ValueError as error:
            log.warning("class %s is not attached: %s", found.guid, error)
            return None

    def event(self, event: AnyEvent, log_time_ns: int) -> Iterator[Said]:
        """The line of an event, and the span of a life that it ends."""
        catalog = self.known(event)
        yield Said(LOG_TOPIC, _encode(self._line(event, catalog, log_time_ns)))
        if not isinstance(event, MessageSent):
            for ended, end_ns in self._ended(event):
                yield Said(ALARMS_TOPIC, _encode(self._span(ended, catalog, end_ns)))

    def gap(self, gap: Gap, log_time_ns: int) -> Said:
        """The line that says what is missing."""
        text = f"{gap.count} events are missing here: {gap.reason}" if gap.reason else f"{gap.count} events are missing here"
        return _warning(text, gap.key, log_time_ns)

    def rejected(self, payload: RejectedPayload, log_time_ns: int) -> Said:
        """The line that says what could not be decoded."""
        return _warning(f"{payload.size} bytes are no events: {payload.reason}", payload.key, log_time_ns)

    def _line(self, event: AnyEvent, catalog: Catalog, log_time_ns: int) -> LogLine:
        text = catalog.event_text(event, self._language)
        if event.is_alarm:
            who = f" by {event.operator}" if event.operator else ""
            text = f"{_WORDS[event.kind]}{who}: {text}"
            if event.comment:
                text = f"{text} ({event.comment})"
        return LogLine(
            _stamp(event.time_ns or log_time_ns),
            event.severity + 1,
            plain(text),
            plain(self._name(event, catalog)),
            plain(catalog.class_name(event.event_class, self._language)),
            event.event_id,
        )

    def _name(self, event: AnyEvent | Alarm, catalog: Catalog) -> str:
        if event.source_name:
            return catalog.source_name(event.source_name, event.source_guid, self._language)
        if event.source_id is not None:
            return f"{event.target} 0x{event.source_id:08X}"
        return event.target

    def _ended(self, event: AlarmEvent) -> Iterator[tuple[AlarmEvent | Alarm, int]]:
        """The lives that are over with this event, each as its last transition and its end."""
        key = alarm_key(event)
        life = self._lives.get(key)
        if life is not None and event.seq and event.session == life.last.session and event.seq <= life.last.seq:
            return  # it was in the keyframe already
        told = life is not None and life.told
        if life is not None and (isinstance(event, AlarmRaised) or event.time_raised_ns != life.last.time_raised_ns):
            if not told:
                yield life.last, life.last.time_cleared_ns or event.time_raised_ns
            told = False
        if not told and event.time_raised_ns and not is_active(event):
            told = True
            yield event, event.time_cleared_ns or event.time_ns
        if isinstance(event, AlarmDisposed):
            self._lives.pop(key, None)
        else:
            self._lives[key] = _Life(event, told)

    def _span(self, ended: AlarmEvent | Alarm, catalog: Catalog, end_ns: int) -> Span:
        start_ns = ended.time_raised_ns
        end_ns, name = max(start_ns, end_ns), self._name(ended, catalog)
        facts = {
            "alarm": catalog.event_text(ended, self._language),
            "severity": Severity(ended.severity).name.lower(),
            "target": ended.target,
            "source": name if name != ended.target else "",
            "event_class": catalog.class_name(ended.event_class, self._language),
            "event_id": str(ended.event_id),
            "duration": f"{(end_ns - start_ns) / NS_PER_S:.3f} s",
            "confirmed": time_text(ended.time_confirmed_ns, 3),
        }
        pairs = tuple(Pair(key, plain(value)) for key, value in facts.items() if value)
        return Span(_stamp(start_ns), _stamp(end_ns), pairs)


def _warning(text: str, key: str, log_time_ns: int) -> Said:
    try:
        name = parse_event_key(key).target
    except KeyFormatError:
        name = key
    return Said(LOG_TOPIC, _encode(LogLine(_stamp(log_time_ns), _WARNING, plain(text), plain(name))))
