"""The Python spelling: what it builds and where a wrong value is refused."""

import pytest

from bridge.core.events import ConfirmationState, Severity
from bridge.core.filters.ast import And, Between, Compare, In, IsEmpty, JsonPointer, Like, Not, Or
from bridge.core.filters.spelling import where
from bridge.core.hresult import ADS_E_INVALIDDATA, AdsError


def test_operators_build_the_tree() -> None:
    """Each operator is one node."""
    assert (where.event_id == 1) == Compare("event_id", "=", 1)
    assert (where.event_id != 1) == Compare("event_id", "!=", 1)
    assert (where.time_ns < 1) == Compare("time_ns", "<", 1)
    assert (where.time_ns <= 1) == Compare("time_ns", "<=", 1)
    assert (where.severity > Severity.INFO) == Compare("severity", ">", 1)
    assert (where.severity >= Severity.INFO) == Compare("severity", ">=", 1)
    assert where.source_name.like("a%") == Like("source_name", "a%")
    assert where.kind.in_("alarm_raised", "alarm_cleared") == In("kind", ("alarm_raised", "alarm_cleared"))
    assert where.event_id.between(1, 5) == Between("event_id", 1, 5)
    assert where.source_guid.is_empty() == IsEmpty("source_guid")
    assert where.source_guid.is_not_empty() == Not(IsEmpty("source_guid"))
    assert where.json("/a").like("x%") == Like(JsonPointer("/a"), "x%")
    assert (where.confirmation_state == ConfirmationState.RESET) == Compare("confirmation_state", "=", 4)


def test_filters_combine_with_symbols() -> None:
    """& binds before |, as in Python; a comparison needs its parentheses."""
    a, b, c = where.is_alarm, where.is_raised, where.event_id == 1
    assert (a | b & ~c) == Or((a, And((b, Not(c)))))


def test_the_natural_mistakes_raise() -> None:
    """`and`, a chained comparison, `in` and a set of fields would all lose something silently."""
    with pytest.raises(TypeError, match="&"):
        bool(where.severity >= Severity.ERROR and where.is_alarm)
    with pytest.raises(TypeError, match="&"):
        bool(1 < where.event_id < 5)
    with pytest.raises(TypeError):
        hash(where.event_id)


def test_values_of_json_may_be_words() -> None:
    """True, False and None are JSON's words, which have text forms."""
    pointer = JsonPointer("/a")
    assert (where.json("/a") == True) == Compare(pointer, "=", "true")  # noqa: E712  it builds a filter
    assert (where.json("/a") != None) == Compare(pointer, "!=", "null")  # noqa: E711  it builds a filter
    assert where.json("/a").in_(False, 1, "x") == In(pointer, ("false", 1, "x"))


def test_wrong_values_raise_at_the_call() -> None:
    """Not at the first event."""
    with pytest.raises(TypeError):
        where.severity == "error"  # noqa: B015  it raises
    with pytest.raises(ValueError, match="kind"):
        where.kind == "alarm"  # noqa: B015  it raises
    with pytest.raises(TypeError):
        where.time_ns > "2026-11-22"  # type: ignore[operator]  # noqa: B015  it raises
    with pytest.raises(ValueError, match="at least one"):
        where.event_id.in_()
    with pytest.raises(ValueError, match="never empty"):
        where.target.is_empty()
    with pytest.raises(AdsError) as caught:
        where.json("axis")
    assert caught.value.code == ADS_E_INVALIDDATA
