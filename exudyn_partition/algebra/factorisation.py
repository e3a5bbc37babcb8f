"""Sparse symmetric factorisation, and solves of many right-hand sides in blocks."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

import scipy.sparse as sp
from threadpoolctl import threadpool_limits

from ..support.arrays import Array
from .sparse.multifrontal import Analysis, Multifrontal
from .sparse.pardiso import Pardiso, library

_LIMITING = threading.Lock()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context or decorator in which BLAS uses one thread: most fronts are too small for more.

    The limit is one of the whole process. The first thread that enters sets it and lifts it. Threads that enter
    meanwhile leave it alone; otherwise they would set it again when they leave.
    """
    if not _LIMITING.acquire(blocking=False):
        yield
        return
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        _LIMITING.release()


class Factorisation:
    """Factors of a sparse symmetric matrix, positive definite or shifted to between two eigenvalues.

    Intel's PARDISO makes them if its package is installed (`pip install exudyn-partition[fast]`), else `Multifrontal`.
    Any thread may solve.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        Symmetric. A function makes it, so that it is gone before the factors need the memory.
    by : {"pardiso", "multifrontal"}, optional
        Default: the first that is installed.
    analysis : Analysis, optional
        Keeps what the places of the entries tell, for other matrices with entries in the same places.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular.
    """

    def __init__(
        self,
        matrix: sp.spmatrix | Callable[[], sp.spmatrix],
        by: str | None = None,
        analysis: Analysis | None = None,
    ) -> None:
        fast = by == "pardiso" if by else library() is not None
        self._factors: Pardiso | Multifrontal = Pardiso(matrix) if fast else Multifrontal(matrix, analysis)

    def solve(self, rhs: Array, threads: int = 2) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides, with at most so many threads."""
        return self._factors.solve(rhs, threads)

    @property
    def nnz(self) -> int:
        """Number of entries of one triangular factor."""
        return self._factors.nnz

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia)."""
        return self._factors.negative_pivots()
