"""The processes of the demo: started with a command that a user could type, heard line by line, ended by their id.

Rule 1: nothing waits without a deadline. A part that fails or is late is a DemoError that names it.
Rule 2: whatever happens, every process that was started is ended: SIGTERM first, SIGKILL when it does not listen.
"""

import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Self

import msgspec

from bridge.cli.options import note
from bridge.config import VARIABLE_PREFIX

DEADLINE_S: Final = 10.0
_END_S: Final = 1.5
_READY: Final = ("listening ", "recording ")


class DemoError(RuntimeError):
    """The demo did not go as it should: which part, and what was expected."""


def _quoted(word: str) -> str:
    return f'"{word}"' if "'" in word else shlex.quote(word)


class Part:
    """One process. `events` counts the events it printed; `last` is the last other line of its output."""

    def __init__(self, name: str, process: subprocess.Popen[str], heard: Callable[[str, dict[str, object]], None]) -> None:
        self.name, self.process = name, process
        self.events = 0
        self.last: dict[str, object] = {}
        self._heard = heard
        self._ready = False
        self._change = threading.Condition()
        self._threads = [
            threading.Thread(target=self._read, args=(stream, take), daemon=True)
            for stream, take in ((process.stdout, self._take), (process.stderr, self._take_note))
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, stream: IO[str], take: Callable[[str], None]) -> None:
        for line in stream:
            take(line.rstrip("\n"))

    def _take(self, line: str) -> None:
        found = msgspec.json.decode(line, type=dict[str, object])
        if "kind" in found:
            self._heard(self.name, found)
        with self._change:
            self.events += "kind" in found
            self._ready |= "ready" in found
            self.last = self.last if "kind" in found else found
            self._change.notify_all()

    def _take_note(self, line: str) -> None:
        if line.startswith(_READY):
            with self._change:
                self._ready = True
                self._change.notify_all()
        else:
            note(f"{self.name}: {line}")

    def _wait(self, done: Callable[[], bool], expected: str) -> None:
        deadline = time.monotonic() + DEADLINE_S
        with self._change:
            while not self._change.wait_for(done, 0.1):
                if self.process.poll() not in (None, 0):
                    raise DemoError(f"{self.name} ended with exit code {self.process.returncode} instead of {expected}")
                if time.monotonic() > deadline:
                    raise DemoError(f"{self.name} was too slow: {expected} took more than {DEADLINE_S:.0f} s")

    def wait_until_ready(self) -> None:
        """Wait for the line that says that it can be used."""
        self._wait(lambda: self._ready, "getting ready")

    def wait_for_events(self, count: int) -> None:
        """Wait until it has printed that many events."""
        self._wait(lambda: self.events >= count, f"printing {count} events")

    def end(self, number: signal.Signals | None = None) -> None:
        """Wait until it has ended well, after a signal if one is given, and all its lines are read."""
        if number is not None:
            self.process.send_signal(number)
        try:
            code = self.process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            raise DemoError(f"{self.name} has not ended after {DEADLINE_S:.0f} s") from None
        for thread in self._threads:
            thread.join(DEADLINE_S)
        if code:
            raise DemoError(f"{self.name} ended with exit code {code}")


class Parts:
    """All processes of a demo. A context manager: leaving it ends those that still run."""

    def __init__(
        self,
        folder: Path,
        options: Sequence[str],
        say: Callable[[str], None],
        heard: Callable[[str, dict[str, object]], None],
    ) -> None:
        """They run in the folder with the options; say() is told their command lines, heard() their events."""
        self._folder, self._options, self._say, self._heard = folder, tuple(options), say, heard
        self._parts: dict[str, Part] = {}
        self._environ = {name: value for name, value in os.environ.items() if not name.startswith(VARIABLE_PREFIX)}
        package = str(Path(__file__).parents[2])
        self._environ["PYTHONPATH"] = os.pathsep.join(filter(None, (package, os.environ.get("PYTHONPATH"))))

    def start(self, name: str, *command: str) -> Part:
        """Start a part: a command of tcbridge, to which the shared options are added."""
        self._say(f"{name:9}  $ tcbridge {' '.join(map(_quoted, command))}")
        process = subprocess.Popen(
            [sys.executable, "-m", "bridge.cli", *command, "--json", *self._options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            cwd=self._folder,
            env=self._environ,
            start_new_session=True,  # Ctrl-C is for us alone: the parts are ended in order
        )
        part = self._parts[name] = Part(name, process, self._heard)
        return part

    def __getitem__(self, name: str) -> Part:
        return self._parts[name]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        running = [part.process for part in self._parts.values() if part.process.poll() is None]
        for process in running:
            process.terminate()
        deadline = time.monotonic() + _END_S
        for process in running:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
