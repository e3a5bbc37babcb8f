"""Contact by Lagrange multipliers in implicit steps: impulses within the steps, found in Newton's iteration.

Theory: examples/site/theory.md, "Implicit steps".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

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
from ..row_forces import RowForces, friction_before, no_forces, no_memory
from ..side import Side
from ..step_mean import GeneralizedAlpha, StepMean
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
    """What multipliers of implicit steps remember of the last accepted step, besides `RowMemory`.

    Parameters
    ----------
    mean : StepMean
        Of generalised forces, with a carrier also of its force and moment.
    rates : (np, 3) array
        Slip rates in the axes of the tangents [m/s]; NaN where they are not known.
    impulse : (7,) array
        Impulses so far [N s]: of normal forces, sum and vector on the slave, and of tangential forces.
    end : tuple of (n,) array
        Coordinates, and velocities; empty before the first step.
    """

    mean: StepMean
    rates: Array
    impulse: Array
    end: tuple[Array, ...] = ()


class Line(NamedTuple):
    """Gaps as linear functions of the coordinates.

    Gaps found again in each iteration could alternate between facets whose normals differ.

    Parameters
    ----------
    place : (n,) array
        Coordinates about which gaps are linearised.
    gap : (nr,) array
        Gaps there [m].
    rows : (nr, n) array or csr matrix
        Derivative of the gaps.
    """

    place: Array
    gap: Array
    rows: Rows


@dataclass(frozen=True, eq=False)
class StepFlexibility:
    """Displacements of the present rows due to unit forces on them in a step.

    Parameters
    ----------
    F : (d nr, d nr) array
        [m/N]
    base : (d nr, d nr) array
        Flexibility of the rows from which F was made; F belongs to this very array.
    step : float
        [s]
    weights : GeneralizedAlpha
    learned : bool
        Whether F was corrected from observed motion.
    """

    F: Array
    base: Array
    step: float
    weights: GeneralizedAlpha
    learned: bool = False


@dataclass(frozen=True, eq=False)
class Iterate:
    """How far Newton's iteration has come in a try of a step: the guess from which it goes on.

    Parameters
    ----------
    start : ImpulseState
        At the start of the step.
    memory : RowMemory
        What rows remembered then.
    flexibility : StepFlexibility or None
        It lasts longer than a step, because joints and carriers change it alike in many steps.
    cautious : bool
        Whether pairs must not be found again within the step.
    settled : bool
        Whether they were found again.
    evaluations : int
        How many there were.
    first : array or None
        State of the solver at the first evaluation.
    line : Line or None
    before : ((nr, d), (nr, d) arrays) or None
        Residual and forces at the evaluation before, see `StepImpulses`.
    evaluated : (float, array) or None
        Step, and state of the solver at the last evaluation.
    """

    start: ImpulseState
    memory: RowMemory
    flexibility: StepFlexibility | None
    cautious: bool
    settled: bool = False
    evaluations: int = 0
    first: Array | None = None
    line: Line | None = None
    before: tuple[Array, Array] | None = None
    evaluated: tuple[float, Array] | None = None


@dataclass(frozen=True, eq=False)
class ImpulseAnswer:
    """Multipliers of a contact at the end of an implicit step.

    Parameters
    ----------
    forces : Forces
        On the present rows; on none before the first evaluation of a step.
    gap : (nr,) array
        Predicted gaps [m].
    least_gap : float
        The smallest of them [m].
    force : (n,) array
        Generalised force at the end of the step.
    on_carrier : (6,) array
        Then, force on the body that carries a rigid surface, and moment about the origin [N, N m]; empty without one.
    state : ImpulseState
        If the step ends so.
    memory : RowMemory
        What rows remember then. Its forces and status are a guess for the next evaluation.
    iterate : Iterate
        The rest of this guess.
    """

    forces: Forces
    gap: Array
    least_gap: float
    force: Array
    on_carrier: Array
    state: ImpulseState
    memory: RowMemory
    iterate: Iterate

    @property
    def impulse(self) -> Array:
        """Impulses so far, see `ImpulseState`."""
        return self.state.impulse

    def carrier_moment(self, point: Array) -> Array:
        """Moment on the body that carries the rigid surface about a point, (3,) [N m], at the end of the step."""
        force, moment = self.on_carrier[:3], self.on_carrier[3:]
        about_point: Array = moment - np.cross(point, force)
        return about_point


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

    An evaluation is a function of the last answer and of the motion. All that this object keeps saves time.

    Parameters
    ----------
    contact : PatchContact
    """

    def __init__(self, contact: PatchContact) -> None:
        self.rows, self.gaps = contact.rows, contact.gaps
        self._law, self._friction = contact.law, contact.friction
        self._tangential = self.rows if isinstance(self.rows, TangentialRows) else None
        self._flexibilities: dict[tuple[float, GeneralizedAlpha], list[Array]] = {}
        self._sides_have: tuple[float, GeneralizedAlpha] | None = None  # step and weights of their flexibility
        self._problem: RowProblem | None = None
        self._posed: StepFlexibility | None = None  # of the problem
        extent = max(float(abs(side.surface.points).max()) for side in self.gaps.sides)
        self._rounding = _ROUNDINGS * np.finfo(float).eps * extent  # of places [m]

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far."""
        return 0 if self._problem is None else self._problem.iterations

    # State.

    def begin(
        self,
        state: ImpulseState | None = None,
        memory: RowMemory | None = None,
        flexibility: StepFlexibility | None = None,
        *,
        cautious: bool = False,
    ) -> ImpulseAnswer:
        """Begin a step from a state, and from what rows remember then; by default, those of a new run.

        `flexibility` is a guess from an earlier step. `cautious` is whether pairs must not be found again in this one.
        """
        gaps, memory = self.gaps, no_memory(self.rows) if memory is None else memory
        if state is None:
            mean = StepMean.none(gaps.n + (6 if gaps.carried else 0))
            state = ImpulseState(mean, np.full((len(memory.path), 3), np.nan), np.zeros(7))
        force, iterate = state.mean.force, Iterate(state, memory, flexibility, cautious)
        none = no_forces(self.rows.d, 0)
        return ImpulseAnswer(none, np.empty(0), np.inf, force[: gaps.n], force[gaps.n :], state, memory, iterate)

    def accept(self, answer: ImpulseAnswer) -> ImpulseAnswer:
        """Begin the next step: the last one ended with this answer."""
        return self.begin(answer.state, answer.memory, answer.iterate.flexibility)

    # Evaluation.

    def at(self, last: ImpulseAnswer, motion: Motion) -> ImpulseAnswer:
        """Answer at the end of a step that is longer than zero; `last` is the last answer in this try of it.

        Raises
        ------
        ComplementarityError
            If gaps are not finite.
        """
        q, q_t, step, gaps = motion.q, motion.q_t, motion.step, self.gaps
        state = np.concatenate([q, q_t, gaps.carrier.pose, gaps.carrier.motion])
        evaluated = last.iterate.evaluated
        if evaluated is not None and evaluated[0] == step and np.array_equal(evaluated[1], state):
            return last
        return self._find(last, (q, q_t), step, motion.weights, state)

    def _find(
        self, last: ImpulseAnswer, end: tuple[Array, Array], step: float, weights: GeneralizedAlpha, state: Array
    ) -> ImpulseAnswer:
        """Answer at coordinates and velocities at the end of the step, see `at`.

        `state` has coordinates, velocities, and place and motion of the surface's carrier. If it is the first one of
        the step again, Newton's iteration has begun anew.
        """
        (q, q_t), gaps, guess = end, self.gaps, last.iterate
        # True in the first evaluation, or if the solver begins again: it then predicts q without accelerations.
        predicted = guess.first is None or (last.memory.closed and np.array_equal(state, guess.first))
        first, before = (state, None) if predicted else (guess.first, guess.before)
        evaluations = 1 if predicted else guess.evaluations + 1
        line, cautious, settled = guess.line, guess.cautious, guess.settled
        if predicted and settled:
            line, cautious = None, True  # Newton's iteration has begun again
        ahead = gaps.sides.moved(q, _AHEAD * step * q_t)
        if line is None:
            line = self._linear(self._ahead(guess.start, ahead, step))
        again = evaluations == _AGAIN and gaps.moving and not cautious
        if again:
            line, before, settled = self._linear(ahead), None, True
        h = self._gaps_at(line, ahead, step)
        least = h.min(initial=np.inf)
        if math.isnan(least):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        flexibility, acted, rates = guess.flexibility, on_rows(self.rows, last.memory.forces), None
        if least >= 0.0 and not acted.any():
            before, forces = None, no_forces(self.rows.d, len(h))
            if self._tangential is not None and least < gaps.size:  # rows that may touch soon
                rates = self._tangential.rates(q_t)[:, 1:]
        else:
            flexibility = self._flexibility(flexibility, step, weights, forgets=evaluations == 1)
            by_q_t = step * weights.by_q_t(step)
            w = (by_q_t / (1 + _AHEAD * by_q_t) * h)[:, None]
            if self._tangential is not None:
                rates = self._tangential.rates(q_t)[:, 1:]
                w = np.hstack([w, step * rates])
            if not predicted and not again:  # else the last forces acted along other rows, or did not act
                if before is not None:
                    flexibility = _corrected(flexibility, acted - before[1], w - before[0], abs(acted).max())
                before = w, acted
            forces = self._forces(flexibility, last, w, acted)
        iterate = Iterate(
            guess.start,
            guess.memory,
            flexibility,
            cautious,
            settled=settled,
            evaluations=evaluations,
            first=first,
            line=line,
            before=before,
            evaluated=(step, state),
        )
        acting = RowForces(self.rows, forces)
        push, start = acting.by_rows, guess.start
        if gaps.carried:
            push = np.concatenate([push, acting.on_carrier(np.zeros(3))])
        applied, mean = start.mean.after(weights, push)
        memory, known_rates = self._slid(acting, iterate, rates)
        state_after = ImpulseState(mean, known_rates, start.impulse + acting.impulse(step), end)
        return ImpulseAnswer(forces, h, least, applied[: gaps.n], applied[gaps.n :], state_after, memory, iterate)

    def _slid(self, acting: RowForces, iterate: Iterate, rates: Array | None) -> tuple[RowMemory, Array]:
        """What rows remember if the step ends now, and `ImpulseState.rates`.

        `rates`, (nr, 2) [m/s], are slip rates at the end of the step, if they are known.
        """
        n, start, rows = len(acting.on_rows), iterate.start, self._tangential
        if rows is None:
            return acting.memory_after(iterate.memory, np.empty(0), np.empty(0), 0.0), start.rates
        known_rates, nodes = np.full_like(start.rates, np.nan), self.gaps.row_nodes
        if rates is None:
            return acting.memory_after(iterate.memory, np.zeros((n, 2)), np.zeros(n), 0.0), known_rates
        assert iterate.evaluated is not None
        then = start.rates[nodes]
        known_then = rows.along(then @ rows.axes.T)
        before = np.where(np.isnan(then[:, :1]), rates, known_then)  # some rows are new in this step
        way = 0.5 * iterate.evaluated[0] * (before + rates)
        taken = float(np.maximum(-np.sum(way * acting.on_rows[:, 1:], axis=1), 0.0).sum())
        known_rates[nodes] = rows.in_space(rates) @ rows.axes
        return acting.memory_after(iterate.memory, way, np.linalg.norm(rates, axis=1), taken), known_rates

    def _gaps_at(self, line: Line, ahead: Array, step: float) -> Array:
        """Gaps, (nr,), at coordinates `ahead`, (n,), and at the predicted place of the surface's carrier."""
        gaps = self.gaps
        h: Array = line.gap + line.rows @ gaps.sides.way(line.place, ahead)
        if gaps.carried:
            now, then = gaps.carrier.pose, gaps.stage.pose
            turn = Rotation.from_matrix(now[3:].reshape(3, 3) @ then[3:].reshape(3, 3).T).as_rotvec()
            way = np.concatenate([now[:3] - then[:3], turn]) + _AHEAD * step * gaps.carrier.motion
            h = h + gaps.carrier.rows(gaps.stage, gaps.present.places[0]) @ way
        return h

    def _ahead(self, start: ImpulseState, ahead: Array, step: float) -> Array:
        """Coordinates, (n,), after predicted rigid motion with the present deformation; in a first step, `ahead`.

        Predicted deformations would amplify vibrations that the steps do not resolve.
        """
        if not start.end:
            return ahead
        q, q_t = start.end
        return self.gaps.sides.moved(q, (1 + _AHEAD) * step * self.gaps.sides.rigid_part(q_t))

    def _linear(self, place: Array) -> Line:
        """Gaps linearised about coordinates, (n,)."""
        gap = self.gaps.at(place)
        return Line(place, gap, self.gaps.jacobian(np.arange(len(gap))))

    def _forces(self, flexibility: StepFlexibility, last: ImpulseAnswer, w: Array, acted: Array) -> Forces:
        """Forces that follow from w, and from the forces that acted when w was found, (nr, d) each."""
        problem = self._problem_with(flexibility, last)
        h = w - problem.moved_by(acted)
        before, mu = friction_before(self.rows, self._friction, last.iterate.memory)
        answer = self._law.answer(Places(h[:, 0], h[:, 1:], before, mu, problem=problem))
        if not self._same(problem, answer.on_rows, acted):
            return answer
        closed, state = acted[:, 0] > 0.0, answer.state
        if state is not None:
            state = np.where(closed, np.maximum(state, STICK), OPEN).astype(np.int8)
        return Forces(acted, np.flatnonzero(closed), state)

    def _same(self, problem: RowProblem, forces: Array, last: Array) -> bool:
        """Whether the change of forces would move rows by no more than the rounding of places."""
        moved = problem.moved_by(forces - last)
        return bool(abs(moved).max() <= self._rounding)

    # Flexibility.

    def _flexibility(
        self, last: StepFlexibility | None, step: float, weights: GeneralizedAlpha, *, forgets: bool
    ) -> StepFlexibility:
        """F of the present rows, if the rows or the step have changed; else the last one.

        `forgets` is whether rows that move lose what was learned: it belongs to other pairs.
        """
        gaps, now = self.gaps, (step, weights)
        if now != self._sides_have:
            if now not in self._flexibilities:
                if len(self._flexibilities) == _STEPS_KEPT:
                    self._flexibilities.clear()
                self._flexibilities[now] = [_in_step(side, *now) for side in gaps.sides]
            gaps.exchange_flexibility(self._flexibilities[now])
            self._sides_have = now
        base = self.rows.flexibility(np.arange(len(gaps.row_nodes)))
        if last is not None and base is last.base and now == (last.step, last.weights):
            if not (forgets and last.learned and gaps.moving):
                return last
        return StepFlexibility(regularised(step * weights.by_q_t(step) * weights.share * base), base, step, weights)

    def _problem_with(self, flexibility: StepFlexibility, last: ImpulseAnswer) -> RowProblem:
        """The problem of the present rows. It goes on from its last answer as long as it has the same rows."""
        problem, posed = self._problem or RowProblem(self.rows.d, flexibility.F), self._posed
        if posed != flexibility:
            if flexibility.learned and posed is not None and posed.F.shape == flexibility.F.shape:
                problem.exchange(flexibility.F)
            else:
                before, _ = friction_before(self.rows, self._friction, last.iterate.memory)
                problem.replace(flexibility.F, last.memory.status[self.gaps.row_nodes], before)
        self._problem, self._posed = problem, flexibility
        return problem


