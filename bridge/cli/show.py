"""How things look: lines and tables for people, plain text when nobody watches, JSON for programs.

Rule 1: colour, boxes and folding only on a terminal. Elsewhere columns are aligned with spaces and nothing is cut.
Rule 2: what comes from outside is shown, never obeyed: control and direction characters are printed as escapes.
Rule 3: JSON has the names and values of the wire, with class_name and text added; a notice has "notice" instead of "kind".
Rule 4: times are UTC. On a terminal a table drops the date when all its rows share it, and says so below.
"""

import functools
import shutil
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias, assert_never

import msgspec

from bridge.config import Loaded
from bridge.core.alarms import Alarm
from bridge.core.event_fields import alarm_state, duration_ns
from bridge.core.events import AnyEvent, ConfirmationState, Event, Severity
from bridge.core.times import time_text

if TYPE_CHECKING:
    from rich.console import Console

    from bridge.core.catalog import Catalog
    from bridge.core.questions import Stored
    from bridge.listener import Item
    from bridge.texts import Texts

STYLES: Final = {
    Severity.VERBOSE: "dim",
    Severity.INFO: "",
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
    Severity.CRITICAL: "bold white on red",
}
KIND_WORDS: Final = {
    "message_sent": "message",
    "alarm_raised": "raised",
    "alarm_cleared": "cleared",
    "alarm_confirmed": "confirmed",
    "alarm_disposed": "disposed",
}
CONFIRMATION_WORDS: Final = {
    ConfirmationState.NOT_SUPPORTED: "",
    ConfirmationState.NOT_REQUIRED: "not yet needed",
    ConfirmationState.WAIT_FOR_CONFIRMATION: "waiting",
    ConfirmationState.CONFIRMED: "confirmed",
    ConfirmationState.RESET: "reset",
}
WIDE: Final = 150
"""Columns a terminal needs for tables with all their times."""
_HOSTILE: Final = {
    code: f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"
    for code in (*range(32), *range(127, 160), 0x061C, *range(0x200E, 0x2010), *range(0x2028, 0x202F), *range(0x2066, 0x206A))
} | {ord("\n"): "\\n", ord("\t"): "\\t", ord("\r"): "\\r"}

Span: TypeAlias = tuple[str, str]
"""A text and its style."""
Cell: TypeAlias = str | Span


def clean(text: str) -> str:
    """The text with everything that a terminal would obey written as an escape; lone surrogates become "?"."""
    return text.translate(_HOSTILE).encode("utf-8", "replace").decode()


