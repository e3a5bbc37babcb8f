"""Progress on the terminal, quiet where there is none."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from ._optional import require

LONG = 2.0  # what takes longer shows its progress [s]


@contextlib.contextmanager
def progress(title: str, *, after: float = 0.0) -> Iterator[Callable[[float], None]]:
    """Show a bar while something runs; yields the function to call with the share done, 0 to 1.

    Parameters
    ----------
    title : str
    after : float
        How long it has to run before a bar appears [s].

    Examples
    --------
    >>> from exudyn_partition import progress
    >>> with progress("stepping") as report:
    ...     report(0.5)
    """
    rich = require("rich.progress")
    console = require("rich.console").Console(stderr=True)
    columns = (rich.TextColumn("{task.description:<28}"), rich.BarColumn(), rich.TimeElapsedColumn())
    bar = rich.Progress(*columns, console=console, disable=not console.is_terminal)
    task, begin = bar.add_task(title, total=1.0), time.perf_counter()

    def report(share: float) -> None:
        if not bar.live.is_started and time.perf_counter() - begin >= after:
            bar.start()
        bar.update(task, completed=share)

    try:
        if not after:
            bar.start()
        yield report
        bar.update(task, completed=1.0)
    finally:
        bar.stop()


@contextlib.contextmanager
def shown(given: Callable[[float], None] | None, title: str) -> Iterator[Callable[[float], None]]:
    """Yield the caller's own function to report to, or that of a bar that appears where it takes long."""
    if given is not None:
        yield given
        given(1.0)
    else:
        with progress(title, after=LONG) as report:
            yield report
