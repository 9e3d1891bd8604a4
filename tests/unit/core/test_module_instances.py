"""A plant in TOML: what is read, in which order it starts, and every fault with its line and what was expected."""

import pytest

from bridge.core.module_instances import Instance, Plant, PlantError, read_plant

PLANT = b"""
[settings]
target = "plc1"

[[modules]]
name = "Calculation"
class = "FB_Calculation"
object_id = 0x71010001
parent = "Line"
task = "#x02010020"
state = "safeop"

[modules.parameters]
gain = 2.5
limits = [1, 2]
0x03002103 = 3

[modules.pointers]
source = "Sensor"
0x00000020 = "16#71010007"
far = "plc2/0x71010003"

[[modules]]
name = "Sensor"
class = "{6B3F0BCD-3F8C-4D0C-9F39-5F8D7B1D0A11}"
needs = ["Recorder"]

[[modules]]
name = "Line"
class = "Line"

[[modules]]
name = "Recorder"
class = "Recorder"
"""


def modules(*tables: str) -> bytes:
    """A plant of these modules, all of one class; the first is A, the next B, and so on. Each begins in a line by itself."""
    rows = (f'[[modules]]\nname = "{name}"\nclass = "C"\n{table}\n' for name, table in zip("ABCDEFGH", tables, strict=False))
    return "".join(rows).encode()


def order(*tables: str) -> str:
    return "".join(each.name for each in read_plant(modules(*tables)).start_order())


def faults(data: bytes) -> list[tuple[int, str]]:
    with pytest.raises(PlantError) as caught:
        read_plant(data, "plant.toml")
    assert str(caught.value) == "\n".join(f"plant.toml:{each.line}: {each.message}" for each in caught.value.problems)
    return [(each.line, each.message) for each in caught.value.problems]


def test_a_plant_is_read_whole() -> None:
    """Ids in every spelling become numbers, names stay names, values are as TOML has them."""
    plant = read_plant(PLANT, "plant.toml")
    assert plant.settings == {"target": "plc1"}
    assert plant.instances[0] == Instance(
        name="Calculation",
        module_class="FB_Calculation",
        object_id=0x71010001,
        parent="Line",
        task=0x02010020,
        state="safeop",
        parameters={"gain": 2.5, "limits": [1, 2], 0x03002103: 3},
        pointers={"source": "Sensor", 0x20: 0x71010007, "far": "plc2/0x71010003"},
    )
    assert plant.instances[1] == Instance(
        name="Sensor", module_class="{6B3F0BCD-3F8C-4D0C-9F39-5F8D7B1D0A11}", needs=("Recorder",)
    )


def test_an_instance_is_found_by_name_or_id() -> None:
    """A reference to somebody elsewhere finds none."""
    plant = read_plant(PLANT)
    assert plant.instance(0x71010001) is plant.instance("Calculation") is plant.instances[0]
    assert plant.instance("plc2/0x71010003") is None
    assert plant.instance(0x71010007) is None
    assert plant.instances[0].references == ("Line", 0x02010020, "Sensor", 0x71010007, "plc2/0x71010003")


def test_a_fault_that_is_found_later_has_its_line() -> None:
    """The host knows more than the file: what it finds is told with the line of the key, or of the nearest table."""
    plant = read_plant(PLANT, "plant.toml")
    first = plant.instances[0]
    assert str(plant.problem(first, "gain: too much", "parameters", "gain")) == "plant.toml:14: gain: too much"
    assert plant.problem(first, "no such class", "class").line == 7
    assert plant.problem(first, "", "parameters", 0x03002103).line == 16
    assert plant.problem(first, "", "pointers", 0x20).line == 20
    assert plant.problem(first, "", "pointers", "missing").line == 18
    assert plant.problem(plant.instances[1], "").line == 23
    assert plant.problem(None, "no such setting", "target").line == 3


def test_who_is_depended_on_starts_first() -> None:
    """Parents, tasks, needs and pointers come first; else the file's order stays."""
    assert [each.name for each in read_plant(PLANT).start_order()] == ["Line", "Recorder", "Sensor", "Calculation"]
    assert order("", "", "") == "ABC"
    assert order('parent = "C"', 'task = "A"', "") == "CAB"
    assert order("pointers = { x = 0x71010001 }", "", "object_id = 0x71010001") == "BCA"


def test_modules_may_point_at_each_other() -> None:
    """Pointers are no reason to refuse a plant; what must be up before still is."""
    assert order('pointers = { x = "B" }', 'pointers = { x = "A" }') == "AB"
    assert order('pointers = { x = "B" }', 'parent = "A"') == "AB"
    assert order('pointers = { x = "B" }', 'parent = "C"\npointers = { x = "A" }', 'pointers = { x = "B" }') == "ACB"


