"""`tcbridge run` as a user runs it: a plant with a module of a package that pip has installed into a fresh environment."""

import base64
import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import sysconfig
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.edges.bus import BusConfig
from bridge.edges.recording import RecordedEvent, read_events, summary

ROOT = Path(__file__).parents[2]
WAIT_S = 60.0
END_S = 3.0

MODULE = '''
"""A module of somebody else."""

from bridge.host import IEventLog
from bridge.tccom import InterfacePointer, Module, Parameter

MESSAGES = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


class Conveyor(Module):
    """Tells that it runs, and fails where it is told to."""

    class_id = "0d2f4f6e-7c5b-4d0f-9f6e-5b8f6f1d7a01"
    fails = Parameter(0x1, str, default="")
    log = InterfacePointer(0x2, IEventLog)

    def _step(self, name: str) -> None:
        if self.fails == name:
            raise RuntimeError("made to fail")

    def on_ip(self) -> None:
        self._step("IP")

    def on_ps(self) -> None:
        self._step("PS")

    def on_so(self) -> None:
        self._step("SO")
        self.log.send_message(MESSAGES, 1, "info", self.object_id, self.name)

    def on_os(self) -> None:
        self._step("OS")

    def on_sp(self) -> None:
        self._step("SP")

    def on_pi(self) -> None:
        self._step("PI")
'''

PLANT = """
[settings]
target = "plc1"
scouting_group = "{group}"

[[modules]]
name = "Lines"
class = "Listener"
parameters = {{ path = "lines.jsonl" }}

[[modules]]
name = "Conveyor"
class = "Conveyor"
object_id = 0x71010007
parameters = {{ fails = "{fails}" }}
pointers = {{ log = "Log" }}

[[modules]]
name = "Night"
class = "Recorder"
parameters = {{ path = "night.mcap" }}

[[modules]]
name = "Other log"
class = "Logger"
parameters = {{ target = "plc2" }}

[[modules]]
name = "Log"
class = "Logger"
parameters = {{ cache = "plc1.db" }}
"""
ORDER = ["Other log", "Log", "Night", "Lines", "Conveyor"]


