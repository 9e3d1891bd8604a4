"""The commands as a user runs them: real processes on a loopback bus of their own."""

import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.edges.bus import BusConfig, open_bus
from bridge.publisher import Publisher
from tests.conftest import new_port

ROOT = Path(__file__).parents[2]
CLASSES = ROOT / "examples" / "plant.tmc"
DEADLINE_S = 30.0
END_S = 3.0


def new_group() -> str:
    """A scouting group that nobody else is in."""
    return f"224.0.0.224:{new_port()}"


class Running:
    """A command that runs until it is stopped."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self.process = process
        self._seen: dict[int, bytes] = {}

    def wait_for(self, pattern: str, *, stderr: bool = False) -> str:
        """The first line of stdout (or stderr) that matches; what came before is consumed."""
        stream = self.process.stderr if stderr else self.process.stdout
        assert stream is not None
        number = stream.fileno()
        deadline = time.monotonic() + DEADLINE_S
        while True:
            *lines, rest = self._seen.get(number, b"").split(b"\n")
            for place, line in enumerate(lines):
                if re.search(pattern, line.decode()):
                    self._seen[number] = b"\n".join([*lines[place + 1 :], rest])
                    return line.decode()
            left_s = deadline - time.monotonic()
            assert left_s > 0, f"no line matches {pattern!r}: {lines}"
            if select.select([number], [], [], left_s)[0]:
                piece = os.read(number, 65536)
                assert piece, f"the output ended and no line matches {pattern!r}: {lines}"
                self._seen[number] = self._seen.get(number, b"") + piece

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """Send a signal; the exit code, which must come in time, and the rest of stdout."""
        assert self.process.stdout is not None
        started_s = time.monotonic()
        self.process.send_signal(number)
        rest, _ = self.process.communicate(timeout=DEADLINE_S)
        assert time.monotonic() - started_s < END_S
        return self.process.returncode, rest.decode()


class Shell:
    """Runs commands in a folder, on a bus and in a realm of this test's own."""

    def __init__(self, folder: Path, group: str, stack: ExitStack) -> None:
        self.folder = folder
        self.bus = ["--scouting-group", group]
        self._stack = stack
        self._environ = {name: value for name, value in os.environ.items() if not name.startswith("TCBRIDGE_")}
        self._environ["PYTHONPATH"] = str(ROOT)

    def _command(self, arguments: tuple[str, ...], bus: bool) -> list[str]:
        return [sys.executable, "-m", "bridge.cli", *arguments, *(self.bus if bus else [])]

    def run(self, *arguments: str, bus: bool = True) -> "subprocess.CompletedProcess[str]":
        """Run a command to its end."""
        command = self._command(arguments, bus)
        return subprocess.run(
            command, cwd=self.folder, env=self._environ, capture_output=True, encoding="utf-8", timeout=DEADLINE_S
        )

    def start(self, *arguments: str, bus: bool = True) -> Running:
        """Start a command that stays."""
        process = subprocess.Popen(
            self._command(arguments, bus),
            cwd=self.folder,
            env=self._environ,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
        )
        self._stack.enter_context(process)
        self._stack.callback(process.kill)
        return Running(process)


@pytest.fixture
def shell(tmp_path: Path, bus_config: BusConfig) -> Iterator[Shell]:
    """A shell in an empty folder."""
    with ExitStack() as stack:
        yield Shell(tmp_path, bus_config.scouting_group, stack)


