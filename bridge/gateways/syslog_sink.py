"""Events into the system's log (journald, syslog): one line each, with the priority of their severity.

Rule 1: off until types says messages, alarms or both; then from Verbose upwards, in English (1033): the manual's defaults (5.5,
WindowsEventLog: TypesSupported, MinLogLevel, LogLocaleId).
Rule 2: a line is one line. What a terminal would obey is written as an escape, and a line longer than LINE_BYTES ends in "...".
Rule 3: what a listener says about losses goes into the log too: a log that looks whole must be whole.
Rule 4: a log that cannot be written to stops nothing. Failures are counted, the first of a row is told, and so is the first
line that gets through again. UDP tells nobody when nobody listens.
Rule 5: what has come when it is closed is still written, as far as time allows; what is left is counted.

The line: TARGET KIND CLASS ID: TEXT [SOURCE] TIME, and by whom and why if that is known. Priorities: verbose is debug, info,
warning, err, crit. The system's own time stamp is that of the arrival; ours is the event's.
"""

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable, Sequence
from logging.handlers import SYSLOG_UDP_PORT, SysLogHandler
from socket import socket as Socket
from types import TracebackType
from typing import Final, Literal, Self, TypeAlias

import msgspec

from bridge.core import keys
from bridge.core.catalog import Catalog, language_id
from bridge.core.events import AnyEvent, Event, Severity
from bridge.core.filters.ast import And, Compare, Everything, Expr, Flag, resolve
from bridge.core.times import time_text
from bridge.edges.bus import Bus
from bridge.listener import Heard, Item, Listener, Snapshot
from bridge.notices import Loss, Notice
from bridge.texts import Texts

SyslogTypes: TypeAlias = Literal["none", "messages", "alarms", "both"]
IDENT: Final = "tcbridge"
"""The name of the program in each line."""
LINE_BYTES: Final = 2048
"""What every syslog receiver should take in one datagram, priority and all (RFC 5426, 3.2)."""
WRITE_S: Final = 2.0
_LEVELS: Final = {
    Severity.VERBOSE: logging.DEBUG,
    Severity.INFO: logging.INFO,
    Severity.WARNING: logging.WARNING,
    Severity.ERROR: logging.ERROR,
    Severity.CRITICAL: logging.CRITICAL,
}
_KINDS: Final[dict[SyslogTypes, Expr]] = {
    "messages": Flag("is_message"),
    "alarms": Flag("is_alarm"),
    "both": Everything(),
}
_ESCAPES: Final = {
    code: ascii(chr(code))[1:-1]
    for code in (*range(0x20), *range(0x7F, 0xA0), *range(0x200B, 0x2010), *range(0x2028, 0x202F), *range(0x2066, 0x206A))
}


class SyslogAddressError(ValueError):
    """An address that is neither a path nor HOST:PORT."""

    def __init__(self, text: str) -> None:
        self.text = text
        super().__init__(f"{text!r} is no address of a system log; expected a path such as /dev/log, or HOST:PORT")


def syslog_address(text: str) -> str | tuple[str, int]:
    """A path, or host and port (UDP; 514 when none is given)."""
    if text.startswith("/"):
        return text
    host, colon, port = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, port = text, str(SYSLOG_UDP_PORT)
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise SyslogAddressError(text)
    return host, int(port)


class SyslogSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What goes where. filter narrows it further; facility is one of syslog's names; lang a tag or an LCID."""

    types: SyslogTypes = "none"
    min_severity: Severity = Severity.VERBOSE
    lang: str | int = 1033
    filter: Expr = Everything()
    address: str = "/dev/log"
    facility: str = "user"
    ident: str = IDENT


class SyslogCounters(msgspec.Struct):
    """Lines written, lines that could not be, and what closing left unread."""

    written: int = 0
    failed: int = 0
    left: int = 0


class _Handler(SysLogHandler):
    """Keeps the error that the library would print."""

    error: BaseException | None = None
    socket: Socket | None

    def handleError(self, record: logging.LogRecord) -> None:
        self.error = sys.exception()


