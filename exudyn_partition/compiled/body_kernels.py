"""Compiled views of what compiled runs have in long arrays: coordinates of a body, and matrices."""

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


@inlined
def matrix_at(numbers: Array, place: int, rows: int, columns: int) -> Array:
    """A matrix among numbers."""
    return numbers[place:][: rows * columns].reshape(rows, columns)
