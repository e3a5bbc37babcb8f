"""Time integration of a linear structure under forces on some rows, such as those of contact: HHT."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..algebra.sparse.multifrontal import Analysis
from ..algebra.sparse.solver import factorise
from ..support.arrays import Array


class HHT:
    """Hilber, Hughes and Taylor's integration of M u_tt + K u = G' lambda, with contact forces lambda.

    The part of the acceleration that comes from the contact force is implicit. A step h from u0, v0, a0 is::

        a1 = -M^-1 K ((1 - alpha) u1 + alpha u0),   c = M^-1 G' lambda1
        u1 = u0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1) + h^2/2 c
        v1 = v0 + h ((1 - gamma) a0 + gamma a1) + h c

    At the end of a step the gaps are closed exactly, and contact never adds energy. If c were part of a, as in HHT for
    smooth forces, closed nodes would ring from step to step, and their energy would grow when flat faces meet.

    A step calls `predict`, then `correct` with the forces that close the gaps. These follow from `compliance`.

    Parameters
    ----------
    mass, stiffness : (n, n) csr matrix
        M [kg] and K [N/m].
    rows : (m, n) csr matrix
        G: gaps, or other motions, as linear functions of the displacements.
    step : float
        h [s].
    alpha : float
        Numerical damping, 0 to 1/3.
    velocity : (n,) array, optional
        At the start [m/s]. Default: at rest.

    Attributes
    ----------
    u, v, a : (n,) array
        Displacement [m], velocity [m/s] and the acceleration by stiffness [m/s2], at the end of the last step.

    References
    ----------
    C. Kane, E. A. Repetto, M. Ortiz, J. E. Marsden, Finite element analysis of nonsmooth contact, 1999.
    """

    def __init__(
        self,
        mass: sp.csr_matrix,
        stiffness: sp.csr_matrix,
        rows: sp.csr_matrix,
        step: float,
        *,
        alpha: float = 0.1,
        velocity: Array | None = None,
    ) -> None:
        n = mass.shape[0]
        self._M, self._K, self._G, self._step, self._alpha = mass, stiffness, rows, step, alpha
        self._beta, self._gamma = (1 + alpha) ** 2 / 4, 0.5 + alpha
        both = Analysis(lambda: sp.csr_matrix(mass.astype(bool) + stiffness.astype(bool)))
        self._factor = factorise(mass + (1 - alpha) * self._beta * step**2 * stiffness, both)
        loads = rows.T.toarray()
        self._answer = step**2 / 2 * self._factor.solve(loads)
        self._push = factorise(mass, both).solve(loads)
        self.u, self.a = np.zeros(n), np.zeros(n)
        self.v = np.zeros(n) if velocity is None else velocity
        self._predicted = self._unloaded = self._free = self.u

    def begin(self, displacement: Array) -> None:
        """Begin with displacements, (n,) [m], that loads hold in equilibrium."""
        self.u = self._predicted = self._unloaded = self._free = displacement

    def compliance(self) -> Array:
        """G u at the end of a step, by the force on each row in it, (m, m) [m/N]."""
        return np.asarray(self._G @ self._answer)

    def predict(self) -> Array:
        """Advance without contact; returns G u at the end of the step, (m,) [m]."""
        h = self._step
        self._predicted = self.u + h * self.v + h**2 * (0.5 - self._beta) * self.a
        a = -self._factor.solve(self._K @ ((1 - self._alpha) * self._predicted + self._alpha * self.u))
        self._free = self._unloaded = self._predicted + self._beta * h**2 * a
        return np.asarray(self._G @ self._free)

    def load(self, before: Array, after: Array) -> Array:
        """Add nodal forces at the start and the end of the step, (n,) [N]; returns G u at its end, (m,) [m].

        They act as the stiffness does, and replace those of an earlier call in this step.
        """
        load = (1 - self._alpha) * after + self._alpha * before
        self._free = self._unloaded + self._beta * self._step**2 * self._factor.solve(load)
        return np.asarray(self._G @ self._free)

    def end_of_step(self, force: Array) -> Array:
        """Displacements at the end of the step, (n,) [m], with forces on the rows, (m,) [N]."""
        return self._free + self._answer @ force if force.any() else self._free

    def correct(self, force: Array) -> None:
        """Add forces on the rows, (m,) [N], and finish the step."""
        h, u = self._step, self.end_of_step(force)
        contact = self._push @ force if force.any() else 0.0
        a = ((u - self._predicted) / h**2 - contact / 2) / self._beta
        self.v = self.v + h * ((1 - self._gamma) * self.a + self._gamma * a + contact)
        self.u, self.a = u, a

    def energy(self) -> float:
        """Kinetic and strain energy [J]."""
        return 0.5 * float(self.v @ (self._M @ self.v) + self.u @ (self._K @ self.u))
