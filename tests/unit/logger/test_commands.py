"""The calls of a logger: the same names, results and errors from inside and through the proxy."""

import inspect
from collections.abc import Iterator

import msgspec
import pytest

from bridge.asking import this_client
from bridge.core.alarms import Alarm, AlarmKey, Clear
from bridge.core.arguments import Argument
from bridge.core.events import AlarmEvent, ConfirmationState, LimitError, MessageSent, Severity, Source
from bridge.core.filters.ast import Expr
from bridge.core.filters.spelling import where
from bridge.core.filters.text import FilterSyntaxError
from bridge.core.hresult import (
    ADS_E_INVALIDSIZE,
    ADS_E_INVALIDSTATE,
    ADS_E_NOMOREHDL,
    ADS_E_NOTFOUND,
    ERROR_ALREADY_EXISTS,
    AdsError,
)
from bridge.core.questions import LogQuestion
from bridge.logger import Commands, EventLogger, LoggerProxy
from bridge.testing.builders import TIME_NS
from tests.unit.logger.logger_stories import CLASS, PUMP, alone, eventually, new_alarm


@pytest.fixture(params=["inside", "proxy"])
def plc1(request: pytest.FixtureRequest) -> Iterator[Commands]:
    """The logger of plc1, once as it is and once through the proxy; its clock stands still."""
    with alone() as bus, EventLogger("plc1", bus=bus, clock=lambda: TIME_NS, object_id=0x0101) as logger:
        if request.param == "inside":
            yield logger
        else:
            with LoggerProxy(bus, "plc1", object_id=0x0101) as proxy:
                yield proxy


def test_the_life_of_an_alarm(plc1: Commands) -> None:
    """Created, raised, confirmed while raised, cleared, disposed of; the log has each transition, newest first."""
    alarm = new_alarm(plc1)
    raised = plc1.raise_alarm(alarm, arguments=(1.5,), json_attribute='{"a":1}')
    assert (raised.time_raised_ns, raised.raised, raised.arguments) == (TIME_NS, True, (Argument.of(1.5),))
    assert plc1.is_raised(alarm)
    assert plc1.is_raised(alarm.key)
    assert plc1.get_alarm(CLASS, 1, PUMP) == raised
    confirmed = plc1.confirm_alarm(alarm, time_ns=TIME_NS + 1)
    assert (confirmed.confirmation_state, confirmed.time_confirmed_ns) == (ConfirmationState.CONFIRMED, TIME_NS + 1)
    assert confirmed.arguments == raised.arguments
    assert not plc1.clear_alarm(alarm).is_active
    assert not plc1.is_raised(alarm)
    assert plc1.dispose_alarm(alarm).alarm is None
    events = [stored.event for stored in plc1.log()]
    assert [event.kind for event in events] == ["alarm_disposed", "alarm_cleared", "alarm_confirmed", "alarm_raised"]
    assert [event.seq for event in events] == [4, 3, 2, 1]


def test_clear_with_reset_of_the_confirmation(plc1: Commands) -> None:
    """The alarm is over at once: nobody needs to confirm it."""
    alarm = new_alarm(plc1)
    plc1.raise_alarm(alarm)
    cleared = plc1.clear_alarm(alarm, reset_confirmation=True)
    assert (cleared.confirmation_state, cleared.is_active) == (ConfirmationState.RESET, False)


def test_who_and_why_stand_in_the_event(plc1: Commands) -> None:
    """Operator and comment as given, the client as host and program."""
    alarm = new_alarm(plc1)
    plc1.raise_alarm(alarm)
    plc1.clear_alarm(alarm, operator="anna", comment="cooled down")
    plc1.confirm_alarm(alarm, operator="ben", comment="seen")
    who = [
        (event.operator, event.client, event.comment)
        for stored in plc1.log(LogQuestion(newest_first=False))
        if isinstance(event := stored.event, AlarmEvent)
    ]
    client = this_client()
    assert who == [("", client, ""), ("anna", client, "cooled down"), ("ben", client, "seen")]


def test_create_again_gives_the_alarm_as_it_is(plc1: Commands) -> None:
    """An answer, no error: created is False, and severity and confirmation stay."""
    alarm = new_alarm(plc1)
    plc1.raise_alarm(alarm)
    again = plc1.create_alarm(CLASS, 1, Severity.VERBOSE, source=PUMP)
    assert (again.result, again.created) == (ERROR_ALREADY_EXISTS, False)
    assert again.alarm is not None
    assert (again.alarm.severity, again.alarm.raised, again.alarm.with_confirmation) == (Severity.ERROR, True, True)


