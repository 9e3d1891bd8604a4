"""`tcbridge sink syslog` as a user runs it: a real process, a real bus, and a receiver where the system's log would be."""

import json
import signal
import socket
from pathlib import Path

from bridge.core.events import Severity, Source
from bridge.edges.bus import BusConfig
from bridge.edges.class_files import load_catalog
from bridge.logger import EventLogger
from tests.e2e.fault_stories import WAIT_S, program

CLASSES = Path(__file__).parents[2] / "examples" / "plant.tmc"


def test_alarms_go_into_the_log_of_the_system(bus_config: BusConfig, tmp_path: Path) -> None:
    """From the severity upwards, in the language, with who and why; a signal ends it with 0, and it says how many lines."""
    catalog, _ = load_catalog((str(CLASSES),))
    faults = catalog.newest("Faults").guid
    source = Source(name="Main.Axis3")
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal,
        EventLogger("plc1", config=bus_config, catalog=catalog) as logger,
    ):
        journal.bind(str(tmp_path / "log"))
        journal.settimeout(WAIT_S)
        options = ["--syslog-types", "alarms", "--syslog-severity", "error", "--syslog-address", str(tmp_path / "log")]
        where = ["--scouting-group", bus_config.scouting_group, "--lang", "de", "--json"]
        with program("sink", "syslog", *options, *where) as sink:
            assert json.loads(sink.line())["ready"] == "syslog"
            assert logger.publisher.wait_for_listener(WAIT_S)
            logger.send_message(faults, 1, Severity.CRITICAL, source=source)
            logger.raise_alarm(logger.create_alarm(faults, 2, Severity.WARNING, source=source).alarm)
            alarm = logger.create_alarm(faults, 1, Severity.ERROR, source=source, arguments=(3, 12.5)).alarm
            logger.raise_alarm(alarm, time_ns=1_800_000_000_000_000_000)
            logger.clear_alarms(f"event_class = '{{{faults}}}'", operator="anna", comment="belt replaced")
            raised, cleared = (journal.recv(65536).decode() for _ in range(2))
            sink.signal(signal.SIGTERM)
            stopped = json.loads(sink.line())
            assert stopped == {"stopped": "syslog", "written": 2, "failed": 0, "left": 0}
            assert sink.process.wait(WAIT_S) == 0
    text = catalog.event_text(alarm, "de")
    assert text != catalog.event_text(alarm, "en")
    name = catalog.class_name(faults, "de")
    assert raised == f"<11>tcbridge: plc1 alarm_raised {name} 1: {text} [Main.Axis3] 2027-01-15T08:00:00.000Z"
    assert cleared.startswith(f"<11>tcbridge: plc1 alarm_cleared {name} 1: {text} [Main.Axis3] ")
    assert cleared.endswith(" by anna (belt replaced)")
