"""Two hosts on one wire: what is open on purpose is reached, what is not is neither heard nor found.

Each test makes two network namespaces with a veth between them and takes them away again; it needs root and iproute2.
"""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge.edges.recording import read_events
from tests.conftest import new_port
from tests.e2e.two_hosts import Host, needs_namespaces, two_hosts

ROOT = Path(__file__).parents[2]
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"

pytestmark = needs_namespaces


@pytest.fixture
def hosts() -> Iterator[tuple[Host, Host]]:
    """Two hosts that can reach each other."""
    with two_hosts() as pair:
        yield pair


@contextlib.contextmanager
def running(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Start a program, wait for the line in which it says that it is ready, and stop it by its id in the end."""
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            lines = iter((process.stdout if "serve" in command else process.stderr).readline, "")
            assert any(word in line for line in lines for word in ("ready", "listening", "recording")), process.poll()
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.communicate(timeout=20)


def _heard(process: subprocess.Popen[str]) -> list[dict[str, object]]:
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return [msgspec.json.decode(line) for line in out.splitlines()]


@pytest.mark.parametrize("way", ["lan", "endpoint"])
def test_publisher_here_listener_recorder_and_logger_there(hosts: tuple[Host, Host], way: str, tmp_path: Path) -> None:
    """With --lan the two find each other; with an endpoint they need no scouting. Events and commands cross the wire."""
    here, there = hosts
    group = ["--scouting-group", f"224.0.0.224:{new_port()}"]
    port = new_port()
    if way == "lan":
        ours = theirs = logger_only = ["--lan", *group]
    else:
        logger_only = ["--listen", f"tcp/{there.address}:{port}", *group]
        ours = theirs = ["--connect", f"tcp/{there.address}:{port}", *group]
    recording = tmp_path / "run.mcap"
    with contextlib.ExitStack() as stack:
        stack.enter_context(running(there.tcbridge("serve", "--target", "plc1", "--json", *logger_only)))
        recorder = stack.enter_context(running(there.tcbridge("record", str(recording), "--json", *theirs)))
        listen = ["listen", "--json", "--timeout", "50", "--count", "3", "--filter", "severity >= error"]
        listener = stack.enter_context(running(there.tcbridge(*listen, *theirs)))
        source = ["--source-name", "MAIN.here"]
        for arguments in (
            ["send", CLASS, "1", "--severity", "error"],
            ["send", CLASS, "2", "--severity", "info"],
            ["raise", CLASS, "3", "--severity", "critical"],
            ["clear", CLASS, "3"],
        ):
            here.run(sys.executable, "-m", "bridge.cli", *arguments, "--target", "plc1", *source, *ours, timeout_s=30)
        events = [line for line in _heard(listener) if "kind" in line]
        recorder.send_signal(signal.SIGTERM)
        recorder.communicate(timeout=20)
    assert [(event["kind"], event["event_id"]) for event in events] == [
        ("message_sent", 1),
        ("alarm_raised", 3),
        ("alarm_cleared", 3),
    ]
    kinds = [(item.event.kind, item.event.event_id) for item in read_events(recording) if hasattr(item, "event")]
    assert kinds[:2] == [("message_sent", 1), ("message_sent", 2)]
    assert ("alarm_cleared", 3) in kinds


def test_without_either_nothing_is_open(hosts: tuple[Host, Host]) -> None:
    """By default a logger listens on 127.0.0.1 only and does not answer a scout from the other host."""
    here, there = hosts
    group = f"224.0.0.224:{new_port()}"
    scout = (
        "import sys, zenoh\n"
        "config = zenoh.Config()\n"
        f"config.insert_json5('scouting/multicast/address', '\"{group}\"')\n"
        "config.insert_json5('scouting/multicast/interface', '\"wire\"')\n"
        "with zenoh.open(config) as session:\n"
        "    found = []\n"
        "    scout = zenoh.scout(lambda hello: found.append(hello), what='peer|router', config=config)\n"
        "    import threading\n"
        "    threading.Event().wait(3)\n"
        "    scout.stop()\n"
        "    print(sum(str(hello.zid) != str(session.zid()) for hello in found))\n"
    )

    def listening() -> list[str]:
        lines = there.run("ss", "-H", "-t", "-l", "-n").splitlines()
        return [line.split()[3] for line in lines]

    common = ["serve", "--target", "plc1", "--json", "--scouting-group", group]
    with running(there.tcbridge(*common)):
        assert listening()
        assert all(address.startswith("127.0.0.1:") for address in listening())
        assert here.run(sys.executable, "-c", scout).split() == ["0"]
    with running(there.tcbridge(*common, "--lan")):
        assert any(not address.startswith("127.") for address in listening())
        assert int(here.run(sys.executable, "-c", scout)) > 0
