"""The samples of the Tc3_Module manual, and Start-Stop of the EventLogger manual, as programs that a user runs."""

import subprocess
import sys
from pathlib import Path

SAMPLES = Path(__file__).parents[2] / "examples" / "tccom"


def test_start_stop_prints_the_messages_of_the_manual() -> None:
    """9.2.2: 1, 7 and 4 when starting, 8, 2 and 5 when stopping, in time, with the manual's texts."""
    done = subprocess.run([sys.executable, SAMPLES / "start_stop.py"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    rows = [line.split(" | ") for line in done.stdout.splitlines()]
    assert [row[:4] for row in rows] == [
        ["Verbose", "TcComMessages", "1", "Eventlogger initialized"],
        ["Verbose", "TcComMessages", "7", "AddModuleToCaller Done"],
        ["Verbose", "TcComMessages", "4", "SetObjStateSO Done"],
        ["Verbose", "TcComMessages", "8", "RemoveModuleFromCaller Done"],
        ["Verbose", "TcComMessages", "2", "Eventlogger deinitialized"],
        ["Verbose", "TcComMessages", "5", "SetObjStateOS Done"],
    ]
    times = [row[4] for row in rows]
    assert times == sorted(times)
