"""Modules that the stories about TcCOM share."""

import threading
from collections.abc import Callable
from typing import Protocol

import msgspec

from bridge.core.hresult import S_FALSE
from bridge.tccom.declarations import DataArea, InterfacePointer, Parameter, Settable
from bridge.tccom.interfaces import DONE, Answer, interface
from bridge.tccom.module import Module
from bridge.tccom.states import State, Transition
from bridge.tccom.tasks import CyclicModule


@interface("6b3f0bcd-3f8c-4d0c-9f39-5f8d7b1d0a11")
class ICalculation(Protocol):
    """What sample 01 of the manual offers."""

    def addition(self, a: int, b: int) -> Answer[int]: ...
    def subtraction(self, a: int, b: int = 1) -> Answer[int]: ...


class Inputs(msgspec.Struct):
    value: int = 0


class Outputs(msgspec.Struct):
    total: int = 0
    inner: Inputs = msgspec.field(default_factory=Inputs)


class Calculation(Module, ICalculation):
    """Adds and subtracts."""

    class_id = "0e0f3a52-9f6e-4f0c-8a5a-0f5c3f4f2b10"
    categories = (7,)

    offset = Parameter(0x1, int, default=0, settable=Settable.INIT | Settable.OP)
    inputs = DataArea(0, Inputs, writable=True)
    outputs = DataArea(1, Outputs)

    def addition(self, a: int, b: int) -> Answer[int]:
        self.outputs.total = a + b + self.offset
        return Answer(self.outputs.total)

    def subtraction(self, a: int, b: int = 1) -> Answer[int]:
        return Answer(a - b, S_FALSE if b > a else 0)


class Caller(Module):
    """Uses a calculation."""

    class_id = "0e0f3a52-9f6e-4f0c-8a5a-0f5c3f4f2b11"

    calculation = InterfacePointer(0x2, ICalculation)


class Scripted(Module):
    """Notes its hooks, and fails or does in one of them what a test asks for."""

    class_id = "0e0f3a52-9f6e-4f0c-8a5a-0f5c3f4f2b12"

    def __init__(self, **does: Callable[["Scripted"], object]) -> None:
        self.does, self.noted = does, list[str]()

    def _note(self, transition: Transition) -> None:
        self.noted.append(transition)
        if transition in self.does:
            self.does[transition](self)

    def on_ip(self) -> None:
        self._note(Transition.IP)

    def on_ps(self) -> None:
        self._note(Transition.PS)

    def on_so(self) -> None:
        self._note(Transition.SO)

    def on_os(self) -> None:
        self._note(Transition.OS)

    def on_sp(self) -> None:
        self._note(Transition.SP)

    def on_pi(self) -> None:
        self._note(Transition.PI)


class Counter(CyclicModule):
    """Counts its cycles, and does in each what a test asks for."""

    class_id = "33333333-0000-4000-8000-000000000001"

    def __init__(self, does: Callable[["Counter"], object] = lambda _: None) -> None:
        self.does = does
        self.cycles = 0
        self.reached = threading.Event()

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        self.cycles += 1
        assert self.state is State.OP
        if self.cycles >= 5:
            self.reached.set()
        self.does(self)
        return DONE
