"""Whether files of one recording are all there: each says its number and the file before and behind it.

Rule: only what is missing between two files is a loss. What came before the first was deleted on purpose (a folder keeps so
many files) or is not asked for, and so is what comes behind the last.
"""

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import msgspec

from bridge.edges.recording.info import RecordingInfo


class MissingFiles(msgspec.Struct, frozen=True):
    """So many files of a recording are missing between two that are there; first is the name of the first of them."""

    after: str
    before: str
    count: int
    first: str

    def __str__(self) -> str:
        files = "1 file is" if self.count == 1 else f"{self.count} files are"
        return f"{files} missing between {self.after} and {self.before}: {self.first or 'the first'} and what follows"


def missing_files(infos: Iterable[RecordingInfo]) -> list[MissingFiles]:
    """What is missing among these files, whatever recordings they are of and in whatever order they come."""
    recordings: dict[str, dict[int, RecordingInfo]] = {}
    for info in infos:
        if info.about.recording and info.about.part:
            recordings.setdefault(info.about.recording, {})[info.about.part] = info
    found = []
    for parts in recordings.values():
        numbers = sorted(parts)
        for number, following in pairwise(numbers):
            if following != number + 1:
                after, before = Path(parts[number].path).name, Path(parts[following].path).name
                found.append(MissingFiles(after, before, following - number - 1, parts[number].totals.next_file))
    return found
