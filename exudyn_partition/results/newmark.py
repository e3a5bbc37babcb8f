"""Energy that implicit steps take: Newmark's method and generalized-alpha (Chung and Hulbert 1993).

With increments [x] = x' - x and means <x> = (x + x') / 2 over a step h, Newmark's formulas with the algorithmic
accelerations a are [v] = h <a> + h (gamma - 1/2) [a] and [u] = h <v> + h^2 (beta - gamma / 2) [a]. They and
generalized-alpha's M ((1 - alpha_m) a' + alpha_m a) = (1 - alpha_f) F' + alpha_f F give, for all forces F,

    <F> [u] = [T] + h^2 (beta - gamma / 2) ([a M a] / 2 + (gamma - 1/2) [a] M [a])
              + ((1 - alpha_m - gamma) M [a] - (1/2 - alpha_f) [F]) [u].

The left side is the work of the forces, exactly -[U] of those that are linear in u. What is there beside the kinetic
energy T is what the method takes: nothing at alpha_m = alpha_f = 1/2, beta = 1/4, gamma = 1/2, whatever the forces are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from ..support.optional import require

_BLOCK = 256  # coordinates that are looked at at once, which bounds the memory


@dataclass(frozen=True)
class Newmark:
    """Parameters of an implicit method with equal or other steps.

    Parameters
    ----------
    alpha_m, alpha_f : float
        Of generalized-alpha; zero for Newmark's method.
    beta, gamma : float
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float

    @property
    def damps(self) -> bool:
        """Whether the method takes energy."""
        return self.gamma > 0.5

    @property
    def spectral_radius(self) -> float:
        """Spectral radius at infinity of generalized-alpha; 1 for Newmark's method, whose damping is another one."""
        return self.alpha_f / (1 - self.alpha_f) if self.alpha_m or self.alpha_f else 1.0

    def taken(self, t: Array, u: Array, v: Array, mass: Array) -> Array:
        """Energy that the method has taken since the start, (n,) [J].

        Parameters
        ----------
        t : (n,) array
            Ends of all steps [s].
        u, v : (n, k) arrays
            Coordinates and their velocities then; NaN for coordinates whose rates these are not, as of rotations.
        mass : (k,) array
            Of the coordinates, which nothing couples.
        """
        taken = np.zeros(len(t))
        if len(t) > 1 and self.damps:
            h = np.diff(t)[:, None]
            for start in range(0, v.shape[1], _BLOCK):
                some = slice(start, start + _BLOCK)
                taken[1:] += self._of_steps(h, u[:2, some], v[:, some], mass[some])
        value: Array = np.cumsum(taken)
        return value

    def _of_steps(self, h: Array, u: Array, v: Array, mass: Array) -> Array:
        """Energy that each step h, (n - 1, 1), takes, (n - 1,); u is (2, k)."""
        rate = np.diff(v, axis=0) / h
        curved = u[1] - u[0] - h[0] * (v[0] + v[1]) / 2
        first = rate[0] - self.gamma / (self.beta - self.gamma / 2) * curved / h[0] ** 2
        a = _recursion(rate / self.gamma, 1 - 1 / self.gamma, np.where(np.isnan(first), rate[0], first))
        Ma = mass * a
        of_step = (1 - self.alpha_m) * Ma[1:] + self.alpha_m * Ma[:-1]
        F = _recursion(of_step / (1 - self.alpha_f), -self.alpha_f / (1 - self.alpha_f), Ma[0])
        change, change_M = np.diff(a, axis=0), np.diff(Ma, axis=0)
        way = h * (v[1:] + v[:-1]) / 2 + h**2 * (self.beta - self.gamma / 2) * change
        forces = (1 - self.alpha_m - self.gamma) * change_M - (0.5 - self.alpha_f) * np.diff(F, axis=0)
        held = 0.5 * np.diff(np.sum(a * Ma, axis=1)) + (self.gamma - 0.5) * np.sum(change * change_M, axis=1)
        value: Array = h[:, 0] ** 2 * (self.beta - self.gamma / 2) * held + np.sum(forces * way, axis=1)
        return value


def _recursion(x: Array, factor: float, first: Array) -> Array:
    """y[0] = first, y[i + 1] = factor y[i] + x[i]; (n, k) -> (n + 1, k). What `first` lacks dies out."""
    rest, _ = require("scipy.signal").lfilter([1.0], [1.0, -factor], x, axis=0, zi=(factor * first)[None])
    return np.vstack([first, rest])
