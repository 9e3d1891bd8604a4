"""Alarms against the manual, row by row; then what a table of alarms makes of events that come twice, late or from before.

ROWS is written from the manual, not from the code. A row names the section that demands it and RULES holds that section's
words, which are looked up in the manual itself; rows that the manual leaves open name their question in decision 0006.
"""

import os
import re
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import pytest

from bridge.core import alarms
from bridge.core.alarms import (
    NEXT,
    Alarm,
    AlarmCommand,
    AlarmKey,
    AlarmTable,
    Clear,
    Confirm,
    Create,
    Dispose,
    Phase,
    Raise,
    alarm_key,
    created,
    decide,
    fold,
    phase,
    row,
    step,
)
from bridge.core.arguments import Argument
from bridge.core.events import AlarmEvent, AlarmRaised, ConfirmationState, Severity, Source
from bridge.core.hresult import AdsError
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    TIME_NS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

P, C = Phase, ConfirmationState
ROOT = Path(__file__).parents[3]
SHARED = Path(os.environ.get("TCBRIDGE_SHARED", ROOT.parent / "shared"))
DECISION = (ROOT / "docs" / "decisions" / "0006-what-the-manual-leaves-open-about-alarms.md").read_text(encoding="utf-8")

KEY = AlarmKey("plc1", EVENT_CLASS, 7, 0x08502000, "MAIN.fbAxis")
OK, ALREADY_EXISTS, INVALIDSTATE, NOTFOUND = 0x0, 0xB7, 0x98110712, 0x9811070C

RULES: Final = {
    "5": (
        "wird für alle Alarime im Zustand Raised intern ein Dispose ausgeführt, das einen Clear-Zeitstempel setzt. "
        "Eine Bestätigung für diese Alarime entfällt."
    ),
    "6.1.4.4": "wenn eine Alarminstanz wieder frei gegeben wurde",
    "6.1.5.1": "Liefert ADS_E_INVALIDSTATE, wenn der Alarm nicht im Zustand Raised war.",
    "6.1.5.1 reset": (
        "Wenn TRUE und der Bestätigungszustand WaitForConfirmation ist, wird der Bestätigungszustand auf Reset gesetzt. "
        "Ansonsten wird der Bestätigungszustand nicht verändert."
    ),
    "6.1.5.2": "Liefert ADS_E_INVALIDSTATE, wenn der Bestätigungszustand nicht WaitForConfirmation war.",
    "6.1.5.3": "Liefert S_OK, wenn ein neuer Alarm erfolgreich erstellt werden konnte. "
    "Liefert ERROR_ALREADY_EXISTS, wenn der Alarm bereits existiert hat.",
    "6.1.5.5": "Liefert ADS_E_INVALIDSTATE, wenn der Alarm bereits im Zustand Raised war.",
    "6.1.5.5 wait": (
        "Wenn der Alarm bestätigungspflichtig ist, wird zusätzlich der Bestätigungszustand auf WaitForConfirmation gesetzt."
    ),
    "6.1.9.7": "Liefert ADS_E_NOTFOUND, wenn keine Instanz gefunden wurde.",
    "6.3.3": "Bestätigung im aktuellen Zustand nicht nötig. (Alarm aktuell nicht im Zustand Raised.)",
    "7.1.3.4": (
        "Wenn der Alarm bestätigungspflichtig ist, wird zusätzlich der Bestätigungszustand auf WaitForConfirmation gesetzt."
    ),
    "7.1.3.5": "Ansonsten wird der Bestätigungszustand nicht verändert.",
    "7.1.3.7": "von WaitForConfirmation auf Confirmed.",
    "7.1.4.2": "Liefert ERROR_ALREADY_EXISTS, wenn der Alarm bereits existiert.",
    "8.2.1.1": 'TRUE = Der Alarm ist im Zustand „Not-Raised" und ist nicht im Zustand „Wait for Confirmation".',
    "8.2.1.2": "TRUE, wenn der Alarm nicht im Zustand „Raised“ ist. FALSE, wenn der Alarm im Zustand „Raised“ ist.",
    "8.2.2.1": "Diese Methode bestätigt den Alarm.",
}
"""What the manual says, in its words (its misprints too), by section."""


class Expected(NamedTuple):
    """What the manual demands of one call in one phase.

    raised, confirmation and the three times are those afterwards, as the event carries them: "kept", "now", "none" or a value;
    "waits if asked" is WAIT_FOR_CONFIRMATION for an alarm that was created with confirmation.
    """

    phase: Phase
    call: str
    sources: str
    hresult: int
    event: str = ""
    raised: bool = False
    confirmation: ConfirmationState | str = "kept"
    time_raised: str = "kept"
    time_cleared: str = "kept"
    time_confirmed: str = "kept"


