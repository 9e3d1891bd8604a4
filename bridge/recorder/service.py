"""Bus to file: what a choice takes, as the bytes that came.

Rule 1: a listener drains to memory, one thread of ours writes; the drain thread never touches the disk.
Rule 2: what is lost is in the file, at its place: gaps, what the memory could not hold, payloads that are no events.
Rule 3: the file is flushed TRANSITION_FLUSH_S after an alarm transition was written at the latest, and every flush_s.
Rule 4: a recorder that cannot write stops loudly: `error` is set, wait() returns, close() raises RecordingError. What was
flushed stays, and the next recorder of that file or folder recovers it: starting again is how one tells it to go on.
Rule 5: who orders something (a pause, a split, a capture) is answered by the writing thread, when all that came before the
order is written.
"""

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple

from bridge.core import keys
from bridge.core.filters.ast import Expr
from bridge.core.times import NS_PER_S
from bridge.edges.bus import Bus
from bridge.edges.recording import (
    ACTIVE_SUFFIX,
    Attachment,
    Compression,
    RecordingError,
    Totals,
    Viewer,
    leftovers,
    recover,
)
from bridge.edges.recording.folder import Keep
from bridge.edges.recording.recovery import discard_empty
from bridge.listener import Listener
from bridge.notices import Heard, Item
from bridge.recorder.arrivals import Arrivals
from bridge.recorder.capture import Capture, Windows
from bridge.recorder.choice import Choice
from bridge.recorder.explained import explained
from bridge.recorder.files import Files, Split
from bridge.recorder.news import News, NotRecovered, Recovered, State, Status

log: Final = logging.getLogger(__name__)

QUEUE_EVENTS: Final = 1_000_000
TRANSITION_FLUSH_S: Final = 0.005
EARLY: Final = 0.8
"""When a flush begins, as a part of flush_s: so that it has ended by then in spite of a busy moment."""
BATCH: Final = 256
"""After so many items the time is looked at: they are written in a few ms."""
SLACK_NS: Final = NS_PER_S // 4
"""How long after it came an item may still be on its way to the queue."""
ANSWER_S: Final = 10.0
PAUSED: Final = "the recorder was paused"


