"""Ctrl-C for loops: a loop asks between its steps whether to stop, so what it has computed is kept."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


class Interrupt:
    """Handler of Ctrl-C that only remembers it.

    Attributes
    ----------
    asked : bool
        Whether the user has asked to stop.
    loops : int
        Loops within the block that ask it between their steps.
    """

    def __init__(self) -> None:
        self.asked = False
        self.loops = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take the signal: remember that the user asked to stop."""
        self.asked = True


class InterruptNow(Interrupt):
    """Handler of Ctrl-C that remembers it, and raises KeyboardInterrupt unless a loop within will ask."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take the signal."""
        super().__call__(number, frame)
        if not self.loops:
            raise KeyboardInterrupt


@contextlib.contextmanager
def interruptible(kind: type[Interrupt] = Interrupt) -> Iterator[Interrupt]:
    """Handle Ctrl-C until the end of the block; within another such block, the outer one handles it.

    Python allows that in the main thread only. In other threads nothing changes, and `asked` stays False.
    """
    previous = signal.getsignal(signal.SIGINT)
    if isinstance(previous, Interrupt):
        previous.loops += 1
        try:
            yield previous
        finally:
            previous.loops -= 1
        return
    interrupt = kind()
    if threading.get_ident() != threading.main_thread().ident:
        yield interrupt
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL if previous is None else previous)
