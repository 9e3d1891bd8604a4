"""`tcbridge classes where-used`: which event classes and events occur in recordings and cache files, and how often."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import TEXTS_ONLY, Texts, catalog
from bridge.cli.show import Cell, print_json, print_table

if TYPE_CHECKING:
    from bridge.core.class_lint import Observed
    from bridge.core.events import AnyEvent


def where_used(
    files: Annotated[tuple[Path, ...], Parameter(name="FILES", help="Recordings (.mcap) and cache files of loggers.")],
    /,
    *,
    event_class: Annotated[str | None, Parameter(name="--class", help="Only this class: a GUID, or a name.")] = None,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Count which classes and events occur in recordings and caches.

    A name means every version of the class, hidden ones too; hidden versions
    are marked. The cache file of a running logger cannot be opened.

    Try:
        tcbridge classes where-used plant.mcap plc1.db --classes plant.tmc
        tcbridge classes where-used plant.mcap --class Faults --classes plant.tmc
    """
    from bridge.cli.values import class_guid

    settings = common.load()
    known = catalog(settings)
    wanted = None
    if event_class is not None:
        wanted = set(known.guids(event_class)) or {class_guid(event_class, known)}
    rows: list[list[Cell]] = []
    for path in files:
        for (guid, number), count in sorted(_count(path).items(), key=lambda item: (item[0][0], item[0][1])):
            if wanted is not None and guid not in wanted:
                continue
            found = known.lookup(guid)
            entry = known.entry(guid, number)
            version = "" if found is None else "hidden" if known.hidden_by(guid) else "newest"
            if common.json:
                facts = {"file": str(path), "event_class": guid, "event_id": number, "count": count, "version": version}
                text = known.text(guid, number, (), settings.lang)
                print_json(facts | {"class": found.qualified_name if found else "", "text": text})
                continue
            name = found.qualified_name if found is not None else guid
            rows.append([name, version, str(number), entry.name if entry is not None else "", f"{count:,}", str(path)])
    if not common.json:
        print_table(("Class", "Version", "Id", "Event", "Count", "File"), rows)
    return Exit.OK


def observed(files: Sequence[Path]) -> "list[Observed]":
    """How often each class occurs in each file."""
    from bridge.core.class_lint import Observed

    found: list[Observed] = []
    for path in files:
        classes: Counter[str] = Counter()
        for (guid, _), count in _count(path).items():
            classes[guid] += count
        found += [Observed(str(path), guid, count) for guid, count in sorted(classes.items())]
    return found


def _count(path: Path) -> "Counter[tuple[str, int]]":
    if not path.is_file():
        raise Usage(f"{path}: no such file")
    return Counter((event.event_class, event.event_id) for event in _events(path))


def _events(path: Path) -> "Iterator[AnyEvent]":
    """Every event of a recording, or of a cache file."""
    if path.name.endswith((".mcap", ".mcap.active")):
        from bridge.edges.recording import RecordedEvent, read_events

        with read_events(path) as reader:
            for item in reader:
                if isinstance(item, RecordedEvent):
                    yield item.event
    else:
        from bridge.core.questions import LogQuestion
        from bridge.logger import Book

        with Book(None, path) as book:
            for stored in book.log(LogQuestion(newest_first=False)):
                yield stored.event
