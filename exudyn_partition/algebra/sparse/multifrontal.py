"""Factors of a sparse symmetric matrix by fronts: dense blocks that BLAS and LAPACK work on.

Theory: I. S. Duff, J. K. Reid, The multifrontal solution of indefinite sparse symmetric linear equations, ACM
Transactions on Mathematical Software 9, 1983.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from threading import Lock
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.linalg import lapack

from ...errors import IndefiniteMatrixError
from ...support.arrays import Array
from ...support.checks import read_only
from . import loops
from .fronts import Fronts, find_fronts
from .kept_fronts import KeptFronts, inside, reached
from .loops import Factor, Factors

_NARROW = 128  # most rows that a front eliminates of those that are kept: few right-hand sides wait for the memory
_BLOCK = 96  # most right-hand sides that go through the fronts together
TWO_THREADS_FROM = 2_000_000  # entries of factors; for fewer a second thread is not worth its start
_TWO_THREADS_TO = 500_000_000  # for more, what the fronts of two threads leave would take too much memory together
_REFINED, _MOST_REFINED = 1e-13, 12  # error of a refined solution, in the norm of energy; steps, of which 3 are usual
_ACCURATE = 1e-6  # relative residual of a solution; 1e-12 and less is usual


class Analysis:
    """Fronts for several matrices, found when they are needed first.

    Parameters
    ----------
    pattern : function
        Makes a csr matrix of symmetric pattern, (n, n), with entries wherever one of those matrices has them.
    last : function, optional
        Gives groups of rows of that pattern that are eliminated last, see `find_fronts`.
    """

    def __init__(
        self,
        pattern: Callable[[], sp.csr_matrix],
        last: Callable[[sp.csr_matrix], Sequence[Array]] = lambda pattern: (),
    ) -> None:
        self._pattern, self._last = pattern, last

    @cached_property
    def fronts(self) -> Fronts:
        """The fronts."""
        pattern = self._pattern()
        return find_fronts(pattern, self._last(pattern))


class Ordered(NamedTuple):
    """A symmetric sparse matrix in the order of its elimination, as `Factorisation` begins with it.

    Parameters
    ----------
    upper : (n, n) csr matrix
        Its upper triangle, with rows and columns in that order.
    fronts : Fronts
    """

    upper: sp.csr_matrix
    fronts: Fronts

    @classmethod
    def of(cls, matrix: sp.csr_matrix, fronts: Fronts) -> Ordered:
        """Order a symmetric matrix, (n, n)."""
        return cls(_ordered(matrix, fronts.order), fronts)

    def whole(self) -> sp.csr_matrix:
        """The matrix with both triangles, in its own order, (n, n)."""
        rank = np.empty(len(self.fronts.order), dtype=np.int64)
        rank[self.fronts.order] = np.arange(len(rank))
        both = self.upper + sp.triu(self.upper, 1).T
        return sp.csr_matrix(both)[rank][:, rank]


class Factorisation:
    """Block factors C S C' of a sparse symmetric matrix, with S of ones and minus ones; one triangle is stored.

    Fronts that are positive definite are factorised by Cholesky, others by Bunch and Kaufman. Pivots are exchanged
    within a front only. That need not be accurate where the matrix is indefinite, so that one solution is checked then.
    Any thread may solve.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function, or Ordered
        Symmetric. A function makes it, so that it is gone before the factors need the memory.
        It is positive definite, or shifted to between two eigenvalues.
    analysis : Analysis, optional
        Keeps what the places of the entries tell, for other matrices with entries in the same places. One that is
        ordered has its own.
    single : bool
        Factors in single precision, of a positive definite matrix: half of the memory, and quicker solutions.
    rows : (r, n) csr matrix, optional
        Sparse rows R, for R A^-1 R' of the matrix A, found front by front in double precision. After that each front is
        rounded to single precision: solutions then need to be refined, see `refined`.

    Attributes
    ----------
    fronts : Fronts
    at_rows : (r, r) array or None
        R A^-1 R'.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular, or the factors are not accurate; in single precision, if a pivot is not positive.
    """

    def __init__(
        self,
        matrix: sp.spmatrix | Callable[[], sp.spmatrix] | Ordered,
        analysis: Analysis | None = None,
        *,
        single: bool = False,
        rows: sp.csr_matrix | None = None,
    ) -> None:
        given, asked = matrix, rows
        if isinstance(given, Ordered):
            matrix, self.fronts = given
        else:
            matrix = sp.csr_matrix(given() if callable(given) else given)
            self.fronts = find_fronts(matrix) if analysis is None else analysis.fronts
            matrix = _ordered(matrix, self.fronts.order)
        fronts = self.fronts
        self._order, self._children = fronts.order, fronts.children
        spans = [slice(*bounds) for bounds in pairwise(fronts.starts.tolist())]
        sizes = [(rows.stop - rows.start, len(below)) for rows, below in zip(spans, fronts.below, strict=True)]
        begins = np.cumsum([0, *(k * (k + m) for k, m in sizes)])
        # In one piece, pages of which are taken when they are written: the memory of updates stays whole.
        dtype, kept = (np.float32 if low else np.float64 for low in (single, single or asked is not None))
        self._store = store = np.zeros(begins[-1], kept)
        self._signs = np.ones(len(self._order), kept)
        on_the_way = None if asked is None else _InverseAt(asked, self._order, fronts.starts)
        updates: dict[int, Array] = {}
        factors: dict[int, Factor] = {}

        def eliminate(numbers: Array) -> None:
            place = np.full(len(self._order), -1)
            for front in numbers.tolist():
                rows, changes, (k, m), begin = spans[front], fronts.below[front], sizes[front], begins[front]
                entries = store[begin : begin + k * (k + m)]
                at_work = entries if on_the_way is None else np.zeros(k * (k + m))
                own, below = _blocks(at_work, k, m)
                place[rows], place[changes] = np.arange(k), np.arange(k, k + m)
                if not loops.put(matrix, rows, place, own, below):
                    raise ValueError("analysis: expected fronts of all entries of the matrix, got those of another one")
                update = np.zeros((m, m), dtype, order="F")
                for child in fronts.children[front]:
                    loops.add(updates.pop(child), place[fronts.below[child]], own, below, update)
                if (signs := _eliminate(own, below, update)) is not None:
                    self._signs[rows] = signs
                if on_the_way is not None:
                    factor = Factor(rows, changes, own, signs, below)
                    on_the_way.pass_front(front, factor, fronts.children[front], place)
                    entries[:] = at_work
                    own, below = _blocks(entries, k, m)
                place[rows] = place[changes] = -1
                factors[front] = Factor(rows, changes, own, signs, below)
                updates[front] = loops.packed(update)
                del update

        self._parts = fronts.parts if loops.share_cores() and len(store) >= TWO_THREADS_FROM else None
        if self._parts is None or len(store) > _TWO_THREADS_TO:
            eliminate(np.arange(len(spans)))
        else:
            first, second, last = self._parts
            with ThreadPoolExecutor(1) as second_core:
                beside = second_core.submit(eliminate, second)
                eliminate(first)
                beside.result()
            eliminate(last)
        ends = np.cumsum([0, *(len(changes) for changes in fronts.below)])
        places = begins, fronts.starts, ends, np.concatenate(fronts.below)
        read_only(store, *places, self._signs)  # as those of `KeptFronts`: numba compiles loops for either kind
        self._factors = Factors([factors[front] for front in range(len(spans))], store, *places, self._signs)
        self.at_rows = None if on_the_way is None else on_the_way.result
        if any(factor.signs is not None for factor in self._factors.fronts):
            self._check(given.whole() if isinstance(given, Ordered) else given() if callable(given) else given)

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
        if self._parts is None:
            loops.push(x, self._factors, np.arange(len(self._factors.fronts)))
            return
        first, second, last = self._parts
        rows, shared = self._rows(second), self._rows(last)
        beside = x.copy()  # so that no two threads change a row at once
        beside[shared] = 0.0
        with ThreadPoolExecutor(1) as second_core:
            pushed = second_core.submit(loops.push, beside, self._factors, second)
            loops.push(x, self._factors, first)
            pushed.result()
        x[rows] = beside[rows]
        x[shared] += beside[shared]
        loops.push(x, self._factors, last)

    def _pull(self, x: Array) -> None:
        """Solve for right-hand sides that are eliminated, in place."""
        if self._parts is None:
            loops.pull(x, self._factors, np.arange(len(self._factors.fronts)))
            return
        first, second, last = self._parts
        loops.pull(x, self._factors, last)
        with ThreadPoolExecutor(1) as second_core:
            pulled = second_core.submit(loops.pull, x, self._factors, second)
            loops.pull(x, self._factors, first)
            pulled.result()

    def _rows(self, fronts: Array) -> Array:
        """Rows that some fronts eliminate, in order of elimination."""
        chosen = np.zeros(len(self._factors.fronts), dtype=bool)
        chosen[fronts] = True
        return np.flatnonzero(np.repeat(chosen, np.diff(self._factors.starts)))

    def inverse_at(self, rows: sp.csr_matrix) -> Array:
        """R A^-1 R', (r, r), of the matrix A for sparse rows R, (r, n).

        Only fronts that a row reaches take part for it, and there is no substitution back.
        """
        inverse, place = _InverseAt(rows, self._order, self._factors.starts), np.empty(len(self._order), dtype=np.int64)
        for front, factor in enumerate(self._factors.fronts):
            k, m = len(factor.inverse), len(factor.changes)
            place[factor.rows], place[factor.changes] = np.arange(k), np.arange(k, k + m)
            inverse.pass_front(front, factor, self._children[front], place)
        return inverse.result

    def kept(self, rows: sp.csr_matrix) -> KeptFronts:
        """Cut out the fronts that solve for some rows, rows (k, n) of the identity, by right-hand sides there.

        They are few if these rows, or the edge of their region, are eliminated last; see `Analysis`.
        """
        fronts, _, _, starts, ends, changes, signs = self._factors
        rank = np.empty(len(self._order), dtype=np.int64)
        rank[self._order] = np.arange(len(rank))
        chosen = reached(rank[rows.indices], starts, ends, changes)
        mine = np.zeros(len(rank), dtype=bool)
        mine[inside(starts, chosen)] = True
        place = np.cumsum(mine) - 1
        parts = [part for front in chosen for part in _narrow(fronts[front])]
        entries = [block.ravel(order="F") for part in parts for block in (part.inverse, part.below)]
        return KeptFronts(
            store=np.concatenate([np.empty(0, signs.dtype), *entries]),
            starts=np.cumsum([0, *(len(part.inverse) for part in parts)]),
            ends=np.cumsum([0, *(len(part.changes) for part in parts)]),
            changes=place[np.concatenate([np.empty(0, changes.dtype), *(part.changes for part in parts)])],
            signs=signs[mine],
            rows=place[rank[rows.indices]],
        )

    @property
    def nnz(self) -> int:
        """Number of entries of one triangular factor."""
        return sum(
            len(inverse) * (len(inverse) + 1) // 2 + below.size for _, _, inverse, _, below in self._factors.fronts
        )

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia)."""
        return sum(int(np.count_nonzero(f.signs < 0)) for f in self._factors.fronts if f.signs is not None)


