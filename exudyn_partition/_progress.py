"""Progress on the terminal, quiet where there is none."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from ._optional import require


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """Show a bar while something runs; yields the function to call with the share done, 0 to 1.

    Parameters
    ----------
    title : str

    Examples
    --------
    >>> from exudyn_partition import progress
    >>> with progress("stepping") as report:
    ...     report(0.5)
    """
    rich = require("rich.progress")
    console = require("rich.console").Console(stderr=True)
    columns = (rich.TextColumn("{task.description:<28}"), rich.BarColumn(), rich.TimeElapsedColumn())
    with rich.Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)
        bar.update(task, completed=1.0)
