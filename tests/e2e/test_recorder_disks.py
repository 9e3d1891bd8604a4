"""Disks that are full, read-only, gone or out of files: the recorder says so and ends; started again, it goes on."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bridge import BusConfig, Publisher, Severity, open_bus
from bridge.edges.recording import RecordedEvent, leftovers, read_events, scan
from tests.e2e.fault_stories import CLASS, ROOT, WAIT_S, eventually


@contextmanager
def disk(place: Path, options: str) -> Iterator[Path]:
    """A small disk in memory."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root can mount a small disk")
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no small disk here: {mounted.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


class Run:
    """tcbridge record, what it says and how it ends."""

    def __init__(self, group: str, *arguments: str) -> None:
        environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
        command = [sys.executable, "-m", "bridge.cli", "record", *arguments, "--scouting-group", group]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environ | {"PYTHONPATH": str(ROOT)}
        )
        self.said: list[str] = []

    def wait_for(self, pattern: str) -> str:
        """The first line on stderr that matches."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said.append(line.strip())
            if re.search(pattern, line):
                return line
        raise AssertionError(f"no line matches {pattern!r}: {self.said}")

    def ended(self) -> tuple[int, str]:
        """Its exit code and its last line, when it ends by itself."""
        _, rest = self.process.communicate(timeout=WAIT_S)
        self.said += rest.splitlines()
        return self.process.returncode, self.said[-1]

    def stop(self) -> tuple[int, str]:
        """The same, when it is told to stop."""
        self.process.terminate()
        return self.ended()


@contextmanager
def recording(group: str, *arguments: str) -> Iterator[Run]:
    """A recorder that is killed at the end if it is still there."""
    run = Run(group, *arguments)
    with run.process:
        try:
            yield run
        finally:
            run.process.kill()


def stream(publisher: Publisher, run: Run, first: int = 0) -> int:
    """Send until the recorder has ended; how many were sent."""
    sent = first

    def over() -> bool:
        nonlocal sent
        for _ in range(50):
            publisher.send_message(CLASS, sent, Severity.INFO, json_attribute='{"x":"' + os.urandom(500).hex() + '"}')
            sent += 1
        return run.process.poll() is not None

    assert eventually(over)
    return sent


def ids(*paths: Path) -> list[int]:
    """The numbers of the events of these files."""
    return [item.event.event_id for path in paths for item in read_events(path) if isinstance(item, RecordedEvent)]


def check_goes_on(publisher: Publisher, folder: Path, group: str) -> None:
    """Started again it recovers what was left, records, and ends well; nothing is half named and every file is whole."""
    with recording(group, str(folder)) as run:
        run.wait_for("recording realm")
        before = set(folder.iterdir())
        (active,) = leftovers(folder)
        publisher.send_message(CLASS, 10**6, Severity.INFO)
        assert eventually(lambda: ids(active)[-1:] == [10**6])
        assert run.stop()[0] == 0
    assert before - set(folder.iterdir()) == {active}
    assert leftovers(folder) == []
    assert all(not scan(path).truncated for path in folder.glob("*.mcap"))


def test_a_full_disk_ends_a_recorder_that_says_so(bus_config: BusConfig, tmp_path: Path) -> None:
    """Exit code 1 and the reason; what was flushed is readable, and recovered at the next start when there is room."""
    group = bus_config.scouting_group
    with disk(tmp_path / "disk", "size=1m") as place, open_bus(bus_config) as bus, Publisher(bus, "plc1") as publisher:
        folder = place / "night"
        with recording(group, str(folder)) as run:
            run.wait_for("recording realm")
            sent = stream(publisher, run)
            code, line = run.ended()
        assert (code, "No space left on device" in line) == (1, True)
        (left,) = leftovers(folder)
        readable = ids(left)
        assert readable == list(range(readable[0], readable[0] + len(readable)))
        assert 100 < len(readable) < sent
        with recording(group, str(folder)) as run:  # on the full disk it says so again, and destroys nothing
            code, line = run.ended()
        assert (code, "No space left on device" in line) == (1, True)
        assert any("is not recovered: No space left on device" in line for line in run.said)
        assert ids(left) == readable
        subprocess.run(["mount", "-o", "remount,size=8m", str(place)], check=True)
        check_goes_on(publisher, folder, group)
        assert ids(*sorted(folder.glob("*.mcap"))) == [*readable, 10**6]


def test_a_disk_without_room_for_another_file_ends_a_recorder_that_says_so(bus_config: BusConfig, tmp_path: Path) -> None:
    """The file before the split is finished and has its name; nothing in it is lost."""
    group = bus_config.scouting_group
    with (
        disk(tmp_path / "disk", "size=20m,nr_inodes=6") as place,
        open_bus(bus_config) as bus,
        Publisher(bus, "plc1") as publisher,
    ):
        folder = place / "night"
        with recording(group, str(folder), "--split-size", "100k") as run:
            run.wait_for("recording realm")
            stream(publisher, run)
            code, line = run.ended()
        assert (code, "No space left on device" in line) == (1, True)
        assert leftovers(folder) == []
        paths = sorted(folder.glob("*.mcap"))
        assert len(paths) >= 3
        recorded = ids(*paths)
        assert recorded == list(range(recorded[0], recorded[0] + len(recorded)))
        paths[0].unlink()
        check_goes_on(publisher, folder, group)


def test_a_read_only_disk_is_told_at_the_start(bus_config: BusConfig, tmp_path: Path) -> None:
    """For a folder, a new folder and a single file; nothing is made."""
    group = bus_config.scouting_group
    with disk(tmp_path / "disk", "size=8m") as place:
        (place / "there").mkdir()
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        for name in ("there", "new", "one.mcap"):
            with recording(group, str(place / name)) as run:
                code, line = run.ended()
            assert (code, "Read-only file system" in line) == (1, True)
        assert [path.name for path in place.rglob("*")] == ["there"]


def test_a_folder_that_vanishes_ends_a_recorder_that_says_so(bus_config: BusConfig, tmp_path: Path) -> None:
    """Else it would go on for days into a file that nobody can find; started again it makes the folder anew."""
    group, folder = bus_config.scouting_group, tmp_path / "night"
    with open_bus(bus_config) as bus, Publisher(bus, "plc1") as publisher:
        with recording(group, str(folder)) as run:
            run.wait_for("recording realm")
            publisher.send_message(CLASS, 1, Severity.INFO)
            (active,) = leftovers(folder)
            assert eventually(lambda: ids(active) == [1])
            shutil.rmtree(folder)
            stream(publisher, run)
            code, line = run.ended()
        assert (code, "deleted while it was written" in line) == (1, True)
        check_goes_on(publisher, folder, group)


def test_a_folder_that_another_recorder_has_is_refused(bus_config: BusConfig, tmp_path: Path) -> None:
    """Two recorders would delete and recover each other's files."""
    group, folder = bus_config.scouting_group, tmp_path / "night"
    with recording(group, str(folder)) as first:
        first.wait_for("recording realm")
        with recording(group, str(folder)) as second:
            code, line = second.ended()
        assert (code, "is the folder of a running recorder" in line) == (1, True)
        assert first.stop()[0] == 0
    assert len(list(folder.iterdir())) == 1
