"""What a logger may be asked, and how it answers: the payloads of @state, @log and @do.

Rule 1: every answer names the session that gave it, so that two loggers for one target are seen.
Rule 2: a command carries an id; asking again with the same id gives the same result and does nothing twice.
Rule 3: an answer has at most PART_ITEMS items; `part` of `parts` says whether it is whole.
Rule 4: read_only marks the answers of a logger that has stepped back for an older one; who gets another answer ignores them.
"""

from typing import Final, Literal, TypeAlias

import msgspec

from bridge.core.alarms import Alarm, AlarmCommand
from bridge.core.event_fields import SortName
from bridge.core.events import U32, AnyEvent, Count
from bridge.core.sequence import Missing

PART_ITEMS: Final = 1000
ViewName: TypeAlias = Literal["transitions", "occurrences"]


class StatePart(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A part of the state of a target after `seq` events of `session`: alarms that were raised and not disposed."""

    target: str
    session: str
    seq: Count
    part: Count = 0
    parts: Count = 1
    alarms: tuple[Alarm, ...] = ()
    read_only: bool = False


class LogQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which stored events: those a filter text takes, or those somebody missed. limit 0 is all of them.

    They are sorted by arrival, or by `sort`; newest_first also means the largest first. limit takes the first of them so
    sorted, with take_last the last, and offset leaves out as many at that end. Texts and class names are sorted as they are in
    `lang`. In the view of occurrences an alarm's life is one row, its newest transition, and the filter is asked about that.
    """

    filter: str = ""
    limit: Count = 0
    offset: Count = 0
    newest_first: bool = True
    missing: Missing | None = None
    sort: SortName | Literal[""] = ""
    take_last: bool = False
    view: ViewName = "transitions"
    lang: str = ""


class Stored(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An event as a logger keeps it: with its unique id and when it arrived (Unix ns)."""

    event: AnyEvent
    unique_id: U32 = 0
    arrival_ns: Count = 0


class LogPart(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A part of the answer to a LogQuestion."""

    session: str
    part: Count = 0
    last: bool = True
    events: tuple[Stored, ...] = ()
    read_only: bool = False


class CommandQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A command with its id. session: who stands for the alarm from then on, as long as its token is there; "" nobody does."""

    id: str
    command: AlarmCommand
    session: str = ""


class CommandAnswer(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of a command: the HRESULT, a detail for people, the alarm as it is now, and who answered.

    created: a Create made a new alarm. seq: the event it caused, 0 for none.
    """

    id: str
    session: str
    result: U32 = 0
    detail: str = ""
    alarm: Alarm | None = None
    created: bool = False
    seq: Count = 0
    read_only: bool = False


class ClearLogQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Asked on @do/clear_log: forget the stored events that `which` selects. Alarm states stay as they are."""

    id: str
    which: LogQuestion = LogQuestion()
    operator: str = ""
    client: str = ""
    comment: str = ""


class ClearLogAnswer(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How many events were forgotten, or the HRESULT and a detail for people; and who answered."""

    id: str
    session: str
    result: U32 = 0
    detail: str = ""
    cleared: Count = 0
    read_only: bool = False