ROWS: Final = (
    # An alarm that was never created or is disposed of: there is only Create.
    Expected(P.ABSENT, "create", "6.1.5.3", OK),
    Expected(P.ABSENT, "raise", "6.1.9.7, raise, clear, confirm, dispose of an unknown alarm", NOTFOUND),
    Expected(P.ABSENT, "clear", "6.1.9.7, raise, clear, confirm, dispose of an unknown alarm", NOTFOUND),
    Expected(P.ABSENT, "clear_reset", "6.1.9.7, raise, clear, confirm, dispose of an unknown alarm", NOTFOUND),
    Expected(P.ABSENT, "confirm", "6.1.9.7, raise, clear, confirm, dispose of an unknown alarm", NOTFOUND),
    Expected(P.ABSENT, "dispose", "6.1.9.7, raise, clear, confirm, dispose of an unknown alarm", NOTFOUND),
    # Not raised, nothing to confirm: just created, or an occurrence is over.
    Expected(P.IDLE, "create", "6.1.5.3, 7.1.4.2, create of an existing alarm", ALREADY_EXISTS),
    Expected(
        P.IDLE,
        "raise",
        "6.1.5.5 wait, 7.1.3.4, raised again",
        OK,
        "alarm_raised",
        True,
        "waits if asked",
        "now",
        "none",
        "none",
    ),
    Expected(P.IDLE, "clear", "6.1.5.1", INVALIDSTATE),
    Expected(P.IDLE, "clear_reset", "6.1.5.1", INVALIDSTATE),
    Expected(P.IDLE, "confirm", "6.1.5.2", INVALIDSTATE),
    Expected(P.IDLE, "dispose", "6.1.4.4, dispose while neither raised nor waiting", OK, "alarm_disposed"),
    # Raised, nothing to confirm: without confirmation, or confirmed already.
    Expected(P.RAISED, "create", "6.1.5.3, 7.1.4.2, create of an existing alarm", ALREADY_EXISTS),
    Expected(P.RAISED, "raise", "6.1.5.5", INVALIDSTATE),
    Expected(P.RAISED, "clear", "6.1.5.1, 7.1.3.5", OK, "alarm_cleared", False, "kept", "kept", "now", "kept"),
    Expected(
        P.RAISED,
        "clear_reset",
        "6.1.5.1 reset, 7.1.3.5, clear with reset",
        OK,
        "alarm_cleared",
        False,
        "kept",
        "kept",
        "now",
        "kept",
    ),
    Expected(P.RAISED, "confirm", "6.1.5.2, confirming while raised", INVALIDSTATE),
    Expected(P.RAISED, "dispose", "5, dispose while raised", OK, "alarm_disposed", False, "kept", "kept", "now", "kept"),
    # Raised, waiting for confirmation.
    Expected(P.RAISED_WAITING, "create", "6.1.5.3, 7.1.4.2, create of an existing alarm", ALREADY_EXISTS),
    Expected(P.RAISED_WAITING, "raise", "6.1.5.5", INVALIDSTATE),
    Expected(P.RAISED_WAITING, "clear", "6.1.5.1 reset, 8.2.1.1", OK, "alarm_cleared", False, "kept", "kept", "now", "kept"),
    Expected(
        P.RAISED_WAITING,
        "clear_reset",
        "6.1.5.1 reset, clear with reset",
        OK,
        "alarm_cleared",
        False,
        C.RESET,
        "kept",
        "now",
        "kept",
    ),
    Expected(
        P.RAISED_WAITING,
        "confirm",
        "6.1.5.2, 7.1.3.7, 8.2.1.2, confirming while raised",
        OK,
        "alarm_confirmed",
        True,
        C.CONFIRMED,
        "kept",
        "kept",
        "now",
    ),
    Expected(
        P.RAISED_WAITING,
        "dispose",
        "5, dispose while raised",
        OK,
        "alarm_disposed",
        False,
        C.NOT_REQUIRED,
        "kept",
        "now",
        "kept",
    ),
    # Cleared, still waiting for confirmation.
    Expected(P.CLEARED_WAITING, "create", "6.1.5.3, 7.1.4.2, create of an existing alarm", ALREADY_EXISTS),
    Expected(
        P.CLEARED_WAITING,
        "raise",
        "6.1.5.5 wait, raised again",
        OK,
        "alarm_raised",
        True,
        C.WAIT_FOR_CONFIRMATION,
        "now",
        "none",
        "none",
    ),
    Expected(P.CLEARED_WAITING, "clear", "6.1.5.1", INVALIDSTATE),
    Expected(P.CLEARED_WAITING, "clear_reset", "6.1.5.1", INVALIDSTATE),
    Expected(
        P.CLEARED_WAITING,
        "confirm",
        "6.1.5.2, 7.1.3.7, 8.2.1.2, 8.2.2.1",
        OK,
        "alarm_confirmed",
        False,
        C.CONFIRMED,
        "kept",
        "kept",
        "now",
    ),
    Expected(
        P.CLEARED_WAITING,
        "dispose",
        "6.1.4.4, dispose while cleared and waiting",
        OK,
        "alarm_disposed",
        False,
        C.NOT_REQUIRED,
        "kept",
        "kept",
        "kept",
    ),
)


