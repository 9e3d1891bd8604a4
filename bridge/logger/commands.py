"""The calls of a logger: the same names, arguments, results and errors inside its process and through the proxy.

Rule 1: every command is one CommandQuestion with an id of its own; who carries it out is decided below this class.
Rule 2: a negative HRESULT raises AdsError; "already exists" is an answer with created = False. What is over a limit is
ADS_E_INVALIDSIZE here (a command may come from far away), where send_message raises LimitError itself.
Rule 3: without a source an alarm belongs to the code that calls (manual 5.8): create_alarm and get_alarm take the caller's
qualified name and the object id.
Rule 4: who, from where and why go with each command: operator, client (host:program unless told otherwise) and comment.
Rule 5: clear_alarms() and confirm_alarms() are one command per alarm, each whole or not at all, with an event of its own. An
alarm that somebody else has cleared, confirmed or disposed of meanwhile is passed over. When one command fails the rest is
not tried: what was done is done, and the same call again does what is left.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

import msgspec

from bridge.asking import new_id, this_client
from bridge.core.alarms import Alarm, AlarmCommand, AlarmKey, Clear, Confirm, Create, Dispose, Raise
from bridge.core.arguments import Argument, Value, guid
from bridge.core.events import ConfirmationState, MessageSent, Severity, Source
from bridge.core.filters.ast import Expr, resolve
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOTFOUND, AdsError, raise_if_failed
from bridge.core.questions import ClearLogAnswer, ClearLogQuestion, CommandAnswer, CommandQuestion, LogQuestion, Stored
from bridge.publisher import default_source

_LATE: Final = (ADS_E_INVALIDSTATE, ADS_E_NOTFOUND)
"""What a logger answers when an alarm is not any more as it was."""


class Created(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to create_alarm: the alarm, whether it is new, and the HRESULT (0, or ERROR_ALREADY_EXISTS)."""

    alarm: Alarm
    created: bool
    result: int


