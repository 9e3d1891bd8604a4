"""Stories of a plant file that meets the classes there are: every fault before the start, ids, order."""

from pathlib import Path
from typing import Protocol

import pytest

from bridge.core.module_instances import PlantError, read_plant
from bridge.host import Plan, make_plan
from bridge.tccom import DONE, Answer, CyclicModule, InterfacePointer, Module, Parameter, Settable, interface
from bridge.tccom.factories import Factories


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0011")
class ISource(Protocol):
    """A value."""

    def value(self) -> Answer[float]: ...


class Sensor(Module, ISource):
    """Has one."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1011"
    scale = Parameter(0x1, float, default=1.0)
    count = Parameter(0x2, int, default=0, settable=Settable.NEVER)

    def value(self) -> Answer[float]:
        return Answer(self.scale)


class Mixer(CyclicModule):
    """Needs one."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1012"
    recipe = Parameter(0x1, str)
    source = InterfacePointer(0x2, ISource)
    spare = InterfacePointer(0x3, ISource, required=False)

    def cycle_update(self, context_id: int, cycle_ns: int) -> Answer[None]:
        return DONE


def plan(text: str) -> Plan:
    """What becomes of a file."""
    factories = Factories(installed=False)
    factories.register(Sensor, Mixer)
    return make_plan(read_plant(text.encode(), "plant.toml"), factories)


GOOD = """
[[modules]]
name = "Mix"
class = "Mixer"
task = "Fast"
parameters = { recipe = "a" }
pointers = { source = "Level", spare = "plc2/0x71010000" }

[[modules]]
name = "Level"
class = "Sensor"
parent = "Mix2"

[[modules]]
name = "Fast"
class = "Task"

[[modules]]
name = "Night"
class = "Recorder"
parameters = { path = "night" }

[[modules]]
name = "Log"
class = "Logger"

[[modules]]
name = "Log2"
class = "Logger"
needs = ["Mix2"]

[[modules]]
name = "Mix2"
class = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1011"
object_id = 0x71010000
state = "safeop"
"""


def test_modules_of_ours_come_first_and_needs_before_all() -> None:
    """Loggers, recorders, the rest in the file's order; whoever is needed comes before whoever needs."""
    modules = plan(GOOD).modules
    assert [each.name for each in modules] == ["Log", "Night", "Fast", "Mix2", "Log2", "Level", "Mix"]


def test_ids_are_the_same_each_time() -> None:
    """Those of ours and of tasks are fixed, the others are the next free ones; one that is given is nobody else's."""
    ids = {each.name: each.object_id for each in plan(GOOD).modules}
    assert ids == {
        "Log": 0x71000100,
        "Log2": 0x71000101,
        "Night": 0x71000200,
        "Fast": 0x02010010,
        "Mix": 0x71010001,
        "Level": 0x71010002,
        "Mix2": 0x71010000,
    }


def test_references_become_ids() -> None:
    """Names of the file in pointers, task, parent and needs; one of another target stays as it is."""
    found = {each.name: each for each in plan(GOOD).modules}
    assert found["Mix"].parameters == {
        "recipe": "a",
        "source": 0x71010002,
        "spare": "plc2/0x71010000",
        0x0300_2060: 0x02010010,
    }
    assert found["Mix"].needs == (0x02010010, 0x71010002)
    assert (found["Level"].parent_id, found["Level"].needs) == (0x71010000, (0x71010000,))


def test_the_plant_in_the_documentation_is_one() -> None:
    """That of `tcbridge run`."""
    page = (Path(__file__).parents[3] / "docs" / "commands.md").read_text(encoding="utf-8")
    block = page.partition("## run\n")[2].partition("```toml\n")[2].partition("```")[0]
    assert [each.name for each in plan(block).modules] == ["Log", "Night", "Errors"]


FAULTS = [
    ('class = "Senser"', "plant.toml:4: class: no module class 'Senser'; did you mean 'Sensor'?"),
    ('class = "Sensor"\nparameters = { scal = 1 }', "plant.toml:5: Sensor has no parameter 'scal'; did you mean 'scale'?"),
    ('class = "Sensor"\nparameters = { "0x9" = 1 }', "Sensor has no parameter 0x00000009; expected scale or count"),
    ('class = "Sensor"\nparameters = { scale = "big" }', "plant.toml:5: scale: Expected `float`, got `str`"),
    ('class = "Sensor"\nparameters = { count = 1 }', "parameter 'count' is not set from outside"),
    ('class = "Sensor"\ntask = "Fast"', "plant.toml:5: task: Sensor is not called cyclically"),
    ('class = "Sensor"\npointers = { source = "Fast" }', "Sensor has no pointer 'source'; expected none"),
    ('class = "Mixer"', "'A' needs parameter 'recipe', which is not given"),
    ('class = "Mixer"', "'A' needs task 'cyclic_caller', which is not given"),
    ('class = "Mixer"', "'A' needs pointer 'source', which is not given"),
    ('class = "Mixer"\npointers = { source = "Fast" }', "plant.toml:5: source: Task 'Fast' does not offer ISource"),
    ('class = "Mixer"\ntask = "A"', "A' waits for A"),
    ('class = "Logger"\nparameters = { max_events = "many" }', "plant.toml:5: max_events: Expected `int`, got `str`"),
    ('class = "Listener"\nparameters = { filter = "severty = 1" }', "plant.toml:5: filter: unknown field 'severty'"),
    ('class = "Sensor"\nobject_id = 0x71000001', "plant.toml:5: object_id 0x71000001 is that of the object server"),
    ('class = "Sensor"\nparameters = { scale = 1, "0x1" = 2 }', "plant.toml:5: parameter 'scale' is given twice"),
    ('class = "Mixer"\npointers = { source = "A", "0x2" = "A" }', "plant.toml:5: pointer 'source' is given twice"),
    ('class = "Mixer"\ntask = "Fast"\npointers = { cyclic_caller = "Fast" }', "the task is given twice"),
    ('class = "Sink"\nparameters = { severity = "warn" }', "plant.toml:5: severity: Invalid enum value 'warn'"),
    ('class = "Recorder"\nparameters = { path = "x", trigger = "severity >>= 1" }', "plant.toml:5: trigger: unexpected '>='"),
]


@pytest.mark.parametrize(("lines", "message"), FAULTS)
def test_a_fault_is_told_with_its_line_and_what_was_expected(lines: str, message: str) -> None:
    """Before anything is started."""
    text = f'\n[[modules]]\nname = "A"\n{lines}\n\n[[modules]]\nname = "Fast"\nclass = "Task"\n'
    with pytest.raises(PlantError) as raised:
        plan(text)
    assert message in str(raised.value)


def test_a_class_in_a_filter_is_looked_up_when_the_plant_runs() -> None:
    """A plan is made without event classes, so a name of one is no fault of its file."""
    lines = 'class = "Listener"\nparameters = { filter = "event_class = Faults" }'
    assert len(plan(f'[[modules]]\nname = "A"\n{lines}\n').modules) == 1


def test_all_faults_are_told_at_once() -> None:
    """In the order of the file."""
    with pytest.raises(PlantError) as raised:
        plan('[[modules]]\nname = "A"\nclass = "Nix"\n[[modules]]\nname = "B"\nclass = "Sensor"\nparameters = { x = 1 }\n')
    assert [problem.line for problem in raised.value.problems] == [3, 7]
