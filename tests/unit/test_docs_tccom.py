"""The examples of docs/first-module.md are run."""

import re
import runpy
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "first-module.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_module_runs_in_a_program_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first two blocks, one after the other: their own assertions hold, and the refused call is told as the page says."""
    program = tmp_path / "counter.py"
    program.write_text("\n".join(PYTHON[:2]), encoding="utf-8")
    runpy.run_path(str(program))
    said = capsys.readouterr().out
    assert said == "ADS_E_OUTOFRANGE (0x98110734): out of range: the box holds 5\n"
