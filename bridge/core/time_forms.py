"""How exported times are written: the six forms of TcExportTimeFormat, in UTC or local time, with a precision.

| form                 | example                           | what counts for it                    |
|----------------------|-----------------------------------|---------------------------------------|
| filetime             | 134397648005000000                | nothing: always UTC, ticks of 100 ns  |
| iso8601              | 2026-11-22T08:00:00.500Z          | zone, precision                       |
| iec_date_and_time    | DT#2026-11-22-08:00:00.500        | zone, precision                       |
| variant_time         | 46348.333339120371                | zone; days since 1899-12-30           |
| localized            | 22.11.2026 08:00:00.500           | zone, precision, language             |
| custom               | what the pattern says             | zone, pattern (as strftime)           |

Rule 1: a time that is not set is "" in every form.
Rule 2: precision -1 writes as many digits as the time has; else so many digits, cut and not rounded.
Rule 3: no time zone is known here. The caller says how far local time is from UTC at an instant; None is UTC.
Rule 4: names of months and days in a pattern are English unless the process has set another locale.

Source: TcExportTimeFormat, TcExportTimeType, TcExportTimePrecision (library 3.1.27).
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from enum import IntEnum
from typing import Final

import msgspec

from bridge.core.catalog import ENGLISH, Language, language_id
from bridge.core.times import NS_PER_S, to_filetime


class TimeForm(IntEnum):
    """TcExportTimeFormat."""

    FILETIME = 0
    ISO8601 = 1
    IEC_DATE_AND_TIME = 2
    VARIANT_TIME = 3
    LOCALIZED = 4
    CUSTOM = 5


PRECISIONS: Final = {"floating": -1, "seconds": 0, "milliseconds": 3, "microseconds": 6, "ticks": 7, "nanoseconds": 9}
"""TcExportTimePrecision; its name for 7 is OneHundertNanoseconds."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_VARIANT_EPOCH_DAYS: Final = 25_569
"""Days from 1899-12-30 to 1970-01-01."""
_DAY_NS: Final = 86_400 * NS_PER_S
_DATES: Final = {
    1031: "%d.%m.%Y %H:%M:%S",
    1033: "%m/%d/%Y %I:%M:%S{} %p",
    2057: "%d/%m/%Y %H:%M:%S",
    1036: "%d/%m/%Y %H:%M:%S",
    3082: "%d/%m/%Y %H:%M:%S",
    1040: "%d/%m/%Y %H:%M:%S",
    1043: "%d-%m-%Y %H:%M:%S",
    1041: "%Y/%m/%d %H:%M:%S",
    2052: "%Y/%m/%d %H:%M:%S",
    1045: "%d.%m.%Y %H:%M:%S",
    1049: "%d.%m.%Y %H:%M:%S",
    1046: "%d/%m/%Y %H:%M:%S",
}
"""How a language writes a time, {} being the place of the fraction (else the end). Others write %Y-%m-%d %H:%M:%S."""


class TimeStyle(msgspec.Struct, frozen=True):
    """How times are written.

    offset_s gives the seconds that local time is ahead of UTC at a Unix second; None is UTC. ValueError for a precision that is
    none, and for a custom form without a pattern.
    """

    form: TimeForm = TimeForm.ISO8601
    precision: int = -1
    language: Language = ENGLISH
    pattern: str = ""
    offset_s: Callable[[int], int] | None = None

    def __post_init__(self) -> None:
        if self.precision not in PRECISIONS.values():
            raise ValueError(f"precision {self.precision} is none of {', '.join(map(str, PRECISIONS.values()))}")
        if (self.form is TimeForm.CUSTOM) != bool(self.pattern):
            raise ValueError("a pattern belongs to the form custom, and custom needs one")
        language_id(self.language)

    def text(self, time_ns: int) -> str:
        """The time as it is written; "" when it is not set."""
        if not time_ns:
            return ""
        if self.form is TimeForm.FILETIME:
            return str(to_filetime(time_ns))
        second, rest = divmod(time_ns, NS_PER_S)
        ahead = 0 if self.offset_s is None else self.offset_s(second)
        fraction = f"{rest:09d}"[: self.precision] if self.precision >= 0 else f"{rest:09d}".rstrip("0")
        fraction = f".{fraction}" if fraction else ""
        if self.form is TimeForm.VARIANT_TIME:
            return repr(_VARIANT_EPOCH_DAYS + (time_ns + ahead * NS_PER_S) / _DAY_NS)
        moment = _EPOCH + timedelta(seconds=second + ahead)
        match self.form:
            case TimeForm.ISO8601:
                return f"{moment:%Y-%m-%dT%H:%M:%S}{fraction}{'Z' if self.offset_s is None else _zone(ahead)}"
            case TimeForm.IEC_DATE_AND_TIME:
                return f"DT#{moment:%Y-%m-%d-%H:%M:%S}{fraction}"
            case TimeForm.LOCALIZED:
                pattern = _DATES.get(language_id(self.language), "%Y-%m-%d %H:%M:%S")
                whole = moment.strftime(pattern)
                return whole.replace("{}", fraction) if "{}" in pattern else whole + fraction
        return moment.replace(tzinfo=timezone(timedelta(seconds=ahead))).strftime(self.pattern)


def _zone(ahead_s: int) -> str:
    sign, minutes = ("-" if ahead_s < 0 else "+"), abs(ahead_s) // 60
    return f"{sign}{minutes // 60:02d}:{minutes % 60:02d}"
