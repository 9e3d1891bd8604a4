"""Two senders, three listeners, six processes: each listener gets exactly its set, nothing lost, in order per key."""

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import NamedTuple

import pytest

from bridge import Listener, Publisher, Severity, Source, open_bus
from bridge.core import keys
from bridge.core.events import Event
from bridge.edges.bus import BusConfig
from bridge.logger import EventLogger

CLASSES = tuple(f"54cc5482-ad79-4cdc-8c3e-{n:012x}" for n in range(4))
MESSAGES = {"station": 60_000, "logger": 30_000}
ALARM_LIVES = 5_000
WAIT_S = 90


class Sent(NamedTuple):
    """One message as both sides know it: who sent it and everything that follows from its number."""

    sender: str
    number: int

    @property
    def event_class(self) -> str:
        return CLASSES[self.number % 4]

    @property
    def severity(self) -> Severity:
        return Severity.CRITICAL if self.number % 100 == 0 else Severity(self.number % 4)

    @property
    def source(self) -> Source:
        return Source(name=f"MAIN.{self.sender}.axis{self.number % 5}")

    @property
    def json_attribute(self) -> str:
        return f'{{"axis":{self.number % 7}}}'

    def send(self, send_message: Callable[..., object]) -> None:
        send_message(
            self.event_class,
            self.number % 50,
            self.severity,
            source=self.source,
            arguments=(self.number,),
            json_attribute=self.json_attribute,
        )


class Report(NamedTuple):
    """What a listener heard: (kind, sender, number) in order, what reached it at all, and what came too late or never."""

    heard: list[tuple[str, str, int]]
    in_order: bool
    late: int
    received: int
    missing: int


def _sent() -> Iterator[Sent]:
    for sender, count in MESSAGES.items():
        for number in range(count):
            yield Sent(sender, number)


def _alarm_severity(life: int) -> Severity:
    return Severity.CRITICAL if life % 100 == 0 else Severity.WARNING


def station(config: BusConfig, pipe: Connection) -> None:
    """The first sender: messages only."""
    with open_bus(config) as bus, Publisher(bus, "plc1", on_full="wait") as publisher:
        pipe.send(publisher.session)
        pipe.recv()
        for number in range(MESSAGES["station"]):
            Sent("station", number).send(publisher.send_message)
        publisher.flush(WAIT_S)
        pipe.send("done")
        pipe.recv()


def logger(config: BusConfig, pipe: Connection) -> None:
    """The second: a logger that sends messages, and raises and clears alarms between them."""
    with open_bus(config) as bus, EventLogger("plc1", bus=bus, on_full="wait") as service:
        pipe.send(service.session)
        pipe.recv()
        every = MESSAGES["logger"] // ALARM_LIVES
        for number in range(MESSAGES["logger"]):
            Sent("logger", number).send(service.send_message)
            if number % every == 0:
                life = number // every
                alarm = service.create_alarm(
                    CLASSES[life % 4], life, _alarm_severity(life), source=Source(name="MAIN.alarm"), arguments=(life,)
                ).alarm
                assert alarm is not None
                service.raise_alarm(alarm)
                service.clear_alarm(alarm)
        service.publisher.flush(WAIT_S)
        pipe.send("done")
        pipe.recv()


def listen(config: BusConfig, filter: str, sessions: list[str], pipe: Connection) -> None:
    """One listener: what it heard, as (kind, sender, number), whether keys were in order, and what reached it."""
    with open_bus(config) as bus, Listener(bus, filter, on_full="wait", queue_events=4096) as listener:
        pipe.send(all(listener.wait_for_beat(session, timeout_s=WAIT_S) for session in sessions))
        pipe.recv()
        heard: list[tuple[str, str, int]] = []
        last: dict[tuple[str, str], int] = {}
        in_order = True
        expected: int = pipe.recv()
        for item in listener:
            if not isinstance(item, Event):
                pipe.send(f"a notice: {item}")
                return
            place = (item.session, keys.event_key("live", item))
            in_order &= item.key_seq > last.get(place, 0)
            last[place] = item.key_seq
            sender = (item.source_name or "").split(".")[1]
            heard.append((item.kind, sender, int(item.arguments[0].value)))
            if len(heard) == expected:
                break
        pipe.send("all")
        pipe.recv()
        listener.settle()
        late = sum(1 for _ in iter(lambda: listener.get(0), None))
        pipe.send(Report(heard, in_order, late, listener.counters.received, listener.counters.missing))


def _expected(takes_message: Callable[[Sent], bool], takes_alarm: Callable[[int], bool]) -> Counter[tuple[str, str, int]]:
    wanted = Counter(("message_sent", sent.sender, sent.number) for sent in _sent() if takes_message(sent))
    for life in range(ALARM_LIVES):
        if takes_alarm(life):
            wanted["alarm_raised", "alarm", life] += 1
            wanted["alarm_cleared", "alarm", life] += 1
    return wanted


FILTERS: dict[str, Counter[tuple[str, str, int]]] = {
    "severity >= critical": _expected(
        lambda sent: sent.severity is Severity.CRITICAL, lambda life: _alarm_severity(life) is Severity.CRITICAL
    ),
    f"event_class = {CLASSES[1]} and source.name like 'MAIN.%.axis3'": _expected(
        lambda sent: sent.number % 4 == 1 and sent.number % 5 == 3, lambda life: False
    ),
    "json('/axis') = 3": _expected(lambda sent: sent.number % 7 == 3, lambda life: False),
}


@pytest.mark.timeout(280)
def test_each_listener_gets_exactly_its_set(bus_config: BusConfig) -> None:
    """100,000 events, senders that wait when full: exact sets, order per key, and 1 % wanted means 1 % sent."""
    assert sum(MESSAGES.values()) + 2 * ALARM_LIVES == 100_000
    spawn = multiprocessing.get_context("spawn")
    processes = []
    pipes: list[Connection] = []

    def start(target: Callable[..., None], *arguments: object) -> Connection:
        ours, theirs = spawn.Pipe()
        process = spawn.Process(target=target, args=(bus_config, *arguments, theirs), daemon=True)
        process.start()
        processes.append(process)
        pipes.append(ours)
        return ours

    def receive(pipe: Connection) -> object:
        assert pipe.poll(WAIT_S), "no word in time"
        return pipe.recv()

    try:
        senders = [start(station), start(logger)]
        sessions = [receive(pipe) for pipe in senders]
        listeners = [start(listen, filter, sessions) for filter in FILTERS]
        for pipe in listeners:
            assert receive(pipe) is True
            pipe.send("go")
        for pipe, wanted in zip(listeners, FILTERS.values(), strict=True):
            pipe.send(wanted.total())
        for pipe in senders:
            pipe.send("go")
        for pipe in [*senders, *listeners]:
            assert receive(pipe) in ("done", "all")
        for pipe in listeners:
            pipe.send("report")
        for number, (pipe, wanted) in enumerate(zip(listeners, FILTERS.values(), strict=True)):
            report = receive(pipe)
            assert isinstance(report, Report)
            assert Counter(report.heard) == wanted
            assert report.in_order
            assert report.late == report.missing == 0
            if number == 0:
                assert report.received == wanted.total()
                assert 900 <= report.received <= 1100
        for pipe in senders:
            pipe.send("close")
    finally:
        for process in processes:
            process.join(10)
            if process.is_alive():
                process.kill()
        for pipe in pipes:
            pipe.close()
