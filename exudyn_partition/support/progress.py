"""How far work has come, and how long it will take: bars on a terminal, lines elsewhere."""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator

from ..errors import InputError
from .checks import validate_number, validate_text
from .foreign import ProgressBar
from .optional import require

Progress = Callable[[float], None]  # takes the share done, 0 to 1

_LOG = logging.getLogger(__name__)
LONG = 2.0  # work that takes longer shows a bar [s]
LOOK = 1.0  # time between two looks at how fast work goes on [s]
_WORTH_TELLING = 10.0  # whole time from which a line tells it ahead [s]
_ALIKE = 2.0  # largest ratio of whole times, by two looks, that agree
_NO_END = 1000 * 3600.0  # from this time left on, work hardly goes on [s]
FIRST_LINE, _SELDOM = 10.0, 300.0  # where there is no bar: time of the first line, and longest between two [s]


@contextlib.contextmanager
def progress(title: str, *, after: float = 0.0) -> Iterator[Progress]:
    """Show a bar while something runs; yields the function to call with the share done, 0 to 1.

    If the whole will take more than some ten seconds, a line tells so after two seconds. Where stderr is no
    terminal, as in notebooks, pipes and batch jobs, lines tell the share done and the time left: after ten seconds,
    then ever less often, at least every five minutes. They go to the log of `exudyn_partition` if that takes level
    INFO, or else to stderr.

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
    begin, made = time.perf_counter(), list[ProgressBar]()

    def bar() -> ProgressBar:  # made when it is needed: short runs take less time than that
        if not made:
            made.append(terminal_bar())
            made[0].add_task(_plain(title), total=1.0)
            made[0].tasks[0].start_time = begin
        return made[0]

    def show(share: float) -> None:
        if not bar().live.is_started:
            bar().start()
        bar().update(bar().task_ids[0], completed=share)

    lines = _Lines(title, lambda: bool(bar().disable))

    def report(share: float) -> None:
        share = validate_number("share", share)
        seconds = time.perf_counter() - begin
        if seconds >= after:
            show(share)
        if (line := lines.at(seconds, share)) is not None:
            _tell(bar(), line)

    try:
        if not after:
            show(0.0)
        yield report
        if made:
            bar().update(bar().task_ids[0], completed=1.0)
    finally:
        if made:
            _stop(bar())


class _Lines:
    """Lines about work: one ahead if it takes long, and where there is no bar, some on the way.

    The time left follows from the pace since the last look. The first look does not count, for loops may be compiled
    before it. The whole time is told where two looks agree about it: loops are also compiled when bodies touch first.

    Parameters
    ----------
    title : str
    on_the_way : callable
        Returns whether there is no bar.
    """

    def __init__(self, title: str, on_the_way: Callable[[], bool]) -> None:
        self._title, self._on_the_way = title, on_the_way
        self._look, self._looks, self._announced, self._next = (0.0, 0.0), 0, False, FIRST_LINE
        self._whole = 0.0  # by the last look [s]

    def at(self, seconds: float, share: float) -> str | None:
        """Line after some time [s], with this share done; None if there is nothing to tell."""
        before, done = self._look
        if seconds - before < LOOK or not done < share < 1.0:
            return None
        self._look, self._looks = (seconds, share), self._looks + 1
        left = (1.0 - share) * (seconds - before) / (share - done)
        if self._looks == 1:
            return None
        last, self._whole = self._whole, seconds + left
        agree = max(last, self._whole) <= _ALIKE * min(last, self._whole)
        if not self._announced and agree and _WORTH_TELLING <= self._whole < _NO_END:
            self._announced = True
            return f"{self._title}: about {duration(seconds + left)} in all"
        if seconds >= self._next and self._on_the_way():
            self._next = _next_line(seconds)
            rest = f"about {duration(left)} left" if left < _NO_END else "it hardly goes on"
            return f"{self._title}: {share:.0%} after {duration(seconds)}, {rest}"
        return None


@contextlib.contextmanager
def pulsing(title: str) -> Iterator[None]:
    """Show a bar that moves while something runs; for work that takes long and cannot tell the share done.

    Where stderr is no terminal, lines tell how long it has taken so far, see `progress`.
    """
    bar, ended = terminal_bar(), threading.Event()
    bar.add_task(title, total=None)

    def watch() -> None:
        if not bar.disable:
            if not ended.wait(LONG):
                bar.start()
            return
        begin, line = time.perf_counter(), FIRST_LINE
        while not ended.wait(begin + line - time.perf_counter()):
            _tell(bar, f"{title}: {duration(line)} so far")
            line = _next_line(line)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()  # or it might start the bar after it was stopped
        _stop(bar)


def _next_line(seconds: float) -> float:
    """Time of the next line after one at some time, where there is no bar [s]."""
    return min(2 * seconds, seconds + _SELDOM)


def say(text: str) -> None:
    """Write a line to the terminal, above a bar; where stderr is no terminal, to the log at level INFO."""
    console = require("rich.console").Console(stderr=True)
    if console.is_terminal:
        console.print(_plain(text))
    else:
        _LOG.info("%s", text)


def _tell(bar: ProgressBar, text: str) -> None:
    """Write a line where the user looks: above the bar, into a log that takes it, or to stderr."""
    if not bar.disable:
        bar.console.print(_plain(text))
    elif _LOG.isEnabledFor(logging.INFO):
        _LOG.info("%s", text)
    else:
        print(text, file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """Text of a time, to two digits, in the unit that suits it."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}'):g} s"


def _plain(title: str) -> str:
    """Text that rich shows as it is: brackets are its markup."""
    return str(require("rich.markup").escape(title))


def terminal_bar() -> ProgressBar:
    """A bar of rich on stderr, which shows nothing where stderr is no terminal."""
    rich = require("rich.progress")
    console = require("rich.console").Console(stderr=True)
    times = rich.TimeElapsedColumn(), rich.TimeRemainingColumn()
    columns = rich.TextColumn("{task.description:<28}"), rich.BarColumn(), *times
    return rich.Progress(*columns, console=console, disable=not console.is_terminal, get_time=time.perf_counter)


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
