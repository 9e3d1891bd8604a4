"""The logger without I/O: what a command leads to, what is stored, what is answered."""

from typing import TypedDict, TypeVar, Unpack

import msgspec
import pytest

from bridge.core.alarms import Alarm, AlarmCommand, AlarmKey, AlarmTable, Clear, Confirm, Create, Dispose, Raise
from bridge.core.arguments import Argument
from bridge.core.events import AlarmCleared, AlarmDisposed, AlarmRaised, AnyEvent, ConfirmationState, Severity
from bridge.core.hresult import (
    ADS_E_BUSY,
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSIZE,
    ADS_E_INVALIDSTATE,
    ADS_E_NOTFOUND,
    ERROR_ALREADY_EXISTS,
    S_OK,
)
from bridge.core.logbook import GONE_KEPT, Changes, Kept, Logbook, Plan
from bridge.core.questions import CommandAnswer, CommandQuestion
from bridge.testing.builders import EVENT_CLASS, TARGET, TIME_NS, alarm_cleared, alarm_disposed, alarm_raised, message_sent

KEY = AlarmKey(TARGET, EVENT_CLASS, 1, None, "MAIN.pump", None)
NOW_NS = TIME_NS + 5
_E = TypeVar("_E", bound=AnyEvent)


class Clerk:
    """A logbook with what a logger puts around it: ids for commands, numbers for events, and what was stored."""

    def __init__(self, book: Logbook | None = None) -> None:
        self.book = book or Logbook(TARGET, "s1")
        self.seq = 0
        self.commands = 0
        self.stored: list[Changes] = []

    def number(self, event: _E) -> _E:
        self.seq += 1
        return msgspec.structs.replace(event, session=self.book.session, seq=self.seq, key_seq=self.seq)

    def ask(self, command: AlarmCommand, id: str | None = None, session: str = "") -> CommandAnswer:
        self.commands += 1
        question = CommandQuestion(id=id if id is not None else f"c{self.commands}", command=command, session=session)
        decision = self.book.decide(question, NOW_NS)
        if isinstance(decision, CommandAnswer):
            return decision
        outcome = self.book.sent(decision, [self.number(event) for event in decision.events], NOW_NS)
        self.stored.append(outcome.changes)
        return outcome.answer

    def events(self) -> list[tuple[str, int]]:
        """Kind and unique id of what was stored."""
        return [(stored.event.kind, stored.unique_id) for changes in self.stored for stored in changes.events]


class CreateFields(TypedDict, total=False):
    severity: Severity
    with_confirmation: bool
    arguments: tuple[Argument, ...] | None
    json_attribute: str | None
    comment: str
    operator: str


def create(key: AlarmKey = KEY, **fields: Unpack[CreateFields]) -> Create:
    given: CreateFields = {"severity": Severity.ERROR, "with_confirmation": True, **fields}
    return Create(key=key, **given)


def raised_clerk() -> Clerk:
    clerk = Clerk()
    clerk.ask(create())
    clerk.ask(Raise(key=KEY))
    return clerk


def test_the_life_of_an_alarm_by_command() -> None:
    """Created, raised, confirmed, cleared, disposed of: each answer has the alarm as it is then and the event it caused."""
    clerk = Clerk()
    created = clerk.ask(create())
    assert (created.result, created.created, created.seq) == (S_OK, True, 0)
    assert created.alarm is not None
    assert not created.alarm.raised

    raised = clerk.ask(Raise(key=KEY, operator="anna", comment="seen from here"))
    assert (raised.result, raised.created, raised.seq) == (S_OK, False, 1)
    assert raised.alarm == clerk.book.table.alarms[KEY]
    assert raised.alarm is not None
    assert (raised.alarm.raised, raised.alarm.operator, raised.alarm.comment) == (True, "anna", "seen from here")

    confirmed = clerk.ask(Confirm(key=KEY))
    assert confirmed.alarm is not None
    assert confirmed.alarm.confirmation_state is ConfirmationState.CONFIRMED
    cleared = clerk.ask(Clear(key=KEY))
    assert cleared.alarm is not None
    assert not cleared.alarm.is_active
    gone = clerk.ask(Dispose(key=KEY))
    assert (gone.result, gone.alarm, gone.seq) == (S_OK, None, 4)
    assert clerk.book.table.alarms == {}
    assert [kind for kind, _ in clerk.events()] == ["alarm_raised", "alarm_confirmed", "alarm_cleared", "alarm_disposed"]


