"""Laws of the spans that viewers are given: they are the lives of alarms as the log has them, however the files are cut."""

import json
from collections.abc import Iterable

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.core.alarms import AlarmCommand, AlarmTable, alarm_key
from bridge.core.catalog import Catalog
from bridge.core.events import AlarmEvent, is_active
from bridge.core.questions import LogQuestion
from bridge.edges.recording import Viewer
from bridge.logger import Book
from tests.property.test_alarm_laws import KEYS, commands, run

NOBODY = Catalog()
# Two alarms rather than many, so that one of them is often raised again.
CALLS = st.lists(
    commands().map(lambda call: msgspec.structs.replace(call, key=KEYS[0] if call.key in KEYS[:3] else KEYS[3])),
    min_size=8,
    max_size=40,
)
Span = tuple[int, int, int]


def told(eyes: Viewer, events: Iterable[AlarmEvent]) -> list[Span]:
    """Each span: event id, begin, end."""
    spans = [json.loads(said.data) for event in events for said in eyes.event(event, 1) if said.topic == "/alarms"]
    found = []
    for span in spans:
        facts = {pair["key"]: pair["value"] for pair in span["metadata"]}
        assert len(facts) == len(span["metadata"])
        found.append(
            (int(facts["event_id"]), *(span[end]["sec"] * 10**9 + span[end]["nsec"] for end in ("start_time", "end_time")))
        )
    return found


def lives(events: list[AlarmEvent]) -> list[Span]:
    """The same from the log of a logger: its occurrences, without the one of each alarm that is still going on."""
    with Book(None, ":memory:") as book:
        for event in events:
            book.replay(event, event.time_ns)
        stored = [each.event for each in book.log(LogQuestion(view="occurrences", newest_first=False))]
        going_on = {key: alarm.time_raised_ns for key, alarm in book.alarms.items() if alarm.is_active}
    latest = {alarm_key(each): number for number, each in enumerate(stored)}
    found = []
    for number, each in enumerate(stored):
        key = alarm_key(each)
        if each.time_raised_ns and not (number == latest[key] and key in going_on and is_active(each)):
            following = next((later for later in stored[number + 1 :] if alarm_key(later) == key), each)
            end_ns = each.time_cleared_ns or following.time_ns
            found.append((each.event_id, each.time_raised_ns, max(each.time_raised_ns, end_ns)))
    return found


@given(CALLS, st.booleans())
@settings(max_examples=60)
def test_spans_are_the_finished_lives_of_the_log(history: list[AlarmCommand], in_order: bool) -> None:
    """Also when several things happen in the same cycle, or times that were given with the calls run backwards."""
    events = run(timed(history, in_order), "s", {})
    assert sorted(told(Viewer(lambda event: NOBODY), events)) == sorted(lives(events))


def timed(history: list[AlarmCommand], in_order: bool) -> list[AlarmCommand]:
    """The calls as they are, or with times that grow."""
    if not in_order:
        return history
    return [msgspec.structs.replace(call, time_ns=place) for place, call in enumerate(history, 1)]


@given(CALLS, st.integers(0, 30))
def test_a_split_neither_loses_nor_doubles_a_span(history: list[AlarmCommand], place: int) -> None:
    """Two files, the second with the keyframe of its start, tell what one file tells."""
    events = run(timed(history, True), "s", {})
    whole = told(Viewer(lambda event: NOBODY), events)
    eyes, table = Viewer(lambda event: NOBODY), AlarmTable()
    first = told(eyes, events[:place])
    for event in events[:place]:
        table.apply(event)
    eyes.begin()
    eyes.state(table.alarms.values())
    assert first + told(eyes, events[place:]) == whole
