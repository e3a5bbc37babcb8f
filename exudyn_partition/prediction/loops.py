"""The loop over the steps of an impact: compiled if numba is there, else by NumPy.

This is the only module of `prediction` that knows which. `kernels` beside it has the compiled loop.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..algebra.complementarity import SOLVING, Complementarity
from ..support.arrays import Array
from ..support.compiled import kernels

Contact = Callable[[Array, float], tuple[Array, Array]]  # coordinates and step to generalised and total forces


def integrate(
    gap: Array, H: Array, F: Array, squares: Array, velocity: Array, steps: tuple[float, int, int]
) -> tuple[Array, Array, Array, Array]:
    """Integrate by velocity Verlet, with contact by complementarity; see `modal_impact.Impact`.

    Parameters
    ----------
    gap, H, F : (nc,), (nc, n), (nc, nc) arrays
        [m], and [m/N].
    squares, velocity : (n,) arrays
        Of circular frequencies [1/s2]; at the start.
    steps : float, int, int
        Length of a step [s], their number, and how many there are from one sample to the next.

    Returns
    -------
    Times (m,) [s], total normal forces (m, 1) [N], velocities (m, n), and rows that carried a force (nc,).
    """
    problem = Complementarity(F)
    if compiled := kernels("prediction"):
        F, *_ = problem.compiled
        *found, solved = compiled.integrate(gap, np.ascontiguousarray(H), F, squares, velocity, *steps, SOLVING)
        if solved:
            return tuple(found)
    none, loaded = np.zeros(len(squares)), np.zeros(len(gap), dtype=bool)

    def contact(q: Array, step: float) -> tuple[Array, Array]:
        nonlocal loaded
        lam = problem.solve(gap + H @ q)
        index = problem.index
        if not index.size:
            return none, lam.sum(keepdims=True)
        loaded[index] = True
        return lam[index] @ H[index], lam.sum(keepdims=True)

    return *verlet(contact, squares, velocity, steps), loaded


def verlet(
    contact: Contact, squares: Array, velocity: Array, steps: tuple[float, int, int]
) -> tuple[Array, Array, Array]:
    """Integrate by velocity Verlet with the generalised forces of contact and its total force, (n,) and (k,)."""
    (step, count, stride), q, v = steps, np.zeros(len(squares)), velocity.copy()
    generalised, force = contact(q, step)
    a = generalised - squares * q
    samples = [(0.0, force, v.copy())]
    for n in range(1, count + 1):
        v += 0.5 * step * a
        q += step * v
        generalised, force = contact(q, step)
        a = generalised - squares * q
        v += 0.5 * step * a
        if n % stride == 0 or n == count:
            samples.append((n * step, force, v.copy()))
    t, force_at, v_at = zip(*samples, strict=True)
    return np.array(t), np.array(force_at), np.array(v_at)
