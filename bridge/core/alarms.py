"""What an alarm becomes: a table, decide() and step().

Rule 1: what a call does is a row of NEXT, nowhere else. decide() turns a command into events or an HRESULT.
Rule 2: step() folds an event into an alarm. The live logger, a mirror and a replay share it, so that they cannot differ.
Rule 3: no clock here. Time is a field of the command and of the event.
Rule 4: an event seen twice changes nothing; fold(rest, fold(first)) = fold(all).

Source: manual 5 (alarm), 6.1.5 (FB_TcAlarm) and 6.1.9 (FB_TcEventLogger); what it leaves open is settled in
docs/decisions/0006. An alarm is identified by target, event class, event id and source (manual 5, identification).
"""

from collections.abc import Iterable
from enum import Enum
from typing import ClassVar, Final, TypeAlias

import msgspec

from bridge.core.arguments import Argument
from bridge.core.events import (
    U32,
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmEvent,
    AlarmRaised,
    ConfirmationState,
    Count,
    Event,
    Origin,
    Severity,
    Source,
    Time,
)
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOTFOUND, ERROR_ALREADY_EXISTS, S_OK, AdsError


class AlarmKey(msgspec.Struct, frozen=True, omit_defaults=True):
    """Which alarm: two alarms with the same class and id but different sources are two alarms."""

    target: str
    event_class: str
    event_id: U32
    source_id: U32 | None = None
    source_name: str | None = None
    source_guid: str | None = None


