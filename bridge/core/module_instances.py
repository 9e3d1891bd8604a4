"""Which modules a plant has, and with what: instances in TOML, in the place of TwinCAT's .tmi files.

Rule 1: bytes in, values out. The file is whole or refused: a plant that starts half of what was asked for is no plant. All
        faults (of references MAX_FAULTS) are told at once, each with file, line and what was expected.
Rule 2: what can be said without the classes is said here: keys, types, names, ids, references inside the file. Whether a class
        exists and takes its parameters, the host finds out, and says it with Plant.problem().
Rule 3: a reference is the object id of a module, or its name in this file, or "target/0x71010000" under another target. Ids are
        TOML's integers (0x71010000) or texts as a PLC or a .tmc file writes them (16#71010000, #x71010000).

    [settings]
    target = "plc1"                  # the keys of tcbridge.toml

    [[modules]]
    name = "Calculation"
    class = "FB_Calculation"         # a name, or the GUID of a class
    object_id = 0x71010001           # not given: a new one
    parent = "Line1"
    task = "Fast"                    # the task that calls it
    needs = ["Recorder"]             # must be up before, beyond parent, pointers and task
    state = "op"                     # how far it is started: preop, safeop, op
    parameters = { gain = 2.0 }      # by name, or by id: "0x03002103" = 3
    pointers = { source = "Sensor" }
"""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Annotated, Final, Literal, TypeAlias

import msgspec

from bridge.core import toml_text
from bridge.core.tmc import Problem

StateName: TypeAlias = Literal["preop", "safeop", "op"]
STATES: Final[dict[str, StateName]] = {"preop": "preop", "safeop": "safeop", "op": "op"}
Reference: TypeAlias = int | str
"""An object id, or a name of this file, or "target/0x71010000"."""
Key: TypeAlias = int | str
"""The id or the name of a parameter or pointer."""

MAX_FAULTS: Final = 100
"""So many names, ids and references of one file that cannot be are told; more say nothing new."""
FIRST_OBJECT_ID: Final = 1
LAST_OBJECT_ID: Final = 2**32 - 2
_PLANT_KEYS: Final = ("settings", "modules")
_WHAT: Final = "a TOML file of modules"
_ID: Final = re.compile(r"(?:0x|#x|16#)([0-9a-fA-F]{1,8})")
_REMOTE: Final = re.compile(r"[^/]+/(?:0x|#x|16#)[0-9a-fA-F]{1,8}")


class Instance(msgspec.Struct, frozen=True, kw_only=True):
    """One module of the plant. An object_id of None is a new one; a task or parent of None is none."""

    name: str
    module_class: str
    object_id: int | None = None
    parent: Reference | None = None
    task: Reference | None = None
    needs: tuple[Reference, ...] = ()
    state: StateName = "op"
    parameters: Mapping[Key, object] = {}
    pointers: Mapping[Key, Reference] = {}

    @property
    def references(self) -> tuple[Reference, ...]:
        """Everybody it depends on, each once: parent, task, needs, pointers."""
        every = (self.parent, self.task, *self.needs, *self.pointers.values())
        return tuple(dict.fromkeys(each for each in every if each is not None))


