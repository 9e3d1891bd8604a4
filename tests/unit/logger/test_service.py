"""The EventLogger: one per target, its alarms, what it stores and answers, and how it ends."""

import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge.core import keys
from bridge.core.alarms import AlarmKey, Clear, Raise
from bridge.core.events import AlarmDisposed, LimitError, MessageSent, Severity
from bridge.core.hresult import ADS_E_BUSY, ADS_E_INVALIDSTATE, ADS_E_NOMEMORY, AdsError
from bridge.core.questions import CommandAnswer, CommandQuestion, LogPart, LogQuestion, StatePart
from bridge.core.sequence import Beat, Missing
from bridge.edges.bus import ALONE, Bus
from bridge.edges.cache import Cache, CacheError, StoreBatch
from bridge.logger import EventLogger, TargetTakenError
from bridge.logger.presence import loggers, token_key
from bridge.publisher import Publisher, PublisherClosedError
from bridge.testing.builders import TIME_NS, alarm_raised, message_sent
from tests.unit.logger.logger_stories import CLASS, PUMP, alone, eventually, new_alarm, put


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


@pytest.fixture
def logger(bus: Bus) -> Iterator[EventLogger]:
    """The logger of plc1 on that bus, at a time that stands still."""
    with EventLogger("plc1", bus=bus, clock=lambda: TIME_NS) as logger:
        yield logger


def asked(bus: Bus, command: Raise | Clear, id: str = "x", key: str | None = None) -> CommandAnswer | str:
    """A command over the bus; a text is a refusal."""
    name = key or str(command.__struct_config__.tag)
    payload = msgspec.json.encode(CommandQuestion(id=id, command=command))
    (answer,) = bus.ask(keys.verb_key("live", "plc1", "@do", name), payload)
    return answer.payload.decode() if answer.error else msgspec.json.decode(answer.payload, type=CommandAnswer)


def state(bus: Bus) -> StatePart:
    (answer,) = bus.ask(keys.verb_key("live", "plc1", "@state"))
    return msgspec.json.decode(answer.payload, type=StatePart)


def log(bus: Bus, question: LogQuestion) -> list[LogPart]:
    answers = bus.ask(keys.verb_key("live", "plc1", "@log"), msgspec.json.encode(question))
    return [msgspec.json.decode(answer.payload, type=LogPart) for answer in answers]


def test_a_message_is_sent_and_stored(logger: EventLogger) -> None:
    """It has this logger's session and number, the caller as source, and a unique id in the log."""
    sent = logger.send_message(CLASS, 7, Severity.WARNING, arguments=("axis", 3))
    assert (sent.session, sent.seq, sent.time_ns) == (logger.session, 1, TIME_NS)
    assert sent.source_name is not None
    assert sent.source_name.endswith("test_a_message_is_sent_and_stored")
    (stored,) = logger.log()
    assert (stored.event, stored.unique_id, stored.arrival_ns) == (sent, 1, TIME_NS)
    with pytest.raises(LimitError):
        logger.send_message(CLASS, 7, Severity.WARNING, json_attribute="x" * 9000)


def test_a_taken_name_is_refused_until_it_is_free(bus: Bus) -> None:
    """The second logger is told whose name it is; after the first has closed there is room again. Realms are apart."""
    with EventLogger("plc1", bus=bus) as first:
        with pytest.raises(TargetTakenError) as taken:
            EventLogger("plc1", bus=bus)
        assert (taken.value.target, taken.value.session) == ("plc1", first.session)
        EventLogger("plc1", bus=bus, realm="replay-1").close()
        EventLogger("plc2", bus=bus).close()
        assert loggers(bus, "plc1") == {first.session}
    assert loggers(bus, "plc1") == set()
    EventLogger("plc1", bus=bus).close()


def test_a_token_nobody_answers_for_holds_the_name_only_while_it_lasts(bus: Bus) -> None:
    """A killed logger's token may linger: opening waits for it to vanish, and refuses when it does not."""
    ghost = bus.alive(token_key("plc1", "live", "ghost"))
    with pytest.raises(TargetTakenError, match="ghost"):
        EventLogger("plc1", bus=bus)
    opened: list[EventLogger] = []
    opening = threading.Thread(target=lambda: opened.append(EventLogger("plc1", bus=bus)))
    opening.start()
    ghost.close()
    opening.join(10)
    (logger,) = opened
    assert not logger.read_only
    logger.close()


