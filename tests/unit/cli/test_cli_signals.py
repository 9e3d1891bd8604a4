"""Signals end a program cleanly, and in time even when something is stuck."""

import signal
import subprocess
import sys
import threading
import time

import pytest

from bridge.cli.signals import GRACE_S, clean_end

CLEAN = """
import os, sys, time
from bridge.cli.signals import Interrupted, clean_end
try:
    with clean_end(20):
        try:
            print("ready", flush=True)
            time.sleep(60)
        finally:
            os.kill(os.getpid(), int(sys.argv[1]))
            print("closed", flush=True)
except Interrupted as interrupted:
    sys.exit(interrupted.code)
"""
STUCK = """
import time
from bridge.cli.signals import Interrupted, clean_end
with clean_end(0.3):
    try:
        print("ready", flush=True)
        time.sleep(60)
    except Interrupted:
        time.sleep(60)
"""
DEAF = """
import ctypes
from bridge.cli.signals import clean_end
with clean_end(0.3):
    ctypes.CDLL(None).system(b"echo ready; exec sleep 4")
"""
NUMBERS = [signal.SIGINT, signal.SIGTERM]


def ended(program: str, number: signal.Signals) -> tuple[int, str, float]:
    """Start a program, send it a signal when it is ready: its exit code, what it printed then, and how long it took."""
    command = [sys.executable, "-c", program, str(int(number))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        started_s = time.monotonic()
        process.send_signal(number)
        code = process.wait(10)
        return code, "" if program == DEAF else process.stdout.read(), time.monotonic() - started_s


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_unwinds_the_program(number: signal.Signals) -> None:
    """What is open is closed, a second signal changes nothing, and the exit code is 128 and the signal's number."""
    assert ended(CLEAN, number)[:2] == (128 + number, "closed\n")


@pytest.mark.parametrize(("program", "number"), [(STUCK, signal.SIGTERM), (STUCK, signal.SIGINT), (DEAF, signal.SIGTERM)])
def test_what_is_stuck_is_cut_off(program: str, number: signal.Signals) -> None:
    """A close that hangs, and a library that does not come back, end in time with the code of the signal."""
    code, _, seconds = ended(program, number)
    assert code == 128 + number
    assert seconds < GRACE_S


def test_without_a_signal_everything_is_as_before() -> None:
    """The handlers of the surrounding program are put back, and no thread stays."""
    before = [signal.getsignal(each) for each in NUMBERS]
    with clean_end():
        assert [signal.getsignal(each) for each in NUMBERS] != before
    assert [signal.getsignal(each) for each in NUMBERS] == before
    assert signal.set_wakeup_fd(-1) == -1
    assert "end in time" not in [thread.name for thread in threading.enumerate()]


def test_the_grace_leaves_room_within_three_seconds() -> None:
    """Commands promise to end within 3 s."""
    assert GRACE_S < 3
