"""`tcbridge log export`: what log shows, as a file for spreadsheets or programs."""

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note
from bridge.cli.selection import LOG, SELECTION, Selection
from bridge.core import csv_export
from bridge.core.catalog import ENGLISH, Language
from bridge.core.csv_export import Column, CsvSettings
from bridge.core.event_fields import NAMES, EventField, Names
from bridge.core.events import AnyEvent
from bridge.core.questions import Stored
from bridge.core.time_forms import PRECISIONS, TimeForm, TimeStyle

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.texts import Texts

EXPORT: Final = Group("Export", sort_key=11)
Format: TypeAlias = Literal["csv", "jsonl"]
FormName: TypeAlias = Literal["filetime", "iso8601", "iec_date_and_time", "variant_time", "localized", "custom"]
PrecisionName: TypeAlias = Literal["floating", "seconds", "milliseconds", "microseconds", "ticks", "nanoseconds"]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class How:
    """What the export looks like."""

    format: Annotated[Format | None, Parameter(help="csv or jsonl. Default: the file's suffix, else csv.", group=EXPORT)] = None
    delimiter: Annotated[str, Parameter(help="Between two cells; 'tab' is TAB.", group=EXPORT, show_default=True)] = ";"
    no_header: Annotated[bool, Parameter(help="No row of headings.", group=EXPORT)] = False
    column: Annotated[
        tuple[str, ...], Parameter(help="A column: FIELD, /JSON/POINTER, each with =HEADING or without.", group=EXPORT)
    ] = ()
    extra_lang: Annotated[
        tuple[str, ...], Parameter(help="A further text column: LANGUAGE or LANGUAGE=HEADING.", group=EXPORT)
    ] = ()
    time_format: Annotated[FormName, Parameter(help="Form of the times.", group=EXPORT, show_default=True)] = "iso8601"
    time_pattern: Annotated[str, Parameter(help="For custom: as strftime, e.g. '%d.%m. %H:%M'.", group=EXPORT)] = ""
    precision: Annotated[PrecisionName, Parameter(help="Digits of the seconds.", group=EXPORT)] = "floating"
    local: Annotated[bool, Parameter(help="Times of this machine's zone, not UTC.", group=EXPORT)] = False
    lossless: Annotated[bool, Parameter(help="A last column with the whole event, to import it again.", group=EXPORT)] = False
    raw: Annotated[bool, Parameter(help="Do not protect cells that a spreadsheet takes for formulas.", group=EXPORT)] = False
    bom: Annotated[bool, Parameter(help="Begin with a byte order mark, as some spreadsheets want it.", group=EXPORT)] = False

    def settings(self, language: str) -> CsvSettings:
        """The same as the export calls it."""
        try:
            times = TimeStyle(
                TimeForm[self.time_format.upper()],
                PRECISIONS[self.precision],
                language,
                self.time_pattern,
                (lambda second: time.localtime(second).tm_gmtoff) if self.local else None,
            )
            return CsvSettings(
                delimiter={"tab": "\t"}.get(self.delimiter, self.delimiter),
                header=not self.no_header,
                language=language,
                columns=tuple(map(_column, self.column)) or csv_export.DEFAULT_COLUMNS,
                languages=tuple((name, heading) for name, _, heading in (each.partition("=") for each in self.extra_lang)),
                times=times,
                safe=not self.raw,
                lossless=self.lossless,
                byte_order_mark=self.bom,
            )
        except ValueError as error:
            raise Usage(str(error)) from None


def _column(text: str) -> Column:
    name, _, heading = text.partition("=")
    if name.startswith("/"):
        return Column(EventField.JSON_ATTRIBUTE, heading, name)
    if name not in NAMES:
        raise Usage(f"--column {name}: no such field; there are {', '.join(NAMES)}, and JSON pointers")
    return Column(NAMES[name], heading)


class _Learnt:
    """Texts and class names from own files, and from the bus for the rows that went through learning()."""

    def __init__(self, known: "Catalog") -> None:
        self._known = known

    def learning(self, rows: Iterator[Stored], texts: "Texts") -> Iterator[Stored]:
        """The same rows, some hundred at a time, after asking for the classes that are not known."""
        while page := list(islice(rows, csv_export.CHUNK_ROWS)):
            self._known = texts.catalog_for(row.event for row in page)
            yield from page

    def class_name(self, event_class: str, language: Language = ENGLISH) -> str:
        """As a catalog has it."""
        return self._known.class_name(event_class, language)

    def event_text(self, event: AnyEvent, language: Language = ENGLISH) -> str:
        """As a catalog has it."""
        return self._known.event_text(event, language)


HOW: Final = How()


def export(
    file: Annotated[Path | None, Parameter(name="FILE", help="Where to. Default: stdout.")] = None,
    /,
    *,
    limit: Annotated[int, Parameter(help="How many; 0 is all of them.", group=LOG, show_default=True)] = 0,
    how: How = HOW,
    which: Selection = SELECTION,
    common: Common = COMMON,
) -> int:
    """Write stored events as CSV or JSON Lines.

    The file appears when it is whole. Cells that a spreadsheet would take for
    formulas begin with a quote mark, see the documentation.

    Try:
        tcbridge log export faults.csv --cache plc1.db --min-severity error \\
            --column time --column event_text=Text --column /axis=Axis --local
        tcbridge log export all.jsonl --cache plc1.db
    """
    settings = common.load()
    known = catalog(settings)
    question = which.question(settings, known, limit)
    shape = how.settings(settings.lang)
    with which.rows(settings, known, question) as (rows, asked):
        names = _Learnt(known)
        write(rows if asked is None else names.learning(rows, asked), names, how.format, shape, file)
    return Exit.OK


def write(rows: Iterable[Stored], names: Names, form: Format | None, shape: CsvSettings, file: Path | None) -> None:
    """Write the rows to a file, which appears when it is whole, or to stdout; in that form, else as the suffix says."""
    if form is None:
        form = "jsonl" if file is not None and file.suffix.lower() in (".jsonl", ".ndjson") else "csv"
    if form == "jsonl":
        texts: Iterable[str] = csv_export.export_jsonl(rows, names, shape.language)
    else:
        texts = csv_export.export_csv(rows, names, shape)
    if file is None:
        sys.stdout.reconfigure(encoding="utf-8", errors="replace", newline="")  # type: ignore[union-attr]
        sys.stdout.writelines(texts)
        return
    part = file.with_name(f"{file.name}.part")
    with part.open("w", encoding="utf-8", errors="replace", newline="") as out:
        out.writelines(texts)
    part.replace(file)
    note(f"wrote {file}")