def alarm(state: ConfirmationState, *, raised: bool, times: tuple[int, int, int]) -> Alarm:
    """An alarm of KEY in a state, with its three times."""
    time_raised, time_cleared, time_confirmed = times
    return Alarm(
        target=KEY.target,
        event_class=KEY.event_class,
        event_id=KEY.event_id,
        severity=Severity.ERROR,
        source_id=KEY.source_id,
        source_name=KEY.source_name,
        raised=raised,
        confirmation_state=state,
        time_raised_ns=time_raised,
        time_cleared_ns=time_cleared,
        time_confirmed_ns=time_confirmed,
        session="s1" if time_raised else "",
        seq=5 if time_raised else 0,
    )


STATES: Final[dict[str, tuple[Phase, Alarm | None]]] = {
    "unknown": (P.ABSENT, None),
    "created": (P.IDLE, alarm(C.NOT_SUPPORTED, raised=False, times=(0, 0, 0))),
    "created with confirmation": (P.IDLE, alarm(C.NOT_REQUIRED, raised=False, times=(0, 0, 0))),
    "cleared": (P.IDLE, alarm(C.NOT_SUPPORTED, raised=False, times=(10, 20, 0))),
    "cleared and confirmed": (P.IDLE, alarm(C.CONFIRMED, raised=False, times=(10, 20, 30))),
    "cleared with reset": (P.IDLE, alarm(C.RESET, raised=False, times=(10, 20, 0))),
    "raised": (P.RAISED, alarm(C.NOT_SUPPORTED, raised=True, times=(10, 0, 0))),
    "raised and confirmed": (P.RAISED, alarm(C.CONFIRMED, raised=True, times=(10, 0, 15))),
    "raised, waiting": (P.RAISED_WAITING, alarm(C.WAIT_FOR_CONFIRMATION, raised=True, times=(10, 0, 0))),
    "cleared, waiting": (P.CLEARED_WAITING, alarm(C.WAIT_FOR_CONFIRMATION, raised=False, times=(10, 20, 0))),
}
"""Every way to be in a phase."""
NOW: Final = 100


def command(call: str) -> AlarmCommand:
    """The call at NOW."""
    match call:
        case "create":
            return Create(key=KEY, time_ns=NOW, severity=Severity.ERROR)
        case "raise":
            return Raise(key=KEY, time_ns=NOW)
        case "clear" | "clear_reset":
            return Clear(key=KEY, time_ns=NOW, reset_confirmation=call == "clear_reset")
        case "confirm":
            return Confirm(key=KEY, time_ns=NOW)
        case "dispose":
            return Dispose(key=KEY, time_ns=NOW)
    raise AssertionError(call)


def answer(before: Alarm | None, called: AlarmCommand) -> tuple[int, tuple[AlarmEvent, ...]]:
    """The HRESULT of a call and the events it causes."""
    try:
        return row(before, called).result, decide(before, called)
    except AdsError as error:
        return error.code, ()


CASES = [
    pytest.param(expected, name, id=f"{expected.call} when {name}")
    for expected in ROWS
    for name, (in_phase, _) in STATES.items()
    if in_phase is expected.phase
]


