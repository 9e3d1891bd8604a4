"""How one object is held by another: a reference, which is a context manager.

    with server.get(object_id, ICalculation) as calculation:
        calculation.addition(1, 2)

Rule 1: a reference holds its object until it is left. Inside, it is the interface: each call waits for the object's turn.
Rule 2: add_ref() and release() are there for those who must count by hand; they answer the object's count of holders.
safe_release() lets go of all this reference holds, any number of times. Leaving it does so too.
Rule 3: a reference that holds nothing refuses calls with E_POINTER.
Rule 4: a reference has an owner: "" is this process. The references of one that died are released by the object server.
"""

import threading
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Generic, Protocol, TypeVar

import msgspec

from bridge.core.hresult import ADS_E_NOINTERFACE, E_POINTER, S_OK, AdsError
from bridge.tccom.identity import InterfaceId, ObjectId
from bridge.tccom.interfaces import Answer, Interface, InterfaceInfo, Method, describe, stub
from bridge.tccom.reports import ReportKind

T = TypeVar("T")
U = TypeVar("U")


class Holdable(Protocol):
    """What a reference needs of the object that it holds."""

    object_id: ObjectId

    @property
    def interfaces(self) -> Mapping[InterfaceId, InterfaceInfo]: ...
    def add_ref(self) -> int: ...
    def release(self) -> int: ...
    def turn(self) -> AbstractContextManager[None]: ...
    def call(self, info: InterfaceInfo, method: Method, arguments: msgspec.Struct) -> Answer[object]: ...
    def report(self, kind: ReportKind, *, code: int = S_OK, detail: str = "", duration_ns: int = 0) -> None: ...


class Reference(Generic[T]):
    """A held interface of an object; AdsError (ADS_E_NOINTERFACE) when the object does not offer it."""

    def __init__(
        self,
        held: Holdable,
        interface: Interface[T],
        owner: str = "",
        released: "Callable[[Reference[T]], None]" = lambda _: None,
    ) -> None:
        """released is called when it has let go."""
        info = describe(interface)
        if info.id not in held.interfaces:
            raise AdsError(ADS_E_NOINTERFACE, f"{held} does not offer {info.name} ({info.id})")
        self.owner, self.held = owner, held
        self.info, self._released = info, released
        self._lock = threading.Lock()
        self._count = 1
        self.interface: T = stub(interface, self.call)
        """The methods of the object."""
        held.add_ref()

    @property
    def object_id(self) -> ObjectId:
        """The id of the object."""
        return self.held.object_id

    def add_ref(self) -> int:
        """Hold it once more (TcAddRef); AdsError (E_POINTER) when it is not held any more."""
        with self._lock:
            self._check()
            count = self.held.add_ref()
            self._count += 1
            return count

    def release(self) -> int:
        """Let go once (TcRelease); AdsError (E_POINTER) when it is not held."""
        with self._lock:
            self._check()
            self._count -= 1
            last = self._count == 0
        try:
            if last:
                self._released(self)
        finally:
            left = self.held.release()
        return left

    def safe_release(self) -> None:
        """Let go of all it holds (FW_SafeRelease). Any number of times."""
        with self._lock:
            count, self._count = self._count, 0
        try:
            if count:
                self._released(self)
        finally:
            for _ in range(count):
                self.held.release()

    def query(self, interface: Interface[U]) -> "Reference[U]":
        """Another interface of the object (TcQueryInterface), as a reference of its own; AdsError (ADS_E_NOINTERFACE)."""
        with self._lock:
            self._check()
            return Reference(self.held, interface)

    def turn(self) -> AbstractContextManager[None]:
        """Have the object alone for more than one call; AdsError (ADS_E_TIMEOUT) when others do not let go in time."""
        self._check()
        return self.held.turn()

    def _check(self) -> None:
        if not self._count:
            raise AdsError(E_POINTER, f"the reference to {self.held} was released")

    def call(self, method: Method, arguments: msgspec.Struct) -> Answer[object]:
        """What the interface does for each of its methods."""
        self._check()
        return self.held.call(self.info, method, arguments)

    def __enter__(self) -> T:
        self._check()
        return self.interface

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.safe_release()
