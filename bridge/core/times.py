"""When: integer Unix nanoseconds, and the forms they take outside.

Rule 1: a time is an int of nanoseconds since 1970-01-01 UTC; 0 means "not set".
Rule 2: no float and no datetime is ever stored. A float loses ticks of 100 ns, a datetime loses the last digit.
Rule 3: no clock here. "Now" is read at the edge and handed in.

TwinCAT counts FILETIME ticks: 100 ns since 1601-01-01 UTC (manual 6.1.5.1). Every tick from 1970 to 2262 has an exact
nanosecond form; a nanosecond count is rounded down to its tick.
"""

import re
from datetime import UTC, datetime, timedelta
from typing import Final

NS_PER_S: Final = 1_000_000_000
FILETIME_EPOCH_S: Final = 11_644_473_600
"""Seconds from 1601-01-01 to 1970-01-01."""
MAX_TIME_NS: Final = 2**63 - 1
"""The largest time that SQLite's INTEGER and MCAP's timestamps both hold: 2262-04-11T23:47:16.854775807Z."""

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_TEXT: Final = re.compile(
    r"(\d{4})-(\d{2})-(\d{2})(?:[T ](\d{2}):(\d{2})(?::(\d{2})(?:\.(\d{1,9}))?)?(Z|[+-](?:[01]\d|2[0-3]):[0-5]\d)?)?", re.ASCII
)


class TimeError(ValueError):
    """A time that is outside 1970..2262 or that cannot be read; says what was expected."""


def check_time(time_ns: int) -> int:
    """Return time_ns unchanged; TimeError unless 0 <= time_ns <= MAX_TIME_NS."""
    if not 0 <= time_ns <= MAX_TIME_NS:
        raise TimeError(f"time {time_ns} ns is outside 0..{MAX_TIME_NS} (1970 to 2262)")
    return time_ns


def from_filetime(ticks: int) -> int:
    """FILETIME ticks of 100 ns since 1601 (UTC) as Unix ns. 0 stays 0: TwinCAT's "not set"."""
    if ticks == 0:
        return 0
    return check_time(ticks * 100 - FILETIME_EPOCH_S * NS_PER_S)


def to_filetime(time_ns: int) -> int:
    """Unix ns as FILETIME ticks of 100 ns, rounded down. 0 stays 0: "not set"."""
    if time_ns == 0:
        return 0
    return check_time(time_ns) // 100 + FILETIME_EPOCH_S * 10_000_000


def time_text(time_ns: int, digits: int = 9) -> str:
    """ISO 8601 in UTC with 0 to 9 fractional digits (cut, not rounded); "" when not set."""
    if time_ns == 0:
        return ""
    seconds, rest = divmod(time_ns, NS_PER_S)
    head = (_EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
    return f"{head}.{rest:09d}"[: 20 + digits] + "Z" if digits else f"{head}Z"


def parse_time(text: str) -> int:
    """Read "2026-11-22", "2026-11-22T08:30:00.5Z" or with "+01:00"; without a zone it is UTC. TimeError else."""
    match = _TEXT.fullmatch(text.strip())
    if match is None:
        raise TimeError(f"{text!r} is no time; expected e.g. 2026-11-22T08:30:00.123456789Z")
    year, month, day, hour, minute, second, fraction, zone = match.groups()
    try:
        moment = datetime(int(year), int(month), int(day), int(hour or 0), int(minute or 0), int(second or 0), tzinfo=UTC)
    except ValueError as error:
        raise TimeError(f"{text!r} is no time: {error}") from None
    whole = (moment - _EPOCH) // timedelta(seconds=1)
    if zone and zone != "Z":
        offset = int(zone[1:3]) * 3600 + int(zone[4:6]) * 60
        whole -= offset if zone[0] == "+" else -offset
    return check_time(whole * NS_PER_S + int((fraction or "0").ljust(9, "0")))
