"""The logger without I/O: what it stores, what it answers, what becomes of its alarms.

Rule 1: decide() changes no alarm, but takes the mark off a suspect one whose source speaks. What it allows is numbered by
the publisher first and only then folded in by sent(): so a command that cannot be sent has not happened.
Rule 2: a command is carried out once per id. The last ANSWERS_KEPT answers are kept, and those an earlier session left; an
older id is judged by the alarm's state alone. The id of one command used for another is refused.
Rule 3: alarm transitions come from this logger only. arrived() takes messages of others and refuses their transitions;
replay() takes all that was recorded; follow() takes what a listener has folded in. An alarm that was replayed (it has an
origin) stays as it was recorded: commands to it are refused.
Rule 4: a unique id belongs to a message or to an alarm life and is given when it is stored. A life begins with its raise, so
a second raise begins another one.
Rule 5: no clock here. "Now" comes in with each call.
Rule 6: who created or raised an alarm last, from a session of its own, is its source: when that session is gone without a
last word, what it left raised is suspect; when it is back, it is not. Refused calls count: the source has spoken. A command
of a session that is gone was on its way before: what it raises is suspect too, and it takes no mark off.
"""

from collections.abc import Iterable, Mapping
from hashlib import blake2b
from types import MappingProxyType
from typing import Final, TypeAlias

import msgspec

from bridge.core.alarms import (
    Alarm,
    AlarmCommand,
    AlarmKey,
    AlarmTable,
    Clear,
    Create,
    Dispose,
    Raise,
    alarm_key,
    created,
    decide,
)
from bridge.core.arguments import guid
from bridge.core.events import (
    DEFAULT_LIMITS,
    AlarmDisposed,
    AlarmEvent,
    AlarmRaised,
    AnyEvent,
    LimitError,
    Limits,
    MessageSent,
    check_limits,
)
from bridge.core.hresult import (
    ADS_E_INVALIDACCESS,
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSIZE,
    ERROR_ALREADY_EXISTS,
    AdsError,
)
from bridge.core.questions import PART_ITEMS, CommandAnswer, CommandQuestion, StatePart, Stored

ANSWERS_KEPT: Final = 10_000
"""How many commands are known by their id; at 100 commands a second that is more than a minute and a half."""
GONE_KEPT: Final = 1_000
"""How many sources that are gone are remembered, for commands of theirs that come later."""
NAME_CHARS: Final = 255
COMMENT_CHARS: Final = 1024
_MAX_ID: Final = 2**32 - 1


class Kept(msgspec.Struct, frozen=True):
    """An alarm as it is now, and the unique id of its life; 0 before the first raise."""

    unique_id: int
    alarm: Alarm


class Answered(msgspec.Struct, frozen=True):
    """A command that was carried out: its digest, the session and number of its event (0: none), whether it made the alarm."""

    digest: bytes
    session: str
    seq: int
    created: bool


class Changes(msgspec.Struct, frozen=True):
    """What must be stored together: events with their unique ids, alarms as they are now, alarms that are gone, and which
    command it was."""

    events: tuple[Stored, ...] = ()
    alarms: tuple[Kept, ...] = ()
    gone: tuple[AlarmKey, ...] = ()
    answered: tuple[Answered, ...] = ()


class Plan(msgspec.Struct, frozen=True):
    """A command that is allowed: the events to send, none for a Create, which makes `alarm`."""

    question: CommandQuestion
    events: tuple[AlarmEvent, ...] = ()
    alarm: Alarm | None = None


class Outcome(msgspec.Struct, frozen=True):
    """What to store, and what to answer when it is stored."""

    answer: CommandAnswer
    changes: Changes


Decision: TypeAlias = Plan | CommandAnswer
"""Events to send first, or an answer at once: known already, refused, or nothing to do."""


def _fault(command_key: AlarmKey, texts: Iterable[tuple[str, str, int]]) -> AdsError | None:
    """What is wrong with the names in a command, before its alarm is looked at."""
    for name, text in (("event_class", command_key.event_class), ("source_guid", command_key.source_guid)):
        try:
            wrong = text is not None and guid(text) != text
        except ValueError:
            wrong = True
        if wrong:
            return AdsError(ADS_E_INVALIDDATA, f"{name} {text!r} is no GUID in lower case without braces")
    for name, text, allowed in texts:
        if len(text) > allowed:
            return AdsError(ADS_E_INVALIDSIZE, f"{name}: {len(text)} is over the limit of {allowed} characters")
    return None


