"""The modules that tcbridge itself has: loggers, recorders, sinks and listeners of a plant.

Rule 1: they are modules like any other: opening is PS, closing is SP, and what fails there leaves the module in PREOP.
Rule 2: a parameter that is not given is the setting of that name, where there is one.
Rule 3: their ids are fixed: the first of each kind has the one of its row in KINDS, the next of its kind the next.
"""

import contextlib
import threading
from collections.abc import Callable
from typing import Final, Literal, NamedTuple, Protocol, TypeAlias

import msgspec

from bridge.config import SeverityName, SyslogTypes, SystemErrors
from bridge.core import codec
from bridge.core.alarms import AlarmKey
from bridge.core.arguments import guid
from bridge.core.events import Event, Severity, Source
from bridge.core.filters.ast import Expr, UnknownClassError
from bridge.core.filters.text import FilterSyntaxError, parse
from bridge.core.hresult import (
    ADS_E_ERROR,
    ADS_E_EXISTS,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSTATE,
    S_FALSE,
    AdsError,
)
from bridge.edges.cache import Cache, CacheError
from bridge.edges.recording import Attachment, Compression, RecordingError, Viewer
from bridge.gateways.syslog_sink import SyslogAddressError, SyslogSettings, SyslogSink
from bridge.gateways.system_errors import JournalError
from bridge.gateways.system_errors import SystemErrors as Errors
from bridge.host.event_log import EventArguments, IEventLog
from bridge.host.surroundings import Surroundings
from bridge.listener import Listener as BusListener
from bridge.logger import EventLogger
from bridge.logger.service import TargetTakenError
from bridge.recorder import Capture, Keep, Split
from bridge.recorder import Recorder as BusRecorder
from bridge.recorder.attached import attached_classes
from bridge.tccom.declarations import Parameter
from bridge.tccom.identity import (
    FIRST_GATEWAY_ID,
    FIRST_LISTENER_ID,
    FIRST_LOGGER_ID,
    FIRST_RECORDER_ID,
    ObjectId,
)
from bridge.tccom.interfaces import DONE, Answer, interface
from bridge.tccom.module import Module
from bridge.tccom.reports import ReportKind
from bridge.texts import Texts

Lowest: TypeAlias = Literal["", SeverityName]
CLOSE_S: Final = 1.0
"""What closing a logger may take, so that a plant ends within 3 s of a signal."""
SETTLE_S: Final = 0.5
JOIN_S: Final = 1.0
PLANT_ATTACHMENT: Final = "tcbridge.plant"
"""The file of the plant, in its recordings. Its name does not end as that of a class file: readers would take it for one."""


class SystemModule(Module):
    """A module of ours; it is created by the host, which tells it where it runs."""

    def __init__(self, around: Surroundings) -> None:
        self.around = around

    def filter_of(self, text: str) -> Expr:
        """The filter of a text; AdsError (ADS_E_INVALIDPARM)."""
        try:
            return parse(text, resolve_class=self.around.catalog.guids)
        except (FilterSyntaxError, UnknownClassError) as error:
            raise AdsError(ADS_E_INVALIDPARM, str(error)) from None


