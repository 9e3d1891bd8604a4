"""`tcbridge record`: the bus in a file."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, parse_filter
from bridge.cli.progress import counting
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted
from bridge.config import Settings

if TYPE_CHECKING:
    from bridge.edges.recording import Attachment
    from bridge.recorder import Recorder

RECORDING = Group("Recording", sort_key=10)
Packing: TypeAlias = Literal["zstd", "lz4", "none"]
STEP_S = 0.1
SETTLE_S = 0.5
"""What asking for the last events may take, so that the program ends within 3 s of a signal."""


def record(
    path: Annotated[Path, Parameter(name="FILE", help="The recording to make; its name ends in .mcap.")],
    /,
    *,
    filter: Annotated[str, Parameter(help="Which events, e.g. 'severity >= error'. Default: all.", group=RECORDING)] = "",
    count: Annotated[int | None, Parameter(help="End after so many events.", group=RECORDING)] = None,
    duration: Annotated[float | None, Parameter(help="End after so many seconds.", group=RECORDING)] = None,
    compression: Annotated[Packing, Parameter(help="How chunks are packed.", group=RECORDING, show_default=True)] = "zstd",
    fsync: Annotated[bool, Parameter(help="Make every flush wait for the disk.", group=RECORDING)] = False,
    comment: Annotated[str, Parameter(help="A text that explains the recording; it is in the file.", group=RECORDING)] = "",
    common: Common = COMMON,
) -> int:
    """Write events to an MCAP file.

    It ends when stopped, after --count events, or after --duration seconds.
    While it is written the file is called FILE.active. Class files of --classes
    are put into it. Exit code 3: something is missing, and the file says what.

    Try:
        tcbridge record plant.mcap --filter "severity >= warning" --duration 60
    """
    from bridge.cli import program_version
    from bridge.edges.recording import summary
    from bridge.recorder import Recorder

    settings = common.load()
    known = catalog(settings)
    expr = parse_filter(filter, known)
    with open_bus(settings) as bus:
        recorder = Recorder(
            bus,
            path,
            expr,
            realm=settings.realm,
            target=settings.target or None,
            compression=compression,
            fsync=fsync,
            comment=comment,
            version=program_version(),
            attachments=_attachments(settings),
            resolve_class=known.guids,
        )
        try:
            note(f"recording realm {settings.realm} to {recorder.path}")
            _wait(recorder, count, duration)
        except Interrupted:
            pass
        finally:
            recorder.close(SETTLE_S)
    found = summary(recorder.path)
    totals = found.totals
    if common.json:
        facts = {"events": totals.events, "gaps": totals.gaps, "missing": totals.gap_events, "rejected": totals.rejected}
        print_json({"recorded": str(recorder.path), "complete": found.complete, **facts})
    else:
        missing = f", {totals.gap_events:,} missing in {totals.gaps:,} gaps" if totals.gaps else ""
        rejected = f", {totals.rejected:,} payloads rejected" if totals.rejected else ""
        print(f"recorded {totals.events:,} events to {recorder.path}{missing}{rejected}; complete: {found.complete}")
    return Exit.OK if found.complete == "yes" else Exit.LOST


def _wait(recorder: "Recorder", count: int | None, duration: float | None) -> None:
    """Wait until enough is recorded, the time is up or writing failed, and show how far it is."""
    ends_s = None if duration is None else time.monotonic() + duration
    with counting("recorded") as show:
        while True:
            left_s = STEP_S if ends_s is None else min(STEP_S, ends_s - time.monotonic())
            events = recorder.listener.counters.passed
            show(events)
            if left_s <= 0 or (count is not None and events >= count) or recorder.wait(left_s):
                return


def _attachments(settings: Settings) -> "list[Attachment]":
    from bridge.edges.class_files import class_files
    from bridge.edges.recording import Attachment

    return [
        Attachment(file.name, file.read_bytes(), f"application/{'toml' if file.suffix.lower() == '.toml' else 'xml'}")
        for file in class_files(settings.classes)
    ]
