"""Times: integer nanoseconds, TwinCAT's ticks of 100 ns, and how a time is written and read."""

import pytest

from bridge.core.times import MAX_TIME_NS, TimeError, check_time, from_filetime, parse_time, time_text, to_filetime

CAPTURED_TICKS = 134_008_985_475_030_000
"""When the captured logger raised its alarms (facts, section 7): 2025-08-28T23:49:07.503Z."""


def test_a_tick_is_100_ns_since_1601() -> None:
    """Manual 6.1.5.1: ticks count 100 ns since 1 January 1601 UTC; the Unix epoch is tick 116444736000000000."""
    assert from_filetime(116_444_736_000_000_000) == 0
    assert from_filetime(116_444_736_000_000_001) == 100
    assert time_text(from_filetime(CAPTURED_TICKS), 3) == "2025-08-28T23:49:07.503Z"


def test_every_tick_comes_back() -> None:
    """Ticks to nanoseconds and back lose nothing, the last digit included; a float or a datetime would lose it."""
    for ticks in (CAPTURED_TICKS, CAPTURED_TICKS + 1, 116_444_736_000_000_001, to_filetime(MAX_TIME_NS)):
        assert to_filetime(from_filetime(ticks)) == ticks


def test_nanoseconds_are_rounded_down_to_their_tick() -> None:
    """199 ns lie in tick 1, 200 ns in tick 2."""
    assert [to_filetime(time_ns) - 116_444_736_000_000_000 for time_ns in (100, 199, 200)] == [1, 1, 2]


def test_zero_is_not_set_in_both_forms() -> None:
    """0 means "not set" (a record) or "now" (a call), never 1601 or 1970: it stays 0, and its text is empty."""
    assert from_filetime(0) == 0
    assert to_filetime(0) == 0
    assert time_text(0) == ""


@pytest.mark.parametrize("time_ns", [-1, MAX_TIME_NS + 1, 2**64])
def test_a_time_is_between_1970_and_2262(time_ns: int) -> None:
    """What SQLite or MCAP could not hold is refused, with the range in the message."""
    with pytest.raises(TimeError, match=rf"time {time_ns} ns is outside 0\.\.9223372036854775807"):
        check_time(time_ns)
    with pytest.raises(TimeError):
        to_filetime(time_ns)


def test_the_bounds_themselves_are_times() -> None:
    """0 and the last nanosecond of 63 bits are taken."""
    assert check_time(0) == 0
    assert check_time(MAX_TIME_NS) == MAX_TIME_NS
    assert time_text(MAX_TIME_NS) == "2262-04-11T23:47:16.854775807Z"


@pytest.mark.parametrize("ticks", [1, 116_444_735_999_999_999, 2**64 - 1])
def test_ticks_outside_are_refused(ticks: int) -> None:
    """Ticks before 1970 or after 2262 have no nanosecond form."""
    with pytest.raises(TimeError):
        from_filetime(ticks)


@pytest.mark.parametrize(
    ("digits", "text"),
    [
        (9, "2026-11-22T08:30:00.123456789Z"),
        (7, "2026-11-22T08:30:00.1234567Z"),
        (3, "2026-11-22T08:30:00.123Z"),
        (1, "2026-11-22T08:30:00.1Z"),
        (0, "2026-11-22T08:30:00Z"),
    ],
)
def test_a_text_has_as_many_digits_as_asked(digits: int, text: str) -> None:
    """0 to 9 fractional digits, cut and not rounded."""
    assert time_text(1_795_336_200_123_456_789, digits) == text


def test_digits_are_cut_even_before_midnight() -> None:
    """.999999999 never becomes the next second."""
    assert time_text(parse_time("2026-12-31T23:59:59.999999999Z"), 0) == "2026-12-31T23:59:59Z"


@pytest.mark.parametrize(
    ("text", "time_ns"),
    [
        ("2026-11-22", 1_795_305_600_000_000_000),
        ("2026-11-22 08:30", 1_795_336_200_000_000_000),
        ("2026-11-22T08:30:00", 1_795_336_200_000_000_000),
        ("2026-11-22T08:30:00Z", 1_795_336_200_000_000_000),
        (" 2026-11-22T08:30:00.5Z ", 1_795_336_200_500_000_000),
        ("2026-11-22T08:30:00.123456789Z", 1_795_336_200_123_456_789),
        ("2026-11-22T09:30:00+01:00", 1_795_336_200_000_000_000),
        ("2026-11-22T03:00:00-05:30", 1_795_336_200_000_000_000),
        ("2028-02-29", 1_835_395_200_000_000_000),
        ("2262-04-11T23:47:16.854775807Z", MAX_TIME_NS),
    ],
)
def test_a_time_is_read_in_utc_unless_it_says_otherwise(text: str, time_ns: int) -> None:
    """A date alone is its midnight; blanks around it do not matter; a zone is taken into account."""
    assert parse_time(text) == time_ns


@pytest.mark.parametrize(
    "text",
    [
        "",
        "now",
        "22.11.2026",
        "2026-11-22T",
        "2026-11-22T8:30",
        "2026-11-22T08:30:00.Z",
        "2026-11-22T08:30:00.1234567890Z",
        "2026-11-22T08:30:00 UTC",
        "2026-13-01",
        "2026-02-29",
        "2026-11-22T24:00:00Z",
        "2026-11-22T08:30:60Z",
        "2026-11-22T08:30:00+24:00",
        "2026-11-22T08:30:00+01:60",
        "1969-12-31",
        "2262-04-12",
        "٢٠٢٦-11-22",
    ],
)
def test_what_is_no_time_is_refused(text: str) -> None:
    """Words, other orders, a tenth digit, days and hours that do not exist, and times outside 1970 to 2262."""
    with pytest.raises(TimeError):
        parse_time(text)


def test_the_error_shows_a_time_as_it_should_be() -> None:
    """Who wrote it wrong sees what was written and an example."""
    with pytest.raises(TimeError, match=r"'soon' is no time; expected e\.g\. 2026-11-22T08:30:00"):
        parse_time("soon")


def test_written_and_read_again() -> None:
    """time_text() with nine digits and parse_time() are inverse."""
    for time_ns in (1, 99, 1_795_336_200_123_456_789, MAX_TIME_NS):
        assert parse_time(time_text(time_ns)) == time_ns
