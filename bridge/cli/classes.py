"""`tcbridge classes list`, `show`, `lint`, `diff`: what event classes there are, what is wrong with them, what changed."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import TEXTS_ONLY, Texts, note
from bridge.cli.show import Cell, clean, print_json, print_table, severity_span
from bridge.config import Settings

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog, EventClass
    from bridge.edges.class_files import ClassFile

CLASSES: Final = Group("Classes", sort_key=10)
Files: TypeAlias = Annotated[
    tuple[Path, ...], Parameter(name="FILES", help="Files or folders with event classes. Default: those of --classes.")
]
Language: TypeAlias = Annotated[tuple[str, ...], Parameter(help="Language, a tag or an LCID; repeat it.", group=CLASSES)]


def class_list(files: Files = (), /, *, common: Texts = TEXTS_ONLY) -> int:
    """List event classes: name, GUID, version, events, languages.

    A hidden version is one that a newer class hides. Without files those of
    --classes. Exit code 1: something in the files cannot be read.

    Try:
        tcbridge classes list examples/plant.tmc --lang de
    """
    from bridge.core.catalog import Catalog, language_tag

    settings = common.load()
    found = read(files, settings)
    known = Catalog(each for file in found for each in file.result.classes)
    rows: list[list[Cell]] = []
    for file in found:
        for each in file.result.classes:
            hidden = ", ".join(newer.qualified_name for newer in known.hidden_by(each.guid))
            languages = [language_tag(lcid) for lcid in sorted({lcid for row in each.translations.values() for lcid in row})]
            name = known.class_name(each.guid, settings.lang)
            if common.json:
                facts = {"class": each.qualified_name, "guid": each.guid, "class_name": name, "events": len(each.events)}
                print_json(
                    facts | {"languages": languages, "hides": each.hides, "hidden": bool(hidden), "file": str(file.path)}
                )
            version = f"hidden by {hidden}" if hidden else "newest"
            rows.append(
                [each.qualified_name, each.guid, version, str(len(each.events)), " ".join(languages), name, str(file.path)]
            )
    if not common.json:
        print_table(("Class", "GUID", "Version", "Events", "Languages", "Text", "File"), rows)
    return tell_problems(found)


def show(
    event_class: Annotated[str, Parameter(name="CLASS", help="Event class: a GUID, or a name from --classes.")],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Show one event class with its events, texts in --lang.

    A name with several versions means the newest one; a GUID means that one.

    Try:
        tcbridge classes show Faults --classes examples/plant.tmc --lang de
    """
    from bridge.cli.options import catalog
    from bridge.core.catalog import language_tag

    settings = common.load()
    known = catalog(settings)
    found = one_class(event_class, known)
    if common.json:
        print_json(found)
        return Exit.OK
    languages = sorted({lcid for row in found.translations.values() for lcid in row})
    hiders = known.hidden_by(found.guid)
    facts = (
        ("class", found.qualified_name),
        ("GUID", found.guid),
        ("text", known.class_name(found.guid, settings.lang)),
        ("languages", " ".join(map(language_tag, languages))),
        ("hidden by", ", ".join(f"{each.qualified_name} ({each.guid})" for each in hiders)),
        ("hides", ", ".join(found.hides)),
        ("comment", found.comment),
    )
    for name, text in facts:
        if text:
            print(f"{name:10} {clean(text)}")
    print()
    rows: list[list[Cell]] = []
    for entry in found.events.values():
        text = known.text(found.guid, entry.id, (), settings.lang)
        rows.append([str(entry.id), entry.name, severity_span(entry.severity), text, entry.comment])
    print_table(("Id", "Name", "Severity", "Text", "Comment"), rows)
    return Exit.OK


