"""What is told about loss is true: no gap that is none, none twice, none forgotten, and a stranger silences nobody."""

import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge import EventLogger, Gap, Listener, MessageSent, Publisher, Recorder, Severity, open_bus
from bridge.core import codec, keys
from bridge.core.events import Event
from bridge.core.questions import LogQuestion
from bridge.core.sequence import Beat
from bridge.edges.bus import ALONE, Bus
from bridge.logger import Book, Mirror
from bridge.replayer import replay_into

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "0a1b2c3d-0000-4000-8000-000000000001"


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


def test_a_reader_who_pauses_and_waits_loses_nothing(bus: Bus) -> None:
    """With on_full="wait" what stands in the channel is late, not lost: no gap, no duplicate, all of it in order."""
    with Listener(bus, on_full="wait", queue_events=100) as listener:
        publisher = Publisher(bus, "plc1", on_full="wait")
        assert listener.wait_for_beat(publisher.session)
        for number in range(30_000):
            publisher.send_message(CLASS, number, Severity.INFO)
        assert publisher.close(20) == 0
        threading.Event().wait(0.7)  # the pause is what is tested: longer than a tail may stay missing
        items = [listener.get(30) for _ in range(30_000)]
        assert listener.wait_for_final(publisher.session, 30)
    assert [item.key_seq for item in items if isinstance(item, Event)] == list(range(1, 30_001))
    assert listener.counters.missing == listener.counters.duplicates == 0


def test_strangers_without_a_session_or_a_target_silence_nobody(bus: Bus) -> None:
    """Beats that disagree with their key are rejected, events without a session are not numbered; good ones still come."""
    event = MessageSent(target="plc1", event_class=CLASS, event_id=1, severity=Severity.INFO, time_ns=1)
    beat_key = keys.verb_key("live", "plc1", "@beat", "x")
    with Listener(bus, with_state=True) as listener:
        for number in (1, 9):
            numbered = msgspec.structs.replace(event, seq=number, key_seq=number)
            bus.put(keys.event_key("live", event), codec.encode(numbered))
        for beat in (
            Beat(target="", session="x", role="logger"),
            Beat(target="plc1", session="", seq=1),
            Beat(target="plc1", session="", seq=2, keys={keys.event_key("live", event): 5}),
            Beat(target="plc1", session="", final=True, unsent=1, seq=1),
        ):
            bus.put(beat_key, msgspec.json.encode(beat))
        with Publisher(bus, "plc1") as publisher:
            assert listener.wait_for_beat(publisher.session)
            sent = publisher.send_message(OTHER, 5, Severity.INFO)
            got = listener.take(3, timeout_s=30)
    assert [found for found in got if found.event_class == OTHER] == [sent]
    assert len(got) == 3
    assert listener.counters.rejected_payloads == 4


def test_what_a_sender_could_not_send_is_told_once(bus: Bus) -> None:
    """A sender that closes at once: what came and what is missing make up what it numbered."""
    count = 60_000
    with Listener(bus, on_full="wait") as listener:
        publisher = Publisher(bus, "plc1")
        assert listener.wait_for_beat(publisher.session)
        for number in range(count):
            publisher.send_message(CLASS, number, Severity.INFO)
        publisher.close(0)
        items: list[object] = []
        while not listener.wait_for_final(publisher.session, 0.05):
            items += iter(lambda: listener.get(0), None)
            assert len(items) <= count + 1
    items += iter(lambda: listener.get(0), None)
    heard = sum(isinstance(item, Event) for item in items)
    missing = sum(item.missing.count for item in items if isinstance(item, Gap))
    assert heard + missing == count
    assert listener.counters.missing == missing


def test_a_logger_that_starts_again_during_a_recording_is_replayed_as_it_was(bus: Bus, tmp_path: Path) -> None:
    """Alarms that wait for confirmation since before the recording come with its session, as a keyframe."""
    cache = tmp_path / "plc1.db"
    with EventLogger("plc1", bus=bus, cache=cache) as logger:
        waiting = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True).alarm
        logger.raise_alarm(waiting)
        logger.clear_alarm(waiting)
    with Recorder(bus, tmp_path / "run.mcap") as recorder, EventLogger("plc1", bus=bus, cache=cache) as logger:
        assert recorder.listener.wait_for_beat(logger.session)
        late = logger.create_alarm(CLASS, 2, Severity.ERROR, with_confirmation=True).alarm
        logger.raise_alarm(late)
        logger.clear_alarm(late)
        live = logger.book.logbook.table.state()
        recorder.close()
    with Book() as book:
        replay_into([tmp_path / "run.mcap"], book)
        assert book.logbook.table.state() == live
    assert {key.event_id for key in live} == {1, 2}


def test_a_mirror_keeps_one_unique_id_per_life(bus: Bus) -> None:
    """Although its state is ahead of its events: a life has one id there as in the logger."""
    lives = 200
    with EventLogger("plc1", bus=bus) as logger, Mirror(bus, "plc1") as mirror:
        assert mirror.wait_for_promise(logger.session)
        for number in range(lives):
            alarm = logger.create_alarm(CLASS, number, Severity.ERROR).alarm
            logger.raise_alarm(alarm)
            logger.clear_alarm(alarm)
            logger.dispose_alarm(alarm)
        assert mirror.wait_for(logger.session, logger.publisher.seq)
        for book in (logger.book, mirror.book):
            ids: dict[int, set[int]] = defaultdict(set)
            for stored in book.log(LogQuestion()):
                ids[stored.event.event_id].add(stored.unique_id)
            assert {number: len(found) for number, found in ids.items()} == dict.fromkeys(range(lives), 1)


def test_many_senders_leave_no_trace(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """A listener of months remembers the last sessions that ended, not each of them."""
    monkeypatch.setattr("bridge.losses.MAX_ENDED", 5)
    with Listener(bus) as listener:
        for _ in range(20):
            with Publisher(bus, "plc1") as publisher:
                assert listener.wait_for_beat(publisher.session)
                publisher.send_message(CLASS, 1, Severity.INFO)
            assert listener.wait_for_final(publisher.session)
        assert len(listener._losses._final) == 5
        assert sum(listener.tracker.started(session) for session in list(listener._losses._sessions)) <= 6
