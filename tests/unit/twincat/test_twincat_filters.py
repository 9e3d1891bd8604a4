"""The TwinCAT spelling of filters: the same trees as the other two, refused chains, and a warning."""

import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.core.events import ConfirmationState, Severity
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.fields import FIELDS, FLAGS
from bridge.core.filters.spelling import where
from bridge.core.filters.text import parse
from bridge.core.hresult import ADS_E_INVALIDDATA, ADS_E_INVALIDPARM, ADS_E_NOMOREHDL, AdsError
from bridge.core.times import parse_time, to_filetime
from bridge.twincat.filters import BinaryExpression, FB_TcEventFilter, LogicalExpression, MixedOperatorsWarning

ROOT = Path(__file__).parents[3]
CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
NOON = parse_time("2026-11-22T12:00:00Z")
TICKS = to_filetime(NOON)

Chain = Callable[[BinaryExpression], LogicalExpression]

REAL: list[tuple[Chain, Expr, str]] = [
    (
        lambda f: f.IsMessage().AND_OP().EventClass.EqualTo(CLASS),
        where.is_message & (where.event_class == CLASS),
        f"is_message and event_class = {CLASS}",
    ),
    (lambda f: f.EtherCATDevice.IsEtherCATDevice(), where.is_ethercat_device, "is_ethercat_device"),
    (lambda f: f.EventClass.EqualTo(CLASS), where.event_class == CLASS, f"event_class = {CLASS}"),
    (
        lambda f: f.IsAlarm().AND_OP().TimeRaised.GreaterThan(TICKS),
        where.is_alarm & (where.time_raised_ns > NOON),
        "is_alarm and time_raised > 2026-11-22T12:00:00Z",
    ),
    (
        lambda f: f.JsonAttribute.Value.EqualTo('{"axis": 3}'),
        where.json_attribute == '{"axis": 3}',
        """json_attribute = '{"axis": 3}'""",
    ),
    (
        lambda f: f.Severity.GreaterThan(Severity.ERROR).AND_OP().Source.Name.Like("%Main%"),
        (where.severity > Severity.ERROR) & where.source_name.like("%Main%"),
        "severity > error and source.name like '%Main%'",
    ),
]
"""The six chains of public PLC code."""

