"""Texts without files: classes offered on the bus, asked for once, and what happens when nobody knows or answers."""

import threading
import time
from collections.abc import Iterable, Iterator

import msgspec
import pytest

from bridge.core import keys
from bridge.core.arguments import ZERO_GUID, Argument, EventReference
from bridge.core.catalog import Catalog, EventClass, EventEntry, LanguageError
from bridge.core.class_offer import ClassesPart, ClassesQuestion
from bridge.core.events import MessageSent, Severity
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOMOREHDL, ADS_E_NOTFOUND, AdsError
from bridge.edges.bus import ALONE, Bus, Question, Reply, open_bus
from bridge.logger import EventLogger
from bridge.texts import ClassOffer, Texts, ask_classes

AXIS_GUID = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
PUMP_GUID = "695e2e22-3f74-4ec5-a795-e51962a66fcb"
UNKNOWN = "64b4d49e-1bd8-462d-9a40-2904237f1837"
AXIS = EventClass(
    AXIS_GUID,
    "Axis",
    "Axis errors",
    {7: EventEntry(7, "Lag", Severity.ERROR, "Axis {0} lags")},
    {"Axis {0} lags": {1031: "Achse {0} schleppt"}, "Axis errors": {1031: "Achsfehler"}},
)
PUMP = EventClass(PUMP_GUID, "Pump", "Pumps", {1: EventEntry(1, "Dry", Severity.ERROR, "Pump ran dry")})
WAIT_S = 30.0


def message(event_class: str = AXIS_GUID, event_id: int = 7, *arguments: Argument, target: str = "plc1") -> MessageSent:
    """A message with argument 3 unless others are given."""
    return MessageSent(
        target=target,
        event_class=event_class,
        event_id=event_id,
        severity=Severity.ERROR,
        time_ns=1,
        arguments=arguments or (Argument.of(3),),
    )


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that meets nobody."""
    with open_bus(ALONE) as opened:
        yield opened


def test_a_text_in_two_languages_without_a_file(bus: Bus) -> None:
    """The class is asked for once; text and class name then come in any language."""
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus, language="de") as texts:
        assert texts.text(message()) == "Achse 3 schleppt"
        assert texts.text(message(), "en") == "Axis 3 lags"
        assert texts.class_name(message()) == "Achsfehler"
        assert texts.class_name(message(), 1033) == "Axis errors"
        assert texts.questions == 1
        assert texts.catalog.lookup(AXIS_GUID) == AXIS


def test_what_was_learnt_outlives_who_offered_it(bus: Bus) -> None:
    """The offer is gone, the text stays."""
    with Texts(bus) as texts:
        with ClassOffer(bus, "plc1", Catalog([AXIS])):
            assert texts.text(message()) == "Axis 3 lags"
        assert texts.text(message()) == "Axis 3 lags"


def test_own_classes_come_first_and_are_not_asked_for(bus: Bus) -> None:
    """A class of one's own file keeps its texts, whatever others offer."""
    own = EventClass(AXIS_GUID, "Axis", events={7: EventEntry(7, "Lag", Severity.ERROR, "mine {0}")})
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus, catalog=Catalog([own])) as texts:
        assert texts.text(message(), "de") == "mine 3"
        assert texts.questions == 0


def test_a_class_of_another_target_is_found(bus: Bus) -> None:
    """The event's own target does not know it; somebody else in the realm does. Another realm is not asked."""
    with ClassOffer(bus, "plc1", Catalog([PUMP])), ClassOffer(bus, "plc2", Catalog([AXIS])), Texts(bus) as texts:
        assert texts.text(message()) == "Axis 3 lags"
        with Texts(bus, realm="replay-1") as elsewhere:
            assert elsewhere.text(message()) == f"{AXIS_GUID}#7 (3)"


def test_two_who_offer_under_one_target(bus: Bus) -> None:
    """The logger knows one class, a publisher beside it the other: both are found in one question."""
    with (
        EventLogger("plc1", bus=bus, catalog=Catalog([PUMP])),
        ClassOffer(bus, "plc1", Catalog([AXIS])),
        Texts(bus) as texts,
    ):
        texts.catalog_for([message(), message(PUMP_GUID, 1)])
        assert {each.guid for each in texts.catalog} == {AXIS_GUID, PUMP_GUID}
        assert texts.questions == 1


def test_two_who_know_different_translations(bus: Bus) -> None:
    """The same class, translated into German here and into French there, is shown in both."""
    french = EventClass(AXIS_GUID, "Axis", "Axis errors", AXIS.events, {"Axis {0} lags": {1036: "L'axe {0} traîne"}})
    with ClassOffer(bus, "plc1", Catalog([AXIS])), ClassOffer(bus, "plc1", Catalog([french])), Texts(bus) as texts:
        assert texts.text(message(), "de") == "Achse 3 schleppt"
        assert texts.text(message(), "fr") == "L'axe 3 traîne"