def test_commands_over_the_bus(bus: Bus, logger: EventLogger) -> None:
    """A command on its key is carried out and answered, once per id."""
    alarm = new_alarm(logger)
    answer = asked(bus, Raise(key=alarm.key, operator="anna"), "mine")
    assert isinstance(answer, CommandAnswer)
    assert (answer.session, answer.seq, answer.alarm) == (logger.session, 1, logger.get_alarm(CLASS, 1, PUMP))
    assert asked(bus, Raise(key=alarm.key, operator="anna"), "mine") == answer
    assert logger.publisher.seq == 1


def test_a_command_on_another_commands_key_is_refused(bus: Bus, logger: EventLogger) -> None:
    """Access may be granted command by command, so a key lets only its own command through."""
    alarm = new_alarm(logger)
    assert asked(bus, Raise(key=alarm.key), key="clear") == "raise was asked on the key of clear"
    assert not logger.is_raised(alarm)


@pytest.mark.parametrize("verb", ["@log", "@do"])
@pytest.mark.parametrize("payload", [b"\xff", b"[", b'{"id": 1, "limit": -1}', b"[" * 5000, b'{"filter": 3}'])
def test_a_question_that_is_none_is_refused(bus: Bus, logger: EventLogger, verb: str, payload: bytes) -> None:
    """Hostile bytes get a refusal, and the logger answers the next question."""
    parts = ("raise",) if verb == "@do" else ()
    (answer,) = bus.ask(keys.verb_key("live", "plc1", verb, *parts), payload)
    assert answer.error
    assert state(bus).session == logger.session


def test_the_state_fits_its_number(bus: Bus, logger: EventLogger) -> None:
    """@state has the alarms after exactly `seq` events of the session, messages counted too."""
    assert state(bus) == StatePart(target="plc1", session=logger.session, seq=0)
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm)
    logger.send_message(CLASS, 7, Severity.INFO)
    part = state(bus)
    assert (part.seq, part.alarms) == (2, (logger.get_alarm(CLASS, 1, PUMP),))


def test_messages_of_others_are_stored_and_their_transitions_rejected(bus: Bus, logger: EventLogger) -> None:
    """A publisher without a logger of its own is in this one's log; only this logger makes transitions."""
    with Publisher(bus, "plc1") as publisher:
        sent = publisher.send_message(CLASS, 7, Severity.INFO)
    put(bus, alarm_raised(session="stranger", seq=1, key_seq=1))
    assert eventually(lambda: (logger.counters.received, logger.counters.rejected) == (1, 1))
    assert [stored.event for stored in logger.log()] == [sent]
    assert logger.active_alarms() == []


def test_own_events_are_stored_once(bus: Bus, logger: EventLogger) -> None:
    """They come back over the bus, and are passed over there."""
    for number in range(100):
        logger.send_message(CLASS, number, Severity.INFO)
    put(bus, message_sent(session="stranger", seq=1, key_seq=1))
    assert eventually(lambda: logger.counters.received == 1)
    assert len(list(logger.log())) == 101


def test_the_log_over_the_bus(bus: Bus, logger: EventLogger) -> None:
    """Filter, limit, offset and order are the asker's; a long answer comes in parts of a thousand."""
    for number in range(2500):
        logger.send_message(CLASS, number, Severity.WARNING if number % 2 else Severity.INFO)
    parts = log(bus, LogQuestion())
    assert [(part.part, part.last, len(part.events)) for part in parts] == [(0, False, 1000), (1, False, 1000), (2, True, 500)]
    assert {part.session for part in parts} == {logger.session}
    (part,) = log(bus, LogQuestion(filter="severity >= warning and event_id < 10", limit=2, offset=1))
    assert [stored.event.event_id for stored in part.events] == [7, 5]
    (part,) = log(bus, LogQuestion(limit=1, newest_first=False))
    assert [stored.event.event_id for stored in part.events] == [0]
    (empty,) = log(bus, LogQuestion(filter="event_id = 99999"))
    assert (empty.last, empty.events) == (True, ())
    (answer,) = bus.ask(keys.verb_key("live", "plc1", "@log"), msgspec.json.encode(LogQuestion(filter="sevrity = 1")))
    assert answer.error
    assert "did you mean" in answer.payload.decode()


