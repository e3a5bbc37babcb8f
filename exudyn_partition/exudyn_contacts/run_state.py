"""State of a run between two steps, as one value: runs begin from it, go on from it, and are saved with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..contact.formulations.explicit_multipliers import ForwardState
from ..contact.formulations.formulation import Method
from ..contact.formulations.implicit_multipliers import ImpulseState
from ..contact.gaps import GapState
from ..contact.memory import RowMemory
from ..contact.plasticity.zone_state import Applied, Change, NodalState, ZoneState
from ..contact.stages import Anchor
from ..contact.state import ContactState
from ..contact.step_mean import StepMean
from ..contact.viscosity import ViscousMemory
from ..support.arrays import Array

_ROUND_OFF = 1e-12  # relative difference of times that are the same


@dataclass(frozen=True, eq=False)
class MemberState:
    """State of a contact in a run.

    Parameters
    ----------
    number : int
        Of its sensor `sForce`, by which it is known in the model.
    contact : ContactState
    multipliers : ForwardState or ImpulseState or None
    """

    number: int
    contact: ContactState
    multipliers: ForwardState | ImpulseState | None

    def for_other_run(self, *, counts: bool, moves: bool, sticks: bool) -> MemberState:
        """Return the state for a run that has another method, or another time; its multipliers are new.

        Parameters
        ----------
        counts : bool
            Whether energies and slip count on.
        moves : bool
            Whether the run before knew speeds of slip, unlike statics.
        sticks : bool
            Whether rows keep their forces. Those of multipliers do not: they act on velocities.
        """
        state = self.contact if counts else self.contact.without_energies()
        state = state if moves else state.at_rest()
        if not sticks:
            none = RowMemory.none(*state.memory.forces.shape).forces
            state = replace(state, memory=state.memory.with_forces(none))
        return MemberState(self.number, state, None)


@dataclass(frozen=True, eq=False)
class JointState:
    """Multipliers of joints in explicit steps.

    Parameters
    ----------
    step : float
        Length of the last step [s].
    predicted : tuple of arrays
        Accelerations by contacts and joints that the velocities include twice, until the next multipliers are known.
    mean, carried : (m,) arrays
        Multipliers: means over the last step, and those at its end.
    answer, answered : (m,) arrays
        Part of them that answers multipliers of contacts: in the last step, and in the step before it.
    usual : float
        Largest acceleration by joints in the last step.
    """

    step: float
    predicted: tuple[Array, ...]
    mean: Array
    carried: Array
    answer: Array
    answered: Array
    usual: float

    @classmethod
    def none(cls, m: int) -> JointState:
        """Before the first step, for m multipliers."""
        none = np.zeros(m)
        return cls(0.0, (), none, none, none, none, 0.0)

    def applied(self, reaction: Array, answer: Array) -> JointState:
        """After multipliers, (m,), were applied ahead of a step; `answer` is their part that answers contacts."""
        mean = 0.5 * self.carried + reaction
        return JointState(self.step, self.predicted, mean, self.carried, answer, self.answered, self.usual)


@dataclass(frozen=True, eq=False)
class StepperState:
    """State of `MultiplierStep`.

    Parameters
    ----------
    numbers : tuple of int
        Of its contacts, see `MemberState`.
    looked : bool
        Whether velocities include the multipliers of the coming step.
    step : float
        Length of the step whose multipliers were applied last [s].
    pushes : tuple of (n,) arrays
        Accelerations by contacts in that step; none if no gap closes.
    joints : JointState or None
        None if it closes no joints.
    """

    numbers: tuple[int, ...]
    looked: bool
    step: float
    pushes: tuple[Array, ...]
    joints: JointState | None

    @property
    def served(self) -> tuple[int, ...]:
        """Key of what it serves."""
        return int(self.joints is not None), *self.numbers


@dataclass(frozen=True, eq=False)
class RunState:
    """State of a model's contacts at the end of a run.

    Parameters
    ----------
    method : {"explicit", "implicit", "static"}
    t : float
        Time of the end [s].
    evaluated_at : float
        Time at which contacts were evaluated last [s].
    q : (nq,) array
        Coordinates of the model at the end.
    has_steps : bool
        Whether the run has made steps.
    broken : bool
        Whether an error stopped the run in a step to whose start its multipliers cannot return.
    contacts : tuple of MemberState
    steppers : tuple of StepperState
    turning : (nq,) array
        Velocities by whose rotation bodies in floating frames grew last; empty without such bodies.
    """

    method: Method
    t: float
    evaluated_at: float
    q: Array
    has_steps: bool
    broken: bool
    contacts: tuple[MemberState, ...]
    steppers: tuple[StepperState, ...]
    turning: Array

    def find(self, number: int) -> MemberState | None:
        """State of the contact with this number; None if it was not in the run."""
        return next((member for member in self.contacts if member.number == number), None)

    def ended_in(self, q: Array) -> bool:
        """Whether the run ended at the model's coordinates q, (nq,), at any time."""
        return np.array_equal(self.q, q)

    def ended_when(self, t: float) -> bool:
        """Whether the run ended at time t [s]."""
        return abs(self.t - t) <= _ROUND_OFF * abs(t)

    def ended_at(self, t: float, method: Method, q: Array) -> bool:
        """Whether the run made steps with this method and ended at time t [s], at the model's coordinates q, (nq,)."""
        if self.method != method or self.broken or not (self.has_steps and self.ended_in(q)):
            return False
        return self.ended_when(t) and abs(self.evaluated_at - t) <= _ROUND_OFF * abs(t)


# Classes of which a state consists, for files.
STATES = (
    *(RunState, MemberState, StepperState, JointState, ContactState, GapState, Anchor, RowMemory, ViscousMemory),
    *(ZoneState, Applied, Change, NodalState, ForwardState, ImpulseState, StepMean),
)
