"""Sample 02 (Tc3_Module manual 7.2): an object that exists, found by its id and used by another program.

    python examples/tccom/sample02.py

The provider creates the object from its class. The caller holds it while it calls, so that it would outlive its deletion.
"""

from increment import INCREMENT_ID, PROVIDER, IIncrement, Increment
from two_programs import Run, main

from bridge import open_bus
from bridge.tccom import ObjectServer, State
from bridge.tccom.proxy import RemoteObjects
from bridge.tccom.service import ObjectService


def provider(run: Run) -> None:
    with open_bus(run.config) as bus, ObjectServer() as server, ObjectService(server, bus, PROVIDER):
        server.add(Increment(), name="Increment", object_id=INCREMENT_ID, parameters={"step": 5}, state=State.OP)
        run.until_stopped()


def caller(run: Run) -> None:
    def call(counter: IIncrement, number: int) -> str:
        return f"call {number}: {counter.increment().value}"

    with open_bus(run.config) as bus, RemoteObjects(bus, PROVIDER) as there:
        run.keep_calling(lambda: there.get(INCREMENT_ID, IIncrement), call)


if __name__ == "__main__":
    main(provider, caller)
