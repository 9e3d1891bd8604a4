"""The six filters found in public PLC code and in the manual (facts 1.4), in both spellings."""

import pytest

from bridge.core.events import Severity
from bridge.core.filters.ast import And, Compare, Expr, Flag, Like
from bridge.core.filters.spelling import where
from bridge.core.filters.text import parse, to_text
from bridge.core.times import parse_time

TEST_CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
NOON = parse_time("2026-11-22T12:00:00Z")

REAL: list[tuple[str, str, Expr, Expr]] = [
    (
        "Clear().IsMessage().AND_OP().EventClass.EqualTo(TC_EVENTS.TestFilterClass.Event1.uuidEventClass)",
        "is_message and event_class = TestFilterClass",
        where.is_message & (where.event_class == TEST_CLASS),
        And((Flag("is_message"), Compare("event_class", "=", TEST_CLASS))),
    ),
    (
        "Clear().EtherCATDevice.IsEtherCATDevice()",
        "is_ethercat_device",
        where.is_ethercat_device,
        Flag("is_ethercat_device"),
    ),
    (
        "Clear().EventClass.EqualTo(event_class)",
        f"event_class = {TEST_CLASS}",
        where.event_class == TEST_CLASS,
        Compare("event_class", "=", TEST_CLASS),
    ),
    (
        "Clear().IsAlarm().AND_OP().TimeRaised.GreaterThan(DT_TO_FILETIME64(dtFilterTimeGT))",
        "is_alarm and time_raised > 2026-11-22T12:00:00Z",
        where.is_alarm & (where.time_raised_ns > NOON),
        And((Flag("is_alarm"), Compare("time_raised_ns", ">", NOON))),
    ),
    (
        "Clear().JsonAttribute.Value.EqualTo(sJson)",
        """json_attribute = '{"axis": 3}'""",
        where.json_attribute == '{"axis": 3}',
        Compare("json_attribute", "=", '{"axis": 3}'),
    ),
    (
        "Severity.GreaterThan(TcEventSeverity.Error).AND_OP().Source.Name.Like('%Main%')",
        "severity > error and source.name like '%Main%'",
        (where.severity > Severity.ERROR) & where.source_name.like("%Main%"),
        And((Compare("severity", ">", 3), Like("source_name", "%Main%"))),
    ),
]


@pytest.mark.parametrize(("twincat", "text", "python", "tree"), REAL, ids=[row[0] for row in REAL])
def test_text_and_python_give_the_same_tree(twincat: str, text: str, python: Expr, tree: Expr) -> None:
    """What a PLC programmer writes as the first column is the second in text and the third in Python."""
    assert twincat
    assert parse(text, resolve_class={"TestFilterClass": [TEST_CLASS]}.__getitem__) == tree
    assert python == tree
    assert parse(to_text(tree)) == tree
