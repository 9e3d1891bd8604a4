"""Recordings cut, filtered and merged."""

import gc
import random
import weakref
from collections.abc import Iterable
from pathlib import Path

import pytest
from msgspec.structs import replace

from bridge.core import codec
from bridge.core.alarms import Alarm
from bridge.core.events import AnyEvent
from bridge.core.filters.text import parse
from bridge.edges.recording import (
    EVERYTHING,
    Attachment,
    Gap,
    Part,
    Recorded,
    RecordedEvent,
    RecordedGap,
    RecordedState,
    RecordingError,
    RecordingReader,
    RecordingWriter,
    Standing,
    StateFrame,
    copy_part,
    read_events,
    read_series,
    scan,
    standing_at,
    summary,
)
from bridge.edges.recording import series as series_module
from bridge.edges.recording.copying import Fills
from bridge.edges.recording.index import read_index
from tests.unit.edges.recording_stories import (
    ABOUT,
    AXIS,
    GAP,
    PUMP,
    START,
    STATE,
    cleared,
    events_of,
    everything,
    kinds,
    message,
    raised,
    record,
    write_story,
)

KEY = f"tc3/1/live/plc1/event/{AXIS}/message/info"


def history(count: int, seed: int = 1) -> list[AnyEvent]:
    """Messages, and alarms that come and go."""
    chance = random.Random(seed)
    events: list[AnyEvent] = []
    up: set[int] = set()
    for number in range(count):
        kind = chance.randrange(3)
        if kind == 0 or (kind == 1 and not up):
            events.append(message(number, (AXIS, PUMP)[number % 2]))
        elif kind == 1:
            which = chance.choice(sorted(up))
            up.discard(which)
            events.append(replace(cleared(which), seq=number + 1, time_ns=START + number))
        else:
            which = chance.randrange(8)
            up.add(which)
            events.append(replace(raised(which), seq=number + 1, time_ns=START + number))
    return events


def write(path: Path, events: Iterable[tuple[int, AnyEvent]], states: Iterable[StateFrame] = ()) -> Path:
    """A recording: keyframes, then events at START + 100 * number, a few per chunk."""
    with RecordingWriter(path, about=ABOUT) as writer:
        for number, event in events:
            for state in states:
                writer.add_state(state, START + 100 * number - 50)
            states = ()
            record(writer, event, START + 100 * number)
            if number % 7 == 0:
                writer.flush()
    return path


def fold(items: Iterable[Recorded]) -> list[Alarm]:
    """The alarms after all of it."""
    standing = Standing()
    for item in items:
        if isinstance(item, RecordedState):
            standing.state(item.state)
        elif isinstance(item, RecordedEvent) and item.event.is_alarm:
            standing.event(item.realm, item.event)  # type: ignore[arg-type]
    return sorted(standing.alarms(), key=lambda alarm: alarm.event_id)


def test_a_copy_of_everything_is_the_same(tmp_path: Path) -> None:
    """Bytes, times, gaps, rejected payloads, keyframes, who recorded it, attachments."""
    source = tmp_path / "a.mcap"
    attached = Attachment("plant.tmc", b"<x/>", "application/xml", 5)
    with RecordingWriter(source, about=ABOUT, attachments=[attached]) as writer:
        writer.add_state(STATE, START)
        record(writer, message(1), START + 1, codec.MSGPACK)
        writer.add_gap(GAP, START + 2)
        writer.add_rejected("tc3/1/live/plc1/event/x", codec.JSON, b"\xff{", "no JSON", START + 3)
        writer.finish(["s7"])
    report = copy_part([source], tmp_path / "b.mcap")
    assert (report.events, report.gaps, report.missing, report.rejected, report.keyframes) == (1, 1, 7, 1, 1)
    assert everything(tmp_path / "b.mcap") == everything(source)
    one, other = summary(source), summary(tmp_path / "b.mcap")
    assert one.totals == other.totals
    assert (one.attachments, one.about.host, one.about.filter) == (other.attachments, other.about.host, other.about.filter)
    assert scan(tmp_path / "b.mcap").totals == other.totals