CONDITIONS: list[tuple[Chain, str]] = [
    (lambda f: f.IsAlarm(), "is_alarm"),
    (lambda f: f.IsMessage(), "is_message"),
    (lambda f: f.AlarmState.IsActive(), "is_active"),
    (lambda f: f.AlarmState.IsRaised(), "is_raised"),
    (lambda f: f.AlarmState.IsWaitForConfirmation(), "is_wait_for_confirmation"),
    (
        lambda f: f.AlarmState.ConfirmationState.EqualTo(ConfirmationState.CONFIRMED),
        "confirmation_state = confirmed",
    ),
    (lambda f: f.AlarmState.ConfirmationState.NotEqualTo(ConfirmationState.RESET), "confirmation_state != reset"),
    (lambda f: f.EtherCATDevice.IsEtherCATDevice(), "is_ethercat_device"),
    (lambda f: f.EtherCATDevice.VendorId.EqualTo(2), "vendor_id = 2"),
    (lambda f: f.EtherCATDevice.ProductCode.LessThan(5), "product_code < 5"),
    (lambda f: f.EtherCATDevice.RevisionNo.GreaterThanOrEqualTo(3), "revision_no >= 3"),
    (lambda f: f.EventClass.NotEqualTo(CLASS), f"event_class != {CLASS}"),
    (lambda f: f.EventId.EqualTo(1), "event_id = 1"),
    (lambda f: f.EventId.NotEqualTo(1), "event_id != 1"),
    (lambda f: f.EventId.LessThan(1), "event_id < 1"),
    (lambda f: f.EventId.LessThanOrEqualTo(1), "event_id <= 1"),
    (lambda f: f.EventId.GreaterThan(1), "event_id > 1"),
    (lambda f: f.EventId.GreaterThanOrEqualTo(1), "event_id >= 1"),
    (lambda f: f.JsonAttribute.Value.Like("%x%"), "json_attribute like '%x%'"),
    (lambda f: f.JsonAttribute.JsonPointer("/axis/0").EqualTo("3"), "json('/axis/0') = '3'"),
    (lambda f: f.JsonAttribute.JsonPointer("/axis").IsEmpty(), "json('/axis') is empty"),
    (lambda f: f.Severity.EqualTo(Severity.INFO), "severity = info"),
    (lambda f: f.Severity.NotEqualTo(Severity.INFO), "severity != info"),
    (lambda f: f.Severity.LessThan(Severity.INFO), "severity < info"),
    (lambda f: f.Severity.LessThanOrEqualTo(Severity.INFO), "severity <= info"),
    (lambda f: f.Severity.GreaterThan(Severity.INFO), "severity > info"),
    (lambda f: f.Severity.GreaterThanOrEqualTo(Severity.INFO), "severity >= info"),
    (lambda f: f.Source.Id.EqualTo(7), "source.id = 7"),
    (lambda f: f.Source.Guid.EqualTo(CLASS), f"source.guid = {CLASS}"),
    (lambda f: f.Source.Name.EqualTo("Pump"), "source.name = 'Pump'"),
    (lambda f: f.Source.Name.NotEqualTo("Pump"), "source.name != 'Pump'"),
    (lambda f: f.Source.Name.IsEmpty(), "source.name is empty"),
    (lambda f: f.Source.Name.IsNotEmpty(), "source.name is not empty"),
    (lambda f: f.TimeRaised.EqualTo(TICKS), "time_raised = 2026-11-22T12:00:00Z"),
    (lambda f: f.TimeCleared.NotEqualTo(TICKS), "time_cleared != 2026-11-22T12:00:00Z"),
    (lambda f: f.TimeConfirmed.LessThanOrEqualTo(TICKS), "time_confirmed <= 2026-11-22T12:00:00Z"),
    (lambda f: f.UniqueId.EqualTo(9), "unique_id = 9"),
]


def chain(build: Chain) -> Expr:
    """What a fresh filter holds after the chain."""
    made = FB_TcEventFilter()
    end = build(made.Clear())
    assert end.expression == made.expression
    return made.expression


@pytest.mark.parametrize(("twincat", "python", "text"), REAL, ids=[row[2] for row in REAL])
def test_the_real_expressions_give_one_tree_in_three_spellings(twincat: Chain, python: Expr, text: str) -> None:
    """What public PLC code asks for can be asked for here in each spelling."""
    assert chain(twincat) == python == parse(text)


@pytest.mark.parametrize(("twincat", "text"), CONDITIONS, ids=[row[1] for row in CONDITIONS])
def test_every_condition_has_its_text(twincat: Chain, text: str) -> None:
    """A condition of the chain is the condition of the text."""
    assert chain(twincat) == parse(text)


def test_every_field_that_twincat_has_is_in_the_table_above() -> None:
    """Only the target, the kind and the event's own time have no TwinCAT spelling: a PLC knows one logger and two types."""
    named = {word for _, text in CONDITIONS for word in text.replace("json('", "json ").split()}
    spelled = {name for name in (*FIELDS, *FLAGS) if name in named or name.removesuffix("_ns") in named}
    spelled |= {name for name in FIELDS if name.replace("source_", "source.", 1) in named}
    assert {*FIELDS, *FLAGS} - spelled == {"target", "kind", "time_ns"}


def test_an_empty_filter_takes_everything() -> None:
    """As Clear() alone does in public PLC code."""
    made = FB_TcEventFilter()
    assert made.expression == Everything()
    made.IsAlarm()
    made.Clear()
    assert made.expression == Everything()


