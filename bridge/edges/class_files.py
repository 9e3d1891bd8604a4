"""Event class files on disk as a catalog: TwinCAT's XML, and our TOML (docs/classes.md).

Rule 1: a path that cannot be opened is the caller's fault and raises OSError.
Rule 2: what is wrong inside a file is a Problem: the whole classes of that file and all other files are still there.
Rule 3: a folder stands for its .tmc, .tsproj, .xti and .classes.toml files. Other TOML files of a folder are somebody else's;
        a .toml file that is named itself is read.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

from bridge.core import class_toml, tmc
from bridge.core.catalog import Catalog
from bridge.core.tmc import Problem, ReadResult, TmcError

SUFFIXES: Final = (".tmc", ".tsproj", ".xti", ".classes.toml")


class ClassFile(msgspec.Struct, frozen=True):
    """A file and what is in it; a refused file has one problem and no classes."""

    path: Path
    result: ReadResult


def load_catalog(paths: Iterable[Path | str]) -> tuple[Catalog, list[Problem]]:
    """Read class files, and those below a folder (sorted); where two files know a GUID, the later one counts.

    OSError when a path cannot be read.
    """
    files = [read_class_file(path) for path in class_files(paths)]
    catalog = Catalog(found for file in files for found in file.result.classes)
    return catalog, [problem for file in files for problem in file.result.problems]


def read_class_file(path: Path) -> ClassFile:
    """One file, with the lines of its classes and events. OSError when it cannot be read."""
    return ClassFile(path, _read(path.suffix, path.read_bytes(), str(path)))


def carried_catalog(files: Iterable[tuple[str, bytes]]) -> tuple[Catalog, list[Problem]]:
    """The classes of files that somebody else carries (a recording), as names and contents; others among them are left out."""
    results = [_read(Path(name).suffix, data, name) for name, data in files if name.lower().endswith((*SUFFIXES, ".toml"))]
    return Catalog(found for result in results for found in result.classes), [
        each for result in results for each in result.problems
    ]


def _read(suffix: str, data: bytes, name: str) -> ReadResult:
    read = class_toml.read_classes if suffix.lower() == ".toml" else tmc.read_classes
    try:
        return read(data, name)
    except TmcError as error:
        return ReadResult((), (Problem(error.file, error.line, error.message),))


def class_files(paths: Iterable[Path | str]) -> Iterator[Path]:
    """The files that load_catalog() reads, in its order."""
    for path in map(Path, paths):
        if path.is_dir():
            yield from sorted(each for each in path.rglob("*") if each.name.lower().endswith(SUFFIXES) and each.is_file())
        else:
            yield path
