"""Texts where no file is: a class is defined in one process and shown in others, in German and English."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from bridge.edges.bus import BusConfig

ROOT = Path(__file__).parents[2]
DEADLINE_S = 60.0
CLASSES = """
[[classes]]
name = "Pump"
display_text = "Pumps"
translations = { de-DE = "Pumpen" }

[[classes.events]]
id = 1
name = "RanDry"
severity = "error"
display_text = "Pump {0} ran dry after {1,f} h"
translations = { de-DE = "Pumpe {0} lief nach {1,f} h trocken" }
"""
PROGRAM = f"""
import sys
from bridge import BusConfig, Publisher, open_bus
from bridge.core.catalog import Catalog
from bridge.core.class_toml import read_classes
from bridge.texts import ClassOffer

result = read_classes({CLASSES!r}.encode())
(pump,) = result.classes
with (
    open_bus(BusConfig(scouting_group=sys.argv[1])) as bus,
    ClassOffer(bus, "plc1", Catalog([pump])),
    Publisher(bus, "plc1") as publisher,
):
    print("ready", pump.guid, flush=True)
    for line in sys.stdin:
        event = pump.events[1]
        publisher.send_message(pump.guid, event.id, event.severity, arguments=(int(line), 1.5))
"""


class Folder:
    """An empty folder without any event class, in which programs run on a bus of their own."""

    def __init__(self, path: Path, group: str) -> None:
        self.path, self.group = path, group
        self.environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
        self.environ["PYTHONPATH"] = str(ROOT)

    @contextmanager
    def start(self, *arguments: str) -> "Iterator[subprocess.Popen[str]]":
        """A Python program; it is killed at the end at the latest."""
        with subprocess.Popen(
            [sys.executable, *arguments],
            cwd=self.path,
            env=self.environ,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        ) as process:
            try:
                yield process
            finally:
                process.kill()

    def command(self, *arguments: str) -> tuple[str, ...]:
        """tcbridge with these arguments on the bus of this folder."""
        return ("-m", "bridge.cli", *arguments, "--scouting-group", self.group)

    def run(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Run a command to its end."""
        command = [sys.executable, *self.command(*arguments)]
        return subprocess.run(
            command, cwd=self.path, env=self.environ, capture_output=True, encoding="utf-8", timeout=DEADLINE_S
        )

    def lines(self, *arguments: str) -> list[str]:
        """Run a command to its end, which must be a good one: its output."""
        done = self.run(*arguments)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.splitlines()


@pytest.fixture
def folder(tmp_path: Path, bus_config: BusConfig) -> Folder:
    """An empty folder and a bus of this test's own."""
    return Folder(tmp_path, bus_config.scouting_group)


def wait_for(process: "subprocess.Popen[str]", word: str, *, stderr: bool = False) -> str:
    """The first line with this word; the test's own timeout bounds the wait."""
    stream = process.stderr if stderr else process.stdout
    assert stream is not None
    for line in stream:
        if word in line:
            return line
    raise AssertionError(f"the output ended without {word!r}")


def test_a_class_from_toml_is_shown_by_listeners_without_files(folder: Folder) -> None:
    """One program defines the class in TOML and sends; two listeners elsewhere print it in German and in English.

    One of them filters by the name of the class, which only the bus knows.
    """
    with ExitStack() as stack:
        program = stack.enter_context(folder.start("-c", PROGRAM, folder.group))
        guid = wait_for(program, "ready").split()[1]
        german, english = (
            stack.enter_context(folder.start(*folder.command("listen", "--lang", language, "--count", "2", *more)))
            for language, more in (("de", ()), ("en", ("--json", "--filter", "event_class = 'Pump'")))
        )
        for listener in (german, english):
            wait_for(listener, "listening", stderr=True)
        assert program.stdin is not None
        for number in ("3", "4"):
            program.stdin.write(f"{number}\n")
        program.stdin.flush()
        first, _ = german.communicate(timeout=DEADLINE_S)
        second, _ = english.communicate(timeout=DEADLINE_S)
        assert [line.partition("message")[2].strip() for line in first.splitlines()] == [
            "Pumpen 1: Pumpe 3 lief nach 1.500000 h trocken  [__main__.<module>]",
            "Pumpen 1: Pumpe 4 lief nach 1.500000 h trocken  [__main__.<module>]",
        ]
        events = [json.loads(line) for line in second.splitlines()]
        assert [event["text"] for event in events] == [f"Pump {n} ran dry after 1.500000 h" for n in (3, 4)]
        assert {(event["class_name"], event["event_class"]) for event in events} == {("Pumps", guid)}
        program.stdin.close()
        assert program.wait(DEADLINE_S) == 0


