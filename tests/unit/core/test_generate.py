"""Event classes as constants: the module as a program imports it and as a type checker reads it, and the JSON."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec
import pytest

from bridge.core.builtin import BUILTIN
from bridge.core.catalog import EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.generate import JsonModule, identifier, json_text, python_module
from bridge.edges.class_files import load_catalog

ROOT = Path(__file__).parents[3]
TYPING = ROOT / "tests" / "typing"
GUID = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "695e2e22-3f74-4ec5-a795-e51962a66fcb"
NASTY = (
    "",
    "1st",
    "class",
    "None",
    "a b",
    "a-b",
    "a.b",
    "__init__",
    "__x",
    "____",
    "mro",
    "_Definition",
    "_Final",
    "_Severity",
    "EventDefinition",
    "Final",
    "str",
    "self",
    'quote"quote',
    "back\\slash",
    "new\nline",
    "nul\0nul",
    "größe",
    "\ufb01ne",
    "fine",
    "²",
    "日本",
    "\u2028",
    "x" * 300,
)


def made(name: str, names: Mapping[int, str], guid: str = GUID, **more: object) -> EventClass:
    """A class of errors whose texts are their names."""
    events = {number: EventEntry(number, each, Severity.ERROR, each) for number, each in names.items()}
    return msgspec.structs.replace(EventClass(guid, name, name, events), **more)


def loaded(source: str) -> dict[str, dict[str, object]]:
    """The constants of a module, class by class, as a program that imports it sees them."""
    space: dict[str, type] = {}
    exec(compile(source, "tc_events.py", "exec", dont_inherit=True), space)
    return {
        name: {each: value for each, value in vars(found).items() if not each.startswith("__")}
        for name, found in vars(space["TC_EVENTS"]).items()
        if isinstance(found, type)
    }


def test_a_constant_is_class_id_and_severity() -> None:
    """TC_EVENTS.Line.Homed unpacks to the first three arguments of a send; TC_EVENT_CLASSES has the GUIDs."""
    source = python_module([made("Line", {5: "Homed"})])
    assert loaded(source) == {"Line": {"Homed": (GUID, 5, Severity.ERROR)}}
    assert f'class TC_EVENT_CLASSES:\n    "The GUID of each event class."\n\n    Line: _Final = "{GUID}"\n' in source


def test_the_header_says_what_made_it_from_what() -> None:
    """The first line names program and files; there is no date in it, so that nothing changes when nothing changed."""
    first = python_module([], made_by="tcbridge 1.2", sources=["b.tmc", 'a".tmc']).splitlines()[0]
    assert first == '"Event classes as constants. Made by tcbridge 1.2 from a\\".tmc, b.tmc: do not edit, make it again."'


def test_the_order_of_the_classes_does_not_matter() -> None:
    """The same classes in any order, and events in any order, give the same text."""
    first = made("B", {1: "One", 2: "Two"})
    second = made("A", {1: "One"}, OTHER)
    for write in (python_module, json_text):
        turned = msgspec.structs.replace(first, events=dict(sorted(first.events.items(), reverse=True)))
        assert write([first, second]) == write([second, turned])
    assert list(loaded(python_module([first, second]))) == ["A", "B"]


def test_no_class_makes_an_empty_module() -> None:
    """Which can be imported."""
    assert loaded(python_module([])) == {}
    assert json.loads(json_text([]))["classes"] == []


def test_a_hidden_version_is_left_out() -> None:
    """What the newest hides is no constant, neither in Python nor in JSON."""
    old = made("Pump", {1: "Old"}, OTHER)
    new = made("Pump", {1: "New"}, hides=(OTHER,))
    assert loaded(python_module([old, new])) == {"Pump": {"New": (GUID, 1, Severity.ERROR)}}
    assert [each["guid"] for each in json.loads(json_text([old, new]))["classes"]] == [GUID]


def test_versions_that_do_not_hide_each_other_get_their_guids() -> None:
    """So do two that hide each other, which no real file has: nothing is lost, and no name is a guess."""
    one, two = made("Pump", {1: "A"}), made("Pump", {1: "B"}, OTHER)
    assert set(loaded(python_module([one, two]))) == {"Pump_54cc5482", "Pump_695e2e22"}
    one, two = made("Pump", {1: "A"}, hides=(OTHER,)), made("Pump", {1: "B"}, OTHER, hides=(GUID,))
    assert set(loaded(python_module([one, two]))) == {"Pump_54cc5482", "Pump_695e2e22"}


def test_a_class_of_another_name_hides_nothing() -> None:
    """Real files hide versions from before a class was copied."""
    copy = made("Copy", {1: "A"}, hides=(OTHER,))
    assert set(loaded(python_module([copy, made("Pump", {1: "B"}, OTHER)]))) == {"Copy", "Pump"}


def test_names_that_become_the_same_get_a_suffix_each() -> None:
    """Classes their GUID's first eight digits, or all of it; events their id. Who is alone keeps the plain name."""
    near = "54cc5482-0000-0000-0000-000000000000"
    found = loaded(python_module([made("a.b", {1: "x y", 2: "x-y", 3: "x_y_1", 4: "z"}), made("a_b", {1: "x"}, near)]))
    assert set(found) == {"a_b_54cc5482_ad79_4cdc_8c3e_b3983b36ed66", "a_b_54cc5482_0000_0000_0000_000000000000"}
    events = found["a_b_54cc5482_ad79_4cdc_8c3e_b3983b36ed66"]
    assert {name: value[1] for name, value in events.items() if isinstance(value, tuple)} == {
        "x_y_1": 1,
        "x_y_2": 2,
        "x_y_1_3": 3,
        "z": 4,
    }


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("TutorialEvent", "TutorialEvent"),
        ("opt.Pump", "opt_Pump"),
        ("1st", "_1st"),
        ("class", "class_"),
        ("__init__", "_init__"),
        ("a b", "a_b"),
        ("größe", "größe"),
        ("\ufb01ne", "fine"),
        ("", "_"),
    ],
)
def test_a_name_becomes_an_identifier(name: str, expected: str) -> None:
    """By the rules of the page."""
    assert identifier(name) == expected


