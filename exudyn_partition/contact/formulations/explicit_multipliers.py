"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 21-28).

Theory: examples/site/theory.md, "Explicit steps".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...algebra.complementarity import regularised
from ...algebra.products import dense, largest_change, smallest
from ...algebra.row_problem import RowProblem
from ...errors import RunError
from ...frames.kinematics import Rows
from ...support.arrays import Array, consecutive
from ..law import Forces, Law, Places
from ..memory import RowMemory, on_rows
from ..patch_contact import PatchContact
from ..row_forces import RowForces, friction_before, no_forces, no_memory, with_forces
from ..tangential import TangentialRows

_CLOSED = 1e-3  # of a facet's size: accuracy of closed gaps where points cross edges between facets
_SOONER = 10  # the error of frozen pairs fades so many times faster than it grew, once pairs are followed
_SOONEST = 20  # steps at least, in which it fades

_NO_FRICTION, _NO_IMPULSE = np.empty(0), np.zeros(7)
# Of a contact's bodies at the start of a step: coordinates, velocities, and accelerations without contact, (n,) each.
Start: TypeAlias = tuple[Array, Array, Array]


class Multipliers(Law):
    """Multipliers for patches with mass: no gap is negative at the end of the step.

    Eq. 24 alone sets the relative acceleration to zero. A node that has just touched would keep its approach velocity
    and drift into penetration. Here lambda_n >= 0 and g(q_{n+1}) >= 0 are complementary. This is the forward-increment
    form (Carpenter, Taylor, Katona 1991) of the same central differences. Pairs are those at the predicted q_{n+1}.

    With friction, a row that sticks does not move along its tangents in the coming step. With s the displacement by
    which a row slides in that step::

        |lambda_t| <= mu lambda_n,    s = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, s is opposite to lambda_t.

    `ForwardIncrement` finds them in explicit steps, `implicit_multipliers.StepImpulses` in implicit ones.
    """

    compliant = False
    ahead = True

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        if places.problem.d == 1:
            forces = places.problem.solve(places.gap[:, None], _NO_FRICTION)
        else:
            forces = places.problem.solve(np.column_stack([places.gap, places.way]), places.mu)
        return Forces(forces, places.problem.index, places.problem.state)


@dataclass(frozen=True, eq=False)
class ForwardState:
    """What multipliers of explicit steps remember besides their contact's state.

    Parameters
    ----------
    jump : (np,) array
        What is subtracted from the gaps since pairs were frozen no longer, at the slave's nodes [m].
    fading : float
        Its factor in a step; one if nothing is subtracted.
    frozen_steps : int
        Steps for which the pairs have been frozen.
    impulse, last_impulse : (7,) arrays
        Impulses so far, and in the last step [N s], see `RowForces.impulse`.
    pending : float
        Share of the last one that is still to be added to those so far.
    pose : (12,) array or None
        Where the carrier of a rigid surface was at the last prediction.
    """

    jump: Array
    fading: float
    frozen_steps: int
    impulse: Array
    last_impulse: Array
    pending: float = 0.0
    pose: Array | None = None

    def expecting(self) -> ForwardState:
        """Return the state with half of the last step's impulse counted again, until that of the next step is known."""
        impulse = self.impulse + 0.5 * self.last_impulse
        return ForwardState(
            self.jump, self.fading, self.frozen_steps, impulse, self.last_impulse, self.pending - 0.5, self.pose
        )


class Promise(NamedTuple):
    """Where the gaps will be at the end of a step that central differences make with these multipliers.

    Parameters
    ----------
    free_end : (n,) array
        Coordinates to which the step leads without contact forces.
    free_gap, gap : (nr,) arrays
        Gaps there, and at the end of the step [m].
    G : (nr, n) array or csr matrix
        Normal directions of the rows.
    scale : float
        Largest change of a place that one multiplier causes [m].
    """

    free_end: Array
    free_gap: Array
    gap: Array
    G: Rows
    scale: float


