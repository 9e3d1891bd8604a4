"""A logger from elsewhere: answered, unanswered, answered twice."""

from collections.abc import Callable, Iterable, Iterator

import msgspec
import pytest

from bridge.core import keys
from bridge.core.alarms import AlarmKey
from bridge.core.events import ConfirmationState, Severity
from bridge.core.hresult import ADS_E_INVALIDSTATE, AdsError
from bridge.core.questions import CommandAnswer, CommandQuestion, LogPart, LogQuestion, Stored
from bridge.edges.bus import Bus, Question, Refusal, Reply
from bridge.listener import TwoLoggersError
from bridge.logger import CommandUnknownError, EventLogger, LoggerProxy, NoLoggerError
from bridge.testing.builders import TIME_NS, message_sent
from tests.unit.logger.logger_stories import CLASS, PUMP, alone, eventually, new_alarm

KEY = AlarmKey("plc1", CLASS, 1, None, PUMP.name, None)


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


def answering(bus: Bus, verb: str, *parts: str, give: Callable[[Question], Iterable[Reply | Refusal]]) -> None:
    """Somebody who answers questions to plc1 his own way."""
    bus.answer(keys.verb_key("live", "plc1", verb, *parts), give)


def answered(session: str, *, read_only: bool = False, result: int = 0) -> Callable[[Question], Iterable[Reply]]:
    """Answers every command in the name of a session."""

    def give(question: Question) -> Iterable[Reply]:
        asked = msgspec.json.decode(question.payload, type=CommandQuestion)
        answer = CommandAnswer(id=asked.id, session=session, read_only=read_only, result=result, detail="stepped back")
        return [Reply(msgspec.json.encode(answer))]

    return give


def test_connecting(bus: Bus) -> None:
    """The proxy sees the logger come and go, and tells; disconnecting tells too."""
    changes: list[bool] = []
    proxy = LoggerProxy(bus, "plc1", on_connection=changes.append)
    assert not proxy.is_connected
    assert not proxy.connect(timeout_s=0)
    with EventLogger("plc1", bus=bus):
        assert proxy.connect()
        assert proxy.is_connected
    assert eventually(lambda: changes == [True, False])
    assert not proxy.is_connected
    with EventLogger("plc1", bus=bus):
        assert eventually(lambda: proxy.is_connected)
        proxy.disconnect()
        assert changes == [True, False, True, False]
        assert not proxy.is_connected
        proxy.disconnect()
        with proxy:
            assert proxy.is_connected


def test_a_command_that_nobody_answers_is_unknown(bus: Bus) -> None:
    """After the time is up: which command, at whom, and that the logger answers nothing else either."""
    proxy = LoggerProxy(bus, "plc1", timeout_s=0)
    with pytest.raises(
        CommandUnknownError, match="raise at 'plc1' was not answered; its logger does not answer at all"
    ) as unknown:
        proxy.raise_alarm(KEY)
    assert (unknown.value.answers, unknown.value.alarm) == (False, None)


def test_questions_that_nobody_answers(bus: Bus) -> None:
    """There is no logger: an error, not an empty list."""
    proxy = LoggerProxy(bus, "plc1", timeout_s=0)
    with pytest.raises(NoLoggerError, match="no logger of 'plc1' answers @state"):
        proxy.active_alarms()
    with pytest.raises(NoLoggerError, match="no logger of 'plc1' answers @log"):
        list(proxy.log())


class _Deaf(EventLogger):
    """Carries a command out, but its first answers get lost."""

    lost = 0

    def _answer_command(self, question: Question) -> Iterator[Reply | Refusal]:
        reply = next(super()._answer_command(question))
        if self.lost:
            self.lost -= 1
            yield Refusal("lost on the way")
        else:
            yield reply


def test_a_lost_answer_is_asked_for_again(bus: Bus) -> None:
    """With the same id, so that the command is carried out once."""
    with _Deaf("plc1", bus=bus) as logger, LoggerProxy(bus, "plc1") as proxy:
        alarm = new_alarm(proxy)
        logger.lost = 3
        assert proxy.raise_alarm(alarm).raised
        assert (logger.publisher.seq, logger.lost) == (1, 0)


def test_when_all_answers_get_lost_the_state_is_read_back(bus: Bus) -> None:
    """The command stays unknown, but what the alarm is now is said."""
    with _Deaf("plc1", bus=bus) as logger, LoggerProxy(bus, "plc1", timeout_s=0.05) as proxy:
        alarm = new_alarm(logger)
        logger.lost = 1_000_000
        with pytest.raises(CommandUnknownError, match="the alarm is raised, wait_for_confirmation") as unknown:
            proxy.raise_alarm(alarm)
        assert unknown.value.answers
        assert unknown.value.alarm == logger.get_alarm(CLASS, 1, PUMP)
        assert unknown.value.reason == "lost on the way"
        assert logger.publisher.seq == 1