def test_what_is_stored_with_each_command() -> None:
    """A create stores the alarm without an event, a transition both, a dispose the event and that the alarm is gone."""
    clerk = raised_clerk()
    clerk.ask(Dispose(key=KEY))
    created, raised, disposed = clerk.stored
    assert (created.events, [kept.unique_id for kept in created.alarms], created.gone) == ((), [0], ())
    assert [kept.alarm.raised for kept in raised.alarms] == [True]
    assert raised.events[0].unique_id == raised.alarms[0].unique_id == 1
    assert (disposed.alarms, disposed.gone) == ((), (KEY,))
    assert all(stored.arrival_ns == NOW_NS for changes in clerk.stored for stored in changes.events)


def test_deciding_changes_nothing() -> None:
    """A command whose events cannot be sent has not happened: the same command is allowed afterwards."""
    clerk = raised_clerk()
    before = dict(clerk.book.table.alarms)
    question = CommandQuestion(id="x", command=Clear(key=KEY))
    decision = clerk.book.decide(question, NOW_NS)
    assert isinstance(decision, Plan)
    assert isinstance(decision.events[0], AlarmCleared)
    assert clerk.book.table.alarms == before
    assert isinstance(clerk.book.decide(question, NOW_NS), Plan)


def test_the_same_id_is_carried_out_once() -> None:
    """Asking again with the same id gives the same answer and causes nothing."""
    clerk = raised_clerk()
    first = clerk.ask(Clear(key=KEY), id="mine")
    clerk.ask(Raise(key=KEY))
    seq = clerk.seq
    assert clerk.ask(Clear(key=KEY), id="mine") == first
    assert clerk.seq == seq
    assert clerk.book.table.alarms[KEY].raised


def test_a_refusal_is_an_answer_too() -> None:
    """A refused id stays refused, even when the alarm's state would allow the command by now."""
    clerk = raised_clerk()
    refused = clerk.ask(Raise(key=KEY), id="again")
    assert refused.result == ADS_E_INVALIDSTATE
    assert refused.alarm == clerk.book.table.alarms[KEY]
    clerk.ask(Clear(key=KEY))
    assert clerk.ask(Raise(key=KEY), id="again") == refused
    assert not clerk.book.table.alarms[KEY].raised


def test_an_id_belongs_to_one_command() -> None:
    """An id that was used for another command is refused, and the first answer stays."""
    clerk = raised_clerk()
    first = clerk.ask(Clear(key=KEY), id="mine")
    other = clerk.ask(Confirm(key=KEY), id="mine")
    assert (other.result, other.alarm) == (ADS_E_INVALIDPARM, None)
    assert clerk.ask(Clear(key=KEY), id="mine") == first


def test_only_so_many_ids_are_remembered() -> None:
    """An id older than the memory is judged by the alarm's state: a second clear is ADS_E_INVALIDSTATE."""
    clerk = Clerk(Logbook(TARGET, "s1", answers_kept=2))
    clerk.ask(create())
    clerk.ask(Raise(key=KEY))
    assert clerk.ask(Clear(key=KEY), id="old").result == S_OK
    clerk.ask(Raise(key=AlarmKey(TARGET, EVENT_CLASS, 9)), id="other")
    assert clerk.ask(Clear(key=KEY), id="old").result == S_OK
    clerk.ask(Raise(key=AlarmKey(TARGET, EVENT_CLASS, 8)), id="another")
    assert clerk.ask(Clear(key=KEY), id="old").result == ADS_E_INVALIDSTATE


def test_create_of_an_existing_alarm_is_an_answer() -> None:
    """ERROR_ALREADY_EXISTS, created False, and the alarm as it is, whatever was asked for."""
    clerk = raised_clerk()
    again = clerk.ask(create(severity=Severity.INFO, with_confirmation=False))
    assert (again.result, again.created, again.seq) == (ERROR_ALREADY_EXISTS, False, 0)
    assert again.alarm == clerk.book.table.alarms[KEY]
    assert again.alarm.severity is Severity.ERROR


@pytest.mark.parametrize("command", [Raise(key=KEY), Clear(key=KEY), Confirm(key=KEY), Dispose(key=KEY)])
def test_an_unknown_alarm_is_not_found(command: AlarmCommand) -> None:
    """Every call but create answers ADS_E_NOTFOUND for an alarm that nobody created."""
    answer = Clerk().ask(command)
    assert (answer.result, answer.alarm) == (ADS_E_NOTFOUND, None)
    assert command.__struct_config__.tag is not None
    assert str(command.__struct_config__.tag) in answer.detail


