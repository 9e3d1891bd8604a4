"""Event class files on disk as a catalog.

Rule 1: a path that cannot be opened is the caller's fault and raises OSError.
Rule 2: what is wrong inside a file is a Problem: the whole classes of that file and all other files are still there.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from bridge.core.catalog import Catalog, EventClass
from bridge.core.tmc import Problem, TmcError, read_classes

SUFFIXES: Final = (".tmc", ".tsproj", ".xti")


def load_catalog(paths: Iterable[Path | str]) -> tuple[Catalog, list[Problem]]:
    """Read .tmc, .tsproj and .xti files, and those below a folder (sorted); where two files know a GUID, the later one counts.

    OSError when a path cannot be read.
    """
    classes: list[EventClass] = []
    problems: list[Problem] = []
    for path in class_files(paths):
        try:
            result = read_classes(path.read_bytes(), str(path))
        except TmcError as error:
            problems.append(Problem(error.file, error.line, error.message))
        else:
            classes += result.classes
            problems += result.problems
    return Catalog(classes), problems


def class_files(paths: Iterable[Path | str]) -> Iterator[Path]:
    """The files that load_catalog() reads, in its order."""
    for path in map(Path, paths):
        if path.is_dir():
            yield from sorted(each for each in path.rglob("*") if each.suffix.lower() in SUFFIXES and each.is_file())
        else:
            yield path
