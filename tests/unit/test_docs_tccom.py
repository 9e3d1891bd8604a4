"""The examples of docs/first-module.md are run."""

import re
import runpy
from pathlib import Path

import pytest

from tests.conftest import new_port

PAGE = (Path(__file__).parents[2] / "docs" / "first-module.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def run(tmp_path: Path, *blocks: str) -> None:
    """Run blocks one after the other, on a bus of the test's own: their own assertions hold."""
    program = tmp_path / "counter.py"
    text = "\n".join(blocks).replace("BusConfig()", f'BusConfig(scouting_group="224.0.0.224:{new_port()}")')
    program.write_text(text, encoding="utf-8")
    runpy.run_path(str(program))


def test_the_module_runs_in_a_program_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The refused call is told as the page says."""
    run(tmp_path, *PYTHON[:2])
    assert capsys.readouterr().out == "ADS_E_OUTOFRANGE (0x98110734): out of range: the box holds 5\n"


def test_the_module_is_called_from_another_program(tmp_path: Path) -> None:
    """Over the bus, by the object's id."""
    run(tmp_path, *PYTHON[:3])