def test_a_day_of_a_logger(shell: Shell) -> None:
    """Serve, raise, raise again, alarms, confirm, clear, log in German, dispose; then stop: counts and exit code 0."""
    serve = shell.start("serve", "--target", "plc1", "--cache", "plc1.db", "--json")
    ready = json.loads(serve.wait_for("ready"))
    assert (ready["target"], ready["realm"]) == ("plc1", "live")
    place = ["Faults", "LagError", "--classes", str(CLASSES), "--target", "plc1"]

    raised = shell.run(
        "raise", *place, "--source-name", "Main.Axis3", "--arg", "3", "--arg", "12.5", "--with-confirmation", "--json"
    )
    assert (raised.returncode, raised.stderr) == (0, "")
    alarm = json.loads(raised.stdout)
    assert (alarm["raised"], alarm["confirmation_state"], alarm["text"]) == (True, 2, "Axis 3 lags 12.5 mm behind")

    again = shell.run("raise", *place, "--source-name", "Main.Axis3")
    assert again.returncode == 1
    assert "ADS_E_INVALIDSTATE (0x98110712)" in again.stderr

    shown = shell.run("alarms", "--target", "plc1", "--classes", str(CLASSES), "--lang", "de")
    header, row = shown.stdout.splitlines()
    assert shown.returncode == 0
    assert re.split(r" {2,}", header)[:4] == ["Severity", "State", "Confirmation", "Class"]
    assert re.split(r" {2,}", row)[:6] == ["error", "raised", "waiting", "Störungen", "1", "Achse 3: Schleppabstand 12.5 mm"]

    confirmed = shell.run("confirm", *place, "--operator", "shift leader", "--comment", "seen", "--json")
    assert (confirmed.returncode, json.loads(confirmed.stdout)["operator"]) == (0, "shift leader")
    assert shell.run("clear", *place).returncode == 0
    assert shell.run("alarms", "--target", "plc1", "--json").stdout == ""
    assert len(shell.run("alarms", "--target", "plc1", "--all", "--json").stdout.splitlines()) == 1

    log = shell.run("log", "--target", "plc1", "--classes", str(CLASSES), "--lang", "de", "--json")
    entries = [json.loads(line) for line in log.stdout.splitlines()]
    assert [entry["kind"] for entry in entries] == ["alarm_cleared", "alarm_confirmed", "alarm_raised"]
    assert {entry["text"] for entry in entries} == {"Achse 3: Schleppabstand 12.5 mm"}
    assert [entry.get("comment", "") for entry in entries] == ["", "seen", ""]
    table = shell.run("log", "--target", "plc1", "--filter", "kind = alarm_raised").stdout.splitlines()
    assert len(table) == 2
    assert table[0].split()[:3] == ["Time", "Severity", "Event"]

    assert shell.run("dispose", *place, "--source-name", "Main.Axis3").returncode == 0
    gone = shell.run("dispose", *place, "--source-name", "Main.Axis3")
    assert (gone.returncode, "ADS_E_NOTFOUND" in gone.stderr) == (1, True)

    code, rest = serve.stop()
    stopped = json.loads(rest)
    assert (code, stopped["stopped"], stopped["unsent"]) == (0, "logger", 0)
    kept = shell.run("log", "--cache", "plc1.db", "--json", bus=True)
    assert len(kept.stdout.splitlines()) == 4


def test_a_target_has_one_logger(shell: Shell) -> None:
    """A second serve of the same target is refused with 1."""
    shell.start("serve", "--target", "plc1").wait_for("ready")
    second = shell.run("serve", "--target", "plc1")
    assert second.returncode == 1
    assert "has a logger already" in second.stderr


@pytest.mark.parametrize("command", [["log"], ["alarms"], ["raise", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "1"]])
def test_nobody_answers(shell: Shell, command: list[str]) -> None:
    """Without a logger questions and commands end with 4, in bounded time."""
    result = shell.run(*command, "--wait", "0.5")
    assert result.returncode == 4
    assert "no logger of" in result.stderr


def test_listen_hears_what_is_sent(shell: Shell) -> None:
    """A filter takes one of two messages; the line and the JSON of it say the same."""
    listen = shell.start("listen", "--filter", "severity >= error", "--classes", str(CLASSES), "--lang", "de")
    listen.wait_for("listening in realm live for severity >= error", stderr=True)
    assert shell.run("send", "Line", "Homed", "--arg", "3", "--classes", str(CLASSES), "--wait", "10").returncode == 0
    sent = shell.run(
        "send", "Line", "GripLost", "--arg", "3", "--arg", "string:17", "--classes", str(CLASSES), "--wait", "10", "--json"
    )
    assert (sent.returncode, sent.stderr) == (0, "")
    assert json.loads(sent.stdout)["text"] == "Gripper of axis 3 lost part 17"
    line = listen.wait_for("Fertigungslinie")
    assert re.search(r"local +error +message +Fertigungslinie 4: Greifer an Achse 3 hat Teil 17 verloren$", line)
    assert listen.stop() == (0, "")


