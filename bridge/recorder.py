"""Bus to file: what a filter takes, as the bytes that came.

Rule 1: a listener drains to memory, one thread of ours writes; the drain thread never touches the disk.
Rule 2: what is lost is in the file, at its place: gaps, what the memory could not hold, payloads that are no events.
Rule 3: the file is flushed per written batch that holds an alarm transition (at most every 5 ms) and every flush_s.
Rule 4: a recorder that cannot write stops loudly: `error` is set, wait() returns, close() raises RecordingError.
Rule 5: a file starts with a keyframe for every logger that answered, so that alarms raised before it are in it.
"""

import platform
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final

from bridge.core import keys
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.text import to_text
from bridge.edges.bus import Bus
from bridge.edges.recording import About, Attachment, Compression, Gap, RecordingError, RecordingWriter, StateFrame, Totals
from bridge.inbox import Dropped
from bridge.listener import (
    BusBack,
    BusLost,
    Heard,
    Item,
    Listener,
    LoggerBack,
    LoggerGone,
    Rejected,
    Snapshot,
    TailUnknown,
    TwoLoggers,
)
from bridge.listener import Gap as MissingHere

QUEUE_EVENTS: Final = 1_000_000
TRANSITION_FLUSH_S: Final = 0.005
BATCH: Final = 4096


class Recorder:
    """Records until closed. A context manager; leaving it finishes the file."""

    def __init__(
        self,
        bus: Bus,
        path: str | Path,
        filter: Expr | str | None = None,
        *,
        realm: str = keys.LIVE,
        target: str | None = None,
        compression: Compression = "zstd",
        flush_s: float = 0.25,
        fsync: bool = False,
        comment: str = "",
        version: str = "",
        attachments: Iterable[Attachment] = (),
        queue_events: int = QUEUE_EVENTS,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Subscribe and create the file. RecordingError when the file exists or cannot be made; filter errors as a Listener's.

        fsync makes every flush wait for the disk. queue_events bounds the memory between bus and disk.
        """
        self._listener = Listener(
            bus,
            filter,
            realm=realm,
            target=target,
            with_state=True,
            queue_events=queue_events,
            resolve_class=resolve_class,
            keep_bytes=True,
        )
        self._realm, self._clock, self._flush_s = realm, clock, flush_s
        self._silent: list[str] = []
        self._closing = False
        self.error: RecordingError | None = None
        expr = self._listener.filter
        about = About(
            started_ns=clock(),
            version=version,
            host=platform.node(),
            realm=realm,
            filter="" if isinstance(expr, Everything) else to_text(expr),
            comment=comment,
        )
        try:
            self._writer = RecordingWriter(path, about=about, attachments=attachments, compression=compression, sync=fsync)
        except BaseException:
            self._listener.close()
            raise
        self.path = self._writer.path
        self._thread = threading.Thread(target=self._run, name=f"record {self.path.name}", daemon=True)
        self._thread.start()

    @property
    def totals(self) -> Totals:
        """What the file holds so far."""
        return self._writer.totals

    @property
    def listener(self) -> Listener:
        """The subscription underneath, for its counters and for waiting until its promise holds."""
        return self._listener

    def _run(self) -> None:
        try:
            self._keyframe()
            flushed_s = time.monotonic()
            dirty = urgent = False
            while True:
                closing = self._closing  # read before the queue is: what came before closing is written
                due_s = flushed_s + (TRANSITION_FLUSH_S if urgent else self._flush_s)
                item = self._listener.get(max(0.0, due_s - time.monotonic()) if dirty else self._flush_s)
                if item is None and closing:
                    break
                written = 0
                while item is not None:
                    urgent |= self._write(item)
                    dirty = True
                    written += 1
                    item = self._listener.get(0) if written < BATCH else None
                now_s = time.monotonic()
                if dirty and now_s - flushed_s >= (TRANSITION_FLUSH_S if urgent else self._flush_s):
                    self._writer.flush()
                    flushed_s, dirty, urgent = now_s, False, False
        except (RecordingError, OSError) as error:
            self.error = error if isinstance(error, RecordingError) else RecordingError(self.path, str(error))
            self._listener.close()

    def _keyframe(self) -> None:
        for state in self._listener.snapshot():
            frame = StateFrame(
                realm=self._realm, target=state.target, session=state.session, seq=state.seq, alarms=state.alarms
            )
            self._writer.add_state(frame, self._clock())
        self._writer.flush()

    def _write(self, item: Item) -> bool:
        """Write one item; True for an alarm transition."""
        match item:
            case Heard(event, element, encoding, arrival_ns):
                key = keys.EventKey(self._realm, event.target, event.event_class, event.is_alarm, event.severity)
                self._writer.add(element, encoding, key, event, arrival_ns)
                return event.is_alarm
            case MissingHere(missing, reason):
                gap = Gap(
                    session=missing.session,
                    key=missing.key,
                    first_key_seq=missing.first,
                    last_key_seq=missing.last,
                    count=missing.count,
                    reason=reason,
                )
                self._writer.add_gap(gap, self._clock())
            case Dropped(count):
                reason = "the memory between bus and disk was full"
                gap = Gap(session="", key="", first_key_seq=0, last_key_seq=0, count=count, reason=reason)
                self._writer.add_gap(gap, self._clock())
            case Rejected(key, raw, reason):
                self._writer.add_rejected(key, "", raw, reason, self._clock())
            case Snapshot(target, session, seq, alarms):
                frame = StateFrame(realm=self._realm, target=target, session=session, seq=seq, alarms=alarms)
                self._writer.add_state(frame, self._clock())
            case TailUnknown(_, session):
                self._silent.append(session)
            case TwoLoggers() | BusLost() | BusBack() | LoggerGone() | LoggerBack():
                pass  # no loss: what each sender sent is recorded under its session
            case _:
                raise TypeError(f"{type(item).__name__} cannot be recorded")
        return False

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until recording has ended by an error; False when the time is up first."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def close(self, settle_s: float = 1.0) -> Path:
        """Ask every sender how far it is, take in what is missing, finish the file; returns its name.

        RecordingError when writing failed, now or before; the active file stays then, readable up to the last flush.
        """
        if not self._closing:
            self._silent.extend(self._listener.settle(settle_s))
            self._listener.close()
            self._closing = True
            self._thread.join()
            if self.error is None:
                try:
                    self._writer.finish(tuple(dict.fromkeys(self._silent)))
                except RecordingError as error:
                    self.error = error
            if self.error is not None:
                self._writer.abandon()
        if self.error is not None:
            raise self.error
        return self.path

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
