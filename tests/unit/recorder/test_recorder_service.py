"""A recorder in one process: what it recovers, what it does when it is told to, how it stands, and how it fails."""

import errno
import os
import platform
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bridge import EventLogger, Publisher, Recorder, Severity, open_bus
from bridge.control import tell
from bridge.core import control
from bridge.core.hresult import ADS_E_INVALIDPARM, ADS_E_INVALIDSTATE, AdsError
from bridge.edges.bus import ALONE, Bus
from bridge.edges.recording import (
    RecordedEvent,
    RecordedGap,
    RecordedState,
    RecordingError,
    RecordingWriter,
    read_events,
    summary,
)
from bridge.notices import Item
from bridge.recorder import Capture, Deleted, Finished, Keep, News, NotRecovered, Recovered, Split, controlled, service
from bridge.recorder.files import Files
from tests.e2e.fault_stories import eventually
from tests.unit.recorder.recorder_stories import CLASS, OTHER


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


def recordings(folder: Path) -> list[Path]:
    """The finished files in the order of their names."""
    return sorted(folder.glob("*.mcap"))


def numbers(*paths: Path) -> list[int]:
    """The ids of the events of these files."""
    return [item.event.event_id for path in paths for item in read_events(path) if isinstance(item, RecordedEvent)]


def send(publisher: Publisher, recorder: Recorder, *ids: int, severity: Severity = Severity.INFO) -> None:
    """Send messages, and wait until the recorder has them."""
    before = recorder.listener.counters.passed
    for number in ids:
        publisher.send_message(CLASS, number, severity)
    assert eventually(lambda: recorder.listener.counters.passed == before + len(ids))


def told(bus: Bus, recorder: Recorder, *commands: control.ControlCommand, name: str = "night") -> control.Facts:
    """Tell it all of this over the bus; its status after the last one."""
    answer = None
    with controlled(recorder, bus, name, stop=lambda: None):
        for command in commands:
            answer = tell(bus, name, command, operator="Kim", comment="a look")
    assert answer is not None
    return answer.status


def test_a_pause_is_a_gap_with_a_keyframe_behind_it(bus: Bus, tmp_path: Path) -> None:
    """What came meanwhile is counted; alarms that were raised meanwhile are in the keyframe."""
    path = tmp_path / "night.mcap"
    with EventLogger("plc1", bus=bus) as logger, Recorder(bus, path) as recorder:
        assert recorder.listener.wait_for_beat(logger.session)
        logger.send_message(CLASS, 1, Severity.INFO)
        assert eventually(lambda: recorder.status.events == 1)
        recorder.pause()
        recorder.pause()
        assert recorder.status.state == "paused"
        alarm = logger.create_alarm(CLASS, 2, Severity.ERROR).alarm
        assert alarm is not None
        logger.raise_alarm(alarm)
        logger.send_message(CLASS, 3, Severity.INFO)
        assert logger.publisher.flush()
        assert eventually(lambda: recorder.listener.counters.passed == 3)
        recorder.resume()
        logger.send_message(CLASS, 4, Severity.INFO)
    items = list(read_events(path))
    assert numbers(path) == [1, 4]
    (gap,) = [item.gap for item in items if isinstance(item, RecordedGap)]
    assert (gap.count, gap.reason) == (2, "the recorder was paused")
    assert [type(item) for item in items[-3:]] == [RecordedGap, RecordedState, RecordedEvent]
    frame = items[-2]
    assert isinstance(frame, RecordedState)
    assert [alarm.event_id for alarm in frame.state.alarms] == [2]
    assert summary(path).complete == "no"


def test_a_pause_that_nobody_ends_is_a_gap_too(bus: Bus, tmp_path: Path) -> None:
    """Of the file that ends in it, and of the one before a split: neither is complete, nothing is counted twice."""
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path) as recorder:
        send(publisher, recorder, 1)
        recorder.pause()
        send(publisher, recorder, 2, 3)
        recorder.split()
        send(publisher, recorder, 4)
    first, second = map(summary, recordings(tmp_path))
    assert [(info.complete, info.totals.gap_events) for info in (first, second)] == [("no", 2), ("no", 1)]
    assert numbers(*recordings(tmp_path)) == [1]


