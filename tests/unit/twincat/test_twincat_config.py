"""The older form of a selection: messages and alarms apart, by class or source, each from a severity upwards."""

import pytest

from bridge.core.events import Severity, Source
from bridge.core.filters.ast import Everything, Expr
from bridge.core.filters.cover import cover
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse
from bridge.core.hresult import ADS_E_INVALIDPARM, ADS_E_NOTFOUND, AdsError
from bridge.testing.builders import alarm_raised, message_sent
from bridge.twincat.config import TcEventFilterConfig, selection

A, B = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "5819b654-acc7-4328-a54f-a5886769f484"
PUMP = Source(name="Pump")


def config(*classes: tuple[str, Severity]) -> TcEventFilterConfig:
    """A list of classes."""
    made = TcEventFilterConfig()
    for name, severity in classes:
        made.AddEventClass(name, severity)
    return made


def test_messages_and_alarms_are_selected_apart() -> None:
    """Warnings of class A as messages, errors of class B as alarms; nothing else."""
    expr = selection(config((A, Severity.WARNING)), config((B, Severity.ERROR)))
    assert expr == parse(
        f"is_message and event_class = {A} and severity >= warning or is_alarm and event_class = {B} and severity >= error"
    )
    takes = compile_filter(expr)
    assert takes(message_sent(event_class=A, severity=Severity.WARNING))
    assert not takes(message_sent(event_class=A, severity=Severity.INFO))
    assert not takes(message_sent(event_class=B, severity=Severity.CRITICAL))
    assert takes(alarm_raised(event_class=B, severity=Severity.ERROR))
    assert not takes(alarm_raised(event_class=A, severity=Severity.ERROR))


def test_a_class_or_a_source_is_enough() -> None:
    """The lines of a list are alternatives, each with its own severity; a source counts by the parts it gives."""
    listed = config((A, Severity.ERROR))
    listed.AddSourceInfo(PUMP, Severity.WARNING)
    takes = compile_filter(listed.expression)
    assert takes(message_sent(event_class=A, severity=Severity.ERROR, source_name="Valve"))
    assert takes(message_sent(event_class=B, severity=Severity.WARNING, source_name="Pump", source_id=7))
    assert not takes(message_sent(event_class=A, severity=Severity.WARNING, source_name="Valve"))


@pytest.mark.parametrize(
    ("messages", "alarms", "expr"),
    [
        (None, None, Everything()),
        (None, TcEventFilterConfig(), parse("is_message")),
        (TcEventFilterConfig(), None, parse("is_alarm")),
        (config((A, Severity.VERBOSE)), TcEventFilterConfig(), parse(f"is_message and event_class = {A}")),
    ],
)
def test_no_list_takes_all_and_an_empty_one_nothing(
    messages: TcEventFilterConfig | None, alarms: TcEventFilterConfig | None, expr: Expr
) -> None:
    """The 0 pointer asks for no selection; a list without a line selects nothing."""
    assert selection(messages, alarms) == expr


def test_two_empty_lists_subscribe_to_nothing() -> None:
    """No key is selected."""
    assert cover(selection(TcEventFilterConfig(), TcEventFilterConfig())).selections == ()


def test_lines_are_replaced_and_removed() -> None:
    """The last severity counts; what is removed is gone, and removing it again is an error."""
    listed = config((A, Severity.ERROR), ("{" + A.upper() + "}", Severity.INFO))
    assert listed.expression == parse(f"event_class = {A} and severity >= info")
    listed.AddSourceInfo(PUMP)
    listed.RemoveEventClass(A)
    assert listed.expression == parse("source.name = 'Pump'")
    listed.RemoveSourceInfo(PUMP)
    with pytest.raises(AdsError) as caught:
        listed.RemoveEventClass(A)
    assert caught.value.code == ADS_E_NOTFOUND
    with pytest.raises(AdsError) as caught:
        listed.RemoveSourceInfo(PUMP)
    assert caught.value.code == ADS_E_NOTFOUND


def test_a_source_without_a_part_is_refused() -> None:
    """It would list everything."""
    with pytest.raises(AdsError) as caught:
        TcEventFilterConfig().AddSourceInfo(Source())
    assert caught.value.code == ADS_E_INVALIDPARM
