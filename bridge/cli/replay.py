"""`tcbridge replay`: a recording into a fresh logger, or onto the bus."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, note, open_bus, parse_filter
from bridge.cli.progress import counting
from bridge.cli.recordings import PART, known_classes, recordings, times
from bridge.cli.show import View, clean, counted, print_json
from bridge.cli.signals import Interrupted
from bridge.core import keys

if TYPE_CHECKING:
    from bridge.config import Settings
    from bridge.core.catalog import Catalog
    from bridge.core.filters.ast import Expr
    from bridge.logger.compare import Comparison, State
    from bridge.replayer import ReplayReport, Sink, Span

HOW = Group("Replay", sort_key=11)
SHOWN_DIFFERENCES = 20
_STEP_S = 0.1


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Which part of a recording, and under which names."""

    start: Annotated[str | None, Parameter(help="From here on: seconds from the start, or a time.", group=PART)] = None
    end: Annotated[str | None, Parameter(help="Up to here: seconds from the start, or a time.", group=PART)] = None
    duration: Annotated[float | None, Parameter(help="Only so many seconds of it.", group=PART)] = None
    filter: Annotated[str, Parameter(help="Which events, e.g. 'is_alarm'. Default: all.", group=PART)] = ""
    remap: Annotated[tuple[str, ...], Parameter(help="Rename a target, OLD=NEW; repeat it.", group=PART)] = ()

    def names(self, span: "Span") -> dict[str, str]:
        """Targets by their new names."""
        from bridge.replayer import check_remap

        pairs = [text.partition("=") for text in self.remap]
        if wrong := [text for text, (old, _, new) in zip(self.remap, pairs, strict=True) if not old or not new]:
            raise Usage(f"--remap {wrong[0]}: expected OLD=NEW")
        names = {old: new for old, _, new in pairs}
        check_remap(names, span.targets)
        return names


CHOSEN = Chosen()


def replay(
    files: Annotated[
        tuple[Path, ...],
        Parameter(name="FILE", help="Recordings, or folders of them; several are one.", negative=(), required=True),
    ],
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
    loop: Annotated[bool, Parameter(help="Start over at the end, until stopped.", group=HOW)] = False,
    paused: Annotated[bool, Parameter(help="Stand still at the start, until told to go on.", group=HOW)] = False,
    name: Annotated[str | None, Parameter(help="What control calls it. Default: the realm.", group=HOW)] = None,
    wait: Annotated[float, Parameter(help="Seconds to wait for somebody who listens.", group=HOW, show_default=True)] = 1.0,
    live: Annotated[bool, Parameter(help="Replay into the realm live. Asks first, or needs --yes.", group=HOW)] = False,
    yes: Annotated[bool, Parameter(help="Do not ask.", group=HOW)] = False,
    dry_run: Annotated[bool, Parameter(help="Read the files and say what would be replayed.", group=HOW)] = False,
    chosen: Chosen = CHOSEN,
    common: Common = COMMON,
) -> int:
    """Play a recording into a fresh logger or onto the bus.

    On the bus it goes into a realm of its own, replay-<8 hex>, which is printed
    first; --realm names another. It is told to pause, step or seek by control, or
    by keys (? lists them). With --into or --against no bus is used. --against says
    whether the replay equals that state: exit code 0, or 1 with every difference
    named. Exit code 3: something is missing in the files.

    Try:
        tcbridge replay plant.mcap --rate 10
        tcbridge replay plant.mcap --start 3600 --duration 60 --remap plc1=test1
        tcbridge replay plant.mcap --into yesterday.db
        tcbridge replay demo/demo.mcap --against demo/live.json
    """
    from bridge.edges.recording import carried
    from bridge.replayer import span_of

    settings = common.load()
    if not rate >= 0:
        raise Usage(f"--rate {rate} is negative")
    if against is not None and not against.is_file():
        raise Usage(f"{against}: no such file")
    paths = recordings(files)
    known = known_classes([carried(path) for path in paths], settings)
    part = _Part(paths, parse_filter(chosen.filter, known), span_of(paths), chosen)
    if dry_run:
        return _dry_run(part, as_json=common.json)
    if into is not None or against is not None:
        if loop or paused or name:
            raise Usage("--loop, --paused and --name are for a replay onto the bus")
        return _into_book(part, into, against, View(known, settings.lang), as_json=common.json)
    how = _How(_realm(common, live=live, yes=yes), name, rate, wait, loop, paused)
    return _onto_bus(part, how, settings, known, as_json=common.json)