class _InverseAt:
    """R A^-1 R' for sparse rows R, (r, n), by fronts that are passed one by one, children first; in any threads.

    Parameters
    ----------
    rows : (r, n) csr matrix
    order : (n,) int array
        Rows of the matrix in order of elimination.
    starts : (nf + 1,) int array
        Which of these each front eliminates.
    """

    def __init__(self, rows: sp.csr_matrix, order: Array, starts: Array) -> None:
        entries, n_fronts = rows.tocoo(), len(starts) - 1
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(rank))
        at, front = rank[entries.col], np.repeat(np.arange(n_fronts), np.diff(starts))[rank[entries.col]]
        sort = np.argsort(front, kind="stable")
        self._at, self._number, self._value = at[sort], entries.row[sort], entries.data[sort]
        self._bounds = np.searchsorted(front[sort], np.arange(n_fronts + 1))
        self._left: dict[int, tuple[Array, Array, Array]] = {}  # by a front: for which of R, where, and what
        self._lock = Lock()
        self.result = np.zeros((rows.shape[0],) * 2)

    def pass_front(self, front: int, factor: Factor, children: list[int], place: Array) -> None:
        """Eliminate the rows R by a front; `place`, (n,), is of each row of the matrix in this front."""
        own = slice(*self._bounds[front : front + 2])
        before = [self._left.pop(child) for child in children if child in self._left]
        number = self._number[own]
        some = np.unique(np.concatenate([number, *(theirs for theirs, _, _ in before)]))
        if not len(some):
            return
        k, m = len(factor.inverse), len(factor.changes)
        x = np.zeros((k + m, len(some)))
        np.add.at(x, (place[self._at[own]], np.searchsorted(some, number)), self._value[own])
        for theirs, changed, pushed in before:
            x[np.ix_(place[changed], np.searchsorted(some, theirs))] += pushed
        y = factor.inverse @ x[:k]
        self._left[front] = some, factor.changes, x[k:] - factor.below @ y
        work = y.T @ y if factor.signs is None else y.T @ (factor.signs[:, None] * y)
        with self._lock:
            self.result[np.ix_(some, some)] += work


