"""What samples 02 and 03 share: a counter, its interface and its class id (manual 7.2, 7.3)."""

from typing import Protocol

from bridge.tccom import DONE, Answer, Module, Parameter, Settable, interface

PROVIDER = "provider"
INCREMENT_ID = 0x71010002


@interface("3f2b6a10-58c1-4f77-9b0e-01c2d3e4f502")
class IIncrement(Protocol):
    """Counts."""

    def increment(self) -> Answer[int]: ...
    def reset(self) -> Answer[None]: ...


class Increment(Module, IIncrement):
    """Counts in steps. Calls never overlap, so no lock is needed."""

    class_id = "3f2b6a10-58c1-4f77-9b0e-01c2d3e4f503"
    step = Parameter(0x1, int, default=1, settable=Settable.INIT | Settable.OP, comment="how much each call adds")

    def on_ip(self) -> None:
        self.value = 0

    def increment(self) -> Answer[int]:
        self.value += self.step
        return Answer(self.value)

    def reset(self) -> Answer[None]:
        self.value = 0
        return DONE
