"""Who is there: senders and loggers, told from their tokens and from the connection to the bus.

Rule 1: a token that vanishes while the connection to the router is lost says nothing: a killed router takes back everybody's.
Who is not back AWAY_S after the connection is gone then.
Rule 2: the connection and the tokens come through different queues, so a vanished token is believed after SETTLE_S.
Rule 3: a sender that gives up one role and keeps another is not gone.
Rule 4: the role LEFT is a farewell: while it is shown its session gives up its other role, and when it goes nothing is said.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from bridge.core import keys
from bridge.edges.bus import Bus

LEFT: Final = "left"
SETTLE_S: Final = 0.1
AWAY_S: Final = 2.0
_RECENT_S: Final = 1.0


class Token(NamedTuple):
    """One token: who shows it, for which target, in which role."""

    target: str
    role: str
    session: str


class Attendance:
    """Follows the tokens of targets (None: of all). Its callbacks come on threads of the bus, never on Zenoh's own."""

    def __init__(
        self,
        bus: Bus,
        realm: str,
        targets: Sequence[str | None],
        *,
        came: Callable[[Token], None],
        left: Callable[[Token, bool], None],
        connected: Callable[[bool], None],
    ) -> None:
        """left(token, gone): gone is False for who lives on in another role. connected(there): is the router there."""
        self._came, self._left, self._connected = came, left, connected
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._there: dict[str, set[Token]] = {}
        self._away: set[Token] = set()
        self._bus, self._routed = bus, bus.has_router()
        self._lost = False
        self._lost_s = self._back_s = float("-inf")
        self._roll_call: threading.Timer | None = None
        self._watches = [bus.watch_connection(self._connection_changed)]
        self._watches += [bus.watch_alive(keys.verb_key(realm, t, "@alive", None, None), self._token_changed) for t in targets]

    def is_there(self, session: str) -> bool:
        """Whether a session shows a token now, or did so when the connection was lost."""
        with self._lock:
            return bool(self._there.get(session)) or any(token.session == session for token in self._away)

    def _token_changed(self, key: str, there: bool) -> None:
        with contextlib.suppress(keys.KeyFormatError, ValueError):
            _, target, _, (role, session) = keys.parse_verb_key(key)
            token = Token(target, role, session)
            if there:
                with self._lock:
                    self._there.setdefault(session, set()).add(token)
                    self._away.discard(token)
                if role != LEFT:
                    self._came(token)
                return
            with self._lock:
                tokens = self._there.get(session, set())
                tokens.discard(token)
                if not tokens:
                    self._there.pop(session, None)
                lives_on, lost = bool(tokens), self._lost
            if role == LEFT:
                return
            if not lives_on and not lost:
                self._closed.wait(SETTLE_S)
            unreachable = self._routed and not self._bus.has_router()
            with self._lock:
                if unreachable or self._lost or self._lost_s > time.monotonic() - _RECENT_S:
                    self._away.add(token)
                    return
            self._left(token, not lives_on)

    def _connection_changed(self, there: bool) -> None:
        with self._lock:
            self._lost = not there
            self._routed = True
            if there:
                self._back_s = time.monotonic()
                self._roll_call = threading.Timer(AWAY_S, self._call_roll, (self._back_s,))
                self._roll_call.daemon = True
                self._roll_call.start()
            else:
                self._lost_s = time.monotonic()
        self._connected(there)

    def _call_roll(self, back_s: float) -> None:
        with self._lock:
            if self._lost or self._back_s != back_s or self._closed.is_set():
                return
            away, self._away = self._away, set()
            gone = [(token, not self._there.get(token.session)) for token in away]
        for token, is_gone in gone:
            self._left(token, is_gone)

    def close(self) -> None:
        """Stop following."""
        self._closed.set()
        for watch in self._watches:
            watch.close()
        with self._lock:
            if self._roll_call is not None:
                self._roll_call.cancel()
