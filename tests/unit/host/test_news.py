"""Stories of what a plant tells: every report is an event with a text, held until somebody takes it."""

import pytest

from bridge.core.catalog import Catalog
from bridge.core.events import MessageSent, Severity
from bridge.core.own_events import OWN_EVENTS
from bridge.host import news
from bridge.host.news import News
from bridge.tccom import State
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.states import Transition

TEXTS = Catalog([OWN_EVENTS])


def report(kind: ReportKind) -> Report:
    """One about a pump."""
    return Report(
        kind=kind,
        object_id=0x71010000,
        object_name="Pump",
        class_name="Pump",
        state=State.PREOP,
        transition=Transition.PS,
        duration_ns=12_345_678,
        code=0x98110719,
        detail="why",
    )


TOLD = {
    ReportKind.DONE: (Severity.INFO, "Pump: PS done in 12 ms, now PREOP"),
    ReportKind.FAILED: (Severity.ERROR, "Pump: PS failed, still PREOP: ADS_E_TIMEOUT: why"),
    ReportKind.UNDO_FAILED: (Severity.ERROR, "Pump: something was not given back in PS: ADS_E_TIMEOUT: why"),
    ReportKind.SLOW: (Severity.WARNING, "Pump: PS took 12 ms, too long for real time"),
    ReportKind.CYCLE_FAILED: (Severity.ERROR, "Pump: a cycle failed: ADS_E_TIMEOUT: why"),
    ReportKind.CYCLE_RECOVERED: (Severity.INFO, "Pump: cycles work again"),
    ReportKind.LATE: (Severity.WARNING, "Pump: why"),
    ReportKind.BROKEN: (Severity.ERROR, "Pump does not work any more: ADS_E_TIMEOUT: why"),
}


@pytest.mark.parametrize("kind", list(ReportKind))
def test_every_report_is_an_event_of_its_module(kind: ReportKind) -> None:
    """With severity, text in two languages that uses every argument, the module as source, and its time."""
    told: list[MessageSent] = []
    News("plc1", lambda event: True, told.append).report(report(kind))
    [event] = told
    assert (event.severity, TEXTS.event_text(event)) == TOLD[kind]
    german = TEXTS.event_text(event, 1031)
    assert german.startswith("Pump")
    assert all(argument.value in german for argument in event.arguments)
    assert (event.target, event.source_id, event.source_name) == ("plc1", 0x71010000, "Pump")
    assert event.time_ns > 0


def test_what_nobody_takes_is_held_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until it is opened and somebody takes it; the oldest go when there are too many."""
    monkeypatch.setattr(news, "HELD", 3)
    sent: list[str] = []
    there = False

    def send(event: MessageSent) -> bool:
        if there:
            sent.append(TEXTS.event_text(event))
        return there

    held = News("plc1", send, lambda event: None)
    for number in range(4):
        held.not_started(number + 1, f"M{number}", "it waits")
    held.open()
    assert sent == []
    there = True
    held.flush()
    assert sent == [f"M{number} is not started: it waits" for number in (1, 2, 3)]
    held.not_ended(9, "M9")
    assert sent[-1].startswith("M9 does not work any more: ADS_E_TIMEOUT")


def test_telling_never_fails_whoever_did_something() -> None:
    """Neither a reader that is gone nor a logger that is being closed."""

    def broken(event: MessageSent) -> bool:
        raise OSError("gone")

    held = News("plc1", broken, broken)  # type: ignore[arg-type] # what it returns is of no interest
    held.open()
    held.report(report(ReportKind.DONE))
