"""`tcbridge doctor`: what is wrong with recordings."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import BASIC, Basic
from bridge.cli.progress import counting
from bridge.cli.recordings import recordings
from bridge.cli.show import clean, counted, print_json


def doctor(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", help="Recordings, or folders of them.", negative=(), required=True)
    ],
    /,
    *,
    common: Basic = BASIC,
) -> int:
    """Say what is wrong with recordings.

    Reads all of each file and compares its parts: checksums, order, index,
    counts, channels and schemas, entries that cannot be read, events that stand
    there twice, numbers that are missing without a gap record that says so.
    Remarks are things to know that are no fault. Exit code 1: there are faults.

    Try:
        tcbridge doctor plant.mcap
        tcbridge doctor night/ --json
    """
    from bridge.edges.recording import diagnose

    common.load()
    faults = 0
    for path in recordings(files):
        with counting(f"reading {path.name}") as show:
            found = diagnose(path, on_progress=show)
        wrong = sum(each.fault for each in found)
        faults += wrong
        if common.json:
            for each in found:
                print_json({"file": str(path), "fault": each.fault, "text": each.text})
            continue
        print(clean(f"{path}: {counted(wrong, 'fault') if wrong else 'nothing wrong'}"))
        for each in found:
            print(clean(f"  {'fault' if each.fault else 'remark'}: {each.text}"))
    return Exit.NO if faults else Exit.OK