class PlantError(ValueError):
    """A file that is no plant: every fault of it."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


class Plant(msgspec.Struct, frozen=True):
    """The modules in the file's order, the settings as they stand there, and where everything stands."""

    instances: tuple[Instance, ...]
    settings: Mapping[str, object] = {}
    file: str = ""
    lines: toml_text.Lines = toml_text.Lines("")

    def instance(self, reference: Reference) -> Instance | None:
        """The instance of this file that is meant; None for one that is elsewhere."""
        for each in self.instances:
            if reference in (each.name, each.object_id):
                return each
        return None

    def problem(self, instance: Instance | None, message: str, *keys: Key) -> Problem:
        """A fault of an instance, or of the settings when it is None, found later: with file and line, down to a key."""
        path: toml_text.Path = ("settings",) if instance is None else ("modules", self.instances.index(instance))
        for key in keys:
            spelled = (one for one in self.lines.below(path) if key in (one, _number(one)))
            path = (*path, next(spelled, str(key)))
        return Problem(self.file, self.lines.of(path), message)

    def start_order(self) -> tuple[Instance, ...]:
        """Whoever is depended on comes first, else as in the file. Among modules that point at each other, the file's order."""
        needed, firm = self._needed(lambda each: each.references), self._needed(_firm)
        left = {each.name: each for each in self.instances}
        order: list[Instance] = []
        while left:
            ready = next((name for name in left if left.keys().isdisjoint(needed[name])), "")
            order.append(left.pop(ready or next(name for name in left if left.keys().isdisjoint(firm[name]))))
        return tuple(order)

    def _needed(self, references: Callable[[Instance], Iterable[Reference]]) -> dict[str, set[str]]:
        """Name to the names of those of this file that it depends on."""
        by_id: dict[Reference, str] = {each.object_id: each.name for each in self.instances if each.object_id is not None}
        names = by_id | {each.name: each.name for each in self.instances}
        return {each.name: {names[one] for one in references(each) if one in names} for each in self.instances}


def _firm(instance: Instance) -> tuple[Reference, ...]:
    """Those that it cannot be without: unlike pointers, they make no sense in a circle."""
    return tuple(each for each in (instance.parent, instance.task, *instance.needs) if each is not None)


# READING ----------------------------------------------------------------------------------------------------------------------

_Name: TypeAlias = Annotated[str, msgspec.Meta(min_length=1, max_length=255)]


class _Row(msgspec.Struct, forbid_unknown_fields=True, rename={"module_class": "class"}):
    name: _Name
    module_class: _Name
    object_id: int | str | None = None
    parent: Reference | None = None
    task: Reference | None = None
    needs: tuple[Reference, ...] = ()
    state: str = "op"
    parameters: dict[str, object] = {}
    pointers: dict[str, Reference] = {}


_KEYS: Final = tuple(field.encode_name for field in msgspec.structs.fields(_Row))
_Fault: TypeAlias = tuple[toml_text.Path, str]


def read_plant(data: bytes, name: str = "") -> Plant:
    """Read a plant from a TOML file's content; `name` is what problems call the file. PlantError with all that is wrong."""
    try:
        tables, lines = toml_text.read(data, name, _WHAT)
    except toml_text.TomlError as error:
        raise PlantError([Problem(error.file, error.line, error.message)]) from None
    rows: list[tuple[int, _Row]] = []
    faults = list(_outer_faults(tables))
    settings, modules = tables.get("settings", {}), tables.get("modules", [])
    for index, table in enumerate(modules if isinstance(modules, list) else ()):
        path: toml_text.Path = ("modules", index)
        unknown = [key for key in table if key not in _KEYS] if isinstance(table, dict) else []
        faults += [((*path, key), toml_text.unknown_key(key, _KEYS)) for key in unknown]
        try:
            rows.append((index, msgspec.convert({key: table[key] for key in table if key not in unknown}, _Row)))
        except msgspec.ValidationError as error:
            faults.append(toml_text.mistyped(error, path))
    faults += islice(_row_faults(rows), MAX_FAULTS)
    if not faults:
        instances = tuple(_instance(row) for _, row in rows)
        plant = Plant(instances, settings if isinstance(settings, dict) else {}, name, lines)
        faults += _circles(plant)
        if not faults:
            return plant
    raise PlantError(
        Problem(name, lines.of(path), message) for path, message in sorted(faults, key=lambda each: lines.of(each[0]))
    )


def _outer_faults(tables: Mapping[str, object]) -> Iterator[_Fault]:
    for key in tables:
        if key not in _PLANT_KEYS:
            yield (key,), toml_text.unknown_key(key, _PLANT_KEYS)
    modules = tables.get("modules")
    if not isinstance(modules, list) or not modules or not all(isinstance(each, dict) for each in modules):
        yield ("modules",), "no list of modules; expected [[modules]]"
    if not isinstance(tables.get("settings", {}), dict):
        yield ("settings",), "settings is no table; expected [settings]"


