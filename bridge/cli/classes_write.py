"""`tcbridge classes new`, `convert`, `generate`, `translations export`, `translations import`, `delete-unused`: new files.

Rule 1: a file that is there is not overwritten without --overwrite, and is replaced as a whole or not at all.
Rule 2: a class file that is written has event classes only: a TwinCAT project's modules and tasks are not carried over, so
        a .tsproj or .xti is never written.
Rule 3: a class that cannot be read stops what writes files, for it would be missing in the new one.
"""

import os
import re
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import Parameter

from bridge.cli.classes import CLASSES, Files, Language, classes_of, lcids, read, tell_problems
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import BASIC, TEXTS_ONLY, Basic, Texts, note
from bridge.cli.show import print_json

if TYPE_CHECKING:
    from bridge.core.catalog import EventClass, EventEntry
    from bridge.core.translations import Table
    from bridge.edges.class_files import ClassFile

Output: TypeAlias = Annotated[
    Path | None, Parameter(name=("--output", "-o"), help="File to write. Default: stdout.", group=CLASSES)
]
ClassOutput: TypeAlias = Annotated[
    Path, Parameter(name=("--output", "-o"), help="Class file to write, .tmc or .toml.", group=CLASSES)
]
Overwrite: TypeAlias = Annotated[bool, Parameter(help="Replace the file if it is there.", group=CLASSES)]
_EVENT = re.compile(r"([0-9]{1,10}):([^:\s]+):(verbose|info|warning|error|critical)(?::(.*))?", re.DOTALL)


def new(
    name: Annotated[str, Parameter(name="NAME", help="Name of the class, for code; a namespace stands before a dot.")],
    /,
    *,
    display_text: Annotated[str, Parameter(help="What people call the class.", group=CLASSES)] = "",
    event: Annotated[
        tuple[str, ...], Parameter(help="ID:NAME:SEVERITY:TEXT; repeat it. Default: one to begin with.", group=CLASSES)
    ] = (),
    output: Output = None,
    overwrite: Overwrite = False,
    common: Basic = BASIC,
) -> int:
    """Define an event class, as TOML, or as TMC if the file ends so.

    Its GUID follows from the content. docs/classes.md describes the TOML.

    Try:
        tcbridge classes new Pump --display-text "Pumps" \\
            --event "1:RanDry:error:Pump {0} ran dry" --output pump.classes.toml
    """
    from bridge.core.definitions import define_class

    common.load()
    namespace, _, last = name.rpartition(".")
    events = [_event(each) for each in event or ("1:Event1:info:Event 1 with {0}",)]
    try:
        found = define_class(last, display_text, events, namespace=namespace)
    except ValueError as error:
        raise Usage(str(error)) from None
    return write_out(_classes_as([found], output, ".toml"), output, overwrite, common, classes=1)


def _event(text: str) -> "EventEntry":
    from bridge.core.catalog import EventEntry
    from bridge.core.events import Severity

    match = _EVENT.fullmatch(text)
    if match is None:
        raise Usage(f"--event {text!r}; expected ID:NAME:SEVERITY:TEXT, e.g. '1:RanDry:error:Pump {{0}} ran dry'")
    return EventEntry(int(match[1]), match[2], Severity[match[3].upper()], match[4] or "")


def convert(files: Files = (), /, *, output: ClassOutput, overwrite: Overwrite = False, common: Texts = TEXTS_ONLY) -> int:
    """Write event classes as TMC or as TOML.

    The ending of --output says which. GUIDs, hidden versions and translations
    stay as they are; only event classes are written.

    Try:
        tcbridge classes convert examples/plant.tmc --output plant.classes.toml
        tcbridge classes convert plant.classes.toml --output plant.tmc
    """
    found = _classes(read(files, common.load()))
    return write_out(_classes_as(found, output, ""), output, overwrite, common, classes=len(found))