def _corrected(flexibility: StepFlexibility, change: Array, moved: Array, largest: float) -> StepFlexibility:
    """F corrected where rows have moved otherwise, by the formula of Broyden, Fletcher, Goldfarb and Shanno.

    Parameters
    ----------
    flexibility : StepFlexibility
    change, moved : (nr, d) arrays
        Change of the forces [N], and how far the rows have moved by it [m].
    largest : float
        Largest force [N].
    """
    change, moved = change.ravel(), moved.ravel()
    if abs(change).max() <= _FINE * largest:
        return flexibility  # the residual of Newton's iteration may be larger
    expected = flexibility.F @ change
    work, expected_work = change @ moved, change @ expected
    astray = np.linalg.norm(moved - expected) > _ASTRAY * np.linalg.norm(expected)
    if not (astray and work > _CURVATURE * expected_work):
        return flexibility
    more = max(work / expected_work, 1.0)  # rows that move more than F predicts would open and close for ever
    learned = np.outer(moved, moved) / work - more * np.outer(expected, expected) / expected_work
    return replace(flexibility, F=more * flexibility.F + learned, learned=True)


def _in_step(side: Side, step: float, weights: GeneralizedAlpha) -> Array:
    """Displacements of the patch's nodes at the end of a step due to unit forces on them, (3 np, 3 np) [m/N]."""
    body = side.kinematics.body
    rows = sp.csr_matrix(body.rows(side.kinematics.nodes))
    met = factorise(sp.csc_matrix(weights.by_q_tt(step) * body.mass + body.stiffness))
    return np.asarray(rows @ met.solve(rows.T.toarray()))
