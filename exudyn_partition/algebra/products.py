"""Products of small matrices with many zeros, multipliers of few rows, and differences of small arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.linalg import lapack

from ..support.arrays import Array, plain
from ..support.compiled import kernels

Matrix: TypeAlias = Array | sp.csr_matrix


def congruence(rows: Array, F: Array, *, threes: bool = False) -> Array:
    """Return rows F rows', (n, n), of rows with many zeros, (n, m), and a symmetric F, (m, m).

    It is faster with `threes`, if three rows each have their zeros in nearly the same places.
    """
    if loops := kernels("algebra", "product_kernels"):
        product: Array = loops.congruence(rows, F, threes)
        return product
    value: Array = rows @ F @ rows.T
    return value


def product(rows: Array, F: Array, *, threes: bool = False) -> Array:
    """Return rows F, (n, k), of rows with many zeros, (n, m), and F, (m, k); `threes` as in `congruence`."""
    if loops := kernels("algebra", "product_kernels"):
        found: Array = loops.sparse_product(np.ascontiguousarray(rows), np.ascontiguousarray(F), threes, False)
        return found
    return np.asarray(rows @ F)


def moved(start: Array, rows: Matrix, way: Array) -> Array:
    """Return start + rows way, (n,), for rows, (n, m)."""
    if isinstance(rows, np.ndarray) and (loops := kernels("algebra", "product_kernels")):
        found: Array = loops.moved(start, rows, plain(way))
        return found
    value: Array = start + rows @ way
    return value


def weighted_rows(weights: Array, rows: Matrix) -> Array:
    """Return the sum of rows, (n, m), times weights, (n,), many of which are zero."""
    if isinstance(rows, np.ndarray) and (loops := kernels("algebra", "product_kernels")):
        found: Array = loops.weighted_rows(weights, rows)
        return found
    value: Array = weights @ rows
    return value


def smallest(values: Array) -> float:
    """Smallest of some values, (n,); infinite if there are none, NaN if one is."""
    if loops := kernels("algebra", "product_kernels"):
        return float(loops.smallest(plain(values)))
    return float(values.min(initial=np.inf))


def largest_change(a: Array, b: Array) -> float:
    """Largest difference of the entries of two arrays of the same shape; NaN if one is."""
    if loops := kernels("algebra", "product_kernels"):
        return float(loops.largest_change(a.ravel(), b.ravel()))
    return float(abs(a - b).max())


def hold_rows(
    C: Array, rest: Array, by: float, push: Array, factor: Array, scale: Array,
    shares: tuple[float, float, float], state: tuple[Array, Array, Array], step: float, dofs: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Push velocities and accelerations by multipliers of rows on some coordinates.

    Parameters
    ----------
    C, push : (n, k), (k, n) arrays
        Rows, and accelerations by unit multipliers.
    rest : (n,) array
    by : float
        Multipliers give the rows the accelerations by (rest + C x).
    factor, scale : (n, n), (n,) arrays
        Lower factor of Cholesky of C push, scaled by `scale` from both sides.
    shares : three floats
        Of coordinates, velocities and accelerations in x.
    state : three (nq,) arrays
        Coordinates, velocities and accelerations; the last two are changed, as `step` [s] of Verlet's method needs it.
    step : float
    dofs : (k,) int array
        Which coordinates the rows are on.

    Returns
    -------
    (n,) array, (k,) array
        Multipliers, and accelerations by them.
    """
    if loops := kernels("algebra", "product_kernels"):
        held: tuple[Array, Array] = loops.hold_rows(C, rest, by, push, factor.T, scale, shares, *state, step, dofs)
        return held
    if not len(rest):  # LAPACK solves no systems without unknowns
        return np.zeros(0), np.zeros(len(dofs))
    parts = (share * values[dofs] for share, values in zip(shares, state, strict=True) if share)
    x = sum(parts, np.zeros(len(dofs)))
    multipliers = scale * lapack.dpotrs(factor, scale * by * (rest + C @ x), lower=1)[0]
    acceleration: Array = push @ multipliers
    state[1][dofs] += 0.5 * step * acceleration
    state[2][dofs] += acceleration
    return multipliers, acceleration


@dataclass(frozen=True)
class Solved:
    """An (n, n) matrix that is an inverse: its products with columns are solutions of equations.

    The inverse itself is computed only for products with more than n columns.

    Parameters
    ----------
    solve : callable
        Solutions, (n, m), for right-hand sides, (n, m).
    n : int
    """

    solve: Callable[[Array], Array]
    n: int

    def __matmul__(self, columns: Matrix) -> Array:
        columns = dense(columns)
        return self.solve(columns) if columns.shape[1] <= self.n else self.toarray() @ columns

    def toarray(self) -> Array:
        """The whole matrix, (n, n)."""
        return self.solve(np.eye(self.n))


def dense(matrix: Matrix | Solved) -> Array:
    """Dense array of a matrix that may be sparse, or an inverse."""
    value: Array = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    return value


def joined(parts: list[Matrix]) -> Matrix:
    """Blocks side by side, (nr, n); csr if all blocks are."""
    return sp.hstack(parts, format="csr") if all(map(sp.issparse, parts)) else np.hstack([*map(dense, parts)])