class Prediction(NamedTuple):
    """Where the rows of a contact would be at the end of the coming step without contact forces.

    Parameters
    ----------
    places : (nr, d) array
        Gaps, and sliding in the step [m].
    least_gap : float
        [m]
    end, q_tt : (n,) arrays
        Coordinates at the end of the step, and accelerations in it.
    step : float
        [s]
    jump, fading, frozen_steps, pose
        After the step, see `ForwardState`.
    """

    places: Array
    least_gap: float
    end: Array
    q_tt: Array
    step: float
    jump: Array
    fading: float
    frozen_steps: int
    pose: Array | None

    def state_after(self, last: ForwardState, impulse: Array, share: float) -> ForwardState:
        """State after the step.

        `last` is the state before it, and `impulse`, (7,), that of the step; velocities include a share of it so far.
        """
        total = last.impulse + (last.pending * last.last_impulse + share * impulse)
        return ForwardState(self.jump, self.fading, self.frozen_steps, total, impulse, 1 - share, self.pose)


@dataclass(frozen=True, eq=False)
class RowResponse:
    """How forces move the present rows of a contact.

    Parameters
    ----------
    G, push : (d nr, n), (n, d nr) arrays or csr matrices
        Present rows, and the accelerations M^-1 G' that unit forces on them cause.
    F : (d nr, d nr) array
        G M^-1 G', with a small addition on the diagonal, because rows may be redundant.
    normals : (nr, n) array or csr matrix
        Normal directions in G.
    """

    G: Rows
    push: Rows
    F: Array
    normals: Rows


class Solution(NamedTuple):
    """Multipliers, and where they let the rows be.

    Parameters
    ----------
    forces : Forces
    places : (nr, d) array
        Gaps at the end of the step, and sliding along the tangents in it [m].
    """

    forces: Forces
    places: Array


class ForwardAnswer(NamedTuple):
    """Multipliers of a contact in an explicit step.

    Parameters
    ----------
    forces : Forces
        On the present rows.
    nodes : (nr,) int array
        Their nodes of the slave's patch.
    gap : (nr,) array
        Gaps at the end of the step [m].
    least_gap : float
        Smallest gap that rows would have then without forces [m].
    state : ForwardState
        For the next step.
    slip_memory : RowMemory
        What rows remember then. Without friction, these are forces alone, and `memory` has them.
    promise : Promise or None
        What the next step checks; None if all rows are open.
    """

    forces: Forces
    nodes: Array
    gap: Array
    least_gap: float
    state: ForwardState
    slip_memory: RowMemory
    promise: Promise | None = None

    @property
    def memory(self) -> RowMemory:
        """What rows remember after the step."""
        acting, slip_memory = self.forces.on_rows, self.slip_memory
        return slip_memory if acting.shape[1] > 1 else with_forces(slip_memory, self.nodes, acting)

    @property
    def impulse(self) -> Array:
        """Impulses so far, (7,) [N s], see `ForwardState`."""
        return self.state.impulse

    def expecting(self) -> ForwardAnswer:
        """See `ForwardState.expecting`."""
        state = self.state.expecting()
        return ForwardAnswer(self.forces, self.nodes, self.gap, self.least_gap, state, self.slip_memory, self.promise)


