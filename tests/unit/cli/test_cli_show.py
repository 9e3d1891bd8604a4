"""How events, alarms and tables look without a terminal, with one, and for programs."""

import json
import re

import pytest

from bridge.cli import show
from bridge.core.alarms import AlarmKey, step
from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import AlarmRaised, ConfirmationState, MessageSent, Severity
from bridge.core.sequence import Missing
from bridge.inbox import Dropped
from bridge.listener import Gap, Item, Rejected, SuspectsChanged, TailUnknown, TwoLoggers

GUID = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "695e2e22-3f74-4ec5-a795-e51962a66fcb"
LAG = EventEntry(7, "LagError", Severity.ERROR, "Axis {0} lags")
AXIS = EventClass(GUID, "Axis", "Axis errors", {7: LAG}, {"Axis {0} lags": {1031: "Achse {0} schleppt"}})
VIEW = show.View(Catalog([AXIS]), "en")
NOON_NS = 1_795_348_800_123_456_789
MESSAGE = MessageSent(
    target="plc1",
    event_class=GUID,
    event_id=7,
    severity=Severity.ERROR,
    time_ns=NOON_NS,
    arguments=(Argument.of(3),),
    source_name="Main.Axis3",
)
RAISED = AlarmRaised(
    target="plc1",
    event_class=GUID,
    event_id=7,
    severity=Severity.ERROR,
    time_ns=NOON_NS,
    time_raised_ns=NOON_NS,
    raised=True,
    confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION,
    session="s",
    seq=1,
)


def test_an_event_is_one_readable_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Time, target, severity, what happened, class and id, text, source; no colour when nobody watches."""
    VIEW.print_item(MESSAGE, as_json=False)
    line = capsys.readouterr().out
    assert line == "2026-11-22T12:00:00.123Z  plc1      error     message    Axis errors 7: Axis 3 lags  [Main.Axis3]\n"


def test_the_line_is_in_the_asked_language(capsys: pytest.CaptureFixture[str]) -> None:
    """--lang de shows the German text."""
    show.View(VIEW.catalog, "de").print_item(MESSAGE, as_json=False)
    assert "Achse 3 schleppt" in capsys.readouterr().out


def test_an_event_of_an_unknown_class_is_shown_by_its_guid_once(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is lost, and nothing is said twice."""
    show.View(Catalog(), "en").print_item(MESSAGE, as_json=False)
    assert capsys.readouterr().out.count(GUID) == 1