class _Part:
    """What is replayed."""

    def __init__(self, files: Sequence[Path], expr: "Expr", span: "Span", chosen: Chosen) -> None:
        self.files, self.expr, self.span = files, expr, span
        self.start_ns, self.end_ns = times(span, chosen.start, chosen.end, chosen.duration)
        self.remap = chosen.names(span)

    def fold(self, sink: "Sink", word: str) -> "ReplayReport":
        """Fold it into something."""
        from bridge.replayer import replay_into

        with counting(word, self.span.events) as show:
            return replay_into(
                self.files,
                sink,
                self.expr,
                start_ns=self.start_ns,
                end_ns=self.end_ns,
                remap=self.remap,
                on_progress=lambda report: show(report.events),
            )


class _How(NamedTuple):
    """How it is played on the bus."""

    realm: str | None
    name: str | None
    rate: float
    wait: float
    loop: bool
    paused: bool


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


def _dry_run(part: _Part, *, as_json: bool) -> int:
    return _tell(part.fold(_Nothing(), "reading"), "would replay", as_json=as_json)


class _Nothing:
    """A sink that keeps nothing."""

    def replay(self, event: object, arrival_ns: int) -> None:
        """Pass over an event."""

    def load_state(self, state: object) -> None:
        """Pass over a keyframe."""


def _into_book(part: _Part, into: Path | None, against: Path | None, view: View, *, as_json: bool) -> int:
    from bridge.edges.cache import Cache
    from bridge.logger import Book
    from bridge.logger.compare import compare, state_of

    other = None if against is None else _read_state(against)
    with Book(None, Cache(":memory:" if into is None else into, max_bytes=sys.maxsize)) as book:
        report = part.fold(book, "replaying")
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


def _onto_bus(part: _Part, how: _How, settings: "Settings", known: "Catalog", *, as_json: bool) -> int:
    from bridge.cli.keyboard import keyboard
    from bridge.replayer import Player

    with open_bus(settings) as bus, counting("replaying", 0 if how.loop else part.span.events) as show:
        player = Player(
            bus,
            part.files,
            part.expr,
            realm=how.realm,
            name=how.name,
            start_ns=part.start_ns,
            end_ns=part.end_ns,
            rate=how.rate,
            loop=how.loop,
            paused=how.paused,
            remap=part.remap,
            catalog=known,
            encoding=settings.wire_encoding,
            wait_for_listener_s=how.wait,
            on_progress=lambda report: show(report.events),
        )
        try:
            if as_json:
                told = {"realm": player.realm, "name": player.control.name, "rate": how.rate}
                print_json({"replaying": [str(file) for file in part.files], **told})
            else:
                named = "" if player.control.name == player.realm else f", as {player.control.name}"
                print(f"replaying {counted(part.span.events, 'event')} in realm {player.realm}{named}", flush=True)
            with keyboard(player):
                while not player.wait(_STEP_S):
                    pass
        except Interrupted:
            if not how.loop:
                raise
        finally:
            report = player.close()
    return _tell(report, "replayed", where=f"in realm {player.realm}", as_json=as_json)


def _tell(report: "ReplayReport", verb: str, *, where: str = "", as_json: bool) -> int:
    """Say what was done; exit code 3 when the files or the bus lost something."""
    if as_json:
        print_json({verb.replace(" ", "_"): msgspec.to_builtins(report)})
    else:
        words = [f"{verb} {counted(report.events, 'event')}{f' {where}' if where else ''}"]
        words += [f"{report.filtered_out:,} not taken by the filter"] if report.filtered_out else []
        words += [f"{report.keyframes:,} keyframe{'s' if report.keyframes > 1 else ''}"] if report.keyframes else []
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
