"""A class of ours as a .tmc file describes it."""

from typing import Protocol

import msgspec

from bridge.core.module_classes import Method, MethodParameter, Pointer, TypeName, Value
from bridge.core.module_tmc import read_modules
from bridge.core.module_tmc_writer import write_modules
from bridge.tccom.declarations import DataArea, InterfacePointer, Parameter, Settable
from bridge.tccom.descriptions import described
from bridge.tccom.interfaces import DONE, Answer, interface
from bridge.tccom.module import Module

FILTER = "8d2f3a54-1c5e-4f4b-9a7d-5d1f00a0b001"
FILTER_2 = "8d2f3a54-1c5e-4f4b-9a7d-5d1f00a0b002"
LOW_PASS = "8d2f3a54-1c5e-4f4b-9a7d-5d1f00a0b003"
LREAL = TypeName("LREAL", "18071995-0000-0000-0000-00000000000e")
HRESULT = TypeName("HRESULT", "18071995-0000-0000-0000-000000000019")


@interface(FILTER)
class IFilter(Protocol):
    def step(self, value: float) -> Answer[float]: ...


@interface(FILTER_2, hides=(IFilter,))
class IFilter2(IFilter, Protocol):
    def reset(self, to: list[int], why: str) -> Answer[None]: ...


class Limits(msgspec.Struct):
    low: float = 0.5


class Image(msgspec.Struct):
    limits: Limits = msgspec.field(default_factory=Limits)
    count: int = 3
    ready: bool = False


class LowPass(Module, IFilter2):
    """Smooths."""

    class_id = LOW_PASS
    gain = Parameter(0x1, float, default=1.5, settable=Settable.INIT | Settable.OP, comment="how much")
    label = Parameter(0x2, str)
    image = DataArea(3, Image)
    source = InterfacePointer(0x4, IFilter, required=False)

    def step(self, value: float) -> Answer[float]:
        return Answer(value * self.gain)

    def reset(self, to: list[int], why: str) -> Answer[None]:
        return DONE


def test_a_class_of_ours_as_a_tmc_file() -> None:
    """It reads as a module class: interfaces, parameters with their defaults, symbols of data areas, interface pointers."""
    found = described([LowPass])
    assert read_modules(write_modules(found.modules, found.interfaces)) == found
    module = found.module("LowPass")
    assert (module.guid, module.class_id) == (LOW_PASS, LOW_PASS)
    assert all(module.implements(name) for name in (FILTER, FILTER_2, "IFilter2", "ITComObject", "ITcADI"))
    assert not module.implements("ITcUnknown")
    gain, label = module.parameters
    assert (gain.id, gain.type, gain.default, gain.online, gain.comment) == (0x1, LREAL, (Value("1.5"),), True, "how much")
    assert (label.id, label.type, label.default, label.online) == (0x2, TypeName("STRING(255)"), (), False)
    (area,) = module.data_areas
    assert (area.number, area.name, area.area_type) == (3, "image", "OutputSrc")
    assert [(symbol.name, symbol.type.name, symbol.default) for symbol in area.symbols] == [
        ("limits.low", "LREAL", (Value("0.5"),)),
        ("count", "LINT", (Value("3"),)),
        ("ready", "BOOL", (Value("false", "Bool"),)),
    ]
    assert module.interface_pointers == (Pointer(0x4, "source", TypeName("IFilter", FILTER)),)


def test_interfaces_of_ours_as_a_tmc_file() -> None:
    """With their own methods, their base and what they hide; what a method gives back is a parameter by reference.

    Those that TwinCAT has itself are not declared again.
    """
    interfaces = {each.name: each for each in described([LowPass]).interfaces}
    older, newer = interfaces["IFilter"], interfaces["IFilter2"]
    result = TypeName("LREAL", LREAL.guid, reference=True)
    assert older.methods == (Method("step", (MethodParameter("value", LREAL), MethodParameter("result", result)), HRESULT),)
    assert newer.methods == (
        Method(
            "reset",
            (MethodParameter("to", TypeName("list[int]")), MethodParameter("why", TypeName("STRING(255)"))),
            HRESULT,
        ),
    )
    assert newer.base == TypeName("IFilter", FILTER)
    assert newer.hides == (FILTER,)
    assert older.base.name == "ITcUnknown"
    assert set(interfaces) == {"IFilter", "IFilter2"}
