"""The README's Python does what it says."""

import re
from pathlib import Path

import pytest

import bridge
from bridge.edges.bus import Bus, BusConfig, open_bus

README = Path(__file__).parents[2] / "README.md"


def test_the_twelve_lines_run_as_they_stand(
    bus_config: BusConfig, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a bus of the test's own; the listener prints the three transitions and not the message."""

    def open_ours() -> Bus:
        return open_bus(bus_config)

    monkeypatch.setattr(bridge, "open_bus", open_ours)
    (block,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    exec(compile(block, "README.md", "exec"), {"__name__": "readme"})
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[0] for line in lines] == ["alarm_raised", "alarm_confirmed", "alarm_cleared"]
    assert {line[1] for line in lines} == {"7"}
    assert {line[2] for line in lines} == {"readme.<module>"}


def test_the_public_door_is_small_and_each_name_is_there_once() -> None:
    """At most 30 names, sorted, each importable."""
    names = bridge.__all__
    assert len(names) <= 30
    assert names == sorted(set(names))
    assert all(hasattr(bridge, name) for name in names)
