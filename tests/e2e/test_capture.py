"""Ten occurrences of a real TwinCAT EventLogger, sent through ours, come out as its own listing shows them.

The capture is that of an EventLogger answering on ADS port 132 (record layout: facts about the EventLogger, section 3.2); the
listing is the Logged Events window over the same ten events, newest first, in local time (UTC-4).
"""

import os
import struct
import subprocess
import sys
import uuid
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from bridge import Argument, ArgumentType, ConfirmationState, Severity, Source, open_bus
from bridge.core.catalog import Catalog
from bridge.core.events import AlarmCleared, AnyEvent, MessageSent
from bridge.core.times import NS_PER_S, from_filetime
from bridge.core.tmc import read_classes
from bridge.edges.bus import BusConfig
from bridge.listener import Listener
from bridge.logger import EventLogger

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("TCBRIDGE_SHARED", ROOT.parent / "shared")) / "data" / "ads-capture"
CLASS = "5819b654-acc7-4328-a54f-a5886769f484"
WORDS = ("Verbose", "Info", "Warning", "Error", "Critical")
CLASS_FILE = (
    '<TcModuleClass><DataTypes><DataType><Name GUID="{5819B654-ACC7-4328-A54F-A5886769F484}">LoggedEventsTest</Name>'
    '<DisplayName TxtId=""><![CDATA[Logged Events Test]]></DisplayName>'
    + "".join(
        f'<EventId><Name Id="{n}">Event{n}</Name><DisplayName TxtId=""><![CDATA[Event{n}: {{0}}]]></DisplayName>'
        f"<Severity>{WORDS[n - 1]}</Severity></EventId>"
        for n in range(1, 6)
    )
    + "</DataType></DataTypes></TcModuleClass>"
).encode()

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no capture at {DATA}")


class Record(NamedTuple):
    """One record of the answer, as far as the listing shows it."""

    event_id: int
    severity: Severity
    is_alarm: bool
    unique_id: int
    raised_ns: int
    cleared_ns: int
    confirmed_ns: int
    confirmation: int
    source_id: int
    source_name: str
    arguments: tuple[Argument, ...]


_SCALARS = {ArgumentType.INT16: "<h", ArgumentType.UINT16: "<H", ArgumentType.INT32: "<i", ArgumentType.UINT32: "<I"}
_SCALARS |= {ArgumentType.INT8: "<b", ArgumentType.UINT8: "<B", ArgumentType.BOOLEAN: "<?"}


def _records() -> list[Record]:
    """The ten records, oldest first."""
    data = (DATA / "logged-events.cap").read_bytes()
    place = data.index(uuid.UUID(CLASS).bytes_le)
    found = []
    for _ in range(10):
        event_id, severity, is_alarm, unique_id = (
            struct.unpack_from(form, data, place + offset)[0]
            for form, offset in (("<I", 0x10), ("<H", 0x18), ("<H", 0x2A), ("<I", 0x2C))
        )
        raised, cleared, _, confirmation = struct.unpack_from("<QQQH", data, place + 0x30)
        (confirmed,) = struct.unpack_from("<Q", data, place + 0x50)
        count, types_at, _, packed_at, packed_size = struct.unpack_from("<5I", data, place + 0x60)
        entries, table = struct.unpack_from("<2I", data, place + 0x1C)
        source: dict[int, bytes] = {}
        for entry in range(entries):
            kind, offset, length = struct.unpack_from("<3I", data, place + table + 12 * entry)
            source[kind] = data[place + offset : place + offset + length]
        (kind_number,) = struct.unpack_from("<H", data, place + types_at)
        kind = ArgumentType(kind_number)
        assert count == 1
        argument = Argument.of(struct.unpack_from(_SCALARS[kind], data, place + packed_at)[0], kind)
        found.append(
            Record(
                event_id,
                Severity(severity),
                bool(is_alarm),
                unique_id,
                from_filetime(raised),
                from_filetime(cleared),
                from_filetime(confirmed),
                confirmation,
                int.from_bytes(source[1], "little"),
                source[4].rstrip(b"\0").decode(),
                (argument,),
            )
        )
        place += packed_at + packed_size
    return found[::-1]


def _listing() -> list[dict[str, str]]:
    rows = (DATA / "logged-events-listing.tsv").read_text().splitlines()
    head = [cell.strip() for cell in rows[0].split("\t")]
    return [dict(zip(head, (cell.strip() for cell in row.split("\t")), strict=True)) for row in rows[1:] if row.strip()]


