"""Ctrl-C and SIGTERM: a clean unwinding that ends within three seconds.

Rule 1: the first signal raises Interrupted in the main thread; context managers close what is open. Later ones change nothing.
Rule 2: a watchdog ends the process GRACE_S after the first signal, whatever is stuck. It is a thread woken by the interpreter's
signal pipe, so it works even while the main thread is inside a library that does not return.
"""

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

GRACE_S: Final = 2.5
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """A signal asks the program to end; `code` is the exit code that says so. No Exception, so that only main() ends by it."""

    def __init__(self, number: int) -> None:
        self.number, self.code = number, 128 + number
        super().__init__(signal.Signals(number).name)


@contextmanager
def clean_end(grace_s: float = GRACE_S) -> Iterator[None]:
    """Turn signals into Interrupted while the block runs; only in the main thread."""
    seen = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal seen
        if not seen:
            seen = True
            raise Interrupted(number)

    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def watch() -> None:
        with reader:
            while number := reader.recv(1):
                if number[0] in SIGNALS:
                    time.sleep(grace_s)
                    os._exit(128 + number[0])

    watchdog = threading.Thread(target=watch, name="end in time", daemon=True)
    watchdog.start()
    before = [signal.signal(each, interrupt) for each in SIGNALS]
    pipe = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(pipe)
        writer.close()
        if not seen:  # else the rest of the program, the interpreter's end included, has to be quick and undisturbed
            watchdog.join()
            for each, handler in zip(SIGNALS, before, strict=True):
                signal.signal(each, handler)


def wait_for_signal() -> None:
    """Wait until a signal interrupts; never returns otherwise."""
    threading.Event().wait()