class Commands(ABC):
    """Commands to the logger of `target`, and questions about its alarms and its log."""

    def __init__(
        self,
        target: str,
        *,
        object_id: int | None = None,
        client: str | None = None,
        resolve_class: Callable[[str], Sequence[str]] | None = None,
    ) -> None:
        """object_id is the source id of alarms without a source; resolve_class finds the GUIDs of a class name in filters."""
        self.target = target
        self._object_id = object_id
        self._client = this_client() if client is None else client
        self._resolve_class = resolve_class

    @abstractmethod
    def _do(self, question: CommandQuestion) -> CommandAnswer:
        """Have a command carried out."""

    @abstractmethod
    def _known_alarms(self) -> dict[AlarmKey, Alarm]:
        """The alarms as they are now."""

    @abstractmethod
    def log(self, question: LogQuestion | None = None) -> Iterator[Stored]:
        """Stored events, newest first unless the question says otherwise."""

    @abstractmethod
    def _clear(self, question: ClearLogQuestion) -> ClearLogAnswer:
        """Have stored events forgotten."""

    def clear_log(self, which: LogQuestion | None = None, *, operator: str = "", comment: str = "") -> int:
        """Forget stored events, all of them without a question; how many went. Alarm states are never touched.

        That it was done, by whom, from where and why is an event of its own (core/own_events.py). AdsError for a bad question.
        """
        which = LogQuestion() if which is None else which
        answer = self._clear(
            ClearLogQuestion(id=new_id(), which=which, operator=operator, client=self._client, comment=comment)
        )
        raise_if_failed(answer.result, answer.detail)
        return answer.cleared

    @abstractmethod
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
    ) -> MessageSent:
        """Send one message; returns it as numbered. time_ns 0 is now. LimitError over a limit."""

    def do(self, command: AlarmCommand) -> CommandAnswer:
        """Carry out a command; AdsError when the answer is a negative HRESULT."""
        answer = self._once(command)
        raise_if_failed(answer.result, answer.detail)
        return answer

    def _once(self, command: AlarmCommand) -> CommandAnswer:
        return self._do(CommandQuestion(id=new_id(), command=command))

    def create_alarm(
        self,
        event_class: str,
        event_id: int,
        severity: Severity,
        *,
        with_confirmation: bool = False,
        source: Source | None = None,
        arguments: Iterable[Argument | Value] = (),
        json_attribute: str = "",
        vendor_id: int | None = None,
        product_code: int | None = None,
        revision_no: int | None = None,
    ) -> Created:
        """Create an alarm; it is not raised and nobody is told. When it exists: created False, and `alarm` as it is.

        AdsError ADS_E_INVALIDSIZE over a limit; ValueError for a class that is no GUID.
        """
        if source is None:
            source = default_source(self._object_id, depth=2)
        answer = self.do(
            Create(
                key=AlarmKey(self.target, guid(event_class), event_id, source.id, source.name, source.guid),
                severity=Severity(severity),
                with_confirmation=with_confirmation,
                arguments=_arguments(arguments),
                json_attribute=json_attribute,
                vendor_id=vendor_id,
                product_code=product_code,
                revision_no=revision_no,
                client=self._client,
            )
        )
        if answer.alarm is None:
            raise TypeError(f"the answer {answer.id} to a create carries no alarm")
        return Created(alarm=answer.alarm, created=answer.created, result=answer.result)

    def raise_alarm(
        self,
        alarm: Alarm | AlarmKey,
        *,
        time_ns: int = 0,
        arguments: Iterable[Argument | Value] | None = None,
        json_attribute: str | None = None,
        operator: str = "",
        comment: str = "",
    ) -> Alarm:
        """Raise it; time_ns 0 is now, None keeps arguments and JSON attribute as they are. ADS_E_INVALIDSTATE when raised."""
        return self._alarm_after(
            Raise(
                key=_key(alarm),
                time_ns=time_ns,
                arguments=None if arguments is None else _arguments(arguments),
                json_attribute=json_attribute,
                operator=operator,
                client=self._client,
                comment=comment,
            )
        )

    def clear_alarm(
        self,
        alarm: Alarm | AlarmKey,
        *,
        reset_confirmation: bool = False,
        time_ns: int = 0,
        arguments: Iterable[Argument | Value] | None = None,
        json_attribute: str | None = None,
        operator: str = "",
        comment: str = "",
    ) -> Alarm:
        """Clear it; with reset_confirmation nobody needs to confirm any more. ADS_E_INVALIDSTATE when not raised."""
        return self._alarm_after(
            Clear(
                key=_key(alarm),
                reset_confirmation=reset_confirmation,
                time_ns=time_ns,
                arguments=None if arguments is None else _arguments(arguments),
                json_attribute=json_attribute,
                operator=operator,
                client=self._client,
                comment=comment,
            )
        )

    def confirm_alarm(
        self,
        alarm: Alarm | AlarmKey,
        *,
        time_ns: int = 0,
        arguments: Iterable[Argument | Value] | None = None,
        json_attribute: str | None = None,
        operator: str = "",
        comment: str = "",
    ) -> Alarm:
        """Confirm it, raised or not. ADS_E_INVALIDSTATE when no confirmation is waited for."""
        return self._alarm_after(
            Confirm(
                key=_key(alarm),
                time_ns=time_ns,
                arguments=None if arguments is None else _arguments(arguments),
                json_attribute=json_attribute,
                operator=operator,
                client=self._client,
                comment=comment,
            )
        )

    def dispose_alarm(
        self, alarm: Alarm | AlarmKey, *, time_ns: int = 0, operator: str = "", comment: str = ""
    ) -> CommandAnswer:
        """Let go of it; a raised alarm gets its clear time. ADS_E_NOTFOUND when there is none."""
        return self.do(Dispose(key=_key(alarm), time_ns=time_ns, operator=operator, client=self._client, comment=comment))

    def clear_alarms(
        self,
        filter: Expr | str | None = None,
        *,
        reset_confirmation: bool = False,
        time_ns: int = 0,
        operator: str = "",
        comment: str = "",
    ) -> list[Alarm]:
        """Clear every raised alarm that the filter takes as it is now; returns them as they are then, oldest change first.

        Manual 6.1.9.1 and 6.1.9.2, with their default for reset_confirmation. What is not raised is left alone, also when it
        waits for confirmation. Errors: those of active_alarms() before anything is done, those of clear_alarm() in the middle.
        """
        return [
            cleared
            for alarm in self.active_alarms(filter)
            if alarm.raised
            and (
                cleared := self._alarm_unless_late(
                    Clear(
                        key=alarm.key,
                        reset_confirmation=reset_confirmation,
                        time_ns=time_ns,
                        operator=operator,
                        client=self._client,
                        comment=comment,
                    )
                )
            )
        ]

    def confirm_alarms(
        self, filter: Expr | str | None = None, *, time_ns: int = 0, operator: str = "", comment: str = ""
    ) -> list[Alarm]:
        """Confirm every alarm that waits for it and that the filter takes as it is now; returns them as they are then.

        Manual 6.1.9.4 and 6.1.9.5. Errors are as for clear_alarms().
        """
        waiting = ConfirmationState.WAIT_FOR_CONFIRMATION
        return [
            confirmed
            for alarm in self.active_alarms(filter)
            if alarm.confirmation_state is waiting
            and (
                confirmed := self._alarm_unless_late(
                    Confirm(key=alarm.key, time_ns=time_ns, operator=operator, client=self._client, comment=comment)
                )
            )
        ]

    def _alarm_unless_late(self, command: Clear | Confirm) -> Alarm | None:
        """The alarm after the command; None when somebody else was faster."""
        answer = self._once(command)
        if answer.result in _LATE and not answer.read_only:
            return None
        raise_if_failed(answer.result, answer.detail)
        return self._alarm_in(answer)

    def _alarm_after(self, command: AlarmCommand) -> Alarm:
        return self._alarm_in(self.do(command))

    def _alarm_in(self, answer: CommandAnswer) -> Alarm:
        if answer.alarm is None:
            raise AdsError(ADS_E_NOTFOUND, f"{self.target} answered without the alarm")
        return answer.alarm

    def get_alarm(self, event_class: str, event_id: int, source: Source | None = None) -> Alarm:
        """The alarm as it is now, of the calling code when no source is given. AdsError ADS_E_NOTFOUND when there is none.

        From outside an alarm can be found from its first raise on; before, only its creator knows it.
        """
        if source is None:
            source = default_source(self._object_id, depth=2)
        key = AlarmKey(self.target, guid(event_class), event_id, source.id, source.name, source.guid)
        alarm = self._known_alarms().get(key)
        if alarm is None:
            raise AdsError(ADS_E_NOTFOUND, f"no alarm {event_id} of {key.event_class} from {source} at {self.target}")
        return alarm

    def active_alarms(self, filter: Expr | str | None = None) -> list[Alarm]:
        """Alarms that are raised or wait for confirmation, and that the filter takes as they are now; oldest change first.

        FilterSyntaxError, UnknownClassError or AdsError for a bad filter.
        """
        expr = parse(filter, resolve_class=self._resolve_class) if isinstance(filter, str) else filter
        matches = None if expr is None else compile_filter(resolve(expr, self._resolve_class))
        active = [alarm for alarm in self._known_alarms().values() if alarm.is_active]
        return sorted((a for a in active if matches is None or matches(a)), key=lambda a: (a.time_ns, a.seq))

    def is_raised(self, alarm: Alarm | AlarmKey) -> bool:
        """Whether it is raised now; False for an unknown one."""
        known = self._known_alarms().get(_key(alarm))
        return known is not None and known.raised


def _key(alarm: Alarm | AlarmKey) -> AlarmKey:
    return alarm.key if isinstance(alarm, Alarm) else alarm


def _arguments(items: Iterable[Argument | Value]) -> tuple[Argument, ...]:
    return tuple([item if isinstance(item, Argument) else Argument.of(item) for item in items])
