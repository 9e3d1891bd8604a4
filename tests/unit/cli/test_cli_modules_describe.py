"""`tcbridge modules describe`: module classes shown and written."""

import json
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core.module_classes import ModuleClass, Parameter, TypeName, Value
from bridge.core.module_tmc import read_modules
from bridge.core.module_tmc_writer import write_modules
from bridge.tccom.tasks import Task

PUMP = ModuleClass(
    guid="11111111-2222-3333-4444-555555555555",
    name="Pump",
    class_id="11111111-2222-3333-4444-555555555555",
    class_factory="Pumps",
    parameters=(Parameter(id=0x10, name="Speed", type=TypeName("LREAL"), default=(Value("1.5"),), online=True),),
)


@pytest.fixture
def pump(tmp_path: Path) -> Path:
    file = tmp_path / "pump.tmc"
    file.write_bytes(write_modules([PUMP]))
    return file


def test_a_file_is_shown(pump: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The class, and a line for each thing it has; for programs, all of it."""
    assert run(["modules", "describe", str(pump)]) == Exit.OK
    title, header, parameter = capsys.readouterr().out.splitlines()
    assert title == f"Pump  class {PUMP.class_id} of Pumps"
    assert header.split() == ["Kind", "Id", "Name", "Type", "More"]
    assert parameter.split(maxsplit=4) == ["parameter", "0x00000010", "Speed", "LREAL", "default 1.5, online"]
    assert run(["modules", "describe", str(pump), "--json"]) == Exit.OK
    assert json.loads(capsys.readouterr().out)["parameters"][0]["name"] == "Speed"


def test_a_class_and_a_file_become_one_file(pump: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Classes of this installation and of files, written as TwinCAT's XML; a file that is there stays."""
    both = tmp_path / "both.tmc"
    assert run(["modules", "describe", "Task", str(pump), "--output", str(both)]) == Exit.OK
    assert capsys.readouterr().out == f"{both}: 2 modules\n"
    found = read_modules(both.read_bytes())
    assert [each.name for each in found.modules] == ["Task", "Pump"]
    assert found.module("Task").class_id == Task.class_id
    assert found.module("Task").implements("ITcCyclicCaller")
    assert found.modules[1] == PUMP
    assert run(["modules", "describe", "Task", "--output", str(both)]) == Exit.USAGE


def test_what_cannot_be_read_is_told(pump: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The whole classes are shown, with code 1, and nothing is written; no such file or class is wrong usage."""
    bad = tmp_path / "bad.tmc"
    bad.write_bytes(pump.read_bytes().replace(b"<PTCID>#x00000010</PTCID>", b""))
    broken = tmp_path / "broken.tmc"
    broken.write_bytes(b"<TcModuleClass>")
    out = tmp_path / "out.tmc"
    for more in ([], ["--output", str(out)]):
        assert run(["modules", "describe", str(bad), str(broken), str(pump), *more]) == Exit.NO
        said = capsys.readouterr()
        assert said.out.startswith("Pump") is not bool(more)
        assert f"{bad}:12: parameter Speed of module Pump: no PTCID" in said.err
        assert f"{broken}:1: " in said.err
    assert not out.exists()
    assert run(["modules", "describe", "gone.tmc"]) == Exit.USAGE
    assert run(["modules", "describe", "Tsk"]) == Exit.USAGE
    expected = "expected a .tmc file or one of Listener, Logger, Recorder, Sink, Task"
    assert f"no module class 'Tsk'; {expected}" in capsys.readouterr().err