def wheel(folder: Path) -> Path:
    """A package as its author would publish it: one Python module, and the entry point that offers its classes."""
    about = "acme_modules-1.0.dist-info"
    files = {
        "acme_modules.py": MODULE,
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: acme-modules\nVersion: 1.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: by hand\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/entry_points.txt": "[tcbridge.modules]\nacme = acme_modules\n",
    }
    path = folder / "acme_modules-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as packed:
        record = ""
        for name, text in files.items():
            packed.writestr(name, text)
            digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()
            record += f"{name},sha256={digest},{len(text.encode())}\n"
        packed.writestr(f"{about}/RECORD", f"{record}{about}/RECORD,,\n")
    return path


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment that has tcbridge, its dependencies and the package, and no line of code of ours for it."""
    folder = tmp_path_factory.mktemp("fresh")
    python = folder / "venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True, timeout=WAIT_S)
    [site] = (folder / "venv" / "lib").glob("python*/site-packages")
    (site / "tcbridge.pth").write_text(f"{ROOT}\n{sysconfig.get_path('purelib')}\n")
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-index", "--no-deps", "--quiet"]
    subprocess.run([*pip, str(wheel(folder))], check=True, timeout=WAIT_S, cwd=folder)
    assert (site / "acme_modules.py").exists()
    return python


class Running:
    """A plant in a program of its own."""

    def __init__(self, python: Path, folder: Path, config: BusConfig, fails: str) -> None:
        self.folder = folder
        self._python = python
        (folder / "plant.toml").write_text(PLANT.format(group=config.scouting_group, fails=fails))
        self._environ = {name: value for name, value in os.environ.items() if not name.startswith(("TCBRIDGE_", "PYTHON"))}
        self._group = config.scouting_group
        self.steps: list[tuple[str, str]] = []
        with (folder / "stderr").open("w") as stderr:
            self.process = subprocess.Popen(
                self._command("run", "plant.toml", "--json"),
                cwd=folder,
                env=self._environ,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
            )

    def run(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """A command of the same environment, to its end."""
        return subprocess.run(
            self._command(*arguments),
            cwd=self.folder,
            env=self._environ,
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )

    def _command(self, *arguments: str) -> list[str]:
        return [str(self._python), "-m", "bridge.cli", *arguments]

    def until(self, key: str) -> dict[str, object]:
        """Take note of what it tells until a line has this key, and return that line."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            told: dict[str, object] = json.loads(line)
            if key in told:
                return told
            self.steps.append((str(told["module"]), str(told["text"])))
        raise AssertionError(f"it ended without {key}: {self.steps}")

    def modules(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """A `tcbridge modules` command, from another process."""
        return self.run("modules", *arguments, "--target", "plc1", "--scouting-group", self._group)

    def stop(self) -> int:
        """SIGTERM; the exit code, which must come in time."""
        begun = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        self.until("stopped")
        code: int = self.process.wait(WAIT_S)
        assert time.monotonic() - begun < END_S
        return code


@contextlib.contextmanager
def running(python: Path, folder: Path, config: BusConfig, fails: str = "") -> Iterator[Running]:
    """It is killed at the end if it is still there."""
    plant = Running(python, folder, config, fails)
    with plant.process:
        try:
            yield plant
        finally:
            plant.process.kill()


def recorded(folder: Path) -> list[tuple[str | None, str]]:
    """Module and transition of each step in the recording."""
    items = [item.event for item in read_events(folder / "night.mcap") if isinstance(item, RecordedEvent)]
    return [(event.source_name, event.arguments[1].value) for event in items if event.event_id == 10 and event.target == "plc1"]


def test_a_plant_runs_from_one_file(fresh: Path, tmp_path: Path, bus_config: BusConfig) -> None:
    """Two loggers, a recorder, a listener and a module of an installed package: up in order, seen, called, down in reverse."""
    with running(fresh, tmp_path, bus_config) as plant:
        assert plant.until("ready")["not_up"] == []
        told = [(name, text.split()[1]) for name, text in plant.steps if name != "ObjectServer" and len(name.split()) == 1]
        order = [name for name in ORDER if name != "Other log"]
        assert told == [(name, "IP") for name in order] + [(name, step) for name in order for step in ("PS", "SO")]
        listed = plant.modules("list", "--json")
        found = {row["name"]: row for row in map(json.loads, listed.stdout.splitlines())}
        assert {name: row["state"] for name, row in found.items()} == dict.fromkeys(["ObjectServer", *ORDER], "op")
        assert (found["Conveyor"]["object_id"], found["Log"]["object_id"], found["Other log"]["object_id"]) == (
            0x71010007,
            0x71000101,
            0x71000100,
        )
        assert plant.modules("state", "Conveyor", "safeop").stdout == "Conveyor is in SAFEOP\n"
        assert plant.modules("state", "Conveyor", "op").stdout == "Conveyor is in OP\n"
        assert plant.modules("param", "Conveyor", "fails").stdout == "\n"
        refused = plant.modules("param", "Conveyor", "fails", "OS")
        assert (refused.returncode, "ADS_E_INVALIDSTATE" in refused.stderr) == (1, True)
        assert plant.modules("call", "Conveyor", "get_object_id").stdout == f"{0x71010007}\n"
        assert plant.stop() == 0
    night = summary(tmp_path / "night.mcap")
    assert (night.complete, "tcbridge.plant" in night.attachments) == ("yes", True)
    assert plant.run("cat", "night.mcap").stderr == ""
    steps = recorded(tmp_path)
    assert [step for step in steps if step[1] == "IP"] == [(name, "IP") for name in ["ObjectServer", *ORDER]]
    up = [(name, step) for name in ORDER for step in ("PS", "SO")]
    place = steps.index(up[0])
    assert steps[place : place + len(up)] == up
    sent = [json.loads(line) for line in (tmp_path / "lines.jsonl").read_text().splitlines()]
    assert [line["source_id"] for line in sent if line["event_class"].startswith("54cc")] == [0x71010007] * 2


@pytest.mark.parametrize("fails", ["IP", "PS", "SO", "OS", "SP", "PI"])
def test_one_module_that_fails_takes_nobody_with_it(fresh: Path, tmp_path: Path, bus_config: BusConfig, fails: str) -> None:
    """It is told once, with line and traceback, the others run and end in time, the recording is complete."""
    with running(fresh, tmp_path, bus_config, fails) as plant:
        starts = fails in ("IP", "PS", "SO")
        assert plant.until("ready")["not_up"] == (["Conveyor"] if starts else [])
        listed = plant.modules("list", "--json")
        states = {row["name"]: row["state"] for row in map(json.loads, listed.stdout.splitlines())}
        others = dict.fromkeys(["ObjectServer", *ORDER[:-1]], "op")
        left = {"IP": {}, "PS": {"Conveyor": "preop"}, "SO": {"Conveyor": "safeop"}}
        assert states == others | left.get(fails, {"Conveyor": "op"})
        assert plant.stop() == 1
    failures = [text for name, text in plant.steps if name == "Conveyor" and "failed" in text]
    assert len([text for text in failures if text.startswith(f"Conveyor: {fails} failed")]) == 1
    line = MODULE[: MODULE.index("raise RuntimeError")].count("\n") + 1
    assert [text.partition("RuntimeError")[2] for text in failures] == [f": made to fail (acme_modules.py:{line} in _step)"]
    assert not any("not started" in text for _, text in plant.steps)
    assert (tmp_path / "stderr").read_text().count("Traceback") == 1
    assert summary(tmp_path / "night.mcap").complete == "yes"


def test_a_file_with_faults_starts_nothing(fresh: Path, tmp_path: Path, bus_config: BusConfig) -> None:
    """Each fault with its line and what was expected; --check says the same, and the order when there is none."""
    with running(fresh, tmp_path, bus_config) as plant:
        plant.process.kill()
    text = (tmp_path / "plant.toml").read_text()
    (tmp_path / "key.toml").write_text(text.replace("target =", "tarket =", 1))
    (tmp_path / "class.toml").write_text(text.replace('class = "Conveyor"', 'class = "Conveyer"'))
    both = (tmp_path / "key.toml").read_text().replace('class = "Conveyor"', 'class = "Conveyer"')
    (tmp_path / "both.toml").write_text(both)
    for name, expected in (
        (
            "both.toml",
            "both.toml:3: unknown key 'tarket', did you mean 'target'?\n"
            "both.toml:13: class: no module class 'Conveyer'; did you mean 'Conveyor'?",
        ),
        ("key.toml", "key.toml:3: unknown key 'tarket', did you mean 'target'?"),
        ("class.toml", "class.toml:13: class: no module class 'Conveyer'; did you mean 'Conveyor'?"),
    ):
        done = plant.run("run", name)
        assert (done.returncode, done.stderr) == (2, f"tcbridge: {expected}\n")
    done = plant.run("run", "plant.toml", "--check")
    assert done.stdout == f"plant.toml: 5 modules, no faults; they start as {', '.join(ORDER)}\n"
