"""Multipliers of contacts and joints for Exudyn's VelocityVerlet, which has none (paper, eq. 28 with joints, 29).

Theory: examples/site/theory.md, "Joints in explicit steps".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..contact.formulations.explicit_multipliers import AllRows, ByJoints, ForwardAnswer, ForwardIncrement, Start
from ..errors import RunError
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import start_of_step
from ..support.arrays import Array, as_slice
from ..support.foreign import MainSystem
from .contact_run import ContactRun
from .run_state import JointState, StepperState

_ITERATIONS = 20
_SETTLED = 1e-8  # relative last change of the joints' accelerations at which the iteration ends
_OPEN, _ROUND_OFF = 1e-2, 1e-12  # how far joints may be open: share of a row's way in a step; share of places, or rad
_OVER = 1e-6  # share of a step: a run that has less time left is at its end


class RowsAndJoints(NamedTuple):
    """How the rows of contacts and joints move each other.

    Parameters
    ----------
    rows : AllRows
    push : (k, n) array
        Of the joints, see `Joints`.
    across : (d nr, n) array
        Accelerations of the rows due to unit multipliers of joints.
    yields : (n, d nr) array
        Multipliers of joints that answer unit forces on the rows.
    by_joints : ByJoints
    """

    rows: AllRows
    push: Array
    across: Array
    yields: Array
    by_joints: ByJoints


class Closing(NamedTuple):
    """Multipliers of contacts and joints in the coming step.

    Parameters
    ----------
    increments : list of (n,) arrays
        Accelerations by each contact; none if no gap closes.
    contacts : list of ForwardAnswer
    reaction, answer : (n,) arrays
        Multipliers of the joints, and their part that answers those of contacts.
    by_joints : (k,) array
        Accelerations by the joints.
    """

    increments: list[Array]
    contacts: list[ForwardAnswer]
    reaction: Array
    answer: Array
    by_joints: Array


class MultiplierStep:
    """Work before each step, and after it if there are joints, for contacts whose multipliers are found together.

    Verlet takes q += h v + h^2/2 a, v += h/2 (a + a'). Let c be the accelerations of the multipliers. If v += h/2 c and
    a += c are set ahead of a step, the velocity at mid-step is v + h/2 a + h c. These are central differences (paper,
    eq. 29).

    Multipliers of contacts act at the start of a step. So `look_ahead` finds and applies them at the end of the step
    before. Velocities and accelerations that sensors record there include them, and the energy does not swing. Those of
    the first step are applied ahead of it. Multipliers of joints are always applied ahead of a step, because a user may
    move joints there. Until then velocities include the last step's multipliers a second time.

    Joints are closed at the end of the step, as gaps are. Joints that are not linear need Newton's iteration. It
    includes the effect of contacts on joints, and of joints on contacts. After the step a second multiplier makes
    velocities and accelerations obey the joints (RATTLE; Andersen 1983), so that nothing drifts. Joint sensors record
    mean reactions over the step before. Their sum times the step is the impulse.

    Parameters
    ----------
    contacts : list of ContactRun
        Contacts whose multipliers are applied ahead of explicit steps.
    joints : Joints, optional
        Of the whole model.
    """

    def __init__(self, contacts: Sequence[ContactRun], joints: Joints | None = None) -> None:
        self.contacts, self.joints = contacts, joints
        self._dofs = [contact.dofs for contact in contacts]
        self._places = [as_slice(dofs) for dofs in self._dofs]
        self._forward = ForwardIncrement([contact.forward for contact in contacts if contact.forward], self._dofs)
        self._shared: list[Sequence[Array]] = []
        none = None
        if joints is not None:
            self._shared = [np.intersect1d(dofs, joints.dofs, return_indices=True)[1:] for dofs in self._dofs]
            none = JointState.none(joints.n)
        self._state = StepperState((), False, 0.0, (), none)
        self._before = self._state  # at the start of the last step
        self._t: float | None = None  # end of the last step whose multipliers were applied
        self._coupled: RowsAndJoints | None = None

    def begin(self, state: StepperState, t: float) -> None:
        """Begin at time t [s] from the state at the end of a run."""
        self._t, self._state, self._before = t, state, state

    def state(self, numbers: tuple[int, ...]) -> StepperState:
        """State at the end of the last step. `numbers` are those of the contacts."""
        return replace(self._state, numbers=numbers)

    def at_start(self, t: float) -> bool:
        """Begin again at the start of the last step, t [s]; whether that can be done.

        Multipliers of contacts alone were applied at the end of the step before, and those of joints alone leave
        nothing behind. But those of contacts with joints, and of a first step, are counted when they are applied.
        """
        if self._t is None or self._t <= t:
            return True
        self.begin(self._before, t)
        return self._state.looked or not self.contacts

    @property
    def iterations(self) -> int:
        """Iterations of the active set so far."""
        return self._forward.iterations

    def has_made(self, t: float) -> bool:
        """Whether the multipliers of the step that ends at t were applied."""
        return t == self._t

    def before_step(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers ahead of the step that ends at t."""
        start, self._before = start_of_step(mbs), self._state
        state = self._state
        if state.looked and start == self._t:
            self._state = StepperState(state.numbers, False, state.step, state.pushes, state.joints)
        else:
            self._apply(mbs, t - start, t)
        self._t = t

    def look_ahead(self, mbs: MainSystem, t: float) -> None:
        """Apply the multipliers of the step that begins at t, once, at the end of the step before."""
        if self.joints is not None or t != self._t or self._state.looked:
            return
        step = self._state.step
        if (solver := mbs.sys.get("dynamicSolver")) is not None:
            step, left = solver.it.currentStepSize, solver.it.endTime - t
            if _OVER * step < left < step:
                step = left  # Exudyn's last step ends with the run
        self._apply(mbs, step, t + step, looked=True)

    def _apply(self, mbs: MainSystem, step: float, end: float, *, looked: bool = False) -> None:
        """Apply multipliers of the coming step, which ends at a time [s]; with `looked`, that step has not begun."""
        data, numbers = mbs.systemData, self._state.numbers
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        coordinates, jointed = (data.GetODE2Coordinates(copy=False), q_t, q_tt), None
        if self.joints is None:
            starts, last = self._starts(coordinates), self._last()
            increments, answers = self._forward.increment(last, starts, step, 0.5 if looked else 1.0)
        else:
            jointed, increments, answers = self._apply_joints(self.joints, coordinates, step)
        for place, increment in zip(self._places, increments, strict=False):  # none if nothing closes
            _push(q_t, q_tt, place, increment, step)
        for contact, answer in zip(self.contacts, answers, strict=True):
            contact.apply_ahead(answer, end)
        self._state = StepperState(numbers, looked, step, tuple(increments), jointed)

    def _starts(self, coordinates: Start) -> list[Start]:
        """Coordinates of each contact, velocities and accelerations, from those of the model."""
        q, q_t, q_tt = coordinates
        return [(c.coordinates_in(q), c.coordinates_in(q_t), c.coordinates_in(q_tt)) for c in self.contacts]

    def _last(self) -> list[ForwardAnswer]:
        """Multipliers of the contacts in the step that has ended."""
        return [contact.multipliers_ahead for contact in self.contacts]

    def _apply_joints(
        self, joints: Joints, coordinates: Start, step: float
    ) -> tuple[JointState, list[Array], list[ForwardAnswer]]:
        """Apply multipliers of joints in the coming step [s]; return their state, and what contacts answer then."""
        (q, q_t, q_tt), joint_state = coordinates, self._joint_state
        for dofs, acceleration in self._repeated(joints):
            _push(q_t, q_tt, dofs, -acceleration, joint_state.step)
        if joints.constant and not self.contacts:
            joints.update()
            coming = 1.0, step, 0.5 * step**2
            reaction, _ = joints.hold(joints.rest(), coming, -1 / step**2, step, coordinates)
            return joint_state.applied(reaction, joint_state.answer), [], []
        joint_dofs = joints.dofs
        mid = q_t[joint_dofs] + 0.5 * step * q_tt[joint_dofs]
        starts, last = self._starts(coordinates), self._last()
        closing = self._close(joints, last, starts, q[joint_dofs], mid, step)
        _push(q_t, q_tt, joint_dofs, closing.by_joints, step)
        return joint_state.applied(closing.reaction, closing.answer), closing.increments, closing.contacts

    @property
    def _joint_state(self) -> JointState:
        state = self._state.joints
        assert state is not None
        return state

    def _repeated(self, joints: Joints) -> list[tuple[Array, Array]]:
        """Coordinates, and accelerations on them that velocities include twice."""
        predicted, pushes = self._joint_state.predicted, self._state.pushes
        return list(zip([*self._dofs[: len(pushes)], joints.dofs], predicted, strict=True)) if predicted else []

    def after_step(self, mbs: MainSystem, t: float) -> None:
        """Make velocities and accelerations obey the joints, and give Exudyn their reactions."""
        if self.joints is None or t != self._t:  # also called before the first step
            return
        joints, data, state, joint_state = self.joints, mbs.systemData, self._state, self._joint_state
        joints.update()
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        drift, now = joints.drift(state.step), (q_t, q_t, q_tt)
        carried, acceleration = joints.hold(drift, (0.0, 1.0, 0.0), -2 / state.step, state.step, now)
        usual = joint_state.usual if joints.linear else abs(acceleration).max()
        predicted: tuple[Array, ...] = ()
        if self.contacts:
            # Until the next step's multipliers are known, contacts push as in the last step, and joints answer.
            predicted = *state.pushes, joints.push @ joint_state.answer
        data.SetAECoordinates(-(joint_state.mean + 0.5 * (carried + joint_state.answer - joint_state.answered)))
        jointed = JointState(
            state.step, predicted, joint_state.mean, carried, joint_state.answer, joint_state.answer, usual
        )
        self._state = StepperState(state.numbers, state.looked, state.step, state.pushes, jointed)
        for dofs, acceleration in self._repeated(joints):
            _push(q_t, q_tt, dofs, acceleration, state.step)
        for contact in self.contacts:
            contact.expect_impulse()

    def _close(
        self,
        joints: Joints,
        contacts: list[ForwardAnswer],
        starts: list[Start],
        start: Array,
        mid: Array,
        step: float,
    ) -> Closing:
        """Multipliers of the coming step [s].

        Contact multipliers lambda change the multipliers of the joints by yields lambda. Multipliers of joints
        accelerate the rows by `across`. So the flexibility of the rows is F + across yields.

        Parameters
        ----------
        contacts : list of ForwardAnswer
            Multipliers of the contacts in the step before.
        starts : list of three arrays
            See `ForwardIncrement.increment`.
        start, mid : (k,) arrays
            Coordinates of the joints, and their velocities at mid-step without multipliers.
        """
        forward, coupled, ahead = self._forward, None, None
        joints.update()
        if forward.rows:
            ahead = forward.predict(contacts, starts, step)
            # No joint closes gaps as wide as a facet within a step, and for them moving rows is not worth the time.
            if not ahead.nearest >= min(rows.gaps.size for rows in forward.rows):
                coupled = self._coupled_rows(joints)
        acceleration, gap_accelerations, last, by_joints, solution = (
            np.zeros(len(start)),
            np.zeros(joints.n),
            np.inf,
            mid,
            None,
        )
        answer = np.zeros(joints.n)
        for _ in range(_ITERATIONS):
            before = acceleration
            g = joints.residual(start, step * (mid + step * acceleration))
            reaction = joints.solve(gap_accelerations - g / step**2)
            if coupled is not None and ahead is not None:
                h = ahead.places + step**2 * (coupled.across @ reaction).reshape(ahead.places.shape)
                solution = forward.solve(contacts, coupled.rows, h, step, coupled.by_joints)
                answer = coupled.yields @ solution.forces.on_rows.ravel()
                reaction = reaction + answer
            by_joints = joints.push @ reaction
            if joints.linear:
                break
            acceleration = by_joints.copy()
            if coupled is not None and solution is not None and solution.forces.on_rows.any():
                parts = coupled.rows.split(solution.forces.on_rows)
                for push, (of_contact, of_joints), on_rows in zip(coupled.rows.push, self._shared, parts, strict=True):
                    acceleration[of_joints] += (push @ on_rows)[of_contact]
            change = abs(acceleration - before).max()
            if change <= _SETTLED * max(self._joint_state.usual, abs(acceleration).max()) or change > 0.5 * last:
                break
            last, gap_accelerations = change, joints.C @ acceleration
        if not joints.linear:
            self._check_closed(joints, g, start, step * mid, step**2 * acceleration)
        increments: list[Array] = []
        answers: list[ForwardAnswer] = []
        if coupled is not None and ahead is not None and solution is not None and solution.forces.on_rows.any():
            increments, answers = forward.act(contacts, ahead, coupled.rows, solution)
        elif ahead is not None:
            increments, answers = forward.open(contacts, ahead)
        return Closing(increments, answers, reaction, answer, by_joints)

    def _coupled_rows(self, joints: Joints) -> RowsAndJoints:
        """How the present rows and joints move each other; the same object as long as neither changes."""
        rows, coupled = self._forward.all_rows(), self._coupled
        if coupled is None or coupled.rows != rows or not np.array_equal(coupled.push, joints.push):
            both = zip(rows.G, self._shared, strict=True)
            across = np.vstack([G[:, of_contact] @ joints.push[of_joints] for G, (of_contact, of_joints) in both])
            yields = -joints.solve(across.T)
            coupled = self._coupled = RowsAndJoints(rows, joints.push, across, yields, ByJoints(across @ yields))
        return coupled

    @staticmethod
    def _check_closed(joints: Joints, g: Array, start: Array, way: Array, added: Array) -> None:
        """Raise an error if the iteration leaves joints open.

        Parameters
        ----------
        g : (n,) array
            Gaps of the joints before the last change of the iteration [m or rad].
        start, way, added : (k,) arrays
            Coordinates, their change in the step without multipliers, and the change that multipliers add.
        """
        used, round_off = joints.scale > 0, _ROUND_OFF * joints.reach
        if (abs(g) <= round_off)[used].all():
            return
        allowed = _OPEN * (abs(joints.C) @ abs(way)) + round_off
        if not (abs(g) <= allowed)[used].all():
            g = joints.residual(start, way + added)
        if not (abs(g) <= allowed)[used].all():  # also true of gaps that are not finite
            raise RunError(
                f"joints: Newton's iteration leaves them open by {abs(g[used]).max():.3g} m or rad. Check that they "
                "fit together at the start, take a shorter step, or method='implicit'"
            )


def _push(q_t: Array, q_tt: Array, place: slice | Array, acceleration: Array, step: float) -> None:
    """Add an acceleration so that Verlet changes the velocity at mid-step by step times this acceleration."""
    q_t[place] += 0.5 * step * acceleration
    q_tt[place] += acceleration
