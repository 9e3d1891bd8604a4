"""`tcbridge log`: what a logger has stored."""

from typing import Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, catalog, note
from bridge.cli.selection import LOG, SELECTION, Selection
from bridge.cli.show import View, print_json


def log(
    *,
    limit: Annotated[int, Parameter(help="How many; 0 is all of them.", group=LOG, show_default=True)] = 100,
    which: Selection = SELECTION,
    common: Common = COMMON,
) -> int:
    """Show stored events of a logger, newest first.

    Texts are in --lang: from --classes, else from whoever offers the class.
    Exit code 4: no logger of the target answers.

    Try:
        tcbridge log --classes examples/plant.tmc --lang de --limit 20
        tcbridge log --cache plc1.db --min-severity error --view occurrences
    """
    settings = common.load()
    known = catalog(settings)
    question = which.question(settings, known, limit)
    with which.rows(settings, known, question) as (rows, texts):
        view = View(known, settings.lang, texts)
        if common.json:
            for entry in rows:
                print_json(view.record(entry.event) | {"unique_id": entry.unique_id, "arrival_ns": entry.arrival_ns})
            return Exit.OK
        found = list(rows)
        view.print_log(found, occurrences=which.view == "occurrences")
    unknown = {entry.event.event_class for entry in found if entry.event.event_class not in known}
    if which.cache is not None and unknown:
        classes = "an event class is" if len(unknown) == 1 else f"{len(unknown):,} event classes are"
        note(f"{classes} unknown, a cache holds none; for texts name the class files with --classes")
    if limit and len(found) == limit:
        note(f"these are {limit}; --limit 0 shows all")
    return Exit.OK
