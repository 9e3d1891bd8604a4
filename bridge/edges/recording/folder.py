"""A folder of recordings: how its files are called, who may write there, and which go when there are too many.

Rule 1: a file is called after its start and its number, 20261122T080000123Z-000001.mcap (UTC, milliseconds), so that names sort
by time. A name that is taken, finished or not, is never given again: the next millisecond is.
Rule 2: one recorder per folder. The folder itself is locked, so nothing is left behind by a crash.
Rule 3: only finished files that are called so are ever deleted, the oldest first.
"""

import contextlib
import os
import re
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from bridge.core.times import NS_PER_S, time_text
from bridge.edges.recording.layout import ACTIVE_SUFFIX, RecordingError
from bridge.edges.recording.writer import lock

_NAME: Final = re.compile(r"\d{8}T\d{9}Z-\d{6,}\.mcap")
_NS_PER_MS: Final = NS_PER_S // 1000


class Keep(msgspec.Struct, frozen=True, kw_only=True):
    """What a folder may hold, the file being written and the one before it included; 0 is no limit."""

    files: int = 0
    size_bytes: int = 0

    def __post_init__(self) -> None:
        if self.files < 0 or self.files == 1 or self.size_bytes < 0:
            raise ValueError("at least two files are kept, and a size is not negative")


class RecordingFolder:
    """A folder that one recorder writes to. A context manager.

    It is made when it is not there. RecordingError when it cannot be, or when a running recorder has it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._held = os.open(self.path, os.O_RDONLY)
        except FileExistsError:
            raise RecordingError(path, "is no folder; a single recording ends in .mcap") from None
        except OSError as error:
            raise RecordingError(path, error.strerror or str(error)) from error
        try:
            lock(self._held, self.path, "is the folder of a running recorder")
            self.measure()
        except BaseException:
            os.close(self._held)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Let another recorder have it."""
        with contextlib.suppress(OSError):
            os.close(self._held)

    def measure(self) -> None:
        """Take note of the finished files that are there."""
        self._files = self._found()

    def new_name(self, start_ns: int, number: int) -> Path:
        """The name of the file `number` that starts then."""
        while True:
            start = time_text(start_ns, 3).translate({ord(mark): None for mark in "-:."})
            path = self.path / f"{start}-{number:06d}.mcap"
            if not os.path.lexists(path) and not os.path.lexists(f"{path}{ACTIVE_SUFFIX}"):
                return path
            start_ns += _NS_PER_MS

    def finished(self, path: Path) -> None:
        """A file of the folder has its name now."""
        self._files[path] = path.stat().st_size

    def over(self, keep: Keep, being_written: Sequence[int]) -> list[Path]:
        """The oldest files that have to go, when files of these sizes are being written too."""
        names = sorted(self._files)
        count, size = len(names) + len(being_written), sum(self._files.values()) + sum(being_written)
        go = []
        for path in names:
            if (not keep.files or count <= keep.files) and (not keep.size_bytes or size <= keep.size_bytes):
                break
            go.append(path)
            count, size = count - 1, size - self._files[path]
        return go

    def delete(self, path: Path) -> int:
        """Delete a finished file; its size. RecordingError when that is refused; it is not tried again then."""
        size = self._files.pop(path)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise RecordingError(path, error.strerror or str(error)) from error
        return size

    def _found(self) -> dict[Path, int]:
        found = {}
        with os.scandir(self.path) as entries:
            for entry in entries:
                if _NAME.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                    found[self.path / entry.name] = entry.stat(follow_symlinks=False).st_size
        return found
