"""Two hosts on one wire: network namespaces with a veth between them, made and taken away again by who asks for them."""

import contextlib
import itertools
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
_numbers = itertools.count()

needs_namespaces = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ip") is None, reason="network namespaces need root and iproute2"
)


class Host(NamedTuple):
    """One namespace and its address on the wire."""

    name: str
    address: str

    def command(self, *arguments: str) -> list[str]:
        return ["ip", "netns", "exec", self.name, *arguments]

    def run(self, *arguments: str, timeout_s: float = 60) -> str:
        command = self.command(*arguments)
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=timeout_s)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def tcbridge(self, *arguments: str) -> list[str]:
        return self.command(sys.executable, "-m", "bridge.cli", *arguments)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True, timeout=20)


@contextlib.contextmanager
def two_hosts() -> Iterator[tuple[Host, Host]]:
    """Two hosts that can reach each other, with a route for multicast."""
    mark = f"{os.getpid() % 100000:05d}{next(_numbers)}"
    pair = Host(f"tcb-a{mark}", "10.99.0.1"), Host(f"tcb-b{mark}", "10.99.0.2")
    try:
        for host in pair:
            _ip("netns", "add", host.name)
        _ip("link", "add", "wire", "netns", pair[0].name, "type", "veth", "peer", "name", "wire", "netns", pair[1].name)
        for host in pair:
            _ip("-n", host.name, "address", "add", f"{host.address}/24", "dev", "wire")
            for link in ("lo", "wire"):
                _ip("-n", host.name, "link", "set", link, "up", "multicast", "on")
            _ip("-n", host.name, "route", "add", "224.0.0.0/4", "dev", "wire")
        yield pair
    finally:
        for host in pair:
            with contextlib.suppress(subprocess.CalledProcessError):
                _ip("netns", "delete", host.name)
