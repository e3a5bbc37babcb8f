"""Products of small matrices with many zeros."""

from __future__ import annotations

from ..support.arrays import Array
from ..support.compiled import kernels


def congruence(rows: Array, F: Array) -> Array:
    """Return rows F rows', (n, n), of rows with many zeros, (n, m), and a symmetric F, (m, m)."""
    if loops := kernels("algebra"):
        product: Array = loops.congruence(rows, F)
        return product
    value: Array = rows @ F @ rows.T
    return value