def test_without_a_source_an_alarm_belongs_to_the_calling_code(plc1: Commands) -> None:
    """create_alarm and get_alarm take the caller's qualified name and object id; another function's alarm is another."""
    created = plc1.create_alarm(CLASS, 1, Severity.INFO).alarm
    assert created is not None
    assert created.source_id == 0x0101
    assert created.source_name is not None
    assert created.source_name.endswith("test_without_a_source_an_alarm_belongs_to_the_calling_code")
    plc1.raise_alarm(created)
    assert plc1.get_alarm(CLASS, 1).key == created.key

    def elsewhere() -> None:
        plc1.get_alarm(CLASS, 1)

    with pytest.raises(AdsError, match="no alarm 1") as refused:
        elsewhere()
    assert refused.value.code == ADS_E_NOTFOUND


def test_active_alarms_are_filtered_by_state(plc1: Commands) -> None:
    """A filter looks at an alarm as it is now, so an alarm that stops matching leaves the list."""
    for number in (1, 2):
        plc1.raise_alarm(new_alarm(plc1, number))
    new_alarm(plc1, 3)
    assert [alarm.event_id for alarm in plc1.active_alarms()] == [1, 2]
    assert [alarm.event_id for alarm in plc1.active_alarms("event_id = 2")] == [2]
    assert [alarm.event_id for alarm in plc1.active_alarms(where.event_id == 1)] == [1]
    plc1.clear_alarm(plc1.get_alarm(CLASS, 1, PUMP))
    assert [alarm.event_id for alarm in plc1.active_alarms("is_raised")] == [2]


@pytest.mark.parametrize("call", ["active_alarms", "log"])
def test_a_bad_filter_is_an_error_at_the_call(plc1: Commands, call: str) -> None:
    """Misspelled: where and how it was meant. Too many conditions: ADS_E_NOMOREHDL."""

    def ask(text: str) -> None:
        if call == "log":
            plc1.log(LogQuestion(filter=text))
        else:
            plc1.active_alarms(text)

    with pytest.raises(FilterSyntaxError, match="did you mean"):
        ask("sevrity = 1")
    with pytest.raises(AdsError) as refused:
        ask(" or ".join(["event_id = 1"] * 256))
    assert refused.value.code == ADS_E_NOMOREHDL


def test_the_log_is_asked_for_what_one_wants(plc1: Commands) -> None:
    """Filter, limit, offset and order."""
    for number in range(1200):
        plc1.send_message(CLASS, number, Severity.WARNING)
    assert eventually(lambda: sum(1 for _ in plc1.log()) == 1200)
    question = LogQuestion(filter="severity >= warning and event_id < 10", limit=2, offset=1)
    assert [stored.event.event_id for stored in plc1.log(question)] == [8, 7]
    oldest = plc1.log(LogQuestion(limit=2, newest_first=False))
    assert [stored.event.event_id for stored in oldest] == [0, 1]
    assert sorted(stored.unique_id for stored in plc1.log()) == list(range(1, 1201))


def test_a_message_is_sent_and_stored(plc1: Commands) -> None:
    """The caller is its source, unless one is given; over a limit it is a LimitError, and nothing is sent."""
    sent = plc1.send_message(CLASS, 7, Severity.WARNING, arguments=("axis", 3), time_ns=TIME_NS)
    assert (sent.target, sent.source_id) == ("plc1", 0x0101)
    assert sent.source_name is not None
    assert sent.source_name.endswith("test_a_message_is_sent_and_stored")
    with pytest.raises(LimitError):
        plc1.send_message(CLASS, 7, Severity.WARNING, json_attribute="x" * 9000)
    other = plc1.send_message(CLASS, 8, Severity.WARNING, source=Source(5, "MAIN"), time_ns=TIME_NS)
    assert (other.source_id, other.source_name, other.seq) == (5, "MAIN", 2)
    assert eventually(lambda: [stored.event for stored in plc1.log(LogQuestion(newest_first=False))] == [sent, other])