def test_listen_ends_after_count_and_timeout(shell: Shell) -> None:
    """--count events end it with 0; a --timeout that is over first ends it with 1 and says how many came."""
    listen = shell.start("listen", "--count", "1", "--json")
    listen.wait_for("listening", stderr=True)
    shell.run("send", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "1", "--wait", "10")
    assert json.loads(listen.wait_for("kind"))["event_id"] == 1
    assert listen.process.wait(DEADLINE_S) == 0
    late = shell.run("listen", "--count", "1", "--timeout", "0.2")
    assert (late.returncode, "0 of 1 events" in late.stderr) == (1, True)


def test_a_message_nobody_hears_is_sent_all_the_same(shell: Shell) -> None:
    """The exit code is 0, and a hint goes to stderr."""
    result = shell.run("send", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "1", "--wait", "0.1")
    assert (result.returncode, result.stderr) == (0, "nobody is listening\n")


def test_wrong_values_end_with_2(shell: Shell) -> None:
    """An unknown class, an argument that does not fit, a message over a limit, a bad filter, a missing class file."""
    guid = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
    for arguments, words in (
        (["send", "Lime", "1", "--classes", str(CLASSES)], "did you mean 'Line'"),
        (["send", guid, "1", "--arg", "int8:300"], "300 is outside -128..127"),
        (["send", guid, "1", "--json-attribute", "x" * 9000], "over the limit event_bytes = 8192"),
        (["send", guid, "1", "--time", "yesterday"], "'yesterday' is no time"),
        (["listen", "--filter", "sevrity = 1"], "did you mean 'severity'"),
        (["listen", "--classes", "gone.tmc"], "gone.tmc: No such file"),
    ):
        result = shell.run(*arguments)
        assert (result.returncode, words in result.stderr) == (2, True), result.stderr
        assert "Traceback" not in result.stderr


STAYING = [
    (["serve"], "ready", False),
    (["listen"], "listening", True),
    (["record", "x.mcap"], "recording", True),
    (["router", "--listen", "tcp/127.0.0.1:0"], "router", False),
]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("command", "ready", "stderr"), STAYING)
def test_what_runs_until_stopped_ends_with_0(
    shell: Shell, command: list[str], ready: str, stderr: bool, number: signal.Signals
) -> None:
    """Ctrl-C and SIGTERM are how these end: within 3 s, with 0."""
    running = shell.start(*command)
    running.wait_for(ready, stderr=stderr)
    assert running.stop(number)[0] == 0


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_work_that_is_stopped_is_not_done(shell: Shell, number: signal.Signals, code: int) -> None:
    """A replay that is stopped in the middle ends with 130 or 143."""
    _record(shell)
    replay = shell.start("replay", "plant.mcap", "--rate", "0.0001", "--wait", "0")
    replay.wait_for("replaying")
    assert replay.stop(number)[0] == code


def _record(shell: Shell) -> str:
    """Record two messages into plant.mcap; what record said in the end."""
    record = shell.start("record", "plant.mcap", "--classes", str(CLASSES), "--count", "2", "--comment", "two")
    record.wait_for("recording", stderr=True)
    for number in ("1", "2"):
        place = ["Line", "Moved", "--classes", str(CLASSES), "--target", "plc1"]
        shell.run("send", *place, "--arg", number, "--arg", "9.5", "--wait", "10")
    line = record.wait_for("recorded")
    assert record.process.wait(DEADLINE_S) == 0, line
    return line


