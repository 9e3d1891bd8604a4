"""Events out: number, encode, keep, hand to the bus.

Rule 1: send() encodes once, numbers the event (seq of the session, key_seq of session and key) and returns; one thread of
ours hands what is waiting to the bus, grouped by key, at most 256 events per put. A lone event goes at once; a key that has
256 waiting behind others lets that thread in, so that a burst does not wait in the queue.
Rule 2: what was sent is kept in a ring (65,536 events or 32 MB) for those who missed it; they ask on @sent/{session}.
Rule 3: when the queue is full, on_full decides: "drop" lets the oldest messages leave the queue (they stay in the ring and
can be asked for) and refuses an alarm transition when only transitions are left; "wait" makes send() wait.
Rule 4: a beat each second says how far every key has come, so that a lost tail is seen; the last one is final and says what
could not be sent.
"""

import contextlib
import logging
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Final, TypeVar

import msgspec
from msgspec.structs import replace

from bridge.batches import Batch, KeyState, Ring, find
from bridge.clock import SteadyClock
from bridge.core import codec, keys
from bridge.core.arguments import ZERO_GUID, Argument, Value, guid
from bridge.core.events import (
    DEFAULT_LIMITS,
    MAX_U32,
    AnyEvent,
    Limits,
    MessageSent,
    Severity,
    Source,
    check_limits,
    check_values,
)
from bridge.core.sequence import Beat, Missing
from bridge.core.times import MAX_TIME_NS
from bridge.edges.bus import Bus, BusError, Question, Refusal, Reply
from bridge.inbox import OnFull

_E = TypeVar("_E", bound=AnyEvent)
log: Final = logging.getLogger(__name__)
PUT_EVENTS: Final = 256
ROUND_EVENTS: Final = 4096
"""How many events, about, the publishing thread takes before it looks at the queue again."""
REPLY_EVENTS: Final = 1000
BEAT_S: Final = 1.0
BEAT_MEMORY_S: Final = 60.0


class QueueFullError(RuntimeError):
    """The queue holds only alarm transitions and takes no more; `waiting` of them wait for the bus."""

    def __init__(self, waiting: int) -> None:
        self.waiting = waiting
        super().__init__(f"{waiting} alarm transitions wait for the bus, no room for another")


class PublisherClosedError(RuntimeError):
    """The publisher is closed."""


class Counters(msgspec.Struct):
    """What a publisher did. dropped events left the queue unsent but may still be asked for; unsent ones never left."""

    sent: int = 0
    puts: int = 0
    dropped: int = 0
    unsent: int = 0
    repaired: int = 0