def test_time_zero_is_now() -> None:
    """A command without a time takes the logger's; one with a time keeps it."""
    clerk = Clerk()
    clerk.ask(create())
    raised = clerk.ask(Raise(key=KEY)).alarm
    assert raised is not None
    assert raised.time_raised_ns == NOW_NS
    cleared = clerk.ask(Clear(key=KEY, time_ns=77)).alarm
    assert cleared is not None
    assert cleared.time_cleared_ns == 77


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (create(arguments=(Argument.of(1),) * 129), "arguments: 129 is over the limit arguments = 128"),
        (create(AlarmKey(TARGET, EVENT_CLASS, 1, None, "n" * 256)), "source_name: 256 is over"),
        (Raise(key=KEY, json_attribute="x" * 9000), "json_attribute: "),
        (Raise(key=KEY, comment="c" * 1025), "comment: 1025 is over the limit of 1024"),
        (Raise(key=KEY, operator="o" * 256), "operator: 256 is over the limit of 255"),
        (Raise(key=KEY, client="o" * 256), "client: 256 is over the limit of 255"),
    ],
)
def test_a_command_over_a_limit_is_refused(command: AlarmCommand, reason: str) -> None:
    """ADS_E_INVALIDSIZE, saying which limit; nothing happens, and the alarm stays as it is."""
    clerk = Clerk()
    if isinstance(command, Raise):
        clerk.ask(create())
    before = dict(clerk.book.table.alarms)
    answer = clerk.ask(command)
    assert answer.result == ADS_E_INVALIDSIZE
    assert reason in answer.detail
    assert clerk.book.table.alarms == before


@pytest.mark.parametrize(
    ("key", "id", "code"),
    [
        (AlarmKey(TARGET, EVENT_CLASS.upper(), 1), "a", ADS_E_INVALIDDATA),
        (AlarmKey(TARGET, "no guid", 1), "a", ADS_E_INVALIDDATA),
        (AlarmKey(TARGET, EVENT_CLASS, 1, source_guid="{nope}"), "a", ADS_E_INVALIDDATA),
        (AlarmKey("plc2", EVENT_CLASS, 1), "a", ADS_E_INVALIDPARM),
        (KEY, "", ADS_E_INVALIDPARM),
        (KEY, "i" * 256, ADS_E_INVALIDSIZE),
    ],
)
def test_a_command_that_makes_no_sense_is_refused(key: AlarmKey, id: str, code: int) -> None:
    """A class that is no GUID, another logger's alarm, no id or an endless one: refused before an alarm is looked at."""
    clerk = Clerk()
    answer = clerk.ask(create(key), id=id)
    assert answer.result == code
    assert clerk.book.table.alarms == {}


def test_a_command_that_could_not_be_sent_is_refused_for_good() -> None:
    """The publisher's queue was full: that is the answer of this id, and the alarm is as before."""
    clerk = raised_clerk()
    question = CommandQuestion(id="x", command=Clear(key=KEY))
    answer = clerk.book.refuse(question, ADS_E_BUSY, "65536 alarm transitions wait")
    assert answer.alarm == clerk.book.table.alarms[KEY]
    assert clerk.book.decide(question, NOW_NS) == answer


def test_messages_of_others_are_stored() -> None:
    """A message under our target gets a unique id, whoever sent it."""
    book = Logbook(TARGET, "s1")
    changes = book.arrived(message_sent(session="other", seq=4), NOW_NS)
    assert changes is not None
    assert [(stored.unique_id, stored.arrival_ns) for stored in changes.events] == [(1, NOW_NS)]


def test_transitions_of_others_are_refused() -> None:
    """Only the logger of a target makes transitions; a message of another target is none of its business."""
    book = Logbook(TARGET, "s1")
    assert book.arrived(alarm_raised(session="other", seq=4), NOW_NS) is None
    assert book.arrived(message_sent(target="plc2"), NOW_NS) is None
    assert book.table.alarms == {}
    assert book.next_unique_id == 1


