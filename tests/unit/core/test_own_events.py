"""The class of our own events: its GUID never changes, and it has every text."""

from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog
from bridge.core.events import check_limits
from bridge.core.own_events import CACHE_DROPPED, LOG_CLEARED, OWN_CLASS, OWN_EVENTS, SOURCE_GONE, SYSTEM_ERROR, own_event


def test_the_class_is_fixed() -> None:
    """Logs of years hold this GUID and these ids."""
    assert OWN_CLASS == OWN_EVENTS.guid == "7c1b6f0e-54c3-4b52-9b0a-7463627269d6"
    assert (CACHE_DROPPED, LOG_CLEARED, SOURCE_GONE, SYSTEM_ERROR) == (1, 2, 3, 4)
    assert set(OWN_EVENTS.events) == {1, 2, 3, 4, 10, 11, 12, 13, 14, 15, 16, 17, 18}
    assert [entry.name for entry in OWN_EVENTS.events.values()][4:6] == ["ModuleStep", "ModuleStepFailed"]


def test_each_event_has_a_text_in_two_languages() -> None:
    """With all its arguments in it, so that none is left over in parentheses."""
    catalog = Catalog([OWN_EVENTS])
    dropped = (Argument.of(5), Argument.of("max_age"))
    assert catalog.text(OWN_CLASS, CACHE_DROPPED, dropped) == "The log dropped its 5 oldest events (max_age)"
    assert (
        catalog.text(OWN_CLASS, CACHE_DROPPED, dropped, "de")
        == "Das Protokoll hat seine 5 ältesten Ereignisse verworfen (max_age)"
    )
    cleared = (Argument.of(7), *(Argument.of(text) for text in ("anna", "hmi", "why")))
    assert catalog.text(OWN_CLASS, LOG_CLEARED, cleared) == "7 events of the log were cleared by anna at hmi: why"
    assert catalog.text(OWN_CLASS, LOG_CLEARED, cleared, 1031).startswith("7 Ereignisse")
    gone = (Argument.of(2), Argument.of("plc:pump"))
    assert catalog.text(OWN_CLASS, SOURCE_GONE, gone).endswith(": 2 raised alarms are suspect, the last of plc:pump")
    assert catalog.text(OWN_CLASS, SOURCE_GONE, gone, 1031).startswith("Eine Quelle ist ohne letztes Wort fort: 2")


def test_an_event_of_ours_says_who_and_what() -> None:
    """Its texts are cut, for people; who did it is whole in its own fields."""
    event = own_event("plc1", "cache", LOG_CLEARED, 5, "o" * 300, "é\ud800", "why", operator="o" * 300, client="hmi")
    assert [argument.value for argument in event.arguments] == ["5", "o" * 200, "é?", "why"]
    assert (event.event_class, event.source_name, event.operator) == (OWN_CLASS, "tcbridge.cache", "o" * 300)
    widest = own_event("plc1", "cache", LOG_CLEARED, 5, *(["\U0001f600" * 99] * 3))
    check_limits(widest)
