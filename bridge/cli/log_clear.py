"""`tcbridge log clear`: forget stored events."""

import sys
from typing import Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, operator
from bridge.cli.selection import LOG, SELECTION, Selection
from bridge.cli.show import clean, counted, print_json
from bridge.config import HELP

CLEAR = Group("Clear", sort_key=11)


def clear(
    *,
    yes: Annotated[bool, Parameter(name="--yes", help="Do not ask.", group=CLEAR)] = False,
    operator_name: Annotated[str | None, Parameter(name="--operator", help=HELP["operator"], group=CLEAR)] = None,
    comment: Annotated[str, Parameter(help="Why; kept in the log.", group=CLEAR)] = "",
    limit: Annotated[int, Parameter(help="How many; 0 is all of them.", group=LOG, show_default=True)] = 0,
    which: Selection = SELECTION,
    common: Common = COMMON,
) -> int:
    """Forget stored events of a logger, all or those selected.

    It asks first. Alarms are not touched: what is raised stays raised. In the
    view of occurrences whole alarm lives go. Exit code 1: answered with no.

    Try:
        tcbridge log clear --target plc1 --filter "severity < warning" --yes
        tcbridge log clear --cache plc1.db --oldest-first --limit 1000
    """
    settings = common.load(operator=operator_name)
    known = catalog(settings)
    question = which.question(settings, known, limit)
    if not yes and not _confirmed(settings.one_target if which.cache is None else str(which.cache), question.filter, limit):
        note("nothing was cleared")
        return Exit.NO
    if which.cache is None:
        from bridge.cli.command import connected

        with connected(settings, which.wait) as proxy:
            count = proxy.clear_log(question, operator=operator(settings), comment=comment)
    else:
        with which.book(known) as book:
            count = book.clear(question)
    if common.json:
        print_json({"cleared": count})
    else:
        print(f"{counted(count, 'event')} cleared")
    return Exit.OK


def _confirmed(log: str, filter: str, limit: int) -> bool:
    if not sys.stdin.isatty():
        raise Usage("log clear asks first, and nobody is there to answer; --yes does not ask")
    what = f"{f'{limit} ' if limit else 'all '}events{f' with {filter}' if filter else ''}"
    print(f"Clear {clean(what)} of the log of {clean(log)}? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")
