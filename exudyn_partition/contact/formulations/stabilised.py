"""Contact by Lagrange multipliers in implicit steps, as a force element with a tangent for Newton's iteration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.factorisation import Factorisation
from ...errors import ComplementarityError
from ...support.arrays import Array
from ..gaps import Side
from .formulation import Motion
from .law import ContactLaw

_AHEAD = 2.0  # number of steps by which gaps are predicted
_SHARE = 0.4  # share of the compliance that a time step sees
_PATIENCE = 30  # evaluations in a shortened step after which rows no longer open or close
_CUT = 0.26  # of the longest step: below it, a step counts as shortened
_STEPS_KEPT = 8  # number of step sizes whose flexibility is kept, for adaptive steps


class StabilisedContact(ContactLaw):
    """Multipliers of patches with mass, for generalized-alpha with step s.

    The gaps h are predicted for two steps ahead, at q + 2 s q_t. The forces solve lambda >= 0, w >= 0, lambda'w = 0
    with

        w = h + F (lambda - lambda*),    F = 0.4 G (4 M / s^2 + K)^-1 G'.

    Here lambda* = 2 lambda_n - lambda_n-1 is extrapolated from the last two steps. F is a share of the compliance that
    a step of the trapezoidal rule sees: s^2 / 4m at a node without neighbours, the static one at a stiff node.

    Zero gaps at the end of each step would give equations of index 3, whose forces oscillate from step to step. The
    prediction damps them: closed rows obey h + 2 s h' = 0 once forces are smooth, and nodes that touch are slowed down
    over some steps. F lets Newton's iteration find which rows are closed. F acts on the second difference of the
    forces only. So the penetration is F s^2 lambda'', which is zero under constant or steadily changing forces. The
    work of F is of third order in the step, and not always a loss: a body that vibrates undamped on its contact gains
    energy in coarse steps. Besides, contact takes the kinetic energy of the nodes' own masses when they meet (Kane,
    Repetto, Ortiz, Marsden 1999).

    Where Newton's iteration does not converge but cycles, Exudyn shortens the step. If that does not help either, rows
    stay open or closed for the rest of the step. Their forces may then pull a little in this step.

    `least_gap` is the smallest predicted gap.

    Parameters
    ----------
    gaps : Gaps
    """

    remembers = True

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._step = 0.0
        self._flexibilities: dict[float, list[Array]] = {}
        self._longest = 0.0
        self._evaluations = 0
        self._expected = self._last = np.zeros(len(self._closed_nodes))
        self._held: object = None
        self._taken = False

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self.problem.iterations if self._taken else 0

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.respond(motion.q, motion.q_t, motion.step)

    def respond(self, q: Array, q_t: Array, step: float) -> Array:
        """Generalised contact force, (n,).

        Parameters
        ----------
        q, q_t : (n,) arrays
            Coordinates of slave and master at the end of the step, and their velocities.
        step : float
            Length of the step [s]; zero while the solver computes initial accelerations. Contact does not act on these.

        Raises
        ------
        ComplementarityError
            If gaps are not finite.
        """
        self._evaluations = self._evaluations + 1 if step == self._step else 0
        if step <= 0.0:
            return self.open_rows()
        gaps = self.gaps
        h = gaps.at(gaps.moved(q, _AHEAD * step * q_t))
        self.least_gap = h.min(initial=np.inf)
        if math.isnan(self.least_gap):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        expected = self._expected[gaps.row_nodes]
        if self.least_gap >= 0.0 and not expected.any():
            return self.open_rows()
        self._take_rows(step)
        w = h - self.problem.F @ expected
        self._longest = max(self._longest, step)
        if self._evaluations < _PATIENCE or step > _CUT * self._longest:
            lam = self.problem.solve(w)
        else:
            lam = np.zeros(len(w))
            lam[self.problem.index] = self.problem.solve_active(-w[self.problem.index])
        self.close_rows(lam, self.problem.index)
        return gaps.generalised(lam)

    def commit(self, start: float) -> None:
        """Begin a new step: keep the last forces as those of the previous step, and extrapolate them."""
        last = np.zeros(len(self._closed_nodes))
        last[self.gaps.row_nodes[self.index]] = self.lam[self.index]
        self._expected = 2 * last - self._last
        self._last, self._evaluations = last, 0

    def _take_rows(self, step: float) -> None:
        """Compute F of the present rows, if the rows or the step have changed."""
        gaps = self.gaps
        if step != self._step:
            if step not in self._flexibilities:
                if len(self._flexibilities) == _STEPS_KEPT:
                    self._flexibilities.clear()
                self._flexibilities[step] = [_dynamic_flexibility(side, step) for side in gaps.sides]
            both = zip(gaps.sides, self._flexibilities[step], strict=True)
            gaps.sides = tuple(replace(side, flexibility=flexibility) for side, flexibility in both)
        elif self._taken and not gaps.moving and self._held is gaps.held:
            return
        F = regularised(_SHARE * gaps.flexibility(np.arange(len(gaps.row_nodes))))
        if not self._taken:
            self.problem, self._taken = Complementarity(F), True
        self.problem.replace(F, self._closed_nodes[gaps.row_nodes])
        self._step, self._held = step, gaps.held

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """Return -(by_q dF/dq + by_q_t dF/dq_t), (n, n), of the force F, with the pairs held."""
        n, index = self.gaps.n, self.index
        if not index.size:
            return sp.csr_matrix((n, n))
        H = sp.csr_matrix(self.gaps.jacobian(index))
        some = np.unique(H.indices)  # only coordinates that closed rows depend on, of the many nodal ones
        part = H[:, some].toarray()
        stiffness = (by_q + _AHEAD * self._step * by_q_t) * (part.T @ self.problem.solve_active(part))
        place = np.repeat(some, len(some)), np.tile(some, len(some))
        return sp.csr_matrix((stiffness.ravel(), place), shape=(n, n))


def _dynamic_flexibility(side: Side, step: float) -> Array:
    """Displacements of the patch's nodes per force on them in an implicit step, (3 np, 3 np) [m/N]."""
    body = side.kinematics.body
    rows = sp.csr_matrix(body.rows(side.kinematics.nodes))
    met = Factorisation(sp.csc_matrix(4 / step**2 * body.mass + body.stiffness))
    return np.asarray(rows @ met.solve(rows.T.toarray()))
