"""One file after the other: names, keyframes, neighbours, what is kept."""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from bridge.core import codec
from bridge.core.alarms import AlarmTable
from bridge.core.events import AnyEvent, MessageSent
from bridge.core.filters.ast import Expr
from bridge.core.sequence import Missing
from bridge.edges.recording import (
    About,
    RecordedEvent,
    RecordedGap,
    RecordedRejected,
    RecordedState,
    RecordingError,
    RecordingWriter,
    missing_parts,
    read_events,
    recover,
    summary,
)
from bridge.edges.recording.folder import Keep, RecordingFolder
from bridge.notices import Gap, Heard, Rejected, Snapshot, TailUnknown
from bridge.recorder.choice import Choice
from bridge.recorder.files import Files, Split
from bridge.recorder.news import Began, Deleted, Finished, News, NotDeleted
from tests.unit.recorder.recorder_stories import CLASS, OTHER, START, S, cleared, disposed, heard, message, raised

KEY = f"tc3/1/live/plc1/event/{CLASS}/message/info"


@contextmanager
def files(
    path: Path,
    filter: Expr | str | None = None,
    split: Split | None = None,
    keep: Keep | None = None,
    told: Callable[[News], None] = lambda news: None,
    trigger: str | None = None,
) -> Iterator[Files]:
    """Files of a recording that is ended at the end of the block."""
    made = Files(
        path,
        Choice(filter, (), trigger),
        about=About(realm="live", recording="r1"),
        split=split,
        keep=keep,
        told=told,
    )
    made.begin(START)
    try:
        yield made
        made.end()
    finally:
        made.abandon()
        made.close()


def put(made: Files, event: AnyEvent, at_s: float = 0.0) -> None:
    """Write an event."""
    item = heard(event, at_s)
    made.write(item, item.arrival_ns)


def recordings(folder: Path) -> list[Path]:
    """The finished files in the order of their names."""
    return sorted(folder.glob("*.mcap"))


def fold(paths: list[Path]) -> AlarmTable:
    """The state after reading these files, keyframes included."""
    table = AlarmTable()
    for path in paths:
        for item in read_events(path):
            if isinstance(item, RecordedState):
                table.load(item.state.alarms, item.state.session, item.state.seq, item.state.target)
            elif isinstance(item, RecordedEvent) and not isinstance(item.event, MessageSent):
                table.apply(item.event)
    return table


def used(folder: Path) -> int:
    """The bytes of all files; one may be given its name meanwhile, and has two for a moment."""
    sizes: dict[int, int] = {}
    for name in os.listdir(folder):
        with contextlib.suppress(FileNotFoundError):
            found = (folder / name).stat()
            sizes[found.st_ino] = found.st_size
    return sum(sizes.values())


def numbers(path: Path) -> list[int]:
    """The ids of the events of a file."""
    return [item.event.event_id for item in read_events(path) if isinstance(item, RecordedEvent)]


def test_a_file_of_a_folder_is_called_after_its_start_and_its_number(tmp_path: Path) -> None:
    """In UTC with milliseconds, so that names sort by time; the folder is made."""
    with files(tmp_path / "night" / "1") as made:
        put(made, message(1), 0.5)
    assert os.listdir(tmp_path / "night" / "1") == ["20261118T110640000Z-000001.mcap"]


def test_a_name_that_is_taken_is_not_given_again(tmp_path: Path) -> None:
    """Neither that of a recording nor that of one being written: the next millisecond is."""
    (tmp_path / "20261118T110640000Z-000001.mcap").touch()
    (tmp_path / "20261118T110640001Z-000001.mcap.active").touch()
    with files(tmp_path) as made:
        assert made.current == tmp_path / "20261118T110640002Z-000001.mcap"