class ForwardRows:
    """The rows of a contact in explicit steps, and their places at the end of each step without contact forces.

    When frozen pairs have slid and become followed pairs, gaps jump. Multipliers would close such a jump within one
    step, with a false impact. So the difference from the frozen gaps is subtracted, and fades over many steps.

    With friction, lambda acts at the start of the step. Friction dissipates its impulse times the mean of the slip
    rates half a step before and after. This is the change of kinetic energy. It includes the tangential energy that
    nodes with mass lose when they touch and stick at once. The coefficient of friction, and the places of a carried
    rigid surface, follow from the step before.

    What a step leads to is a function of the answer in the step before. All that this object keeps saves time.

    Parameters
    ----------
    contact : PatchContact

    Attributes
    ----------
    law : Law
    friction : Coulomb or None
    """

    def __init__(self, contact: PatchContact) -> None:
        self.rows, self.gaps, self.law, self.friction = contact.rows, contact.gaps, contact.law, contact.friction
        self._response: tuple[object, RowResponse] | None = None  # the stage, and the response of its rows

    def begin(self, state: ForwardState | None = None, memory: RowMemory | None = None) -> ForwardAnswer:
        """Begin from a state, and from what rows remember then; by default, those of a new run."""
        memory = no_memory(self.rows) if memory is None else memory
        if state is None:
            state = ForwardState(np.zeros(len(memory.path)), 1.0, 0, _NO_IMPULSE, _NO_IMPULSE)
        nodes = self.gaps.row_nodes
        status = memory.status[nodes]
        forces = Forces(on_rows(self.rows, memory.forces), np.flatnonzero(status), status if self.rows.d > 1 else None)
        return ForwardAnswer(forces, nodes, np.full(len(nodes), np.inf), np.inf, state, memory)

    def response(self) -> RowResponse:
        """How forces move the present rows; the same object as long as the rows stay frozen."""
        kept, gaps = self._response, self.gaps
        if kept is None or gaps.moving or gaps.stage != kept[0]:
            G = self.rows.jacobian(np.arange(len(gaps.row_nodes)))
            push = gaps.sides.accelerations(gaps.present.q, G)
            F = regularised(dense(G @ push))  # between flat patches, there may be more rows than coordinates
            kept = self._response = gaps.stage, RowResponse(G, push, F, G[:: self.rows.d])
        return kept[1]

    def predict(self, last: ForwardAnswer, start: Start, step: float) -> Prediction:
        """Where rows would be at the end of the coming step [s] without contact forces; `last` is of the step before.

        The sliding of rows that are far away is not computed.
        """
        (q, q_t, q_tt), gaps, rows, pose = start, self.gaps, self.rows, last.state.pose
        gaps.accept(gaps.after())  # the step before has ended
        if last.promise is not None:
            self._check_last_step(last.promise, q)
        end = gaps.sides.moved(q, step * q_t + 0.5 * step**2 * q_tt)
        gap, jump, fading, frozen_steps = self._gaps(last.state, q, end)
        least = smallest(gap)
        if not isinstance(rows, TangentialRows):
            return Prediction(gap[:, None], least, end, q_tt, step, jump, fading, frozen_steps, pose)
        now, way = gaps.stage.pose, np.zeros((len(gap), rows.d - 1))
        if least < gaps.size:
            rows.record_places_at(q, now if pose is None else pose)
            way = rows.way()
        places = np.column_stack([gap, way])
        return Prediction(places, least, end, q_tt, step, jump, fading, frozen_steps, now)

    def _gaps(self, state: ForwardState, q: Array, end: Array) -> tuple[Array, Array, float, int]:
        """Gaps, (nr,) [m], at the coordinates `end`, (n,), to which q, (n,), leads without contact forces.

        The rest are `jump`, `fading` and `frozen_steps` after the step, see `ForwardState`.
        """
        gaps, frozen, nodes = self.gaps, self.gaps.stage.linear, self.gaps.row_nodes
        gap = gaps.at(end)
        jump, fading, frozen_steps = state.jump, state.fading, state.frozen_steps + 1
        if fading < 1.0:
            jump = fading * jump
        if gaps.moving:
            if frozen is not None:
                present, before = gaps.of_present(q), np.zeros(len(jump))
                before[gaps.row_nodes] = np.maximum(present, 0.0)  # a new row may be closed already
                before[nodes] = frozen.start + frozen.H @ q
                jump = jump.copy()
                jump[gaps.row_nodes] += present - before[gaps.row_nodes]
                gap = gaps.at(end)
                fading = 1 - 1 / max(frozen_steps / _SOONER, _SOONEST)
            frozen_steps = 0
        if fading < 1.0:
            gap = gap - jump[gaps.row_nodes]
        return gap, jump, fading, frozen_steps

    def open(self, last: ForwardAnswer, prediction: Prediction, share: float) -> ForwardAnswer:
        """Leave all rows open in the coming step, see `act`."""
        n, memory = len(prediction.places), last.slip_memory
        forces, gap = no_forces(self.rows.d, n), prediction.places[:, 0]
        if self.rows.d > 1 and memory.closed:
            memory = RowForces(self.rows, forces).memory_after(memory, np.zeros((n, 2)), np.zeros(n), 0.0)
        state = prediction.state_after(last.state, _NO_IMPULSE, share)
        return ForwardAnswer(forces, self.gaps.row_nodes, gap, prediction.least_gap, state, memory)

    def act(
        self,
        last: ForwardAnswer,
        prediction: Prediction,
        response: RowResponse,
        solution: Solution,
        scale: float,
        share: float,
    ) -> ForwardAnswer:
        """Apply forces to the rows in the coming step.

        Parameters
        ----------
        last : ForwardAnswer
            In the step before.
        prediction : Prediction
        response : RowResponse
        solution : Solution
        scale : float
            Largest change of a place that one multiplier causes [m].
        share : float
            Share of the impulse that velocities at the start of the step include.
        """
        forces, places = solution
        acting, step = RowForces(self.rows, forces), prediction.step
        memory, nodes = last.slip_memory, self.gaps.row_nodes
        if self.rows.d > 1:
            slips, taken = places[:, 1:], 0.0
            if forces.closed.size:
                way = step**2 * np.asarray(response.G @ prediction.q_tt).reshape(places.shape)[:, 1:]
                before = prediction.places[:, 1:] - way
                taken = -0.5 * float(np.sum(forces.on_rows[:, 1:] * (before + slips)))
            memory = acting.memory_after(memory, slips, np.linalg.norm(slips, axis=1) / step, taken)
        state = prediction.state_after(last.state, acting.impulse(step), share)
        promise = Promise(prediction.end, prediction.places[:, 0], places[:, 0], response.normals, scale)
        return ForwardAnswer(forces, nodes, places[:, 0], prediction.least_gap, state, memory, promise)

    def _check_last_step(self, promise: Promise, q: Array) -> None:
        """Raise unless the last step moved the gaps as central differences with its multipliers do.

        The check uses the pairs of that step, because points that cross an edge between facets have other gaps.
        """
        gap = promise.free_gap + promise.G @ self.gaps.sides.way(promise.free_end, q)
        off = largest_change(gap, promise.gap)
        # Rounding errors are looked at only where they may matter.
        if off > 1e-3 * promise.scale and off > 1e-3 * promise.scale + 1e-12 * (abs(q).max() + abs(gap).max()):
            raise RunError(
                "the last step did not close the gaps as predicted: contact with formulation 'lagrange' needs Exudyn's "
                "explicit solver VelocityVerlet with a constant step (solve_dynamic(..., method='explicit')), or its "
                "solver generalized-alpha (method='implicit')"
            )

    def check(self, answer: ForwardAnswer, q: Array) -> None:
        """Raise if a gap at coordinates q, (n,), is far below zero. The rows stay where they are."""
        gaps, state, promise, present = self.gaps, answer.state, answer.promise, self.gaps.present
        gap, faded = gaps.of_present(q), 0.0
        if state.fading < 1.0:
            gap = gap - state.jump[gaps.row_nodes]
            faded = (1 / state.fading - 1) * abs(state.jump).max(initial=0.0)  # in the step that ended here
        if gaps.present != present:  # frozen rows stay
            gaps.return_to(present)
        if promise is not None and len(promise.gap) == len(gap):
            gap = gap - np.minimum(promise.gap, 0.0)  # the depth that a user's own law allows
        deepest = smallest(gap)
        if deepest < -_CLOSED * gaps.size - faded:
            raise RunError(
                f"a gap is {deepest:.3g} m after a step whose multipliers should have closed it: in the step, points "
                "slid over edges between facets, where normals jump. Take a shorter step or a finer mesh of the master"
            )


