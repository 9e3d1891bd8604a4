"""What the documentation says is true as far as a program can tell: links, dependencies, decisions, examples of the wire."""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bridge.core import codec, keys
from bridge.core.arguments import ArgumentType
from bridge.core.events import DEFAULT_LIMITS, KIND_NAMES, MessageSent

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def name(path: Path) -> str:
    """A page's path as the test's name."""
    return str(path.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """The anchors that a page's headings make, as code hosts spell them."""
    prose = FENCE.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def broken_links(page: Path) -> Iterator[str]:
    """Relative links of a page that lead nowhere, to a file or to a heading in it."""
    prose = re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text(encoding="utf-8")))
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if target.startswith(("https://", "http://")):
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        if not there.exists() or (anchor and anchor not in anchors(there)):
            yield target


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_link_resolves(page: Path) -> None:
    """A link within the repository leads to a file that exists and, with an anchor, to a heading in it."""
    assert list(broken_links(page)) == []


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    """Missing files and missing headings are both named; addresses and code are passed over."""
    page = tmp_path / "page.md"
    page.write_text("# A b\n[x](gone.md) [y](#a-b) [z](#c) [w](https://example.org) `[v](no.md)`\n```\n[u](no.md)\n```\n")
    assert list(broken_links(page)) == ["gone.md", "#c"]


def test_every_command_is_in_the_contents_of_its_page() -> None:
    """The list at the top of docs/commands.md names each section."""
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    contents, _, sections = text.partition("\n## ")
    titles = re.findall(r"^## (.+)$", f"## {sections}", re.MULTILINE)
    assert [title for title in titles if f"(#{title.replace(' ', '-').lower()})" not in contents] == []


def test_every_page_is_in_the_index() -> None:
    """docs/README.md leads to every page beside it, and the decisions' index to every decision."""
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    assert [page.name for page in (ROOT / "docs").glob("*.md") if f"({page.name})" not in index and page.stem != "README"] == []
    index = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    for number, page in enumerate(DECISIONS, start=1):
        title = page.read_text(encoding="utf-8").splitlines()[0].removeprefix(f"# {number:04d}. ")
        assert f"| {number:04d} | [{title}]({page.name}) |" in index


@pytest.mark.parametrize("page", DECISIONS, ids=name)
def test_a_decision_is_one_screen_with_four_sections(page: Path) -> None:
    """Status, context, decision, consequences, in this order, under a numbered title, in at most 60 lines."""
    lines = page.read_text(encoding="utf-8").splitlines()
    assert re.fullmatch(rf"# {page.name[:4]}\. \S.*", lines[0])
    assert [line for line in lines if line.startswith("## ")] == ["## Status", "## Context", "## Decision", "## Consequences"]
    assert len(lines) <= 60


def requirement(line: str) -> str:
    """The distribution that a requirement names, as an index spells it."""
    found = re.match(r"[A-Za-z0-9._-]+", line)
    assert found is not None, line
    return re.sub(r"[-_.]+", "-", found.group()).lower()


def required() -> list[str]:
    """Every distribution that pyproject.toml asks for: run time, extras and build."""
    project = PROJECT["project"]
    lists = [project["dependencies"], PROJECT["build-system"]["requires"], *project["optional-dependencies"].values()]
    return sorted({requirement(line) for lines in lists for line in lines})


def test_every_dependency_is_explained() -> None:
    """Each has one row in docs/dependencies.md with reason, licence and what it replaces; no row names another one."""
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if row[0] != "library"]
    assert sorted(row[0] for row in rows) == required()
    assert all(len(row) == 4 and all(row) for row in rows)


def test_every_dependency_is_pinned() -> None:
    """constraints.txt gives each dependency one version, and holds no address of an index."""
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pins = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert [line for line in pins if not re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line)] == []
    assert set(required()) <= {requirement(line) for line in pins}


def test_the_changelog_has_a_place_for_what_comes() -> None:
    """CHANGELOG.md begins with Unreleased."""
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == "[Unreleased]"


def test_the_readme_keeps_its_order() -> None:
    """Three sentences, the two commands, the flow, twelve lines of Python, the commands, promised and not promised."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    opening = text.split("\n\n")[1]
    assert len(re.findall(r"\.(?:\s|$)", opening)) == 3
    blocks = FENCE.findall(text)
    assert [language for language, _ in blocks] == ["sh", "text", "python"]
    assert re.findall(r"^make \w+", blocks[0][1], re.MULTILINE) == ["make demo", "make test"]
    assert len(blocks[2][1].splitlines()) == 12
    assert re.findall(r"^## (.+)$", text, re.MULTILINE) == ["In Python", "Commands", "Promised", "Not promised"]


WIRE = (ROOT / "docs" / "wire.md").read_text(encoding="utf-8")


def test_the_wire_example_is_what_the_codec_writes() -> None:
    """The JSON on the page decodes under the key on the page, and encodes to the same bytes."""
    (example,) = [body.strip() for language, body in FENCE.findall(WIRE) if language == "json"]
    (key,) = re.findall(r"on key `([^`]+)`", WIRE)
    decoded = codec.decode(example.encode(), codec.JSON, keys.parse_event_key(key))
    assert decoded.rejected == []
    assert codec.join([codec.encode(event) for event in decoded.events]).decode() == example


def test_the_wire_page_names_every_field_and_hidden_key() -> None:
    """The tables hold each field of an event, each kind, each verb, each encoding, and no field that does not exist."""
    rows = re.findall(r"^\| (`[^|]+) \|", WIRE.split("## Payload")[1].split("## Argument values")[0], re.MULTILINE)
    named = {field for row in rows for field in re.findall(r"`(\w+)`", row)}
    assert named == {"kind", *(field.encode_name for field in msgspec.structs.fields(MessageSent))}
    for word in (*KIND_NAMES, *keys.VERBS, *codec.ENCODINGS, keys.PREFIX):
        assert f"`{word}" in WIRE


def test_the_wire_page_names_every_argument_type() -> None:
    """Each number of TcEventArgumentType but UNDEFINED has its text form on the page."""
    rows = re.findall(r"^\| (\d[^|]*) \|", WIRE.split("## Argument values")[1], re.MULTILINE)
    named: set[int] = set()
    for row in rows:
        if ranged := re.match(r"(\d+) to (\d+)", row):
            named |= set(range(int(ranged[1]), int(ranged[2]) + 1))
        else:
            named |= {int(number) for number in re.findall(r"\b\d+\b", row)}
    assert named == {int(kind) for kind in ArgumentType} - {0}


def test_the_promised_bounds_are_those_of_the_code() -> None:
    """The table of bounds gives the event's limits as the code has them."""
    bounds = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8").split("## Bounds")[1]
    for limit in json.loads(msgspec.json.encode(DEFAULT_LIMITS)).values():
        assert f"{limit:,}" in bounds
