"""Flexibility between some of many rows, by right-hand sides that are only eliminated, not substituted back.

With A = C S C' and y_i = C^-1 r_i, the flexibility is F_ij = y_i' S y_j. Such a column y_i is zero but on the fronts
from its row to the root. Columns are kept for the next time that their rows are asked for.
"""

from __future__ import annotations

from threading import Lock

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array
from .kept_fronts import KeptFronts

_ROOM, _MORE = 1.5, 512  # arrays have room for so many times what they hold; products, at most for so many more columns
BLOCK = 96  # most right-hand sides that go through the fronts together


class _Grown:
    """Rows of an array, which has room for more.

    Parameters
    ----------
    none : (0, ...) array
        Of what kind the rows are.
    """

    def __init__(self, none: Array) -> None:
        self._store, self._n = none, 0

    @property
    def rows(self) -> Array:
        """The rows, (n, ...)."""
        return self._store[: self._n]

    @property
    def nbytes(self) -> int:
        """Memory [bytes]."""
        return int(self._store.nbytes)

    def append(self, more: Array) -> None:
        """Add rows, (m, ...)."""
        n = self._n + len(more)
        if n > len(self._store):
            grown = np.empty((max(n, int(_ROOM * len(self._store))), *more.shape[1:]), more.dtype)
            grown[: self._n] = self.rows
            self._store = grown
        self._store[self._n : n] = more
        self._n = n

    def keep(self, chosen: Array) -> None:
        """Keep some rows, (n,) bool."""
        self._store, self._n = self.rows[chosen], int(np.count_nonzero(chosen))


