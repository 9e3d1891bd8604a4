"""`tcbridge serve`: the logger of a target, alone in a program."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Group, Parameter

from bridge import config
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted, wait_for_signal
from bridge.config import HELP, Settings

if TYPE_CHECKING:
    from bridge.edges.cache import Cache
    from bridge.logger import LoggerCounters

LOGGER = Group("Logger", sort_key=10)
CLOSE_S = 1.5
"""What closing may take, so that the program ends within 3 s of a signal."""


def serve(
    *,
    cache: Annotated[Path | None, Parameter(help=HELP["cache"], group=LOGGER)] = None,
    max_size: Annotated[int | None, Parameter(help=HELP["max_size"], group=LOGGER)] = None,
    max_events: Annotated[int | None, Parameter(help=HELP["max_events"], group=LOGGER)] = None,
    max_age: Annotated[float | None, Parameter(help=HELP["max_age"], group=LOGGER)] = None,
    move_aside_bad_cache: Annotated[
        bool, Parameter(help="Rename a cache file that is damaged or another program's, and begin a new one.", group=LOGGER)
    ] = False,
    durable: Annotated[bool | None, Parameter(help=HELP["durable"], group=LOGGER, negative="")] = None,
    system_errors: Annotated[config.SystemErrors | None, Parameter(help=HELP["system_errors"], group=LOGGER)] = None,
    common: Common = COMMON,
) -> int:
    """Run the logger of a target until stopped.

    It owns the alarms of its target, stores what is sent under it, and answers
    alarms, log and commands. When it can be used it prints one line. Stopping
    it disposes of raised alarms. Exit code 1: the target has a logger already.

    Try:
        tcbridge serve --target plc1 --cache plc1.db
    """
    from bridge.gateways.system_errors import SystemErrors
    from bridge.logger import EventLogger

    settings = common.load(
        cache=None if cache is None else str(cache),
        max_size=max_size,
        max_events=max_events,
        max_age=max_age,
        durable=durable,
        system_errors=system_errors,
    )
    known = catalog(settings)
    with open_bus(settings) as bus, _open_cache(settings, move_aside_bad_cache) as kept:
        logger = EventLogger(
            settings.one_target,
            bus=bus,
            realm=settings.realm,
            cache=kept,
            encoding=settings.wire_encoding,
            durable=settings.durable,
            catalog=known,
            on_read_only=lambda reason: note(f"read-only: {reason}"),
        )
        unsent = 0
        try:
            with SystemErrors(logger.target, logger.report, settings.system_errors):
                if common.json:
                    print_json({"ready": "logger", "target": logger.target, "realm": logger.realm, "session": logger.session})
                else:
                    where = settings.cache or "memory"
                    print(f"logger of {logger.target} in realm {logger.realm} is ready, log in {where}", flush=True)
                wait_for_signal()
        except Interrupted:
            pass
        finally:
            unsent = logger.close(CLOSE_S)
        counters = logger.counters
        if common.json:
            print_json({"stopped": "logger", "target": logger.target, "unsent": unsent, **_counts(counters)})
        else:
            words = ", ".join(f"{number:,} {name}" for name, number in _counts(counters).items())
            print(f"logger of {logger.target} stopped: {words}", flush=True)
    if unsent:
        note(f"{unsent} events were not sent")
    return Exit.LOST if unsent else Exit.OK


def _open_cache(settings: Settings, may_move: bool) -> "Cache":
    """The cache; a bad file is refused, or moved aside when that was allowed."""
    from bridge.edges.cache import Cache, CacheError, move_aside

    def opened() -> Cache:
        try:
            cache = Cache(
                settings.cache or ":memory:",
                max_bytes=settings.max_size,
                max_events=settings.max_events or None,
                max_age_s=settings.max_age or None,
            )
        except ValueError as error:
            raise Usage(str(error)) from None
        try:
            cache.load_alarms()
        except CacheError:
            cache.close()
            raise
        return cache

    try:
        return opened()
    except CacheError as error:
        if not error.bad or not settings.cache:
            raise
        if not may_move:
            note("--move-aside-bad-cache renames it and begins a new one")
            raise
        note(f"{error}; it is {move_aside(Path(settings.cache))} now")
        return opened()


def _counts(counters: "LoggerCounters") -> dict[str, int]:
    return {name: int(number) for name, number in msgspec.structs.asdict(counters).items()}
