"""docs/twincat.md against the manual and against the code: every documented name has a row, and what a row names exists."""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.core import hresult

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "twincat.md"
MANUALS = sorted((ROOT / ".." / "shared" / "seeds").resolve().glob("003_*.txt"))

CHAPTER = re.compile(r"^[#* ]+((?:4|5|6|7|8|10)(?:\.\d+)*)\.?\s+(.+?)[*\s]*$")
TABLE = re.compile(r"^Name\t(?:Beschreibung|Definitions|Modifizierer|R.ckgabotyp|Typ\tZugriff|Typ\tInitialwert)")
NAMES = {
    "5.5": re.compile(r"(?:\\EventLogger\\|HKEY.*\[)([\w\\]+)"),
    "5.10.1": re.compile(r"((?:ADS_)?E_\w+)\t"),
    "6.1.2.2": re.compile(r"([a-z]\w+)\t(?:BOOL|DINT|STRING)\t"),
}
"""Sections whose names stand in tables of another shape."""
ENUM = re.compile(r"^\s+([A-Za-z_]\w*)\s*(?::=\s*\d+|=\s*\d+)?,?\s*(?://.*)?$")
DAMAGE = ((r"<[^>]*>|\[.*|&gt;.*|▶.*|\\", ""), (r"Referenceld", "ReferenceId"), (r"nUniqueld", "nUniqueId"), (r"\s+", ""))
"""What the print of the manual did to names, and how it is undone."""
ENUMS = ("6.3.2", "6.3.3", "7.2.2", "7.2.3", "8.3.1", "8.3.2", "8.3.3", "8.3.4", "8.3.5")


def cleaned(name: str) -> str:
    """A name as it was meant."""
    for pattern, meant in DAMAGE:
        name = re.sub(pattern, meant, name)
    return name


def members(text: str) -> Iterator[tuple[str, str]]:
    """(section, heading or "") and (section, .member) of chapters 4 to 8 and 10, in the order of the manual."""
    lines = text.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("# 1 "))
    section, in_table, in_code, skipping = "", False, False, True
    for line in lines[start:]:
        if re.match(r"^#+ (?:9|11) ", line):
            skipping = True
        if line.startswith("```"):
            in_code = not in_code
            continue
        heading = None if in_code else CHAPTER.match(line)
        if heading is not None:
            section, skipping, in_table = heading[1], False, False
            yield section, heading[2].replace("\\", "").strip()
        elif skipping:
            continue
        elif section in NAMES and (found := NAMES[section].match(line)):
            yield section, "." + found[1].replace("\\", "/")
        elif TABLE.match(line):
            in_table = True
        elif not line.strip() or line.startswith("#"):
            in_table = False
        elif in_table and "\t" in line and (name := cleaned(line.split("\t")[0])):
            yield section, f".{name}"
        elif in_code and section in ENUMS and (found := ENUM.match(line)):
            yield section, f".{found[1]}"


def rows() -> list[tuple[str, str, str]]:
    """The page's rows: manual, ours, note."""
    table = [line.split(" | ") for line in PAGE.read_text().splitlines() if line.startswith("| ") and " | " in line]
    cells = [(row[0].removeprefix("| "), row[1], row[2].removesuffix(" |")) for row in table if len(row) == 3]
    return [row for row in cells if row[0] != "manual"]


def find(path: str) -> object:
    """What a dotted path names; AttributeError or ImportError when it is not there."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            fields = getattr(found, "__struct_fields__", ()) or getattr(found, "__annotations__", {})
            found = object() if part in fields and not hasattr(found, part) else getattr(found, part)
        return found
    raise ImportError(path)


@pytest.mark.skipif(not MANUALS, reason="the manual is not part of this repository")
def test_every_name_of_the_manual_has_a_row() -> None:
    """Headings, methods, properties, constants and enumeration values of chapters 4 to 8 and 10."""
    there = {manual for manual, _, _ in rows()}
    wanted = [f"{section} {name}" for section, name in members(MANUALS[0].read_text())]
    assert len(wanted) > 600
    assert [name for name in dict.fromkeys(wanted) if name not in there] == []


@pytest.mark.skipif(not MANUALS, reason="the manual is not part of this repository")
def test_every_code_of_the_manual_is_known() -> None:
    """The return codes of 10.1 and the names of 5.10.1."""
    text = MANUALS[0].read_text()
    appendix = text[text.rindex("## 10.1 ADS Return Codes") : text.rindex("## 10.2 ")]
    codes = {int(code, 16) for code in re.findall(r"0x98[0-9A-F]{6}\b", appendix)}
    assert len(codes) > 100
    assert [hex(code) for code in sorted(codes) if hresult.lookup(code) is None] == []


def test_every_path_exists() -> None:
    """What stands beside a name of the manual can be imported; who has nothing says why."""
    missing = []
    for manual, ours, note in rows():
        paths = re.findall(r"`([^`]+)`", ours)
        if not paths and not note.strip():
            missing.append(f"{manual}: neither a name nor a reason")
        for path in paths:
            if not path.startswith("bridge."):
                missing.append(f"{manual}: {path}")
                continue
            try:
                find(path)
            except (AttributeError, ImportError):
                missing.append(f"{manual}: {path}")
    assert missing == []


def test_no_row_stands_twice() -> None:
    """One name, one answer."""
    names = [manual for manual, _, _ in rows()]
    assert len(names) > 600
    assert len(names) == len(set(names))