def _row_faults(rows: list[tuple[int, _Row]]) -> Iterator[_Fault]:
    """Names, ids and references that cannot be."""
    names: dict[str, int] = {}
    ids: dict[int, str] = {}
    for index, row in rows:
        if row.name in names:
            yield ("modules", index, "name"), f"a second module is called {row.name!r}; expected different names"
        if "/" in row.name or _ID.fullmatch(row.name):
            yield ("modules", index, "name"), f"name {row.name!r}; expected one without '/' that is no id"
        names[row.name] = index
    for index, row in rows:
        path: toml_text.Path = ("modules", index)
        if row.state not in STATES:
            yield (*path, "state"), f"state {row.state!r}; expected one of {', '.join(STATES)}"
        if row.object_id is not None:
            number = _number(row.object_id)
            if number is None or not FIRST_OBJECT_ID <= number <= LAST_OBJECT_ID:
                yield (*path, "object_id"), f"object_id {_shown(row.object_id)}; expected 0x1..0xFFFFFFFE"
            elif number in ids:
                yield (*path, "object_id"), f"object_id {_shown(number)} is that of {ids[number]!r} too; expected different ids"
            else:
                ids[number] = row.name
    for index, row in rows:
        places: list[tuple[toml_text.Path, Reference | None]] = [(("parent",), row.parent), (("task",), row.task)]
        places += [(("needs",), each) for each in row.needs]
        places += [(("pointers", key), each) for key, each in row.pointers.items()]
        for place, reference in places:
            if reference is not None and (message := _unknown(reference, names)):
                yield ("modules", index, *place), f"{place[-1]}: {message}"


def _unknown(reference: Reference, names: Mapping[str, int]) -> str:
    number = _number(reference)
    if number is not None:
        return "" if FIRST_OBJECT_ID <= number <= LAST_OBJECT_ID else f"id {_shown(reference)}; expected 0x1..0xFFFFFFFE"
    if not isinstance(reference, str) or reference in names or _REMOTE.fullmatch(reference):
        return ""
    near = difflib.get_close_matches(reference, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else "expected a name of this file, an id, or target/0x71010000"
    return f"no module is called {reference!r}; {hint}"


def _circles(plant: Plant) -> Iterator[_Fault]:
    """Modules that wait for each other by parent, task or needs."""
    left = plant._needed(_firm)
    waiting: set[str] = set()
    while waiting != left.keys():
        waiting = set(left)
        needed = {name for each in left.values() for name in each}
        left = {name: each for name, each in left.items() if each & left.keys() and name in needed}
    for index, instance in enumerate(plant.instances):
        if instance.name in left:
            others = ", ".join(sorted(left[instance.name] & left.keys()))
            yield ("modules", index), f"{instance.name!r} waits for {others}, and so in a circle; expected an order to start in"


def _instance(row: _Row) -> Instance:
    return Instance(
        name=row.name,
        module_class=row.module_class,
        object_id=None if row.object_id is None else _number(row.object_id),
        parent=_reference(row.parent),
        task=_reference(row.task),
        needs=tuple(_known(each) for each in row.needs),
        state=STATES[row.state],
        parameters={_known(key): value for key, value in row.parameters.items()},
        pointers={_known(key): _known(each) for key, each in row.pointers.items()},
    )


def _number(value: Reference) -> int | None:
    """The id that a number or a text is; None for a text that is a name."""
    if isinstance(value, int):
        return value
    match = _ID.fullmatch(value)
    return None if match is None else int(match[1], 16)


def _known(value: Reference) -> Reference:
    number = _number(value)
    return value if number is None else number


def _reference(value: Reference | None) -> Reference | None:
    return None if value is None else _known(value)


def _shown(value: Reference) -> str:
    return f"0x{value:08X}" if isinstance(value, int) and value >= 0 else repr(value)
