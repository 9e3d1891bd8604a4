"""A logger is killed at any moment: what was answered is there, once, and its alarms are as the log says."""

import random
import sys
import threading
import time
from pathlib import Path

import msgspec
import pytest

from bridge.core import keys
from bridge.core.alarms import AlarmCommand, AlarmKey, Clear, Confirm, Create, Raise, fold
from bridge.core.events import Severity
from bridge.core.hresult import AdsError
from bridge.core.questions import CommandAnswer, CommandQuestion
from bridge.edges.bus import Bus, BusConfig, open_bus
from bridge.edges.cache import Cache
from bridge.logger import LoggerProxy
from bridge.logger.proxy import CommandUnknownError
from tests.e2e.fault_stories import CLASS, WAIT_S, Program, eventually, program

CLIENTS = 3


class Client:
    """Raises, clears and confirms one alarm without a pause, and remembers what was answered. Each command has its comment."""

    def __init__(self, bus: Bus, number: int) -> None:
        self.key = AlarmKey("plc1", CLASS, number, None, f"MAIN.client{number}")
        self.answered: dict[str, tuple[str, int]] = {}
        self.refused: list[str] = []
        self.asked = 0
        self._proxy = LoggerProxy(bus, "plc1", timeout_s=WAIT_S)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            comment = f"{self.key.event_id}.{self.asked}"
            commands: tuple[AlarmCommand, ...] = (
                Create(key=self.key, severity=Severity.ERROR, with_confirmation=True),
                Raise(key=self.key, comment=comment),
                Clear(key=self.key, comment=comment),
                Confirm(key=self.key, comment=comment),
            )
            command = commands[self.asked % 4]
            self.asked += 1
            try:
                answer = self._proxy.do(command)
            except (AdsError, CommandUnknownError) as error:
                self.refused.append(f"{comment}: {error}")
            else:
                if answer.seq:
                    self.answered[comment] = (answer.session, answer.seq)

    def stop(self) -> None:
        """Let it finish its command."""
        self._stop.set()

    def join(self) -> None:
        """Wait for its last command."""
        self._thread.join(2 * WAIT_S)
        assert not self._thread.is_alive()


def check(path: Path, answered: dict[str, tuple[str, int]]) -> None:
    """What was answered is in the cache, nothing is there twice, and the alarms are the fold of the events."""
    with Cache(path) as cache:
        events = [stored.event for stored in cache.query(newest_first=False)]
        alarms = {stored.alarm.key: stored.alarm for stored in cache.load_alarms()}
    stored = {event.comment: (event.session, event.seq) for event in events}
    assert len(stored) == len(events)
    assert {comment: stored.get(comment) for comment in answered} == answered
    assert fold(events).state() == {
        key: (a.raised, a.confirmation_state, a.time_raised_ns, a.time_cleared_ns, a.time_confirmed_ns)
        for key, a in alarms.items()
        if a.was_raised
    }


@pytest.mark.parametrize("kills", [3, pytest.param(50, marks=pytest.mark.slow)])
def test_a_logger_that_is_killed_at_random_moments(kills: int, bus_config: BusConfig, tmp_path: Path) -> None:
    """Each command that was answered is in the cache after the kill, none twice, and the alarms are the fold of the log.

    Nobody is refused what was done already: who gets no answer asks again with the same id, and hears what became of it.
    """
    seed = random.randrange(2**32)
    sys.stdout.write(f"seed {seed}\n")
    moments = random.Random(seed)
    path = tmp_path / "plc1.db"
    command = ("serve", "--target", "plc1", "--cache", str(path), "--scouting-group", bus_config.scouting_group)
    with open_bus(bus_config) as bus:
        clients = [Client(bus, number) for number in range(CLIENTS)]
        try:
            for number in range(kills):
                with program(*command) as logger:
                    if number % 5 != 4:  # the others are killed while they open
                        assert "is ready" in logger.line()
                    time.sleep(moments.uniform(0.0, 0.6))
                    answered = {comment: place for client in clients for comment, place in list(client.answered.items())}
                    logger.kill()
                if path.exists():
                    check(path, answered)
            with program(*command) as logger:
                assert "is ready" in logger.line()
                for client in clients:
                    client.stop()
                for client in clients:
                    client.join()
                _compare_state(bus, logger, path, clients)
        finally:
            for client in clients:
                client.stop()
    assert sum(len(client.answered) for client in clients) > 10 * kills
    assert [client.refused for client in clients] == [[]] * CLIENTS


