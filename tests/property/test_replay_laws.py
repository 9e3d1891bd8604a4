"""Recordings cannot lie: whatever happened, however it was cut, split or played, the state is the one that there was.

A history is made by commands that a logger would have allowed, of two targets, with restarts. Between keys the order of a
recording is not that of seq, and clocks of senders jump; arrivals are those of a clock that jumps back too.
"""

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import hypothesis.strategies as st
import msgspec
import pytest
from hypothesis import given, settings

from bridge import open_bus
from bridge.core import codec
from bridge.core.alarms import Alarm, AlarmCommand, AlarmKey, AlarmTable, Clear, Confirm, Create, Dispose, Raise, fold
from bridge.core.events import AnyEvent, ConfirmationState, Severity
from bridge.core.keys import EventKey
from bridge.core.logbook import Logbook, Plan
from bridge.core.questions import CommandQuestion, LogQuestion
from bridge.edges.bus import ALONE, Bus
from bridge.edges.recording import RecordedEvent, RecordingWriter, StateFrame, read_series, standing_at
from bridge.logger import Book
from bridge.repair import ask_state
from bridge.replayer import Player, replay_into
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, TIME_NS, message_sent

State: TypeAlias = dict[AlarmKey, tuple[bool, ConfirmationState, int, int, int]]
TARGETS = ("plc1", "plc2")
KEYS = [
    AlarmKey(target, event_class, event_id, None, source, None)
    for target in TARGETS
    for event_class, event_id, source in ((EVENT_CLASS, 1, "a"), (EVENT_CLASS, 1, "b"), (OTHER_CLASS, 2, None))
]
OPS = ("raise", "clear", "reset", "confirm", "dispose", "message")


class Entry(NamedTuple):
    """What arrives: an event, or the word of a logger that was started again and tells its state."""

    event: AnyEvent | None = None
    frame: StateFrame | None = None


class Plant:
    """Two loggers without a bus."""

    def __init__(self) -> None:
        self.books: dict[str, Logbook] = {}
        self.numbers: dict[tuple[str, object], int] = {}
        self.sessions = 0
        self.asked = 0
        self.entries: list[Entry] = []
        for target in TARGETS:
            self.start(target)

    def start(self, target: str) -> None:
        """A logger starts, with the alarms that the one before had."""
        self.sessions += 1
        before = self.books.get(target)
        book = self.books[target] = Logbook(target, f"{self.sessions:016x}")
        if before is not None:
            book.table.load(before.table.alarms.values())
            alarms = tuple(alarm for alarm in book.table.alarms.values() if alarm.was_raised)
            self.entries.append(
                Entry(frame=StateFrame(realm="live", target=target, session=book.session, seq=0, alarms=alarms))
            )

    def number(self, event: AnyEvent) -> AnyEvent:
        session = self.books[event.target].session
        key = (session, (event.event_class, event.is_alarm, event.severity))
        for place in (key, (session, None)):
            self.numbers[place] = self.numbers.get(place, 0) + 1
        return msgspec.structs.replace(event, session=session, seq=self.numbers[session, None], key_seq=self.numbers[key])

    def do(self, key: AlarmKey, op: str, time_ns: int) -> None:
        """One command, if it is allowed now."""
        book = self.books[key.target]
        if op == "message":
            self.entries.append(
                Entry(self.number(message_sent(target=key.target, event_class=key.event_class, time_ns=time_ns)))
            )
            return
        commands: dict[str, list[AlarmCommand]] = {
            "raise": [
                Create(key=key, severity=Severity.ERROR, with_confirmation=key.event_id == 1),
                Raise(key=key, time_ns=time_ns),
            ],
            "clear": [Clear(key=key, time_ns=time_ns)],
            "reset": [Clear(key=key, time_ns=time_ns, reset_confirmation=True)],
            "confirm": [Confirm(key=key, time_ns=time_ns)],
            "dispose": [Dispose(key=key, time_ns=time_ns)],
        }
        for command in commands[op]:
            self.asked += 1
            plan = book.decide(CommandQuestion(id=str(self.asked), command=command), time_ns)
            if isinstance(plan, Plan):
                events = [self.number(event) for event in plan.events]
                book.sent(plan, events, time_ns)  # type: ignore[arg-type]
                self.entries += [Entry(event) for event in events]

    @property
    def state(self) -> State:
        """What is live at the end."""
        return {key: state for book in self.books.values() for key, state in book.table.state().items()}


