"""Gaps, in place: what could be repaired comes where it belongs, what could not is named, however much a stranger claims."""

import json
from collections.abc import Iterator

import msgspec
import pytest

from bridge.core import codec, keys
from bridge.core.events import MessageSent
from bridge.core.sequence import Beat
from bridge.edges.bus import ALONE, Bus, Question, Reply, open_bus
from bridge.listener import Gap, Item, Listener, Rejected
from bridge.publisher import Publisher
from bridge.testing.builders import message_sent
from tests.e2e.fault_stories import eventually

KEY = keys.event_key("live", message_sent())


def event(number: int) -> MessageSent:
    """The event of session s1 with this number on its key."""
    return message_sent(session="s1", seq=number, key_seq=number, event_id=number % 1000)


def hear(bus: Bus, listener: Listener, numbers: tuple[int, ...], count: int) -> list[Item | None]:
    """What the listener hands over when these events are put, each by itself."""
    for number in numbers:
        bus.put(KEY, codec.encode(event(number)))
    return [listener.get(10) for _ in range(count)]


def shown(item: Item | None) -> int | tuple[int, int]:
    """An event as its number, a gap as its range."""
    if isinstance(item, Gap):
        return item.missing.first, item.missing.last
    assert isinstance(item, MessageSent)
    return item.key_seq


@pytest.mark.parametrize(
    ("held", "items", "missing"),
    [
        ((), [1, (2, 9), 10], 8),
        ((2, 3, 4, 5, 6, 7, 8, 9), list(range(1, 11)), 0),
        ((4, 5), [1, (2, 3), 4, 5, (6, 9), 10], 6),
        ((2, 9), [1, 2, (3, 8), 9, 10], 6),
        ((3, 5, 7), [1, (2, 2), 3, (4, 4), 5, (6, 6), 7, (8, 9), 10], 5),
    ],
)
def test_what_is_repaired_and_what_is_missing_stand_in_place(
    held: tuple[int, ...], items: list[int | tuple[int, int]], missing: int
) -> None:
    """1 and 10 come; the sender still holds some of 2 to 9, and says that it let others go."""

    def answer(question: Question) -> Iterator[Reply]:
        asked = json.loads(question.payload)
        assert (asked["first"], asked["last"]) == (2, 9)
        yield Reply(codec.join([codec.encode(event(number)) for number in held]), codec.JSON, b"8")

    with open_bus(ALONE) as bus, Listener(bus) as listener:
        bus.answer(keys.verb_key("live", "plc1", "@sent", "s1"), answer)
        found = hear(bus, listener, (1, 10), len(items))
    assert [shown(item) for item in found] == items
    assert (listener.counters.missing, listener.counters.repaired) == (missing, len(held))


@pytest.mark.parametrize("number", [2**32, 2**63 - 1])
def test_a_number_from_nowhere_costs_nothing(number: int) -> None:
    """A stranger claims an astronomical number: one gap is reported at once, nobody counts up to it."""
    with open_bus(ALONE) as bus, Listener(bus) as listener:
        found = hear(bus, listener, (1, number), 3)
    assert [shown(item) for item in found] == [1, (2, number - 1), number]
    assert listener.counters.missing == number - 2


def test_a_stranger_with_a_real_session_cannot_shut_out_what_follows() -> None:
    """Numbers that the sender never gave are rejected; its own events after them are no duplicates."""
    with open_bus(ALONE) as bus, Listener(bus) as listener, Publisher(bus, "plc1") as publisher:
        genuine = [publisher.send(message_sent(session="", seq=0, key_seq=0, event_id=number)) for number in range(3)]
        assert listener.wait_for_beat(publisher.session)
        assert listener.take(3) == genuine
        for number in (5, 2**40):
            bus.put(KEY, codec.encode(message_sent(session=publisher.session, seq=number, key_seq=number)))
            rejected = listener.get(10)
            assert isinstance(rejected, Rejected)
            assert f"number {number} is beyond" in rejected.reason
            follows = publisher.send(message_sent(session="", seq=0, key_seq=0))
            assert listener.get(10) == follows
    assert (listener.counters.rejected_events, listener.counters.duplicates, listener.counters.missing) == (2, 0, 0)


def test_a_stranger_who_comes_before_the_first_beat_is_found_out() -> None:
    """Nothing is promised before the first beat; what a stranger claimed until then is set right by it."""
    with open_bus(ALONE) as bus, Listener(bus) as listener:
        assert [shown(item) for item in hear(bus, listener, (2**40,), 1)] == [2**40]
        bus.answer(keys.verb_key("live", "plc1", "@sent", "s1"), lambda _question: [Reply(b"[]", codec.JSON, b"0 7")])
        beat = Beat(target="plc1", session="s1", seq=7, keys={KEY: 7})
        bus.put(keys.verb_key("live", "plc1", "@beat", "s1"), msgspec.json.encode(beat))
        assert listener.wait_for_beat("s1")
        assert [shown(item) for item in hear(bus, listener, (8, 9), 2)] == [8, 9]
    assert (listener.counters.duplicates, listener.counters.missing) == (0, 0)


def test_a_beat_that_claims_more_than_was_sent_makes_no_gap() -> None:
    """The sender is asked, and what it never numbered is not missing."""
    asked: list[bytes] = []

    def answer(question: Question) -> list[Reply]:
        asked.append(question.payload)
        return [Reply(b"[]", codec.JSON, b"0 1")]

    with open_bus(ALONE) as bus, Listener(bus) as listener:
        bus.answer(keys.verb_key("live", "plc1", "@sent", "s1"), answer)
        hear(bus, listener, (1,), 1)
        for claimed in (1, 2**40):
            beat = Beat(target="plc1", session="s1", seq=claimed, keys={KEY: claimed})
            bus.put(keys.verb_key("live", "plc1", "@beat", "s1"), msgspec.json.encode(beat))
            assert listener.wait_for_beat("s1")
        assert eventually(lambda: len(asked) == 1)
        assert [shown(item) for item in hear(bus, listener, (2,), 1)] == [2]
    assert (listener.counters.duplicates, listener.counters.missing) == (0, 0)