def test_a_split_loses_and_doubles_nothing(tmp_path: Path) -> None:
    """By time: an event that comes a second after the file began is in the next one; times go on growing."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        for number in range(35):
            put(made, message(number), number / 10)
    paths = recordings(tmp_path)
    assert [numbers(path) for path in paths] == [list(range(10)), list(range(10, 20)), list(range(20, 30)), list(range(30, 35))]
    times = [item.log_time_ns for path in paths for item in read_events(path)]
    assert times == sorted(set(times))


def test_times_go_on_growing_when_a_file_ends_ahead_of_its_time(tmp_path: Path) -> None:
    """A hundred events of one nanosecond have a hundred times, and the next file begins behind them."""
    with files(tmp_path) as made:
        for number in range(100):
            put(made, message(number))
        made.split(START + 50)
        put(made, message(100), 0)
    times = [[item.log_time_ns for item in read_events(path)] for path in recordings(tmp_path)]
    assert times == [list(range(START, START + 100)), [START + 100]]
    assert summary(recordings(tmp_path)[1]).about.started_ns == START + 100


def test_files_are_split_by_size(tmp_path: Path) -> None:
    """Each has at least the size asked for and at most a chunk more; all events are there, in order."""
    with files(tmp_path, split=Split(size_bytes=20_000)) as made:
        for number in range(3000):
            put(made, message(number))
            if number % 50 == 49:
                made.flush()
    paths = recordings(tmp_path)
    assert len(paths) > 3
    assert [number for path in paths for number in numbers(path)] == list(range(3000))
    assert all(20_000 <= path.stat().st_size < 40_000 for path in paths[:-1])


def test_a_file_without_an_event_is_not_split_by_time(tmp_path: Path) -> None:
    """A quiet night is one file."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        for second in range(10):
            made.tick(START + second * S)
        put(made, message(1), 20)
        made.tick(START + 21 * S)
    assert [numbers(path) for path in recordings(tmp_path)] == [[1], []]


def test_a_file_begins_with_the_state_at_its_first_event(tmp_path: Path) -> None:
    """What was raised and not disposed before it, nothing that comes later; read alone it gives the state at its end."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        made.write(Snapshot("plc1", "logger", 0, ()), START)
        for event, at_s in (
            (raised(1, 1), 0.1),
            (raised(2, 2), 0.2),
            (raised(3, 3), 0.3),
            (disposed(3, 4), 0.4),
            (cleared(1, 5), 1.0),
            (raised(4, 6), 1.5),
            (cleared(2, 7), 2.5),
        ):
            put(made, event, at_s)
    paths = recordings(tmp_path)
    frames = [[item.state for item in read_events(path) if isinstance(item, RecordedState)] for path in paths]
    assert [[(alarm.event_id, alarm.raised) for alarm in frame[-1].alarms] for frame in frames] == [
        [],
        [(1, True), (2, True)],
        [(1, False), (2, True), (4, True)],
    ]
    assert {frame[0].session for frame in frames} == {"logger"}
    whole = fold(paths)
    assert {key.event_id: alarm.raised for key, alarm in whole.alarms.items()} == {1: False, 2: False, 4: True}
    assert fold(paths[1:]).state() == whole.state()
    assert fold(paths[2:]).state() == whole.state()


def test_an_event_that_is_late_among_keys_is_not_taken_for_old(tmp_path: Path) -> None:
    """Event 7 comes before 6, which has another key, and the file is split between them: both count when read alone."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        made.write(Snapshot("plc1", "logger", 4, ()), START)
        put(made, raised(7, 7), 0.5)
        put(made, raised(6, 6, event_class=OTHER), 1.5)
    assert {key.event_id for key in fold(recordings(tmp_path)[1:]).alarms} == {6, 7}


def test_a_filtered_recording_has_the_alarms_that_the_filter_takes(tmp_path: Path) -> None:
    """Transitions it does not take are folded all the same: an alarm cleared by one is not shown as raised for ever."""
    with files(tmp_path, filter="event_class = '" + CLASS + "' and kind != alarm_cleared", split=Split(seconds=1)) as made:
        made.write(Snapshot("plc1", "logger", 0, ()), START)
        put(made, raised(1, 1), 0.1)
        put(made, raised(2, 2, event_class=OTHER), 0.2)
        put(made, cleared(1, 3), 0.3)
        put(made, message(9), 1.5)
    first, second = recordings(tmp_path)
    assert numbers(first) == [1]
    (frame,) = [item.state for item in read_events(second) if isinstance(item, RecordedState)]
    assert [(alarm.event_id, alarm.raised) for alarm in frame.alarms] == [(1, False)]


