"""Stored events as CSV and JSON Lines: what a spreadsheet sees, and that everything comes back."""

import csv
import json
from collections.abc import Iterator
from itertools import islice

import pytest

from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry, LanguageError
from bridge.core.csv_export import (
    CHUNK_ROWS,
    Column,
    CsvError,
    CsvSettings,
    escape,
    export_csv,
    export_jsonl,
    import_csv,
    import_jsonl,
    read_csv,
    unescape,
)
from bridge.core.event_fields import EventField
from bridge.core.events import AnyEvent, Severity
from bridge.core.hresult import AdsError
from bridge.core.questions import Stored
from bridge.core.time_forms import TimeForm, TimeStyle
from bridge.testing.builders import EVENT_CLASS, TIME_NS, alarm_cleared, alarm_raised, message_sent

CLASS = EventClass(
    EVENT_CLASS,
    "Pumps",
    "Pump faults",
    {1: EventEntry(1, "Dry", Severity.ERROR, "dry {0}")},
    {"dry {0}": {1031: "trocken {0}"}, "Pump faults": {1031: "Pumpen"}},
)
CATALOG = Catalog([CLASS])
HOSTILE = [
    "",
    "\0",
    "a;b,c\td",
    '"',
    'a"b""c',
    "\r",
    "\n",
    "\r\n",
    "a\r\nb",
    "=1+1",
    "+1",
    "-1",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "  =1",
    "\u00a0=1",
    "＝1+1",
    "'",
    "''=1",
    "'=1",
    " a ",
    "Ω 日本語 العربية हिन्दी 🔥 e\u0301",
    "a\x0bb\x0cc\x1cd\x85e\u2028f\u2029g",
    "\ufeff",
    "\ufeff=1",
    "Record",
    "x" * 200_000,
]


def row(event: AnyEvent, unique_id: int = 1) -> Stored:
    """An event as the log has it."""
    return Stored(event=event, unique_id=unique_id, arrival_ns=TIME_NS + unique_id)


def table(events: list[AnyEvent], settings: CsvSettings) -> list[list[str]]:
    """The rows as an ordinary CSV reader sees them."""
    text = "".join(export_csv(map(row, events), CATALOG, settings))
    return list(csv.reader(text.splitlines(keepends=True), delimiter=settings.delimiter))


def test_the_default_is_what_the_manual_says() -> None:
    """Semicolon, header, 1033, and the columns of the Logged Events window."""
    event = alarm_raised(severity=Severity.ERROR, source_name="MAIN.pump", arguments=(Argument.of(3),))
    (text,) = ["".join(export_csv([row(event, 7)], CATALOG))]
    assert text == (
        "Time;Event;Severity Level;Event Class Name;Event Id;Unique Id;Event Text;Source Name;Time Raised;Time Cleared;"
        "Time Confirmed\r\n"
        "2026-11-22T08:00:00Z;alarm_raised;Error;Pump faults;1;7;dry 3;MAIN.pump;2026-11-22T08:00:00Z;;\r\n"
    )


def test_columns_headings_languages_and_pointers() -> None:
    """Chosen fields in the chosen order, a text in three languages, values from inside the JSON attribute."""
    attribute = '{"axis": {"no": 3.50, "on": true, "none": null, "list": [1, "a\\"é", {"b": 1e3}]}}'
    settings = CsvSettings(
        language=1031,
        columns=(
            Column(EventField.EVENT_TEXT, "Was"),
            Column(EventField.EVENT_CLASS_NAME),
            Column(EventField.JSON_ATTRIBUTE, "Achse", "/axis/no"),
            *(Column(EventField.JSON_ATTRIBUTE, "", f"/axis/{name}") for name in ("on", "none", "list", "gone")),
        ),
        languages=((1033, ""), ("de", "Deutsch")),
    )
    assert table([message_sent(json_attribute=attribute, arguments=(Argument.of("x"),))], settings) == [
        [
            "Was",
            "Event Class Name",
            "Achse",
            "/axis/on",
            "/axis/none",
            "/axis/list",
            "/axis/gone",
            "Event Text (en-US)",
            "Deutsch",
        ],
        ["trocken x", "Pumpen", "3.50", "true", "null", '[1,"a\\"é",{"b":1e3}]', "", "dry x", "trocken x"],
    ]


