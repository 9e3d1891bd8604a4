"""From the bus into a file, and from the file onto a bus or into a book."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge import EventLogger, Publisher, Recorder, Severity, Source, open_bus
from bridge.core.arguments import Argument
from bridge.core.events import Event
from bridge.core.questions import LogQuestion
from bridge.edges.bus import ALONE, Bus
from bridge.edges.recording import (
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    RecordingError,
    read_events,
    summary,
)
from bridge.logger import Book
from bridge.replayer import replay_into

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


def _night(bus: Bus, path: Path, filter: str = "") -> tuple[list[Event], str]:
    """Record a logger's night: an alarm raised before the recording, one during it, and messages; what the log holds."""
    with EventLogger("plc1", bus=bus) as logger:
        early = logger.create_alarm(CLASS, 1, Severity.CRITICAL, with_confirmation=True).alarm
        logger.raise_alarm(early)
        assert logger.publisher.flush()
        with Recorder(bus, path, filter, comment="a night") as recorder:
            assert recorder.listener.wait_for_beat(logger.session)
            late = logger.create_alarm(CLASS, 2, Severity.ERROR, source=Source(7, "MAIN")).alarm
            logger.raise_alarm(late, arguments=("x", 1.5))
            for number in range(50):
                logger.send_message(CLASS, 3, Severity.INFO, arguments=(number,), json_attribute=f'{{"n":{number}}}')
            logger.clear_alarm(late)
        return [stored.event for stored in logger.log(LogQuestion(newest_first=False))], logger.session


def test_a_recording_holds_the_bytes_and_starts_with_the_state(bus: Bus, tmp_path: Path) -> None:
    """Every event as it was on the wire, after a keyframe with the alarm that was raised before."""
    events, session = _night(bus, tmp_path / "night.mcap")
    items = list(read_events(tmp_path / "night.mcap"))
    assert isinstance(items[0], RecordedState)
    assert [alarm.event_id for alarm in items[0].state.alarms] == [1]
    assert items[0].state.session == session
    recorded = [item.event for item in items if isinstance(item, RecordedEvent)]
    assert sorted(recorded, key=lambda event: event.seq) == events[1:]
    info = summary(tmp_path / "night.mcap")
    assert info.complete == "yes"
    assert info.about.comment == "a night"


def test_a_filter_selects_what_is_recorded(bus: Bus, tmp_path: Path) -> None:
    """The same language as everywhere; the filter is written into the file."""
    _night(bus, tmp_path / "night.mcap", "is_message and json('/n') between 10 and 19")
    recorded = [item.event for item in read_events(tmp_path / "night.mcap") if isinstance(item, RecordedEvent)]
    assert [event.arguments for event in recorded] == [(Argument.of(number),) for number in range(10, 20)]
    assert "between 10 and 19" in summary(tmp_path / "night.mcap").about.filter


def test_a_replay_into_a_book_ends_in_the_same_state(bus: Bus, tmp_path: Path) -> None:
    """Alarms by key, state, times and confirmation; events by session and seq; the early alarm comes from the keyframe."""
    events, _ = _night(bus, tmp_path / "night.mcap")
    with Book(None, tmp_path / "fresh.db") as book:
        report = replay_into([tmp_path / "night.mcap"], book)
        book.flush()
        assert report.events == len(events) - 1
        assert {key.event_id: alarm.raised for key, alarm in book.alarms.items()} == {1: True, 2: False}
        replayed = [stored.event for stored in book.log(LogQuestion(newest_first=False))]
        replayed.sort(key=lambda event: event.seq)
        assert [msgspec.structs.replace(event, origin=None) for event in replayed] == events[1:]
        assert [event.origin.seq for event in replayed if event.origin is not None] == [event.seq for event in events[1:]]


def test_what_is_no_event_is_in_the_file_with_its_key(bus: Bus, tmp_path: Path) -> None:
    """A payload that could not be decoded is kept, and the file is still complete for its senders."""
    key = f"tc3/1/live/plc1/event/{CLASS}/message/info"
    with Recorder(bus, tmp_path / "x.mcap") as recorder, Publisher(bus, "plc1") as publisher:
        assert recorder.listener.wait_for_beat(publisher.session)
        bus.put(key, b"[{]")
        publisher.send_message(CLASS, 1, Severity.INFO)
        publisher.close()
        assert recorder.listener.wait_for_final(publisher.session)
    items = list(read_events(tmp_path / "x.mcap"))
    (rejected,) = [item.rejected for item in items if isinstance(item, RecordedRejected)]
    assert (rejected.key, rejected.payload) == (key, b"[{]")
    assert sum(isinstance(item, RecordedEvent) for item in items) == 1


def test_what_the_memory_could_not_hold_is_a_gap_in_the_file(bus: Bus, tmp_path: Path) -> None:
    """With room for ten events and a burst before the writer runs, the file says how many are missing."""
    with Publisher(bus, "plc1") as publisher:
        recorder = Recorder(bus, tmp_path / "x.mcap", queue_events=10)
        assert recorder.listener.wait_for_beat(publisher.session)
        for number in range(20_000):
            publisher.send_message(CLASS, number, Severity.INFO)
        publisher.close()
        assert recorder.listener.wait_for_final(publisher.session)
        recorder.close()
    items = list(read_events(tmp_path / "x.mcap"))
    kept = sum(isinstance(item, RecordedEvent) for item in items)
    lost = sum(item.gap.count for item in items if isinstance(item, RecordedGap))
    assert kept + lost == 20_000
    assert summary(tmp_path / "x.mcap").complete == ("no" if lost else "yes")


def test_a_recorder_never_writes_over_a_file(bus: Bus, tmp_path: Path) -> None:
    """The error names the file; the subscription is taken back."""
    (tmp_path / "x.mcap").write_bytes(b"somebody's")
    with pytest.raises(RecordingError, match="exists"):
        Recorder(bus, tmp_path / "x.mcap")
    assert (tmp_path / "x.mcap").read_bytes() == b"somebody's"
