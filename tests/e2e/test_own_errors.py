"""`tcbridge serve --system-errors own` as a user runs it: what goes wrong in it is an event."""

from bridge.core import keys
from bridge.core.events import Severity
from bridge.core.own_events import OWN_CLASS, SYSTEM_ERROR
from bridge.core.questions import LogQuestion
from bridge.edges.bus import BusConfig, open_bus
from bridge.listener import Listener
from bridge.logger import LoggerProxy
from bridge.testing.builders import message_sent
from tests.e2e.fault_stories import WAIT_S, eventually, program


def test_a_rejected_payload_is_an_event(bus_config: BusConfig) -> None:
    """A warning that listeners get and the log keeps, with the key and the reason."""
    chosen = f"event_class = {OWN_CLASS} AND event_id = {SYSTEM_ERROR}"
    where = ("--target", "plc1", "--scouting-group", bus_config.scouting_group)
    with (
        open_bus(bus_config) as bus,
        Listener(bus, chosen) as listener,
        program("serve", "--system-errors", "own", *where) as logger,
    ):
        assert "is ready" in logger.line()
        key = keys.event_key(keys.LIVE, message_sent(target="plc1"))
        bus.put(key, b"{no event")
        (told,) = listener.take(1, WAIT_S)
        what, who = (argument.value for argument in told.arguments)
        assert (told.severity, who) == (Severity.WARNING, "bridge.logger.service")
        assert what.startswith(f"plc1: 1 rejected so far, the last: 9 bytes on {key}: ")
        proxy = LoggerProxy(bus, "plc1", timeout_s=WAIT_S)
        assert eventually(lambda: bool(list(proxy.log(LogQuestion(filter=chosen)))))
