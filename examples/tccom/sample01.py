"""Sample 01 (Tc3_Module manual 7.1): a calculation that one program offers and another one uses. Either may start first.

    python examples/tccom/sample01.py

The provider's module registers itself and goes to OP. The caller knows its object id and its interface, and nothing else.
"""

from calculation import CALCULATION_ID, PROVIDER, Calculation, ICalculation
from two_programs import Run, main

from bridge import open_bus
from bridge.tccom import ObjectServer
from bridge.tccom.proxy import RemoteObjects
from bridge.tccom.service import ObjectService


def provider(run: Run) -> None:
    with (
        open_bus(run.config) as bus,
        ObjectServer() as server,
        Calculation(server, name="Calculation", object_id=CALCULATION_ID),
        ObjectService(server, bus, PROVIDER),
    ):
        run.until_stopped()


def caller(run: Run) -> None:
    def call(calculation: ICalculation, number: int) -> str:
        added, left = calculation.addition(number, 4), calculation.subtraction(number, 4)
        return f"{number} + 4 = {added.value}, {number} - 4 = {left.value}"

    with open_bus(run.config) as bus, RemoteObjects(bus, PROVIDER) as there:
        run.keep_calling(lambda: there.get(CALCULATION_ID, ICalculation), call)


if __name__ == "__main__":
    main(provider, caller)
