"""The log of a logger: sorted, in two views, cleared on demand; and what it drops is told as an event."""

from collections.abc import Iterator

import pytest

from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import MessageSent, Severity, Source
from bridge.core.hresult import (
    ADS_E_INVALIDDATA,
    ADS_E_INVALIDPARM,
    ADS_E_INVALIDSIZE,
    ADS_E_INVALIDSTATE,
    AdsError,
)
from bridge.core.own_events import CACHE_DROPPED, LOG_CLEARED, OWN_CLASS
from bridge.core.questions import ClearLogQuestion, LogQuestion, Stored
from bridge.core.sequence import Missing
from bridge.edges.bus import Bus
from bridge.edges.cache import Cache, Drop
from bridge.logger import Commands, EventLogger, LoggerProxy
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS
from tests.unit.logger.logger_stories import alone, eventually, new_alarm

TEXTS = {1: ("zero", "drei"), 2: ("one", "zwei"), 3: ("two", "eins")}
CATALOG = Catalog(
    [
        EventClass(
            EVENT_CLASS,
            "Line",
            "z line",
            {number: EventEntry(number, f"E{number}", Severity.INFO, english) for number, (english, _) in TEXTS.items()},
            {english: {1031: german} for english, german in TEXTS.values()},
        ),
        EventClass(OTHER_CLASS, "Other", "a other", {1: EventEntry(1, "E1", Severity.INFO, "five")}),
    ]
)


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus without any neighbour."""
    with alone() as bus:
        yield bus


@pytest.fixture(params=["inside", "proxy"])
def logger(request: pytest.FixtureRequest, bus: Bus) -> Iterator[Commands]:
    """The same logger from inside and from outside."""
    with EventLogger("plc1", bus=bus, catalog=CATALOG, client="hmi:test") as inside:
        if request.param == "inside":
            yield inside
        else:
            with LoggerProxy(bus, "plc1", client="hmi:test") as proxy:
                yield proxy


def send(logger: Commands, *numbers: int, event_class: str = EVENT_CLASS) -> None:
    """Messages with these event ids, and wait until they are stored."""
    before = len(list(logger.log()))
    for number in numbers:
        logger.send_message(event_class, number, Severity.INFO, source=Source(name="MAIN"))
    assert eventually(lambda: len(list(logger.log())) == before + len(numbers))


def ids(found: Iterator[Stored]) -> list[int]:
    """Their event ids."""
    return [one.event.event_id for one in found]


def test_texts_sort_in_the_language_asked_for(logger: Commands) -> None:
    """English and German order, first and last ones; class names too."""
    send(logger, 1, 2, 3)
    send(logger, 1, event_class=OTHER_CLASS)
    only = "event_class = 'Line'"
    assert ids(logger.log(LogQuestion(sort="event_text", newest_first=False, filter=only))) == [2, 3, 1]
    assert ids(logger.log(LogQuestion(sort="event_text", lang="de", newest_first=False, filter=only))) == [1, 3, 2]
    assert ids(logger.log(LogQuestion(sort="event_text", lang="de", filter=only, limit=1))) == [2]
    assert ids(logger.log(LogQuestion(sort="event_text", lang="de", filter=only, limit=2, take_last=True))) == [3, 1]
    names = [one.event.event_class for one in logger.log(LogQuestion(sort="event_class_name", newest_first=False))]
    assert names == [OTHER_CLASS, EVENT_CLASS, EVENT_CLASS, EVENT_CLASS]
    assert ids(logger.log(LogQuestion(sort="event_id", newest_first=False, limit=3, offset=1))) == [1, 2, 3]


def test_an_unknown_language_is_refused(bus: Bus) -> None:
    """Not taken for English."""
    with EventLogger("plc1", bus=bus) as logger, pytest.raises(AdsError) as refused:
        logger.log(LogQuestion(sort="event_text", lang="xx-YY"))
    assert refused.value.code == ADS_E_INVALIDPARM


def test_an_occurrence_has_the_whole_life(logger: Commands) -> None:
    """One row with raised, confirmed and cleared; the transitions are still there."""
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm, time_ns=10**18)
    logger.confirm_alarm(alarm, time_ns=10**18 + 5)
    logger.clear_alarm(alarm, time_ns=10**18 + 7)
    send(logger, 3)
    message, life = logger.log(LogQuestion(view="occurrences"))
    assert message.event.event_id == 3
    assert life.event.kind == "alarm_cleared"
    times = (life.event.time_raised_ns, life.event.time_confirmed_ns, life.event.time_cleared_ns)
    assert times == (10**18, 10**18 + 5, 10**18 + 7)
    assert len(list(logger.log())) == 4


def test_clearing_never_touches_alarms(logger: Commands) -> None:
    """The log is empty but for the report, which says who, from where and why; the alarm is still raised."""
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm)
    send(logger, 1, 2, 3)
    assert logger.clear_log(operator="anna", comment="new shift") == 4
    assert logger.is_raised(alarm)
    assert eventually(lambda: len(list(logger.log())) == 1)
    (report,) = logger.log()
    event = report.event
    assert isinstance(event, MessageSent)
    assert (event.event_class, event.event_id, event.severity) == (OWN_CLASS, LOG_CLEARED, Severity.INFO)
    assert [one.value for one in event.arguments] == ["4", "anna", "hmi:test", "new shift"]
    assert (event.operator, event.client, event.comment) == ("anna", "hmi:test", "new shift")
    assert logger.confirm_alarm(alarm).raised


def test_clearing_a_part(logger: Commands) -> None:
    """Filter, order, limit and offset as in a question; what is selected goes, nothing else."""
    send(logger, 1, 2, 3, 4, 5, 6)
    assert logger.clear_log(LogQuestion(filter="event_id > 1", sort="event_id", newest_first=False, limit=2, offset=1)) == 2
    assert sorted(ids(logger.log(LogQuestion(filter="event_class = 'Line'")))) == [1, 2, 5, 6]
    assert logger.clear_log(LogQuestion(sort="event_text", limit=1, take_last=True, filter="event_class = 'Line'")) == 1
    assert logger.clear_log(LogQuestion(filter="event_id = 77")) == 0


def test_clearing_an_occurrence_takes_its_whole_life(logger: Commands) -> None:
    """Not only its newest row, or the one before would take its place."""
    alarm = new_alarm(logger)
    logger.raise_alarm(alarm)
    logger.confirm_alarm(alarm)
    send(logger, 2)
    assert logger.clear_log(LogQuestion(filter="is_alarm", view="occurrences")) == 2
    assert [one.event.kind for one in logger.log(LogQuestion(filter="event_class != 'TcBridge'"))] == ["message_sent"]


def test_a_clearing_is_carried_out_once_per_id(bus: Bus) -> None:
    """The same question again gets the same answer; what came meanwhile stays. Another question with the id is refused."""
    with EventLogger("plc1", bus=bus) as logger:
        send(logger, 1, 2)
        question = ClearLogQuestion(id="a", which=LogQuestion(filter="event_id < 9 and source_name = 'MAIN'"))
        first = logger._clear(question)
        send(logger, 3)
        assert logger._clear(question) == first
        assert first.cleared == 2
        assert ids(logger.log(LogQuestion(filter="source_name = 'MAIN'"))) == [3]
        assert logger._clear(ClearLogQuestion(id="a")).result == ADS_E_INVALIDDATA
        assert logger._clear(ClearLogQuestion(id="")).result == ADS_E_INVALIDDATA
        assert logger._clear(ClearLogQuestion(id="b", comment="x" * 1025)).result == ADS_E_INVALIDSIZE
    assert logger._clear(ClearLogQuestion(id="c")).result == ADS_E_INVALIDSTATE


def test_a_bad_clearing_is_refused(logger: Commands) -> None:
    """A filter that is none, what is missing: an error, and nothing is gone."""
    send(logger, 1)
    for which in (LogQuestion(filter="severity >"), LogQuestion(missing=Missing("s", "k", 1, 2))):
        with pytest.raises(AdsError):
            logger.clear_log(which)
    assert len(list(logger.log())) == 1


def test_what_the_cache_drops_is_an_event(bus: Bus) -> None:
    """A message of our own class with number and reason, stored and sent; dropping such messages alone makes no other."""
    cache = Cache(max_events=50)
    drops: list[Drop] = []
    with EventLogger("plc1", bus=bus, cache=cache) as logger:
        tell = cache.on_dropped

        def told(drop: Drop) -> None:
            assert tell is not None
            drops.append(drop)
            tell(drop)

        cache.on_dropped = told
        for number in range(51):
            logger.send_message(EVENT_CLASS, number, Severity.INFO, source=Source(name="MAIN"))
        own = LogQuestion(filter=f"event_class = '{OWN_CLASS}'")
        assert eventually(lambda: len(list(logger.log(own))) == 1)
        (report,) = logger.log(own)
        assert report.event.event_id == CACHE_DROPPED
        assert report.event.severity is Severity.WARNING
        assert [one.value for one in report.event.arguments] == ["26", "max_events"]
        assert (
            logger.catalog.event_text(report.event, "de")
            == "Das Protokoll hat seine 26 ältesten Ereignisse verworfen (max_events)"
        )
        for _ in range(12):
            for _ in range(10):
                logger.send_message(OWN_CLASS, CACHE_DROPPED, Severity.WARNING, source=Source(name="x"))
            logger.book.flush()
    assert drops[0] == Drop(26, "max_events")
    assert any(drop.quiet for drop in drops)
    assert logger.counters.messages == 51 + 120 + sum(not drop.quiet for drop in drops)
