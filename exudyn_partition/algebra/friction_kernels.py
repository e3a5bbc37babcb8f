"""Compiled loops of contact with friction; `friction` does the same by NumPy and LAPACK."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled


@compiled
def friction_residual(places: Array, lam: Array, mu: Array) -> tuple[Array, Array, Array, Array, Array, float]:
    """Forces that the law of friction leaves unbalanced, see `closed_rows.ClosedRows.residual`.

    Parameters
    ----------
    places : (3 na,) array
        h + F lambda, scaled to forces.
    lam : (3 na,) array
    mu : (na,) array

    Returns
    -------
    Unbalanced forces, (3 na,), trial forces along both tangents, their length, their bound, (na,) each, and the largest
    unbalanced force.
    """
    n = len(mu)
    x1, x2, length, bound = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    value, largest = places.copy(), 0.0
    for i in range(n):
        k = 3 * i
        x1[i], x2[i] = lam[k + 1] - value[k + 1], lam[k + 2] - value[k + 2]
        length[i] = np.sqrt(x1[i] * x1[i] + x2[i] * x2[i])
        bound[i] = mu[i] * max(lam[k], 0.0)
        share = min(1.0, bound[i] / (length[i] + 1e-300))
        value[k + 1], value[k + 2] = lam[k + 1] - share * x1[i], lam[k + 2] - share * x2[i]
        largest = max(largest, abs(value[k]), abs(value[k + 1]), abs(value[k + 2]))
    return value, x1, x2, length, bound, largest


@compiled
def chord_step(
    factors: Array, pivots: Array, value: Array, moves: Array, squares: Array, count: int
) -> tuple[Array, float]:
    """Newton step by LU factors of LAPACK, transposed, corrected by the steps before, see `ClosedRows.step`.

    It is kept in `moves`, and returned with its largest entry.
    """
    n, x = len(value), -value
    for j in range(n):
        x[j], x[pivots[j]] = x[pivots[j]], x[j]
    for j in range(n):
        for i in range(j + 1, n):
            x[i] -= factors[j, i] * x[j]
    for j in range(n - 1, -1, -1):
        x[j] /= factors[j, j]
        for i in range(j):
            x[i] -= factors[j, i] * x[j]
    for m in range(count):
        share = 0.0
        for i in range(n):
            share += moves[m, i] * x[i]
        share /= squares[m]
        for i in range(n):
            x[i] = x[i] + share * moves[m + 1, i] if m + 1 < count else x[i] / (1.0 - share)
    square, largest = 0.0, 0.0
    for i in range(n):
        moves[count, i] = x[i]
        square += x[i] * x[i]
        largest = max(largest, abs(x[i]))
    squares[count] = square
    return x, largest
