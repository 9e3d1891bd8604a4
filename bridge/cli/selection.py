"""Which events of a log: the options that log, log export and log clear share, and where the events come from."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from cyclopts import Group, Parameter

from bridge.cli.exits import Usage
from bridge.cli.options import parse_filter
from bridge.cli.values import SeverityName
from bridge.config import Settings
from bridge.core.event_fields import SortName
from bridge.core.questions import LogQuestion, Stored, ViewName

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.logger import Book
    from bridge.texts import Texts

LOG: Final = Group("Log", sort_key=10)
_UNLIMITED: Final = 2**62


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which stored events, in which order."""

    filter: Annotated[str, Parameter(help="Which events, e.g. 'is_alarm and severity >= error'.", group=LOG)] = ""
    only: Annotated[Literal["messages", "alarms"] | None, Parameter(help="Only messages, or only alarms.", group=LOG)] = None
    min_severity: Annotated[SeverityName | None, Parameter(help="Only this severity and above.", group=LOG)] = None
    view: Annotated[ViewName, Parameter(help="Every transition, or one row per alarm life.", group=LOG, show_default=True)] = (
        "transitions"
    )
    sort: Annotated[SortName | None, Parameter(help="Sort by this field. Default: arrival.", group=LOG)] = None
    oldest_first: Annotated[bool, Parameter(help="The oldest, or the smallest, first.", group=LOG)] = False
    last: Annotated[bool, Parameter(help="--limit takes the last of them, not the first.", group=LOG)] = False
    offset: Annotated[int, Parameter(help="How many to leave out at that end.", group=LOG)] = 0

    def question(self, settings: Settings, known: "Catalog", limit: int) -> LogQuestion:
        """What to ask the logger for. The errors of a bad filter are those of parse_filter()."""
        from bridge.core.filters.ast import Everything
        from bridge.core.filters.text import to_text

        if limit < 0 or self.offset < 0:
            raise Usage("--limit and --offset are not negative")
        expr = parse_filter(self.filter, known)
        parts = [] if isinstance(expr, Everything) else [f"({to_text(expr)})"]
        if self.only is not None:
            parts.append("is_message" if self.only == "messages" else "is_alarm")
        if self.min_severity is not None:
            parts.append(f"severity >= {self.min_severity}")
        return LogQuestion(
            filter=" and ".join(parts),
            limit=limit,
            offset=self.offset,
            newest_first=not self.oldest_first,
            sort=self.sort or "",
            take_last=self.last,
            view=self.view,
            lang=settings.lang,
        )


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Selection(Choice):
    """The same, and whose."""

    cache: Annotated[Path | None, Parameter(help="The cache file of a logger that is not running.", group=LOG)] = None
    wait: Annotated[float, Parameter(help="Seconds to wait for the logger.", group=LOG, show_default=True)] = 3.0

    @contextmanager
    def rows(
        self, settings: Settings, known: "Catalog", question: LogQuestion
    ) -> "Iterator[tuple[Iterator[Stored], Texts | None]]":
        """The events as they come, from the logger or the file; and who asks for classes of no file, if there is a bus."""
        if self.cache is not None:
            with self.book(known) as book:
                yield book.log(question), None
        else:
            from bridge.cli.command import connected
            from bridge.texts import Texts

            with connected(settings, self.wait) as proxy, Texts(proxy.bus, realm=settings.realm, catalog=known) as texts:
                yield proxy.log(question), texts

    def book(self, known: "Catalog") -> "Book":
        """The cache file, opened as it is: nothing is dropped from it."""
        from bridge.edges.cache import Cache
        from bridge.logger import Book

        if self.cache is None or not self.cache.is_file():
            raise Usage(f"--cache {self.cache}: no such file")
        return Book(None, Cache(self.cache, max_bytes=_UNLIMITED), resolve_class=known.guids, catalog=known)


CHOICE: Final = Choice()
SELECTION: Final = Selection()