class Publisher:
    """Sends events under a target, with or without a logger running. A context manager."""

    def __init__(
        self,
        bus: Bus,
        target: str,
        *,
        realm: str = keys.LIVE,
        role: str = "publisher",
        session: str | None = None,
        encoding: codec.Encoding = codec.JSON,
        limits: Limits = DEFAULT_LIMITS,
        object_id: int | None = None,
        on_full: OnFull = "drop",
        queue_events: int = 65536,
        ring_events: int = 65536,
        ring_bytes: int = 32_000_000,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """object_id is the source id of events without a source (TcCOM); clock gives Unix ns for events without a time,
        which never go back (clock.py).

        session is a random id unless one is given; no two publishers may have the same.
        """
        self.bus, self.target, self.realm, self.role = bus, target, realm, role
        self.session = session or os.urandom(8).hex()
        self.counters = Counters()
        self._encoding, self._limits, self._object_id = encoding, limits, object_id
        self._may_drop, self._queue_events, self._clock = on_full == "drop", queue_events, SteadyClock.of(clock)
        self._encode = codec.encoder(encoding)
        smallest = MessageSent(
            target=target, event_class=ZERO_GUID, event_id=0, severity=Severity.VERBOSE, session=self.session, seq=1, key_seq=1
        )
        self._harmless, self._harmless_beside_json = codec.harmless_sizes(smallest, encoding, limits)
        self._keys: dict[tuple[str, bool, int], KeyState] = {}
        self._ring = Ring(ring_events, ring_bytes)
        self._seq = 0
        self._put_seq = 0
        self._taken_seq = 0
        self._waiting = 0
        self._marks = 0
        self._queue: deque[Batch] = deque()
        self._messages: deque[Batch] = deque()
        self._lock = threading.Lock()
        self._more = threading.Condition(self._lock)
        self._room = threading.Condition(self._lock)
        self._idle = True
        self._closing = False
        self._deadline_s = 0.0
        self._beat_due = True
        self._beats = bus.sender(keys.verb_key(realm, target, "@beat", self.session), codec.JSON)
        self._beats.on_matched(self._beat_soon)
        self._sent = bus.answer(keys.verb_key(realm, target, "@sent", self.session), self._answer)
        self._alive = bus.alive(keys.verb_key(realm, target, "@alive", role, self.session))
        self._thread = threading.Thread(target=self._run, name=f"publish {target}", daemon=True)
        self._thread.start()

    def send_message(
        self,
        event_class: str,
        event_id: int,
        severity: Severity,
        *,
        source: Source | None = None,
        arguments: Iterable[Argument | Value] = (),
        json_attribute: str = "",
        time_ns: int = 0,
        vendor_id: int | None = None,
        product_code: int | None = None,
        revision_no: int | None = None,
    ) -> MessageSent:
        """Send one message; returns it as numbered.

        Without a source: the qualified name of the calling code and this publisher's object id (manual 5.8). time_ns 0 is now.
        LimitError over a limit, ValueError for a class that is no GUID.
        """
        if source is None:
            source = default_source(self._object_id, depth=2)
        event = MessageSent(
            target=self.target,
            event_class=guid(event_class),
            event_id=event_id,
            severity=Severity(severity),
            time_ns=time_ns,
            source_id=source.id,
            source_name=source.name,
            source_guid=source.guid,
            arguments=tuple([item if isinstance(item, Argument) else Argument.of(item) for item in arguments]),
            json_attribute=json_attribute,
            vendor_id=vendor_id,
            product_code=product_code,
            revision_no=revision_no,
        )
        return self.send(event)

    def send(self, event: _E) -> _E:
        """Number, encode, keep and queue one event; returns it as numbered. Its time, if not set, is now.

        LimitError over a limit and ValueError for a number out of range (nothing is numbered then), QueueFullError when only
        alarm transitions wait and there is no room, PublisherClosedError after close().
        """
        if event.target != self.target:
            raise ValueError(f"event of target {event.target!r} sent under {self.target!r}")
        if event.vendor_id is not None or not (0 <= event.event_id <= MAX_U32 and 0 <= event.time_ns <= MAX_TIME_NS):
            check_values(event)
        place = event.event_class, event.is_alarm, event.severity.real  # an enum member hashes in Python, an int does not
        with self._lock:
            if self._closing:
                raise PublisherClosedError(f"publisher {self.session} of {self.target} is closed")
            state = self._keys.get(place)
            if state is None:
                state = self._keys[place] = KeyState(keys.event_key(self.realm, event), event.is_alarm)
            if self._waiting >= self._queue_events:
                self._make_room()
            seq, key_seq = self._seq + 1, state.sent_key_seq + 1
            event = replace(event, session=self.session, seq=seq, key_seq=key_seq, time_ns=event.time_ns or self._clock())
            try:
                element = self._encode(event)
            except UnicodeEncodeError as error:
                raise codec.no_text(error) from None
            size, name = len(element), event.source_name
            if (
                size > self._harmless
                or size - len(event.json_attribute) > self._harmless_beside_json
                or (name is not None and len(name) > self._limits.source_name_chars)
            ):
                check_limits(event, self._limits)
            self._seq, state.sent_key_seq = seq, key_seq
            self._waiting += 1
            batch = state.open or self._open(state)
            batch.elements.append(element)
            batch.seqs.append(seq)
            late = False
            if len(batch.seqs) >= PUT_EVENTS:
                state.open = None
                late = len(self._queue) > 1
            if self._idle:
                self._idle = False
                self._more.notify()
        if late:
            time.sleep(0)  # lets the publishing thread in, which Python would keep waiting for 5 ms at every put
        return event

    def _open(self, state: KeyState) -> Batch:
        batch = state.open = Batch(state, state.sent_key_seq)
        self._queue.append(batch)
        if self._may_drop and not state.is_alarm:
            self._messages.append(batch)
        return batch

    def _make_room(self) -> None:
        if not self._may_drop:
            self._room.wait_for(lambda: self._waiting < self._queue_events or self._closing)
            if self._closing:
                raise PublisherClosedError(f"publisher {self.session} of {self.target} was closed while waiting")
            return
        while self._messages:
            batch = self._messages[0]
            if batch.taken or not batch.waiting:
                self._messages.popleft()
                if batch.state.open is batch:
                    batch.state.open = None  # else it would take events that nobody could drop
                continue
            batch.dropped += 1
            self._waiting -= 1
            self.counters.dropped += 1
            state = batch.state
            last_dropped = batch.first_key_seq + batch.dropped - 1
            state.put_key_seq = max(state.put_key_seq, last_dropped)  # the next beats tell who missed it
            return
        raise QueueFullError(self._waiting)

    def _run(self) -> None:
        next_beat_s = time.monotonic()
        while True:
            with self._lock:
                while not self._queue and not self._closing and not self._beat_due:
                    left = next_beat_s - time.monotonic()
                    self._idle = True
                    if left <= 0 or not self._more.wait(left):
                        break
                self._idle = False
                done = self._closing and (not self._queue or time.monotonic() >= self._deadline_s)
                beat = self._beat_due or done or time.monotonic() >= next_beat_s
                self._beat_due = False
                batches = [] if beat else self._take()
            if beat:
                next_beat_s = time.monotonic() + BEAT_S
                self._beat(final=done)
            if done:
                return
            for batch in batches:
                if batch.waiting:
                    self._put(batch)
            self._taken_seq = 0

    def _put(self, batch: Batch) -> None:
        state = batch.state
        try:
            if state.sender is None:
                state.sender = self.bus.sender(state.key, self._encoding)
            state.sender.put(codec.join(batch.elements[batch.dropped :], self._encoding))
        except BusError as error:
            log.warning("%d events not sent: %s", batch.waiting, error)
            return
        state.put_key_seq = max(state.put_key_seq, batch.first_key_seq + len(batch.seqs) - 1)
        self._put_seq = max(self._put_seq, batch.seqs[-1])
        self.counters.puts += 1
        self.counters.sent += batch.waiting

    def _take(self) -> list[Batch]:
        """The batches that have waited longest, for one round of puts; called with the lock held."""
        batches: list[Batch] = []
        taken, now_s = 0, time.monotonic()
        was_full = self._waiting >= self._queue_events
        while self._queue and taken < ROUND_EVENTS:
            batch = self._queue.popleft()
            batch.taken = True
            batch.state.used_s = now_s
            if batch.state.open is batch:
                batch.state.open = None
            self._ring.add(batch.kept())
            taken += batch.waiting
            batches.append(batch)
        self._waiting -= taken
        self._taken_seq = batches[0].seqs[0] if batches else 0
        while self._messages and self._messages[0].taken:
            self._messages.popleft()
        if was_full or not self._may_drop:
            self._room.notify_all()
        return batches

    def _beat_soon(self) -> None:
        with self._lock:
            self._beat_due = True
            self._more.notify()

    def _numbers(self, *, numbered: bool = False, final: bool = False) -> Beat:
        """How far each key has come on the bus; or, numbered, with what still waits here and can be asked for."""
        oldest_s = time.monotonic() - BEAT_MEMORY_S
        with self._lock:
            if final:
                self._count_unsent()
            if numbered or final:
                numbers = {s.key: s.sent_key_seq for s in self._keys.values() if s.sent_key_seq}
            else:
                numbers = {s.key: s.put_key_seq for s in self._keys.values() if s.put_key_seq and s.used_s >= oldest_s}
            seq = self._seq if numbered or final else self._put_seq
        return Beat(
            target=self.target,
            session=self.session,
            role=self.role,
            seq=seq,
            keys=numbers,
            final=final,
            unsent=self.counters.unsent,
            marks=self._marks,
        )

    def _count_unsent(self) -> None:
        """What was numbered and neither put nor dropped: it waits, is refused by the bus, or its put has not returned."""
        self.counters.unsent = self._seq - self.counters.sent - self.counters.dropped

    def _beat(self, *, final: bool) -> None:
        with contextlib.suppress(BusError):
            self._beats.put(msgspec.json.encode(self._numbers(final=final)))

    def _answer(self, question: Question) -> Iterator[Reply | Refusal]:
        """The events of a Missing range, as payloads; without a payload how far it has numbered, as a Beat.

        The note beside a payload: up to which seq nothing is held any more, and the last number on the key.
        """
        if not question.payload:
            yield Reply(msgspec.json.encode(self._numbers(numbered=True)))
            return
        try:
            missing = msgspec.json.decode(question.payload, type=Missing)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            yield Refusal(f"no range of missing events: {error}")
            return
        with self._lock:
            held = [*self._ring.all(), *(batch.kept() for batch in self._queue if batch.state.key == missing.key)]
            numbered = next((state.sent_key_seq for state in self._keys.values() if state.key == missing.key), 0)
            note = b"%d %d" % (self._ring.evicted_seq, numbered)
        found = find(held, missing)  # without the lock: it takes longer than send() may
        self.counters.repaired += len(found)
        for start in range(0, max(len(found), 1), REPLY_EVENTS):
            yield Reply(codec.join(found[start : start + REPLY_EVENTS], self._encoding), self._encoding, note)

    @property
    def seq(self) -> int:
        """How many events were numbered so far."""
        return self._seq

    def change_role(self, role: str) -> None:
        """Show another role from now on."""
        before, self.role = self._alive, role
        self._alive = self.bus.alive(keys.verb_key(self.realm, self.target, "@alive", role, self.session))
        before.close()
        self._beat_soon()

    def tell_marks(self, marks: int) -> None:
        """Say with a beat now, and with all that follow, how often marks of alarms have changed."""
        if marks != self._marks:
            self._marks = marks
            self._beat_soon()

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything sent so far was handed to the bus; False when time was up."""
        deadline = time.monotonic() + timeout_s
        target = self._seq
        pause = threading.Event()
        while True:
            with self._lock:
                behind = 0 < self._taken_seq <= target or (bool(self._queue) and self._queue[0].seqs[0] <= target)
                if not behind and self.counters.sent + self.counters.dropped >= target:
                    return True
            if time.monotonic() > deadline or not self._thread.is_alive():
                return False
            pause.wait(0.001)

    def wait_for_listener(self, timeout_s: float = 10.0) -> bool:
        """Wait until somebody listens to this publisher's beats; False when nobody does in time."""
        deadline = time.monotonic() + timeout_s
        pause = threading.Event()
        while not self._beats.is_matched():
            if time.monotonic() > deadline:
                return False
            pause.wait(0.005)
        return True

    def close(self, timeout_s: float = 2.0) -> int:
        """Send what waits, then a final beat; returns how many events could not be sent. Never hangs."""
        with self._lock:
            if not self._closing:
                self._closing = True
                self._deadline_s = time.monotonic() + timeout_s
                self._more.notify_all()
                self._room.notify_all()
        self._thread.join(timeout_s + 1.5)
        with self._lock:
            self._count_unsent()
        self._sent.close()
        self._alive.close()
        self._beats.close()
        for state in self._keys.values():
            if state.sender is not None:
                state.sender.close()
        return self.counters.unsent

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def new_logger_session() -> str:
    """A session id that starts with the time in microseconds: of two loggers the older one has the smaller id."""
    return f"{time.time_ns() // 1000:013x}"[-13:] + os.urandom(2).hex()[:3]


def default_source(object_id: int | None, *, depth: int) -> Source:
    """The source of events without one: the qualified name of the code `depth` frames up, and the object id."""
    frame = sys._getframe(depth)
    module = frame.f_globals.get("__name__", "")
    return Source(object_id, f"{module}.{frame.f_code.co_qualname}"[: DEFAULT_LIMITS.source_name_chars])
