"""Our events per second and CPU per event, beside bare zenoh-python with msgspec on the same payload in the same run.

    python benches/end_to_end.py [--events 200000] [--rounds 3]

Two processes on loopback, a publisher and a listener, once with tcbridge and once with nothing but a declared Zenoh publisher
(Block), msgspec and a FIFO, in turns. "mixed keys" is 20 classes x 5 severities against one event per put; "one key" is
against 64 events per put. Events exist before the clock starts. CPU is user and system time of both processes.
Only the ratios mean something: machines and hours differ.
"""

import argparse
import itertools
import multiprocessing
import os
import random
import resource
import statistics
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import msgspec
import zenoh

from bridge import MessageSent, Severity
from bridge.core import keys
from bridge.core.arguments import Argument
from bridge.core.events import AnyEvent
from bridge.edges.bus import BusConfig, open_bus
from bridge.listener import Listener
from bridge.publisher import Publisher

CLASSES = [f"54cc5482-ad79-4cdc-8c3e-{n:012x}" for n in range(20)]
SIDES = ("tcbridge", "bare")
CASES = ("mixed keys", "one key")
SEED_EVENTS = 2000


def made_events(case: str) -> list[MessageSent]:
    """Events as a plant sends them, 15 fields and 3 arguments; of 100 keys or of one."""
    dice = random.Random(1)
    return [
        MessageSent(
            target="plc1",
            event_class=dice.choice(CLASSES) if case == "mixed keys" else CLASSES[0],
            event_id=dice.randrange(50),
            severity=Severity(dice.randrange(5)) if case == "mixed keys" else Severity.ERROR,
            time_ns=1_795_300_000_000_000_000 + n,
            source_id=0x08502000,
            source_name=f"MAIN.fbStation{dice.randrange(30)}",
            arguments=(Argument.of(dice.randrange(1000)), Argument.of(dice.random()), Argument.of("axis")),
            json_attribute='{"axis":3,"unit":"mm","limit":250.5}',
        )
        for n in range(SEED_EVENTS)
    ]