def test_unique_ids_are_of_messages_and_of_alarm_lives() -> None:
    """All transitions of a life share its id; a second raise begins another life; messages have their own."""
    clerk = Clerk()
    clerk.ask(create())
    clerk.ask(Raise(key=KEY))
    clerk.ask(Clear(key=KEY))
    clerk.stored.append(clerk.book.message(clerk.number(message_sent()), NOW_NS))
    for command in (Raise(key=KEY), Confirm(key=KEY), Dispose(key=KEY)):
        clerk.ask(command)
    clerk.ask(create())
    clerk.ask(Raise(key=KEY))
    assert clerk.events() == [
        ("alarm_raised", 1),
        ("alarm_cleared", 1),
        ("message_sent", 2),
        ("alarm_raised", 3),
        ("alarm_confirmed", 3),
        ("alarm_disposed", 3),
        ("alarm_raised", 4),
    ]


def test_unique_ids_start_again_after_the_largest() -> None:
    """They have 32 bits; 0 is never given, it stands for none."""
    book = Logbook(TARGET, "s1", next_unique_id=2**32 - 1)
    ids = [book.message(message_sent(seq=n), 0).events[0].unique_id for n in (1, 2)]
    assert ids == [2**32 - 1, 1]


def test_what_an_earlier_session_left_goes_on() -> None:
    """Its alarms are there, a transition keeps the id of their life, and ids go on where they stopped."""
    before = raised_clerk()
    kept = [kept for changes in before.stored[-1:] for kept in changes.alarms]
    clerk = Clerk(Logbook(TARGET, "s2", alarms=kept, next_unique_id=before.book.next_unique_id))
    assert clerk.book.table.alarms == before.book.table.alarms
    assert clerk.ask(Raise(key=KEY)).result == ADS_E_INVALIDSTATE
    assert clerk.ask(Clear(key=KEY)).result == S_OK
    assert clerk.ask(Raise(key=KEY)).result == S_OK
    assert clerk.events() == [("alarm_cleared", 1), ("alarm_raised", 2)]


def test_the_state_is_what_was_raised() -> None:
    """An alarm that was only created is known to nobody else; without alarms there is one empty part."""
    clerk = Clerk()
    clerk.ask(create())
    (empty,) = clerk.book.state_parts(0)
    assert (empty.target, empty.session, empty.alarms, empty.part, empty.parts) == (TARGET, "s1", (), 0, 1)
    clerk.ask(Raise(key=KEY))
    (part,) = clerk.book.state_parts(clerk.seq, read_only=True)
    assert (part.seq, part.read_only) == (1, True)
    assert part.alarms == (clerk.book.table.alarms[KEY],)


def test_a_large_state_comes_in_parts() -> None:
    """A thousand alarms per part, each part with the same seq, together all alarms."""
    clerk = Clerk()
    for number in range(2001):
        key = AlarmKey(TARGET, EVENT_CLASS, number)
        clerk.ask(create(key))
        clerk.ask(Raise(key=key))
    parts = clerk.book.state_parts(clerk.seq)
    assert [(part.part, part.parts, part.seq, len(part.alarms)) for part in parts] == [
        (0, 3, 2001, 1000),
        (1, 3, 2001, 1000),
        (2, 3, 2001, 1),
    ]
    assert {alarm.key for part in parts for alarm in part.alarms} == clerk.book.table.alarms.keys()


def test_a_clean_stop_disposes_of_what_is_raised() -> None:
    """Raised alarms go with their clear time set and no confirmation; cleared ones that wait stay, created ones too."""
    clerk = raised_clerk()
    waiting, idle = AlarmKey(TARGET, EVENT_CLASS, 2), AlarmKey(TARGET, EVENT_CLASS, 3)
    for command in (create(waiting), Raise(key=waiting), Clear(key=waiting), create(idle)):
        clerk.ask(command)
    (event,) = clerk.book.stop(TIME_NS + 9)
    assert isinstance(event, AlarmDisposed)
    assert (event.time_cleared_ns, event.raised) == (TIME_NS + 9, False)
    assert event.confirmation_state is ConfirmationState.NOT_REQUIRED
    changes = clerk.book.replay(clerk.number(event), NOW_NS)
    assert changes.gone == (KEY,)
    assert clerk.book.table.alarms.keys() == {waiting, idle}
    assert clerk.book.stop(TIME_NS + 9) == ()


def test_a_replay_seen_twice_changes_no_alarm() -> None:
    """Recorded events of any target are folded in as they are; again, they change no alarm."""
    book = Logbook(None)
    events: list[AnyEvent] = [
        alarm_raised(session="a", seq=1),
        alarm_cleared(session="a", seq=2),
        alarm_raised(target="plc2", session="b", seq=1),
    ]
    for event in events:
        assert book.replay(event, NOW_NS).alarms
    state = book.table.state()
    assert {key.target for key in state} == {TARGET, "plc2"}
    assert [book.replay(event, NOW_NS).alarms for event in events] == [(), (), ()]
    assert book.table.state() == state


