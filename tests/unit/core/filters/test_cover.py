"""The keys a listener subscribes to: few, disjoint, never too small, and exact where the cover says so."""

import time
from itertools import combinations, product

import pytest

from bridge.core.events import Severity
from bridge.core.filters.ast import Everything, Expr, Not, Or, UnknownClassError
from bridge.core.filters.cover import MAX_SELECTIONS, Cover, cover, places, residual
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.spelling import where
from bridge.core.keys import EventKey, Selection, includes
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, alarm_raised, message_sent

G, H = EVENT_CLASS, OTHER_CLASS
K = "97cf8247-b59c-4e2c-b4b0-7350d0471457"
ERROR, CRITICAL = Severity.ERROR, Severity.CRITICAL
OPEN = where.source_name.like("%Main%")


def one(**chunks: str | bool | Severity) -> Selection:
    """A selection with the chunks that matter."""
    return Selection(**chunks)  # type: ignore[arg-type]


ROWS: list[tuple[Expr, tuple[Selection, ...], bool]] = [
    (Everything(), (one(),), True),
    (~Everything(), (), True),
    (OPEN, (one(),), False),
    (~OPEN, (one(),), False),
    (where.severity >= ERROR, (one(severity=ERROR), one(severity=CRITICAL)), True),
    (where.severity.between(CRITICAL, ERROR), (), True),
    (where.severity != ERROR, tuple(one(severity=severity) for severity in Severity if severity != ERROR), True),
    (where.is_alarm, (one(is_alarm=True),), True),
    (~where.is_alarm, (one(is_alarm=False),), True),
    (where.is_message & where.is_alarm, (), True),
    (where.kind == "message_sent", (one(is_alarm=False),), True),
    (where.kind != "message_sent", (one(is_alarm=True),), True),
    (where.kind == "alarm_raised", (one(is_alarm=True),), False),
    (where.kind != "alarm_raised", (one(),), False),
    (where.kind.in_("alarm_raised", "message_sent"), (one(),), False),
    (
        where.kind.in_("alarm_raised", "alarm_cleared", "alarm_confirmed", "alarm_disposed"),
        (one(is_alarm=True),),
        True,
    ),
    (where.is_raised, (one(is_alarm=True),), False),
    (~where.is_raised, (one(),), False),
    (where.is_active & where.is_message, (), True),
    (where.target == "plc1", (one(target="plc1"),), True),
    (where.target != "plc1", (one(),), False),
    (where.target == "", (), True),
    (where.target.like("plc1"), (one(),), False),
    (where.event_class == G, (one(event_class=G),), True),
    (where.event_class.in_(G, H), (one(event_class=G), one(event_class=H)), True),
    ((where.event_class != G) & (where.event_class == H), (one(event_class=H),), True),
    ((where.event_class == G) & (where.event_class == H), (), True),
    (where.is_message & (where.event_class == G) & OPEN, (one(event_class=G, is_alarm=False),), False),
    (~(OPEN | where.is_alarm), (one(is_alarm=False),), False),
    (~(OPEN & where.is_alarm), (one(),), False),
    (
        where.is_alarm | (where.severity >= ERROR),
        (one(is_alarm=False, severity=ERROR), one(is_alarm=False, severity=CRITICAL), one(is_alarm=True)),
        True,
    ),
    (
        (where.target == "plc1") | (where.severity == CRITICAL),
        (one(severity=CRITICAL), *(one(target="plc1", severity=severity) for severity in Severity if severity != CRITICAL)),
        True,
    ),
    # two overlapping wildcards would deliver an event twice, so they become one
    ((where.target == "plc1") | (where.event_class == G), (one(),), False),
    # ten selections would be too many: the classes give way
    (
        where.event_class.in_(G, H, K) & where.severity.in_(Severity.INFO, ERROR, CRITICAL),
        (one(severity=Severity.INFO), one(severity=ERROR), one(severity=CRITICAL)),
        False,
    ),
    (Or(tuple(where.target == f"plc{number}" for number in range(9))), (one(),), False),
    (
        Or(tuple(where.target == f"plc{number}" for number in range(8))),
        tuple(one(target=f"plc{number}") for number in range(8)),
        True,
    ),
]


@pytest.mark.parametrize(("expr", "selections", "exact"), ROWS, ids=lambda value: repr(value)[:60])
def test_the_cover_of_a_filter(expr: Expr, selections: tuple[Selection, ...], exact: bool) -> None:
    """Each row: a filter, its selections, and whether they are exact."""
    assert cover(expr) == Cover(selections, exact)


