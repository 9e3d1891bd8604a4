"""Two versions of a class side by side: what changed, and what a listener notices of it."""

import msgspec
import pytest

from bridge.core.catalog import EventClass, EventEntry
from bridge.core.class_diff import STALE, Change, diff, diff_classes
from bridge.core.events import Severity

OLD = "11111111-0000-4000-8000-000000000001"
NEW = "11111111-0000-4000-8000-000000000002"
OTHER = "11111111-0000-4000-8000-000000000003"


def pump(guid: str = OLD, *events: EventEntry, **more: object) -> EventClass:
    """A class with one event unless others are given."""
    entries = events or (EventEntry(1, "Dry", Severity.ERROR, "Pump {0} ran dry"),)
    found = EventClass(guid, "Pump", "Pumps", {each.id: each for each in entries}, {"Pumps": {1031: "Pumpen"}})
    for name, value in more.items():
        found = _with(found, name, value)
    return found


def _with(found: EventClass, name: str, value: object) -> EventClass:
    return msgspec.convert(msgspec.to_builtins(found) | {name: msgspec.to_builtins(value)}, EventClass, str_keys=True)


def changes(old: EventClass, new: EventClass) -> dict[str, tuple[str, str, bool]]:
    """What changed: before, after, and whether it is noticed."""
    return {each.what: (each.before, each.after, bool(each.notice)) for each in diff_classes(old, new).changes}


def test_nothing_changed() -> None:
    """The same class has no change, and a file compared with itself no difference."""
    assert diff_classes(pump(), pump()).changes == ()
    assert diff([pump(), pump(NEW)], [pump(NEW), pump()]) == []


def test_an_edit_that_hides_the_old_version() -> None:
    """A new GUID: a filter by name goes on, one by the old GUID does not."""
    found = diff_classes(pump(), pump(NEW, hides=[OLD]))
    assert found.changes == (
        Change("GUID", OLD, NEW, "a filter by class name takes both versions, one by the old GUID takes no new event"),
    )
    assert found.noticed


def test_a_copy_that_hides_nothing() -> None:
    """Nothing joins the two versions."""
    (change,) = diff_classes(pump(), pump(NEW)).changes
    assert change.notice.startswith("no version hides the other")
    (change,) = diff_classes(pump(NEW, hides=[OLD]), pump()).changes
    assert "swapped" in change.notice


EVENT = EventEntry(1, "Dry", Severity.ERROR, "Pump {0} ran dry")
CASES: list[tuple[str, EventEntry, tuple[str, str, bool]]] = [
    ("event 1 (Dry) severity", EventEntry(1, "Dry", Severity.INFO, "Pump {0} ran dry"), ("error", "info", True)),
    ("event 1 (Wet) name", EventEntry(1, "Wet", Severity.ERROR, "Pump {0} ran dry"), ("Dry", "Wet", False)),
    (
        "event 1 (Dry) text",
        EventEntry(1, "Dry", Severity.ERROR, "Pump {1} ran dry"),
        ("Pump {0} ran dry", "Pump {1} ran dry", True),
    ),
    ("event 1 (Dry) comment", EventEntry(1, "Dry", Severity.ERROR, "Pump {0} ran dry", "why"), ("", "why", False)),
]


@pytest.mark.parametrize(("what", "entry", "expected"), CASES, ids=lambda case: case if isinstance(case, str) else "")
def test_one_event_changed(what: str, entry: EventEntry, expected: tuple[str, str, bool]) -> None:
    """Severity and text are noticed, Name and comment are not."""
    assert changes(pump(OLD, EVENT), pump(OLD, entry)) == {what: expected}


def test_a_name_that_is_shown_is_noticed() -> None:
    """An event without display text shows its Name."""
    old, new = pump(OLD, EventEntry(1, "Dry", Severity.ERROR)), pump(OLD, EventEntry(1, "Wet", Severity.ERROR))
    assert changes(old, new) == {"event 1 (Wet) name": ("Dry", "Wet", True)}


def test_events_come_and_go() -> None:
    """Both are noticed."""
    found = changes(pump(OLD, EVENT), pump(OLD, EventEntry(2, "Hot", Severity.ERROR, "Pump hot")))
    assert found == {"event 1": ("Dry: Pump {0} ran dry", "", True), "event 2": ("", "Hot: Pump hot", True)}


def test_the_rest_of_a_class() -> None:
    """Class name, display text, surplus arguments, translations, hidden versions, comment, properties."""
    new = pump(
        name="Pumps2",
        display_text="All pumps",
        hide_needless_arguments=True,
        translations={"All pumps": {1031: "Alle Pumpen"}, "Pump {0} ran dry": {1031: "Pumpe {0} trocken"}},
        hides=[OTHER],
        comment="c",
        properties={"a": "1"},
    )
    assert changes(pump(), new) == {
        "name": ("Pump", "Pumps2", True),
        "display text": ("Pumps", "All pumps", True),
        "surplus arguments": ("shown", "hidden", True),
        "'Pump {0} ran dry' in de-DE (1031)": ("", "Pumpe {0} trocken", True),
        "hides": ("", OTHER, True),
        "comment": ("", "c", False),
        "properties": ("", "a=1", False),
    }


def test_content_that_changed_under_the_same_guid_is_stale() -> None:
    """Every noticed change says that listeners go on with what they have; a comment does not."""
    new = pump(OLD, EventEntry(1, "Dry", Severity.INFO, "Pump {0} ran dry", "why"))
    severity, comment = diff_classes(pump(), new).changes
    assert severity.notice.endswith(STALE)
    assert comment.notice == ""


def test_files_are_compared_class_by_class() -> None:
    """By GUID, then by what hides what, then by a name that occurs once; the rest came or went."""
    lonely = EventClass(OTHER, "Lonely")
    fresh = EventClass("11111111-0000-4000-8000-000000000004", "Lonely")
    gone = EventClass("11111111-0000-4000-8000-000000000005", "Gone")
    found = {each.name: each for each in diff([pump(), lonely, gone], [pump(NEW, hides=[OLD]), fresh])}
    assert set(found) == {"Pump", "Lonely", "Gone"}
    assert found["Pump"].old == pump()
    assert [each.what for each in found["Lonely"].changes] == ["GUID"]
    assert found["Gone"].new is None
    (came,) = diff([], [gone])
    assert (came.name, came.noticed) == ("Gone", True)
