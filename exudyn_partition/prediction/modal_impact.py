"""Impacts of reduced bodies in modal coordinates, from which the error of a truncation is estimated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from ..algebra.complementarity import Complementarity, regularised
from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import SLIP, FrictionProblem
from ..errors import InputError
from ..support.arrays import Array
from ..support.optional import require
from . import loops
from .default_step import SAFETY, STEPS_A_PERIOD, resolving_step

_SAMPLES = 5000
_MOST_STEPS = 1e6  # of an impact; more mean a duration in other units


@dataclass(frozen=True, eq=False)
class Impact:
    """An impact in modal coordinates: h = gap + H q, lambda >= 0, h + F lambda >= 0, complementary.

    Parameters
    ----------
    gap : (nc,) array
        Initial gaps, the smallest zero [m].
    H : (nc, n) array
        Modal gap rows.
    F : (nc, nc) array
        Residual flexibility at the rows [m/N].
    omega : (n,) array
        [rad/s], zero for rigid motion.
    velocity : (n,) array
        Initial velocities of the coordinates.
    size : float
        Of the slave's facets [m].
    """

    gap: Array
    H: Array
    F: Array
    omega: Array
    velocity: Array
    size: float

    def truncated(self, omega_top: float) -> tuple[Impact, Array]:
        """The impact with only the static answer of modes above `omega_top`, and a mask of its coordinates."""
        keep = self.omega < omega_top
        cut = self.H[:, ~keep] / self.omega[~keep]
        H, F = self.H[:, keep], self.F + cut @ cut.T
        return replace(self, H=H, F=F, omega=self.omega[keep], velocity=self.velocity[keep]), keep

    def with_means(self, mean: Array) -> Impact:
        """The impact with fewer rows, means of these: (k, nc) weights."""
        return replace(self, gap=mean @ self.gap, H=mean @ self.H, F=mean @ self.F @ mean.T)

    def step(self, f_cut: float, finer: float = 1.0) -> float:
        """Default step of a run with bodies truncated at `f_cut` [s]; the step for the impact is divided by `finer`."""
        problem = Complementarity(self.F)
        stiffness = self.H.T @ np.linalg.solve(problem.F, self.H) + np.diag(self.omega**2)
        limit = float(2 / np.sqrt(scipy.linalg.eigvalsh(stiffness)[-1]))

        def press(gap: Array) -> tuple[float, int]:
            return -0.5 * float(problem.solve(gap) @ gap), len(problem.index)

        def mobility(rows: Array) -> float:
            rigid = self.H[rows][:, self.omega == 0.0].mean(axis=0)
            return float(rigid @ rigid)

        of_impact = resolving_step(
            self.gap, self.H @ self.velocity, mobility, press, size=self.size, limit=lambda: limit
        )
        return min(1 / (STEPS_A_PERIOD * f_cut), SAFETY * limit, of_impact / finer)

    def run(self, duration: float, largest_step: float) -> tuple[Array, Array, Array]:
        """Integrate by velocity Verlet: times (m,), total normal forces (m, 1) [N] and velocities (m, n)."""
        return self._run(duration, largest_step)[:3]

    def loaded(self, duration: float, largest_step: float) -> Array:
        """Rows that carry a force at some time of `run`, (nc,) bool."""
        return self._run(duration, largest_step)[3]

    def forces(self, duration: float, largest_step: float, moments: int) -> Array:
        """Forces of the rows at moments of `run` that part its impulse evenly, (nc, m) [N]; m is `moments` at most."""
        t, total, velocity = self.run(duration, largest_step)
        passed = np.cumsum(total[:, 0])
        at = np.unique(np.searchsorted(passed, passed[-1] * (np.arange(moments) + 0.5) / moments))
        q = require("scipy.integrate").cumulative_trapezoid(velocity, t, axis=0, initial=0.0)[at]
        problem = Complementarity(self.F)
        return np.array([problem.solve(self.gap + self.H @ one).copy() for one in q]).T

    def _run(self, duration: float, largest_step: float) -> tuple[Array, Array, Array, Array]:
        """Return what `run` and `loaded` do."""
        steps = _steps(duration, largest_step)
        return loops.integrate(self.gap, self.H, self.F, self.omega**2, self.velocity, steps)


def _steps(duration: float, largest_step: float) -> tuple[float, int, int]:
    """Length of steps [s], their number, and how many there are from one sample to the next."""
    if duration / largest_step > _MOST_STEPS:
        raise InputError(
            f"duration: {duration:g} s are {duration / largest_step:.2g} steps of {largest_step:.2g} s, which this "
            f"impact needs, expected at most {_MOST_STEPS:g}. Give the time of the impact alone, in s"
        )
    steps = int(np.ceil(duration / largest_step))
    return duration / steps, steps, max(1, steps // _SAMPLES)


@dataclass(frozen=True, eq=False)
class ObliqueImpact(Impact):
    """An impact with friction; the normal part alone decides on steps.

    Parameters
    ----------
    H_t : (2 nc, n) array
        Modal rows of the tangential places, two for each row.
    F_all : (3 nc, 3 nc) array
        Residual flexibility of normal and tangents, interleaved [m/N].
    friction : Coulomb
    """

    H_t: Array
    F_all: Array
    friction: Coulomb

    def truncated(self, omega_top: float) -> tuple[ObliqueImpact, Array]:
        """See `Impact`."""
        keep = self.omega < omega_top
        cut = self._rows()[:, ~keep] / self.omega[~keep]
        normal, _ = super().truncated(omega_top)
        assert isinstance(normal, ObliqueImpact)
        return replace(normal, H_t=self.H_t[:, keep], F_all=self.F_all + cut @ cut.T), keep

    def _rows(self) -> Array:
        """Rows of all directions, interleaved, (3 nc, n)."""
        n = len(self.H)
        return np.concatenate([self.H[:, None], self.H_t.reshape(n, 2, -1)], axis=1).reshape(3 * n, -1)

    def run(self, duration: float, largest_step: float) -> tuple[Array, Array, Array]:
        """Integrate by velocity Verlet: times (m,), normal and two tangential forces (m, 3) [N], velocities (m, n)."""
        problem, n = FrictionProblem(regularised(self.F_all)), len(self.gap)
        rows, none = self._rows(), np.zeros(len(self.omega))
        last, place, mu = np.zeros((n, 3)), np.zeros((n, 2)), np.full(n, self.friction.static)

        def contact(q: Array, step: float) -> tuple[Array, Array]:
            nonlocal last, place, mu
            h = (rows @ q).reshape(n, 3)
            h[:, 0] += self.gap
            now = h[:, 1:].copy()
            h[:, 1:] -= place
            place = now
            if h[:, 0].min() >= 0.0:
                last = np.zeros((n, 3))
                return none, last[0]
            if last.any():
                h[:, 1:] -= (problem.F @ last.ravel()).reshape(n, 3)[:, 1:]
            last = problem.solve(h, mu).copy()
            if not self.friction.constant:
                slip = (h + (problem.F @ last.ravel()).reshape(n, 3))[:, 1:]
                slides = problem.state == SLIP
                mu = coefficients(self.friction, slides, np.linalg.norm(slip, axis=1) / step * slides)
            return last.ravel() @ rows, last.sum(axis=0)

        return loops.verlet(contact, self.omega**2, self.velocity, _steps(duration, largest_step))
