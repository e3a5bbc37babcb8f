"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 21-28).

Theory: examples/site/theory.md, "Explicit steps".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...algebra.complementarity import regularised
from ...algebra.friction import SLIP
from ...algebra.products import dense
from ...algebra.row_problem import RowProblem
from ...errors import RunError
from ...frames.kinematics import Rows
from ...support.arrays import Array, consecutive
from ..law import Forces, Law, Places, RowDirections
from ..patch_contact import PatchContact
from ..tangential import TangentialRows

_CLOSED = 1e-3  # of a facet's size: accuracy of closed gaps where points cross edges between facets
_SOONER = 10  # the error of frozen pairs fades so many times faster than it grew, once pairs are followed
_SOONEST = 20  # steps at least, in which it fades

_NO_FRICTION = np.empty(0)
State = tuple[Array, Array, Array]  # coordinates, velocities, and accelerations without contact, (n,) each


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

    def answer(self, at: Places) -> Forces:
        """See `Law`."""
        if at.problem.d == 1:
            forces = at.problem.solve(at.gap[:, None], _NO_FRICTION)
        else:
            forces = at.problem.solve(np.column_stack([at.gap, at.way]), at.mu)
        return Forces(forces, at.problem.index, at.problem.state)

    def fresh(self, rows: RowDirections) -> Multipliers:
        """See `Law`."""
        return Multipliers()


@dataclass(frozen=True, eq=False)
class ForwardState:
    """What multipliers of explicit steps remember besides their contact's state.

    Parameters
    ----------
    jump : (np,) array
        What is subtracted from the gaps since pairs were frozen no longer, at the slave's nodes [m].
    fading : float
        Its factor in a step.
    frozen_steps : int
        Steps for which the pairs have been frozen.
    pose : (12,) array or None
        Where the carrier of a rigid surface was at the last prediction.
    """

    jump: Array
    fading: float
    frozen_steps: int
    pose: Array | None = None


