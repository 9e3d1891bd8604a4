"""Where recorded items go: one file after the other, each of which can be read alone.

Rule 1: a file begins with a keyframe per target, the alarms as they were right before its first event. The fold behind it
follows what is written and what is passed over, in the same order, so that no split loses or doubles anything.
Rule 2: a file says in its metadata to which recording it belongs, its number, the file before and the file behind it.
Rule 3: times in the files of a recording never go back, not even from one to the next.
Rule 4: of a split the old file is finished on a thread of its own, while the next one is written already: the disk may take
long, and a transition may not wait for it. An error of that thread is raised by the next look().
"""

import contextlib
import math
import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from bridge.core import keys
from bridge.core.times import NS_PER_S
from bridge.edges.recording import (
    About,
    Attachment,
    Compression,
    Gap,
    RecordingError,
    RecordingWriter,
    Totals,
    Viewer,
)
from bridge.edges.recording.folder import Keep, RecordingFolder
from bridge.edges.recording.tally import joined
from bridge.inbox import Dropped
from bridge.notices import (
    BusBack,
    BusLost,
    Heard,
    Item,
    LoggerBack,
    LoggerGone,
    Rejected,
    Snapshot,
    SuspectsChanged,
    TailUnknown,
    TwoLoggers,
)
from bridge.notices import Gap as MissingHere
from bridge.recorder.choice import Choice
from bridge.recorder.news import Began, Deleted, Finished, News, NotDeleted
from bridge.recorder.states import States

QUEUE_FULL: Final = "the memory between bus and disk was full"
MORE_METADATA: Final = "captured"


class Split(msgspec.Struct, frozen=True, kw_only=True):
    """When a new file begins: when this one has so many bytes (one chunk more at most), or is so old; 0 is never.

    A file without an event is not split by time.
    """

    size_bytes: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if self.size_bytes < 0 or not 0 <= self.seconds < math.inf:
            raise ValueError("a file is split by a size and a time that are not negative")


class _Finishing(NamedTuple):
    """A file that is being finished."""

    writer: RecordingWriter
    events: int
    size_bytes: int
    tails: tuple[str, ...]
    following: str
    done: "Future[Path]"


