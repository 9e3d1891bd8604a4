"""`tcbridge convert`: a recording for programs that know nothing of us."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import TEXTS_ONLY, Texts, note
from bridge.cli.progress import counting
from bridge.cli.recordings import known_classes, tell_damages
from bridge.cli.show import counted, print_json

if TYPE_CHECKING:
    from bridge.config import Settings
    from bridge.edges.recording import Carried, Viewer


def convert(
    source: Annotated[Path, Parameter(name="FILE", help="The recording; it stays as it is.")],
    target: Annotated[Path, Parameter(name="NEW", help="The recording to make; its name ends in .mcap.")],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write a recording again so that other programs can read all of it.

    Events in msgpack become JSON. A file without the log for viewers gets it,
    in --lang; one that has it keeps it, unless --lang or --classes is given.
    Event classes come from --classes and from the file itself. All else stays:
    gaps, keyframes, attachments, times. Exit code 3: the file was damaged, and
    what could be read of it was converted.

    Try:
        tcbridge convert plant.mcap for-foxglove.mcap
        tcbridge convert plant.mcap german.mcap --lang de --classes plant.tmc
    """
    from bridge.edges.recording import carried, summary
    from bridge.edges.recording import convert as convert_file

    settings = common.load()
    if target.suffix != ".mcap":
        raise Usage(f"{target.name!r} does not end in .mcap")
    found = carried(source)
    keep = found.has_log and common.lang is None and not common.classes
    lang = settings.lang if common.lang is not None else found.language or settings.lang
    viewer = None if keep else _viewer(found, settings, lang)
    with counting("converted", found.summary.events if found.summary is not None else 0) as show:
        report = convert_file(source, target, viewer, on_progress=lambda report: show(report.events))
    for topic in report.left_out:
        note(f"warning: channel {topic} of another program was left out")
    code = tell_damages({} if report.damage is None else {source: report.damage})
    complete = summary(target).complete
    if common.json:
        facts = {"events": report.events, "from_msgpack": report.from_msgpack, "left_out": report.left_out}
        print_json({"converted": str(target), "complete": complete, **facts})
    else:
        changed = f", {report.from_msgpack:,} of them from msgpack" if report.from_msgpack else ""
        print(f"converted {counted(report.events, 'event')} into {target}{changed}; complete: {complete}")
    return code or Exit.OK


def _viewer(found: "Carried", settings: "Settings", lang: str) -> "Viewer":
    """What makes the log anew. Classes that are neither built in nor in the file are attached to the new one."""
    from bridge.core.builtin import builtin_catalog
    from bridge.core.own_events import OWN_EVENTS
    from bridge.edges.class_files import carried_catalog
    from bridge.edges.recording import Viewer

    known = known_classes([found], settings)
    attached, _ = carried_catalog((each.name, each.data) for each in found.attachments)
    return Viewer(lambda event: known, lang, builtin_catalog().merged((OWN_EVENTS,)).merged(attached))
