"""The disk of a logger's cache is full: it says so, keeps serving, refuses what it cannot keep, goes on when there is room."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core.alarms import AlarmKey, Create, Raise
from bridge.core.events import Severity, Source
from bridge.core.hresult import ADS_E_NOMEMORY, AdsError
from bridge.edges.bus import BusConfig, open_bus
from bridge.logger import LoggerProxy
from bridge.publisher import Publisher
from tests.e2e.fault_stories import CLASS, eventually, program

SIZE = "32m"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A small disk."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only root can mount a small disk")
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no small disk here: {mounted.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def refused(proxy: LoggerProxy, number: int) -> bool:
    """Whether the logger refuses a new alarm because it cannot be kept."""
    key = AlarmKey("plc1", CLASS, number, None, "MAIN.new")
    try:
        answer = proxy.do(Create(key=key, severity=Severity.ERROR))
    except AdsError as error:
        return error.code == ADS_E_NOMEMORY and "full" in error.detail
    return "full" in answer.detail


def test_a_full_disk(disk: Path, bus_config: BusConfig) -> None:
    """Commands are refused and say why, state and log are served, and all goes on when there is room; so after a restart."""
    command = ("serve", "--target", "plc1", "--cache", str(disk / "plc1.db"), "--scouting-group", bus_config.scouting_group)
    raised = AlarmKey("plc1", CLASS, 1, None, "MAIN.pump")
    filler = disk / "filler"
    with open_bus(bus_config) as bus:
        proxy = LoggerProxy(bus, "plc1", timeout_s=30)
        with program(*command) as logger:
            assert "is ready" in logger.line()
            proxy.do(Create(key=raised, severity=Severity.ERROR, with_confirmation=True))
            proxy.do(Raise(key=raised))
            _fill(filler)
            with Publisher(bus, "plc1") as publisher:
                for number in range(500):  # the file has a little room of its own
                    publisher.send_message(CLASS, number, Severity.INFO, source=Source(name="MAIN"), json_attribute="x" * 1000)
                assert publisher.flush(30)
                assert eventually(lambda: refused(proxy, 2))
                assert eventually(lambda: refused(proxy, 3))
            assert [alarm.key for alarm in proxy.active_alarms()] == [raised]
            assert [alarm.raised for alarm in proxy.active_alarms()] == [True]
            assert any(stored.event.event_id == 1 for stored in proxy.log())
            filler.unlink()
            assert eventually(lambda: not refused(proxy, 4))
            confirmed = proxy.confirm_alarm(raised)
            assert confirmed.raised
            kept = len(list(proxy.log()))
            _fill(filler)
            logger.kill()
        with program(*command) as logger:
            assert "is ready" in logger.line()
            assert [alarm.key for alarm in proxy.active_alarms()] == [raised]
            assert len(list(proxy.log())) == kept
            filler.unlink()
            assert eventually(lambda: not refused(proxy, 5))
            assert not proxy.clear_alarm(raised).raised


def _fill(filler: Path) -> None:
    """Use the rest of the disk."""
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(b"\0" * 4096)
        except OSError:
            return
