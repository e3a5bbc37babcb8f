"""Iterations that learn from their last steps: Anderson's acceleration of fixed points, Broyden's stiffness.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

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


class Broyden:
    """Stiffness K of a force f(q), df = -K dq, corrected along the last step dq of an iteration by what f did there.

    References
    ----------
    C. G. Broyden, A class of methods for solving nonlinear simultaneous equations, Math. Comp. 19, 1965.
    """

    def __init__(self) -> None:
        self._last: tuple[Array, Array] | None = None
        self._step: tuple[Array, Array] | None = None

    def see(self, q: Array, force: Array) -> None:
        """Take note of the force, (n,), at coordinates q, (n,)."""
        if self._last is not None:
            step, change = q - self._last[0], force - self._last[1]
            if np.linalg.norm(change) > _TELLING * np.linalg.norm(force):
                self._step = step, change
        self._last = q.copy(), force.copy()

    def corrected(self, stiffness: Array) -> Array:
        """Stiffness, (n, n), that explains the last step, with the least change of the given one, (n, n)."""
        if self._step is None:
            return stiffness
        step, change = self._step
        return stiffness - np.outer(change + stiffness @ step, step / (step @ step))