class Logger(SystemModule, IEventLog):
    """The logger of a target: alarms, the log, and what other modules send."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b101"
    thread_safe = True

    target = Parameter(0x1, str, default="", comment="default: the setting")
    cache = Parameter(0x2, str, default="", comment="SQLite file; default: the setting for its target, else memory")
    max_size = Parameter(0x3, int, default=0, comment="bytes; 0: the setting")
    max_events = Parameter(0x4, int, default=0, comment="0: the setting")
    max_age = Parameter(0x5, float, default=0.0, comment="seconds; 0: the setting")
    durable = Parameter(0x6, bool, default=False, comment="answer when safe from a power cut")
    system_errors: Parameter[SystemErrors] = Parameter(0x7, SystemErrors, default="none", comment="errors that become events")  # type: ignore[arg-type]

    logger: EventLogger | None = None

    @property
    def its_target(self) -> str:
        """The target it is the logger of."""
        return self.target or self.around.settings.one_target

    def on_ps(self) -> None:
        """Open cache and logger."""
        settings = self.around.settings
        path = str(self.around.folder / self.cache) if self.cache else ""
        if not path and self.its_target == settings.one_target:
            path = settings.cache
        try:
            cache = self.enter(
                Cache(
                    path or ":memory:",
                    max_bytes=self.max_size or settings.max_size,
                    max_events=self.max_events or settings.max_events or None,
                    max_age_s=self.max_age or settings.max_age or None,
                )
            )
            self.logger = EventLogger(
                self.its_target,
                bus=self.around.bus,
                realm=settings.realm,
                cache=cache,
                encoding=settings.wire_encoding,
                durable=self.durable or settings.durable,
                catalog=self.around.catalog,
                object_id=self.object_id,
                on_read_only=lambda why: self.place.report(ReportKind.BROKEN, code=ADS_E_EXISTS, detail=why),
            )
            self.enter(contextlib.ExitStack()).callback(self._close, self.logger)
            errors = self.system_errors if self.system_errors != "none" else settings.system_errors
            self.enter(Errors(self.its_target, self.logger.report, errors))
        except TargetTakenError as error:
            raise AdsError(ADS_E_EXISTS, str(error)) from None
        except (CacheError, JournalError) as error:
            raise AdsError(ADS_E_ERROR, str(error)) from None

    def _close(self, logger: EventLogger) -> None:
        self.logger = None
        if unsent := logger.close(CLOSE_S):
            self.around.lost += unsent
            self.around.told(f"{self.name}: {unsent:,} events were not sent")

    def on_so(self) -> None:
        """From now on modules may send."""
        self.around.logger_is_up(self._opened())

    def on_os(self) -> None:
        """No more."""
        self.around.logger_is_down(self._opened())

    def _opened(self) -> EventLogger:
        if self.logger is None:
            raise AdsError(ADS_E_INVALIDSTATE, f"{self.name} is in {self.state.name}")
        return self.logger

    # IEventLog.

    def send_message(
        self,
        event_class: str,
        event_id: int,
        severity: SeverityName,
        source_id: ObjectId,
        source_name: str = "",
        arguments: EventArguments = (),
        json_attribute: str = "",
    ) -> Answer[None]:
        self._opened().send_message(
            event_class,
            event_id,
            Severity[severity.upper()],
            source=_source(source_id, source_name),
            arguments=arguments,
            json_attribute=json_attribute,
        )
        return DONE

    def raise_alarm(
        self,
        event_class: str,
        event_id: int,
        severity: SeverityName,
        source_id: ObjectId,
        source_name: str = "",
        arguments: EventArguments = (),
        with_confirmation: bool = False,
        json_attribute: str = "",
    ) -> Answer[None]:
        logger = self._opened()
        created = logger.create_alarm(
            event_class,
            event_id,
            Severity[severity.upper()],
            with_confirmation=with_confirmation,
            source=_source(source_id, source_name),
        )
        if created.alarm.raised:
            return Answer(None, S_FALSE)
        logger.raise_alarm(created.alarm, arguments=arguments, json_attribute=json_attribute)
        return DONE

    def clear_alarm(
        self,
        event_class: str,
        event_id: int,
        source_id: ObjectId,
        source_name: str = "",
        reset_confirmation: bool = False,
    ) -> Answer[None]:
        logger = self._opened()
        key = _alarm_key(logger, event_class, event_id, source_id, source_name)
        if not logger.is_raised(key):
            return Answer(None, S_FALSE)
        logger.clear_alarm(key, reset_confirmation=reset_confirmation)
        return DONE

    def is_raised(self, event_class: str, event_id: int, source_id: ObjectId, source_name: str = "") -> Answer[bool]:
        logger = self._opened()
        return Answer(logger.is_raised(_alarm_key(logger, event_class, event_id, source_id, source_name)))


def _source(object_id: ObjectId, name: str) -> Source:
    return Source(id=object_id, name=name or None)


def _alarm_key(logger: EventLogger, event_class: str, event_id: int, object_id: ObjectId, name: str) -> AlarmKey:
    source = _source(object_id, name)
    return AlarmKey(logger.target, guid(event_class), event_id, source.id, source.name, source.guid)


class RecorderInfo(msgspec.Struct, frozen=True, kw_only=True):
    """How a recorder stands."""

    state: str
    file: str
    files: int
    events: int
    gaps: int
    missing: int


@interface("5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7c002")
class IRecorder(Protocol):
    """What a recorder may be told while it records."""

    def pause(self) -> Answer[None]: ...
    def resume(self) -> Answer[None]: ...
    def split(self) -> Answer[None]: ...
    def capture(self, why: str = "asked for") -> Answer[None]: ...
    def recorder_info(self) -> Answer[RecorderInfo]: ...


class Recorder(SystemModule, IRecorder):
    """The bus in files."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b102"

    path = Parameter(0x1, str, comment="a file that ends in .mcap, or a folder for several")
    filter = Parameter(0x2, str, default="", comment="which events; default: all")
    targets = Parameter(0x3, list[str], default=[], comment="default: every target")
    split_size = Parameter(0x4, int, default=0, comment="a new file when this one has so many bytes")
    split_time = Parameter(0x5, float, default=0.0, comment="a new file after so many seconds")
    keep_files = Parameter(0x6, int, default=0, comment="delete the oldest when there are more")
    keep_size = Parameter(0x7, int, default=0, comment="delete the oldest when they have more bytes together")
    trigger = Parameter(0x8, str, default="", comment="write only what is around events that this filter takes")
    before = Parameter(0x9, float, default=60.0, comment="seconds before a trigger")
    after = Parameter(0xA, float, default=30.0, comment="seconds after a trigger")
    compression: Parameter[Compression] = Parameter(0xB, Compression, default="zstd")  # type: ignore[arg-type]
    comment = Parameter(0xC, str, default="", comment="a text in the file")

    recorder: BusRecorder | None = None

    def on_ip(self) -> None:
        """Refuse filters that are none."""
        self.filter_of(self.filter)
        self.filter_of(self.trigger)

    def on_ps(self) -> None:
        """Subscribe, recover what a crash left, make the file."""
        around, settings = self.around, self.around.settings
        texts = self.enter(Texts(around.bus, realm=settings.realm, catalog=around.catalog))
        trigger = None
        if self.trigger:
            trigger = Capture(trigger=self.filter_of(self.trigger), before_s=self.before, after_s=self.after)
        try:
            recorder = BusRecorder(
                around.bus,
                around.folder / self.path,
                self.filter_of(self.filter),
                realm=settings.realm,
                targets=self.targets,
                capture=trigger,
                split=Split(size_bytes=self.split_size, seconds=self.split_time),
                keep=Keep(files=self.keep_files, size_bytes=self.keep_size),
                compression=self.compression,
                comment=self.comment,
                attachments=[*attached_classes(settings.classes), *self._plant_file()],
                viewer=Viewer(texts.known, settings.lang, around.catalog),
                told=lambda news: around.told(f"{self.name}: {news}"),
            )
        except ValueError as error:
            raise AdsError(ADS_E_INVALIDPARM, str(error)) from None
        except (RecordingError, OSError) as error:
            raise AdsError(ADS_E_ERROR, str(error)) from None
        self.recorder = recorder
        self.enter(contextlib.ExitStack()).callback(self._close, recorder)
        threading.Thread(target=self._watch, args=(recorder,), name=f"watch {self.name}", daemon=True).start()

    def _plant_file(self) -> list[Attachment]:
        plant = self.around.plant
        return [] if plant is None else [Attachment(PLANT_ATTACHMENT, plant.read_bytes(), "application/toml")]

    def _watch(self, recorder: BusRecorder) -> None:
        recorder.wait()
        if recorder.error is not None:
            self.place.report(ReportKind.BROKEN, code=ADS_E_ERROR, detail=str(recorder.error))

    def _close(self, recorder: BusRecorder) -> None:
        self.recorder = None
        self.around.flush()
        try:
            totals = recorder.close(SETTLE_S)
        except RecordingError as error:
            self.around.lost += 1
            raise AdsError(ADS_E_ERROR, str(error)) from None
        if totals.complete != "yes":
            self.around.lost += totals.gap_events or 1
            self.around.told(f"{self.name}: the recording is not complete: {totals.complete}")

    # IRecorder.

    def pause(self) -> Answer[None]:
        return self._told(BusRecorder.pause)

    def resume(self) -> Answer[None]:
        return self._told(BusRecorder.resume)

    def split(self) -> Answer[None]:
        return self._told(BusRecorder.split)

    def capture(self, why: str = "asked for") -> Answer[None]:
        return self._told(lambda recorder: recorder.trigger(why))

    def recorder_info(self) -> Answer[RecorderInfo]:
        status = self._recording().status
        return Answer(msgspec.convert(status, RecorderInfo, from_attributes=True))

    def _told(self, order: Callable[[BusRecorder], object]) -> Answer[None]:
        try:
            order(self._recording())
        except ValueError as error:
            raise AdsError(ADS_E_INVALIDPARM, str(error)) from None
        except RecordingError as error:
            raise AdsError(ADS_E_INVALIDSTATE, str(error)) from None
        return DONE

    def _recording(self) -> BusRecorder:
        if self.recorder is None:
            raise AdsError(ADS_E_INVALIDSTATE, f"{self.name} is in {self.state.name}")
        return self.recorder


