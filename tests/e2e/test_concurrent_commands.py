"""Many hands on one alarm: exactly one of them moves it, and asking again moves nothing."""

import multiprocessing
import threading
from multiprocessing.connection import Connection

import msgspec
import pytest

from bridge import AdsError, EventLogger, LoggerProxy, Severity, Source, open_bus
from bridge.core import keys
from bridge.core.alarms import AlarmKey, Confirm
from bridge.core.hresult import ADS_E_INVALIDSTATE, S_OK
from bridge.core.questions import CommandAnswer, CommandQuestion, LogQuestion
from bridge.edges.bus import BusConfig
from bridge.logger import TargetTakenError

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
SOURCE = Source(name="MAIN.pump")
PROCESSES, EACH = 4, 50


def confirm_often(config: BusConfig, key: AlarmKey, name: str, pipe: Connection) -> None:
    """Fifty confirms at once, from one process; what became of each."""
    results: list[int] = []
    lock = threading.Lock()
    with open_bus(config) as bus, LoggerProxy(bus, "plc1") as proxy:

        def confirm() -> None:
            try:
                proxy.confirm_alarm(key, operator=name)
                result = S_OK
            except AdsError as error:
                result = error.code
            with lock:
                results.append(result)

        pipe.send(proxy.connect(30))
        pipe.recv()
        threads = [threading.Thread(target=confirm) for _ in range(EACH)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        pipe.send(results)


@pytest.mark.timeout(180)
def test_two_hundred_confirms_make_one_transition(bus_config: BusConfig) -> None:
    """From four processes at once: one succeeds, the others hear ADS_E_INVALIDSTATE, and the log holds one confirmation."""
    spawn = multiprocessing.get_context("spawn")
    with open_bus(bus_config) as bus, EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, source=SOURCE).alarm
        logger.raise_alarm(alarm)
        pairs = [spawn.Pipe() for _ in range(PROCESSES)]
        processes = [
            spawn.Process(target=confirm_often, args=(bus_config, alarm.key, f"hand {n}", theirs), daemon=True)
            for n, (_, theirs) in enumerate(pairs)
        ]
        try:
            for process in processes:
                process.start()
            for ours, _ in pairs:
                assert ours.poll(60)
                assert ours.recv() is True
            for ours, _ in pairs:
                ours.send("go")
            results: list[int] = []
            for ours, _ in pairs:
                assert ours.poll(90)
                results += ours.recv()
        finally:
            for process in processes:
                process.join(10)
                if process.is_alive():
                    process.kill()
        assert len(results) == PROCESSES * EACH
        assert sorted(set(results)) == [S_OK, ADS_E_INVALIDSTATE]
        assert results.count(S_OK) == 1
        confirmed = list(logger.log(LogQuestion(filter="kind = alarm_confirmed")))
        assert len(confirmed) == 1
        assert confirmed[0].event.operator.startswith("hand ")


def test_asking_again_with_the_same_id_changes_nothing(bus_config: BusConfig) -> None:
    """Whoever never got the reply (its bus was closed while it waited) asks again and gets the same answer."""
    with open_bus(bus_config) as bus, EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, source=SOURCE).alarm
        logger.raise_alarm(alarm)
        question = msgspec.json.encode(CommandQuestion(id="once", command=Confirm(key=alarm.key, operator="anna")))
        key = keys.verb_key("live", "plc1", "@do", "confirm")
        with open_bus(bus_config) as first:
            assert first.ask(key, question, timeout_s=0.001) is not None  # the reply may or may not have come: it is dropped
        with open_bus(bus_config) as second:
            answers = [msgspec.json.decode(answer.payload, type=CommandAnswer) for answer in second.ask(key, question)]
            again = [msgspec.json.decode(answer.payload, type=CommandAnswer) for answer in second.ask(key, question)]
        assert [answer.result for answer in answers] == [S_OK]
        assert again == answers
        assert len(list(logger.log(LogQuestion(filter="kind = alarm_confirmed")))) == 1


def test_a_second_logger_of_the_target_is_refused(bus_config: BusConfig) -> None:
    """The error names the session that has the name; the first goes on."""
    with open_bus(bus_config) as here, open_bus(bus_config) as there, EventLogger("plc1", bus=here) as logger:
        with pytest.raises(TargetTakenError, match=logger.session):
            EventLogger("plc1", bus=there)
        assert logger.send_message(CLASS, 1, Severity.INFO).seq
