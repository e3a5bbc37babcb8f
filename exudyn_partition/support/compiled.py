"""Inner loops that numba compiles, if it is installed; without it the same is done by NumPy.

The modules named `kernels`, or like `moving_kernels`, hold these loops. They are imported only where `compiles` is
true, because numba takes long to load. Compiled code is kept on disk, beside the modules or in the user's folder for
caches, so that only the first process waits for the compiler. It is made again if its module changes, but not if a loop
of another module does that it calls: then delete it. NUMBA_CACHE_DIR names another folder, NUMBA_DISABLE_JIT=1 switches
compiling off.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import TypeVar

F = TypeVar("F", bound=Callable[..., object])

_OPTIONS = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "nsz"}}  # sums in any order; NaN stays NaN


@cache
def compiles() -> bool:
    """Whether inner loops are compiled."""
    try:
        numba = importlib.import_module("numba")
    except ImportError:  # it may be there, but miss a library, or not fit NumPy
        return False
    return not numba.config.DISABLE_JIT


@cache
def kernels(layer: str, module: str = "kernels") -> ModuleType | None:
    """Compiled loops of a layer of this package; None if they are not compiled."""
    return importlib.import_module(f"..{layer}.{module}", __package__) if compiles() else None


def compiled(function: F) -> F:
    """Return the function, which is compiled when it is called first, for the types of its arguments."""
    return _compiled(function, **_OPTIONS)


def inlined(function: F) -> F:
    """Return a compiled function whose code is put where it is called: calls with arrays cost more than small sums."""
    return _compiled(function, forceinline=True, **_OPTIONS)


def _compiled(function: F, **options: object) -> F:
    njit = importlib.import_module("numba").njit
    try:
        result: F = njit(cache=True, **options)(function)
    except RuntimeError:  # no folder can be written to
        result = njit(**options)(function)
    return result