class ForwardRows:
    """The rows of a contact in explicit steps, and their places at the end of each step without contact forces.

    When frozen pairs have slid and become followed pairs, gaps jump. Multipliers would close such a jump within one
    step, with a false impact. So the difference from the frozen gaps is subtracted, and fades over many steps.

    With friction, lambda acts at the start of the step. Friction dissipates its impulse times the mean of the slip
    rates half a step before and after. This is the change of kinetic energy. It includes the tangential energy that
    nodes with mass lose when they touch and stick at once. The coefficient of friction, and the places of a carried
    rigid surface, follow from the step before.

    Parameters
    ----------
    contact : PatchContact

    Attributes
    ----------
    G, push : (d nr, n), (n, d nr) arrays or csr matrices
        Present rows, and the accelerations M^-1 G' that unit forces on them cause.
    F : (d nr, d nr) array
        G M^-1 G', with a small addition on the diagonal, because rows may be redundant.
    """

    def __init__(self, contact: PatchContact) -> None:
        self.contact, self.rows = contact, contact.rows
        n = len(contact.gaps.slave.surface.points)
        self._expected: Array | None = None
        self._held: object = None
        self._jump, self._fading = np.zeros(n), 1.0  # remaining jump at the slave's nodes [m], its factor in a step
        self._frozen_steps = 0
        none = np.empty(0, dtype=np.int64)
        self._open = none, Forces(np.empty((0, self.rows.d)), none)  # no closed rows
        self._last = self._open  # nodes of the rows in the last step, and the forces on them
        self._pose: Array | None = None
        self.take()

    @property
    def state(self) -> ForwardState:
        """What is remembered after the multipliers of the coming step were found."""
        return ForwardState(self._jump.copy(), self._fading, self._frozen_steps, self._pose)

    def begin(self, state: ForwardState) -> None:
        """Begin from a state; the contact has begun from its own."""
        self._jump[:], self._fading = state.jump, state.fading
        self._frozen_steps, self._pose = state.frozen_steps, state.pose

    def take(self) -> bool:
        """Compute G, `push` and F of the present rows; return whether the rows have changed."""
        gaps = self.contact.gaps
        if gaps.holds(self._held):
            return False
        self.G = self.rows.jacobian(np.arange(len(gaps.row_nodes)))
        self.push = gaps.accelerations(self.G)
        self.F = regularised(dense(self.G @ self.push))  # between flat patches, there may be more rows than coordinates
        self._held = gaps.held
        return True

    @property
    def guess(self) -> tuple[Array, Array]:
        """Status of the present rows in the last step, (nr,), and the forces then, (nr, 3) [N]."""
        (nodes, (_, closed, state, *_)), status = self._last, np.zeros(len(self._jump), dtype=np.int8)
        status[nodes[closed]] = SLIP if state is None else state[closed]
        return status[self.contact.gaps.row_nodes], self.contact.last

    def predict(self, state: State, step: float) -> Array:
        """Places, (nr, d) [m], at the end of the coming step [s] without contact forces: gaps, and sliding in the step.

        The sliding of rows that are far away is not computed.
        """
        q, q_t, q_tt = state
        gaps, rows = self.contact.gaps, self.rows
        gap = self._gaps(q, gaps.moved(q, step * q_t + 0.5 * step**2 * q_tt))
        self._step, self._q_tt = step, q_tt
        if not isinstance(rows, TangentialRows):
            return gap[:, None]
        pose, way = gaps.evaluated_pose, np.zeros((len(gap), rows.d - 1))
        if self._least < gaps.size:
            rows.hold_at(q, pose if self._pose is None else self._pose)
            way = rows.way()
        self._pose, self._free = pose, way
        return np.column_stack([gap, way])

    def _gaps(self, q: Array, to: Array) -> Array:
        """Gaps, (nr,) [m], at the coordinates `to`, (n,), to which q, (n,), leads without contact forces."""
        self.contact.gaps.accept(self.contact.gaps.after())
        gaps, frozen, nodes = self.contact.gaps, self.contact.gaps.linear, self.contact.gaps.row_nodes
        self._check_last_step(q)  # it may find that the pairs have slid too far
        gap = gaps.at(to)
        self._jump *= self._fading
        self._frozen_steps += 1
        if gaps.moving:
            if frozen is not None:
                start, before = gaps.of_present(q), np.zeros(len(self._jump))
                before[gaps.row_nodes] = np.maximum(start, 0.0)  # a new row may be closed already
                before[nodes] = frozen.start + frozen.H @ q
                self._jump[gaps.row_nodes] += start - before[gaps.row_nodes]
                gap = gaps.at(to)
                self._fading = 1 - 1 / max(self._frozen_steps / _SOONER, _SOONEST)
            self._frozen_steps = 0
        gap = gap - self._jump[gaps.row_nodes]
        self._expected, self._predicted = None, (to, gap)
        self._least = gap.min(initial=np.inf)
        return gap

    def open(self) -> None:
        """Leave all rows open in the coming step."""
        closed = self.contact.evaluation.index.size > 0
        answer = self.contact.opened(self._predicted[1], self._least)
        self._last = self._open
        if closed and self.rows.d > 1:
            n = len(answer.on_rows)
            self.contact.remember(answer.memory_after(self.contact.state.memory, np.zeros((n, 2)), np.zeros(n), 0.0))

    def act(self, forces: Forces, places: Array, scale: float) -> None:
        """Apply forces to the rows in the coming step.

        Parameters
        ----------
        forces : Forces
        places : (nr, d) array
            Gaps at the end of the step, and sliding along the tangents in it [m].
        scale : float
            Largest change of a place that one multiplier causes [m].
        """
        contact = self.contact
        answer = contact.answered(forces, places[:, 0], self._least)
        self._last = contact.gaps.row_nodes, forces
        self._expected, self._scale = places[:, 0], scale
        if self.rows.d > 1:
            slips, taken = places[:, 1:], 0.0
            if answer.index.size:
                before = self._free - self._step**2 * np.asarray(self.G @ self._q_tt).reshape(-1, 3)[:, 1:]
                taken = -0.5 * float(np.sum(forces.on_rows[:, 1:] * (before + slips)))
            contact.remember(
                answer.memory_after(self.contact.state.memory, slips, np.linalg.norm(slips, axis=1) / self._step, taken)
            )

    def _check_last_step(self, q: Array) -> None:
        """Raise unless the last step moved the gaps as central differences with these multipliers do.

        The check uses the pairs of that step, because points that cross an edge between facets have other gaps.
        """
        if self._expected is None:
            return
        start, free = self._predicted
        gap = free + self.G[:: self.rows.d] @ self.contact.gaps.way(start, q)
        round_off = 1e-12 * (abs(q).max() + abs(gap).max())
        if abs(gap - self._expected).max() > 1e-3 * self._scale + round_off:
            raise RunError(
                "the last step did not close the gaps as predicted: contact with formulation 'lagrange' needs Exudyn's "
                "explicit solver VelocityVerlet with a constant step (solve_dynamic(..., method='explicit')), or its "
                "solver generalized-alpha (method='implicit')"
            )

    def check(self, q: Array) -> None:
        """Raise if a gap at coordinates q, (n,), is far below zero."""
        gaps = self.contact.gaps
        gap = gaps.of_present(q)
        faded = (1 / self._fading - 1) * abs(self._jump).max(initial=0.0)  # in the step that ended here
        gap = gap - self._jump[gaps.row_nodes]
        if self._expected is not None and len(self._expected) == len(gap):
            gap = gap - np.minimum(self._expected, 0.0)  # the depth that a user's own law allows
        deepest = gap.min(initial=0.0)
        if deepest < -_CLOSED * gaps.size - faded:
            raise RunError(
                f"a gap is {deepest:.3g} m after a step whose multipliers should have closed it: in the step, points "
                "slid over edges between facets, where normals jump. Take a shorter step or a finer mesh of the master"
            )


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
    G, push : lists of (d nr, n) and (n, d nr) arrays or csr matrices
        Rows of each contact in the problem, and the accelerations that unit forces on them cause.

    Raises
    ------
    RunError
        If contacts with different laws are to be solved together.
    """

    G: Sequence[Rows]
    push: Sequence[Rows]

    def __init__(self, rows: Sequence[ForwardRows], dofs: Sequence[Array]) -> None:
        self.rows = rows
        self.d = max((one.rows.d for one in rows), default=1)
        self._problem: RowProblem | None = None
        self._by_joints: Array | None = None
        self._links = []
        laws = [one.contact.law for one in rows]
        if len(laws) > 1 and (len({type(law) for law in laws}) > 1 or any(vars(law) for law in laws)):
            names = ", ".join(sorted({type(law).__name__ for law in laws}))
            raise RunError(
                f"contacts with the laws {names} act ahead of explicit steps and share joints or bodies, so that "
                "one law has to find all their forces. Take formulation='lagrange' for all of them, or one "
                "formulation whose law has no attributes"
            )
        for i, j in combinations(range(len(rows)), 2):
            _, own, others = np.intersect1d(dofs[i], dofs[j], return_indices=True)
            if own.size:
                self._links.append((i, j, own, others))

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far."""
        return 0 if self._problem is None else self._problem.iterations

    def increment(self, states: Sequence[State], step: float) -> list[Array]:
        """Accelerations, (n,) for each contact, due to the forces that prevent penetration; empty if no gap closes.

        Parameters
        ----------
        states : list of three (n,) arrays
            For each contact: coordinates of its bodies, their velocities, and their accelerations without contact.
        step : float
            Length of the step [s].
        """
        h = self.predict(states, step)
        if self.nearest(h) >= 0.0:
            return self.open()
        self.take_rows()
        return self.accelerations(self.solve(h))

    def predict(self, states: Sequence[State], step: float) -> Array:
        """Places of the rows of all contacts at the end of the step without contact forces, (nr, d) [m]."""
        self._step = step
        found = [self._in_all(one.predict(state, step)) for one, state in zip(self.rows, states, strict=True)]
        return found[0] if len(found) == 1 else np.vstack(found)

    def _in_all(self, places: Array) -> Array:
        """Values along the directions of rows, (nr, ...), with zeros along tangents that a contact does not have."""
        if places.shape[1] == self.d:
            return places
        return np.hstack([places, np.zeros((len(places), self.d - 1))])

    @staticmethod
    def nearest(h: Array) -> float:
        """Smallest gap in the places h, (nr, d); infinite without rows."""
        value: float = h[:, 0].min(initial=np.inf)
        return value

    def open(self) -> list[Array]:
        """Leave all rows open in the coming step; returns no accelerations."""
        for one in self.rows:
            one.open()
        return []

    def take_rows(self) -> bool:
        """Compute how forces move the present rows; return whether the rows have changed."""
        changed = [one.take() for one in self.rows]
        if self._problem is not None and not any(changed):
            return False
        self.G, self.push, blocks = zip(*map(self._expanded, self.rows), strict=True)
        self._slices = consecutive([len(F) for F in blocks])
        self._F = scipy.linalg.block_diag(*blocks)
        for i, j, own, others in self._links:
            block = self.G[i][:, own] @ self.push[j][others]
            rows, columns = self._slices[i], self._slices[j]
            self._F[rows, columns] = dense(block)
            self._F[columns, rows] = self._F[rows, columns].T
        guesses = [one.guess for one in self.rows]
        status, forces = (np.concatenate(part) for part in zip(*guesses, strict=True))
        F = self._step**2 * self._F
        if self._problem is None:
            self._problem = RowProblem(self.d, F)
        self._problem.replace(F, status, forces)
        self._by_joints, self._solved_step = None, self._step
        return True

    def _expanded(self, one: ForwardRows) -> tuple[Rows, Rows, Array]:
        """G, M^-1 G' and F of a contact's rows in all directions of the problem."""
        if one.rows.d == self.d:
            return one.G, one.push, one.F
        n = len(one.F)
        F = np.eye(self.d * n) * one.F.diagonal().mean()
        F[:: self.d, :: self.d] = one.F
        expand = sp.csr_matrix((np.ones(n), (self.d * np.arange(n), np.arange(n))), shape=(self.d * n, n))
        return expand @ one.G, one.push @ expand.T, F

    def yield_joints(self, by_joints: Array) -> None:
        """Add the accelerations of rows, (d nr, d nr), that unit forces on rows cause through joint reactions."""
        self._by_joints = by_joints
        self._exchange()

    def _exchange(self) -> None:
        assert self._problem is not None
        F = self._F if self._by_joints is None else self._F + self._by_joints
        self._problem.exchange(self._step**2 * F)
        self._solved_step = self._step

    def solve(self, h: Array) -> Array:
        """Return the forces, (nr, d) [N], for the places h, (nr, d) [m], see `predict`."""
        if self._step != self._solved_step:
            self._exchange()
        assert self._problem is not None
        contacts, n = [one.contact for one in self.rows], len(h)
        last, mu = np.zeros((n, 3)), np.zeros(n)
        if self.d > 1:
            last = np.concatenate([contact.last for contact in contacts])
            mu = np.concatenate([contact.coefficients for contact in contacts])
        places = Places(h[:, 0], h[:, 1:], last, mu, problem=self._problem)
        self._answer = contacts[0].law.answer(places)
        self._reached = h + self._problem.moved_by(self._answer.on_rows)
        return self._answer.on_rows

    def split(self, forces: Array) -> list[Array]:
        """Split forces, (nr, d), into those of the contacts, (d nr,) each."""
        return [forces.ravel()[own] for own in self._slices]

    def accelerations(self, forces: Array) -> list[Array]:
        """Apply forces, (nr, d) [N], in the coming step; return the accelerations they cause, (n,) for each contact."""
        each = self.split(forces)
        scale = self._step**2 * (self._F.diagonal() * forces.ravel()).max()
        if len(self.rows) == 1:
            self.rows[0].act(self._answer, self._reached, scale)
            return [self.push[0] @ each[0]]
        for one, own, reached, lam in zip(self.rows, self._slices, self.split(self._reached), each, strict=True):
            d, start, stop = one.rows.d, own.start // self.d, own.stop // self.d
            of_rows, places = (np.ascontiguousarray(x.reshape(-1, self.d)[:, :d]) for x in (lam, reached))
            closed = self._answer.closed[slice(*np.searchsorted(self._answer.closed, (start, stop)))] - start
            state = None if d == 1 or self._answer.state is None else self._answer.state[start:stop]
            one.act(Forces(of_rows, closed, state), places, scale)
        return [push @ lam for push, lam in zip(self.push, each, strict=True)]
