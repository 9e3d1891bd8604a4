"""The bus: what is open by default, what every question gets, and what closing does."""

import contextlib
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.edges.bus import ALONE, Arrival, BusConfig, BusError, Question, Refusal, Reply, open_bus
from tests.e2e.fault_stories import eventually


def listening() -> set[str]:
    """The addresses at which this process listens, as the kernel writes them (IPv4: four bytes in its own order)."""
    inodes = {match[1] for each in Path("/proc/self/fd").iterdir() if (match := re.search(r"socket:\[(\d+)\]", _target(each)))}
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes}


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except FileNotFoundError:  # it was open for reading this very list
        return ""


def test_by_default_only_this_machine_is_reached(bus_config: BusConfig) -> None:
    """Two programs find each other over loopback; every link is between loopback addresses, and nothing else is listened to."""
    with open_bus(bus_config) as one, open_bus(bus_config) as other:
        receiver = other.receiver("t/**")
        sender = one.sender("t/x", "application/json")
        appeared = threading.Event()
        sender.on_matched(appeared.set)
        assert sender.is_matched() or appeared.wait(20)
        sender.put(b"1")
        assert [arrival.payload for arrival in receiver.receive()] == [b"1"]
        assert all("/127.0.0.1:" in endpoint for endpoint in one.endpoints() + other.endpoints())
        assert listening() == {"0100007F"}


def test_of_two_programs_only_the_later_one_dials(bus_config: BusConfig) -> None:
    """One link for each pair, and all of the first program's lead to the address it listens on: a second link would let Zenoh
    take a program that was stopped for connected when it is not."""
    with contextlib.ExitStack() as stack:
        buses = [stack.enter_context(open_bus(bus_config)) for _ in range(5)]
        assert eventually(lambda: all(bus.peers() == len(buses) - 1 for bus in buses))
        assert len(buses[0].endpoints()) == 1
        assert len(buses[-1].endpoints()) == len(buses) - 1
        assert all(len(list(bus._session.info.links())) == len(buses) - 1 for bus in buses)


def test_every_question_gets_an_answer_or_a_refusal() -> None:
    """Parts in order with their notes; a handler that raises or says nothing becomes a refusal; nobody there is no answer."""

    def fail(_question: Question) -> Iterator[Reply | Refusal]:
        raise ZeroDivisionError("by design")

    with open_bus(ALONE) as bus:
        bus.answer("q/parts", lambda question: [Reply(question.payload, note=b"n"), Refusal("no more")])
        bus.answer("q/fails", fail)
        bus.answer("q/silent", lambda _question: [])
        first, second = bus.ask("q/parts", b"hello")
        assert (first.payload, first.note, first.error) == (b"hello", b"n", False)
        assert (second.payload, second.error) == (b"no more", True)
        assert [(answer.payload, answer.error) for answer in bus.ask("q/fails")] == [(b"ZeroDivisionError: by design", True)]
        assert [answer.error for answer in bus.ask("q/silent")] == [True]
        assert bus.ask("q/nobody") == []


def test_who_is_alive_comes_and_goes() -> None:
    """A token is seen by who asks and by who watches, until it is closed."""
    news: list[tuple[str, bool]] = []
    gone = threading.Event()

    def changed(key: str, there: bool) -> None:
        news.append((key, there))
        if not there:
            gone.set()

    with open_bus(ALONE) as bus:
        token = bus.alive("l/1")
        bus.watch_alive("l/*", changed)
        assert bus.who_is_alive("l/*") == {"l/1"}
        token.close()
        assert gone.wait(20)
        assert bus.who_is_alive("l/*") == set()
    assert news == [("l/1", True), ("l/1", False)]


def test_closing_wakes_who_waits_and_may_be_repeated() -> None:
    """A thread in receive() gets an empty list; nothing raises the second time."""
    bus = open_bus(ALONE)
    receiver = bus.receiver("t/**")
    got: list[object] = []
    thread = threading.Thread(target=lambda: got.append(receiver.receive()))
    thread.start()
    assert bus.close()
    thread.join(20)
    assert got == [[]]
    assert bus.close()
    receiver.close()


