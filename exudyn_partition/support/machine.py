"""Memory and cores that this process may use."""

from __future__ import annotations

import contextlib
import ctypes
import math
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

_HERE = threading.local()
_LOOKS = 5  # at what runs: others wake up for a moment


def available_memory() -> tuple[float, float]:
    """Free memory, and the most that this process may have [bytes]; infinite if the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        about = {line.split(":")[0]: 1024.0 * int(line.split()[1]) for line in lines}
        free, most = about["MemAvailable"], about["MemTotal"]
    except (OSError, KeyError, ValueError, IndexError):
        return math.inf, math.inf
    limit = _address_space()
    return min(free, limit), min(most, limit)


def give_memory_back() -> None:
    """Return memory that is free within this process to the system; only the C library of GNU needs to be asked."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)


@contextlib.contextmanager
def beside_other_work() -> Iterator[None]:
    """Take one core in this thread meanwhile, where others could be taken too: they have other work."""
    _HERE.busy = True
    try:
        yield
    finally:
        _HERE.busy = False


def others_busy() -> bool:
    """Whether this thread is `beside_other_work`."""
    return getattr(_HERE, "busy", False)


def alone() -> bool:
    """Whether nothing else runs all the time now; False if the system does not tell."""
    if others_busy():
        return False
    try:
        for _ in range(_LOOKS):
            running, _ = Path("/proc/loadavg").read_text().split()[3].split("/")
            if int(running) <= 1:
                return True
            time.sleep(1e-3)
    except (OSError, ValueError, IndexError):
        pass
    return False


def _address_space() -> float:
    """What `ulimit -v` allows [bytes]."""
    if sys.platform == "win32":
        return math.inf
    import resource

    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    return math.inf if soft == resource.RLIM_INFINITY else float(soft)