def test_record_info_and_replay(shell: Shell) -> None:
    """A recording says what it holds, goes onto the bus in a realm of its own, and into a cache file once."""
    assert _record(shell) == "recorded 2 events to plant.mcap; complete: yes"
    info = shell.run("info", "plant.mcap", "--classes", str(CLASSES), bus=False)
    assert info.returncode == 0
    facts = dict(re.findall(r"^(\w+) +(.+)$", info.stdout, re.MULTILINE))
    assert (facts["complete"], facts["events"], facts["comment"]) == ("yes", "2", "two")
    assert "plant.tmc" in facts["attached"]
    assert re.search(r"^plc1 +Production line +message +verbose +2$", info.stdout, re.MULTILINE)
    told = json.loads(shell.run("info", "plant.mcap", "--json", bus=False).stdout)
    assert (told["complete"], told["totals"]["events"]) == ("yes", 2)

    listen = shell.start("listen", "--realm", "again", "--count", "2", "--json")
    listen.wait_for("listening", stderr=True)
    replayed = shell.run("replay", "plant.mcap", "--realm", "again", "--rate", "0", "--wait", "10")
    assert (replayed.returncode, replayed.stderr) == (0, "")
    event = json.loads(listen.wait_for("kind"))
    assert (event["origin"]["realm"], event["seq"]) == ("live", 1)
    listen.wait_for("kind")
    assert listen.process.wait(DEADLINE_S) == 0

    own = shell.run("replay", "plant.mcap", "--rate", "0", "--wait", "0")
    assert re.match(r"replaying 2 events in realm replay-[0-9a-f]{8}\n", own.stdout)
    into = shell.run("replay", "plant.mcap", "--into", "new.db", "--json", bus=True)
    assert (into.returncode, json.loads(into.stdout)["replayed"]["events"]) == (0, 2)
    assert len(shell.run("log", "--cache", "new.db", "--json").stdout.splitlines()) == 2
    twice = shell.run("replay", "plant.mcap", "--into", "new.db")
    assert (twice.returncode, "holds events or alarms already" in twice.stderr) == (1, True)
    assert json.loads(shell.run("replay", "plant.mcap", "--dry-run", "--json").stdout)["would_replay"]["events"] == 2


def test_a_sender_that_is_killed_leaves_an_unknown_tail(shell: Shell) -> None:
    """Nobody knows what a killed logger sent last: record says so, ends with 3, and info with 1."""
    serve = shell.start("serve", "--target", "plc1", "--json")
    session = json.loads(serve.wait_for("ready"))["session"]
    record = shell.start("record", "plant.mcap")
    record.wait_for("recording", stderr=True)
    listen = shell.start("listen", "--json")
    listen.wait_for("listening", stderr=True)
    shell.run("raise", "Faults", "DoorOpen", "--classes", str(CLASSES), "--target", "plc1", "--wait", "10")
    listen.wait_for("alarm_raised")
    shell.run("send", "Line", "Homed", "--classes", str(CLASSES), "--target", "plc1", "--wait", "10")
    serve.process.kill()
    assert json.loads(listen.wait_for("tail_unknown"))["session"] == session
    assert listen.stop()[0] == 3
    code, rest = record.stop()
    assert (code, rest) == (3, "recorded 2 events to plant.mcap; complete: tail unknown\n")
    info = shell.run("info", "plant.mcap", bus=False)
    assert (info.returncode, session in info.stdout) == (1, True)


def test_a_replay_among_live_events_needs_a_yes(shell: Shell) -> None:
    """Nobody is asked where nobody can answer: without --yes it is refused."""
    _record(shell)
    for arguments in (["--live"], ["--realm", "live"]):
        refused = shell.run("replay", "plant.mcap", "--rate", "0", "--wait", "0", *arguments)
        assert (refused.returncode, "--yes" in refused.stderr) == (2, True)
    assert shell.run("replay", "plant.mcap", "--rate", "0", "--wait", "0", "--live", "--yes").returncode == 0


def test_a_recording_is_never_overwritten(shell: Shell) -> None:
    """record refuses a file that is there, with 1; info refuses what is no recording."""
    (shell.folder / "x.mcap").write_bytes(b"")
    assert shell.run("record", "x.mcap").returncode == 1
    assert shell.run("info", "x.mcap", bus=False).returncode == 1
    assert shell.run("replay", "gone.mcap").returncode == 2