def test_alarms_and_log_of_a_logger_with_classes(folder: Folder) -> None:
    """Only serve has the file; alarms and log elsewhere show its texts in the asked language."""
    place = folder.path.parent / f"{folder.path.name}-classes"
    place.mkdir()
    file = place / "pump.classes.toml"
    file.write_text(CLASSES, encoding="utf-8")
    with folder.start(*folder.command("serve", "--target", "plc1", "--classes", str(file))) as serve:
        wait_for(serve, "ready")
        folder.lines("raise", "Pump", "RanDry", "--target", "plc1", "--arg", "7", "--arg", "2.5")
        (alarm,) = folder.lines("alarms", "--target", "plc1", "--lang", "de", "--json")
        assert json.loads(alarm)["text"] == "Pumpe 7 lief nach 2.500000 h trocken"
        table = folder.lines("alarms", "--target", "plc1", "--lang", "en")
        assert "Pump 7 ran dry after 2.500000 h" in table[1]
        (alarm,) = folder.lines("alarms", "--target", "plc1", "--filter", "event_class = 'Pump'", "--json")
        assert json.loads(alarm)["class_name"] == "Pumps"
        (entry,) = folder.lines("log", "--target", "plc1", "--lang", "de", "--json")
        assert json.loads(entry)["class_name"] == "Pumpen"
        serve.terminate()
        serve.communicate(timeout=DEADLINE_S)
        assert serve.returncode == 0


def test_commands_name_classes_that_only_the_logger_has(folder: Folder) -> None:
    """raise, confirm --all, clear and send find class and event by their names on the bus, and the severity of the class."""
    place = folder.path.parent / f"{folder.path.name}-classes"
    place.mkdir()
    file = place / "pump.classes.toml"
    file.write_text(CLASSES, encoding="utf-8")
    with folder.start(*folder.command("serve", "--target", "plc1", "--classes", str(file))) as serve:
        wait_for(serve, "ready")
        (line,) = folder.lines("raise", "Pump", "RanDry", "--target", "plc1", "--arg", "7", "--with-confirmation", "--json")
        alarm = json.loads(line)
        assert (alarm["class_name"], alarm["severity"], alarm["raised"]) == ("Pumps", 3, True)
        (line,) = folder.lines("clear", alarm["event_class"], "RanDry", "--target", "plc1", "--lang", "de", "--json")
        assert json.loads(line)["text"].startswith("Pumpe 7 lief nach")
        confirm = folder.run("confirm", "--all", "--filter", "event_class = 'Pump'", "--target", "plc1", "--json")
        assert (confirm.returncode, confirm.stderr) == (0, "1 alarm confirmed\n")
        assert json.loads(confirm.stdout)["class_name"] == "Pumps"
        (line,) = folder.lines("send", "Pump", "RanDry", "--target", "plc1", "--arg", "7", "--json")
        assert (json.loads(line)["class_name"], json.loads(line)["severity"]) == ("Pumps", 3)
        wrong = folder.run("raise", "Pumb", "RanDry", "--target", "plc1")
        assert (wrong.returncode, "unknown event class 'Pumb'" in wrong.stderr) == (2, True), wrong.stderr
