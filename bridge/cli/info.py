"""`tcbridge info`: what a recording holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import TEXTS_ONLY, Texts, catalog
from bridge.cli.show import KIND_WORDS, Cell, clean, print_json, print_table, severity_span
from bridge.core.events import Severity
from bridge.core.times import NS_PER_S, time_text

if TYPE_CHECKING:
    from bridge.edges.recording import RecordingInfo


def info(
    path: Annotated[Path, Parameter(name="FILE", help="The recording; also one that is still being written (.mcap.active).")],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Say what a recording holds.

    Whether it is complete, since when, how many events of which class and
    severity. The exit code is 0 for a complete recording, 1 for one with gaps,
    an unknown end or damage.

    Try:
        tcbridge info plant.mcap
    """
    from bridge.edges.recording import summary

    settings = common.load()
    known = catalog(settings)
    found = summary(path)
    if common.json:
        print_json(msgspec.to_builtins(found) | {"complete": found.complete})
        return Exit.OK if found.complete == "yes" else Exit.NO
    for name, text in _lines(found):
        print(f"{name:10} {clean(text)}")
    counts: list[list[Cell]] = [
        [
            row.target,
            known.class_name(row.event_class, settings.lang),
            KIND_WORDS.get(row.kind, row.kind),
            severity_span(Severity(row.severity)),
            f"{row.count:,}",
        ]
        for row in found.totals.counts
    ]
    if counts:
        print()
        print_table(("Target", "Class", "Event", "Severity", "Count"), counts)
    if found.channels:
        print()
        channels = [[channel.topic, channel.message_encoding, f"{channel.messages:,}"] for channel in found.channels]
        print_table(("Channel", "Encoding", "Messages"), channels)
    return Exit.OK if found.complete == "yes" else Exit.NO


def _lines(found: "RecordingInfo") -> list[tuple[str, str]]:
    totals, about = found.totals, found.about
    seconds = (totals.last_log_time_ns - totals.first_log_time_ns) / NS_PER_S
    lines = [
        ("file", f"{found.path}, {found.size_bytes:,} bytes"),
        ("complete", _complete(found)),
        ("events", f"{totals.events:,}"),
        ("recorded", _span(totals.first_log_time_ns, totals.last_log_time_ns) + f" ({seconds:.1f} s)"),
        ("happened", _span(totals.first_time_ns, totals.last_time_ns)),
        ("rejected", f"{totals.rejected:,} payloads that are no events" if totals.rejected else "nothing"),
        ("keyframes", f"{totals.states:,}"),
        ("realm", about.realm),
        ("filter", about.filter or "everything"),
        ("comment", about.comment),
        ("by", " ".join(word for word in ("tcbridge", about.version, "on", about.host) if word) if about.host else ""),
        ("attached", ", ".join(found.attachments)),
    ]
    return [(name, text) for name, text in lines if text]


def _span(first_ns: int, last_ns: int) -> str:
    return f"{time_text(first_ns, 3)} to {time_text(last_ns, 3)}" if first_ns else "-"


def _complete(found: "RecordingInfo") -> str:
    totals = found.totals
    if found.damage is not None:
        return f"{found.complete}: damaged at byte {found.damage.offset:,}: {found.damage.reason}"
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