@pytest.mark.parametrize(("expected", "state"), CASES)
def test_a_call_does_what_the_manual_says(expected: Expected, state: str) -> None:
    """HRESULT, event, raised flag, confirmation and the three times, for each call in each state an alarm can be in."""
    before = STATES[state][1]
    assert phase(before) is expected.phase
    hresult, events = answer(before, command(expected.call))
    assert hresult == expected.hresult
    assert [event.kind for event in events] == ([expected.event] if expected.event else [])
    if not events or before is None:
        return
    (event,) = events
    confirmation = {
        "kept": before.confirmation_state,
        "waits if asked": C.WAIT_FOR_CONFIRMATION if before.with_confirmation else C.NOT_SUPPORTED,
    }.get(str(expected.confirmation), expected.confirmation)
    assert event.raised is expected.raised
    assert event.confirmation_state is confirmation

    def time(word: str, kept: int) -> int:
        return {"kept": kept, "now": NOW, "none": 0}[word]

    assert event.time_ns == NOW
    assert event.time_raised_ns == time(expected.time_raised, before.time_raised_ns)
    assert event.time_cleared_ns == time(expected.time_cleared, before.time_cleared_ns)
    assert event.time_confirmed_ns == time(expected.time_confirmed, before.time_confirmed_ns)
    after = step(before, event)
    if expected.event == "alarm_disposed":
        assert after is None
    else:
        assert after is not None
        assert (after.raised, after.confirmation_state, after.severity) == (event.raised, confirmation, before.severity)
        assert (after.time_ns, after.time_raised_ns) == (NOW, event.time_raised_ns)
        assert (after.time_cleared_ns, after.time_confirmed_ns) == (event.time_cleared_ns, event.time_confirmed_ns)


def test_the_table_has_these_rows_and_no_others() -> None:
    """Every pair of phase and call stands here exactly once, and NEXT knows no pair that is not here."""
    pairs = [(expected.phase, expected.call) for expected in ROWS]
    assert len(set(pairs)) == len(pairs) == len(Phase) * 6
    assert set(pairs) == set(NEXT)
    assert {name: phase(state) for name, (_, state) in STATES.items()} == {name: p for name, (p, _) in STATES.items()}
    assert {p for p, _ in STATES.values()} == set(Phase)


def sources(expected: Expected) -> list[str]:
    """What a row rests on: sections of the manual, questions of the decision."""
    manual, question = [], expected.sources
    while match := re.match(r"(\d[\d.]*(?: reset| wait)?)(?:, |$)", question):
        manual.append(match[1])
        question = question[match.end() :]
    return [*manual, *([question] if question else [])]


def test_every_row_has_its_source() -> None:
    """Each row names a rule of the manual, and each rule bears a row (6.3.3 tells of the state after Create)."""
    named = {source for expected in ROWS for source in sources(expected)}
    assert all(any(source in RULES for source in sources(expected)) for expected in ROWS)
    assert set(RULES) - named == {"6.3.3"}


def test_what_the_manual_leaves_open_is_in_the_decision() -> None:
    """The rows' questions are those of decision 0006, but for three about no call: the new alarm, the clean stop, the kill."""
    table = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", DECISION, re.MULTILINE)
    questions = set(table) - {"question", "---"}
    asked = {source for expected in ROWS for source in sources(expected) if source not in RULES}
    assert questions - asked == {"created, not yet raised", "clean stop of a logger", "a killed logger"}
    assert asked <= questions


def section(text: str, number: str) -> str:
    """The text of a section of the manual; "5" is the part of chapter 5 about alarms."""
    if number == "5":
        start = text.index("\n## Alarm\n")
        return text[start : text.index("\n## Identifikation", start)]
    (start,) = [match.end() for match in re.finditer(rf"^[#* ]*{re.escape(number)} (?!.*\t)", text, re.MULTILINE)]
    following = re.compile(r"^[#* ]*\d+(?:\.\d+)+ \w", re.MULTILINE).search(text, start)
    return text[start : following.start() if following else None]


@pytest.mark.parametrize("rule", RULES)
def test_the_manual_says_so(rule: str) -> None:
    """The words stand in the section that the rows name (German; skipped where the manual is not at hand)."""
    path = SHARED / "seeds" / "003_436fa307038a0f32.txt"
    if not path.is_file():
        pytest.skip(f"the manual {path} is not here; TCBRIDGE_SHARED names the folder that holds it")
    words = re.sub(r"\[(►|▶)[ _]\d+\] ", "", section(path.read_text(encoding="utf-8"), rule.split()[0]))
    assert RULES[rule] in words


# Stories.


