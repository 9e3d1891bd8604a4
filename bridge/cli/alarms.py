"""`tcbridge alarms`: the alarms of a logger, now or as they change, and those of a recording at a moment."""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, parse_filter
from bridge.cli.recordings import known_classes, recordings, tell_damages
from bridge.cli.show import View, console, on_terminal, print_json
from bridge.cli.signals import Interrupted
from bridge.config import Settings
from bridge.core import keys
from bridge.core.alarms import Alarm
from bridge.core.times import time_text

if TYPE_CHECKING:
    from bridge.core.filters.ast import Expr
    from bridge.edges.bus import Bus
    from bridge.listener import Listener

SHOWN = Group("Shown", sort_key=10)
_STEP_S = 0.02


def alarms(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", help="Of recordings instead: files, or folders.", negative=())
    ] = (),
    /,
    *,
    at: Annotated[
        str | None, Parameter(help="When in the recordings: seconds, or a time. Default: the end.", group=SHOWN)
    ] = None,
    all: Annotated[bool, Parameter(help="Also those that are no longer active.", group=SHOWN)] = False,
    filter: Annotated[str, Parameter(help="Which alarms, e.g. 'is_wait_for_confirmation'.", group=SHOWN)] = "",
    watch: Annotated[bool, Parameter(help="Stay, and show them anew when they change.", group=SHOWN)] = False,
    wait: Annotated[float, Parameter(help="Seconds to wait for a logger.", group=SHOWN, show_default=True)] = 3.0,
    common: Common = COMMON,
) -> int:
    """Show the alarms of a logger as they are, or as they were in a recording.

    Active ones: raised, or waiting for confirmation. Without --target those of
    every logger that answers. Exit code 4: none does. Texts are in --lang: from
    --classes, else from whoever offers the class, or from the recording. Of a
    recording: exit code 3 when events are missing that may have changed them.

    Try:
        tcbridge alarms --classes examples/plant.tmc --lang de
        tcbridge alarms --filter "is_wait_for_confirmation" --watch
        tcbridge alarms night.mcap --at 2026-11-22T03:12:00Z
    """
    from bridge.listener import Listener
    from bridge.logger import NoLoggerError
    from bridge.texts import Texts

    settings = common.load()
    if files:
        if watch:
            raise Usage("--watch is for loggers; a recording does not change")
        return _recorded(files, at, filter, settings, all=all, as_json=common.json)
    if at is not None:
        raise Usage("--at is for recordings; name one")
    known = catalog(settings)
    with open_bus(settings) as bus, Texts(bus, realm=settings.realm, catalog=known) as texts:
        expr = parse_filter(filter, known, texts.guids)
        view = View(known, settings.lang, texts)
        if not _logger_there(bus, settings, wait):
            raise NoLoggerError(settings.target or "any target", f"in realm {settings.realm}")
        with Listener(bus, realm=settings.realm, target=settings.target or None, with_state=True) as listener:
            if not listener.snapshot():
                raise NoLoggerError(settings.target or "any target", "@state")
            _show(view, _chosen(_known(listener), expr, all=all), as_json=common.json)
            if watch:
                _watch(view, listener, expr, all=all, as_json=common.json)
    return Exit.OK


def _logger_there(bus: "Bus", settings: Settings, wait_s: float) -> bool:
    """Wait until the logger of the target is there; without a target, until all who may turn up have had their time."""
    place = keys.verb_key(settings.realm, settings.target or None, "@alive", "logger", None)
    deadline = time.monotonic() + wait_s
    while True:
        found = bus.who_is_alive(place, timeout_s=0.5)
        if found and (settings.target or not bus.undiscovered_s()):
            return True
        if time.monotonic() >= deadline:
            return bool(found)
        time.sleep(_STEP_S)


def _recorded(files: tuple[Path, ...], at: str | None, filter: str, settings: Settings, *, all: bool, as_json: bool) -> int:
    """The alarms at a moment of recordings."""
    from bridge.edges.recording import carried, standing_at
    from bridge.replayer import span_of

    paths = recordings(files)
    known = known_classes([carried(path) for path in paths], settings)
    expr = parse_filter(filter, known)
    span = span_of(paths)
    at_ns = span.last_ns if at is None else span.place(at)
    if at_ns < span.first_ns:
        raise Usage(f"{time_text(at_ns)} is before the recording, which begins at {time_text(span.first_ns)}")
    if at_ns > span.last_ns:
        note(f"the recording ends at {time_text(span.last_ns)}; what was later is not known")
    standing = standing_at(paths, at_ns)
    there = [alarm for alarm in standing.alarms() if settings.target in ("", alarm.target)]
    title = f"alarms at {time_text(at_ns)} ({span.offset_s(at_ns):g} s)"
    _show(View(known, settings.lang), _chosen(there, expr, all=all), as_json=as_json, title=title)
    if standing.missing:
        note(f"{standing.missing:,} events are missing since the last keyframe; the alarms may have been others")
    return tell_damages(standing.damages) or (Exit.LOST if standing.missing else Exit.OK)


def _known(listener: "Listener") -> list[Alarm]:
    return [alarm for state in listener.snapshot() for alarm in state.alarms]


def _chosen(known: Iterable[Alarm], expr: "Expr", *, all: bool) -> list[Alarm]:
    from bridge.core.filters.predicate import compile_filter

    matches = compile_filter(expr)
    found = [alarm for alarm in known if (all or alarm.is_active) and matches(alarm)]
    return sorted(found, key=lambda alarm: (-alarm.severity, -alarm.time_ns))


def _show(view: View, found: list[Alarm], *, as_json: bool, title: str = "") -> None:
    if as_json:
        for alarm in found:
            print_json(view.alarm_record(alarm))
    else:
        view.print_alarms(found, title=title)


def _watch(view: View, listener: "Listener", expr: "Expr", *, all: bool, as_json: bool) -> None:
    """Show the alarms again after each change, until a signal comes."""
    before = _chosen(_known(listener), expr, all=all)
    try:
        while listener.get() is not None:
            while listener.get(0) is not None:
                pass
            found = _chosen(_known(listener), expr, all=all)
            if found == before:
                continue
            if as_json:
                gone = {alarm.key for alarm in before} - {alarm.key for alarm in found}
                for alarm in found:
                    if alarm not in before:
                        print_json(view.alarm_record(alarm))
                for key in sorted(gone, key=repr):
                    print_json({"gone": key})
            else:
                if on_terminal():
                    console().clear()
                else:
                    print()
                view.print_alarms(found)
            before = found
    except Interrupted:
        return
