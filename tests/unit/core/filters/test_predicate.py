"""The compiled predicate: what matches, what is missing, and that nothing from outside gets into the code."""

from timeit import repeat

import pytest

from bridge.core.alarms import Alarm
from bridge.core.events import AnyEvent, ConfirmationState, Severity
from bridge.core.filters.ast import Everything, Expr, UnknownClassError
from bridge.core.filters.pointer import read_json
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.spelling import where
from bridge.core.filters.text import parse
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

BARE = message_sent(time_ns=0)
FULL = alarm_raised(
    event_id=7,
    severity=Severity.ERROR,
    source_id=0,
    source_name="PLC.MAIN.fbAxis",
    source_guid=OTHER_CLASS,
    json_attribute='{"axis": 3}',
    time_ns=10,
    confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION,
    vendor_id=2,
    product_code=0,
    revision_no=1,
)
OPTIONAL = [
    (where.source_id, 0),
    (where.time_ns, 10),
    (where.time_raised_ns, 10),
    (where.vendor_id, 2),
    (where.product_code, 0),
    (where.revision_no, 1),
]


@pytest.mark.parametrize(("field", "value"), OPTIONAL)
def test_comparisons_of_numbers(field: object, value: int) -> None:
    """Each comparison holds or not for a value, and none holds for a missing one; NOT turns that round."""
    assert isinstance(field, type(where.time_ns))
    rows: list[tuple[Expr, bool]] = [
        (field == value, True),
        (field != value, False),
        (field != value + 1, True),
        (field < value + 1, True),
        (field < value, False),
        (field <= value, True),
        (field > value - 1, True),
        (field > value, False),
        (field >= value, True),
        (field.between(value, value), True),
        (field.between(value + 1, value), False),
        (field.in_(value, 99), True),
        (field.in_(99), False),
        (field < 2**64, True),
        (field > -(2**64), True),
        (field != 2**64, True),
        (field.is_not_empty(), True),
    ]
    for expr, answer in rows:
        assert compile_filter(expr)(FULL) is answer
        assert compile_filter(~expr)(FULL) is not answer
        assert compile_filter(expr)(BARE) is False
        assert compile_filter(~expr)(BARE) is True
    assert compile_filter(field.is_empty())(BARE) is True
    assert compile_filter(field.is_empty())(FULL) is False


def test_time_zero_and_empty_json_are_missing_and_equal_nothing() -> None:
    """Not set is not a time, and no JSON attribute is no text."""
    assert not compile_filter(where.time_ns == 0)(BARE)
    assert not compile_filter(where.time_ns.in_(0))(BARE)
    assert not compile_filter(where.time_ns <= 0)(BARE)
    assert not compile_filter(where.json_attribute == "")(BARE)
    assert not compile_filter(where.json_attribute.in_(""))(BARE)
    assert not compile_filter(where.json_attribute.like("%"))(BARE)
    assert compile_filter(where.json_attribute.is_empty())(BARE)
    assert compile_filter(where.json_attribute == '{"axis": 3}')(FULL)
    assert not compile_filter(where.json_attribute != '{"axis": 3}')(FULL)


def test_an_empty_source_name_is_there_and_empty() -> None:
    """`= ''` is for a name that is "", `is empty` for both."""
    empty, missing = message_sent(source_name=""), message_sent()
    assert compile_filter(where.source_name == "")(empty)
    assert not compile_filter(where.source_name == "")(missing)
    assert compile_filter(where.source_name.is_empty())(empty)
    assert compile_filter(where.source_name.is_empty())(missing)
    assert compile_filter(where.source_name.like(""))(empty)
    assert not compile_filter(where.source_name.like("%"))(missing)
    assert compile_filter(where.source_name != "x")(empty)
    assert not compile_filter(where.source_name != "x")(missing)


def test_texts_are_equal_exactly_and_alike_without_ascii_case() -> None:
    """Kelvin sign, long s and dotted I are letters of their own."""
    event = message_sent(source_name="Kelvin")
    assert compile_filter(where.source_name == "Kelvin")(event)
    assert not compile_filter(where.source_name == "kelvin")(event)
    for pattern in ("kelvin", "KEL%", "%VIN", "%elv%", "k_l%n", "%"):
        assert compile_filter(where.source_name.like(pattern))(event), pattern
        assert not compile_filter(where.source_name.like("x" + pattern))(event), pattern
    odd = message_sent(source_name="\u212aelvin\u017f\u0130\n\0")
    for pattern, answer in [
        ("k%", False),
        ("%S%", False),
        ("%i\u0307%", False),
        ("\u212aELV%", True),
        ("%\n\0", True),
        ("_elvin%", True),
    ]:
        assert compile_filter(where.source_name.like(pattern))(odd) is answer, pattern


