"""How the cache file is opened, and whose turn it is to use it.

Rule 1: a file that is not ours, is damaged, newer than this program or in use is refused and never overwritten. move_aside()
renames one, and only when somebody asks for it.
Rule 2: within a process a file is opened once, and only by SQLite: closing a second file handle would drop SQLite's lock.
Rule 3: one connection; who uses it holds the turn, for one transaction or one page of rows.
"""

import contextlib
import itertools
import os
import sqlite3
import stat
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

from bridge.edges.cache.migrations import APPLICATION_ID, MIGRATIONS, VERSION

_MAGIC: Final = b"SQLite format 3\0"
_MEMORY: Final = ":memory:"

Parameter: TypeAlias = int | float | str | bytes
"""What a ? in SQL stands for."""


class CacheError(RuntimeError):
    """The cache cannot be opened, read or written; `path` says which, `reason` why, `code` is SQLite's name for it or "".

    bad: the file is damaged or another program's, so that no later try will open it.
    """

    def __init__(self, path: str, reason: str, code: str = "", *, bad: bool = False) -> None:
        self.path, self.reason, self.code, self.bad = path, reason, code, bad
        super().__init__(f"cache {path}: {reason}" + (f" ({code})" if code else ""))


def cache_error(path: str, error: sqlite3.Error) -> CacheError:
    """SQLite's error as ours."""
    return CacheError(path, str(error), getattr(error, "sqlite_errorname", ""))


def _look(path: str) -> bool:
    """Whether the file is new or empty. CacheError when it is another program's, told from its first bytes without opening it.

    The application id of our files is in their first page from their first moment, because it is written before WAL begins.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise CacheError(path, "is no cache: not a file")
        with Path(path).open("rb") as file:
            head = file.read(100)
    except FileNotFoundError:
        return True
    except (OSError, ValueError) as error:
        raise CacheError(path, f"cannot be read: {error}") from None
    if not head:
        return True
    if len(head) < 100 or not head.startswith(_MAGIC):
        raise CacheError(path, "is no cache: not an SQLite file", bad=True)
    if (found := int.from_bytes(head[68:72], "big")) != APPLICATION_ID:
        raise CacheError(path, f"is no cache: an SQLite file of another program (application id {found:#x})", bad=True)
    return False


def _number(connection: sqlite3.Connection, pragma: str) -> int:
    (value,) = connection.execute(f"PRAGMA {pragma}").fetchone()
    return int(value)


class CacheFile:
    """A connection that is alone on its file, lent to one thread at a time. close() gives the file free again."""

    def __init__(self, path: str, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection: sqlite3.Connection | None = connection
        self._gate, self._lock = threading.Lock(), threading.Lock()
        self._identity = None if path == _MEMORY else _identity(path)
        _in_use.add(self._identity)

    @contextmanager
    def turn(self) -> Iterator[sqlite3.Connection]:
        """The connection for as long as the block lasts. CacheError when closed.

        Who waits at the gate is next, so that a busy writer does not starve the readers.
        """
        with self._gate:
            self._lock.acquire()
        try:
            if self._connection is None:
                raise CacheError(self.path, "is closed")
            yield self._connection
        finally:
            self._lock.release()

    def read(self, text: str, parameters: Sequence[Parameter | None] = ()) -> list[Any]:
        """All rows of a SELECT. CacheError when closed or damaged."""
        with self.turn() as connection:
            try:
                return connection.execute(text, parameters).fetchall()
            except sqlite3.Error as error:
                raise cache_error(self.path, error) from None

    def close(self) -> None:
        """Close the connection; what is committed stays, also when SQLite cannot tidy up."""
        with self.turn() as connection, _opening:
            self._connection = None
            connection.close()
            _in_use.discard(self._identity)


_opening: Final = threading.Lock()
_in_use: Final[set[tuple[int, int] | None]] = set()


def _identity(path: str) -> tuple[int, int] | None:
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def open_file(path: str) -> CacheFile:
    """Open or create the cache at a path or ":memory:", alone (WAL without shared memory), checked and migrated.

    CacheError: not a cache, damaged, written by a newer program, in use, or not writable. WAL's shared memory is avoided
    because on a full disk it kills the process with SIGBUS (measured); with an exclusive lock there is none.
    """
    with _opening:
        if path != _MEMORY and (identity := _identity(path)) is not None and identity in _in_use:
            raise CacheError(path, "is in use by another Cache of this process")
        return CacheFile(path, _open(path))


def _open(path: str) -> sqlite3.Connection:
    new = path == _MEMORY or _look(path)
    try:
        connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    except (sqlite3.Error, ValueError) as error:
        raise CacheError(path, f"cannot be opened: {error}") from None
    try:
        _prepare(connection, path, new)
    except sqlite3.Error as error:
        connection.close()
        name = getattr(error, "sqlite_errorname", "")
        if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
            raise CacheError(path, "is in use by another process", name) from None
        if name.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")):
            raise CacheError(path, f"is damaged: {error}", name, bad=True) from None
        raise CacheError(path, f"cannot be opened: {error}", name) from None
    except BaseException:
        connection.close()
        raise
    return connection


def _prepare(connection: sqlite3.Connection, path: str, new: bool) -> None:
    execute = connection.execute
    execute("PRAGMA locking_mode=EXCLUSIVE")
    execute("PRAGMA trusted_schema=OFF")
    execute("PRAGMA cell_size_check=ON")
    if new:
        execute("BEGIN EXCLUSIVE")
        if execute("SELECT count(*) FROM sqlite_schema").fetchone() != (0,):
            raise CacheError(path, "is in use by another process")
        execute(f"PRAGMA application_id={APPLICATION_ID}")
        execute("COMMIT")
    (mode,) = execute("PRAGMA journal_mode=WAL").fetchone()
    if mode != ("memory" if path == _MEMORY else "wal"):
        raise CacheError(path, f"cannot be kept safely: journal mode {mode} instead of wal")
    execute("BEGIN IMMEDIATE")
    execute("COMMIT")
    version = _number(connection, "user_version")
    if version > VERSION:
        raise CacheError(path, f"was written by a newer program (version {version}, known are 1 to {VERSION})")
    (verdict,) = execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise CacheError(path, f"is damaged: {verdict}", bad=True)
    for number, script in enumerate(MIGRATIONS[version:], version + 1):
        connection.executescript(f"BEGIN IMMEDIATE; {script} PRAGMA user_version={number}; COMMIT;")
    execute("PRAGMA synchronous=NORMAL")


def move_aside(path: str | Path) -> Path:
    """Rename a bad cache file, with what SQLite keeps beside it, to a name that is free; the new name. OSError when it cannot.

    The caller has seen a CacheError that says `bad`.
    """
    old = Path(path)
    for number in itertools.count(1):
        new = old.with_name(f"{old.name}.bad-{number}")
        if not new.exists():
            break
    for suffix in ("-wal", "-shm", ""):
        with contextlib.suppress(FileNotFoundError):
            Path(f"{old}{suffix}").rename(f"{new}{suffix}")
    return new


def used_bytes(connection: sqlite3.Connection) -> int:
    """Bytes of the pages that hold something; freed pages are used again before the file grows."""
    return (_number(connection, "page_count") - _number(connection, "freelist_count")) * _number(connection, "page_size")