def test_a_new_alarm_is_not_raised_and_nobody_is_told() -> None:
    """Create makes an alarm that is not raised; with confirmation none is required yet (6.3.3), without it is not supported."""
    plain = Create(key=KEY, severity=Severity.ERROR)
    asked = Create(key=KEY, severity=Severity.ERROR, with_confirmation=True)
    assert decide(None, plain) == decide(None, asked) == ()
    for call, state in ((plain, C.NOT_SUPPORTED), (asked, C.NOT_REQUIRED)):
        new = created(call)
        assert (new.raised, new.is_active, new.was_raised, new.confirmation_state) == (False, False, False, state)
        assert (new.time_raised_ns, new.time_cleared_ns, new.time_confirmed_ns) == (0, 0, 0)
        assert new.key == KEY
        assert new.source == Source(KEY.source_id, KEY.source_name)


def test_severity_and_confirmation_are_frozen() -> None:
    """A second Create that asks for something else is answered ERROR_ALREADY_EXISTS and changes nothing."""
    first = created(Create(key=KEY, severity=Severity.ERROR, with_confirmation=True))
    again = Create(key=KEY, severity=Severity.CRITICAL, with_confirmation=False)
    assert answer(first, again) == (ALREADY_EXISTS, ())


def test_a_refused_call_says_what_was_asked_of_what() -> None:
    """The error carries the manual's code and tells a person which call met which alarm."""
    with pytest.raises(AdsError) as caught:
        decide(STATES["raised"][1], Raise(key=KEY))
    assert (caught.value.code, caught.value.name) == (INVALIDSTATE, "ADS_E_INVALIDSTATE")
    assert caught.value.detail == "raise of an alarm that is raised, nothing to confirm"
    with pytest.raises(AdsError, match=r"ADS_E_NOTFOUND .* confirm of an alarm that is absent"):
        decide(None, Confirm(key=KEY))


def number(event: AlarmEvent, seq: int, session: str = "s1") -> AlarmEvent:
    """The event as its logger numbers it."""
    return msgspec.structs.replace(event, session=session, seq=seq)


def life(*calls: AlarmCommand) -> list[AlarmEvent]:
    """The numbered events of calls that follow each other, from Create on."""
    state: Alarm | None = None
    events: list[AlarmEvent] = []
    for call in calls:
        for decided in decide(state, call):
            events.append(number(decided, len(events) + 1))
            state = step(state, events[-1])
        if isinstance(call, Create) and state is None:
            state = created(call)
    return events


def test_the_captured_life() -> None:
    """As the real logger's capture shows five times: raised, confirmed while raised, cleared; it ends confirmed."""
    events = life(
        Create(key=KEY, severity=Severity.CRITICAL, with_confirmation=True),
        Raise(key=KEY, time_ns=1000),
        Confirm(key=KEY, time_ns=1000),
        Clear(key=KEY, time_ns=2000),
    )
    assert [event.kind for event in events] == ["alarm_raised", "alarm_confirmed", "alarm_cleared"]
    last = events[-1]
    assert (last.raised, last.confirmation_state) == (False, C.CONFIRMED)
    assert (last.time_raised_ns, last.time_cleared_ns, last.time_confirmed_ns) == (1000, 2000, 1000)


def test_each_transition_carries_what_is_valid_then() -> None:
    """Arguments and JSON attribute stay until a call brings others; who and why belong to one call only."""
    x, y = (Argument.of("x"),), (Argument.of("y"),)
    events = life(
        Create(key=KEY, severity=Severity.ERROR, with_confirmation=True, arguments=x, json_attribute='{"n":1}'),
        Raise(key=KEY, time_ns=1),
        Confirm(key=KEY, time_ns=2, json_attribute="", operator="op", client="hmi", comment="seen"),
        Clear(key=KEY, time_ns=3, arguments=y),
        Dispose(key=KEY, time_ns=4, arguments=()),
    )
    assert [event.arguments for event in events] == [x, x, y, ()]
    assert [event.json_attribute for event in events] == ['{"n":1}', "", "", ""]
    assert [(event.operator, event.client, event.comment) for event in events] == [
        ("", "", ""),
        ("op", "hmi", "seen"),
        ("", "", ""),
        ("", "", ""),
    ]


def test_identity_severity_and_device_stay_through_a_life() -> None:
    """Key, severity and the EtherCAT device of Create are in every event and in the alarm."""
    events = life(
        Create(key=KEY, severity=Severity.CRITICAL, vendor_id=2, product_code=0x44C2C52, revision_no=0),
        Raise(key=KEY, time_ns=1),
        Clear(key=KEY, time_ns=2),
        Dispose(key=KEY, time_ns=3),
    )
    for event in events:
        assert alarm_key(event) == KEY
        assert event.severity is Severity.CRITICAL
        assert (event.vendor_id, event.product_code, event.revision_no) == (2, 0x44C2C52, 0)
    state = step(None, events[0])
    assert state is not None
    assert (state.key, state.vendor_id, state.revision_no) == (KEY, 2, 0)


