"""Where a replay is seen: for each target a stand-in for its logger, in the realm of the replay.

Rule 1: a stand-in sends the events with numbers of its own and answers for the alarms as the replay has them now, so late
joiners, mirrors and listeners with state are right.
Rule 2: it refuses every command with ADS_E_INVALIDACCESS: what was is not changed by who looks at it.
Rule 3: it holds the name of the logger. Where a logger of the target is, there is no replay.
Rule 4: after a jump a stand-in is another session: so everybody asks for the state anew.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import msgspec

from bridge.core import codec, keys
from bridge.core.alarms import Alarm
from bridge.core.catalog import Catalog
from bridge.core.events import AnyEvent, MessageSent
from bridge.core.hresult import ADS_E_INVALIDACCESS
from bridge.core.logbook import Logbook
from bridge.core.questions import ClearLogAnswer, ClearLogQuestion, CommandAnswer, CommandQuestion
from bridge.edges.bus import Bus, Question, Refusal, Reply
from bridge.publisher import Publisher, PublisherClosedError, new_logger_session
from bridge.texts import ClassOffer

FLUSH_S: Final = 30.0
_CLEAR_LOG: Final = "clear_log"


class LoggerThereError(RuntimeError):
    """A logger of a target is in the realm, where a replay would be a second one."""

    def __init__(self, target: str, realm: str) -> None:
        self.target, self.realm = target, realm
        super().__init__(f"realm {realm} has a logger of {target!r}; replay into another realm, or rename the target")


class StandIn:
    """The logger of one target, as the recording has it."""

    def __init__(
        self,
        bus: Bus,
        target: str,
        realm: str,
        alarms: Iterable[Alarm],
        *,
        encoding: codec.Encoding,
        catalog: Catalog,
        clock: Callable[[], int],
    ) -> None:
        self.target, self.realm = target, realm
        self.session = new_logger_session()
        self._book = Logbook(target, self.session)
        self._book.table.load(alarms)
        self._seq = 0
        self._lock = threading.Lock()

        def key(verb: str, *parts: str | None) -> str:
            return keys.verb_key(realm, target, verb, *parts)

        self._answers = [
            bus.answer(key("@state"), self._answer_state),
            bus.answer(key("@do", None), self._answer_command),
            bus.answer(key("@log"), self._answer_log),
        ]
        self._offer = ClassOffer(bus, target, catalog, realm=realm, session=self.session)
        # The token comes last: who sees it finds the state.
        self.publisher = Publisher(
            bus, target, realm=realm, role="logger", session=self.session, encoding=encoding, on_full="wait", clock=clock
        )

    def send(self, event: AnyEvent) -> None:
        """Send an event; waits when the bus does."""
        sent = self.publisher.send(event)
        if isinstance(sent, MessageSent):
            self._seq = sent.seq
            return
        with self._lock:
            self._book.table.apply(sent)
            self._seq = sent.seq

    def _answer_state(self, _question: Question) -> Iterator[Reply]:
        with self._lock:
            parts = self._book.state_parts(self._seq)
        for part in parts:
            yield Reply(msgspec.json.encode(part))

    def _answer_command(self, question: Question) -> Iterator[Reply | Refusal]:
        detail = f"{self.target} in realm {self.realm} is a replay; it stays as it was recorded"
        answer: CommandAnswer | ClearLogAnswer
        try:
            if keys.parse_verb_key(question.key)[3] == (_CLEAR_LOG,):
                forget = msgspec.json.decode(question.payload, type=ClearLogQuestion)
                answer = ClearLogAnswer(id=forget.id, session=self.session, result=ADS_E_INVALIDACCESS, detail=detail)
            else:
                asked = msgspec.json.decode(question.payload, type=CommandQuestion)
                with self._lock:
                    alarm = self._book.table.alarms.get(asked.command.key)
                answer = CommandAnswer(
                    id=asked.id, session=self.session, result=ADS_E_INVALIDACCESS, detail=detail, alarm=alarm
                )
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, keys.KeyFormatError) as error:
            yield Refusal(f"no command: {error}")
            return
        yield Reply(msgspec.json.encode(answer))

    def _answer_log(self, _question: Question) -> Iterator[Refusal]:
        yield Refusal(f"{self.target} in realm {self.realm} is a replay, which keeps no log; replay into a cache file for one")

    def close(self, timeout_s: float) -> int:
        """Send what waits and say the last word; how many events could not be sent."""
        unsent = self.publisher.close(timeout_s)
        self._offer.close()
        for answer in self._answers:
            answer.close()
        return unsent


class Stage:
    """The stand-ins of a replay."""

    def __init__(self, bus: Bus, realm: str, *, encoding: codec.Encoding, catalog: Catalog, clock: Callable[[], int]) -> None:
        self.realm, self.unsent = realm, 0
        self._bus, self._encoding, self._catalog, self._clock = bus, encoding, catalog, clock
        self._there: dict[str, StandIn] = {}
        self._closed = False

    def refuse_loggers(self, targets: Iterable[str]) -> None:
        """Return when no target has a logger in the realm; LoggerThereError else."""
        deadline = time.monotonic() + self._bus.undiscovered_s()
        wanted = sorted(targets)
        while True:
            for target in wanted:
                if self._bus.who_is_alive(keys.verb_key(self.realm, target, "@alive", "logger", None), timeout_s=0.5):
                    raise LoggerThereError(target, self.realm)
            if time.monotonic() >= deadline:
                return
            time.sleep(0.02)

    def enter(self, target: str, alarms: Iterable[Alarm] = ()) -> StandIn:
        """A new stand-in for a target, with these alarms, in place of the one there is."""
        self._leave(target, FLUSH_S)
        if self._closed:
            raise PublisherClosedError(f"the replay of {target} is over")
        made = self._there[target] = StandIn(
            self._bus, target, self.realm, alarms, encoding=self._encoding, catalog=self._catalog, clock=self._clock
        )
        if self._closed:  # meanwhile, by another thread, which may not have seen it
            self._leave(target, 0.0)
        return made

    def send(self, event: AnyEvent) -> None:
        """Send an event as its target."""
        there = self._there.get(event.target)
        (self.enter(event.target) if there is None else there).send(event)

    def is_heard(self) -> bool:
        """Whether anybody listens to one of them."""
        return any(each.publisher.wait_for_listener(0.0) for each in list(self._there.values()))

    def flush(self, timeout_s: float = FLUSH_S) -> None:
        """Wait until everything was handed to the bus."""
        deadline = time.monotonic() + timeout_s
        for each in self._there.values():
            each.publisher.flush(max(0.0, deadline - time.monotonic()))

    def _leave(self, target: str, timeout_s: float) -> None:
        there = self._there.pop(target, None)
        if there is not None:
            self.unsent += there.close(timeout_s)

    def close(self, timeout_s: float = 2.0) -> int:
        """Everybody leaves, and nobody enters any more; how many events could not be sent."""
        self._closed = True
        deadline = time.monotonic() + timeout_s
        for target in list(self._there):
            self._leave(target, max(0.1, deadline - time.monotonic()))
        return self.unsent
