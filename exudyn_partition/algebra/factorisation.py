"""Sparse symmetric factorisation, and solves of many right-hand sides in blocks."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg
from threadpoolctl import threadpool_limits

from ..errors import IndefiniteMatrixError
from ..support.arrays import Array
from .ordering import nested_dissection
from .pardiso import Pardiso, library

_BLOCK = 48  # right-hand sides in a call: enough for BLAS 3 inside SuperLU, with little memory

_LIMITING = threading.Lock()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context or decorator in which BLAS uses one thread: the blocks of SuperLU are too small for more.

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

    Intel's PARDISO makes them if its package is installed (`pip install exudyn-partition[fast]`), else SciPy's SuperLU.
    Make and drop them in one thread, see `SuperLU`. Any thread may solve.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        Symmetric. A function makes it, so that it is gone before the factors need the memory.
    by : {"pardiso", "superlu"}, optional
        Default: the first that is installed.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular.
    """

    def __init__(self, matrix: sp.spmatrix | Callable[[], sp.spmatrix], by: str | None = None) -> None:
        fast = by == "pardiso" if by else library() is not None
        self._factors: Pardiso | SuperLU = Pardiso(matrix) if fast else SuperLU(matrix)

    def solve(self, rhs: Array, threads: int = 2) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides, with at most so many threads."""
        return self._factors.solve(rhs, threads)

    @property
    def nnz(self) -> int:
        """Number of stored entries of the factors."""
        return self._factors.nnz

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia).

        Raises
        ------
        IndefiniteMatrixError
            If a pivot of SuperLU is zero; then signs mean nothing.
        """
        return self._factors.negative_pivots()


class SuperLU:
    """LU factors of a sparse symmetric matrix.

    SuperLU works in the order of nested dissection, with pivots on the diagonal. Without `diag_pivot_thresh=0` partial
    pivoting destroys the order, and the fill grows a hundredfold. SciPy frees the memory only if the last reference is
    dropped in the thread that made the factors, so make and drop them in one thread. Any thread may solve.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        See `Factorisation`.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular.
    """

    def __init__(self, matrix: sp.spmatrix | Callable[[], sp.spmatrix]) -> None:
        matrix = sp.csr_matrix(matrix() if callable(matrix) else matrix)
        self._order = nested_dissection(matrix)
        ordered = matrix[self._order][:, self._order]
        del matrix
        try:
            self._lu = scipy.sparse.linalg.splu(
                ordered.T,  # its columns are its rows: no copy
                permc_spec="NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise IndefiniteMatrixError(
                f"the matrix of order {len(self._order)} cannot be factorised: {error}"
            ) from error

    def solve(self, rhs: Array, threads: int = 2) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides; these in blocks, `threads` of them at a time."""
        result = np.empty(rhs.shape, order="F")
        if rhs.ndim == 1:
            result[self._order] = self._lu.solve(rhs[self._order])
            return result

        def solve_block(block: slice) -> None:
            result[self._order, block] = self._lu.solve(np.asfortranarray(rhs[self._order, block]))

        n = rhs.shape[1]
        count = min(n, threads * -(-n // (threads * _BLOCK)))
        bounds = np.linspace(0, n, count + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:  # SuperLU lets other threads run
            list(pool.map(solve_block, map(slice, bounds[:-1], bounds[1:])))
        return result

    @property
    def nnz(self) -> int:
        """Number of stored entries of both factors."""
        return int(self._lu.nnz)

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia).

        SuperLU copies its factors to show the pivots, and keeps the copy.

        Raises
        ------
        IndefiniteMatrixError
            If SuperLU exchanged rows because of a zero on the diagonal; then the signs mean nothing.
        """
        if (self._lu.perm_r != self._lu.perm_c).any():
            raise IndefiniteMatrixError(
                "a pivot on the diagonal is zero, so that signs cannot be counted; move the shift"
            )
        return int(np.count_nonzero(self._lu.U.diagonal() < 0))
