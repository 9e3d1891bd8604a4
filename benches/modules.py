"""A thousand modules in one host: create, to OP, list over the bus, call, delete; beside a bare Zenoh queryable's calls.

    python benches/modules.py [--objects 1000] [--calls 10000]

Two processes on loopback: one keeps the objects, this one asks. The bare side is a declared queryable with msgpack that does
the same addition on one thread, and session.get(), in turns with ours in the same run. Calls go to all objects one after
another, from one thread and from four. "held" is through a reference, as programs call; "by id" holds nothing, as
`tcbridge modules` does.
Only the ratios mean something: machines and hours differ.
"""

import argparse
import multiprocessing
import os
import resource
import statistics
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Protocol

import msgspec
import zenoh

from bridge.edges.bus import BusConfig, open_bus
from bridge.tccom import Answer, Module, ObjectServer, State, interface
from bridge.tccom.factories import Factories
from bridge.tccom.interfaces import describe
from bridge.tccom.proxy import RemoteObjects
from bridge.tccom.service import ObjectService

BARE_KEY = "bench/bare"


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0099")
class IAdder(Protocol):
    """One method."""

    def add(self, a: int, b: int) -> Answer[int]: ...


class Adder(Module, IAdder):
    """Adds."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1099"

    def add(self, a: int, b: int) -> Answer[int]:
        return Answer(a + b)


class Pair(msgspec.Struct):
    """What the bare side sends."""

    a: int
    b: int


def usage() -> tuple[int, float]:
    """Threads of this process, and MB that it has had at most."""
    return len(os.listdir("/proc/self/task")), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def provider(group: str, objects: int, pipe: Connection) -> None:
    """Keep the objects, and answer on the bare key."""
    factories = Factories(installed=False)
    factories.register(Adder)
    with (
        open_bus(BusConfig(scouting_group=group)) as bus,
        ObjectServer(factories=factories) as server,
        ObjectService(server, bus, "bench"),
    ):
        channel = bus._session.declare_queryable(BARE_KEY, zenoh.handlers.FifoChannel(1024))

        def answer() -> None:
            decode, encode = msgspec.msgpack.Decoder(Pair).decode, msgspec.msgpack.Encoder().encode
            for query in channel:
                with query:
                    assert query.payload is not None
                    pair = decode(query.payload.to_bytes())
                    query.reply(BARE_KEY, encode(pair.a + pair.b))

        threading.Thread(target=answer, daemon=True).start()
        pipe.send(("before", *usage(), 0.0))
        begun = time.perf_counter()
        ids = [server.add(Adder(), name=f"Adder {number}") for number in range(objects)]
        pipe.send(("create", *usage(), time.perf_counter() - begun))
        begun = time.perf_counter()
        for object_id in ids:
            server.set_state(object_id, State.OP)
        pipe.send(("to OP", *usage(), time.perf_counter() - begun))
        pipe.recv()
        pipe.send(("called", *usage(), 0.0))
        begun = time.perf_counter()
        for object_id in ids:
            server.delete(object_id)
        pipe.send(("delete", *usage(), time.perf_counter() - begun))
        pipe.recv()
        channel.undeclare()


def timed(calls: int, threads: int, call: Callable[[int], object]) -> float:
    """Seconds per call, with so many threads calling at once."""
    each = calls // threads

    def work(first: int) -> None:
        for number in range(first, first + each):
            call(number)

    workers = [threading.Thread(target=work, args=(index * each,)) for index in range(threads)]
    begun = time.perf_counter()
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return (time.perf_counter() - begun) / (each * threads)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--calls", type=int, default=10_000)
    options = parser.parse_args()
    group = f"224.0.0.224:{20000 + os.getpid() % 40000}"
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    child = context.Process(target=provider, args=(group, options.objects, there), daemon=True)
    child.start()
    for _ in range(3):
        what, threads, memory, seconds = here.recv()
        print(f"{what:8} {seconds * 1e3:8.1f} ms for {options.objects:,} objects; {threads} threads, {memory:.0f} MB")
    with open_bus(BusConfig(scouting_group=group)) as bus, RemoteObjects(bus, "bench", timeout_s=20) as remote:
        begun = time.perf_counter()
        infos = [info for info in remote.objects() if info.class_name == "Adder"]
        print(f"list     {(time.perf_counter() - begun) * 1e3:8.1f} ms for {len(infos):,} objects over the bus")
        begun = time.perf_counter()
        references = [remote.get(info.object_id, IAdder) for info in infos]
        print(f"hold     {(time.perf_counter() - begun) * 1e3:8.1f} ms for {len(infos):,} objects over the bus")
        held = [reference.interface for reference in references]
        iid = describe(IAdder).id
        encode, decode = msgspec.msgpack.encode, msgspec.msgpack.Decoder(int).decode

        def bare(number: int) -> int:
            for reply in bus._session.get(BARE_KEY, payload=encode(Pair(number, 1))):
                assert reply.ok is not None
                return decode(reply.ok.payload.to_bytes())
            raise AssertionError("no answer")

        sides: dict[str, Callable[[int], object]] = {
            "bare": bare,
            "held": lambda number: held[number % len(held)].add(number, 1),
            "by id": lambda number: remote.call(infos[number % len(infos)].object_id, iid, "add", {"a": number, "b": 1}),
        }
        for threads in (1, 4):
            found: dict[str, list[float]] = {name: [] for name in sides}
            for _ in range(5):
                for name, call in sides.items():
                    found[name].append(timed(options.calls // 5, threads, call))
            times = {name: statistics.median(seconds) for name, seconds in found.items()}
            for name, seconds in times.items():
                ratio = seconds / times["bare"]
                what = f"{name:6} {options.calls:,} calls from {threads} threads"
                print(f"call     {seconds * 1e6:8.1f} us {what}; {ratio:.2f} of bare")
        begun = time.perf_counter()
        for reference in references:
            reference.safe_release()
        print(f"release  {(time.perf_counter() - begun) * 1e3:8.1f} ms for {len(infos):,} objects over the bus")
    here.send("called")
    for _ in range(2):
        what, threads, memory, seconds = here.recv()
        print(f"{what:8} {seconds * 1e3:8.1f} ms; {threads} threads, {memory:.0f} MB")
    here.send("done")
    child.join(10)


if __name__ == "__main__":
    main()
