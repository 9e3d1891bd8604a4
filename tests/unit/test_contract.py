"""The contract between the layers holds, and a breach of any of its clauses is found."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = sorted((ROOT / "bridge" / "core").rglob("*.py"))


def lint_imports(tree: Path) -> subprocess.CompletedProcess[str]:
    """Run the checker on a tree that holds pyproject.toml and bridge/."""
    script = "import sys; from importlinter.cli import lint_imports_command as main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, "--no-cache", "--no-logo"], cwd=tree, capture_output=True, text=True, timeout=60
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package and its contract, to be spoilt."""
    shutil.copytree(ROOT / "bridge", tmp_path / "bridge", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def plant(tree: Path, module: str, line: str) -> None:
    """Put one line at the end of a module; a module or package that does not exist yet is made."""
    path = tree.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a", encoding="utf-8") as out:
        out.write(f"\n{line}\n")


PURE = "Core is pure"
DIRECTION = "Direction"
BREACHES = [
    *((PURE, "bridge.core.times", f"import {name}") for name in ("zenoh", "mcap", "sqlite3", "asyncio", "threading")),
    *((PURE, "bridge.core.times", f"import {name}") for name in ("time", "socket", "logging", "pathlib", "os", "random")),
    (PURE, "bridge.core.events", "def f():\n    from time import monotonic"),
    ("Core: ", "bridge.core.times", "from bridge.core import arguments"),
    ("Core: ", "bridge.core.arguments", "from bridge.core.events import Event"),
    ("Core: ", "bridge.core.events", "from bridge.core.codec import encode"),
    ("Core: ", "bridge.core.sequence", "import bridge.core.alarms"),
    ("Core: ", "bridge.core.tmc", "import bridge.core.logbook"),
    ("Core: ", "bridge.core.misc", "import msgspec"),
    (DIRECTION, "bridge.core.times", "import bridge.edges"),
    (DIRECTION, "bridge.config", "import bridge.edges"),
    (DIRECTION, "bridge.edges.bus", "import bridge.publisher"),
    (DIRECTION, "bridge.publisher", "import bridge.listener"),
    (DIRECTION, "bridge.listener", "import bridge.recorder"),
    (DIRECTION, "bridge.recorder", "import bridge.logger"),
    (DIRECTION, "bridge.logger", "import bridge.cli"),
    (DIRECTION, "bridge.cli", "import bridge.testing"),
    (DIRECTION, "bridge.cli", "import bridge.twincat"),
    (DIRECTION, "bridge.helpers", ""),
    ("Edges: ", "bridge.edges.bus", "import bridge.edges.recording"),
    ("Edges: ", "bridge.edges.cache", "import bridge.edges.bus"),
    ("Edges: ", "bridge.edges.mqtt", ""),
    ("Filters: ", "bridge.core.filters.cover", "import bridge.core.filters.sql"),
    ("Filters: ", "bridge.core.filters.spelling", "import bridge.core.filters.predicate"),
    ("One importer: zenoh", "bridge.publisher", "import zenoh"),
    ("One importer: zenoh", "bridge.edges.recording", "from zenoh import open"),
    ("One importer: mcap", "bridge.recorder", "from mcap.writer import Writer"),
    ("One importer: sqlite3", "bridge.logger", "import sqlite3"),
    ("Test libraries", "bridge.cli", "import hypothesis"),
    ("GPL libraries", "bridge.edges.recording", "import small_mcap"),
    ("The public door", "bridge.listener", "from bridge import Severity"),
]


def test_the_tree_keeps_the_contract() -> None:
    """The package as it stands breaks no clause."""
    result = lint_imports(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(("clause", "module", "line"), BREACHES)
def test_a_planted_breach_is_found(copy: Path, clause: str, module: str, line: str) -> None:
    """One forbidden line, or one module that no layer names, and the checker names the clause and fails."""
    for name in ("bus", "recording", "cache"):
        plant(copy, f"bridge.edges.{name}", "")
    if line.startswith(("import bridge.", "from bridge.")):
        plant(copy, line.split()[1], "")
    plant(copy, module, line)
    result = lint_imports(copy)
    assert result.returncode == 1, result.stdout + result.stderr
    assert any(row.startswith(clause) and " BROKEN" in row for row in result.stdout.splitlines()), result.stdout


def test_a_package_is_placed_as_a_whole(copy: Path) -> None:
    """A new module inside a placed package needs no new line in the contract."""
    plant(copy, "bridge.edges.recording.index", "import mcap")
    assert "One importer: mcap only in bridge.edges.recording KEPT" in lint_imports(copy).stdout


IMPURE_NAMES = {"open", "input", "print", "eval", "exec", "__import__"}
IMPURE_ATTRIBUTES = {"now", "utcnow", "today", "uuid1", "uuid4"}
ALLOWED = {("predicate.py", "eval"), ("predicate.py", "exec")}
"""The filter predicate is compiled from a tree that we built; decision 0005."""


def impure_calls(source: str, file: str = "") -> list[str]:
    """What the import contract cannot see: calls that open a file, read the clock, print or run text."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Call(func=ast.Name(id=name)) if name in IMPURE_NAMES and (file, name) not in ALLOWED:
                found.append(f"{file}:{node.lineno} {name}()")
            case ast.Call(func=ast.Attribute(attr=name)) if name in IMPURE_ATTRIBUTES:
                found.append(f"{file}:{node.lineno} .{name}()")
            case ast.Call(func=ast.Attribute(value=ast.Name(id="io"), attr="open")):
                found.append(f"{file}:{node.lineno} io.open()")
    return found


@pytest.mark.parametrize("path", CORE, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_core_opens_no_file_and_reads_no_clock(path: Path) -> None:
    """No module of the core opens a file, asks what time it is, prints, or draws a random id."""
    assert impure_calls(path.read_text(encoding="utf-8"), path.name) == []


@pytest.mark.parametrize("call", ["open('x')", "io.open('x')", "datetime.now()", "date.today()", "uuid.uuid4()", "print(1)"])
def test_an_impure_call_is_found(call: str) -> None:
    """Each forbidden call is seen, however deep it stands."""
    assert len(impure_calls(f"def f():\n    if True:\n        return [{call}]")) == 1