def test_a_cut_begins_with_the_alarms_as_they_were(tmp_path: Path) -> None:
    """Wherever it is cut: the events are those of its time, and folding the cut ends where folding the whole ends."""
    source = write(tmp_path / "a.mcap", enumerate(history(60)))
    whole = everything(source)
    end = fold(whole)
    assert end
    for number in range(0, 62, 4):
        start_ns = START + 100 * number + 1
        cut = tmp_path / f"{number}.mcap"
        copy_part([source], cut, Part(start_ns=start_ns))
        items = everything(cut)
        wanted = [item for item in whole if item.log_time_ns >= start_ns]
        assert [item for item in items if isinstance(item, RecordedEvent)] == wanted
        assert fold(items) == end
        begin = [item for item in items if item.log_time_ns < start_ns]
        assert fold(begin) == fold(item for item in whole if item.log_time_ns < start_ns)
        assert all(isinstance(item, RecordedState) for item in begin)


def test_a_part_between_two_times_ends_in_the_state_of_its_end(tmp_path: Path) -> None:
    """start <= t < end, by the times of arrival."""
    source = write(tmp_path / "a.mcap", enumerate(history(60, seed=4)))
    copy_part([source], tmp_path / "b.mcap", Part(start_ns=START + 1000, end_ns=START + 4000))
    items = everything(tmp_path / "b.mcap")
    assert [item.log_time_ns for item in items if isinstance(item, RecordedEvent)] == list(
        range(START + 1000, START + 4000, 100)
    )
    assert fold(items) == sorted(standing_at([source], START + 3999).alarms(), key=lambda alarm: alarm.event_id)


def test_the_filter_of_a_copy_is_told_and_restricts_its_keyframes(tmp_path: Path) -> None:
    """Alarms that the filter does not take by their state are not in the keyframe either; gaps of other keys are not kept."""
    source = write(tmp_path / "a.mcap", [(1, raised(13)), (2, raised(15)), (3, message(13)), (4, message(14, PUMP))], [STATE])
    copy_part([source], tmp_path / "b.mcap", Part(start_ns=START + 300, filter=parse("event_id = 13")))
    items = everything(tmp_path / "b.mcap")
    assert [alarm.event_id for alarm in fold(items)] == [13]
    assert [event.event_id for event in events_of(items)] == [13]
    assert summary(tmp_path / "b.mcap").about.filter == f"({ABOUT.filter}) and (event_id = 13)"


def test_merged_files_have_each_event_once_and_in_order(tmp_path: Path) -> None:
    """Two recorders of one plant that each missed something else."""
    events = list(enumerate(history(80, seed=2)))
    one = write(tmp_path / "a.mcap", [pair for pair in events if pair[0] % 5])
    other = write(tmp_path / "b.mcap", [pair for pair in events if pair[0] % 3], [STATE])
    report = copy_part([other, one], tmp_path / "c.mcap")
    items = everything(tmp_path / "c.mcap")
    assert events_of(items) == [event for number, event in events if number % 15]
    assert (report.events, report.keyframes) == (len(events_of(items)), 1)
    assert summary(tmp_path / "c.mcap").about.more["made_of"] == "b.mcap, a.mcap"


def test_a_gap_loses_what_another_file_has(tmp_path: Path) -> None:
    """And what nobody has stays missing, in its place."""
    for name, there in (("a", [1, 2, 9]), ("b", [4, 5, 9])):
        with RecordingWriter(tmp_path / f"{name}.mcap") as writer:
            for number in there:
                record(writer, replace(message(1), seq=number, key_seq=number), START + 10 * number)
                if number in (2, 5):
                    missing = Gap(session="s1", key=KEY, first_key_seq=3 if name == "a" else 6, last_key_seq=8, count=6)
                    writer.add_gap(replace(missing, count=9 - missing.first_key_seq), START + 10 * number + 1)
            if name == "b":
                writer.add_gap(Gap(session="", key="", first_key_seq=0, last_key_seq=0, count=3), START + 95)
    report = copy_part([tmp_path / "a.mcap", tmp_path / "b.mcap"], tmp_path / "c.mcap")
    items = everything(tmp_path / "c.mcap")
    gaps = [(item.gap.first_key_seq, item.gap.last_key_seq, item.gap.count) for item in items if isinstance(item, RecordedGap)]
    assert gaps == [(3, 3, 1), (6, 8, 3), (0, 0, 3)]
    assert (report.filled, report.missing) == (2, 7)
    assert "".join(kinds(items)) == "eeggeeeg"