def test_what_is_wrong_on_keys_nobody_asked_for_is_not_in_the_file(tmp_path: Path) -> None:
    """Gaps and rejected payloads of the chosen keys, and of those that are no event keys at all."""
    other = KEY.replace(CLASS, OTHER)
    with files(tmp_path, filter=f"event_class = '{CLASS}'") as made:
        for key in (KEY, other):
            made.write(Gap(Missing("s", key, 1, 2), "lost"), START)
            made.write(Rejected(key, b"[{]", "no JSON"), START)
        made.write(Rejected("tc3/1/live/x", b"", "no key"), START)
    (path,) = recordings(tmp_path)
    info = summary(path)
    assert (info.totals.gaps, info.totals.rejected) == (1, 2)


def test_a_disk_that_takes_long_to_finish_a_file_holds_nothing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next file is written meanwhile; the one after it waits."""
    goes_on = threading.Event()
    finish = RecordingWriter.finish

    def slow(self: RecordingWriter, unknown_tails: Sequence[str] = (), next_file: str = "") -> Path:
        assert goes_on.wait(60)
        return finish(self, unknown_tails, next_file)

    monkeypatch.setattr(RecordingWriter, "finish", slow)
    with files(tmp_path) as made:
        put(made, message(1), 1)
        done = made.split(START + 2 * S)
        put(made, message(2), 3)
        made.flush()
        assert recordings(tmp_path) == []
        assert made.current is not None
        assert numbers(made.current.with_name(f"{made.current.name}.active")) == [2]
        goes_on.set()
        assert done.result(60) == recordings(tmp_path)[0]
    assert [numbers(path) for path in recordings(tmp_path)] == [[1], [2]]


def test_who_abandons_a_file_waits_for_the_one_before_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was whole, so it gets its name."""
    abandoned = threading.Event()
    abandon, finish = RecordingWriter.abandon, RecordingWriter.finish

    def slow(self: RecordingWriter, unknown_tails: Sequence[str] = (), next_file: str = "") -> Path:
        assert abandoned.wait(60)
        return finish(self, unknown_tails, next_file)

    def tell(self: RecordingWriter) -> None:
        abandon(self)
        abandoned.set()

    monkeypatch.setattr(RecordingWriter, "finish", slow)
    monkeypatch.setattr(RecordingWriter, "abandon", tell)
    made = Files(tmp_path, Choice(None), about=About())
    made.begin(START)
    made.split(START + S)
    made.abandon()
    made.close()
    assert (len(recordings(tmp_path)), len(list(tmp_path.glob("*.active"))), made.finished) == (1, 1, 1)


def test_without_a_thread_to_finish_a_file_nothing_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file stays as it is, to be recovered, and it is told why."""
    made = Files(tmp_path, Choice(None), about=About(realm="live"))
    made.begin(START)
    put(made, message(1))

    def start(_thread: threading.Thread) -> None:
        raise RuntimeError("no more threads")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(RuntimeError, match="no more threads"):
        made.split(START + S)
    made.abandon()
    made.close()
    assert len(list(tmp_path.glob("*.active"))) == 1


def test_what_goes_wrong_while_a_file_is_finished_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the next look(); the file stays as an active one."""

    def full(self: RecordingWriter, unknown_tails: Sequence[str] = (), next_file: str = "") -> Path:
        raise RecordingError(self.path, "No space left on device")

    made = Files(tmp_path, Choice(None), about=About())
    made.begin(START)
    with monkeypatch.context() as patch:
        patch.setattr(RecordingWriter, "finish", full)
        with pytest.raises(RecordingError, match="No space left"):
            made.split(START + 2 * S).result(60)
        with pytest.raises(RecordingError, match="No space left"):
            made.look()
    made.abandon()
    made.close()
    assert len(list(tmp_path.glob("*.active"))) == len(list(tmp_path.iterdir())) == 2


