"""Sample 13 (Tc3_Module manual 7.4): a cyclic module calls the calculation of sample 01, which another program offers.

    python examples/tccom/sample13.py

The module has an interface pointer that names an object of another target. It is not required, so that the module may start
first: it is looked for in each cycle until it is there, and released in OS.
"""

import queue

from calculation import CALCULATION_ID, PROVIDER, ICalculation
from sample01 import provider
from two_programs import Run, main

from bridge import open_bus
from bridge.tccom import DONE, AdsError, Answer, CyclicModule, InterfacePointer, ObjectServer, Resolved, State
from bridge.tccom.proxy import RemoteTargets
from bridge.tccom.tasks import Task

TASK_ID = 0x02010020


class Caller(CyclicModule):
    """Calls once per cycle and keeps what it heard for the program to print."""

    class_id = "3f2b6a10-58c1-4f77-9b0e-01c2d3e4f505"
    calculation = InterfacePointer(0x1, ICalculation, resolved=Resolved.SO, required=False)

    def on_ip(self) -> None:
        self.heard: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.number = 0

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        try:
            sum_of_both = self.calculation.addition(self.number, self.number).value
        except AdsError as error:
            self.heard.put(f"no answer: {error}")
        else:
            self.heard.put(f"{self.number} + {self.number} = {sum_of_both}")
            self.number += 1
        return DONE


def caller(run: Run) -> None:
    with open_bus(run.config) as bus, RemoteTargets(bus) as targets, ObjectServer(remote=targets) as server:
        server.add(Task(), object_id=TASK_ID, name="Task", parameters={"cycle_ns": 100_000_000}, state=State.OP)
        module = Caller()
        pointers = {"cyclic_caller": TASK_ID, "calculation": f"{PROVIDER}/0x{CALCULATION_ID:08X}"}
        server.add(module, name="Caller", parameters=pointers, state=State.OP)
        told = ""
        while not run.stop.is_set() and (module.number < run.calls or not run.calls):
            line = module.heard.get()
            if line != told:
                print(line, flush=True)
            told = line


if __name__ == "__main__":
    main(provider, caller)
