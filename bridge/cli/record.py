"""`tcbridge record`: the bus in files."""

import os
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import BUS, REALM, Network, Texts, catalog, note, open_bus, parse_filter
from bridge.cli.progress import counting
from bridge.cli.show import counted, print_json
from bridge.cli.signals import Interrupted
from bridge.cli.values import size
from bridge.config import Loaded, Settings

if TYPE_CHECKING:
    from bridge.control import Control
    from bridge.core.filters.ast import Expr
    from bridge.edges.bus import Bus
    from bridge.edges.recording import Attachment
    from bridge.recorder import Capture, News, Recorder

WHAT = Group("What", sort_key=10)
FILES = Group("Files", sort_key=11)
AROUND = Group("Around a trigger", sort_key=12)
Packing: TypeAlias = Literal["zstd", "lz4", "none"]
STEP_S: Final = 0.1
SETTLE_S: Final = 0.5
"""What asking for the last events may take, so that the program ends within 3 s of a signal."""
SETTINGS_ATTACHMENT: Final = "tcbridge.settings.json"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Common(Texts, Network):
    """As for other commands, but with any number of targets."""

    targets: Annotated[
        tuple[str, ...], Parameter(name="--target", help="Only of this target, repeated. Default: every target.", group=BUS)
    ] = ()
    realm: Annotated[str | None, REALM] = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Division:
    """How many files, how large."""

    split_size: Annotated[str, Parameter(help="A new file when this one has so many bytes, e.g. 100MB.", group=FILES)] = ""
    split_time: Annotated[float, Parameter(help="A new file after so many seconds.", group=FILES)] = 0.0
    keep_files: Annotated[int, Parameter(help="Delete the oldest when there are more files.", group=FILES)] = 0
    keep_size: Annotated[str, Parameter(help="Delete the oldest when they have more bytes together.", group=FILES)] = ""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Around:
    """What is captured around a trigger."""

    trigger: Annotated[str, Parameter(help="Write only what is around events that this filter takes.", group=AROUND)] = ""
    before: Annotated[float, Parameter(help="Seconds before.", group=AROUND, show_default=True)] = 60.0
    after: Annotated[float, Parameter(help="Seconds after.", group=AROUND, show_default=True)] = 30.0
    memory: Annotated[str, Parameter(help="Memory for what comes before.", group=AROUND, show_default=True)] = "256MB"

    def capture(self, trigger: "Expr") -> "Capture":
        """What to capture. ValueError for numbers that make no sense."""
        from bridge.recorder import Capture

        return Capture(trigger=trigger, before_s=self.before, after_s=self.after, max_bytes=size(self.memory))


COMMON: Final = Common()
DIVISION: Final = Division()
AROUND_IT: Final = Around()


