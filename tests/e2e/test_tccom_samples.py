"""The samples of the Tc3_Module manual, and Start-Stop of the EventLogger manual, as programs that a user runs."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import new_port
from tests.e2e.two_hosts import Host, needs_namespaces, two_hosts

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "examples" / "tccom"
SHOWN = {
    "sample01": ["1 + 4 = 5, 1 - 4 = -3", "2 + 4 = 6, 2 - 4 = -2", "3 + 4 = 7, 3 - 4 = -1"],
    "sample02": ["call 1: 5", "call 2: 10", "call 3: 15"],
    "sample03": ["call 1: 10", "call 2: 20", "call 3: 30", "left behind: []"],
    "sample13": ["0 + 0 = 0", "1 + 1 = 2", "2 + 2 = 4"],
}
ERROR_S = 2.0
"""How soon a caller hears that its provider was killed."""
WAIT_S = 60.0


class Part:
    """One half of a sample, in a process of its own, maybe on another host."""

    def __init__(self, sample: str, part: str, *options: str, host: Host | None = None) -> None:
        command = [sys.executable, str(SAMPLES / f"{sample}.py"), part, *options]
        environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
        self.process = subprocess.Popen(
            command if host is None else host.command(*command),
            cwd=ROOT,
            env=environ | {"PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
        )

    def line(self) -> str:
        """The next line it prints; "" when it has ended."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().rstrip("\n")

    def answers(self) -> list[str]:
        """What it prints until it ends, without what it says while it waits for the other half."""
        lines = list(iter(self.line, ""))
        assert self.process.wait(WAIT_S) == 0
        return [line for line in lines if not line.startswith("no answer: ")]


@contextlib.contextmanager
def part(sample: str, name: str, *options: str, host: Host | None = None) -> Iterator[Part]:
    """It is killed at the end if it is still there."""
    started = Part(sample, name, *options, host=host)
    with started.process:
        try:
            yield started
        finally:
            started.process.kill()


