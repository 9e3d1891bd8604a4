"""`tcbridge info`: what recordings hold."""

from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import TEXTS_ONLY, Texts
from bridge.cli.progress import counting
from bridge.cli.recordings import known_classes, recordings
from bridge.cli.show import KIND_WORDS, Cell, View, clean, print_json, print_table, severity_span
from bridge.core.events import Severity
from bridge.core.times import NS_PER_S, time_text

if TYPE_CHECKING:
    from bridge.edges.recording import Active, Carried, Gap, RecordingInfo, Totals

SHOWN: Final = 20
"""How many gaps and active alarms are shown to people; --json has up to 100 of each."""


def info(
    files: Annotated[
        tuple[Path, ...],
        Parameter(
            name="FILE",
            help="Recordings, also those still being written (.mcap.active), or folders of them.",
            negative=(),
            required=True,
        ),
    ],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Say what recordings hold.

    Whether they are complete and what is missing, since when, how many events of
    which class and severity, which alarms were active at the start and at the
    end. Of several files each has a line, and the rest is told of all together; a
    part of a split recording that is not among them is named. The exit code is 0
    for complete recordings, 1 with gaps, an unknown end, damage or a missing part.

    Try:
        tcbridge info plant.mcap
        tcbridge info night/
    """
    from bridge.edges.recording import carried, joined, missing_parts, summary

    settings = common.load()
    paths = recordings(files)
    with counting("reading") as show:
        found = sorted((summary(path, on_progress=show) for path in paths), key=lambda each: each.totals.first_log_time_ns)
    absent = missing_parts(found)
    code = Exit.NO if absent or any(each.complete != "yes" for each in found) else Exit.OK
    if common.json:
        for each in found:
            print_json(msgspec.to_builtins(each) | {"complete": each.complete})
        for recording, part in absent:
            print_json({"notice": "missing_part", "recording": recording, "part": part})
        return code
    brought = [carried(path) for path in paths]
    view = View(known_classes(brought, settings), settings.lang)
    totals = reduce(joined, (each.totals for each in found))
    lines = _lines(found[0], brought[0]) if len(found) == 1 else [("files", f"{len(found):,}")]
    if len(found) > 1:
        _print_files(found)
    for name, text in [*lines, *_more_lines(totals)]:
        print(f"{name:10} {clean(text)}")
    for recording, part in absent:
        print(f"{'missing':10} part {part} of recording {recording}")
    _print_gaps(totals.named_gaps, totals.gaps)
    _print_counts(totals, view)
    _print_active(totals.active_at_start, "at the start", view)
    _print_active(totals.active_at_end, "at the end", view)
    if len(found) == 1 and found[0].channels:
        print()
        channels = [[channel.topic, channel.message_encoding, f"{channel.messages:,}"] for channel in found[0].channels]
        print_table(("Channel", "Encoding", "Messages"), channels)
    return code


def _lines(found: "RecordingInfo", brought: "Carried") -> list[tuple[str, str]]:
    """What explains a file: who recorded what, its neighbours, and everything else that it carries."""
    about = found.about
    metadata = [(name, ", ".join(f"{key} {text}" for key, text in texts.items())) for name, texts in brought.metadata]
    lines = [
        ("file", f"{found.path}, {found.size_bytes:,} bytes"),
        ("complete", _complete(found)),
        ("realm", about.realm),
        ("filter", about.filter or "everything"),
        ("comment", about.comment),
        ("part", f"{about.part} of recording {about.recording}" if about.part else ""),
        ("previous", about.previous),
        ("next", found.totals.next_file),
        *about.more.items(),
        ("by", " ".join(word for word in ("tcbridge", about.version, "on", about.host) if word) if about.host else ""),
        ("attached", ", ".join(f"{each.name} ({len(each.data):,} bytes)" for each in brought.attachments)),
        *metadata,
    ]
    return [(name, text) for name, text in lines if text]


def _more_lines(totals: "Totals") -> list[tuple[str, str]]:
    seconds = (totals.last_log_time_ns - totals.first_log_time_ns) / NS_PER_S
    return [
        ("events", f"{totals.events:,}"),
        ("recorded", _span(totals.first_log_time_ns, totals.last_log_time_ns) + f" ({seconds:.1f} s)"),
        ("happened", _span(totals.first_time_ns, totals.last_time_ns)),
        ("rejected", f"{totals.rejected:,} payloads that are no events" if totals.rejected else "nothing"),
        ("keyframes", f"{totals.states:,}"),
    ]


def _print_files(found: "Sequence[RecordingInfo]") -> None:
    rows = [
        [
            each.path,
            _complete(each),
            f"{each.totals.events:,}",
            time_text(each.totals.first_log_time_ns, 3),
            time_text(each.totals.last_log_time_ns, 3),
            f"{each.size_bytes:,}",
        ]
        for each in found
    ]
    print_table(("File", "Complete", "Events", "From", "To", "Bytes"), rows)
    print()


def _print_gaps(gaps: "Sequence[Gap]", count: int) -> None:
    if gaps:
        print()
        rows = [
            [
                f"{gap.count:,}",
                f"{gap.first_key_seq}..{gap.last_key_seq}" if gap.last_key_seq else "",
                gap.session,
                gap.key,
                gap.reason,
            ]
            for gap in gaps[:SHOWN]
        ]
        print_table(("Missing", "Numbers", "Session", "Key", "Why"), rows)
        _print_rest(count - SHOWN, "gaps")


def _print_counts(totals: "Totals", view: View) -> None:
    counts: list[list[Cell]] = [
        [
            row.target,
            view.catalog.class_name(row.event_class, view.lang),
            KIND_WORDS.get(row.kind, row.kind),
            severity_span(Severity(row.severity)),
            f"{row.count:,}",
        ]
        for row in totals.counts
    ]
    if counts:
        print()
        print_table(("Target", "Class", "Event", "Severity", "Count"), counts)


def _print_active(active: "Active", when: str, view: View) -> None:
    if active.count:
        print()
        view.print_alarms(active.named[-SHOWN:], title=f"{active.count:,} alarms active {when}")
        _print_rest(active.count - SHOWN, "earlier ones")


def _print_rest(count: int, what: str) -> None:
    if count > 0:
        print(f"and {count:,} {what} more")


def _span(first_ns: int, last_ns: int) -> str:
    return f"{time_text(first_ns, 3)} to {time_text(last_ns, 3)}" if first_ns else "-"


def _complete(found: "RecordingInfo") -> str:
    totals = found.totals
    if found.damage is not None:
        return f"{found.complete}: {found.damage.text(found.path)}"
    match found.complete:
        case "no":
            return f"no: {totals.gaps:,} gaps, {totals.gap_events:,} events are missing"
        case "tail unknown":
            return f"tail unknown: {_tails(totals.unknown_tails)}"
        case _:
            return "yes"


def _tails(sessions: tuple[str, ...]) -> str:
    if "*" in sessions:
        return "the recorder was killed"
    return f"{len(sessions)} senders went without a last word ({', '.join(sessions[:5])})"
