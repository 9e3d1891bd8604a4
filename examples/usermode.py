"""Usermode (manual 9.3): a program outside reaches the logger of a target: lists, confirms and reads the log.

The logger stands for the PLC; the program outside has its own session and knows only the target's name.

    python examples/usermode.py
"""

import os
from pathlib import Path

from bridge import BusConfig, EventLogger, LoggerProxy, Source, open_bus
from bridge.edges.class_files import load_catalog

CLASSES = Path(__file__).with_name("samples.classes.toml")


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    machine = catalog.newest("MachineEventClass")
    fault = machine.events[3]
    config = BusConfig(scouting_group=f"224.0.0.224:{20000 + os.getpid() % 40000}")
    with open_bus(config) as plant, EventLogger("plc1", bus=plant) as logger:
        for axis in (1, 2):
            source = Source(name=f"Axis{axis}")
            alarm = logger.create_alarm(machine.guid, fault.id, fault.severity, with_confirmation=True, source=source).alarm
            logger.raise_alarm(alarm, arguments=[0x4650 + axis])
        with open_bus(config) as outside, LoggerProxy(outside, "plc1") as proxy:
            print(f"connected: {proxy.is_connected}")
            for active in sorted(proxy.active_alarms(), key=lambda found: found.source_name or ""):
                text = catalog.text(active.event_class, active.event_id, active.arguments)
                print(f"active: {active.source_name}: {text}")
                proxy.confirm_alarm(active, operator="usermode", comment="seen from outside")
            proxy.clear_alarm(proxy.get_alarm(machine.guid, fault.id, Source(name="Axis1")))
            print(f"still active: {[alarm.source_name for alarm in proxy.active_alarms()]}")
            for stored in proxy.log():
                event = stored.event
                print(f"log: {event.kind} {event.source_name}: {catalog.event_text(event)} {event.operator}".rstrip())


if __name__ == "__main__":
    main()
