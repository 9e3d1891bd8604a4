"""How far long work is: on stderr, and only when a person watches."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, TypeAlias

from bridge.cli.show import console

Show: TypeAlias = Callable[[int], None]
_EVERY_S: Final = 0.1


@contextmanager
def counting(word: str, total: int = 0) -> Iterator[Show]:
    """Give a function that shows how many events are done; with a total as a bar."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn

    counts: list[ProgressColumn | str] = (
        [BarColumn(), MofNCompleteColumn()] if total else [TextColumn("{task.completed:,.0f} events")]
    )
    with Progress(TextColumn(word), *counts, TimeElapsedColumn(), console=console(stderr=True), transient=True) as bar:
        task = bar.add_task(word, total=total or None)
        shown_s = 0.0

        def show(done: int) -> None:
            nonlocal shown_s
            if time.monotonic() - shown_s >= _EVERY_S:
                shown_s = time.monotonic()
                bar.update(task, completed=done)

        yield show
