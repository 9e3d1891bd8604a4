"""Interfaces are declared once, and stay what they are."""

from typing import Protocol

import msgspec
import pytest

from bridge.core.hresult import ADS_E_EXCEPTION, ADS_E_INVALIDPARM, ADS_E_NOTFOUND, S_FALSE, AdsError
from bridge.tccom.general import ICyclic, ICyclicCaller, IDataAreas, IObject, IObjectServer, ITask, IWatchSource
from bridge.tccom.identity import ITC_ADI, ITC_UNKNOWN, ITC_WATCH_SOURCE, ITCOM_OBJECT
from bridge.tccom.interfaces import (
    Answer,
    Interface,
    InterfaceChangedError,
    Method,
    carry_out,
    describe,
    interface,
    known_interface,
    offered,
    stub,
)
from bridge.tccom.module import Module
from tests.unit.tccom.tccom_stories import Calculation, ICalculation


@interface("11111111-0000-4000-8000-000000000002", hides=(ICalculation,))
class ICalculation2(ICalculation, Protocol):
    """A newer version: it does what the old one does, and more."""

    def product(self, a: float, b: float = 1.0) -> Answer[float]: ...


def test_a_declaration_is_its_methods_and_their_types() -> None:
    """Name, methods with typed parameters and defaults, output, bases, and what it hides."""
    info = describe(ICalculation2)
    assert (info.name, list(info.methods)) == ("ICalculation2", ["addition", "subtraction", "product"])
    assert (info.bases, info.hides) == ((describe(ICalculation).id,), (describe(ICalculation).id,))
    product = info.methods["product"]
    assert product.returns is float
    assert msgspec.json.encode(product.bind((2.0,), {})) == b'{"a":2.0,"b":1.0}'
    assert known_interface(info.id) is info
    assert known_interface(ITCOM_OBJECT) is describe(IObject)


PUBLISHED = {
    ICalculation: "7047d8ce5874b02c",
    IObject: "62a50bbb015447e4",
    IDataAreas: "a02594d3a1c991d4",
    IWatchSource: "c929648115c6ded5",
    IObjectServer: "dbe28cc43c0ebbd6",
    ICyclic: "4529db2ee0cb8997",
    ICyclicCaller: "136f3a0792a8fdaf",
    ITask: "98c883f2491baac1",
}


@pytest.mark.parametrize(("declared", "mark"), PUBLISHED.items())
def test_a_fingerprint_is_the_same_in_every_process(declared: Interface[object], mark: str) -> None:
    """Made of names and types alone, it holds wherever the interface is declared. One that differs here has changed: programs
    of this version and of an older one would refuse each other's calls.
    """
    assert describe(declared).fingerprint == mark


@pytest.mark.parametrize("change", ["name", "parameter", "type", "default", "output", "order", "more"])
def test_an_interface_that_changes_needs_a_new_id(change: str) -> None:
    """Whatever a caller could notice is a change; the old declaration stays."""
    iid = "11111111-0000-4000-8000-000000000003"

    @interface(iid)
    class IFirst(Protocol):
        def one(self, a: int) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...

    class Renamed(Protocol):
        def uno(self, a: int) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...

    class OtherParameter(Protocol):
        def one(self, b: int) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...

    class OtherType(Protocol):
        def one(self, a: float) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...

    class OtherDefault(Protocol):
        def one(self, a: int = 0) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...

    class OtherOutput(Protocol):
        def one(self, a: int) -> Answer[str]: ...
        def two(self) -> Answer[None]: ...

    class OtherOrder(Protocol):
        def two(self) -> Answer[None]: ...
        def one(self, a: int) -> Answer[int]: ...

    class More(Protocol):
        def one(self, a: int) -> Answer[int]: ...
        def two(self) -> Answer[None]: ...
        def three(self) -> Answer[None]: ...

    changed = {
        "name": Renamed,
        "parameter": OtherParameter,
        "type": OtherType,
        "default": OtherDefault,
        "output": OtherOutput,
        "order": OtherOrder,
        "more": More,
    }
    with pytest.raises(InterfaceChangedError, match="an id of its own") as failure:
        interface(iid)(changed[change])
    assert failure.value.expected == describe(IFirst).fingerprint
    known = known_interface(iid)
    assert known is not None
    assert known.name == "IFirst"


def test_a_published_interface_is_held_by_its_fingerprint() -> None:
    """Written into the decorator, it refuses a changed declaration even in a process that never saw the old one."""
    mark = describe(ICalculation).fingerprint
    with pytest.raises(InterfaceChangedError):

        @interface("11111111-0000-4000-8000-000000000004", fingerprint=mark)
        class IOther(Protocol):
            def addition(self, a: int, b: int) -> Answer[float]: ...

    assert known_interface("11111111-0000-4000-8000-000000000004") is None


