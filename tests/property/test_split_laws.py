"""However a stream is split into files, read together or from any of them on they give the same state and the same events."""

import tempfile
from collections import deque
from collections.abc import Iterable
from pathlib import Path

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.core.alarms import (
    Alarm,
    AlarmCommand,
    AlarmKey,
    AlarmTable,
    Clear,
    Confirm,
    Create,
    Dispose,
    Raise,
    alarm_key,
    created,
    decide,
)
from bridge.core.events import AlarmEvent, MessageSent, Severity
from bridge.core.hresult import AdsError
from bridge.edges.recording import About, RecordedEvent, RecordedState, read_events
from bridge.edges.recording.standing import Standing
from bridge.notices import Heard, Item, Snapshot
from bridge.recorder.choice import Choice
from bridge.recorder.files import Files, Split
from bridge.recorder.states import States
from tests.unit.recorder.recorder_stories import CLASS, OTHER, START, S, heard, message

KEYS = [AlarmKey("plc1", event_class, number) for event_class in (CLASS, OTHER) for number in (1, 2)]
KINDS: list[type[AlarmCommand]] = [Create, Create, Raise, Raise, Clear, Confirm, Dispose]


def carried_out(commands: list[tuple[AlarmKey, type[AlarmCommand]]], session: str, table: AlarmTable) -> list[AlarmEvent]:
    """The transitions that a logger makes of commands, numbered."""
    events: list[AlarmEvent] = []
    for number, (key, kind) in enumerate(commands):
        alarm = table.alarms.get(key)
        if kind is Create:
            command: AlarmCommand = Create(key=key, severity=Severity(key.event_id), with_confirmation=True)
            if alarm is None:
                table.put(created(Create(key=key, severity=Severity(key.event_id), with_confirmation=True)))
            continue
        command = msgspec.convert({"do": kind.__struct_config__.tag, "key": msgspec.to_builtins(key)}, AlarmCommand)
        try:
            decided = decide(alarm, msgspec.structs.replace(command, time_ns=START + number + 1))
        except AdsError:
            continue
        for event in decided:
            seq = len(events) + 1
            events.append(msgspec.structs.replace(event, session=session, seq=seq, key_seq=seq))
            table.apply(events[-1])
    return events


@st.composite
def streams(draw: st.DrawFn) -> tuple[list[tuple[Item, int]], AlarmTable]:
    """What a recorder gets and when: a state, transitions in order per key only, messages, perhaps a restarted logger."""
    logger, items = AlarmTable(), list[Item]()
    for session in ("first", "second")[: draw(st.integers(1, 2))]:
        items.append(Snapshot("plc1", session, 0, tuple(alarm for alarm in logger.alarms.values() if alarm.was_raised)))
        commands = draw(st.lists(st.tuples(st.sampled_from(KEYS), st.sampled_from(KINDS)), max_size=25))
        waiting: dict[AlarmKey, deque[AlarmEvent]] = {key: deque() for key in KEYS}
        for event in carried_out(commands, session, logger):
            waiting[alarm_key(event)].append(event)
        while any(waiting.values()):
            queue = waiting[draw(st.sampled_from([name for name, events in waiting.items() if events]))]
            items.append(heard(queue.popleft()))
            if draw(st.booleans()):
                items.append(heard(message(len(items))))
    times, now_s = [], 0
    for _ in items:
        now_s += draw(st.integers(0, 1))
        times.append(START + now_s * S)
    return list(zip(items, times, strict=True)), logger


def fold(paths: list[Path]) -> dict[AlarmKey, tuple[object, ...]]:
    """The state after reading these files, keyframes included."""
    standing = Standing()
    for path in paths:
        for item in read_events(path):
            if isinstance(item, RecordedState):
                standing.state(item.state)
            elif isinstance(item, RecordedEvent) and not isinstance(item.event, MessageSent):
                standing.event(item.realm, item.event)
    return state(standing.alarms())


def state(alarms: Iterable[Alarm]) -> dict[AlarmKey, tuple[object, ...]]:
    """What two views of alarms have to agree in."""
    table = AlarmTable()
    for alarm in alarms:
        table.put(alarm)
    return dict(table.state())


@settings(max_examples=60)
@given(streams())
def test_files_read_together_or_from_any_of_them_on_give_the_state(
    stream: tuple[list[tuple[Item, int]], AlarmTable],
) -> None:
    """No event is lost, doubled or out of order where files meet, and each keyframe is the state at its place."""
    items, logger = stream
    with tempfile.TemporaryDirectory() as name:
        files = Files(Path(name), Choice(None), about=About(realm="live"), split=Split(seconds=1))
        files.begin(START)
        for item, at_ns in items:
            files.write(item, at_ns)
        files.end()
        files.close()
        paths = sorted(Path(name).glob("*.mcap"))
        written = [item.event for path in paths for item in read_events(path) if isinstance(item, RecordedEvent)]
        assert written == [item.event for item, _ in items if isinstance(item, Heard)]
        for first in range(len(paths)):
            assert fold(paths[first:]) == state(logger.alarms.values())


@settings(max_examples=60)
@given(streams(), st.lists(st.booleans(), min_size=1, max_size=12))
def test_captures_read_together_or_from_any_of_them_on_give_the_state(
    stream: tuple[list[tuple[Item, int]], AlarmTable], windows: list[bool]
) -> None:
    """What went by between two files is in the keyframe of the second, though no gap stands between them."""
    items, _ = stream
    every = max(1, len(items) // len(windows) + 1)
    so_far, last = States(), dict[AlarmKey, tuple[object, ...]]()
    with tempfile.TemporaryDirectory() as name:
        files = Files(Path(name), Choice(None), about=About(realm="live"))
        for place, (item, at_ns) in enumerate(items):
            wanted = windows[place // every]
            if wanted and files.current is None:
                files.begin(at_ns)
            if not wanted:
                files.end()
                files.skip(item)
            else:
                files.write(item, at_ns)
            so_far.take(item)
            if wanted:
                last = state(alarm for frame in so_far.frames("live", None) for alarm in frame.alarms)
        files.end()
        files.close()
        paths = sorted(Path(name).glob("*.mcap"))
        for first in range(len(paths)):
            assert fold(paths[first:]) == last
