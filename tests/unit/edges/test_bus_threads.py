"""A bus of months: what comes and goes leaves nothing behind."""

from bridge.edges.bus import ALONE, open_bus


def test_who_answers_no_more_is_forgotten() -> None:
    """A hundred answerers and watchers, one after the other, leave no hundred threads to be joined at the end."""
    with open_bus(ALONE) as bus:
        for _ in range(100):
            bus.answer("a/b", lambda _question: ()).close()
            bus.watch_alive("a/*", lambda _key, _there: None).close()
        assert len(bus._threads) < 20