class Files:
    """The files of one recording. Not for several threads."""

    def __init__(
        self,
        path: Path,
        choice: Choice,
        *,
        about: About,
        attachments: Iterable[Attachment] = (),
        compression: Compression = "zstd",
        sync: bool = False,
        split: Split | None = None,
        keep: Keep | None = None,
        viewer: Viewer | None = None,
        told: Callable[[News], None] = lambda news: None,
    ) -> None:
        """path: a file that ends in .mcap, else a folder, which is held until close(). RecordingError as RecordingFolder's.

        ValueError for a single file that is to be split, and for a number of bytes to keep without files of at most half of it.
        """
        self.path = path
        self.states = States()
        self._choice, self._about, self._told = choice, about, told
        self._attachments, self._compression, self._sync = tuple(attachments), compression, sync
        self._viewer = viewer
        self._split, self._keep = split or Split(), keep or Keep()
        single = path.suffix == ".mcap"
        if single and (self._split != Split() or self._keep != Keep()):
            raise ValueError(f"{path.name} is one file: to have several, name a folder")
        if self._keep.size_bytes and not 0 < self._split.size_bytes <= self._keep.size_bytes // 2:
            raise ValueError("to keep a number of bytes, split by a size of at most half of it")
        self._folder = None if single else RecordingFolder(path)
        self._writer: RecordingWriter | None = None
        self._finishing: _Finishing | None = None
        self._silent: list[str] = []
        self._previous = ""
        self._due_ns = self._last_ns = 0
        self.number = self.finished = self.events = self.gaps = self.missing = self.rejected = 0
        self._in_this = 0
        self.totals = Totals()
        """What the finished files hold together."""

    @property
    def current(self) -> Path | None:
        """The file being written, under the name that it will have."""
        return None if self._writer is None else self._writer.path

    def measure(self) -> None:
        """Count what is in the folder now among what is kept: others may have finished files there."""
        if self._folder is not None:
            self._folder.measure()

    def begin(self, at_ns: int, why: str = "") -> None:
        """Make the next file. RecordingError when it cannot be made."""
        at_ns = max(at_ns, self._last_ns + 1)
        self.number += 1
        path = self.path if self._folder is None else self._folder.new_name(at_ns, self.number)
        self._open(path, at_ns, why)

    def _open(self, path: Path, at_ns: int, why: str = "") -> None:
        about = msgspec.structs.replace(
            self._about,
            started_ns=at_ns,
            part=self.number,
            previous=self._previous,
            more=self._about.more | ({MORE_METADATA: why} if why else {}),
        )
        self._make_room(new_files=1)
        self._writer = RecordingWriter(
            path,
            about=about,
            attachments=self._attachments,
            compression=self._compression,
            sync=self._sync,
            viewer=self._viewer,
        )
        self._in_this = 0
        self._due_ns = at_ns + round(self._split.seconds * NS_PER_S) if self._split.seconds else 0
        self._told(Began(path, why))
        self.keyframe(at_ns)

    def keyframe(self, at_ns: int, target: str | None = None) -> None:
        """Write the state as it is here, of one target or of all."""
        writer = self._open_writer()
        at_ns = max(at_ns, self._last_ns + 1)
        for frame in self.states.frames(self._about.realm, self._choice.takes):
            if target in (None, frame.target):
                self._last_ns = writer.add_state(frame, at_ns)
        writer.flush()

    def write(self, item: Item, at_ns: int) -> None:
        """Write one item as far as the recording takes it, into the next file if this one is full or old."""
        self.tick(at_ns)
        writer = self._open_writer()
        at_ns = max(at_ns, self._last_ns + 1)  # the writer knows the times of its own file only
        self.states.take(item)
        match item:
            case Heard(event, element, encoding):
                takes = self._choice.takes
                if takes is None or takes(event):
                    key = keys.EventKey(self._about.realm, event.target, event.event_class, event.is_alarm, event.severity)
                    try:
                        self._last_ns = writer.add(element, encoding, key, event, at_ns)
                    except (ValueError, TypeError) as error:  # a stranger's event that no recording can hold
                        self._reject(keys.event_key(self._about.realm, event), encoding, element, str(error), at_ns)
                    else:
                        self._in_this += 1
                        self.events += 1
            case MissingHere(missing, reason):
                if self._choice.wants(missing.key):
                    gap = Gap(
                        session=missing.session,
                        key=missing.key,
                        first_key_seq=missing.first,
                        last_key_seq=missing.last,
                        count=missing.count,
                        reason=reason,
                    )
                    self._add_gap(gap, at_ns)
            case Dropped(count):
                self.miss(count, QUEUE_FULL, at_ns)
            case Rejected(key, raw, reason):
                if self._choice.wants(key):
                    self._reject(key, "", raw, reason, at_ns)
            case Snapshot(target=target):
                self.keyframe(at_ns, target)
            case TailUnknown(_, session):
                self._silent.append(session)
            case TwoLoggers() | BusLost() | BusBack() | LoggerGone() | LoggerBack() | SuspectsChanged():
                pass  # no loss: what each sender sent is recorded under its session
            case _:
                raise TypeError(f"{type(item).__name__} cannot be recorded")

    def skip(self, item: Item) -> None:
        """Pass over an item that is not wanted, for the state only."""
        self.states.take(item)

    def miss(self, count: int, reason: str, at_ns: int) -> None:
        """Write that so many events are missing here, nobody knows which."""
        gap = Gap(session="", key="", first_key_seq=0, last_key_seq=0, count=count, reason=reason)
        self._add_gap(gap, max(at_ns, self._last_ns + 1))

    def _add_gap(self, gap: Gap, at_ns: int) -> None:
        self._last_ns = self._open_writer().add_gap(gap, at_ns)
        self.gaps += 1
        self.missing += gap.count

    def _reject(self, key: str, encoding: str, raw: bytes, reason: str, at_ns: int) -> None:
        self._last_ns = self._open_writer().add_rejected(key, encoding, raw, reason, at_ns)
        self.rejected += 1

    def tick(self, at_ns: int) -> None:
        """Go on in another file if it is time to."""
        if self._writer is not None and self._in_this:
            full = self._split.size_bytes and self._writer.size_bytes >= self._split.size_bytes
            if full or (self._due_ns and at_ns >= self._due_ns):
                self.split(at_ns)

    def split(self, at_ns: int) -> "Future[Path]":
        """Finish this file and go on in another one; the future has the name of the old one when it is finished.

        ValueError for a single file.
        """
        if self._folder is None:
            raise ValueError(f"{self.path.name} is one file: to have several, name a folder")
        at_ns = max(at_ns, self._last_ns + 1)
        following = self._folder.new_name(at_ns, self.number + 1)
        done = self._finish((), following.name)
        self.number += 1
        self._open(following, at_ns)
        return done

    def end(self, silent: Iterable[str] = ()) -> None:
        """Finish this file, if one is open. silent: the sessions whose end is not known."""
        if self._writer is not None:
            self._finish(silent, "")
        self._collect()

    def _finish(self, silent: Iterable[str], following: str) -> "Future[Path]":
        """Begin to finish this file; that before it has to be finished first."""
        self._collect()
        writer, tails = self._open_writer(), tuple(dict.fromkeys((*self._silent, *silent)))
        done: Future[Path] = Future()

        def finish() -> None:
            try:
                done.set_result(writer.finish(tails, following))
            except BaseException as error:  # noqa: BLE001 - it is raised again by who collects it
                writer.abandon()
                done.set_exception(error)

        finishing = _Finishing(writer, self._in_this, writer.size_bytes, tails, following, done)
        threading.Thread(target=finish, name=f"finish {writer.path.name}", daemon=True).start()
        self._finishing, self._writer = finishing, None
        self._silent.clear()
        self._previous = writer.path.name
        return done

    def _collect(self) -> None:
        """Wait for the file that is being finished, if there is one. RecordingError when it could not be."""
        finishing, self._finishing = self._finishing, None
        if finishing is None:
            return
        path = finishing.done.result()
        self.finished += 1
        totals = msgspec.structs.replace(finishing.writer.totals, unknown_tails=finishing.tails)
        self.totals = joined(self.totals, totals)
        if self._folder is not None:
            self._folder.finished(path)
        self._told(Finished(path, finishing.events, os.path.getsize(path), bool(finishing.following)))

    def look(self) -> None:
        """Take note of a file that is finished by now. RecordingError when it could not be."""
        if self._finishing is not None and self._finishing.done.done():
            self._collect()

    def flush(self) -> None:
        """Hand what was written to the operating system, and see to it that the folder holds no more than it may."""
        if self._writer is not None:
            self._writer.flush()
            self._make_room()

    def _make_room(self, new_files: int = 0) -> None:
        if self._folder is None or self._keep == Keep():
            return
        being_written = [0] * new_files if self._writer is None else [self._writer.size_bytes]
        if self._finishing is not None:
            being_written.append(self._finishing.size_bytes)
        for path in self._folder.over(self._keep, being_written):
            try:
                self._told(Deleted(path, self._folder.delete(path)))
            except RecordingError as error:
                self._told(NotDeleted(path, error.reason))

    def abandon(self) -> None:
        """Leave the open file as it is, readable up to the last flush."""
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None
        with contextlib.suppress(OSError):  # what is wrong is known already
            self._collect()

    def close(self) -> None:
        """Let another recorder have the folder."""
        if self._folder is not None:
            self._folder.close()

    def _open_writer(self) -> RecordingWriter:
        if self._writer is None:
            raise RecordingError(self.path, "no file is open")
        return self._writer