def test_a_thousand_modules_in_a_chain_are_put_in_order() -> None:
    """The worst case: everyone waits for the next one."""
    count = 1000
    instances = [Instance(name=str(n), module_class="C", parent=str(n + 1) if n + 1 < count else None) for n in range(count)]
    assert [each.name for each in Plant(tuple(instances)).start_order()] == [str(n) for n in reversed(range(count))]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", [(1, "no list of modules; expected [[modules]]")]),
        (b"modules = 3\nx = 1", [(1, "no list of modules"), (2, "unknown key 'x'; expected one of settings, modules")]),
        (b"[[module]]\n", [(1, "unknown key 'module', did you mean 'modules'?"), (1, "no list of modules")]),
        (b"settings = 1\n[[modules]]\nname='A'\nclass='C'", [(1, "settings is no table; expected [settings]")]),
        (b"[[modules]\n", [(1, "Expected ']]' at the end of an array declaration in column 10; expected a TOML file")]),
        (b"\xff", [(1, "bytes that are no UTF-8")]),
        (modules("paramters = {}"), [(4, "unknown key 'paramters', did you mean 'parameters'?")]),
        (modules("colour = 1"), [(4, "unknown key 'colour'; expected one of name, class, object_id, parent, task, needs")]),
        (b"[[modules]]\nname = ''\n", [(2, "name: Expected `str` of length >= 1".replace("`", "'"))]),
        (b"[[modules]]\nname = 'A'\n", [(1, "no 'class'")]),
        (modules("state = 'run'"), [(4, "state 'run'; expected one of preop, safeop, op")]),
        (modules("object_id = true"), [(4, "object_id: Expected 'int | str | null', got 'bool'")]),
        (modules("object_id = 'Pump'"), [(4, "object_id 'Pump'; expected 0x1..0xFFFFFFFE")]),
        (modules("object_id = 0xFFFFFFFF"), [(4, "object_id 0xFFFFFFFF; expected 0x1..0xFFFFFFFE")]),
        (modules("object_id = 0"), [(4, "object_id 0x00000000; expected")]),
        (modules("object_id = -5"), [(4, "object_id -5; expected")]),
        (
            modules("object_id = 7", "object_id = '0x7'"),
            [(8, "object_id 0x00000007 is that of 'A' too; expected different ids")],
        ),
        (
            modules("", 'parent = "Z"'),
            [(8, "no module is called 'Z'; expected a name of this file, an id, or target/0x71010000")],
        ),
        (b"[[modules]]\nname='Sensor'\nclass='C'\npointers.x = 'Sensro'", [(4, "'Sensro'; did you mean 'Sensor'?")]),
        (modules("[modules.pointers]\na = 'A'\nb = 'plc2/B'"), [(6, "b: no module is called 'plc2/B'")]),
        (modules("task = 0"), [(4, "task: id 0x00000000; expected 0x1..0xFFFFFFFE")]),
        (b"[[modules]]\nname='A/B'\nclass='C'", [(2, "name 'A/B'; expected one without '/' that is no id")]),
        (b"[[modules]]\nname='0x12'\nclass='C'", [(2, "name '0x12'; expected one without '/' that is no id")]),
        (b"[[modules]]\nname='A'\nclass='C'\n" * 2, [(5, "a second module is called 'A'; expected different names")]),
    ],
)
def test_what_is_wrong_is_told_with_line_and_expectation(data: bytes, expected: list[tuple[int, str]]) -> None:
    """Unknown keys with the nearest name, wrong types, impossible ids, references to nobody."""
    found = faults(data)
    assert [line for line, _ in found] == [line for line, _ in expected]
    for (_, message), (_, part) in zip(found, expected, strict=True):
        assert part in message


def test_a_file_has_a_size() -> None:
    """Python's TOML reader is slow: what is no plant by its size is not read."""
    assert faults(b"#" * 1_000_001) == [(1, "1000001 bytes; expected at most 1000000 for a TOML file of modules")]


def test_all_faults_are_told_at_once() -> None:
    """In the file's order, and a plant with one fault is no plant."""
    assert [line for line, _ in faults(modules("state = 1", 'parent = "Z"', "", "colour = 1\nobject_id = 0"))] == [4, 8, 16, 17]


def test_what_is_wrong_everywhere_is_not_told_for_ever() -> None:
    """A thousand references to nobody: the first hundred are told."""
    rows = "".join(f"[[modules]]\nname = 'Pump{number}'\nclass = 'C'\nparent = 'Pmp{number}'\n" for number in range(1000))
    assert [line for line, _ in faults(rows.encode())] == [4 * number for number in range(1, 101)]


def test_a_circle_is_told_by_its_members() -> None:
    """Who waits for whom; a module that only waits for one of them is no part of it."""
    found = faults(modules('parent = "B"', 'needs = ["C"]', 'task = "A"', 'parent = "A"', ""))
    assert found == [
        (1, "'A' waits for B, and so in a circle; expected an order to start in"),
        (5, "'B' waits for C, and so in a circle; expected an order to start in"),
        (9, "'C' waits for A, and so in a circle; expected an order to start in"),
    ]
    assert [line for line, _ in faults(modules('parent = "A"'))] == [1]
