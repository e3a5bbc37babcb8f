"""Contact with friction, row by row: an exact answer of one row, and sweeps over all of them (block Gauss-Seidel)."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array


def sweep(F: Array, h: Array, mu: Array, lam: Array) -> Array:
    """Forces after one sweep, (nr, 3) [N]: each row is solved exactly for the present forces of the others.

    Parameters
    ----------
    F : (3 nr, 3 nr) array
        Flexibility of the rows [m/N].
    h : (nr, 3) array
        Gaps and slips without the forces [m].
    mu : (nr,) array
        Coefficients of friction.
    lam : (nr, 3) array
        Present forces [N].
    """
    lam = lam.copy()
    w = h.ravel() + F @ lam.ravel()
    for row in range(len(h)):
        of_row = slice(3 * row, 3 * row + 3)
        block = F[of_row, of_row]
        before = lam[row].copy()
        lam[row] = one_row(block, w[of_row] - block @ before, float(mu[row]), before)
        w += F[:, of_row] @ (lam[row] - before)
    return lam


def one_row(F: Array, h: Array, mu: float, guess: Array) -> Array:
    """Forces of a single row, (3,) [N].

    In slip, w_n = 0 gives the normal force for each direction d of the friction force, and d must be parallel to the
    slip. That is a quartic equation. If it has several answers, which needs a high coefficient and normal forces that
    move the row sideways, the one nearest to the guess is taken.

    Parameters
    ----------
    F : (3, 3) array
        Its symmetric positive definite flexibility [m/N].
    h : (3,) array
        Gap and slip without its own forces [m].
    mu : float
        Coefficient of friction.
    guess : (3,) array
        Forces before [N].
    """
    if h[0] >= 0.0:
        return np.zeros(3)
    stick: Array = np.linalg.solve(F, -h)
    if np.hypot(stick[1], stick[2]) <= mu * stick[0]:
        return stick
    f, T = F[1:, 0], F[1:, 1:]
    rest = F[0, 0] * h[1:] - h[0] * f  # the slip, times a positive number, is rest + M d
    M = mu * (np.outer(h[1:], f) - h[0] * T)
    twice = complex(-(M[0, 1] + M[1, 0]), M[1, 1] - M[0, 0]) / 4.0  # slip x d = 0 in powers of exp(i angle)
    once = complex(-rest[1], -rest[0]) / 2.0
    roots = np.roots([twice, once, (M[0, 1] - M[1, 0]) / 2.0, once.conjugate(), twice.conjugate()])
    roots = roots[abs(abs(roots) - 1.0) < 1e-3]
    d = np.column_stack([roots.real, roots.imag]) / abs(roots)[:, None]
    yielding = F[0, 0] + mu * d @ f
    slip = rest + d @ M.T
    d = d[(yielding > 0.0) & (np.einsum("ij,ij->i", slip, d) <= 0.0)]
    if not len(d):
        return guess
    normal = -h[0] / (F[0, 0] + mu * d @ f)
    candidates = np.column_stack([normal, mu * normal[:, None] * d])
    nearest: Array = candidates[np.argmin(np.linalg.norm(candidates - guess, axis=1))]
    return nearest
