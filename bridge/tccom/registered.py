"""How a program offers a module of its own making: a base class that registers itself.

    class Calculation(RegisteredModule, ICalculation): ...

    with ObjectServer() as server, Calculation(server, name="Calculation") as calculation:
        print(calculation.object_id)

Entered, the module is registered and in OP; left, it is taken down and signed off. TcBaseModuleRegistered does so from its
creation on; here there is a moment to begin and one to end, and both are written down.
"""

import contextlib
from types import TracebackType
from typing import Self

from bridge.core.hresult import AdsError
from bridge.tccom.general import Parameters
from bridge.tccom.identity import CREATE_NEW_ID, NO_OBJECT, ObjectId
from bridge.tccom.module import Module
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State


class RegisteredModule(Module):
    """Registers itself and goes to OP. A class id is not needed: nobody else creates it."""

    def __init__(
        self,
        server: ObjectServer,
        *,
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        name: str = "",
        parameters: Parameters | None = None,
    ) -> None:
        self._server = server
        self._wanted_id, self._wanted_parent, self._wanted_name, self._given = object_id, parent_id, name, parameters

    def __enter__(self) -> Self:
        """Register and go to OP; AdsError, and it is not registered, when a step fails."""
        self._server.add(
            self,
            object_id=self._wanted_id,
            parent_id=self._wanted_parent,
            name=self._wanted_name,
            parameters=self._given,
            state=State.OP,
        )
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """Go down and sign off; who holds it may still call it."""
        with contextlib.suppress(AdsError):
            self._server.delete(self.object_id, force=True)
