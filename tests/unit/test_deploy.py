"""What deploy/ offers: a unit that systemd takes, and a plant that is one."""

import shlex
import shutil
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path

import pytest

from bridge.cli.exits import Exit

DEPLOY = Path(__file__).parents[2] / "deploy"
UNIT = DEPLOY / "tcbridge.service"


def test_the_unit_runs_the_plant_beside_it() -> None:
    """Its commands are ours, with a plant that has no fault; wrong usage is not tried again; stopping is given its time."""
    unit = ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str  # type: ignore[method-assign, assignment]
    unit.read(UNIT)
    service = unit["Service"]
    assert service["RestartPreventExitStatus"] == str(int(Exit.USAGE))
    assert float(service["TimeoutStopSec"]) > 3
    check, run = (shlex.split(service[name]) for name in ("ExecStartPre", "ExecStart"))
    assert check == [*run, "--check"]
    assert run[1:] == ["run", "/etc/tcbridge/plant.toml"]
    assert Path(run[0]).name == "tcbridge"
    checked = subprocess.run(
        [sys.executable, "-m", "bridge.cli", "run", str(DEPLOY / "plant.toml"), "--check"], capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stderr


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here to ask about the unit")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    """No line that it does not know. The program itself need not be installed here."""
    here = tmp_path / UNIT.name
    here.write_text(UNIT.read_text().replace("/opt/tcbridge/bin/tcbridge", "/bin/true"))
    verified = subprocess.run(["systemd-analyze", "verify", "--man=no", str(here)], capture_output=True, text=True)
    assert str(here) not in verified.stderr, verified.stderr
    assert UNIT.name not in verified.stderr, verified.stderr