class SyslogSink:
    """Writes events of a realm into the system's log. A context manager; run() writes until close()."""

    def __init__(
        self,
        bus: Bus,
        settings: SyslogSettings,
        *,
        realm: str = keys.LIVE,
        target: str | None = None,
        texts: Texts | None = None,
        catalog: Catalog | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        on_trouble: Callable[[str], None] | None = None,
    ) -> None:
        """texts finds the texts of classes that catalog does not have. on_trouble is told when writing fails, and works again.

        SyslogAddressError, LanguageError or ValueError for settings that cannot be; UnknownClassError for the filter's.
        """
        if settings.facility not in SysLogHandler.facility_names:
            raise ValueError(f"no facility {settings.facility!r}; one of {', '.join(SysLogHandler.facility_names)}")
        self.settings, self.counters = settings, SyslogCounters()
        self._lang = language_id(settings.lang)
        self._texts, self._catalog = texts, catalog if catalog is not None else Catalog()
        self._on_trouble = on_trouble
        self._failing = False
        self._until_s = float("inf")
        self._running = False
        self._done = threading.Event()
        self._turn = threading.Lock()
        self._handler: _Handler | None = None
        self._listener: Listener | None = None
        address = syslog_address(settings.address)
        if settings.types == "none":
            return
        handler = _Handler(address, facility=SysLogHandler.facility_names[settings.facility])
        handler.ident = f"{settings.ident}: "
        handler.append_nul = False
        self._handler = handler
        try:
            self._listener = Listener(bus, _chosen(settings, resolve_class), realm=realm, target=target)
        except BaseException:
            handler.close()
            raise

    def run(self) -> None:
        """Write what comes until close(); returns at once when the sink is off."""
        self._running = True
        try:
            self._write_all()
        finally:
            self._done.set()

    def _write_all(self) -> None:
        while self._listener is not None and (item := self._listener.get()) is not None:
            if time.monotonic() < self._until_s:
                self.write(item)
            else:
                self.counters.left += 1

    def write(self, item: Item) -> bool:
        """Write one event or notice; whether there was nothing to write, or it was handed over."""
        if isinstance(item, Heard):
            item = item.event
        if isinstance(item, Event):
            return self._hand_over(item.severity, self.line(item))
        if isinstance(item, Snapshot):
            raise TypeError("a snapshot is for recorders")
        severity = Severity.WARNING if isinstance(item, Loss) else Severity.INFO
        return severity < self.settings.min_severity or self._hand_over(severity, _notice_line(item))

    def line(self, event: AnyEvent) -> str:
        """The line of an event, without priority and name of the program."""
        known = self._catalog if self._texts is None else self._texts.catalog_for((event,))
        head = f"{event.target} {event.kind} "
        if event.event_class in known:
            head += f"{known.class_name(event.event_class, self._lang)} {event.event_id}: "
        parts = [head + known.event_text(event, self._lang)]
        if source := _source(event):
            parts.append(f"[{source}]")
        parts.append(time_text(event.time_ns, 3))
        if event.operator:
            parts.append(f"by {event.operator}")
        if event.comment:
            parts.append(f"({event.comment})")
        return _one_line(" ".join(parts))

    def _hand_over(self, severity: Severity, text: str) -> bool:
        with self._turn:
            return self._handler is not None and self._put(self._handler, severity, text)

    def _put(self, handler: _Handler, severity: Severity, text: str) -> bool:
        level = _LEVELS[severity]
        text = _cut(text, LINE_BYTES - len(f"<191>{handler.ident}".encode()))
        handler.error = None
        with contextlib.suppress(OSError):
            if handler.socket is not None:
                handler.socket.settimeout(max(0.1, min(WRITE_S, self._until_s - time.monotonic())))
        handler.handle(logging.makeLogRecord({"levelno": level, "levelname": logging.getLevelName(level), "msg": text}))
        error: BaseException | None = handler.error
        if error is None:
            self.counters.written += 1
            if self._failing:
                self._tell(f"{self.settings.address} can be written to again")
        else:
            self.counters.failed += 1
            if not self._failing:
                self._tell(f"{self.settings.address} cannot be written to: {error}")
        self._failing = error is not None
        return error is None

    def _tell(self, text: str) -> None:
        if self._on_trouble is not None:
            self._on_trouble(text)

    def close(self, timeout_s: float = 1.0) -> None:
        """Stop listening and write what has come, for timeout_s and one more line at most."""
        if self._handler is None:
            return
        self._until_s = time.monotonic() + timeout_s
        if self._listener is not None:
            self._listener.close()
        if self._running:
            self._done.wait(max(timeout_s, WRITE_S))
        self._write_all()
        with self._turn:
            handler, self._handler = self._handler, None
        if handler is not None:
            handler.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _chosen(settings: SyslogSettings, resolve_class: Callable[[str], Sequence[str]] | None) -> Expr:
    parts = [resolve(settings.filter, resolve_class), _KINDS[settings.types]]
    if settings.min_severity > Severity.VERBOSE:
        parts.append(Compare("severity", ">=", settings.min_severity))
    parts = [part for part in parts if not isinstance(part, Everything)]
    return And(tuple(parts)) if len(parts) > 1 else parts[0] if parts else Everything()


def _source(event: AnyEvent) -> str:
    if event.source_name is not None:
        return event.source_name
    return f"0x{event.source_id:08X}" if event.source_id is not None else event.source_guid or ""


def _notice_line(item: Notice) -> str:
    facts = {name: value for name, value in msgspec.structs.asdict(item).items() if not isinstance(value, bytes)}
    return _one_line(f"{type(item).__name__} {msgspec.json.encode(facts).decode()}" if facts else type(item).__name__)


def _one_line(text: str) -> str:
    return text.translate(_ESCAPES).encode("utf-8", "replace").decode()


def _cut(text: str, size: int) -> str:
    data = text.encode()
    return text if len(data) <= size else data[: size - 3].decode("utf-8", "ignore") + "..."