def test_an_event_that_an_argument_refers_to(bus: Bus) -> None:
    """Its class is asked for too."""
    with ClassOffer(bus, "plc1", Catalog([AXIS, PUMP])), Texts(bus) as texts:
        reference = Argument.of(EventReference(1, PUMP_GUID))
        assert texts.text(message(AXIS_GUID, 7, reference)) == "Axis Pump ran dry lags"


def test_nobody_knows(bus: Bus) -> None:
    """The text is that of an unknown class; nobody is asked again before the time is over."""
    with ClassOffer(bus, "plc1", Catalog([PUMP])), Texts(bus) as texts:
        assert texts.text(message(UNKNOWN)) == f"{UNKNOWN}#7 (3)"
        asked = texts.questions
        assert texts.class_name(message(UNKNOWN)) == UNKNOWN
        assert texts.questions == asked == 2


def test_unknown_is_forgotten(bus: Bus) -> None:
    """After unknown_s (here at once) a class that somebody offers by now is found."""
    with Texts(bus, unknown_s=0) as texts:
        assert texts.text(message()) == f"{AXIS_GUID}#7 (3)"
        with ClassOffer(bus, "plc1", Catalog([AXIS])):
            assert texts.text(message()) == "Axis 3 lags"


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xff", b"[]", b'{"session":"s","classes":[{"guid":"x","name":"y"}]}', b'{"session":"s","last":false}', b"[" * 9999],
)
def test_an_answer_that_is_none(bus: Bus, payload: bytes) -> None:
    """Hostile and broken answers are left out; the good one beside them counts."""

    def broken(_question: Question) -> Iterable[Reply]:
        return [Reply(payload)]

    answering = bus.answer(keys.verb_key("live", "plc1", "@classes"), broken)
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus) as texts:
        assert texts.text(message()) == "Axis 3 lags"
    answering.close()


def test_an_answer_nobody_asked_for_is_not_kept(bus: Bus) -> None:
    """Who is asked for one class cannot slip in another."""

    def everything(_question: Question) -> Iterable[Reply]:
        return [Reply(msgspec.json.encode(ClassesPart(session="s", classes=(AXIS, PUMP))))]

    answering = bus.answer(keys.verb_key("live", "plc1", "@classes"), everything)
    with Texts(bus) as texts:
        assert texts.text(message()) == "Axis 3 lags"
        assert [each.guid for each in texts.catalog] == [AXIS_GUID]
    answering.close()


def test_somebody_who_does_not_answer(bus: Bus) -> None:
    """The text comes without the class when the time is over, and the rest of the stream does not wait again."""
    hung = threading.Event()

    def silent(_question: Question) -> Iterable[Reply]:
        hung.wait(WAIT_S)
        return []

    answering = bus.answer(keys.verb_key("live", "plc1", "@classes"), silent)
    try:
        with Texts(bus, timeout_s=0.2) as texts:
            for _ in range(100):
                assert texts.text(message()) == f"{AXIS_GUID}#7 (3)"
            assert texts.questions <= 2
    finally:
        hung.set()
        answering.close()


def test_a_closed_bus_is_no_exception() -> None:
    """text() shows the unknown class, also of an event whose class or target is nonsense."""
    bus = open_bus(ALONE)
    texts = Texts(bus)
    bus.close()
    assert texts.text(message()) == f"{AXIS_GUID}#7 (3)"
    assert texts.text(message("nonsense", 1)) == "nonsense#1 (3)"
    assert texts.text(message(target="\ud800")) == f"{AXIS_GUID}#7 (3)"
    assert texts.guids("Axis") == ()
    texts.close()


def test_names_for_filters(bus: Bus) -> None:
    """A name that no own file knows is asked for in the realm; every version of it counts."""
    with ClassOffer(bus, "plc1", Catalog([AXIS, PUMP])), Texts(bus) as texts:
        assert texts.guids("Axis") == (AXIS_GUID,)
        assert texts.guids("Axes") == ()


def test_the_class_behind_a_source_is_asked_for(bus: Bus) -> None:
    """Its name is then there in the asked language. A source without a name, or with the GUID of zeros, asks nothing."""
    pump = EventClass(PUMP_GUID, "PumpRoom", translations={"Pump": {1031: "Pumpe"}})
    event = msgspec.structs.replace(message(), source_name="Pump", source_guid=PUMP_GUID)
    with ClassOffer(bus, "plc1", Catalog([AXIS])), ClassOffer(bus, "plc2", Catalog([pump])), Texts(bus) as texts:
        assert texts.catalog_for((event,)).source_name("Pump", PUMP_GUID, "de") == "Pumpe"
        asked = texts.questions
        for other in (
            msgspec.structs.replace(event, source_name=None, source_guid=AXIS_GUID[:-1] + "0"),
            msgspec.structs.replace(event, source_guid=ZERO_GUID),
            msgspec.structs.replace(event, source_guid=None),
        ):
            texts.text(other)
        assert texts.questions == asked


