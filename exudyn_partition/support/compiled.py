"""Inner loops that numba compiles, if it is installed; without it the same is done by NumPy.

The modules named `kernels`, or like `moving_kernels`, hold these loops. Beside them, a module `loops` is the door to
them: it alone asks whether they are there, and does the same by NumPy if not. They are imported when one of them is
called first, because numba takes long to load. Compiled code is kept on disk, beside the modules or in the user's
folder for caches, so that only the first process waits for the compiler. Beside the modules it is made again if any of
them changes; in another folder, only if its own module does. NUMBA_CACHE_DIR names such a folder, NUMBA_DISABLE_JIT=1
switches compiling off.

A loop that others call a few times a step is `inner`, or is called by what `called` returns: it is compiled once, not
again in each of them. Small ones that are called for each entry are `inlined`.

Loops write arrays entry by entry: `a[:] = b` brings code that tells of other shapes in words, seconds to compile.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from .progress import say

F = TypeVar("F", bound=Callable[..., object])

_PACKAGE = Path(__file__).parents[1]
_DOOR = {"no_cfunc_wrapper": True}  # nobody calls loops from C
_NO_DOOR = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
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
    """Compiled loops of a layer of this package; None if they are not compiled. Only doors call it."""
    if not compiles():
        return None
    forget_stale(_PACKAGE)
    return importlib.import_module(f"..{layer}.{module}", __package__)


@cache
def forget_stale(folder: Path) -> None:
    """Delete compiled code beside the modules that is older than one of them, once a process.

    numba compares it with its own module only, and loops of other modules may be part of it.
    """
    changed = max((module.stat().st_mtime for module in folder.rglob("*kernels.py")), default=0.0)
    for index in folder.rglob("__pycache__/*kernels.*.nbi"):
        with contextlib.suppress(OSError):  # another process may delete it too, or a user must not
            if index.stat().st_mtime < changed:
                index.unlink()


def compiled(function: F) -> F:
    """Return the function, which is compiled when it is called first, for the types of its arguments."""
    return _compiled(function, **_OPTIONS, **_DOOR)


def unlocked(function: F) -> F:
    """Return a compiled function that lets other Python threads run; for loops that take long."""
    return _compiled(function, nogil=True, **_OPTIONS, **_DOOR)


def inner(function: F) -> F:
    """Return a compiled function that only other loops call, see `call_kernels.called`."""
    return called(_compiled(function, **_OPTIONS, **_NO_DOOR))


def exact(function: F) -> F:
    """Return a function for other loops whose sums are made in the order in which they are written, rounded each."""
    return _compiled(function, error_model="numpy", **_NO_DOOR)


def inlined(function: F) -> F:
    """Return a function for other loops whose code is put into theirs: calls with arrays cost more than small sums."""
    put_in: Callable[[F], F] = importlib.import_module(".call_kernels", __package__).put_in
    return put_in(_compiled(function, forceinline=True, **_OPTIONS, **_NO_DOOR))


def called(function: F) -> F:
    """Return what other loops call a `compiled` function by where its code must not become part of theirs."""
    call: Callable[[F], F] = importlib.import_module(".call_kernels", __package__).called
    return call(function)


def external(module: str, name: str, n_arguments: int) -> Callable[..., None]:
    """Return a function of SciPy's BLAS or LAPACK that compiled loops can call, with addresses of its arguments.

    Parameters
    ----------
    module : str
        `cython_blas` or `cython_lapack`.
    name : str
    n_arguments : int
    """
    types = importlib.import_module("numba.core.types")
    address = importlib.import_module("numba.extending").get_cython_function_address(f"scipy.linalg.{module}", name)
    # By a name, which code on disk can hold; addresses are others in each process.
    importlib.import_module("llvmlite.binding").add_symbol(f"exudyn_partition_{name}", address)
    found: Callable[..., None] = types.ExternalFunction(
        f"exudyn_partition_{name}", types.void(*[types.intp] * n_arguments)
    )
    return found


@cache
def _tell_of_compiling() -> None:
    """Let the first loop that numba compiles in this process be told; code that is read from disk is not compiled.

    Meanwhile garbage is not collected: the compiler makes many objects and lets few of them go, so that to look for
    garbage again and again takes a good part of its time.
    """
    events, ours = importlib.import_module("numba.core.event"), __name__.partition(".")[0]
    told, collects = False, list[bool]()  # whether garbage was collected before each loop that is being compiled

    def on_start(listener: object, event: Any) -> None:
        nonlocal told
        module = getattr(event.data["dispatcher"].py_func, "__module__", None) or ""
        of_library = module.partition(".")[0] == ours
        collects.append(of_library and gc.isenabled())
        if of_library:
            gc.disable()
        if of_library and not told:
            told = True
            say(f"{ours}: numba compiles inner loops, which may take a minute; later runs find them on disk")

    def on_end(listener: object, event: Any) -> None:
        if collects.pop():
            gc.enable()

    listener = type("Listener", (events.Listener,), {"on_start": on_start, "on_end": on_end})
    events.register("numba:compile", listener())


def _compiled(function: F, **options: object) -> F:
    _tell_of_compiling()
    njit = importlib.import_module("numba").njit
    try:
        result: F = njit(cache=True, **options)(function)
    except RuntimeError:  # no folder can be written to
        result = njit(**options)(function)
    return result
