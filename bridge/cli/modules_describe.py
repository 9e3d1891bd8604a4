"""`tcbridge modules describe`: what a module class offers and needs: from a .tmc file or installed, shown or as a .tmc file."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Group, Parameter

from bridge.cli.classes_write import Output, Overwrite, write_out
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import BASIC, Basic, note
from bridge.cli.show import Cell, print_json, print_table

if TYPE_CHECKING:
    from bridge.core.module_classes import InterfaceType, ModuleClass, TypeName
    from bridge.core.tmc import Problem

MODULES: Final = Group("Modules", sort_key=11)
_SUFFIXES: Final = (".tmc", ".tsproj", ".xti")
_HEADERS: Final = ("Kind", "Id", "Name", "Type", "More")


def describe(
    sources: Annotated[
        tuple[str, ...],
        Parameter(name="SOURCES", help="Description files (.tmc), or names or ids of module classes that a plant can have."),
    ],
    /,
    *,
    output: Output = None,
    overwrite: Overwrite = False,
    common: Basic = BASIC,
) -> int:
    """Show module classes: interfaces, parameters, data areas, interface pointers.

    With --output they are written as a .tmc file, for TwinCAT's tools. Exit code
    1: something in the files cannot be read; nothing is written then.

    Try:
        tcbridge modules describe Logger
        tcbridge modules describe Task --output task.tmc
    """
    from bridge.core.module_tmc_writer import write_modules

    common.load()
    modules, interfaces, problems = _read(sources)
    for problem in problems:
        note(f"warning: {problem}")
    if output is not None and not problems:
        return write_out(write_modules(modules, interfaces), output, overwrite, common, modules=len(modules))
    if output is None:
        for module in modules:
            if common.json:
                print_json(module)
            else:
                _show(module, {each.guid: each for each in interfaces})
    return Exit.NO if problems else Exit.OK


def _read(sources: Sequence[str]) -> "tuple[list[ModuleClass], list[InterfaceType], list[Problem]]":
    from bridge.core.hresult import AdsError
    from bridge.core.module_tmc import read_modules
    from bridge.core.tmc import Problem, TmcError
    from bridge.host.system import KINDS
    from bridge.tccom.descriptions import described
    from bridge.tccom.factories import Factories
    from bridge.tccom.tasks import Task

    installed = Factories()
    installed.register(Task, *(kind.module_class for kind in KINDS))
    modules: list[ModuleClass] = []
    interfaces: dict[str, InterfaceType] = {}
    problems: list[Problem] = []
    for source in sources:
        try:
            if source.lower().endswith(_SUFFIXES):
                found = read_modules(Path(source).read_bytes(), source)
            else:
                found = described([installed.find(source)])
        except TmcError as error:
            problems.append(Problem(error.file, error.line, error.message))
        except OSError as error:
            raise Usage(f"{source}: {error.strerror or error}") from None
        except AdsError as error:
            names = ", ".join(one.__name__ for one in installed.classes())
            raise Usage(f"{error.detail}; expected a .tmc file or one of {names}") from None
        else:
            modules += found.modules
            interfaces |= {each.guid: each for each in found.interfaces}
            problems += found.problems
    return modules, list(interfaces.values()), problems


def _show(module: "ModuleClass", interfaces: "dict[str, InterfaceType]") -> None:
    rows: list[list[Cell]] = []
    for offered in module.interfaces:
        methods = interfaces[offered.guid].methods if offered.guid in interfaces else ()
        rows.append(["interface", offered.guid, offered.name, "", ", ".join(method.name for method in methods)])
    for one in module.parameters:
        kind = _type(one.type) if one.type else ", ".join(f"{part.name} {_type(part.type)}" for part in one.members)
        default = " ".join(value.text for value in one.default)
        more = [f"default {default}" if default else "", "online" if one.online else "", one.comment]
        rows.append(["parameter", _hex(one.id), one.name, kind, ", ".join(filter(None, more))])
    for area in module.data_areas:
        rows.append(["data area", str(area.number), area.name, area.area_type, f"{len(area.symbols)} symbols"])
        rows += [["symbol", "", f"{area.name}.{each.name}", _type(each.type), each.comment.strip()] for each in area.symbols]
    for pointer in module.interface_pointers:
        rows.append(["pointer", _hex(pointer.id), pointer.name, _type(pointer.type), ""])
    rows += [["event class", each.guid, each.name, "", ""] for each in module.event_classes]
    caption = f"{module.name}  class {module.class_id}" + (f" of {module.class_factory}" if module.class_factory else "")
    print_table(_HEADERS, rows, title=caption)


def _type(kind: "TypeName | None") -> str:
    return "" if kind is None else "POINTER TO " * kind.pointers + ("REFERENCE TO " if kind.reference else "") + kind.name


def _hex(number: int) -> str:
    return f"0x{number:08X}"