class Recorder:
    """Records until closed. A context manager; leaving it finishes the file.

    With a capture a file is made only around triggers.
    """

    def __init__(
        self,
        bus: Bus,
        path: str | Path,
        filter: Expr | str | None = None,
        *,
        realm: str = keys.LIVE,
        targets: Sequence[str] = (),
        capture: Capture | None = None,
        split: Split | None = None,
        keep: Keep | None = None,
        compression: Compression = "zstd",
        flush_s: float = 0.25,
        fsync: bool = False,
        comment: str = "",
        version: str = "",
        attachments: Iterable[Attachment] = (),
        viewer: Viewer | None = None,
        queue_events: int = QUEUE_EVENTS,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        told: Callable[[News], None] = lambda news: None,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Subscribe, recover what a crash left, create the file.

        path: one file, ending in .mcap, or a folder, in which files are called after their start; capture and split need a
        folder. RecordingError when the file exists, the folder is another recorder's, or nothing can be written there;
        ValueError for choices that do not go together; filter errors as a Listener's. fsync makes every flush wait for the
        disk. With a viewer what viewers show is beside the events. queue_events bounds the memory between bus and disk. told
        is called, on the writing thread and here, with what became of files; it must be quick.
        """
        path = Path(path)
        if capture is not None and path.suffix == ".mcap":
            raise ValueError(f"{path.name} is one file: captures need a folder")

        def tell(news: News) -> None:
            try:
                told(news)
            except Exception:
                log.exception("telling %s", news)

        choice = self._choice = Choice(filter, targets, None if capture is None else capture.trigger, resolve_class)
        self.path = path
        self.error: RecordingError | None = None
        self._flush_s = EARLY * flush_s
        self._arrivals = Arrivals(clock)
        self._silent: list[str] = []
        self._orders: deque[_Order] = deque()
        self._closing = self._closed = False
        self._ended = threading.Event()  # not join(): one that a signal interrupts takes the thread for ended (Python 3.11)
        self._paused: int | None = None
        self._files = Files(
            path,
            choice,
            about=explained(choice, capture, targets, realm=realm, comment=comment, version=version),
            attachments=attachments,
            compression=compression,
            sync=fsync,
            split=split,
            keep=keep,
            viewer=viewer,
            told=tell,
        )
        try:
            self.listener = Listener(
                bus, choice.listens, realm=realm, with_state=True, queue_events=queue_events, keep_bytes=True
            )
            """The subscription underneath, for its counters and for waiting until its promise holds."""
        except BaseException:
            self._files.close()
            raise
        self._windows = None if capture is None else Windows(capture, choice.fires, _Output(self._files))
        try:
            self._recover(tell)
            for state in self.listener.snapshot():
                self._files.states.take(state)
            if self._windows is None:
                self._files.begin(self._arrivals.last_ns)
        except BaseException:
            self.listener.close()
            self._files.abandon()
            self._files.close()
            raise
        self._status = self._stands()
        threading.Thread(target=self._run, name=f"record {path.name}", daemon=True).start()

    @property
    def status(self) -> Status:
        """How it stands; as of the last flush while it runs."""
        return self._status

    @property
    def totals(self) -> Totals:
        """What the finished files hold together."""
        return self._files.totals

    # Asked for by others: carried out on the writing thread.

    def pause(self) -> None:
        """Record nothing until resume(); how much that was will be in the file as a gap. A capture only ignores triggers.

        RecordingError when it does not record any more; so for what follows.
        """
        self._order(self._pause)

    def resume(self) -> None:
        """Go on, with a keyframe."""
        self._order(self._resume)

    def split(self) -> Path:
        """Go on in another file; returns the old one when it is finished.

        ValueError for a single file, or when none is open.
        """
        finished: list[Future[Path]] = []
        self._order(lambda: finished.append(self._split_now()))
        return finished[0].result(ANSWER_S)

    def trigger(self, why: str = "asked for") -> None:
        """Capture what is around now. ValueError when it is no capture, or is paused."""
        self._order(lambda: self._trigger_now(why))

    def _order(self, carry_out: Callable[[], None]) -> None:
        order = _Order(self._arrivals.now_ns(), carry_out, Future())
        self._orders.append(order)
        if self._ended.is_set():
            self._refuse_orders()
        try:
            order.done.result(ANSWER_S)
        except TimeoutError:
            order.done.cancel()  # who was told that it was not done can rely on it
            raise

    def _refuse_orders(self) -> None:
        while self._orders:
            with contextlib.suppress(IndexError):  # the other thread may have taken the last one
                done = self._orders.popleft().done
                if done.set_running_or_notify_cancel():
                    done.set_exception(self.error or RecordingError(self.path, "is not recorded any more"))

    def _pause(self) -> None:
        if self._paused is None:
            self._paused = 0
            if self._windows is not None:
                self._windows.end()
                self._windows.armed = False

    def _resume(self) -> None:
        if self._windows is not None:
            self._windows.armed = True
        elif self._paused is not None:
            self._tell_pause()
            self._files.keyframe(self._arrivals.last_ns)
        self._paused = None

    def _tell_pause(self) -> None:
        """Write how much a pause left out so far."""
        if self._paused:
            self._files.miss(self._paused, PAUSED, self._arrivals.last_ns)
            self._paused = 0

    def _split_now(self) -> "Future[Path]":
        if self._files.current is None:
            raise ValueError("no file is open")
        self._tell_pause()
        return self._files.split(self._arrivals.now_ns())

    def _trigger_now(self, why: str) -> None:
        if self._windows is None:
            raise ValueError("this recorder writes everything: there is nothing to trigger")
        if self._paused is not None:
            raise ValueError("the recorder is paused")
        self._windows.trigger(self._arrivals.now_ns(), why)

    # The writing thread.

    def _run(self) -> None:
        try:
            self._record()
        except (RecordingError, OSError) as error:
            self._fail(error if isinstance(error, RecordingError) else RecordingError(self.path, error.strerror or str(error)))
        except Exception as error:
            log.exception("recording %s", self.path)
            self._fail(RecordingError(self.path, f"a fault of ours: {type(error).__name__}: {error}"))
        finally:
            self._status = self._stands()
            self._ended.set()
            self._refuse_orders()

    def _fail(self, error: RecordingError) -> None:
        self.error = error
        self._files.abandon()
        self._files.close()
        self.listener.close()

    def _record(self) -> None:
        flushed_s = time.monotonic()
        dirty = urgent = False
        while True:
            closing = self._closing  # read before the queue is: what came before closing is written
            due_s = flushed_s + (TRANSITION_FLUSH_S if urgent else self._flush_s)
            item = self.listener.get(max(0.0, due_s - time.monotonic()) if dirty else self._flush_s)
            if item is None and closing:
                break
            now_ns, orders = self._arrivals.now_ns(), len(self._orders)
            items: list[Item] = []
            while item is not None:
                items.append(item)
                item = self.listener.get(0) if len(items) < BATCH else None
            drained = len(items) < BATCH
            for item, at_ns in zip(items, self._arrivals.times(items, drained=drained), strict=True):
                urgent |= self._take(item, at_ns)
            dirty |= bool(items)
            self._carry_out(orders, None if drained else self._arrivals.last_ns)
            if drained:
                self._tick(now_ns - SLACK_NS)
            now_s = time.monotonic()
            if now_s - flushed_s >= (TRANSITION_FLUSH_S if urgent else self._flush_s):
                self._files.look()
                if dirty:
                    self._files.flush()
                self._status = self._stands()
                flushed_s, dirty, urgent = now_s, False, False
        self._tell_pause()
        owing = self._windows is None or self._windows.misses_tail(self._arrivals.now_ns())
        self._files.end(self._silent if owing else ())
        self._files.close()

    def _carry_out(self, orders: int, up_to_ns: int | None) -> None:
        """Carry out so many orders, as far as all that came before them is written: all, or what came up to a time."""
        for _ in range(orders):
            if up_to_ns is not None and self._orders[0].at_ns > up_to_ns:
                return
            _, carry_out, done = self._orders.popleft()
            if not done.set_running_or_notify_cancel():
                continue
            try:
                carry_out()
            except ValueError as error:
                done.set_exception(error)
            except BaseException as error:
                done.set_exception(error)
                raise
            else:
                self._status = self._stands()
                done.set_result(None)

    def _take(self, item: Item, at_ns: int) -> bool:
        """Deal with one item; True for an alarm transition."""
        if self._windows is not None:
            self._windows.take(item, at_ns)
        elif self._paused is not None and isinstance(item, Heard):
            self._paused += self._choice.takes is None or self._choice.takes(item.event)
            self._files.skip(item)
        else:
            self._tell_pause()
            self._files.write(item, at_ns)
        return isinstance(item, Heard) and item.event.is_alarm

    def _tick(self, now_ns: int) -> None:
        if self._windows is not None:
            self._windows.tick(now_ns)
        elif self._paused is None:
            self._files.tick(now_ns)

    def _stands(self) -> Status:
        files = self._files
        return Status(
            state=self._state_now(),
            file="" if files.current is None else str(files.current),
            files=files.finished,
            events=files.events,
            gaps=files.gaps,
            missing=files.missing,
            rejected=files.rejected,
            triggers=0 if self._windows is None else self._windows.triggers,
            error="" if self.error is None else str(self.error),
        )

    def _state_now(self) -> State:
        if self.error is not None:
            return "failed"
        if self._closed:
            return "stopped"
        if self._paused is not None:
            return "paused"
        return "recording" if self._files.current is not None else "waiting for a trigger"

    # Before and after.

    def _recover(self, tell: Callable[[News], None]) -> None:
        """Finish what a crash left in the folder, or of this file."""
        one = self.path.with_name(self.path.name + ACTIVE_SUFFIX)
        for left in [one] if self.path.suffix == ".mcap" else leftovers(self.path):
            if left.exists() and not discard_empty(left):
                try:
                    tell(Recovered.of(recover(left)))
                except RecordingError as error:
                    tell(NotRecovered(left, error.reason))
        self._files.measure()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until recording has ended by an error; False when the time is up first."""
        return self._ended.wait(timeout_s)

    def close(self, settle_s: float = 1.0) -> Totals:
        """Ask every sender how far it is, take in what is missing, finish the file; what the recording holds.

        RecordingError when writing failed, now or before; the active file stays then, readable up to the last flush.
        """
        if not self._closed:
            if not self._ended.is_set():
                self._silent.extend(self.listener.settle(settle_s))
            self.listener.close()
            self._closing = True
            self._ended.wait()
            self._closed = True
            self._status = self._stands()
        if self.error is not None:
            raise self.error
        return self.totals

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class _Order(NamedTuple):
    at_ns: int
    carry_out: Callable[[], None]
    done: "Future[None]"


class _Output:
    """What a capture does to the files."""

    def __init__(self, files: Files) -> None:
        self.begin, self.write, self.skip, self._files = files.begin, files.write, files.skip, files

    def end(self) -> None:
        self._files.end()
