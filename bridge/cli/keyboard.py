"""Keys while a replay plays: on a terminal each key is a command."""

import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from bridge.cli.options import note
from bridge.core.hresult import AdsError
from bridge.core.times import NS_PER_S, time_text

if TYPE_CHECKING:
    from bridge.replayer import Player

KEYS: Final = {
    " ": "pause, or go on",
    "s": "play one event, then stand still",
    "]": "10 s forward",
    "[": "10 s back",
    "+": "twice as fast",
    "-": "half as fast",
    "q": "end",
    "?": "what the keys do",
}
_JUMP_NS: Final = 10 * NS_PER_S
_SLOWEST: Final = 1 / 1024


@contextmanager
def keyboard(player: "Player") -> Iterator[None]:
    """Listen to keys while the block runs; without a terminal nobody listens."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        yield
        return
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    reader, writer = os.pipe()

    def listen() -> None:
        while True:
            ready, _, _ = select.select([terminal, reader], [], [])
            if reader in ready or not (typed := os.read(terminal, 64)):
                return
            for key in typed.decode(errors="replace"):
                press(player, key)

    thread = threading.Thread(target=listen, name="keys", daemon=True)
    try:
        tty.setcbreak(terminal, termios.TCSADRAIN)  # a key that was pressed already counts
        thread.start()
        yield
    finally:
        os.close(writer)
        thread.join(1.0)
        os.close(reader)
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def press(player: "Player", key: str) -> None:
    """Do what a key says, and tell where the replay is; other keys do nothing."""
    if key not in KEYS:
        return
    try:
        match key:
            case " ":
                (player.pause if player.running else player.resume)()
            case "s":
                player.step()
            case "]" | "[":
                wanted_ns = player.now_ns + (_JUMP_NS if key == "]" else -_JUMP_NS)
                player.seek(min(max(wanted_ns, player.span.first_ns), player.span.last_ns))
            case "+" | "-":
                rate = float(player.status()["rate"])
                player.change_rate(rate * 2 if key == "+" else max(rate / 2, _SLOWEST))
            case "q":
                player.stop()
            case _:
                for each, meaning in KEYS.items():
                    note(f"  {'space' if each == ' ' else each:5}  {meaning}")
                return
    except AdsError as error:
        note(str(error))
        return
    status = player.status()
    place = f"{status['offset_s']:g} s of {status['length_s']:g} s"
    note(f"{status['state']} at {time_text(player.now_ns, 3)}, {place}, rate {status['rate']:g}")
