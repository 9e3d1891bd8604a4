"""What the logger before has sent may come after the state of the next one: by repair, or because queues differ."""

from collections.abc import Iterator

import msgspec
import pytest

from bridge import AlarmRaised, Listener, Publisher, Rejected, open_bus
from bridge.core import codec, keys
from bridge.core.events import AnyEvent
from bridge.edges.bus import ALONE, Bus
from bridge.logger import EventLogger
from bridge.testing.builders import TARGET, alarm_cleared, alarm_raised
from tests.unit.logger.logger_stories import eventually

RAISED, CLEARED = alarm_raised(event_id=7), alarm_cleared(event_id=7)


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


def put(bus: Bus, event: AnyEvent, session: str, number: int) -> None:
    """Put an event as this session would."""
    sent = msgspec.structs.replace(event, session=session, seq=number, key_seq=number)
    bus.put(keys.event_key(keys.LIVE, sent), codec.join([codec.encode(sent)]))


def test_a_late_transition_of_the_logger_before_is_handed_over_and_changes_no_state(bus: Bus) -> None:
    """It happened; what became of the alarm is what the logger says that there is now."""
    with Listener(bus, with_state=True) as listener:
        with EventLogger(TARGET, bus=bus) as before:
            assert listener.wait_for_beat(before.session)
        with EventLogger(TARGET, bus=bus) as logger:
            assert eventually(lambda: [state.session for state in listener.snapshot()] == [logger.session])
            put(bus, RAISED, before.session, 1)
            (event,) = listener.take(1)
            assert isinstance(event, AlarmRaised)
            assert listener.alarms == []
            assert listener.counters.rejected_events == 0


def test_a_transition_of_who_was_never_a_logger_is_rejected(bus: Bus) -> None:
    """Also with a session that looks older."""
    with Listener(bus, with_state=True) as listener, EventLogger(TARGET, bus=bus) as logger:
        assert listener.wait_for_beat(logger.session)
        with Publisher(bus, TARGET, session="0000000000000000") as stranger:
            assert listener.wait_for_beat(stranger.session)
            put(bus, CLEARED, stranger.session, 1)
            item = listener.get(30)
            assert isinstance(item, Rejected)
            assert "but the logger of plc1 is" in item.reason
