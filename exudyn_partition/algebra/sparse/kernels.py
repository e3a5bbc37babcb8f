"""Compiled loops of the factorisation by fronts; module `multifrontal` does the same by NumPy."""

from __future__ import annotations

from ...support.arrays import Array
from ...support.compiled import compiled


@compiled
def add(change: Array, place: Array, own: Array, below: Array, update: Array) -> None:
    """Add what a child leaves to its places in the front; all arrays but `place` are transposed, with rows in order.

    Parameters
    ----------
    change : (c, c) array
        Its upper triangle counts.
    place : (c,) int array
        Ascending.
    own, below, update : (k, k), (k, m), (m, m) arrays
    """
    k, c = len(own), len(place)
    for i in range(c):
        row = place[i]
        if row < k:
            for j in range(i, c):
                if place[j] < k:
                    own[row, place[j]] += change[i, j]
                else:
                    below[row, place[j] - k] += change[i, j]
        else:
            for j in range(i, c):
                update[row - k, place[j] - k] += change[i, j]
