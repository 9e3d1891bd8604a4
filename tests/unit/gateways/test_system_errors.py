"""Errors of programs and of the machine as events: which, how many, and what never comes round."""

import contextlib
import json
import logging
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.events import MessageSent, Severity
from bridge.core.own_events import OWN_CLASS, SYSTEM_ERROR
from bridge.gateways.system_errors import BURST, Errors, JournalError, SystemErrors
from tests.unit.logger.logger_stories import eventually

LOG = logging.getLogger("pump.control")


@contextlib.contextmanager
def errors_of(which: Errors, *journal: str) -> Iterator[tuple[SystemErrors, list[MessageSent]]]:
    """The errors that become events."""
    sent: list[MessageSent] = []
    with SystemErrors("plc1", sent.append, which, journal=journal or ("no-such-program",)) as errors:
        yield errors, sent


def texts(sent: list[MessageSent]) -> list[list[str]]:
    """What and where."""
    return [[argument.value for argument in event.arguments] for event in sent]


def test_what_the_program_logs_becomes_an_event(caplog: pytest.LogCaptureFixture) -> None:
    """From warning upwards, on one line, with its severity and time; it is logged as before."""
    with errors_of("own") as (_, sent):
        LOG.info("all is well")
        LOG.warning("bearing %d\nis hot", 3)
        LOG.error("it burns")
        LOG.critical("it is gone")
    assert texts(sent) == [["bearing 3 is hot", "pump.control"], ["it burns", "pump.control"], ["it is gone", "pump.control"]]
    assert [event.severity for event in sent] == [Severity.WARNING, Severity.ERROR, Severity.CRITICAL]
    assert {(event.target, event.event_class, event.event_id) for event in sent} == {("plc1", OWN_CLASS, SYSTEM_ERROR)}
    assert all(event.time_ns for event in sent)
    assert len(caplog.records) >= 3
    LOG.error("nobody takes this")
    assert len(sent) == 3


def test_a_call_that_does_not_fit_its_text_hurts_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who logs goes on, and so do we."""
    monkeypatch.setattr(logging.root, "handlers", [])
    monkeypatch.setattr(logging, "raiseExceptions", False)
    with errors_of("own") as (_, sent):
        LOG.error("%d bar", "much")
        LOG.error("it burns")
    assert texts(sent) == [["it burns", "pump.control"]]


def test_off_is_off() -> None:
    """The manual's default: nothing is taken."""
    with errors_of("none") as (_, sent):
        LOG.error("it burns")
    assert sent == []


def test_a_storm_of_errors_is_no_storm_of_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most BURST in a while; the next one says how many were left out."""
    with errors_of("own") as (errors, sent):
        for number in range(100):
            LOG.error("error %d", number)
        assert eventually(lambda: errors.left_out == 100 - BURST)
        monkeypatch.setattr("bridge.gateways.system_errors.WINDOW_S", -1.0)
        LOG.error("a minute later")
    assert len(sent) == BURST + 1
    assert texts(sent)[-1][0] == f"({100 - BURST} more before this) a minute later"


def test_an_error_of_telling_is_no_event() -> None:
    """Else one that cannot be sent would go round for ever; what follows is told."""
    sent: list[str] = []
    threads: set[str] = set()

    def send(event: MessageSent) -> None:
        threads.add(threading.current_thread().name)
        text = event.arguments[0].value
        LOG.error("cannot tell: %s", text)
        if text == "first":
            raise OSError
        sent.append(text)

    with SystemErrors("plc1", send, "own"):
        LOG.error("first")
        LOG.error("second")
        assert eventually(lambda: "second" in sent)
        LOG.error("third")
        assert eventually(lambda: "third" in sent)
    assert sent == ["second", "third"]
    assert threads == {"system errors"}


def test_errors_of_the_host_come_from_its_journal(tmp_path: Path) -> None:
    """With the unit, the severity and the time of each; lines of our own sink and what is no entry are passed over."""
    entries = [
        {
            "MESSAGE": "disk sda: I/O error",
            "PRIORITY": "2",
            "SYSLOG_IDENTIFIER": "kernel",
            "__REALTIME_TIMESTAMP": "1800000000000000",
        },
        {"MESSAGE": "plc1 alarm_raised", "PRIORITY": "3", "SYSLOG_IDENTIFIER": "tcbridge"},
        {"MESSAGE": list(b"caf\xc3\xa9"), "PRIORITY": "3", "_SYSTEMD_UNIT": "till.service"},
        {"MESSAGE": None, "PRIORITY": "3"},
    ]
    (tmp_path / "journal").write_text("".join(f"{json.dumps(entry)}\nno entry\n" for entry in entries))
    script = "import sys,time; print(open(sys.argv[1]).read(), flush=True); time.sleep(600)"
    with errors_of("host", sys.executable, "-c", script, str(tmp_path / "journal")) as (_, sent):
        assert eventually(lambda: len(sent) == 2, 30)
        LOG.error("and those of the program")
    assert texts(sent) == [
        ["disk sda: I/O error", "kernel"],
        ["café", "till.service"],
        ["and those of the program", "pump.control"],
    ]
    assert [event.severity for event in sent] == [Severity.CRITICAL, Severity.ERROR, Severity.ERROR]
    assert sent[0].time_ns == 1_800_000_000_000_000_000


def test_a_journal_that_ends_is_told() -> None:
    """Else no error of the host would look like a host without errors."""
    with errors_of("host", sys.executable, "-c", "raise SystemExit(3)") as (_, sent):
        assert eventually(lambda: len(sent) == 1, 30)
    assert texts(sent) == [["the journal ended with 3: errors of the host are not seen any more", "journal"]]


def test_a_host_without_a_journal() -> None:
    """Is told at once, by the name of what is missing."""
    with pytest.raises(JournalError, match=r"no-such-program: No such file"), errors_of("host"):
        pass
