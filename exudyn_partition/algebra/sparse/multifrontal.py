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
TWO_THREADS_FROM = 2_000_000  # entries of factors; for fewer a second thread is not worth its start
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
        self._order, self._children = fronts.order, fronts.children
        matrix = _ordered(matrix, self._order)
        spans = [slice(*bounds) for bounds in pairwise(fronts.starts.tolist())]
        sizes = [(rows.stop - rows.start, len(below)) for rows, below in zip(spans, fronts.below, strict=True)]
        begins = np.cumsum([0, *(k * (k + m) for k, m in sizes)])
        # In one piece, pages of which are taken when they are written: the memory of updates stays whole.
        dtype = np.float32 if single else np.float64
        self._store = store = np.zeros(begins[-1], dtype)
        self._signs = np.ones(len(self._order), dtype)
        updates: dict[int, Array] = {}
        factors: dict[int, _Factor] = {}

        def eliminate(numbers: Array) -> None:
            place = np.full(len(self._order), -1)
            for front in numbers.tolist():
                rows, changes, (k, m), begin = spans[front], fronts.below[front], sizes[front], begins[front]
                own = store[begin : begin + k * k].reshape((k, k), order="F")
                below = store[begin + k * k : begin + k * (k + m)].reshape((m, k), order="F")
                place[rows], place[changes] = np.arange(k), np.arange(k, k + m)
                _put(matrix, rows, place, own, below)
                update = np.zeros((m, m), dtype, order="F")
                for child in fronts.children[front]:
                    _add(updates.pop(child), place[fronts.below[child]], own, below, update)
                place[rows] = place[changes] = -1
                if (signs := _eliminate(own, below, update)) is not None:
                    self._signs[rows] = signs
                factors[front] = _Factor(rows, changes, own, signs, below)
                updates[front] = update
                del update

        # Without compiled loops, threads would wait for each other.
        self._parts = fronts.parts if kernels("algebra.sparse") and len(store) >= TWO_THREADS_FROM else None
        if self._parts is None:
            eliminate(np.arange(len(spans)))
        else:
            first, second, last = self._parts
            with ThreadPoolExecutor(1) as second_core:
                beside = second_core.submit(eliminate, second)
                eliminate(first)
                beside.result()
            eliminate(last)
        self._factors = [factors[front] for front in range(len(spans))]
        ends = np.cumsum([0, *(len(changes) for changes in fronts.below)])
        self._places = begins, fronts.starts, ends, np.concatenate(fronts.below)
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

    def solve(self, rhs: Array) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides; these in blocks."""
        if rhs.ndim == 1:
            return self.solve(rhs[:, None])[:, 0]
        result, n = np.empty(rhs.shape, order="F"), rhs.shape[1]
        bounds = np.linspace(0, n, -(-n // _BLOCK) + 1).astype(int)
        for block in (slice(*bounds) for bounds in pairwise(bounds.tolist())):
            x = self._in_order(rhs[:, block])
            self._push(x)
            self._pull(x)
            result[self._order, block] = x.reshape(len(x), -1)
        return result

    def energies(self, rhs: Array) -> Array:
        """B' A^-1 B, (k, k), of the matrix A for many right-hand sides B, (n, k), without substitution back."""
        x = self._in_order(rhs)
        self._push(x)
        x = x.reshape(len(x), -1)
        result: Array = x.T @ (self._signs[:, None] * x)
        return result

    def _in_order(self, rhs: Array) -> Array:
        """Right-hand sides in order of elimination, (n, k); of a single one a vector, which is quicker."""
        x = np.array(rhs[self._order], self._store.dtype, order="C")
        return x[:, 0] if x.shape[1] == 1 else x

    def _push(self, x: Array) -> None:
        """Eliminate right-hand sides in order of elimination, in place."""
        if (loops := kernels("algebra.sparse")) is None:
            for rows, changes, inverse, _, below in self._factors:
                x[rows] = inverse @ x[rows]
                x[changes] -= below @ x[rows]
            return
        if self._parts is None:
            self._go(loops.push, x, np.arange(len(self._factors)))
            return
        first, second, last = self._parts
        own, shared = self._rows(second), self._rows(last)
        beside = x.copy()  # so that no two threads change a row at once
        beside[shared] = 0.0
        with ThreadPoolExecutor(1) as second_core:
            pushed = second_core.submit(self._go, loops.push, beside, second)
            self._go(loops.push, x, first)
            pushed.result()
        x[own] = beside[own]
        x[shared] += beside[shared]
        self._go(loops.push, x, last)

    def _pull(self, x: Array) -> None:
        """Solve for right-hand sides that are eliminated, in place."""
        if (loops := kernels("algebra.sparse")) is None:
            for rows, changes, inverse, signs, below in reversed(self._factors):
                own = x[rows] if signs is None else (signs * x[rows].T).T
                x[rows] = inverse.T @ (own - below.T @ x[changes])
            return
        if self._parts is None:
            self._go(loops.pull, x, np.arange(len(self._factors)), self._signs)
            return
        first, second, last = self._parts
        self._go(loops.pull, x, last, self._signs)
        with ThreadPoolExecutor(1) as second_core:
            pulled = second_core.submit(self._go, loops.pull, x, second, self._signs)
            self._go(loops.pull, x, first, self._signs)
            pulled.result()

    def _go(self, loop: Callable[..., None], x: Array, fronts: Array, *more: Array) -> None:
        """Run a compiled loop over some fronts."""
        loop(x, self._store, *self._places, fronts, *more)

    def _rows(self, fronts: Array) -> Array:
        """Rows that some fronts eliminate, in order of elimination."""
        chosen = np.zeros(len(self._factors), dtype=bool)
        chosen[fronts] = True
        return np.flatnonzero(np.repeat(chosen, np.diff(self._places[1])))

    def inverse_at(self, rows: sp.csr_matrix) -> Array:
        """R A^-1 R', (r, r), of the matrix A for sparse rows R, (r, n).

        Only fronts that a row reaches take part for it, and there is no substitution back.
        """
        entries, n_fronts = rows.tocoo(), len(self._factors)
        rank = np.empty(len(self._order), dtype=np.int64)
        rank[self._order] = np.arange(len(rank))
        at, front = rank[entries.col], np.repeat(np.arange(n_fronts), np.diff(self._places[1]))[rank[entries.col]]
        sort = np.argsort(front, kind="stable")
        at, number, value = at[sort], entries.row[sort], entries.data[sort]
        bounds = np.searchsorted(front[sort], np.arange(n_fronts + 1))
        result = np.zeros((rows.shape[0],) * 2)
        place = np.empty(len(self._order), dtype=np.int64)
        left: dict[int, tuple[Array, Array]] = {}  # by a front on the rows that it changes, and for which of R
        for front, (span, changes, inverse, signs, below) in enumerate(self._factors):
            own, before = slice(*bounds[front : front + 2]), [c for c in self._children[front] if c in left]
            some = np.unique(np.concatenate([number[own], *(left[child][0] for child in before)]))
            if not len(some):
                continue
            k, m = len(inverse), len(changes)
            place[span], place[changes] = np.arange(k), np.arange(k, k + m)
            x = np.zeros((k + m, len(some)))
            np.add.at(x, (place[at[own]], np.searchsorted(some, number[own])), value[own])
            for child in before:
                theirs, pushed = left.pop(child)
                x[np.ix_(place[self._factors[child].changes], np.searchsorted(some, theirs))] += pushed
            y = inverse @ x[:k]
            left[front] = some, x[k:] - below @ y
            result[np.ix_(some, some)] += y.T @ y if signs is None else y.T @ (signs[:, None] * y)
        return result

    @property
    def nnz(self) -> int:
        """Number of entries of one triangular factor."""
        return sum(len(inverse) * (len(inverse) + 1) // 2 + below.size for _, _, inverse, _, below in self._factors)

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia)."""
        return sum(int(np.count_nonzero(f.signs < 0)) for f in self._factors if f.signs is not None)


def _ordered(matrix: sp.csr_matrix, order: Array) -> sp.csr_matrix:
    """Rows and columns of a matrix in another order, (n,) int array."""
    rank = np.empty(len(order), dtype=matrix.indices.dtype)
    rank[order] = np.arange(len(order))
    rows = matrix[order]
    return sp.csr_matrix((rows.data, rank[rows.indices], rows.indptr), shape=matrix.shape)


def _put(matrix: sp.csr_matrix, rows: slice, place: Array, own: Array, below: Array) -> None:
    """Write the upper triangle of some rows of a matrix to a front, as columns."""
    starts, k = matrix.indptr[rows.start : rows.stop + 1], len(own)
    if loops := kernels("algebra.sparse"):
        complete = loops.put(starts, matrix.indices, matrix.data, rows.start, place, own.T, below.T)
    else:
        entries, column = slice(starts[0], starts[-1]), np.repeat(np.arange(k), np.diff(starts))
        upper = matrix.indices[entries] >= rows.start + column
        row, column, values = place[matrix.indices[entries][upper]], column[upper], matrix.data[entries][upper]
        complete, inside = row.min(initial=0) >= 0, row < k
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