def counted(number: int, noun: str) -> str:
    """How many of something, e.g. 1 event, 2,000 events."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def on_terminal() -> bool:
    """Whether a person watches stdout."""
    return sys.stdout.isatty()


@functools.cache
def console(*, stderr: bool = False) -> "Console":
    """The terminal, opened once."""
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, markup=False, emoji=False)


def print_json(value: object) -> None:
    """One line of JSON."""
    print(msgspec.json.encode(value).decode("utf-8", "replace"), flush=True)


def print_spans(spans: Iterable[Span]) -> None:
    """One line, coloured on a terminal."""
    if on_terminal():
        from rich.text import Text

        console().print(Text.assemble(*spans), soft_wrap=True)
    else:
        print("".join(text for text, _ in spans).rstrip(), flush=True)


def print_table(headers: Sequence[str], rows: Sequence[Sequence[Cell]], *, caption: str = "", title: str = "") -> None:
    """A table; folded to the width of a terminal, else aligned and whole."""
    if on_terminal():
        from rich.table import Table
        from rich.text import Text

        table = Table(*headers, box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
        table.title, table.title_justify, table.title_style = title or None, "left", "bold"
        table.caption, table.caption_justify = caption or None, "left"
        for column, header in zip(table.columns, headers, strict=True):
            column.overflow, column.no_wrap = "fold", header in ("Severity", "Id", "Event", "State", "Confirmation")
        for row in rows:
            table.add_row(*(Text(*_span(cell)) for cell in row))
        console().print(table)
        return
    texts = [list(headers), *([_span(cell)[0] for cell in row] for row in rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(headers))]
    if title:
        print(title)
    for row in texts:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
    sys.stdout.flush()


def _span(cell: Cell) -> Span:
    return (clean(cell), "") if isinstance(cell, str) else (clean(cell[0]), cell[1])


def severity_span(severity: Severity) -> Span:
    """The severity as a word in its colour."""
    return severity.name.lower(), STYLES[severity]


def source_text(source: "Event | Alarm", known: "Catalog | None" = None, lang: str = "") -> str:
    """Where it happened: the name, in the language if a class known has it, else the object id, else the GUID."""
    if source.source_name is not None:
        return known.source_name(source.source_name, source.source_guid, lang) if known is not None else source.source_name
    if source.source_id is not None:
        return f"0x{source.source_id:08X}"
    return source.source_guid or ""


class View(NamedTuple):
    """Event classes and the language in which texts are shown; `texts` asks the bus for classes of no file."""

    catalog: "Catalog"
    lang: str
    texts: "Texts | None" = None

    def classes(self, items: "Iterable[Event | Alarm]") -> "Catalog":
        """The event classes that these items need, as far as somebody knows them."""
        return self.catalog if self.texts is None else self.texts.catalog_for(items)

    def spans(self, event: AnyEvent) -> list[Span]:
        """One event as one readable line: time, target, severity, what happened, class, id, text, source."""
        style = STYLES[event.severity]
        known = self.classes((event,))
        source = source_text(event, known, self.lang)
        head = f"{known.class_name(event.event_class, self.lang)} {event.event_id}: "
        return [
            (f"{time_text(event.time_ns, 3) or '-':24}  ", "dim"),
            (f"{clean(event.target):8}  ", "cyan"),
            (f"{event.severity.name.lower():8}", style),
            (f"  {KIND_WORDS[event.kind]:9}  ", "bold" if event.is_alarm else ""),
            (clean(head) if event.event_class in known else "", ""),
            (clean(known.event_text(event, self.lang)), style),
            (f"  [{clean(source)}]" if source else "", "dim"),
        ]

    def record(self, item: AnyEvent | Alarm) -> dict[str, object]:
        """An event or alarm for programs."""
        found: dict[str, object] = msgspec.to_builtins(item)
        known = self.classes((item,))
        found["class_name"] = known.class_name(item.event_class, self.lang)
        found["text"] = known.event_text(item, self.lang)
        return found

    def alarm_record(self, alarm: Alarm) -> dict[str, object]:
        """An alarm for programs: raised, confirmation_state and active are always there."""
        states = {"raised": alarm.raised, "confirmation_state": int(alarm.confirmation_state), "active": alarm.is_active}
        return self.record(alarm) | states

    def print_item(self, item: "Item", *, as_json: bool) -> None:
        """One thing a listener gave: an event, or a notice of what is missing."""
        if isinstance(item, Event):
            print_json(self.record(item)) if as_json else print_spans(self.spans(item))
        elif as_json:
            print_json(notice(item)[1])
        else:
            print_spans([(f"{'':24}  {clean(notice(item)[0])}", "bold magenta")])

    def print_alarms(self, alarms: Sequence[Alarm], *, title: str = "") -> None:
        """Alarms as a table."""
        day = _shared_day(time for alarm in alarms for time in _times(alarm))
        known = self.classes(alarms)
        headers = ("Severity", "State", "Confirmation", "Class", "Id", "Text", "Source", "Raised", "Cleared", "Confirmed")
        rows: list[list[Cell]] = [
            [
                severity_span(alarm.severity),
                _state(alarm),
                CONFIRMATION_WORDS[alarm.confirmation_state],
                known.class_name(alarm.event_class, self.lang),
                str(alarm.event_id),
                (clean(known.event_text(alarm, self.lang)), STYLES[alarm.severity]),
                source_text(alarm, known, self.lang),
                *(_time(time, day) for time in _times(alarm)),
            ]
            for alarm in alarms
        ]
        may_go = () if _wide() else ("Confirmation", "Source", "Raised", "Cleared", "Confirmed")
        print_table(*_without_empty(headers, rows, may_go), caption=f"times in UTC on {day}" if day else "", title=title)

    def print_log(self, entries: "Sequence[Stored]", *, occurrences: bool = False) -> None:
        """Stored events as a table; occurrences: each is an alarm's life or a message, with its state and duration."""
        wide = _wide()
        day = _shared_day(time for entry in entries for time in (entry.event.time_ns, *_times(entry.event)))
        headers = ["Time", "Severity", "Event", "Class", "Id", "Unique id", "Text", "Source"]
        if occurrences:
            headers[2:3] = ["State", "Duration"]
        known = self.classes(entry.event for entry in entries)
        rows: list[list[Cell]] = []
        for entry in entries:
            event = entry.event
            row: list[Cell] = [
                _time(event.time_ns, day),
                severity_span(event.severity),
                KIND_WORDS[event.kind],
                known.class_name(event.event_class, self.lang),
                str(event.event_id),
                str(entry.unique_id),
                (clean(known.event_text(event, self.lang)), STYLES[event.severity]),
                source_text(event, known, self.lang),
            ]
            if occurrences:
                row[2:3] = [alarm_state(event), _duration(event)]
            rows.append([*row, *(_time(time, day) for time in _times(event))] if wide else row)
        print_table(
            [*headers, "Raised", "Cleared", "Confirmed"] if wide else headers,
            rows,
            caption=f"times in UTC on {day}" if day else "",
        )