def test_nasty_names_and_texts_stay_data() -> None:
    """Each name gets an identifier of its own; nothing in a name or a text leaves its string."""
    found = loaded(python_module([made(name, dict(enumerate(NASTY)), f"{i:08}-{GUID[9:]}") for i, name in enumerate(NASTY)]))
    assert len(found) == len(NASTY)
    for events in found.values():
        assert sorted(value[1] for value in events.values() if isinstance(value, tuple)) == list(range(len(NASTY)))


def test_a_long_text_is_cut_in_a_comment_only() -> None:
    """The docstring of a constant is one short line; the JSON has the whole text."""
    text = "long \n" * 100
    found = msgspec.structs.replace(made("A", {}), events={1: EventEntry(1, "E", Severity.INFO, text)})
    assert max(len(line) for line in python_module([found]).splitlines()) < 120
    assert json.loads(json_text([found]))["classes"][0]["events"][0]["texts"]["0"] == text


def test_json_has_every_language() -> None:
    """The fields of JsonModule, with class name, GUID, severity as number and word, and texts by LCID."""
    found = msgspec.structs.replace(
        made("Line", {5: "Homed"}, hides=(OTHER,)), namespace="opt", translations={"Homed": {1031: "Referenziert"}, "Line": {}}
    )
    text = json_text([found], made_by="tcbridge 1.2", sources=["line.tmc"])
    assert json.loads(text) == {
        "made_by": "tcbridge 1.2",
        "sources": ["line.tmc"],
        "format": 1,
        "classes": [
            {
                "identifier": "opt_Line",
                "name": "opt.Line",
                "guid": GUID,
                "hides": [OTHER],
                "texts": {"0": "Line"},
                "events": [
                    {
                        "identifier": "Homed",
                        "name": "Homed",
                        "id": 5,
                        "severity": 3,
                        "severity_name": "error",
                        "texts": {"0": "Homed", "1031": "Referenziert"},
                    }
                ],
            }
        ],
    }
    assert msgspec.json.decode(text, type=JsonModule).classes[0].events[0].texts["1031"] == "Referenziert"


def test_the_built_in_classes_as_constants() -> None:
    """Five classes: the older versions are hidden."""
    found = loaded(python_module(BUILTIN))
    assert {name: len(events) for name, events in found.items()} == {
        "TcGeneralAdsEventClass": 73,
        "TcRTimeEventClass": 16,
        "TcRouterEventClass": 14,
        "TcSystemEventClass": 30,
        "Win32EventClass": 99,
    }


def test_the_checked_in_example_is_what_is_made_now() -> None:
    """tests/typing/plant_events.py, which the user code there imports, is the module of examples/plant.tmc."""
    catalog, problems = load_catalog([ROOT / "examples" / "plant.tmc"])
    assert problems == []
    assert python_module(catalog, sources=["plant.tmc"]) == (TYPING / "plant_events.py").read_text(encoding="utf-8")


def test_a_program_imports_it(tmp_path: Path) -> None:
    """In a process of its own, under strict warnings: the constants are there, a misspelt one is an AttributeError."""
    (tmp_path / "tc_events.py").write_text(python_module([made("Line", {5: "Homed", 6: "class"})]), encoding="utf-8")
    code = """
from tc_events import TC_EVENTS, TC_EVENT_CLASSES
event_class, event_id, severity = TC_EVENTS.Line.Homed
print(event_class == TC_EVENT_CLASSES.Line, event_id, severity.name, TC_EVENTS.Line.class_.event_id)
try:
    TC_EVENTS.Line.Homedd
except AttributeError as error:
    print(error)
"""
    command = [sys.executable, "-W", "error", "-c", code]
    result = subprocess.run(
        command, cwd=ROOT, env={"PYTHONPATH": f"{tmp_path}:{ROOT}"}, capture_output=True, text=True, timeout=60, check=True
    )
    assert result.stdout.splitlines() == ["True 5 ERROR 6", "type object 'Line' has no attribute 'Homedd'"]


def test_the_type_checker_refuses_a_misspelt_event(tmp_path: Path) -> None:
    """Strict mypy takes user code of a module made just now, nasty names and all, and names the one event that is misspelt.

    The user code in tests/typing needs each of its ignores, and no others.
    """
    source = python_module([made("Nasty", dict(enumerate(NASTY))), made("Line", {5: "Homed"}, OTHER)])
    (tmp_path / "tc_events.py").write_text(source, encoding="utf-8")
    right = "from tc_events import TC_EVENTS\nnumber: int = TC_EVENTS.Line.Homed.event_id\n"
    (tmp_path / "right.py").write_text(right)
    (tmp_path / "wrong.py").write_text(right.replace("Homed", "Homedd"))
    example = TYPING / "generated_constants.py"
    paths = [str(each) for each in (example, *sorted(tmp_path.glob("*.py")))]
    result = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", *paths],
        cwd=ROOT,
        env={"MYPYPATH": f"{tmp_path}:{ROOT}"},
        capture_output=True,
        text=True,
        timeout=110,
    )
    errors = [line for line in result.stdout.splitlines() if ": error: " in line]
    assert len(errors) == 1, result.stdout + result.stderr
    assert "wrong.py:2: error: " in errors[0]
    assert '"type[Line]" has no attribute "Homedd"' in errors[0]
    assert example.read_text(encoding="utf-8").count("# type: ignore") == 7
