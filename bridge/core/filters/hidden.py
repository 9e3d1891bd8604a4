"""Which old versions of event classes a filter names, so that somebody who filters by one is warned.

Rule: a hidden GUID is worth a warning when the filter names none of the classes that hide it (of the same name, if there are
such). A class name stands for all its versions, so it is never worth one: the newer version is in the filter too.
"""

import contextlib

import msgspec

from bridge.core.catalog import Catalog, EventClass
from bridge.core.filters.ast import Compare, Expr, In, UnknownClassError, leaves, resolve


class HiddenClass(msgspec.Struct, frozen=True):
    """A GUID in a filter that is an older version: as text the warning."""

    guid: str
    hidden_by: tuple[EventClass, ...]
    name: str = ""

    def __str__(self) -> str:
        newer = " and ".join(f"{found.qualified_name} {found.guid}" for found in self.hidden_by)
        own = f"{self.name} " if self.name else ""
        return (
            f"event class {own}{self.guid} is an older version, hidden by {newer}: senders with the newer one are not taken; "
            f"event_class = '{self.hidden_by[-1].qualified_name}' takes every version"
        )


def hidden_in(expr: Expr, catalog: Catalog) -> tuple[HiddenClass, ...]:
    """The older versions that a filter names without one of those that hide them, in the order of the filter."""
    with contextlib.suppress(UnknownClassError):  # a name that nobody knows hides nothing
        expr = resolve(expr, catalog.guids)
    named: dict[str, None] = {}
    for leaf in leaves(expr):
        match leaf:
            case Compare("event_class", "=", value):
                named[str(value)] = None
            case In("event_class", values):
                named.update(dict.fromkeys(map(str, values)))
            case _:
                pass
    hidden: list[HiddenClass] = []
    for guid in named:
        known = catalog.lookup(guid)
        name = "" if known is None else known.qualified_name
        hiding = catalog.hidden_by(guid)
        newer = tuple(found for found in hiding if found.qualified_name == name) or hiding
        if newer and not any(found.guid in named for found in newer):
            hidden.append(HiddenClass(guid, newer, name))
    return tuple(hidden)
