"""The equations of contact rows with friction that are closed, and the factors of their Jacobian.

The trial force of a row is x = lambda_t - w_t / F_tt. The row slips if |x| is above mu lambda_n. Then its equations are
turned to the direction d of x, and to the direction across. The share c = mu lambda_n / |x| says how far it slips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ..support.arrays import Array
from . import loops
from .flat_friction import CHORD_STEPS


class Slip(NamedTuple):
    """Rows that slip, k of them, with their directions.

    Parameters
    ----------
    along, across : (k,) int arrays
        Numbers of their two tangents among the directions of the closed rows.
    d1, d2 : (k,) arrays
        Direction of the trial force.
    c : (k,) array
        Bound of the force over the length of the trial force.
    mu : (k,) array
    """

    along: Array
    across: Array
    d1: Array
    d2: Array
    c: Array
    mu: Array

    def project(self, A: Array) -> None:
        """Keep of the tangents of the rows of A, (3 na, m), what moves the force: across d, its share c."""
        turned = (self.c * self.d1)[:, None] * A[self.across] - (self.c * self.d2)[:, None] * A[self.along]
        # They are turned back to the tangents, so that the right-hand side of a step needs no turning.
        A[self.along], A[self.across] = -self.d2[:, None] * turned, self.d1[:, None] * turned

    def add_bounds(self, A: Array) -> None:
        """Add what the bounds and directions of the forces add to the projected Jacobian A, (3 na, 3 na)."""
        d1, d2, c = self.d1, self.d2, self.c
        A[self.along, self.along] += d1 * d1 + (1.0 - c) * d2 * d2
        A[self.across, self.across] += d2 * d2 + (1.0 - c) * d1 * d1
        A[self.along, self.across] += c * d1 * d2
        A[self.across, self.along] += c * d1 * d2
        A[self.along, self.along - 1] -= d1 * self.mu
        A[self.across, self.along - 1] -= d2 * self.mu


class Factors:
    """LU factors of the Jacobian of rows whose slips are given.

    Parameters
    ----------
    F : (3 na, 3 na) array
        Flexibility of the rows, scaled to forces. It is overwritten.
    slip : Slip
    """

    def __init__(self, F: Array, slip: Slip) -> None:
        slip.project(F)
        slip.add_bounds(F)
        self.slip = slip
        self.lu: tuple[Array, Array] = lapack.dgetrf(F)[:2] if len(F) else (F, np.empty(0))

    def solve(self, rhs: Array) -> Array:
        """Solve for right-hand sides, (3 na,) or (3 na, m)."""
        if not rhs.size:
            return np.zeros_like(rhs)
        solution: Array = lapack.dgetrs(*self.lu, rhs)[0]
        return solution


class ClosedRows:
    """The equations of Alart and Curnier for rows that are closed.

    Parameters
    ----------
    F : (3 nr, 3 nr) array
        Flexibility of all rows [m/N].
    inverse : (nr, 3) array
        Scales of all rows' gaps and slips to forces [N/m].
    index : (na,) int array
        Rows that are closed.

    Attributes
    ----------
    open : (nr - na,) int array
        The other rows.
    stale : bool
        Whether the Jacobian should be factorised again.
    steps : int
        Steps with the present factors, in this answer.
    """

    def __init__(self, F: Array, inverse: Array, index: Array) -> None:
        self._set_rows(inverse, index)
        columns = F[:, directions(index)]
        self._onto_open = columns[3 * self.open]
        self._F = np.ascontiguousarray(self._inverse[:, None] * columns[directions(index)])

    def _set_rows(self, inverse: Array, index: Array) -> None:
        """Begin with these closed rows, (na,), without factors; `inverse`, (nr, 3), are the scales of all rows."""
        self.open = np.delete(np.arange(len(inverse)), index)
        self._inverse = inverse[index].ravel()
        self._moves, self._squares = np.empty((CHORD_STEPS + 2, 3 * len(index))), np.empty(CHORD_STEPS + 2)
        self._factorised = np.empty(0, dtype=bool)
        self.stale, self.steps = True, 0

    def load(self, h: Array, mu: Array) -> None:
        """Take gaps and slips, (na, 3), and coefficients, (na,)."""
        self._h, self._mu = self._inverse * h.ravel(), mu
        self.steps = 0

    def moved_open(self, lam: Array) -> Array:
        """How far forces on the closed rows, (3 na,) [N], move the gaps of the others, (nr - na,) [m]."""
        value: Array = self._onto_open @ lam
        return value

    @property
    def slips(self) -> Array:
        """Which rows slip, (na,)."""
        slips: Array = self._length > self._bound
        return slips

    @property
    def changed(self) -> bool:
        """Whether other rows slip than those that the factors belong to."""
        return bool((self.slips != self._factorised).any())

    def residual(self, lam: Array) -> float:
        """Largest force that the law leaves unbalanced [N]."""
        law = loops.friction_residual(self._h + self._pushed(lam), lam, self._mu)
        self._value, self._x1, self._x2, self._length, self._bound, largest = law
        return largest

    def _pushed(self, lam: Array) -> Array:
        """F lambda of the closed rows, scaled to forces, (3 na,)."""
        value: Array = self._F @ lam
        return value

    def allowed(self, lam: Array) -> Array:
        """Forces without the rounding by which they are beyond the law, (3 na,) [N]."""
        lam = lam.reshape(-1, 3)
        lam[:, 0] = np.maximum(lam[:, 0], 0.0)
        length = np.hypot(lam[:, 1], lam[:, 2])
        lam[:, 1:] *= np.minimum(1.0, self._bound / (length + 1e-300))[:, None]
        return lam

    def factorise(self, lam: Array, *, wholly: bool = False) -> None:
        """Factorise the Jacobian at the last residual.

        Of blocks, only those in which other rows slip are factorised again, unless there are none, or `wholly`.
        """
        self._factorised = self.slips if lam.any() else np.zeros(len(self._mu), dtype=bool)  # unless guessed, all stick
        self._make_factors(wholly)
        self.stale, self.steps = False, 0

    def _make_factors(self, wholly: bool) -> None:
        self._factors = Factors(self._F.copy(), self._slip(slice(0, len(self._mu))))

    def _slip(self, part: slice) -> Slip:
        """The rows that slip, of some that lie one behind the other."""
        rows = np.flatnonzero(self._factorised[part])
        length, x1, x2, bound, mu = (
            values[part][rows] for values in (self._length, self._x1, self._x2, self._bound, self._mu)
        )
        return Slip(3 * rows + 1, 3 * rows + 2, x1 / length, x2 / length, bound / length, mu)

    def step(self) -> tuple[Array, float]:
        """Newton step with the present factors, (3 na,), corrected by the steps made with them, and its largest entry.

        The correction is that of Broyden. Forces are in N.
        """
        self.steps += 1
        return loops.chord_step(self._factors.lu, self._value, self._moves, self._squares, self.steps - 1)

    def response(self, way: Array) -> Array:
        """Minus the change of the forces, (3 na, m) [N], due to ways of rows, (3 na, m) [m], with present factors."""
        rhs = self._inverse[:, None] * way
        self._factors.slip.project(rhs)
        return self._factors.solve(rhs)


def directions(index: Array) -> Array:
    """Numbers of the three directions of some rows, (3 na,)."""
    value: Array = (3 * index[:, None] + np.arange(3)).ravel()
    return value