def test_neighbours_know_each_other(tmp_path: Path) -> None:
    """Each file says which recording it is of, its number, the file before and the one behind it."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        for second in range(3):
            put(made, message(second), second)
    paths = recordings(tmp_path)
    told = [summary(path) for path in paths]
    assert [(info.about.recording, info.about.part) for info in told] == [("r1", 1), ("r1", 2), ("r1", 3)]
    assert [info.about.previous for info in told] == ["", paths[0].name, paths[1].name]
    assert [info.totals.next_file for info in told] == [paths[1].name, paths[2].name, ""]


def test_a_missing_file_is_noticed(tmp_path: Path) -> None:
    """By its number; which is missing can be told in whatever order files are named."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        for second in range(4):
            put(made, message(second), second)
    infos = [summary(path) for path in recordings(tmp_path)]
    assert missing_parts(infos) == []
    assert missing_parts([infos[3], infos[0], infos[1]]) == [("r1", 3)]


def test_a_strangers_event_that_no_recording_can_hold_is_rejected(tmp_path: Path) -> None:
    """Two megabytes of blanks inside an event are valid JSON: recording goes on, and the file says what came."""
    event = message(1)
    with files(tmp_path) as made:
        made.write(Heard(event, b"{" + b" " * (2 << 20) + codec.encode(event)[1:], codec.JSON, START), START)
        put(made, message(2))
    (path,) = recordings(tmp_path)
    assert numbers(path) == [2]
    (rejected,) = [item.rejected for item in read_events(path) if isinstance(item, RecordedRejected)]
    assert (rejected.key, rejected.size > 2 << 20) == (KEY, True)


def test_a_tail_that_is_unknown_is_told_by_the_file_in_which_it_was_noticed(tmp_path: Path) -> None:
    """And at the end by the last one."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        put(made, message(1), 0)
        made.write(TailUnknown("plc1", "gone"), START + S // 2)
        put(made, message(2), 1)
        made.end(["silent"])
    first, second = map(summary, recordings(tmp_path))
    assert (first.totals.unknown_tails, second.totals.unknown_tails) == (("gone",), ("silent",))
    assert made.totals.unknown_tails == ("gone", "silent")
    assert made.totals.events == 2


def test_a_number_of_files_is_kept(tmp_path: Path) -> None:
    """Never more than three, the one being written included; the oldest goes first, and each is told."""
    told: list[News] = []
    most = []
    with files(tmp_path, split=Split(seconds=1), keep=Keep(files=3), told=told.append) as made:
        for second in range(10):
            put(made, message(second), second)
            most.append(len({name.removesuffix(".active") for name in os.listdir(tmp_path)}))
    assert max(most) == 3
    assert [numbers(path) for path in recordings(tmp_path)] == [[7], [8], [9]]
    gone = [news.path for news in told if isinstance(news, Deleted)]
    finished = [news.path for news in told if isinstance(news, Finished)]
    assert gone == finished[:7]
    assert sum(isinstance(news, Began) for news in told) == len(finished) == 10


def test_a_number_of_bytes_is_kept(tmp_path: Path) -> None:
    """Never more than asked for, but for the index of the file that is just being finished."""
    with files(tmp_path, split=Split(size_bytes=20_000), keep=Keep(size_bytes=100_000)) as made:
        for number in range(6000):
            put(made, message(number))
            if number % 50 == 49:
                made.flush()
                assert used(tmp_path) <= 105_000
    assert 3 <= len(recordings(tmp_path)) <= 5
    assert numbers(recordings(tmp_path)[-1])[-1] == 5999


def test_only_files_of_such_a_name_are_ever_deleted(tmp_path: Path) -> None:
    """A copy, a damaged file, a text and a folder stay; a file of an earlier start counts and goes."""
    others = ["copy of 20261118T110640000Z-000001.mcap", "20251118T110640000Z-000001.mcap.damaged", "plant.mcap", "notes.txt"]
    for name in others:
        (tmp_path / name).touch()
    (tmp_path / "20251118T110640000Z-000002.mcap").mkdir()
    earlier = tmp_path / "20251118T110640000Z-000001.mcap"
    earlier.touch()
    with files(tmp_path, split=Split(seconds=1), keep=Keep(files=2)) as made:
        for second in range(3):
            put(made, message(second), second)
    assert not earlier.exists()
    assert len(recordings(tmp_path)) == 5
    assert all((tmp_path / name).exists() for name in others)


def test_what_cannot_be_deleted_is_told_and_recording_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once per file."""
    told: list[News] = []

    def refuse(self: Path, missing_ok: bool = False) -> None:
        raise PermissionError(1, "Operation not permitted")

    with files(tmp_path, split=Split(seconds=1), keep=Keep(files=2), told=told.append) as made, monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refuse)
        for second in range(4):
            put(made, message(second), second)
    refused = [news for news in told if isinstance(news, NotDeleted)]
    assert [news.path for news in refused] == recordings(tmp_path)[:2]
    assert "not permitted" in str(refused[0])