class HalfSolved:
    """Flexibility between rows R, (r, k), of a matrix A and of some fields, R A^-1 R' + V W V', as it is asked for.

    What is kept is bounded. It saves time, and may be lost: answers differ by rounding alone.

    Parameters
    ----------
    fronts : KeptFronts
        In double precision; they solve for k dofs.
    rows : (r, k) csr matrix
    vectors : (r, c) array
        V.
    weights : (c, c) array
        W, symmetric.
    most : int
        Most memory for columns and products [bytes].
    """

    def __init__(self, fronts: KeptFronts, rows: sp.csr_matrix, vectors: Array, weights: Array, most: int) -> None:
        self._fronts, self._matrix, self._most = fronts, rows, most
        self._vectors, self._weighted = vectors, vectors @ weights
        self._lock, self._time = Lock(), 0
        self._lengths = fronts.lengths(rows)
        self._forget()

    def _forget(self) -> None:
        self._number = np.full(self._matrix.shape[0], -1)  # of each row among those that are kept
        self._rows = np.empty(0, dtype=np.int64)  # that are kept
        self._asked = np.empty(0, dtype=np.int64)  # when each was asked for last
        self._columns: dict[int, tuple[_Grown, _Grown]] = {}  # by a front: numbers of rows, and their columns there
        self._products = np.empty((0, 0))  # flexibility between the kept rows, in an array with room for more

    @property
    def nbytes(self) -> int:
        """Memory of what is kept [bytes]."""
        of_fronts = sum(number.nbytes + columns.nbytes for number, columns in self._columns.values())
        return of_fronts + self._products.nbytes

    def between(self, rows: Array, others: Array) -> Array | None:
        """Flexibility between some rows, (m,) int array, and others, (j,): (m, j); None if it takes too much memory.

        Any thread may ask.
        """
        with self._lock:
            self._time += 1
            some = np.union1d(rows, others)
            new = some[self._number[some] < 0]
            try:
                if len(new) and not self._make_room(some, new):
                    return None
                for first in range(0, len(new), BLOCK):
                    self._add(new[first : first + BLOCK])
            except BaseException:  # half of the work may be done, as when memory runs out
                self._forget()
                raise
            self._asked[self._number[some]] = self._time
            at, across = self._number[rows], self._number[others]
            if len(at) > len(across):  # products are symmetric, and the first axis is taken from all of them
                at, across = across, at
            F: Array = self._products.take(at, axis=0).take(across, axis=1)
            return F if len(F) == len(rows) else F.T

    def _make_room(self, some: Array, new: Array) -> bool:
        """Drop the columns that were not asked for longest, until new ones have room; whether they have."""
        if self._needed(some) > self._most:
            return False
        if self._needed(np.concatenate([self._rows, new])) > self._most:
            wanted = np.isin(self._rows, some)
            order = np.lexsort((-self._asked, ~wanted))  # what is wanted, then what was asked for last
            count = np.count_nonzero(wanted)
            while self._needed(np.concatenate([self._rows[order[: count + BLOCK]], new])) < self._most / 2:
                count += BLOCK
            self._keep_columns(np.sort(order[:count]))
        return True

    def _needed(self, rows: Array) -> float:
        """Most memory of the columns of some rows, (n,), and of the products between them [bytes]."""
        return 8.0 * (_with_room(len(rows)) ** 2 + _ROOM * float(self._lengths[rows].sum()))

    def _keep_columns(self, chosen: Array) -> None:
        """Keep some columns, by their numbers, ascending."""
        place = np.full(len(self._rows), -1)
        place[chosen] = np.arange(len(chosen))
        for front, (numbers, columns) in list(self._columns.items()):
            moved = place[numbers.rows]
            kept = moved >= 0
            numbers.keep(kept)
            numbers.rows[:] = moved[kept]
            columns.keep(kept)
            if not kept.any():
                del self._columns[front]
        self._rows, self._asked = self._rows[chosen], self._asked[chosen]
        self._products = np.ascontiguousarray(self._products[np.ix_(chosen, chosen)])
        self._number[:] = -1
        self._number[self._rows] = np.arange(len(self._rows))

    def _add(self, new: Array) -> None:
        """Solve half for some rows, (m,) int array, and multiply by what is kept."""
        kept, loads = self._fronts, self._matrix[new].tocoo()
        before, n = len(self._rows), len(self._rows) + len(new)
        if n > len(self._products):
            grown = np.zeros((max(n, _with_room(len(self._products))),) * 2)
            grown[:before, :before] = self._products[:before, :before]
            self._products = grown
        F, fresh = self._products, slice(before, n)
        F[before:n, :n] = F[:n, before:n] = 0.0
        at = kept.rows[loads.col]
        fronts, through = kept.ways(at, loads.row, len(new))
        x = np.zeros((len(kept.signs), len(new)))
        np.add.at(x, (at, loads.row), loads.data)
        kept.push(x, fronts)
        for front, of_front in zip(fronts.tolist(), through, strict=True):
            place, added = kept.place(front), np.flatnonzero(of_front)
            y = np.ascontiguousarray(x[place][:, added].T)
            signed = y * kept.signs[place]
            numbers, columns = self._columns.setdefault(front, (_Grown(added[:0]), _Grown(y[:0])))
            F[np.ix_(numbers.rows, before + added)] += columns.rows @ signed.T
            products = y @ signed.T
            F[np.ix_(before + added, before + added)] += (products + products.T) / 2
            numbers.append(before + added)
            columns.append(y)
        self._rows = np.concatenate([self._rows, new])
        self._asked = np.concatenate([self._asked, np.full(len(new), self._time)])
        self._number[new] = np.arange(before, n)
        of_fields = self._vectors[self._rows] @ self._weighted[new].T
        F[:before, fresh] += of_fields[:before]
        F[fresh, fresh] += (of_fields[before:] + of_fields[before:].T) / 2
        F[fresh, :before] = F[:before, fresh].T


def _with_room(n: int) -> int:
    """Order of an array for the products of n columns and of those that may follow."""
    return min(int(_ROOM * n), n + _MORE)


def energies(fronts: KeptFronts, loads: sp.csc_matrix) -> Array:
    """Work of each load, a column of a sparse matrix (k, p), on its own answer, c' A^-1 c: (p,)."""
    work = np.zeros(loads.shape[1])
    first = [fronts.rows[loads.indices[a:b]].min() if b > a else 0 for a, b in zip(*_spans(loads), strict=True)]
    order = np.argsort(first)  # those that go through the same fronts together
    for begin in range(0, len(order), BLOCK):
        some = order[begin : begin + BLOCK]
        part = loads[:, some].tocoo()
        x = np.zeros((len(fronts.signs), len(some)))
        np.add.at(x, (fronts.rows[part.row], part.col), part.data)
        reached, _ = fronts.ways(fronts.rows[part.row], part.col, len(some))
        fronts.push(x, reached)
        for front in reached.tolist():
            place = fronts.place(front)
            work[some] += np.einsum("ij,i,ij->j", x[place], fronts.signs[place], x[place])
    return work


def _spans(matrix: sp.csc_matrix) -> tuple[list[int], list[int]]:
    return matrix.indptr[:-1].tolist(), matrix.indptr[1:].tolist()