@pytest.mark.parametrize(
    ("config", "named"),
    [
        (BusConfig(connect=("tcp/127.0.0.1:1",)), "nobody answers at tcp/127.0.0.1:1"),
        (BusConfig(connect=("nonsense",)), "nonsense"),
        (BusConfig(listen=("tcp/256.0.0.1:x",)), "256.0.0.1"),
        (BusConfig(config="/nowhere/zenoh.json5"), "/nowhere/zenoh.json5"),
        (BusConfig(mode="boss"), "boss"),
    ],
)
def test_what_cannot_be_opened_says_why(config: BusConfig, named: str) -> None:
    """The error names the setting at fault and no place in somebody else's source."""
    with pytest.raises(BusError) as error:
        open_bus(config, timeout_s=0.3)
    assert named in str(error.value)
    assert ".rs" not in str(error.value)


def test_who_listens_on_an_endpoint_routes_for_those_who_connect(bus_config: BusConfig) -> None:
    """Two clients of one endpoint hear each other; scouting is not needed."""
    with open_bus(BusConfig(listen=("tcp/127.0.0.1:0",), scouting_group=bus_config.scouting_group)) as middle:
        port = _listening_port(middle.id, bus_config)
        ends = BusConfig(connect=(f"tcp/127.0.0.1:{port}",), scouting=False)
        with open_bus(ends) as one, open_bus(ends) as other:
            receiver = other.receiver("t/**")
            sender = one.sender("t/x", "application/json")
            appeared = threading.Event()
            sender.on_matched(appeared.set)
            assert sender.is_matched() or appeared.wait(20)
            sender.put(b"1")
            assert [arrival.payload for arrival in receiver.receive()] == [b"1"]


def _listening_port(middle: str, config: BusConfig) -> str:
    """The port the router drew, as a peer that scouts finds it."""
    with open_bus(config) as peer:
        found = threading.Event()
        for _ in range(2000):
            links = peer.links()
            if middle in links:
                return links[middle].rpartition(":")[2]
            found.wait(0.01)
    raise AssertionError("the router was not found")


def test_who_leaves_is_told_from_who_dies() -> None:
    """With a last key: closing shows it before the token goes, and the bus does so too when it closes."""
    with open_bus(ALONE) as bus:
        news: list[tuple[str, bool]] = []
        gone = threading.Semaphore(0)

        def changed(key: str, there: bool) -> None:
            news.append((key, there))
            if (key, there) == ("left/1", False):
                gone.release()

        bus.watch_alive("*/1", changed)
        bus.alive("here/1", "left/1").close()
        assert gone.acquire(timeout=20)
        assert news == [("here/1", True), ("left/1", True), ("here/1", False), ("left/1", False)]
        bus.alive("here/1", "left/1")
    assert news[4:7] == [("here/1", True), ("left/1", True), ("here/1", False)]


def test_a_deletion_is_no_end() -> None:
    """Zenoh's other kind of sample, from a stranger: who waits goes on waiting, and gets what comes next."""
    with open_bus(ALONE) as bus:
        receiver = bus.receiver("t/**")
        got: list[list[Arrival]] = []
        waiting = threading.Thread(target=lambda: got.append(receiver.receive()))
        waiting.start()
        bus._session.delete("t/1")
        bus.put("t/1", b"later")
        waiting.join(20)
        assert [[arrival.payload for arrival in arrivals] for arrivals in got] == [[b"later"]]


def test_nobody_is_there_on_a_closed_bus() -> None:
    """Showing oneself fails as everything else does then, in our words."""
    bus = open_bus(ALONE)
    bus.close()
    with pytest.raises(BusError, match="cannot show 'l/1'"):
        bus.alive("l/1")
