"""`tcbridge serve`: the logger of a target, alone in a program."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, catalog, note, open_bus
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted, wait_for_signal

if TYPE_CHECKING:
    from bridge.logger import LoggerCounters

LOGGER = Group("Logger", sort_key=10)
CLOSE_S = 1.5
"""What closing may take, so that the program ends within 3 s of a signal."""


def serve(
    *,
    cache: Annotated[
        Path | None, Parameter(name="--cache", help="SQLite file that keeps the log. Default: memory.", group=LOGGER)
    ] = None,
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
    with open_bus(settings) as bus:
        logger = EventLogger(
            settings.one_target,
            bus=bus,
            realm=settings.realm,
            cache=":memory:" if cache is None else cache,
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


def _counts(counters: "LoggerCounters") -> dict[str, int]:
    return {name: int(number) for name, number in msgspec.structs.asdict(counters).items()}
