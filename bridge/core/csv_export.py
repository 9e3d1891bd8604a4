"""Stored events as CSV or JSON Lines, and back: rows in, pieces of text out, nothing held but some hundred rows.

Rule 1: a cell is escaped so that it comes back exactly. It is quoted when it holds the delimiter, a quote, CR or LF (RFC 4180),
and rows end with CR LF.
Rule 2: no cell is a formula. One whose first character that is no white space is = + - @ or the full-width form of one of them,
or that starts with TAB, CR, LF or a byte order mark, gets a ' in front; one that starts with ' gets another. So a reader takes
one ' from the front of each cell that has one (`safe`, on by default).
Rule 3: what can be imported without a difference has a last column "Record" with the whole event as JSON (`lossless`). JSON
Lines always can.
Rule 4: a lone surrogate, which no file holds, is a "?" in a cell and stays exact in the record.

The settings are those of FB_TcEventCsvExportSettings and FB_TcEventExportSettings (manual 6.1.2.2; library 3.1.27): delimiter,
header, language, further languages, fields with headings, JSON pointers, form of the times. What the manual leaves open is
decided here: the default columns are those of the Logged Events window (manual 5.6) with the event and its unique id, a
severity is its name, a source id a decimal number, a duration seconds with nine digits, an object in a JSON attribute its JSON.
"""

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import count, islice
from typing import Final, TypeAlias, cast

import msgspec

from bridge.core.catalog import ENGLISH, Language, language_id, language_tag
from bridge.core.event_fields import FIELD_ROWS, EventField, Names, value
from bridge.core.events import U32, AnyEvent, Count, Severity
from bridge.core.filters.ast import JsonPointer
from bridge.core.filters.pointer import NOTHING, JsonNumber, find, read_json, text_of
from bridge.core.questions import Stored
from bridge.core.time_forms import TimeStyle
from bridge.core.times import NS_PER_S

RECORD: Final = "Record"
CHUNK_ROWS: Final = 256
MAX_CELL: Final = 64 * 1024 * 1024
"""Characters of a cell that can be read back; also set as the limit of the csv module, which knows one for all readers."""
_RISKY: Final = re.compile(r"'|[\t\r\n\ufeff]|\s*[=+\-@＝＋－＠]")
_END: Final = "\r\n"
_BOM: Final = "\ufeff"

_Cell: TypeAlias = Callable[[Stored], str]


class CsvError(ValueError):
    """A text that is no export: the row, counted from 1 with the header, the line it begins on, and what is wrong."""

    def __init__(self, row: int, reason: str, line: int = 0) -> None:
        self.row, self.reason, self.line = row, reason, line or row
        super().__init__(f"row {row}: {reason}")


OnBad: TypeAlias = Callable[[CsvError], None]


class Column(msgspec.Struct, frozen=True):
    """A column: which field, its heading ("" is the field's own), a JSON pointer into the JSON attribute, another language."""

    field: EventField
    heading: str = ""
    pointer: str = ""
    language: Language | None = None

    def __post_init__(self) -> None:
        if self.pointer and self.field is not EventField.JSON_ATTRIBUTE:
            raise ValueError(f"a JSON pointer needs the field json_attribute, not {self.field.name.lower()}")
        if self.pointer:
            JsonPointer(self.pointer)  # AdsError when it is none
        if self.language is not None:
            language_id(self.language)


DEFAULT_COLUMNS: Final = tuple(
    Column(field)
    for field in (
        EventField.TIME,
        EventField.KIND,
        EventField.SEVERITY_LEVEL,
        EventField.EVENT_CLASS_NAME,
        EventField.EVENT_ID,
        EventField.ID,
        EventField.EVENT_TEXT,
        EventField.SOURCE_NAME,
        EventField.TIME_RAISED,
        EventField.TIME_CLEARED,
        EventField.TIME_CONFIRMED,
    )
)


class CsvSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What an export looks like. languages are further text columns, after the others: a language and its heading ("": tag).

    ValueError for a delimiter that cannot be told from the rest, and for an unknown language.
    """

    delimiter: str = ";"
    header: bool = True
    language: Language = ENGLISH
    columns: tuple[Column, ...] = DEFAULT_COLUMNS
    languages: tuple[tuple[Language, str], ...] = ()
    times: TimeStyle = TimeStyle()
    safe: bool = True
    lossless: bool = False
    byte_order_mark: bool = False

    def __post_init__(self) -> None:
        if len(self.delimiter) != 1 or self.delimiter in "\"'\r\n\ufeff" or self.delimiter.isalnum():
            raise ValueError(f"delimiter {self.delimiter!r} is not one character that is no quote, line end, letter or digit")
        language_id(self.language)

    @property
    def all_columns(self) -> tuple[Column, ...]:
        """The columns with those of the further languages, without the record."""
        further = (
            Column(EventField.EVENT_TEXT, heading or f"Event Text ({language_tag(language_id(language))})", "", language)
            for language, heading in self.languages
        )
        return (*self.columns, *further)


DEFAULT: Final = CsvSettings()


# OUT --------------------------------------------------------------------------------------------------------------------------


class _Pieces:
    """Where the csv module writes to."""

    def __init__(self) -> None:
        self._pieces: list[str] = []
        self.write = self._pieces.append

    def take(self) -> str:
        text = "".join(self._pieces)
        self._pieces.clear()
        return text


def export_csv(rows: Iterable[Stored], catalog: Names, settings: CsvSettings = DEFAULT) -> Iterator[str]:
    """The rows as CSV, in pieces of up to 256 rows. Times may be outside no range: each is of an event."""
    columns = settings.all_columns
    cells = [_cell(column, catalog, settings) for column in columns]
    headings = [column.heading or column.pointer or FIELD_ROWS[column.field].heading for column in columns]
    if settings.lossless:
        cells.append(_record)
        headings.append(RECORD)
    pieces = _Pieces()
    writer = csv.writer(pieces, delimiter=settings.delimiter, lineterminator=_END, quoting=csv.QUOTE_MINIMAL)
    if settings.byte_order_mark:
        pieces.write(_BOM)
    if settings.header:
        writer.writerow([escape(each) if settings.safe else each for each in headings])
    if start := pieces.take():
        yield start
    source = iter(rows)
    while chunk := list(islice(source, CHUNK_ROWS)):
        writer.writerows([cell(row) for cell in cells] for row in chunk)
        yield pieces.take()


def export_jsonl(rows: Iterable[Stored], catalog: Names, language: Language = ENGLISH) -> Iterator[str]:
    """The rows as JSON Lines: the fields of the wire, unique_id, arrival_ns, class_name and text."""
    source = iter(rows)
    while chunk := list(islice(source, CHUNK_ROWS)):
        yield "".join(_line(row, catalog, language) for row in chunk)


def _line(row: Stored, catalog: Names, language: Language) -> str:
    found: dict[str, object] = msgspec.to_builtins(row.event)
    found["unique_id"], found["arrival_ns"] = row.unique_id, row.arrival_ns
    found["class_name"] = catalog.class_name(row.event.event_class, language)
    found["text"] = catalog.event_text(row.event, language)
    return _json(found) + "\n"


def _json(item: object) -> str:
    try:
        return msgspec.json.encode(item).decode()
    except UnicodeEncodeError:  # a lone surrogate
        return json.dumps(msgspec.to_builtins(item), separators=(",", ":"))


def _record(row: Stored) -> str:
    return _json(row)


def escape(cell: str) -> str:
    """The cell as no spreadsheet takes it for a formula; unescape() undoes it."""
    return f"'{cell}" if _RISKY.match(cell) else cell


def unescape(cell: str) -> str:
    """What escape() was given."""
    return cell.removeprefix("'")


def _cell(column: Column, catalog: Names, settings: CsvSettings) -> _Cell:
    read = _reader(column, catalog, settings)
    risky = _RISKY.match

    def written(row: Stored) -> str:
        text = read(row)
        if text.isascii():
            return f"'{text}" if settings.safe and risky(text) else text
        text = text.encode("utf-8", "replace").decode("utf-8")
        return f"'{text}" if settings.safe and risky(text) else text

    return written


def _reader(column: Column, catalog: Names, settings: CsvSettings) -> _Cell:
    field = column.field
    language = settings.language if column.language is None else column.language
    if column.pointer:
        steps = JsonPointer(column.pointer).steps
        return lambda row: _pointed(row.event.json_attribute, steps)
    if field is EventField.SEVERITY_LEVEL:
        return lambda row: _SEVERITIES[row.event.severity]
    if field is EventField.DURATION:
        return lambda row: _seconds(value(field, row, catalog, language))
    if FIELD_ROWS[field].form == "time":
        style = settings.times
        return lambda row: style.text(int(value(field, row, catalog, language) or 0))

    def plain(row: Stored) -> str:
        found = value(field, row, catalog, language)
        return "" if found is None else str(found)

    return plain


_SEVERITIES: Final = {severity: severity.name.capitalize() for severity in Severity}


def _seconds(found: int | str | None) -> str:
    if found is None:
        return ""
    whole, rest = divmod(abs(int(found)), NS_PER_S)
    return f"{'-' if int(found) < 0 else ''}{whole}.{rest:09d}"


def _pointed(json_attribute: str, steps: tuple[str, ...]) -> str:
    found = find(read_json(json_attribute), steps) if json_attribute else NOTHING
    return "" if found is NOTHING else _written(found)


def _written(found: object, *, nested: bool = False) -> str:
    """A value as it stands in a cell; in an object or a list a text is JSON."""
    match found:
        case dict():
            pairs = (f"{json.dumps(name, ensure_ascii=False)}:{_written(each, nested=True)}" for name, each in found.items())
            return "{" + ",".join(pairs) + "}"
        case list():
            return "[" + ",".join(_written(each, nested=True) for each in found) + "]"
        case str() if nested and not isinstance(found, JsonNumber):
            return json.dumps(found, ensure_ascii=False)
    return text_of(found) or ""


# IN ---------------------------------------------------------------------------------------------------------------------------


def _lines(texts: Iterable[str]) -> Iterator[str]:
    """The text in pieces that each end with LF, as the csv module wants them; without a byte order mark."""
    rest, first = "", True
    for text in texts:
        if first and text:
            text, first = text.removeprefix(_BOM), False
        *whole, last = text.split("\n")
        for part in whole:
            yield f"{rest}{part}\n"
            rest = ""
        rest += last
    if rest:
        yield rest


def read_csv(texts: Iterable[str], *, delimiter: str = ";", safe: bool = True) -> Iterator[list[str]]:
    """The rows of an export as the texts that were written, the header first when it has one. CsvError for what is none."""
    return (row for _, _, row in _rows(texts, delimiter, safe, _refuse))


def _refuse(error: CsvError) -> None:
    raise error


def _rows(texts: Iterable[str], delimiter: str, safe: bool, on_bad: OnBad) -> Iterator[tuple[int, int, list[str]]]:
    """Number, first line and texts of each row."""
    csv.field_size_limit(max(csv.field_size_limit(), MAX_CELL))
    reader = csv.reader(_lines(texts), delimiter=delimiter, strict=True)
    for number in count(1):
        line = reader.line_num + 1
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            on_bad(CsvError(number, str(error), line))
        else:
            yield number, line, [unescape(cell) for cell in row] if safe else row


def import_csv(
    texts: Iterable[str], *, delimiter: str = ";", header: bool = True, safe: bool = True, on_bad: OnBad = _refuse
) -> Iterator[Stored]:
    """The events of a lossless export, equal to those that were exported.

    CsvError when the export was not lossless, and for a row that is none; on_bad is told instead, and it is left out.
    """
    for number, line, row in _rows(texts, delimiter, safe, on_bad):
        if header and number == 1:
            if row[-1:] != [RECORD]:
                raise CsvError(1, f"the last column is not {RECORD}: the export was not lossless")
            continue
        try:
            yield _stored(row[-1])
        except (ValueError, IndexError, RecursionError, msgspec.MsgspecError) as error:
            on_bad(CsvError(number, f"no record: {error}", line))


def import_jsonl(texts: Iterable[str], *, on_bad: OnBad = _refuse) -> Iterator[Stored]:
    """The events of an export as JSON Lines. CsvError for a line that is none; on_bad is told instead, and it is left out."""
    for number, line in enumerate(_lines(texts), 1):
        try:
            _check_encoding(line)
            data = json.loads(line) if "\\u" in line else None
            ids = msgspec.json.decode(line, type=_Ids) if data is None else msgspec.convert(data, _Ids)
            event = msgspec.json.decode(line, type=AnyEvent) if data is None else msgspec.convert(data, AnyEvent)
            yield Stored(event=cast(AnyEvent, event), unique_id=ids.unique_id, arrival_ns=ids.arrival_ns)
        except (ValueError, RecursionError, msgspec.MsgspecError) as error:
            on_bad(CsvError(number, f"no event: {error}"))


class _Ids(msgspec.Struct, frozen=True):
    unique_id: U32 = 0
    arrival_ns: Count = 0


def _check_encoding(text: str) -> None:
    """ValueError for what is no UTF-8 (read with surrogateescape); an export writes lone surrogates as escapes."""
    if not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f"no UTF-8 (character {error.start + 1})") from None


def _stored(record: str) -> Stored:
    _check_encoding(record)
    try:
        return msgspec.json.decode(record, type=Stored)
    except (msgspec.MsgspecError, UnicodeError):
        return msgspec.convert(json.loads(record), Stored)
