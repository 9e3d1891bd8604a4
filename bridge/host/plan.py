"""From a plant file to what is started: classes found, values checked, ids given, in order.

Rule 1: everything that can be known before starting is checked before: all faults are told at once, with file and line.
Rule 2: an id that is not given is fixed for modules of ours and for tasks, and else the next free one in the file's order: the
same file gives the same ids.
Rule 3: modules of ours come first, loggers before all, as far as nobody's needs say otherwise.
"""

import difflib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

import msgspec

from bridge.core.arguments import ZERO_GUID
from bridge.core.filters.text import FilterSyntaxError, parse
from bridge.core.hresult import AdsError
from bridge.core.module_instances import Instance, Key, Plant, PlantError, Reference
from bridge.core.tmc import Problem
from bridge.host.system import KINDS, SystemModule
from bridge.tccom.declarations import UNSET, InterfacePointer, Parameter
from bridge.tccom.factories import Factories
from bridge.tccom.general import ParameterKey
from bridge.tccom.identity import (
    FIRST_FREE_ID,
    FIRST_TASK_ID,
    NO_OBJECT,
    OBJECT_SERVER_ID,
    PID_CYCLIC_CALLER,
    TASK_ID_STEP,
    ObjectId,
    id_text,
)
from bridge.tccom.module import Module
from bridge.tccom.states import State
from bridge.tccom.tasks import Task

_SYSTEM: Final = {kind.module_class.__name__: kind.module_class for kind in KINDS}
_RANK: Final[dict[type[Module], int]] = {kind.module_class: rank for rank, kind in enumerate(KINDS)}
_FILTERS: Final = frozenset({"filter", "trigger"})
"""Parameters of modules of ours that are filters. Which event classes there are is known when they start."""
USER_RANK: Final = len(KINDS)


class Planned(NamedTuple):
    """One module to start. needs: the ids of those that must be up before, parent, task and required pointers among them."""

    name: str
    module_class: type[Module]
    object_id: ObjectId
    parent_id: ObjectId
    state: State
    parameters: Mapping[ParameterKey, object]
    needs: tuple[ObjectId, ...]

    @property
    def rank(self) -> int:
        """Its place in KINDS; modules of others are behind."""
        return _RANK.get(self.module_class, USER_RANK)


class Plan(NamedTuple):
    """The modules in the order in which they are started."""

    modules: tuple[Planned, ...]


