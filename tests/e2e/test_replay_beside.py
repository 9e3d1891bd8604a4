"""A replay beside the plant: it changes nothing there, two of them do not meet, and what it makes is what a logger has."""

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import msgspec
import pytest

from bridge import AdsError, EventLogger, Listener, Recorder, Severity, Source, open_bus
from bridge.control import tell
from bridge.core.catalog import Catalog
from bridge.core.control import Resume, Status
from bridge.core.csv_export import export_csv
from bridge.core.hresult import ADS_E_INVALIDACCESS
from bridge.core.questions import LogQuestion, Stored, ViewName
from bridge.edges.bus import ALONE, Bus, BusConfig
from bridge.logger import Book
from bridge.replayer import replay_into
from tests.e2e.fault_stories import CLASS, ROOT, eventually, program

AXIS = Source(3, "MAIN.fbAxis")


def yesterday(folder: Path) -> Path:
    """A recording of the same target in which other things happened: one alarm stays raised, the other was confirmed."""
    path = folder / "yesterday.mcap"
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus) as logger, Recorder(bus, path) as recorder:
        assert recorder.listener.wait_for_beat(logger.session)
        one = logger.create_alarm(CLASS, 1, Severity.ERROR, source=AXIS, with_confirmation=True).alarm
        logger.raise_alarm(one)
        logger.confirm_alarm(one, operator="night shift")
        logger.raise_alarm(logger.create_alarm(CLASS, 2, Severity.CRITICAL, source=AXIS).alarm)
        for number in range(20):
            logger.send_message(CLASS, 100 + number, Severity.INFO)
        recorder.close()
    return path


def replay(bus_config: BusConfig, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """`tcbridge replay` as a person runs it, on the bus of the test."""
    group = ["--scouting-group", bus_config.scouting_group]
    command = [sys.executable, "-m", "bridge.cli", "replay", *arguments, "--rate", "0", "--wait", "0", *group]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)


def test_a_replay_by_mistake_changes_nothing_in_the_plant(bus_config: BusConfig, tmp_path: Path) -> None:
    """Alarms, cache and listeners of realm live are equal before and after; into live, beside a logger, it is refused."""
    path = yesterday(tmp_path)
    with open_bus(bus_config) as bus, EventLogger("plc1", bus=bus, cache=tmp_path / "plc1.db") as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, source=AXIS, with_confirmation=True).alarm
        logger.raise_alarm(alarm)
        with Listener(bus, with_state=True) as listener:
            logger.send_message(CLASS, 1, Severity.INFO)
            (message,) = listener.take(1)
            before = (logger.active_alarms(), list(logger.log()), listener.alarms)

            by_mistake = replay(bus_config, str(path))
            assert (by_mistake.returncode, by_mistake.stderr) == (0, "")
            assert "in realm replay-" in by_mistake.stdout
            forced = replay(bus_config, str(path), "--live", "--yes")
            assert (forced.returncode, forced.stdout) == (1, "")
            assert "realm live has a logger of 'plc1'" in forced.stderr
            assert replay(bus_config, str(path), "--realm", "live").returncode == 2

            assert (logger.active_alarms(), list(logger.log()), listener.alarms) == before
            assert listener.get(0) is None
            assert listener.counters.rejected_events == 0
            logger.confirm_alarm(alarm)
            (confirmed,) = listener.take(1)
            assert (message.seq + 1, message.session) == (confirmed.seq, confirmed.session)


def test_two_replays_at_once_do_not_meet(bus_config: BusConfig, tmp_path: Path) -> None:
    """Each realm has its own events, each once; a second one into the same realm is refused."""
    path = yesterday(tmp_path)
    wanted = [*range(100, 120)]
    common = ["--scouting-group", bus_config.scouting_group, "--rate", "0", "--paused", "--wait", "0", "--loop"]
    with (
        open_bus(bus_config) as bus,
        Listener(bus, "is_message", realm="replay-a") as a,
        Listener(bus, "is_message", realm="replay-b") as b,
        program("replay", str(path), "--realm", "replay-a", *common) as one,
        program("replay", str(path), "--realm", "replay-b", *common) as other,
    ):
        assert one.line().endswith("realm replay-a")
        assert other.line().endswith("realm replay-b")
        again = replay(bus_config, str(path), "--realm", "replay-a")
        assert again.returncode == 1
        assert "replay-a" in again.stderr
        for realm in ("replay-a", "replay-b"):
            assert eventually(lambda realm=realm: is_paused(bus, realm))  # type: ignore[misc]
            tell(bus, realm, Resume(), realm=realm, timeout_s=30)
        sessions = set()
        for listener in (a, b):
            first = listener.take(len(wanted), timeout_s=60)
            assert sorted(event.event_id for event in first) == wanted
            sessions |= {event.session for event in first}
            assert all(event.origin is not None and event.origin.realm == "live" for event in first)
        assert len(sessions) == 2


