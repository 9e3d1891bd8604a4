"""Bytes on keys, between programs: the only module that knows Zenoh.

Rule 1: put never reports loss, so nothing here promises delivery. Numbers, beats and repair do (core/sequence.py).
Rule 2: one priority, reliable, Block, never express: mixed priorities reorder, Drop loses 30 to 77 % of a burst (measured).
Rule 3: user code never runs on Zenoh's threads. A receiver is a FIFO that its owner drains; a question is answered on a
thread of ours, and every question gets an answer or an error.
Rule 4: safe by default. Without being told otherwise a bus listens on 127.0.0.1 and scouts on the loopback interface only.
Rule 5: an empty answer means "unknown": nobody there, denied and crashed look alike (facts, 26 pitfalls, number 10).
"""

import contextlib
import logging
import random
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple

import msgspec
import zenoh

log: Final = logging.getLogger(__name__)

SCOUTING_GROUP: Final = "224.0.0.224:7446"
"""Zenoh's own multicast group; tests and the demo use others so that they never meet a running plant."""
DEFAULT_CAPACITY: Final = 65536
DISCOVERY_S: Final = 0.2
"""Opening itself waits up to 0.5 s for others. Then those that were there or opened meanwhile are met in 3 ms (measured)."""


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


def _reason(error: zenoh.ZError) -> str:
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


def _zenoh_config(config: BusConfig) -> zenoh.Config:
    try:
        made = zenoh.Config.from_file(config.config) if config.config is not None else zenoh.Config()
        settings = dict(_TIMING)
        if config.config is None:
            settings.update(_settings(config))
        for name, value in settings.items():
            made.insert_json5(name, msgspec.json.encode(value).decode())
    except zenoh.ZError as error:
        raise BusError(f"bus settings refused: {_reason(error)}") from None
    return made


class Arrival(NamedTuple):
    """One sample: where, what, in which encoding."""

    key: str
    payload: bytes
    encoding: str


class Answer(NamedTuple):
    """One reply to a question. `note` is what the answerer said beside the payload; `error` marks a refusal."""

    key: str
    payload: bytes
    encoding: str
    note: bytes
    error: bool
    who: str


class Question(NamedTuple):
    """One question: its key and what came with it."""

    key: str
    payload: bytes
    encoding: str


class Reply(NamedTuple):
    """One part of an answer, on the key of the question unless another is given."""

    payload: bytes
    encoding: str = "application/json"
    note: bytes = b""


class Refusal(NamedTuple):
    """An answer that says no, and why."""

    reason: str


class Sender:
    """A declared publisher of one key."""

    def __init__(self, publisher: zenoh.Publisher, key: str) -> None:
        self._publisher = publisher
        self.key = key

    def put(self, payload: bytes) -> None:
        """Hand a payload to the bus; blocks up to wait_before_close when a receiver is stopped. Never reports loss.

        BusError when the bus is closed.
        """
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise BusError(f"cannot put on {self.key!r}: {_reason(error)}") from None

    def is_matched(self) -> bool:
        """Whether anybody is subscribed to the key now."""
        return bool(getattr(self._publisher.matching_status, "matching", False))  # the stub says bool, it is a struct

    def on_matched(self, wake: Callable[[], None]) -> None:
        """Call wake (quick, not blocking) when the first subscriber appears."""

        def changed(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                wake()

        self._publisher.declare_matching_listener(changed)

    def close(self) -> None:
        """Undeclare."""
        with contextlib.suppress(zenoh.ZError):
            self._publisher.undeclare()


class Receiver:
    """A subscription drained by its owner. An undrained one blocks its session: drain it or close it."""

    def __init__(self, subscriber: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]") -> None:
        self._subscriber = subscriber
        self._channel = subscriber.handler

    def receive(self, limit: int = 1024) -> list[Arrival]:
        """Wait for a sample, then take what is there too, at most `limit`; an empty list when the receiver is closed.

        Deletions are passed over: nothing of ours makes any, and who does makes nobody stop listening by it.
        """
        while True:
            try:
                samples = [self._channel.recv()]
            except zenoh.ZError:
                return []
            if arrivals := self._drain(samples, limit):
                return arrivals

    def receive_now(self, limit: int = 1024) -> list[Arrival]:
        """What is there, without waiting."""
        return self._drain([], limit)

    def _drain(self, samples: list[zenoh.Sample], limit: int) -> list[Arrival]:
        take = self._channel.try_recv
        with contextlib.suppress(zenoh.ZError):
            while len(samples) < limit:
                sample = take()
                if sample is None:
                    break
                samples.append(sample)
        return [
            Arrival(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding))
            for sample in samples
            if sample.kind == zenoh.SampleKind.PUT
        ]

    def close(self) -> None:
        """Undeclare; a thread waiting in receive() gets an empty list."""
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()


class Closable(NamedTuple):
    """Something declared that can be taken back."""

    close: Callable[[], None]


