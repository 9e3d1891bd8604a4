"""The samples of the manual's chapter 9 run by one command each and show what the manual says."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SHOWN = {
    "tutorial": [
        "Info | EventClass for Tutorial | 1 | Event for Tutorial",
        "Info | Ereignisklasse des Tutorials | 1 | Ereignis des Tutorials",
        "0x08502000",
    ],
    "result_message": [
        "library trace level: refused: ('DivisionByZero', (42,)); result 7.0",
        "own trace level: refused: ('DivisionByZero', (42,)); result 7.0",
        "sent: A division by zero has occurred (dividend = 42) [Math Calculation 12]",
        "addition: None, ('Overflow', (2147483647, 1))",
    ],
    "listener": [
        'message_sent    Part 7 is done  {"part": 7}',
        "alarm_cleared: 1, alarm_confirmed: 1, alarm_raised: 1, message_sent: 1",
    ],
    "filter": [
        "messages of the machine: Drive reports 8130, Part 7 is done, Part 8 is done",
        "errors and worse: Drive reports 8130, Store south is empty",
        "EtherCAT emergencies: Drive reports 8130",
        "sources below Store: Part 7 is done, Store south is empty",
        "axis 3, as text: Part 8 is done",
        "Critical;Machine;Drive reports 8130;Drive.1",
        "cleared: 3",
        "left in the log: 3 events of the log were cleared by sample",
        "left in the log: Store south is empty",
        "still active: 1",
    ],
    "usermode": [
        "connected: True",
        "active: Axis2: Drive reports 4652",
        "still active: ['Axis2']",
        "log: alarm_confirmed Axis1: Drive reports 4651 usermode",
    ],
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_sample_shows_what_it_promises(name: str) -> None:
    """It ends by itself with exit code 0, and nothing on stderr."""
    done = subprocess.run([sys.executable, EXAMPLES / f"{name}.py"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for line in SHOWN[name]:
        assert line in done.stdout


def test_every_sample_is_listed_with_its_command() -> None:
    """examples/README.md names each program; nothing in it names a program that is not there."""
    text = (EXAMPLES / "README.md").read_text()
    programs = {path.stem for path in EXAMPLES.glob("*.py")}
    assert {name for name in programs if f"python examples/{name}.py" in text} == programs
    assert set(SHOWN) <= programs
