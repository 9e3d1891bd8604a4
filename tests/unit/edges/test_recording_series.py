"""Several recordings read as one."""

import os
import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from bridge.edges.recording import (
    Part,
    RecordedEvent,
    RecordingError,
    RecordingWriter,
    read_series,
)
from tests.unit.edges.recording_stories import PUMP, START, STATE, everything, kinds, message, record, write_story


def write(path: Path, numbers: list[int]) -> Path:
    """A recording of messages, each as long after START as its number says."""
    with RecordingWriter(path) as writer:
        writer.add_state(STATE, START + 10 * numbers[0])
        for number in numbers:
            record(writer, message(number), START + 10 * number + 1)
            if number % 3 == 0:
                writer.flush()
    return path


def numbers(paths: list[Path], part: Part | None = None) -> list[int]:
    """The ids of the events of several files, in the order of reading."""
    with read_series(paths, part or Part()) as series:
        return [item.event.event_id for item in series if isinstance(item, RecordedEvent)]


def test_one_file_is_read_as_it_is(tmp_path: Path) -> None:
    """Nothing is taken out of a single file."""
    write_story(tmp_path / "a.mcap")
    with read_series([tmp_path / "a.mcap"]) as series:
        assert list(series) == everything(tmp_path / "a.mcap")


def test_files_are_read_in_the_order_of_time(tmp_path: Path) -> None:
    """However they are named and however they overlap, each event once."""
    chance = random.Random(5)
    for case in range(20):
        paths, expected = [], set()
        for name in "abcd":
            chosen = sorted(chance.sample(range(40), chance.randrange(1, 20)))
            expected |= set(chosen)
            paths.append(write(tmp_path / f"{case}{name}.mcap", chosen))
        chance.shuffle(paths)
        assert numbers(paths) == sorted(expected)


def test_an_event_of_two_files_is_given_once_and_a_keyframe_of_each(tmp_path: Path) -> None:
    """Two recorders of one plant: the events are the same, the keyframes may differ in what they know."""
    paths = [write(tmp_path / "a.mcap", [0, 1, 2, 3]), write(tmp_path / "b.mcap", [2, 3, 4])]
    with read_series(paths) as series:
        assert "".join(kinds(list(series))) == "seeseee"
    assert numbers(paths) == [0, 1, 2, 3, 4]


def test_a_part_of_several_files(tmp_path: Path) -> None:
    """The part is taken of each."""
    paths = [write(tmp_path / "a.mcap", [0, 1, 2, 3]), write(tmp_path / "b.mcap", [7, 8])]
    assert numbers(paths, Part(start_ns=START + 11, end_ns=START + 72)) == [1, 2, 3, 7]
    assert numbers(paths, Part(classes=frozenset({PUMP}))) == []


def test_a_damaged_file_is_named_and_the_others_go_on(tmp_path: Path) -> None:
    """Its readable part is given in its place."""
    paths = [write(tmp_path / "a.mcap", list(range(0, 20, 2))), write(tmp_path / "b.mcap", list(range(1, 20, 2)))]
    data = paths[0].read_bytes()
    paths[0].write_bytes(data[: len(data) // 2])
    with read_series(paths) as series:
        found = [item.event.event_id for item in series if isinstance(item, RecordedEvent)]
        assert list(series.damages) == [paths[0]]
        assert series.damages[paths[0]].torn
    assert set(range(1, 20, 2)) <= set(found)
    assert found == sorted(found)


def test_what_is_no_recording_is_told_before_anything_is_given(tmp_path: Path) -> None:
    """Not after a night's worth of the first file."""
    good = write(tmp_path / "a.mcap", [1])
    with pytest.raises(RecordingError, match=r"b\.mcap: No such file"):
        read_series([good, tmp_path / "b.mcap"])


def test_files_are_opened_when_they_are_due(tmp_path: Path) -> None:
    """Many files after each other are not all open at once."""
    paths = [write(tmp_path / f"{number:03}.mcap", [2 * number, 2 * number + 1]) for number in range(60)]
    before = len(os.listdir("/proc/self/fd"))
    most = 0
    with read_series(paths) as series:
        for _ in series:
            most = max(most, len(os.listdir("/proc/self/fd")) - before)
    assert most <= 3


def test_events_without_numbers_are_never_taken_for_the_same(tmp_path: Path) -> None:
    """A sender that does not number says nothing about which is which."""
    for name in "ab":
        with RecordingWriter(tmp_path / f"{name}.mcap") as writer:
            record(writer, replace(message(1), seq=0), START + 1)
    assert numbers([tmp_path / "a.mcap", tmp_path / "b.mcap"]) == [1, 1]


def test_at_the_same_time_the_file_that_is_named_first_comes_first(tmp_path: Path) -> None:
    """Also when the other one is open already."""
    for name, times in (("a", [10, 20]), ("b", [5, 10, 20])):
        with RecordingWriter(tmp_path / f"{name}.mcap") as writer:
            for time in times:
                record(writer, replace(message(1), session=name, seq=time, event_id=ord(name)), START + time)
    assert bytes(numbers([tmp_path / "a.mcap", tmp_path / "b.mcap"])) == b"babab"
    assert bytes(numbers([tmp_path / "b.mcap", tmp_path / "a.mcap"])) == b"bbaba"
