"""Compiled loops over small arrays; `products` does the same by NumPy."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from ..support.compiled import called, compiled, inlined


@inlined
def matrix_at(numbers: Array, place: int, rows: int, columns: int) -> Array:
    """A matrix among numbers, without a copy."""
    return numbers[place:][: rows * columns].reshape(rows, columns)


@compiled
def add(a: float, f: Array, x: Array) -> None:
    """Add a f to x."""
    for j in range(len(f)):
        x[j] += a * f[j]


@compiled
def add_to_three(a: float, b: float, c: float, f: Array, x: Array, y: Array, z: Array) -> None:
    """Add a f to x, b f to y and c f to z; f is loaded once."""
    for j in range(len(f)):
        x[j] += a * f[j]
        y[j] += b * f[j]
        z[j] += c * f[j]


@compiled
def sparse_product(rows: Array, F: Array, threes: bool, upper: bool) -> Array:
    """Products of rows, (n, m), with F, (m, k), without products with zeros; of a square result the upper half alone.

    With `threes`, three rows each have their zeros in the same places.
    """
    n, m = rows.shape
    result = np.zeros((n, F.shape[1]))
    together = n - n % 3 if threes else 0
    for i in range(0, together, 3):
        start = i if upper else 0
        x, y, z = result[i, start:], result[i + 1, start:], result[i + 2, start:]
        for k in range(m):
            a, b, c = rows[i, k], rows[i + 1, k], rows[i + 2, k]
            if a != 0.0 or b != 0.0 or c != 0.0:
                add_to_three(a, b, c, F[k, start:], x, y, z)
    for i in range(together, n):
        start = i if upper else 0
        for k in range(m):
            if rows[i, k] != 0.0:
                add(rows[i, k], F[k, start:], result[i, start:])
    return result


product = called(sparse_product)


@compiled
def congruence(rows: Array, F: Array, threes: bool) -> Array:
    """See `products.congruence`."""
    half = product(rows, F, threes, False)
    n, m = half.shape
    across = np.empty((m, n))
    for i in range(n):
        for k in range(m):
            across[k, i] = half[i, k]
    result = product(rows, across, threes, True)
    for i in range(len(rows)):
        for j in range(i):
            result[i, j] = result[j, i]
    return result


@compiled
def moved(start: Array, rows: Array, way: Array) -> Array:
    """See `products.moved`."""
    result = np.empty(len(rows))
    for i in range(len(rows)):
        total = 0.0
        for k in range(len(way)):
            total += rows[i, k] * way[k]
        result[i] = start[i] + total
    return result


@compiled
def weighted_rows(weights: Array, rows: Array) -> Array:
    """See `products.weighted_rows`."""
    result = np.zeros(rows.shape[1])
    for i in range(len(rows)):
        weight = weights[i]
        if weight != 0.0:
            for k in range(len(result)):
                result[k] += weight * rows[i, k]
    return result


@compiled
def hold_rows(
    C: Array, rest: Array, by: float, push: Array, upper: Array, scale: Array, shares: tuple[float, float, float],
    q: Array, q_t: Array, q_tt: Array, step: float, dofs: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """See `products.hold_rows`; `upper` is the transpose of the factor."""
    n, k = C.shape
    x, multipliers, acceleration = np.empty(k), np.empty(n), np.empty(k)
    for j in range(k):
        i = dofs[j]
        x[j] = shares[0] * q[i] + shares[1] * q_t[i] + shares[2] * q_tt[i]
    for i in range(n):
        total = rest[i]
        for j in range(k):
            total += C[i, j] * x[j]
        multipliers[i] = scale[i] * by * total
    for i in range(n):
        multipliers[i] /= upper[i, i]
        for j in range(i + 1, n):
            multipliers[j] -= upper[i, j] * multipliers[i]
    for i in range(n - 1, -1, -1):
        total = multipliers[i]
        for j in range(i + 1, n):
            total -= upper[i, j] * multipliers[j]
        multipliers[i] = total / upper[i, i]
    for i in range(n):
        multipliers[i] *= scale[i]
    for j in range(k):
        total = 0.0
        for i in range(n):
            total += push[j, i] * multipliers[i]
        acceleration[j] = total
        q_t[dofs[j]] += 0.5 * step * total
        q_tt[dofs[j]] += total
    return multipliers, acceleration


@compiled
def smallest(values: Array) -> float:
    """See `products.smallest`."""
    least, total = np.inf, 0.0
    for i in range(len(values)):
        least, total = min(least, values[i]), total + values[i]
    return least if total == total else math.nan


@compiled
def largest_change(a: Array, b: Array) -> float:
    """See `products.largest_change`."""
    largest = 0.0
    for i in range(len(a)):
        change = abs(a[i] - b[i])
        if not change <= largest:  # NaN stays
            largest = change
        if largest != largest:
            break
    return largest
