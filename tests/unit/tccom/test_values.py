"""Parameters, pointers, data areas and watches, from inside and from outside."""

import gc
import math
import weakref

import msgspec
import pytest

from bridge.core.hresult import (
    ADS_E_EXCEPTION,
    ADS_E_INVALIDACCESS,
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSTATE,
    ADS_E_NOTFOUND,
    ADS_E_NOTINIT,
    ADS_E_SRVNOTSUPP,
    ADS_E_SYMBOLNOTFOUND,
    AdsError,
)
from bridge.tccom.declarations import UNSET, DataArea, InterfacePointer, Parameter, Resolved, Settable, checked_address
from bridge.tccom.describing import class_info
from bridge.tccom.general import IDataAreas, IObject
from bridge.tccom.identity import IdError
from bridge.tccom.module import Module
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from bridge.tccom.values import same
from tests.unit.tccom.tccom_stories import Calculation, ICalculation, Inputs, Outputs


class Range(msgspec.Struct, frozen=True):
    low: float = 0.0
    high: float = 1.0


class Filter(Module):
    """A filter."""

    class_id = "22222222-0000-4000-8000-000000000001"

    gain = Parameter(0x1, float, settable=Settable.INIT | Settable.OP)
    order = Parameter(0x2, int, default=2)
    limits = Parameter(0x3, Range, default=Range(), settable=Settable.OP)
    seen = Parameter(0x4, int, default=0, settable=Settable.NEVER)
    taps = Parameter(0x5, list[float], default=[1.0])

    def on_parameter(self, name: str) -> None:
        if name == "gain" and self.gain == 0:
            raise AdsError(ADS_E_INVALIDPARM, "a gain of 0")
        if name == "gain" and self.gain < 0:
            raise ZeroDivisionError
        self.seen += 1


def _refused(server: ObjectServer, object_id: int, key: str | int, value: object) -> int:
    with pytest.raises(AdsError) as failure:
        server.set_parameter(object_id, key, value)
    return failure.value.code


def test_parameters_are_set_when_they_may_be() -> None:
    """INIT until PREOP is left, OP in OP, none in SAFEOP, NEVER never."""
    with ObjectServer() as server:
        given: dict[int | str, object] = {0x1: 2, "order": 4}
        object_id = server.add(Filter(), parameters=given)
        assert [server.get_parameter(object_id, key) for key in ("gain", 0x2, "limits")] == [2.0, 4, {"low": 0.0, "high": 1.0}]
        server.set_parameter(object_id, "order", 3)
        server.set_parameter(object_id, "gain", 3.5)
        assert _refused(server, object_id, "limits", {"low": 1}) == ADS_E_INVALIDSTATE
        server.set_state(object_id, State.SAFEOP)
        assert {_refused(server, object_id, key, 1) for key in ("gain", "order")} == {ADS_E_INVALIDSTATE}
        server.set_state(object_id, State.OP)
        server.set_parameter(object_id, "gain", 4)
        server.set_parameter(object_id, 0x3, {"high": 9})
        assert _refused(server, object_id, "order", 1) == ADS_E_INVALIDSTATE
        assert _refused(server, object_id, "seen", 1) == ADS_E_INVALIDACCESS
        assert _refused(server, object_id, "none", 1) == ADS_E_NOTFOUND
        assert server.get_parameter(object_id, "limits") == {"low": 0.0, "high": 9.0}
        assert server.get_parameter(object_id, "seen") == 4


@pytest.mark.parametrize(
    ("key", "value"), [("gain", "much"), ("gain", None), ("order", 1.5), ("order", True), ("taps", 1), ("taps", ["x"])]
)
def test_a_value_of_another_type_is_refused(key: str, value: object) -> None:
    """At creation and later; the old value stays."""
    with ObjectServer() as server:
        with pytest.raises(AdsError) as failure:
            server.add(Filter(), parameters={"gain": 1.0, key: value})
        assert failure.value.code == ADS_E_INVALIDDATA
        object_id = server.add(Filter(), parameters={"gain": 1.0})
        before = server.get_parameter(object_id, key)
        assert _refused(server, object_id, key, value) == ADS_E_INVALIDDATA
        assert server.get_parameter(object_id, key) == before


def test_a_module_may_refuse_a_parameter() -> None:
    """By an AdsError of its own or by breaking over it: the old value is back."""
    with ObjectServer() as server:
        object_id = server.add(Filter(), parameters={"gain": 1.0}, state=State.OP)
        assert _refused(server, object_id, "gain", 0) == ADS_E_INVALIDPARM
        assert _refused(server, object_id, "gain", -1) == ADS_E_EXCEPTION
        assert server.get_parameter(object_id, "gain") == 1.0


