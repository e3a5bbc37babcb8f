"""Compiled loops of the factorisation by fronts; module `multifrontal` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.compiled import external, inlined, unlocked

_dpotrf, _spotrf = external("cython_lapack", "dpotrf", 5), external("cython_lapack", "spotrf", 5)
_dtrtri, _strtri = external("cython_lapack", "dtrtri", 6), external("cython_lapack", "strtri", 6)
_dtrsm, _strsm = external("cython_blas", "dtrsm", 11), external("cython_blas", "strsm", 11)
_dsyrk, _ssyrk = external("cython_blas", "dsyrk", 10), external("cython_blas", "ssyrk", 10)


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


@inlined
def write(values: Array, result: Array) -> None:
    """Write values to an array of the same shape, entry by entry, see `support.compiled`."""
    for place in np.ndindex(result.shape):
        result[place] = values[place]


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
    letters = np.array([ord("L"), ord("R"), ord("T"), ord("N")], np.uint8)
    sizes, info = np.array([len(own), len(update)], np.int32), np.zeros(1, np.int32)
    numbers, factor = np.array([1.0, -1.0]).astype(own.dtype), own.copy()
    lower, k, one = letters.ctypes.data, sizes.ctypes.data, numbers.ctypes.data
    right, turned, plain, m, minus = lower + 1, lower + 2, lower + 3, k + 4, one + own.itemsize
    a, b, c, said = factor.ctypes.data, below.ctypes.data, update.ctypes.data, info.ctypes.data
    if own.itemsize == 4:
        _spotrf(lower, k, a, k, said)
        if info[0] == 0 and len(update) > 0:
            _strsm(right, lower, turned, plain, m, k, one, a, k, b, m)
            _ssyrk(lower, plain, m, k, minus, b, m, one, c, m)
        if info[0] == 0:
            _strtri(lower, plain, k, a, k, said)
    else:
        _dpotrf(lower, k, a, k, said)
        if info[0] == 0 and len(update) > 0:
            _dtrsm(right, lower, turned, plain, m, k, one, a, k, b, m)
            _dsyrk(lower, plain, m, k, minus, b, m, one, c, m)
        if info[0] == 0:
            _dtrtri(lower, plain, k, a, k, said)
    definite: bool = info[0] == 0
    if definite:
        write(factor, own)
    # Arrays are freed after their last use, and an address is none: these are used once more after the calls.
    kept: bool = letters[0] > 0 and sizes[0] >= 0 and numbers[0] > 0.0
    return definite and kept


@unlocked
def push(x: Array, store: Array, begins: Array, starts: Array, ends: Array, changes: Array, fronts: Array) -> None:
    """Eliminate one or many right-hand sides x, (n,) or (n, p), in place, by some fronts.

    Parameters
    ----------
    x : array
        Its rows are in order of elimination.
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
    for front in fronts:
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m, begin = len(own), len(others), begins[front]
        write(np.dot(store[begin : begin + k * k].reshape(k, k).T, own), own)
        pushed = np.dot(store[begin + k * k : begin + k * (k + m)].reshape(k, m).T, own)
        for place in np.ndindex(pushed.shape):
            x[(others[place[0]], *place[1:])] -= pushed[place]


@unlocked
def pull(
    x: Array, store: Array, begins: Array, starts: Array, ends: Array, changes: Array, fronts: Array, signs: Array
) -> None:
    """Solve for x by some fronts, from the last to the first, after all are eliminated; see `push`."""
    for front in fronts[::-1]:
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m, begin = len(own), len(others), begins[front]
        pulled = np.dot(store[begin + k * k : begin + k * (k + m)].reshape(k, m), x[others])
        for place in np.ndindex(pulled.shape):
            pulled[place] = signs[starts[front] + place[0]] * own[place] - pulled[place]
        write(np.dot(store[begin : begin + k * k].reshape(k, k), pulled), own)
