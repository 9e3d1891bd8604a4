"""What goes over the bus and comes out of it: samples, questions, answers, and the two ends of a key."""

import contextlib
from collections.abc import Callable
from typing import NamedTuple

import zenoh

from bridge.edges.bus.settings import BusError, reason_of


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
            raise BusError(f"cannot put on {self.key!r}: {reason_of(error)}") from None

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
