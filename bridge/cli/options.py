"""Options that commands share, and what they become: settings, a bus, a catalog, a filter.

Rule 1: an option that is not given is None here, so that environment and file can speak (bridge/config.py).
Rule 2: dataclasses, because the parser flattens them into options and does not know other structs.
"""

import getpass
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Group, Parameter

from bridge import config
from bridge.cli.exits import Exit, Usage

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.core.filters.ast import Expr
    from bridge.edges.bus import Bus, BusConfig

TEXTS: Final = Group("Texts", sort_key=20)
BUS: Final = Group("Bus", sort_key=30)
PROGRAM: Final = Group("Settings and output", sort_key=40)


def _setting(name: str, group: Group, *, metavar: str | None = None, negative: tuple[str, ...] = ()) -> Parameter:
    return Parameter(help=config.HELP[name], group=group, metavar=metavar, negative=negative)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Basic:
    """Options of every command."""

    settings: Annotated[
        Path | None, Parameter(help=f"Settings file. Default: {config.FILE_NAME} here, if there is one.", group=PROGRAM)
    ] = None
    show_settings: Annotated[
        bool, Parameter(help="Print every setting and where it came from, and do nothing else.", group=PROGRAM)
    ] = False
    json: Annotated[bool, Parameter(help="For programs: JSON, one object per line.", group=PROGRAM)] = False

    def loaded(self, **more: object) -> config.Loaded:
        """The settings and their origins, with options of one command beside the shared ones."""
        return config.load(self.given() | more, os.environ, self.settings)

    def given(self) -> dict[str, object]:
        """The settings that are options of this command; None where one was not given."""
        return {field.name: _plain(getattr(self, field.name)) for field in fields(self) if field.name in config.HELP}

    def load(self, **more: object) -> config.Settings:
        """The settings; with --show-settings prints them and ends."""
        loaded = self.loaded(**more)
        if self.show_settings:
            from bridge.cli.show import print_settings

            print_settings(loaded, as_json=self.json)
            raise SystemExit(Exit.OK)
        return loaded.settings


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Texts(Basic):
    """Options of commands that show events or read names of event classes."""

    lang: Annotated[str | None, _setting("lang", TEXTS)] = None
    classes: Annotated[tuple[Path, ...], _setting("classes", TEXTS)] = ()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Network(Basic):
    """Options of commands that open the bus."""

    connect: Annotated[tuple[str, ...], _setting("connect", BUS)] = ()
    listen: Annotated[tuple[str, ...], _setting("listen", BUS)] = ()
    config: Annotated[Path | None, _setting("config", BUS)] = None
    lan: Annotated[bool | None, _setting("lan", BUS, negative=("--no-lan",))] = None
    scouting_group: Annotated[str | None, _setting("scouting_group", BUS, metavar="HOST:PORT")] = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Common(Texts, Network):
    """Options of commands that meet others on the bus."""

    target: Annotated[str | None, _setting("target", BUS)] = None
    realm: Annotated[str | None, _setting("realm", BUS)] = None


BASIC: Final = Basic()
TEXTS_ONLY: Final = Texts()
NETWORK: Final = Network()
COMMON: Final = Common()
REALM: Final = _setting("realm", BUS)
LANG: Final = _setting("lang", TEXTS)


def _plain(value: object) -> object:
    match value:
        case Path():
            return str(value)
        case tuple():
            return tuple(map(str, value))
        case _:
            return value


def note(text: str) -> None:
    """Tell a person something that is not the result: on stderr."""
    print(text, file=sys.stderr, flush=True)


def bus_config(settings: config.Settings, mode: str = "peer") -> "BusConfig":
    """How these settings reach the bus."""
    from bridge.edges.bus import BusConfig

    return BusConfig(
        mode=mode,
        connect=settings.connect,
        listen=settings.listen,
        lan=settings.lan,
        scouting_group=settings.scouting_group,
        config=settings.config or None,
    )


def open_bus(settings: config.Settings) -> "Bus":
    """The bus these settings name."""
    from bridge.edges import bus

    return bus.open_bus(bus_config(settings))


def catalog(settings: config.Settings) -> "Catalog":
    """The built-in event classes and those of the settings, which win; what is wrong in files is told and the rest is used."""
    from bridge.core.builtin import builtin_catalog
    from bridge.core.own_events import OWN_EVENTS
    from bridge.edges.class_files import load_catalog

    try:
        found, problems = load_catalog(settings.classes)
    except OSError as error:
        raise Usage(f"--classes: {error.filename}: {error.strerror or error}") from None
    for problem in problems:
        note(f"warning: {problem}")
    return builtin_catalog().merged((OWN_EVENTS,)).merged(found)


def parse_filter(text: str | None, known: "Catalog", resolve_class: Callable[[str], Sequence[str]] | None = None) -> "Expr":
    """The filter of a text; old versions of classes that it names are told on stderr.

    resolve_class finds the GUIDs of a class name, in the catalog unless it is given. What the manual answers with an HRESULT is
    wrong usage here.
    """
    from bridge.core.filters.hidden import hidden_in
    from bridge.core.filters.text import parse
    from bridge.core.hresult import AdsError

    try:
        expr = parse(text or "", resolve_class=resolve_class or known.guids)
    except AdsError as error:
        raise Usage(f"filter refused: {error}") from None
    for hidden in hidden_in(expr, known):
        note(f"warning: {hidden}")
    return expr


def operator(settings: config.Settings) -> str:
    """Who gives a command."""
    if settings.operator:
        return settings.operator
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user without a name
        return str(os.getuid())
