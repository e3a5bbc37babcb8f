"""The sparse solver: one function that factorises a matrix, and what it returns.

It is that of module `multifrontal`, unless `solved_by` puts another in its place: SuperLU of SciPy, CHOLMOD, a user's.
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array
from .kept_fronts import KeptFronts
from .multifrontal import Analysis, Factorisation, Ordered, refined

_TOGETHER = 32  # right-hand sides that are refined at a time: each needs memory for five vectors


class SparseFactors(Protocol):
    """Factors of a symmetric sparse matrix A, (n, n). A solver that inherits from this has to write two methods."""

    @abstractmethod
    def solve(self, rhs: Array) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides; any thread may do so."""

    @abstractmethod
    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as A has negative eigenvalues (Sylvester's law of inertia)."""

    def energies(self, rhs: Array) -> Array:
        """B' A^-1 B, (k, k), for many right-hand sides B, (n, k)."""
        found: Array = rhs.T @ self.solve(rhs)
        return found

    def inverse_at(self, rows: sp.csr_matrix) -> Array:
        """R A^-1 R', (r, r), for sparse rows R, (r, n)."""
        return np.asarray(rows @ self.solve(rows.T.toarray()))

    def kept(self, rows: sp.csr_matrix) -> KeptFronts:
        """Keep what solves for some rows of a positive definite A, rows (k, n) of the identity: here a dense front."""
        return KeptFronts.of_inverse(self.inverse_at(rows))


class Refined(SparseFactors):
    """Factors in single precision that solve as well as those in double precision, by conjugate gradients.

    Parameters
    ----------
    matrix : (n, n) csr matrix
        Positive definite.
    factors : Factorisation
        Of it, with `rows`.
    rows : (r, n) csr matrix
    """

    def __init__(self, matrix: sp.csr_matrix, factors: Factorisation, rows: sp.csr_matrix) -> None:
        self._matrix, self._factors, self._rows = matrix, factors, rows

    def solve(self, rhs: Array) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides.

        Raises
        ------
        IndefiniteMatrixError
            If the factors are too rough.
        """
        x = np.empty((len(rhs), rhs.size // len(rhs)), order="F")
        for first in range(0, x.shape[1], _TOGETHER):
            some = slice(first, first + _TOGETHER)
            x[:, some] = refined(self._matrix, self._factors, rhs.reshape(x.shape)[:, some])
        return x.reshape(rhs.shape)

    def negative_pivots(self) -> int:
        """Count the negative pivots."""
        return self._factors.negative_pivots()

    def inverse_at(self, rows: sp.csr_matrix) -> Array:
        """R A^-1 R', (r, r), for sparse rows R, (r, n): known for those of the factors, else by solutions."""
        known = self._factors.at_rows
        if known is not None and rows.shape == self._rows.shape and not (rows != self._rows).nnz:
            return known
        return super().inverse_at(rows)


Solver: TypeAlias = Callable[[sp.csc_matrix], SparseFactors]
_others: list[Solver] = []  # those in place of the own one; the last counts


def factorise(
    matrix: sp.spmatrix | Callable[[], sp.spmatrix],
    analysis: Analysis | None = None,
    *,
    single: bool = False,
    rows: sp.csr_matrix | None = None,
) -> SparseFactors:
    """Factorise a sparse symmetric matrix.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        Positive definite, or shifted to between two eigenvalues. A function makes it, so that it is gone before the
        factors need the memory.
    analysis : Analysis, optional
        Keeps what the places of the entries tell the own solver, for other matrices with entries in the same places.
    single : bool
        Whether single precision will do, which another solver than the own one need not have.
    rows : (r, n) csr matrix, optional
        What `inverse_at` will be asked for; all other solutions are few. The own solver then finds it on the way, and
        keeps its factors in half of the memory, see `Refined`.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular, or the factors are not accurate; in single precision, if a pivot is not positive.
    """
    if not _others:
        if rows is None:
            return Factorisation(matrix, analysis, single=single)
        factors = Factorisation(matrix, analysis, rows=rows)
        return Refined(sp.csr_matrix(matrix() if callable(matrix) else matrix), factors, rows)
    return _others[-1](sp.csc_matrix(matrix() if callable(matrix) else matrix))


def kept_fronts(matrix: Ordered, rows: sp.csr_matrix) -> KeptFronts:
    """Fronts of the own solver that solve for some rows, rows (k, n) of the identity, of a positive definite matrix."""
    return Factorisation(matrix).kept(rows)


@contextlib.contextmanager
def solved_by(solver: Solver) -> Iterator[None]:
    """Let another solver factorise matrices in this process, in all threads.

    Parameters
    ----------
    solver : callable
        Takes a symmetric csc matrix with all its entries, and returns `SparseFactors`. It has to raise
        IndefiniteMatrixError if the matrix is singular.
    """
    _others.append(solver)
    try:
        yield
    finally:
        _others.remove(solver)
