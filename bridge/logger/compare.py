"""Whether two loggers hold the same: "the same state" of decision 0013, with every difference named.

Rule 1: alarms are compared by key: raised, confirmation state and the three times. An alarm that was never raised is no part
of the state, for no event told of it.
Rule 2: events are compared by target, session and seq, with everything in them but the mark that they are replayed (origin).
Unique ids and arrival times are not compared.
"""

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec

from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.events import AnyEvent, Event
from bridge.core.questions import LogQuestion
from bridge.logger.book import Book

EVENT_FIELDS: Final = tuple(field for field in Event.__struct_fields__ if field != "origin")
ALARM_FIELDS: Final = ("raised", "confirmation_state", "time_raised_ns", "time_cleared_ns", "time_confirmed_ns")
_SHOWN: Final = 60


class State(msgspec.Struct, frozen=True, kw_only=True):
    """What is compared: alarms and events, in any order."""

    alarms: tuple[Alarm, ...] = ()
    events: tuple[AnyEvent, ...] = ()


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """How many different events and alarms there are on either side, and how they differ."""

    events: int
    alarms: int
    differences: tuple[str, ...] = ()

    @property
    def equal(self) -> bool:
        """Whether both sides hold the same."""
        return not self.differences


def state_of(book: Book) -> State:
    """What a book holds."""
    entries = book.log(LogQuestion(newest_first=False))
    return State(alarms=tuple(book.alarms.values()), events=tuple(entry.event for entry in entries))


def compare(live: State, replayed: State) -> Comparison:
    """Compare two states; the first is called live, the second replayed."""
    here, there = _events(live.events), _events(replayed.events)
    alarms_here, alarms_there = _alarms(live.alarms), _alarms(replayed.alarms)
    return Comparison(
        events=len(here.keys() | there.keys()),
        alarms=len(alarms_here.keys() | alarms_there.keys()),
        differences=(*_event_differences(here, there), *_alarm_differences(alarms_here, alarms_there)),
    )


def _events(events: Iterable[AnyEvent]) -> dict[tuple[str, str, int], AnyEvent]:
    return {(event.target, event.session, event.seq): event for event in events}


def _alarms(alarms: Iterable[Alarm]) -> dict[AlarmKey, Alarm]:
    return {alarm.key: alarm for alarm in alarms if alarm.was_raised}


def _event_differences(
    live: dict[tuple[str, str, int], AnyEvent], replayed: dict[tuple[str, str, int], AnyEvent]
) -> Iterator[str]:
    for place in sorted(live.keys() | replayed.keys()):
        name = f"event {place[2]} of session {place[1]} of {place[0]}"
        one, other = live.get(place), replayed.get(place)
        if one is None or other is None:
            yield f"{name} is only {'replayed' if one is None else 'live'}"
        elif type(one) is not type(other):
            yield f"{name}: kind is {one.kind} live, {other.kind} replayed"
        else:
            yield from _field_differences(f"{name} ({one.kind} {one.event_class} {one.event_id})", one, other, EVENT_FIELDS)


def _alarm_differences(live: dict[AlarmKey, Alarm], replayed: dict[AlarmKey, Alarm]) -> Iterator[str]:
    for key in sorted(live.keys() | replayed.keys(), key=repr):
        name = f"alarm {key.event_class} {key.event_id} of {key.source_name or key.source_id or key.source_guid or '-'}"
        one, other = live.get(key), replayed.get(key)
        if one is None or other is None:
            yield f"{name} is only {'replayed' if one is None else 'live'}"
        else:
            yield from _field_differences(name, one, other, ALARM_FIELDS)


def _field_differences(name: str, one: AnyEvent | Alarm, other: AnyEvent | Alarm, fields: Iterable[str]) -> Iterator[str]:
    for field in fields:
        left, right = getattr(one, field), getattr(other, field)
        if left != right:
            yield f"{name}: {field} is {_text(left)} live, {_text(right)} replayed"


def _text(value: object) -> str:
    text = msgspec.json.encode(value).decode("utf-8", "replace")
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