def test_a_recorded_state_takes_the_place_of_what_was_known() -> None:
    """A keyframe brings alarms without events, removes those it does not have, and leaves other targets alone."""
    book = Logbook(None)
    for event in (alarm_raised(session="a", seq=1), alarm_raised(event_id=8, session="a", seq=2)):
        book.replay(event, NOW_NS)
    book.replay(alarm_disposed(event_id=8, session="a", seq=3), NOW_NS)
    book.replay(alarm_raised(target="plc2", session="b", seq=1), NOW_NS)
    there = Alarm(target=TARGET, event_class=EVENT_CLASS, event_id=5, severity=Severity.INFO, raised=True, session="c", seq=3)
    changes = book.load_state(TARGET, "c", 3, [there])
    assert [(key.target, key.event_id) for key in changes.gone] == [(TARGET, 1)], "once, not what was gone before"
    assert {(key.target, key.event_id) for key in book.table.alarms} == {(TARGET, 5), ("plc2", 1)}
    life = next(kept.unique_id for kept in changes.alarms if kept.alarm == there)
    assert life > 3
    assert book.replay(alarm_cleared(event_id=5, session="c", seq=3), NOW_NS).alarms == ()
    assert book.replay(alarm_cleared(event_id=5, session="c", seq=4), NOW_NS).events[0].unique_id == life


def test_following_a_table_that_somebody_else_keeps() -> None:
    """A mirror numbers and stores events whose fold a listener has done, and can write the whole table anew."""
    table = AlarmTable()
    book = Logbook(TARGET, alarms=[Kept(9, Alarm(target=TARGET, event_class=EVENT_CLASS, event_id=7, severity=Severity.INFO))])
    assert [key.event_id for key in book.adopt(table).gone] == [7]
    raised = alarm_raised(session="s", seq=1)
    table.apply(raised)
    changes = book.follow(raised, NOW_NS)
    assert [kept.alarm for kept in changes.alarms] == list(table.alarms.values())
    table.load([])
    again = book.follow(alarm_cleared(session="s", seq=2), NOW_NS)
    assert (again.events[0].unique_id, again.alarms, len(again.gone)) == (changes.events[0].unique_id, (), 1)


def test_a_stale_raise_of_an_older_session_ends_no_life() -> None:
    """It is stored, but the alarm and the id of its life stay."""
    book = Logbook(None)
    book.load_state(TARGET, "a", 0, [])
    book.replay(alarm_raised(session="a", seq=1), NOW_NS)
    book.load_state(TARGET, "b", 0, [])
    life = book.replay(alarm_raised(session="b", seq=1), NOW_NS).events[0].unique_id
    late = book.replay(
        AlarmRaised(target=TARGET, event_class=EVENT_CLASS, event_id=1, severity=Severity.INFO, session="a", seq=2), 1
    )
    assert (len(late.events), late.alarms) == (1, ())
    assert book.replay(alarm_cleared(session="b", seq=2), NOW_NS).events[0].unique_id == life


def test_a_source_that_is_gone_leaves_its_raised_alarms_suspect() -> None:
    """Those it created or raised last, and nobody else's; when it is back they are as they were. It changes the marks only."""
    clerk = Clerk()
    mine, theirs, cleared, taken_over = (AlarmKey(TARGET, EVENT_CLASS, number) for number in range(1, 5))
    for key, session in ((mine, "pump"), (theirs, "valve"), (cleared, "pump"), (taken_over, "pump")):
        clerk.ask(create(key), session=session)
        clerk.ask(Raise(key=key), session=session)
    clerk.ask(Clear(key=cleared, reset_confirmation=True))
    assert clerk.ask(Raise(key=taken_over), session="valve").result == ADS_E_INVALIDSTATE
    before, marks = clerk.book.table.state(), clerk.book.marks
    changes = clerk.book.source_gone("pump")
    assert [(kept.alarm.key, kept.alarm.suspect, kept.unique_id) for kept in changes.alarms] == [(mine, True, 1)]
    assert changes.events == () == changes.gone
    assert (clerk.book.table.state(), clerk.book.marks) == (before, marks + 1)
    assert clerk.book.source_gone("pump") == Changes()
    assert [(kept.alarm.key, kept.alarm.suspect) for kept in clerk.book.source_back("pump").alarms] == [(mine, False)]
    assert clerk.book.marks == marks + 2


