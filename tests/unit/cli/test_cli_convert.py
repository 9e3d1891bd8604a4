"""`tcbridge convert` as a user runs it."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core import codec
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.class_toml import write_classes
from bridge.core.events import AnyEvent, Severity
from bridge.edges.class_files import carried_catalog
from bridge.edges.recording import Attachment, RecordingWriter, Viewer, carried, summary
from bridge.logger import Book
from bridge.logger.compare import compare, state_of
from bridge.replayer import replay_into
from tests.unit.edges.recording_stories import AXIS, GAP, START, STATE, cleared, message, raised, record

CLASS = EventClass(
    AXIS,
    "Axis",
    "",
    {90: EventEntry(90, "Jam", Severity.ERROR, "Axis jams"), 1: EventEntry(1, "Moved", Severity.INFO, "Axis {0} moved")},
    {"Axis jams": {1031: "Achse klemmt"}, "Axis {0} moved": {1031: "Achse {0} bewegt"}},
)
FILE = Attachment("axis.classes.toml", write_classes([CLASS]), "application/toml")


def write(path: Path, attachments: tuple[Attachment, ...] = (), viewer: Viewer | None = None) -> None:
    """An alarm's life and a message, half of it in msgpack, after a keyframe, with a gap."""
    events: tuple[AnyEvent, ...] = (message(1), raised(90), cleared(90))
    with RecordingWriter(path, attachments=attachments, viewer=viewer) as writer:
        writer.add_state(STATE, START)
        for place, event in enumerate(events):
            record(writer, event, START + 1 + place, (codec.MSGPACK, codec.JSON)[place % 2])
        writer.add_gap(GAP, START + 10)


def lines(path: Path) -> list[str]:
    """What the log channel says of events."""
    with open(path, "rb") as file:
        said = [json.loads(raw.data)["message"] for _, _, raw in make_reader(file).iter_messages(topics=["/log"])]
    return [line.partition(" (")[0] for line in said if "missing" not in line]


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_it_says_what_it_did(capsys: pytest.CaptureFixture[str]) -> None:
    """For people and for programs; a recording with a gap is converted, and stays one with a gap."""
    write(Path("a.mcap"))
    assert run(["convert", "a.mcap", "b.mcap"]) == Exit.OK
    assert capsys.readouterr().out == "converted 3 events into b.mcap, 2 of them from msgpack; complete: no\n"
    assert run(["convert", "b.mcap", "c.mcap", "--json"]) == Exit.OK
    told = json.loads(capsys.readouterr().out)
    assert told == {"converted": "c.mcap", "complete": "no", "events": 3, "from_msgpack": 0, "left_out": []}
    assert Path("b.mcap").read_bytes() == Path("c.mcap").read_bytes()


def test_what_was_converted_replays_into_the_same_state() -> None:
    """Alarms and events of a fresh logger are those of the first file."""
    write(Path("a.mcap"), (FILE,))
    assert run(["convert", "a.mcap", "b.mcap"]) == Exit.OK
    states = []
    for name in ("a.mcap", "b.mcap"):
        with Book(None, f"{name}.db") as book:
            replay_into([Path(name)], book)
            book.flush()
            states.append(state_of(book))
    assert compare(*states).equal
    assert len(states[0].alarms) == 2


def test_texts_come_from_the_file_itself_and_from_the_options() -> None:
    """In the language asked for; a class of an option is attached, so that the new file explains itself."""
    write(Path("a.mcap"), (FILE,))
    assert run(["convert", "a.mcap", "b.mcap"]) == Exit.OK
    assert lines(Path("b.mcap")) == ["Axis 1 moved", "raised: Axis jams", "cleared: Axis jams"]
    write(Path("bare.mcap"))
    Path("axis.toml").write_bytes(FILE.data)
    assert run(["convert", "bare.mcap", "c.mcap", "--lang", "de", "--classes", "axis.toml"]) == Exit.OK
    assert lines(Path("c.mcap")) == ["Achse 1 bewegt", "raised: Achse klemmt", "cleared: Achse klemmt"]
    attached, _ = carried_catalog((each.name, each.data) for each in carried("c.mcap").attachments)
    assert list(attached) == [CLASS]


def test_the_log_that_is_there_is_kept_unless_something_else_is_asked_for() -> None:
    """Without options it stays as it was recorded; --classes alone makes it anew in the language that it had."""
    write(Path("a.mcap"), viewer=Viewer(lambda event: Catalog(), "de"))
    assert run(["convert", "a.mcap", "b.mcap"]) == Exit.OK
    assert lines(Path("b.mcap")) == lines(Path("a.mcap")) == [f"{AXIS}#1", f"raised: {AXIS}#90", f"cleared: {AXIS}#90"]
    assert carried("b.mcap").language == "de-DE"
    Path("axis.toml").write_bytes(FILE.data)
    assert run(["convert", "b.mcap", "c.mcap", "--classes", "axis.toml"]) == Exit.OK
    assert lines(Path("c.mcap"))[0] == "Achse 1 bewegt"
    assert run(["convert", "c.mcap", "d.mcap", "--lang", "en"]) == Exit.OK
    assert lines(Path("d.mcap"))[0] == "Axis 1 moved"


def test_a_damaged_file_ends_with_3(capsys: pytest.CaptureFixture[str]) -> None:
    """What could be read is there, and where reading ended is said."""
    write(Path("a.mcap"))
    data = Path("a.mcap").read_bytes()
    Path("cut.mcap").write_bytes(data[: len(data) - 40])
    assert run(["convert", "cut.mcap", "b.mcap"]) == Exit.LOST
    assert "warning: cut.mcap: damaged at byte" in capsys.readouterr().err
    assert summary("b.mcap").totals.events == 3


def test_wrong_names_and_bad_class_files_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    """A name without .mcap is wrong usage, nothing is overwritten, and a class file in the recording may be bad."""
    write(Path("a.mcap"), (Attachment("bad.tmc", b"<x"),))
    assert run(["convert", "a.mcap", "b.json"]) == Exit.USAGE
    assert run(["convert", "a.mcap", "a.mcap"]) == Exit.NO
    assert run(["convert", "none.mcap", "b.mcap"]) == Exit.NO
    assert not Path("b.mcap").exists()
    assert run(["convert", "a.mcap", "b.mcap"]) == Exit.OK
    assert "warning: attached: bad.tmc" in capsys.readouterr().err
