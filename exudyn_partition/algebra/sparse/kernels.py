"""Compiled loops of the factorisation by fronts; module `multifrontal` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.compiled import compiled


@compiled
def add(change: Array, place: Array, own: Array, below: Array, update: Array) -> None:
    """Add what a child leaves to its places in the front; all arrays but `place` are transposed, with rows in order.

    Parameters
    ----------
    change : (c, c) array
        Its upper triangle counts.
    place : (c,) int array
        Ascending.
    own, below, update : (k, k), (k, m), (m, m) arrays
    """
    k, c = len(own), len(place)
    for i in range(c):
        row = place[i]
        if row < k:
            for j in range(i, c):
                if place[j] < k:
                    own[row, place[j]] += change[i, j]
                else:
                    below[row, place[j] - k] += change[i, j]
        else:
            for j in range(i, c):
                update[row - k, place[j] - k] += change[i, j]


@compiled
def solve(x: Array, store: Array, starts: Array, ends: Array, changes: Array, signs: Array) -> None:
    """Solve for one right-hand side x, (n,), in place; its rows are in order of elimination.

    Parameters
    ----------
    store : array
        Of one front after the other, `inverse` and `below`, each with its columns one behind the other.
    starts : (nf + 1,) int array
        Which rows each front eliminates.
    ends : (nf + 1,) int array
        Where the rows begin in `changes` that each front changes.
    changes : int array
    signs : (n,) array
    """
    begin = 0
    for front in range(len(starts) - 1):
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m = len(own), len(others)
        own[:] = np.dot(own, store[begin : begin + k * k].reshape(k, k))
        begin += k * k
        pushed = np.dot(own, store[begin : begin + k * m].reshape(k, m))
        begin += k * m
        for i in range(m):
            x[others[i]] -= pushed[i]
    for front in range(len(starts) - 2, -1, -1):
        own, others = x[starts[front] : starts[front + 1]], changes[ends[front] : ends[front + 1]]
        k, m = len(own), len(others)
        known = np.empty(m, x.dtype)
        for i in range(m):
            known[i] = x[others[i]]
        begin -= k * m
        pushed = np.dot(store[begin : begin + k * m].reshape(k, m), known)
        for i in range(k):
            pushed[i] = signs[starts[front] + i] * own[i] - pushed[i]
        begin -= k * k
        own[:] = np.dot(store[begin : begin + k * k].reshape(k, k), pushed)
