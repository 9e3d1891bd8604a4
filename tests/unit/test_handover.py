"""How items reach the user: a callback that raises or says "pause" waits for the next poll, and nothing is lost."""

import threading

import pytest

from bridge.core.events import Event, MessageSent
from bridge.handover import Handover, Polled, dispatch
from bridge.inbox import Inbox
from bridge.listener import Heard, Item, TailUnknown
from bridge.testing.builders import alarm_cleared, alarm_raised, message_sent


def handover(*items: Item) -> Handover:
    """The user's side with items waiting."""
    inbox: Inbox[Item] = Inbox(1024, "drop", lambda item: isinstance(item, Event))
    inbox.put(items)
    return Handover(inbox)


class Noted:
    """An observer that notes what it was called with, and answers what it is told."""

    def __init__(self, answers: dict[int, object] | None = None) -> None:
        self.seen: list[int] = []
        self.answers = answers or {}
        self.all_there = threading.Event()

    def on_message_sent(self, event: MessageSent) -> object:
        """Note the id; answer or raise what is laid out for it."""
        self.seen.append(event.event_id)
        if event.event_id == 5:
            self.all_there.set()
        answer = self.answers.get(event.event_id)
        if isinstance(answer, Exception):
            raise answer
        return answer


FIVE = [message_sent(event_id=number) for number in range(1, 6)]


def test_a_poll_takes_what_is_there_and_does_not_wait() -> None:
    """All five, then none; a limit is kept."""
    stream, noted = handover(*FIVE), Noted()
    assert stream.poll(noted, limit=2) == Polled(2, False)
    assert stream.poll(noted) == Polled(3, False)
    assert stream.poll(noted) == Polled(0, False)
    assert noted.seen == [1, 2, 3, 4, 5]


def test_pause_ends_a_poll_and_the_next_one_goes_on() -> None:
    """The item that was answered with "pause" counts as handed over; other answers mean nothing."""
    stream, noted = handover(*FIVE), Noted({1: None, 2: "pause", 3: 0, 4: "pause"})
    assert stream.poll(noted) == Polled(2, True)
    assert noted.seen == [1, 2]
    assert stream.poll(noted) == Polled(2, True)
    assert stream.poll(noted) == Polled(1, False)
    assert noted.seen == [1, 2, 3, 4, 5]


def test_an_error_comes_through_and_ends_the_poll() -> None:
    """The caller sees it; the next poll goes on behind the item."""
    stream, noted = handover(*FIVE), Noted({3: ValueError("three")})
    with pytest.raises(ValueError, match="three"):
        stream.poll(noted)
    assert noted.seen == [1, 2, 3]
    assert stream.poll(noted) == Polled(2, False)
    assert noted.seen == [1, 2, 3, 4, 5]


def test_an_observing_thread_survives_its_observer() -> None:
    """An error or a pause costs one cycle; the error is counted and kept, every item comes once."""
    error = ValueError("two")
    stream, noted = handover(*FIVE), Noted({2: error, 4: "pause"})
    thread = stream.observe(noted, cycle_s=0.01)
    assert noted.all_there.wait(30)
    stream.close()
    thread.join(30)
    assert not thread.is_alive()
    assert noted.seen == [1, 2, 3, 4, 5]
    assert (stream.callback_failures, stream.callback_error) == (1, error)


def test_closing_ends_the_pause_of_an_observing_thread() -> None:
    """Nobody waits for a long cycle."""
    stream, noted = handover(*FIVE), Noted({5: "pause"})
    thread = stream.observe(noted, cycle_s=3600)
    assert noted.all_there.wait(30)
    stream.close()
    thread.join(30)
    assert not thread.is_alive()


def test_each_kind_finds_its_method() -> None:
    """A cleared alarm says whether it left the list; bytes count as their event; notices have one method."""
    calls: list[object] = []

    class Observer:
        def on_alarm_cleared(self, event: Event, removed: bool) -> None:
            calls.append(removed)

        def on_message_sent(self, event: Event) -> None:
            calls.append(event.event_id)

        def on_notice(self, notice: object) -> str:
            calls.append(notice)
            return "pause"

    gone = TailUnknown("plc1", "s1")
    observer = Observer()
    assert not dispatch(observer, alarm_raised())
    assert not dispatch(observer, alarm_cleared())
    assert not dispatch(observer, Heard(FIVE[0], b"", "application/json", 0))
    assert dispatch(observer, gone)
    assert calls == [True, 1, gone]
