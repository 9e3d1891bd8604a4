"""A logger from elsewhere: the same calls over the bus.

Rule 1: an empty answer means "unknown". A command is then asked again with the same id, which cannot do it twice, until time
is up; then the state is read back and CommandUnknownError says what is known.
Rule 2: who creates or raises alarms stands for them from then on: it shows that it is there until disconnect(), or until its
bus is closed. Leaving so leaves the alarms as they are; being killed makes those that it left raised suspect.
Rule 3: exactly one logger answers for a target. Two are an error (TwoLoggersError); one that has stepped back does not count.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import TracebackType
from typing import Final, Self, TypeVar

import msgspec

from bridge.asking import ask_sessions, read_answer
from bridge.core import codec, keys
from bridge.core.alarms import Alarm, AlarmKey, Create, Raise
from bridge.core.arguments import ZERO_GUID, Argument, Value
from bridge.core.events import DEFAULT_LIMITS, Limits, MessageSent, Severity, Source
from bridge.core.filters.text import parse
from bridge.core.questions import (
    ClearLogAnswer,
    ClearLogQuestion,
    CommandAnswer,
    CommandQuestion,
    LogPart,
    LogQuestion,
    StatePart,
    Stored,
)
from bridge.edges.bus import Bus, Closable
from bridge.listener import TwoLoggersError
from bridge.logger.commands import Commands
from bridge.logger.presence import Presence, show_source
from bridge.publisher import Publisher, default_source

_STEP_S: Final = 0.02
_ASK_S: Final = 2.0
_LOG_S: Final = 60.0
_T = TypeVar("_T", CommandAnswer, ClearLogAnswer, StatePart, LogPart)


class NoLoggerError(RuntimeError):
    """No logger of the target answers; `reason` is what was heard instead, "" for nothing."""

    def __init__(self, target: str, asked: str, reason: str = "") -> None:
        self.target, self.reason = target, reason
        super().__init__(f"no logger of {target!r} answers {asked}" + (f": {reason}" if reason else ""))


class CommandUnknownError(RuntimeError):
    """A command was not answered: whether it was carried out is unknown.

    answers: whether the logger answers questions now; alarm: the alarm as that answer has it (None: not known there).
    """

    def __init__(self, target: str, command: str, alarm: Alarm | None, answers: bool, reason: str = "") -> None:
        self.target, self.command, self.alarm, self.answers, self.reason = target, command, alarm, answers, reason
        known = "its logger does not answer at all"
        if answers:
            known = "its logger has no such raised alarm" if alarm is None else f"the alarm is {_state(alarm)}"
        super().__init__(f"{command} at {target!r} was not answered; {known}" + (f" ({reason})" if reason else ""))


def _state(alarm: Alarm) -> str:
    return f"{'raised' if alarm.raised else 'not raised'}, {alarm.confirmation_state.name.lower()}"


class LoggerProxy(Commands):
    """The logger of `target`, wherever it runs. A context manager: connects on entering, disconnects on leaving."""

    def __init__(
        self,
        bus: Bus,
        target: str,
        *,
        realm: str = keys.LIVE,
        timeout_s: float = 2.0,
        encoding: codec.Encoding = codec.JSON,
        limits: Limits = DEFAULT_LIMITS,
        object_id: int | None = None,
        client: str | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
        on_connection: Callable[[bool], None] | None = None,
    ) -> None:
        """timeout_s is how long a command is tried; on_connection(there) is called on a thread of ours when that changes."""
        super().__init__(target, object_id=object_id, client=client, resolve_class=resolve_class)
        self.bus, self.realm, self.timeout_s = bus, realm, timeout_s
        self.session = os.urandom(8).hex()
        """Which source this is in the logger's eyes."""
        self._source: Closable | None = None
        self._encoding, self._limits = encoding, limits
        self._on_connection = on_connection
        self._presence: Presence | None = None
        self._publisher: Publisher | None = None
        self._lock = threading.Lock()

    # Connection.

    def connect(self, timeout_s: float | None = None) -> bool:
        """Watch for the logger and wait until it is there; False when it is not in time (it may come later)."""
        with self._lock:
            if self._presence is None:
                self._presence = Presence(self.bus, self.target, self.realm, self._on_connection)
            presence = self._presence
        return presence.wait(self.timeout_s if timeout_s is None else timeout_s)

    def disconnect(self) -> int:
        """Stop watching, leave the alarms to the logger, close what send_message() opened; how many messages were not sent."""
        with self._lock:
            presence, self._presence = self._presence, None
            publisher, self._publisher = self._publisher, None
            source, self._source = self._source, None
        if source is not None:
            source.close()
        if presence is not None:
            presence.close()
        return publisher.close() if publisher is not None else 0

    @property
    def is_connected(self) -> bool:
        """Whether the logger is there; False before connect()."""
        presence = self._presence
        return presence is not None and bool(presence.sessions)

    # Asking.

    def _ask(self, kind: type[_T], verb: str, payload: bytes, *parts: str, timeout_s: float = _ASK_S) -> tuple[list[_T], str]:
        """The answers of the one logger, and the last refusal heard. TwoLoggersError when two answer."""
        key = keys.verb_key(self.realm, self.target, verb, *parts)
        found, reason = ask_sessions(self.bus, key, payload, kind, timeout_s=timeout_s)
        if len(found) > 1:
            found = {session: items for session, items in found.items() if not items[0].read_only} or found
        if len(found) > 1:
            raise TwoLoggersError(self.target, sorted(found))
        return next(iter(found.values()), []), reason

    def _do(self, question: CommandQuestion) -> CommandAnswer:
        if isinstance(question.command, Create | Raise):
            with self._lock:
                if self._source is None:
                    self._source = show_source(self.bus, self.target, self.realm, self.session)
            question = msgspec.structs.replace(question, session=self.session)
        deadline = time.monotonic() + self.timeout_s
        payload = msgspec.json.encode(question)
        name = str(question.command.__struct_config__.tag)
        while True:
            answers, reason = self._ask(CommandAnswer, "@do", payload, name)
            if answers:
                return answers[0]
            if time.monotonic() >= deadline:
                break
            time.sleep(_STEP_S)
        state = self._state_now()
        alarm = None if state is None else state.get(question.command.key)
        raise CommandUnknownError(self.target, name, alarm, state is not None, reason)

    def _clear(self, question: ClearLogQuestion) -> ClearLogAnswer:
        deadline = time.monotonic() + self.timeout_s
        payload = msgspec.json.encode(question)
        while True:
            answers, reason = self._ask(ClearLogAnswer, "@do", payload, "clear_log", timeout_s=_LOG_S)
            if answers:
                return answers[0]
            if time.monotonic() >= deadline:
                raise NoLoggerError(self.target, "@do/clear_log", reason)
            time.sleep(_STEP_S)

    def _state_now(self) -> dict[AlarmKey, Alarm] | None:
        parts, _ = self._ask(StatePart, "@state", b"")
        if not parts or len(parts) != parts[0].parts or len({part.seq for part in parts}) != 1:
            return None
        return {alarm.key: alarm for part in parts for alarm in part.alarms}

    def _known_alarms(self) -> dict[AlarmKey, Alarm]:
        deadline = time.monotonic() + self.timeout_s
        while (state := self._state_now()) is None:
            if time.monotonic() >= deadline:
                raise NoLoggerError(self.target, "@state")
            time.sleep(_STEP_S)
        return state

    def log(self, question: LogQuestion | None = None) -> Iterator[Stored]:
        """Stored events, as they come.

        FilterSyntaxError or AdsError for a bad filter; NoLoggerError when nobody answers, the answer breaks off, or the logger
        refuses (it does not know a class name, say).
        """
        question = question or LogQuestion()
        if question.filter:
            parse(question.filter, resolve_class=lambda _name: (ZERO_GUID,))  # the logger may know classes that we do not
        return self._log(question)

    def _log(self, question: LogQuestion) -> Iterator[Stored]:
        spare: dict[str, list[LogPart]] = {}
        reason = ""
        taken = _Parts(self.target)
        key = keys.verb_key(self.realm, self.target, "@log")
        for answer in self.bus.ask_each(key, msgspec.json.encode(question), timeout_s=_LOG_S):
            part = read_answer(answer, LogPart)
            if isinstance(part, str):
                reason = part
            elif part.read_only:
                spare.setdefault(part.session, []).append(part)
            else:
                yield from taken.take(part)
        if not taken.session and len(spare) == 1:
            for part in next(iter(spare.values())):
                yield from taken.take(part)
        if not taken.done:
            raise NoLoggerError(self.target, "@log", reason or ("the answer breaks off" if taken.session else ""))

    # Sending.

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
        """Send one message under the target, with a session of this proxy's own; the logger need not be there.

        LimitError over a limit, ValueError for a class that is no GUID.
        """
        if source is None:
            source = default_source(self._object_id, depth=2)
        with self._lock:
            if self._publisher is None:
                self._publisher = Publisher(
                    self.bus,
                    self.target,
                    realm=self.realm,
                    encoding=self._encoding,
                    limits=self._limits,
                    object_id=self._object_id,
                )
            publisher = self._publisher
        return publisher.send_message(
            event_class,
            event_id,
            severity,
            source=source,
            arguments=arguments,
            json_attribute=json_attribute,
            time_ns=time_ns,
            vendor_id=vendor_id,
            product_code=product_code,
            revision_no=revision_no,
        )

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.disconnect()


class _Parts:
    """The parts of one logger's answer, in order."""

    def __init__(self, target: str) -> None:
        self.target, self.session, self.next, self.done = target, "", 0, False

    def take(self, part: LogPart) -> tuple[Stored, ...]:
        if self.session not in ("", part.session):
            raise TwoLoggersError(self.target, sorted((self.session, part.session)))
        if part.part != self.next:
            raise NoLoggerError(self.target, "@log", f"part {self.next} of the answer is missing")
        self.session, self.next, self.done = part.session, self.next + 1, part.last
        return part.events
