"""Module classes as XML: what is read, what is a fault and where, and that what is written reads back equal."""

import pytest

from bridge.core.catalog import EventClass, EventEntry
from bridge.core.events import Severity
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
from bridge.core.module_tmc import ITC_UNKNOWN, read_modules
from bridge.core.module_tmc_writer import write_modules
from bridge.core.tmc import TmcError, read_classes

PUMP = "11111111-2222-3333-4444-555555555555"
DINT = TypeName("DINT", "18071995-0000-0000-0000-000000000009")
UNKNOWN = TypeName("ITcUnknown", ITC_UNKNOWN)
CALCULATION = InterfaceType(
    guid="aaaaaaaa-0000-0000-0000-000000000001",
    name="ICalculation",
    base=UNKNOWN,
    methods=(
        Method(
            "Addition",
            (
                MethodParameter("nIn1", DINT),
                MethodParameter("nRes", TypeName("DINT", DINT.guid, reference=True), "the sum"),
            ),
            TypeName("HRESULT"),
            "adds",
        ),
        Method("Reset"),
    ),
    hides=("aaaaaaaa-0000-0000-0000-000000000000",),
    comment="sums & differences",
    namespace="Lib",
)
MODULE = ModuleClass(
    guid=PUMP,
    name="Pump",
    class_id=PUMP,
    class_factory="Pumps",
    group="Plant",
    init_sequence="PS",
    contexts=(Context(1, "Fast", 0x02010020), Context(2)),
    interfaces=(TypeName("ICalculation", CALCULATION.guid),),
    parameters=(
        Parameter(
            id=0x10,
            name="Speed",
            type=TypeName("LREAL"),
            default=(Value("1.5"), Value("0", "Min"), Value("9", "Max")),
            unit="1/s",
            online=True,
            symbol=True,
        ),
        Parameter(
            id=0x11,
            name="Limits",
            members=(Member("low", DINT), Member("high", DINT, "the upper one")),
            default=(Value("1", name=".low"), Value("2", name=".high")),
            read_only=True,
            hidden=True,
            context_id=2,
            comment=" for the\r\nlimits ]]> ",
        ),
    ),
    data_areas=(
        DataArea(
            number=0,
            name="Inputs",
            area_type="InputDst",
            context_id=1,
            byte_size=8,
            symbols=(
                Symbol(
                    name="Value",
                    type=DINT,
                    array=((-1, 3),),
                    bit_size=32,
                    bit_offset=0,
                    properties={"no_init": ""},
                    comment="x",
                ),
                Symbol(name="Text", type=TypeName("STRING(80)"), default=(Value(" a ", "String"),)),
            ),
            symbols_for_ads=True,
        ),
    ),
    interface_pointers=(Pointer(0x20, "Caller", TypeName("ITcCyclicCaller", "0300001e-0000-0000-e000-000000000064")),),
    data_pointers=(Pointer(0x21, "Image", TypeName("DINT", pointers=2)), Pointer(0x22, "Any")),
    event_classes=(TypeName("PumpEvents", "bbbbbbbb-0000-0000-0000-000000000001"),),
    licenses={"cccccccc-0000-0000-0000-000000000001": "TC3 C++"},
    properties={"ApplicationName": "Port_851"},
    attributes={"TargetPlatform": "TwinCAT RT (x64)"},
)


def module(inner: str, guid: str = f"{{{PUMP}}}") -> bytes:
    """A file with one module named Pump: its opening tag is on line 2, `inner` begins on line 3."""
    return f"""<TcModuleClass><Modules>
<Module GUID="{guid}"><Name>Pump</Name><CLSID ClassFactory="Pumps">{{{PUMP}}}</CLSID>
{inner}
</Module></Modules></TcModuleClass>""".encode()


def test_what_is_written_reads_back_equal() -> None:
    """Modules, interfaces and whose they are; also beside event classes, each of which finds its own."""
    library = Library("Somebody", "Pumps", "1.2.0.3")
    events = EventClass(
        guid="bbbbbbbb-0000-0000-0000-000000000001",
        name="PumpEvents",
        display_text="Pump",
        events={1: EventEntry(1, "Dry", Severity.ERROR, "runs dry")},
    )
    data = write_modules([MODULE], [CALCULATION], library, [events])
    found = read_modules(data)
    assert found.problems == ()
    assert found.modules == (MODULE,)
    assert found.interfaces == (CALCULATION,)
    assert found.library == library
    assert read_classes(data).classes == (events,)
    assert read_modules(write_modules([])) == read_modules(b"<TcModuleClass/>")


def test_a_module_is_found_by_name_or_id() -> None:
    """By name, GUID or class id in any spelling; a class id that two share finds neither."""
    other = ModuleClass(guid="11111111-2222-3333-4444-666666666666", name="Valve", class_id=PUMP)
    found = read_modules(write_modules([MODULE, other]))
    assert found.module("Valve").guid == other.guid
    assert found.module(f"{{{other.guid.upper()}}}").name == "Valve"
    assert MODULE.parameter("Speed").id == 0x10
    with pytest.raises(KeyError, match="2 module classes"):
        found.module(PUMP)
    with pytest.raises(KeyError, match="0 module classes are 'Tank'; expected one of Pump, Valve"):
        found.module("Tank")
    with pytest.raises(KeyError, match="'Sped'; expected one of Speed, Limits"):
        MODULE.parameter("Sped")