class Alarm(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The state of one alarm. Its attributes are spelled as an event's, so that one filter serves both.

    time_ns is the time of the last transition; session and seq are those of the last event folded in ("" and 0: none yet).
    suspect: its logger or its source is gone without a last word since, and its source has not spoken again. origin: it is
    replayed, and from where.
    """

    target: str
    event_class: str
    event_id: U32
    severity: Severity
    source_id: U32 | None = None
    source_name: str | None = None
    source_guid: str | None = None
    raised: bool = False
    confirmation_state: ConfirmationState = ConfirmationState.NOT_SUPPORTED
    time_ns: Time = 0
    time_raised_ns: Time = 0
    time_cleared_ns: Time = 0
    time_confirmed_ns: Time = 0
    arguments: tuple[Argument, ...] = ()
    json_attribute: str = ""
    vendor_id: U32 | None = None
    product_code: U32 | None = None
    revision_no: U32 | None = None
    session: str = ""
    seq: Count = 0
    operator: str = ""
    client: str = ""
    comment: str = ""
    suspect: bool = False
    origin: Origin | None = None

    kind: ClassVar[str] = "alarm_state"
    is_alarm: ClassVar[bool] = True

    @property
    def key(self) -> AlarmKey:
        """The identity."""
        return AlarmKey(self.target, self.event_class, self.event_id, self.source_id, self.source_name, self.source_guid)

    @property
    def source(self) -> Source:
        """id, name and GUID of the source as one value."""
        return Source(self.source_id, self.source_name, self.source_guid)

    @property
    def is_active(self) -> bool:
        """Raised, or waiting for confirmation (bActive)."""
        return self.raised or self.confirmation_state is ConfirmationState.WAIT_FOR_CONFIRMATION

    @property
    def with_confirmation(self) -> bool:
        """Whether it was created to be confirmed."""
        return self.confirmation_state is not ConfirmationState.NOT_SUPPORTED

    @property
    def was_raised(self) -> bool:
        """Whether it has been raised since it was created; before that nobody else knows of it."""
        return self.time_raised_ns != 0 or self.seq != 0


class Command(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What every call carries. time_ns is explicit: who reads a clock puts "now" there.

    arguments and json_attribute: None keeps those of the alarm, anything else replaces them from this transition on.
    """

    key: AlarmKey
    time_ns: Time = 0
    arguments: tuple[Argument, ...] | None = None
    json_attribute: str | None = None
    operator: str = ""
    client: str = ""
    comment: str = ""


class Create(Command, frozen=True, kw_only=True, omit_defaults=True, tag_field="do", tag="create"):
    """Create an alarm; it is not raised yet and nobody is told."""

    severity: Severity
    with_confirmation: bool = False
    vendor_id: U32 | None = None
    product_code: U32 | None = None
    revision_no: U32 | None = None


class Raise(Command, frozen=True, kw_only=True, omit_defaults=True, tag_field="do", tag="raise"):
    """Raise it; one with confirmation waits for it from now on."""


class Clear(Command, frozen=True, kw_only=True, omit_defaults=True, tag_field="do", tag="clear"):
    """Clear it; with reset_confirmation a waiting confirmation becomes RESET in the same event."""

    reset_confirmation: bool = False


class Confirm(Command, frozen=True, kw_only=True, omit_defaults=True, tag_field="do", tag="confirm"):
    """Confirm it, raised or not."""


class Dispose(Command, frozen=True, kw_only=True, omit_defaults=True, tag_field="do", tag="dispose"):
    """Let go of it; a raised alarm gets its clear time and needs no confirmation any more."""


AlarmCommand: TypeAlias = Create | Raise | Clear | Confirm | Dispose


class Phase(Enum):
    """What decides about a call."""

    ABSENT = "absent"
    IDLE = "not raised, nothing to confirm"
    RAISED = "raised, nothing to confirm"
    RAISED_WAITING = "raised, waiting for confirmation"
    CLEARED_WAITING = "cleared, waiting for confirmation"


def phase(alarm: Alarm | None) -> Phase:
    """The phase an alarm is in."""
    if alarm is None:
        return Phase.ABSENT
    if alarm.confirmation_state is ConfirmationState.WAIT_FOR_CONFIRMATION:
        return Phase.RAISED_WAITING if alarm.raised else Phase.CLEARED_WAITING
    return Phase.RAISED if alarm.raised else Phase.IDLE


class Row(msgspec.Struct, frozen=True):
    """What a call does in a phase: the HRESULT, the event if there is one, and the confirmation state if it changes."""

    result: int
    event: type[AlarmRaised] | type[AlarmCleared] | type[AlarmConfirmed] | type[AlarmDisposed] | None = None
    confirmation: ConfirmationState | None = None


_P, _C = Phase, ConfirmationState
_REFUSED: Final = Row(ADS_E_INVALIDSTATE)
_UNKNOWN: Final = Row(ADS_E_NOTFOUND)
_EXISTS: Final = Row(ERROR_ALREADY_EXISTS)

NEXT: Final[dict[tuple[Phase, str], Row]] = {
    (_P.ABSENT, "create"): Row(S_OK),
    (_P.ABSENT, "raise"): _UNKNOWN,
    (_P.ABSENT, "clear"): _UNKNOWN,
    (_P.ABSENT, "clear_reset"): _UNKNOWN,
    (_P.ABSENT, "confirm"): _UNKNOWN,
    (_P.ABSENT, "dispose"): _UNKNOWN,
    (_P.IDLE, "create"): _EXISTS,
    (_P.IDLE, "raise"): Row(S_OK, AlarmRaised, _C.WAIT_FOR_CONFIRMATION),
    (_P.IDLE, "clear"): _REFUSED,
    (_P.IDLE, "clear_reset"): _REFUSED,
    (_P.IDLE, "confirm"): _REFUSED,
    (_P.IDLE, "dispose"): Row(S_OK, AlarmDisposed),
    (_P.RAISED, "create"): _EXISTS,
    (_P.RAISED, "raise"): _REFUSED,
    (_P.RAISED, "clear"): Row(S_OK, AlarmCleared),
    (_P.RAISED, "clear_reset"): Row(S_OK, AlarmCleared),
    (_P.RAISED, "confirm"): _REFUSED,
    (_P.RAISED, "dispose"): Row(S_OK, AlarmDisposed),
    (_P.RAISED_WAITING, "create"): _EXISTS,
    (_P.RAISED_WAITING, "raise"): _REFUSED,
    (_P.RAISED_WAITING, "clear"): Row(S_OK, AlarmCleared),
    (_P.RAISED_WAITING, "clear_reset"): Row(S_OK, AlarmCleared, _C.RESET),
    (_P.RAISED_WAITING, "confirm"): Row(S_OK, AlarmConfirmed, _C.CONFIRMED),
    (_P.RAISED_WAITING, "dispose"): Row(S_OK, AlarmDisposed, _C.NOT_REQUIRED),
    (_P.CLEARED_WAITING, "create"): _EXISTS,
    (_P.CLEARED_WAITING, "raise"): Row(S_OK, AlarmRaised),
    (_P.CLEARED_WAITING, "clear"): _REFUSED,
    (_P.CLEARED_WAITING, "clear_reset"): _REFUSED,
    (_P.CLEARED_WAITING, "confirm"): Row(S_OK, AlarmConfirmed, _C.CONFIRMED),
    (_P.CLEARED_WAITING, "dispose"): Row(S_OK, AlarmDisposed, _C.NOT_REQUIRED),
}


def row(alarm: Alarm | None, command: AlarmCommand) -> Row:
    """The row of NEXT for a command."""
    name = command.__struct_config__.tag
    if isinstance(command, Clear) and command.reset_confirmation:
        name = "clear_reset"
    return NEXT[phase(alarm), str(name)]


def created(command: Create) -> Alarm:
    """The alarm that a Create makes: not raised, and with confirmation none is required yet."""
    key = command.key
    return Alarm(
        target=key.target,
        event_class=key.event_class,
        event_id=key.event_id,
        severity=command.severity,
        source_id=key.source_id,
        source_name=key.source_name,
        source_guid=key.source_guid,
        confirmation_state=_C.NOT_REQUIRED if command.with_confirmation else _C.NOT_SUPPORTED,
        arguments=command.arguments or (),
        json_attribute=command.json_attribute or "",
        vendor_id=command.vendor_id,
        product_code=command.product_code,
        revision_no=command.revision_no,
    )


def decide(alarm: Alarm | None, command: AlarmCommand) -> tuple[AlarmEvent, ...]:
    """The events a command causes, not yet numbered; none for a Create.

    AdsError with the manual's HRESULT when the call is refused: ADS_E_INVALIDSTATE in the wrong phase, ADS_E_NOTFOUND for
    an unknown alarm. A Create of an existing alarm is no error: it causes nothing (ERROR_ALREADY_EXISTS is an answer).
    """
    choice = row(alarm, command)
    if choice.result >= 0x8000_0000:
        raise AdsError(choice.result, f"{command.__struct_config__.tag} of an alarm that is {phase(alarm).value}")
    if choice.event is None or alarm is None:
        return ()
    now = command.time_ns
    state, raised = alarm.confirmation_state, alarm.raised
    if choice.confirmation is not None and alarm.with_confirmation:
        state = choice.confirmation
    time_raised, time_cleared, time_confirmed = alarm.time_raised_ns, alarm.time_cleared_ns, alarm.time_confirmed_ns
    if choice.event is AlarmRaised:
        raised, time_raised, time_cleared, time_confirmed = True, now, 0, 0
    elif choice.event is AlarmConfirmed:
        time_confirmed = now
    elif raised:
        raised, time_cleared = False, now
    event = choice.event(
        target=alarm.target,
        event_class=alarm.event_class,
        event_id=alarm.event_id,
        severity=alarm.severity,
        time_ns=now,
        source_id=alarm.source_id,
        source_name=alarm.source_name,
        source_guid=alarm.source_guid,
        arguments=alarm.arguments if command.arguments is None else command.arguments,
        json_attribute=alarm.json_attribute if command.json_attribute is None else command.json_attribute,
        raised=raised,
        confirmation_state=state,
        time_raised_ns=time_raised,
        time_cleared_ns=time_cleared,
        time_confirmed_ns=time_confirmed,
        vendor_id=alarm.vendor_id,
        product_code=alarm.product_code,
        revision_no=alarm.revision_no,
        operator=command.operator,
        client=command.client,
        comment=command.comment,
    )
    return (event,)


def alarm_key(event: Event) -> AlarmKey:
    """Which alarm an event is about."""
    return AlarmKey(event.target, event.event_class, event.event_id, event.source_id, event.source_name, event.source_guid)


def step(alarm: Alarm | None, event: AlarmEvent) -> Alarm | None:
    """The alarm after the event; None when it is disposed. An event already folded in changes nothing.

    A transition means that the source is there again, except a confirmation, which comes from an operator.
    """
    if alarm is not None and event.seq and event.session == alarm.session and event.seq <= alarm.seq:
        return alarm
    if isinstance(event, AlarmDisposed):
        return None
    return Alarm(
        target=event.target,
        event_class=event.event_class,
        event_id=event.event_id,
        severity=event.severity,
        source_id=event.source_id,
        source_name=event.source_name,
        source_guid=event.source_guid,
        raised=event.raised,
        confirmation_state=event.confirmation_state,
        time_ns=event.time_ns,
        time_raised_ns=event.time_raised_ns,
        time_cleared_ns=event.time_cleared_ns,
        time_confirmed_ns=event.time_confirmed_ns,
        arguments=event.arguments,
        json_attribute=event.json_attribute,
        vendor_id=event.vendor_id,
        product_code=event.product_code,
        revision_no=event.revision_no,
        session=event.session,
        seq=event.seq,
        operator=event.operator,
        client=event.client,
        comment=event.comment,
        origin=event.origin,
        suspect=alarm is not None and alarm.suspect and isinstance(event, AlarmConfirmed),
    )


class AlarmTable:
    """All alarms of one or more targets, folded from their events.

    Events may come in any order between alarms, so each alarm remembers the sessions it took events of and how far each came,
    a disposed one too. Sessions of a target follow each other: an event of a session that another one has replaced, for that
    alarm or by a snapshot, is stale.
    """

    def __init__(self) -> None:
        self.alarms: dict[AlarmKey, Alarm] = {}
        self._seen: dict[AlarmKey, dict[str, int]] = {}
        self._replaced: set[str] = set()
        self._base: dict[str, tuple[str | None, int]] = {}

    def load(self, alarms: Iterable[Alarm], session: str = "", seq: int = 0, target: str | None = None) -> None:
        """Take over a snapshot: the state of a target (None: of everything) after `seq` events of `session`."""
        self.alarms = {} if target is None else {k: a for k, a in self.alarms.items() if k.target != target}
        seen, self._seen = self._seen, {}
        former = {old for old, (name, _) in self._base.items() if target in (None, name)}
        for key, sessions in seen.items():
            if target in (None, key.target):
                former.update(sessions)
            else:
                self._seen[key] = sessions
        for alarm in alarms:
            self.alarms[alarm.key] = alarm
            self._seen[alarm.key] = {alarm.session: alarm.seq}
            former.add(alarm.session)
        if session:
            self._replaced = (self._replaced | former) - {session, ""}
            self._base[session] = (target, seq)

    def refresh(self, alarms: Iterable[Alarm], session: str, seq: int, target: str, last_seq: int = 0) -> bool:
        """Take over a recorded snapshot, which may stand anywhere among the events of its session; False when it is stale.

        It has all events of the session up to `seq`, and others up to last_seq. What later events said stays, what else differs
        is corrected: so a gap ends at the next snapshot. A session not heard of yet replaces what is known, one that was
        replaced says nothing any more.
        """
        heard = {name for key, seen in self._seen.items() if key.target == target for name in seen} - self._replaced
        if session in self._replaced or (session in self._base and heard - {session, ""}):
            return False
        if session not in self._base and session not in heard:
            self.load(alarms, session, seq, target)
            return True
        told = {alarm.key: alarm for alarm in alarms}
        former = {alarm.session for alarm in told.values()}
        for key in {key for key in (*self._seen, *self.alarms) if key.target == target} | told.keys():
            seen = self._seen.setdefault(key, {})
            former.update(seen)
            alarm, last = told.get(key), seen.get(session, 0)
            if last > (max(seq, last_seq) if alarm is None else seq if alarm.session != session else max(seq, alarm.seq)):
                continue
            if alarm is None:
                self.alarms.pop(key, None)
                continue
            self.alarms[key] = alarm
            if alarm.session == session or not seen:
                seen[alarm.session] = max(last, alarm.seq)
        self._replaced = (self._replaced | former) - {session, ""}
        self._base[session] = (target, max(seq, self.base(session)))
        return True

    def apply(self, event: AlarmEvent) -> bool:
        """Fold one event in; False when it was seen before or is stale."""
        session, seq = event.session, event.seq
        if session in self._replaced or 0 < seq <= self.base(session):
            return False
        key = alarm_key(event)
        seen = self._seen.setdefault(key, {})
        if session in seen and (session != next(reversed(seen)) or 0 < seq <= seen[session]):
            return False
        seen[session] = seq
        after = step(self.alarms.get(key), event)
        if after is None:
            self.alarms.pop(key, None)
        else:
            self.alarms[key] = after
        return True

    def base(self, session: str) -> int:
        """Up to which seq of a session the loaded snapshot reached; 0 without one."""
        return self._base.get(session, ("", 0))[1]

    def put(self, alarm: Alarm) -> None:
        """Set one alarm as it is (a created one, which no event announces)."""
        self.alarms[alarm.key] = alarm

    def suspect(self, target: str | None = None) -> bool:
        """Mark the raised alarms of a target (None: of every target) suspect; whether any was not yet."""
        return bool(self.mark([key for key in self.alarms if target in (None, key.target)], suspect=True))

    def mark(self, alarms: Iterable[AlarmKey], *, suspect: bool) -> list[Alarm]:
        """Mark those that are raised suspect, or take the mark off any; returns those that it changed, as they are now."""
        changed = [
            msgspec.structs.replace(alarm, suspect=suspect)
            for key in alarms
            if (alarm := self.alarms.get(key)) is not None and alarm.suspect != suspect and (alarm.raised or not suspect)
        ]
        self.alarms.update((alarm.key, alarm) for alarm in changed)
        return changed

    def suspects(self, target: str) -> tuple[AlarmKey, ...]:
        """Which alarms of a target are marked."""
        return tuple(sorted((key for key, alarm in self.alarms.items() if alarm.suspect and key.target == target), key=repr))

    def active(self) -> list[Alarm]:
        """Alarms that are raised or wait for confirmation, latest transition last."""
        return sorted((alarm for alarm in self.alarms.values() if alarm.is_active), key=lambda alarm: alarm.time_ns)

    def state(self) -> dict[AlarmKey, tuple[bool, ConfirmationState, int, int, int]]:
        """What "the same state" compares (docs/decisions/0013): raised, confirmation and the three times of known alarms."""
        return {
            key: (
                alarm.raised,
                alarm.confirmation_state,
                alarm.time_raised_ns,
                alarm.time_cleared_ns,
                alarm.time_confirmed_ns,
            )
            for key, alarm in self.alarms.items()
            if alarm.was_raised
        }


def fold(events: Iterable[Event], table: AlarmTable | None = None) -> AlarmTable:
    """Fold events into a table (a new one when none is given); messages are passed over."""
    table = AlarmTable() if table is None else table
    for event in events:
        if isinstance(event, AlarmRaised | AlarmCleared | AlarmConfirmed | AlarmDisposed):
            table.apply(event)
    return table
