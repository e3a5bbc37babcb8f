"""Iterations that learn from their last steps: Anderson's acceleration of fixed points, Broyden's stiffness.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..support.arrays import Array

_TELLING = 1e-3  # change of a force, relative: smaller ones may be the rounding of an iteration that found it
DEPTH = 8  # of Anderson's acceleration: number of earlier guesses that count


class Anderson:
    """Next guesses of x = g(x), from the last few guesses and what they led to.

    Attributes
    ----------
    shares : (k,) array
        Of the last k guesses, at most `DEPTH` + 1, in the combination of them whose change g(x) - x is least if g is
        linear. Their sum is 1.
    least : float
        Norm of this change.

    References
    ----------
    H. F. Walker, P. Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49, 2011.
    """

    def __init__(self) -> None:
        self.shares, self.least = np.ones(1), np.inf
        self._steps: list[Array] = []
        self._changes: list[Array] = []
        self._last: tuple[Array, Array] | None = None

    def guess(self, x: Array, led_to: Array) -> Array:
        """Return the next guess, (n,), after x, (n,), led to g(x), (n,)."""
        residual = led_to - x
        if self._last is not None:
            self._steps.append(led_to - self._last[0])
            self._changes.append(residual - self._last[1])
            del self._steps[:-DEPTH], self._changes[:-DEPTH]
        self._last = led_to, residual
        if not self._changes:
            self.least = float(np.linalg.norm(residual))
            return led_to
        changes = np.array(self._changes)
        back = scipy.linalg.lstsq(changes.T, residual, cond=1e-12, check_finite=False)[0]
        self.shares = np.diff(np.r_[0.0, back, 1.0])
        self.least = float(np.linalg.norm(residual - back @ changes))
        return np.asarray(led_to - back @ np.array(self._steps))


@dataclass(frozen=True, eq=False)
class Secant:
    """Last step of an iteration that looks for a zero of a force f(q), and what f did there: Broyden's formula.

    Parameters
    ----------
    last : tuple of two (n,) arrays, optional
        Last coordinates, and the force there.
    step : tuple of two (n,) arrays, optional
        Last step in which the force changed by more than its rounding, and this change.

    References
    ----------
    C. G. Broyden, A class of methods for solving nonlinear simultaneous equations, Math. Comp. 19, 1965.
    """

    last: tuple[Array, Array] | None = None
    step: tuple[Array, Array] | None = None

    def then(self, q: Array, force: Array) -> Secant:
        """Return the secant after the next step, to coordinates q, (n,), with a force, (n,)."""
        step = self.step
        if self.last is not None:
            way, change = q - self.last[0], force - self.last[1]
            if np.linalg.norm(change) > _TELLING * np.linalg.norm(force):
                step = way, change
        return Secant((q.copy(), force.copy()), step)

    def corrected(self, stiffness: Array) -> Array:
        """Stiffness K, df = -K dq, (n, n), that explains the last step, with the least change of the given one."""
        if self.step is None:
            return stiffness
        way, change = self.step
        return stiffness - np.outer(change + stiffness @ way, way / (way @ way))
