"""Programs in node that know nothing of us: run with packages of fixed versions, which are fetched once."""

import contextlib
import fcntl
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

PACKAGES = ("@mcap/core@2.2.2", "@mcap/nodejs@1.0.2", "fzstd@0.1.1", "@foxglove/schemas@2.1.0")
FETCH_S = 90


def modules(config: pytest.Config) -> Path:
    """The folder with PACKAGES, in pytest's cache. Skips the test without node or npm, or when npm cannot fetch them."""
    npm = shutil.which("npm")
    if shutil.which("node") is None or npm is None:
        pytest.skip("node and npm are not installed")
    assert config.cache is not None
    place = config.cache.mkdir("node")
    with _alone(place / "lock"):
        wanted, done = "\n".join(PACKAGES), place / "fetched"
        if not done.exists() or done.read_text(encoding="utf-8") != wanted:
            quiet = ("--ignore-scripts", "--no-package-lock", "--no-save", "--no-audit", "--no-fund", "--fetch-retries=0")
            try:
                subprocess.run(
                    [npm, "install", *quiet, "--prefix", str(place), *PACKAGES],
                    check=True,
                    capture_output=True,
                    timeout=FETCH_S,
                )
            except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
                pytest.skip(f"npm cannot fetch {', '.join(PACKAGES)}: {error}")
            done.write_text(wanted, encoding="utf-8")
    return place / "node_modules"


@contextlib.contextmanager
def _alone(lock: Path) -> Iterator[None]:
    with open(lock, "w", encoding="utf-8") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


def run_node(where: Path, script: str, *arguments: str | Path) -> Any:  # noqa: ANN401 - what a script prints as JSON
    """What a script prints, from JSON. Its arguments are process.argv[1], [2], ..."""
    return json.loads(run_program(where, "-e", script, *arguments))


def run_program(where: Path, *command: str | Path) -> str:
    """What node prints for a command line."""
    environ = os.environ | {"NODE_PATH": str(where)}
    words = ["node", *map(str, command)]
    done = subprocess.run(words, env=environ, check=False, capture_output=True, encoding="utf-8", timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout
