"""Samples of an object's values, as somebody far away takes them."""

import threading
from queue import Queue

import pytest

from bridge.core.hresult import ADS_E_NOTFOUND, ADS_E_SYMBOLNOTFOUND, E_NOTIMPL, E_POINTER, AdsError
from bridge.tccom.general import IWatchSource, ParameterKey
from bridge.tccom.identity import ITC_WATCH_SOURCE
from bridge.tccom.interfaces import Answer
from bridge.tccom.sampling import Sampler
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from tests.unit.tccom.tccom_stories import Calculation, ICalculation

PATIENCE_S = 30.0


def test_values_of_one_moment_are_read_together() -> None:
    """Parameters by id or name, symbols by path; a key that nobody has refuses them all."""
    with ObjectServer() as server:
        calculation = server.create(Calculation, ICalculation, state=State.OP)
        assert ITC_WATCH_SOURCE in server.object_info(calculation.object_id).interfaces
        with calculation.query(IWatchSource) as source:
            calculation.interface.addition(1, 2)
            assert source.read_values((1, "offset", "outputs.total", "inputs")).value == (0, 0, 3, {"value": 0})
            assert source.read_values(()).value == ()
            unknown: list[tuple[ParameterKey, int]] = [
                ("none", ADS_E_NOTFOUND),
                ("outputs.no", ADS_E_SYMBOLNOTFOUND),
                (99, ADS_E_NOTFOUND),
            ]
            for key, code in unknown:
                with pytest.raises(AdsError) as failure:
                    source.read_values(("offset", key))
                assert failure.value.code == code


def test_a_sampler_tells_what_is_and_what_has_changed() -> None:
    """First everything, then what is another value than before; closed, nothing more."""
    told: Queue[tuple[ParameterKey, object]] = Queue()
    with ObjectServer() as server:
        calculation = server.create(Calculation, ICalculation, state=State.OP)
        source = calculation.query(IWatchSource)
        with Sampler(source.interface, ["outputs.total", 1], lambda *change: told.put(change), every_s=0.001):
            assert [told.get(timeout=PATIENCE_S) for _ in range(2)] == [("outputs.total", 0), (1, 0)]
            calculation.interface.addition(1, 2)
            assert told.get(timeout=PATIENCE_S) == ("outputs.total", 3)
            server.set_parameter(calculation.object_id, "offset", 5)
            assert told.get(timeout=PATIENCE_S) == (1, 5)
        calculation.interface.addition(1, 2)
        assert told.empty()
    assert not [thread for thread in threading.enumerate() if thread.name == "sampler"]


class _Flaky:
    """Answers one more sample each time it is let."""

    def __init__(self) -> None:
        self.answers: Queue[object] = Queue()

    def read_values(self, keys: tuple[ParameterKey, ...]) -> Answer[tuple[object, ...]]:
        match self.answers.get(timeout=PATIENCE_S):
            case AdsError() as error:
                raise error
            case value:
                return Answer((value,))


def test_an_object_that_is_gone_for_a_while_is_told_once() -> None:
    """Its error once, then silence; when it is back, what has changed meanwhile."""
    told: Queue[object] = Queue()
    source = _Flaky()
    sampler = Sampler(source, ["x"], lambda _, value: told.put(value), failed=lambda error: told.put(error.code), every_s=0.001)
    for answer in (AdsError(E_NOTIMPL), 1, AdsError(ADS_E_NOTFOUND), AdsError(E_POINTER), 1, AdsError(E_POINTER), 2):
        source.answers.put(answer)
    assert [told.get(timeout=PATIENCE_S) for _ in range(5)] == [E_NOTIMPL, 1, ADS_E_NOTFOUND, E_POINTER, 2]
    source.answers.put(AdsError(E_POINTER))
    sampler.close()
    sampler.close()


def test_who_cannot_take_what_is_told_misses_it(caplog: pytest.LogCaptureFixture) -> None:
    """The failure is logged, and the next change is told."""
    told: Queue[object] = Queue()

    def take(_: ParameterKey, value: object) -> None:
        if value == 1:
            raise OSError("full")
        told.put(value)

    source = _Flaky()
    sampler = Sampler(source, ["x"], take, every_s=0.001)
    for answer in (1, 2):
        source.answers.put(answer)
    assert told.get(timeout=PATIENCE_S) == 2
    assert "full" in caplog.text
    source.answers.put(2)
    sampler.close()