def _wide() -> bool:
    """Whether there is room for every column."""
    return not on_terminal() or shutil.get_terminal_size().columns >= WIDE


def _without_empty(
    headers: Sequence[str], rows: Sequence[Sequence[Cell]], may_go: Sequence[str]
) -> tuple[Sequence[str], list[list[Cell]]]:
    """A table without those of its columns that may go and are empty in every row."""
    kept = [n for n, header in enumerate(headers) if header not in may_go or any(row[n] for row in rows) or not rows]
    return [headers[n] for n in kept], [[row[n] for n in kept] for row in rows]


def _state(alarm: Alarm) -> str:
    state = "raised" if alarm.raised else "cleared" if alarm.was_raised else "created"
    return f"{state}, suspect" if alarm.suspect else state


def _duration(event: AnyEvent) -> str:
    lasted_ns = duration_ns(event)
    return "" if lasted_ns is None else f"{lasted_ns / 1e9:.3f} s"


def _times(item: Event | Alarm) -> tuple[int, int, int]:
    return item.time_raised_ns, item.time_cleared_ns, item.time_confirmed_ns


def _shared_day(times: Iterable[int]) -> str:
    """The one day of all times that are set, "" when there are several or when this is no terminal."""
    days = {time_text(time)[:10] for time in times if time} if on_terminal() else set()
    return days.pop() if len(days) == 1 else ""


def _time(time_ns: int, day: str) -> str:
    text = time_text(time_ns, 3)
    return text[11:-1] if day else text


def notice(item: "Item") -> tuple[str, dict[str, object]]:
    """What a listener says about what is missing or wrong: for people and for programs."""
    from bridge.inbox import Dropped
    from bridge.listener import Gap, Heard, Rejected, Snapshot, TailUnknown, TwoLoggers
    from bridge.notices import BusBack, BusLost, LoggerBack, LoggerGone, SuspectsChanged

    match item:
        case Gap(missing, reason):
            facts: dict[str, object] = {"notice": "gap", "count": missing.count, "reason": reason}
            text = f"gap: {missing.count} events of session {missing.session} on {missing.key} are lost: {reason}"
            return text, facts | {"missing": msgspec.to_builtins(missing)}
        case Dropped(count):
            return f"dropped: {count} events, this program was too slow", {"notice": "dropped", "count": count}
        case Rejected(key, raw, reason, whole):
            facts = {"notice": "rejected", "key": key, "reason": reason, "raw": raw, "whole_payload": whole}
            return f"rejected: {len(raw)} bytes on {key}: {reason}", facts
        case TailUnknown(target, session):
            facts = {"notice": "tail_unknown", "target": target, "session": session}
            return f"tail unknown: session {session} of {target} is gone without a last word", facts
        case TwoLoggers(target, sessions):
            facts = {"notice": "two_loggers", "target": target, "sessions": sessions}
            return f"two loggers of {target} answer: {', '.join(sessions)}", facts
        case BusLost():
            return "bus lost: the router does not answer", {"notice": "bus_lost"}
        case BusBack():
            return "bus back: the router answers again", {"notice": "bus_back"}
        case LoggerGone(target, session, clean):
            facts = {"notice": "logger_gone", "target": target, "session": session, "clean": clean}
            how = "has stopped" if clean else "is gone without a last word, its raised alarms are suspect"
            return f"logger gone: session {session} of {target} {how}", facts
        case LoggerBack(target, session):
            facts = {"notice": "logger_back", "target": target, "session": session}
            return f"logger back: session {session} of {target}", facts
        case SuspectsChanged(target, session, suspects):
            facts = {"notice": "suspects_changed", "target": target, "session": session}
            text = f"suspect alarms of {target} now: {len(suspects)}"
            return text, facts | {"suspects": [msgspec.to_builtins(key) for key in suspects]}
        case Event() | Heard() | Snapshot():
            raise TypeError("an event is no notice")
        case _:
            assert_never(item)


def print_settings(loaded: Loaded, *, as_json: bool) -> None:
    """Every setting, its value and where it came from."""
    if as_json:
        for name, origin in loaded.origins.items():
            print_json({"setting": name, "value": getattr(loaded.settings, name), "origin": origin})
    else:
        print_table(("Setting", "Value", "From"), loaded.rows())
