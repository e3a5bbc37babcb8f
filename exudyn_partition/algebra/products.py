"""Products of small matrices with many zeros, and differences of small arrays."""

from __future__ import annotations

from ..support.arrays import Array
from ..support.compiled import kernels


def congruence(rows: Array, F: Array, *, threes: bool = False) -> Array:
    """Return rows F rows', (n, n), of rows with many zeros, (n, m), and a symmetric F, (m, m).

    It is faster with `threes`, if three rows each have their zeros in nearly the same places.
    """
    if loops := kernels("algebra"):
        product: Array = loops.congruence(rows, F, threes)
        return product
    value: Array = rows @ F @ rows.T
    return value


def largest_change(a: Array, b: Array) -> float:
    """Largest difference of the entries of two arrays of the same shape; NaN if one is."""
    if loops := kernels("algebra"):
        return float(loops.largest_change(a.ravel(), b.ravel()))
    return float(abs(a - b).max())
