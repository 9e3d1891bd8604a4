"""What commands make of class files: TOML beside TMC, and the warning about old versions."""

from pathlib import Path

import pytest

from bridge.cli.exits import Usage
from bridge.cli.options import parse_filter
from bridge.cli.show import source_text
from bridge.core.catalog import Catalog, EventEntry
from bridge.core.class_toml import write_classes
from bridge.core.definitions import define_class, edited
from bridge.core.events import MessageSent, Severity
from bridge.core.tmc_writer import write_classes as write_tmc
from bridge.edges.class_files import class_files, load_catalog, read_class_file

OLD = define_class("Pump", "Pumps", [EventEntry(1, "Start", Severity.INFO, "start")])
NEW = edited(OLD, define_class("Pump", "Pumps", [EventEntry(1, "Start", Severity.INFO, "starts")]))


def test_a_filter_by_an_old_version_is_warned(capsys: pytest.CaptureFixture[str]) -> None:
    """Once per old version, on stderr; the filter is as it was written, and one by name says nothing."""
    known = Catalog([OLD, NEW])
    parse_filter(f"event_class = '{OLD.guid}' and severity > info", known)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"warning: event class Pump {OLD.guid} is an older version, hidden by Pump {NEW.guid}")
    parse_filter("event_class = Pump", known)
    parse_filter("", known)
    assert capsys.readouterr().err == ""
    with pytest.raises((Usage, ValueError)):
        parse_filter("event_class =", known)


def test_a_folder_holds_both_kinds_of_files(tmp_path: Path) -> None:
    """TMC and .classes.toml; a settings file beside them is somebody else's, but read when it is named itself."""
    (tmp_path / "new.tmc").write_bytes(write_tmc([NEW]))
    (tmp_path / "OLD.Classes.TOML").write_bytes(write_classes([OLD]))
    settings = tmp_path / "tcbridge.toml"
    settings.write_text('lang = "de"\n', "utf-8")
    catalog, problems = load_catalog([tmp_path])
    assert problems == []
    assert catalog.newest("Pump") == NEW
    assert len(catalog) == 2
    assert [path.name for path in class_files([tmp_path])] == ["OLD.Classes.TOML", "new.tmc"]
    (problem,) = read_class_file(settings).result.problems
    assert (problem.file, problem.line) == (str(settings), 1)
    assert problem.message == "unknown key 'lang'; expected [[classes]]"


def test_a_source_is_shown_in_the_asked_language() -> None:
    """By the class of its GUID; without one as it came."""
    names = define_class(
        "Sources", "", [EventEntry(1, "Pump", Severity.INFO, "Main.Pump")], translations={"Main.Pump": {"de": "Hauptpumpe"}}
    )
    event = MessageSent(
        target="plc1",
        event_class=OLD.guid,
        event_id=1,
        severity=Severity.INFO,
        source_name="Main.Pump",
        source_guid=names.guid,
    )
    known = Catalog([names])
    assert [source_text(event, known, lang) for lang in ("de", "en")] == ["Hauptpumpe", "Main.Pump"]
    assert source_text(event) == source_text(event, Catalog(), "de") == "Main.Pump"
