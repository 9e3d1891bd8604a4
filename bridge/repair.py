"""What is asked when something is missing: the sender for its own events, the logger for its log, the loggers for their state.

Rule 1: nobody's answer is trusted further than the question: only events of the asked session and range are taken.
Rule 2: no answer and a broken answer are the same here: nothing was found. The listener reports what stays missing.
"""

import contextlib
import time
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from bridge.core import codec, keys
from bridge.core.events import Limits
from bridge.core.questions import LogPart, LogQuestion, StatePart
from bridge.core.sequence import Missing
from bridge.edges.bus import Bus
from bridge.notices import Heard, Snapshot, TwoLoggers

PART_EVENTS: Final = 2048
PATIENCE_S: Final = 3.0
_STEP_S: Final = 0.05


def elements_of(payload: bytes, encoding: str, decoded: codec.Decoded) -> dict[int, Heard]:
    """Each event's own bytes, by the event's id(); the raw slices of rejected elements stand between them."""
    encoding = encoding.partition(";")[0]
    elements = codec.split(payload, encoding)
    if decoded.rejected:
        bad = [rejected.raw for rejected in decoded.rejected]
        for raw in bad:
            elements.remove(raw)
    arrival_ns = time.time_ns()
    return {
        id(event): Heard(event, element, encoding, arrival_ns) for event, element in zip(decoded.events, elements, strict=True)
    }


class Held(NamedTuple):
    """What a sender says about a gap: events by key_seq, the seq up to which it holds nothing, its last number on the key.

    None: it did not tell. whole: it answered and nothing of the answer is missing.
    """

    found: dict[int, Heard]
    evicted: int | None = None
    numbered: int | None = None
    whole: bool = False


def ask_sender(
    bus: Bus,
    realm: str,
    target: str,
    missing: Missing,
    limits: Limits,
    *,
    is_there: Callable[[], bool],
    wait: Callable[[float], object],
) -> Held:
    """What the sender still holds of a gap, asked for in parts of PART_EVENTS.

    Who is_there and is not heard may be connecting again, or be asked by many at once: it is asked again until nothing has
    come for PATIENCE_S.
    """
    found: dict[int, Heard] = {}
    evicted: int | None = None
    numbered: int | None = None
    first, last = missing.first, missing.last
    deadline = time.monotonic() + PATIENCE_S
    size = PART_EVENTS
    whole = False
    while first <= last:
        part = msgspec.structs.replace(missing, first=first, last=min(last, first + size - 1))
        held = _ask_part(bus, realm, target, part, limits)
        found.update(held.found)
        if held.evicted is not None:
            evicted, numbered = held.evicted, held.numbered
            last = last if numbered is None else min(last, numbered)
        if held.found or held.whole:
            deadline = time.monotonic() + PATIENCE_S
        if held.whole and numbered is None:  # it does not tell how far it has come, so the rest is asked for at once
            size = last
        whole = held.whole
        if whole:
            first = part.last + 1
        elif not is_there() or time.monotonic() > deadline:
            break
        else:
            wait(_STEP_S)
    return Held(found, evicted, numbered, whole)


def _ask_part(bus: Bus, realm: str, target: str, missing: Missing, limits: Limits) -> Held:
    held = Held({})
    key = keys.parse_event_key(missing.key)
    question = keys.verb_key(realm, target, "@sent", missing.session)
    answers = bus.ask(question, msgspec.json.encode(missing), timeout_s=2.0)
    for answer in answers:
        if answer.error:
            continue
        with contextlib.suppress(codec.CodecError, ValueError):
            evicted, *numbered = map(int, answer.note.split())
            held = held._replace(evicted=evicted, numbered=numbered[0] if numbered else None)
            decoded = codec.decode(answer.payload, answer.encoding, key, limits)
            for heard in elements_of(answer.payload, answer.encoding, decoded).values():
                event = heard.event
                if event.session == missing.session and missing.first <= event.key_seq <= missing.last:
                    held.found[event.key_seq] = heard
    return held._replace(whole=bool(answers) and not any(answer.error for answer in answers))


def ask_log(bus: Bus, realm: str, target: str, missing: Missing) -> list[Heard]:
    """What the logger of the target keeps of a gap; its bytes are encoded anew."""
    question = msgspec.json.encode(LogQuestion(missing=missing))
    found: list[Heard] = []
    wanted = range(missing.first, missing.last + 1)
    for answer in bus.ask(keys.verb_key(realm, target, "@log"), question, timeout_s=2.0):
        if not answer.error:
            with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                part = msgspec.json.decode(answer.payload, type=LogPart)
                found.extend(
                    Heard(stored.event, codec.encode(stored.event), codec.JSON, time.time_ns())
                    for stored in part.events
                    if stored.event.session == missing.session and stored.event.key_seq in wanted
                )
    return found


class States(msgspec.Struct, frozen=True):
    """What loggers answered: whole states, targets with two loggers (their states are left out), undecodable answers."""

    whole: tuple[Snapshot, ...]
    doubles: tuple[TwoLoggers, ...]
    undecodable: int


def ask_state(bus: Bus, realm: str, target: str | None) -> States:
    """The state of the target's logger, or of every logger there is; read-only ones are not counted as loggers."""
    parts: dict[str, dict[str, list[StatePart]]] = {}
    undecodable = 0
    for answer in bus.ask(keys.verb_key(realm, target, "@state"), timeout_s=2.0):
        if answer.error:
            continue
        try:
            part = msgspec.json.decode(answer.payload, type=StatePart)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            undecodable += 1
            continue
        if not part.read_only:
            parts.setdefault(part.target, {}).setdefault(part.session, []).append(part)
    whole = []
    for name, sessions in parts.items():
        for session, found in sessions.items():
            if len(sessions) == 1 and len({part.seq for part in found}) == 1 and len(found) == found[0].parts:
                whole.append(Snapshot(name, session, found[0].seq, tuple(alarm for part in found for alarm in part.alarms)))
    doubles = [TwoLoggers(name, tuple(sorted(sessions))) for name, sessions in parts.items() if len(sessions) > 1]
    return States(tuple(whole), tuple(doubles), undecodable)
