"""What a recorder does when it is told something over the bus.

Rule: a recorder that no longer records refuses with ADS_E_INVALIDSTATE; its status says why.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from bridge.control import RECORDER, Control
from bridge.core import keys
from bridge.core.control import ControlCommand, ControlQuestion, Facts, Pause, Resume, Split, Stop, Trigger, control_name
from bridge.core.hresult import ADS_E_INVALIDSTATE, AdsError
from bridge.edges.bus import Bus
from bridge.edges.recording import RecordingError
from bridge.recorder.service import Recorder

TAKES: Final[tuple[type[ControlCommand], ...]] = (Pause, Resume, Split, Trigger, Stop)


def controlled(recorder: Recorder, bus: Bus, name: str, *, realm: str = keys.LIVE, stop: Callable[[], None]) -> Control:
    """Let others tell it something under a name. NameTakenError when the name is taken.

    stop is called when it is told to: who made the recorder closes it.
    """

    def carry_out(question: ControlQuestion) -> None:
        try:
            match question.command:
                case Pause():
                    recorder.pause()
                case Resume():
                    recorder.resume()
                case Split():
                    recorder.split()
                case Trigger():
                    who = question.operator or question.client
                    recorder.trigger(": ".join(text for text in (f"asked for by {who}", question.comment) if text))
                case Stop():
                    stop()
                case _:
                    raise ValueError(f"a recorder takes no {control_name(question.command)}")
        except (RecordingError, TimeoutError) as error:
            raise AdsError(ADS_E_INVALIDSTATE, str(error)) from None

    def status() -> Facts:
        found: Facts = msgspec.to_builtins(recorder.status)
        return found

    return Control(bus, name, RECORDER, carry_out, status, takes=TAKES, realm=realm)
