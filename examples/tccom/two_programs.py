"""How the samples are run: as two programs that meet on the bus, or each by itself, e.g. on two machines.

python examples/tccom/sample01.py                          both; ends by itself
python examples/tccom/sample01.py provider --lan           one of them, until it is stopped
python examples/tccom/sample01.py caller --lan --calls 0   the other one; 0 is without end
"""

import argparse
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final, NamedTuple, TypeVar

from bridge import BusConfig
from bridge.tccom import AdsError

T = TypeVar("T")
PAUSE_S: Final = 0.1


class Run(NamedTuple):
    """How a part is run: the bus it is on, how many calls it makes (0: without end), and what is set when it shall end."""

    config: BusConfig
    calls: int
    stop: threading.Event

    def until_stopped(self) -> None:
        """Say that it is there, and wait."""
        print("ready", flush=True)
        self.stop.wait()

    def keep_calling(self, reach: Callable[[], AbstractContextManager[T]], call: Callable[[T, int], str]) -> None:
        """Hold an object and call it, saying what it answers. While it is not there, say so once and try again."""
        number, told = 0, ""

        def tell(error: AdsError) -> None:
            nonlocal told
            if error.name != told:
                print(f"no answer: {error}", flush=True)
            told = error.name

        while not self.stop.wait(PAUSE_S):
            try:
                with reach() as found:
                    while not self.stop.wait(PAUSE_S):
                        try:
                            print(call(found, number + 1), flush=True)
                        except AdsError as error:
                            tell(error)
                            break
                        number, told = number + 1, ""
                        if number == self.calls:
                            return
            except AdsError as error:
                tell(error)


def main(provider: Callable[[Run], None], caller: Callable[[Run], None]) -> None:
    """Run what the command line says: one part, or both."""
    parser = argparse.ArgumentParser()
    parser.add_argument("part", nargs="?", choices=("provider", "caller"))
    parser.add_argument("--calls", type=int, default=3)
    parser.add_argument("--lan", action="store_true")
    parser.add_argument("--scouting-group", default=f"224.0.0.224:{20000 + os.getpid() % 40000}")
    given = parser.parse_args()
    run = Run(BusConfig(scouting_group=given.scouting_group, lan=given.lan), given.calls, threading.Event())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: run.stop.set())
    if given.part == "provider":
        provider(run)
    elif given.part == "caller":
        caller(run)
    else:
        child = subprocess.Popen([sys.executable, sys.argv[0], "provider", "--scouting-group", given.scouting_group])
        try:
            caller(run)
        finally:
            child.terminate()
            child.wait()