def test_an_alarm_keeps_every_field_of_its_last_event() -> None:
    """Each attribute an alarm shares with an event is taken over from it, so one filter serves both."""
    event = alarm_confirmed(
        event_id=3,
        severity=Severity.WARNING,
        session="s1",
        seq=9,
        source_id=0,
        source_name="",
        source_guid=OTHER_CLASS,
        arguments=(Argument.of(1),),
        json_attribute="{}",
        time_cleared_ns=4,
        vendor_id=1,
        product_code=2,
        revision_no=3,
        operator="op",
        client="hmi",
        comment="why",
    )
    state = step(None, event)
    assert state is not None
    shared = set(Alarm.__struct_fields__) & set(AlarmRaised.__struct_fields__)
    assert shared == set(Alarm.__struct_fields__) - {"suspect"}
    assert {name: getattr(state, name) for name in shared} == {name: getattr(event, name) for name in shared}
    assert (state.kind, state.is_alarm) == ("alarm_state", True)


def test_the_same_event_at_two_sources_is_two_alarms() -> None:
    """Chapter 5: class, id and source identify an alarm; absent, 0 and "" are different sources."""
    keys = [
        alarm_key(event)
        for event in (
            alarm_raised(),
            alarm_raised(source_id=0),
            alarm_raised(source_name=""),
            alarm_raised(source_id=0, source_name=""),
            alarm_raised(event_id=2),
            alarm_raised(event_class=OTHER_CLASS),
            alarm_raised(target="plc2"),
        )
    ]
    assert len(set(keys)) == len(keys)
    assert alarm_key(alarm_raised(severity=Severity.ERROR)) == alarm_key(alarm_cleared())


@pytest.mark.parametrize(
    ("state", "active"),
    [
        ("created", False),
        ("created with confirmation", False),
        ("cleared", False),
        ("cleared and confirmed", False),
        ("cleared with reset", False),
        ("raised", True),
        ("raised and confirmed", True),
        ("raised, waiting", True),
        ("cleared, waiting", True),
    ],
)
def test_active_is_raised_or_waiting(state: str, active: bool) -> None:
    """bActive (6.1.5), and bRemove of 8.2.1.1 and 8.2.1.2 is its opposite."""
    known = STATES[state][1]
    assert known is not None
    assert known.is_active is active


# The table: many alarms, from events that may come twice, late, or from a logger before.

RAISED = number(alarm_raised(time_ns=10), 1)
CLEARED = number(alarm_cleared(time_ns=20), 2)
RAISED_AGAIN = number(alarm_raised(time_ns=30), 3)
DISPOSED = number(alarm_disposed(time_ns=40), 4)
HERE = alarm_key(RAISED)


def test_an_event_seen_twice_changes_nothing() -> None:
    """Neither at once nor later, nor after the alarm is gone: a disposed alarm is not raised again by an old event."""
    table = fold([RAISED, CLEARED])
    assert table.apply(RAISED) is False
    assert table.apply(CLEARED) is False
    assert table.alarms[HERE].raised is False
    assert table.apply(DISPOSED) is True
    assert [table.apply(event) for event in (RAISED, CLEARED, RAISED_AGAIN, DISPOSED)] == [False] * 4
    assert table.alarms == {}


def test_a_disposed_alarm_can_be_raised_in_a_new_life() -> None:
    """A later event of the same session brings it back."""
    table = fold([RAISED, DISPOSED])
    assert table.apply(number(alarm_raised(time_ns=50), 5)) is True
    assert table.alarms[HERE].time_raised_ns == 50


def test_messages_are_passed_over() -> None:
    """A table may be fed the whole stream."""
    assert fold([message_sent(), RAISED, message_sent()]).alarms.keys() == {HERE}


def test_an_alarm_is_known_from_any_transition() -> None:
    """Each event carries the whole state: whoever starts in the middle knows the alarm from its next transition."""
    table = fold([number(alarm_cleared(time_ns=20, confirmation_state=C.WAIT_FOR_CONFIRMATION), 7)])
    assert table.alarms[HERE].is_active
    assert (table.alarms[HERE].time_raised_ns, table.alarms[HERE].time_cleared_ns) == (TIME_NS, 20)


def test_events_of_a_logger_that_was_replaced_are_stale() -> None:
    """After the new logger's first word on an alarm, the old one's events on it change nothing, seen before or not."""
    new = number(alarm_raised(time_ns=50), 1, "s2")
    table = fold([RAISED, new])
    assert table.apply(RAISED) is False
    assert table.apply(CLEARED) is False
    assert table.alarms[HERE].time_raised_ns == 50


