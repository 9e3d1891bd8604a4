"""The object server as an object: what others may ask it over the bus.

Rule 1: it has the id OBJECT_SERVER_ID and stays in OP until the server is closed.
Rule 2: what it creates is held by nobody but the server. Who wants to hold something creates it through a proxy.
"""

from typing import Protocol

from bridge.core.hresult import ADS_E_ACCESSDENIED, AdsError
from bridge.tccom.describing import class_info
from bridge.tccom.factories import Factories
from bridge.tccom.general import ClassInfo, IObject, IObjectServer, ObjectInfo
from bridge.tccom.identity import CREATE_NEW_ID, NO_OBJECT, ClassId, ObjectId
from bridge.tccom.interfaces import DONE, Answer
from bridge.tccom.module import Module, Server
from bridge.tccom.states import State


class Opened(Server, Protocol):
    """What it needs of the object server."""

    factories: Factories

    @property
    def closed(self) -> bool: ...
    def object_info(self, object_id: ObjectId) -> ObjectInfo: ...


class ServerObject(Module, IObjectServer):
    """The object server, seen as an object."""

    class_id = "5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7b001"
    thread_safe = True

    def __init__(self, keeper: Opened) -> None:
        self._keeper = keeper

    def on_os(self) -> None:
        """Stay in OP for as long as the object server is open."""
        if not self._keeper.closed:
            raise AdsError(ADS_E_ACCESSDENIED, "the object server stays in OP until it is closed")

    def objects(self) -> Answer[tuple[ObjectInfo, ...]]:
        return Answer(self._keeper.objects())

    def object_info(self, object_id: ObjectId) -> Answer[ObjectInfo]:
        return Answer(self._keeper.object_info(object_id))

    def classes(self) -> Answer[tuple[ClassInfo, ...]]:
        return Answer(tuple(map(class_info, self._keeper.factories.classes())))

    def class_info(self, class_id: ClassId) -> Answer[ClassInfo]:
        return Answer(class_info(self._keeper.factories.find(class_id)))

    def create_instance(
        self,
        class_id: ClassId,
        name: str = "",
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        parameters: dict[str, object] = {},  # noqa: B006 # never changed
        state: State = State.PREOP,
    ) -> Answer[ObjectId]:
        with self._keeper.create(
            class_id,
            IObject,
            object_id=object_id,
            parent_id=parent_id,
            name=name,
            parameters=parameters,
            state=state,
        ) as created:
            return created.get_object_id()

    def delete_instance(self, object_id: ObjectId) -> Answer[None]:
        self._keeper.delete(object_id)
        return DONE
