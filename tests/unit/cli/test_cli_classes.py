"""The commands of event classes on files: what they print, what they write, and how they end."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core.class_lint import RULES
from bridge.core.events import Severity
from bridge.edges.bus import ALONE, open_bus
from bridge.edges.class_files import load_catalog
from bridge.logger import EventLogger
from bridge.recorder import Recorder

ROOT = Path(__file__).parents[3]
PLANT = str(ROOT / "examples" / "plant.tmc")
FAULTS = "ad4adf83-39ab-40c0-a603-795c27820b17"
TEXT = """[[classes]]
name = "Pump"
display_text = "Pumps"
translations = { de-DE = "Pumpen" }
[[classes.events]]
id = 1
name = "RanDry"
severity = "error"
display_text = "Pump {0} ran dry"
translations = { de-DE = "Pumpe {0} lief trocken" }
"""
Call = Callable[..., tuple[int, list[str], str]]


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Run `tcbridge classes ...` in an empty folder: exit code, lines of stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def run_it(*arguments: str) -> tuple[int, list[str], str]:
        code = run(["classes", *arguments])
        out = capsys.readouterr()
        return code, out.out.splitlines(), out.err

    return run_it


def test_list_names_every_class(call: Call) -> None:
    """Name, GUID, version, events, languages, text in the language; the same for programs."""
    code, lines, _ = call("list", PLANT, "--lang", "de")
    assert (code, lines[0].split()[:4], len(lines)) == (Exit.OK, ["Class", "GUID", "Version", "Events"], 3)
    assert lines[2].split()[:6] == ["Faults", FAULTS, "newest", "3", "de-DE", "Störungen"]
    code, lines, _ = call("list", "--classes", PLANT, "--json")
    assert [json.loads(line)["class"] for line in lines] == ["Line", "Faults"]


def test_list_without_files_is_wrong_usage(call: Call) -> None:
    """Neither FILES nor --classes; a file that is not there."""
    assert call("list")[::2] == (Exit.USAGE, "tcbridge: no event classes: name files, or --classes\n")
    assert call("list", "gone.tmc")[0] == Exit.USAGE


def test_list_says_what_cannot_be_read(call: Call) -> None:
    """What is whole is listed; the code is 1."""
    Path("bad.tmc").write_text("<TcModuleClass><DataTypes></TcModuleClass>")
    code, lines, error = call("list", PLANT, "bad.tmc")
    assert (code, len(lines)) == (Exit.NO, 3)
    assert error.startswith("warning: bad.tmc:1: ")


def test_show_is_one_class_in_a_language(call: Call) -> None:
    """By name or GUID; an unknown name is wrong usage with what was probably meant."""
    code, lines, _ = call("show", "Faults", "--classes", PLANT, "--lang", "de")
    assert code == Exit.OK
    assert lines[-1].split() == ["3", "OilHot", "warning", "Öl", "hat", "{0}", "°C,", "erlaubt", "sind", "{1}"]
    code, (line,), _ = call("show", FAULTS.upper(), "--classes", PLANT, "--json")
    assert json.loads(line)["events"]["1"]["name"] == "LagError"
    code, _, error = call("show", "Fault", "--classes", PLANT)
    assert (code, "did you mean 'Faults'" in error) == (Exit.USAGE, True)


def test_lint_says_file_and_line(call: Call) -> None:
    """A TOML class with a forgotten placeholder and a missing translation: 1, and 0 when it is mended."""
    Path("pump.classes.toml").write_text(TEXT.replace("Pumpe {0}", "Pumpe") + 'comment = "c"\n')
    code, lines, error = call("lint", "pump.classes.toml", "--language", "de", "--language", "fr")
    assert code == Exit.NO
    assert [line.split(": ")[:2] for line in lines] == [
        ["pump.classes.toml:1", "missing-language"],
        ["pump.classes.toml:5", "missing-language"],
        ["pump.classes.toml:5", "placeholders-differ"],
    ]
    assert error == "3 findings in 1 classes of 1 files\n"
    code, lines, _ = call("lint", "pump.classes.toml", "--json")
    assert [json.loads(line)["name"] for line in lines] == ["Pump"]
    Path("pump.classes.toml").write_text(TEXT)
    assert call("lint", "pump.classes.toml")[:2] == (Exit.OK, [])
    assert call("lint", "pump.classes.toml", "--text-limit", "60")[0] == Exit.NO


def test_the_rules_are_documented() -> None:
    """docs/commands.md has each rule with the words of the table."""
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    rows = {line for line in page.splitlines() if line.startswith("| `")}
    assert {f"| `{rule}` | {text} |" for rule, text in RULES.items()} <= rows


def test_diff_of_files_and_of_classes(call: Call) -> None:
    """Files class by class; two versions of one file by GUID; 0 when nothing changed."""
    Path("old.classes.toml").write_text(TEXT)
    Path("new.classes.toml").write_text(TEXT.replace('severity = "error"', 'severity = "warning"'))
    code, lines, _ = call("diff", "old.classes.toml", "new.classes.toml")
    assert (code, lines[0]) == (Exit.NO, "Pump: listeners notice")
    assert "  event 1 (RanDry) severity: 'error' -> 'warning'" in lines
    code, (line,), _ = call("diff", "old.classes.toml", "new.classes.toml", "--json")
    assert [change["what"] for change in json.loads(line)["changes"]] == ["GUID", "event 1 (RanDry) severity"]
    assert call("diff", "old.classes.toml", "old.classes.toml") == (Exit.OK, [], "")
    assert call("diff", "Line", "Faults", "--classes", PLANT)[0] == Exit.NO
    assert call("diff", "Line", "Nothing", "--classes", PLANT)[0] == Exit.USAGE


def test_new_convert_and_back(call: Call) -> None:
    """A class from the command line, as TOML and TMC, is the same class everywhere."""
    event = ("--event", "1:RanDry:error:Pump {0}: ran dry", "--event", "2:Hot:warning")
    code, lines, _ = call("new", "opt.Pump", "--display-text", "Pumps", *event, "--output", "pump.classes.toml")
    assert (code, lines) == (Exit.OK, ["pump.classes.toml: 1 classes"])
    assert call("convert", "pump.classes.toml", "--output", "pump.tmc")[0] == Exit.OK
    assert call("new", "opt.Pump", "--display-text", "Pumps", *event, "--output", "direct.tmc")[0] == Exit.OK
    (first,), (second,), (third,) = (load_catalog([name])[0] for name in ("pump.classes.toml", "pump.tmc", "direct.tmc"))
    assert first == second == third
    assert (first.qualified_name, first.events[1].display_text) == ("opt.Pump", "Pump {0}: ran dry")
    assert first.events[2].severity is Severity.WARNING


def test_new_without_a_file_prints_what_to_begin_with(call: Call) -> None:
    """TOML with one event; for programs in one object. A bad event is wrong usage."""
    code, lines, _ = call("new", "Pump")
    assert (code, lines[0], 'name = "Event1"' in lines) == (Exit.OK, "[[classes]]", True)
    code, (line,), _ = call("new", "Pump", "--json")
    assert json.loads(line)["content"].startswith("[[classes]]")
    assert call("new", "Pump", "--event", "x:y")[0] == Exit.USAGE
    assert call("new", "Pump", "--event", "1:A:error", "--event", "1:B:error")[0] == Exit.USAGE


def test_nothing_is_overwritten_unasked(call: Call) -> None:
    """A file that is there stays, unless --overwrite; an ending that is none is refused; so is a source that is broken."""
    Path("x.toml").write_text("mine")
    code, _, error = call("convert", PLANT, "--output", "x.toml")
    assert (code, "--overwrite" in error, Path("x.toml").read_text()) == (Exit.USAGE, True, "mine")
    assert call("convert", PLANT, "--output", "x.toml", "--overwrite")[0] == Exit.OK
    assert call("convert", PLANT, "--output", "plant.tsproj")[0] == Exit.USAGE
    Path("bad.tmc").write_text("<TcModuleClass><DataTypes></TcModuleClass>")
    assert call("convert", PLANT, "bad.tmc", "--output", "y.toml")[0] == Exit.USAGE
    assert sorted(path.name for path in Path().iterdir()) == ["bad.tmc", "x.toml"]


def test_generate_python_and_json(call: Call) -> None:
    """By --to or by the ending; both name the event."""
    assert call("generate", PLANT, "--output", "plant_events.py")[0] == Exit.OK
    assert "LagError" in Path("plant_events.py").read_text()
    assert call("generate", PLANT, "--output", "plant.json")[0] == Exit.OK
    assert {each["name"] for each in json.loads(Path("plant.json").read_text())["classes"]} == {"Line", "Faults"}
    code, lines, _ = call("generate", PLANT, "--to", "json")
    assert (code, "\n".join(lines) + "\n") == (Exit.OK, Path("plant.json").read_text())


@pytest.mark.parametrize("ending", ["csv", "xml"])
def test_translations_go_out_and_come_back(call: Call, ending: str) -> None:
    """Exported with a new language, filled in, imported: the classes have it, under the same GUID."""
    Path("pump.classes.toml").write_text(TEXT)
    table = f"texts.{ending}"
    assert (
        call("translations", "export", "pump.classes.toml", "--language", "de", "--language", "fr", "--output", table)[0] == 0
    )
    text = Path(table).read_text(encoding="utf-8-sig")
    assert "Pumpe {0} lief trocken" in text
    Path(table).write_text(text.replace("Pumpe {0} lief trocken", "Pumpe {0} trocken"), encoding="utf-8")
    code, lines, _ = call("translations", "import", table, "pump.classes.toml", "--output", "new.classes.toml", "--json")
    assert (code, json.loads(lines[0])["changed"]) == (Exit.OK, 1)
    (old,), (new,) = (load_catalog([name])[0] for name in ("pump.classes.toml", "new.classes.toml"))
    assert old.guid == new.guid
    assert new.translated("Pump {0} ran dry", 1031) == "Pumpe {0} trocken"


def test_a_table_for_other_classes_is_told(call: Call) -> None:
    """Texts that no class has are named, and the code is 1; a table that is none is wrong usage."""
    Path("pump.classes.toml").write_text(TEXT)
    assert call("translations", "export", PLANT, "--output", "plant.csv")[0] == Exit.OK
    code, _, error = call("translations", "import", "plant.csv", "pump.classes.toml", "--output", "new.tmc")
    assert (code, "no class has this text: 'Faults'" in error) == (Exit.NO, True)
    Path("none.csv").write_text("a,b\n")
    assert call("translations", "import", "none.csv", "pump.classes.toml", "--output", "z.tmc")[0] == Exit.USAGE
    assert call("translations", "import", "gone.csv", "pump.classes.toml", "--output", "z.tmc")[0] == Exit.USAGE


def test_unused_translations_go(call: Call) -> None:
    """A translation of a text that nothing has is named and left out, on the level of a file and of a class."""
    text = Path(PLANT).read_text(encoding="utf-8")
    extra = '<Translations><Text TxtId="Old text"><Text LcId="1031">Alter Text</Text></Text>'
    assert "<Translations>" in text
    Path("plant.tmc").write_text(text.replace("<Translations>", extra, 1), encoding="utf-8")
    code, lines, error = call("delete-unused", "plant.tmc", "--output", "clean.tmc")
    assert (code, lines, error) == (Exit.OK, ["clean.tmc: 2 classes, 1 deleted"], "not used: 'Old text'\n")
    assert "Alter Text" not in Path("clean.tmc").read_text(encoding="utf-8")
    assert list(load_catalog(["clean.tmc"])[0]) == list(load_catalog([PLANT])[0])


def test_where_classes_are_used(call: Call) -> None:
    """In a recording and in a cache: which class, which event, how often; lint knows a hidden class that is used."""
    old, other = "11111111-0000-4000-8000-000000000001", "11111111-0000-4000-8000-000000000009"
    Path("pump.classes.toml").write_text(TEXT.replace('name = "Pump"', f'name = "Pump"\nhides = ["{old}"]'))
    with open_bus(ALONE) as bus, Recorder(bus, "plant.mcap"), EventLogger("plc1", bus=bus, cache="plc1.db") as logger:
        for _ in range(3):
            logger.send_message(old, 1, Severity.ERROR)
        logger.send_message(other, 7, Severity.ERROR)
    code, lines, _ = call("where-used", "plant.mcap", "plc1.db", "--classes", "pump.classes.toml")
    assert code == Exit.OK
    for file, number in (("plant.mcap", 1), ("plc1.db", 3)):
        assert lines[number].split() == [old, "1", "3", file]
        assert lines[number + 1].split() == [other, "7", "1", file]
    code, lines, _ = call("where-used", "plc1.db", "--class", "Pump", "--classes", "pump.classes.toml", "--json")
    assert [(json.loads(line)["event_class"], json.loads(line)["count"]) for line in lines] == [(old, 3)]
    code, lines, _ = call("lint", "pump.classes.toml", "--used", "plant.mcap")
    assert (code, [line.split(": ")[1] for line in lines]) == (Exit.NO, ["hidden-in-use"])
    assert call("where-used", "gone.mcap")[0] == Exit.USAGE
