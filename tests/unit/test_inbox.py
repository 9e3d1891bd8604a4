"""The queue between our threads and the user's."""

import asyncio
import threading

from bridge.inbox import Dropped, Inbox


def _inbox(size: int, on_full: str = "drop") -> Inbox[object]:
    assert on_full in ("drop", "wait")
    return Inbox(size, "drop" if on_full == "drop" else "wait", lambda item: isinstance(item, int))


def test_what_a_full_queue_drops_is_said_where_it_was() -> None:
    """The oldest leave; Dropped(n) comes first; what is not an event stays."""
    inbox = _inbox(3)
    inbox.put([1, "notice", 2, 3, 4, 5])
    inbox.close()
    assert list(inbox) == [Dropped(2), "notice", 3, 4, 5]
    assert inbox.dropped == 2


def test_with_wait_putting_waits_for_room() -> None:
    """A thread that puts into a full queue goes on when the consumer takes."""
    inbox = _inbox(2, "wait")
    inbox.put([1, 2])
    through = threading.Event()

    def put() -> None:
        inbox.put([3])
        through.set()

    thread = threading.Thread(target=put)
    thread.start()
    assert not through.is_set()
    assert inbox.get(5) == 1
    assert through.wait(20)
    thread.join(20)
    inbox.close()
    assert list(inbox) == [2, 3]
    assert inbox.dropped == 0


def test_a_closed_queue_wakes_who_waits_and_gives_what_it_has() -> None:
    """get() ends with None, and so does a thread that was waiting."""
    inbox = _inbox(5)
    got: list[object] = []
    thread = threading.Thread(target=lambda: got.append(inbox.get()))
    thread.start()
    inbox.close()
    thread.join(20)
    assert got == [None]
    inbox.put([1])
    assert inbox.get() == 1
    assert inbox.get(0) is None


def test_items_can_be_awaited() -> None:
    """async for gives the items in order and ends when the queue is closed."""
    inbox = _inbox(100)

    async def collect() -> list[object]:
        loop = asyncio.get_running_loop()
        feeder = loop.run_in_executor(None, feed)
        items = [item async for item in inbox]
        await feeder
        return items

    def feed() -> None:
        for number in range(50):
            inbox.put([number])
        inbox.close()

    assert asyncio.run(collect()) == list(range(50))