def test_a_name_is_asked_for_until_everybody_was_found(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter that is resolved right after the bus was opened finds who turns up a moment later, but waits no longer."""
    moments = iter((2.0, 1.0, 0.0))
    offers: list[ClassOffer] = []

    def undiscovered() -> float:
        left = next(moments)
        if left == 1.0:
            offers.append(ClassOffer(bus, "plc1", Catalog([AXIS])))
        return left

    monkeypatch.setattr(bus, "undiscovered_s", undiscovered)
    with Texts(bus) as texts:
        assert texts.guids("Axis") == (AXIS_GUID,)
        assert offers
        assert not texts.guids("Nobody")


def test_a_recorder_does_not_wait(bus: Bus) -> None:
    """What is known now comes at once; what is not is asked for meanwhile, once, and is there later."""
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus, catalog=Catalog([PUMP])) as texts:
        assert PUMP_GUID in texts.known(message(PUMP_GUID, 1))
        assert texts.questions == 0
        assert AXIS_GUID not in texts.known(message())
        deadline = time.monotonic() + WAIT_S
        while AXIS_GUID not in texts.known(message()) and time.monotonic() < deadline:
            time.sleep(0.001)
        assert texts.known(message()).lookup(AXIS_GUID) == AXIS
        assert texts.questions == 1


def test_requests_do_not_wait(bus: Bus) -> None:
    """Futures with text and class name; a callback runs when the text is there."""
    called = threading.Event()
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus) as texts:
        asked = texts.request_text(message(), "de")
        asked.add_done_callback(lambda _future: called.set())
        assert asked.result(WAIT_S) == "Achse 3 schleppt"
        assert called.wait(WAIT_S)
        assert texts.request_class_name(AXIS_GUID.upper(), 1031).result(WAIT_S) == "Achsfehler"
        assert texts.request_class_name(AXIS_GUID, target="plc1").result(WAIT_S) == "Axis errors"


def test_a_request_for_what_nobody_knows_fails_with_the_manuals_code(bus: Bus) -> None:
    """An unknown class, an unknown event of a known class, and a name that is no GUID: ADS_E_NOTFOUND."""
    with ClassOffer(bus, "plc1", Catalog([AXIS])), Texts(bus) as texts:
        for future in (
            texts.request_text(message(UNKNOWN)),
            texts.request_text(message(AXIS_GUID, 8)),
            texts.request_class_name(UNKNOWN),
            texts.request_class_name("nonsense"),
        ):
            with pytest.raises(AdsError) as caught:
                future.result(WAIT_S)
            assert caught.value.code == ADS_E_NOTFOUND


def test_requests_are_bounded(bus: Bus) -> None:
    """While two are open the third fails at once; when they are done there is room again. close() ends open ones."""
    hung, asked = threading.Event(), threading.Event()

    def slow(_question: Question) -> Iterable[Reply]:
        asked.set()
        hung.wait(WAIT_S)
        return []

    answering = bus.answer(keys.verb_key("live", "plc1", "@classes"), slow)
    with Texts(bus, outstanding=2, timeout_s=WAIT_S) as texts:
        first, second = texts.request_text(message()), texts.request_text(message())
        assert asked.wait(WAIT_S)
        third = texts.request_text(message())
        assert isinstance(error := third.exception(0), AdsError)
        assert error.code == ADS_E_NOMOREHDL
        hung.set()
        assert first.exception(WAIT_S) is not None
        assert second.exception(WAIT_S) is not None
        assert isinstance(error := texts.request_text(message()).exception(WAIT_S), AdsError)
        assert error.code == ADS_E_NOTFOUND
    closed = texts.request_text(message()).exception(0)
    assert isinstance(closed, AdsError)
    assert closed.code == ADS_E_INVALIDSTATE
    answering.close()


def test_the_language_is_checked_at_the_call(bus: Bus) -> None:
    """An unknown language is the caller's fault."""
    with pytest.raises(LanguageError):
        Texts(bus, language="klingon")


def test_a_logger_offers_its_classes(bus: Bus) -> None:
    """With a catalog it answers @classes and its filters know the names; without one it knows none of ours."""
    with EventLogger("plc1", bus=bus, catalog=Catalog([AXIS])) as logger:
        assert ask_classes(bus, ClassesQuestion(), target="plc1")[AXIS_GUID] == AXIS
        logger.create_alarm(AXIS_GUID, 7, Severity.ERROR)
        assert logger.active_alarms("event_class = 'Axis'") == []
    with EventLogger("plc2", bus=bus):
        assert ask_classes(bus, ClassesQuestion(guids=(AXIS_GUID,)), target="plc2") == {}


def test_a_question_that_is_none_is_refused(bus: Bus) -> None:
    """The refusal says why; the next question is answered."""
    with ClassOffer(bus, "plc1", Catalog([AXIS])):
        (answer,) = bus.ask(keys.verb_key("live", "plc1", "@classes"), b'{"guids":7}')
        assert (answer.error, b"no question about classes" in answer.payload) == (True, True)
        assert ask_classes(bus, ClassesQuestion(), target="plc1") == {AXIS_GUID: AXIS}
