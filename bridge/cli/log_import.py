"""`tcbridge log import`: an export back into a log."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit
from bridge.cli.log_export import Format
from bridge.cli.options import BASIC, Basic, note
from bridge.cli.progress import counting
from bridge.cli.show import clean, counted, print_json
from bridge.core.csv_export import CsvError, import_csv, import_jsonl

IMPORT: Final = Group("Import", sort_key=10)
SHOWN: Final = 20
CHARS: Final = 1 << 16


def import_(
    file: Annotated[Path, Parameter(name="FILE", help="What log export wrote.")],
    /,
    *,
    cache: Annotated[Path, Parameter(help="The cache file to make.", group=IMPORT)],
    format: Annotated[
        Format | None, Parameter(help="csv or jsonl. Default: the file's suffix, else csv.", group=IMPORT)
    ] = None,
    delimiter: Annotated[str, Parameter(help="Between two cells; 'tab' is TAB.", group=IMPORT, show_default=True)] = ";",
    no_header: Annotated[bool, Parameter(help="The first row is an event.", group=IMPORT)] = False,
    raw: Annotated[bool, Parameter(help="Cells were not protected.", group=IMPORT)] = False,
    basic: Basic = BASIC,
) -> int:
    """Read what log export wrote into a new cache file.

    JSON Lines, or CSV that was exported with --lossless. Rows that are none are
    told with their line and left out; the exit code is then 3. If there is no
    event in it, no file is made and the exit code is 1.

    Try:
        tcbridge log export all.csv --cache plc1.db --lossless
        tcbridge log import all.csv --cache copy.db
        tcbridge log --cache copy.db
    """
    from bridge.logger.importing import import_log

    basic.load()
    kind = format or ("jsonl" if file.suffix.lower() in (".jsonl", ".ndjson") else "csv")
    bad = _Bad(file, as_json=basic.json)
    with file.open(encoding="utf-8", errors="surrogateescape", newline="") as source, counting("importing") as show:
        texts: Iterator[str] = iter(lambda: source.read(CHARS), "")
        if kind == "jsonl":
            rows = import_jsonl(texts, on_bad=bad.tell)
        else:
            rows = import_csv(
                texts,
                delimiter={"tab": "\t"}.get(delimiter, delimiter),
                header=not no_header,
                safe=not raw,
                on_bad=bad.tell,
            )
        try:
            done = import_log(rows, cache, on_progress=show)
        except CsvError as error:
            bad.tell(error)
            return Exit.NO
    if bad.count and not done.events:
        cache.unlink()
        note(f"{file}: none of {bad.count:,} rows is an event; nothing was made")
        return Exit.NO
    if basic.json:
        print_json({"imported": done.events, "bad": bad.count, "duplicates": done.duplicates, "cache": str(cache)})
    else:
        twice = f"{done.duplicates:,} were there twice"
        print(f"{counted(done.events, 'event')} imported into {cache}, {twice}, {counted(bad.count, 'bad row')}")
    return Exit.LOST if bad.count else Exit.OK


class _Bad:
    """Rows that are none: told one by one, the first of them, and counted."""

    def __init__(self, file: Path, *, as_json: bool) -> None:
        self._file, self._as_json = file, as_json
        self.count = 0

    def tell(self, error: CsvError) -> None:
        self.count += 1
        if self._as_json:
            print_json({"bad_row": error.row, "line": error.line, "file": str(self._file), "reason": error.reason})
        elif self.count <= SHOWN:
            note(clean(f"{self._file}:{error.line}: row {error.row}: {error.reason}"))
        elif self.count == SHOWN + 1:
            note("further bad rows are counted only; --json tells each")
