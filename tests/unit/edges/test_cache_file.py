"""The cache file: what is refused and left as it was, who may have it open, and what a killed process leaves."""

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bridge.edges.cache import Cache, CacheError
from bridge.edges.cache.file import open_file
from bridge.edges.cache.migrations import APPLICATION_ID, MIGRATIONS, VERSION
from tests.unit.edges.cache_stories import events_of, ids_of, message, messages

ROOT = Path(__file__).parents[3]
WRITER = """
import itertools, sys
from bridge.edges.cache import Cache
from tests.unit.edges.cache_stories import messages
cache = Cache(sys.argv[1])
print("open", flush=True)
for n in range(1, 100_000, 50):
    cache.append(messages(n, n + 49))
    cache.flush()
    print(n + 49, flush=True)
"""
HOLDER = """
import sys
from bridge.edges.cache import Cache, CacheError
try:
    cache = Cache(sys.argv[1])
except CacheError as error:
    print(error.reason, flush=True)
else:
    print("open", flush=True)
    sys.stdin.read()
"""


@contextmanager
def process(script: str, path: Path) -> Iterator[subprocess.Popen[str]]:
    """A Python process that runs a script on a cache; killed at the end if it still lives."""
    child = subprocess.Popen(
        [sys.executable, "-c", script, str(path)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with child:
        try:
            yield child
        finally:
            child.kill()


def said(child: subprocess.Popen[str]) -> str:
    """The next line of its output."""
    assert child.stdout is not None
    return child.stdout.readline().strip()


@pytest.mark.parametrize("flushes", [1, 2, 7, 40])
def test_a_killed_writer_leaves_all_that_was_flushed(tmp_path: Path, flushes: int) -> None:
    """kill -9 at any moment: what was flushed is there in order, at most the batches after it are there too, whole."""
    path = tmp_path / "cache.db"
    with process(WRITER, path) as child:
        assert said(child) == "open"
        last = 0
        for _ in range(flushes):
            last = int(said(child))
        child.send_signal(signal.SIGKILL)
        child.wait(10)
    with Cache(path) as cache:
        kept = events_of(cache.query(newest_first=False))
        assert len(kept) >= last
        assert len(kept) % 50 == 0
        assert kept == [message(n) for n in range(1, len(kept) + 1)]
        cache.append(messages(len(kept) + 1, len(kept) + 5))
        cache.flush()
        assert cache.count() == len(kept) + 5


def test_a_second_process_is_refused(tmp_path: Path) -> None:
    """A file that another process has open: an error that says so, at once; free again when that process is gone."""
    path = tmp_path / "cache.db"
    with process(HOLDER, path) as child:
        assert said(child) == "open"
        with pytest.raises(CacheError, match="in use by another process"):
            Cache(path)
    Cache(path).close()


def test_a_second_cache_of_this_process_is_refused_and_costs_the_first_nothing(tmp_path: Path) -> None:
    """Looking at the file again must not drop the lock that the first one has on it (POSIX drops it at any close)."""
    path = tmp_path / "cache.db"
    with Cache(path) as cache:
        (tmp_path / "link").symlink_to(path)
        for name in (path, tmp_path / "link"):
            with pytest.raises(CacheError, match="in use by another Cache of this process"):
                Cache(name)
        with process(HOLDER, path) as child:
            assert said(child) == "is in use by another process"
        cache.append(messages(1, 3))
        cache.flush()
    with Cache(path) as cache:
        assert cache.count() == 3


def test_a_closed_file_is_one_file(tmp_path: Path) -> None:
    """No shared memory ever (it kills the process when the disk is full), no WAL left after a clean close."""
    with Cache(tmp_path / "cache.db") as cache:
        cache.append(messages(1, 10))
        cache.flush()
        assert sorted(os.listdir(tmp_path)) == ["cache.db", "cache.db-wal"]
    assert os.listdir(tmp_path) == ["cache.db"]


def _garbage(path: Path) -> None:
    path.write_bytes(b"not a database, but a text that somebody wants to keep\n" * 100)


def _short(path: Path) -> None:
    path.write_bytes(b"SQLite format 3\0")


def _foreign(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript("CREATE TABLE events (id INTEGER PRIMARY KEY, body BLOB); INSERT INTO events VALUES (1, 'x');")
    connection.close()


def _foreign_wal(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript("PRAGMA application_id=7; PRAGMA journal_mode=WAL; CREATE TABLE t (a);")
    connection.close()


def _newer(path: Path) -> None:
    Cache(path).close()
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version={VERSION + 1}")
    connection.close()


def _damaged(path: Path) -> None:
    with Cache(path) as cache:
        cache.append(messages(1, 500))
    data = bytearray(path.read_bytes())
    data[8192:20480] = os.urandom(12288)
    path.write_bytes(data)


def _truncated(path: Path) -> None:
    with Cache(path) as cache:
        cache.append(messages(1, 500))
    path.write_bytes(path.read_bytes()[: 40 * 4096])


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (_garbage, "not an SQLite file"),
        (_short, "not an SQLite file"),
        (_foreign, "another program"),
        (_foreign_wal, r"another program \(application id 0x7\)"),
        (_newer, "newer program"),
        (_damaged, "damaged"),
        (_truncated, "damaged"),
    ],
)
def test_what_is_not_a_sound_cache_is_refused_and_left_as_it_was(tmp_path: Path, make: object, reason: str) -> None:
    """Refused with the reason; not one byte of the file changes, and no file appears beside it."""
    assert callable(make)
    path = tmp_path / "file.db"
    make(path)
    before = path.read_bytes()
    for _ in range(2):
        with pytest.raises(CacheError, match=reason) as caught:
            Cache(path)
        assert caught.value.path == str(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["file.db"]


def test_what_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    """A directory, a pipe (which must not be waited for), a name in a directory that does not exist."""
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path, tmp_path / "pipe", tmp_path / "none" / "cache.db"):
        with pytest.raises(CacheError):
            Cache(name)


def test_an_empty_file_becomes_a_cache(tmp_path: Path) -> None:
    """mktemp makes such files."""
    path = tmp_path / "cache.db"
    path.touch()
    with Cache(path) as cache:
        cache.append(messages(1, 2))
    with Cache(path) as cache:
        assert ids_of(cache.query()) == [2, 1]


def test_a_file_whose_creation_was_cut_off_is_completed(tmp_path: Path) -> None:
    """Killed after the first page and before the tables: the file is known as ours and gets its tables."""
    path = tmp_path / "cache.db"
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA application_id={APPLICATION_ID}")
    connection.close()
    with Cache(path) as cache:
        assert cache.count() == 0


def test_the_file_says_whose_it_is_before_the_wal_is_folded_in(tmp_path: Path) -> None:
    """The application id stands in the first page of the main file, so that a killed creation is not taken as foreign."""
    path = tmp_path / "cache.db"
    file = open_file(str(path))
    assert int.from_bytes(path.read_bytes()[68:72], "big") == APPLICATION_ID
    file.close()


def test_a_file_of_the_first_version_is_brought_up(tmp_path: Path) -> None:
    """Its events stay, and what came since is there."""
    path = tmp_path / "old.db"
    with contextlib.closing(sqlite3.connect(path)) as old:
        old.execute(f"PRAGMA application_id={APPLICATION_ID}")
        old.executescript(MIGRATIONS[0])
        old.execute("PRAGMA user_version=1")
        old.execute("INSERT INTO meta VALUES ('kept', 'yes')")
        old.commit()
    with Cache(path) as cache:
        assert cache.meta()["kept"] == "yes"
        assert cache.load_answers() == []
    with contextlib.closing(sqlite3.connect(path)) as new:
        assert new.execute("PRAGMA user_version").fetchone() == (VERSION,)
