"""Listener (manual 9.1.3): one program sends a message and raises, clears and confirms an alarm; another counts them.

The listener registers one event class; another that is sent too does not reach it.

    python examples/listener.py
"""

import threading
from pathlib import Path

from bridge import AlarmCleared, AlarmConfirmed, AlarmRaised, EventLogger, Listener, MessageSent, Source, open_bus, where
from bridge.core.catalog import Catalog
from bridge.core.events import AnyEvent
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog

CLASSES = Path(__file__).with_name("samples.classes.toml")


class Counting:
    """Counts by kind and keeps the text of the last event."""

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self.counts: dict[str, int] = {}
        self.done = threading.Event()

    def _count(self, event: AnyEvent) -> None:
        self.counts[event.kind] = self.counts.get(event.kind, 0) + 1
        print(f"{event.kind:15} {self._catalog.event_text(event)}  {event.json_attribute}")

    def on_message_sent(self, event: MessageSent) -> None:
        self._count(event)

    def on_alarm_raised(self, event: AlarmRaised) -> None:
        self._count(event)

    def on_alarm_cleared(self, event: AlarmCleared, removed: bool) -> None:
        self._count(event)
        if removed:
            self.done.set()

    def on_alarm_confirmed(self, event: AlarmConfirmed, removed: bool) -> None:
        self._count(event)


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    machine, other = catalog.newest("MachineEventClass"), catalog.newest("TutorialClass")
    done, empty = machine.events[1], machine.events[2]
    observer = Counting(catalog)
    with (
        open_bus(ALONE) as bus,
        Listener(bus, where.event_class == machine.guid) as listener,
        EventLogger("plc1", bus=bus) as logger,
    ):
        listener.observe(observer)
        logger.send_message(other.guid, 1, other.events[1].severity)
        logger.send_message(machine.guid, done.id, done.severity, arguments=[7], json_attribute='{"part": 7}')
        store = Source(name="Store.North")
        alarm = logger.create_alarm(machine.guid, empty.id, empty.severity, with_confirmation=True, source=store).alarm
        logger.raise_alarm(alarm, arguments=["north"], json_attribute='{"store": 1}')
        logger.confirm_alarm(alarm, operator="tutorial")
        logger.clear_alarm(alarm)
        observer.done.wait(20)
    print(", ".join(f"{kind}: {count}" for kind, count in sorted(observer.counts.items())))


if __name__ == "__main__":
    main()
