"""Every real class file of the shared data as module classes: class ids, interfaces, parameters and counts.

The counts were taken from the files with a regular expression over their text.
"""

import os
from pathlib import Path

import pytest

from bridge.core.module_classes import Context, Library, ModuleClass, Pointer, TypeName
from bridge.core.module_tmc import ModuleFile, read_modules
from bridge.core.module_tmc_writer import write_modules

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
FOLDER = SHARED / "data" / "tmc"
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(),
    reason=f"the real class files are not in {FOLDER}; TCBRIDGE_SHARED names the folder that holds data/tmc",
)

COUNTS = {
    "aag-test-bench.tsproj": ([], 0, 0),
    "beckhoff-filter-sample.tmc": ([], 0, 0),
    "beckhoff-publisher.tmc": (["Publisher"], 13, 65),
    "beckhoff-resource-import.tmc": ([], 0, 0),
    "beckhoff-start-stop.tmc": (["StartStopMsgsModule"], 0, 0),
    "packml-vffs-demo.tmc": ([], 0, 0),
}
"""File to its module classes, its number of interfaces and of their methods."""
UDINT = TypeName("UDINT", "18071995-0000-0000-0000-000000000008")
LREAL = TypeName("LREAL", "18071995-0000-0000-0000-00000000000e")


def load(name: str) -> ModuleFile:
    return read_modules((FOLDER / name).read_bytes(), name)


def start_stop() -> ModuleClass:
    return load("beckhoff-start-stop.tmc").module("StartStopMsgsModule")


def publisher() -> ModuleClass:
    return load("beckhoff-publisher.tmc").module("Publisher")


def test_no_file_is_forgotten() -> None:
    """Every file of the folder has its counts here."""
    assert {path.name for path in FOLDER.iterdir()} == set(COUNTS)


@pytest.mark.parametrize("name", COUNTS)
def test_a_file_has_its_modules_and_interfaces(name: str) -> None:
    """Modules, interfaces and methods as counted in the file; nothing is a problem."""
    found = load(name)
    methods = sum(len(interface.methods) for interface in found.interfaces)
    assert ([module.name for module in found.modules], len(found.interfaces), methods) == COUNTS[name]
    assert found.problems == ()


@pytest.mark.parametrize("name", COUNTS)
def test_each_file_is_equal_after_a_round_trip(name: str) -> None:
    """Written and read again, with every symbol, method, default value and property."""
    found = load(name)
    assert read_modules(write_modules(found.modules, found.interfaces, found.library)) == found


def test_who_start_stop_is() -> None:
    """Class id, class factory, licence, library, and how far it is started."""
    found = start_stop()
    assert (found.guid, found.class_id) == ("a06cf2d1-3600-4c82-a881-28b671fe0a69",) * 2
    assert (found.class_factory, found.group, found.init_sequence) == ("StartStopMsgs", "C++", "SO")
    assert found.licenses == {"304d006a-8299-4560-ab79-438534b50288": "TC3 C++"}
    assert load("beckhoff-start-stop.tmc").library == Library("C++ Module Vendor", "StartStopMsgs", "0.0.0.1")
    assert found.contexts == (Context(1),)


def test_what_start_stop_implements() -> None:
    """ITcCyclic, ITcADI and ITcWatchSource besides ITComObject, by name and by id."""
    found = start_stop()
    assert {interface.name: interface.guid for interface in found.interfaces} == {
        "ITComObject": "00000012-0000-0000-e000-000000000064",
        "ITcCyclic": "03000010-0000-0000-e000-000000000064",
        "ITcADI": "03000012-0000-0000-e000-000000000064",
        "ITcWatchSource": "03000018-0000-0000-e000-000000000064",
    }
    assert all(found.implements(name) for name in ("ITcCyclic", "ITcADI", "ITcWatchSource"))
    assert found.implements("{03000018-0000-0000-E000-000000000064}")
    assert not found.implements("ITcTask")


def test_the_parameters_of_start_stop() -> None:
    """Two: one of a system type, hidden and with an id of the system; one whose parts are written out."""
    found = start_stop()
    assert [(each.name, each.id, each.context_id) for each in found.parameters] == [
        ("TraceLevelMax", 0x03002103, 1),
        ("Parameter", 1, 1),
    ]
    level, own = found.parameters
    assert level.type == TypeName("TcTraceLevel", "8007ae3b-86bb-40f2-b385-ef87fcc239a4")
    assert (level.hidden, level.comment) == (True, "Controls the amount of log messages.")
    assert [(part.name, part.type) for part in own.members] == [("data1", UDINT), ("data2", UDINT), ("data3", LREAL)]
    assert own.type is None


