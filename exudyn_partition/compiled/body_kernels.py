"""Compiled views of what compiled runs have in long arrays: coordinates of a body."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.compiled import inlined


@inlined
def gathered(dofs: Array, first: int, end: int, values: Array) -> Array:
    """Values of some coordinates, (n,)."""
    result = np.empty(end - first)
    for i in range(end - first):
        result[i] = values[dofs[first + i]]
    return result