@pytest.mark.parametrize("sample", SHOWN)
def test_a_sample_runs_by_one_command(sample: str) -> None:
    """Both halves as two processes; it ends by itself with exit code 0, and nothing on stderr."""
    done = subprocess.run(
        [sys.executable, SAMPLES / f"{sample}.py"], capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    lines = [line for line in done.stdout.splitlines() if line != "ready" and not line.startswith("no answer: ")]
    assert lines == SHOWN[sample]


@pytest.mark.slow
@pytest.mark.parametrize("sample", SHOWN)
@pytest.mark.parametrize("first", ["provider", "caller"])
def test_either_half_may_start_first(sample: str, first: str) -> None:
    """A caller that is first says that nobody answers, and goes on by itself when the provider has come."""
    options = ["--scouting-group", f"224.0.0.224:{new_port()}"]
    with contextlib.ExitStack() as stack:
        if first == "provider":
            assert stack.enter_context(part(sample, "provider", *options)).line() == "ready"
            caller = stack.enter_context(part(sample, "caller", *options))
        else:
            caller = stack.enter_context(part(sample, "caller", *options))
            assert caller.line().startswith("no answer: ")
            stack.enter_context(part(sample, "provider", *options))
        assert caller.answers() == SHOWN[sample]


@pytest.mark.slow
@pytest.mark.parametrize("sample", SHOWN)
@pytest.mark.parametrize("name", ["provider", "caller"])
def test_sigterm_ends_either_half(sample: str, name: str) -> None:
    """With exit code 0, also while the other half is not there."""
    with part(sample, name, "--calls", "0", "--scouting-group", f"224.0.0.224:{new_port()}") as started:
        assert started.line()
        started.process.terminate()
        assert started.process.wait(WAIT_S) == 0


def kill_and_restart(sample: str, *options: str, here: Host | None = None, there: Host | None = None) -> float:
    """How long it took until a caller heard that its provider was killed; it has gone on after the provider's restart."""
    with part(sample, "caller", "--calls", "0", *options, host=here) as caller:
        with part(sample, "provider", *options, host=there) as provider:
            while caller.line().startswith("no answer: "):
                pass
            provider.process.kill()
            killed = time.monotonic()
            while not (line := caller.line()).startswith("no answer: "):
                assert line
            heard = time.monotonic() - killed
        with part(sample, "provider", *options, host=there):
            while (line := caller.line()).startswith("no answer: "):
                pass
            assert line
    return heard


@pytest.mark.parametrize("sample", SHOWN)
def test_a_killed_provider_is_an_error_and_comes_back(sample: str) -> None:
    """kill -9 in the middle of calls: the caller hears of it within 2 s, and goes on after the restart by itself."""
    assert kill_and_restart(sample, "--scouting-group", f"224.0.0.224:{new_port()}") < ERROR_S


@pytest.fixture
def hosts() -> Iterator[tuple[Host, Host]]:
    """Two hosts that can reach each other."""
    with two_hosts() as pair:
        yield pair


@pytest.mark.slow
@needs_namespaces
@pytest.mark.parametrize("sample", SHOWN)
@pytest.mark.parametrize("first", ["provider", "caller"])
def test_the_halves_may_be_on_two_hosts(hosts: tuple[Host, Host], sample: str, first: str) -> None:
    """With --lan they find each other over the wire, started in either order."""
    here, there = hosts
    options = ["--lan", "--scouting-group", f"224.0.0.224:{new_port()}"]
    with contextlib.ExitStack() as stack:
        if first == "provider":
            assert stack.enter_context(part(sample, "provider", *options, host=there)).line() == "ready"
        caller = stack.enter_context(part(sample, "caller", *options, host=here))
        if first == "caller":
            assert caller.line().startswith("no answer: ")
            stack.enter_context(part(sample, "provider", *options, host=there))
        assert caller.answers() == SHOWN[sample]


@pytest.mark.slow
@needs_namespaces
@pytest.mark.parametrize("sample", SHOWN)
def test_a_provider_on_another_host_is_killed_and_comes_back(hosts: tuple[Host, Host], sample: str) -> None:
    """Within 2 s the caller hears of it over the wire, and goes on after the restart by itself."""
    here, there = hosts
    assert kill_and_restart(sample, "--lan", "--scouting-group", f"224.0.0.224:{new_port()}", here=here, there=there) < ERROR_S


def test_start_stop_prints_the_messages_of_the_manual() -> None:
    """9.2.2: 1, 7 and 4 when starting, 8, 2 and 5 when stopping, in time, with the manual's texts."""
    done = subprocess.run([sys.executable, SAMPLES / "start_stop.py"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    rows = [line.split(" | ") for line in done.stdout.splitlines()]
    assert [row[:4] for row in rows] == [
        ["Verbose", "TcComMessages", "1", "Eventlogger initialized"],
        ["Verbose", "TcComMessages", "7", "AddModuleToCaller Done"],
        ["Verbose", "TcComMessages", "4", "SetObjStateSO Done"],
        ["Verbose", "TcComMessages", "8", "RemoveModuleFromCaller Done"],
        ["Verbose", "TcComMessages", "2", "Eventlogger deinitialized"],
        ["Verbose", "TcComMessages", "5", "SetObjStateOS Done"],
    ]
    times = [row[4] for row in rows]
    assert times == sorted(times)


@pytest.mark.slow
@needs_namespaces
def test_a_cut_network_is_an_error_and_comes_back(hosts: tuple[Host, Host]) -> None:
    """Nobody tells that the other host is cut off: the call times out within 2 s; calls work again when the wire is back."""
    here, there = hosts
    options = ["--lan", "--scouting-group", f"224.0.0.224:{new_port()}"]
    with (
        part("sample01", "provider", *options, host=there) as provider,
        part("sample01", "caller", "--calls", "0", *options, host=here) as caller,
    ):
        assert provider.line() == "ready"
        while caller.line().startswith("no answer: "):
            pass
        there.run("ip", "link", "set", "wire", "down")
        cut = time.monotonic()
        while not (line := caller.line()).startswith("no answer: "):
            assert line
        assert time.monotonic() - cut < ERROR_S
        assert "ADS_E_TIMEOUT" in line
        there.run("ip", "link", "set", "wire", "up")
        there.run("ip", "route", "add", "224.0.0.0/4", "dev", "wire")
        while (line := caller.line()).startswith("no answer: "):
            pass
        assert line


def test_every_sample_is_listed_with_its_command() -> None:
    """examples/README.md names each program of the folder that is one."""
    text = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    programs = {path.stem for path in SAMPLES.glob("*.py") if "__main__" in path.read_text(encoding="utf-8")}
    assert {name for name in programs if f"python examples/tccom/{name}.py" in text} == programs
    assert {*SHOWN, "start_stop"} == programs