def test_what_start_stop_is_wired_with() -> None:
    """Two data areas of three UDINT each, a pointer to the task that calls it, the event class it sends."""
    found = start_stop()
    assert [(area.number, area.name, area.area_type) for area in found.data_areas] == [
        (0, "Inputs", "InputDst"),
        (1, "Outputs", "OutputSrc"),
    ]
    assert [symbol.name for symbol in found.data_area("Outputs").symbols] == ["Value", "Control", "Data"]
    assert {symbol.type for area in found.data_areas for symbol in area.symbols} == {UDINT}
    caller = TypeName("ITcCyclicCaller", "0300001e-0000-0000-e000-000000000064")
    assert found.interface_pointers == (Pointer(0x03002060, "CyclicCaller", caller),)
    assert found.event_classes == (TypeName("TcComMessages", "b01d11fa-e667-4416-9cca-9c2fdcba0d44"),)


def test_a_plc_program_is_a_module() -> None:
    """The publisher: the class id that all PLC programs have, a task bound by hand, one data area of 262 symbols."""
    found = publisher()
    assert (found.guid, found.class_id) == (
        "2501f3a8-723b-4108-82a1-029e28a59a64",
        "08500001-0000-0000-f000-000000000064",
    )
    assert found.class_factory == "TcPlc30"
    assert found.contexts == (Context(0, "PublisherTask", 0x02010020),)
    assert (found.interfaces, found.parameters, found.interface_pointers) == ((), (), ())
    (area,) = found.data_areas
    assert (area.number, area.area_type, area.byte_size, area.symbols_for_ads) == (3, "Internal", 655360, True)
    assert len(area.symbols) == 262
    assert sum(bool(symbol.default) for symbol in area.symbols) == 237
    assert [each.name for each in found.event_classes] == ["Win32EventClass", "AnotherEventClass", "PublisherEventClass"]
    assert found.properties["ApplicationName"] == "Port_851"
    assert found.attributes == {"TcSmClass": "TComPlcObjDef", "TargetPlatform": "TwinCAT RT (x64)"}


def test_symbols_of_a_plc_program() -> None:
    """Arrays with their bounds, structures with a default for each part, comments as they stand."""
    symbols = {symbol.name: symbol for symbol in publisher().data_areas[0].symbols}
    digits = symbols["Global_Variables.FORMAT_HEXASC_CODES"]
    assert digits.array == ((0, 2), (0, 16))
    assert [(value.name, value.text) for value in digits.default[:2]] == [("[0,0]", "48"), ("[0,1]", "49")]
    version = symbols["Global_Version.stLibVersion_Tc2_System"]
    assert [(value.name, value.kind, value.text) for value in version.default[2:]] == [
        (".iBuild", "Value", "26"),
        (".iRevision", "Value", "0"),
        (".nFlags", "Value", "1"),
        (".sVersion", "String", "3.4.26.0"),
    ]
    assert symbols["Global_Variables.AMSPORT_LOGGER"].comment == " Logger "


def test_interfaces_with_their_methods() -> None:
    """An interface of the EventLogger: its base, its methods in order, and which parameters the callee writes."""
    interfaces = {each.name: each for each in load("beckhoff-publisher.tmc").interfaces}
    event = interfaces["ITcEvent"]
    assert event.guid == "4a9cb0e9-8969-4b85-b567-605110511200"
    assert event.base == TypeName("ITcUnknown", "00000001-0000-0000-e000-000000000064")
    assert [method.name for method in event.methods[:4]] == ["GetEventClass", "GetEventId", "GetSeverity", "GetSourceInfo"]
    assert all(method.returns is not None and method.returns.name == "HRESULT" for method in event.methods)
    (source,) = event.methods[3].parameters
    assert (source.name, source.type.name, source.type.pointers) == ("pipSourceInfo", "ITcSourceInfo", 1)
    (event_id,) = event.methods[1].parameters
    assert (event_id.type.name, event_id.type.reference) == ("UDINT", True)
    assert interfaces["ITcAlarm2"].base.guid == interfaces["ITcAlarm"].guid