def test_programs_meet_at_a_router(shell: Shell) -> None:
    """With a router's address no scouting is needed: what one sends there the other hears."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    router = shell.start("router", "--listen", endpoint, "--json", "--scouting-group", new_group(), bus=False)
    assert json.loads(router.wait_for("ready"))["listen"] == [endpoint]
    listen = shell.start("listen", "--connect", endpoint, "--scouting-group", new_group(), bus=False)
    listen.wait_for("listening", stderr=True)
    place = ["54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "77", "--connect", endpoint, "--scouting-group", new_group()]
    sent = shell.run("send", *place, "--wait", "10", bus=False)
    assert (sent.returncode, sent.stderr) == (0, "")
    listen.wait_for("#77")
    assert router.stop()[0] == 0


def test_an_endpoint_where_nobody_listens_ends_with_4(shell: Shell) -> None:
    """Whoever asked for an endpoint is told that nobody answers there."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # bound but not listening: nobody else can take it, and nobody answers
        endpoint = f"tcp/127.0.0.1:{bound.getsockname()[1]}"
        result = shell.run("listen", "--connect", endpoint)
        assert (result.returncode, f"nobody answers at {endpoint}" in result.stderr) == (4, True)


def test_what_is_no_event_is_said_and_ends_with_3(shell: Shell, bus_config: BusConfig) -> None:
    """A payload that cannot be decoded is a line in place, and the exit code says that something is wrong."""
    listen = shell.start("listen", "--json")
    listen.wait_for("listening", stderr=True)
    key = "tc3/1/live/plc1/event/54cc5482-ad79-4cdc-8c3e-b3983b36ed66/message/info"
    with open_bus(bus_config) as bus:
        sender = bus.sender(key, "application/json")
        deadline = time.monotonic() + DEADLINE_S
        while not sender.is_matched() and time.monotonic() < deadline:
            threading.Event().wait(0.01)
        sender.put(b"nonsense")
        notice = json.loads(listen.wait_for("notice"))
    assert (notice["notice"], notice["key"]) == ("rejected", key)
    assert listen.stop()[0] == 3


def test_what_is_not_sent_ends_with_3(
    bus_config: BusConfig, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """When closing says that an event did not reach the bus, so does the command."""
    close = Publisher.close

    def unsent(self: Publisher, timeout_s: float = 2.0) -> int:
        return close(self, timeout_s) + 1

    monkeypatch.setattr(Publisher, "close", unsent)
    place = ["54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "1", "--wait", "0", "--scouting-group", bus_config.scouting_group]
    assert run(["send", *place]) == 3
    assert "1 event was not sent" in capsys.readouterr().err


def test_alarms_can_be_watched(shell: Shell) -> None:
    """--watch shows an alarm when it comes and says when it is gone."""
    shell.start("serve", "--target", "plc1").wait_for("ready")
    watch = shell.start("alarms", "--watch", "--json", "--wait", "10")
    place = ["Faults", "DoorOpen", "--classes", str(CLASSES), "--target", "plc1"]
    shell.run("raise", *place, "--wait", "10")
    assert json.loads(watch.wait_for("DoorOpen|event_id"))["active"] is True
    shell.run("clear", *place, "--wait", "10")
    assert json.loads(watch.wait_for("gone"))["gone"]["event_id"] == 2
    assert watch.stop()[0] == 0


def test_a_reader_that_goes_away_is_no_fault(shell: Shell) -> None:
    """When whoever reads the output is gone, the command ends quietly with 141."""
    listen = shell.start("listen", "--json")
    listen.wait_for("listening", stderr=True)
    assert listen.process.stdout is not None
    listen.process.stdout.close()
    shell.run("send", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "1", "--wait", "10")
    assert listen.process.wait(DEADLINE_S) == 141
    assert listen.process.stderr is not None
    assert b"Traceback" not in listen.process.stderr.read()


def test_settings_of_the_folder_count(shell: Shell) -> None:
    """A tcbridge.toml in the working folder is read, and --show-settings names it."""
    (shell.folder / "tcbridge.toml").write_text(f'target = "plc9"\nclasses = ["{CLASSES}"]\n')
    rows = [json.loads(line) for line in shell.run("send", "x", "1", "--show-settings", "--json").stdout.splitlines()]
    origins = {row["setting"]: (row["value"], row["origin"]) for row in rows}
    assert origins["target"] == ("plc9", "file tcbridge.toml")
    assert origins["scouting_group"][1] == "option --scouting-group"
    assert "plc9" in shell.run("send", "Line", "Homed", "--wait", "0").stdout