def test_one_recorder_per_folder(tmp_path: Path) -> None:
    """The second one is refused and told why; when the first has closed, it is not."""
    with files(tmp_path), pytest.raises(RecordingError, match="the folder of a running recorder"):
        RecordingFolder(tmp_path)
    RecordingFolder(tmp_path).close()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    """And a folder that cannot be made is refused with the reason."""
    (tmp_path / "notes").touch()
    with pytest.raises(RecordingError, match="is no folder"):
        RecordingFolder(tmp_path / "notes")
    with pytest.raises(RecordingError, match="Not a directory"):
        RecordingFolder(tmp_path / "notes" / "deeper")


def test_choices_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    """One file is not split, and a number of bytes is kept only of files that are small enough."""
    for split, keep in ((Split(seconds=1), None), (None, Keep(files=2))):
        with pytest.raises(ValueError, match="name a folder"):
            Files(tmp_path / "one.mcap", Choice(None), about=About(), split=split, keep=keep)
    for split in (None, Split(seconds=1), Split(size_bytes=51)):
        with pytest.raises(ValueError, match="at most half"):
            Files(tmp_path, Choice(None), about=About(), split=split, keep=Keep(size_bytes=100))
    with pytest.raises(ValueError, match="not negative"):
        Split(seconds=-1)
    for count in (-1, 1):
        with pytest.raises(ValueError, match="at least two files"):
            Keep(files=count)


def test_a_file_that_is_deleted_while_it_is_written_stops_the_recording(tmp_path: Path) -> None:
    """Else everything would go into a file that nobody can find."""
    writer = RecordingWriter(tmp_path / "x.mcap")
    writer.active_path.unlink()
    with pytest.raises(RecordingError, match="deleted while it was written"):
        writer.flush()
    writer.abandon()


def test_a_killed_split_is_recovered_with_its_place_in_the_recording(tmp_path: Path) -> None:
    """Number and neighbour before are in the recovered file."""
    with files(tmp_path, split=Split(seconds=1)) as made:
        put(made, message(1), 0)
        put(made, message(2), 1)
        made.flush()
        made.abandon()
    (left,) = tmp_path.glob("*.active")
    info = summary(recover(left).path)
    assert (info.about.part, info.about.previous, info.complete) == (2, recordings(tmp_path)[0].name, "tail unknown")


def test_gaps_are_records_in_their_place(tmp_path: Path) -> None:
    """What the memory did not hold, and what was not recorded on purpose, stand between the events around them."""
    with files(tmp_path) as made:
        put(made, message(1), 0.1)
        made.miss(7, "a pause", START + S // 5)
        put(made, message(2), 0.3)
    (path,) = recordings(tmp_path)
    kinds = [type(item) for item in read_events(path)]
    assert kinds == [RecordedEvent, RecordedGap, RecordedEvent]
    assert summary(path).complete == "no"
