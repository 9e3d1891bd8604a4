"""Filter (manual 9.1.4): five receivers, each with another filter; then the log is exported and cleared by filter.

python examples/filter.py
"""

from pathlib import Path

from bridge import EventLogger, Listener, Severity, Source, open_bus, where
from bridge.core.csv_export import Column, CsvSettings, export_csv
from bridge.core.event_fields import EventField
from bridge.core.filters.text import parse
from bridge.core.own_events import OWN_EVENTS
from bridge.core.questions import LogQuestion
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog

CLASSES = Path(__file__).with_name("samples.classes.toml")
COLUMNS = (EventField.SEVERITY_LEVEL, EventField.EVENT_CLASS_NAME, EventField.EVENT_TEXT, EventField.SOURCE_NAME)


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    known = catalog.merged((OWN_EVENTS,))
    machine, tutorial = catalog.newest("MachineEventClass"), catalog.newest("TutorialClass")
    filters = {
        "messages of the machine": where.is_message & (where.event_class == machine.guid),
        "errors and worse": where.severity >= Severity.ERROR,
        "EtherCAT emergencies": where.is_ethercat_device,
        "sources below Store": where.source_name.like("Store.%"),
        "axis 3, as text": parse("json('/axis') = 3 and not is_alarm"),
    }
    with open_bus(ALONE) as bus, EventLogger("plc1", bus=bus) as logger:
        receivers = {name: Listener(bus, expr, on_full="wait") for name, expr in filters.items()}
        done, empty, fault = machine.events[1], machine.events[2], machine.events[3]
        logger.send_message(tutorial.guid, 1, Severity.INFO, source=Source(name="MAIN"))
        logger.send_message(machine.guid, done.id, done.severity, arguments=[7], source=Source(name="Store.North"))
        logger.send_message(machine.guid, done.id, done.severity, arguments=[8], json_attribute='{"axis": 3}')
        drive = Source(name="Drive.1")
        logger.send_message(
            machine.guid, fault.id, fault.severity, arguments=[0x8130], source=drive, vendor_id=2, product_code=7
        )
        alarm = logger.create_alarm(machine.guid, empty.id, empty.severity, source=Source(name="Store.South")).alarm
        logger.raise_alarm(alarm, arguments=["south"])
        logger.publisher.flush()
        for name, receiver in receivers.items():
            receiver.settle()
            receiver.close()
            print(f"{name}: {', '.join(sorted(catalog.event_text(event) for event in receiver.events()))}")
        errors = LogQuestion(filter="severity >= error", newest_first=False)
        settings = CsvSettings(columns=tuple(Column(field) for field in COLUMNS))
        print("".join(export_csv(logger.log(errors), catalog, settings)).replace("\r\n", "\n"), end="")
        print(f"cleared: {logger.clear_log(LogQuestion(filter='severity < error'), operator='sample')}")
        for stored in logger.log():
            print(f"left in the log: {known.event_text(stored.event)}")
        print(f"still active: {len(logger.active_alarms())}")


if __name__ == "__main__":
    main()
