"""PARDISO out of Intel's MKL, a factorisation of sparse symmetric matrices that pip can bring: `pip install mkl`."""

from __future__ import annotations

import ctypes
import importlib.metadata
import re
import threading
import weakref
from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.sparse as sp

from ...errors import IndefiniteMatrixError
from ...support.arrays import Array

_SYMMETRIC = -2  # PARDISO's type of matrix: real, symmetric, not necessarily definite
_FACTORISE, _SOLVE, _RELEASE = 12, 33, -1  # its phases
_SEQUENTIAL = 1  # MKL's threading layer without OpenMP, whose libraries of two makers do not mix
_NO_MEMORY = -2
_ZERO = 13  # a pivot below 10^-13 of the matrix counts as zero
# Settings by their numbers in Intel's manual, which count from one. Those that are not named are zero: no scaling, no
# refinement, double precision, in memory.
_SETTINGS = {1: 1, 2: 2, 10: _ZERO, 18: -1, 21: 1, 35: 1}  # ours, metis, zero, count entries, 2 x 2 pivots, from 0
_ENTRIES, _PERTURBED, _NEGATIVE = 17, 13, 22  # what it tells, from zero


@cache
def library() -> ctypes.CDLL | None:
    """MKL as pip has installed it; None if it has not, or the library cannot be loaded."""
    try:
        files = importlib.metadata.files("mkl") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    for file in files:
        if re.fullmatch(r"(lib)?mkl_rt(\.\d+)?\.(so(\.\d+)?|dll)", file.name):
            try:
                found = ctypes.CDLL(str(file.locate()))
                found.MKL_Set_Threading_Layer(_SEQUENTIAL)
            except (OSError, AttributeError):
                return None
            return found
    return None


class Pardiso:
    """L D L' factors of a sparse symmetric matrix, in one thread.

    Parameters
    ----------
    matrix : (n, n) sparse matrix, or function
        Symmetric; see `Factorisation`.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular.
    MemoryError

    References
    ----------
    O. Schenk and K. Gaertner, On fast factorization pivoting methods for sparse symmetric indefinite systems, 2006.
    """

    def __init__(self, matrix: sp.spmatrix | Callable[[], sp.spmatrix]) -> None:
        upper = sp.triu(matrix() if callable(matrix) else matrix, format="coo")
        n = upper.shape[0]
        diagonal = np.arange(n)  # must be there, even as zeros
        where = (np.r_[upper.row, diagonal], np.r_[upper.col, diagonal])
        upper = sp.csr_matrix((np.r_[upper.data, np.zeros(n)], where), shape=(n, n), dtype=float)
        upper.sort_indices()
        self._n, self._values = n, upper.data
        self._starts, self._columns = (np.ascontiguousarray(x, np.int32) for x in (upper.indptr, upper.indices))
        self._handle, self._settings = np.zeros(64, np.int64), np.zeros(64, np.int32)
        for number, value in _SETTINGS.items():
            self._settings[number - 1] = value
        self._lock = threading.Lock()
        weakref.finalize(self, _run, _RELEASE, self._handle, self._settings, n, None, None, None, None, None)
        nothing = np.empty((n, 0), order="F")
        error = self._call(_FACTORISE, nothing, nothing)
        if error == _NO_MEMORY:
            raise MemoryError(f"no memory for the factors of a matrix of order {n}")
        if error or self._settings[_PERTURBED]:
            raise IndefiniteMatrixError(
                f"the matrix of order {n} cannot be factorised: {self._settings[_PERTURBED]} pivots are zero "
                f"(PARDISO's error {error})"
            )

    def _call(self, phase: int, rhs: Array, result: Array) -> int:
        return _run(
            phase, self._handle, self._settings, self._n, self._values, self._starts, self._columns, rhs, result
        )

    def solve(self, rhs: Array, threads: int = 1) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides; threads take turns."""
        given = np.asfortranarray(rhs, dtype=float)
        result = np.empty_like(given)
        if given.size:
            with self._lock:
                self._call(_SOLVE, given, result)
        return result

    @property
    def nnz(self) -> int:
        """Number of stored entries of the factors."""
        return int(self._settings[_ENTRIES])

    def negative_pivots(self) -> int:
        """Count the negative pivots: as many as the matrix has negative eigenvalues (Sylvester's law of inertia)."""
        return int(self._settings[_NEGATIVE])


def _run(
    phase: int,
    handle: Array,
    settings: Array,
    n: int,
    values: Array | None,
    starts: Array | None,
    columns: Array | None,
    rhs: Array | None,
    result: Array | None,
) -> int:
    """Call PARDISO, and return its error."""
    found = library()
    assert found is not None
    integer = ctypes.c_int32
    count = 1 if rhs is None or rhs.ndim == 1 else max(1, rhs.shape[1])
    error = integer(0)

    def at(array: Array | None) -> ctypes.c_void_p:
        return ctypes.c_void_p(None if array is None else array.ctypes.data)

    numbers = [ctypes.byref(integer(x)) for x in (1, 1, _SYMMETRIC, phase, n)]
    found.pardiso(
        at(handle),
        *numbers,
        at(values),
        at(starts),
        at(columns),
        None,
        ctypes.byref(integer(count)),
        at(settings),
        ctypes.byref(integer(0)),
        at(rhs),
        at(result),
        ctypes.byref(error),
    )
    return error.value