def test_every_field_has_a_value() -> None:
    """Every TcEventField and ours, of an alarm that was cleared."""
    event = alarm_cleared(time_ns=TIME_NS + 1_500_000_000, source_id=5, source_guid=EVENT_CLASS, operator="anna", comment="why")
    settings = CsvSettings(columns=tuple(map(Column, EventField)), header=False)
    (cells,) = table([event], settings)
    found = dict(zip(EventField, cells, strict=True))
    assert found[EventField.DURATION] == "1.500000000"
    assert found[EventField.ALARM_STATE] == "Inactive(Cleared)"
    assert found[EventField.EVENT_CLASS] == found[EventField.SOURCE_GUID] == EVENT_CLASS
    assert (found[EventField.SOURCE_ID], found[EventField.SOURCE_NAME]) == ("5", "")
    assert (found[EventField.OPERATOR], found[EventField.CLIENT], found[EventField.COMMENT]) == ("anna", "", "why")
    assert found[EventField.TIME_CLEARED] == "2026-11-22T08:00:01.5Z"


def test_a_message_has_its_time_as_time_raised() -> None:
    """As the manual says of TimeRaised (6.1.2.3); its state is <message> and it lasts nothing."""
    columns = tuple(map(Column, (EventField.TIME_RAISED, EventField.ALARM_STATE, EventField.DURATION)))
    settings = CsvSettings(columns=columns, header=False, times=TimeStyle(TimeForm.FILETIME))
    assert table([message_sent()], settings) == [[str(TIME_NS // 100 + 116_444_736_000_000_000), "<message>", ""]]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_text_comes_back(text: str) -> None:
    """As a cell, as a heading and as a record, whatever it holds; and no spreadsheet takes it for a formula."""
    columns = (Column(EventField.SOURCE_NAME, text), Column(EventField.JSON_ATTRIBUTE), Column(EventField.COMMENT))
    for delimiter in ";,\t|":
        settings = CsvSettings(delimiter=delimiter, columns=columns, lossless=True)
        rows = [row(message_sent(source_name=text, json_attribute=text, comment=f"a{text}"), n) for n in (1, 2)]
        made = "".join(export_csv(rows, CATALOG, settings))
        head, *found = read_csv(iter(made), delimiter=delimiter)
        assert head[0] == (text or "Source Name")
        assert [cells[:3] for cells in found] == [[text, text, f"a{text}"]] * 2
        assert list(import_csv([made], delimiter=delimiter)) == rows
        assert escape(text).lstrip()[:1] not in tuple("=+-@＝＋－＠")
        assert escape(text)[:1] not in ("\t", "\r", "\n")
        assert unescape(escape(text)) == text


def test_a_lone_surrogate_stays_in_the_record() -> None:
    """A cell shows a question mark, so that any file can hold it; the event comes back as it was, from CSV and JSON Lines."""
    rows = [row(message_sent(source_name="a\ud800", comment="\udfff"))]
    made = "".join(export_csv(rows, CATALOG, CsvSettings(columns=(Column(EventField.SOURCE_NAME),), lossless=True)))
    assert made.encode().startswith(b"Source Name;Record\r\na?;")
    assert list(import_csv([made])) == rows
    lines = "".join(export_jsonl(rows, CATALOG))
    lines.encode()
    assert list(import_jsonl([lines])) == rows


@pytest.mark.parametrize("text", HOSTILE)
def test_json_lines_come_back(text: str) -> None:
    """One line per event, whatever is in it, cut anywhere."""
    rows = [row(message_sent(source_name=text, json_attribute=text), n) for n in (1, 2)]
    made = "".join(export_jsonl(rows, CATALOG, 1031))
    assert made.count("\n") == 2
    assert list(import_jsonl(iter(made))) == rows
    assert json.loads(made.split("\n")[0])["class_name"] == "Pumpen"


def test_rows_are_asked_for_as_they_are_written() -> None:
    """Nothing is held: the first piece comes after the header, the second after some hundred rows."""
    asked = 0

    def rows() -> Iterator[Stored]:
        nonlocal asked
        while True:
            asked += 1
            yield row(message_sent(), asked)

    pieces = export_csv(rows(), CATALOG)
    assert [piece.count("\r\n") for piece in islice(pieces, 3)] == [1, CHUNK_ROWS, CHUNK_ROWS]
    assert asked == 2 * CHUNK_ROWS


def test_without_header_and_with_a_mark() -> None:
    """The byte order mark, which some spreadsheets need, is no part of the first cell."""
    settings = CsvSettings(header=False, byte_order_mark=True, lossless=True, columns=(Column(EventField.KIND),))
    made = "".join(export_csv([row(message_sent())], CATALOG, settings))
    assert made.startswith("\ufeffmessage_sent;")
    assert list(import_csv([made], header=False)) == [row(message_sent())]


def test_a_formula_is_kept_on_demand() -> None:
    """Who reads with a program wants no escape: then nothing is added and nothing is taken away."""
    settings = CsvSettings(safe=False, columns=(Column(EventField.SOURCE_NAME),), header=False)
    made = "".join(export_csv([row(message_sent(source_name=name)) for name in ("=1", "'x")], CATALOG, settings))
    assert made == "=1\r\n'x\r\n"
    assert list(read_csv([made], safe=False)) == [["=1"], ["'x"]]


@pytest.mark.parametrize(
    ("text", "at", "reason"),
    [
        ("a;b\r\n", 1, "not lossless"),
        ("", 0, ""),
        ("Record\r\n{}\r\n", 2, "no record"),
        ("Record\r\nnot json\r\n", 2, "no record"),
        ("Record\r\n\r\n", 2, "no record"),
        ('Record\r\n"open', 2, "unexpected end"),
        ('Record\r\n"a"b\r\n', 2, "expected"),
    ],
)
def test_what_is_no_export_is_refused_with_its_row(text: str, at: int, reason: str) -> None:
    """Which row, and why; an empty text is no event."""
    if not at:
        assert list(import_csv([text])) == []
        return
    with pytest.raises(CsvError, match=reason) as refused:
        list(import_csv([text]))
    assert refused.value.row == at
    with pytest.raises(CsvError, match="row 1: no event"):
        list(import_jsonl(["{}\n"]))


def test_bad_rows_are_told_and_left_out() -> None:
    """Each with its row, the line it begins on and what is wrong; all others come, also behind an open quote and no UTF-8."""
    rows = [row(message_sent(source_name="a\nb", seq=number), number) for number in range(1, 5)]
    columns = (Column(EventField.SOURCE_NAME),)
    head, *pieces = (list(export_csv([each], CATALOG, CsvSettings(columns=columns, lossless=True))) for each in rows)
    made = [*head, "x;not json\r\n", pieces[0][1], '"x"y;{}\r\n', pieces[1][1], "caf\udce9\r\n", pieces[2][1], '"open;']
    told: list[CsvError] = []
    assert list(import_csv(made, on_bad=told.append)) == rows
    assert [(error.row, error.line) for error in told] == [(3, 4), (5, 7), (7, 10), (9, 13)]
    assert [error.reason.partition(":")[0] for error in told][::2] == ["no record", "no record"]
    assert "no UTF-8 (character 4)" in told[2].reason
    lines = [*export_jsonl(rows[:1], CATALOG), "{}\n", "caf\udce9\n", *export_jsonl(rows[1:2], CATALOG)]
    told.clear()
    assert list(import_jsonl(lines, on_bad=told.append)) == rows[:2]
    assert [(error.row, error.line) for error in told] == [(2, 2), (3, 3)]


@pytest.mark.parametrize("delimiter", ["", ";;", '"', "'", "\r", "\n", "a", "1"])
def test_a_delimiter_must_be_told_from_the_rest(delimiter: str) -> None:
    """One character that is no quote, line end, letter or digit."""
    with pytest.raises(ValueError, match="delimiter"):
        CsvSettings(delimiter=delimiter)


def test_settings_are_checked_where_they_are_made() -> None:
    """A pointer without the JSON attribute, a pointer that is none, an unknown language."""
    with pytest.raises(ValueError, match="needs the field json_attribute"):
        Column(EventField.EVENT_ID, pointer="/a")
    with pytest.raises(AdsError):
        Column(EventField.JSON_ATTRIBUTE, pointer="a")
    with pytest.raises(LanguageError):
        CsvSettings(language="xx-YY")
    with pytest.raises(LanguageError):
        Column(EventField.EVENT_TEXT, language="xx-YY")


# Times.

ALL_FORMS = [
    (TimeForm.FILETIME, 0, "", "134398080005000000"),
    (TimeForm.ISO8601, -1, "", "2026-11-22T08:00:00.50000012Z"),
    (TimeForm.ISO8601, 0, "", "2026-11-22T08:00:00Z"),
    (TimeForm.ISO8601, 7, "", "2026-11-22T08:00:00.5000001Z"),
    (TimeForm.IEC_DATE_AND_TIME, 3, "", "DT#2026-11-22-08:00:00.500"),
    (TimeForm.LOCALIZED, 3, "", "22.11.2026 08:00:00.500"),
    (TimeForm.CUSTOM, 3, "%d/%m %H", "22/11 08"),
]


@pytest.mark.parametrize(("form", "precision", "pattern", "text"), ALL_FORMS)
def test_the_forms_of_a_time(form: TimeForm, precision: int, pattern: str, text: str) -> None:
    """The six forms in UTC; a time that is not set is empty in each."""
    time_ns = TIME_NS + 500_000_120
    style = TimeStyle(form, precision, 1031, pattern)
    if form is TimeForm.FILETIME:
        text = str(time_ns // 100 + 116_444_736_000_000_000)
    assert (style.text(time_ns), style.text(0)) == (text, "")


def test_a_variant_time_counts_days() -> None:
    """Since 1899-12-30: noon of 1970-01-02 is 25570.5."""
    assert TimeStyle(TimeForm.VARIANT_TIME).text(129_600_000_000_000) == "25570.5"


def test_local_time() -> None:
    """The caller knows how far it is ahead at each instant; a FILETIME is always UTC."""
    asked: list[int] = []

    def offset(second: int) -> int:
        asked.append(second)
        return -12_600

    assert TimeStyle(offset_s=offset).text(TIME_NS) == "2026-11-22T04:30:00-03:30"
    assert TimeStyle(TimeForm.LOCALIZED, 0, 1033, offset_s=offset).text(TIME_NS + 10**9) == "11/22/2026 04:30:01 AM"
    assert TimeStyle(TimeForm.CUSTOM, pattern="%H:%M %z", offset_s=offset).text(TIME_NS) == "04:30 -0330"
    assert asked == [TIME_NS // 10**9, TIME_NS // 10**9 + 1, TIME_NS // 10**9]
    assert TimeStyle(TimeForm.FILETIME, offset_s=offset).text(TIME_NS) == TimeStyle(TimeForm.FILETIME).text(TIME_NS)


def test_a_language_without_a_table_is_written_like_iso() -> None:
    """And the fraction of an American time stands before AM and PM."""
    assert TimeStyle(TimeForm.LOCALIZED, 0, "fi-FI").text(TIME_NS) == "2026-11-22 08:00:00"
    assert TimeStyle(TimeForm.LOCALIZED, 3, 1033).text(TIME_NS) == "11/22/2026 08:00:00.000 AM"


def test_a_style_is_checked() -> None:
    """A precision that TcExportTimePrecision does not have; a pattern and no custom form, and the other way round."""
    with pytest.raises(ValueError, match="precision"):
        TimeStyle(precision=2)
    for style in ((TimeForm.CUSTOM, ""), (TimeForm.ISO8601, "%H")):
        with pytest.raises(ValueError, match="pattern"):
            TimeStyle(style[0], pattern=style[1])