@st.composite
def histories(draw: st.DrawFn, size: int = 40, keys: Sequence[AlarmKey] = KEYS, ops: Sequence[str] = OPS) -> Plant:
    """What happened in a plant, in the order in which it arrives. With few keys more commands meet the same alarm."""
    plant = Plant()
    times = st.sampled_from([TIME_NS, TIME_NS + 10**9, TIME_NS - 10**12, TIME_NS + 10**12])
    step = st.tuples(st.sampled_from(keys), st.sampled_from((*ops, "restart")), times)
    for key, op, time_ns in draw(st.lists(step, min_size=size // 3, max_size=size)):
        if op == "restart":
            plant.start(key.target)
        else:
            plant.do(key, op, time_ns)
    plant.entries = draw(arrivals(plant.entries))
    return plant


def arrivals(entries: list[Entry]) -> st.SearchStrategy[list[Entry]]:
    """The entries as they may arrive: neighbours of different keys change places; a restart stays between its sessions."""

    def swapped(places: list[int]) -> list[Entry]:
        out = list(entries)
        for place in places:
            if place + 1 < len(out) and _may_swap(out[place], out[place + 1]):
                out[place], out[place + 1] = out[place + 1], out[place]
        return out

    return st.lists(st.integers(0, max(0, len(entries) - 1)), max_size=10).map(swapped)


def _may_swap(one: Entry, other: Entry) -> bool:
    if one.event is None or other.event is None:
        return False
    first, second = one.event, other.event
    return first.session == second.session and (first.event_class, first.is_alarm, first.severity) != (
        second.event_class,
        second.is_alarm,
        second.severity,
    )


def write(
    folder: Path, entries: list[Entry], cuts: set[int], clock: Callable[[int], int], lost: range = range(0)
) -> list[Path]:
    """Recordings of the entries: a new one at each cut, with keyframes there and after what was lost, as a recorder has it."""
    paths: list[Path] = []
    table, last, based = AlarmTable(), dict[str, int](), dict[str, tuple[str, int]]()
    writer: RecordingWriter | None = None

    def keyframes(writer: RecordingWriter, at_ns: int) -> None:
        for target, (session, seq) in based.items():
            alarms = tuple(a for a in table.alarms.values() if a.target == target and a.was_raised)
            frame = StateFrame(
                realm="live", target=target, session=session, seq=seq, alarms=alarms, last_seq=last.get(target, 0)
            )
            writer.add_state(frame, at_ns)

    for number, entry in enumerate([*entries, Entry()]):
        at_ns = clock(number)
        if (writer is None or number in cuts) and number < len(entries):
            if writer is not None:
                at_ns = max(at_ns, writer.last_log_time_ns + 1)  # as a recorder does: the next file is the later one
                writer.finish()
            paths.append(folder / f"{len(paths):03}.mcap")
            writer = RecordingWriter(paths[-1])
            keyframes(writer, at_ns)
        if writer is not None and lost and number == min(lost.stop, len(entries)):
            keyframes(writer, at_ns)
        if entry.frame is not None:
            frame = entry.frame
            table.load(frame.alarms, frame.session, frame.seq, frame.target)
            based[frame.target], last[frame.target] = (frame.session, frame.seq), 0
            if writer is not None and number not in lost:
                writer.add_state(frame, at_ns)
        if (event := entry.event) is not None:
            if event.is_alarm:
                fold([event], table)
                same = based.get(event.target, ("", 0))[0] == event.session
                based[event.target] = based[event.target] if same else (event.session, 0)
                last[event.target] = max(last.get(event.target, 0) if same else 0, event.seq)
            if writer is not None and number not in lost:
                key = EventKey("live", event.target, event.event_class, event.is_alarm, event.severity)
                writer.add(codec.encode(event), codec.JSON, key, event, at_ns)
    if writer is not None:
        writer.finish()
    return paths


def state_of(alarms: Iterable[Alarm]) -> State:
    table = AlarmTable()
    for alarm in alarms:
        table.put(alarm)
    return table.state()


def folded(paths: list[Path], start_ns: int | None = None, end_ns: int | None = None) -> tuple[State, list[AnyEvent]]:
    """State and events of a book that the recordings were replayed into."""
    with Book(None) as book:
        replay_into(paths, book, start_ns=start_ns, end_ns=end_ns)
        return state_of(book.alarms.values()), [stored.event for stored in book.log(LogQuestion(newest_first=False))]


def event_times(paths: list[Path]) -> list[int]:
    return [item.log_time_ns for item in read_series(paths) if isinstance(item, RecordedEvent)]


def plain(event: AnyEvent) -> AnyEvent:
    return msgspec.structs.replace(event, origin=None)


clocks = st.lists(st.integers(-5, 5), min_size=1, max_size=8).map(
    lambda jumps: lambda number: TIME_NS + 10**9 * (number + jumps[number % len(jumps)])
)
"""Arrivals by a clock that jumps, back too."""


@settings(max_examples=100)
@given(histories(), st.sets(st.integers(1, 39), max_size=5), clocks, st.data())
def test_live_replayed_cut_and_rebuilt_states_are_one(
    plant: Plant, cuts: set[int], clock: Callable[[int], int], data: st.DataObject
) -> None:
    """Over any splits, from any moment on; events come in the order in which they arrived, once each."""
    with tempfile.TemporaryDirectory() as folder:
        paths = write(Path(folder), plant.entries, cuts, clock)
        events = [entry.event for entry in plant.entries if entry.event is not None]
        state, replayed = folded(data.draw(st.permutations(paths)))
        assert state == plant.state
        assert [plain(event) for event in replayed] == events
        assert all(event.origin is not None and event.origin.seq == event.seq for event in replayed)
        if not paths:
            return
        times = [item.log_time_ns for item in read_series(paths)]
        at_ns = data.draw(st.sampled_from([times[0], *times, times[-1] + 1]))
        after, rest = folded(paths, start_ns=at_ns)
        assert after == plant.state
        passed = sum(at < at_ns for at in event_times(paths))
        assert [plain(event) for event in rest] == events[passed:]
        before, first = folded(paths, end_ns=at_ns)
        assert [plain(event) for event in first] == events[:passed]
        assert state_of(standing_at(paths, at_ns - 1).alarms()) == before


@pytest.fixture(scope="module")
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


@settings(max_examples=100)
@given(histories(15, KEYS[:2], ("raise", "dispose", "clear")), st.sets(st.integers(1, 9), max_size=2), st.data())
def test_after_a_loss_the_state_is_right_from_the_next_keyframe_on(plant: Plant, cuts: set[int], data: st.DataObject) -> None:
    """Whatever was lost: raises, ends of alarms, a restart; also when the replay starts in the middle."""
    if not plant.entries:
        return
    first = data.draw(st.sampled_from(range(len(plant.entries))))
    lost = range(first, min(first + data.draw(st.sampled_from((1, 1, 2, 4))), len(plant.entries)))
    with tempfile.TemporaryDirectory() as folder:
        paths = write(Path(folder), plant.entries, cuts, lambda number: TIME_NS + 10**9 * number, lost)
        assert folded(paths)[0] == plant.state
        times = [item.log_time_ns for item in read_series(paths)]
        if times:
            assert folded(paths, start_ns=data.draw(st.sampled_from(times)))[0] == plant.state


def served(bus: Bus, player: Player) -> State:
    """The alarms that the realm of the player answers with."""
    alarms = [alarm for snapshot in ask_state(bus, player.realm, None).whole for alarm in snapshot.alarms]
    return state_of(alarms)


def stands(player: Player, events: int) -> None:
    """Wait until it stands still after so many events."""
    deadline = time.monotonic() + 60
    while (status := player.status())["events"] != events or status["state"] != "paused":
        assert time.monotonic() < deadline, status
        assert player.error is None
        time.sleep(0.002)


@settings(max_examples=30)
@given(histories(12), st.sets(st.integers(1, 11), max_size=2), st.data())
def test_a_player_serves_the_state_that_there_was(bus: Bus, plant: Plant, cuts: set[int], data: st.DataObject) -> None:
    """After a jump, after steps from there on, and at the end of every round from the start."""
    with tempfile.TemporaryDirectory() as folder:
        paths = write(Path(folder), plant.entries, cuts, lambda number: TIME_NS + 10**9 * number)
        if not paths:
            return
        times = [item.log_time_ns for item in read_series(paths)]
        goals = data.draw(st.lists(st.sampled_from(times), min_size=1, max_size=2))
        with Player(bus, paths, rate=0, paused=True) as player:
            played = 0
            stands(player, played)
            for goal in goals:
                player.seek(goal)
                stands(player, played)
                ahead = [at for at in event_times(paths) if at >= goal]
                steps = data.draw(st.integers(0, len(ahead)))
                if steps:
                    player.step(steps)
                played += steps
                stands(player, played)
                until = ahead[steps - 1] if steps else goal - 1
                assert served(bus, player) == state_of(standing_at(paths, until).alarms())
            for _round in range(2):
                player.seek(times[0])
                stands(player, played)
                if everything := len(event_times(paths)):
                    player.step(everything)
                played += everything
                stands(player, played)
                assert served(bus, player) == plant.state
