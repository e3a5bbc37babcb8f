"""Contact by Lagrange multipliers in implicit steps, as a force element with a tangent for Newton's iteration.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.friction import SLIP, STICK, FrictionProblem
from ...algebra.sparse.multifrontal import Factorisation
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..side import Side
from ..tangential import directions
from .formulation import Motion
from .frictional import FrictionalRows
from .law import ContactLaw

_AHEAD = 2.0  # number of steps by which gaps are predicted
_ALONG = 0.8  # the same for slip; twice the share below, for at the same a node that sticks would be unstable
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
        self._expected = self._before = np.zeros(len(self._closed_nodes))
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
        self._longest = max(self._longest, step)
        held = self._evaluations >= _PATIENCE and step <= _CUT * self._longest
        return self._found(h, expected, q_t, held)

    def _found(self, h: Array, expected: Array, q_t: Array, held: bool) -> Array:
        """Generalised contact force, (n,); with `held` rows no longer open or close.

        Parameters
        ----------
        h, expected : (nr,) arrays
            Predicted gaps [m] and extrapolated forces [N] of the present rows.
        q_t : (n,) array
        held : bool
        """
        w = h - self.problem.F @ expected
        if not held:
            lam = self.problem.solve(w)
        else:
            lam = np.zeros(len(w))
            lam[self.problem.index] = self.problem.solve_active(-w[self.problem.index])
        self.close_rows(lam, self.problem.index)
        return self.gaps.generalised(lam)

    def commit(self, start: float) -> None:
        """Begin a new step: keep the last forces as those of the previous step, and extrapolate them."""
        last = np.zeros(len(self._closed_nodes))
        last[self.gaps.row_nodes[self.index]] = self.lam[self.index]
        self._expected = 2 * last - self._before
        self._before, self._evaluations = last, 0

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
        self._set_up()
        self._step, self._held = step, gaps.held

    def _set_up(self) -> None:
        """Set up the problem of the present rows."""
        gaps = self.gaps
        F = regularised(_SHARE * gaps.flexibility(np.arange(len(gaps.row_nodes))))
        if not self._taken:
            self.problem, self._taken = Complementarity(F), True
        self.problem.replace(F, self._closed_nodes[gaps.row_nodes])

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """Return -(by_q dF/dq + by_q_t dF/dq_t), (n, n), of the force F, with the pairs held."""
        n, index = self.gaps.n, self.index
        if not index.size:
            return sp.csr_matrix((n, n))
        some, part = _dependent(self.gaps.jacobian(index))
        stiffness = (by_q + _AHEAD * self._step * by_q_t) * (part.T @ self.problem.solve_active(part))
        return _spread(stiffness, some, n)


class FrictionalStabilised(FrictionalRows, StabilisedContact):
    """Stabilised multipliers with Coulomb friction.

    Normal rows are those of `StabilisedContact`. Along the tangents of a row, with v its slip rate at the end of the
    step::

        w_t = 0.8 s v + (F (lambda - lambda*))_t,  |lambda_t| <= mu lambda_n,  w_t = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, w_t is opposite to lambda_t. F is that of all three directions. Rows that stick
    have no slip rate under constant or steadily changing forces.

    The rate enters, not the place where a row stuck first: a place would need equations of index 3. With 2 s v, as gaps
    have it, the directions of slip flip from one iteration to the next, and Newton's method cycles. Below 0.4 s v, a
    node without neighbours that sticks is unstable in the trapezoidal rule.

    Friction takes the mean of the forces at both ends of the step times the mean of the slip rates there. Where
    Newton's iteration cycles, rows keep their state for the rest of the step, and forces are linear in w.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb
    """

    friction_problem: FrictionProblem

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._expected: Array = np.zeros((len(self._closed_nodes), 4))  # as the forces of the last step
        self._rates_then = np.zeros((len(self._closed_nodes), 3))  # slip rates at its end, in the tangents' axes
        self._rates: Array | None = None
        self._from: tuple[Array, Array, Array] | None = None

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self.friction_problem.iterations if self._taken else 0

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.respond(motion.q, motion.q_t, motion.step)

    def open_rows(self) -> Array:
        """Open all rows."""
        self._rates = self._from = None
        return super().open_rows()

    def _set_up(self) -> None:
        F = regularised(_SHARE * self.tangential.flexibility())
        nodes = self.gaps.row_nodes
        if not self._taken:
            self.friction_problem, self._taken = FrictionProblem(F), True
        closed = np.where(self._slipped[nodes], SLIP, STICK) * self._closed_nodes[nodes]
        self.friction_problem.replace(F, closed, self.last_forces())

    def _found(self, h: Array, expected: Array, q_t: Array, held: bool) -> Array:
        problem = self.friction_problem
        along = self.tangential.along(expected[:, 1:] @ self.tangential.axes.T)
        self._rates = self.tangential.rates(q_t)
        w = np.column_stack([h, _ALONG * self._step * self._rates])
        w -= (problem.F @ np.column_stack([expected[:, 0], along]).ravel()).reshape(-1, 3)
        if held and self._from is not None and len(self._from[1]) == len(w):
            K, w_then, forces = self._from
            some = directions(problem.index)
            self.forces = forces.copy()
            self.forces[problem.index] -= (K @ (w - w_then).ravel()[some]).reshape(-1, 3)
        else:
            self.forces = problem.solve(w, self.coefficients())
            self._state = problem.state
            self._from = (problem.derivative(), w, self.forces) if held and problem.index.size else None
        self.close_rows(self.forces[:, 0], problem.index)
        return self.generalised()

    def commit(self, start: float) -> None:
        """Begin a new step: remember the last forces and slip rates, and extrapolate the forces."""
        then, length = self._last.copy(), np.zeros(len(self.forces))
        rates = np.zeros((len(self.forces), 2)) if self._rates is None else self._rates
        if self.index.size:
            self._dissipated += self._taken_in_step()
            length = np.linalg.norm(rates, axis=1)
        self.remember(self._way() if self.index.size else rates, length)
        self._rates_then[:] = 0.0
        self._rates_then[self.gaps.row_nodes] = self.tangential.in_space(rates) @ self.tangential.axes
        self._expected, self._evaluations = 2 * self._last - then, 0
        self._rates = self._from = None

    def _way(self) -> Array:
        """How far the present rows have slid in the step, (nr, 2) [m]; those that were open, after they closed."""
        assert self._rates is not None
        nodes = self.gaps.row_nodes
        before = self.tangential.along(self._rates_then[nodes] @ self.tangential.axes.T)
        before[self._last[nodes, 0] == 0] = self._rates[self._last[nodes, 0] == 0]
        return 0.5 * self._step * (before + self._rates)

    def _taken_in_step(self) -> float:
        """Energy that friction takes in the present step [J]."""
        return -0.5 * float(np.sum(self._way() * (self.last_forces() + self.forces)[:, 1:]))

    def dissipated(self) -> float:
        """See `Law`."""
        return self._dissipated + (self._taken_in_step() if self.index.size and self._rates is not None else 0.0)

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`; unsymmetric where rows slip."""
        n, index = self.gaps.n, self.index
        if not index.size:
            return sp.csr_matrix((n, n))
        some, part = _dependent(self.tangential.jacobian(index))
        ahead, along = (share * self._step * by_q_t for share in (_AHEAD, _ALONG))
        scales = np.tile([by_q + ahead, along, along], len(index))
        K = self.friction_problem.derivative() if self._from is None else self._from[0]
        return _spread(part.T @ (K @ (scales[:, None] * part)), some, n)


def _dependent(rows: Rows) -> tuple[Array, Array]:
    """Coordinates that rows, (na, n), depend on, (k,), of the many nodal ones, and the rows on these, (na, k)."""
    H = sp.csr_matrix(rows)
    some = np.unique(H.indices)
    return some, H[:, some].toarray()


def _spread(part: Array, some: Array, n: int) -> sp.csr_matrix:
    """Matrix on all coordinates, (n, n), of one on some of them, (k, k)."""
    place = np.repeat(some, len(some)), np.tile(some, len(some))
    return sp.csr_matrix((part.ravel(), place), shape=(n, n))


def _dynamic_flexibility(side: Side, step: float) -> Array:
    """Displacements of the patch's nodes per force on them in an implicit step, (3 np, 3 np) [m/N]."""
    body = side.kinematics.body
    rows = sp.csr_matrix(body.rows(side.kinematics.nodes))
    met = Factorisation(sp.csc_matrix(4 / step**2 * body.mass + body.stiffness))
    return np.asarray(rows @ met.solve(rows.T.toarray()))