def test_not_binds_before_and_and_and_before_or() -> None:
    """SQL's precedence, said where the manual is silent; the chain warns where it is mixed, at the caller's line."""
    made = FB_TcEventFilter()
    with pytest.warns(MixedOperatorsWarning, match="AND binds before OR") as caught:
        made.IsAlarm().OR_OP().NOT_OP().IsMessage().AND_OP().EventId.EqualTo(1)
    assert made.expression == parse("is_alarm or (not is_message and event_id = 1)")
    assert [Path(warning.filename) for warning in caught] == [Path(__file__)]


def test_a_group_says_what_is_meant_and_does_not_warn() -> None:
    """FilterExpression takes a filter, or the end of a chain, as one condition."""
    inner = FB_TcEventFilter()
    inner.IsAlarm().OR_OP().EventId.EqualTo(1)
    made = FB_TcEventFilter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made.FilterExpression(inner).AND_OP().NOT_OP().FilterExpression(FB_TcEventFilter().IsMessage())
    assert made.expression == parse("(is_alarm or event_id = 1) and not is_message")


def test_a_chain_is_warned_about_once() -> None:
    """The second operator kind warns, what follows does not; Clear starts anew."""
    made = FB_TcEventFilter()
    with pytest.warns(MixedOperatorsWarning) as caught:
        made.IsAlarm().OR_OP().IsMessage().AND_OP().IsAlarm().OR_OP().IsAlarm().AND_OP().IsAlarm()
    assert len(caught) == 1
    made.Clear().IsAlarm().OR_OP().IsMessage()


def test_two_hundred_and_fifty_five_conditions() -> None:
    """One more is ADS_E_NOMOREHDL, when the filter is applied."""
    made = FB_TcEventFilter()
    end = made.EventId.EqualTo(0)
    for number in range(1, 255):
        end = end.OR_OP().EventId.EqualTo(number)
    assert made.expression == end.expression
    end.OR_OP().EventId.EqualTo(255)
    with pytest.raises(AdsError) as caught:
        _ = made.expression
    assert caught.value.code == ADS_E_NOMOREHDL


def dangling(made: FB_TcEventFilter) -> None:
    """An operator at the end."""
    made.IsAlarm().AND_OP()


def negation(made: FB_TcEventFilter) -> None:
    """A NOT of nothing."""
    made.NOT_OP()


def doubled(made: FB_TcEventFilter) -> None:
    """Two conditions without an operator, through the filter itself."""
    made.IsAlarm()
    made.IsMessage()


def headless(made: FB_TcEventFilter) -> None:
    """An operator first: the end of a chain that was cleared meanwhile."""
    end = made.IsAlarm()
    made.Clear()
    end.AND_OP().IsMessage()


@pytest.mark.parametrize("build", [dangling, negation, doubled, headless])
def test_an_invalid_chain_is_refused_when_it_is_applied(build: Callable[[FB_TcEventFilter], None]) -> None:
    """ADS_E_INVALIDPARM, the manual's validation error."""
    made = FB_TcEventFilter()
    build(made)
    with pytest.raises(AdsError) as caught:
        _ = made.expression
    assert caught.value.code == ADS_E_INVALIDPARM


def test_a_bad_pointer_is_refused() -> None:
    """ADS_E_INVALIDDATA, as in the manual."""
    with pytest.raises(AdsError) as caught:
        FB_TcEventFilter().JsonAttribute.JsonPointer("axis")
    assert caught.value.code == ADS_E_INVALIDDATA


def test_the_type_checker_refuses_wrong_chains_and_takes_right_ones() -> None:
    """Each ignore of the example is needed, and no other line needs one: strict mypy reports both."""
    example = ROOT / "tests" / "typing" / "twincat_chains.py"
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", str(example)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110)
    assert result.returncode == 0, result.stdout + result.stderr
    assert example.read_text().count("# type: ignore") == 12
