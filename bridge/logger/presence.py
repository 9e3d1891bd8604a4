"""Which loggers and sources of a target there are, and when that changes.

Liveliness tokens say so: a logger holds @alive/logger/{session} from opening to closing, and loses it with its process; an
object server does so with @alive/objects/{session}. Who raises alarms through the logger holds @alive/source/{session};
closing shows @alive/left/{session} in the moment in which that token goes, and so a source that has left is told from one
that died.
"""

import threading
from collections.abc import Callable
from typing import Final

from bridge.attendance import LEFT
from bridge.core import keys
from bridge.edges.bus import Bus, Closable

LOGGER: Final = "logger"
OBJECTS: Final = "objects"
SOURCE: Final = "source"


def token_key(target: str, realm: str, session: str | None = None, *, role: str = LOGGER) -> str:
    """The key of a logger's token, or the expression for all of the target's."""
    return keys.verb_key(realm, target, "@alive", role, session)


def show_source(bus: Bus, target: str, realm: str, session: str) -> Closable:
    """Show that a source of the target's alarms is there, until closed."""
    here, left = (keys.verb_key(realm, target, "@alive", role, session) for role in (SOURCE, LEFT))
    return bus.alive(here, left)


def session_of(key: str) -> str | None:
    """The session in a token's key; None when a stranger wrote what is no such key."""
    try:
        parts = keys.parse_verb_key(key)[3]
    except keys.KeyFormatError:
        return None
    return parts[1] if len(parts) == 2 else None


def loggers(bus: Bus, target: str, realm: str = keys.LIVE, *, role: str = LOGGER) -> set[str]:
    """Sessions that hold the name of a target now."""
    found = map(session_of, bus.who_is_alive(token_key(target, realm, role=role), timeout_s=0.5))
    return {session for session in found if session is not None}


def targets_of(bus: Bus, realm: str = keys.LIVE, *, role: str = LOGGER) -> set[str]:
    """Targets whose name somebody holds now."""
    found = bus.who_is_alive(keys.verb_key(realm, None, "@alive", role, None), timeout_s=0.5)
    return {keys.parse_verb_key(key)[1] for key in found if session_of(key) is not None}


class Presence:
    """Follows the loggers of a target until closed; changed(there) is called when the first comes or the last goes."""

    def __init__(
        self, bus: Bus, target: str, realm: str, changed: Callable[[bool], None] | None = None, *, role: str = LOGGER
    ) -> None:
        self._changed = changed
        self._there: set[str] = set()
        self._news = threading.Condition()
        self._closed = False
        self._watch = bus.watch_alive(token_key(target, realm, role=role), self._seen)

    @property
    def sessions(self) -> set[str]:
        """Sessions that are there now."""
        with self._news:
            return set(self._there)

    def _seen(self, key: str, there: bool) -> None:
        session = session_of(key)
        with self._news:
            if self._closed or session is None:
                return
            before = bool(self._there)
            (self._there.add if there else self._there.discard)(session)
            after = bool(self._there)
            self._news.notify_all()
        if before != after and self._changed is not None:
            self._changed(after)

    def wait(self, timeout_s: float, *, there: bool = True) -> bool:
        """Wait until a logger is there (or none is); False when time is up."""
        with self._news:
            return self._news.wait_for(lambda: bool(self._there) == there, timeout_s)

    def close(self) -> None:
        """Stop following. Who was told that a logger is there is told that it is not, as far as we know."""
        with self._news:
            if self._closed:
                return
            self._closed = True
            before = bool(self._there)
            self._there.clear()
            self._news.notify_all()
        self._watch.close()
        if before and self._changed is not None:
            self._changed(False)
