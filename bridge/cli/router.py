"""`tcbridge router`: a Zenoh router in our own program."""

from bridge.cli.exits import Exit
from bridge.cli.options import NETWORK, Network, bus_config
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted, wait_for_signal

PORT = 7447
"""Zenoh's own port."""


def router(*, common: Network = NETWORK) -> int:
    """Run a Zenoh router until stopped.

    Programs on several machines meet at its address. It listens on
    tcp/127.0.0.1:7447; with --lan on every interface, with --listen there.

    Try:
        tcbridge router --lan
        tcbridge listen --connect tcp/router-host:7447
    """
    import msgspec

    from bridge.edges.bus import open_bus

    settings = common.load()
    config = bus_config(settings, mode="router")
    if not config.listen and config.config is None:
        endpoint = f"tcp/{'0.0.0.0' if config.lan else '127.0.0.1'}:{PORT}"
        config = msgspec.structs.replace(config, listen=(endpoint,))
    with open_bus(config) as bus:
        where = ", ".join(config.listen) or f"the endpoints of {config.config}"
        try:
            if common.json:
                print_json({"ready": "router", "id": bus.id, "listen": config.listen})
            else:
                print(f"router {bus.id} listens on {where}", flush=True)
            wait_for_signal()
        except Interrupted:
            return Exit.OK
    return Exit.OK
