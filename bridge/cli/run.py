"""`tcbridge run`: a whole plant from one file."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Group, Parameter

from bridge import config
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus
from bridge.cli.show import print_json, print_settings
from bridge.cli.signals import Interrupted, wait_for_signal

if TYPE_CHECKING:
    from bridge.core.events import MessageSent
    from bridge.core.module_instances import Plant
    from bridge.core.tmc import Problem

PLANT: Final = Group("Plant", sort_key=10)


def run(
    plant: Annotated[Path, Parameter(name="PLANT", help="A TOML file with [settings] and [[modules]].")],
    /,
    *,
    check: Annotated[bool, Parameter(help="Look for faults in PLANT, and start nothing.", group=PLANT)] = False,
    modules_access: Annotated[config.ModulesAccess | None, Parameter(help=config.HELP["modules_access"], group=PLANT)] = None,
    common: Common = COMMON,
) -> int:
    """Run loggers, recorders, sinks, listeners and modules of your own until stopped.

    They come up in order, whoever is needed first. A module that fails stays
    where it got to; those that need it wait, the others run. Stopping takes all
    down in reverse, the logger last. Each step is an event of the class
    TcBridge. [settings] of PLANT stand in the place of tcbridge.toml.

    Exit code 1: a module was not up, or failed while stopping, or the target is
    served already. 2: faults in PLANT, each with its line. 3: something was not
    sent or recorded.

    Try:
        tcbridge run plant.toml
        tcbridge run plant.toml --check
    """
    from bridge.core.module_instances import PlantError, read_plant
    from bridge.host import Host, Surroundings, make_plan
    from bridge.tccom.factories import Factories

    factories = Factories()
    if common.settings is not None:
        raise Usage("--settings: a plant's settings stand in its own file")
    if not plant.exists():
        raise Usage(f"{plant}: no such file")
    read = read_plant(plant.read_bytes(), str(plant))
    faults = list(_faulty_settings(read))
    try:
        plan = make_plan(read, factories)
    except PlantError as error:
        faults += () if common.show_settings else error.problems
    if faults:
        raise PlantError(sorted(faults, key=lambda each: each.line))
    loaded = config.load(common.given() | {"modules_access": modules_access}, os.environ, plant, table=read.settings)
    if common.show_settings:
        print_settings(loaded, as_json=common.json)
        return Exit.OK
    settings = loaded.settings
    if check:
        if common.json:
            print_json({"plant": str(plant), "modules": [each.name for each in plan.modules]})
        else:
            print(f"{plant}: {len(plan.modules):,} modules, no faults; they start as {', '.join(e.name for e in plan.modules)}")
        return Exit.OK
    known = catalog(settings)
    not_up: tuple[str, ...] = ()
    host: Host | None = None
    with open_bus(settings) as bus:
        around = Surroundings(bus, settings, known, folder=plant.parent, plant=plant, told=note)
        try:
            with Host(plan, around, factories, told=_teller(common.json)) as host:
                host.start()
                not_up = host.not_up()
                if common.json:
                    print_json({"ready": "plant", "target": host.target, "realm": settings.realm, "not_up": not_up})
                else:
                    missing = f", not up: {', '.join(not_up)}" if not_up else ""
                    print(
                        f"plant {host.target} in realm {settings.realm} is ready: {len(plan.modules):,} modules{missing}",
                        flush=True,
                    )
                try:
                    wait_for_signal()
                finally:
                    not_up = host.not_up()
        except Interrupted:
            pass
    not_ended = () if host is None else host.not_ended()
    if common.json:
        facts = {"lost": around.lost, "not_up": not_up, "not_ended": not_ended}
        print_json({"stopped": "plant", "target": settings.one_target, **facts})
    else:
        print(f"plant {settings.one_target} stopped", flush=True)
    return Exit.LOST if around.lost else Exit.NO if not_up or not_ended else Exit.OK


def _faulty_settings(plant: "Plant") -> "Iterator[Problem]":
    """What the settings of the plant's file have wrong."""
    from bridge.core import toml_text

    for name, value in plant.settings.items():
        if name not in config.HELP:
            yield plant.problem(None, toml_text.unknown_key(name, config.HELP), name)
            continue
        try:
            config.check(name, value, "")
        except config.SettingsError as error:
            yield plant.problem(None, f"{name}: {error.message}", name)


def _teller(as_json: bool) -> "Callable[[MessageSent], None]":
    """Says each step as JSON, or what went wrong to a person."""
    from bridge.core.catalog import Catalog
    from bridge.core.events import Severity
    from bridge.core.own_events import OWN_EVENTS

    texts = Catalog([OWN_EVENTS])

    def tell(event: "MessageSent") -> None:
        text = texts.event_text(event)
        if as_json:
            severity = event.severity.name.lower()
            print_json({"module": event.source_name, "object_id": event.source_id, "severity": severity, "text": text})
        elif event.severity >= Severity.WARNING:
            note(text)

    return tell
