"""Fronts cut out of the factors of a matrix: they solve for some rows as the whole factors would.

A right-hand side that is zero outside of some rows reaches their fronts, and the fronts that these change, up to the
last. The solution at the same rows needs no others. So the rest of the factors may go, and nothing is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...errors import InputError
from ...support.arrays import Array
from ...support.checks import check_floats, check_indices, read_only
from . import loops
from .loops import Factor, Factors

_BLOCK = 96  # most right-hand sides that go through the fronts together


@dataclass(frozen=True, eq=False)
class KeptFronts:
    """Some fronts of the factors of a matrix A, which solve for k of its rows; see `multifrontal.Factorisation.kept`.

    Parameters
    ----------
    store : array
        `inverse` and `below` of each front, see `loops.Factor`, with their columns one behind the other.
    starts, ends : (nf + 1,) int arrays
        Where a front begins in the order of elimination, and in `changes`.
    changes : int array
        Rows that the fronts change beyond those that they eliminate.
    signs : (n,) array
        Of all rows that these fronts eliminate.
    rows : (k,) int array
        Places of the k rows in the order of elimination.
    """

    store: Array
    starts: Array
    ends: Array
    changes: Array
    signs: Array
    rows: Array

    def __post_init__(self) -> None:
        check_floats("signs", self.signs, (None,))
        n = len(self.signs)
        check_indices("changes", self.changes, (None,), n)
        _check_bounds("starts", self.starts, n)
        _check_bounds("ends", self.ends, len(self.changes))
        check_indices("rows", self.rows, (None,), n)
        if len(self.starts) != len(self.ends):
            raise InputError(f"ends: expected {len(self.starts)} bounds, as of starts, got {len(self.ends)}")
        check_floats("store", self.store, (int(self._begins[-1]),))
        read_only(self.store, self.starts, self.ends, self.changes, self.signs, self.rows)

    @classmethod
    def of_inverse(cls, inverse: Array) -> KeptFronts:
        """One front that multiplies by a positive definite matrix, (k, k)."""
        k, none = len(inverse), np.empty(0, dtype=np.int64)
        factor = scipy.linalg.cholesky(inverse, check_finite=False)
        return cls(factor.ravel(order="F"), np.array([0, k]), np.array([0, 0]), none, np.ones(k), np.arange(k))

    @cached_property
    def _begins(self) -> Array:
        """Where each front begins in `store`, (nf + 1,) int array."""
        sizes, below = np.diff(self.starts), np.diff(self.ends)
        begins: Array = np.r_[0, np.cumsum(sizes * (sizes + below))]
        read_only(begins)
        return begins

    @cached_property
    def _factors(self) -> Factors:
        fronts = []
        for front, (start, end) in enumerate(pairwise(self.starts.tolist())):
            changes, entries = (
                values[at[front] : at[front + 1]]
                for values, at in ((self.changes, self.ends), (self.store, self._begins))
            )
            k, m = end - start, len(changes)
            inverse, below = entries[: k * k].reshape((k, k), order="F"), entries[k * k :].reshape((m, k), order="F")
            fronts.append(Factor(slice(start, end), changes, inverse, self.signs[start:end], below))
        return Factors(fronts, self.store, self._begins, self.starts, self.ends, self.changes, self.signs)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone, for pickle: each front has views of them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __setstate__(self, state: dict[str, Array]) -> None:
        """Take the fields; numba would compile loops again for arrays that can be written to."""
        read_only(*state.values())
        self.__dict__.update(state)

    def __len__(self) -> int:
        return len(self.rows)

    def single(self) -> KeptFronts:
        """Return the same in single precision: half of the memory, and quicker solutions."""
        return replace(self, store=self.store.astype(np.float32), signs=self.signs.astype(np.float32))

    def reached(self, some: Array) -> Array:
        """Fronts that solve for some of the k rows, (j,) int array, by right-hand sides there."""
        return reached(self.rows[some], self.starts, self.ends, self.changes)

    def place(self, front: int) -> slice:
        """Rows that a front eliminates, in the order of elimination."""
        return slice(*self.starts[front : front + 2])

    def push(self, x: Array, fronts: Array) -> None:
        """Eliminate right-hand sides, (n, p) in order of elimination, in place, by some fronts, ascending."""
        loops.push(x, self._factors, fronts)

    @cached_property
    def _parents(self) -> tuple[Array, Array]:
        """The front that eliminates each row, (n,), and the front that each front changes first, (nf,), or -1."""
        return parents(self.starts, self.ends, self.changes)

    def ways(self, rows: Array, columns: Array, n: int) -> tuple[Array, Array]:
        """Fronts from entries of n right-hand sides to the root, and which of them each goes through.

        Parameters
        ----------
        rows, columns : (e,) int arrays
            Places of the entries: in the order of elimination, and which of the right-hand sides.
        n : int

        Returns
        -------
        fronts : (m,) int array
            Ascending.
        through : (m, n) bool array
        """
        front_of, parent = self._parents
        begins = np.zeros((len(parent) + 1, n), dtype=bool)
        begins[front_of[rows], columns] = True
        some = np.flatnonzero(self._needed_of(front_of[rows]))
        for front in some.tolist():
            begins[parent[front]] |= begins[front]  # the last row takes up those of the root
        return some, begins[some]

    def _needed_of(self, fronts: Array) -> Array:
        """Whether each front is one of some fronts, or comes after them, (nf,) bool."""
        _, parent = self._parents
        needed = np.zeros(len(parent), dtype=bool)
        for front in np.unique(fronts).tolist():
            while front >= 0 and not needed[front]:
                needed[front], front = True, int(parent[front])
        return needed

    def lengths(self, rows: sp.csr_matrix) -> Array:
        """Most rows and fronts that each of some sparse rows, (r, k), meets on its way to the root, (r,)."""
        front_of, parent = self._parents
        way = np.diff(self.starts) + 1
        for front in range(len(parent) - 1, -1, -1):
            way[front] += way[parent[front]] if parent[front] >= 0 else 0
        at = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr)), front_of[self.rows[rows.indices]]
        begins = sp.csr_matrix((np.ones(rows.nnz), at), (rows.shape[0], len(way)))
        begins.sum_duplicates()
        begins.data[:] = 1.0
        found: Array = begins @ way
        return found

    def entries(self, fronts: Array) -> int:
        """Numbers that some fronts hold."""
        return int(np.diff(self._begins)[fronts].sum())

    def solve(self, rhs: Array, rows: Array, fronts: Array) -> Array:
        """Solve by right-hand sides at some rows, (j,) or (j, p), with the fronts that these rows, (j,) places, reach.

        The solution, (n,) or (n, p) in order of elimination, is known where these fronts eliminate.
        """
        x = np.zeros((len(self.signs), *rhs.shape[1:]), self.store.dtype)
        x[rows] = rhs
        loops.push(x, self._factors, fronts)
        loops.pull(x, self._factors, fronts)
        return x

    def complete(self, x: Array, fronts: Array) -> Array:
        """Solution at all k rows, (k,) or (k, p), from that of `solve` with these fronts; x becomes the whole."""
        loops.pull(x, self._factors, np.delete(np.arange(len(self.starts) - 1), fronts))
        return np.asarray(x[self.rows])

    def __matmul__(self, rhs: Array) -> Array:
        """Solve at the k rows, for one, (k,), or many, (k, p), right-hand sides; these in blocks."""
        everything = np.arange(len(self.starts) - 1)
        if rhs.ndim == 1:
            return np.asarray(self.solve(rhs, self.rows, everything)[self.rows])
        result = np.empty(rhs.shape, self.store.dtype, order="F")
        for first in range(0, rhs.shape[1], _BLOCK):
            some = slice(first, first + _BLOCK)
            result[:, some] = self.solve(rhs[:, some], self.rows, everything)[self.rows]
        return result


def reached(rows: Array, starts: Array, ends: Array, changes: Array) -> Array:
    """Fronts that eliminate some rows, (k,) places in the order of elimination, and those that they change; ascending.

    `starts`, `ends` and `changes` are as in `KeptFronts`; the first row that a front changes is the least.
    """
    front_of, parent = parents(starts, ends, changes)
    needed = np.zeros(len(parent) + 1, dtype=bool)
    needed[front_of[rows]] = True
    for front in np.flatnonzero(parent >= 0).tolist():
        if needed[front]:
            needed[parent[front]] = True
    return np.flatnonzero(needed[:-1])


def parents(starts: Array, ends: Array, changes: Array) -> tuple[Array, Array]:
    """The front that eliminates each row, (n,), and the front that each front changes first, (nf,); -1 for a root.

    `starts`, `ends` and `changes` are as in `KeptFronts`; the first row that a front changes is the least.
    """
    n_fronts = len(starts) - 1
    front_of = np.repeat(np.arange(n_fronts), np.diff(starts))
    changing, parent = np.diff(ends) > 0, np.full(n_fronts, -1)
    parent[changing] = front_of[changes[ends[:-1][changing]]]
    return front_of, parent


def _check_bounds(name: str, bounds: Array, end: int) -> None:
    check_indices(name, bounds, (None,))
    if not len(bounds) or bounds[0] != 0 or bounds[-1] != end or (np.diff(bounds) < 0).any():
        raise InputError(f"{name}: expected bounds that ascend from 0 to {end}")


def inside(bounds: Array, chosen: Array) -> Array:
    """Indices within some of the spans between bounds, (n + 1,), one span after the other."""
    sizes = np.diff(bounds)[chosen]
    return np.repeat(bounds[:-1][chosen] - np.cumsum(sizes) + sizes, sizes) + np.arange(sizes.sum())