def lint(
    files: Files = (),
    /,
    *,
    language: Language = (),
    used: Annotated[
        tuple[Path, ...], Parameter(help="Recording or cache file, to find hidden classes in use; repeat it.", group=CLASSES)
    ] = (),
    text_limit: Annotated[int | None, Parameter(help="Bytes that a text may have. Default: 2035.", group=CLASSES)] = None,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Say what is wrong with event classes, with file and line.

    Missing languages, placeholders that differ between languages, ids and names
    used twice, missing severities, texts that are too long, hidden classes that
    are still used. Exit code 1: there are findings.

    Try:
        tcbridge classes lint examples/plant.tmc --language de --language en
    """
    from bridge.cli.where_used import observed
    from bridge.core.class_draft import draft
    from bridge.core.class_lint import TEXT_BYTES
    from bridge.core.class_lint import lint as run

    settings = common.load()
    found = read(files, settings)
    drafts = [draft(file.path.read_bytes(), str(file.path), file.result) for file in found]
    problems = [problem for file in found for problem in file.result.problems]
    limit = TEXT_BYTES if text_limit is None else text_limit
    findings = run(drafts, problems, languages=lcids(language), observed=observed(used), text_bytes=limit)
    for each in findings:
        if common.json:
            print_json(each)
        else:
            print(clean(str(each)))
    if not common.json:
        note(f"{len(findings)} findings in {sum(len(each.classes) for each in drafts)} classes of {len(found)} files")
    return Exit.NO if findings else Exit.OK


def diff(
    old: Annotated[str, Parameter(name="OLD", help="A file, or a class of --classes: a GUID, or a name.")],
    new: Annotated[str, Parameter(name="NEW", help="The same for the newer one.")],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Say what changed between two versions, and what listeners notice.

    Two files are compared class by class, two classes with each other. Exit
    code 0: nothing changed; 1: something did.

    Try:
        tcbridge classes diff old.tmc new.tmc
        tcbridge classes diff 64b4d49e-1bd8-462d-9a40-2904237f1837 MsgEvents
    """
    from bridge.core import class_diff

    settings = common.load()
    if Path(old).exists() and Path(new).exists():
        before, after = (read((Path(place),), settings) for place in (old, new))
        tell_problems([*before, *after])
        found = class_diff.diff(classes_of(before), classes_of(after))
    else:
        from bridge.cli.options import catalog

        known = catalog(settings)
        one = class_diff.diff_classes(one_class(old, known), one_class(new, known))
        found = [one] if one.changes else []
    for each in found:
        if common.json:
            print_json(
                {
                    "class": each.name,
                    "old": each.old.guid if each.old is not None else None,
                    "new": each.new.guid if each.new is not None else None,
                    "noticed": each.noticed,
                    "changes": each.changes,
                }
            )
            continue
        print(f"{clean(each.name)}: {'listeners notice' if each.noticed else 'listeners notice nothing'}")
        for change in each.changes:
            print(f"  {clean(change.what)}: {_quoted(change.before)} -> {_quoted(change.after)}")
            if change.notice:
                print(f"    {clean(change.notice)}")
    return Exit.NO if found else Exit.OK


def _quoted(text: str) -> str:
    return f"'{clean(text)}'" if text else "(nothing)"


# SHARED WITH THE COMMANDS THAT WRITE ------------------------------------------------------------------------------------------


def read(files: Sequence[Path], settings: Settings) -> "list[ClassFile]":
    """The class files that were named, else those of the settings. Usage when there are none or one cannot be opened."""
    from bridge.edges.class_files import class_files, read_class_file

    paths = files or tuple(map(Path, settings.classes))
    if not paths:
        raise Usage("no event classes: name files, or --classes")
    try:
        found = [read_class_file(path) for path in class_files(paths)]
    except OSError as error:
        raise Usage(f"{error.filename}: {error.strerror or error}") from None
    if not found:
        raise Usage(f"no class files in {', '.join(map(str, paths))}")
    return found


def classes_of(files: "Sequence[ClassFile]") -> "list[EventClass]":
    """Every class of these files, in order."""
    return [each for file in files for each in file.result.classes]


def tell_problems(files: "Sequence[ClassFile]") -> int:
    """What cannot be read goes to stderr; the exit code that this means."""
    problems = [problem for file in files for problem in file.result.problems]
    for problem in problems:
        note(f"warning: {problem}")
    return Exit.NO if problems else Exit.OK


def one_class(text: str, known: "Catalog") -> "EventClass":
    """The class of a GUID or name. ClassNameError for a name that is unknown or means several."""
    return known.lookup(text) or known.newest(text)


def lcids(languages: Sequence[str]) -> tuple[int, ...]:
    """Languages as LCIDs."""
    from bridge.core.catalog import LanguageError, language_id

    try:
        return tuple(language_id(each) for each in languages)
    except LanguageError as error:
        raise Usage(f"--language: {error}") from None
