"""One session on the bus: bytes on keys, questions and answers, who is there.

Rule 1: put never reports loss, so nothing here promises delivery. Numbers, beats and repair do (core/sequence.py).
Rule 2: one priority, reliable, Block, never express: mixed priorities reorder, Drop loses 30 to 77 % of a burst (measured).
Rule 3: user code never runs on Zenoh's threads. A receiver is a FIFO that its owner drains; a question is answered on a
thread of ours, and every question gets an answer or an error.
Rule 4: an empty answer means "unknown": nobody there, denied and crashed look alike (facts, 26 pitfalls, number 10).
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple

import zenoh

from bridge.edges.bus.ends import Answer, Question, Receiver, Refusal, Reply, Sender
from bridge.edges.bus.settings import LOCAL, BusConfig, BusError, reason_of, zenoh_config

log: Final = logging.getLogger(__name__)

DEFAULT_CAPACITY: Final = 65536
DISCOVERY_S: Final = 0.2
"""Opening itself waits up to 0.5 s for others. Then those that were there or opened meanwhile are met in 3 ms (measured)."""


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
            raise BusError(f"cannot publish on {key!r}: {reason_of(error)}") from None
        return Sender(publisher, key)

    def put(self, key: str, payload: bytes, encoding: str = "application/json") -> None:
        """Put once on a key, without declaring it."""
        self._session.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)

    def receiver(self, expression: str, capacity: int = DEFAULT_CAPACITY) -> Receiver:
        """Subscribe to a key expression through a FIFO. BusError when the expression is none."""
        try:
            subscriber = self._session.declare_subscriber(expression, zenoh.handlers.FifoChannel(capacity))
        except zenoh.ZError as error:
            raise BusError(f"cannot subscribe to {expression!r}: {reason_of(error)}") from None
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
            raise BusError(f"cannot ask {key!r}: {reason_of(error)}") from None
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
            raise BusError(f"cannot answer on {key!r}: {reason_of(error)}") from None
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
            raise BusError(f"cannot show {key!r}: {reason_of(error)}") from None

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
    made = zenoh_config(config)
    while True:
        try:
            session = zenoh.open(made)
            break
        except zenoh.ZError as error:
            # A client without a router does not open at all, and a longer wait inside would not hear Ctrl-C.
            if not config.connect:
                where = f" on {', '.join(config.listen)}" if config.listen else ""
                raise BusError(f"cannot open the bus{where}: {reason_of(error)}") from None
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