def is_paused(bus: Bus, realm: str) -> bool:
    return tell(bus, realm, Status(), realm=realm, timeout_s=30).status["state"] == "paused"


def written(rows: Iterable[Stored]) -> list[str]:
    """The rows as CSV, without what is no part of the same state: unique ids and arrival times."""
    return list(export_csv((msgspec.structs.replace(row, unique_id=0, arrival_ns=0) for row in rows), Catalog()))


@pytest.mark.parametrize("view", ["transitions", "occurrences"])
def test_a_fresh_logger_has_what_the_live_one_had(tmp_path: Path, view: ViewName) -> None:
    """Alarms, history, occurrences and CSV of the replayed cache are those of the live cache."""
    live_path, fresh_path, path = tmp_path / "live.db", tmp_path / "fresh.db", tmp_path / "run.mcap"
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus, cache=live_path) as logger, Recorder(bus, path) as recorder:
        assert recorder.listener.wait_for_beat(logger.session)
        for life in range(3):
            for number in range(4):
                alarm = logger.create_alarm(CLASS, number, Severity.ERROR, source=AXIS, with_confirmation=number % 2 == 0).alarm
                logger.raise_alarm(alarm, arguments=(life, "ü;\n=1"), json_attribute='{"n": 1}')
                logger.send_message(CLASS, 50, Severity.VERBOSE, arguments=(life, number))
                if number:
                    logger.clear_alarm(alarm)
                if number == 2:
                    logger.confirm_alarm(alarm, operator="op", comment="seen")
                if number == 3 or life < 2:
                    logger.dispose_alarm(alarm)
        recorder.close()
        question = LogQuestion(newest_first=False, view=view)
        live_alarms = logger.book.logbook.table.state()
        live = sorted(logger.log(question), key=lambda row: row.event.seq)
    with Book(None, fresh_path) as book:
        report = replay_into([path], book)
        assert (report.gaps, report.rejected) == (0, 0)
    with Book(None, fresh_path) as book:
        fresh = sorted(book.log(question), key=lambda row: row.event.seq)
        assert book.logbook.table.state() == live_alarms
        assert written(fresh) == written(live)
        assert [msgspec.structs.replace(row.event, origin=None) for row in fresh] == [row.event for row in live]
        assert all(row.event.origin is not None for row in fresh)
        lives = {row.unique_id for row in fresh}
        assert len(lives) == len({row.unique_id for row in live})


def test_who_serves_a_replayed_cache_cannot_change_it(tmp_path: Path) -> None:
    """Commands to its alarms are refused; a clean stop leaves them as they were; new alarms are the logger's own."""
    path, cache = yesterday(tmp_path), tmp_path / "yesterday.db"
    with Book(None, cache) as book:
        replay_into([path], book)
        state = book.logbook.table.state()
    for _round in range(2):
        with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus, realm="museum", cache=cache) as logger:
            old = [alarm for alarm in logger.active_alarms() if alarm.origin is not None]
            assert sorted(alarm.event_id for alarm in old) == [1, 2]
            for alarm in old:
                for command in (logger.raise_alarm, logger.clear_alarm, logger.confirm_alarm, logger.dispose_alarm):
                    with pytest.raises(AdsError, match="the alarm is replayed") as refused:
                        command(alarm, operator="somebody")
                    assert refused.value.code == ADS_E_INVALIDACCESS
            own = logger.create_alarm(CLASS, 9, Severity.INFO).alarm
            logger.raise_alarm(own)
            logger.dispose_alarm(own)
    with Book(None, cache) as book:
        assert book.logbook.table.state() == state
