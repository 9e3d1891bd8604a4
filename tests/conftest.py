"""Settings that all tests share."""

import itertools
import os

import pytest
from hypothesis import settings

from bridge.edges.bus import BusConfig

_ports = itertools.count()


def new_port() -> int:
    """A scouting port of this test's own: groups are not bound like TCP ports, so two tests must not draw the same one."""
    return 20000 + (os.getpid() * 97 + next(_ports)) % 40000


# Two test processes share the machine: a deadline in wall time would measure the neighbour, not the code.
settings.register_profile("shared machine", deadline=None, print_blob=True)
settings.load_profile("shared machine")


@pytest.fixture
def bus_config() -> BusConfig:
    """A loopback bus that no other test and no running plant is on."""
    return BusConfig(scouting_group=f"224.0.0.224:{new_port()}")
