"""Classes are found by id and by name, in the program and in installed packages."""

from pathlib import Path

import pytest

from bridge.core.hresult import ADS_E_EXISTS, ADS_E_INVALIDCLSID, AdsError
from bridge.tccom.factories import GROUP, Factories
from bridge.tccom.general import IObject
from bridge.tccom.identity import versioned_class_id
from bridge.tccom.module import Module
from bridge.tccom.registered import RegisteredModule
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from bridge.tccom.tasks import Task
from tests.unit.tccom import tccom_stories
from tests.unit.tccom.tccom_stories import Calculation, Caller, ICalculation

PACKAGE = '''
from bridge.tccom.module import Module
from bridge.tccom.tasks import Task

class Pump(Module):
    """Pumps."""
    class_id = "44444444-0000-4000-8000-000000000001"

class Valve(Module):
    class_id = "44444444-0000-4000-8000-000000000002"

class Base(Module):
    """Has no class id: for others to derive from."""
'''


def _install(folder: Path, name: str, entry_points: str, source: str = "") -> None:
    """What pip leaves of an installed package, as far as it matters here."""
    (folder / f"{name}.py").write_text(source)
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{entry_points}\n")


def test_classes_of_installed_packages_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry point names a class or a whole Python module; a broken package does not take the others with it."""
    _install(tmp_path, "tccom_pumps", "all = tccom_pumps", PACKAGE)
    _install(
        tmp_path, "tccom_single", "one = tccom_single:Mixer", PACKAGE.replace("44444444", "55555555").replace("Valve", "Mixer")
    )
    _install(tmp_path, "tccom_broken", "bad = tccom_broken:Nothing\nnone = tccom_broken:Number", "Number = 1\nraise_ = 1/0")
    _install(tmp_path, "tccom_numbers", "number = tccom_numbers:number", "number = 1")
    _install(tmp_path, "tccom_leaver", "leaver = tccom_leaver", "import sys\nsys.exit('no licence')")
    monkeypatch.syspath_prepend(tmp_path)
    factories = Factories()
    assert factories.find("Pump").__doc__ == "Pumps."
    assert [one.__name__ for one in factories.classes()] == ["Mixer", "Pump", "Valve"]
    assert factories.find("{44444444-0000-4000-8000-000000000002}").__name__ == "Valve"
    assert sorted(factories.faults) == ["bad", "leaver", "none", "number"]
    assert "ZeroDivisionError" in factories.faults["bad"]
    with ObjectServer(factories=factories) as server, server.create("Pump", IObject, state=State.OP) as pump:
        assert pump.get_state().value is State.OP


def test_a_class_is_found_by_its_id_or_name() -> None:
    """In any spelling of the id. What nobody has is ADS_E_INVALIDCLSID."""
    factories = Factories(installed=False)
    factories.register(Calculation, Caller, Task)
    factories.register(Calculation)
    assert factories.find("Calculation") is factories.find("{0E0F3A52-9F6E-4F0C-8A5A-0F5C3F4F2B10}") is Calculation
    for key in ("calculation", "", "0e0f3a52-9f6e-4f0c-8a5a-0f5c3f4f2b99"):
        with pytest.raises(AdsError) as failure:
            factories.find(key)
        assert failure.value.code == ADS_E_INVALIDCLSID


def test_two_classes_of_one_name_are_told_apart_by_their_ids() -> None:
    """The name alone is refused, and names both."""

    class Caller(Module):
        class_id = "44444444-0000-4000-8000-000000000003"

    factories = Factories(installed=False)
    factories.register(Caller, tccom_stories.Caller)
    with pytest.raises(AdsError, match=Caller.class_id):
        factories.find("Caller")
    assert factories.find(Caller.class_id) is Caller


def test_two_classes_of_one_id_are_refused() -> None:
    """Also a class that only inherits its id."""

    class Derived(Calculation):
        pass

    factories = Factories(installed=False)
    factories.register(Calculation)
    with pytest.raises(AdsError) as failure:
        factories.register(Derived)
    assert failure.value.code == ADS_E_EXISTS


def test_a_class_without_id_is_created_by_nobody_else() -> None:
    """It cannot be registered; the program that has it may still add an object of it."""

    class Own(Module):
        pass

    with pytest.raises(AdsError) as failure:
        Factories(installed=False).register(Own)
    assert failure.value.code == ADS_E_INVALIDCLSID
    with ObjectServer() as server:
        assert server.object_info(server.add(Own())).class_id == ""


def test_versions_of_a_class_live_side_by_side() -> None:
    """A class with a library id has the class id of its version."""

    class Old(Module):
        class_id = "44444444-0000-4000-8000-000000000004"
        library = "Acme|Pumps|1.0.0.0"

    class New(Module):
        class_id = "44444444-0000-4000-8000-000000000004"
        library = "Acme|Pumps|2.0.0.0"

    factories = Factories(installed=False)
    factories.register(Old, New)
    assert factories.find(versioned_class_id("44444444-0000-4000-8000-000000000004", "Acme|Pumps|2.0.0.0")) is New


def test_a_registered_module_is_in_op_while_its_program_wants_it() -> None:
    """It registers itself and goes to OP when entered; left, it is signed off, and lives on while it is held."""

    class Calculator(RegisteredModule, ICalculation):
        addition = Calculation.addition
        subtraction = Calculation.subtraction
        offset = Calculation.offset
        outputs = Calculation.outputs

    with ObjectServer() as server:
        with Calculator(server, name="calc", object_id=0x71010042, parameters={"offset": 3}) as calculator:
            assert (calculator.object_id, calculator.name, calculator.state) == (0x71010042, "calc", State.OP)
            reference = server.get(0x71010042, ICalculation)
            assert reference.interface.addition(1, 2).value == 6
        assert calculator.state is State.INIT
        assert [one.name for one in server.objects()] == ["ObjectServer"]
        assert reference.interface.addition(1, 2).value == 6
        assert reference.release() == 0
