"""Flexibility of many rows of a body, of which a part is found when somebody asks for it.

A dense array of r rows has r^2 numbers: 8 GB for a skin of 10 000 nodes with three directions. What solves for these
rows is some per cent of that: the fronts of the body's factors that they reach. A contact asks for the few rows that
may close.

For few rows, an array is smaller and quicker than the fronts; `SMALL` is the limit. So there are two kinds, and this
one answers as an array does: by blocks, products, and slices for patches.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from ...errors import InputError, MemoryLimitError
from ...support.arrays import Array
from ...support.checks import check_floats, check_indices, read_only
from ..blas_threads import one_blas_thread
from .fronts import Fronts
from .half_solved import HalfSolved, energies
from .kept_fronts import KeptFronts
from .multifrontal import Ordered
from .solver import kept_fronts

SMALL = 3000  # rows up to which an array is taken: 72 MB
MOST_ROWS = 8000  # rows of which an array is made if somebody needs all: 512 MB
KEPT_BYTES = 600_000_000  # most memory for half-solved columns, and the products between them
_BLOCK = 96  # right-hand sides that are solved for together


@dataclass(frozen=True, eq=False)
class StoredFactors:
    """A positive definite matrix, ordered such that its factors are soon found, and the dofs for which they solve.

    A file holds the matrix: its factors are ten times as large, and found in the time that it takes to read them.

    Parameters
    ----------
    upper : (n, n) csr matrix
        Upper triangle in order of elimination, see `Ordered`.
    order, starts : int arrays
        See `Fronts`.
    ends : (nf + 1,) int array
        Where the rows begin in `changes` that each front changes.
    changes : int array
    dofs : (k,) int array
        Rows of the matrix, in its own order.
    """

    upper: sp.csr_matrix
    order: Array
    starts: Array
    ends: Array
    changes: Array
    dofs: Array

    def __post_init__(self) -> None:
        check_floats("upper", self.upper.data, (None,))
        n, n_fronts = self.upper.shape[0], len(self.starts) - 1
        check_indices("order", self.order, (n,), n)
        check_indices("starts", self.starts, (None,), n + 1)
        check_indices("ends", self.ends, (n_fronts + 1,), len(self.changes) + 1)
        check_indices("changes", self.changes, (None,), n)
        check_indices("dofs", self.dofs, (None,), n)
        if len(np.unique(self.order)) != n:
            raise InputError("order: expected each row of the matrix once")
        for name, bounds, end in (("starts", self.starts, n), ("ends", self.ends, len(self.changes))):
            if bounds[0] != 0 or bounds[-1] != end or (np.diff(bounds) < 0).any():
                raise InputError(f"{name}: expected bounds that ascend from 0 to {end}")
        read_only(self.upper.data, self.order, self.starts, self.ends, self.changes, self.dofs)

    @classmethod
    def of(cls, matrix: sp.csr_matrix, fronts: Fronts, dofs: Array, kept: KeptFronts) -> StoredFactors:
        """Store a matrix, (n, n), with what was cut out of its factors for these dofs."""
        upper = Ordered.of(matrix, fronts).upper
        ends = np.cumsum([0, *map(len, fronts.below)])
        found = cls(upper, fronts.order, fronts.starts, ends, np.concatenate(fronts.below), dofs)
        vars(found)["kept"] = kept
        return found

    @cached_property
    def kept(self) -> KeptFronts:
        """Fronts that solve for the dofs; of a matrix from a file they are found when somebody asks first."""
        below = [self.changes[slice(*bounds)] for bounds in pairwise(self.ends.tolist())]
        fronts, n = Fronts.of(self.order, self.starts, below), self.upper.shape[0]
        of_dofs = sp.csr_matrix(
            (np.ones(len(self.dofs)), self.dofs, np.arange(len(self.dofs) + 1)), (len(self.dofs), n)
        )
        with one_blas_thread():
            return kept_fronts(Ordered(self.upper, fronts), of_dofs)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone, for pickle."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True, eq=False)
class SkinFlexibility:
    """Flexibility of r rows on some dofs of a body, R A^-1 R' + V S V' [m/N]; it reads like an array, (r, r).

    Parameters
    ----------
    factors : StoredFactors
        Of A, for k dofs.
    rows : (r, k) csr matrix
        R.
    vectors : (r, c) array
        V.
    weights : (c, c) array
        S, symmetric.

    Notes
    -----
    `flexibility[rows, columns]` takes two slices, and returns a `SkinBlock`; or what `numpy.ix_` returns, and then
    returns an array. `flexibility @ forces` is the motion by forces on all rows. `numpy.asarray` makes an array of at
    most `MOST_ROWS` rows, and refuses more by a `MemoryLimitError`.
    """

    factors: StoredFactors
    rows: sp.csr_matrix
    vectors: Array
    weights: Array

    __array_ufunc__ = None  # arrays leave products to this class

    def __post_init__(self) -> None:
        check_floats("rows", self.rows.data, (None,))
        r, k = self.rows.shape
        if k != len(self.factors.dofs):
            raise InputError(f"rows: expected {len(self.factors.dofs)} columns, one for each dof, got {k}")
        check_floats("vectors", self.vectors, (r, None))
        check_floats("weights", self.weights, (self.vectors.shape[1],) * 2)
        read_only(self.rows.data, self.vectors, self.weights)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone, for pickle."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def shape(self) -> tuple[int, int]:
        """(r, r)."""
        return (self.rows.shape[0],) * 2

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def plus(self, vectors: Array, weights: Array) -> SkinFlexibility:
        """Return it with U diag(w) U' added, for vectors U, (r, j), and weights w, (j,)."""
        weights = scipy.linalg.block_diag(self.weights, np.diag(weights))
        return SkinFlexibility(self.factors, self.rows, np.hstack([self.vectors, vectors]), weights)

    @cached_property
    def columns(self) -> HalfSolved:
        """Half-solved columns, which may be lost without changing an answer."""
        return HalfSolved(self.factors.kept, self.rows, self.vectors, self.weights, KEPT_BYTES)

    def between(self, some: Array) -> Array:
        """Flexibility between some rows, (m,) int array: (m, m) [m/N]."""
        F = self.columns.between(some, some)
        if F is None:
            F = self._solved(some, some)
            F = (F + F.T) / 2
        return F

    def block(self, rows: Array, columns: Array) -> Array:
        """Flexibility between rows, (m,) int array, and columns, (j,) int array: (m, j) [m/N]."""
        if len(rows) == len(columns) and (rows == columns).all():
            return self.between(rows)
        F = self.columns.between(rows, columns)
        return self._solved(rows, columns) if F is None else F

    def _solved(self, rows: Array, columns: Array) -> Array:
        """The same by full solutions for the columns, a block at a time: nothing is kept."""
        kept, (sub, loads) = self.factors.kept, (self.rows[some] for some in (rows, columns))
        dofs = np.union1d(sub.indices, loads.indices)
        places, fronts, at = kept.rows[dofs], kept.reached(dofs), sub[:, dofs]
        F = np.empty((len(rows), len(columns)))
        for first in range(0, len(columns), _BLOCK):
            some = slice(first, first + _BLOCK)
            F[:, some] = at @ kept.solve(loads[some][:, dofs].T.toarray(), places, fronts)[places]
        found: Array = F + self.vectors[rows] @ (self.weights @ self.vectors[columns].T)
        return found

    def energies(self, loads: sp.csc_matrix) -> Array:
        """Work of each load, a column of a sparse matrix (r, p), on its own answer, c' F c: (p,) [m/N]."""
        of_fields = loads.T @ self.vectors
        by_fields = np.einsum("ij,jk,ik->i", of_fields, self.weights, of_fields, optimize=True)
        return np.asarray(energies(self.factors.kept, sp.csc_matrix(self.rows.T @ loads)) + by_fields)

    def __matmul__(self, forces: Array) -> Array:
        """Motion of the rows, (r,) or (r, p) [m], by forces on them [N]."""
        by_fields = self.vectors @ (self.weights @ (self.vectors.T @ forces))
        return np.asarray(self.rows @ (self.factors.kept @ (self.rows.T @ forces)) + by_fields)

    def __rmatmul__(self, forces: Array) -> Array:
        """The same for forces as rows, (r,) or (p, r)."""
        return np.asarray((self @ np.asarray(forces).T).T)

    @property
    def T(self) -> SkinFlexibility:
        """The transpose, which is the same."""
        return self

    def __getitem__(self, key: Any) -> Any:
        """See the notes on the class."""
        return self._all[key]

    @property
    def _all(self) -> SkinBlock:
        return SkinBlock(self, slice(0, len(self)), slice(0, len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return self._all.__array__(dtype, copy)


@dataclass(frozen=True, eq=False)
class SkinBlock:
    """Flexibility between two ranges of rows of a `SkinFlexibility`, as those of two patches; see there.

    Parameters
    ----------
    whole : SkinFlexibility
    rows, columns : slice
        From a number to a number.
    """

    whole: SkinFlexibility
    rows: slice
    columns: slice

    __array_ufunc__ = None  # arrays leave products to this class

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start

    def __len__(self) -> int:
        return int(self.rows.stop - self.rows.start)

    @property
    def T(self) -> SkinBlock:
        """The transpose."""
        return SkinBlock(self.whole, self.columns, self.rows)

    def __getitem__(self, key: Any) -> Any:
        """A `SkinBlock` by two slices; an array by what `numpy.ix_` returns."""
        rows, columns = key
        if isinstance(rows, slice) and isinstance(columns, slice):
            (a, b), (c, d) = (_within(part, size) for part, size in zip((rows, columns), self.shape, strict=True))
            start, first = self.rows.start, self.columns.start
            return SkinBlock(self.whole, slice(start + a, start + b), slice(first + c, first + d))
        if isinstance(rows, slice) or isinstance(columns, slice):
            raise InputError("flexibility: expected two slices, or numbers of rows and columns from numpy.ix_")
        numbers, others = np.asarray(rows).ravel(), np.asarray(columns).ravel()
        return self.whole.block(self.rows.start + numbers, self.columns.start + others)

    def __matmul__(self, forces: Array) -> Array:
        """Motion of the rows, (m,) or (m, p) [m], by forces on the columns [N]."""
        on_all = np.zeros((len(self.whole), *np.shape(forces)[1:]))
        on_all[self.columns] = forces
        return np.asarray((self.whole @ on_all)[self.rows])

    def __rmatmul__(self, forces: Array) -> Array:
        """The same for forces on the rows, as rows, (m,) or (p, m): motion of the columns."""
        return np.asarray((self.T @ np.asarray(forces).T).T)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        n, m = self.shape
        if max(n, m) > MOST_ROWS:
            raise MemoryLimitError(
                f"flexibility: it is found on demand, and an array of all {n} x {m} entries, {8e-9 * n * m:.3g} GB, is "
                f"made for at most {MOST_ROWS} rows. What asked for it needs a smaller patch: a part of the faces, "
                "axes='normal', or a coarser mesh"
            )
        rows, columns = (np.arange(part.start, part.stop) for part in (self.rows, self.columns))
        return np.asarray(self.whole.block(rows, columns), dtype=dtype)


Flexibility: TypeAlias = Array | SkinFlexibility | SkinBlock


def check_flexibility(name: str, value: object, n: int) -> None:
    """Raise unless `value` is a flexibility of n rows; an array becomes read-only."""
    if isinstance(value, SkinFlexibility):
        if len(value) != n:
            raise InputError(f"{name}: expected that of {n} rows, got that of {len(value)}")
        return
    check_floats(name, value, (n, n))
    assert isinstance(value, np.ndarray)
    read_only(value)


def largest_value(flexibility: Flexibility) -> float:
    """Largest singular value of a flexibility, (m, j) [m/N]; of one on demand to six digits, by products alone."""
    if isinstance(flexibility, np.ndarray):
        return float(np.linalg.norm(flexibility, 2))
    m = flexibility.shape[1]
    other = flexibility.T
    operator = scipy.sparse.linalg.LinearOperator((m, m), matvec=lambda x: other @ (flexibility @ x), dtype=float)
    found = scipy.sparse.linalg.eigsh(operator, k=1, v0=np.ones(m), tol=1e-6, return_eigenvectors=False)
    return float(np.sqrt(max(found[0], 0.0)))


def works(flexibility: Flexibility, loads: sp.csc_matrix) -> Array:
    """Work of each load, a column of a sparse matrix (r, p), on its own answer, c' F c: (p,) [m/N]."""
    if isinstance(flexibility, np.ndarray):
        return np.asarray(loads.multiply(flexibility @ loads).sum(axis=0)).ravel()
    assert isinstance(flexibility, SkinFlexibility)
    return flexibility.energies(loads)


def _within(part: slice, size: int) -> tuple[int, int]:
    start, stop, step = part.indices(size)
    if step != 1:
        raise InputError(f"flexibility: expected slices of neighbouring rows, got a step of {step}")
    return start, max(start, stop)
