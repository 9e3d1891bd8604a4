"""What the author of a module writes, and its user: a type checker sees every method, parameter and pointer."""

from typing import Protocol, assert_type

from msgspec import Struct

from bridge.tccom import (
    DONE,
    Answer,
    CyclicModule,
    DataArea,
    InterfacePointer,
    Module,
    ObjectServer,
    Parameter,
    Reference,
    RegisteredModule,
    Settable,
    State,
    interface,
)


@interface("77777777-0000-4000-8000-000000000001")
class IIncrement(Protocol):
    def increment(self, by: int = 1) -> Answer[int]: ...
    def reset(self) -> Answer[None]: ...


class Outputs(Struct):
    count: int = 0


class Increment(Module, IIncrement):
    class_id = "77777777-0000-4000-8000-000000000002"

    limit = Parameter(0x1, int, default=100, settable=Settable.INIT | Settable.OP)
    outputs = DataArea(1, Outputs)

    def increment(self, by: int = 1) -> Answer[int]:
        assert_type(self.limit, int)
        assert_type(self.outputs, Outputs)
        self.outputs.count = min(self.outputs.count + by, self.limit)
        return Answer(self.outputs.count)

    def reset(self) -> Answer[None]:
        self.outputs.count = 0
        return DONE


class Stepper(CyclicModule):
    class_id = "77777777-0000-4000-8000-000000000003"

    counter = InterfacePointer(0x1, IIncrement)

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        assert_type(self.counter, IIncrement)
        assert_type(self.counter.increment(2), Answer[int])
        return DONE


class Own(RegisteredModule, IIncrement):
    def increment(self, by: int = 1) -> Answer[int]:
        return Answer(by)

    def reset(self) -> Answer[None]:
        return DONE


def use(server: ObjectServer) -> None:
    reference = server.create(Increment, IIncrement, parameters={"limit": 5}, state=State.OP)
    assert_type(reference, Reference[IIncrement])
    with reference as counter:
        assert_type(counter, IIncrement)
        assert_type(counter.increment().value, int)
    with Own(server, name="own") as own:
        assert_type(own, Own)
    assert_type(Increment.limit, Parameter[int])
    counter.decrement()  # type: ignore[attr-defined] # no such method
    counter.increment("1")  # type: ignore[arg-type] # a number is wanted
    Increment().limit = "5"  # type: ignore[assignment] # a number is wanted
