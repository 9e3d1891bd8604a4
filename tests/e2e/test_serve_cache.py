"""`serve` with a bad cache file, and with limits; `log clear` at a running logger."""

import json
import sqlite3
from pathlib import Path

from tests.e2e.test_cli import Shell, shell

__all__ = ["shell"]

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"


def foreign(path: Path) -> None:
    """Another program's database."""
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE events (id)")
    connection.commit()
    connection.close()


def test_a_bad_cache_is_moved_aside_only_when_told_to(shell: Shell) -> None:
    """Refused with the option's name, left alone; with the option renamed, and a new one is begun."""
    path = shell.folder / "plc1.db"
    foreign(path)
    before = path.read_bytes()
    refused = shell.run("serve", "--target", "plc1", "--cache", "plc1.db")
    assert refused.returncode == 1
    assert "another program" in refused.stderr
    assert "--move-aside-bad-cache" in refused.stderr
    assert path.read_bytes() == before
    serving = shell.start("serve", "--target", "plc1", "--cache", "plc1.db", "--move-aside-bad-cache")
    serving.wait_for("is ready")
    assert (shell.folder / "plc1.db.bad-1").read_bytes() == before
    assert serving.stop()[0] == 0


def test_a_limited_log_is_cleared_over_the_bus(shell: Shell) -> None:
    """The drop is reported in the language asked for; clearing leaves the report of who did it and why."""
    serving = shell.start("serve", "--target", "plc1", "--max-events", "4")
    serving.wait_for("is ready")
    for number in range(5):
        assert shell.run("send", CLASS, str(number), "--target", "plc1").returncode == 0
    wanted, shown = "Das Protokoll hat seine 3 ältesten Ereignisse verworfen (max_events)", ""
    for _ in range(20):
        shown = shell.run("log", "--target", "plc1", "--lang", "de", "--filter", "event_class = 'TcBridge'").stdout
        if wanted in shown:
            break
    assert wanted in shown
    cleared = shell.run("log", "clear", "--target", "plc1", "--yes", "--operator", "anna", "--comment", "test", "--json")
    assert json.loads(cleared.stdout)["cleared"] >= 3
    (line,) = shell.run("log", "--target", "plc1", "--json").stdout.splitlines()
    report = json.loads(line)
    assert (report["operator"], report["comment"]) == ("anna", "test")
    assert shell.run("log", "clear", "--target", "plc1").returncode == 2
    assert serving.stop()[0] == 0
