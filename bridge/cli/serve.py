"""`tcbridge serve`: the logger of a target, alone in a program."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted, wait_for_signal

if TYPE_CHECKING:
    from bridge.edges.cache import Cache
    from bridge.logger import LoggerCounters

LOGGER = Group("Logger", sort_key=10)
CLOSE_S = 1.5
"""What closing may take, so that the program ends within 3 s of a signal."""


def serve(
    *,
    cache: Annotated[
        Path | None, Parameter(name="--cache", help="SQLite file that keeps the log. Default: memory.", group=LOGGER)
    ] = None,
    max_size: Annotated[
        int, Parameter(help="Bytes of the log; half goes when it is full.", group=LOGGER, show_default=True)
    ] = (20_000_000),
    max_events: Annotated[int | None, Parameter(help="Events of the log; half goes when there are more.", group=LOGGER)] = None,
    max_age: Annotated[float | None, Parameter(help="Seconds that an event stays in the log.", group=LOGGER)] = None,
    move_aside_bad_cache: Annotated[
        bool, Parameter(help="Rename a cache file that is damaged or another program's, and begin a new one.", group=LOGGER)
    ] = False,
    durable: Annotated[bool, Parameter(help="Answer commands only when they are safe from a power cut.", group=LOGGER)] = False,
    common: Common = COMMON,
) -> int:
    """Run the logger of a target until stopped.

    It owns the alarms of its target, stores what is sent under it, and answers
    alarms, log and commands. When it can be used it prints one line. Stopping
    it disposes of raised alarms. Exit code 1: the target has a logger already.

    Try:
        tcbridge serve --target plc1 --cache plc1.db
    """
    from bridge.logger import EventLogger

    settings = common.load()
    known = catalog(settings)
    limits = _Limits(max_size, max_events, max_age)
    with open_bus(settings) as bus, _open_cache(cache, limits, move_aside_bad_cache) as kept:
        logger = EventLogger(
            settings.one_target,
            bus=bus,
            realm=settings.realm,
            cache=kept,
            encoding=settings.wire_encoding,
            durable=durable,
            catalog=known,
            on_read_only=lambda reason: note(f"read-only: {reason}"),
        )
        unsent = 0
        try:
            if common.json:
                print_json({"ready": "logger", "target": logger.target, "realm": logger.realm, "session": logger.session})
            else:
                where = "memory" if cache is None else str(cache)
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


class _Limits(NamedTuple):
    size: int
    events: int | None
    age_s: float | None


def _open_cache(path: Path | None, limits: _Limits, may_move: bool) -> "Cache":
    """The cache; a bad file is refused, or moved aside when that was allowed."""
    from bridge.edges.cache import Cache, CacheError, move_aside

    def opened() -> Cache:
        where = ":memory:" if path is None else path
        try:
            cache = Cache(where, max_bytes=limits.size, max_events=limits.events, max_age_s=limits.age_s)
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
        if not error.bad or path is None:
            raise
        if not may_move:
            note("--move-aside-bad-cache renames it and begins a new one")
            raise
        note(f"{error}; it is {move_aside(path)} now")
        return opened()


def _counts(counters: "LoggerCounters") -> dict[str, int]:
    return {name: int(number) for name, number in msgspec.structs.asdict(counters).items()}
