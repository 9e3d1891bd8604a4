"""What the stories about loggers share: a bus that meets nobody, an alarm, and waiting without guessing times."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bridge.core import codec, keys
from bridge.core.alarms import Alarm
from bridge.core.events import AnyEvent, Severity, Source
from bridge.edges.bus import ALONE, Bus, open_bus
from bridge.logger import Commands

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
PUMP = Source(name="MAIN.pump")


@contextmanager
def alone() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with open_bus(ALONE) as bus:
        yield bus


def new_alarm(logger: Commands, event_id: int = 1, *, with_confirmation: bool = True) -> Alarm:
    """A created alarm of the pump."""
    answer = logger.create_alarm(CLASS, event_id, Severity.ERROR, with_confirmation=with_confirmation, source=PUMP)
    assert answer.alarm is not None
    return answer.alarm


def eventually(condition: Callable[[], bool], timeout_s: float = 10.0) -> bool:
    """Whether a condition that another thread brings about comes true in time."""
    deadline = time.monotonic() + timeout_s
    pause = threading.Event()
    while not condition():
        if time.monotonic() > deadline:
            return False
        pause.wait(0.002)
    return True


def put(bus: Bus, event: AnyEvent, realm: str = keys.LIVE) -> None:
    """An event as a stranger would send it: on its key, with whatever numbers it has."""
    bus.put(keys.event_key(realm, event), codec.join([codec.encode(event)]), codec.JSON)