def test_two_answers_are_an_error(bus: Bus) -> None:
    """Whoever is right, the user must know: both sessions are named."""
    for session in ("a", "b"):
        answering(bus, "@do", "clear", give=answered(session))
    with pytest.raises(TwoLoggersError, match="'plc1' has 2 loggers: a, b"):
        LoggerProxy(bus, "plc1").clear_alarm(KEY)


def test_a_logger_that_has_stepped_back_does_not_count(bus: Bus) -> None:
    """Beside another one it is ignored; alone its refusal is the answer."""
    answering(bus, "@do", "dispose", give=answered("b", read_only=True, result=ADS_E_INVALIDSTATE))
    proxy = LoggerProxy(bus, "plc1")
    with pytest.raises(AdsError, match="stepped back"):
        proxy.dispose_alarm(KEY)
    answering(bus, "@do", "dispose", give=answered("a"))
    assert proxy.dispose_alarm(KEY).session == "a"


def part_of(session: str, part: int, *, last: bool, read_only: bool = False) -> Reply:
    events = (Stored(event=message_sent(session=session), unique_id=part),)
    return Reply(msgspec.json.encode(LogPart(session=session, part=part, last=last, events=events, read_only=read_only)))


def test_a_log_that_breaks_off_is_no_answer(bus: Bus) -> None:
    """A part is missing, or the last one: the asker learns that this was not all."""
    proxy = LoggerProxy(bus, "plc1")
    answering(bus, "@log", give=lambda _: [part_of("a", 0, last=False), part_of("a", 2, last=True)])
    with pytest.raises(NoLoggerError, match="part 1 of the answer is missing"):
        list(proxy.log())


def test_a_log_without_its_end_is_no_answer(bus: Bus) -> None:
    """The logger died while answering."""
    answering(bus, "@log", give=lambda _: [part_of("a", 0, last=False)])
    with pytest.raises(NoLoggerError, match="breaks off"):
        list(LoggerProxy(bus, "plc1").log())


def test_two_logs_are_an_error(bus: Bus) -> None:
    """As with commands, unless one has stepped back."""
    proxy = LoggerProxy(bus, "plc1")
    answering(bus, "@log", give=lambda _: [part_of("b", 5, last=True, read_only=True)])
    answering(bus, "@log", give=lambda _: [part_of("a", 0, last=True)])
    assert [stored.event.session for stored in proxy.log()] == ["a"]
    answering(bus, "@log", give=lambda _: [part_of("c", 0, last=True)])
    with pytest.raises(TwoLoggersError):
        list(proxy.log())


def test_the_log_of_a_logger_that_has_stepped_back(bus: Bus) -> None:
    """When nobody else answers, its log is better than none."""
    answering(bus, "@log", give=lambda _: [part_of("b", 0, last=True, read_only=True)])
    assert [stored.event.session for stored in LoggerProxy(bus, "plc1").log()] == ["b"]


def test_what_the_logger_refuses_is_said(bus: Bus) -> None:
    """A class name that neither side knows: the logger's words reach the asker."""
    with EventLogger("plc1", bus=bus), LoggerProxy(bus, "plc1") as proxy, pytest.raises(NoLoggerError, match="Pumps"):
        list(proxy.log(LogQuestion(filter="event_class = Pumps")))


def test_class_names_are_known_to_the_logger(bus: Bus) -> None:
    """A filter with a class name is answered by a logger that knows it, though the asker does not."""
    with (
        EventLogger("plc1", bus=bus, resolve_class=lambda name: [CLASS] if name == "Pumps" else []) as logger,
        LoggerProxy(bus, "plc1") as proxy,
    ):
        sent = logger.send_message(CLASS, 1, Severity.INFO)
        assert [stored.event for stored in proxy.log(LogQuestion(filter="event_class = Pumps"))] == [sent]


def test_messages_need_no_logger(bus: Bus) -> None:
    """They go out under the target with a session of the proxy's own, which ends with it."""
    with LoggerProxy(bus, "plc1", timeout_s=0) as proxy:
        first = proxy.send_message(CLASS, 1, Severity.INFO, time_ns=TIME_NS)
        second = proxy.send_message(CLASS, 1, Severity.INFO, time_ns=TIME_NS)
        assert (first.session, first.seq, second.seq) == (second.session, 1, 2)
        assert len(bus.who_is_alive(keys.verb_key("live", "plc1", "@alive", "publisher", None))) == 1
    assert bus.who_is_alive(keys.verb_key("live", "plc1", "@alive", "publisher", None)) == set()


def test_commands_by_two_proxies_meet_in_one_state(bus: Bus) -> None:
    """One raises, another confirms, the logger clears: each sees what the others did."""
    with EventLogger("plc1", bus=bus) as logger, LoggerProxy(bus, "plc1") as one, LoggerProxy(bus, "plc1") as two:
        alarm = new_alarm(one)
        one.raise_alarm(alarm)
        assert two.confirm_alarm(alarm).confirmation_state is ConfirmationState.CONFIRMED
        logger.clear_alarm(alarm)
        with pytest.raises(AdsError):
            one.clear_alarm(alarm)
