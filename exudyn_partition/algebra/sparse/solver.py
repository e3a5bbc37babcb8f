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
from .multifrontal import Analysis, Factorisation


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


Solver: TypeAlias = Callable[[sp.csc_matrix], SparseFactors]
_others: list[Solver] = []  # those in place of the own one; the last counts


def factorise(
    matrix: sp.spmatrix | Callable[[], sp.spmatrix], analysis: Analysis | None = None, *, single: bool = False
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

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular, or the factors are not accurate; in single precision, if a pivot is not positive.
    """
    if not _others:
        return Factorisation(matrix, analysis, single=single)
    return _others[-1](sp.csc_matrix(matrix() if callable(matrix) else matrix))


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
