"""Questions and answers: what a logger is asked on the bus, as the JSON that anybody can write."""

import msgspec
import pytest

from bridge.core.alarms import Alarm, AlarmKey, Clear, Confirm, Create, Dispose, Raise, fold
from bridge.core.arguments import ZERO_GUID, Argument
from bridge.core.events import ConfirmationState, Severity
from bridge.core.questions import (
    PART_ITEMS,
    ClearLogAnswer,
    ClearLogQuestion,
    CommandAnswer,
    CommandQuestion,
    LogPart,
    LogQuestion,
    StatePart,
    Stored,
)
from bridge.core.sequence import Beat, Missing
from bridge.testing.builders import EVENT_CLASS, alarm_raised, message_sent

KEY = AlarmKey("plc1", EVENT_CLASS, 7, 0, "", ZERO_GUID)
(ALARM,) = fold([alarm_raised(source_id=0, session="s1", seq=3, arguments=(Argument.of(1),))]).alarms.values()

MESSAGES: list[msgspec.Struct] = [
    Beat(target="plc1", session="s1", role="logger", seq=9, keys={"k": 4}, final=True, unsent=2),
    Beat(target="plc1", session="s1"),
    StatePart(target="plc1", session="s1", seq=3, part=1, parts=2, alarms=(ALARM,)),
    StatePart(target="plc1", session="s1", seq=0),
    LogQuestion(filter="severity >= error", limit=10, offset=5, newest_first=False),
    LogQuestion(missing=Missing("s1", "k", 4, 6, 2)),
    LogQuestion(sort="event_text", lang="de", take_last=True, view="occurrences"),
    ClearLogQuestion(id="1", which=LogQuestion(filter="is_alarm", limit=3), operator="op", client="hmi", comment="full"),
    ClearLogAnswer(id="1", session="s1", result=0x98110712, detail="no", cleared=3, read_only=True),
    LogPart(
        session="s1",
        part=1,
        last=False,
        events=(Stored(event=message_sent(source_name=""), unique_id=1, arrival_ns=2), Stored(event=alarm_raised())),
    ),
    CommandQuestion(id="1", command=Create(key=KEY, severity=Severity.ERROR, with_confirmation=True, vendor_id=0)),
    CommandQuestion(id="1", command=Raise(key=KEY, time_ns=5, arguments=(), json_attribute="")),
    CommandQuestion(id="1", command=Clear(key=KEY, reset_confirmation=True)),
    CommandQuestion(id="1", command=Confirm(key=KEY, operator="op", client="hmi", comment="seen")),
    CommandQuestion(id="1", command=Dispose(key=KEY)),
    CommandAnswer(id="1", session="s1", result=0x98110712, detail="no", alarm=ALARM, created=True, seq=3),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_what_is_asked_and_answered_comes_back(message: msgspec.Struct) -> None:
    """Through JSON, with every field; absent and empty sources of an alarm's key stay apart."""
    assert msgspec.json.decode(msgspec.json.encode(message), type=type(message)) == message


def test_a_command_can_be_written_by_hand() -> None:
    """An id, what to do, and which alarm: the rest has defaults."""
    text = f'{{"id":"42","command":{{"do":"confirm","key":{{"target":"plc1","event_class":"{EVENT_CLASS}","event_id":7}}}}}}'
    question = msgspec.json.decode(text, type=CommandQuestion)
    assert question == CommandQuestion(id="42", command=Confirm(key=AlarmKey("plc1", EVENT_CLASS, 7)))
    assert msgspec.json.encode(question).decode() == text


def test_each_call_has_its_word() -> None:
    """create, raise, clear, confirm, dispose: as the table of alarms and the command's key name them."""
    words = [
        msgspec.json.decode(msgspec.json.encode(message))["command"]["do"]
        for message in MESSAGES
        if isinstance(message, CommandQuestion)
    ]
    assert words == ["create", "raise", "clear", "confirm", "dispose"]


def test_none_and_empty_are_different_orders() -> None:
    """Without arguments those of the alarm stay; an empty list takes them away."""
    keep, empty = Raise(key=KEY), Raise(key=KEY, arguments=(), json_attribute="")
    assert b"arguments" not in msgspec.json.encode(keep)
    assert b'"arguments":[]' in msgspec.json.encode(empty)
    assert b'"json_attribute":""' in msgspec.json.encode(empty)


@pytest.mark.parametrize(
    "command",
    [
        '{"do":"acknowledge"}',
        '{"do":"raise"}',
        '{"do":"create","key":KEY}',
        '{"do":"create","key":KEY,"severity":5}',
        '{"do":"raise","key":KEY,"time_ns":-1}',
        '{"do":"raise","key":KEY,"arguments":[{"type":-1,"value":""}]}',
        '{"do":"raise","key":{"target":"plc1"}}',
    ],
)
def test_a_bad_command_is_no_command(command: str) -> None:
    """An unknown word, no alarm, no severity, numbers out of range: refused while reading, before anything is done."""
    key = msgspec.json.encode(KEY).decode()
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(f'{{"id":"1","command":{command.replace("KEY", key)}}}', type=CommandQuestion)


def test_an_alarm_in_a_state_has_the_names_of_an_event() -> None:
    """Who reads events reads states: the same names, defaults left out."""
    assert msgspec.json.decode(msgspec.json.encode(ALARM)) == {
        "target": "plc1",
        "event_class": EVENT_CLASS,
        "event_id": 1,
        "severity": 1,
        "source_id": 0,
        "raised": True,
        "time_ns": ALARM.time_ns,
        "time_raised_ns": ALARM.time_ns,
        "arguments": [{"type": 4, "value": "1"}],
        "session": "s1",
        "seq": 3,
    }
    assert msgspec.convert({"target": "", "event_class": "", "event_id": 0, "severity": 0}, Alarm).confirmation_state is (
        ConfirmationState.NOT_SUPPORTED
    )


def test_a_question_without_words_asks_for_all() -> None:
    """Every stored event, the newest first."""
    question = msgspec.json.decode("{}", type=LogQuestion)
    assert (question.filter, question.limit, question.offset, question.newest_first, question.missing) == ("", 0, 0, True, None)


def test_an_answer_has_at_most_a_thousand_items() -> None:
    """More come in parts; the promise stands in docs/promises.md."""
    assert PART_ITEMS == 1000
