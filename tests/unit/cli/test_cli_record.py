"""`tcbridge record`: what does not go together, and sizes as people write them."""

from pathlib import Path

import pytest

from bridge.cli import run
from bridge.cli.exits import Usage
from bridge.cli.values import size
from bridge.edges.bus import BusConfig


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["x.mcap", "--trigger", "severity = critical"], "captures need a folder"),
        (["x.mcap", "--split-size", "1MB"], "name a folder"),
        (["x.mcap", "--keep-files", "3"], "name a folder"),
        (["night", "--keep-files", "1"], "at least two files"),
        (["night", "--keep-size", "1MB", "--split-size", "600k"], "at most half"),
        (["night", "--split-size", "1QB"], "is no size"),
        (["night", "--split-time", "-1"], "not negative"),
        (["night", "--before", "10"], "about a --trigger"),
        (["night", "--trigger", "severity = critical", "--before", "-1"], "not negative"),
        (["night", "--trigger", "severity > "], "expected"),
        (["night", "--event-class", "nobody's"], "nobody's"),
    ],
)
def test_wrong_usage_ends_with_2_and_makes_nothing(
    arguments: list[str], reason: str, bus_config: BusConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one line that says what is wrong."""
    path = tmp_path / arguments[0]
    assert run(["record", str(path), *arguments[1:], "--scouting-group", bus_config.scouting_group]) == 2
    assert reason in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "said"), [("plant.mcap", "to {}; its name"), ("plant.mcapp", "to the folder {}; its name")])
def test_a_name_that_is_no_file_is_said_to_be_a_folder(
    name: str, said: str, bus_config: BusConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """So a slip in the suffix is seen at once."""
    path = tmp_path / name
    assert run(["record", str(path), "--duration", "0.1", "--scouting-group", bus_config.scouting_group]) == 0
    assert said.format(path) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "size_bytes"),
    [("", 0), ("0", 0), ("1000000", 10**6), ("100MB", 10**8), ("2GB", 2 * 10**9), ("1.5k", 1500), ("3 TB", 3 * 10**12)],
)
def test_sizes_are_written_as_people_do(text: str, size_bytes: int) -> None:
    """Powers of ten; the B may be left out."""
    assert size(text) == size_bytes


@pytest.mark.parametrize("text", ["B", "MB", "-1", "1 QB", "inf", "nan", "1e999", "0x10"])
def test_what_is_no_size_is_refused(text: str) -> None:
    """Negative, endless or no number."""
    with pytest.raises(Usage, match="no size"):
        size(text)