def test_a_parameter_without_default_must_be_given_before_safeop() -> None:
    """A parent may pass it on while the child is in PREOP (manual 8.1.1.2, PS)."""
    with ObjectServer() as server:
        object_id = server.add(Filter())
        with pytest.raises(AdsError, match="gain") as failure:
            server.set_state(object_id, State.SAFEOP)
        assert failure.value.code == ADS_E_NOTINIT
        server.set_parameter(object_id, "gain", 1.0)
        server.set_state(object_id, State.SAFEOP)


def test_a_default_belongs_to_each_object() -> None:
    """Changing a list in one object does not change it in another."""
    one, other = Filter(), Filter()
    one.taps.append(2.0)
    assert (one.taps, other.taps) == ([1.0, 2.0], [1.0])


def test_declarations_that_cannot_be_are_refused() -> None:
    """Two of one id, a default of another type, a name that every module has."""
    with pytest.raises(TypeError, match="0x00000001"):

        class Twice(Module):
            one = Parameter(0x1, int, default=0)
            two = InterfacePointer(0x1, ICalculation)

    with pytest.raises(RuntimeError) as failure:

        class Wrong(Module):
            one = Parameter[int](0x1, int, default="x")  # type: ignore[arg-type] # the mistake the test is about

    assert isinstance(failure.value.__cause__, AdsError)

    with pytest.raises(TypeError, match="state"):

        class Shadow(Module):
            state = Parameter(0x1, int, default=0)  # type: ignore[assignment] # the mistake the test is about


def test_symbols_are_read_and_written_by_their_path() -> None:
    """A whole area, a symbol, a member; only in areas that are writable, and only in their type."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation, state=State.OP)
        with reference.query(IDataAreas) as areas:
            reference.interface.addition(1, 2)
            assert areas.read_symbol("").value == {"inputs": {"value": 0}, "outputs": {"total": 3, "inner": {"value": 0}}}
            assert areas.read_symbol("outputs.total").value == 3
            assert areas.read_symbol("outputs.inner.value").value == 0
            areas.write_symbol("inputs.value", 7)
            assert areas.read_symbol("inputs").value == {"value": 7}
            areas.write_symbol("inputs", {"value": 8})
            assert areas.read_symbol("inputs.value").value == 8
            codes = []
            for path, value in [
                ("outputs.total", 1),
                ("inputs.value", "x"),
                ("inputs.other", 1),
                ("other", 1),
                ("inputs.value.x", 1),
            ]:
                with pytest.raises(AdsError) as failure:
                    areas.write_symbol(path, value)
                codes.append(failure.value.code)
            assert codes == [ADS_E_INVALIDACCESS, ADS_E_INVALIDDATA, *[ADS_E_SYMBOLNOTFOUND] * 3]


def test_a_watch_tells_what_is_and_each_change() -> None:
    """Parameters and symbols; after it was left, nothing."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation, state=State.OP)
        told: list[object] = []
        with (
            server.watch(reference.object_id, "outputs.total", lambda value: told.append(("total", value))),
            server.watch(reference.object_id, 0x1, lambda value: told.append(("offset", value))),
        ):
            reference.interface.addition(1, 2)
            reference.interface.addition(2, 1)
            server.set_parameter(reference.object_id, "offset", 5)
            reference.interface.addition(0, 0)
        reference.interface.addition(50, 0)
        assert told == [("total", 0), ("offset", 0), ("total", 3), ("offset", 5), ("total", 5)]
        for key, code in [("none", ADS_E_NOTFOUND), ("outputs.none", ADS_E_SYMBOLNOTFOUND)]:
            with pytest.raises(AdsError) as failure:
                server.watch(reference.object_id, key, told.append)
            assert failure.value.code == code


@pytest.mark.parametrize(
    ("before", "now", "unchanged"),
    [
        (math.nan, float("nan"), True),
        ({"a": [math.nan]}, {"a": [-math.nan + math.nan]}, True),
        (math.nan, 0.0, False),
        (1, 1, True),
        ([1], [2], False),
        (UNSET, 1, False),
        (UNSET, None, False),
    ],
)
def test_what_is_not_a_number_does_not_change_all_the_time(before: object, now: object, unchanged: bool) -> None:
    """A sensor that gives NaN is told once, not with every call."""
    assert same(before, now) is unchanged


