"""Functions for tests of studies: workers import them, and need neither Exudyn nor NGSolve."""

import os
import signal
import time
import warnings

from exudyn_partition.errors import ModelLimitWarning


def square(x, y=0.0):
    return {"square": x * x + y, "both": [x, y]}


def picky(x, refused=3):
    """Fail at one value."""
    if x == refused:
        raise ValueError(f"{x} is refused")
    return float(x)


def mended(x, *, flag):
    """Fail at x = 1 until the file `flag` is there."""
    if x == 1 and not os.path.exists(flag):  # noqa: PTH110
        raise ValueError("no flag")
    return float(x)


def deadly(x):
    """End the process at one value."""
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(5e-3)
    return float(x)


def slow(x, pause=0.05):
    """Return after a pause, with the number of the process."""
    time.sleep(pause)
    return {"x": float(x), "process": os.getpid()}


def warning(x):
    """Warn at even numbers."""
    if x % 2 == 0:
        warnings.warn(f"{x} is even", ModelLimitWarning, stacklevel=1)
    return float(x)