def test_what_somebody_missed_can_be_asked_from_the_log(bus: Bus, logger: EventLogger) -> None:
    """A range of numbers of a session and key, only above a seq when the asker was promised no more."""
    sent = [logger.send_message(CLASS, 7, Severity.INFO) for _ in range(5)]
    logger.send_message(CLASS, 7, Severity.ERROR)
    key = keys.event_key("live", sent[0])
    (part,) = log(bus, LogQuestion(missing=Missing(logger.session, key, 2, 4)))
    assert [stored.event for stored in part.events] == sent[1:4]
    (part,) = log(bus, LogQuestion(missing=Missing(logger.session, key, 2, 4, after_seq=3)))
    assert [stored.event for stored in part.events] == sent[3:4]


def test_a_command_is_refused_before_anything_changes_when_the_queue_is_full(bus: Bus) -> None:
    """ADS_E_BUSY; no number is used, the alarm is as before, and the same id keeps that answer."""
    with EventLogger("plc1", bus=bus, queue_events=0) as logger:
        alarm = new_alarm(logger)
        question = CommandQuestion(id="x", command=Raise(key=alarm.key))
        refused = logger._do(question)
        assert (refused.result, refused.alarm) == (ADS_E_BUSY, alarm)
        assert logger._do(question) == refused
        assert (logger.publisher.seq, logger.is_raised(alarm)) == (0, False)
        with pytest.raises(AdsError, match="no room"):
            logger.raise_alarm(alarm)


class _Failing(Cache):
    """A cache whose disk is full whenever the test says so."""

    full = False

    def append(self, batch: StoreBatch, *, durable: bool = False) -> None:
        if self.full:
            raise CacheError(self.path, "disk is full")
        super().append(batch, durable=durable)

    @property
    def error(self) -> CacheError | None:
        return CacheError(self.path, "disk is full") if self.full else None


def test_what_cannot_be_stored_is_refused(bus: Bus) -> None:
    """While the cache takes nothing, commands are ADS_E_NOMEMORY and lost messages are counted; then it goes on."""
    cache = _Failing()
    with EventLogger("plc1", bus=bus, cache=cache) as logger:
        alarm = new_alarm(logger)
        cache.full = True
        with pytest.raises(AdsError, match="disk is full") as refused:
            logger.raise_alarm(alarm)
        assert refused.value.code == ADS_E_NOMEMORY
        logger.send_message(CLASS, 7, Severity.INFO)
        assert state(bus).seq == 1
        assert logger.book.unstored == 1
        cache.full = False
        assert logger.raise_alarm(alarm).raised
        assert len(list(logger.log())) == 1


def test_a_logger_goes_on_where_its_cache_ends(tmp_path: Path, bus: Bus) -> None:
    """After a clean stop: raised alarms were disposed of, waiting and created ones are back, ids and the log go on."""
    path = tmp_path / "plc1.db"
    with EventLogger("plc1", bus=bus, cache=path) as first:
        raised, waiting, idle = (new_alarm(first, number) for number in (1, 2, 3))
        first.raise_alarm(raised)
        first.raise_alarm(waiting)
        first.clear_alarm(waiting)
        last = max(stored.unique_id for stored in first.log())
    with EventLogger("plc1", bus=bus, cache=path) as second:
        assert second.session > first.session
        assert second.book.alarms.keys() == {waiting.key, idle.key}
        assert [alarm.key for alarm in second.active_alarms()] == [waiting.key]
        assert [alarm.key for alarm in state(bus).alarms] == [waiting.key]
        newest = next(iter(second.log()))
        assert isinstance(newest.event, AlarmDisposed)
        assert (newest.event.session, newest.event.event_id) == (first.session, 1)
        second.confirm_alarm(waiting)
        second.raise_alarm(idle)
        ids = [stored.unique_id for stored in second.log(LogQuestion(limit=2))]
        assert ids[0] > last
        assert ids[1] == next(s.unique_id for s in second.log() if s.event.kind == "alarm_cleared")


def test_durable_commands_are_on_the_disk(tmp_path: Path, bus: Bus) -> None:
    """With durable=True a command waits for a synced commit."""
    with EventLogger("plc1", bus=bus, cache=tmp_path / "plc1.db", durable=True) as logger:
        logger.raise_alarm(new_alarm(logger))
        assert int(logger.book.cache.meta()["durable_commits"]) >= 2


