"""`tcbridge cat`: recordings as text."""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.options import TEXTS_ONLY, Texts, note
from bridge.cli.recordings import WHICH, Which, known_classes, recordings, tell_damages
from bridge.cli.show import View, clean, print_json, print_spans
from bridge.core.times import time_text

if TYPE_CHECKING:
    from bridge.core.csv_export import CsvSettings
    from bridge.core.questions import Stored
    from bridge.edges.recording import Recorded

FORM = Group("Form", sort_key=11)


def cat(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", help="Recordings, or folders of them.", negative=(), required=True)
    ],
    /,
    *,
    csv: Annotated[bool, Parameter(help="As CSV: the events, without the numbers of a log.", group=FORM)] = False,
    which: Which = WHICH,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Print what stands in recordings, as it stands there.

    One line for each event, gap, rejected payload and keyframe, in the order in
    which they were recorded; several files are one, and an event that is in more
    than one of them is printed once. With --json one object per line. Texts are
    those of --classes, else of the classes that the recordings carry. What a
    logger makes of it (lives of alarms, sorting, columns) is export's. Exit code
    3: a file is damaged, and what could be read of it was printed.

    Try:
        tcbridge cat plant.mcap --filter "severity >= error"
        tcbridge cat night/ --start 2026-11-22T03:00:00Z --duration 60 --json
        tcbridge cat plant.mcap --csv --target plc1
    """
    from bridge.core import csv_export
    from bridge.edges.recording import carried, read_series

    settings = common.load()
    paths = recordings(files)
    view = View(known_classes([carried(path) for path in paths], settings), settings.lang)
    part = which.part(paths, view.catalog, ("events",) if csv else None)
    with read_series(paths, part) as series:
        if csv:
            sys.stdout.reconfigure(encoding="utf-8", errors="replace", newline="")  # type: ignore[union-attr]
            sys.stdout.writelines(csv_export.export_csv(_stored(series), view.catalog, _columns(settings.lang)))
        else:
            for item in series:
                _print(item, view, as_json=common.json)
        if not part.is_all:
            for path, reason in series.read_through.items():
                note(f"{path}: read from end to end: {reason}")
        return tell_damages(series.damages)


def _columns(lang: str) -> "CsvSettings":
    from bridge.core.csv_export import DEFAULT_COLUMNS, CsvSettings
    from bridge.core.event_fields import EventField

    return CsvSettings(language=lang, columns=tuple(each for each in DEFAULT_COLUMNS if each.field is not EventField.ID))


def _stored(items: "Iterable[Recorded]") -> "Iterator[Stored]":
    from bridge.core.questions import Stored
    from bridge.edges.recording import RecordedEvent

    for item in items:
        if isinstance(item, RecordedEvent):
            yield Stored(event=item.event, arrival_ns=item.log_time_ns)


def _print(item: "Recorded", view: View, *, as_json: bool) -> None:
    from bridge.edges.recording import RecordedEvent, RecordedGap, RecordedRejected

    logged = {"log_time_ns": item.log_time_ns}
    match item:
        case RecordedEvent(event=event):
            if as_json:
                print_json(logged | {"realm": item.realm} | view.record(event))
            else:
                print_spans(view.spans(event))
            return
        case RecordedGap(gap=gap):
            facts = {"notice": "gap"} | msgspec.to_builtins(gap)
            where = f" of session {gap.session} on {gap.key}" if gap.session else ""
            text = f"gap: {gap.count:,} events{where} are missing: {gap.reason or 'lost'}"
        case RecordedRejected(rejected=rejected):
            facts = {"notice": "rejected"} | msgspec.to_builtins(rejected)
            text = f"rejected: {rejected.size:,} bytes on {rejected.key}: {rejected.reason}"
        case _:
            state = item.state
            facts = {"notice": "keyframe"} | msgspec.to_builtins(state)
            active = sum(alarm.is_active for alarm in state.alarms)
            text = f"keyframe: {state.target} has {len(state.alarms):,} alarms, {active:,} of them active"
    if as_json:
        print_json(logged | facts)
    else:
        print_spans([(f"{time_text(item.log_time_ns, 3):24}  {clean(text)}", "bold magenta")])