class Predictions(NamedTuple):
    """Predictions of several contacts in one step.

    Parameters
    ----------
    parts : list of Prediction
        Of each contact.
    places : (nr, d) array
        Places of the rows of all contacts [m].
    step : float
        [s]
    """

    parts: list[Prediction]
    places: Array
    step: float

    @property
    def nearest(self) -> float:
        """Smallest gap [m]; infinite without rows."""
        return min([part.least_gap for part in self.parts], default=np.inf)


@dataclass(frozen=True, eq=False)
class AllRows:
    """How forces move the present rows of several contacts.

    Parameters
    ----------
    responses : list of RowResponse
        Of each contact.
    G, push : lists of (d nr, n) and (n, d nr) arrays or csr matrices
        Rows of each contact in the problem, and the accelerations that unit forces on them cause.
    F : (d nr, d nr) array
        Accelerations of all rows due to unit forces on them.
    slices : list of slice
        Places of each contact's rows in F.
    """

    responses: list[RowResponse]
    G: Sequence[Rows]
    push: Sequence[Rows]
    F: Array
    slices: list[slice]

    def split(self, forces: Array) -> list[Array]:
        """Split forces, (nr, d), into those of the contacts, (d nr,) each."""
        return [forces.ravel()[part] for part in self.slices]


@dataclass(frozen=True, eq=False)
class ByJoints:
    """Accelerations of rows that unit forces on rows cause through joint reactions, (d nr, d nr)."""

    F: Array


