"""Programs that are started, killed and stopped by tests of faults."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
WAIT_S = 60.0


class Program:
    """A program of ours: a command of tcbridge, or Python code. It reads lines and prints lines."""

    def __init__(self, arguments: Sequence[str], *, code: str = "") -> None:
        environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
        environ["PYTHONPATH"] = str(ROOT)
        how = ["-c", code] if code else ["-m", "bridge.cli"]
        self.process = subprocess.Popen(
            [sys.executable, *how, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environ
        )

    def line(self) -> str:
        """The next line it prints; "" when it has ended."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def tell(self, text: str = "") -> None:
        """Send it a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        os.kill(self.process.pid, number)

    def kill(self) -> None:
        """kill -9, and wait until it is gone."""
        self.process.kill()
        self.process.wait(WAIT_S)


@contextlib.contextmanager
def program(*arguments: str, code: str = "") -> Iterator[Program]:
    """A program that is killed at the end if it is still there."""
    started = Program(arguments, code=code)
    with started.process:
        try:
            yield started
        finally:
            started.process.kill()


def eventually(condition: Callable[[], bool], timeout_s: float = WAIT_S) -> bool:
    """Whether the condition holds before time is up."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True
