"""Compiled loops of small dense problems; the modules beside this one do the same by NumPy and LAPACK."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled


@compiled
def check_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, scale: float
) -> tuple[Array, Array, int]:
    """Forces on the active rows, which rows violate their condition, and how many: see `Complementarity.check`.

    Parameters
    ----------
    F : (n, n) array
    factor : (na, na) array
        Transpose of the lower factor of Cholesky of the active part.
    index : (na,) int array
        Active rows.
    h : (n,) array
    rounding, scale : float
        By rounding times scale an inactive row may be violated. A scale of zero is the largest entry of h.
    """
    n, na = len(h), len(index)
    x = np.empty(na)
    for i in range(na):
        x[i] = -h[index[i]]
    for i in range(na):
        x[i] /= factor[i, i]
        for j in range(i + 1, na):
            x[j] -= factor[i, j] * x[i]
    for i in range(na - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, na):
            total -= factor[i, j] * x[j]
        x[i] = total / factor[i, i]
    if scale == 0.0:
        for i in range(n):
            scale = max(scale, abs(h[i]))
    lam, active, wrong = np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    count = 0
    for i in range(na):
        row = index[i]
        active[row] = True
        lam[row] = x[i]
        wrong[row] = x[i] < 0.0
        count += wrong[row]
    for row in range(n):
        if not active[row]:
            w = h[row]
            for i in range(na):
                w += F[row, index[i]] * x[i]
            wrong[row] = w < -rounding * scale
            count += wrong[row]
    return lam, wrong, count


@compiled
def iterate(
    starts: Array, columns: Array, core: Array, a: Array, G: Array, pressed: Array, c: Array, settled: float, steps: int
) -> bool:
    """Iterate c = S (a - G c), see `BlockComplementarity`; each block takes the newest amplitudes of the others.

    Parameters
    ----------
    starts, columns, core : arrays
        S as a csr matrix, (n m, n m).
    a : (n, m) array
    G : (k, m, m) array
        Of the blocks that have forces.
    pressed : (k,) int array
        Numbers of these blocks.
    c : (n, m) array
        A guess; becomes the last iterate.
    settled : float
        Relative change at which c is settled.
    steps : int
        Most passes over all blocks.

    Returns
    -------
    Whether c has settled.
    """
    n, m = c.shape
    forces, place = a.copy(), np.full(n, -1)
    for i in range(len(pressed)):
        place[pressed[i]] = i
    for j in range(n):
        push(forces[j], a[j], G, place[j], c[j])
    flat = forces.ravel()
    for _ in range(steps):
        change = size = 0.0
        for j in range(n):
            for r in range(m):
                total, row = 0.0, m * j + r
                for p in range(starts[row], starts[row + 1]):
                    total += core[p] * flat[columns[p]]
                change, size = max(change, abs(total - c[j, r])), max(size, abs(total))
                c[j, r] = total
            push(forces[j], a[j], G, place[j], c[j])
        if change <= settled * size:
            return True
    return False


@compiled
def push(forces: Array, a: Array, G: Array, place: int, c: Array) -> None:
    """Set forces, (m,), to a - G c of one block; a block with place -1 has none of G."""
    for i in range(len(a)):
        total = a[i]
        if place >= 0:
            for j in range(len(c)):
                total -= G[place, i, j] * c[j]
        forces[i] = total


@compiled
def friction_residual(value: Array, lam: Array, mu: Array) -> tuple[Array, Array, Array, Array, float]:
    """Forces that the law of friction leaves unbalanced, see `friction._ClosedRows.residual`.

    Parameters
    ----------
    value : (3 na,) array
        Gaps and slips, scaled to forces; becomes the unbalanced forces.
    lam : (3 na,) array
    mu : (na,) array

    Returns
    -------
    Trial forces along both tangents, their length, their bound, (na,) each, and the largest unbalanced force.
    """
    n = len(mu)
    x1, x2, length, bound = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    largest = 0.0
    for i in range(n):
        k = 3 * i
        x1[i], x2[i] = lam[k + 1] - value[k + 1], lam[k + 2] - value[k + 2]
        length[i] = np.sqrt(x1[i] * x1[i] + x2[i] * x2[i])
        bound[i] = mu[i] * max(lam[k], 0.0)
        share = min(1.0, bound[i] / (length[i] + 1e-300))
        value[k + 1], value[k + 2] = lam[k + 1] - share * x1[i], lam[k + 2] - share * x2[i]
        largest = max(largest, abs(value[k]), abs(value[k + 1]), abs(value[k + 2]))
    return x1, x2, length, bound, largest


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


@compiled
def congruence(rows: Array, F: Array, threes: bool) -> Array:
    """See `products.congruence`."""
    half = sparse_product(rows, F, threes, False)
    result = sparse_product(rows, np.ascontiguousarray(half.T), threes, True)
    for i in range(len(rows)):
        for j in range(i):
            result[i, j] = result[j, i]
    return result


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