def test_an_event_for_programs_is_that_of_the_wire_with_its_text(capsys: pytest.CaptureFixture[str]) -> None:
    """Names and values as on the wire, and class_name and text beside them."""
    VIEW.print_item(MESSAGE, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert (found["kind"], found["severity"], found["time_ns"]) == ("message_sent", 3, NOON_NS)
    assert (found["class_name"], found["text"]) == ("Axis errors", "Axis 3 lags")


NOTICES: list[tuple[Item, str, str]] = [
    (Gap(Missing("s1", "k", 3, 5), "nobody has them"), "gap", "gap: 3 events of session s1 on k are lost: nobody has them"),
    (Dropped(4), "dropped", "dropped: 4 events"),
    (Rejected("k", b"x", "no event"), "rejected", "rejected: 1 bytes on k: no event"),
    (TailUnknown("plc1", "s1"), "tail_unknown", "tail unknown: session s1 of plc1"),
    (TwoLoggers("plc1", ("a", "b")), "two_loggers", "two loggers of plc1 answer: a, b"),
    (SuspectsChanged("plc1", "s1", (AlarmKey("plc1", GUID, 1),)), "suspects_changed", "suspect alarms of plc1 now: 1"),
]


@pytest.mark.parametrize(("item", "name", "text"), NOTICES)
def test_what_is_missing_is_said_in_a_line(item: Item, name: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A notice is a line for people and has `notice` instead of `kind` for programs."""
    VIEW.print_item(item, as_json=False)
    assert capsys.readouterr().out.strip().startswith(text)
    VIEW.print_item(item, as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found["notice"] == name
    assert "kind" not in found


def test_what_comes_from_outside_is_not_obeyed(capsys: pytest.CaptureFixture[str]) -> None:
    """Escape sequences, line ends and direction marks of a text, a source or a target are shown as escapes."""
    nasty = "a\x1b[2J\nb\u202ec\ud800"
    event = MessageSent(
        target=nasty, event_class=OTHER, event_id=1, severity=Severity.INFO, source_name=nasty, arguments=(Argument.of(nasty),)
    )
    VIEW.print_item(event, as_json=False)
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e]", out)
    assert out.count("a\\x1b[2J\\nb\\u202ec?") == 3


def test_a_table_is_aligned_and_whole_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Columns start at one place, nothing is cut, no line ends with blanks."""
    long = "x" * 300
    show.print_table(("Name", "Value"), [["a", long], ["bb", ("1", "red")]], title="numbers")
    assert capsys.readouterr().out.splitlines() == ["numbers", "Name  Value", f"a     {long}", "bb    1"]


def test_alarms_are_a_table_with_their_state(capsys: pytest.CaptureFixture[str]) -> None:
    """Severity, state, confirmation, class, text and the three times."""
    alarm = step(None, RAISED)
    assert alarm is not None
    VIEW.print_alarms([alarm])
    header, row = capsys.readouterr().out.splitlines()
    assert re.split(r" {2,}", header)[:4] == ["Severity", "State", "Confirmation", "Class"]
    assert re.split(r" {2,}", row)[:5] == ["error", "raised", "waiting", "Axis errors", "7"]
    assert "2026-11-22T12:00:00.123Z" in row


def test_an_alarm_for_programs_always_has_its_state() -> None:
    """raised, confirmation_state and active are there even when they are defaults."""
    alarm = step(None, RAISED)
    assert alarm is not None
    found = VIEW.alarm_record(alarm)
    assert (found["raised"], found["confirmation_state"], found["active"]) == (True, 2, True)


def test_a_terminal_gets_colours_and_short_times(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal the severity is coloured, and a table drops the date that all rows share and says it once."""
    from rich.console import Console

    console = Console(force_terminal=True, width=200, color_system="standard", highlight=False)
    monkeypatch.setattr(show, "on_terminal", lambda: True)
    monkeypatch.setattr(show, "console", lambda: console)
    VIEW.print_item(MESSAGE, as_json=False)
    assert "\x1b[31merror" in capsys.readouterr().out
    alarm = step(None, RAISED)
    assert alarm is not None
    VIEW.print_alarms([alarm])
    out = capsys.readouterr().out
    assert "12:00:00.123" in out
    assert out.count("2026-11-22") == 1
    assert "times in UTC on 2026-11-22" in out


def test_brackets_in_a_text_are_no_markup(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A text like "[red]" is printed as it is."""
    from rich.console import Console

    console = Console(force_terminal=True, width=200, markup=False, highlight=False, emoji=False)
    monkeypatch.setattr(show, "on_terminal", lambda: True)
    monkeypatch.setattr(show, "console", lambda: console)
    show.print_spans([("[red]x[/red] :smile:", "")])
    show.print_table(("A",), [["[red]y"]])
    out = capsys.readouterr().out
    assert "[red]x[/red] :smile:" in out
    assert "[red]y" in out


@pytest.mark.parametrize(("number", "text"), [(0, "0 events"), (1, "1 event"), (2000, "2,000 events")])
def test_one_is_not_many(number: int, text: str) -> None:
    """A count and its noun agree."""
    assert show.counted(number, "event") == text


def test_a_narrow_terminal_leaves_out_columns_without_values(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In 80 columns the table of alarms has no empty column of times or sources, so texts and headers stay in one line."""
    from rich.console import Console

    console = Console(force_terminal=True, width=80, color_system=None, highlight=False)
    monkeypatch.setattr(show, "on_terminal", lambda: True)
    monkeypatch.setattr(show, "console", lambda: console)
    monkeypatch.setenv("COLUMNS", "80")
    alarm = step(None, RAISED)
    assert alarm is not None
    VIEW.print_alarms([alarm])
    header, row, *_ = capsys.readouterr().out.splitlines()
    assert header.split() == ["Severity", "State", "Confirmation", "Class", "Id", "Text", "Raised"]
    assert "Axis {0} lags" in row
    assert "12:00:00.123" in row
    monkeypatch.setenv("COLUMNS", "200")
    VIEW.print_alarms([alarm])
    assert "Source" in capsys.readouterr().out
