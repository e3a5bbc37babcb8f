"""The loops over nodes of bodies in motion: compiled if numba is there, else by NumPy.

This is the only module of `frames` that knows which. `kernels` beside it has the compiled loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..support.arrays import Array
from ..support.compiled import kernels

if TYPE_CHECKING:
    from .kernels import Fixed


def fixed(start: Array, rows: Array, active: Array) -> Fixed | None:
    """What one compiled call needs to place nodes and more; None where NumPy places nodes in a call of its own.

    Parameters
    ----------
    start, rows, active
        See `kernels.Fixed`.
    """
    if compiled := kernels("frames"):
        value: Fixed = compiled.fixed(start, rows, active, np.full(start.shape, np.nan))
        return value
    return None
