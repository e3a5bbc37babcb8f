"""Threads of BLAS."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator

from threadpoolctl import ThreadpoolController

_LIMITING = threading.Lock()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context or decorator in which BLAS uses one thread: most fronts are too small for more.

    The limit is one of the whole process. The first thread that enters sets it and lifts it. Threads that enter
    meanwhile leave it alone; otherwise they would set it again when they leave.
    """
    if not _LIMITING.acquire(blocking=False):
        yield
        return
    try:
        libraries = _libraries()
        if all(library.num_threads == 1 for library in libraries.lib_controllers):  # as workers of a study have it
            yield
            return
        with libraries.limit(limits=1):
            yield
    finally:
        _LIMITING.release()


@functools.cache  # a search takes milliseconds; NumPy and SciPy, whose BLAS the library calls, are loaded by then
def _libraries() -> ThreadpoolController:
    """Libraries of BLAS that the process has loaded."""
    return ThreadpoolController().select(user_api="blas")
