"""Stories of an exception in an author's code: whoever asked learns the line, the log has the traceback once."""

import json
import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import pytest

from bridge.core.hresult import ADS_E_EXCEPTION, ADS_E_INVALIDDATA, AdsError
from bridge.tccom import Answer, Module, ObjectServer, Parameter, State, interface, raised
from bridge.tccom.general import IObject
from bridge.tccom.reports import Report, ReportKind


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d2001")
class IFaulty(Protocol):
    """Works in no case."""

    def work(self) -> Answer[None]: ...


class Faulty(Module, IFaulty):
    """Breaks where it is told to."""

    breaks = ""
    gain = Parameter(0x1, int, default=0)

    def __init__(self) -> None:
        self._break("making")

    def _break(self, where: str) -> None:
        if self.breaks == where:
            no_luck(where)

    @contextmanager
    def _held(self) -> Iterator[None]:
        yield
        no_luck("giving back")

    def on_parameter(self, name: str) -> None:
        self._break("parameter")

    def on_ps(self) -> None:
        if self.breaks == "giving back":
            self.enter(self._held())

    def on_so(self) -> None:
        self._break("step")

    def work(self) -> Answer[None]:
        no_luck("call")
        return Answer(None)


def no_luck(where: str) -> None:
    """The innermost line of the author."""
    json.loads(f"{where}: no luck")


LINE = no_luck.__code__.co_firstlineno + 2
PLACE = f"(test_raised.py:{LINE} in no_luck)"


@pytest.fixture(autouse=True)
def nothing_logged_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test begins as a program does."""
    monkeypatch.setattr(raised, "_logged", {})


def _make(server: ObjectServer) -> None:
    server.create(Faulty, IObject)


def _step(server: ObjectServer) -> None:
    server.create(Faulty, IObject, state=State.OP)


def _parameter(server: ObjectServer) -> None:
    server.create(Faulty, IObject).interface.set_parameter("gain", 1)


def _call(server: ObjectServer) -> None:
    server.create(Faulty, IFaulty).interface.work()


def _give_back(server: ObjectServer) -> None:
    server.create(Faulty, IObject, state=State.SAFEOP).interface.set_state(State.PREOP)


ASKED: dict[str, Callable[[ObjectServer], None]] = {"making": _make, "step": _step, "parameter": _parameter, "call": _call}


@pytest.mark.parametrize("where", ASKED)
def test_the_author_learns_the_line(where: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """In the answer the innermost line of the author's code, not that of the library it uses; in the log one traceback."""
    monkeypatch.setattr(Faulty, "breaks", where)
    with ObjectServer() as server, pytest.raises(AdsError) as failure:
        ASKED[where](server)
    assert failure.value.code == ADS_E_EXCEPTION
    assert "JSONDecodeError: Expecting value" in failure.value.detail
    assert PLACE in failure.value.detail
    [record] = caplog.records
    assert (record.name, record.levelno) == ("bridge.tccom.raised", logging.ERROR)
    assert caplog.text.count("Traceback") == 1
    assert "in no_luck" in caplog.text


def test_what_is_given_back_badly_is_told_with_its_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody gets an answer of it: the report has the line."""
    monkeypatch.setattr(Faulty, "breaks", "giving back")
    told: list[Report] = []
    with ObjectServer(report=told.append) as server:
        _give_back(server)
    [detail] = [one.detail for one in told if one.kind is ReportKind.UNDO_FAILED]
    assert detail.endswith(PLACE)
    assert caplog.text.count("Traceback") == 1


def test_a_place_that_breaks_in_every_cycle_does_not_fill_the_log(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The same place is logged once, and again when the quiet time is over; every caller is told."""
    with ObjectServer() as server:
        faulty = server.create(Faulty, IFaulty)
        for quiet_s, logged in ((60.0, 1), (60.0, 1), (0.0, 2)):
            monkeypatch.setattr(raised, "QUIET_S", quiet_s)
            with pytest.raises(AdsError, match=re.escape(PLACE)):
                faulty.interface.work()
            assert len(caplog.records) == logged


def test_the_line_stands_in_the_first_line_of_a_long_text() -> None:
    """What shows one line of it shows the place."""
    try:
        raise ValueError("one\n  two")
    except ValueError as error:
        told = raised.as_ads_error(error, "x").detail.splitlines()
    assert told[0].startswith("x: ValueError: one (test_raised.py:")
    assert told[1:] == ["  two"]


def test_a_refusal_is_an_answer(caplog: pytest.LogCaptureFixture) -> None:
    """An AdsError is passed on as it is, and is no news for the log."""
    refusal = AdsError(ADS_E_INVALIDDATA, "no")
    assert raised.as_ads_error(refusal, "x") is refusal
    assert caplog.records == []
