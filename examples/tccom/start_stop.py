"""Start-Stop (EventLogger manual 9.2.2): a cyclic module of a plant says by messages how it starts and stops.

Before SO the event logger may not be there yet, after OS it may be gone: in PS and SP nothing is sent.

    python examples/tccom/start_stop.py
"""

import threading
from pathlib import Path

from bridge import Listener, open_bus, where
from bridge.config import Settings
from bridge.core.module_instances import read_plant
from bridge.core.times import time_text
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog
from bridge.host import Host, IEventLog, Surroundings, make_plan
from bridge.tccom import DONE, Answer, CyclicModule, InterfacePointer, Resolved
from bridge.tccom.factories import Factories

PLANT = Path(__file__).with_name("start_stop.toml")
CATALOG, _ = load_catalog([Path(__file__).with_name("start_stop.classes.toml")])
MESSAGES = CATALOG.newest("TcComMessages")


class StartStop(CyclicModule):
    """Gets its logger in SO and gives it back in OS, registers with its task and leaves it, and tells each step."""

    class_id = "3f2b6a10-58c1-4f77-9b0e-01c2d3e4f504"
    logger = InterfacePointer(0x1, IEventLog, resolved=Resolved.SO)
    at_work = threading.Event()

    def on_so(self) -> None:
        self.tell(1)
        super().on_so()
        self.tell(7)
        self.tell(4)

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        self.at_work.set()
        return DONE

    def on_os(self) -> None:
        self.leave_task()
        self.tell(8)
        self.tell(2)
        self.tell(5)

    def tell(self, event_id: int) -> None:
        event = MESSAGES.events[event_id]
        self.logger.send_message(MESSAGES.guid, event.id, "verbose", self.object_id, self.name)


def main() -> None:
    factories = Factories()
    factories.register(StartStop)
    plan = make_plan(read_plant(PLANT.read_bytes(), str(PLANT)), factories)
    with open_bus(ALONE) as bus, Listener(bus, where.event_class == MESSAGES.guid) as listener:
        with Host(plan, Surroundings(bus, Settings(), CATALOG), factories) as host:
            host.start()
            StartStop.at_work.wait(20)
        for event in listener.take(6):
            severity, name = event.severity.name.title(), CATALOG.class_name(event.event_class)
            print(f"{severity} | {name} | {event.event_id} | {CATALOG.event_text(event)} | {time_text(event.time_ns, 3)}")


if __name__ == "__main__":
    main()
