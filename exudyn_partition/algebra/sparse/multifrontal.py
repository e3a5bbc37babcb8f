"""Factors of a sparse symmetric matrix by fronts: dense blocks that BLAS and LAPACK work on.

Theory: I. S. Duff, J. K. Reid, The multifrontal solution of indefinite sparse symmetric linear equations, ACM
Transactions on Mathematical Software 9, 1983.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.linalg import blas, lapack

from ...errors import IndefiniteMatrixError
from ...support.arrays import Array
from ...support.compiled import kernels
from .fronts import Fronts, find_fronts

_BLOCK = 96  # most right-hand sides that go through the fronts together
_FEW = 4  # so few are solved for one by one
_ACCURATE = 1e-6  # relative residual of a solution; 1e-12 and less is usual


class _Factor(NamedTuple):
    """What a front leaves: with C = inverse^-1, its rows of the matrix are [C; below] diag(signs) [C; below]'.

    Parameters
    ----------
    rows : slice
        What it eliminates, in order of elimination.
    changes : (m,) int array
        Rows beyond them.
    inverse : (k, k) array
    signs : (k,) array or None
        None if all are 1.
    below : (m, k) array
    """

    rows: slice
    changes: Array
    inverse: Array
    signs: Array | None
    below: Array


class Analysis:
    """Fronts for several matrices, found when they are needed first.

    Parameters
    ----------
    pattern : function
        Makes a csr matrix of symmetric pattern, (n, n), with entries wherever one of those matrices has them.
    """

    def __init__(self, pattern: Callable[[], sp.csr_matrix]) -> None:
        self._pattern = pattern

    @cached_property
    def fronts(self) -> Fronts:
        """The fronts."""
        return find_fronts(self._pattern())


class Factorisation:
    """Block factors C S C' of a sparse symmetric matrix, with S of ones and minus ones; one triangle is stored.

    Fronts that are positive definite are factorised by Cholesky, others by Bunch and Kaufman. Pivots are exchanged
    within a front only. That need not be accurate where the matrix is indefinite, so that one solution is checked then.
    Any thread may solve.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        Symmetric. A function makes it, so that it is gone before the factors need the memory.
        It is positive definite, or shifted to between two eigenvalues.
    analysis : Analysis, optional
        Keeps what the places of the entries tell, for other matrices with entries in the same places.
    single : bool
        Factors in single precision, of a positive definite matrix: half of the memory, and quicker solutions.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular, or the factors are not accurate; in single precision, if a pivot is not positive.
    """

    def __init__(
        self,
        matrix: sp.spmatrix | Callable[[], sp.spmatrix],
        analysis: Analysis | None = None,
        *,
        single: bool = False,
    ) -> None:
        given = matrix
        matrix = sp.csr_matrix(given() if callable(given) else given)
        fronts = find_fronts(matrix) if analysis is None else analysis.fronts
        self._order, n = fronts.order, len(fronts.order)
        matrix = _upper(matrix, self._order)
        spans = [slice(*bounds) for bounds in pairwise(fronts.starts.tolist())]
        sizes = [(rows.stop - rows.start, len(below)) for rows, below in zip(spans, fronts.below, strict=True)]
        # In one piece, pages of which are taken when they are written: the memory of updates stays whole.
        dtype = np.float32 if single else np.float64
        self._store = store = np.zeros(sum(k * (k + m) for k, m in sizes), dtype)
        self._signs = np.ones(n, dtype)
        place, begin = np.full(n, -1), 0
        updates: list[tuple[Array, Array]] = []
        self._factors: list[_Factor] = []
        for rows, (k, m), changes, count in zip(spans, sizes, fronts.below, fronts.n_children, strict=True):
            own = store[begin : begin + k * k].reshape((k, k), order="F")
            below = store[begin + k * k : begin + k * (k + m)].reshape((m, k), order="F")
            begin += k * (k + m)
            place[rows], place[changes] = np.arange(k), np.arange(k, k + m)
            _put(matrix, rows, place, own, below)
            update = np.zeros((m, m), dtype, order="F")
            for _ in range(count):
                child, change = updates.pop()
                _add(change, place[child], own, below, update)
                del change
            place[rows] = place[changes] = -1
            if (signs := _eliminate(own, below, update)) is not None:
                self._signs[rows] = signs
            self._factors.append(_Factor(rows, changes, own, signs, below))
            updates.append((changes, update))
            del update
        ends = np.cumsum([0, *(len(changes) for changes in fronts.below)])
        self._places = fronts.starts, ends, np.concatenate(fronts.below)
        if any(factor.signs is not None for factor in self._factors):
            self._check(given() if callable(given) else given)

    def _check(self, matrix: sp.spmatrix) -> None:
        """Refuse factors that do not solve the equations of a matrix that is not positive definite."""
        rhs = matrix @ np.random.default_rng(0).standard_normal(matrix.shape[0])
        residual = float(np.linalg.norm(matrix @ self.solve(rhs) - rhs) / np.linalg.norm(rhs))
        if not residual < _ACCURATE:
            raise IndefiniteMatrixError(
                f"the matrix cannot be factorised: a solution leaves {residual:.2g} of its right-hand side, expected "
                f"at most {_ACCURATE:g}. If it is shifted, take another shift"
            )

    def solve(self, rhs: Array, threads: int = 2) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides; these in blocks, `threads` of them at a time.

        A few go through compiled loops one by one: blocks pay for the calls from Python by their width.
        """
        if rhs.ndim == 1:
            return self.solve(rhs[:, None])[:, 0]
        result = np.empty(rhs.shape, order="F")
        if rhs.shape[1] <= _FEW and (loops := kernels("algebra.sparse")):
            for one, answer in zip(rhs.T, result.T, strict=True):
                x = one[self._order].astype(self._store.dtype)
                loops.solve(x, self._store, *self._places, self._signs)
                answer[self._order] = x
            return result

        def solve_block(block: slice) -> None:
            x = np.array(rhs[self._order, block], self._store.dtype, order="C")
            x = x[:, 0] if x.shape[1] == 1 else x  # vectors are quicker
            for rows, changes, inverse, _, below in self._factors:
                x[rows] = inverse @ x[rows]
                x[changes] -= below @ x[rows]
            for rows, changes, inverse, signs, below in reversed(self._factors):
                own = x[rows] if signs is None else (signs * x[rows].T).T
                x[rows] = inverse.T @ (own - below.T @ x[changes])
            result[self._order, block] = x.reshape(len(x), -1)

        n = rhs.shape[1]
        count = min(n, threads * -(-n // (threads * _BLOCK)))
        bounds = np.linspace(0, n, count + 1).astype(int).tolist()
        with ThreadPoolExecutor(threads) as pool:  # products of NumPy let other threads run
            list(pool.map(solve_block, map(slice, bounds[:-1], bounds[1:])))
        return result

    @property
    def nnz(self) -> int:
        """Number of entries of one triangular factor."""
        return sum(len(inverse) * (len(inverse) + 1) // 2 + below.size for _, _, inverse, _, below in self._factors)

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia)."""
        return sum(int(np.count_nonzero(f.signs < 0)) for f in self._factors if f.signs is not None)


def _upper(matrix: sp.csr_matrix, order: Array) -> sp.csr_matrix:
    """Upper triangle of a symmetric matrix with rows and columns in another order, (n,) int array."""
    rank = np.empty(len(order), dtype=matrix.indices.dtype)
    rank[order] = np.arange(len(order))
    rows, columns = np.repeat(rank, np.diff(matrix.indptr)), rank[matrix.indices]
    upper = rows <= columns
    return sp.csr_matrix((matrix.data[upper], (rows[upper], columns[upper])), shape=matrix.shape)


def _put(matrix: sp.csr_matrix, rows: slice, place: Array, own: Array, below: Array) -> None:
    """Write the entries of some rows of an upper triangle to a front, as columns."""
    starts, k = matrix.indptr[rows.start : rows.stop + 1], len(own)
    if loops := kernels("algebra.sparse"):
        complete = loops.put(starts, matrix.indices, matrix.data, place, own.T, below.T)
    else:
        entries = slice(starts[0], starts[-1])
        row, column = place[matrix.indices[entries]], np.repeat(np.arange(k), np.diff(starts))
        complete, inside, values = row.min(initial=0) >= 0, row < k, matrix.data[entries]
        own[row[inside], column[inside]] = values[inside]
        below[row[~inside] - k, column[~inside]] = values[~inside]
    if not complete:
        raise ValueError("analysis: expected fronts of all entries of the matrix, got those of another one")


def _add(change: Array, place: Array, own: Array, below: Array, update: Array) -> None:
    """Add what a child leaves, (c, c), to its places in the front, (c,) int array; only lower triangles count."""
    # Transposed, the entries of a row lie one behind the other.
    change, own, below, update = change.T, own.T, below.T, update.T
    if loops := kernels("algebra.sparse"):
        loops.add(change, place, own, below, update)
        return
    inside = int(np.searchsorted(place, len(own)))
    mine, others = place[:inside], place[inside:] - len(own)
    _add_at(own, mine, mine, change[:inside, :inside])
    _add_at(below, mine, others, change[:inside, inside:])
    _add_at(update, others, others, change[inside:, inside:])


def _add_at(target: Array, rows: Array, columns: Array, values: Array) -> None:
    """Do `target[np.ix_(rows, columns)] += values` for a contiguous array, which is quicker by flat indices."""
    flat, entries = target.reshape(-1), (rows[:, None] * target.shape[1] + columns).ravel()
    flat.put(entries, flat.take(entries) + values.ravel())


def _eliminate(own: Array, below: Array, update: Array) -> Array | None:
    """Factorise a front in place: `own` becomes the inverse of its factor; return signs, see `_Factor`.

    Raises
    ------
    IndefiniteMatrixError
        If it is singular, or not positive definite in single precision.
    """
    loops = kernels("algebra.sparse")
    definite = loops.eliminate(own.T, below.T, update.T) if loops else _eliminate_definite(own, below, update)
    if definite:
        return None
    if own.dtype == np.float32:
        raise IndefiniteMatrixError("the matrix is not positive definite in single precision")
    own[:], signs = _indefinite(own)
    below[:] = below @ (own.T * signs)
    update -= (below * signs) @ below.T
    return signs


def _eliminate_definite(own: Array, below: Array, update: Array) -> bool:
    """Do so by Cholesky; whether it is positive definite. If not, nothing has changed."""
    potrf, trtri = lapack.get_lapack_funcs(("potrf", "trtri"), (own,))
    trsm, syrk = blas.get_blas_funcs(("trsm", "syrk"), (own,))
    factor, indefinite = potrf(own, lower=1)
    if indefinite:
        return False
    if len(below):
        trsm(1.0, factor, below, side=1, lower=1, trans_a=1, overwrite_b=1)
        syrk(-1.0, below, beta=1.0, c=update, lower=1, overwrite_c=1)
    own[:] = trtri(factor, lower=1, overwrite_c=1)[0]
    return True


def _indefinite(matrix: Array) -> tuple[Array, Array]:
    """Inverse of C, and S, of C S C' = matrix, (k, k), whose lower triangle is given.

    Raises
    ------
    IndefiniteMatrixError
        If it is singular.
    """
    factor, blocks, order = scipy.linalg.ldl(matrix, check_finite=False)
    inverse = np.empty_like(matrix)
    inverse[:, order] = lapack.dtrtri(factor[order], lower=1, unitdiag=1)[0]
    values, second = blocks.diagonal().copy(), np.flatnonzero(blocks.diagonal(-1)) + 1
    for pair in np.column_stack([second - 1, second]):
        values[pair], turn = np.linalg.eigh(blocks[np.ix_(pair, pair)])
        inverse[pair] = turn.T @ inverse[pair]
    if not (abs(values) > 0).all():
        raise IndefiniteMatrixError(f"the matrix cannot be factorised: {np.count_nonzero(values == 0)} pivots are zero")
    return inverse / np.sqrt(abs(values))[:, None], np.sign(values)
