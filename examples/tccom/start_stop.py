"""Start-Stop (EventLogger manual 9.2.2): a cyclic module says by messages how it starts and stops.

Before SO the event logger may not be there yet, after OS it may be gone: in PS and SP nothing is sent.

    python examples/tccom/start_stop.py
"""

import threading
from pathlib import Path

from bridge import EventLogger, Source
from bridge.core.catalog import EventClass
from bridge.core.times import time_text
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog
from bridge.tccom import DONE, Answer, CyclicModule, ObjectServer, State
from bridge.tccom.tasks import Task

CLASSES = Path(__file__).with_name("start_stop.classes.toml")
TASK_ID = 0x02010020


class StartStop(CyclicModule):
    """Registers with its task in SO and leaves in OS, as its base class does, and tells each step."""

    class_id = "3f2b6a10-58c1-4f77-9b0e-01c2d3e4f504"

    def __init__(self, logger: EventLogger, messages: EventClass) -> None:
        self._logger, self._messages = logger, messages
        self.at_work = threading.Event()
        self.cycles = 0

    def on_so(self) -> None:
        self.tell(1)
        super().on_so()
        self.tell(7)
        self.tell(4)

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        self.cycles += 1
        if self.cycles == 10:
            self.at_work.set()
        return DONE

    def on_os(self) -> None:
        self.leave_task()
        self.tell(8)
        self.tell(2)
        self.tell(5)

    def tell(self, event_id: int) -> None:
        event = self._messages.events[event_id]
        source = Source(id=self.object_id, name=self.name)
        self._logger.send_message(self._messages.guid, event.id, event.severity, source=source)


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    messages = catalog.newest("TcComMessages")
    with EventLogger("plc1", config=ALONE) as logger:
        with ObjectServer() as server:
            server.add(Task(), object_id=TASK_ID, name="Task", state=State.OP)
            module = StartStop(logger, messages)
            server.add(module, name="StartStop", parameters={"cyclic_caller": TASK_ID}, state=State.OP)
            module.at_work.wait(20)
        for stored in reversed(list(logger.log())):
            event = stored.event
            severity, name = event.severity.name.title(), catalog.class_name(event.event_class)
            print(f"{severity} | {name} | {event.event_id} | {catalog.event_text(event)} | {time_text(event.time_ns, 3)}")


if __name__ == "__main__":
    main()
