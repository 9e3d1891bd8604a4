"""An observer as a PLC has it, on a real bus: subscribed once, called back inside Execute(), paused by its own answer."""

from collections.abc import Callable

import pytest

from bridge import MessageSent, Publisher, Severity, open_bus
from bridge.core.events import AlarmCleared
from bridge.core.hresult import ADS_E_EXISTS, ADS_E_NOTFOUND, S_OK, AdsError
from bridge.edges.bus import ALONE, Bus
from bridge.inbox import Dropped
from bridge.logger import EventLogger
from bridge.twincat.config import TcEventFilterConfig
from bridge.twincat.filters import FB_TcEventFilter
from bridge.twincat.listener import MAX_QUEUED, FB_ListenerBase2

A, B = "00000000-0000-0000-0000-00000000000a", "00000000-0000-0000-0000-00000000000b"


class Noting(FB_ListenerBase2):
    """Notes what it hears; answers S_FALSE (1) to messages whose id is asked for."""

    def __init__(self, bus: Bus, pause_at: int = 0) -> None:
        super().__init__(bus)
        self.heard: list[object] = []
        self.pause_at = pause_at

    def OnMessageSent(self, fbEvent: MessageSent) -> int | None:
        """Note the id."""
        self.heard.append(fbEvent.event_id)
        return 1 if fbEvent.event_id == self.pause_at else S_OK

    def OnAlarmCleared(self, fbEvent: AlarmCleared, bRemove: bool) -> int | None:
        """Note whether it left the list."""
        self.heard.append(bRemove)
        return None

    def OnNotice(self, notice: object) -> int | None:
        """Note it."""
        self.heard.append(notice)
        return None


def run_until(block: FB_ListenerBase2, there: Callable[[], bool]) -> int:
    """Cycles until the condition holds."""
    for cycle in range(1, 3_000_000):
        assert block.Execute() == S_OK
        if there():
            return cycle
    raise AssertionError("it never came")


def test_subscribing_twice_and_unsubscribing_when_not_subscribed() -> None:
    """ADS_E_EXISTS and ADS_E_NOTFOUND, as the manual says; after Unsubscribe it can subscribe again."""
    with open_bus(ALONE) as bus:
        block = Noting(bus)
        with pytest.raises(AdsError) as caught:
            block.Unsubscribe()
        assert caught.value.code == ADS_E_NOTFOUND
        assert block.Subscribe2(FB_TcEventFilter()) == S_OK
        assert block.bSubscribed
        with pytest.raises(AdsError) as caught:
            block.Subscribe()
        assert caught.value.code == ADS_E_EXISTS
        assert block.Unsubscribe() == S_OK
        assert not block.bSubscribed
        assert block.Execute() == S_OK
        assert block.Subscribe() == S_OK
        block.Unsubscribe()


def test_an_answer_other_than_s_ok_pauses_until_the_next_cycle() -> None:
    """Both events wait; the first one's answer leaves the second to the next Execute()."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        block = Noting(bus, pause_at=1)
        block.Subscribe2(FB_TcEventFilter().IsMessage())
        for number in (1, 2):
            publisher.send_message(A, number, Severity.INFO)
        assert publisher.flush(30)
        run_until(block, lambda: block.heard == [1])
        run_until(block, lambda: block.heard == [1, 2])
        block.Unsubscribe()


def test_the_older_form_selects_messages_and_alarms_apart() -> None:
    """Messages of class A only, no alarm; a cleared alarm comes to who asks for alarms, with bRemove."""
    nothing, of_a = TcEventFilterConfig(), TcEventFilterConfig()
    of_a.AddEventClass(A)
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus) as logger:
        messages, alarms = Noting(bus), Noting(bus)
        messages.Subscribe(of_a, nothing)
        alarms.Subscribe(nothing, None)
        pump = logger.create_alarm(B, 1, Severity.ERROR).alarm
        assert pump is not None
        logger.raise_alarm(pump)
        logger.clear_alarm(pump)
        logger.send_message(B, 3, Severity.INFO)
        logger.send_message(A, 4, Severity.INFO)
        run_until(messages, lambda: bool(messages.heard))
        run_until(alarms, lambda: bool(alarms.heard))
        messages.Unsubscribe()
        alarms.Unsubscribe()
    assert messages.heard == [4]
    assert alarms.heard == [True]


def test_beyond_1024_waiting_events_the_oldest_are_dropped_and_counted() -> None:
    """The manual's limit, with the loss said in place."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        block = Noting(bus)
        block.Subscribe2()
        for number in range(MAX_QUEUED + 10):
            publisher.send_message(A, number, Severity.INFO)
        assert publisher.flush(30)
        listener = block.listener
        assert listener is not None
        for _ in range(3_000_000):
            if listener.counters.received == MAX_QUEUED + 10 and listener.dropped:
                break
        run_until(block, lambda: block.heard[-1:] == [MAX_QUEUED + 9])
        block.Unsubscribe()
    assert block.heard == [Dropped(10), *range(10, MAX_QUEUED + 10)]
