"""Contact by Lagrange multipliers in implicit steps: impulses within the steps, found in Newton's iteration.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from ...algebra.complementarity import regularised
from ...algebra.friction import OPEN, STICK
from ...algebra.row_problem import RowProblem
from ...algebra.sparse.solver import factorise
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..law import Forces, Motion, Places
from ..memory import RowMemory, on_rows
from ..patch_contact import PatchContact
from ..side import Side
from ..step_mean import TRAPEZOIDAL, GeneralizedAlpha, StepMean
from ..tangential import TangentialRows

_AHEAD = 0.5  # of a step: time by which gaps are predicted
_ROUNDINGS = 8  # rounding errors of the places, the accuracy of gaps
_AGAIN = 3  # evaluation in a step after which pairs and normals stay; by then, bodies are near the end of the step
_ASTRAY = 0.1  # relative error of motion predicted by F above which F is corrected
_FINE = 1e-2  # of the largest force: smaller changes do not correct F
_CURVATURE = 1e-3  # of the motion that F predicts: with less motion, F is not corrected
_STEPS_KEPT = 8  # step sizes whose flexibility is kept, for adaptive steps


@dataclass(frozen=True, eq=False)
class ImpulseState:
    """What multipliers of implicit steps remember of the last accepted step.

    Parameters
    ----------
    mean : StepMean
        Of generalised forces, with a carrier also of its force and moment.
    given : (np, k) array
        Forces on the rows, stored for the slave's nodes as in `RowMemory` [N].
    rates : (np, 3) array
        Slip rates in the axes of the tangents [m/s]; NaN where they are not known.
    impulse : (7,) array
        Impulses so far, see `StepImpulses.impulse`.
    end : tuple of (n,) array
        Coordinates, and velocities; empty before the first step.
    """

    mean: StepMean
    given: Array
    rates: Array
    impulse: Array
    end: tuple[Array, ...] = ()


class StepImpulses:
    """Forces of a contact that are constant within each step s of generalized-alpha.

    The forces lambda (Jean 1999; Brüls, Acary, Cardona 2014) are the impulses in the step, divided by s, see
    `StepMean`. With q and q_t at the end of the step, and gaps h predicted half a step further, they are multipliers
    of::

        lambda >= 0,    h = g(q + s/2 q_t) >= 0,    lambda'h = 0 .

    Forces that keep gaps closed at the ends of steps would oscillate from step to step. Here, the motion of a closed
    row is g' = (g + s/2 g_t) / 2, g_t' = -(g + s/2 g_t) / s. So it rests at zero after two steps, from any earlier
    motion. Nothing is regularised. A row that touches loses its kinetic energy as in a plastic impact, with the mass
    that responds within a step. A row that stays closed does no work.

    Newton's iteration finds q with the forces of the last iteration. New forces follow from

        w = h + F (lambda - lambda_last),    F = s g_t G (M / s'^2 + K)^-1 G' ,

    where F is the displacement of rows due to unit forces on them in a step. For linear bodies, F is exact. Then two
    iterations are enough, and no row alternates between open and closed. Joints, carriers and other contacts change F.
    If rows move otherwise than F predicts, F is corrected from their observed motion.

    With friction, along the tangents of a row, with v its slip rate at the end of the step::

        |lambda_t| <= mu lambda_n,    s v = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, v is opposite to lambda_t. F has all three directions. The condition uses the
    rate, not the place where a row first stuck, because a place would need equations of index 3. Friction dissipates
    the forces times the mean of the slip rates at both ends of the step, which is their work on the bodies. It includes
    the tangential energy that nodes lose when they touch and stick at once. Where a row turns back within a step, that
    work may be negative, because the force opposes only the later rate. Then the dissipation is zero.

    The contact's `least_gap` is the smallest predicted gap.

    Parameters
    ----------
    contact : PatchContact
    """

    _given: Array
    state: ImpulseState

    def __init__(self, contact: PatchContact) -> None:
        self.contact, self.rows, self.gaps = contact, contact.rows, contact.gaps
        self._tangential = self.rows if isinstance(self.rows, TangentialRows) else None
        n = len(self.gaps.slave.surface.points)
        self._at: tuple[float, Array] | None = None  # step and state of the last evaluation
        self._first: Array | None = None  # state at the first evaluation in this attempt of the step
        self._line: tuple[Array, Array, Rows] | None = None  # see `_linear`
        self._evaluations, self._settled = 0, False  # evaluations in this attempt; whether pairs were found again
        self._cautious = False  # whether pairs must not be found again
        self._end: tuple[Array, Array] | None = None  # coordinates and velocities at the last evaluation
        self._weights: GeneralizedAlpha | None = None  # of the last evaluation
        self._before: tuple[Array, Array] | None = None  # w and forces at the evaluation before, in Newton's iteration
        mean = StepMean.none(self.gaps.n + (6 if self.gaps.carried else 0))
        self._pushed = self._applied = mean.force
        self._flexibilities: dict[tuple[float, GeneralizedAlpha], list[Array]] = {}
        self._flexible: tuple[float, GeneralizedAlpha] | None = None  # step and weights that F belongs to
        self._base: Array | None = None  # F before its corrections
        self._learned = False
        self._given = np.zeros((n, 4 if self._tangential else 1))  # forces at the last evaluation, at the slave's nodes
        self.state = ImpulseState(mean, self._given.copy(), np.full((n, 3), np.nan), np.zeros(7))
        self._open = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int8)
        self._last = self._open  # nodes of the rows in the last answer, and whether they were open, stuck or slipped
        self._problem: RowProblem | None = None
        self._rates: Array | None = None

    @property
    def impulse(self) -> Array:
        """Impulses so far, (7,) [N s]: of normal forces, sum and vector on the slave, and of tangential forces."""
        return self.state.impulse + self._impulse_in_step()

    def _impulse_in_step(self) -> Array:
        answer = self.contact.evaluation
        if self._at is None or not answer.index.size:
            return np.zeros(7)
        along = answer.traction.sum(axis=0)
        return self._at[0] * np.concatenate([[answer.lam.sum()], answer.resultant(), along])

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far."""
        return 0 if self._problem is None else self._problem.iterations

    def evaluate(self, motion: Motion) -> Array:
        """Generalised contact force at the end of the step, (n,)."""
        return self.respond(motion.q, motion.q_t, motion.step, motion.weights)

    def respond(self, q: Array, q_t: Array, step: float, weights: GeneralizedAlpha = TRAPEZOIDAL) -> Array:
        """Generalised contact force at the end of the step, (n,).

        Parameters
        ----------
        q, q_t : (n,) arrays
            Coordinates of slave and master at the end of the step, and their velocities.
        step : float
            Length of the step [s]; zero while the solver computes initial accelerations, on which contact does not act.
        weights : GeneralizedAlpha, optional
            Coefficients of the solver.

        Raises
        ------
        ComplementarityError
            If gaps are not finite.
        """
        if step <= 0.0:
            self.contact.opened(np.zeros(len(self.gaps.row_nodes)), self.contact.evaluation.least_gap)
            return np.zeros(self.gaps.n)
        state = np.concatenate([q, q_t, self.gaps.carrier_pose, self.gaps.carrier_motion])
        if self._at is None or self._at[0] != step or not np.array_equal(self._at[1], state):
            self._at, self._weights = (step, state), weights
            self._find(q, q_t, step, weights)
            self._end = q, q_t
            self._pushed = self._pushes()
            self._applied = self.state.mean.applied(weights, self._pushed)
        return self._applied[: self.gaps.n]

    def _find(self, q: Array, q_t: Array, step: float, weights: GeneralizedAlpha) -> None:
        """Find the forces on the present rows."""
        # True in the first evaluation, or if the solver begins again: it then predicts q without accelerations.
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
        self._gap, self._least = h, h.min(initial=np.inf)
        least = self._least
        if math.isnan(least):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        last = self._last_answer()
        if least >= 0.0 and not last.any():
            self._before = None
            self._fly(q_t)
            return
        problem = self._take_rows(step, weights)
        by_q_t = step * weights.by_q_t(step)
        w = self._moves(by_q_t / (1 + _AHEAD * by_q_t) * h, step, q_t)
        if not predicted and not again:  # else the last forces acted along other rows, or did not act
            self._learn(problem, w, last)
            self._before = w, last
        self._answer(problem, w, last)

    def _gaps_at(self, ahead: Array, step: float) -> Array:
        """Gaps, (nr,), at coordinates `ahead`, (n,), and at the predicted place of the surface's carrier."""
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
        """Coordinates, (n,), after predicted rigid motion with the present deformation; in a first step, `ahead`.

        Predicted deformations would amplify vibrations that the steps do not resolve.
        """
        if not self.state.end:
            return ahead
        q, q_t = self.state.end
        return self.gaps.moved(q, (1 + _AHEAD) * step * self.gaps.rigid_part(q_t))

    def _linear(self, place: Array) -> tuple[Array, Array, Rows]:
        """Place, (n,), gaps there, (nr,), and their derivative, (nr, n), about which gaps are linearised in this step.

        Gaps found again in each iteration could alternate between facets whose normals differ.
        """
        gap = self.gaps.at(place)
        return place, gap, self.gaps.jacobian(np.arange(len(gap)))

    def _last_answer(self) -> Array:
        """Forces on the present rows at the last evaluation, (nr, d) [N]."""
        if self._tangential is not None:
            return on_rows(self._tangential, self._given)
        value: Array = self._given[self.gaps.row_nodes]
        return value

    def _fly(self, q_t: Array) -> None:
        """Leave all rows open; with friction, record the slip rates of rows that may touch soon."""
        self.contact.opened(self._gap, self._least)
        self._last = self._open
        if self._tangential is not None:
            near = self._least < self.gaps.size
            self._rates = self._tangential.rates(q_t)[:, 1:] if near else None

    def _moves(self, gap: Array, step: float, q_t: Array) -> Array:
        """Residual w of the rows' conditions, (nr, d) [m]: scaled gaps, and slip rates times the step."""
        if self._tangential is None:
            return gap[:, None]
        self._rates = self._tangential.rates(q_t)[:, 1:]
        return np.column_stack([gap, step * self._rates])

    def _answer(self, problem: RowProblem, w: Array, last: Array) -> None:
        """Find the forces from w and from the forces for which w was computed, (nr, d) each."""
        contact, h = self.contact, w - problem.moved_by(last)
        places = Places(h[:, 0], h[:, 1:], contact.last, contact.coefficients, problem=problem)
        forces = contact.law.answer(places)
        if self._same(problem, forces.on_rows, last):
            closed, state = last[:, 0] > 0.0, forces.state
            if state is not None:
                state = np.where(closed, np.maximum(state, STICK), OPEN).astype(np.int8)
            forces = Forces(last, np.flatnonzero(closed), state)
        answer = contact.answered(forces, self._gap, self._least)
        self._last = self.gaps.row_nodes, answer.status
        self._given = answer.at_nodes(len(self._given))

    def _same(self, problem: RowProblem, forces: Array, last: Array) -> bool:
        """Whether the change of forces would move rows by no more than the rounding of places."""
        extent = max(float(abs(side.surface.points).max()) for side in self.gaps.sides)
        moved = problem.moved_by(forces - last)
        return bool(abs(moved).max() <= _ROUNDINGS * np.finfo(float).eps * extent)

    def _learn(self, problem: RowProblem, w: Array, last: Array) -> None:
        """Correct F where rows have moved otherwise, by the formula of Broyden, Fletcher, Goldfarb and Shanno."""
        if self._before is None:
            return
        F = problem.F
        change, moved = (last - self._before[1]).ravel(), (w - self._before[0]).ravel()
        if abs(change).max() <= _FINE * abs(last).max():
            return  # the residual of Newton's iteration may be larger
        expected = F @ change
        work, expected_work = change @ moved, change @ expected
        astray = np.linalg.norm(moved - expected) > _ASTRAY * np.linalg.norm(expected)
        if astray and work > _CURVATURE * expected_work:
            more = max(work / expected_work, 1.0)  # rows that move more than F predicts would open and close for ever
            learned = np.outer(moved, moved) / work - more * np.outer(expected, expected) / expected_work
            problem.exchange(more * F + learned)
            self._learned = True

    def _pushes(self) -> Array:
        """Generalised forces, (n,), from present forces on rows; with a carrier, also its force and moment, (6,)."""
        answer = self.contact.evaluation
        if not self.gaps.carried:
            return answer.generalised
        return np.concatenate([answer.generalised, answer.on_carrier(np.zeros(3))])

    def on_carrier(self, point: Array) -> Array:
        """Force on the body that carries the rigid surface, and moment about a point, (6,), at the end of the step."""
        force, moment = self._applied[-6:-3], self._applied[-3:]
        return np.concatenate([force, moment - np.cross(point, force)])

    # State.

    def begin(self, state: ImpulseState) -> None:
        """Begin from a state; the contact has begun from its own."""
        self.state, self._applied = state, state.mean.force
        self._try()

    def after(self) -> tuple[ImpulseState, RowMemory]:
        """State after a step that ends with the last answer, and what rows remember then."""
        state, contact = self.state, self.contact
        if self._at is None:
            return state, contact.state.memory
        rates, memory, mean = state.rates, contact.state.memory.with_forces(self._given.copy()), state.mean
        if (rows := self._tangential) is not None:
            now, nodes = self._rates, self.gaps.row_nodes
            length = np.zeros(len(nodes)) if now is None else np.linalg.norm(now, axis=1)
            memory = contact.evaluation.memory_after(contact.state.memory, self._way(), length, self._taken_in_step())
            rates = np.full_like(rates, np.nan)
            if now is not None:
                rates[nodes] = rows.in_space(now) @ rows.axes
        if self._weights is not None:
            mean = mean.after(self._weights, self._pushed)
        return ImpulseState(mean, self._given.copy(), rates, self.impulse, self._end or ()), memory

    def accept(self, start: float) -> None:
        """Begin a step at time `start` [s]. The step before ended there, with the last answer."""
        self.state, memory = self.after()
        self.contact.remember(memory)
        self.gaps.accept(self.gaps.after())
        self._try()
        self._cautious = False

    def retry(self) -> None:
        """Begin the step again, from the state that was accepted last."""
        self.gaps.retry()
        self._try()

    def _try(self) -> None:
        """Begin a try of a step."""
        self._given = self.state.given.copy()
        self._at = self._first = self._before = self._line = self._rates = self._end = self._weights = None
        self._settled, self._cautious = False, True

    def _way(self) -> Array:
        """How far the present rows have slid in the step, (nr, 2) [m]."""
        rows = self._tangential
        if rows is None or self._rates is None or self._at is None:
            return np.zeros((len(self.gaps.row_nodes), 2))
        then = self.state.rates[self.gaps.row_nodes]
        before = rows.along(then @ rows.axes.T)
        before = np.where(np.isnan(then[:, :1]), self._rates, before)  # rows that are new in this step
        return 0.5 * self._at[0] * (before + self._rates)

    def _taken_in_step(self) -> float:
        """Energy that friction dissipates in the present step [J]."""
        if self._tangential is None or not self.contact.evaluation.index.size:
            return 0.0
        return float(np.maximum(-np.sum(self._way() * self.contact.evaluation.on_rows[:, 1:], axis=1), 0.0).sum())

    def dissipated(self) -> float:
        """Energy that friction has dissipated since the start of the run [J]."""
        return self.contact.state.memory.dissipated + self._taken_in_step()

    def _take_rows(self, step: float, weights: GeneralizedAlpha) -> RowProblem:
        """Compute F of the present rows, if the rows or the step have changed."""
        gaps, now = self.gaps, (step, weights)
        if now != self._flexible:
            if now not in self._flexibilities:
                if len(self._flexibilities) == _STEPS_KEPT:
                    self._flexibilities.clear()
                self._flexibilities[now] = [_in_step(side, *now) for side in gaps.sides]
            gaps.take_flexibility(self._flexibilities[now])
        base = self.rows.flexibility(np.arange(len(gaps.row_nodes)))
        forget = self._learned and gaps.moving and self._evaluations == 1  # corrections from other pairs
        if self._problem is None or base is not self._base or now != self._flexible or forget:
            self._base, self._flexible, self._learned = base, now, False
            F = regularised(step * weights.by_q_t(step) * weights.share * base)
            if self._problem is None:
                self._problem = RowProblem(self.rows.d, F)
            self._problem.replace(F, self._guess(), self.contact.last)
        return self._problem

    def _guess(self) -> Array:
        """Whether the present rows were open, stuck or slipped in the last answer, (nr,) int8."""
        (nodes, state), at_nodes = self._last, np.full(len(self._given), OPEN, dtype=np.int8)
        at_nodes[nodes] = state
        value: Array = at_nodes[self.gaps.row_nodes]
        return value


def _in_step(side: Side, step: float, weights: GeneralizedAlpha) -> Array:
    """Displacements of the patch's nodes at the end of a step due to unit forces on them, (3 np, 3 np) [m/N]."""
    body = side.kinematics.body
    rows = sp.csr_matrix(body.rows(side.kinematics.nodes))
    met = factorise(sp.csc_matrix(weights.by_q_tt(step) * body.mass + body.stiffness))
    return np.asarray(rows @ met.solve(rows.T.toarray()))
