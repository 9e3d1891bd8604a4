"""What a recorder tells while it works: which files it began, finished, recovered and deleted, and how it stands.

Rule: as text a piece of news is a line for people, as record() facts for programs.
"""

from pathlib import Path
from typing import Literal, TypeAlias

import msgspec

from bridge.edges import recording

Facts: TypeAlias = dict[str, str | int | bool]


class _News(msgspec.Struct, frozen=True):
    path: Path

    def record(self) -> Facts:
        """The facts, with the name of what happened first."""
        names = (name for name in self.__struct_fields__ if name != "path")
        return {_words(type(self).__name__): str(self.path)} | {name: getattr(self, name) for name in names}


def _words(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).removeprefix("_")


class Recovered(_News, frozen=True):
    """What a crash left is a recording again. kept_as is where what could not be read is kept, "" when there is nothing."""

    messages: int
    lost_bytes: int
    kept_as: str

    @classmethod
    def of(cls, found: recording.Recovered) -> "Recovered":
        """From what a recovery did."""
        return cls(found.path, found.messages, found.lost_bytes, str(found.damaged_path or ""))

    def __str__(self) -> str:
        kept = f"; {self.lost_bytes:,} bytes could not be read, kept in {self.kept_as}" if self.kept_as else ""
        return f"recovered {self.path}: {self.messages:,} messages{kept}"


class NotRecovered(_News, frozen=True):
    """What a crash left could not be recovered; it stays as it is."""

    reason: str

    def __str__(self) -> str:
        return f"warning: {self.path} is not recovered: {self.reason}"


class Began(_News, frozen=True):
    """A file is being written; why: what triggered a capture, else ""."""

    why: str = ""

    def __str__(self) -> str:
        return f"began {self.path}" + (f": {self.why}" if self.why else "")


class Finished(_News, frozen=True):
    """A file has its name. With more, the recording goes on in another one."""

    events: int
    size_bytes: int
    more: bool

    def __str__(self) -> str:
        return f"finished {self.path}: {self.events:,} events, {self.size_bytes:,} bytes"


class Deleted(_News, frozen=True):
    """A file went because the folder may not hold more."""

    size_bytes: int

    def __str__(self) -> str:
        return f"deleted {self.path}: the folder may not hold more"


class NotDeleted(_News, frozen=True):
    """A file should have gone and could not be deleted; the folder holds more than it may."""

    reason: str

    def __str__(self) -> str:
        return f"warning: {self.path} cannot be deleted: {self.reason}"


News: TypeAlias = Recovered | NotRecovered | Began | Finished | Deleted | NotDeleted

State: TypeAlias = Literal["recording", "waiting for a trigger", "paused", "stopped", "failed"]


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """How a recorder stands. file is the one being written, "" between captures; files counts the finished ones.

    missing events were never to be had, error says why a failed recorder stopped.
    """

    state: State
    file: str = ""
    files: int = 0
    events: int = 0
    gaps: int = 0
    missing: int = 0
    rejected: int = 0
    triggers: int = 0
    error: str = ""
