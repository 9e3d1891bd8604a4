"""`tcbridge export`: the log that a recording makes, as a file for spreadsheets or programs."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.log_export import EXPORT, HOW, How, write
from bridge.cli.options import TEXTS_ONLY, Texts, note
from bridge.cli.progress import counting
from bridge.cli.recordings import WINDOW, Window, count_events, known_classes, recordings
from bridge.cli.selection import CHOICE, LOG, Choice


def export(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", help="Recordings, or folders of them.", negative=(), required=True)
    ],
    /,
    *,
    to: Annotated[Path | None, Parameter(help="Where to. Default: stdout.", group=EXPORT)] = None,
    limit: Annotated[int, Parameter(help="How many; 0 is all of them.", group=LOG, show_default=True)] = 0,
    how: How = HOW,
    which: Choice = CHOICE,
    window: Window = WINDOW,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write the log of recordings as CSV or JSON Lines.

    It is what log export would write of the logger that was recorded: transitions,
    or with --view occurrences one row per alarm life with its duration, sorted and
    in the columns asked for. Unique ids are new. What stands in the file as it
    stands there is cat's. Exit code 3: a file ends before its end.

    Try:
        tcbridge export plant.mcap --to lives.csv --view occurrences \\
            --column event_text=Text --column duration=Seconds --oldest-first
        tcbridge export night/ --to night.jsonl --only alarms
    """
    from bridge.edges.cache import Cache
    from bridge.edges.recording import carried
    from bridge.logger import Book
    from bridge.replayer import replay_into

    settings = common.load()
    paths = recordings(files)
    known = known_classes([carried(path) for path in paths], settings)
    question, shape = which.question(settings, known, limit), how.settings(settings.lang)
    start_ns, end_ns = window.times(paths)
    with TemporaryDirectory(prefix="tcbridge-") as folder:
        cache = Cache(Path(folder) / "log.db", max_bytes=sys.maxsize)
        with Book(None, cache, resolve_class=known.guids, catalog=known) as book:
            with counting("read", count_events(paths)) as show:
                report = replay_into(
                    paths, book, start_ns=start_ns, end_ns=end_ns, on_progress=lambda report: show(report.events)
                )
            write(book.log(question), known, how.format, shape, to)
    if report.missing:
        note(f"warning: {report.missing:,} events are missing in {report.gaps:,} gaps")
    if report.truncated:
        note("warning: a file ends before its end, or is damaged; info says which")
    return Exit.LOST if report.truncated else Exit.OK