class Bus:
    """One Zenoh session. A context manager; close() takes back everything that was declared, last first."""

    def __init__(self, session: zenoh.Session, discovery_s: float = 0.0) -> None:
        """discovery_s: how long others may take to be found, from now on."""
        self._session = session
        self._found_s = time.monotonic() + discovery_s
        self._declared: list[Callable[[], None]] = []
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._closed = False

    @property
    def id(self) -> str:
        """The Zenoh id of this session."""
        return str(self._session.zid())

    def endpoints(self) -> list[str]:
        """Addresses this session is linked from, for messages to people."""
        return sorted({str(link.src) for link in self._session.info.links()})

    def links(self) -> dict[str, str]:
        """The address each linked session is reached at, by its id."""
        return {str(link.zid): str(link.dst) for link in self._session.info.links()}

    def peers(self) -> int:
        """How many other sessions this one is linked to now."""
        return len(list(self._session.info.peers_zid())) + len(list(self._session.info.routers_zid()))

    def has_router(self) -> bool:
        """Whether this session is linked to a router now."""
        return bool(list(self._session.info.routers_zid()))

    def undiscovered_s(self) -> float:
        """For how long from now somebody who was there all the time may still turn up; 0 when everybody is known."""
        return max(0.0, self._found_s - time.monotonic())

    def _keep(self, close: Callable[[], None]) -> Callable[[], None]:
        def close_once() -> None:
            with self._lock:
                if close_once not in self._declared:
                    return
                self._declared.remove(close_once)
            with contextlib.suppress(zenoh.ZError):
                close()

        with self._lock:
            self._declared.append(close_once)
        return close_once

    def _remember(self, thread: threading.Thread) -> None:
        """Keep a thread for close(), and forget those that have ended: who answers comes and goes in a program of months."""
        with self._lock:
            self._threads = [each for each in self._threads if each.is_alive()] + [thread]

    def sender(self, key: str, encoding: str) -> Sender:
        """Declare a publisher of one key. BusError when the key is none."""
        try:
            publisher = self._session.declare_publisher(
                key,
                encoding=encoding,
                congestion_control=zenoh.CongestionControl.BLOCK,
                reliability=zenoh.Reliability.RELIABLE,
                express=False,
            )
        except zenoh.ZError as error:
            raise BusError(f"cannot publish on {key!r}: {_reason(error)}") from None
        return Sender(publisher, key)

    def put(self, key: str, payload: bytes, encoding: str = "application/json") -> None:
        """Put once on a key, without declaring it."""
        self._session.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)

    def receiver(self, expression: str, capacity: int = DEFAULT_CAPACITY) -> Receiver:
        """Subscribe to a key expression through a FIFO. BusError when the expression is none."""
        try:
            subscriber = self._session.declare_subscriber(expression, zenoh.handlers.FifoChannel(capacity))
        except zenoh.ZError as error:
            raise BusError(f"cannot subscribe to {expression!r}: {_reason(error)}") from None
        receiver = Receiver(subscriber)
        receiver.close = self._keep(receiver.close)  # type: ignore[method-assign]
        return receiver

    def ask(
        self, key: str, payload: bytes = b"", *, timeout_s: float = 2.0, encoding: str = "application/json"
    ) -> list[Answer]:
        """Ask everybody who answers on the key; every reply, none merged. [] means unknown, not "no"."""
        return list(self.ask_each(key, payload, timeout_s=timeout_s, encoding=encoding))

    def ask_each(
        self, key: str, payload: bytes = b"", *, timeout_s: float = 2.0, encoding: str = "application/json"
    ) -> Iterator[Answer]:
        """As ask(), one reply at a time."""
        try:
            replies = self._session.get(
                key,
                zenoh.handlers.FifoChannel(4096),
                payload=payload,
                encoding=encoding,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout_s,
            )
        except zenoh.ZError as error:
            raise BusError(f"cannot ask {key!r}: {_reason(error)}") from None
        for reply in replies:
            who = str(reply.replier_id.zid) if reply.replier_id is not None else ""
            if (sample := reply.ok) is not None:
                note = sample.attachment.to_bytes() if sample.attachment is not None else b""
                yield Answer(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), note, False, who)
            elif (error_reply := reply.err) is not None:
                yield Answer(key, error_reply.payload.to_bytes(), str(error_reply.encoding), b"", True, who)

    def answer(self, key: str, handler: Callable[[Question], Iterable[Reply | Refusal]], *, threads: int = 1) -> Closable:
        """Answer questions on a key, so many at a time on threads of ours. What the handler raises becomes a refusal."""
        try:
            queryable = self._session.declare_queryable(key, zenoh.handlers.FifoChannel(1024), complete=True)
        except zenoh.ZError as error:
            raise BusError(f"cannot answer on {key!r}: {_reason(error)}") from None
        channel = queryable.handler

        def serve() -> None:
            while True:
                try:
                    query = channel.recv()
                except zenoh.ZError:
                    return
                with contextlib.suppress(zenoh.ZError), query:
                    self._serve_one(query, handler)

        for _ in range(threads):
            thread = threading.Thread(target=serve, name=f"answer {key}", daemon=True)
            thread.start()
            self._remember(thread)
        return Closable(self._keep(queryable.undeclare))

    @staticmethod
    def _serve_one(query: zenoh.Query, handler: Callable[[Question], Iterable[Reply | Refusal]]) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        question = Question(str(query.key_expr), payload, str(query.encoding) if query.encoding is not None else "")
        answered = 0
        try:
            for part in handler(question):
                match part:
                    case Reply(payload=body, encoding=encoding, note=note):
                        query.reply(str(query.key_expr), body, encoding=encoding, attachment=note or None)
                    case Refusal(reason=reason):
                        query.reply_err(reason, encoding="text/plain")
                answered += 1
            if not answered:
                query.reply_err("no answer", encoding="text/plain")
        except Exception as error:
            log.exception("answering %s", question.key)
            query.reply_err(f"{type(error).__name__}: {error}", encoding="text/plain")

    def alive(self, key: str, last: str = "") -> Closable:
        """Show that somebody is there, until closed; it vanishes with the process too.

        With a `last` key the two can be told apart: closing shows that key for the moment in which this one goes.
        BusError when the key is none or the bus is closed.
        """
        try:
            token = self._session.liveliness().declare_token(key)
        except zenoh.ZError as error:
            raise BusError(f"cannot show {key!r}: {_reason(error)}") from None

        def leave() -> None:
            farewell = self._session.liveliness().declare_token(last)
            token.undeclare()
            farewell.undeclare()

        return Closable(self._keep(leave if last else token.undeclare))

    def who_is_alive(self, expression: str, *, timeout_s: float = 1.0) -> set[str]:
        """Keys of the tokens there are."""
        replies = self._session.liveliness().get(expression, timeout=timeout_s)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def watch_alive(self, expression: str, changed: Callable[[str, bool], None]) -> Closable:
        """Call changed(key, is_there) for tokens that are there and whenever one comes or goes, on a thread of ours."""
        subscriber = self._session.liveliness().declare_subscriber(expression, zenoh.handlers.FifoChannel(4096), history=True)
        channel = subscriber.handler

        def watch() -> None:
            while True:
                try:
                    sample = channel.recv()
                except zenoh.ZError:
                    return
                try:
                    changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
                except Exception:
                    log.exception("told of %s", sample.key_expr)  # who comes and goes afterwards must still be seen

        thread = threading.Thread(target=watch, name=f"watch {expression}", daemon=True)
        thread.start()
        self._remember(thread)
        return Closable(self._keep(subscriber.undeclare))

    def watch_connection(self, changed: Callable[[bool], None]) -> Closable:
        """Call changed(False) when the last router is lost, changed(True) when one is back, on a thread of ours.

        Among peers nothing is ever lost: whoever goes was one of them, not the bus.
        """
        events = self._session.info.declare_transport_events_listener(zenoh.handlers.FifoChannel(1024), history=True)
        channel = events.handler
        routers: set[str] = set()

        def watch() -> None:
            lost = False
            while True:
                try:
                    event = channel.recv()
                except zenoh.ZError:
                    return
                if event.transport.whatami != zenoh.WhatAmI.ROUTER:
                    continue
                there = event.kind == zenoh.SampleKind.PUT
                (routers.add if there else routers.discard)(str(event.transport.zid))
                if lost == bool(routers):
                    lost = not lost
                    changed(not lost)

        thread = threading.Thread(target=watch, name="watch connection", daemon=True)
        thread.start()
        self._remember(thread)
        return Closable(self._keep(events.undeclare))

    def close(self, timeout_s: float = 2.0) -> bool:
        """Take everything back and close the session; False when a thread of ours did not end in time."""
        with self._lock:
            if self._closed:
                return True
            self._closed = True
            declared = list(reversed(self._declared))
        for close in declared:
            close()
        deadline = time.monotonic() + timeout_s
        me = threading.current_thread()
        for thread in self._threads:
            if thread is not me:
                thread.join(max(0.0, deadline - time.monotonic()))
        with contextlib.suppress(zenoh.ZError):
            self._session.close()
        return not any(thread.is_alive() for thread in self._threads if thread is not me)

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def open_bus(config: BusConfig = LOCAL, *, timeout_s: float = 10.0) -> Bus:
    """Open a session. With `connect` it waits, in short steps, for a link; BusError after timeout_s, naming the endpoint."""
    if config.config is not None and not Path(config.config).is_file():
        raise BusError(f"no such configuration file: {config.config}")
    deadline = time.monotonic() + timeout_s
    made = _zenoh_config(config)
    while True:
        try:
            session = zenoh.open(made)
            break
        except zenoh.ZError as error:
            # A client without a router does not open at all, and a longer wait inside would not hear Ctrl-C.
            if not config.connect:
                where = f" on {', '.join(config.listen)}" if config.listen else ""
                raise BusError(f"cannot open the bus{where}: {_reason(error)}") from None
            if time.monotonic() > deadline:
                raise BusError(f"nobody answers at {', '.join(config.connect)}") from None
        time.sleep(0.05)
    bus = Bus(session, DISCOVERY_S if config.scouting or config.connect or config.config is not None else 0.0)
    if config.connect:
        while not bus.peers():
            if time.monotonic() > deadline:
                bus.close()
                raise BusError(f"nobody answers at {', '.join(config.connect)}")
            time.sleep(0.02)
    return bus