def test_a_source_that_speaks_again_takes_the_mark_off() -> None:
    """A refused raise does, by whoever: no event tells that, so the marks have changed. A confirmation does not."""
    clerk = Clerk()
    clerk.ask(create(), session="pump")
    clerk.ask(Raise(key=KEY), session="pump")
    clerk.book.source_gone("pump")
    clerk.ask(Confirm(key=KEY))
    assert clerk.book.table.alarms[KEY].suspect
    marks = clerk.book.marks
    assert clerk.ask(Raise(key=KEY), session="pump again").result == ADS_E_INVALIDSTATE
    assert not clerk.book.table.alarms[KEY].suspect
    assert clerk.book.marks == marks + 1
    assert clerk.book.source_gone("pump") == Changes()
    assert len(clerk.book.source_gone("pump again").alarms) == 1
    clerk.ask(Dispose(key=KEY))
    assert clerk.book.source_back("pump again") == Changes()


def test_what_a_source_asked_for_before_it_died_leaves_suspect_alarms_too() -> None:
    """Its commands may be carried out after its end was told: nobody stands for those alarms, until it is back."""
    clerk = Clerk()
    early, late = (AlarmKey(TARGET, EVENT_CLASS, number) for number in (1, 2))
    for key in (early, late):
        clerk.ask(create(key), session="pump")
    clerk.ask(Raise(key=early), session="pump")
    clerk.book.source_gone("pump")
    marks = clerk.book.marks
    raised = clerk.ask(Raise(key=late), session="pump")
    assert raised.alarm is not None
    assert raised.alarm.suspect
    assert [kept.alarm.suspect for kept in clerk.stored[-1].alarms] == [True]
    assert clerk.book.marks == marks + 1
    assert clerk.ask(Raise(key=early), session="pump").result == ADS_E_INVALIDSTATE
    assert clerk.book.table.suspects(TARGET) == (early, late)
    assert len(clerk.book.source_back("pump").alarms) == 2
    clerk.ask(Clear(key=late, reset_confirmation=True), session="pump")
    clerk.ask(Raise(key=late), session="pump")
    assert clerk.book.table.suspects(TARGET) == ()


def test_only_so_many_sources_that_are_gone_are_remembered() -> None:
    """What a session of long ago asked for has come by now."""
    clerk = Clerk()
    clerk.ask(create(), session="0")
    for number in range(GONE_KEPT + 1):
        clerk.book.source_gone(str(number))
    clerk.ask(Raise(key=KEY), session="0")
    assert clerk.book.table.suspects(TARGET) == ()


def test_the_session_of_a_source_has_a_limit() -> None:
    """As every name in a command."""
    assert Clerk().ask(create(), session="x" * 256).result == ADS_E_INVALIDSIZE


def test_what_an_earlier_session_carried_out_is_not_carried_out_again() -> None:
    """Its answer is that of then: the event and who made it; the alarm is as it is now. Another id is another command."""
    before = Clerk()
    questions = [CommandQuestion(id=name, command=done) for name, done in (("c", create()), ("r", Raise(key=KEY)))]
    for question in questions:
        before.ask(question.command, question.id)
    before.ask(Clear(key=KEY))
    answered = [each for changes in before.stored for each in changes.answered]
    assert [(each.session, each.seq, each.created) for each in answered] == [
        ("s1", 0, True),
        ("s1", 1, False),
        ("s1", 2, False),
    ]
    left = [Kept(1, alarm) for alarm in before.book.table.alarms.values()]
    after = Clerk(Logbook(TARGET, "s2", alarms=left, answered=answered))
    made, raised = (after.ask(question.command, question.id) for question in questions)
    assert (made.result, made.session, made.created) == (S_OK, "s1", True)
    assert (raised.result, raised.session, raised.seq, raised.alarm) == (S_OK, "s1", 1, left[0].alarm)
    assert after.stored == []
    again = after.ask(Raise(key=KEY), "another")
    assert (again.session, again.seq) == ("s2", 1)


def test_a_command_with_any_text_has_a_digest() -> None:
    """A lone surrogate, which only a program of Python can send, changes nothing."""
    clerk = Clerk()
    assert clerk.ask(create(comment="\ud800")).result == S_OK
    assert len(clerk.stored[0].answered[0].digest) == 16
