"""Events: what each kind carries, the source with all its ways to be absent, and the limits of the manual."""

import msgspec
import pytest

from bridge.core.arguments import ZERO_GUID, Argument, ArgumentType
from bridge.core.events import (
    DEFAULT_LIMITS,
    KIND_NAMES,
    KINDS,
    AnyEvent,
    ConfirmationState,
    LimitError,
    Limits,
    Origin,
    Severity,
    Source,
    argument_bytes,
    check_limits,
    is_active,
    measure,
)
from bridge.testing.builders import (
    EVENT_CLASS,
    TIME_NS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

T = ArgumentType


def test_the_five_severities() -> None:
    """TcEventSeverity (manual 6.3.2): verbose 0 to critical 4, so that they compare."""
    assert [(severity.name, int(severity)) for severity in Severity] == [
        ("VERBOSE", 0),
        ("INFO", 1),
        ("WARNING", 2),
        ("ERROR", 3),
        ("CRITICAL", 4),
    ]


def test_the_five_confirmation_states() -> None:
    """TcEventConfirmationState (manual 6.3.3)."""
    names = ["NOT_SUPPORTED", "NOT_REQUIRED", "WAIT_FOR_CONFIRMATION", "CONFIRMED", "RESET"]
    assert [(state.name, int(state)) for state in ConfirmationState] == [(name, n) for n, name in enumerate(names)]


def test_the_five_kinds() -> None:
    """A message, and the four transitions of an alarm; each kind has a name and says whether it is an alarm's."""
    assert KIND_NAMES == ("message_sent", "alarm_raised", "alarm_cleared", "alarm_confirmed", "alarm_disposed")
    assert [kind.is_alarm for kind in KINDS] == [False, True, True, True, True]


def test_every_kind_has_the_same_fields() -> None:
    """A filter needs no memory and no case for the kind: whatever it asks for is there."""
    assert {kind.__struct_fields__ for kind in KINDS} == {KINDS[0].__struct_fields__}


def test_an_event_cannot_change() -> None:
    """What happened has happened."""
    with pytest.raises(AttributeError):
        message_sent().event_id = 2  # type: ignore[misc]


@pytest.mark.parametrize(
    ("event", "active"),
    [
        (message_sent(), False),
        (alarm_raised(), True),
        (alarm_raised(confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION), True),
        (alarm_cleared(), False),
        (alarm_cleared(confirmation_state=ConfirmationState.WAIT_FOR_CONFIRMATION), True),
        (alarm_cleared(confirmation_state=ConfirmationState.RESET), False),
        (alarm_confirmed(), True),
        (alarm_confirmed(raised=False), False),
        (alarm_disposed(), False),
    ],
    ids=str,
)
def test_active_is_raised_or_waiting_for_confirmation(event: AnyEvent, active: bool) -> None:
    """bActive (manual 6.1.5): raised, or cleared but still to be confirmed."""
    assert is_active(event) is active


# The source: object id, path and GUID, each possibly absent.

SIX = [
    Source(),
    Source(id=0),
    Source(name=""),
    Source(guid=ZERO_GUID),
    Source(id=0, name=""),
    Source(id=0, name="", guid=ZERO_GUID),
]


def test_absent_is_not_empty() -> None:
    """No id and id 0, no name and the name "", no GUID and the zero GUID: none of them equals another."""
    assert len(set(SIX)) == len(SIX)
    for field, empty in (("id", 0), ("name", ""), ("guid", ZERO_GUID)):
        assert Source() != msgspec.structs.replace(Source(), **{field: empty})


def test_absent_and_empty_are_measured_apart() -> None:
    """An empty part of the source is transmitted, an absent one is not: entries of 12 bytes, then 4, 1 and 16 of data."""
    sizes = [measure(message_sent(source_id=s.id, source_name=s.name, source_guid=s.guid)) - 120 for s in SIX]
    assert sizes == [0, 12 + 4, 12 + 1, 12 + 16, 12 + 4 + 12 + 1, 12 + 4 + 12 + 1 + 12 + 16]


def test_an_event_gives_its_source_as_one_value() -> None:
    """id, name and GUID of the event, absent ones absent."""
    assert message_sent(source_id=0, source_guid=EVENT_CLASS).source == Source(id=0, guid=EVENT_CLASS)
    assert message_sent().source == Source()


def test_sources_compare_by_value() -> None:
    """Two sources with the same parts are the same, also when the GUID was spelled otherwise."""
    assert Source(1, "MAIN", "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}") == Source(1, "MAIN", EVENT_CLASS)
    assert Source(1, "MAIN") != Source(1, "main")


@pytest.mark.parametrize("number", [-1, 2**32])
def test_a_source_id_has_32_bits(number: int) -> None:
    """An object id is a UDINT."""
    with pytest.raises(ValueError, match=f"source id {number} is outside"):
        Source(id=number)
    assert Source(id=2**32 - 1).id == 2**32 - 1


def test_a_source_guid_must_be_one() -> None:
    """A name is no GUID."""
    with pytest.raises(ValueError, match="'MAIN' is no GUID"):
        Source(guid="MAIN")


def test_a_name_is_extended() -> None:
    """ExtendName appends to the name and keeps id and GUID; without a name the extension is the name."""
    assert Source(1, "MAIN", EVENT_CLASS).extended(".fbAxis") == (Source(1, "MAIN.fbAxis", EVENT_CLASS), True)
    assert Source().extended("X") == (Source(name="X"), True)
    assert Source().extended("") == (Source(name=""), True)


def test_an_extended_name_is_cut_at_the_limit_and_says_so() -> None:
    """255 characters fit (cSourceNameSize 256 counts the terminator); of 256 the last is cut and the answer is False."""
    assert Source(name="a" * 254).extended("b") == (Source(name="a" * 254 + "b"), True)
    assert Source(name="a" * 254).extended("bc") == (Source(name="a" * 254 + "b"), False)
    assert Source(name="a").extended("bcd", limit=3) == (Source(name="abc"), False)


# Limits: native sizes, measured whatever the encoding here.


def test_the_limits_are_those_of_the_manual() -> None:
    """8 kB per event (chapter 4), 128 arguments and 1,024 bytes of them (5.7), 255 characters of source name (6.4.3)."""
    assert Limits() == DEFAULT_LIMITS == Limits(8192, 128, 1024, 255)


def test_the_record_of_the_capture() -> None:
    """An alarm of the captured logger: id, the name MAIN and one INT argument are 159 bytes, as its record is (facts 3.2)."""
    arguments = (Argument.of(1, T.INT16),)
    event = alarm_cleared(source_id=0x08502000, source_name="MAIN", arguments=arguments)
    assert measure(event) == 120 + (12 + 4) + (12 + 5) + 2 + 2
    assert measure(event) + 2 == 159  # the captured argument is a DINT
    assert measure(alarm_cleared(source_id=0x08502000, source_name="MAIN", arguments=(Argument.of(1),))) == 159


def over(event: AnyEvent, limits: Limits = DEFAULT_LIMITS) -> LimitError:
    """The error that the event meets."""
    with pytest.raises(LimitError) as caught:
        check_limits(event, limits)
    return caught.value


def json_of(size: int) -> str:
    """A JSON attribute that makes a message measure `size` bytes: header 120, one terminator."""
    return "x" * (size - 121)


def test_an_event_of_8192_bytes_fits() -> None:
    """Exactly at the limit; the JSON attribute fills what the header leaves."""
    event = message_sent(json_attribute=json_of(8192))
    assert measure(event) == 8192
    check_limits(event)


def test_an_event_of_8193_bytes_does_not() -> None:
    """The error names the limit, the measured size, what is allowed, and the field that weighs most."""
    error = over(message_sent(json_attribute=json_of(8193)))
    assert (error.limit, error.field, error.measured, error.allowed) == ("event_bytes", "json_attribute", 8193, 8192)
    assert str(error) == "json_attribute: 8193 is over the limit event_bytes = 8192"


def test_the_size_counts_every_element() -> None:
    """Source, arguments and their types count with the JSON attribute: together they are one byte too many."""
    arguments = (Argument.of(True), Argument.of("ab"))
    event = message_sent(source_id=0, source_guid=ZERO_GUID, source_name="MAIN", arguments=arguments)
    rest = (12 + 4) + (12 + 16) + (12 + 5) + 2 * 2 + 1 + 3
    check_limits(msgspec.structs.replace(event, json_attribute=json_of(8192 - rest)))
    error = over(msgspec.structs.replace(event, json_attribute=json_of(8193 - rest)))
    assert (error.limit, error.measured) == ("event_bytes", 8193)


def test_a_letter_counts_its_bytes_not_its_place() -> None:
    """An umlaut is two bytes, an emoji four: 2,000 characters may be near 8 kB, and the wire's escapes do not matter."""
    check_limits(message_sent(json_attribute="🙂" * 2017 + "abc"))
    assert over(message_sent(json_attribute="🙂" * 2017 + "abcd")).measured == 8193
    check_limits(message_sent(json_attribute="\\n" * 4035))


def test_128_arguments_fit_and_129_do_not() -> None:
    """The count is a limit of its own."""
    check_limits(message_sent(arguments=(Argument.of(True),) * 128))
    error = over(message_sent(arguments=(Argument.of(True),) * 129))
    assert (error.limit, error.field, error.measured, error.allowed) == ("arguments", "arguments", 129, 128)


def test_1024_bytes_of_arguments_fit_and_1025_do_not() -> None:
    """Packed argument data: a blob has 4 bytes of length, a text its terminator."""
    check_limits(message_sent(arguments=(Argument.of(bytes(1020)),)))
    check_limits(message_sent(arguments=(Argument.of("x" * 1023),)))
    error = over(message_sent(arguments=(Argument.of(bytes(1021)),)))
    assert (error.limit, error.field, error.measured, error.allowed) == ("argument_bytes", "arguments", 1025, 1024)
    assert over(message_sent(arguments=(Argument.of("x" * 511 + "ü"), Argument.of("x" * 510)))).measured == 1025


def test_arguments_that_say_little_and_weigh_much_are_measured_too() -> None:
    """A reference with a class is 20 bytes even when a foreign sender left its text empty: 51 fit, 52 do not."""
    check_limits(message_sent(arguments=(Argument(T.EVENT_REFERENCE, ""),) * 51))
    assert over(message_sent(arguments=(Argument(T.EVENT_REFERENCE, ""),) * 52)).measured == 1040


def test_packed_data_is_the_sum_of_the_arguments() -> None:
    """BYTE, WORD and DWORD as UInt8, 16 and 32 take 1, 2 and 4 bytes."""
    arguments = (Argument.of(1, T.UINT8), Argument.of(1, T.UINT16), Argument.of(1, T.UINT32))
    assert argument_bytes(arguments) == 7


def test_a_source_name_of_255_characters_fits_and_256_do_not() -> None:
    """Characters count, not bytes: 255 emoji are a name."""
    check_limits(message_sent(source_name="🙂" * 255))
    error = over(message_sent(source_name="x" * 256))
    assert (error.limit, error.field, error.measured, error.allowed) == ("source_name_chars", "source_name", 256, 255)


def test_the_source_name_may_be_made_longer() -> None:
    """cSourceNameSize 81 to 10,000 counts the terminator: 80 to 9,999 characters; beyond is refused."""
    check_limits(message_sent(source_name="x" * 9999), Limits(event_bytes=20_000, source_name_chars=9999))
    for chars in (79, 10_000):
        with pytest.raises(ValueError, match=rf"source_name_chars {chars} is outside 80\.\.9999"):
            Limits(source_name_chars=chars)
    assert Limits(source_name_chars=80).source_name_chars == 80


def test_the_heaviest_field_is_named() -> None:
    """A long name, or many arguments under wider limits, is blamed instead of an empty JSON attribute."""
    assert over(message_sent(source_name="x" * 400), Limits(event_bytes=400, source_name_chars=9999)).field == "source_name"
    many = (Argument.of(True),) * 5000
    error = over(message_sent(arguments=many), Limits(event_bytes=8192, arguments=10_000, argument_bytes=10_000))
    assert (error.field, error.measured) == ("arguments", 120 + 2 * 5000 + 5000)


def test_small_events_are_measured_too() -> None:
    """Under a small limit no shortcut lets an event pass: 120 bytes of header alone are too many for 119."""
    check_limits(message_sent(), Limits(event_bytes=120))
    assert over(message_sent(), Limits(event_bytes=119)).measured == 120


def test_origin_tells_where_a_replayed_event_came_from() -> None:
    """Realm, session, seq and key_seq of the recording; an event that was not replayed has none."""
    origin = Origin("live", "5f1c2a90", 41, 3)
    assert message_sent(origin=origin).origin == origin
    assert message_sent().origin is None


def test_times_of_the_builders() -> None:
    """An event's own time is apart from the three alarm times; a message has only its own."""
    event = message_sent()
    assert (event.time_ns, event.time_raised_ns, event.time_cleared_ns, event.time_confirmed_ns) == (TIME_NS, 0, 0, 0)
