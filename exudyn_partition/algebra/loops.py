"""The loops of complementarity and friction: compiled if numba is there, else by NumPy and LAPACK.

Of this folder, only this module and `products` know which. `kernels` and `friction_kernels` have the compiled loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.linalg import lapack

from ..support.arrays import Array, plain
from ..support.compiled import kernels

if TYPE_CHECKING:
    from .flat_friction import FlatFriction
    from .friction_kernels import FrictionObject


def check_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, scale: float = 0.0
) -> tuple[Array, Array, int]:
    """Forces on the active rows, (n,), which rows violate their condition, (n,), and how many do.

    Parameters
    ----------
    F : (n, n) array
        Symmetric [m/N], with rows one after the other in memory.
    factor : (na, na) array
        Transpose of the lower factor of Cholesky of the active part.
    index : (na,) int array
        Active rows.
    h : (n,) array
        [m]
    rounding, scale : float
        By rounding times scale an inactive row may be violated. A scale of zero is the largest entry of h.
    """
    if compiled := kernels("algebra"):
        lam, wrong, count = compiled.check_active(F, factor, index, h, rounding, scale)
        return lam, wrong, count
    lam, w = np.zeros(len(h)), h
    if index.size:
        active = lapack.dpotrs(factor.T, -h[index], lower=1)[0]
        lam[index] = active
        w = h + active @ F[index]
    wrong = w < -rounding * (scale or abs(h).max())
    wrong[index] = lam[index] < 0.0
    return lam, wrong, int(np.count_nonzero(wrong))


def solve_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, steps: int, most: int
) -> tuple[Array, Array, Array, int, int]:
    """Change the active rows until none violates its condition; see `check_active`.

    They are changed `steps` times at most, compiled only as long as they are no more than `most`: LAPACK is faster
    then.

    Returns
    -------
    Forces, the active rows' factor, their numbers, how often they were changed, and how many rows violate their
    condition; -1 if the active part of F is not positive definite with the rows that should be active next.
    """
    if compiled := kernels("algebra"):
        lam, factor, index, changes, count = compiled.solve_active(F, factor, index, plain(h), rounding, steps, most)
        return lam, factor, index, changes, count
    lam, wrong, count = check_active(F, factor, index, h, rounding)
    for step in range(steps):
        if not count:
            return lam, factor, index, step, 0
        wrong[index] = ~wrong[index]
        chosen = np.flatnonzero(wrong)
        lower, indefinite = lapack.dpotrf(F.take(chosen, axis=0).take(chosen, axis=1).T, lower=1, overwrite_a=1)
        if indefinite:
            return lam, factor, index, step, -1
        factor, index = lower.T, chosen
        lam, wrong, count = check_active(F, factor, index, h, rounding)
    return lam, factor, index, steps, count


def iterate(
    core: tuple[Array, ...], S: sp.csr_matrix, a: Array, G: Array, pressed: Array, c: Array, settled: float, steps: int
) -> Array | None:
    """Return c = S (a - G c), (n, m), by iteration; None if it does not settle.

    Parameters
    ----------
    core : FlatCore
        S in flat arrays, see `BlockComplementarity`.
    S : (n m, n m) csr matrix
        The same.
    a : (n, m) array
    G : (k, m, m) array
        Of the blocks that have forces.
    pressed : (k,) int array
        Numbers of these blocks.
    c : (n, m) array
        A guess.
    settled : float
        Relative change at which c is settled.
    steps : int
        Most passes over all blocks.
    """
    if compiled := kernels("algebra"):
        result = c.copy()
        return result if compiled.iterate(core, a, G, pressed, result, settled, steps) else None
    for _ in range(steps):
        forces = a.copy()
        forces[pressed] -= (G @ c[pressed, :, None])[:, :, 0]
        before, c = c, np.asarray(S @ forces.ravel()).reshape(c.shape)
        if abs(c - before).max() <= settled * abs(c).max():
            return c
    return None


def solve_blocks(
    blocks: tuple[object, ...], h: Array, rounding: float, settled: float, steps: int, patience: int
) -> bool:
    """Solve all blocks of a `FlatBlocks` at once for h, (nr,), and keep the answer there; False if it is not found.

    NumPy never finds it: there, `BlockComplementarity` goes through the blocks.
    """
    if compiled := kernels("algebra"):
        return bool(compiled.solve_blocks(blocks, h, rounding, settled, steps, patience))
    return False


def newton_at_once() -> bool:
    """Whether `newton_friction` is there; else `friction.FrictionProblem` goes step by step."""
    return kernels("algebra", "friction_kernels") is not None


def friction_object(problem: FlatFriction) -> FrictionObject:
    """The same arrays as one object, as `newton_friction` takes it."""
    compiled = kernels("algebra", "friction_kernels")
    assert compiled is not None, "asked for what is only done at once"
    found: FrictionObject = compiled.friction_object(*problem)
    return found


def newton_friction(
    problem: FrictionObject, h: Array, mu: Array, fresh: bool, limits: tuple[float, float, float, int, int]
) -> bool:
    """Make the steps of Newton's method for contact with friction; return whether forces have settled.

    Parameters
    ----------
    problem : FrictionObject
        With n rows. Its forces and states are a guess, then the answer.
    h : (n, 3) array
        Gaps and slips without the forces [m].
    mu : (n,) array
        Coefficients of friction.
    fresh : bool
        Whether other rows are in `closed` than before.
    limits
        See `flat_friction.FRICTION_LIMITS`.
    """
    compiled = kernels("algebra", "friction_kernels")
    assert compiled is not None, "asked for what is only done at once"
    return bool(compiled.newton_friction(problem, h, mu, fresh, limits))


def friction_residual(places: Array, lam: Array, mu: Array) -> tuple[Array, Array, Array, Array, Array, float]:
    """Forces that the law of friction leaves unbalanced.

    Parameters
    ----------
    places : (3 na,) array
        h + F lambda, scaled to forces [N].
    lam : (3 na,) array
        [N]
    mu : (na,) array

    Returns
    -------
    Unbalanced forces, (3 na,), trial forces along both tangents, their length, their bound, (na,) each, and the largest
    unbalanced force [N].
    """
    if compiled := kernels("algebra", "friction_kernels"):
        found: tuple[Array, Array, Array, Array, Array, float] = compiled.friction_residual(places, lam, mu)
        return found
    value = places.copy()
    x1, x2 = lam[1::3] - value[1::3], lam[2::3] - value[2::3]
    length = np.sqrt(x1 * x1 + x2 * x2)
    bound = mu * np.maximum(lam[::3], 0.0)
    share = np.minimum(1.0, bound / (length + 1e-300))
    value[1::3] = lam[1::3] - share * x1
    value[2::3] = lam[2::3] - share * x2
    return value, x1, x2, length, bound, float(abs(value).max())


def chord_step(
    factors: tuple[Array, Array], value: Array, moves: Array, squares: Array, count: int
) -> tuple[Array, float]:
    """Newton step, (3 na,) [N], with factors of an earlier one, corrected as Broyden does; and its largest entry.

    Parameters
    ----------
    factors : (3 na, 3 na) array, (3 na,) int array
        LU factors and pivots of LAPACK.
    value : (3 na,) array
        Unbalanced forces [N].
    moves, squares : (k, 3 na), (k,) arrays
        The steps made with these factors, and their squares; this one is added.
    count : int
        How many there are before.
    """
    if compiled := kernels("algebra", "friction_kernels"):
        lu, pivots = factors
        step, largest = compiled.chord_step(lu.T, pivots, value, moves, squares, count)
        return step, largest
    return corrected_step(lapack.dgetrs(*factors, -value, overwrite_b=1)[0], moves, squares, count)


def corrected_step(step: Array, moves: Array, squares: Array, count: int) -> tuple[Array, float]:
    """Newton step, (n,), corrected as in `chord_step`, and its largest entry; `step` is overwritten."""
    for m in range(count - 1):
        step += moves[m + 1] * (moves[m] @ step / squares[m])
    if count:
        step /= 1.0 - moves[count - 1] @ step / squares[count - 1]
    moves[count], squares[count] = step, step @ step
    return step, float(abs(step).max())
