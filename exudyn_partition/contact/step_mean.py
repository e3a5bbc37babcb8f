"""Forces that are constant within an implicit step, in generalized-alpha, whose forces belong to the ends of steps.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array

_GONE = 1e-12  # of the largest force so far, below which what is left of earlier steps counts as none


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Coefficients of generalized-alpha with algorithmic accelerations a (Arnold, Brüls 2007); default: trapezoidal.

    With step s and accelerations q_tt::

        (1 - alpha_m) a' + alpha_m a = (1 - alpha_f) q_tt' + alpha_f q_tt
        q'   = q + s q_t + s^2 ((1/2 - beta) a + beta a')
        q_t' = q_t + s ((1 - gamma) a + gamma a')
    """

    alpha_m: float = 0.5
    alpha_f: float = 0.5
    beta: float = 0.25
    gamma: float = 0.5

    def by_q_tt(self, step: float) -> float:
        """Change of q_tt' with q' in Newton's iteration [1/s2]."""
        return (1 - self.alpha_m) / (step**2 * self.beta * (1 - self.alpha_f))

    def by_q_t(self, step: float) -> float:
        """Change of q_t' with q' [1/s]."""
        return self.gamma / (step * self.beta)

    @property
    def share(self) -> float:
        """Change of the force at the end of a step with the mean force within it."""
        return (1 - self.alpha_m) / (self.gamma * (1 - self.alpha_f))


TRAPEZOIDAL = GeneralizedAlpha()


class StepMean:
    """What to apply at the end of each step, so that the velocities change by the mean force within the step.

    Generalized-alpha adds s ((1 - gamma) phi + gamma phi') to the momentum, where phi follows from the applied forces f
    as algorithmic accelerations do from accelerations. So that this is s p, it takes

        phi' = (p - (1 - gamma) phi) / gamma,    f' = ((1 - alpha_m) phi' + alpha_m phi - alpha_f f) / (1 - alpha_f) .

    Where p is smooth, so is f. After a jump of p, f swings about it and decays by the spectral radius in a step;
    velocities and places know p alone.

    Parameters
    ----------
    n : int
        Number of forces.

    Attributes
    ----------
    lasting : (n,) array
        Part of f' that earlier steps have left.
    """

    def __init__(self, n: int) -> None:
        self._phi, self._force, self._largest = np.zeros(n), np.zeros(n), 0.0
        self._weights: GeneralizedAlpha | None = None
        self.lasting = np.zeros(n)

    def begin(self, weights: GeneralizedAlpha) -> None:
        """Begin a step with these weights."""
        if weights == self._weights:
            return
        self._weights, a, b = weights, weights.alpha_m, weights.alpha_f
        phi = a - (1 - a) * (1 - weights.gamma) / weights.gamma
        self.lasting = (phi * self._phi - b * self._force) / (1 - b)

    def applied(self, mean: Array) -> Array:
        """Return f', (n,), for the mean forces within the step, (n,)."""
        assert self._weights is not None
        result: Array = self._weights.share * mean + self.lasting
        return result

    def end(self, mean: Array) -> None:
        """End the step, in which these were the mean forces, (n,)."""
        if self._weights is None:
            return
        weights, force = self._weights, self.applied(mean)
        self._phi = (mean - (1 - weights.gamma) * self._phi) / weights.gamma
        self._force, self._weights = force, None
        left = max(abs(self._phi).max(initial=0.0), abs(force).max(initial=0.0))
        self._largest = max(self._largest, left)
        if left <= _GONE * self._largest:
            self._phi, self._force, self._largest = np.zeros_like(force), np.zeros_like(force), 0.0
