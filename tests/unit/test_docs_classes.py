"""The examples of docs/classes.md are read, run and compared."""

import codecs
import re
import runpy
import uuid
from pathlib import Path

import msgspec
import pytest

from bridge.core.catalog import Catalog, CauseRemedy, Detail
from bridge.core.class_toml import read_classes, write_classes
from bridge.core.definitions import NAMESPACE, content_guid
from bridge.core.tmc import read_classes as read_tmc
from bridge.core.tmc_writer import braced
from bridge.core.translations import imported, read_csv, read_xml

PAGE = (Path(__file__).parents[2] / "docs" / "classes.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def block(language: str, index: int = 0) -> str:
    texts: list[str] = [text for kind, text in BLOCKS if kind == language]
    return texts[index]


def test_the_toml_example_is_a_class() -> None:
    """It loads without a word, has what it shows, and reads back equal."""
    result = read_classes(block("toml").encode(), "docs/classes.md")
    assert result.problems == ()
    catalog = Catalog(result.classes)
    pump = catalog.newest("Pump")
    assert catalog.class_name(pump.guid, "de") == "Pumpen"
    assert catalog.text(pump.guid, 1, (), "ja") == "ポンプ {0} 始動"
    assert catalog.causes(pump.guid, 2, "de") == (CauseRemedy(1, "Dirt in the inlet", "Sieb reinigen"),)
    assert catalog.details(pump.guid, 2) == (Detail("Wiring", "Sheet 3"),)
    assert read_classes(write_classes(result.classes)).classes == result.classes


def test_every_key_has_its_row() -> None:
    """The two tables name exactly the keys that are read."""
    tables = re.findall(r"^\| key \|.*?\n\n", PAGE, re.MULTILINE | re.DOTALL)
    documented = [set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) for table in tables]
    problems = read_classes(b"[[classes]]\nqqqq = 1\n[[classes.events]]\nqqqq = 1\n").problems
    keys = [set(problem.message.partition("expected one of ")[2].split(", ")) for problem in problems]
    assert sorted(documented, key=len) == sorted(keys, key=len)


def test_the_python_example_runs(tmp_path: Path) -> None:
    """Its own assertions hold."""
    program = tmp_path / "example.py"
    program.write_text(block("python"), encoding="utf-8")
    names = runpy.run_path(str(program))
    assert names["newer"].guid != names["pump"].guid


def test_the_example_on_the_bus_runs(tmp_path: Path) -> None:
    """The second Python example's own assertions hold; it needs no file."""
    program = tmp_path / "example.py"
    program.write_text(block("python", 1), encoding="utf-8")
    assert runpy.run_path(str(program))["texts"].questions == 1


def test_the_guid_is_computed_as_described(tmp_path: Path) -> None:
    """The JSON of the page is the content of the Python example's class, in the namespace of the page."""
    program = tmp_path / "example.py"
    program.write_text(block("python"), encoding="utf-8")
    pump = runpy.run_path(str(program))["pump"]
    content = block("json").strip()
    assert f"`{NAMESPACE}`" in PAGE
    assert str(uuid.uuid5(NAMESPACE, content)) == content_guid(pump) == pump.guid
    assert msgspec.json.encode(msgspec.json.decode(content)).decode() == content


def test_the_xml_example_is_an_event() -> None:
    """Causes and details are read from where the page says."""
    name = f'<Name GUID="{braced(str(NAMESPACE))}">Pump</Name>'
    data = f"<TcModuleClass><DataTypes><DataType>{name}{block('xml')}</DataType></DataTypes></TcModuleClass>"
    result = read_tmc(data.encode())
    assert result.problems == ()
    entry = result.classes[0].events[2]
    assert entry.causes == (CauseRemedy(1, "Dirt in the inlet", "Clean the sieve"),)
    assert entry.details == (Detail("Wiring", "Sheet 3", "left cabinet"),)


@pytest.mark.parametrize("kind", ["xml", "csv"])
def test_the_translations_of_the_page_fit_its_class(kind: str) -> None:
    """Both files say what the TOML example says already; the CSV names its GUID."""
    (pump,) = read_classes(block("toml").encode()).classes
    table = read_xml(block("xml", 1).encode()) if kind == "xml" else read_csv(codecs.BOM_UTF8 + block("csv").encode())
    result = imported([pump], table)
    assert (result.classes, result.added, result.changed, result.unknown) == ((pump,), 0, 0, ())