class Sink(SystemModule):
    """Events into the log of the system (journald, syslog)."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b103"

    types: Parameter[SyslogTypes] = Parameter(0x1, SyslogTypes, default="both")  # type: ignore[arg-type]
    severity: Parameter[Lowest] = Parameter(0x2, Lowest, default="", comment="default: the setting syslog_severity")  # type: ignore[arg-type]
    address = Parameter(0x3, str, default="", comment="a path, or HOST:PORT; default: the setting syslog_address")
    filter = Parameter(0x4, str, default="", comment="which of these events; default: all")
    target = Parameter(0x5, str, default="", comment="default: every target")
    facility = Parameter(0x6, str, default="user")

    failing = False

    def on_ip(self) -> None:
        """Refuse a filter that is none."""
        self.filter_of(self.filter)

    def on_ps(self) -> None:
        """Begin to write."""
        around, settings = self.around, self.around.settings
        texts = self.enter(Texts(around.bus, realm=settings.realm, catalog=around.catalog))
        try:
            chosen = SyslogSettings(
                types=self.types,
                min_severity=Severity[(self.severity or settings.syslog_severity).upper()],
                lang=settings.lang,
                filter=self.filter_of(self.filter),
                address=self.address or settings.syslog_address,
                facility=self.facility,
            )
            sink = SyslogSink(
                around.bus,
                chosen,
                realm=settings.realm,
                target=self.target or None,
                texts=texts,
                resolve_class=around.catalog.guids,
                on_trouble=self._trouble,
            )
        except (SyslogAddressError, ValueError) as error:
            raise AdsError(ADS_E_INVALIDPARM, str(error)) from None
        self.enter(contextlib.ExitStack()).callback(self._count, sink)
        self.enter(sink)
        self.enter(contextlib.ExitStack()).callback(around.flush)
        threading.Thread(target=sink.run, name=f"sink {self.name}", daemon=True).start()

    def _trouble(self, text: str) -> None:
        """The sink tells the first line of a row that failed, and the first that got through again, in turns."""
        self.failing = not self.failing
        if self.failing:
            self.place.report(ReportKind.BROKEN, code=ADS_E_ERROR, detail=text)
        else:
            self.around.told(f"{self.name}: {text}")

    def _count(self, sink: SyslogSink) -> None:
        if unwritten := sink.counters.failed + sink.counters.left:
            self.around.lost += unwritten
            self.around.told(f"{self.name}: {unwritten:,} lines were not written")


class Listener(SystemModule):
    """Events as lines of JSON, into a file or to the program's output."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b104"

    filter = Parameter(0x1, str, default="", comment="which events; default: all")
    target = Parameter(0x2, str, default="", comment="default: every target")
    path = Parameter(0x3, str, default="", comment="a file to append to; default: the program's output")

    def on_ip(self) -> None:
        """Refuse a filter that is none."""
        self.filter_of(self.filter)

    def on_ps(self) -> None:
        """Subscribe and begin to write."""
        around = self.around
        write: Callable[[str], object] = around.told
        if self.path:
            try:
                file = self.enter((around.folder / self.path).open("a", encoding="utf-8", buffering=1))
            except OSError as error:
                raise AdsError(ADS_E_ERROR, f"{self.path}: {error.strerror or error}") from None
            write = lambda line: file.write(f"{line}\n")  # noqa: E731 # one of two ways to write
        listener = BusListener(around.bus, self.filter_of(self.filter), realm=around.settings.realm, target=self.target or None)
        thread = threading.Thread(target=self._run, args=(listener, write), name=f"listen {self.name}", daemon=True)
        thread.start()
        closing = self.enter(contextlib.ExitStack())
        closing.callback(thread.join, JOIN_S)
        closing.callback(listener.close)
        closing.callback(listener.settle, SETTLE_S)
        closing.callback(around.flush)

    def _run(self, listener: BusListener, write: Callable[[str], object]) -> None:
        while (item := listener.get()) is not None:
            if isinstance(item, Event):
                write(codec.encode(item).decode())
            else:
                write(msgspec.json.encode({"notice": type(item).__name__, **_facts(item)}).decode())


def _facts(item: msgspec.Struct) -> dict[str, object]:
    return {name: value for name, value in msgspec.structs.asdict(item).items() if not isinstance(value, bytes)}


class Kind(NamedTuple):
    """A row of KINDS: kinds that come first are started first and end last."""

    module_class: type[SystemModule]
    first_id: ObjectId


KINDS: Final = (
    Kind(Logger, FIRST_LOGGER_ID),
    Kind(Recorder, FIRST_RECORDER_ID),
    Kind(Sink, FIRST_GATEWAY_ID),
    Kind(Listener, FIRST_LISTENER_ID),
)
"""What a plant file may name as a class, beside Task and the classes of installed packages."""
