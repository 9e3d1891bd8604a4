"""Events in: subscribe to what the filter's cover picks, decode, check, fold, hand over.

Rule 1: a thread of ours drains each subscription; user code runs on the user's thread (iterator) or one of ours (observe).
Rule 2: loss is never silent. Gaps and tails are repaired or reported in place (losses.py); what a full queue dropped is
Dropped in place; what could not be decoded is Rejected; a session gone without a word is TailUnknown.
Rule 3: alarm state is folded before the user's queue, so it is right even when the user is slow.
Rule 4: state first subscribes, then asks, then applies what is newer (the other order left gaps in 25 of 40 joins).
Rule 5: the promise starts with the first beat of a session after subscribing.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final

from bridge.attendance import Attendance, Token
from bridge.core import codec, keys
from bridge.core.alarms import Alarm, AlarmTable
from bridge.core.events import DEFAULT_LIMITS, AnyEvent, Event, Limits, MessageSent
from bridge.core.filters.ast import Expr
from bridge.core.sequence import Beat, Missing
from bridge.edges.bus import DEFAULT_CAPACITY, Arrival, Bus, Receiver
from bridge.handover import Handover, dispatch
from bridge.inbox import Dropped, Inbox, OnFull
from bridge.losses import Losses, Receiving
from bridge.notices import (
    BusBack,
    BusLost,
    Gap,
    Heard,
    Item,
    ListenerCounters,
    LoggerBack,
    LoggerGone,
    Notice,
    Rejected,
    Snapshot,
    SuspectsChanged,
    TailUnknown,
    TwoLoggers,
    TwoLoggersError,
)
from bridge.repair import ask_state, elements_of
from bridge.sieve import Sieve

__all__ = [
    "BusBack",
    "BusLost",
    "Dropped",
    "Gap",
    "Heard",
    "Item",
    "Listener",
    "ListenerCounters",
    "LoggerBack",
    "LoggerGone",
    "Notice",
    "Rejected",
    "Snapshot",
    "SuspectsChanged",
    "TailUnknown",
    "TwoLoggers",
    "TwoLoggersError",
    "dispatch",
]

BATCH: Final = 64
MAX_LOGGERS: Final = 1000
"""How many sessions that were a logger are remembered."""
HAND_OVER_ITEMS: Final = 1024
FULL_ROUNDS: Final = DEFAULT_CAPACITY // BATCH
"""A channel that is never empty holds so many batches at most."""


class Listener(Handover):
    """Events that a filter takes, as an iterator, an async iterator or callbacks. A context manager."""

    def __init__(
        self,
        bus: Bus,
        filter: Expr | str | None = None,
        *,
        realm: str = keys.LIVE,
        target: str | None = None,
        with_state: bool = False,
        queue_events: int = 65536,
        on_full: OnFull = "drop",
        limits: Limits = DEFAULT_LIMITS,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        keep_bytes: bool = False,
    ) -> None:
        """Subscribe. with_state also asks the loggers for their alarms, and keeps `alarms` current from then on.

        FilterSyntaxError or AdsError for a bad filter. keep_bytes hands over Heard instead of bare events.
        """
        self._sieve = Sieve(filter, target, resolve_class)
        self._target, self._resolve_class = target, resolve_class
        self.bus, self.realm = bus, realm
        self.counters = ListenerCounters()
        self._limits, self._keep_bytes = limits, keep_bytes
        self._elements: dict[int, Heard] = {}
        super().__init__(Inbox(queue_events, on_full, lambda item: isinstance(item, Event | Heard)))
        self._work = threading.RLock()
        self._table = AlarmTable() if with_state else None
        self._loggers: dict[str, str] = {}
        self._were_loggers: dict[str, str] = {}
        self._marks: dict[str, tuple[str, int]] = {}
        self._doubles: set[TwoLoggers] = set()
        self._gone: dict[str, str] = {}
        self._replacing = threading.Lock()
        self._out: list[Item] = []
        self._handing_over = threading.Lock()
        receiving = Receiving(
            wants=lambda key: self._sieve.wants(key),
            is_there=lambda session: self._attendance.is_there(session),
            progress=self._progress,
            repaired=self._take_repaired,
            lost=self._state_is_unsure,
            beat=self._take_beat,
            put=self._out.extend,
            hand_over=self._hand_over,
        )
        self._losses = Losses(
            bus, realm, receiving, limits=limits, counters=self.counters, work=self._work, closed=self._closed
        )
        self.tracker = self._losses.tracker
        self._behind: set[Receiver] = set()
        self._rounds: Counter[Receiver] = Counter()
        self._threads: list[threading.Thread] = []
        self._receivers = self._subscribe()
        self._beats, self._attendance = self._follow_senders()
        if self._table is not None:
            for known in self._sieve.targets:
                self._resync(known)
        self._start(self._receivers, self._beats)

    def _subscribe(self) -> list[Receiver]:
        return [self.bus.receiver(keys.expression(self.realm, selection)) for selection in self._sieve.selections]

    def _follow_senders(self) -> tuple[list[Receiver], Attendance]:
        targets = self._sieve.targets
        beats = [self.bus.receiver(keys.verb_key(self.realm, target, "@beat", None), 4096) for target in targets]
        return beats, Attendance(self.bus, self.realm, targets, came=self._came, left=self._left, connected=self._connected)

    def _start(self, receivers: Sequence[Receiver], beats: Sequence[Receiver]) -> None:
        threads = [threading.Thread(target=self._drain, args=(one,), name="listen", daemon=True) for one in receivers]
        threads += [threading.Thread(target=self._losses.follow, args=(one,), name="beats", daemon=True) for one in beats]
        self._threads = [thread for thread in self._threads if thread.is_alive()] + threads
        for thread in threads:
            thread.start()

    # Draining: on our threads, one at a time under _work.

    def _drain(self, receiver: Receiver) -> None:
        while arrivals := receiver.receive_now(BATCH) or self._rest(receiver):
            for arrival in arrivals:
                with self._work:
                    self._take(arrival, self._out)
                    many = len(self._out) >= HAND_OVER_ITEMS
                if many:
                    self._hand_over()
                    time.sleep(0)  # lets the user's thread in while what it takes is still in the processor's cache
            self._hand_over()
            self._rounds[receiver] += 1

    def _hand_over(self) -> None:
        """Put what was taken in into the user's queue, in the order in which it was; called without _work.

        Else one thread could overtake another between taking in and putting, with events of one key.
        """
        with self._handing_over:
            with self._work:
                out = self._out.copy()
                self._out.clear()
            if out:
                self._inbox.put(out)

    def _rest(self, receiver: Receiver) -> list[Arrival]:
        """Wait for more; meanwhile nothing that came is still to be handed over."""
        self._behind.discard(receiver)
        arrivals = receiver.receive(BATCH)
        self._behind.add(receiver)
        return arrivals

    def _progress(self) -> Callable[[], bool]:
        since = dict(self._rounds)
        return lambda: all(self._rounds[one] > since.get(one, 0) + FULL_ROUNDS for one in list(self._behind))

    def _take_repaired(self, heard: Heard, out: list[Item]) -> None:
        if self._keep_bytes:
            self._elements[id(heard.event)] = heard
        self._accept([heard.event], out)

    def _take(self, arrival: Arrival, out: list[Item]) -> None:
        self.counters.payloads += 1
        try:
            decoded = codec.decode(
                arrival.payload, arrival.encoding.partition(";")[0], keys.parse_event_key(arrival.key), self._limits
            )
        except (codec.CodecError, keys.KeyFormatError) as error:
            self.counters.rejected_payloads += 1
            out.append(Rejected(arrival.key, arrival.payload, str(error), True))
            return
        if not self._sieve.wants(arrival.key):  # it came through a filter that was replaced meanwhile
            return
        if self._keep_bytes:
            self._elements.clear()
            self._elements.update(elements_of(arrival.payload, arrival.encoding, decoded))
        if decoded.rejected:
            self.counters.rejected_events += len(decoded.rejected)
            out.extend(Rejected(arrival.key, element.raw, element.reason) for element in decoded.rejected)
        events = decoded.events
        if not events:
            return
        self.counters.received += len(events)
        first, last = events[0], events[-1]
        if (
            last.session == first.session
            and last.key_seq - first.key_seq == len(events) - 1
            and first.key_seq
            and first.session
            and not self.tracker.is_duplicate(first.session, arrival.key, first.key_seq)
        ):
            if self._losses.see(arrival.key, first, last.key_seq, out):
                self._accept(events, out)
            else:
                self._refuse(arrival.key, events, out)
            return
        for event in events:
            if not event.key_seq or not event.session:
                self._accept([event], out)
            elif self.tracker.is_duplicate(event.session, arrival.key, event.key_seq):
                self.counters.duplicates += 1
            elif self._losses.see(arrival.key, event, event.key_seq, out):
                self._accept([event], out)
            else:
                self._refuse(arrival.key, [event], out)

    def _refuse(self, key: str, events: list[AnyEvent], out: list[Item]) -> None:
        self.counters.rejected_events += len(events)
        for event in events:
            raw = self._elements[id(event)].element if self._keep_bytes else codec.encode(event)
            out.append(
                Rejected(key, raw, f"number {event.key_seq} is beyond what session {event.session} has sent on this key")
            )

    def _accept(self, events: list[AnyEvent], out: list[Item]) -> None:
        if self._table is not None and events[0].is_alarm:
            events = [event for event in events if self._fold(event, out)]
        if (check := self._sieve.check) is not None:
            events = [event for event in events if check(event)]
        self.counters.passed += len(events)
        if self._keep_bytes:
            out.extend([self._elements[id(event)] for event in events])
        else:
            out.extend(events)

    # Alarm state.

    def _fold(self, event: AnyEvent, out: list[Item]) -> bool:
        if self._table is None or isinstance(event, MessageSent):
            return True
        if self._loggers.get(event.target) != event.session:
            if self._is_of_former_logger(event):
                return True
            self._resync(event.target, out)
            owner = self._loggers.get(event.target)
            if owner is not None and owner != event.session:
                if self._is_of_former_logger(event):
                    return True
                self.counters.rejected_events += 1
                reason = f"alarm transition of session {event.session}, but the logger of {event.target} is {owner}"
                out.append(Rejected(keys.event_key(self.realm, event), codec.encode(event), reason))
                return False
        self._table.apply(event)
        return True

    def _is_of_former_logger(self, event: AnyEvent) -> bool:
        """Whether the logger before sent it: it came late, by repair or after the state of the next one, which counts."""
        owner = self._loggers.get(event.target, "")
        return event.session < owner and self._were_loggers.get(event.session) == event.target

    def _note_logger(self, target: str, session: str) -> None:
        self._were_loggers[session] = target
        if len(self._were_loggers) > MAX_LOGGERS:
            del self._were_loggers[next(iter(self._were_loggers))]

    def _resync(self, target: str | None, out: list[Item] | None = None) -> bool:
        """Ask for the state; with target None of every logger there is. No answer leaves what is known, and is False.

        Two answers for a target leave it too: TwoLoggers goes to `out`, once for the same two; without it TwoLoggersError.
        """
        if self._table is None:
            return False
        states = ask_state(self.bus, self.realm, target)
        self.counters.rejected_payloads += states.undecodable
        for both in states.doubles:
            if out is None:
                raise TwoLoggersError(both.target, both.sessions)
            if both not in self._doubles:
                self._doubles.add(both)
                out.append(both)
        for state in states.whole:
            self._table.load(state.alarms, state.session, state.seq, target=state.target)
            self._loggers[state.target] = state.session
            self._note_logger(state.target, state.session)
            if self._keep_bytes and out is not None:
                out.append(state)
        return bool(states.whole)

    def _state_is_unsure(self, target: str, missing: Missing, out: list[Item]) -> None:
        if self._table is not None and "/alarm/" in missing.key:
            if self._loggers.get(target) == missing.session:
                del self._loggers[target]  # if it does not tell its state now, it is asked again with its next beat
            self._resync(target, out)

    def _take_beat(self, beat: Beat, out: list[Item]) -> None:
        if self._table is None or beat.role != "logger":
            return
        self._note_logger(beat.target, beat.session)
        if self._loggers.get(beat.target) != beat.session:
            self._resync(beat.target, out)
        marks = beat.session, beat.marks
        if self._marks.get(beat.target, (beat.session, 0)) != marks:
            before = self._table.suspects(beat.target)
            if not self._resync(beat.target, out):
                return
            if (suspects := self._table.suspects(beat.target)) != before:
                out.append(SuspectsChanged(beat.target, beat.session, suspects))
        self._marks[beat.target] = marks

    @property
    def alarms(self) -> list[Alarm]:
        """The alarms the filter takes that are active now, by state rather than by event; needs with_state."""
        if self._table is None:
            raise RuntimeError("this listener keeps no alarm state; open it with with_state=True")
        with self._work:
            matches = self._sieve.matches
            return [alarm for alarm in self._table.active() if matches is None or matches(alarm)]

    @property
    def table(self) -> AlarmTable:
        """All alarm state as folded so far; needs with_state."""
        if self._table is None:
            raise RuntimeError("this listener keeps no alarm state; open it with with_state=True")
        return self._table

    # Who is there: on threads of the bus.

    def _came(self, who: Token) -> None:
        if who.role != "logger":
            return
        with self._work:
            self._note_logger(who.target, who.session)
        if self._gone.pop(who.target, None) is None:
            return
        with self._work:
            self._resync(who.target, self._out)
            self._out.append(LoggerBack(who.target, who.session))
        self._hand_over()

    def _left(self, who: Token, gone: bool) -> None:
        target, role, session = who
        clean = gone and self._losses.farewell(session)
        with self._work:
            if self._loggers.get(target) == session and not clean:
                del self._loggers[target]
            if gone and role == "logger":
                self._gone[target] = session
                self._out.append(LoggerGone(target, session, clean))
                if not clean and self._table is not None:
                    self._table.suspect(target)
            if gone and not clean and self.tracker.heard(session):
                self.counters.tails_unknown += 1
                self._out.append(TailUnknown(target, session))
                self._losses.gone(session)
        self._hand_over()

    def _connected(self, there: bool) -> None:
        with self._work:
            self._out.append(BusBack() if there else BusLost())
        self._hand_over()

    # What the user asks of a listener; how items are handed over is in handover.py.

    @property
    def filter(self) -> Expr:
        """What it takes, class names resolved."""
        return self._sieve.filter

    def replace_filter(self, filter: Expr | str | None) -> list[str]:
        """Take another filter from now on, losing no event that both take or that is sent after this returns.

        The new keys are subscribed before the old ones are given up, and each sender is asked how far it is: its answer is
        where the promise for keys that are new begins. What comes twice meanwhile is handed over once, if its sender numbers
        it. Returns the sessions that did not answer: theirs begins with their next beat. Errors as for a new listener, and
        nothing has changed then. With on_full "wait" and a full queue it waits for whoever reads: call it from elsewhere.
        """
        sieve = Sieve(filter, self._target, self._resolve_class)
        with self._replacing:
            out: list[Item] = []
            with self._work:
                before, receivers, beats = self._sieve, self._receivers, self._beats
                self._sieve = sieve
                self._receivers = self._subscribe()
                fresh_beats: list[Receiver] = []
                if sieve.targets != before.targets:
                    self._attendance.close()
                    self._beats, self._attendance = self._follow_senders()
                    fresh_beats = self._beats
                self.tracker.join(lambda key: sieve.wants(key) and not before.wants(key))
                if self._table is not None:
                    for target in sieve.targets:
                        self._resync(target, out)
                self._out.extend(out)
            if out:
                self._hand_over()
            self._start(self._receivers, fresh_beats)
            silent = self.settle()
            for receiver in (*receivers, *(beats if fresh_beats else ())):
                receiver.close()
        return silent

    def snapshot(self) -> list[Snapshot]:
        """The state as folded so far, one per target whose logger answered; needs with_state."""
        with self._work:
            table = self.table
            return [
                Snapshot(
                    target,
                    session,
                    table.base(session),
                    tuple(alarm for key, alarm in table.alarms.items() if key.target == target and alarm.was_raised),
                )
                for target, session in self._loggers.items()
            ]

    def settle(self, timeout_s: float = 1.0) -> list[str]:
        """Ask every sender how far it is and take in what is missing; returns the sessions that cannot tell any more.

        timeout_s is for all of them: a sender that stands still costs the others what it takes.
        """
        return self._losses.settle(timeout_s)

    def wait_for_beat(self, session: str | None = None, *, count: int = 1, timeout_s: float = 10.0) -> bool:
        """Wait until the promise holds: a beat of `session`, or of `count` sessions, has come; False when time is up."""
        return self._losses.wait_for_beat(session, count, timeout_s)

    def wait_for_final(self, session: str, timeout_s: float = 10.0) -> bool:
        """Wait until the session has said its last word and everything it named was dealt with; False when time is up."""
        return self._losses.wait_for_final(session, timeout_s)

    def close(self, timeout_s: float = 2.0) -> bool:
        """Stop listening; what is queued can still be read. False when a thread did not end in time."""
        super().close()
        self._attendance.close()
        for receiver in (*self._receivers, *self._beats):
            receiver.close()
        deadline = time.monotonic() + timeout_s
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(max(0.0, deadline - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads)

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
