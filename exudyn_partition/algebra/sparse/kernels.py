"""Compiled loops of the factorisation by fronts; module `multifrontal` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.compiled import external, inlined, inner, unlocked

_dpotrf, _spotrf = external("cython_lapack", "dpotrf", 5), external("cython_lapack", "spotrf", 5)
_dtrtri, _strtri = external("cython_lapack", "dtrtri", 6), external("cython_lapack", "strtri", 6)
_dtrsm, _strsm = external("cython_blas", "dtrsm", 11), external("cython_blas", "strsm", 11)
_dsyrk, _ssyrk = external("cython_blas", "dsyrk", 10), external("cython_blas", "ssyrk", 10)
_dgemv, _sgemv = external("cython_blas", "dgemv", 11), external("cython_blas", "sgemv", 11)
_dgemm, _sgemm = external("cython_blas", "dgemm", 13), external("cython_blas", "sgemm", 13)


@unlocked
def put(starts: Array, indices: Array, data: Array, place: Array, own: Array, below: Array) -> bool:
    """Write some rows of a matrix to a front, whose arrays are transposed.

    Parameters
    ----------
    starts : (k + 1,) int array
        Where these rows begin in `indices` and `data`, as of csr.
    place : (n,) int array
        Of each row in the front, -1 if it is not there.
    own, below : (k, k), (k, m) arrays

    Returns
    -------
    bool
        Whether all entries have a place.
    """
    k = len(own)
    for i in range(k):
        for entry in range(starts[i], starts[i + 1]):
            j = place[indices[entry]]
            if j < 0:
                return False
            if j < k:
                own[i, j] = data[entry]
            else:
                below[i, j - k] = data[entry]
    return True


@unlocked
def add(change: Array, place: Array, own: Array, below: Array, update: Array) -> None:
    """Add what a child leaves to its places in the front; all arrays but `place` are transposed, with rows in order.

    Parameters
    ----------
    change : (c (c + 1) / 2,) array
        See `packed`.
    place : (c,) int array
        Ascending.
    own, below, update : (k, k), (k, m), (m, m) arrays
    """
    k, c, begin = len(own), len(place), 0
    for i in range(c):
        row, values = place[i], change[begin : begin + c - i]
        begin += c - i
        if row < k:
            for j in range(i, c):
                if place[j] < k:
                    own[row, place[j]] += values[j - i]
                else:
                    below[row, place[j] - k] += values[j - i]
        else:
            for j in range(i, c):
                update[row - k, place[j] - k] += values[j - i]


@unlocked
def packed(update: Array) -> Array:
    """Upper triangle of a transposed array, (m, m), row by row."""
    m, begin = len(update), 0
    result = np.empty(m * (m + 1) // 2, update.dtype)
    for i in range(m):
        for j in range(i, m):
            result[begin + j - i] = update[i, j]
        begin += m - i
    return result


@unlocked
def eliminate(own: Array, below: Array, update: Array) -> bool:
    """Factorise a front in place, see `multifrontal._eliminate`; all arrays are transposed.

    Returns
    -------
    bool
        Whether it is positive definite; if not, nothing has changed.
    """
    letters, sizes, numbers = np.empty(4, np.uint8), np.empty(3, np.int32), np.empty(2, own.dtype)
    letters[0], letters[1], letters[2], letters[3] = ord("L"), ord("R"), ord("T"), ord("N")
    sizes[0], sizes[1], sizes[2] = len(own), len(update), 0
    numbers[0], numbers[1] = 1.0, -1.0
    n, factor = len(own), np.empty(own.shape, own.dtype)
    for i in range(n):
        for j in range(n):
            factor[i, j] = own[i, j]
    lower, k, one = letters.ctypes.data, sizes.ctypes.data, numbers.ctypes.data
    right, turned, plain, m, minus = lower + 1, lower + 2, lower + 3, k + 4, one + own.itemsize
    a, b, c, said = factor.ctypes.data, below.ctypes.data, update.ctypes.data, k + 8
    if own.itemsize == 4:
        _spotrf(lower, k, a, k, said)
        if sizes[2] == 0 and len(update) > 0:
            _strsm(right, lower, turned, plain, m, k, one, a, k, b, m)
            _ssyrk(lower, plain, m, k, minus, b, m, one, c, m)
        if sizes[2] == 0:
            _strtri(lower, plain, k, a, k, said)
    else:
        _dpotrf(lower, k, a, k, said)
        if sizes[2] == 0 and len(update) > 0:
            _dtrsm(right, lower, turned, plain, m, k, one, a, k, b, m)
            _dsyrk(lower, plain, m, k, minus, b, m, one, c, m)
        if sizes[2] == 0:
            _dtrtri(lower, plain, k, a, k, said)
    definite: bool = sizes[2] == 0
    if definite:
        for i in range(n):
            for j in range(n):
                own[i, j] = factor[i, j]
    # Arrays are freed after their last use, and an address is none: these are used once more after the calls.
    kept: bool = letters[0] > 0 and sizes[0] >= 0 and numbers[0] > 0.0
    return definite and kept


@inner
def multiply(
    block: Array, turned: bool, given: Array, result: Array, letters: Array, sizes: Array, scale: Array
) -> None:
    """Set a result, (i, p), to the product of a block, whose i x j numbers lie by rows, and what is given, (j, p).

    If it is `turned`, the block has j x i numbers. All arrays must lie by rows, for BLAS gets their addresses alone.
    `numpy.dot` does the same by the same calls of BLAS, but takes long to compile. The last three arguments come from
    `room_of`.
    """
    i, j, p = len(result), len(given), result.shape[1]
    if i == 0 or j == 0:
        for row in range(i):
            for column in range(p):
                result[row, column] = 0.0
        return
    sizes[0], sizes[1], sizes[2], sizes[3] = p, i if turned else j, j if turned else i, 1
    plain, n, one, zero = letters.ctypes.data, sizes.ctypes.data, scale.ctypes.data, scale.ctypes.data + scale.itemsize
    flipped, wide, high, step = plain + 1, n + 4, n + 8, n + 12
    a, b, c = block.ctypes.data, given.ctypes.data, result.ctypes.data
    if p == 1:
        kind = plain if turned else flipped
        if scale.itemsize == 4:
            _sgemv(kind, wide, high, one, a, wide, b, step, zero, c, step)
        else:
            _dgemv(kind, wide, high, one, a, wide, b, step, zero, c, step)
        return
    kind, many, inside = (flipped, wide, high) if turned else (plain, high, wide)
    if scale.itemsize == 4:
        _sgemm(plain, kind, n, many, inside, one, b, n, a, wide, zero, c, n)
    else:
        _dgemm(plain, kind, n, many, inside, one, b, n, a, wide, zero, c, n)


@inlined
def room_of(store: Array) -> tuple[Array, Array, Array]:
    """Letters, sizes and factors of sums for `multiply`, the latter of the kind of the stored numbers."""
    letters, scale = np.empty(2, np.uint8), np.empty(2, store.dtype)
    letters[0], letters[1] = ord("N"), ord("T")
    scale[0], scale[1] = 1.0, 0.0
    return letters, np.empty(4, np.int32), scale


@unlocked
def push(x: Array, store: Array, begins: Array, starts: Array, ends: Array, changes: Array, fronts: Array) -> None:
    """Eliminate right-hand sides x, (n, p), in place, by some fronts.

    Parameters
    ----------
    x : (n, p) array
        Its rows are in order of elimination; it must lie by rows, see `multiply`.
    store : array
        `inverse` and `below` of each front, with their columns one behind the other.
    begins : (nf + 1,) int array
        Where a front's begin there.
    starts : (nf + 1,) int array
        Which rows each front eliminates.
    ends : (nf + 1,) int array
        Where the rows begin in `changes` that each front changes.
    changes : int array
    fronts : int array
        Children before their parents.
    """
    letters, sizes, scale = room_of(store)
    p = x.shape[1]
    for front in fronts:
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m, begin = len(own), len(others), begins[front]
        solved, pushed = np.empty((k, p), store.dtype), np.empty((m, p), store.dtype)
        multiply(store[begin : begin + k * k], True, own, solved, letters, sizes, scale)
        multiply(store[begin + k * k : begin + k * (k + m)], True, solved, pushed, letters, sizes, scale)
        for i in range(k):
            for j in range(p):
                own[i, j] = solved[i, j]
        for i in range(m):
            for j in range(p):
                x[others[i], j] -= pushed[i, j]


@unlocked
def pull(
    x: Array, store: Array, begins: Array, starts: Array, ends: Array, changes: Array, fronts: Array, signs: Array
) -> None:
    """Solve for x by some fronts, from the last to the first, after all are eliminated; see `push`."""
    letters, sizes, scale = room_of(store)
    p = x.shape[1]
    for at in range(len(fronts) - 1, -1, -1):
        front = fronts[at]
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m, begin = len(own), len(others), begins[front]
        known, pulled = np.empty((m, p), store.dtype), np.empty((k, p), store.dtype)
        for i in range(m):
            for j in range(p):
                known[i, j] = x[others[i], j]
        multiply(store[begin + k * k : begin + k * (k + m)], False, known, pulled, letters, sizes, scale)
        for i in range(k):
            for j in range(p):
                pulled[i, j] = signs[starts[front] + i] * own[i, j] - pulled[i, j]
        multiply(store[begin : begin + k * k], False, pulled, own, letters, sizes, scale)