def test_prose_is_no_change() -> None:
    """Docstrings and the interface's name in Python may change."""

    class Point(msgspec.Struct):
        """Where it is."""

        x: float

    @interface("11111111-0000-4000-8000-000000000005")
    class IOne(Protocol):
        def at(self) -> Answer[Point]: ...

    Point.__doc__ = "Where it was."

    @interface("11111111-0000-4000-8000-000000000005")
    class ISame(Protocol):
        """The same."""

        def at(self) -> Answer[Point]:
            """Where."""
            ...

    assert describe(ISame) is describe(IOne)


def test_what_could_not_be_called_over_a_bus_is_no_interface() -> None:
    """Parameters without a type, lists of parameters, results that are no Answer, types that have no plain form, attributes."""

    class Untyped(Protocol):
        def one(self, a) -> Answer[int]: ...  # type: ignore[no-untyped-def] # the mistake the test is about

    class Open(Protocol):
        def one(self, *a: int) -> Answer[int]: ...

    class Bare(Protocol):
        def one(self, a: int) -> int: ...

    class Thing:
        pass

    class Opaque(Protocol):
        def one(self, a: Thing) -> Answer[int]: ...

    class Later(Protocol):
        async def one(self, a: int) -> Answer[int]: ...

    class Attribute(Protocol):
        a: int

    class Property(Protocol):
        @property
        def a(self) -> Answer[int]: ...

    for wrong in (Untyped, Open, Bare, Opaque, Later, Attribute, Property):
        with pytest.raises(TypeError):
            interface("11111111-0000-4000-8000-000000000006")(wrong)


def test_who_offers_a_new_version_offers_the_old_one_too() -> None:
    """Both can be asked for; the newest is named first, the hidden one last."""

    class Both(Calculation, ICalculation2):
        class_id = "11111111-0000-4000-8000-000000000007"

        def product(self, a: float, b: float = 1.0) -> Answer[float]:
            return Answer(a * b)

    ids = list(offered(Both))
    general = {ITC_UNKNOWN, ITCOM_OBJECT, ITC_ADI, ITC_WATCH_SOURCE}
    assert set(ids) == {describe(ICalculation2).id, describe(ICalculation).id, *general}
    assert ids[-1] == describe(ICalculation).id


def test_a_class_that_lacks_a_method_cannot_be_made() -> None:
    """The mistake is told when the class is written, not when somebody calls."""
    with pytest.raises(TypeError, match=r"ICalculation\.addition, ICalculation\.subtraction"):

        class Lazy(Module, ICalculation):
            class_id = "11111111-0000-4000-8000-000000000008"


class _Odd:
    def positive(self) -> Answer[None]:
        return Answer(None, S_FALSE)

    def negative(self) -> Answer[None]:
        return Answer(None, ADS_E_NOTFOUND)

    def refusal(self) -> Answer[None]:
        raise AdsError(ADS_E_NOTFOUND, "gone")

    def broken(self) -> Answer[None]:
        raise KeyError("x")

    def leaving(self) -> Answer[None]:
        raise SystemExit(1)

    def bare(self) -> int:
        return 1


class _Nothing(msgspec.Struct):
    pass


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("negative", ADS_E_NOTFOUND),
        ("refusal", ADS_E_NOTFOUND),
        ("broken", ADS_E_EXCEPTION),
        ("leaving", ADS_E_EXCEPTION),
        ("bare", ADS_E_EXCEPTION),
    ],
)
def test_a_negative_hresult_is_raised(name: str, code: int) -> None:
    """Returned or raised, or an exception that is none of ours: the caller gets an AdsError."""
    with pytest.raises(AdsError) as failure:
        carry_out(_Odd(), Method(name, _Nothing, None), _Nothing())
    assert failure.value.code == code


def test_a_positive_hresult_is_information() -> None:
    """It comes with the answer."""
    assert carry_out(_Odd(), Method("positive", _Nothing, None), _Nothing()).result == S_FALSE


def test_a_stub_binds_its_arguments_before_it_calls() -> None:
    """By position, by name, with defaults; what does not fit never reaches the other side."""
    called: list[tuple[str, bytes]] = []

    def call(method: Method, arguments: msgspec.Struct) -> Answer[object]:
        called.append((method.name, msgspec.json.encode(arguments)))
        return Answer(0)

    calculation = stub(ICalculation, call)
    calculation.addition(1, b=2)
    calculation.subtraction(5)
    with pytest.raises(AdsError) as failure:
        calculation.addition(1)  # type: ignore[call-arg] # the mistake the test is about
    assert failure.value.code == ADS_E_INVALIDPARM
    assert called == [("addition", b'{"a":1,"b":2}'), ("subtraction", b'{"a":5,"b":1}')]
