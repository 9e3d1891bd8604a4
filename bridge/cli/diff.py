"""`tcbridge diff`: the same run on two versions, compared."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import TEXTS_ONLY, Texts, parse_filter
from bridge.cli.progress import Show, counting
from bridge.cli.recordings import count_events, known_classes, recordings, tell_damages
from bridge.cli.show import Cell, View, print_json, print_table, severity_span, source_text
from bridge.core.times import NS_PER_S, time_text

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.core.filters.ast import Expr
    from bridge.core.runs import CountDifference, Difference, Life, Run

HOW: Final = Group("Comparison", sort_key=10)
_STEP: Final = 1000


def diff(
    first: Annotated[Path, Parameter(name="FIRST", help="A recording, or a folder of one in several files.")],
    second: Annotated[Path, Parameter(name="SECOND", help="What is compared with it.")],
    /,
    *,
    tolerance: Annotated[
        float, Parameter(help="Seconds that starts and lengths may differ.", group=HOW, show_default=True)
    ] = 1.0,
    align: Annotated[
        str, Parameter(help="Times count from the first event that this filter takes. Default: the first event.", group=HOW)
    ] = "",
    filter: Annotated[str, Parameter(help="Which events, e.g. 'is_alarm'. Default: all.", group=HOW)] = "",
    common: Texts = TEXTS_ONLY,
) -> int:
    """Compare two recordings of the same run.

    Says which lives of alarms are new, gone, later, earlier, longer or shorter in
    SECOND by more than the tolerance, which were not cleared, and which messages
    came more or less often. Times are the events' own, counted from the first
    event of each run, or from that of --align. Exit code 0: no difference, 1:
    differences, 3: none was found, but a file is damaged.

    Try:
        tcbridge diff version1.mcap version2.mcap
        tcbridge diff monday/ tuesday/ --align "event_id = 1" --filter is_alarm
    """
    from bridge.core.runs import alarm_differences, message_differences
    from bridge.edges.recording import carried

    settings = common.load()
    if not 0 <= tolerance < float("inf"):
        raise Usage(f"--tolerance {tolerance} is no time")
    sides = [recordings([first]), recordings([second])]
    known = known_classes([carried(path) for side in sides for path in side], settings)
    expr, zero = parse_filter(filter, known), parse_filter(align, known) if align else None
    done = 0
    damaged = Exit.OK
    runs = []
    with counting("read", sum(map(count_events, sides))) as show:
        for side in sides:
            run, code, done = _run(side, expr, zero, done, show)
            damaged = damaged or code
            runs.append(run)
    one, other = runs
    alarms = alarm_differences(one, other, int(tolerance * NS_PER_S))
    messages = message_differences(one, other)
    if common.json:
        for alarm in alarms:
            print_json(_record(alarm, known, settings.lang))
        for count in messages:
            print_json({"what": "count"} | msgspec.to_builtins(count))
    else:
        _print(alarms, messages, (one, other), View(known, settings.lang))
    return Exit.NO if alarms or messages else damaged


def _run(side: list[Path], expr: "Expr", zero: "Expr | None", done: int, show: Show) -> "tuple[Run, Exit, int]":
    from bridge.core.filters.ast import Everything
    from bridge.core.filters.predicate import compile_filter
    from bridge.core.runs import Run
    from bridge.edges.recording import Part, RecordedEvent, RecordedState, read_series

    run = Run(0 if zero is None else _zero(side, zero))
    matches = compile_filter(expr)
    part = Part(filter=None if isinstance(expr, Everything) else expr, only=frozenset(("events", "states")))
    with read_series(side, part) as series:
        for item in series:
            match item:
                case RecordedEvent(event=event):
                    run.event(event)
                    done += 1
                    if done % _STEP == 0:
                        show(done)
                case RecordedState(state=state):
                    run.state(alarm for alarm in state.alarms if matches(alarm))
                case _:
                    pass
        return run, tell_damages(series.damages), done


def _zero(side: list[Path], zero: "Expr") -> int:
    from bridge.edges.recording import Part, RecordedEvent, read_series

    with read_series(side, Part(filter=zero, only=frozenset(("events",)))) as series:
        for item in series:
            if isinstance(item, RecordedEvent) and item.event.time_ns:
                return item.event.time_ns
    raise Usage(f"--align: {', '.join(map(str, side))} has no such event")


def _record(found: "Difference", known: "Catalog", lang: str) -> dict[str, object]:
    life = found.second or found.first
    facts: dict[str, object] = {"what": found.what} | msgspec.to_builtins(found.key)
    facts |= {"occurrence": found.occurrence, "by_ns": found.by_ns}
    for side, of in (("first", found.first), ("second", found.second)):
        facts[side] = None if of is None else {"start_ns": of.start_ns, "end_ns": of.end_ns}
    if life is not None:
        facts |= {
            "severity": int(life.last.severity),
            "class_name": known.class_name(found.key.event_class, lang),
            "text": known.event_text(life.last, lang),
        }
    return facts


def _print(alarms: "list[Difference]", messages: "list[CountDifference]", runs: "tuple[Run, Run]", view: View) -> None:
    if not alarms and not messages:
        print("no difference")
        return
    if alarms:
        rows = [_row(found, view) for found in alarms]
        headers = ("Alarm is", "By", "Severity", "Class", "Id", "Text", "Source", "Which", "First", "Second")
        print_table(headers, rows, caption=f"seconds from {' and '.join(time_text(run.zero_ns, 3) or '-' for run in runs)}")
    if messages:
        if alarms:
            print()
        samples = runs[0].samples | runs[1].samples
        counts: list[list[Cell]] = []
        for count in messages:
            event = samples[count.target, count.event_class, count.event_id]
            name = view.catalog.class_name(count.event_class, view.lang)
            text = view.catalog.event_text(event, view.lang)
            row: list[Cell] = [count.target, severity_span(event.severity), name, str(count.event_id), text]
            counts.append([*row, f"{count.first:,}", f"{count.second:,}"])
        print_table(("Target", "Severity", "Class", "Id", "One of them", "First", "Second"), counts)


def _row(found: "Difference", view: View) -> list[Cell]:
    life = found.second or found.first
    assert life is not None
    last = life.last
    return [
        found.what,
        f"{found.by_ns / NS_PER_S:.3f} s" if found.by_ns else "",
        severity_span(last.severity),
        view.catalog.class_name(found.key.event_class, view.lang),
        str(found.key.event_id),
        view.catalog.event_text(last, view.lang),
        source_text(last, view.catalog, view.lang),
        str(found.occurrence),
        _times(found.first),
        _times(found.second),
    ]


def _times(life: "Life | None") -> str:
    if life is None:
        return "-"
    return f"{_seconds(life.start_ns, 'before')} to {_seconds(life.end_ns, 'the end')}"


def _seconds(time_ns: int | None, unknown: str) -> str:
    return unknown if time_ns is None else f"{time_ns / NS_PER_S:.3f}"