def test_what_came_before_an_order_is_dealt_with_before_it(bus: Bus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also by a recorder that is behind: ten events wait when it is told to pause, and all are recorded."""
    goes_on = threading.Event()
    write = Files.write

    def behind(self: Files, item: Item, at_ns: int) -> None:
        assert goes_on.wait(60)
        write(self, item, at_ns)

    monkeypatch.setattr(service, "BATCH", 2)
    monkeypatch.setattr(Files, "write", behind)
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path) as recorder:
        send(publisher, recorder, *range(10))
        pause = threading.Thread(target=recorder.pause)
        pause.start()
        assert eventually(lambda: bool(recorder._orders))
        goes_on.set()
        pause.join(60)
        assert (recorder.status.state, recorder.status.events) == ("paused", 10)


def test_an_order_that_was_given_up_is_not_carried_out_later(bus: Bus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recorder whose disk took too long said so; who was told that is not paused by surprise."""
    goes_on = threading.Event()
    write = Files.write

    def behind(self: Files, item: Item, at_ns: int) -> None:
        assert goes_on.wait(60)
        write(self, item, at_ns)

    monkeypatch.setattr(service, "ANSWER_S", 0.05)
    monkeypatch.setattr(Files, "write", behind)
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path) as recorder:
        send(publisher, recorder, 1)
        with pytest.raises(TimeoutError):
            recorder.pause()
        monkeypatch.setattr(service, "ANSWER_S", 30)
        goes_on.set()
        recorder.split()
        assert recorder.status.state == "recording"
        send(publisher, recorder, 2)
    assert numbers(*recordings(tmp_path)) == [1, 2]


def test_a_recorder_is_told_to_split_over_the_bus(bus: Bus, tmp_path: Path) -> None:
    """The events before are in one file, those after in the next, and the status says which it writes."""
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path) as recorder:
        send(publisher, recorder, 1, 2)
        assert eventually(lambda: recorder.status.events == 2)
        status = told(bus, recorder, control.Split())
        assert (status["state"], status["events"]) == ("recording", 2)
        (finished,) = recordings(tmp_path)
        assert status["file"] not in ("", str(finished))
        assert eventually(lambda: recorder.status.files == 1)
        send(publisher, recorder, 3)
    assert [numbers(path) for path in recordings(tmp_path)] == [[1, 2], [3]]
    assert recorder.status.state == "stopped"


def test_a_capture_is_asked_for_over_the_bus(bus: Bus, tmp_path: Path) -> None:
    """Who asked and why is in the file; while it is paused nobody can ask."""
    capture = Capture(trigger="severity = critical", before_s=60, after_s=60)
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path, capture=capture) as recorder:
        send(publisher, recorder, 1, 2)
        assert recorder.status.state == "waiting for a trigger"
        assert os.listdir(tmp_path) == []
        with pytest.raises(AdsError) as refused:
            told(bus, recorder, control.Pause(), control.Trigger())
        assert (refused.value.code, refused.value.detail) == (ADS_E_INVALIDPARM, "the recorder is paused")
        status = told(bus, recorder, control.Resume(), control.Trigger())
        assert (status["state"], status["triggers"]) == ("recording", 1)
        send(publisher, recorder, 3)
    (path,) = recordings(tmp_path)
    assert numbers(path) == [1, 2, 3]
    more = dict(summary(path).about.more)
    versions = more.pop("versions")
    assert versions.startswith(f"Python {platform.python_version()}, eclipse-zenoh 1.")
    assert more == {
        "trigger": "severity = critical",
        "before_s": "60",
        "after_s": "60",
        "captured": "asked for by Kim: a look",
    }


def test_a_pause_ends_a_capture(bus: Bus, tmp_path: Path) -> None:
    """The file is finished at once, and triggers are ignored until it goes on."""
    capture = Capture(trigger="severity = critical")
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path, capture=capture) as recorder:
        send(publisher, recorder, 1)
        send(publisher, recorder, 2, severity=Severity.CRITICAL)
        assert eventually(lambda: recorder.status.triggers == 1)
        recorder.pause()
        assert [numbers(path) for path in recordings(tmp_path)] == [[1, 2]]
        send(publisher, recorder, 3, severity=Severity.CRITICAL)
        recorder.resume()
        assert recorder.status.triggers == 1


def test_a_trigger_is_recorded_whatever_the_filter_says(bus: Bus, tmp_path: Path) -> None:
    """Recorded is what the filter or the trigger takes; targets bound both."""
    capture = Capture(trigger="severity = critical")
    with (
        Publisher(bus, "plc1") as publisher,
        Publisher(bus, "plc2") as other,
        Recorder(bus, tmp_path, f"event_class = '{OTHER}'", targets=("plc1",), capture=capture) as recorder,
    ):
        publisher.send_message(CLASS, 1, Severity.INFO)
        publisher.send_message(OTHER, 2, Severity.INFO)
        other.send_message(OTHER, 3, Severity.CRITICAL)
        publisher.send_message(CLASS, 4, Severity.CRITICAL)
        publisher.send_message(OTHER, 5, Severity.INFO)
        assert eventually(lambda: recorder.status.events == 3)
    (path,) = recordings(tmp_path)
    assert sorted(numbers(path)) == [2, 4, 5]
    assert summary(path).about.more["targets"] == "plc1"