class ForwardIncrement:
    """One problem for all rows of several contacts: places at the end of a step, and the forces before it.

    Without contact forces, rows would be at h at the end of a step s. Forces move them by F = s^2 G M^-1 G'. If any
    contact has friction, all rows have three directions. Rows of contacts without friction then have a coefficient of
    zero, and forces along their tangents move nothing.

    Parameters
    ----------
    rows : sequence of ForwardRows
    dofs : list of (n,) int arrays
        Numbers of each contact's coordinates among all. They show which coordinates contacts share.

    Attributes
    ----------
    d : int
        Directions of each row in the problem.

    Raises
    ------
    RunError
        If contacts with different laws are to be solved together.
    """

    def __init__(self, rows: Sequence[ForwardRows], dofs: Sequence[Array]) -> None:
        self.rows = rows
        self.d = max((part.rows.d for part in rows), default=1)
        self._all: AllRows | None = None
        self._problem: RowProblem | None = None
        self._posed: tuple[AllRows, ByJoints | None, float] | None = None  # what the problem belongs to
        self._links = []
        laws = [part.law for part in rows]
        if len(laws) > 1 and (len({type(law) for law in laws}) > 1 or any(vars(law) for law in laws)):
            names = ", ".join(sorted({type(law).__name__ for law in laws}))
            raise RunError(
                f"contacts with the laws {names} act ahead of explicit steps and share joints or bodies, so that "
                "one law has to find all their forces. Take formulation='lagrange' for all of them, or one "
                "formulation whose law has no attributes"
            )
        for i, j in combinations(range(len(rows)), 2):
            _, in_i, in_j = np.intersect1d(dofs[i], dofs[j], return_indices=True)
            if in_i.size:
                self._links.append((i, j, in_i, in_j))

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far."""
        return 0 if self._problem is None else self._problem.iterations

    def increment(
        self, last: Sequence[ForwardAnswer], starts: Sequence[Start], step: float, share: float = 1.0
    ) -> tuple[list[Array], list[ForwardAnswer]]:
        """Forces that prevent penetration in the coming step.

        Parameters
        ----------
        last : sequence of ForwardAnswer
            Of each contact in the step before.
        starts : sequence of three (n,) arrays
            For each contact: coordinates of its bodies, their velocities, and their accelerations without contact.
        step : float
            Length of the step [s].
        share : float, optional
            Share of the impulse that velocities at the start of the step include.

        Returns
        -------
        list of (n,) arrays, list of ForwardAnswer
            Accelerations by each contact, none if no gap closes, and its answer.
        """
        ahead = self.predict(last, starts, step)
        if ahead.nearest >= 0.0:
            return self.open(last, ahead, share)
        rows = self.all_rows()
        return self.act(last, ahead, rows, self.solve(last, rows, ahead.places, step), share)

    def predict(self, last: Sequence[ForwardAnswer], starts: Sequence[Start], step: float) -> Predictions:
        """Where the rows of all contacts would be at the end of the step without contact forces."""
        by_contact = zip(self.rows, last, starts, strict=True)
        parts = [rows.predict(answer, start, step) for rows, answer, start in by_contact]
        places = [self._in_all(part.places) for part in parts]
        return Predictions(parts, places[0] if len(places) == 1 else np.vstack(places), step)

    def _in_all(self, places: Array) -> Array:
        """Values along the directions of rows, (nr, ...), with zeros along tangents that a contact does not have."""
        if places.shape[1] == self.d:
            return places
        return np.hstack([places, np.zeros((len(places), self.d - 1))])

    def open(
        self, last: Sequence[ForwardAnswer], ahead: Predictions, share: float = 1.0
    ) -> tuple[list[Array], list[ForwardAnswer]]:
        """Leave all rows open in the coming step, see `increment`."""
        by_contact = zip(self.rows, last, ahead.parts, strict=True)
        return [], [rows.open(answer, part, share) for rows, answer, part in by_contact]

    def all_rows(self) -> AllRows:
        """How forces move the present rows; the same object as long as the rows stay frozen."""
        responses = [rows.response() for rows in self.rows]
        if self._all is not None and responses == self._all.responses:
            return self._all
        by_contact = zip(self.rows, responses, strict=True)
        G, push, blocks = zip(*(self._expanded(rows.rows.d, response) for rows, response in by_contact), strict=True)
        slices, F = consecutive([len(block) for block in blocks]), scipy.linalg.block_diag(*blocks)
        for i, j, in_i, in_j in self._links:
            block = dense(G[i][:, in_i] @ push[j][in_j])
            F[slices[i], slices[j]], F[slices[j], slices[i]] = block, block.T
        self._all = AllRows(responses, G, push, F, slices)
        return self._all

    def _expanded(self, d: int, response: RowResponse) -> tuple[Rows, Rows, Array]:
        """G, M^-1 G' and F of a contact's rows, which have d directions, in all directions of the problem."""
        if d == self.d:
            return response.G, response.push, response.F
        n = len(response.F)
        F = np.eye(self.d * n) * response.F.diagonal().mean()
        F[:: self.d, :: self.d] = response.F
        expand = sp.csr_matrix((np.ones(n), (self.d * np.arange(n), np.arange(n))), shape=(self.d * n, n))
        return expand @ response.G, response.push @ expand.T, F

    def solve(
        self,
        last: Sequence[ForwardAnswer],
        rows: AllRows,
        places: Array,
        step: float,
        by_joints: ByJoints | None = None,
    ) -> Solution:
        """Forces on all rows, and where the rows are then.

        Parameters
        ----------
        last : sequence of ForwardAnswer
            Of each contact in the step before. What rows remember of it is the guess.
        rows : AllRows
        places : (nr, d) array
            Of the rows at the end of the step without contact forces [m], see `predict`.
        step : float
            [s]
        by_joints : ByJoints, optional
        """
        forces = mu = None
        if self.d > 1:
            by_contact = zip(self.rows, last, strict=True)
            before = [friction_before(part.rows, part.friction, answer.slip_memory) for part, answer in by_contact]
            forces, mu = (np.concatenate(values) for values in zip(*before, strict=True))
        posed = self._posed
        if posed != (rows, by_joints, step):
            status = [answer.memory.status[part.gaps.row_nodes] for part, answer in zip(self.rows, last, strict=True)]
            self._pose(rows, by_joints, step, np.concatenate(status), forces)
        assert self._problem is not None
        row_places = Places(places[:, 0], places[:, 1:], forces, mu, problem=self._problem)
        answer = self.rows[0].law.answer(row_places)
        return Solution(answer, places + self._problem.moved_by(answer.on_rows))

    def _pose(
        self, rows: AllRows, by_joints: ByJoints | None, step: float, status: Array, forces: Array | None
    ) -> None:
        """Pose the problem of these rows, with guesses of their status, (nr,), and with friction forces, (nr, 3)."""
        F = step**2 * (rows.F if by_joints is None else rows.F + by_joints.F)
        if self._problem is None:
            self._problem = RowProblem(self.d, F)
        if self._posed is None or self._posed[0] != rows:
            self._problem.replace(F, status, _NO_FRICTION if forces is None else forces)
        else:
            self._problem.exchange(F)
        self._posed = rows, by_joints, step

    def act(
        self,
        last: Sequence[ForwardAnswer],
        ahead: Predictions,
        rows: AllRows,
        solution: Solution,
        share: float = 1.0,
    ) -> tuple[list[Array], list[ForwardAnswer]]:
        """Apply forces in the coming step, see `increment`."""
        forces, places = solution
        by_contact, scale = (
            rows.split(forces.on_rows),
            ahead.step**2 * (rows.F.diagonal() * forces.on_rows.ravel()).max(),
        )
        accelerations = [push @ lam for push, lam in zip(rows.push, by_contact, strict=True)]
        if len(self.rows) == 1:
            answer = self.rows[0].act(last[0], ahead.parts[0], rows.responses[0], solution, scale, share)
            return accelerations, [answer]
        answers = []
        for i, (part, span) in enumerate(zip(self.rows, rows.slices, strict=True)):
            d, start, stop = part.rows.d, span.start // self.d, span.stop // self.d
            of_rows, ends = (np.ascontiguousarray(x[start:stop, :d]) for x in (forces.on_rows, places))
            closed = forces.closed[slice(*np.searchsorted(forces.closed, (start, stop)))] - start
            state = None if d == 1 or forces.state is None else forces.state[start:stop]
            part_solution = Solution(Forces(of_rows, closed, state), ends)
            answers.append(part.act(last[i], ahead.parts[i], rows.responses[i], part_solution, scale, share))
        return accelerations, answers