def refined(matrix: sp.csr_matrix, factors: Factorisation, rhs: Array) -> Array:
    """Solve for many right-hand sides, (n, k), by conjugate gradients with rounded factors of the matrix, (n, n).

    Raises
    ------
    IndefiniteMatrixError
        If the factors are too rough.
    """
    x, r = np.zeros_like(rhs), rhs.copy()
    z = factors.solve(r)
    p, rz = z.copy(), np.einsum("ij,ij->j", r, z)
    goal = _REFINED**2 * rz  # of the squares of errors, in the norm of energy
    for _ in range(_MOST_REFINED):
        if (rz <= goal).all():
            return x
        q = matrix @ p
        curvature = np.einsum("ij,ij->j", p, q)
        alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=curvature > 0)
        x += alpha * p
        r -= alpha * q
        z = factors.solve(r)
        last, rz = rz, np.einsum("ij,ij->j", r, z)
        p *= np.divide(rz, last, out=np.zeros_like(rz), where=last > 0)
        p += z
    raise IndefiniteMatrixError("factors in single precision are too rough for this matrix")


def _narrow(factor: Factor) -> list[Factor]:
    """Divide a front that eliminates many rows into a chain, so that zeros of its triangle are not multiplied."""
    rows, changes, inverse, signs, below = factor
    k = len(inverse)
    if signs is not None or k <= _NARROW:
        return [factor]
    lower = lapack.get_lapack_funcs("trtri", (inverse,))(inverse, lower=1)[0]
    chain = []
    for first in range(0, k, _NARROW):
        own, later = slice(first, min(first + _NARROW, k)), slice(min(first + _NARROW, k), k)
        beyond = np.concatenate([np.arange(rows.start + later.start, rows.stop), changes])
        part = slice(rows.start + own.start, rows.start + own.stop)
        chain.append(Factor(part, beyond, inverse[own, own], None, np.vstack([lower[later, own], below[:, own]])))
    return chain