class Logbook:
    """The alarms of a target (None: of every target, for replays), and the numbers and answers a logger gives."""

    def __init__(
        self,
        target: str | None,
        session: str = "",
        *,
        alarms: Iterable[Kept] = (),
        next_unique_id: int = 1,
        limits: Limits = DEFAULT_LIMITS,
        answers_kept: int = ANSWERS_KEPT,
        answered: Iterable[Answered] = (),
    ) -> None:
        """alarms, next_unique_id and answered are what an earlier session left."""
        self.target, self.session, self.limits = target, session, limits
        self.next_unique_id = next_unique_id
        self.table = AlarmTable()
        self.marks = 0
        """How often marks were set or taken off without an event that tells it."""
        self._sources: dict[AlarmKey, str] = {}
        self._gone: dict[str, None] = {}
        self._lives: dict[AlarmKey, int] = {}
        self._answers: dict[str, tuple[int, CommandAnswer]] = {}
        self._answers_kept = answers_kept
        self._earlier = {each.digest: each for each in answered}
        left = list(alarms)
        self.table.load(kept.alarm for kept in left)
        self._lives.update((kept.alarm.key, kept.unique_id) for kept in left)

    # Commands.

    def decide(self, question: CommandQuestion, now_ns: int) -> Decision:
        """What a command leads to; time_ns 0 in it becomes now_ns. Refusals are answers too: this raises nothing."""
        known = self._answers.get(question.id)
        if known is not None and known[0] == hash(question):
            return known[1]
        if self._earlier and (before := self._earlier.get(_digest(question))) is not None:
            answer = self._answer(question, 0, self.table.alarms.get(question.command.key), seq=before.seq)
            return msgspec.structs.replace(answer, session=before.session, created=before.created)
        command = question.command
        texts = (
            ("id", question.id, NAME_CHARS),
            ("session", question.session, NAME_CHARS),
            ("operator", command.operator, NAME_CHARS),
            ("client", command.client, NAME_CHARS),
            ("comment", command.comment, COMMENT_CHARS),
        )
        if known is not None or not question.id:
            reason = "the id belongs to another command" if known is not None else "a command needs an id"
            return self._answer(question, ADS_E_INVALIDPARM, None, reason)
        if command.key.target != self.target:
            return self._answer(question, ADS_E_INVALIDPARM, None, f"an alarm of {command.key.target!r} at {self.target!r}")
        if (fault := _fault(command.key, texts)) is not None:
            return self._answer(question, fault.code, None, fault.detail)
        if not command.time_ns:
            command = msgspec.structs.replace(command, time_ns=now_ns)
        if (replayed := self._replayed(command)) is not None:
            return self.refuse(question, ADS_E_INVALIDACCESS, replayed)
        if question.session not in self._gone:
            if isinstance(command, Create | Raise | Clear) and self.table.mark((command.key,), suspect=False):
                self.marks += 1
            if isinstance(command, Create | Raise) and command.key in self.table.alarms:
                self._sources[command.key] = question.session
        alarm = self.table.alarms.get(command.key)
        try:
            events = decide(alarm, command)
            if isinstance(command, Create):
                if alarm is not None:
                    return self._remember(question, self._answer(question, ERROR_ALREADY_EXISTS, alarm))
                alarm = created(command)
                check_limits(_as_event(alarm), self.limits)
                return Plan(question, (), alarm)
            for event in events:
                check_limits(event, self.limits)
        except LimitError as error:
            return self._answer(question, ADS_E_INVALIDSIZE, alarm, str(error))
        except AdsError as error:
            return self.refuse(question, error.code, error.detail)
        return Plan(question, events)

    def _replayed(self, command: AlarmCommand) -> str | None:
        """Why a command cannot be: the alarm is a replayed one, which stays as it was recorded."""
        alarm = self.table.alarms.get(command.key)
        if alarm is None or alarm.origin is None or isinstance(command, Create):
            return None
        return f"the alarm is replayed: session {alarm.origin.session} of realm {alarm.origin.realm}, event {alarm.origin.seq}"

    def refuse(self, question: CommandQuestion, code: int, detail: str) -> CommandAnswer:
        """Answer no, and remember that: the same id gets the same answer."""
        return self._remember(question, self._answer(question, code, self.table.alarms.get(question.command.key), detail))

    def sent(self, plan: Plan, events: Iterable[AlarmEvent], arrival_ns: int) -> Outcome:
        """The plan's events are numbered and on their way: fold them in, and say what to store and to answer."""
        question = plan.question
        if plan.alarm is not None:
            self.table.put(plan.alarm)
            self._sources[plan.alarm.key] = question.session
            self._lives[plan.alarm.key] = 0
            answer = CommandAnswer(id=question.id, session=self.session, alarm=plan.alarm, created=True)
            changes = Changes(alarms=(Kept(0, plan.alarm),), answered=(self._answered(answer, question),))
            return Outcome(self._remember(question, answer), changes)
        changes, seq = Changes(), 0
        for event in events:
            changes, seq = self.replay(event, arrival_ns), event.seq
        if question.session in self._gone and isinstance(question.command, Raise):
            self._sources[question.command.key] = question.session
            marked = self._marked(question.session, suspect=True)
            changes = msgspec.structs.replace(changes, alarms=marked.alarms or changes.alarms)
        answer = self._answer(question, 0, self.table.alarms.get(question.command.key), seq=seq)
        changes = msgspec.structs.replace(changes, answered=(self._answered(answer, question),))
        return Outcome(self._remember(question, answer), changes)

    def stop(self, now_ns: int) -> tuple[AlarmEvent, ...]:
        """The events of a clean stop: raised alarms are disposed of; what waits for confirmation stays (decision 0006).

        Replayed ones stay as they were recorded. Each goes through replay() once it is numbered.
        """
        raised = [alarm for alarm in self.table.active() if alarm.raised and alarm.origin is None]
        return tuple(event for alarm in raised for event in decide(alarm, Dispose(key=alarm.key, time_ns=now_ns)))

    def _answer(
        self, question: CommandQuestion, code: int, alarm: Alarm | None, detail: str = "", *, seq: int = 0
    ) -> CommandAnswer:
        return CommandAnswer(id=question.id, session=self.session, result=code, detail=detail, alarm=alarm, seq=seq)

    def _answered(self, answer: CommandAnswer, question: CommandQuestion) -> Answered:
        return Answered(_digest(question), self.session, answer.seq, answer.created)

    def _remember(self, question: CommandQuestion, answer: CommandAnswer) -> CommandAnswer:
        self._answers[question.id] = (hash(question), answer)
        if len(self._answers) > self._answers_kept:
            del self._answers[next(iter(self._answers))]
        return answer

    # Events.

    def arrived(self, event: AnyEvent, arrival_ns: int) -> Changes | None:
        """A message of another publisher. None for what is refused: a transition, or another target."""
        if not isinstance(event, MessageSent) or event.target != self.target:
            return None
        return Changes((self._stored(event, arrival_ns, self._new_id()),))

    def message(self, event: MessageSent, arrival_ns: int) -> Changes:
        """A message of this logger's own."""
        return Changes((self._stored(event, arrival_ns, self._new_id()),))

    def replay(self, event: AnyEvent, arrival_ns: int) -> Changes:
        """An event of any kind that is folded in as it is: recorded, or this logger's own. Seen before, it changes no alarm."""
        if isinstance(event, MessageSent):
            return self.message(event, arrival_ns)
        return self._numbered(event, arrival_ns, self.table.apply(event))

    def follow(self, event: AnyEvent, arrival_ns: int) -> Changes:
        """An event that the table has taken in already, because a listener keeps it (adopt)."""
        if isinstance(event, MessageSent):
            return self.message(event, arrival_ns)
        return self._numbered(event, arrival_ns, True)

    def _numbered(self, event: AlarmEvent, arrival_ns: int, changed: bool) -> Changes:
        key = alarm_key(event)
        unique_id = self._lives.get(key, 0)
        if not unique_id or (changed and isinstance(event, AlarmRaised)):
            unique_id = self._new_id()
        stored = (self._stored(event, arrival_ns, unique_id),)
        if not changed:
            return Changes(stored)
        if isinstance(event, AlarmDisposed):  # the table may be ahead of the event (follow)
            self._lives.pop(key, None)
            self._sources.pop(key, None)
        else:
            self._lives[key] = unique_id
        alarm = self.table.alarms.get(key)
        if alarm is None:
            return Changes(stored, gone=(key,))
        return Changes(stored, (Kept(unique_id, alarm),))

    def source_gone(self, session: str) -> Changes:
        """The source with this session is gone without a last word: what it left raised is suspect."""
        self._gone[session] = None
        if len(self._gone) > GONE_KEPT:
            del self._gone[next(iter(self._gone))]
        return self._marked(session, suspect=True)

    def source_back(self, session: str) -> Changes:
        """The source with this session could not be reached, and is there again."""
        self._gone.pop(session, None)
        return self._marked(session, suspect=False)

    def _marked(self, session: str, *, suspect: bool) -> Changes:
        alarms = self.table.mark([key for key, source in self._sources.items() if source == session], suspect=suspect)
        self.marks += bool(alarms)
        return Changes(alarms=tuple(Kept(self._lives.get(alarm.key, 0), alarm) for alarm in alarms))

    def load_state(self, target: str, session: str, seq: int, alarms: Iterable[Alarm], last_seq: int = 0) -> Changes:
        """Take over a recorded state of a target after `seq` events of `session`; what it corrects is written anew."""
        before = dict(self.table.alarms)
        self.table.refresh(alarms, session, seq, target, last_seq)
        for key, alarm in before.items():
            now = self.table.alarms.get(key)
            if now is not None and now.time_raised_ns != alarm.time_raised_ns:  # its raise was missed: another life
                self._lives.pop(key, None)
        return self._rewritten(before)

    def adopt(self, table: AlarmTable) -> Changes:
        """Use a table that somebody else keeps from now on; all of it is written anew."""
        self.table = table
        return self._rewritten()

    def _rewritten(self, before: Mapping[AlarmKey, Alarm] = MappingProxyType({})) -> Changes:
        """The table as changes of what was there before."""
        alarms = dict(self.table.alarms)
        gone = tuple(key for key in self._lives if key not in alarms)
        for key in gone:
            del self._lives[key]
        for key, alarm in alarms.items():
            if not self._lives.setdefault(key, 0) and alarm.was_raised:
                self._lives[key] = self._new_id()
        changed = tuple(Kept(self._lives[key], alarm) for key, alarm in alarms.items() if before.get(key) != alarm)
        return Changes((), changed, gone)

    @staticmethod
    def _stored(event: AnyEvent, arrival_ns: int, unique_id: int) -> Stored:
        return Stored(event=event, unique_id=unique_id, arrival_ns=arrival_ns)

    def _new_id(self) -> int:
        unique_id = self.next_unique_id
        self.next_unique_id = unique_id + 1 if unique_id < _MAX_ID else 1
        return unique_id

    # Answers.

    def state_parts(self, seq: int, *, read_only: bool = False) -> list[StatePart]:
        """The state after `seq` events of this session, in parts of 1,000: alarms that were raised and not disposed of."""
        alarms = [alarm for alarm in self.table.alarms.values() if alarm.was_raised]
        count = max(1, -(-len(alarms) // PART_ITEMS))
        return [
            StatePart(
                target=self.target or "",
                session=self.session,
                seq=seq,
                part=part,
                parts=count,
                alarms=tuple(alarms[part * PART_ITEMS : (part + 1) * PART_ITEMS]),
                read_only=read_only,
            )
            for part in range(count)
        ]


def _digest(question: CommandQuestion) -> bytes:
    """Which command it is, its id included; the same in every process."""
    try:
        data = msgspec.json.encode(question)
    except UnicodeEncodeError:  # a lone surrogate, from this process
        data = repr(question).encode("utf-8", "backslashreplace")
    return blake2b(data, digest_size=16).digest()


def _as_event(alarm: Alarm) -> AlarmDisposed:
    """An event of the size that the alarm's transitions will have, to measure it."""
    return AlarmDisposed(
        target=alarm.target,
        event_class=alarm.event_class,
        event_id=alarm.event_id,
        severity=alarm.severity,
        source_id=alarm.source_id,
        source_name=alarm.source_name,
        source_guid=alarm.source_guid,
        arguments=alarm.arguments,
        json_attribute=alarm.json_attribute,
    )
