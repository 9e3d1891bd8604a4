"""`tcbridge log`: what a logger has stored."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, parse_filter
from bridge.cli.show import View, print_json
from bridge.config import Settings

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.core.questions import LogQuestion, Stored

LOG = Group("Log", sort_key=10)


def log(
    *,
    filter: Annotated[str, Parameter(help="Which events, e.g. 'is_alarm and severity >= error'.", group=LOG)] = "",
    limit: Annotated[int, Parameter(help="How many; 0 is all of them.", group=LOG, show_default=True)] = 100,
    offset: Annotated[int, Parameter(help="How many of the newest to leave out.", group=LOG)] = 0,
    cache: Annotated[Path | None, Parameter(help="Read the cache file of a logger that is not running.", group=LOG)] = None,
    wait: Annotated[float, Parameter(help="Seconds to wait for the logger.", group=LOG, show_default=True)] = 3.0,
    common: Common = COMMON,
) -> int:
    """Show stored events of a logger, newest first.

    Texts are in --lang: from --classes, else from whoever offers the class.
    Exit code 4: no logger of the target answers.

    Try:
        tcbridge log --classes examples/plant.tmc --lang de --limit 20
        tcbridge log --cache plc1.db --filter "severity >= error" --json
    """
    from bridge.core.filters.text import to_text
    from bridge.core.questions import LogQuestion

    settings = common.load()
    known = catalog(settings)
    if limit < 0 or offset < 0:
        raise Usage("--limit and --offset are not negative")
    expr = parse_filter(filter, known)
    question = LogQuestion(filter=to_text(expr), limit=limit, offset=offset)
    if cache is None:
        found, known = _from_bus(settings, question, wait, known)
    else:
        found = _from_file(cache, question)
    view = View(known, settings.lang)
    if common.json:
        for entry in found:
            print_json(view.record(entry.event) | {"unique_id": entry.unique_id, "arrival_ns": entry.arrival_ns})
        return Exit.OK
    view.print_log(found)
    if limit and len(found) == limit:
        note(f"the newest {limit}; --limit 0 shows all")
    return Exit.OK


def _from_bus(settings: Settings, question: "LogQuestion", wait_s: float, known: "Catalog") -> "tuple[list[Stored], Catalog]":
    """What is stored, and the event classes of it."""
    from bridge.cli.command import connected
    from bridge.texts import Texts

    with connected(settings, wait_s) as proxy, Texts(proxy.bus, realm=settings.realm, catalog=known) as texts:
        found = list(proxy.log(question))
        return found, texts.catalog_for(entry.event for entry in found)


def _from_file(cache: Path, question: "LogQuestion") -> "list[Stored]":
    from bridge.logger import Book

    if not cache.is_file():
        raise Usage(f"--cache {cache}: no such file")
    with Book(None, cache) as book:
        return list(book.log(question))
