"""Compiled conjugate gradients, see `conjugate_gradients`."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.compiled import unlocked


@unlocked
def solve(starts: Array, columns: Array, blocks: Array, inverse: Array, r: Array, solved: float, steps: int) -> Array:
    """Solve for all right-hand sides r, (3 n, k), at once; r becomes what is left.

    Parameters
    ----------
    starts, columns, blocks : (n + 1,) int array, int array, (nb, 3, 3) array
        The matrix, as in `scipy.sparse.bsr_matrix`.
    inverse : (3 n,) array
        Of its diagonal.
    """
    n, k = r.shape
    x, p, q = np.zeros(r.shape, r.dtype), np.empty(r.shape, r.dtype), np.empty(r.shape, r.dtype)
    sizes, curvature, ahead, back = np.zeros(k), np.zeros(k), np.zeros(k, r.dtype), np.zeros(k, r.dtype)
    for i in range(n):
        for j in range(k):
            p[i, j] = inverse[i] * r[i, j]
            sizes[j] += r[i, j] * p[i, j]
    goals = np.empty(k)
    for j in range(k):
        goals[j] = solved * solved * sizes[j]
    for _ in range(steps):
        for j in range(k):
            curvature[j] = 0.0
        for i in range(len(starts) - 1):
            a, b, c = q[3 * i], q[3 * i + 1], q[3 * i + 2]
            for j in range(k):
                a[j] = b[j] = c[j] = 0.0
            for m in range(starts[i], starts[i + 1]):
                block, column = blocks[m], 3 * columns[m]
                u, v, w = p[column], p[column + 1], p[column + 2]
                d00, d01, d02 = block[0, 0], block[0, 1], block[0, 2]
                d10, d11, d12 = block[1, 0], block[1, 1], block[1, 2]
                d20, d21, d22 = block[2, 0], block[2, 1], block[2, 2]
                for j in range(k):
                    a[j] += d00 * u[j] + d01 * v[j] + d02 * w[j]
                    b[j] += d10 * u[j] + d11 * v[j] + d12 * w[j]
                    c[j] += d20 * u[j] + d21 * v[j] + d22 * w[j]
            u, v, w = p[3 * i], p[3 * i + 1], p[3 * i + 2]
            for j in range(k):
                curvature[j] += a[j] * u[j] + b[j] * v[j] + c[j] * w[j]
        for j in range(k):
            ahead[j] = sizes[j] / curvature[j] if curvature[j] > 0.0 else 0.0
            back[j], sizes[j] = sizes[j], 0.0
        for i in range(n):
            for j in range(k):
                x[i, j] += ahead[j] * p[i, j]
                r[i, j] -= ahead[j] * q[i, j]
                sizes[j] += inverse[i] * r[i, j] * r[i, j]
        done = True
        for j in range(k):
            done = done and sizes[j] <= goals[j]
            back[j] = sizes[j] / back[j] if back[j] > 0.0 else 0.0
        if done:
            break
        for i in range(n):
            for j in range(k):
                p[i, j] = inverse[i] * r[i, j] + back[j] * p[i, j]
    return x
