"""Is everything here that was sent: what came, compared with what its senders say, repaired or told.

Rule 1: nothing missing is passed over in silence: it is asked from its sender, then from the logger, and handed over in its
place; what stays missing is a Gap there.
Rule 2: a tail (what a beat names and did not come) may still be on its way: events and beats come through different queues.
It is judged when nothing of it is missing, or when all that came before is handed over.
Rule 3: the word of a sender bounds what is missing: numbers that it has never given are nobody's loss, and what carries them
did not come from it.
Rule 4: whoever settles waits for a bounded time; a session that cannot tell any more is named, never taken as complete.
Rule 5: numbers of a session are kept until it said its last word and MAX_ENDED others did so after it; those of one that is
gone without a word, until MAX_ENDED others went so after it. That one is not asked until it is heard again.

All of it runs under the listener's lock or takes it. What it does with a listener is Receiving, nothing more.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from bridge.core import keys
from bridge.core.events import Event, Limits
from bridge.core.sequence import Beat, Missing, Tracker
from bridge.edges.bus import Bus, Receiver
from bridge.notices import Gap, Heard, Item, ListenerCounters
from bridge.repair import Held, ask_log, ask_sender

RECHECK_S: Final = 0.1
"""How long a tail may stay missing before it is asked for: events and beats come through different queues."""
MAX_ENDED: Final = 1000
"""How many sessions that have said their last word are remembered."""


class Receiving(NamedTuple):
    """What a listener does for its losses.

    wants(key): are its events taken. is_there(session): can it still be asked. progress(): a test whether all that had come
    when it was made is handed over by now. repaired(heard, out): take an event that came late, in its place. lost(target,
    missing, out): what was made of these events is no longer sure. beat(beat, out): a sender speaks, before its tails are dealt
    with. put(out): items to hand over, in their place, under the lock; hand_over(): do so, without the lock.
    """

    wants: Callable[[str], bool]
    is_there: Callable[[str], bool]
    progress: Callable[[], Callable[[], bool]]
    repaired: Callable[[Heard, list[Item]], None]
    lost: Callable[[str, Missing, list[Item]], None]
    beat: Callable[[Beat, list[Item]], None]
    put: Callable[[list[Item]], None]
    hand_over: Callable[[], None]


class Losses:
    """The sessions a listener hears, how far each has come, and what of it is missing."""

    def __init__(
        self,
        bus: Bus,
        realm: str,
        receiving: Receiving,
        *,
        limits: Limits,
        counters: ListenerCounters,
        work: threading.RLock,
        closed: threading.Event,
    ) -> None:
        """work: the listener's lock; closed: set when it closes, so that no wait outlives it."""
        self._bus, self._realm, self._receiving = bus, realm, receiving
        self._limits, self._counters = limits, counters
        self._work, self._closed = work, closed
        self.tracker = Tracker()
        self._sessions: dict[str, str] = {}
        self._final: dict[str, None] = {}
        self._gone: dict[str, None] = {}
        self._last_words: set[str] = set()
        self._beat_seen = threading.Condition(work)

    # Gaps: numbers that are jumped over.

    def see(self, key: str, first: Event, last: int, out: list[Item]) -> bool:
        """Take note of first..last, deal with what is missing before them. False when their sender never numbered so far."""
        missing = self.tracker.see(first.session, key, first.key_seq, last)
        if missing is None:
            return True
        numbered = self._recover(first.target, missing, out)
        if numbered is None or last <= numbered:
            return True
        self.tracker.step_back(missing.session, key, numbered)
        return False

    def _recover(self, target: str, missing: Missing, out: list[Item]) -> int | None:
        """Fill a gap from its sender, then from the logger; what is left is reported. The range is dealt with afterwards.

        Numbers the sender has never given are no gap. Returns its last number on this key, None when it does not tell.
        """
        held = self._ask_sender(target, missing)
        found, evicted, numbered = held.found, held.evicted, held.numbered
        if numbered is not None and numbered < missing.last:
            if numbered < missing.first:
                return numbered
            missing = msgspec.structs.replace(missing, last=numbered)
        asked = "its sender no longer holds it" if held.whole else "its sender does not answer"
        if missing.after_seq and evicted is not None and evicted <= missing.after_seq and (found or held.whole):
            # It holds all that is promised, so what is older than the first one it gave was never promised.
            missing = msgspec.structs.replace(missing, first=min(found, default=missing.last + 1))
        if len(found) < missing.count:
            for heard in ask_log(self._bus, self._realm, target, missing):
                found.setdefault(heard.event.key_seq, heard)
        self._counters.repaired += len(found)
        lost = missing.count - len(found)
        self._counters.missing += lost
        # A stranger may claim any number: walk over what was found, never over the range.
        follows = missing.first
        for number in sorted(found):
            if lost and number > follows:
                out.append(Gap(Missing(missing.session, missing.key, follows, number - 1, missing.after_seq), asked))
            self._receiving.repaired(found[number], out)
            follows = number + 1
        if lost and follows <= missing.last:
            out.append(Gap(Missing(missing.session, missing.key, follows, missing.last, missing.after_seq), asked))
        self.tracker.pass_over(missing)
        if lost:
            self._receiving.lost(target, missing, out)
        return numbered

    def _ask_sender(self, target: str, missing: Missing) -> Held:
        return ask_sender(
            self._bus,
            self._realm,
            target,
            missing,
            self._limits,
            is_there=lambda: self._receiving.is_there(missing.session),
            wait=self._closed.wait,
        )

    # Tails: numbers that a beat names.

    def follow(self, beats: Receiver) -> None:
        """Judge every beat that comes, until the receiver is closed."""
        while arrivals := beats.receive(64):
            latest: dict[str, Beat] = {}
            for arrival in arrivals:
                try:
                    beat = msgspec.json.decode(arrival.payload, type=Beat)
                except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                    self._counters.rejected_payloads += 1
                    continue
                if keys.verb_key(self._realm, beat.target or "-", "@beat", beat.session or "-") != arrival.key:
                    self._counters.rejected_payloads += 1
                    continue
                if beat.final:
                    self._last_words.add(beat.session)
                if self.tracker.started(beat.session):
                    latest[beat.session] = beat
                else:
                    self._judge(self._whole(beat))
            for beat in latest.values():
                if self._judge(beat, look=True):
                    self._catch_up(beat)
                self._judge(beat)

    def _catch_up(self, beat: Beat, deadline: float = float("inf")) -> bool:
        """Wait until nothing that the beat names is missing any more, or all that came by now is handed over.

        False when time is up.
        """
        all_handed_over = self._receiving.progress()
        while not self._closed.wait(RECHECK_S) and self._judge(beat, look=True):
            if all_handed_over():
                return True
            if time.monotonic() > deadline:
                return False
        return True

    def _whole(self, beat: Beat) -> Beat:
        """A beat names the keys of the last 60 s; with the others too a quiet key is not taken for a gap later."""
        if not beat.seq:
            return beat
        for told in self._ask_how_far(beat.target, beat.session, 1.0):
            if told.session == beat.session:
                return msgspec.structs.replace(beat, keys={**told.keys, **beat.keys})
        return beat

    def _ask_how_far(self, target: str, session: str, timeout_s: float) -> list[Beat]:
        told = []
        for answer in self._bus.ask(keys.verb_key(self._realm, target, "@sent", session), timeout_s=timeout_s):
            with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                if not answer.error:
                    told.append(msgspec.json.decode(answer.payload, type=Beat))
        return told

    def _check_first(self, beat: Beat, numbers: dict[str, int]) -> None:
        """Before its first beat a session's numbers are taken as they come: what is beyond them now may be a stranger's."""
        for key, number in numbers.items():
            seen = self.tracker.last(beat.session, key)
            if seen is not None and seen > number:
                held = self._ask_sender(beat.target, Missing(beat.session, key, seen, seen))
                if held.numbered is not None and held.numbered < seen:
                    self.tracker.step_back(beat.session, key, number)

    def _judge(self, beat: Beat, *, look: bool = False) -> bool:
        """Compare a beat with what came; with look only say whether something is missing."""
        numbers = {key: number for key, number in beat.keys.items() if self._receiving.wants(key)}
        out: list[Item] = []
        with self._work:
            if not self.tracker.started(beat.session):
                self._check_first(beat, numbers)
            tails = self.tracker.beat(beat, numbers)
            if look:
                return bool(tails)
            self._receiving.beat(beat, out)
            for tail in tails:
                self._recover(beat.target, tail, out)
            self._sessions[beat.session] = beat.target
            self._gone.pop(beat.session, None)
            if beat.final:
                self._end(beat.session)
            self._beat_seen.notify_all()
            self._receiving.put(out)
        if out:
            self._receiving.hand_over()
        return bool(tails)

    def _end(self, session: str) -> None:
        """Note a last word, and forget the oldest of many, so that a program of months does not grow with each sender."""
        self._final[session] = None
        self._forget_oldest(self._final)

    def gone(self, session: str) -> None:
        """Note that a session went without a last word; called under the lock."""
        self._gone[session] = None
        self._forget_oldest(self._gone)

    def _forget_oldest(self, ended: dict[str, None]) -> None:
        if len(ended) > MAX_ENDED:
            oldest = next(iter(ended))
            del ended[oldest]
            self._last_words.discard(oldest)
            self._sessions.pop(oldest, None)
            self.tracker.forget(oldest)

    # Who has said what.

    def farewell(self, session: str) -> bool:
        """Whether a session that is gone said its last word; waits a moment for one that is still on its way here."""
        if self.tracker.heard(session):
            # It comes through another queue than its token, where it waits for the tails that it names.
            self.wait_for_final(session, 5 * RECHECK_S)
        return session in self._last_words

    def settle(self, timeout_s: float) -> list[str]:
        """Ask every sender how far it is and take in what is missing; returns the sessions that cannot tell any more."""
        deadline = time.monotonic() + timeout_s
        with self._work:
            open_sessions = {s: t for s, t in self._sessions.items() if s not in self._final and self.tracker.started(s)}
            silent = [session for session in open_sessions if session in self._gone]
        for session in silent:
            del open_sessions[session]
        for session, target in open_sessions.items():
            left_s = max(RECHECK_S, deadline - time.monotonic())
            beats = self._ask_how_far(target, session, left_s)
            if not beats:
                # Who is closing just now answers no more, but its final beat is on its way through another queue.
                if not self.wait_for_final(session, left_s):
                    silent.append(session)
            elif self._judge(beats[0], look=True):
                if self._catch_up(beats[0], deadline):
                    self._judge(beats[0])
                else:
                    silent.append(session)
        return silent

    def wait_for_beat(self, session: str | None, count: int, timeout_s: float) -> bool:
        """Wait for a beat of `session`, or of `count` sessions; False when time is up."""
        with self._work:
            return self._beat_seen.wait_for(
                lambda: self.tracker.started(session) if session is not None else self._started() >= count, timeout_s
            )

    def _started(self) -> int:
        return sum(self.tracker.started(session) for session in self._sessions)

    def wait_for_final(self, session: str, timeout_s: float) -> bool:
        """Wait until a session's last word is dealt with; False when time is up."""
        with self._work:
            return self._beat_seen.wait_for(lambda: session in self._final, timeout_s)
