"""What commands about recordings share: which files, which part of them, and what is told of their state.

Rule 1: a folder stands for the recordings in it, finished or not.
Rule 2: a part is named by the times of recording, not by those that events say of themselves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import catalog, note, parse_filter
from bridge.core.times import NS_PER_S, time_text

if TYPE_CHECKING:
    from bridge.config import Settings
    from bridge.core.catalog import Catalog
    from bridge.edges.recording import Carried, Damage, Part, Viewer
    from bridge.edges.recording.reader import Sort
    from bridge.replayer import Span

PART: Final = Group("Which part", sort_key=10)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Window:
    """Which time of recordings."""

    start: Annotated[str | None, Parameter(help="From here on: seconds from the start, or a time.", group=PART)] = None
    end: Annotated[str | None, Parameter(help="Up to here: seconds from the start, or a time.", group=PART)] = None
    duration: Annotated[float | None, Parameter(help="Only so many seconds of it.", group=PART)] = None

    def times(self, paths: Sequence[Path]) -> tuple[int | None, int | None]:
        """From when on and before when, in Unix ns; None is from the start, to the end. TimeError or Usage."""
        from bridge.replayer import span_of

        if self.start is None and self.end is None and self.duration is None:
            return None, None
        return times(span_of(paths), self.start, self.end, self.duration)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Which(Window):
    """Which part of recordings."""

    filter: Annotated[str, Parameter(help="Which events, e.g. 'severity >= error'. Default: all.", group=PART)] = ""
    target: Annotated[tuple[str, ...], Parameter(help="Only of this target, repeated.", group=PART)] = ()

    def part(self, paths: Sequence[Path], known: "Catalog", only: "Sequence[Sort] | None" = None) -> "Part":
        """What to read. TimeError, Usage, and the errors of a bad filter."""
        from bridge.core.filters.ast import Everything
        from bridge.edges.recording import Part
        from bridge.edges.recording.reader import SORTS

        start, end = self.times(paths)
        expr = parse_filter(self.filter, known)
        return Part(
            start_ns=start or 0,
            end_ns=end,
            targets=frozenset(self.target) if self.target else None,
            filter=None if isinstance(expr, Everything) else expr,
            only=SORTS if only is None else frozenset(only),
        )


WINDOW: Final = Window()
WHICH: Final = Which()


def times(span: "Span", start: str | None, end: str | None, duration: float | None) -> tuple[int | None, int | None]:
    """From when on and before when, in Unix ns; None is from the start, to the end. TimeError or Usage for what is no part."""
    first = None if start is None else span.place(start)
    last = None if end is None else span.place(end)
    begin = span.first_ns if first is None else first
    if duration is not None:
        if last is not None or not duration > 0:
            raise Usage("--duration is above 0, and stands in place of --end")
        last = begin + int(duration * NS_PER_S)
    if last is not None and last <= begin:
        raise Usage("the end is not after the start")
    if span.last_ns and begin > span.last_ns:
        raise Usage(f"the start is behind the end of the recording, {time_text(span.last_ns)}")
    if last is not None and last <= span.first_ns:
        raise Usage(f"the end is before the recording, which begins at {time_text(span.first_ns)}")
    return first, last


def recordings(files: Sequence[Path]) -> list[Path]:
    """The recordings that are meant, each once, those of a folder in the order of their names."""
    from bridge.edges.recording import ACTIVE_SUFFIX

    found: dict[Path, None] = {}
    for file in files:
        if file.is_dir():
            inside = sorted([*file.glob("*.mcap"), *file.glob(f"*.mcap{ACTIVE_SUFFIX}")])
            if not inside:
                raise Usage(f"{file}: no recording in this folder")
            found.update(dict.fromkeys(inside))
        elif file.is_file():
            found[file] = None
        else:
            raise Usage(f"{file}: no such file")
    return list(found)


def count_events(paths: Sequence[Path]) -> int:
    """How many events recordings hold, for a bar."""
    from bridge.edges.recording import summary

    return sum(summary(path).totals.events for path in paths)


def tell_damages(damages: "Mapping[Path, Damage]") -> Exit:
    """Say on stderr which files could not be read to their end; the exit code of that."""
    for path, damage in damages.items():
        note(f"warning: {path}: {damage.text(path)}")
    return Exit.LOST if damages else Exit.OK


def known_classes(brought: "Sequence[Carried]", settings: "Settings") -> "Catalog":
    """The event classes of the settings, and below them those that the recordings carry."""
    from bridge.edges.class_files import carried_catalog

    attached, problems = carried_catalog((file.name, file.data) for each in brought for file in each.attachments)
    for problem in problems:
        note(f"warning: attached: {problem}")
    return attached.merged(catalog(settings))


def viewer_for(brought: "Sequence[Carried]", settings: "Settings", lang: str | None) -> "Viewer | None":
    """What makes the log for viewers anew, when the recordings have one: in the language asked for, else that of the first."""
    from bridge.edges.recording import Viewer

    if not any(each.has_log for each in brought):
        return None
    known = known_classes(brought, settings)
    languages = filter(None, (lang, *(each.language for each in brought)))
    return Viewer(lambda event: known, next(languages, settings.lang), known)
