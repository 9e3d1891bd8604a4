"""What stays missing is told: nothing is taken for a number that was never promised unless its sender says so to the end."""

from collections.abc import Iterator

import msgspec
import pytest

from bridge import Gap, Listener, MessageSent, Severity, TailUnknown, open_bus
from bridge.core import codec, keys
from bridge.core.sequence import Beat, Missing
from bridge.edges.bus import ALONE, Answer, Bus, Question, Refusal, Reply
from bridge.testing.builders import EVENT_CLASS

SESSION = "sender"


def event(number: int) -> MessageSent:
    return MessageSent(
        target="plc1",
        event_class=EVENT_CLASS,
        event_id=1,
        severity=Severity.INFO,
        session=SESSION,
        seq=number,
        key_seq=number,
    )


KEY = keys.event_key("live", event(1))


class Sender:
    """Answers for SESSION: 3,001 events, all of them held, of which the first 10 came before anybody listened."""

    def __init__(self, bus: Bus, *, answers: int, cut: int = 0) -> None:
        """answers: how many questions it answers before it is gone; cut: how many events of each answer do not arrive."""
        self.bus, self.left, self.cut = bus, answers, cut
        bus.answer(keys.verb_key("live", "plc1", "@sent", SESSION), self.answer)
        beat = Beat(target="plc1", session=SESSION, seq=10)
        bus.put(keys.verb_key("live", "plc1", "@beat", SESSION), msgspec.json.encode(beat))

    def answer(self, question: Question) -> Iterator[Reply | Refusal]:
        if not question.payload:
            yield Reply(msgspec.json.encode(Beat(target="plc1", session=SESSION, seq=10)))
            return
        missing = msgspec.json.decode(question.payload, type=Missing)
        self.left -= 1
        if self.left < 0:
            yield Refusal("gone")
            return
        numbers = range(max(missing.first, missing.after_seq + 1), missing.last + 1 - self.cut)
        yield Reply(codec.join([codec.encode(event(number)) for number in numbers]), codec.JSON, b"0 3001")


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


@pytest.mark.parametrize(
    ("answers", "cut", "gaps"),
    [(2, 0, []), (1, 0, [(2049, 3000)]), (2, 5, [(2044, 2048), (2996, 3000)]), (0, 0, [(1, 3000)])],
    ids=["whole", "broken off", "incomplete", "silent"],
)
def test_what_a_sender_did_not_tell_to_the_end_is_missing(
    bus: Bus, answers: int, cut: int, gaps: list[tuple[int, int]]
) -> None:
    """Only what it says that it never promised, by giving all the rest, is no loss."""
    with Listener(bus) as listener:
        Sender(bus, answers=answers, cut=cut)
        assert listener.wait_for_beat(SESSION, timeout_s=30)
        bus.put(KEY, codec.encode(event(3001)))
        told, numbers = list[tuple[int, int]](), list[int]()
        while 3001 not in numbers:
            item = listener.get(30)
            assert item is not None
            if isinstance(item, Gap):
                told.append((item.missing.first, item.missing.last))
            elif isinstance(item, MessageSent):
                numbers.append(item.key_seq)
        assert told == gaps
        lost = {number for first, last in gaps for number in range(first, last + 1)}
        assert numbers == [number for number in range(11, 3002) if number not in lost]
        assert listener.counters.missing == len(lost)


def test_who_is_gone_without_a_word_is_named_and_not_asked(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its tail was told as unknown when it went; only so many of such are remembered."""
    monkeypatch.setattr("bridge.losses.MAX_ENDED", 3)
    asked: list[str] = []
    ask = bus.ask

    def note(key: str, payload: bytes = b"", *, timeout_s: float = 2.0, encoding: str = codec.JSON) -> list[Answer]:
        asked.append(key)
        return ask(key, payload, timeout_s=timeout_s, encoding=encoding)

    with Listener(bus) as listener:
        for number in range(5):
            session = f"dead{number}"
            token = bus.alive(keys.verb_key("live", "plc1", "@alive", "publisher", session))
            beat = Beat(target="plc1", session=session)
            bus.put(keys.verb_key("live", "plc1", "@beat", session), msgspec.json.encode(beat))
            assert listener.wait_for_beat(session, timeout_s=30)
            token.close()
            assert listener.get(30) == TailUnknown("plc1", session)
        monkeypatch.setattr(bus, "ask", note)
        assert listener.settle() == ["dead2", "dead3", "dead4"]
        assert not listener.tracker.heard("dead0")
        assert asked == []
