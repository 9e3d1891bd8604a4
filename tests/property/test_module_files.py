"""Laws of module descriptions: whatever is described reads back equal, and no file makes the reader fail in another way."""

import json
import string

from hypothesis import given
from hypothesis import strategies as st

from bridge.core.module_classes import (
    Context,
    DataArea,
    InterfaceType,
    Library,
    Member,
    Method,
    MethodParameter,
    ModuleClass,
    Parameter,
    Pointer,
    Symbol,
    TypeName,
    Value,
)
from bridge.core.module_instances import PlantError, read_plant
from bridge.core.module_tmc import read_modules
from bridge.core.module_tmc_writer import write_modules
from bridge.core.tmc import TmcError

ANY = st.text(
    st.characters(exclude_categories=("Cs", "Cc"), include_characters="\t\n\r", exclude_characters="\ufffe\uffff"), max_size=8
)
WORD = st.text(string.ascii_letters + string.digits + "_.[]()<>&äß", min_size=1, max_size=6)
GUID = st.uuids().map(str)
ID = st.integers(0, 2**32 - 1)
TYPE = st.builds(TypeName, WORD, st.just("") | GUID, st.just("") | WORD, st.integers(0, 3), st.booleans())
VALUES = st.lists(
    st.builds(Value, ANY, st.sampled_from(["Value", "String", "EnumText", "Bool"]), st.just("") | WORD), max_size=3, unique=True
).map(lambda values: tuple(sorted(values, key=lambda value: value.name)))
PROPERTIES = st.dictionaries(WORD, ANY, max_size=2)


def rows(strategy: st.SearchStrategy[object]) -> st.SearchStrategy[tuple[object, ...]]:
    return st.lists(strategy, max_size=2).map(tuple)


MODULES = st.builds(
    ModuleClass,
    guid=GUID,
    name=WORD,
    class_id=GUID,
    class_factory=WORD,
    group=st.just("") | WORD,
    init_sequence=st.sampled_from(["", "PS", "SO"]),
    contexts=rows(st.builds(Context, ID, st.just("") | WORD, st.none() | ID)),
    interfaces=rows(TYPE),
    parameters=rows(
        st.builds(
            Parameter,
            id=ID,
            name=WORD,
            type=TYPE,
            members=rows(st.builds(Member, WORD, TYPE, ANY)),
            default=VALUES,
            comment=ANY,
            unit=st.just("") | WORD,
            context_id=st.none() | ID,
            online=st.booleans(),
            read_only=st.booleans(),
            hidden=st.booleans(),
            symbol=st.booleans(),
        )
    ),
    data_areas=rows(
        st.builds(
            DataArea,
            number=ID,
            name=WORD,
            area_type=st.just("") | WORD,
            context_id=st.none() | ID,
            byte_size=st.none() | ID,
            symbols=rows(
                st.builds(
                    Symbol,
                    name=WORD,
                    type=TYPE,
                    array=rows(st.tuples(st.integers(-(2**31), 2**31 - 1), ID)),
                    default=VALUES,
                    comment=ANY,
                    bit_size=st.none() | ID,
                    bit_offset=st.none() | ID,
                    properties=PROPERTIES,
                )
            ),
            symbols_for_ads=st.booleans(),
        )
    ),
    interface_pointers=rows(st.builds(Pointer, ID, WORD, st.none() | TYPE)),
    data_pointers=rows(st.builds(Pointer, ID, WORD, st.none() | TYPE)),
    event_classes=rows(TYPE),
    licenses=st.dictionaries(GUID, ANY, max_size=2),
    properties=PROPERTIES,
    attributes=st.dictionaries(st.sampled_from(["TcSmClass", "TargetPlatform"]), WORD),
)
METHODS = rows(st.builds(Method, WORD, rows(st.builds(MethodParameter, WORD, TYPE, ANY)), st.none() | TYPE, ANY))
INTERFACES = st.builds(
    InterfaceType, guid=GUID, name=WORD, base=TYPE, methods=METHODS, hides=rows(GUID), comment=ANY, namespace=st.just("") | WORD
).filter(lambda found: bool(found.methods))
LIBRARIES = st.builds(Library, st.just("") | WORD, st.just("") | WORD, st.just("") | WORD)


@given(st.lists(MODULES, max_size=2), st.lists(INTERFACES, max_size=2), LIBRARIES)
def test_what_is_written_reads_back_equal(
    modules: list[ModuleClass], interfaces: list[InterfaceType], library: Library
) -> None:
    """Every field of every row, with texts that are XML themselves."""
    found = read_modules(write_modules(modules, interfaces, library))
    assert found.problems == ()
    assert found.modules == tuple(modules)
    assert found.interfaces == tuple(interfaces)
    assert found.library == library


@given(MODULES, st.data())
def test_a_damaged_file_is_an_error_or_a_file(module: ModuleClass, data: st.DataObject) -> None:
    """Bytes cut out or put in: TmcError, or classes and problems with lines of the file."""
    whole = write_modules([module])
    start = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(start, min(len(whole), start + 20)))
    damaged = whole[:start] + data.draw(st.binary(max_size=4)) + whole[end:]
    try:
        found = read_modules(damaged)
    except TmcError:
        return
    assert all(1 <= problem.line <= damaged.count(b"\n") + 1 for problem in found.problems)


NAMED = st.sampled_from(["A", "B", "C", "D", 1, "0x2", "plc2/0x3"])
PLANTS = st.lists(
    st.fixed_dictionaries(
        {"name": st.sampled_from("ABCD"), "class": st.just("K")},
        optional={
            "object_id": st.integers(1, 3),
            "parent": NAMED,
            "task": NAMED,
            "needs": st.lists(NAMED, max_size=2),
            "pointers.x": NAMED,
            "pointers.y": NAMED,
        },
    ),
    min_size=1,
    max_size=4,
    unique_by=lambda row: str(row["name"]),
)


@given(PLANTS)
def test_whoever_is_needed_starts_first(rows: list[dict[str, object]]) -> None:
    """A plant starts each of its modules once, after parent, task and needs of this file; else its faults have lines."""
    lines = [line for row in rows for line in ("[[modules]]", *(f"{key} = {json.dumps(value)}" for key, value in row.items()))]
    try:
        plant = read_plant("\n".join(lines).encode(), "plant.toml")
    except PlantError as error:
        told = error.problems
    else:
        order = plant.start_order()
        assert sorted(each.name for each in order) == sorted(each.name for each in plant.instances)
        for place, each in enumerate(order):
            firm = [one for one in (each.parent, each.task, *each.needs) if one is not None]
            needed = [found for found in map(plant.instance, firm) if found is not None]
            assert all(one in order[:place] for one in needed)
        return
    assert told
    assert all(1 <= problem.line <= len(lines) for problem in told)
