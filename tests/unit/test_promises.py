"""The page of promises: each row names the tests that hold it, and those tests exist."""

import re
from pathlib import Path

import pytest

from bridge.core import codec, keys
from bridge.core.events import Severity, Source
from bridge.edges.bus import ALONE, DEFAULT_CAPACITY, open_bus
from bridge.publisher import PUT_EVENTS, Publisher

ROOT = Path(__file__).parents[2]
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
_TABLE = re.compile(r"^\|(?!\s*(?:promise|what)\s*\||-)(.*)\|$")


def rows() -> list[list[str]]:
    """The cells of every row that promises something."""
    text = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
    return [[cell.strip() for cell in found[1].split("|")] for line in text.splitlines() if (found := _TABLE.match(line))]


def known() -> set[str]:
    """The name of every test there is."""
    files = (ROOT / "tests").rglob("test_*.py")
    return {
        name for file in files for name in re.findall(r"^\s*def (test_\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    }


def test_there_are_promises() -> None:
    """The page has its four tables."""
    assert len(rows()) > 35


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0][:40])
def test_each_promise_names_tests_that_exist(row: list[str]) -> None:
    """The last cell of a row has names of tests and nothing else."""
    named = re.findall(r"`(test_\w+)`", row[-1])
    assert named, f"{row[0]} names no test"
    assert re.sub(r"`test_\w+`|[, ]", "", row[-1]) == ""
    assert set(named) <= known()


def test_a_put_has_at_most_256_events() -> None:
    """A burst goes in arrays of one key, none larger than the page says, and nothing of it is lost."""
    with open_bus(ALONE) as bus, Publisher(bus, "plc1") as publisher:
        receiver = bus.receiver(keys.expression("live", keys.Selection()))
        for number in range(3000):
            publisher.send_message(CLASS, number, Severity.INFO, source=Source(name="MAIN"))
        assert publisher.flush()
        sizes: list[int] = []
        while sum(sizes) < 3000:
            sizes += [len(codec.split(arrival.payload, arrival.encoding)) for arrival in receiver.receive()]
    assert max(sizes) <= PUT_EVENTS == 256


def test_the_channel_of_a_receiver_is_bounded() -> None:
    """It holds what the page says, and not one payload is lost below that."""
    assert DEFAULT_CAPACITY == 65_536
    with open_bus(ALONE) as bus:
        receiver = bus.receiver("some/key", 100)
        for number in range(100):
            bus.put("some/key", str(number).encode())
        assert [int(arrival.payload) for arrival in receiver.receive_now()] == list(range(100))
