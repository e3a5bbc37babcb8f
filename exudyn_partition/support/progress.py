"""Progress bars on the terminal; without a terminal, lines in the log at level INFO."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator

from ..errors import InputError
from .checks import validate_number, validate_text
from .foreign import ProgressBar
from .optional import require

Progress = Callable[[float], None]  # takes the share done, 0 to 1

_LOG = logging.getLogger(__name__)
_PARTS = 10  # lines in the log of work that takes long

LONG = 2.0  # work that takes longer shows a bar [s]


@contextlib.contextmanager
def progress(title: str, *, after: float = 0.0) -> Iterator[Progress]:
    """Show a bar while something runs; yields the function to call with the share done, 0 to 1.

    Where stderr is no terminal, each tenth is a line in the log of `exudyn_partition`, at level INFO.

    Parameters
    ----------
    title : str
    after : float
        How long it has to run before a bar, or a line in the log, appears [s].

    Raises
    ------
    InputError
        If an argument, or the share, is no such thing.

    Examples
    --------
    >>> from exudyn_partition import progress
    >>> with progress("stepping") as report:
    ...     report(0.5)
    """
    validate_text("title", title)
    after = validate_number("after", after, "a time in s")
    if after < 0:
        raise InputError(f"after: expected a time of at least zero, got {after!r}")
    bar = terminal_bar()
    task, begin, told = bar.add_task(_plain(title), total=1.0), time.perf_counter(), 0

    def report(share: float) -> None:
        nonlocal told
        share = validate_number("share", share)
        seconds, part = time.perf_counter() - begin, int(_PARTS * share)
        if not bar.live.is_started and seconds >= after:
            bar.start()
        bar.update(task, completed=share)
        if bar.disable and part > told and seconds >= after:
            told = part
            _LOG.info("%s: %d %% after %.3g s", title, 100 * part // _PARTS, seconds)

    try:
        if not after:
            bar.start()
        yield report
        bar.update(task, completed=1.0)
    finally:
        _stop(bar)


@contextlib.contextmanager
def pulsing(title: str) -> Iterator[None]:
    """Show a bar that moves while something runs; for work that takes long and cannot tell the share done."""
    bar = terminal_bar()
    bar.add_task(title, total=None)
    timer = threading.Timer(LONG, bar.start)
    timer.daemon = True
    if not bar.disable:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        if timer.ident is not None:
            timer.join()  # or it might start the bar after it was stopped
        _stop(bar)


def say(text: str) -> None:
    """Write a line to the terminal, above a bar; where stderr is no terminal, to the log at level INFO."""
    console = require("rich.console").Console(stderr=True)
    if console.is_terminal:
        console.print(_plain(text))
    else:
        _LOG.info("%s", text)


def _plain(title: str) -> str:
    """Text that rich shows as it is: brackets are its markup."""
    return str(require("rich.markup").escape(title))


def terminal_bar() -> ProgressBar:
    """A bar of rich on stderr, which shows nothing where stderr is no terminal."""
    rich = require("rich.progress")
    console = require("rich.console").Console(stderr=True)
    columns = (rich.TextColumn("{task.description:<28}"), rich.BarColumn(), rich.TimeElapsedColumn())
    return rich.Progress(*columns, console=console, disable=not console.is_terminal)


def _stop(bar: ProgressBar) -> None:
    if bar.live.is_started:  # rich 13 prints an empty line for a bar that is stopped without having been shown
        bar.stop()


@contextlib.contextmanager
def shown(given: Callable[[float], None] | None, title: str) -> Iterator[Callable[[float], None]]:
    """Yield the function to report to: the one that is given, or that of a bar that appears if the work takes long."""
    if given is not None:
        yield given
        given(1.0)
    else:
        with progress(title, after=LONG) as report:
            yield report
