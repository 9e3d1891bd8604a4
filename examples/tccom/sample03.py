"""Sample 03 (Tc3_Module manual 7.3): an object that its user creates, in another program, and deletes again.

    python examples/tccom/sample03.py

The provider offers a class only. The caller creates an object of it by class id, in OP, with a name and a parameter; it is
transient: when the caller lets go of it, or dies, it is deleted.
"""

from increment import PROVIDER, IIncrement, Increment
from two_programs import Run, main

from bridge import open_bus
from bridge.tccom import ObjectServer, Reference, State
from bridge.tccom.factories import Factories
from bridge.tccom.proxy import RemoteObjects
from bridge.tccom.service import ObjectService


def provider(run: Run) -> None:
    factories = Factories(installed=False)
    factories.register(Increment)
    with open_bus(run.config) as bus, ObjectServer(factories=factories) as server, ObjectService(server, bus, PROVIDER):
        run.until_stopped()


def caller(run: Run) -> None:
    def call(counter: IIncrement, number: int) -> str:
        return f"call {number}: {counter.increment().value}"

    with open_bus(run.config) as bus, RemoteObjects(bus, PROVIDER) as there:

        def create() -> Reference[IIncrement]:
            parameters = {"step": 10}
            return there.create(
                Increment.class_id, IIncrement, name="Mine", parameters=parameters, state=State.OP, transient=True
            )

        run.keep_calling(create, call)
        if not run.stop.is_set():
            print(f"left behind: {[each.name for each in there.objects() if each.name == 'Mine']}")


if __name__ == "__main__":
    main(provider, caller)