@pytest.mark.parametrize("expr", [row[0] for row in ROWS], ids=lambda value: repr(value)[:60])
def test_selections_are_few_disjoint_and_true_to_the_filter(expr: Expr) -> None:
    """Each key with each open condition true and false: nothing lost, and nothing too much where the cover is exact."""
    found = cover(expr)
    matches = compile_filter(expr)
    assert len(found.selections) <= MAX_SELECTIONS
    targets, classes = ("plc1", "plc2", "other"), (G, H, "3f2504e0-4f89-11d3-9a0c-0305e82c3301")
    for target, event_class, severity, alarm, name in product(targets, classes, Severity, (False, True), (None, "Main")):
        build = alarm_raised if alarm else message_sent
        event = build(target=target, event_class=event_class, severity=severity, source_name=name)
        key = EventKey("live", target, event_class, alarm, severity)
        taken = [selection for selection in found.selections if includes(selection, key)]
        assert len(taken) <= 1
        if matches(event):
            assert taken
        elif found.exact:
            assert not taken


def test_selections_do_not_overlap_as_wildcards() -> None:
    """Zenoh would deliver an event once per matching subscription."""
    for expr, _, _ in ROWS:
        for a, b in combinations(cover(expr).selections, 2):
            pairs = [
                (a.target, b.target),
                (a.event_class, b.event_class),
                (a.is_alarm, b.is_alarm),
                (a.severity, b.severity),
            ]
            assert any(x is not None and y is not None and x != y for x, y in pairs)


@pytest.mark.parametrize(
    ("expr", "rest"),
    [
        (where.severity >= ERROR, Everything()),
        ((where.severity >= ERROR) & OPEN, OPEN),
        ((where.severity >= ERROR) & OPEN & (where.event_id == 3), OPEN & (where.event_id == 3)),
        (where.is_alarm & (where.kind == "alarm_raised"), where.kind == "alarm_raised"),
        (~(OPEN | where.is_alarm), Not(OPEN)),
        ((where.is_message & where.is_alarm) | ((where.event_class == G) & OPEN), OPEN),
        (where.event_class != G, where.event_class != G),
        (~Everything(), Everything()),
    ],
)
def test_what_the_keys_decide_is_not_asked_again(expr: Expr, rest: Expr) -> None:
    """The residual is what a listener has to check of an event that came by its key."""
    assert residual(expr) == rest


def test_a_filter_on_stored_events_has_no_keys() -> None:
    """Live events have no unique id."""
    with pytest.raises(ValueError, match="unique_id is given when an event is stored"):
        cover(where.is_alarm & ~(where.unique_id == 3))
    with pytest.raises(ValueError, match="unique_id"):
        residual(where.unique_id.in_(3))


def test_class_names_are_looked_up() -> None:
    """Every GUID of the name gets its key."""
    expr = where.event_class == "Motion"
    assert cover(expr, resolve_class=lambda _: [G, H]).selections == (one(event_class=G), one(event_class=H))
    with pytest.raises(UnknownClassError):
        cover(expr)


def test_a_filter_that_names_very_many_targets_and_classes_is_bounded() -> None:
    """127 targets and 128 classes would make 16,000 cells."""
    guids = [f"{number:08x}-0000-0000-0000-000000000000" for number in range(128)]
    expr = where.target.in_(*(f"plc{number}" for number in range(127))) & where.event_class.in_(*guids)
    began = time.perf_counter()
    assert cover(expr) == Cover((Selection(),), False)
    assert residual(expr) == expr
    assert time.perf_counter() - began < 5


def test_places_tell_which_targets_and_classes_may_match() -> None:
    """Never narrower than the filter, and not widened where a cover is: a recording has a channel for each pair."""
    takes = places((where.target == "plc1") & (where.event_class == EVENT_CLASS) | (where.target == "plc2") & where.is_alarm)
    pairs = list(product(("plc1", "plc2", "plc3"), (EVENT_CLASS, OTHER_CLASS)))
    assert [takes(*pair) for pair in pairs] == [True, False, True, True, False, False]
    names = tuple(f"plc{number}" for number in range(100))
    assert len(cover(where.target.in_(*names)).selections) == 1
    many = places(where.target.in_(*names))
    assert many("plc99", EVENT_CLASS)
    assert not many("plc100", EVENT_CLASS)
    assert places(Everything())("any", OTHER_CLASS)
    assert places((where.target == "plc1") & (where.event_id == 7))("plc1", OTHER_CLASS), "what the key does not decide may be"
    assert not places(Not(Everything()))("any", OTHER_CLASS)
