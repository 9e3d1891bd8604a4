"""Events in the system's log: which, as what line, with what priority, and what happens when it is not there."""

import socket
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity, Source
from bridge.core.filters.spelling import where
from bridge.edges.bus import Bus
from bridge.gateways.syslog_sink import LINE_BYTES, SyslogAddressError, SyslogSettings, SyslogSink, syslog_address
from bridge.inbox import Dropped
from bridge.logger import EventLogger
from bridge.notices import BusBack, Rejected
from bridge.publisher import Publisher
from bridge.testing.builders import alarm_confirmed, message_sent
from tests.unit.logger.logger_stories import CLASS, PUMP, alone, eventually

CATALOG = Catalog(
    [
        EventClass(
            CLASS,
            "Axis",
            events={7: EventEntry(7, "Lag", Severity.ERROR, "Axis {0} lags")},
            translations={"Axis {0} lags": {1031: "Achse {0} eilt nach"}},
        )
    ]
)
ANYWHERE = "127.0.0.1:9"


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[socket.socket]:
    """What /dev/log is: a datagram socket in the file system."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "log"))
        receiver.settimeout(30)
        yield receiver


def lines(receiver: socket.socket, count: int) -> list[str]:
    """The next lines that arrive."""
    return [receiver.recv(65536).decode() for _ in range(count)]


def test_the_manuals_defaults(bus: Bus) -> None:
    """Off, from Verbose upwards, in English; off means that nothing is listened to and run() has nothing to do."""
    settings = SyslogSettings()
    assert (settings.types, settings.min_severity, settings.lang) == ("none", Severity.VERBOSE, 1033)
    with SyslogSink(bus, settings) as sink:
        sink.run()
        assert not sink.write(message_sent())


def has_come(sink: SyslogSink, count: int) -> bool:
    """Whether so many events have come to it."""
    return sink._listener is not None and sink._listener.counters.passed == count


CHOICES = [
    (SyslogSettings(types="both"), {"low", "high", "alarm_raised"}),
    (SyslogSettings(types="messages"), {"low", "high"}),
    (SyslogSettings(types="alarms"), {"alarm_raised"}),
    (SyslogSettings(types="both", min_severity=Severity.ERROR), {"high", "alarm_raised"}),
    (SyslogSettings(types="messages", min_severity=Severity.ERROR), {"high"}),
    (SyslogSettings(types="messages", filter=where.source_name == "low"), {"low"}),
]


@pytest.mark.parametrize(("settings", "expected"), CHOICES)
def test_what_is_chosen_arrives(bus: Bus, journal: socket.socket, settings: SyslogSettings, expected: set[str]) -> None:
    """Messages, alarms or both, from a minimum severity, narrowed by a filter; nothing else."""
    settings = SyslogSettings(
        types=settings.types, min_severity=settings.min_severity, filter=settings.filter, address=journal.getsockname()
    )
    with SyslogSink(bus, settings) as sink, EventLogger("plc1", bus=bus) as logger:
        writer = threading.Thread(target=sink.run)
        writer.start()
        logger.send_message(CLASS, 1, Severity.INFO, source=Source(name="low"))
        logger.send_message(CLASS, 1, Severity.CRITICAL, source=Source(name="high"))
        logger.raise_alarm(logger.create_alarm(CLASS, 2, Severity.ERROR, source=PUMP).alarm)
        found = lines(journal, len(expected))
        sink.close()
        writer.join(30)
        journal.setblocking(False)
        with pytest.raises(BlockingIOError):
            journal.recv(1)
    assert {word for word in ("low", "high", "alarm_raised") if any(word in line for line in found)} == expected
    assert sink.counters.written == len(expected)


def test_a_line(bus: Bus, journal: socket.socket) -> None:
    """Priority of facility and severity, program, target, what happened, class, id, text in the language, source, time, who."""
    settings = SyslogSettings(types="both", address=journal.getsockname(), lang="de", facility="local0")
    confirmed = alarm_confirmed(
        target="plc1", event_class=CLASS, event_id=7, severity=Severity.ERROR, time_ns=1_763_769_600_500_000_000,
        source_name="MAIN.x", arguments=(Argument.of(3),), operator="anna", comment="seen",
    )  # fmt: skip
    with SyslogSink(bus, settings, catalog=CATALOG) as sink:
        assert sink.write(confirmed)
    assert lines(journal, 1) == [
        "<131>tcbridge: plc1 alarm_confirmed Axis 7: Achse 3 eilt nach [MAIN.x] 2025-11-22T00:00:00.500Z by anna (seen)"
    ]


@pytest.mark.parametrize(("severity", "priority"), list(zip(Severity, (15, 14, 12, 11, 10), strict=True)))
def test_a_severity_is_a_priority(bus: Bus, journal: socket.socket, severity: Severity, priority: int) -> None:
    """Debug, info, warning, err, crit of the facility user."""
    with SyslogSink(bus, SyslogSettings(types="both", address=journal.getsockname())) as sink:
        sink.write(message_sent(severity=severity))
    assert lines(journal, 1)[0].startswith(f"<{priority}>tcbridge: ")


def test_a_line_is_one_line(bus: Bus, journal: socket.socket) -> None:
    """Nothing in a text starts a second line or moves a terminal; what is too long is cut between two characters."""
    with SyslogSink(bus, SyslogSettings(types="both", address=journal.getsockname())) as sink:
        sink.write(message_sent(source_name="a\n<2>sshd: b\x1b[31m\x00%s\u2028\u202e"))
        sink.write(message_sent(comment="\u20ac" * 1000))
    first, second = lines(journal, 2)
    assert r"[a\n<2>sshd: b\x1b[31m\x00%s\u2028\u202e]" in first
    assert second.endswith("\u20ac...")
    assert LINE_BYTES - 4 < len(second.encode()) <= LINE_BYTES


def test_losses_stand_in_the_log(bus: Bus, journal: socket.socket) -> None:
    """What a listener misses is a warning; what only tells how things are is an info, and left out above that."""
    with SyslogSink(bus, SyslogSettings(types="both", address=journal.getsockname())) as sink:
        sink.write(Dropped(3))
        sink.write(Rejected("tc3/1", b"\x00", "no event"))
        sink.write(BusBack())
    assert lines(journal, 3) == [
        '<12>tcbridge: Dropped {"count":3}',
        '<12>tcbridge: Rejected {"key":"tc3/1","reason":"no event","whole_payload":false}',
        "<14>tcbridge: BusBack",
    ]
    with SyslogSink(bus, SyslogSettings(types="both", address=ANYWHERE, min_severity=Severity.ERROR)) as sink:
        assert sink.write(BusBack())
        assert sink.counters.written == 0


def test_over_the_network(bus: Bus) -> None:
    """HOST:PORT is UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(30)
        with (
            SyslogSink(bus, SyslogSettings(types="messages", address=f"127.0.0.1:{receiver.getsockname()[1]}")) as sink,
            Publisher(bus, "plc1") as publisher,
        ):
            writer = threading.Thread(target=sink.run)
            writer.start()
            publisher.send_message(CLASS, 9, Severity.WARNING, source=PUMP)
            (line,) = lines(receiver, 1)
            sink.close()
            writer.join(30)
    assert line.startswith(f"<12>tcbridge: plc1 message_sent {CLASS}#9 [MAIN.pump]")


