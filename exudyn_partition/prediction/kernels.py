"""Compiled loop of an impact in modal coordinates; module `modal_impact` does the same by NumPy."""

from __future__ import annotations

import math

import numpy as np

from ..algebra.kernels import solve_active
from ..algebra.product_kernels import moved
from ..support.arrays import Array
from ..support.compiled import called, unlocked

find_moved, find_active = called(moved), called(solve_active)


@unlocked
def integrate(
    gap: Array, H: Array, F: Array, squares: Array, velocity: Array, step: float, steps: int, stride: int,
    solving: tuple[float, int, int],
) -> tuple[Array, Array, Array, Array, bool]:  # fmt: skip
    """Integrate by velocity Verlet, with contact by complementarity; see `modal_impact.Impact`.

    Parameters
    ----------
    gap, H, F : (nc,), (nc, n), (nc, nc) arrays
    squares, velocity : (n,) arrays
        Of circular frequencies; at the start.
    stride : int
        Steps between two samples.
    solving : tuple
        See `complementarity.SOLVING`.

    Returns
    -------
    Times (m,), total normal forces (m, 1), velocities (m, n), rows that carried a force (nc,), and whether forces were
    found at all steps.
    """
    n, m = len(squares), 1 + -(-steps // stride)
    t, force, velocities, loaded = np.empty(m), np.empty((m, 1)), np.empty((m, n)), np.zeros(len(gap), np.bool_)
    q, v, a, count = np.zeros(n), np.empty(n), np.empty(n), 0
    for i in range(n):
        v[i] = velocity[i]
    rounding, patience, few = solving
    factor, index = np.empty((0, 0)), np.empty(0, np.int64)
    for k in range(steps + 1):
        if k > 0:
            for i in range(n):
                v[i] += 0.5 * step * a[i]
                q[i] += step * v[i]
        h, total, least = find_moved(gap, H, q), 0.0, np.inf
        for i in range(n):
            a[i] = -squares[i] * q[i]
        for row in range(len(h)):
            if not h[row] >= least:
                least = h[row]
            if least != least:  # NaN
                break
        if not math.isfinite(least):
            return t, force, velocities, loaded, False
        if least < 0.0:
            lam, factor, index, _, wrong = find_active(F, factor, index, h, rounding, patience, few)
            if wrong != 0:
                return t, force, velocities, loaded, False
            for active in range(len(index)):
                row = index[active]
                loaded[row] = True
                total += lam[row]
                for i in range(n):
                    a[i] += lam[row] * H[row, i]
        else:
            factor, index = np.empty((0, 0)), np.empty(0, np.int64)
        if k > 0:
            for i in range(n):
                v[i] += 0.5 * step * a[i]
        if k % stride == 0 or k == steps:
            t[count], force[count, 0] = k * step, total
            for i in range(n):
                velocities[count, i] = v[i]
            count += 1
    return t, force, velocities, loaded, True
