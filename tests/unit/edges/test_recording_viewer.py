"""What viewers are given beside the events: a line of text for each, and a span for each finished alarm."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader

from bridge.core import codec, tmc
from bridge.core.alarms import Alarm
from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry, LanguageError
from bridge.core.events import (
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmRaised,
    AnyEvent,
    ConfirmationState,
    MessageSent,
    Severity,
)
from bridge.edges.recording import RecordingWriter, Viewer, read_events, scan, summary
from bridge.edges.recording.frames import Frames
from bridge.edges.recording.layout import RejectedPayload, event_schema, gap_schema, state_schema
from bridge.edges.recording.viewer import log_schema, span_schema
from tests.unit.edges.recording_stories import ABOUT, AXIS, GAP, PUMP, START, events_of, everything, kinds, message, record

WAIT, CONFIRMED = ConfirmationState.WAIT_FOR_CONFIRMATION, ConfirmationState.CONFIRMED
S = 1_000_000_000
AXES = EventClass(
    AXIS,
    "Axis",
    "Axes of the line",
    {7: EventEntry(7, "Jam", Severity.ERROR, "Axis {0} jams at {1} mm"), 8: EventEntry(8, "Moved", Severity.INFO, "Moved {0}")},
    {"Axis {0} jams at {1} mm": {1031: "Achse {0} klemmt bei {1} mm"}, "Axes of the line": {1031: "Achsen"}},
)
CATALOG = Catalog([AXES])


def viewer(language: str = "en") -> Viewer:
    """A viewer's texts of one class."""
    return Viewer(lambda event: CATALOG, language)


def line(event: AnyEvent, language: str = "en") -> dict[str, Any]:
    """The log line of one event."""
    first, *_ = viewer(language).event(event, START)
    found: dict[str, Any] = json.loads(first.data)
    assert first.topic == "/log"
    return found


def spans(events: Iterable[AnyEvent], state: Iterable[Alarm] = ()) -> list[dict[str, Any]]:
    """The spans that a history makes, with their metadata as a table."""
    eyes = viewer()
    eyes.state(state)
    found = [json.loads(said.data) for event in events for said in eyes.event(event, START) if said.topic == "/alarms"]
    return [span | {"metadata": {pair["key"]: pair["value"] for pair in span["metadata"]}} for span in found]