def make_plan(plant: Plant, factories: Factories) -> Plan:
    """Check a plant against the classes there are; PlantError with all that is wrong."""
    factories.register(Task)
    faults: list[Problem] = []
    classes: dict[str, type[Module]] = {}
    for instance in plant.instances:
        try:
            classes[instance.name] = _class(instance.module_class, factories)
        except AdsError as error:
            names = [*_SYSTEM, *(one.__name__ for one in factories.classes())]
            near = difflib.get_close_matches(instance.module_class, names, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"expected one of {', '.join(names)}, or a class id"
            told = [f"; {point}: {why}" for point, why in factories.faults.items()]
            faults.append(plant.problem(instance, f"class: {error.detail}; {hint}{''.join(told)}", "class"))
    ids = _ids(plant, classes)

    def id_of(reference: Reference) -> ObjectId | str:
        found = plant.instance(reference)
        return reference if found is None else ids[found.name]

    planned: dict[str, Planned] = {}
    for instance in plant.instances:
        if (kind := classes.get(instance.name)) is not None:
            faults += _faults(plant, instance, kind, classes)
            planned[instance.name] = _planned(instance, kind, id_of, ids[instance.name])
    if faults:
        raise PlantError(sorted(faults, key=lambda each: each.line))
    ranked = sorted(plant.instances, key=lambda each: planned[each.name].rank)
    order = msgspec.structs.replace(plant, instances=tuple(ranked)).start_order()
    return Plan(tuple(planned[each.name] for each in order))


def _class(name: str, factories: Factories) -> type[Module]:
    ours = _SYSTEM.get(name)
    return factories.find(name) if ours is None else ours


def _ids(plant: Plant, classes: Mapping[str, type[Module]]) -> dict[str, ObjectId]:
    taken = {OBJECT_SERVER_ID} | {each.object_id for each in plant.instances if each.object_id is not None}
    rows: dict[type[Module], Iterator[ObjectId]] = {kind.module_class: itertools.count(kind.first_id) for kind in KINDS}
    rows[Task] = itertools.count(FIRST_TASK_ID, TASK_ID_STEP)
    free = itertools.count(FIRST_FREE_ID)
    ids: dict[str, ObjectId] = {}
    for each in plant.instances:
        row = rows.get(classes.get(each.name, Module), free)
        ids[each.name] = each.object_id or next(number for number in row if number not in taken)
        taken.add(ids[each.name])
    return ids


def _planned(
    instance: Instance, kind: type[Module], id_of: Callable[[Reference], ObjectId | str], object_id: ObjectId
) -> Planned:
    pointers: dict[ParameterKey, object] = {key: id_of(reference) for key, reference in instance.pointers.items()}
    if instance.task is not None:
        pointers[PID_CYCLIC_CALLER] = id_of(instance.task)
    needs = [each for each in (instance.parent, instance.task, *instance.needs) if each is not None]
    needs += [
        reference
        for key, reference in instance.pointers.items()
        if (one := _declared(kind, key)) is not None and isinstance(one, InterfacePointer) and one.required
    ]
    parent = NO_OBJECT if instance.parent is None else id_of(instance.parent)
    return Planned(
        name=instance.name,
        module_class=kind,
        object_id=object_id,
        parent_id=parent if isinstance(parent, int) else NO_OBJECT,
        state=State[instance.state.upper()],
        parameters={**instance.parameters, **pointers},
        needs=tuple(number for number in map(id_of, needs) if isinstance(number, int)),
    )


def _declared(kind: type[Module], key: ParameterKey) -> Parameter[object] | InterfacePointer[object] | None:
    try:
        return kind.declared.value(key)
    except AdsError:
        return None


def _faults(plant: Plant, instance: Instance, kind: type[Module], classes: Mapping[str, type[Module]]) -> Iterator[Problem]:
    """What the class says against an instance."""
    declared = kind.declared
    given = set()
    if instance.object_id == OBJECT_SERVER_ID:
        yield plant.problem(instance, f"object_id {id_text(OBJECT_SERVER_ID)} is that of the object server", "object_id")
    for key, value in instance.parameters.items():
        one = _declared(kind, key)
        if not isinstance(one, Parameter):
            yield plant.problem(instance, _unknown("parameter", key, declared.parameters, kind), "parameters", key)
            continue
        if one.name in given:
            yield plant.problem(instance, f"parameter {one.name!r} is given twice: by name and by id", "parameters", key)
        given.add(one.name)
        try:
            checked = one.checked(value)
            if isinstance(checked, str) and one.name in _FILTERS and issubclass(kind, SystemModule):
                parse(checked, resolve_class=lambda name: (ZERO_GUID,))
        except AdsError as error:
            yield plant.problem(instance, error.detail, "parameters", key)
        except FilterSyntaxError as error:
            yield plant.problem(instance, f"{one.name}: {error}", "parameters", key)
        if not one.settable:
            yield plant.problem(instance, f"parameter {one.name!r} is not set from outside", "parameters", key)
    for key, reference in instance.pointers.items():
        one = _declared(kind, key)
        if not isinstance(one, InterfacePointer):
            yield plant.problem(instance, _unknown("pointer", key, declared.pointers, kind), "pointers", key)
            continue
        if one.name in given:
            yield plant.problem(instance, f"pointer {one.name!r} is given twice: by name and by id", "pointers", key)
        given.add(one.name)
        yield from _offers(plant, instance, reference, one, classes, ("pointers", key))
    if instance.task is not None:
        caller = _declared(kind, PID_CYCLIC_CALLER)
        if not isinstance(caller, InterfacePointer):
            yield plant.problem(instance, f"task: {kind.__name__} is not called cyclically", "task")
        elif caller.name in given:
            yield plant.problem(instance, f"the task is given twice, as task and as pointer {caller.name!r}", "task")
        else:
            given.add(caller.name)
            yield from _offers(plant, instance, instance.task, caller, classes, ("task",))
    absent = [name for name, one in declared.parameters.items() if one.default is UNSET and name not in given]
    absent += [name for name, one in declared.pointers.items() if one.required and not one.default and name not in given]
    for name in absent:
        what = "parameter" if name in declared.parameters else "task" if name == "cyclic_caller" else "pointer"
        yield plant.problem(instance, f"{instance.name!r} needs {what} {name!r}, which is not given")


def _offers(
    plant: Plant,
    instance: Instance,
    reference: Reference,
    pointer: InterfacePointer[object],
    classes: Mapping[str, type[Module]],
    keys: tuple[Key, ...],
) -> Iterator[Problem]:
    """Whether the one that is pointed to offers the interface."""
    other = plant.instance(reference)
    kind = None if other is None else classes.get(other.name)
    if kind is not None and pointer.info.id not in kind.interfaces:
        yield plant.problem(instance, f"{keys[-1]}: {kind.__name__} {reference!r} does not offer {pointer.info.name}", *keys)


def _unknown(what: str, key: ParameterKey, names: Iterable[str], kind: type[Module]) -> str:
    known = list(names)
    near = difflib.get_close_matches(str(key), known, 1)
    shown = f"0x{key:08X}" if isinstance(key, int) else repr(key)
    hint = f"did you mean {near[0]!r}?" if near else f"expected {' or '.join(known) if known else 'none'}"
    return f"{kind.__name__} has no {what} {shown}; {hint}"
