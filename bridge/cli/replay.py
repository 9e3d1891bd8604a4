"""`tcbridge replay`: a recording into a fresh logger, or onto the bus."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, parse_filter
from bridge.cli.progress import counting
from bridge.cli.show import View, clean, print_json
from bridge.core import keys

if TYPE_CHECKING:
    from bridge.config import Settings
    from bridge.core.filters.ast import Expr
    from bridge.logger.compare import Comparison, State
    from bridge.replayer import ReplayReport

HOW = Group("Replay", sort_key=10)
SHOWN_DIFFERENCES = 20


def replay(
    files: Annotated[tuple[Path, ...], Parameter(name="FILE", help="Recordings, in their order.", negative=(), required=True)],
    /,
    *,
    into: Annotated[
        Path | None, Parameter(help="Make this cache file, as the logger that recorded would have it.", group=HOW)
    ] = None,
    against: Annotated[
        Path | None,
        Parameter(help="Compare the outcome with a state (.json, see demo --keep) or a logger's cache file.", group=HOW),
    ] = None,
    rate: Annotated[float, Parameter(help="Speed on the bus; 0 is as fast as it can.", group=HOW, show_default=True)] = 1.0,
    filter: Annotated[str, Parameter(help="Which events, e.g. 'is_alarm'. Default: all.", group=HOW)] = "",
    wait: Annotated[float, Parameter(help="Seconds to wait for somebody who listens.", group=HOW, show_default=True)] = 1.0,
    live: Annotated[bool, Parameter(help="Replay into the realm live. Asks first, or needs --yes.", group=HOW)] = False,
    yes: Annotated[bool, Parameter(help="Do not ask.", group=HOW)] = False,
    dry_run: Annotated[bool, Parameter(help="Read the files and say what would be replayed.", group=HOW)] = False,
    common: Common = COMMON,
) -> int:
    """Play a recording into a fresh logger or onto the bus.

    On the bus it goes into a realm of its own, replay-<8 hex>, which is printed
    first; --realm names another. With --into or --against no bus is used.
    --against says whether the replay equals that state: exit code 0, or 1 with
    every difference named. Exit code 3: something is missing in the files.

    Try:
        tcbridge replay plant.mcap --rate 10
        tcbridge replay plant.mcap --into yesterday.db
        tcbridge replay demo/demo.mcap --against demo/live.json
    """
    settings = common.load()
    known = catalog(settings)
    expr = parse_filter(filter, known)
    view = View(known, settings.lang)
    if not rate >= 0:
        raise Usage(f"--rate {rate} is negative")
    for file in (*files, *([against] if against is not None else [])):
        if not file.is_file():
            raise Usage(f"{file}: no such file")
    total = _total(files)
    if dry_run:
        return _dry_run(files, expr, total, as_json=common.json)
    if into is not None or against is not None:
        return _into_book(files, expr, total, into, against, view, as_json=common.json)
    return _onto_bus(files, expr, total, settings, _realm(common, live=live, yes=yes), rate, wait, as_json=common.json)


def _total(files: tuple[Path, ...]) -> int:
    from bridge.edges.recording import summary

    return sum(summary(file).totals.events for file in files)


def _realm(common: Common, *, live: bool, yes: bool) -> str | None:
    """Where to replay; None is a new realm. A recording goes among live events only when a person says so."""
    realm = keys.LIVE if live else common.realm
    if realm != keys.LIVE or yes:
        return realm
    if not sys.stdin.isatty():
        raise Usage("a replay into the realm live needs --yes")
    print("Replay into the realm live, among the events of the plant? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise Usage("not replayed")
    return realm


def _dry_run(files: tuple[Path, ...], expr: "Expr", total: int, *, as_json: bool) -> int:
    from bridge.replayer import replay_into

    with counting("reading", total) as show:
        report = replay_into(files, _Nothing(), expr, on_progress=lambda report: show(report.events))
    return _tell(report, "would replay", as_json=as_json)


class _Nothing:
    """A sink that keeps nothing."""

    def replay(self, event: object, arrival_ns: int) -> None:
        """Pass over an event."""

    def load_state(self, state: object) -> None:
        """Pass over a keyframe."""


def _into_book(
    files: tuple[Path, ...],
    expr: "Expr",
    total: int,
    into: Path | None,
    against: Path | None,
    view: View,
    *,
    as_json: bool,
) -> int:
    from bridge.logger import Book
    from bridge.logger.compare import compare, state_of
    from bridge.replayer import replay_into

    other = None if against is None else _read_state(against)
    with Book(None, ":memory:" if into is None else into) as book:
        with counting("replaying", total) as show:
            report = replay_into(files, book, expr, on_progress=lambda report: show(report.events))
        book.flush()
        state = state_of(book)
    if as_json:
        for alarm in state.alarms:
            print_json(view.alarm_record(alarm))
    else:
        view.print_alarms(state.alarms, title="alarms after the replay")
    code = _tell(report, "replayed", where="" if into is None else f"into {into}", as_json=as_json)
    return code if other is None else max(code, show_comparison(compare(other, state), as_json=as_json))


def _read_state(path: Path) -> "State":
    from bridge.logger import Book
    from bridge.logger.compare import State, state_of

    if path.suffix != ".json":
        with Book(None, path) as book:
            return state_of(book)
    try:
        return msgspec.json.decode(path.read_bytes(), type=State)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise Usage(f"{path}: no state: {error}") from None


def show_comparison(found: "Comparison", *, as_json: bool) -> int:
    """Say whether a replay equals what was live, and how it differs; the exit code."""
    if as_json:
        facts = {"events": found.events, "alarms": found.alarms, "differences": found.differences}
        print_json({"replay_equals_live": found.equal, **facts})
    else:
        for difference in found.differences[:SHOWN_DIFFERENCES]:
            print(f"  {clean(difference)}")
        if len(found.differences) > SHOWN_DIFFERENCES:
            print(f"  and {len(found.differences) - SHOWN_DIFFERENCES:,} more")
        answer = "yes" if found.equal else "no"
        print(f"replay equals live: {answer} ({found.events} events, {found.alarms} alarms)", flush=True)
    return Exit.OK if found.equal else Exit.NO


def _onto_bus(
    files: tuple[Path, ...],
    expr: "Expr",
    total: int,
    settings: "Settings",
    realm: str | None,
    rate: float,
    wait: float,
    *,
    as_json: bool,
) -> int:
    from bridge.replayer import new_realm, replay_to_bus

    realm = realm or new_realm()
    with open_bus(settings) as bus, counting("replaying", total) as show:
        if as_json:
            print_json({"replaying": [str(file) for file in files], "realm": realm, "rate": rate})
        else:
            print(f"replaying {total:,} events in realm {realm}", flush=True)
        report = replay_to_bus(
            files,
            bus,
            expr,
            realm=realm,
            rate=rate,
            encoding=settings.wire_encoding,
            wait_for_listener_s=wait,
            on_progress=lambda report: show(report.events),
        )
    return _tell(report, "replayed", where=f"in realm {realm}", as_json=as_json)


def _tell(report: "ReplayReport", verb: str, *, where: str = "", as_json: bool) -> int:
    """Say what was done; exit code 3 when the files or the bus lost something."""
    if as_json:
        print_json({verb.replace(" ", "_"): msgspec.to_builtins(report)})
    else:
        words = [f"{verb} {report.events:,} events{f' {where}' if where else ''}"]
        words += [f"{report.filtered_out:,} not taken by the filter"] if report.filtered_out else []
        words += [f"{report.keyframes:,} keyframes"] if report.keyframes else []
        print(", ".join(words))
    lost = {
        f"{report.missing:,} events are missing in {report.gaps:,} gaps": report.gaps,
        f"{report.rejected:,} payloads are no events": report.rejected,
        f"{report.unsent:,} events were not sent": report.unsent,
        "the recording breaks off": report.truncated,
    }
    for text, happened in lost.items():
        if happened:
            note(text)
    return Exit.LOST if any(lost.values()) else Exit.OK
