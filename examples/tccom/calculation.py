"""What provider and caller of samples 01 and 13 share: the interface (manual 7.1.1), and the module that offers it."""

from typing import Protocol

from bridge.tccom import Answer, RegisteredModule, interface

PROVIDER = "provider"
CALCULATION_ID = 0x71010001


@interface("3f2b6a10-58c1-4f77-9b0e-01c2d3e4f501")
class ICalculation(Protocol):
    """Adds and subtracts."""

    def addition(self, a: int, b: int) -> Answer[int]: ...
    def subtraction(self, a: int, b: int) -> Answer[int]: ...


class Calculation(RegisteredModule, ICalculation):
    """Keeps nothing between two calls, so that callers need not wait for each other."""

    thread_safe = True

    def addition(self, a: int, b: int) -> Answer[int]:
        return Answer(a + b)

    def subtraction(self, a: int, b: int) -> Answer[int]:
        return Answer(a - b)