def _local(time_ns: int) -> str:
    """As the listing writes a time: local, seconds, en-US."""
    if not time_ns:
        return ""
    moment = datetime.fromtimestamp(time_ns // NS_PER_S, UTC) - timedelta(hours=4)
    return f"{moment.month}/{moment.day}/{moment.year} {moment.strftime('%I:%M:%S %p').lstrip('0')}"


def _state(event: AnyEvent) -> str:
    if isinstance(event, MessageSent):
        return "<message>"
    assert event.confirmation_state is ConfirmationState.CONFIRMED
    assert not event.raised
    return "Inactive(Cleared,Confirmed)"


def _row(event: AnyEvent, catalog: Catalog, unique_id: int | None = None) -> dict[str, str]:
    return {
        "Alarm State": _state(event),
        "Severity Level": event.severity.name.capitalize(),
        "Event Class Name": catalog.class_name(event.event_class),
        "Event Id": str(event.event_id),
        "Unique Id": str(unique_id) if unique_id is not None else "",
        "Event Text": catalog.event_text(event),
        "Source Name": event.source_name or "",
        "Time Raised": _local(event.time_raised_ns or event.time_ns),
        "Time Cleared": _local(event.time_cleared_ns),
        "Time Confirmed": _local(event.time_confirmed_ns),
        "Localized Source Name": "",
    }


def test_ten_occurrences_as_the_listing_shows_them(bus_config: BusConfig, tmp_path: Path) -> None:
    """Text, class, source, severity and times, from a listener and from `tcbridge log`; unique ids from the log."""
    records, listing = _records(), _listing()
    assert len(listing) == len(records) == 10
    result = read_classes(CLASS_FILE)
    assert not result.problems
    catalog = Catalog(result.classes)
    class_file = tmp_path / "logged.tmc"
    class_file.write_bytes(CLASS_FILE)
    with (
        open_bus(bus_config) as theirs,
        open_bus(bus_config) as ours,
        Listener(ours) as listener,
        EventLogger("plc1", bus=theirs) as logger,
    ):
        assert listener.wait_for_beat(logger.session)
        alarms = []
        for record in records:
            source = Source(record.source_id, record.source_name)
            if not record.is_alarm:
                logger.send_message(
                    CLASS,
                    record.event_id,
                    record.severity,
                    source=source,
                    arguments=record.arguments,
                    time_ns=record.raised_ns,
                )
                continue
            alarm = logger.create_alarm(
                CLASS,
                record.event_id,
                record.severity,
                with_confirmation=True,
                source=source,
                arguments=record.arguments,
            ).alarm
            assert alarm is not None
            logger.raise_alarm(alarm, time_ns=record.raised_ns)
            alarms.append((alarm, record))
        for alarm, record in alarms:
            logger.confirm_alarm(alarm, time_ns=record.confirmed_ns)
        for alarm, record in alarms:
            cleared = logger.clear_alarm(alarm, time_ns=record.cleared_ns)
            assert int(cleared.confirmation_state) == record.confirmation
        heard = [event for event in listener.take(20) if isinstance(event, MessageSent | AlarmCleared)]
        shown = sorted((_row(event, catalog) for event in heard), key=lambda row: (row["Event Id"], row["Alarm State"]))
        wanted = [row | {"Unique Id": ""} for row in listing]
        assert shown == sorted(wanted, key=lambda row: (row["Event Id"], row["Alarm State"]))

        command = [sys.executable, "-m", "bridge.cli", "log", "--target", "plc1", "--limit", "0", "--json"]
        command += ["--classes", str(class_file), "--scouting-group", bus_config.scouting_group]
        done = subprocess.run(command, capture_output=True, cwd=ROOT, timeout=60, check=True)
    lines = [msgspec.json.decode(line) for line in done.stdout.splitlines()]
    occurrences = [line for line in lines if line["kind"] in ("message_sent", "alarm_cleared")]
    assert len(lines) == 20
    by_id = {str(line["unique_id"]): line for line in occurrences}
    assert sorted(by_id, key=int) == [str(n) for n in range(1, 11)]
    for row in listing:
        line = by_id[row["Unique Id"]]
        assert line["text"] == row["Event Text"]
        assert line["class_name"] == row["Event Class Name"]
        assert line["source_name"] == row["Source Name"]
        assert Severity(line["severity"]).name.capitalize() == row["Severity Level"]
        assert _local(line.get("time_raised_ns") or line["time_ns"]) == row["Time Raised"]
        assert _local(line.get("time_cleared_ns", 0)) == row["Time Cleared"]
        assert _local(line.get("time_confirmed_ns", 0)) == row["Time Confirmed"]