def cpu_s() -> float:
    """User and system time of this process so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def publish_tcbridge(config: BusConfig, case: str, count: int, pipe: Connection) -> None:
    events = made_events(case)
    with open_bus(config) as bus, Publisher(bus, "plc1", on_full="wait") as publisher:
        publisher.wait_for_listener()
        pipe.recv()
        start, used = time.monotonic(), cpu_s()
        send = publisher.send
        for event in itertools.islice(itertools.cycle(events), count):
            send(event)
        publisher.flush(120)
        pipe.send((start, cpu_s() - used))
        pipe.recv()


def listen_tcbridge(config: BusConfig, case: str, count: int, pipe: Connection) -> None:
    with open_bus(config) as bus, Listener(bus, on_full="wait") as listener:
        listener.wait_for_beat()
        pipe.send("ready")
        used = cpu_s()
        got = 0
        for _ in listener:
            got += 1
            if got == count:
                break
        pipe.send((time.monotonic(), cpu_s() - used, got))
        pipe.recv()


def publish_bare(config: BusConfig, case: str, count: int, pipe: Connection) -> None:
    events = made_events(case)
    encode = msgspec.json.Encoder().encode
    with zenoh.open(zenoh_config(config)) as session:
        declared = {
            key: session.declare_publisher(key, encoding="application/json", congestion_control=zenoh.CongestionControl.BLOCK)
            for key in {keys.event_key("live", event) for event in events}
        }
        puts = [declared[keys.event_key("live", event)].put for event in events]
        first = next(iter(declared.values()))
        while not getattr(first.matching_status, "matching", False):  # the stub says bool, it is a struct
            time.sleep(0.01)
        pipe.recv()
        start, used = time.monotonic(), cpu_s()
        if case == "mixed keys":
            for put, event in itertools.islice(itertools.cycle(zip(puts, events, strict=True)), count):
                put(encode(event))
        else:
            put, source = puts[0], itertools.cycle(events)
            for start_at in range(0, count, 64):
                put(encode(list(itertools.islice(source, min(64, count - start_at)))))
        pipe.send((start, cpu_s() - used))
        pipe.recv()


def listen_bare(config: BusConfig, case: str, count: int, pipe: Connection) -> None:
    decode_one = msgspec.json.Decoder(AnyEvent).decode
    decode_list = msgspec.json.Decoder(list[AnyEvent]).decode
    with zenoh.open(zenoh_config(config)) as session:
        subscriber = session.declare_subscriber("tc3/1/live/*/event/**", zenoh.handlers.FifoChannel(65536))
        while not list(session.info.peers_zid()):
            time.sleep(0.01)
        pipe.send("ready")
        used = cpu_s()
        got = 0
        while got < count:
            payload = subscriber.recv().payload.to_bytes()
            if case == "mixed keys":
                decode_one(payload)
                got += 1
            else:
                got += len(decode_list(payload))
        pipe.send((time.monotonic(), cpu_s() - used, got))
        pipe.recv()


def zenoh_config(config: BusConfig) -> zenoh.Config:
    """Bare Zenoh with the settings that matter for where it listens and how long it waits; the rest is its default."""
    made = zenoh.Config()
    made.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
    made.insert_json5("scouting/multicast/interface", '"lo"')
    made.insert_json5("scouting/multicast/address", f'"{config.scouting_group}"')
    return made


ROLES: dict[str, tuple[Callable[..., None], Callable[..., None]]] = {
    "tcbridge": (publish_tcbridge, listen_tcbridge),
    "bare": (publish_bare, listen_bare),
}


def measure(side: str, case: str, count: int, group: str) -> tuple[float, float]:
    """(events per second, microseconds of CPU per event in both processes)."""
    spawn = multiprocessing.get_context("spawn")
    config = BusConfig(scouting_group=group)
    publish, listen = ROLES[side]
    ours, theirs = zip(*(spawn.Pipe() for _ in range(2)), strict=True)
    processes = [
        spawn.Process(target=target, args=(config, case, count, pipe))
        for target, pipe in zip((publish, listen), theirs, strict=True)
    ]
    for process in processes:
        process.start()
    publisher, listener = ours
    try:
        listener.recv()
        publisher.send("go")
        start, publisher_cpu = publisher.recv()
        if not listener.poll(120):
            raise SystemExit(f"{side}, {case}: the listener did not get all events")
        end, listener_cpu, got = listener.recv()
        for pipe in ours:
            pipe.send("stop")
    finally:
        for process in processes:
            process.join(10)
            if process.is_alive():
                process.kill()
    return got / (end - start), (publisher_cpu + listener_cpu) / got * 1e6


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--events", type=int, default=200_000)
    options.add_argument("--rounds", type=int, default=3)
    given = options.parse_args()
    group = f"224.0.0.224:{20000 + os.getpid() % 40000}"
    out = sys.stdout.write
    for case in CASES:
        rates: dict[str, list[float]] = {side: [] for side in SIDES}
        cpus: dict[str, list[float]] = {side: [] for side in SIDES}
        for _ in range(given.rounds):
            for side in SIDES:
                rate, cpu = measure(side, case, given.events, group)
                rates[side].append(rate)
                cpus[side].append(cpu)
        against = "one event per put" if case == "mixed keys" else "64 events per put"
        out(f"{case}, against bare {against} ({given.events:,} events, median of {given.rounds})\n")
        for side in SIDES:
            rate, cpu = statistics.median(rates[side]), statistics.median(cpus[side])
            out(f"  {side:9} {rate:10,.0f} events/s  {cpu:6.2f} us CPU per event\n")
        ratio = statistics.median(rates["tcbridge"]) / statistics.median(rates["bare"])
        out(f"  ratio     {ratio:10.2f}\n")


if __name__ == "__main__":
    main()
