"""Turns what a crash left behind into a finished recording.

Rule 1: every whole chunk that stands before the first fault is kept, byte for byte per message; nothing behind it is.
Rule 2: the leftover is deleted only when nothing that could have held an event was cut off. Else it stays beside the
recovered file as name.mcap.damaged, for whoever wants to dig in it.
Rule 3: a recovery that is itself interrupted is taken up again by the next one; no name is ever taken from another file.
Rule 4: a recovered recording never claims to be complete: what was not flushed is gone, and nobody knows how much it was.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.writer import LIBRARY_IDENTIFIER, Writer

from bridge.core.events import DEFAULT_LIMITS, Limits
from bridge.edges.recording.frames import OWN_LIBRARY, Damage, Frames
from bridge.edges.recording.layout import ACTIVE_SUFFIX, RECOVERED_METADATA, SUMMARY_METADATA, RecordingError
from bridge.edges.recording.reader import Interpretation
from bridge.edges.recording.tally import Tally
from bridge.edges.recording.writer import lock, name_finished

PROGRESS_MESSAGES: Final = 1000
DAMAGED_SUFFIX: Final = ".damaged"
_HALF_DONE_SUFFIX: Final = ".recovering"
_EMPTY_HANDED: Final = (Opcode.MESSAGE_INDEX, Opcode.METADATA, Opcode.DATA_END, Opcode.FOOTER)


class Recovered(msgspec.Struct, frozen=True, kw_only=True):
    """What a recovery did. lost_bytes were cut off; damaged_path is where the leftover is kept, None when it was deleted."""

    path: Path
    messages: int
    lost_bytes: int
    damage: Damage | None
    damaged_path: Path | None


def leftovers(folder: str | os.PathLike[str]) -> list[Path]:
    """The active files in a folder: left by a crash, or being written by a running recorder (recover() refuses those)."""
    return sorted(Path(folder).glob(f"*.mcap{ACTIVE_SUFFIX}"))


def recover(
    path: str | os.PathLike[str],
    target: str | os.PathLike[str] | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
    on_progress: Callable[[int], None] = lambda messages: None,
) -> Recovered:
    """Make `name.mcap` of `name.mcap.active`, or `target` of any MCAP file; on_progress hears how many messages are copied.

    ValueError without a target for a file that is not active. RecordingError when it is being written, is no MCAP file, the
    target exists, or the disk refuses; then the leftover is as it was.
    """
    source = Path(path)
    if target is None:
        if source.suffix != ACTIVE_SUFFIX:
            raise ValueError(f"{source.name!r} does not end in {ACTIVE_SUFFIX}: say where the recovered file goes")
        target = source.with_suffix("")
    goal = Path(target)
    try:
        with open(source, "rb") as held:
            lock(held, source)
            return _finish_earlier(source, goal) if os.path.lexists(goal) else _recover(source, goal, limits, on_progress)
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(error.filename or source, error.strerror or str(error)) from error


def _recover(source: Path, goal: Path, limits: Limits, on_progress: Callable[[int], None]) -> Recovered:
    half_done = goal.with_name(goal.name + _HALF_DONE_SUFFIX)
    with Frames(source) as frames:
        try:
            with open(half_done, "wb") as file:
                messages = _copied(frames, source, file, limits, on_progress)
            size = frames.size
            if frames.damage is None and source.suffix == ACTIVE_SUFFIX:
                half_done.unlink()
                name_finished(source, goal)
                return Recovered(path=goal, messages=messages, lost_bytes=0, damage=None, damaged_path=None)
            name_finished(half_done, goal)
        except BaseException:  # an interruption too: nothing half done stays
            half_done.unlink(missing_ok=True)
            raise
        kept = _set_aside(source, goal, _harmless(source, frames))
        return Recovered(path=goal, messages=messages, lost_bytes=size - frames.end, damage=frames.damage, damaged_path=kept)


def _copied(frames: Frames, source: Path, file: BinaryIO, limits: Limits, on_progress: Callable[[int], None]) -> int:
    """Copy what is readable, in file order; the number of messages."""
    tally = Tally()
    interpret = Interpretation(frames, limits, tally)
    writer = Writer(file, enable_data_crcs=True)
    own = f"{OWN_LIBRARY}recovered {LIBRARY_IDENTIFIER}" if frames.strict else f"recovered by {LIBRARY_IDENTIFIER}"
    writer.start(frames.profile, own)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, tuple[Channel, int]] = {}
    messages = carried = 0
    for raw in frames.messages():
        carried = _carry_metadata(frames, writer, carried)
        channel = frames.channels[raw.channel_id]
        known = channels.get(raw.channel_id)
        if known is None or known[0] is not channel:
            if channel.schema_id not in schemas:
                schema = frames.schemas.get(channel.schema_id)
                schemas[channel.schema_id] = (
                    writer.register_schema(schema.name, schema.encoding, schema.data) if schema is not None else 0
                )
            number = writer.register_channel(
                channel.topic, channel.message_encoding, schemas[channel.schema_id], channel.metadata
            )
            known = channels[raw.channel_id] = (channel, number)
        writer.add_message(known[1], raw.log_time, raw.data, raw.publish_time, raw.sequence)
        interpret(raw)
        messages += 1
        if messages % PROGRESS_MESSAGES == 0:
            on_progress(messages)
    _carry_metadata(frames, writer, carried)
    with Frames(source) as again:
        for place in frames.attachments:
            attachment = again.attachment(place)
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )
    told = {
        "source": source.name,
        "source_bytes": str(frames.size),
        "kept_bytes": str(frames.end),
        "reason": frames.damage.reason if frames.damage is not None else "",
        "harmless": str(_harmless(source, frames)),
    }
    writer.add_metadata(RECOVERED_METADATA, told)
    writer.add_metadata(SUMMARY_METADATA, tally.totals(("*",)).metadata())
    writer.finish()  # type: ignore[no-untyped-call]
    file.flush()
    os.fsync(file.fileno())
    return messages


def _carry_metadata(frames: Frames, writer: Writer, done: int) -> int:
    for name, metadata in frames.metadata[done:]:
        if name not in (SUMMARY_METADATA, RECOVERED_METADATA):
            writer.add_metadata(name, metadata)
    return len(frames.metadata)


def _harmless(source: Path, frames: Frames) -> bool:
    """Whether what was cut off cannot have held an event."""
    if frames.damage is None:
        return True
    with open(source, "rb") as file:
        file.seek(frames.end)
        opcode = file.read(1)
    return not opcode or (frames.damage.torn and opcode[0] in _EMPTY_HANDED)


def _set_aside(source: Path, goal: Path, harmless: bool) -> Path | None:
    if source.suffix != ACTIVE_SUFFIX:
        return source  # a file given by name is never touched
    if harmless:
        source.unlink()
        return None
    for number in range(1, 1000):
        kept = goal.with_name(f"{goal.name}{DAMAGED_SUFFIX}{'' if number == 1 else f'.{number}'}")
        if not os.path.lexists(kept):
            source.rename(kept)
            return kept
    raise RecordingError(source, "too many damaged files of this name")


def discard_empty(path: Path) -> bool:
    """Delete a leftover without a byte: its writer was killed before it wrote. False for any other file."""
    try:
        with open(path, "rb") as held:
            lock(held, path)
            if os.fstat(held.fileno()).st_size:
                return False
            path.unlink()
    except OSError:
        return False
    return True


def _finish_earlier(source: Path, goal: Path) -> Recovered:
    """The target is there: take up a recovery or a naming that was interrupted, or refuse."""
    if os.path.samefile(source, goal):
        source.unlink()
        with Frames(goal) as frames:
            messages = sum(1 for _ in frames.messages())
        return Recovered(path=goal, messages=messages, lost_bytes=0, damage=None, damaged_path=None)
    with Frames(goal) as frames:
        messages = sum(1 for _ in frames.messages())
        told = dict(frames.metadata).get(RECOVERED_METADATA, {})
        whole = frames.damage is None
    size = source.stat().st_size
    if not whole or (told.get("source"), told.get("source_bytes")) != (source.name, str(size)):
        raise RecordingError(goal, f"exists; {source.name} is not recovered over it")
    kept = _set_aside(source, goal, told.get("harmless") == "True")
    lost = size - int(told.get("kept_bytes", size))
    return Recovered(path=goal, messages=messages, lost_bytes=lost, damage=None, damaged_path=kept)