def test_a_log_that_is_not_there_stops_nothing(bus: Bus, tmp_path: Path) -> None:
    """Failures are counted and told once; when the log is there again, that is told too and lines get through."""
    told: list[str] = []
    path = tmp_path / "log"
    with SyslogSink(bus, SyslogSettings(types="both", address=str(path)), on_trouble=told.append) as sink:
        assert not sink.write(message_sent())
        assert not sink.write(message_sent())
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
            receiver.bind(str(path))
            assert sink.write(message_sent())
            assert sink.write(message_sent())
            assert len(lines(receiver, 2)) == 2
        assert (sink.counters.written, sink.counters.failed) == (2, 2)
    assert len(told) == 2
    assert told[0].startswith(f"{path} cannot be written to: ")
    assert told[1] == f"{path} can be written to again"


ADDRESSES = [
    ("/dev/log", "/dev/log"),
    ("log-host:5514", ("log-host", 5514)),
    ("log-host", ("log-host", 514)),
    ("[::1]:5514", ("::1", 5514)),
    ("[::1]", ("::1", 514)),
]


@pytest.mark.parametrize(("text", "expected"), ADDRESSES)
def test_addresses(text: str, expected: object) -> None:
    """A path, or host and port."""
    assert syslog_address(text) == expected


@pytest.mark.parametrize("text", ["", ":514", "host:", "host:x", "host:0", "host:70000"])
def test_what_is_no_address(text: str) -> None:
    """It is named, with what was expected."""
    with pytest.raises(SyslogAddressError, match="no address of a system log; expected a path"):
        syslog_address(text)


def test_a_facility_that_does_not_exist(bus: Bus) -> None:
    """The names there are, are listed."""
    with pytest.raises(ValueError, match=r"no facility 'plant'; one of .*local0"):
        SyslogSink(bus, SyslogSettings(types="both", facility="plant"))


def test_what_has_come_is_written_when_it_is_closed(bus: Bus, journal: socket.socket) -> None:
    """All of it, whether run() was at work or not."""
    settings = SyslogSettings(types="messages", address=str(journal.getsockname()))
    received: list[str] = []
    reader = threading.Thread(target=lambda: received.extend(lines(journal, 400)))
    reader.start()
    sink, idle = SyslogSink(bus, settings), SyslogSink(bus, settings)
    threading.Thread(target=sink.run, daemon=True).start()
    with Publisher(bus, "plc1") as publisher:
        for number in range(200):
            publisher.send(message_sent(target="plc1", event_id=number))
        assert publisher.flush()
        for each in (sink, idle):
            assert eventually(partial(has_come, each, 200))
            each.close(30)
            assert (each.counters.written, each.counters.left) == (200, 0)
    reader.join(30)
    assert len(received) == 400


def test_closing_does_not_wait_for_ever(bus: Bus, journal: socket.socket) -> None:
    """What there is no time for is counted."""
    sink = SyslogSink(bus, SyslogSettings(types="messages", address=str(journal.getsockname())))
    with Publisher(bus, "plc1") as publisher:
        for number in range(50):
            publisher.send(message_sent(target="plc1", event_id=number))
        assert publisher.flush()
        assert eventually(partial(has_come, sink, 50))
    sink.close(0)
    assert (sink.counters.written, sink.counters.left) == (0, 50)
