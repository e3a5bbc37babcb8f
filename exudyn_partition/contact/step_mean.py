"""Forces that are constant within implicit steps; generalized-alpha itself has forces at the ends of steps.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array

_GONE = 1e-12  # of the largest force so far: a smaller remainder of earlier steps counts as zero


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
        """Derivative of q_tt' with respect to q' in Newton's iteration [1/s2]."""
        return (1 - self.alpha_m) / (step**2 * self.beta * (1 - self.alpha_f))

    def by_q_t(self, step: float) -> float:
        """Derivative of q_t' with respect to q' [1/s]."""
        return self.gamma / (step * self.beta)

    @property
    def share(self) -> float:
        """Derivative of the force at the end of a step with respect to the mean force within it."""
        return (1 - self.alpha_m) / (self.gamma * (1 - self.alpha_f))


TRAPEZOIDAL = GeneralizedAlpha()


@dataclass(frozen=True, eq=False)
class StepMean:
    """Forces to apply at the end of each step, so that the momentum changes by the mean force times the step.

    Generalized-alpha adds s ((1 - gamma) phi + gamma phi') to the momentum, where phi follows from the applied forces f
    as algorithmic accelerations follow from accelerations. To make this equal to s p for the mean force p, set

        phi' = (p - (1 - gamma) phi) / gamma,    f' = ((1 - alpha_m) phi' + alpha_m phi - alpha_f f) / (1 - alpha_f) .

    Where p is smooth, f is smooth too. After a jump of p, f oscillates about p, and the oscillation decays by the
    spectral radius in each step. Velocities and places depend on p alone.

    Parameters
    ----------
    phi, force : (n,) arrays
        phi and f at the start of the step [N].
    largest : float
        Largest of them so far [N].
    """

    phi: Array
    force: Array
    largest: float = 0.0

    @classmethod
    def none(cls, n: int) -> StepMean:
        """Before the first step, for n forces."""
        return cls(np.zeros(n), np.zeros(n))

    def lasting(self, weights: GeneralizedAlpha) -> Array:
        """Part of f', (n,), that remains from earlier steps."""
        a, b = weights.alpha_m, weights.alpha_f
        phi = a - (1 - a) * (1 - weights.gamma) / weights.gamma
        result: Array = (phi * self.phi - b * self.force) / (1 - b)
        return result

    def after(self, weights: GeneralizedAlpha, mean: Array) -> tuple[Array, StepMean]:
        """Return f', (n,), for the mean forces within a step, (n,), and the state after that step."""
        force: Array = weights.share * mean + self.lasting(weights)
        phi = (mean - (1 - weights.gamma) * self.phi) / weights.gamma
        left = max(abs(phi).max(initial=0.0), abs(force).max(initial=0.0))
        largest = max(self.largest, left)
        return force, StepMean.none(len(force)) if left <= _GONE * largest else StepMean(phi, force, largest)