def record(
    path: Annotated[Path, Parameter(name="PATH", help="A file that ends in .mcap, or a folder for several.")],
    /,
    *,
    filter: Annotated[str, Parameter(help="Which events, e.g. 'severity >= error'. Default: all.", group=WHAT)] = "",
    event_class: Annotated[tuple[str, ...], Parameter(help="Only this class, name or GUID, repeated.", group=WHAT)] = (),
    count: Annotated[int | None, Parameter(help="End after so many events.", group=WHAT)] = None,
    duration: Annotated[float | None, Parameter(help="End after so many seconds.", group=WHAT)] = None,
    division: Division = DIVISION,
    around: Around = AROUND_IT,
    compression: Annotated[Packing, Parameter(help="How chunks are packed.", group=FILES, show_default=True)] = "zstd",
    fsync: Annotated[bool, Parameter(help="Make every flush wait for the disk.", group=FILES)] = False,
    viewer: Annotated[
        bool,
        Parameter(help="Put beside the events what viewers such as Foxglove show.", negative=("--no-viewer",), group=FILES),
    ] = True,
    comment: Annotated[str, Parameter(help="A text that explains the recording; it is in the file.", group=FILES)] = "",
    name: Annotated[str, Parameter(help="What 'tcbridge control' calls it. Default: after PATH.", group=BUS)] = "",
    common: Common = COMMON,
) -> int:
    """Write events to MCAP files.

    PATH is a file that ends in .mcap, or a folder: its files are called after
    their start, and each can be read alone. While a file is written its name
    ends in .active; what a crash left so is recovered at the next start.

    It ends when stopped, after --count events, or after --duration seconds.
    The settings and the class files of --classes are put into each file.
    Exit code 3: something is missing, and the file says what.

    Try:
        tcbridge record plant.mcap --filter "severity >= warning" --duration 60
        tcbridge record night --split-size 100MB --keep-files 24
        tcbridge record faults --trigger "severity = critical" --before 60
    """
    from bridge.cli import program_version
    from bridge.control import NameTakenError, present
    from bridge.core.filters.fields import quoted
    from bridge.edges.recording import Viewer
    from bridge.recorder import Keep, Recorder, Split
    from bridge.texts import Texts as BusTexts

    loaded = common.loaded()
    settings = common.load()
    known = catalog(settings)
    if not around.trigger and around != AROUND_IT:
        raise Usage("--before, --after and --memory are about a --trigger")
    split_size, keep_size = size(division.split_size), size(division.keep_size)
    stopped = threading.Event()
    with open_bus(settings) as bus, BusTexts(bus, realm=settings.realm, catalog=known) as texts, ExitStack() as stack:
        names = " or ".join(f"event_class = {quoted(each)}" for each in event_class)
        wanted = f"({filter}) and ({names})" if filter and names else filter or names
        expr = parse_filter(wanted, known, texts.guids)
        trigger = parse_filter(around.trigger, known, texts.guids) if around.trigger else None
        if name and (taken := present(bus, realm=settings.realm, name=name)):
            raise NameTakenError(name, settings.realm, taken[0].role)  # before a file is made
        try:
            recorder = Recorder(
                bus,
                path,
                expr,
                realm=settings.realm,
                targets=common.targets or ((settings.target,) if settings.target else ()),
                capture=None if trigger is None else around.capture(trigger),
                split=Split(size_bytes=split_size, seconds=division.split_time),
                keep=Keep(files=division.keep_files, size_bytes=keep_size),
                compression=compression,
                fsync=fsync,
                comment=comment,
                version=program_version(),
                viewer=Viewer(texts.known, settings.lang, known) if viewer else None,
                attachments=_attachments(settings, loaded),
                told=lambda news: _tell(news, as_json=common.json),
            )
        except ValueError as error:
            raise Usage(str(error)) from None
        try:
            control = stack.enter_context(_control(recorder, bus, name, settings.realm, stopped))
            place = path if path.suffix == ".mcap" else f"the folder {path}"
            note(f"recording realm {settings.realm} to {place}; its name is {control.name}")
            _wait(recorder, stopped, count, duration)
        except Interrupted:
            pass
        finally:
            totals = recorder.close(SETTLE_S)
    if common.json:
        facts = {"events": totals.events, "gaps": totals.gaps, "missing": totals.gap_events, "rejected": totals.rejected}
        files = {"files": recorder.status.files}
        print_json({"recorded": str(path), "complete": totals.complete, **facts, **files})
    else:
        files_text = "" if path.suffix == ".mcap" else f" in {counted(recorder.status.files, 'file')}"
        missing = f", {totals.gap_events:,} missing in {totals.gaps:,} gaps" if totals.gaps else ""
        rejected = f", {totals.rejected:,} payloads rejected" if totals.rejected else ""
        print(
            f"recorded {counted(totals.events, 'event')} to {path}{files_text}{missing}{rejected}; complete: {totals.complete}"
        )
    return Exit.OK if totals.complete == "yes" else Exit.LOST


def _wait(recorder: "Recorder", stopped: threading.Event, count: int | None, duration: float | None) -> None:
    """Wait until enough is recorded, the time is up, it is told to stop, or writing failed; and show how far it is."""
    ends_s = None if duration is None else time.monotonic() + duration
    with counting("recorded") as show:
        while True:
            left_s = STEP_S if ends_s is None else min(STEP_S, ends_s - time.monotonic())
            events = recorder.status.events
            show(events)
            if left_s <= 0 or stopped.is_set() or (count is not None and events >= count) or recorder.wait(left_s):
                return


def _control(recorder: "Recorder", bus: "Bus", name: str, realm: str, stopped: threading.Event) -> "Control":
    """Let others tell it something, under the name asked for, or one after its path that is free."""
    from bridge.control import NameTakenError
    from bridge.recorder import controlled

    if name:
        return controlled(recorder, bus, name, realm=realm, stop=stopped.set)
    plain = recorder.path.stem or "recorder"
    try:
        return controlled(recorder, bus, plain, realm=realm, stop=stopped.set)
    except NameTakenError:
        return controlled(recorder, bus, f"{plain}-{os.urandom(4).hex()}", realm=realm, stop=stopped.set)


def _tell(news: "News", *, as_json: bool) -> None:
    """Say what became of a file."""
    if as_json:
        print_json(news.record())
    else:
        note(str(news))


def _attachments(settings: Settings, loaded: Loaded) -> "list[Attachment]":
    from bridge.edges.recording import Attachment
    from bridge.recorder.attached import attached_classes

    rows = {name: {"value": value, "from": origin} for name, value, origin in loaded.rows()}
    return [
        Attachment(SETTINGS_ATTACHMENT, msgspec.json.format(msgspec.json.encode(rows)), "application/json"),
        *attached_classes(settings.classes),
    ]
