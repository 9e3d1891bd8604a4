"""Errors of programs and of the machine as events: messages of our own class, under a logger's target.

LogMessageType of the manual (5.5).

Rule 1: off unless asked for. "own": what this program logs at warning and above through Python's logging. "host": what the
machine's journal gets at error and above too; that needs journalctl.
Rule 2: what is logged goes where it went before as well.
Rule 3: a storm of errors is not a storm of events: at most BURST in WINDOW_S; the next one says how many were left out.
Rule 4: nothing here waits for anybody and nothing comes round: sending is done on a thread of ours, whose own errors are no
events, and lines that `tcbridge sink syslog` wrote into the journal are passed over.
"""

import contextlib
import logging
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from queue import Empty, Full, Queue
from types import TracebackType
from typing import Final, Literal, NamedTuple, Self, TypeAlias

import msgspec

from bridge.core.events import MessageSent, Severity
from bridge.core.own_events import SYSTEM_ERROR, own_event
from bridge.gateways.syslog_sink import IDENT

Errors: TypeAlias = Literal["none", "own", "host"]
BURST: Final = 20
WINDOW_S: Final = 60.0
WAITING: Final = 1000
JOURNAL: Final = ("journalctl", "--follow", "--lines=0", "--priority=err", "--output=json")
_SEVERITIES: Final = (
    (logging.CRITICAL, Severity.CRITICAL),
    (logging.ERROR, Severity.ERROR),
    (logging.WARNING, Severity.WARNING),
)


class JournalError(RuntimeError):
    """The machine's journal cannot be read; names the command and why."""

    def __init__(self, command: str, reason: str) -> None:
        self.command, self.reason = command, reason
        super().__init__(f"errors of the host cannot be read: {command}: {reason}")


class _Error(NamedTuple):
    severity: Severity
    where: str
    text: str
    time_ns: int


class _Entry(msgspec.Struct):
    """What is read of a journal entry. A message that is no text comes as numbers, one that is too long as null."""

    message: str | list[int] | None = msgspec.field(name="MESSAGE", default=None)
    priority: str = msgspec.field(name="PRIORITY", default="3")
    identifier: str = msgspec.field(name="SYSLOG_IDENTIFIER", default="")
    unit: str = msgspec.field(name="_SYSTEMD_UNIT", default="")
    time_us: str = msgspec.field(name="__REALTIME_TIMESTAMP", default="0")


class _Tap(logging.Handler):
    """Hands records on."""

    def __init__(self, take: Callable[[logging.LogRecord], None]) -> None:
        super().__init__(logging.WARNING)
        self._take = take

    def emit(self, record: logging.LogRecord) -> None:
        if logging.root.handlers == [self] and logging.lastResort is not None:
            logging.lastResort.handle(record)
        try:
            self._take(record)
        except Exception:  # noqa: BLE001 - whatever an argument's own code raises
            self.handleError(record)  # a call that does not fit its text: who logs goes on, as with every other handler


class SystemErrors:
    """Sends errors as events of `target` with `send` until closed. A context manager."""

    def __init__(
        self, target: str, send: Callable[[MessageSent], object], errors: Errors, *, journal: Sequence[str] = JOURNAL
    ) -> None:
        """JournalError when the host's errors are asked for and journalctl is not there."""
        self.left_out = 0
        self._target, self._send = target, send
        self._waiting = Queue[_Error | None](WAITING)
        self._tap: _Tap | None = None
        self._journal: subprocess.Popen[bytes] | None = None
        if errors == "none":
            return
        if errors == "host":
            try:
                self._journal = subprocess.Popen(journal, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
            except OSError as error:
                raise JournalError(journal[0], error.strerror or str(error)) from None
        self._thread = threading.Thread(target=self._run, name="system errors", daemon=True)
        self._thread.start()
        self._tap = _Tap(self._take_record)
        logging.root.addHandler(self._tap)
        if self._journal is not None:
            threading.Thread(target=self._read, args=(self._journal,), name="journal", daemon=True).start()

    def _take_record(self, record: logging.LogRecord) -> None:
        if record.thread != self._thread.ident:
            severity = next(severity for level, severity in _SEVERITIES if record.levelno >= level)
            self._take(severity, record.name, record.getMessage(), time_ns=int(record.created * 1e9))

    def _read(self, journal: "subprocess.Popen[bytes]") -> None:
        for entry in _entries(journal):
            if entry.identifier != IDENT and entry.message is not None:
                text = entry.message if isinstance(entry.message, str) else bytes(entry.message).decode(errors="replace")
                severity = Severity.ERROR if entry.priority == "3" else Severity.CRITICAL
                time_us = int(entry.time_us) if entry.time_us.isdecimal() else 0
                self._take(severity, entry.unit or entry.identifier or "journal", text, time_ns=time_us * 1000)
        code = journal.wait()
        if self._tap is not None:
            self._take(Severity.ERROR, "journal", f"the journal ended with {code}: errors of the host are not seen any more")

    def _take(self, severity: Severity, where: str, text: str, *, time_ns: int = 0) -> None:
        try:
            self._waiting.put_nowait(_Error(severity, where, " ".join(text.split()), time_ns))
        except Full:
            self.left_out += 1

    def _run(self) -> None:
        told = 0
        sent_s: deque[float] = deque(maxlen=BURST)
        while (error := self._waiting.get()) is not None:
            now_s = time.monotonic()
            if len(sent_s) == BURST and now_s - sent_s[0] < WINDOW_S:
                self.left_out += 1
                continue
            sent_s.append(now_s)
            more, told = self.left_out - told, self.left_out
            text = f"({more} more before this) {error.text}" if more else error.text
            event = own_event(self._target, "errors", SYSTEM_ERROR, text, error.where)
            with contextlib.suppress(Exception):  # an error of telling errors is no event
                self._send(msgspec.structs.replace(event, severity=error.severity, time_ns=error.time_ns))

    def close(self, timeout_s: float = 1.0) -> None:
        """Stop taking errors; what waits is sent, if that is done in time."""
        if self._tap is None:
            return
        logging.root.removeHandler(self._tap)
        self._tap = None
        if self._journal is not None:
            self._journal.terminate()
            try:
                self._journal.wait(timeout_s)
            except subprocess.TimeoutExpired:
                self._journal.kill()
        while True:
            try:
                self._waiting.put_nowait(None)
                break
            except Full:
                with contextlib.suppress(Empty):
                    self._waiting.get_nowait()
                    self.left_out += 1
        self._thread.join(timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _entries(journal: "subprocess.Popen[bytes]") -> Iterator[_Entry]:
    with journal:
        for line in journal.stdout or ():
            with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                yield msgspec.json.decode(line, type=_Entry)
