"""docs/first-module.md from its plant on: the counter as a package, its plant, and the commands of the page."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.core.module_tmc import read_modules
from tests.conftest import new_port

ROOT = Path(__file__).parents[2]
BLOCKS = re.findall(
    r"^```(\w+)\n(.*?)^```$", (ROOT / "docs" / "first-module.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
)
PYTHON = [text for kind, text in BLOCKS if kind == "python"]
TOML = [text for kind, text in BLOCKS if kind == "toml"]
SHELL = [text for kind, text in BLOCKS if kind == "sh"]
WAIT_S = 60


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """The environment in which the package of the page is installed: its module and its entry point are on the path."""
    project = tomllib.loads(TOML[0])["project"]
    site = tmp_path / "site"
    info = site / f"{project['name']}-{project['version']}.dist-info"
    info.mkdir(parents=True)
    (site / "counter.py").write_text(PYTHON[0], encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    rows = [
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in points.items())
        for group, points in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(rows))
    (tmp_path / "plant.toml").write_text(TOML[1], encoding="utf-8")
    environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
    return environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{site}", "TCBRIDGE_SCOUTING_GROUP": f"224.0.0.224:{new_port()}"}


@pytest.fixture
def tcbridge(tmp_path: Path, installed: dict[str, str]) -> Callable[[str], str]:
    """Run a command line of the page: what it prints."""

    def run(line: str) -> str:
        command = [sys.executable, "-m", "bridge.cli", *shlex.split(line)[1:]]
        done = subprocess.run(command, cwd=tmp_path, env=installed, capture_output=True, text=True, timeout=WAIT_S, check=False)
        assert (done.returncode, done.stderr) == (0, ""), line
        return done.stdout

    return run


def test_the_plant_of_the_page_runs_and_is_called(
    tmp_path: Path, installed: dict[str, str], tcbridge: Callable[[str], str]
) -> None:
    """The package is found by its entry point; every command of the page does what it says."""
    (start,) = SHELL[0].split("\n")[:-1]
    with subprocess.Popen(
        [sys.executable, "-m", "bridge.cli", *shlex.split(start)[1:]],
        cwd=tmp_path,
        env=installed,
        stdout=subprocess.PIPE,
        text=True,
    ) as plant:
        try:
            assert plant.stdout is not None
            assert plant.stdout.readline() == "plant plc1 in realm live is ready: 2 modules\n"
            rows, counted, _, described = map(tcbridge, SHELL[1].splitlines())
            assert ["Box", "Counter", "OP"] in [row.split()[1:4] for row in rows.splitlines()]
            assert json.loads(counted) == 3
            assert json.loads(tcbridge("tcbridge modules param Box limit --target plc1")) == 10
            assert described == "counter.tmc: 1 modules\n"
            plant.send_signal(signal.SIGTERM)
            assert plant.wait(WAIT_S) == 0
        finally:
            plant.kill()
    found = read_modules((tmp_path / "counter.tmc").read_bytes())
    assert found.module("Counter").implements("ICounter")
    assert [method.name for method in found.interfaces[0].methods] == ["count", "reset"]