def lasted(found: Iterable[dict[str, Any]]) -> list[tuple[int, int]]:
    """From when to when, in seconds after START."""
    return [(span["start_time"]["sec"] - START // S, span["end_time"]["sec"] - START // S) for span in found]


def jam(
    kind: type[AlarmRaised] | type[AlarmCleared] | type[AlarmConfirmed] | type[AlarmDisposed],
    second: int,
    confirmation: ConfirmationState = ConfirmationState.NOT_SUPPORTED,
    *,
    raised: int = 0,
    cleared: int | None = None,
    confirmed: int | None = None,
    operator: str = "",
    comment: str = "",
) -> AnyEvent:
    """A transition of one alarm; seconds after START."""
    return kind(
        target="plc1",
        event_class=AXIS,
        event_id=7,
        severity=Severity.ERROR,
        time_ns=START + second * S,
        source_name="Line1.X",
        arguments=(Argument.of("X1"), Argument.of(12.5)),
        raised=kind is AlarmRaised or (cleared is None and kind is not AlarmCleared),
        confirmation_state=confirmation,
        time_raised_ns=START + raised * S,
        time_cleared_ns=0 if cleared is None else START + cleared * S,
        time_confirmed_ns=0 if confirmed is None else START + confirmed * S,
        operator=operator,
        comment=comment,
    )


def test_a_line_is_the_text_with_time_level_and_place() -> None:
    """The event's own time in exact halves, the source, and class and id where a log panel shows file and line."""
    assert line(jam(AlarmRaised, 3)) == {
        "timestamp": {"sec": START // S + 3, "nsec": 0},
        "level": 4,
        "message": "raised: Axis X1 jams at 12.5 mm",
        "name": "Line1.X",
        "file": "Axes of the line",
        "line": 7,
    }


def test_a_line_is_in_the_language_asked_for() -> None:
    """Text and class name are translated; who did it and why follow in any language."""
    found = line(jam(AlarmConfirmed, 3, CONFIRMED, confirmed=3, operator="kim", comment="seen"), "de")
    assert found["message"] == "confirmed by kim: Achse X1 klemmt bei 12.5 mm (seen)"
    assert found["file"] == "Achsen"
    with pytest.raises(LanguageError):
        viewer("klingon")


@pytest.mark.parametrize("severity", Severity)
def test_severities_are_the_levels_one_to_five(severity: Severity) -> None:
    """Verbose is DEBUG, critical is FATAL, as foxglove.LogLevel counts them."""
    event = MessageSent(target="plc1", event_class=AXIS, event_id=8, severity=severity, time_ns=START)
    assert line(event)["level"] == {"VERBOSE": 1, "INFO": 2, "WARNING": 3, "ERROR": 4, "CRITICAL": 5}[severity.name]


def test_what_is_unknown_is_still_readable() -> None:
    """No class, no source, no time: the GUID with the arguments, the target, the time it came."""
    guid = "0a0b0c0d-0000-4000-8000-000000000001"
    event = MessageSent(
        target="plc1", event_class=guid, event_id=5, severity=Severity.INFO, arguments=(Argument.of("a"), Argument.of(2))
    )
    found = line(event)
    assert (found["message"], found["name"], found["file"]) == (f"{guid}#5 (a, 2)", "plc1", guid)
    assert found["timestamp"] == {"sec": START // S, "nsec": 0}
    assert line(msgspec.structs.replace(event, source_id=0x1010010))["name"] == "plc1 0x01010010"


def test_an_alarm_without_confirmation_is_over_when_it_is_cleared() -> None:
    """From raised to cleared, with what it was; letting go of it later tells nothing twice."""
    history = [jam(AlarmRaised, 0), jam(AlarmCleared, 4, cleared=4), jam(AlarmDisposed, 9, cleared=4)]
    (span,) = spans(history)
    assert lasted([span]) == [(0, 4)]
    assert span["metadata"] == {
        "alarm": "Axis X1 jams at 12.5 mm",
        "severity": "error",
        "target": "plc1",
        "source": "Line1.X",
        "event_class": "Axes of the line",
        "event_id": "7",
        "duration": "4.000 s",
    }


def test_an_alarm_with_confirmation_is_over_when_both_are_done() -> None:
    """In either order; the span ends where the alarm was cleared, and says when it was confirmed."""
    late = [jam(AlarmRaised, 0, WAIT), jam(AlarmCleared, 4, WAIT, cleared=4)]
    assert spans(late) == []
    late.append(jam(AlarmConfirmed, 6, CONFIRMED, cleared=4, confirmed=6))
    early = [jam(AlarmRaised, 0, WAIT), jam(AlarmConfirmed, 2, CONFIRMED, confirmed=2)]
    early.append(jam(AlarmCleared, 4, CONFIRMED, cleared=4, confirmed=2))
    assert lasted(spans(late)) == lasted(spans(early)) == [(0, 4)]
    assert spans(late)[0]["metadata"]["confirmed"].endswith(":06.000Z")


def test_each_raise_begins_a_life() -> None:
    """Raised again before it was confirmed: the first life is over with it, from its raise to its clear."""
    history = [jam(AlarmRaised, 0, WAIT), jam(AlarmCleared, 4, WAIT, cleared=4), jam(AlarmRaised, 10, WAIT, raised=10)]
    assert lasted(spans(history)) == [(0, 4)]
    history.append(jam(AlarmDisposed, 15, ConfirmationState.NOT_REQUIRED, raised=10, cleared=15))
    assert lasted(spans(history)) == [(0, 4), (10, 15)]


def test_lives_of_one_cycle_are_told_apart() -> None:
    """A PLC raises, clears and raises again at one and the same time: two lives."""
    one = [jam(AlarmRaised, 3, raised=3), jam(AlarmCleared, 3, raised=3, cleared=3)]
    assert lasted(spans([*one, *one])) == [(3, 3), (3, 3)]


def test_a_raise_that_was_lost_hides_no_life() -> None:
    """The clear says when it was raised."""
    history = [jam(AlarmRaised, 0), jam(AlarmCleared, 4, cleared=4), jam(AlarmCleared, 9, raised=7, cleared=9)]
    assert lasted(spans(history)) == [(0, 4), (7, 9)]


def test_what_a_keyframe_has_is_not_taken_twice() -> None:
    """A transition that was folded into the keyframe and comes after it."""
    known = Alarm(
        target="plc1", event_class=AXIS, event_id=7, severity=Severity.ERROR, source_name="Line1.X", raised=True,
        time_raised_ns=START + 5 * S, session="s1", seq=9,
    )  # fmt: skip
    late = msgspec.structs.replace(jam(AlarmCleared, 4, cleared=4), session="s1", seq=8)
    assert spans([late], [known]) == []


def test_lives_that_began_before_the_recording_come_from_the_keyframe() -> None:
    """An alarm of the keyframe that is active is told when it ends; one that had ended is not told again."""
    active = Alarm(
        target="plc1", event_class=AXIS, event_id=7, severity=Severity.ERROR, source_name="Line1.X", raised=True,
        time_raised_ns=START,
    )  # fmt: skip
    over = msgspec.structs.replace(active, raised=False, time_cleared_ns=START + 4 * S)
    assert lasted(spans([jam(AlarmCleared, 5, cleared=5)], [active])) == [(0, 5)]
    assert spans([jam(AlarmDisposed, 9, cleared=4)], [over]) == []
    waiting = msgspec.structs.replace(over, confirmation_state=WAIT)
    assert lasted(spans([jam(AlarmRaised, 10, WAIT, raised=10)], [waiting])) == [(0, 4)]


def test_a_file_begins_with_its_keyframe(tmp_path: Path) -> None:
    """What happened between two files of a capture is not made up: what was open in one is forgotten in the next."""
    eyes = viewer()
    with RecordingWriter(tmp_path / "a.mcap", viewer=eyes) as writer:
        record(writer, jam(AlarmRaised, 0), START)
    with RecordingWriter(tmp_path / "b.mcap", viewer=eyes) as writer:
        record(writer, jam(AlarmRaised, 90, raised=90), START)
        record(writer, jam(AlarmCleared, 95, raised=90, cleared=95), START)
    with open(tmp_path / "b.mcap", "rb") as file:
        (span,) = [json.loads(raw.data) for _, _, raw in make_reader(file).iter_messages(topics=["/alarms"])]
    assert lasted([span]) == [(90, 95)]


def test_a_loss_is_told_to_viewers_too() -> None:
    """A log without it would look complete: gaps and rejected payloads are warnings of the target."""
    gap = json.loads(viewer().gap(GAP, START).data)
    assert (gap["level"], gap["name"], gap["message"]) == (3, "plc1", "7 events are missing here: lost")
    body = RejectedPayload(key="no key", encoding="", payload=b"{", size=1, reason="no JSON")
    rejected = json.loads(viewer().rejected(body, START).data)
    assert (rejected["level"], rejected["name"], rejected["message"]) == (3, "no key", "1 bytes are no events: no JSON")


def for_viewers(path: Path, events: int = 6) -> None:
    """A recording with messages for viewers beside a few events, one finished alarm and a gap."""
    history = [*(message(number) for number in range(events)), jam(AlarmRaised, 1), jam(AlarmCleared, 2, cleared=2)]
    with RecordingWriter(path, about=ABOUT, viewer=viewer("de")) as writer:
        for place, event in enumerate(history):
            record(writer, event, START + place // 3)
        writer.add_gap(GAP, START)


def test_readers_of_ours_pass_over_what_is_for_viewers(tmp_path: Path) -> None:
    """Events, counts and times are those without it, from the summary and from a scan."""
    for_viewers(tmp_path / "a.mcap")
    items = everything(tmp_path / "a.mcap")
    assert kinds(items) == ["e"] * 8 + ["g"]
    assert len({item.log_time_ns for item in items}) == 9
    with read_events(tmp_path / "a.mcap") as reader:
        assert len(events_of(list(reader))) == 8
        assert not reader.truncated
    fast, slow = summary(tmp_path / "a.mcap"), scan(tmp_path / "a.mcap")
    assert fast.from_summary
    assert fast.totals == slow.totals
    assert fast.totals.events == 8


def test_others_find_each_message_beside_its_event(tmp_path: Path) -> None:
    """MCAP's own reader gives the line at the event's log time, under Foxglove's schema names, and the language."""
    for_viewers(tmp_path / "a.mcap")
    languages = set()
    times: dict[str, list[int]] = {}
    with open(tmp_path / "a.mcap", "rb") as file:
        for schema, channel, raw in make_reader(file, validate_crcs=True).iter_messages():
            times.setdefault(schema.name if schema is not None else "", []).append(raw.log_time)
            languages.add((channel.topic, channel.metadata.get("language")))
    assert {("/log", "de-DE"), ("/alarms", "de-DE"), ("/gaps", None)} < languages
    assert times["foxglove.Log"] == sorted(times["tcbridge.Event"] + times["tcbridge.Gap"])
    assert times["foxglove.Event"] == [times["tcbridge.Event"][-1]]


def attached(path: Path) -> list[str]:
    """The attachments that define classes."""
    return [name for name in summary(path).attachments if name.endswith(".tmc")]


def test_a_class_that_nobody_else_has_is_attached_once_it_is_known(tmp_path: Path) -> None:
    """With the next flush: a recorder that is killed later has it. What is the program's own is not attached."""
    known = Catalog()
    eyes = Viewer(lambda event: known)
    with RecordingWriter(tmp_path / "a.mcap", viewer=eyes) as writer:
        record(writer, message(1), START)
        writer.flush()
        assert [place for place in scan(writer.active_path).attachments if place.endswith(".tmc")] == []
        known = CATALOG
        record(writer, message(2), START)
        record(writer, message(3), START, codec.MSGPACK)
        writer.flush()
        (definition,) = [place for place in scan(writer.active_path).attachments if place.endswith(".tmc")]
    assert attached(tmp_path / "a.mcap") == [definition] == ["Axis-54cc5482.tmc"]
    with read_events(tmp_path / "a.mcap") as reader:
        assert len(list(reader)) == 3
        place = next(place for place in reader.frames.attachments if place.name == definition)
    with Frames(tmp_path / "a.mcap") as frames:
        assert tmc.read_classes(frames.attachment(place).data).classes == (AXES,)
    with RecordingWriter(tmp_path / "b.mcap", viewer=Viewer(lambda event: CATALOG, own=CATALOG)) as writer:
        record(writer, message(1), START)
    assert attached(tmp_path / "b.mcap") == []


def test_a_class_that_is_known_at_the_end_is_attached_at_the_end(tmp_path: Path) -> None:
    """Its answer came after its last event; and a class without events, which cannot be written, harms nothing."""
    known = Catalog()
    with RecordingWriter(tmp_path / "a.mcap", viewer=Viewer(lambda event: known)) as writer:
        record(writer, message(1), START)
        record(writer, message(1, PUMP), START)
        known = Catalog([AXES, EventClass(PUMP, "Pump")])
    assert attached(tmp_path / "a.mcap") == ["Axis-54cc5482.tmc"]


def faults(schema: object, path: str = "") -> list[str]:
    """Where a JSON Schema breaks the rules of docs/recordings.md, so that viewers refuse the channel."""
    if not isinstance(schema, dict):
        return [f"{path}: no schema"]
    found = [f"{path}: {word}" for word in ("$ref", "$defs", "anyOf", "allOf", "not", "contentEncoding") if word in schema]
    if "oneOf" in schema:
        numbers = [isinstance(each.get("const"), int) and isinstance(each.get("title"), str) for each in schema["oneOf"]]
        found += [] if all(numbers) else [f"{path}: oneOf is no list of titled numbers"]
    match schema.get("type"):
        case "object":
            if not isinstance(schema.get("properties"), dict):
                found.append(f"{path}: object without properties")
            for name, part in schema.get("properties", {}).items():
                found += faults(part, f"{path}/{name}")
        case "array":
            found += faults(schema.get("items"), f"{path}[]")
            if schema.get("items", {}).get("type") == "array":
                found.append(f"{path}: array of arrays")
        case "string" | "number" | "integer" | "boolean":
            pass
        case other:
            found.append(f"{path}: type {other!r}")
    return found


@pytest.mark.parametrize("schema", [event_schema, gap_schema, state_schema, log_schema, span_schema])
def test_every_schema_keeps_the_rules_of_viewers(schema: Callable[[], bytes]) -> None:
    """The root is an object, everything is inlined, and every property has one plain type."""
    found = json.loads(schema())
    assert found["type"] == "object"
    assert faults(found) == []


def test_a_schema_that_viewers_refuse_is_found_out() -> None:
    """What msgspec writes for a struct by itself breaks several of the rules."""
    found = faults(msgspec.json.schema(MessageSent))
    assert any("$ref" in fault for fault in found)
    broken = {"type": "object", "properties": {"a": {"anyOf": []}, "b": {"type": "array"}, "c": {"type": "object"}}}
    assert len(faults(broken)) == 4