def test_a_third_logger_replaces_the_second() -> None:
    """However often a logger is started again, only its last run counts."""
    runs = [number(alarm_raised(time_ns=10 * n), 1, f"s{n}") for n in range(1, 5)]
    table = fold(runs)
    assert [table.apply(event) for event in runs] == [False] * 4
    assert table.alarms[HERE].time_raised_ns == 40


def test_another_alarm_may_hear_of_the_loggers_in_another_order() -> None:
    """Events of different alarms come on different keys: one may bring the new logger before the other brings the old one."""
    table = fold([number(alarm_raised(event_id=2, time_ns=60), 1, "s2"), RAISED])
    assert table.apply(number(alarm_cleared(time_ns=70), 2, "s2")) is True
    assert table.alarms[HERE].raised is False
    assert len(table.alarms) == 2


def test_a_snapshot_replaces_what_was_known_of_its_target() -> None:
    """Alarms of the target that the snapshot lacks are gone; those of other targets stay."""
    elsewhere = number(alarm_raised(target="plc2"), 1, "s9")
    gone = number(alarm_raised(event_id=2), 2)
    table = fold([RAISED, gone, elsewhere])
    snapshot = fold([RAISED, CLEARED])
    table.load(snapshot.alarms.values(), "s1", 2, target="plc1")
    assert table.alarms.keys() == {HERE, alarm_key(elsewhere)}
    assert table.alarms[HERE].raised is False
    assert table.base("s1") == 2
    assert table.base("s9") == 0


def test_a_snapshot_of_everything_replaces_everything() -> None:
    """Without a target nothing is kept."""
    table = fold([RAISED, number(alarm_raised(target="plc2"), 1, "s9")])
    table.load([])
    assert table.alarms == {}


def test_events_before_the_snapshot_are_stale_and_later_ones_count() -> None:
    """Subscribe, ask, then apply what is newer: seq decides, for alarms the snapshot has and for those it has not."""
    table = AlarmTable()
    table.load(fold([RAISED]).alarms.values(), "s1", 3)
    assert table.apply(RAISED) is False
    assert table.apply(CLEARED) is False
    assert table.apply(number(alarm_raised(event_id=2), 3)) is False
    assert table.apply(number(alarm_raised(event_id=2), 4)) is True
    assert table.alarms.keys() == {HERE, AlarmKey("plc1", EVENT_CLASS, 2)}


def test_a_snapshot_makes_the_loggers_before_it_stale() -> None:
    """Their late events change nothing, not even on alarms that the new logger has said nothing about."""
    table = fold([RAISED, number(alarm_raised(event_id=2), 2)])
    table.load(fold([RAISED]).alarms.values(), "s2", 1, target="plc1")
    assert table.apply(RAISED_AGAIN) is False
    assert table.apply(number(alarm_cleared(event_id=2), 9)) is False
    assert table.apply(number(alarm_cleared(time_ns=70), 2, "s2")) is True
    assert table.alarms[HERE].time_cleared_ns == 70


def test_a_logger_known_from_a_snapshot_only_is_stale_too() -> None:
    """An alarm from a run before stands in the snapshot: late events of that run change nothing, on no alarm."""
    table = AlarmTable()
    table.load(fold([number(alarm_raised(), 7, "s0")]).alarms.values(), "s1", 1, target="plc1")
    assert table.apply(number(alarm_cleared(), 8, "s0")) is False
    assert table.apply(number(alarm_raised(event_id=2), 9, "s0")) is False
    assert table.apply(number(alarm_cleared(time_ns=70), 2, "s1")) is True


def test_a_logger_that_comes_back_counts_again() -> None:
    """After a healed partition the older logger stays: its snapshot makes its events good again, and the other's stale."""
    table = fold([RAISED])
    table.load([], "s2", 1, target="plc1")
    assert table.apply(CLEARED) is False
    table.load([], "s1", 2, target="plc1")
    assert table.apply(RAISED_AGAIN) is True
    assert table.apply(number(alarm_cleared(time_ns=99), 5, "s2")) is False


def test_a_new_logger_after_two_snapshots_is_not_mixed_up_with_the_old_one() -> None:
    """Snapshot, another logger, then the first one's events again: they stay stale."""
    table = fold([number(alarm_raised(event_id=2), 1, "s0"), RAISED])
    table.load(fold([RAISED]).alarms.values(), "s1", 1)
    assert table.apply(number(alarm_raised(time_ns=50), 1, "s2")) is True
    assert table.apply(CLEARED) is False
    assert table.alarms[HERE].raised is True