def test_an_object_forgets_watches_that_have_ended() -> None:
    """A thousand people who look once leave nothing behind."""
    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation)
        with server.watch(reference.object_id, "offset", lambda _: None) as watch:
            ended = weakref.ref(watch)
        del watch
        gc.collect()
        assert ended() is None


def test_a_watch_that_breaks_disturbs_nobody(caplog: pytest.LogCaptureFixture) -> None:
    """The call is answered, the failure is logged."""

    def stumble(value: object) -> None:
        raise OSError(value)

    with ObjectServer() as server:
        reference = server.create(Calculation, ICalculation)
        with server.watch(reference.object_id, "outputs", stumble):
            assert reference.interface.addition(1, 2).value == 3
    assert "a watch failed" in caplog.text


class User(Module):
    """Uses what may come later."""

    class_id = "22222222-0000-4000-8000-000000000002"

    calculation = InterfacePointer(0x1, ICalculation, required=False, resolved=Resolved.SO)


def test_a_pointer_that_is_not_required_finds_what_comes_later() -> None:
    """The order in which provider and caller start does not matter (manual 7.1.2)."""
    with ObjectServer() as server:
        user = User()
        user_id = server.add(user, parameters={"calculation": 0x71010077}, state=State.OP)
        with pytest.raises(AdsError) as failure:
            user.calculation.addition(1, 2)
        assert failure.value.code == ADS_E_NOTFOUND
        with server.create(Calculation, IObject, object_id=0x71010077):
            assert user.calculation.addition(1, 2).value == 3
        assert server.object_info(0x71010077).references == 2
        server.set_state(user_id, State.SAFEOP)
        assert server.object_info(0x71010077).references == 1
        with pytest.raises(AdsError) as failure:
            user.calculation.addition(1, 2)
        assert failure.value.code == ADS_E_NOTINIT


def test_a_pointer_that_is_required_holds_the_module_back() -> None:
    """Without an id, or without its object, PS fails; the address of another target needs a way there."""

    class Strict(Module):
        calculation = InterfacePointer(0x1, ICalculation)

    with ObjectServer() as server:
        codes = []
        for address in (0, 0x71010077, "plc2/0x71010077"):
            object_id = server.add(Strict(), parameters={"calculation": address})
            with pytest.raises(AdsError) as failure:
                server.set_state(object_id, State.OP)
            codes.append(failure.value.code)
            assert server.object_info(object_id).state is State.PREOP
        assert codes == [ADS_E_NOTINIT, ADS_E_NOTFOUND, ADS_E_SRVNOTSUPP]


@pytest.mark.parametrize(
    ("value", "address"),
    [(5, 5), (0, 0), ("0x71010000", 0x71010000), ("plc2/0x71010000", "plc2/0x71010000"), ("a/b/16", "a/b/0x00000010")],
)
def test_an_address_is_an_id_or_a_target_and_an_id(value: object, address: object) -> None:
    """One spelling for each."""
    assert checked_address(value) == address


@pytest.mark.parametrize("value", [-1, 2**32, 0xFFFFFFFF, True, None, 1.0, "", "x", "plc2/", "/0x1", "plc2/x"])
def test_what_is_no_address_is_refused(value: object) -> None:
    """With what was expected."""
    with pytest.raises(IdError):
        checked_address(value)


def test_a_class_can_be_described() -> None:
    """Everything a tool needs to show it and to fill in its parameters."""
    info = class_info(Filter)
    assert (info.name, info.description, info.class_id) == ("Filter", "A filter.", Filter.class_id)
    assert [(one.id, one.name, one.type, one.settable, one.required) for one in info.parameters] == [
        (1, "gain", "float", ("init", "op"), True),
        (2, "order", "int", ("init",), False),
        (3, "limits", "Range", ("op",), False),
        (4, "seen", "int", (), False),
        (5, "taps", "list[float]", ("init",), False),
    ]
    symbols = class_info(Calculation).symbols
    assert [(one.path, one.type, one.area, one.writable) for one in symbols] == [
        ("inputs.value", "int", 0, True),
        ("outputs.total", "int", 1, False),
        ("outputs.inner.value", "int", 1, False),
    ]
    (pointer,) = class_info(User).parameters
    assert (pointer.type, pointer.interface, pointer.required) == (
        "ICalculation",
        "6b3f0bcd-3f8c-4d0c-9f39-5f8d7b1d0a11",
        False,
    )
    assert isinstance(Calculation.inputs, DataArea)
    assert Calculation().inputs == Inputs()
    assert Calculation().outputs == Outputs()