def test_a_command_that_was_carried_out_before_the_kill_is_not_carried_out_again(bus_config: BusConfig, tmp_path: Path) -> None:
    """Its answer was lost with the logger. Asked again with the same id, it hears of the event of then, whatever came since."""
    command = ("serve", "--target", "plc1", "--cache", str(tmp_path / "plc1.db"), "--scouting-group", bus_config.scouting_group)
    key = AlarmKey("plc1", CLASS, 1, None, "MAIN.pump")
    create, raise_, clear = (
        CommandQuestion(id=name, command=done, session="pump")
        for name, done in (("c", Create(key=key, severity=Severity.ERROR)), ("r", Raise(key=key)), ("x", Clear(key=key)))
    )
    with open_bus(bus_config) as bus:
        proxy = LoggerProxy(bus, "plc1", timeout_s=WAIT_S)
        with program(*command) as logger:
            assert "is ready" in logger.line()
            before = [asked(bus, question) for question in (create, raise_, clear)]
            logger.kill()
        with program(*command) as logger:
            assert "is ready" in logger.line()
            after = [asked(bus, question) for question in (create, raise_, clear)]
            assert not proxy.is_raised(key)
            assert len(list(proxy.log())) == 2
            assert [(one.result, one.session, one.seq, one.created) for one in after] == [
                (0, before[0].session, seq, created) for seq, created in ((0, True), (1, False), (2, False))
            ]
            assert asked(bus, CommandQuestion(id="r2", command=Raise(key=key))).seq == 1  # another one, of this session


def asked(bus: Bus, question: CommandQuestion) -> CommandAnswer:
    """What the logger answers to a command, sent as it is."""
    verb = keys.verb_key(keys.LIVE, "plc1", "@do", str(question.command.__struct_config__.tag))
    found: list[CommandAnswer] = []

    def answered() -> bool:
        found.extend(
            msgspec.json.decode(one.payload, type=CommandAnswer) for one in bus.ask(verb, msgspec.json.encode(question))
        )
        return bool(found)

    assert eventually(answered)
    return found[0]


def _compare_state(bus: Bus, logger: Program, path: Path, clients: list[Client]) -> None:
    """What the logger answers now is what its file holds after one more kill."""
    state = {alarm.key: alarm for alarm in LoggerProxy(bus, "plc1", timeout_s=WAIT_S).active_alarms()}
    logger.kill()
    check(path, {comment: place for client in clients for comment, place in client.answered.items()})
    with Cache(path) as cache:
        kept = {stored.alarm.key: stored.alarm for stored in cache.load_alarms() if stored.alarm.is_active}
    assert {key: msgspec.structs.replace(alarm, suspect=False) for key, alarm in state.items()} == {
        key: msgspec.structs.replace(alarm, suspect=False) for key, alarm in kept.items()
    }


def test_after_a_kill_raised_alarms_are_suspect_until_their_source_speaks(bus_config: BusConfig, tmp_path: Path) -> None:
    """They come back as they were, marked; a confirmation leaves the mark, what their source says takes it off."""
    command = ("serve", "--target", "plc1", "--cache", str(tmp_path / "plc1.db"), "--scouting-group", bus_config.scouting_group)
    alarms = [AlarmKey("plc1", CLASS, number, None, "MAIN.pump") for number in range(4)]
    with open_bus(bus_config) as bus:
        proxy = LoggerProxy(bus, "plc1", timeout_s=WAIT_S)
        with program(*command) as logger:
            assert "is ready" in logger.line()
            for key in alarms:
                proxy.do(Create(key=key, severity=Severity.ERROR, with_confirmation=True))
                proxy.do(Raise(key=key))
            assert not any(alarm.suspect for alarm in proxy.active_alarms())
            logger.kill()
        with program(*command) as logger:
            assert "is ready" in logger.line()
            assert all(alarm.suspect for alarm in proxy.active_alarms())
            assert proxy.confirm_alarm(alarms[0]).suspect
            assert not proxy.clear_alarm(alarms[1]).suspect
            with pytest.raises(AdsError):  # it is raised: its source says so once more
                proxy.raise_alarm(alarms[2])
            suspects = [alarm.event_id for alarm in proxy.active_alarms() if alarm.suspect]
            assert sorted(suspects) == [0, 3]
