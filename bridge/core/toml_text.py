"""A TOML text from outside: its tables, and the line that each of their keys stands in.

Rule 1: bytes in, values out. What is none, too large or built to be slow is refused: file, line, expected.
Rule 2: Python's reader takes about a second per megabyte, and a time that grows with the square of a key's parts: hence the
        limits. Who reads larger things does not use TOML.
Rule 3: lines are as good as a look at the text allows: what is written inline stands where its table does.
"""

import difflib
import re
import tomllib
from collections.abc import Iterable, Iterator
from typing import Final, TypeAlias

import msgspec

MAX_BYTES: Final = 1_000_000
MAX_PARTS: Final = 16
Path: TypeAlias = tuple[str | int, ...]
"""The way to a key: names of tables, and places in lists of tables."""

_PART: Final = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY: Final = re.compile(rf"(?:^|[\[{{,])[ \t]*(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_PARTS}}}", re.MULTILINE)


class TomlError(ValueError):
    """A text that is refused: file, line, and what was expected."""

    def __init__(self, file: str, line: int, message: str) -> None:
        self.file, self.line, self.message = file, line, message
        super().__init__(f"{file}:{line}: {message}")


class Lines:
    """Where the tables and keys of a text stand."""

    _HEADER: Final = re.compile(r"\s*(\[\[?)([^\[\]]*)\]")
    _KEY: Final = re.compile(r"\s*(?:\"([^\"]*)\"|'([^']*)'|([A-Za-z0-9_-]+))\s*[=.]")
    _PART: Final = re.compile(r"\"([^\"]*)\"|'([^']*)'|([A-Za-z0-9_-]+)")

    def __init__(self, text: str) -> None:
        self._places: dict[Path, int] = {}
        counts: dict[Path, int] = {}
        table: Path = ()
        inside = ""
        for number, line in enumerate(text.split("\n"), 1):
            began = inside
            for quotes in re.findall("\"\"\"|'''", line):
                inside = "" if inside == quotes else inside or quotes
            if began:
                continue
            if (header := self._HEADER.match(line)) is not None:
                names = [next(filter(None, part), "") for part in self._PART.findall(header[2])]
                table = ()
                for position, name in enumerate(names, 1):
                    table = (*table, name)
                    if position == len(names) and header[1] == "[[":
                        self._places.setdefault(table, number)
                        counts[table] = counts.get(table, -1) + 1
                    if table in counts:
                        table = (*table, counts[table])
                self._places.setdefault(table, number)
            elif (key := self._KEY.match(line)) is not None:
                self._places.setdefault((*table, next(filter(None, key.groups()), "")), number)

    def of(self, path: Path) -> int:
        """The line of the path or of the nearest table around it."""
        while path and path not in self._places:
            path = path[:-1]
        return self._places.get(path, 1)

    def below(self, path: Path) -> Iterator[str]:
        """The keys of a table as they are spelled, as far as they stand in lines of their own."""
        return (str(place[-1]) for place in self._places if len(place) == len(path) + 1 and place[:-1] == path)


def read(data: bytes, name: str, what: str) -> tuple[dict[str, object], Lines]:
    """The tables of a text, and their lines. `name` is what TomlError calls the file, `what` what it says was expected."""
    if len(data) > MAX_BYTES:
        raise TomlError(name, 1, f"{len(data)} bytes; expected at most {MAX_BYTES} for {what}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TomlError(name, line, "bytes that are no UTF-8; expected a TOML file") from None
    long = _LONG_KEY.search(text)
    if long is not None:
        line = text.count("\n", 0, long.start()) + 1
        raise TomlError(name, line, f"a key of more than {MAX_PARTS} parts; expected {what}")
    try:
        return tomllib.loads(text), Lines(text)
    except RecursionError:
        raise TomlError(name, 1, f"nested too deep; expected {what}") from None
    except ValueError as error:
        found = re.fullmatch(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(error), re.DOTALL)
        reason = found[1] if found else str(error)
        line = int(found[2]) if found and found[2] else text.count("\n") + 1 if found else 1
        column = f" in column {found[3]}" if found and found[3] else ""
        raise TomlError(name, line, f"{reason}{column}; expected a TOML file") from None


def unknown_key(key: str, keys: Iterable[str]) -> str:
    """What to say about a key that is none: the one that was probably meant, or those that there are."""
    known = list(keys)
    near = difflib.get_close_matches(key, known, n=1)
    hint = f", did you mean {near[0]!r}?" if near else f"; expected one of {', '.join(known)}"
    return f"unknown key {key!r}{hint}"


_STEP: Final = re.compile(r"\.([^.\[\]]+)|\[([0-9]+)\]|\[\.\.\.\]")


def mistyped(error: msgspec.ValidationError, start: Path) -> tuple[Path, str]:
    """Where a value of another type than expected stands, in a table at `start`, and what to say about it."""
    message, _, place = str(error).partition(" - at `$")
    path = start
    for step in _STEP.finditer(place.rstrip("`")):
        if step[1] is None and step[2] is None:
            break
        path = (*path, step[1] if step[1] is not None else int(step[2]))
    message = message.replace("Object missing required field", "no").replace("`", "'")
    key = next((step for step in reversed(path) if isinstance(step, str)), "")
    return path, f"{key}: {message}" if len(path) > len(start) else message