@pytest.mark.parametrize(("end", "complete"), [(None, "tail unknown"), (START + 300, "yes")])
def test_a_copy_knows_its_tail_when_it_ends_before_that_of_its_source(tmp_path: Path, end: int | None, complete: str) -> None:
    """What comes behind the end of the part is no matter of the copy."""
    source = tmp_path / "a.mcap"
    with RecordingWriter(source) as writer:
        for number in range(6):
            record(writer, message(number), START + 100 * number)
        writer.finish(["s1"])
    copy_part([source], tmp_path / "b.mcap", Part(end_ns=end))
    assert summary(tmp_path / "b.mcap").complete == complete


def test_a_copy_of_a_cut_file_never_claims_to_be_complete(tmp_path: Path) -> None:
    """The damage is told, what is readable is copied."""
    source = write(tmp_path / "a.mcap", enumerate(history(60)))
    data = source.read_bytes()
    source.write_bytes(data[: len(data) // 2])
    report = copy_part([source], tmp_path / "b.mcap")
    assert list(report.damages) == [source]
    assert 0 < report.events < 60
    assert summary(tmp_path / "b.mcap").complete == "tail unknown"


def test_a_copy_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """Neither a file nor half of one; and what exists is not touched."""
    source = tmp_path / "a.mcap"
    write_story(source)
    with pytest.raises(RecordingError, match="exists"):
        copy_part([source], source)

    def stop(done: int) -> None:
        raise KeyboardInterrupt

    big = write(tmp_path / "big.mcap", enumerate(history(1500)))
    with pytest.raises(KeyboardInterrupt):
        copy_part([big], tmp_path / "c.mcap", on_progress=stop)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "big.mcap"]


def test_the_state_at_a_time_is_that_of_folding_everything(tmp_path: Path) -> None:
    """At every event and between them, of one file and of one split into several that begin with keyframes."""
    events = list(enumerate(history(60, seed=9)))
    whole = write(tmp_path / "a.mcap", events)
    parts = []
    for first in range(0, 60, 20):
        states = standing_at([whole], START + 100 * first - 1).frames()
        parts.append(write(tmp_path / f"{first:02}.mcap", events[first : first + 20], states))
    items = everything(whole)
    for time_ns in range(START - 100, START + 6200, 50):
        wanted = fold(item for item in items if item.log_time_ns <= time_ns)
        for paths in ([whole], parts, parts[::-1]):
            assert sorted(standing_at(paths, time_ns).alarms(), key=lambda alarm: alarm.event_id) == wanted


def test_files_before_one_that_begins_anew_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their damage does not matter; but a target that the later file says nothing of makes them needed."""
    events = list(enumerate(history(40, seed=3)))
    one = write(tmp_path / "a.mcap", events[:20])
    frames = standing_at([one], START * 2).frames()
    other = write(tmp_path / "b.mcap", events[20:], frames)
    opened: list[str] = []

    def spy(path: Path, part: Part = EVERYTHING, **more: object) -> RecordingReader:
        opened.append(path.name)
        return read_events(path, part)

    monkeypatch.setattr(series_module, "read_events", spy)
    standing_at([one, other], START * 2)
    assert set(opened) == {"b.mcap"}
    opened.clear()
    write(tmp_path / "c.mcap", [(50, replace(raised(1), target="plc2", session="s2"))], frames)
    standing_at([one, other, tmp_path / "c.mcap"], START * 2)
    assert set(opened) == {"c.mcap"}
    opened.clear()
    write(tmp_path / "d.mcap", [(60, raised(2))], frames)
    standing_at([one, other, tmp_path / "c.mcap", tmp_path / "d.mcap"], START * 2)
    assert set(opened) == {"c.mcap", "d.mcap"}


def test_keyframes_of_a_logger_of_which_nothing_else_was_heard_are_needed(tmp_path: Path) -> None:
    """A later file that begins anew for others does not make its alarms unknown."""
    quiet = replace(STATE, target="plc2", session="s9", alarms=(replace(STATE.alarms[0], target="plc2", session="s9"),))
    with RecordingWriter(tmp_path / "a.mcap", about=ABOUT) as writer:
        writer.add_state(quiet, START)
    with RecordingWriter(tmp_path / "b.mcap", about=ABOUT) as writer:
        record(writer, raised(1), START + 100)
    write(tmp_path / "c.mcap", [(9, raised(5))], [StateFrame(realm="live", target="plc1", session="s1", seq=1)])
    paths = [tmp_path / name for name in ("a.mcap", "b.mcap", "c.mcap")]
    with read_series(paths) as items:
        wanted = fold(items)
    assert {alarm.target for alarm in wanted} == {"plc1", "plc2"}
    assert sorted(standing_at(paths, START * 2).alarms(), key=lambda alarm: alarm.event_id) == wanted


@pytest.mark.parametrize("part", [EVERYTHING, Part(start_ns=START + 900_000)])
def test_a_damage_that_the_summary_does_not_know_of_makes_no_complete_copy(tmp_path: Path, part: Part) -> None:
    """Whether it is met on the way, or stands before the start, where the alarms were to be found."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, compression="none") as writer:
        for number in range(50):
            record(writer, raised(number + 1), START + 20_000 * number)
            writer.flush()
    data = bytearray(path.read_bytes())
    with open(path, "rb") as file:
        place = read_index(file, len(data), lambda channel: True).chunks[25]
    data[place.offset + 120] ^= 1
    path.write_bytes(bytes(data))
    assert summary(path).complete == "yes"  # the doctor would find it
    report = copy_part([path], tmp_path / "b.mcap", part)
    assert list(report.damages) == [path]
    assert summary(tmp_path / "b.mcap").complete == "tail unknown"
    assert summary(copy_part([path], tmp_path / "c.mcap", Part(end_ns=START + 400_000)).path).complete == "yes"


def test_a_moment_between_two_keyframes_at_the_start_of_a_file_needs_the_one_before(tmp_path: Path) -> None:
    """What a later keyframe will say is not known yet."""
    two = replace(raised(2), target="plc2", session="s2")
    write(tmp_path / "a.mcap", [(1, raised(1)), (2, two)])
    frames = standing_at([tmp_path / "a.mcap"], START * 2).frames()
    paths = [tmp_path / "a.mcap", write(tmp_path / "b.mcap", [(9, raised(3))], frames)]
    for step, ids in ((849, [1, 2]), (850, [1, 2]), (851, [1, 2]), (900, [1, 2, 3])):
        assert sorted(alarm.event_id for alarm in standing_at(paths, START + step).alarms()) == ids


def test_what_nobody_misses_is_not_kept_in_memory_while_merging(tmp_path: Path) -> None:
    """Only numbers in gaps are: gaps that overlap, that touch, and one that nothing fills."""
    fills = Fills()
    fills.want([replace(GAP, first_key_seq=first, last_key_seq=last) for first, last in ((3, 9), (8, 12), (13, 13), (40, 41))])
    for number in (50, 1, 12, 3, 4, 10, 13, 20):
        fills.there(GAP.session, GAP.key, number)
    assert sum(map(len, fills._there.values())) == 5
    left = fills.left(replace(GAP, first_key_seq=3, last_key_seq=13, count=11))
    assert [(gap.first_key_seq, gap.last_key_seq) for gap in left] == [(5, 9), (11, 11)]


def test_a_file_that_was_read_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A night of many files needs the memory of one; who stops in between leaves none open."""
    paths = [write(tmp_path / f"{number}.mcap", [(number, message(number))]) for number in range(6)]
    readers: list[weakref.ref[RecordingReader]] = []

    def spy(path: Path, part: Part = EVERYTHING, **more: object) -> RecordingReader:
        reader = read_events(path, part)
        readers.append(weakref.ref(reader))
        return reader

    with read_series(paths) as items:
        monkeypatch.setattr(series_module, "read_events", spy)
        for _ in range(5):
            next(items)
        gc.collect()
        assert sum(reader() is not None for reader in readers) <= 2
    assert all(reader is None or reader.frames._file.closed for reader in (each() for each in readers))
