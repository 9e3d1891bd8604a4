"""docs/tccom.md against the Tc3_Module manual and against the code: every documented name has a row, every row a name."""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core import hresult
from bridge.core.module_instances import read_plant

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tccom.md"
SEEDS = (ROOT / ".." / "shared" / "seeds").resolve()
MANUALS = sorted(SEEDS.glob("000_*.txt"))
CONCEPTS = sorted(SEEDS.glob("002_*.txt"))
needs_manual = pytest.mark.skipif(not MANUALS or not CONCEPTS, reason="the manual is not part of this repository")

TITLE = re.compile(r"(?<![\d.])([3-8](?:\.\d+)*) ([A-Z][^.]*?) ?\.{5,}")
"""A line of the table of contents."""
CONSTANT = re.compile(r"\b(\w+(?: \w+)*) : (?:HRESULT|OTCID|PVOID) := ")
TYPE = re.compile(r": (?:REFERENCE TO |POINTER TO )?([A-Z][\w ]*);")
METHOD = re.compile(r"\b(8\.2\.\d\.\d+) Method ITc (?:Com Object|Unknown):(Tc(?: [A-Z][a-z]+)+?)(?:\(| The | This | Query of )")
STATE = re.compile(r"(State: [A-Z]+|Transition: [A-Z]+ to [A-Z]+ \([A-Z]{2}\))")
INTERFACE = re.compile(r"\bI[Tt](c|Com)([A-Z]\w+)")
SPLIT = re.compile(r"\b(?:Twin CAT|Tc COM|ITCom Object|ITc Unknown)\b")
"""Words in sentences that the print took apart."""
CONCEPT_HEADINGS = ("ID Management", "Interfaces", "Class Factories", "Module service life")
"""Of 8.1.1: lines of their own in the concept."""
PROPERTIES = (
    "Module description",
    "Class description files (*.tmc)",
    "Instance description files (*.tmi)",
    "State machine",
    "Parameter",
    "Interfaces",
    "Interface pointers",
    "Data areas",
    "Data area pointer",
    "Context",
    "Categories",
    "ADS",
    "System module",
    "Creation of modules",
)
"""Headings of 8.1.1.1, which the print does not tell from its sentences."""
ONLY_IN_PROPERTIES = ("ITCom Object Category", "ITCom Object Enum Ptr", "ITc RTime")
MISPRINTS = {"ITcUknown": "ITcUnknown", "sec- ond PLC,": "second PLC", "ob- ject": "object"}
"""What the print did to names, and how it is undone."""


def glued(name: str) -> str:
    """The name of a function, method, constant or type as it was meant: in one word."""
    name = name.replace(" ", "")
    return MISPRINTS.get(name, name)


def titled(title: str) -> str:
    """A heading as it was meant: the manual's own names in one word, the others as they are."""
    for wrong, meant in MISPRINTS.items():
        title = title.replace(wrong, meant)
    title = SPLIT.sub(lambda found: glued(found[0]), title)
    return glued(title) if title.split()[0] in ("Tc", "FW_Obj", "FW_Safe", "Guids") or "COM_Sample" in title else title


def named() -> Iterator[str]:
    """What the manual documents: headings, methods, constants, states, properties, interfaces, types."""
    text = MANUALS[0].read_text(encoding="utf-8").replace("\n", " ")
    contents = text[text.index("## Page 3") : text.index("## Page 5")]
    for number, title in TITLE.findall(contents):
        yield f"{number} {titled(title)}"
    for number, title in re.findall(r"\b(8\.1\.1\.\d) (Twin CAT module [a-z]+(?: machine)?)", text):
        yield f"{number} {titled(title)}"
    for number, name in METHOD.findall(text):
        yield f"{number} {glued(name)}"
    for name in CONSTANT.findall(text):
        yield f"5.1 .{glued(name).rpartition('GVL')[2]}"
    states = text[text.index("State: INIT") : text.index("8.2 Interfaces 8.2.1")]
    for state in STATE.findall(states):
        yield f"8.1.1.2 {state}"
    for name in TYPE.findall(text):
        yield f"type {glued(name)}"
    properties = text[text.index("8.1.1.1 Twin CAT module properties") : text.index("8.1.1.2 Twin CAT module state machine")]
    for name in (*PROPERTIES, *ONLY_IN_PROPERTIES):
        assert name in properties, name
        yield f"8.1.1.1 {glued(name) if name in ONLY_IN_PROPERTIES else name}"
    concept = CONCEPTS[0].read_text(encoding="utf-8")
    for name in CONCEPT_HEADINGS:
        assert f"\n{name}\n" in concept, name
        yield f"8.1.1 {name}"
    for kind, name in INTERFACE.findall(concept):
        yield f"8.1.1 IT{kind}{name}"


def rows() -> list[tuple[str, str, str]]:
    """The page's rows: manual, ours, note."""
    names = PAGE.read_text(encoding="utf-8").split("## Names of the manual")[1]
    table = [line.split(" | ") for line in names.splitlines() if line.startswith("| ")]
    cells = [(row[0].removeprefix("| "), row[1], row[2].removesuffix(" |")) for row in table if len(row) == 3]
    return [row for row in cells if row[0] != "manual"]


def find(path: str) -> None:
    """Import what a dotted path names; AttributeError or ImportError when it is not there."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return
    raise ImportError(path)


@needs_manual
def test_every_name_of_the_manual_has_a_row() -> None:
    """Function blocks, functions, methods, constants, states, interfaces, types, samples."""
    wanted = list(dict.fromkeys(named()))
    there = {manual for manual, _, _ in rows()}
    assert len(wanted) > 130
    assert [name for name in wanted if name not in there] == []


@needs_manual
def test_every_row_is_a_name_of_the_manual() -> None:
    """Nothing on the page is made up, and none stands twice."""
    known = set(named())
    there = [manual for manual, _, _ in rows()]
    assert [name for name in there if name not in known] == []
    assert len(there) == len(set(there))


@needs_manual
def test_every_code_of_the_manual_is_known() -> None:
    """The return codes of chapter 6, and what the manual calls them."""
    text = MANUALS[0].read_text(encoding="utf-8")
    chapter = text[text.index("## Page 32") : text.index("## Page 37")]
    codes = [int(code, 16) for code in re.findall(r"0x98[0-9A-F]{6}\b", chapter)]
    assert len(codes) > 130
    assert [hex(code) for code in codes if hresult.lookup(code) is None] == []
    for code, name in re.findall(r"0x0000_([0-9A-F]{4}) (S_\w+)", chapter):
        assert getattr(hresult, name) == int(code, 16)


def test_every_path_exists() -> None:
    """What stands beside a name of the manual can be imported or is a file; who has nothing says why."""
    missing = []
    for manual, ours, note in rows():
        paths = re.findall(r"`([^`]+)`", ours)
        if not paths and not note.strip():
            missing.append(f"{manual}: neither a name nor a reason")
        for path in paths:
            try:
                if not path.startswith("examples/"):
                    find(path)
                elif not (ROOT / path).is_file():
                    missing.append(f"{manual}: {path}")
            except (AttributeError, ImportError):
                missing.append(f"{manual}: {path}")
    assert missing == []


def test_the_plant_of_the_page_is_one() -> None:
    """It is read, and starts in the order that the page promises."""
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    plant = read_plant(block.encode(), "plant.toml")
    assert [each.name for each in plant.start_order()] == ["Fast", "Sensor", "Filter"]
    assert plant.settings == {"target": "plc1"}