def test_the_end(bus: Bus) -> None:
    """Closing disposes of raised alarms, says a last word that counts them, and refuses what comes later."""
    beats = bus.receiver(keys.verb_key("live", "plc1", "@beat", None))
    logger = EventLogger("plc1", bus=bus)
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm)
    assert logger.close() == 0
    assert logger.close() == 0
    last = msgspec.json.decode(beats.receive_now()[-1].payload, type=Beat)
    assert (last.final, last.seq, last.unsent, last.session) == (True, 2, 0, logger.session)
    with pytest.raises(AdsError, match="closed") as refused:
        logger.create_alarm(CLASS, 1, Severity.INFO)
    assert refused.value.code == ADS_E_INVALIDSTATE
    with pytest.raises(PublisherClosedError):
        logger.send_message(CLASS, 1, Severity.INFO)
    assert bus.ask(keys.verb_key("live", "plc1", "@state")) == []


def test_alarms_that_cannot_be_disposed_of_are_counted_as_unsent(bus: Bus) -> None:
    """A queue without room at the end: close() says how many transitions are missing; the alarms stay as they were."""
    logger = EventLogger("plc1", bus=bus)
    alarms = [new_alarm(logger, number) for number in range(3)]
    for alarm in alarms:
        logger.raise_alarm(alarm)
    logger.publisher.flush()
    logger.publisher._queue_events = 0
    assert logger.close() == 3
    assert len(logger.book.alarms) == 3


def test_a_logger_with_a_bus_of_its_own() -> None:
    """Without a bus it opens one from the settings, and closes it."""
    with EventLogger("plc1", config=ALONE) as logger:
        assert isinstance(logger.send_message(CLASS, 1, Severity.INFO), MessageSent)
        bus = logger.bus
    assert bus.close()


def test_a_logger_steps_back_for_an_older_one(bus: Bus) -> None:
    """It refuses commands and says why, still stores and answers, and gives the name free when the older one is gone."""
    reasons: list[str] = []
    with EventLogger("plc1", bus=bus, on_read_only=reasons.append) as logger:
        alarm = new_alarm(logger)
        logger.raise_alarm(alarm)
        older = bus.alive(token_key("plc1", "live", "0000"))
        assert eventually(lambda: bool(reasons))
        assert logger.read_only == reasons[0]
        assert "session 0000 is an older logger of plc1" in reasons[0]
        with pytest.raises(AdsError, match="older logger") as refused:
            logger.clear_alarm(alarm)
        assert refused.value.code == ADS_E_INVALIDSTATE
        answer = asked(bus, Clear(key=alarm.key))
        assert isinstance(answer, CommandAnswer)
        assert answer.read_only
        assert state(bus).read_only
        put(bus, message_sent(session="stranger", seq=1, key_seq=1))
        assert eventually(lambda: logger.counters.received == 1)
        older.close()
        with EventLogger("plc1", bus=bus) as next_logger:
            assert not next_logger.read_only
            assert logger.read_only
    assert len(logger.book.alarms) == 1, "a logger that has stepped back makes no transitions, at its end neither"


def test_a_logger_stays_when_a_younger_one_appears(bus: Bus, logger: EventLogger) -> None:
    """The other one has to step back."""
    younger = bus.alive(token_key("plc1", "live", "ffff"))
    logger.raise_alarm(new_alarm(logger))
    assert not logger.read_only
    younger.close()


def test_many_threads_command_one_logger(logger: EventLogger) -> None:
    """Two hundred confirms of one alarm make one transition; all the others are ADS_E_INVALIDSTATE."""
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm)
    results: list[int] = []

    def confirm() -> None:
        for _ in range(50):
            try:
                logger.confirm_alarm(alarm)
            except AdsError as error:
                results.append(error.code)
            else:
                results.append(0)

    threads = [threading.Thread(target=confirm) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(results) == [0] + [ADS_E_INVALIDSTATE] * 199
    assert logger.publisher.seq == 2


def test_an_alarm_of_another_target_is_refused(logger: EventLogger) -> None:
    """A key of plc2 sent to the logger of plc1 is a mistake of the caller."""
    with pytest.raises(AdsError, match="'plc2' at 'plc1'"):
        logger.raise_alarm(AlarmKey("plc2", CLASS, 1))