FLAGS: list[tuple[AnyEvent, set[str]]] = [
    (message_sent(), {"is_message"}),
    (message_sent(raised=True, vendor_id=0), {"is_message", "is_ethercat_device"}),
    (alarm_raised(), {"is_alarm", "is_raised", "is_active"}),
    (
        alarm_raised(confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION),
        {"is_alarm", "is_raised", "is_active", "is_wait_for_confirmation"},
    ),
    (
        alarm_cleared(confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION),
        {"is_alarm", "is_active", "is_wait_for_confirmation"},
    ),
    (alarm_cleared(), {"is_alarm"}),
    (alarm_confirmed(), {"is_alarm", "is_raised", "is_active"}),
    (alarm_disposed(), {"is_alarm"}),
]


@pytest.mark.parametrize(("event", "flags"), FLAGS, ids=lambda value: value.kind if hasattr(value, "kind") else "")
def test_flags(event: AnyEvent, flags: set[str]) -> None:
    """Those of the alarm state are false for messages, whatever a foreign sender writes into one."""
    names = ["is_message", "is_alarm", "is_raised", "is_active", "is_wait_for_confirmation", "is_ethercat_device"]
    assert {name for name in names if compile_filter(parse(name))(event)} == flags


def test_a_filter_serves_alarms_too() -> None:
    """The state of an alarm has the attributes of an event."""
    alarm = Alarm(target="plc1", event_class=EVENT_CLASS, event_id=7, severity=Severity.ERROR, raised=True, time_raised_ns=5)
    assert compile_filter(parse("is_active and severity >= error and time_raised > 4 and event_id = 7"))(alarm)
    assert not compile_filter(parse("is_message or kind = alarm_raised"))(alarm)


def test_the_empty_filter_matches_all() -> None:
    """And its opposite nothing."""
    assert compile_filter(Everything())(BARE) is True
    assert compile_filter(~Everything())(BARE) is False


def test_not_binds_before_and_before_or() -> None:
    """The truth table of a mixed filter."""
    matches = compile_filter(parse("event_id = 1 or severity = error and not is_alarm"))
    for event_id, severity, alarm in [
        (i, s, a) for i in (1, 2) for s in (Severity.INFO, Severity.ERROR) for a in (False, True)
    ]:
        event = (alarm_raised if alarm else message_sent)(event_id=event_id, severity=severity)
        assert matches(event) is (event_id == 1 or (severity == Severity.ERROR and not alarm))


def test_the_json_attribute_is_read_once_per_event_and_only_when_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three conditions on JSON read it once; an event that fails before them is not read at all."""
    reads = []

    def counting(text: str) -> object:
        reads.append(text)
        return read_json(text)

    monkeypatch.setattr("bridge.core.filters.predicate.read_json", counting)
    matches = compile_filter(parse("json('/a') = 1 and json('/b') = 2 and not json('/c') = 3 and severity >= error"))
    assert matches(message_sent(severity=Severity.ERROR, json_attribute='{"a": 1, "b": 2}'))
    assert len(reads) == 1
    assert not matches(message_sent(json_attribute='{"a": 1, "b": 2}'))
    assert len(reads) == 1
    assert not matches(message_sent(severity=Severity.ERROR, json_attribute='{"a": 1}'))
    assert len(reads) == 2


def test_values_never_become_code() -> None:
    """Quotes, brackets and names of Python are just characters."""
    for text in ("' or True or '", '"""', "__import__('os')", "{event}", "\\", "\0", "#"):
        event = message_sent(source_name=text)
        assert compile_filter(where.source_name == text)(event)
        assert compile_filter(where.source_name.like("%" + text.replace("_", "%")))(event)
        assert not compile_filter(where.source_name == text + "x")(event)


def test_the_unique_id_is_refused() -> None:
    """A live event has none."""
    with pytest.raises(ValueError, match="unique_id is given when an event is stored"):
        compile_filter(where.is_alarm | (where.unique_id == 3))


def test_class_names_are_looked_up() -> None:
    """With a catalog, else they are an error."""
    expr = where.event_class == "Motion"
    assert compile_filter(expr, resolve_class=lambda _: [OTHER_CLASS, EVENT_CLASS])(BARE)
    assert not compile_filter(expr, resolve_class=lambda _: [OTHER_CLASS])(BARE)
    with pytest.raises(UnknownClassError):
        compile_filter(expr)


def test_the_largest_filters_compile() -> None:
    """255 conditions and 64 levels; LIKE and JSON in each."""
    parts = [where.source_name.like(f"_{n}%") | (where.json(f"/{n}") == n) for n in range(127)]
    wide: Expr = parts[0]
    for part in parts[1:]:
        wide = wide & part
    assert not compile_filter(wide)(FULL)
    deep: Expr = where.is_alarm
    for _ in range(31):
        deep = ~(deep & where.is_alarm)
    assert isinstance(compile_filter(deep)(FULL), bool)


def test_a_simple_filter_takes_well_under_a_microsecond() -> None:
    """The target is 0.15 us; the bound leaves room for a busy machine."""
    for text in ("severity >= error", "severity >= error and source.name like '%main%'", f"event_class = {OTHER_CLASS}"):
        matches = compile_filter(parse(text))
        assert min(repeat(lambda m=matches: m(FULL), number=10_000, repeat=5)) / 10_000 < 1e-6  # type: ignore[misc]
