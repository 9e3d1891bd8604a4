"""How a session is opened: what a program says, and the Zenoh configuration that comes of it.

Rule: safe by default. Without being told otherwise a bus listens on 127.0.0.1 and scouts on the loopback interface only.
"""

import random
import time
from collections.abc import Sequence
from typing import Final

import msgspec
import zenoh

SCOUTING_GROUP: Final = "224.0.0.224:7446"
"""Zenoh's own multicast group; tests and the demo use others so that they never meet a running plant."""


class BusError(RuntimeError):
    """The bus could not be opened or used; says with which setting."""


class BusConfig(msgspec.Struct, frozen=True, kw_only=True):
    """How a program reaches the bus.

    lan opens listening and scouting to the network on purpose; connect and listen are Zenoh endpoints ("tcp/host:7447"). Who
    listens on an endpoint is a router for those who connect to it, who are its clients: Zenoh passes nothing on between peers.
    config is a Zenoh configuration file (json5, yaml, toml), taken as it is, with our timing settings on top.
    """

    mode: str = "peer"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    lan: bool = False
    scouting: bool = True
    scouting_group: str = SCOUTING_GROUP
    config: str | None = None


LOCAL: Final = BusConfig()
ALONE: Final = BusConfig(scouting=False)
"""A session that meets nobody: no scouting, no endpoint. It opens in 0.05 ms and matches real keys."""

TX_BATCHES: Final = 16
"""How many batches of 64 KiB may wait for a link. Zenoh's default of 2 makes a put of 256 events wait for the socket."""
_TIMING: Final = {
    "timestamping/enabled": True,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
    "connect/exit_on_failure": False,
    "connect/timeout_ms": 0,
}


LATER_DIALS: Final = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
"""Of two peers only one dials. When both do and one was stopped, Zenoh can take the new link into a dead transport for good:
nothing comes through it any more and nobody is told (eclipse-zenoh/zenoh#2806)."""


def _later_id() -> str:
    """An id greater than those given before, in Zenoh's order, where the last byte weighs most: who comes later asks around at
    once, so it is the one to dial."""
    return f"{random.getrandbits(64) | 1 << 63:016x}{time.time_ns().to_bytes(8, 'little').hex()}"


def reason_of(error: zenoh.ZError) -> str:
    """What Zenoh says, without the place in its own source."""
    return str(error).partition(" at /")[0]


def _settings(config: BusConfig) -> dict[str, object]:
    listen: Sequence[str] = config.listen
    if not listen:
        listen = ("tcp/0.0.0.0:0", "tcp/[::]:0")[: 1 if config.mode != "router" else 2] if config.lan else ("tcp/127.0.0.1:0",)
    if not config.lan and not config.listen and not config.scouting and not config.connect:
        listen = ()
    mode = config.mode
    if mode == "peer" and not config.lan:
        mode = "router" if config.listen else "client" if config.connect else mode
    settings: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": list(listen) if mode != "client" else [],
        "connect/endpoints": list(config.connect),
        "scouting/multicast/enabled": config.scouting,
        "scouting/multicast/address": config.scouting_group,
        "scouting/gossip/enabled": True,
        "scouting/multicast/autoconnect_strategy": LATER_DIALS,
        "scouting/gossip/autoconnect_strategy": LATER_DIALS,
        "id": _later_id(),
        "transport/link/tx/queue/size/data": TX_BATCHES,
    }
    if not config.lan:
        settings["scouting/multicast/interface"] = "lo"
    return settings


def zenoh_config(config: BusConfig) -> zenoh.Config:
    try:
        made = zenoh.Config.from_file(config.config) if config.config is not None else zenoh.Config()
        settings = dict(_TIMING)
        if config.config is None:
            settings.update(_settings(config))
        for name, value in settings.items():
            made.insert_json5(name, msgspec.json.encode(value).decode())
    except zenoh.ZError as error:
        raise BusError(f"bus settings refused: {reason_of(error)}") from None
    return made