def test_a_stored_state_without_a_session_goes_on() -> None:
    """Alarms loaded from a file continue with the session they came from."""
    table = AlarmTable()
    table.load(fold([RAISED]).alarms.values())
    assert table.apply(RAISED) is False
    assert table.apply(CLEARED) is True


def test_an_event_without_a_session_is_never_stale() -> None:
    """Who does not number cannot be replaced: nothing is known of its order."""
    table = AlarmTable()
    table.load(fold([alarm_raised()]).alarms.values(), "s1", 1)
    assert table.apply(alarm_cleared()) is True


def test_a_created_alarm_is_put_and_takes_its_first_event() -> None:
    """No event announces it; the first raise makes it part of the state that is compared."""
    table = AlarmTable()
    table.put(created(Create(key=HERE, severity=Severity.INFO)))
    assert table.alarms.keys() == {HERE}
    assert table.state() == {}
    assert table.apply(RAISED) is True
    assert table.state() == {HERE: (True, C.NOT_SUPPORTED, 10, 0, 0)}


def test_active_alarms_have_the_latest_last() -> None:
    """In the order of their last transition; idle ones are left out."""
    events = [number(alarm_raised(event_id=n, time_ns=time_ns), n) for n, time_ns in ((1, 30), (2, 10), (3, 20))]
    table = fold([*events, number(alarm_cleared(event_id=3, time_ns=40), 4)])
    assert [known.event_id for known in table.active()] == [2, 1]


def test_the_state_tells_two_tables_apart() -> None:
    """Raised, confirmation and each of the three times count; arguments and numbers do not (decision 0013)."""
    base = fold([RAISED]).state()
    for change in (
        {"raised": False},
        {"confirmation_state": C.CONFIRMED},
        {"time_raised_ns": 11},
        {"time_cleared_ns": 1},
        {"time_confirmed_ns": 1},
    ):
        assert fold([msgspec.structs.replace(RAISED, **change)]).state() != base
    assert fold([msgspec.structs.replace(RAISED, session="s2", seq=9, arguments=(Argument.of(1),))]).state() == base


def test_the_module_names_its_phases() -> None:
    """A phase's words appear in what a person reads when a call is refused."""
    assert [member.value for member in alarms.Phase] == [
        "absent",
        "not raised, nothing to confirm",
        "raised, nothing to confirm",
        "raised, waiting for confirmation",
        "cleared, waiting for confirmation",
    ]


def test_a_suspect_alarm_is_trusted_when_its_source_speaks() -> None:
    """Only raised alarms become suspect, of the target alone; a confirmation by an operator proves nothing, a clear does."""
    table = AlarmTable()
    for target, number in (("plc1", 1), ("plc1", 2), ("plc2", 3)):
        table.apply(alarm_raised(target=target, event_id=number, seq=number))
    table.apply(alarm_cleared(target="plc1", event_id=2, seq=4))
    before = table.state()
    assert table.suspect("plc1")
    assert not table.suspect("plc1")
    assert table.state() == before
    assert [alarm.event_id for alarm in table.alarms.values() if alarm.suspect] == [1]
    table.apply(alarm_confirmed(target="plc1", event_id=1, seq=5, raised=True))
    assert [alarm.event_id for alarm in table.alarms.values() if alarm.suspect] == [1]
    table.apply(alarm_cleared(target="plc1", event_id=1, seq=6))
    assert not any(alarm.suspect for alarm in table.alarms.values())
    assert table.suspect()
    assert table.suspects("plc2") == tuple(key for key in table.alarms if key.target == "plc2")
    assert [alarm.suspect for alarm in table.mark(list(table.alarms), suspect=False)] == [False]
    assert table.suspects("plc2") == ()
    assert table.mark(list(table.alarms), suspect=False) == []


def test_suspects_are_told_whatever_their_sources_are() -> None:
    """Sources with and without id, name and GUID stand in one order, whichever came first."""
    sources = (
        alarm_raised(),
        alarm_raised(source_id=7),
        alarm_raised(source_name="Pump"),
        alarm_raised(source_guid=OTHER_CLASS),
    )
    told = []
    for order in (sources, sources[::-1]):
        table = AlarmTable()
        for seq, event in enumerate(order, 1):
            table.apply(number(event, seq))
        assert table.suspect("plc1")
        told.append(table.suspects("plc1"))
    assert len(told[0]) == len(sources)
    assert told[0] == told[1]
