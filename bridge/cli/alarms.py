"""`tcbridge alarms`: the alarms of a logger, now or as they change."""

import time
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, catalog, open_bus, parse_filter
from bridge.cli.show import View, console, on_terminal, print_json
from bridge.cli.signals import Interrupted
from bridge.config import Settings
from bridge.core import keys
from bridge.core.alarms import Alarm

if TYPE_CHECKING:
    from bridge.core.filters.ast import Expr
    from bridge.edges.bus import Bus
    from bridge.listener import Listener

SHOWN = Group("Shown", sort_key=10)
_STEP_S = 0.02


def alarms(
    *,
    all: Annotated[bool, Parameter(help="Also those that are no longer active.", group=SHOWN)] = False,
    filter: Annotated[str, Parameter(help="Which alarms, e.g. 'is_wait_for_confirmation'.", group=SHOWN)] = "",
    watch: Annotated[bool, Parameter(help="Stay, and show them anew when they change.", group=SHOWN)] = False,
    wait: Annotated[float, Parameter(help="Seconds to wait for a logger.", group=SHOWN, show_default=True)] = 3.0,
    common: Common = COMMON,
) -> int:
    """Show the alarms of a logger as they are.

    Active ones: raised, or waiting for confirmation. Without --target those of
    every logger that answers. Exit code 4: none does. Texts are in --lang: from
    --classes, else from whoever offers the class.

    Try:
        tcbridge alarms --classes examples/plant.tmc --lang de
        tcbridge alarms --filter "is_wait_for_confirmation" --watch
    """
    from bridge.listener import Listener
    from bridge.logger import NoLoggerError
    from bridge.texts import Texts

    settings = common.load()
    known = catalog(settings)
    expr = parse_filter(filter, known)
    with open_bus(settings) as bus, Texts(bus, realm=settings.realm, catalog=known) as texts:
        view = View(known, settings.lang, texts)
        if not _logger_there(bus, settings, wait):
            raise NoLoggerError(settings.target or "any target", f"in realm {settings.realm}")
        with Listener(bus, realm=settings.realm, target=settings.target or None, with_state=True) as listener:
            if not listener.snapshot():
                raise NoLoggerError(settings.target or "any target", "@state")
            _show(view, _chosen(listener, expr, all=all), as_json=common.json)
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


def _chosen(listener: "Listener", expr: "Expr", *, all: bool) -> list[Alarm]:
    from bridge.core.filters.predicate import compile_filter

    matches = compile_filter(expr)
    found = [alarm for state in listener.snapshot() for alarm in state.alarms if (all or alarm.is_active) and matches(alarm)]
    return sorted(found, key=lambda alarm: (-alarm.severity, -alarm.time_ns))


def _show(view: View, found: list[Alarm], *, as_json: bool) -> None:
    if as_json:
        for alarm in found:
            print_json(view.alarm_record(alarm))
    else:
        view.print_alarms(found)


def _watch(view: View, listener: "Listener", expr: "Expr", *, all: bool, as_json: bool) -> None:
    """Show the alarms again after each change, until a signal comes."""
    before = _chosen(listener, expr, all=all)
    try:
        while listener.get() is not None:
            while listener.get(0) is not None:
                pass
            found = _chosen(listener, expr, all=all)
            if found == before:
                continue
            if as_json:
                gone = {alarm.key for alarm in before} - {alarm.key for alarm in found}
                for alarm in found:
                    if alarm not in before:
                        print_json(view.alarm_record(alarm))
                for key in sorted(gone):
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
