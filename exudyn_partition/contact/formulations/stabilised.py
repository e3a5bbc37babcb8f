"""Contact by Lagrange multipliers in implicit steps: impulses within the steps, found in Newton's iteration.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.friction import OPEN, SLIP, STICK, FrictionProblem
from ...algebra.sparse.solver import factorise
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..side import Side
from .formulation import Motion
from .frictional import FrictionalRows
from .law import ContactLaw
from .step_mean import TRAPEZOIDAL, GeneralizedAlpha, StepMean

_AHEAD = 0.5  # of a step, by which gaps are predicted
_ROUNDINGS = 8  # of the places, that gaps have
_AGAIN = 3  # evaluation in a step after which pairs and normals stay: those before it bring bodies near to its end
_ASTRAY = 0.1  # share by which rows may move otherwise than F says before F learns
_FINE = 1e-2  # of the largest force: changes that teach F nothing
_CURVATURE = 1e-3  # of what F says, that rows must move for F to learn it
_STEPS_KEPT = 8  # number of step sizes whose flexibility is kept, for adaptive steps


class StabilisedContact(ContactLaw):
    """Multipliers of patches with mass, for generalized-alpha with step s.

    The forces lambda are constant within a step (Jean 1999; Brüls, Acary, Cardona 2014), see `StepMean`: they are
    the impulses in the step, divided by s. With q and q_t at its end, and gaps h predicted half a step further::

        lambda >= 0,    h = g(q + s/2 q_t) >= 0,    lambda'h = 0 .

    Forces at the ends of steps that keep gaps closed there would oscillate from step to step. Here, a row that has
    closed moves as g' = (g + s/2 g_t) / 2, g_t' = -(g + s/2 g_t) / s: it stands still at zero after two steps,
    whatever it did before. Nothing is regularised. A row that touches loses its kinetic energy as in a plastic impact,
    with the mass that a step can reach; a row that stays closed does no work.

    Newton's iteration finds q for the forces that the last iteration had, and the forces follow from

        w = h + F (lambda - lambda_last),    F = s g_t G (M / s'^2 + K)^-1 G' ,

    where F is how rows move by their forces in a step: for linear bodies that is exact, so that two iterations end it,
    and no row opens or closes to and fro. Joints, carriers and other contacts change F. Where rows move otherwise than
    F says, it learns that from what they did.

    `least_gap` is the smallest predicted gap.

    Parameters
    ----------
    gaps : Gaps
    """

    remembers = True
    _given: Array
    _accepted: Array

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._at: tuple[float, Array] | None = None  # step and state of the last evaluation
        self._first: Array | None = None  # state at the first one in this attempt of the step
        self._line: tuple[Array, Array, Rows] | None = None  # see `_linear`
        self._evaluations, self._settled = 0, False  # evaluations in this attempt; whether pairs have been found again
        self._cautious = False  # whether they must not be
        self._end: tuple[Array, Array] | None = None  # coordinates and velocities at the last evaluation
        self._start: tuple[Array, Array] | None = None  # the same at the end of the last step
        self._before: tuple[Array, Array] | None = None  # w and forces at the one before, which Newton's method made
        self._mean = StepMean(self.gaps.n + (6 if self.gaps.carried else 0))
        self._pushed = self._applied = np.zeros(len(self._mean.lasting))
        self._flexibilities: dict[tuple[float, GeneralizedAlpha], list[Array]] = {}
        self._flexible: tuple[float, GeneralizedAlpha] | None = None  # step and weights that F belongs to
        self._base: Array | None = None  # what F was before it learned
        self._learned = False
        self._given = np.zeros(len(self._closed_nodes))  # forces at the last evaluation, by the slave's nodes
        self._accepted = self._given.copy()  # the same at the end of the last step
        self._impulse = np.zeros(7)  # up to the start of the step
        self._taken = False

    @property
    def impulse(self) -> Array:
        """See `Law`."""
        return self._impulse + self._impulse_in_step()

    def _impulse_in_step(self) -> Array:
        if self._at is None or not self.index.size:
            return np.zeros(7)
        along = np.zeros(3) if self.friction is None else self.traction.sum(axis=0)
        return self._at[0] * np.concatenate([[self.lam.sum()], self.resultant(), along])

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self.problem.iterations if self._taken else 0

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.respond(motion.q, motion.q_t, motion.step, motion.weights)

    def respond(self, q: Array, q_t: Array, step: float, weights: GeneralizedAlpha = TRAPEZOIDAL) -> Array:
        """Generalised contact force at the end of the step, (n,).

        Parameters
        ----------
        q, q_t : (n,) arrays
            Coordinates of slave and master at the end of the step, and their velocities.
        step : float
            Length of the step [s]; zero while the solver computes initial accelerations. Contact does not act on these.
        weights : GeneralizedAlpha, optional
            Of the solver.

        Raises
        ------
        ComplementarityError
            If gaps are not finite.
        """
        if step <= 0.0:
            return self.open_rows()
        state = np.concatenate([q, q_t, self.gaps.carrier_pose, self.gaps.carrier_motion])
        if self._at is None or self._at[0] != step or not np.array_equal(self._at[1], state):
            self._at = step, state
            self._mean.begin(weights)
            self._find(q, q_t, step, weights)
            self._end = q, q_t
            self._pushed = self._pushes()
            self._applied = self._mean.applied(self._pushed)
        return self._applied[: self.gaps.n]

    def _find(self, q: Array, q_t: Array, step: float, weights: GeneralizedAlpha) -> None:
        """Find the forces on the present rows."""
        # By the solver, as if nothing accelerated the bodies: in the first evaluation, or where it begins again.
        assert self._at is not None
        state = self._at[1]
        predicted = self._first is None or (self._given.any() and np.array_equal(state, self._first))
        if predicted:
            self._first, self._before = state, None
        ahead = self.gaps.moved(q, _AHEAD * step * q_t)
        self._evaluations = 1 if predicted else self._evaluations + 1
        if predicted and self._settled:
            self._line, self._cautious = None, True  # Newton's iteration has begun again
        if self._line is None:
            self._line = self._linear(self._ahead(ahead, step))
        again = self._evaluations == _AGAIN and self.gaps.moving and not self._cautious
        if again:
            self._line, self._before, self._settled = self._linear(ahead), None, True
        h = self._gaps_at(ahead, step)
        self.least_gap = h.min(initial=np.inf)
        if math.isnan(self.least_gap):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        last = self._last_answer()
        if self.least_gap >= 0.0 and not last.any():
            self._before = None
            self._fly(q_t)
            return
        self._take_rows(step, weights)
        by_q_t = step * weights.by_q_t(step)
        w = self._moves(by_q_t / (1 + _AHEAD * by_q_t) * h, step, q_t)
        if not predicted and not again:  # else the last forces acted along other rows, or did not act
            self._learn(w, last)
            self._before = w, last
        self._answer(w, last)

    def _gaps_at(self, ahead: Array, step: float) -> Array:
        """Gaps at coordinates `ahead`, (n,), and where the surface's carrier goes on to, (nr,)."""
        assert self._line is not None
        place, gap, rows = self._line
        gaps = self.gaps
        h: Array = gap + rows @ gaps.way(place, ahead)
        if gaps.carried:
            now, then = gaps.carrier_pose, gaps.evaluated_pose
            turn = Rotation.from_matrix(now[3:].reshape(3, 3) @ then[3:].reshape(3, 3).T).as_rotvec()
            way = np.concatenate([now[:3] - then[:3], turn]) + _AHEAD * step * gaps.carrier_motion
            h = h + gaps.carrier_rows(np.arange(len(h))) @ way
        return h

    def _ahead(self, ahead: Array, step: float) -> Array:
        """Place, (n,), to which bodies go on rigidly as they are deformed now; in a first step, `ahead`.

        Deformations that are predicted too would let what steps do not resolve grow.
        """
        if self._start is None:
            return ahead
        q, q_t = self._start
        return self.gaps.moved(q, (1 + _AHEAD) * step * self.gaps.rigid_part(q_t))

    def _linear(self, place: Array) -> tuple[Array, Array, Rows]:
        """Place, (n,), gaps there, (nr,), and their derivative, (nr, n), from which gaps are linear in this step.

        Those of each iteration would go to and fro between facets whose normals differ.
        """
        gap = self.gaps.at(place)
        return place, gap, self.gaps.jacobian(np.arange(len(gap)))

    def _last_answer(self) -> Array:
        """Forces on the present rows at the last evaluation, (nr,) [N]."""
        value: Array = self._given[self.gaps.row_nodes]
        return value

    def _fly(self, q_t: Array) -> None:
        """Leave all rows open."""
        self.open_rows()

    def _moves(self, gap: Array, step: float, q_t: Array) -> Array:
        """How far rows are from where they must be, w, (nr,) [m], from the scaled gaps, (nr,)."""
        return gap

    def _answer(self, w: Array, last: Array) -> None:
        """Find the forces from w and from the forces that it belongs to, (nr,)."""
        problem = self.problem
        lam = problem.solve(w - problem.F @ last)
        if self._same(lam, last):
            self.close_rows(last, np.flatnonzero(last))
        else:
            self.close_rows(lam, problem.index)
        self._given[:] = 0.0
        self._given[self.gaps.row_nodes] = self.lam

    def _same(self, lam: Array, last: Array) -> bool:
        """Whether other forces would move rows by no more than the rounding of places."""
        extent = max(float(abs(side.surface.points).max()) for side in self.gaps.sides)
        moved = self._present_problem.F @ (lam - last).ravel()
        return bool(abs(moved).max() <= _ROUNDINGS * np.finfo(float).eps * extent)

    @property
    def _present_problem(self) -> Complementarity | FrictionProblem:
        return self.problem

    def _learn(self, w: Array, last: Array) -> None:
        """Correct F where rows have moved otherwise, as the formula of Broyden, Fletcher, Goldfarb and Shanno does."""
        if self._before is None:
            return
        F = self._present_problem.F
        change, moved = (last - self._before[1]).ravel(), (w - self._before[0]).ravel()
        if abs(change).max() <= _FINE * abs(last).max():
            return  # what Newton's iteration leaves may be larger
        expected = F @ change
        work, expected_work = change @ moved, change @ expected
        astray = np.linalg.norm(moved - expected) > _ASTRAY * np.linalg.norm(expected)
        if astray and work > _CURVATURE * expected_work:
            more = max(work / expected_work, 1.0)  # rows that move more would open and close for ever
            learned = np.outer(moved, moved) / work - more * np.outer(expected, expected) / expected_work
            self._replace(more * F + learned)
            self._learned = True

    def _pushes(self) -> Array:
        """Generalised forces, (n,), by the present forces on rows, and with a carrier force and moment on it, (6,)."""
        push = self.generalised() if self.index.size else self._zero
        if not self.gaps.carried:
            return push
        return np.concatenate([push, -self.resultant(), -self.moment(np.zeros(3))])

    def generalised(self) -> Array:
        """Generalised forces, (n,), from the present forces on the rows."""
        return self.gaps.generalised(self.lam)

    def on_carrier(self, point: Array) -> Array:
        """See `Law`; at the end of the step."""
        force, moment = self._applied[-6:-3], self._applied[-3:]
        return np.concatenate([force, moment - np.cross(point, force)])

    def commit(self, start: float) -> None:
        """Begin a new step: keep what the last one leaves."""
        self._mean.end(self._pushed)
        self._impulse = self.impulse
        self._start = self._end
        self._accepted = self._given.copy()
        self.rollback()
        self._cautious = False

    def rollback(self) -> None:
        """See `Law`."""
        self._given = self._accepted.copy()
        self._at = self._first = self._before = self._line = None
        self._settled, self._cautious = False, True

    def _take_rows(self, step: float, weights: GeneralizedAlpha) -> None:
        """Compute F of the present rows, if the rows or the step have changed."""
        gaps, now = self.gaps, (step, weights)
        if now != self._flexible:
            if now not in self._flexibilities:
                if len(self._flexibilities) == _STEPS_KEPT:
                    self._flexibilities.clear()
                self._flexibilities[now] = [_in_step(side, *now) for side in gaps.sides]
            gaps.take_flexibility(self._flexibilities[now])
        base = self._flexibility()
        forget = self._learned and gaps.moving and self._evaluations == 1  # what other pairs have taught
        if base is not self._base or now != self._flexible or forget:
            self._base, self._flexible, self._learned = base, now, False
            self._set_up(regularised(step * weights.by_q_t(step) * weights.share * base))

    def _flexibility(self) -> Array:
        """How the present rows move by forces on them at the end of the step, (nr, nr) [m/N]."""
        return self.gaps.flexibility(np.arange(len(self.gaps.row_nodes)))

    def _set_up(self, F: Array) -> None:
        """Set up the problem of the present rows."""
        if not self._taken:
            self.problem, self._taken = Complementarity(F), True
        self.problem.replace(F, self._closed_nodes[self.gaps.row_nodes])

    def _replace(self, F: Array) -> None:
        """Go on with another F of the same rows."""
        self.problem.replace(F, self.problem.active)


class FrictionalStabilised(FrictionalRows, StabilisedContact):
    """The same with Coulomb friction.

    Along the tangents of a row, with v its slip rate at the end of the step::

        |lambda_t| <= mu lambda_n,    s v = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, v is opposite to lambda_t. F is that of all three directions.

    The rate enters, not the place where a row stuck first: a place would need equations of index 3. Friction takes the
    forces times the mean of the slip rates at both ends of the step: the work that they do on the bodies. That includes
    what nodes lose along the surface when they touch and stick at once. Where a row turns back within a step, that work
    may be negative, for the force opposes the later rate alone; there friction takes nothing.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb
    """

    friction_problem: FrictionProblem

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._given = self._last.copy()  # as the forces of the last step
        self._accepted = self._last.copy()
        self._rates_then = np.full((len(self._closed_nodes), 3), np.nan)  # slip rates at its end, in the tangents' axes
        self._rates: Array | None = None

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self.friction_problem.iterations if self._taken else 0

    @property
    def _present_problem(self) -> FrictionProblem:
        return self.friction_problem

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return StabilisedContact.evaluate(self, motion)

    def _last_answer(self) -> Array:
        """Forces on the present rows at the last evaluation, (nr, 3) [N]."""
        return self.on_rows(self._given)

    def _fly(self, q_t: Array) -> None:
        """Leave all rows open; those that may touch soon are watched."""
        self.open_rows()
        self._rates = self.tangential.rates(q_t) if self.least_gap < self.gaps.size else None

    def _flexibility(self) -> Array:
        return self.tangential.flexibility()

    def _set_up(self, F: Array) -> None:
        nodes = self.gaps.row_nodes
        if not self._taken:
            self.friction_problem, self._taken = FrictionProblem(F), True
        closed = np.where(self._slipped[nodes], SLIP, STICK) * self._closed_nodes[nodes]
        self.friction_problem.replace(F, closed, self.last_forces())

    def _replace(self, F: Array) -> None:
        problem = self.friction_problem
        problem.replace(F, problem.state, problem.lam)

    def _moves(self, gap: Array, step: float, q_t: Array) -> Array:
        """The scaled gaps and the ways of the slip rates, (nr, 3) [m]."""
        self._rates = self.tangential.rates(q_t)
        return np.column_stack([gap, step * self._rates])

    def _answer(self, w: Array, last: Array) -> None:
        problem = self.friction_problem
        forces = problem.solve(w - (problem.F @ last.ravel()).reshape(-1, 3), self.coefficients())
        if self._same(forces, last):
            self.forces, self._state = last, np.where(last[:, 0] > 0.0, np.maximum(problem.state, STICK), OPEN)
        else:
            self.forces, self._state = forces, problem.state
        self.close_rows(self.forces[:, 0], np.flatnonzero(self._state))
        self._given[:] = 0.0
        nodes = self.gaps.row_nodes
        self._given[nodes, 0], self._given[nodes, 1:] = self.lam, self.traction @ self.tangential.axes

    def commit(self, start: float) -> None:
        """Begin a new step: remember the last forces and slip rates."""
        rates, nodes = self._rates, self.gaps.row_nodes
        if self._at is not None:
            self._dissipated += self._taken_in_step()
            length = np.zeros(len(nodes)) if rates is None else np.linalg.norm(rates, axis=1)
            self.remember(self._way(), length)
            self._rates_then[:] = np.nan
            if rates is not None:
                self._rates_then[nodes] = self.tangential.in_space(rates) @ self.tangential.axes
        super().commit(start)

    def rollback(self) -> None:
        """See `Law`."""
        super().rollback()
        self._rates = None

    def _way(self) -> Array:
        """How far the present rows have slid in the step, (nr, 2) [m]."""
        if self._rates is None or self._at is None:
            return np.zeros((len(self.gaps.row_nodes), 2))
        then = self._rates_then[self.gaps.row_nodes]
        before = self.tangential.along(then @ self.tangential.axes.T)
        before = np.where(np.isnan(then).any(axis=1)[:, None], self._rates, before)  # of rows that were not there
        return 0.5 * self._at[0] * (before + self._rates)

    def _taken_in_step(self) -> float:
        """Energy that friction takes in the present step [J]."""
        return float(np.maximum(-np.sum(self._way() * self.forces[:, 1:], axis=1), 0.0).sum())

    def dissipated(self) -> float:
        """See `Law`."""
        return self._dissipated + (self._taken_in_step() if self.index.size else 0.0)


def _in_step(side: Side, step: float, weights: GeneralizedAlpha) -> Array:
    """Displacements of the patch's nodes per force on them at the end of a step, (3 np, 3 np) [m/N]."""
    body = side.kinematics.body
    rows = sp.csr_matrix(body.rows(side.kinematics.nodes))
    met = factorise(sp.csc_matrix(weights.by_q_tt(step) * body.mass + body.stiffness))
    return np.asarray(rows @ met.solve(rows.T.toarray()))