def _blocks(entries: Array, k: int, m: int) -> tuple[Array, Array]:
    """Views of the k rows that a front eliminates, (k, k), and of the m rows that it changes, (m, k)."""
    return entries[: k * k].reshape((k, k), order="F"), entries[k * k :].reshape((m, k), order="F")


def _ordered(matrix: sp.csr_matrix, order: Array) -> sp.csr_matrix:
    """Upper triangle of a symmetric matrix with rows and columns in another order, (n,) int array."""
    n = len(order)
    rank = np.empty(n, dtype=matrix.indices.dtype)
    rank[order] = np.arange(n)
    rows = matrix[order]
    columns = rank[rows.indices]
    upper = np.flatnonzero(columns >= np.repeat(np.arange(n, dtype=columns.dtype), np.diff(rows.indptr)))
    starts = np.searchsorted(upper, rows.indptr)
    return sp.csr_matrix((rows.data[upper], columns[upper], starts), shape=matrix.shape)


def _eliminate(own: Array, below: Array, update: Array) -> Array | None:
    """Factorise a front in place: `own` becomes the inverse of its factor; return signs, see `loops.Factor`.

    Raises
    ------
    IndefiniteMatrixError
        If it is singular, or not positive definite in single precision.
    """
    if loops.eliminate(own, below, update):
        return None
    if own.dtype == np.float32:
        raise IndefiniteMatrixError("the matrix is not positive definite in single precision")
    own[:], signs = _indefinite(own)
    below[:] = below @ (own.T * signs)
    update -= (below * signs) @ below.T
    return signs


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