def generate(
    files: Files = (),
    /,
    *,
    to: Annotated[
        Literal["python", "json"] | None, Parameter(help="Default: by the ending, else python.", group=CLASSES)
    ] = None,
    output: Output = None,
    overwrite: Overwrite = False,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write typed constants: a Python module, or JSON.

    TC_EVENTS.Faults.LagError then has class, id and severity, and a type
    checker finds a misspelled event. The same classes give the same file.

    Try:
        tcbridge classes generate examples/plant.tmc --output plant_events.py
        tcbridge classes generate examples/plant.tmc --to json
    """
    from bridge.cli import program_version
    from bridge.core import generate as generators

    files_read = read(files, common.load())
    found = _classes(files_read)
    kind = to or ("json" if output is not None and output.suffix.lower() == ".json" else "python")
    write = generators.json_text if kind == "json" else generators.python_module
    text = write(found, made_by=f"tcbridge {program_version()}", sources=[file.path.name for file in files_read])
    return write_out(text.encode(), output, overwrite, common, classes=len(found))


def translations_export(
    files: Files = (),
    /,
    *,
    language: Language = (),
    output: Annotated[Path, Parameter(name=("--output", "-o"), help="File to write, .csv or .xml.", group=CLASSES)],
    overwrite: Overwrite = False,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write every text with its translations, for translators.

    As CSV with a column per language, or as TwinCAT's Translations block (XML).
    With --language exactly those, also where a translation is missing.

    Try:
        tcbridge classes translations export examples/plant.tmc \\
            --language de --output texts.csv
    """
    from bridge.core import translations

    found = _classes(read(files, common.load()))
    table = translations.every_text(found, lcids(language))
    try:
        data = (
            translations.write_csv(table, found)
            if _ending(output, (".csv", ".xml")) == ".csv"
            else translations.write_xml(table)
        )
    except ValueError as error:
        raise Usage(str(error)) from None
    return write_out(data, output, overwrite, common, texts=sum(map(len, table.values())))


def translations_import(
    table: Annotated[Path, Parameter(name="TABLE", help="Translations, .csv or .xml.")],
    files: Files = (),
    /,
    *,
    output: ClassOutput,
    overwrite: Overwrite = False,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Write event classes with the translations of a table.

    GUIDs stay: a translation makes no new version. An empty translation changes
    nothing. Exit code 1: the table has texts that no class has; they are named.

    Try:
        tcbridge classes translations import texts.csv examples/plant.tmc \\
            --output plant.classes.toml
    """
    from bridge.core import translations

    found = _classes(read(files, common.load()))
    result = translations.imported(found, _table(table))
    written = write_out(
        _classes_as(result.classes, output, ""),
        output,
        overwrite,
        common,
        classes=len(result.classes),
        added=result.added,
        changed=result.changed,
        unknown=len(result.unknown),
    )
    for event_class, text in result.unknown:
        note(f"no class has this text: {text!r}" + (f" (class {event_class})" if event_class else ""))
    return Exit.NO if result.unknown else written


def _table(path: Path) -> "Table":
    from bridge.core import translations
    from bridge.core.tmc import TmcError

    read_table = translations.read_csv if _ending(path, (".csv", ".xml")) == ".csv" else translations.read_xml
    try:
        return read_table(path.read_bytes(), str(path))
    except OSError as error:
        raise Usage(f"{path}: {error.strerror or error}") from None
    except TmcError as error:
        raise Usage(str(error)) from None


def delete_unused(
    files: Files = (), /, *, output: ClassOutput, overwrite: Overwrite = False, common: Texts = TEXTS_ONLY
) -> int:
    """Write event classes without translations that no text has.

    Those of a class and those on the level of the file. What is left out is
    named.

    Try:
        tcbridge classes delete-unused plant.tmc --output plant.tmc --overwrite
    """
    from bridge.core import translations

    files_read = read(files, common.load())
    found = _classes(files_read)
    texts = {text for each in found for text in each.texts()}
    gone = [text for keys in translations.unused(found).values() for text in keys]
    gone += [text for file in files_read for text in file.result.translations if text not in texts]
    kept = translations.without_unused(found)
    written = write_out(_classes_as(kept, output, ""), output, overwrite, common, classes=len(kept), deleted=len(gone))
    for text in gone:
        note(f"not used: {text!r}")
    return written


# FILES ------------------------------------------------------------------------------------------------------------------------


def _classes(files: "Sequence[ClassFile]") -> "list[EventClass]":
    """Every class, each GUID once. Usage when something cannot be read, or a GUID stands for two contents."""
    if tell_problems(files):
        raise Usage("nothing is written, for something cannot be read")
    found: dict[str, EventClass] = {}
    for each in classes_of(files):
        if found.setdefault(each.guid, each) != each:
            raise Usage(f"the files define {each.qualified_name} ({each.guid}) in two ways; name one of them")
    return list(found.values())


def _ending(path: Path, endings: tuple[str, ...]) -> str:
    ending = path.suffix.lower()
    if ending not in endings:
        raise Usage(f"{path}: expected a name that ends with {' or '.join(endings)}")
    return ending


def _classes_as(classes: "Iterable[EventClass]", output: Path | None, default: str) -> bytes:
    from bridge.core import class_toml, tmc_writer

    ending = default if output is None else _ending(output, (".tmc", ".toml"))
    try:
        return tmc_writer.write_classes(classes) if ending == ".tmc" else class_toml.write_classes(classes)
    except ValueError as error:
        raise Usage(str(error)) from None


def write_out(data: bytes, output: Path | None, overwrite: bool, common: Basic, **counts: int) -> int:
    """To the file, or to stdout without one."""
    if output is None:
        if common.json:
            print_json({"content": data.decode(), **counts})
        else:
            print(data.decode(), end="")
        return Exit.OK
    if output.exists() and not overwrite:
        raise Usage(f"{output} is there already; --overwrite replaces it")
    _replace(output, data)
    if common.json:
        print_json({"written": str(output), "bytes": len(data), **counts})
    else:
        print(f"{output}: {', '.join(f'{number:,} {name}' for name, number in counts.items())}")
    return Exit.OK


def _replace(path: Path, data: bytes) -> None:
    """Write beside it, then rename, so that nobody sees half a file."""
    number, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        Path(name).chmod(0o666 & ~umask)
        Path(name).replace(path)
    except BaseException:
        with suppress(OSError):
            Path(name).unlink()
        raise
