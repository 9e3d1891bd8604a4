"""A filter that names an old version of a class is warned, and one that names the class is not."""

import pytest

from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.filters.ast import Compare
from bridge.core.filters.hidden import hidden_in
from bridge.core.filters.text import parse

NEW = "11111111-0000-0000-0000-000000000001"
OLD = "33333333-0000-0000-0000-000000000003"
OLDER = "44444444-0000-0000-0000-000000000004"
OTHER = "22222222-0000-0000-0000-000000000002"
EVENTS = {1: EventEntry(1, "Start", Severity.INFO)}
CATALOG = Catalog(
    [
        EventClass(NEW, "Pump", events=EVENTS, hides=(OLD, OLDER)),
        EventClass(OLD, "Pump", events=EVENTS, hides=(OLDER,)),
        EventClass(OTHER, "Valve", events=EVENTS, hides=(OLD,)),
    ]
)


@pytest.mark.parametrize(
    ("text", "hidden"),
    [
        ("", []),
        (f"event_class = '{NEW}'", []),
        (f"event_class = '{OLD}'", [OLD]),
        (f"event_class = '{OLDER}'", [OLDER]),
        (f"severity > info and not (event_id = 1 or event_class in ('{OTHER}', '{OLD.upper()}'))", [OLD]),
        (f"event_class = '{OLDER}' or event_class = '{OLD}'", [OLD]),
        (f"event_class in ('{OLD}', '{NEW}')", []),
        ("event_class = Pump", []),
        ("event_class = Valve", []),
        (f"event_class = Pump and event_class != '{OLD}'", []),
    ],
)
def test_old_versions_of_a_filter(text: str, hidden: list[str]) -> None:
    """A hidden GUID counts unless a class of its name that hides it is in the filter as well; != asks for none."""
    assert [each.guid for each in hidden_in(parse(text, resolve_class=CATALOG.guids), CATALOG)] == hidden


def test_the_warning_names_both_versions_and_the_way_out() -> None:
    """Known and unknown old versions, and what to write instead."""
    (known,) = hidden_in(parse(f"event_class = '{OLD}'"), CATALOG)
    assert str(known) == (
        f"event class Pump {OLD} is an older version, hidden by Pump {NEW}: senders with the newer one are not taken; "
        "event_class = 'Pump' takes every version"
    )
    (unknown,) = hidden_in(parse(f"event_class = '{OLDER}'"), CATALOG)
    assert str(unknown).startswith(f"event class {OLDER} is an older version, hidden by Pump {NEW} and Pump {OLD}: ")


def test_a_class_that_nobody_knows_is_not_a_matter_of_this_warning() -> None:
    """A filter that was not looked up yet is, as far as it can be; an unknown name is told elsewhere."""
    assert hidden_in(Compare("event_class", "=", "Nobody"), CATALOG) == ()
    assert hidden_in(Compare("event_class", "=", "Pump"), CATALOG) == ()
    assert hidden_in(parse(f"event_class = '{OLD}'"), Catalog()) == ()
