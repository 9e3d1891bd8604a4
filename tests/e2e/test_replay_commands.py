"""Replays as a user runs them: what is told to one while it plays, and the alarms of a recording at a moment."""

import json
import os
import pty
import select
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.control import Control
from bridge.core.control import Facts, Split
from bridge.edges.bus import BusConfig, open_bus
from bridge.replayer import Player
from tests.e2e.fault_stories import ROOT, eventually
from tests.unit.replayer.player_stories import night, state_is

KEYS = (
    (b"?", b"what the keys do"),
    (b"]", b"9 s of 9 s"),
    (b"[", b"0 s of 9 s"),
    (b"+", b"rate 2"),
    (b"-", b"rate 1"),
    (b" ", b"playing at"),
    (b" ", b"paused at"),
)


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    capsys.readouterr()
    code = run(arguments)
    out = capsys.readouterr()
    return code, out.out, out.err


def test_control_lists_and_tells(bus_config: BusConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Everybody in every realm; one by its name, whatever its realm; what is refused says why; nobody is exit code 4."""
    night(tmp_path / "night.mcap")
    group = ("--scouting-group", bus_config.scouting_group)
    with (
        open_bus(bus_config) as bus,
        Player(bus, [tmp_path / "night.mcap"], realm="replay-a", paused=True, rate=0) as one,
        Player(bus, [tmp_path / "night.mcap"], realm="replay-b", name="night", paused=True) as other,
    ):
        state_is(one, "paused")
        state_is(other, "paused")
        code, listed, _ = told(capsys, "control", "--json", *group)
        names = [
            (each["name"], each["role"], each["realm"], each["status"]["state"])
            for each in map(json.loads, listed.splitlines())
        ]
        assert (code, names) == (0, [("replay-a", "player", "replay-a", "paused"), ("night", "player", "replay-b", "paused")])
        code, listed, _ = told(capsys, "control", "--realm", "replay-b", *group)
        assert [line.split()[:3] for line in listed.splitlines()[1:]] == [["night", "player", "replay-b"]]

        code, answer, _ = told(capsys, "control", "replay-a", "step", "5", *group)
        assert code == 0
        assert "takes: status, pause, resume, step, seek, rate, stop" in answer
        assert eventually(lambda: one.status()["events"] == 5)
        code, active, _ = told(capsys, "alarms", "--realm", "replay-a", "--json", *group)
        assert (code, sorted(json.loads(line)["event_id"] for line in active.splitlines())) == (0, [1, 2])
        assert told(capsys, "control", "night", "rate", "0.5", *group)[0] == 0
        assert other.status()["rate"] == 0.5

        code, _, error = told(capsys, "control", "night", "split", *group)
        assert code == 1
        assert error.startswith("tcbridge: ADS_E_SRVNOTSUPP (0x98110701)")
        assert error.endswith(": a player takes no split\n")
        assert told(capsys, "control", "night", "seek", "never", *group)[0] == 1
        assert told(capsys, "control", "night", "seek", *group)[0] == 2
        code, _, error = told(capsys, "control", "nobody", "--wait", "0", *group)
        assert (code, error) == (4, "tcbridge: no recorder or player 'nobody' answers in any realm\n")
        assert told(capsys, "control", "night", "stop", *group)[0] == 0
        assert other.wait(30)


def test_a_fact_that_is_empty_is_not_shown(bus_config: BusConfig, capsys: pytest.CaptureFixture[str]) -> None:
    """An error that there is none of does not look like one; programs are told all the same."""
    group = ("--scouting-group", bus_config.scouting_group)
    facts: Facts = {"state": "recording", "events": 0, "error": ""}
    with open_bus(bus_config) as bus, Control(bus, "night", "recorder", lambda question: None, lambda: facts, takes=(Split,)):
        assert "error" not in told(capsys, "control", *group)[1]
        code, shown, _ = told(capsys, "control", "night", *group)
        assert (code, "events: 0" in shown, "error" in shown) == (0, True, False)
        assert json.loads(told(capsys, "control", "night", "--json", *group)[1])["status"] == facts


def test_alarms_of_a_recording_at_a_moment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As seconds or as a time, at the end by default; what makes no sense is refused."""
    night(tmp_path / "night.mcap")

    def at(*moment: str) -> list[int]:
        code, out, _ = told(capsys, "alarms", str(tmp_path), *moment, "--json")
        assert code == 0
        return sorted(json.loads(line)["event_id"] for line in out.splitlines())

    assert [at("--at", moment) for moment in ("1.9", "2", "5.5", "6")] == [[], [1], [1, 2], [2]]
    assert at("--at", "2026-11-22T08:00:05Z") == [1, 2]
    assert at() == [2]
    assert at("--all") == [1, 2]
    assert at("--filter", "event_id = 1", "--at", "5") == [1]
    assert at("--target", "plc9") == []
    for wrong in (["--at", "2026-11-22T07:59:59Z"], ["--at", "soon"], ["--watch"]):
        assert told(capsys, "alarms", str(tmp_path), *wrong)[0] == 2
    assert told(capsys, "alarms", "--at", "3")[0] == 2
    code, _, note = told(capsys, "alarms", str(tmp_path), "--at", "100")
    assert (code, note) == (0, "the recording ends at 2026-11-22T08:00:09.000000000Z; what was later is not known\n")


def test_keys_tell_a_replay_what_to_do(bus_config: BusConfig, tmp_path: Path) -> None:
    """On a terminal each key is a command; the terminal is as before when the replay has ended."""
    night(tmp_path / "night.mcap")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "bridge.cli", "replay", "night.mcap", "--paused", "--wait", "0"]
    environ = os.environ | {"PYTHONPATH": str(ROOT), "TERM": "dumb"}
    with subprocess.Popen(
        [*command, "--scouting-group", bus_config.scouting_group],
        cwd=tmp_path,
        env=environ,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
    ) as process:
        os.close(theirs)
        seen = b""

        def shows(text: bytes) -> bool:
            nonlocal seen
            while text not in seen:
                assert select.select([ours], [], [], 60)[0], seen
                try:
                    seen += os.read(ours, 4096)
                except OSError:  # the other side is closed
                    return text in seen
            seen = seen.partition(text)[2]
            return True

        try:
            assert shows(b"replaying 10 events")
            for key, shown in KEYS:
                os.write(ours, key)
                assert shows(shown), key
            os.write(ours, b"sq")
            assert shows(b"replayed ")
            assert process.wait(30) == 0
        finally:
            process.kill()
            os.close(ours)