def test_refusals_carry_the_manuals_code(plc1: Commands) -> None:
    """Wrong state, unknown, over a limit: AdsError with code and reason."""
    alarm = new_alarm(plc1)
    with pytest.raises(AdsError) as wrong_state:
        plc1.clear_alarm(alarm)
    with pytest.raises(AdsError) as unknown:
        plc1.confirm_alarm(AlarmKey("plc1", CLASS, 99))
    with pytest.raises(AdsError, match="arguments = 128") as too_large:
        plc1.raise_alarm(alarm, arguments=range(129))
    codes = [refused.value.code for refused in (wrong_state, unknown, too_large)]
    assert codes == [ADS_E_INVALIDSTATE, ADS_E_NOTFOUND, ADS_E_INVALIDSIZE]
    assert not plc1.is_raised(alarm)


@pytest.mark.parametrize("event_class", ["no guid", "54cc5482"])
def test_a_class_that_is_no_guid_is_the_callers_mistake(plc1: Commands, event_class: str) -> None:
    """ValueError, before anything is asked."""
    with pytest.raises(ValueError, match="is no GUID"):
        plc1.create_alarm(event_class, 1, Severity.INFO)
    with pytest.raises(ValueError, match="is no GUID"):
        plc1.get_alarm(event_class, 1)


def _raised(plc1: Commands, *event_ids: int) -> list[Alarm]:
    """Raised alarms that wait for confirmation, in this order."""
    return [plc1.raise_alarm(new_alarm(plc1, number), time_ns=TIME_NS + number) for number in event_ids]


def _who(plc1: Commands, kind: str) -> list[tuple[int, str, str]]:
    """Event id, operator and comment of the stored transitions of a kind, oldest first."""
    return [
        (event.event_id, event.operator, event.comment)
        for stored in plc1.log(LogQuestion(newest_first=False))
        if isinstance(event := stored.event, AlarmEvent) and event.kind == kind
    ]


def test_all_alarms_are_cleared(plc1: Commands) -> None:
    """Those that are raised, each with an event of its own that says who and why; confirmations stay as they are."""
    first, second, third = _raised(plc1, 1, 2, 3)
    plc1.clear_alarm(second)
    cleared = plc1.clear_alarms(operator="anna", comment="power is back")
    assert [(alarm.key, alarm.raised, alarm.confirmation_state) for alarm in cleared] == [
        (first.key, False, ConfirmationState.WAIT_FOR_CONFIRMATION),
        (third.key, False, ConfirmationState.WAIT_FOR_CONFIRMATION),
    ]
    assert cleared == [plc1.get_alarm(CLASS, number, PUMP) for number in (1, 3)]
    assert _who(plc1, "alarm_cleared") == [(2, "", ""), (1, "anna", "power is back"), (3, "anna", "power is back")]
    assert plc1.clear_alarms() == []


def test_all_alarms_are_cleared_with_reset_of_the_confirmation(plc1: Commands) -> None:
    """Raised ones need no confirmation any more; one that was cleared before still waits."""
    first, second = _raised(plc1, 1, 2)
    plc1.clear_alarm(second)
    (cleared,) = plc1.clear_alarms(reset_confirmation=True, time_ns=TIME_NS + 9)
    assert (cleared.key, cleared.confirmation_state, cleared.time_cleared_ns) == (
        first.key,
        ConfirmationState.RESET,
        TIME_NS + 9,
    )
    assert [alarm.key for alarm in plc1.active_alarms()] == [second.key]


def test_all_alarms_are_confirmed(plc1: Commands) -> None:
    """Those that wait for it, raised or not; one without confirmation is left alone."""
    first, second = _raised(plc1, 1, 2)
    plc1.raise_alarm(new_alarm(plc1, 3, with_confirmation=False))
    plc1.clear_alarm(first)
    confirmed = plc1.confirm_alarms(time_ns=TIME_NS + 9, operator="ben")
    assert {(alarm.key, alarm.raised, alarm.confirmation_state) for alarm in confirmed} == {
        (first.key, False, ConfirmationState.CONFIRMED),
        (second.key, True, ConfirmationState.CONFIRMED),
    }
    assert {alarm.time_confirmed_ns for alarm in confirmed} == {TIME_NS + 9}
    assert len(_who(plc1, "alarm_confirmed")) == 2
    assert plc1.confirm_alarms() == []


