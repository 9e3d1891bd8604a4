"""The interfaces that TcCOM itself defines, as far as they make sense here, under TwinCAT's ids.

ITcUnknown has no methods here: querying, counting and releasing are what a Reference does. ITComObject, ITcADI and
ITcWatchSource are implemented by Module for every object; the object server, tasks and cyclic modules implement the rest.

What an interface reveals of an object is plain data, so that it can be called over the bus as well.
"""

from collections.abc import Mapping
from typing import Protocol, TypeAlias

import msgspec

from bridge.tccom.identity import (
    CREATE_NEW_ID,
    ITC_ADI,
    ITC_CYCLIC,
    ITC_CYCLIC_CALLER,
    ITC_TASK,
    ITC_UNKNOWN,
    ITC_WATCH_SOURCE,
    ITCOM_OBJECT,
    ITCOM_OBJECT_SERVER,
    NO_OBJECT,
    CategoryId,
    ClassId,
    ContextId,
    InterfaceId,
    ObjectId,
    ParameterId,
)
from bridge.tccom.interfaces import Answer, interface
from bridge.tccom.states import State

ParameterKey: TypeAlias = ParameterId | str
"""The id or the name of a parameter or interface pointer."""
Parameters: TypeAlias = Mapping[str, object] | Mapping[ParameterKey, object]
"""Values for parameters and interface pointers, by id or name."""


class ObjectInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What everybody may know of an object. references counts its holders, the object server among them."""

    object_id: ObjectId
    name: str
    class_id: ClassId
    class_name: str
    parent_id: ObjectId
    state: State
    references: int
    interfaces: tuple[InterfaceId, ...]
    categories: tuple[CategoryId, ...]


class ParameterInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter (or pointer: interface is set) of a class. settable: "init", "op", both or none."""

    id: ParameterId
    name: str
    type: str
    settable: tuple[str, ...]
    required: bool
    interface: InterfaceId = ""
    comment: str = ""


class SymbolInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A symbol of a data area, by its whole path."""

    path: str
    type: str
    area: int
    writable: bool


class ClassInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What everybody may know of a module class. description: the first line of its docstring."""

    class_id: ClassId
    name: str
    description: str
    library: str
    thread_safe: bool
    interfaces: dict[InterfaceId, str]
    categories: tuple[CategoryId, ...]
    parameters: tuple[ParameterInfo, ...]
    symbols: tuple[SymbolInfo, ...]


@interface(ITC_UNKNOWN)
class IUnknown(Protocol):
    """ITcUnknown: whatever is an object."""


@interface(ITCOM_OBJECT)
class IObject(IUnknown, Protocol):
    """ITComObject: identity, parameters and state of an object. Offered by every module (manual 8.2.1)."""

    def get_object_id(self) -> Answer[ObjectId]: ...
    def get_object_name(self) -> Answer[str]: ...
    def set_object_name(self, name: str) -> Answer[None]: ...
    def get_parent_id(self) -> Answer[ObjectId]: ...
    def set_parent_id(self, object_id: ObjectId) -> Answer[None]: ...
    def get_state(self) -> Answer[State]: ...
    def set_state(self, state: State) -> Answer[None]: ...
    def get_parameter(self, key: ParameterKey) -> Answer[object]: ...
    def set_parameter(self, key: ParameterKey, value: object) -> Answer[None]: ...


@interface(ITC_ADI)
class IDataAreas(Protocol):
    """ITcADI: symbols of data areas by their path, "area.symbol". Offered by every module; "" reads all areas."""

    def read_symbol(self, path: str) -> Answer[object]: ...
    def write_symbol(self, path: str, value: object) -> Answer[None]: ...


@interface(ITC_WATCH_SOURCE)
class IWatchSource(Protocol):
    """ITcWatchSource: parameters (by id or name) and symbols (by path) as they were at one moment. Offered by every module."""

    def read_values(self, keys: tuple[ParameterKey, ...]) -> Answer[tuple[object, ...]]: ...


@interface(ITCOM_OBJECT_SERVER)
class IObjectServer(Protocol):
    """ITComObjectServer: who is there, and coming and going. Offered by the object OBJECT_SERVER_ID."""

    def objects(self) -> Answer[tuple[ObjectInfo, ...]]: ...
    def object_info(self, object_id: ObjectId) -> Answer[ObjectInfo]: ...
    def classes(self) -> Answer[tuple[ClassInfo, ...]]: ...
    def class_info(self, class_id: ClassId) -> Answer[ClassInfo]: ...
    def create_instance(
        self,
        class_id: ClassId,
        name: str = "",
        object_id: ObjectId = CREATE_NEW_ID,
        parent_id: ObjectId = NO_OBJECT,
        parameters: dict[str, object] = {},  # noqa: B006 # msgspec copies an empty default
        state: State = State.PREOP,
    ) -> Answer[ObjectId]: ...
    def delete_instance(self, object_id: ObjectId) -> Answer[None]: ...


@interface(ITC_CYCLIC)
class ICyclic(Protocol):
    """ITcCyclic: is called once per cycle of its task. cycle_ns is the nominal length of a cycle."""

    def cycle_update(self, context_id: ContextId, cycle_ns: int) -> Answer[None]: ...


@interface(ITC_CYCLIC_CALLER)
class ICyclicCaller(Protocol):
    """ITcCyclicCaller: a task that calls others. An object is added in SO and removed in OS."""

    def add_module(self, object_id: ObjectId, context_id: ContextId = 0) -> Answer[None]: ...
    def remove_module(self, object_id: ObjectId) -> Answer[None]: ...


class TaskInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A task: its settings, what it calls, and how it kept its times. overruns: cycles that began late and were skipped."""

    cycle_ns: int
    priority: int
    modules: tuple[ObjectId, ...]
    cycles: int
    overruns: int
    failures: int
    longest_ns: int


@interface(ITC_TASK)
class ITask(Protocol):
    """ITcTask: the cycle time, the priority and the counters of a task."""

    def task_info(self) -> Answer[TaskInfo]: ...
