"""`tcbridge filter explain`: what becomes of a filter."""

from typing import Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import REALM, TEXTS_ONLY, Texts, catalog, parse_filter
from bridge.cli.show import print_json


def explain(
    text: Annotated[str, Parameter(help="The filter, e.g. \"severity >= error and source.name like '%Main%'\".")] = "",
    /,
    *,
    realm: Annotated[str | None, REALM] = None,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Explain a filter: tree, keys, SQL, what is exact.

    The keys are what a listener subscribes to; the predicate checks what they
    leave open. Both keys and SQL may let too much through, never too little.
    A filter that is not understood is shown with a caret under the place, and
    the exit code is 2. Names of event classes need --classes.

    Try:
        tcbridge filter explain "severity >= error and json('/axis') = 3"
    """
    from bridge.core.filters.explain import explain as explained

    settings = common.load(realm=realm)
    known = catalog(settings)
    explanation = explained(parse_filter(text, known), settings.realm, resolve_class=known.guids)
    if common.json:
        print_json(explanation)
    else:
        print("\n".join(explanation.lines()))
    return Exit.OK