@pytest.mark.parametrize(
    ("inner", "line", "message"),
    [
        ("<Parameters><Parameter><Name>Speed</Name><BaseType>LREAL</BaseType></Parameter></Parameters>", 3, "no PTCID"),
        (
            "<Parameters><Parameter><Name>Speed</Name><BaseType>LREAL</BaseType>\n<PTCID>7fff</PTCID></Parameter></Parameters>",
            4,
            "parameter Speed of module Pump: PTCID '7fff'; expected 0..4294967295, decimal or #x and hex digits",
        ),
        ("<Parameters><Parameter><Name>Speed</Name><PTCID>1</PTCID></Parameter></Parameters>", 3, "no type; expected BaseType"),
        ("<Interfaces>\n<Interface/></Interfaces>", 4, "no type; expected <Type GUID=...>"),
        ("<Interfaces><Interface>\n<Type GUID='{1}'>IPump</Type></Interface></Interfaces>", 4, "type IPump: GUID '{1}'"),
        ("<DataAreas><DataArea><Name>In</Name></DataArea></DataAreas>", 3, "data area In of module Pump: no AreaNo"),
        (
            "<DataAreas><DataArea><AreaNo>0</AreaNo><Name>In</Name><Symbol><Name>a</Name></Symbol></DataArea></DataAreas>",
            3,
            "symbol a of data area In of module Pump: no type",
        ),
        (
            "<DataAreas><DataArea><AreaNo>0</AreaNo><Name>In</Name><Symbol><Name>a</Name><BaseType>INT</BaseType>"
            "<ArrayInfo><LBound>²</LBound><Elements>1</Elements></ArrayInfo></Symbol></DataArea></DataAreas>",
            3,
            "LBound '²'; expected a whole number",
        ),
        ("<InterfacePointers><InterfacePointer><Name>Caller</Name></InterfacePointer></InterfacePointers>", 3, "no PTCID"),
        ("<Contexts><Context><Id>-1</Id></Context></Contexts>", 3, "a context of module Pump: Id '-1'"),
        ("<Licenses><License/></Licenses>", 3, "a licence of module Pump: no GUID"),
    ],
)
def test_a_fault_costs_its_module_and_says_where(inner: str, line: int, message: str) -> None:
    """A module with a fault is left out; file, line, what was found and what was expected are told."""
    found = read_modules(module(inner), "pump.tmc")
    assert found.modules == ()
    (problem,) = found.problems
    assert (problem.file, problem.line) == ("pump.tmc", line)
    assert message in problem.message


def test_a_fault_does_not_cost_the_others() -> None:
    """A module without a class id and one without a name beside a whole one."""
    data = write_modules([MODULE]).replace(
        b"<Modules>", b"<Modules><Module GUID='{%b}'><Name>X</Name></Module><Module/>" % PUMP.encode()
    )
    found = read_modules(data)
    assert found.modules == (MODULE,)
    assert [problem.message.partition(";")[0] for problem in found.problems] == [
        "module X: no CLSID",
        "a module has no Name",
    ]


def test_what_is_an_interface() -> None:
    """A GUID, a base and methods, or ITcUnknown as base. Function blocks, structures and enumerations are none."""
    types = """
        <DataType><Name GUID="{aaaaaaaa-0000-0000-0000-000000000001}">IEmpty</Name>
          <BaseType GUID="{00000001-0000-0000-E000-000000000064}">ITcUnknown</BaseType></DataType>
        <DataType><Name GUID="{aaaaaaaa-0000-0000-0000-000000000002}">IMore</Name>
          <BaseType GUID="{aaaaaaaa-0000-0000-0000-000000000001}">IEmpty</BaseType><Method><Name>Go</Name></Method></DataType>
        <DataType><Name>FB_Pump</Name><Method><Name>Go</Name></Method></DataType>
        <DataType><Name GUID="{aaaaaaaa-0000-0000-0000-000000000003}">E_Mode</Name><BaseType>INT</BaseType>
          <EnumInfo><Text>a</Text></EnumInfo></DataType>
        <DataType><Name GUID="{aaaaaaaa-0000-0000-0000-000000000004}">ST_Pump</Name>
          <SubItem><Name>a</Name><Type>INT</Type></SubItem></DataType>"""
    found = read_modules(f"<TcModuleClass><DataTypes>{types}</DataTypes></TcModuleClass>".encode())
    assert [(each.name, [method.name for method in each.methods]) for each in found.interfaces] == [
        ("IEmpty", []),
        ("IMore", ["Go"]),
    ]
    assert found.problems == ()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"<TcModuleClass><Modules>", "expected well-formed XML"),
        (b"<Plant/>", "the root is Plant"),
        (b'<!DOCTYPE a [<!ENTITY x "y">]><TcModuleClass>&x;</TcModuleClass>', "a DTD is refused"),
        (b"<TcModuleClass>" + b"<a>" * 300, "expected"),
        (b"", "no element"),
    ],
)
def test_what_is_refused_as_a_whole(data: bytes, message: str) -> None:
    """Half a file, another root, a DTD, elements too deep."""
    with pytest.raises(TmcError, match=message):
        read_modules(data, "x.tmc")


def test_what_xml_cannot_hold_names_the_module() -> None:
    """A NUL in a comment is the caller's fault."""
    bad = ModuleClass(guid=PUMP, name="Pump", class_id=PUMP, event_classes=(TypeName("a\0"),))
    with pytest.raises(ValueError, match="module 'Pump' cannot be written as XML"):
        write_modules([bad])
    with pytest.raises(ValueError, match="interface 'I' cannot be written as XML"):
        write_modules([], [InterfaceType(guid=PUMP, name="I", base=UNKNOWN, comment="\ud800")])