def test_what_a_crash_left_is_recovered_at_the_next_start(bus: Bus, tmp_path: Path) -> None:
    """In a folder all of it, each told; what cannot be is told too, stays, and keeps nothing from being recorded.

    A file without a byte, of a recorder that was killed before it wrote, is gone.
    """
    news: list[News] = []
    killed = RecordingWriter(tmp_path / "20251118T110640000Z-000001.mcap")
    killed.flush()
    killed.abandon()
    (tmp_path / "20251118T110640000Z-000002.mcap.active").write_bytes(b"no recording")
    (tmp_path / "20251118T110640000Z-000003.mcap.active").touch()
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path, told=news.append) as recorder:
        send(publisher, recorder, 1)
    assert [type(each) for each in news[:2]] == [Recovered, NotRecovered]
    assert "000002.mcap.active is not recovered: is no MCAP file" in str(news[1])
    assert isinstance(news[-1], Finished)
    assert [numbers(path) for path in recordings(tmp_path)] == [[], [1]]
    assert len(list(tmp_path.glob("*.active"))) == 1


def test_a_recovered_file_counts_among_those_that_are_kept(bus: Bus, tmp_path: Path) -> None:
    """It is the oldest, and goes first."""
    killed = RecordingWriter(tmp_path / "20251118T110640000Z-000001.mcap")
    killed.flush()
    killed.abandon()
    news: list[News] = []
    with Publisher(bus, "plc1") as publisher, Recorder(bus, tmp_path, keep=Keep(files=2), told=news.append) as recorder:
        for number in range(2):
            send(publisher, recorder, number)
            recorder.split()
    assert len(recordings(tmp_path)) == 2
    assert next(each.path.name for each in news if isinstance(each, Deleted)) == "20251118T110640000Z-000001.mcap"


def test_a_single_file_that_was_recovered_is_not_written_over(bus: Bus, tmp_path: Path) -> None:
    """It has its name then, so the recording is refused: a recorder that is started again writes to a folder."""
    news: list[News] = []
    killed = RecordingWriter(tmp_path / "night.mcap")
    killed.flush()
    killed.abandon()
    with pytest.raises(RecordingError, match="exists"):
        Recorder(bus, tmp_path / "night.mcap", told=news.append)
    assert [type(each) for each in news] == [Recovered]
    assert summary(tmp_path / "night.mcap").complete == "tail unknown"


def test_a_recorder_that_cannot_write_stops_loudly(bus: Bus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """wait() returns, the status says why, orders are refused, close() raises; what was flushed can be recovered."""

    def full(self: RecordingWriter) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    recorder = Recorder(bus, tmp_path)
    with Publisher(bus, "plc1") as publisher:
        send(publisher, recorder, 1)
        assert eventually(lambda: recorder.status.events == 1)
        with monkeypatch.context() as patch:
            patch.setattr(RecordingWriter, "flush", full)
            send(publisher, recorder, 2)
            assert recorder.wait(30)
    assert recorder.status.state == "failed"
    assert "No space left" in recorder.status.error
    with pytest.raises(AdsError, match="No space left") as refused:
        told(bus, recorder, control.Split())
    assert refused.value.code == ADS_E_INVALIDSTATE
    with pytest.raises(RecordingError, match="No space left"):
        recorder.close()
    with Recorder(bus, tmp_path):
        pass
    assert numbers(recordings(tmp_path)[0]) == [1]


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (lambda bus, path: Recorder(bus, path / "x.mcap", capture=Capture(trigger="is_alarm")), "captures need a folder"),
        (lambda bus, path: Recorder(bus, path / "x.mcap", split=Split(seconds=1)), "name a folder"),
        (lambda bus, path: Recorder(bus, path, "severity > "), "expected"),
    ],
)
def test_wrong_choices_are_refused_at_once(
    bus: Bus, tmp_path: Path, wrong: Callable[[Bus, Path], Recorder], reason: str
) -> None:
    """And leave nothing behind: neither a file nor a lock nor a subscription."""
    with pytest.raises(ValueError, match=reason):
        wrong(bus, tmp_path)
    assert os.listdir(tmp_path) == []
    with Recorder(bus, tmp_path):
        pass


def test_an_order_that_makes_no_sense_is_refused(bus: Bus, tmp_path: Path) -> None:
    """A single file is not split, a recorder without a trigger captures nothing; recording goes on."""
    with Recorder(bus, tmp_path / "x.mcap") as recorder:
        for order, reason in ((recorder.split, "name a folder"), (recorder.trigger, "nothing to trigger")):
            with pytest.raises(ValueError, match=reason):
                order()
        assert recorder.status.state == "recording"
    with pytest.raises(RecordingError, match="not recorded any more"):
        recorder.pause()
