"""`tcbridge cut` and `tcbridge merge`: recordings made of recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import TEXTS_ONLY, Texts
from bridge.cli.progress import counting
from bridge.cli.recordings import WHICH, Which, count_events, known_classes, recordings, tell_damages, viewer_for
from bridge.cli.show import counted, print_json

if TYPE_CHECKING:
    from bridge.edges.recording import Part

NEW = Group("The new file", sort_key=12)
Packing: TypeAlias = Literal["zstd", "lz4", "none"]
SEVERAL = Parameter(
    name="FILE", help="Recordings, or folders of them; the last name is the new file.", negative=(), required=True
)
PACKING = Parameter(help="How chunks are packed.", group=NEW, show_default=True)


def cut(
    files: Annotated[tuple[Path, ...], SEVERAL],
    /,
    *,
    which: Which = WHICH,
    compression: Annotated[Packing, PACKING] = "zstd",
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write a part of recordings as a new one.

    The new file begins with a keyframe: the alarms as they were at its start, so
    that it shows and replays like the whole. With a filter these are the alarms
    that it takes. Gaps of the part stay gaps. The last name given is the new
    file, and nothing that exists is ever overwritten. Exit code 3: a file was
    damaged, and what could be read of it was written.

    Try:
        tcbridge cut night.mcap hour.mcap --start 3600 --duration 3600
        tcbridge cut night/ faults.mcap --filter "severity >= error"
    """
    sources, target = _names(files)
    from bridge.edges.recording import carried

    known = known_classes([carried(path) for path in sources], common.load())
    part = which.part(sources, known)
    if part.is_all:
        raise Usage("say what to cut: --start, --end, --duration, --filter or --target")
    return _copy(sources, target, part, compression, common, "cut")


def merge(
    files: Annotated[tuple[Path, ...], SEVERAL],
    /,
    *,
    compression: Annotated[Packing, PACKING] = "zstd",
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write several recordings as one, in the order of time.

    An event that several of them have is written once; what one misses and
    another has is no gap any more. Keyframes and the other gaps stay. The last
    name given is the new file, and nothing that exists is ever overwritten. Exit
    code 3: a file was damaged, and what could be read of it was written.

    Try:
        tcbridge merge line1.mcap line2.mcap plant.mcap
        tcbridge merge night/ night.mcap
    """
    from bridge.edges.recording import EVERYTHING

    return _copy(*_names(files), EVERYTHING, compression, common, "merged")


def _names(files: tuple[Path, ...]) -> tuple[list[Path], Path]:
    sources, target = recordings(files[:-1]), files[-1]
    if not sources or target.is_dir():
        raise Usage("say which recordings, and last the name of the new file")
    if target.suffix != ".mcap":
        raise Usage(f"{target.name!r} does not end in .mcap; the last name is that of the new file")
    return sources, target


def _copy(sources: list[Path], target: Path, part: "Part", compression: Packing, common: Texts, word: str) -> int:
    from bridge.cli import program_version
    from bridge.edges.recording import carried, copy_part, summary

    settings = common.load()
    viewer = viewer_for([carried(path) for path in sources], settings, common.lang)
    with counting("copying", count_events(sources) if part.is_all else 0) as show:
        report = copy_part(
            sources,
            target,
            part,
            compression=compression,
            viewer=viewer,
            version=program_version(),
            on_progress=show,
        )
    code = tell_damages(report.damages)
    complete = summary(target).complete
    if common.json:
        facts = {name: getattr(report, name) for name in ("events", "gaps", "missing", "filled", "rejected", "keyframes")}
        print_json({word: str(target), "complete": complete, **facts})
    else:
        filled = f"; {report.filled:,} that one file missed came from another" if report.filled else ""
        missing = f"; {report.missing:,} are missing" if report.missing else ""
        print(f"{word} {counted(report.events, 'event')} into {target}{filled}{missing}; complete: {complete}")
    return code or Exit.OK
