"""Questions with typed answers: who answered what, and why there was no answer.

Rule 1: every answer names the session that gave it, so that two who answer where one is right are seen.
Rule 2: a refusal and an answer that cannot be read are reasons, not answers; the last one heard is told.
"""

import os
import socket
import sys
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from bridge.edges.bus import Answer, Bus


class Signed(Protocol):
    """An answer that names its session."""

    @property
    def session(self) -> str:
        """Who answered."""


_T = TypeVar("_T")
_S = TypeVar("_S", bound=Signed)


def read_answer(answer: Answer, kind: type[_T]) -> _T | str:
    """The answer, or why it is none."""
    if answer.error:
        return answer.payload.decode(errors="replace")
    try:
        return msgspec.json.decode(answer.payload, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return f"cannot be read: {error}"


def ask_sessions(bus: Bus, key: str, payload: bytes, kind: type[_S], *, timeout_s: float) -> tuple[dict[str, list[_S]], str]:
    """The answers by the session that gave them, and the last reason heard for none."""
    found: dict[str, list[_S]] = {}
    reason = ""
    for answer in bus.ask(key, payload, timeout_s=timeout_s):
        item = read_answer(answer, kind)
        if isinstance(item, str):
            reason = item
        else:
            found.setdefault(item.session, []).append(item)
    return found, reason


def this_client() -> str:
    """Where commands of this process come from: host:program."""
    return f"{socket.gethostname()}:{Path(sys.argv[0]).name or 'python'}"[:255]


def new_id() -> str:
    """An id for a command."""
    return os.urandom(8).hex()
