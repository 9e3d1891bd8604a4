"""Who is there: who dies is told from who leaves, and nobody leaves a trace."""

import threading
from collections.abc import Iterator

import pytest

from bridge.attendance import Attendance, Token
from bridge.core import keys
from bridge.edges.bus import ALONE, Bus, open_bus
from tests.unit.logger.logger_stories import eventually


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that meets nobody."""
    with open_bus(ALONE) as bus:
        yield bus


class Roll:
    """What an attendance tells."""

    def __init__(self, bus: Bus) -> None:
        self.came: list[Token] = []
        self.left: list[tuple[Token, bool]] = []
        self.news = threading.Semaphore(0)
        self.attendance = Attendance(
            bus, "live", ["plc1"], came=self.came.append, left=self._left, connected=lambda _there: None
        )

    def _left(self, token: Token, gone: bool) -> None:
        self.left.append((token, gone))
        self.news.release()


def key(role: str, session: str) -> str:
    """The key of a token."""
    return keys.verb_key("live", "plc1", "@alive", role, session)


def test_who_leaves_and_who_dies(bus: Bus) -> None:
    """A farewell is no arrival of its own, and its end is no death; without one the session is gone."""
    roll = Roll(bus)
    bus.alive(key("source", "a"), key("left", "a")).close()
    bus.alive(key("source", "b")).close()
    assert roll.news.acquire(timeout=20)
    assert roll.news.acquire(timeout=20)
    assert roll.came == [Token("plc1", "source", "a"), Token("plc1", "source", "b")]
    assert roll.left == [(Token("plc1", "source", "a"), False), (Token("plc1", "source", "b"), True)]


def test_a_change_of_role_is_no_end(bus: Bus) -> None:
    """Who shows a second role before the first is given up lives on."""
    roll = Roll(bus)
    logger = bus.alive(key("logger", "a"))
    bus.alive(key("reader", "a"))
    logger.close()
    assert roll.news.acquire(timeout=20)
    assert roll.left == [(Token("plc1", "logger", "a"), False)]
    assert roll.attendance.is_there("a")


def test_who_is_gone_leaves_no_trace(bus: Bus) -> None:
    """An attendance of months does not grow with each program that came by; those who leave are not waited for."""
    roll = Roll(bus)
    for number in range(200):
        bus.alive(key("source", f"s{number}"), key("left", f"s{number}")).close()
    assert eventually(lambda: len(roll.left) == 200, 15)
    assert eventually(lambda: not roll.attendance._there)
    assert not any(gone for _, gone in roll.left)
