"""Multipliers of contacts and joints for Exudyn's VelocityVerlet, which has none (paper, eq. 28 with joints, 29).

Theory: examples/site/theory.md, "Joints in explicit steps".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..contact.formulations.explicit_multipliers import ForwardIncrement, State
from ..errors import RunError
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import start_of_step
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .contact_run import ContactRun
from .run_state import StepperState

_ITERATIONS = 20
_SETTLED = 1e-8  # relative last change of the joints' accelerations at which the iteration ends
_OPEN, _ROUND_OFF = 1e-2, 1e-12  # how far joints may be open: share of a row's way in a step; share of places, or rad
_OVER = 1e-6  # share of a step: a run that has less time left is at its end


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
        self._jointed = joints is not None
        self._stepped_to: float | None = None
        self._step = self._last_step = 0.0
        self._corrected_to = -np.inf  # end of the last step after which velocities were corrected
        self._looked_from: float | None = None  # start of the step whose multipliers `look_ahead` has applied
        self._pushes: list[tuple[Array, Array]] = []  # coordinates, and accelerations by contacts in the last step
        self._predicted: list[tuple[Array, Array]] = []  # those in the present velocities that must be removed again
        self._dofs = [contact.dofs for contact in contacts]
        self._forward = ForwardIncrement([contact.forward for contact in contacts if contact.forward], self._dofs)
        if joints is not None:
            self._carried, self._usual = np.zeros(joints.n), 0.0
            self._carried_before = self._carried  # at the start of the last step
            # Multipliers of joints that answer those of contacts: in the last step, and in the step before it.
            self._answer = self._answered = np.zeros(joints.n)
            self._shared = [np.intersect1d(dofs, joints.dofs, return_indices=True)[1:] for dofs in self._dofs]
            self._across: Array | None = None

    def begin(self, state: StepperState, t: float) -> None:
        """Begin at time t [s] from the state at the end of a run."""
        self._stepped_to, self._looked_from = t, t if state.looked else None
        self._step, self._last_step = state.step, state.last_step
        dofs = [*self._dofs[: len(state.pushes)], *([] if self.joints is None else [self.joints.dofs])]
        self._pushes = list(zip(self._dofs, state.pushes, strict=False))
        self._predicted = list(zip(dofs, state.predicted, strict=True)) if state.predicted else []
        if self.joints is not None:
            self._carried = self._carried_before = state.carried
            self._answer, self._answered, self._usual = state.answer, state.answered, state.usual

    def state(self, numbers: tuple[int, ...]) -> StepperState:
        """State at the end of the last step. `numbers` are those of the contacts."""
        none = np.empty(0)
        joints = (none, none, none, 0.0)
        if self._jointed:
            joints = self._carried, self._answer, self._answered, self._usual
        pushes, predicted = (tuple(a for _, a in some) for some in (self._pushes, self._predicted))
        looked = self._looked_from is not None and self._looked_from == self._stepped_to
        return StepperState(self._jointed, numbers, looked, self._step, self._last_step, pushes, predicted, *joints)

    def step_back(self, t: float) -> bool:
        """Return to the start of a step, t [s]; whether that can be done.

        Multipliers of contacts alone were applied at the end of the step before, and those of joints alone leave
        nothing behind. But those of contacts with joints, and of a first step, are counted when they are applied.
        """
        if self._stepped_to is None or self._stepped_to <= t:
            return True
        self._stepped_to = t
        if self._corrected_to > t:
            self._carried = self._carried_before
        return self._looked_from == t or not self.contacts

    @property
    def iterations(self) -> int:
        """Iterations of the active set so far."""
        return self._forward.iterations

    def before_step(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers ahead of the step that ends at t, once."""
        if t == self._stepped_to:
            return
        start = start_of_step(mbs)
        if start != self._looked_from:
            self._step = t - start
            self._apply(mbs)
            for contact in self.contacts:
                contact.count_impulse(t, self._step)
        self._stepped_to = t

    def look_ahead(self, mbs: MainSystem, t: float) -> None:
        """Apply the multipliers of the step that begins at t, once, at the end of the step before."""
        if self.joints is not None or t != self._stepped_to or t == self._looked_from:
            return
        if (solver := mbs.sys.get("dynamicSolver")) is not None:
            it = solver.it
            self._step, left = it.currentStepSize, it.endTime - t
            if _OVER * self._step < left < self._step:
                self._step = left  # Exudyn's last step ends with the run
        self._apply(mbs)
        for contact in self.contacts:
            contact.count_impulse(t + self._step, self._step, half=True)
        self._looked_from = t

    def _apply(self, mbs: MainSystem) -> None:
        """Apply multipliers of the coming step."""
        data, step = mbs.systemData, self._step
        q = data.GetODE2Coordinates(copy=False)
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        for dofs, acceleration in self._predicted:
            _push(q_t, q_tt, dofs, -acceleration, self._last_step)
        states = [(q[dofs], q_t[dofs], q_tt[dofs]) for dofs in self._dofs]
        increments: list[Array] = []
        if self.joints is None:
            increments = self._forward.increment(states, step)
        elif self.joints.constant and not self.contacts:
            self.joints.update()
            coming = 1.0, step, 0.5 * step**2
            reaction, _ = self.joints.hold(self.joints.rest(), coming, -1 / step**2, step, (q, q_t, q_tt))
            self._mean = 0.5 * self._carried + reaction
        else:
            own = self.joints.dofs
            mid = q_t[own] + 0.5 * step * q_tt[own]
            increments, reaction, acceleration = self._close(self._forward, self.joints, states, q[own], mid)
            self._mean = 0.5 * self._carried + reaction
            _push(q_t, q_tt, own, acceleration, step)
        self._pushes = list(zip(self._dofs, increments, strict=False))  # none if nothing closes
        for dofs, increment in self._pushes:
            _push(q_t, q_tt, dofs, increment, step)

    def after_step(self, mbs: MainSystem, t: float) -> None:
        """Make velocities and accelerations obey the joints, and give Exudyn their reactions."""
        if self.joints is None or t != self._stepped_to:  # also called before the first step
            return
        joints, data = self.joints, mbs.systemData
        self._carried_before, self._corrected_to = self._carried, t
        joints.update()
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        drift, now = joints.drift(self._step), (q_t, q_t, q_tt)
        self._carried, acceleration = joints.hold(drift, (0.0, 1.0, 0.0), -2 / self._step, self._step, now)
        if not joints.linear:
            self._usual = abs(acceleration).max()
        if self.contacts:
            # Until the next step's multipliers are known, contacts push as in the last step, and joints answer.
            self._predicted, self._last_step = [*self._pushes, (joints.dofs, joints.push @ self._answer)], self._step
        for dofs, acceleration in self._predicted:
            _push(q_t, q_tt, dofs, acceleration, self._step)
        for contact in self.contacts:
            contact.predict_impulse()
        data.SetAECoordinates(-(self._mean + 0.5 * (self._carried + self._answer - self._answered)))
        self._answered = self._answer

    def _close(
        self, forward: ForwardIncrement, joints: Joints, states: list[State], start: Array, mid: Array
    ) -> tuple[list[Array], Array, Array]:
        """Accelerations by each contact, multipliers of the joints, (n,), and accelerations by the joints, (k,).

        Contact multipliers lambda change the multipliers of the joints by yields lambda. Multipliers of joints
        accelerate the rows by `across`. So the flexibility of the rows is F + across yields.

        Parameters
        ----------
        states : list of three arrays
            States of the contacts, as `ForwardIncrement.predict` takes them.
        start, mid : (k,) arrays
            Coordinates of the joints, and their velocities at mid-step without multipliers.
        """
        step, near = self._step, False
        changed = joints.update()
        if forward.rows:
            h = forward.predict(states, step)
            # No joint closes gaps as wide as a facet within a step, and for them moving rows is not worth the time.
            near = not forward.nearest(h) >= min(rows.contact.gaps.size for rows in forward.rows)
        if near and (forward.take_rows() or changed or self._across is None):
            pushes = [G[:, own] @ joints.push[others] for G, (own, others) in zip(forward.G, self._shared, strict=True)]
            across = self._across = np.vstack(pushes)
            self._yields = -joints.solve(across.T)
            forward.yield_joints(across @ self._yields)
        acceleration, held, lam, last, by_joints = np.zeros(len(start)), np.zeros(joints.n), np.zeros(0), np.inf, mid
        self._answer = np.zeros(joints.n)
        for _ in range(_ITERATIONS):
            before = acceleration
            g = joints.residual(start, step * (mid + step * acceleration))
            reaction = joints.solve(held - g / step**2)
            if near:
                lam = forward.solve(h + step**2 * (self._across @ reaction).reshape(h.shape))
                self._answer = self._yields @ lam.ravel()
                reaction = reaction + self._answer
            by_joints = joints.push @ reaction
            if joints.linear:
                break
            acceleration = by_joints.copy()
            if lam.any():
                for push, (own, others), on_rows in zip(forward.push, self._shared, forward.split(lam), strict=True):
                    acceleration[others] += (push @ on_rows)[own]
            change = abs(acceleration - before).max()
            if change <= _SETTLED * max(self._usual, abs(acceleration).max()) or change > 0.5 * last:
                break
            last, held = change, joints.C @ acceleration
        if not joints.linear:
            self._check_closed(joints, g, start, step * mid, step**2 * acceleration)
        return forward.accelerations(lam) if lam.any() else forward.open(), reaction, by_joints

    @staticmethod
    def _check_closed(joints: Joints, g: Array, start: Array, way: Array, held: Array) -> None:
        """Raise an error if the iteration leaves joints open.

        Parameters
        ----------
        g : (n,) array
            Gaps of the joints before the last change of the iteration [m or rad].
        start, way, held : (k,) arrays
            Coordinates, their change in the step without multipliers, and the change that multipliers add.
        """
        used, round_off = joints.scale > 0, _ROUND_OFF * joints.reach
        if (abs(g) <= round_off)[used].all():
            return
        allowed = _OPEN * (abs(joints.C) @ abs(way)) + round_off
        if not (abs(g) <= allowed)[used].all():
            g = joints.residual(start, way + held)
        if not (abs(g) <= allowed)[used].all():  # also true of gaps that are not finite
            raise RunError(
                f"joints: Newton's iteration leaves them open by {abs(g[used]).max():.3g} m or rad. Check that they "
                "fit together at the start, take a shorter step, or method='implicit'"
            )


def _push(q_t: Array, q_tt: Array, dofs: Array, acceleration: Array, step: float) -> None:
    """Add an acceleration so that Verlet changes the velocity at mid-step by step times this acceleration."""
    q_t[dofs] += 0.5 * step * acceleration
    q_tt[dofs] += acceleration