@pytest.mark.parametrize("spelling", ["event_id >= 2 and is_raised", where.event_id >= 2])
def test_a_filter_chooses_by_the_state(plc1: Commands, spelling: Expr | str) -> None:
    """What does not match as it is now is left alone; a wrong filter does nothing at all."""
    first, second, third = _raised(plc1, 1, 2, 3)
    with pytest.raises(FilterSyntaxError):
        plc1.clear_alarms("event_id >")
    assert [alarm.key for alarm in plc1.confirm_alarms(spelling)] == [second.key, third.key]
    assert [alarm.key for alarm in plc1.clear_alarms(spelling)] == [second.key, third.key]
    assert [alarm.key for alarm in plc1.active_alarms()] == [first.key]


def test_somebody_else_was_faster(plc1: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    """An alarm that is cleared, or gone, between the look and the command is passed over; the others are done."""
    first, second, third = _raised(plc1, 1, 2, 3)
    before = plc1.active_alarms()
    monkeypatch.setattr(plc1, "active_alarms", lambda _filter: before)
    plc1.clear_alarm(first, reset_confirmation=True)
    plc1.dispose_alarm(second)
    assert [alarm.key for alarm in plc1.confirm_alarms()] == [third.key]
    assert [alarm.key for alarm in plc1.clear_alarms()] == [third.key]


def test_a_logger_that_has_stepped_back_refuses_them() -> None:
    """Its refusal is no "somebody was faster": it raises."""
    with alone() as bus, EventLogger("plc1", bus=bus) as logger:
        _raised(logger, 1)
        logger.read_only = "an older logger is there"
        with pytest.raises(AdsError, match="an older logger is there"):
            logger.clear_alarms()
        logger.read_only = ""


CALLS = [name for name, value in vars(Commands).items() if not name.startswith("_") and callable(value)]


@pytest.mark.parametrize("name", CALLS)
def test_every_call_is_spelled_alike_inside_and_through_the_proxy(name: str) -> None:
    """Same names, same parameters with the same defaults, same results."""
    inside, through = (inspect.signature(getattr(kind, name)) for kind in (EventLogger, LoggerProxy))
    assert inside == through


def test_a_walk_through_every_call_gives_the_same_inside_and_through_the_proxy() -> None:
    """The same calls in the same order: the same results, but for who answered, and the same log."""

    def walk(calls: Commands) -> dict[str, object]:
        found: dict[str, object] = {"send_message": calls.send_message(CLASS, 9, Severity.INFO, source=PUMP, time_ns=TIME_NS)}
        created = calls.create_alarm(CLASS, 1, Severity.ERROR, with_confirmation=True, source=PUMP)
        found["create_alarm"] = (created.created, created.result, created.alarm)
        found["raise_alarm"] = alarm = calls.raise_alarm(created.alarm, arguments=(1,), operator="anna")
        found["is_raised"] = calls.is_raised(alarm)
        found["get_alarm"] = calls.get_alarm(CLASS, 1, PUMP)
        found["active_alarms"] = calls.active_alarms("is_raised")
        found["confirm_alarm"] = calls.confirm_alarm(alarm, comment="seen")
        found["clear_alarm"] = calls.clear_alarm(alarm.key)
        calls.raise_alarm(alarm)
        found["confirm_alarms"] = calls.confirm_alarms(operator="ben")
        found["clear_alarms"] = calls.clear_alarms("event_id = 1", reset_confirmation=True)
        calls.raise_alarm(alarm)
        found["do"] = calls.do(Clear(key=alarm.key)).alarm
        found["dispose_alarm"] = calls.dispose_alarm(alarm).result
        found["log"] = sorted((stored.event.kind, stored.event.time_ns) for stored in calls.log(LogQuestion(filter="is_alarm")))
        return found

    def bare(value: object) -> object:
        match value:
            case Alarm() | MessageSent():
                return (
                    msgspec.structs.replace(value, session="", seq=0, key_seq=0)
                    if isinstance(value, MessageSent)
                    else (msgspec.structs.replace(value, session="", seq=0))
                )
            case list() | tuple():
                return [bare(each) for each in value]
            case _:
                return value

    with alone() as bus, EventLogger("plc1", bus=bus, clock=lambda: TIME_NS) as logger:
        inside = walk(logger)
    with alone() as bus, EventLogger("plc1", bus=bus, clock=lambda: TIME_NS), LoggerProxy(bus, "plc1") as proxy:
        through = walk(proxy)
    assert {name: bare(value) for name, value in inside.items()} == {name: bare(value) for name, value in through.items()}
    assert set(inside) == set(CALLS) - {"clear_log"}  # its story is told with the log
