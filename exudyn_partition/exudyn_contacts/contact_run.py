"""A contact in one run: its mechanics, and data for results. See `group_run` for contacts that belong together."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from ..algebra.friction import SLIP, STICK
from ..contact.evaluation import Evaluation
from ..contact.formulations.explicit_multipliers import ForwardAnswer, ForwardRows, ForwardState
from ..contact.formulations.formulation import Method
from ..contact.formulations.implicit_multipliers import ImpulseAnswer, ImpulseState, StepImpulses
from ..contact.law import Forces
from ..contact.memory import RowMemory
from ..contact.patch_contact import PatchContact
from ..errors import RunError
from ..exudyn_bodies.model import SolverMotion, start_of_step
from ..support.arrays import Array, consecutive, joined_slices
from ..support.foreign import MainSystem
from .contact_record import ContactRecord
from .run_state import MemberState

N_VALUES, N_VALUES_AHEAD = 6, 10  # numbers of values of `sForce`; those of multipliers include impulses
N_FRICTION = 7  # number of values of `sFriction`, of contacts without multipliers


class Group(Protocol):
    """Contacts of a run that belong together, as far as one of them needs it: `group_run.GroupRun`."""

    @property
    def values(self) -> Array | None:
        """Values of the sensors `sForce` of all members, (n, 6); None unless compiled loops have found them."""

    @property
    def stored(self) -> Array | None:
        """Energy that each member stores, (n,) [J]; None unless compiled loops have found it."""

    def evaluation(self, place: int) -> Evaluation:
        """Last answer of the contact at a place of the group."""

    def closing(self, place: int, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `PatchContact.closing`, of the contact at a place of the group."""


class ContactRun:
    """A contact in a run.

    Parameters
    ----------
    name : str
        The contact's.
    mechanics : PatchContact
        Rows, forces and memory of the contact, at the start of the run.
    slices : list of slice
        Places of the coordinates of slave and master among the model's.
    t : float
        When the run begins [s].
    method : {"explicit", "implicit", "static"}
    place, friction_place : int, optional
        First of the data coordinates that the sensors `sForce` and `sFriction` read. Default: the sensor calls the
        contact itself.

    Attributes
    ----------
    dofs : (n,) int array
        Numbers of the contact's coordinates in the model.
    force : (n,) array or None
        Generalised force of the last evaluation; None before the first one, or if compiled loops found the force.
    record : ContactRecord
        What results need.
    forward : ForwardRows or None
        Multipliers that act ahead of the steps of an explicit run.
    impulses : StepImpulses or None
        Multipliers of an implicit run, whose forces are means within steps.
    joined : bool
        Whether the multipliers are found together with those of joints.
    goes_on_at : float or None
        Time at which the earlier run ended, if this one goes on from it as if both were one [s].
    """

    def __init__(
        self,
        name: str,
        mechanics: PatchContact,
        slices: Sequence[slice],
        t: float,
        method: Method,
        place: int | None = None,
        friction_place: int | None = None,
    ) -> None:
        self.name, self.mechanics, self.place, self._friction_place = name, mechanics, place, friction_place
        self._static = method == "static"
        self.forward = ForwardRows(mechanics) if mechanics.ahead and method == "explicit" else None
        self.impulses = StepImpulses(mechanics) if mechanics.ahead and method == "implicit" else None
        self.dofs = np.concatenate([np.arange(s.start, s.stop) for s in slices])
        self._slices = joined_slices(slices)  # fewer slices are quicker
        self._parts = consecutive([s.stop - s.start for s in self._slices])
        self._group_of: Callable[[], Group | None] = lambda: None
        self._place = 0  # in the group
        self.joined = False
        self.record = ContactRecord(mechanics)
        self._open: Forces | None = None
        self._open_values: list[float] = []  # values of `sFriction` while all rows are open, without plastic zones
        self._multipliers: ForwardAnswer | ImpulseAnswer | None = None  # their last answer
        self._begin_multipliers(None)
        self._stepped_to = t
        self._start, self._evaluated_at = -np.inf, t
        self.force: Array | None = None
        self.goes_on_at: float | None = None

    @property
    def evaluation(self) -> Evaluation:
        """Last answer of the contact."""
        group = self._group_of()
        return self.mechanics.evaluation if group is None else group.evaluation(self._place)

    @property
    def is_open(self) -> bool:
        """Whether all rows are open in the state that was evaluated last. The mechanics need not know it."""
        values = self._values
        return not (self.evaluation.index.size if values is None else values[1])

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `PatchContact.closing`."""
        group = self._group_of()
        if group is None:
            return self.mechanics.closing(q, q_t, q_tt)
        return group.closing(self._place, q, q_t, q_tt)

    @property
    def normal_force(self) -> float:
        """Sum of the normal forces in the state that was evaluated last [N]."""
        if (values := self._values) is not None:
            return float(values[0])
        answer = self.evaluation
        return float(answer.lam.take(answer.index).sum())

    @property
    def energy(self) -> float:
        """Energy that the contact stores in the state that was evaluated last, and that it has dissipated [J]."""
        group = self._group_of()
        if group is not None and (stored := group.stored) is not None:  # without friction and plastic zones
            return float(stored[self._place])
        answer = self.evaluation
        plastic = 0.0 if answer.plastic is None else answer.plastic.work
        return answer.stored + self._dissipated(answer) + self._damping_work(answer, self._evaluated_at) + plastic

    @property
    def _values(self) -> Array | None:
        """Values of the sensor `sForce`, (6,), if compiled loops have found them."""
        group = self._group_of()
        values = None if group is None else group.values
        return None if values is None else values[self._place]

    @property
    def asks(self) -> bool:
        """Whether all its sensors call it."""
        return self.place is None and self._friction_place is None

    @property
    def acts_within(self) -> bool:
        """Whether the contact has forces within a step; multipliers ahead of the step do not count."""
        return self.forward is None or self.mechanics.zones is not None

    @property
    def pushes(self) -> bool:
        """Whether any force may not be zero in the last evaluation."""
        return self.force is not None and (self.impulses is not None or self.mechanics.evaluation.pushes)

    @property
    def remembers(self) -> bool:
        """Whether forces depend on earlier steps."""
        return self.impulses is not None or self.mechanics.remembers

    def coordinates_in(self, q: Array) -> Array:
        """Coordinates of slave and master, (n,), out of the model's."""
        place, *more = self._slices
        return np.concatenate([q[s] for s in self._slices]) if more else q[place].copy()

    def join(self, group: Group, place: int) -> None:
        """Let the group find the forces; `place` is this contact's place in it.

        The group is the model's. Held by a contact and holding it, its memory would wait for the collector of garbage.
        """
        self._group_of, self._place = weakref.ref(group), place

    def begin(self, state: MemberState, t: float, *, as_one: bool = True) -> None:
        """Begin at time t [s] from the state at the end of a run.

        With `as_one`, as if both runs were one: forces are not found again at that time.
        """
        self.mechanics.begin(state.contact, t)
        self._begin_multipliers(state.multipliers)
        if not as_one:
            return
        if isinstance(self._multipliers, ImpulseAnswer):
            self.force = self._multipliers.force
        elif self.acts_within:
            self.force = self.mechanics.generalised()
        self._evaluated_at = self._stepped_to = self.goes_on_at = t

    def _begin_multipliers(self, state: ForwardState | ImpulseState | None) -> None:
        mechanics = self.mechanics
        if self.forward is not None:
            known = state if isinstance(state, ForwardState) else None
            self._multipliers = self.forward.begin(known, mechanics.state.memory)
        elif self.impulses is not None:
            known_means = state if isinstance(state, ImpulseState) else None
            self._multipliers = self.impulses.begin(known_means, mechanics.state.memory)

    def state(self, number: int) -> MemberState:
        """State at the end of the last step. `number` is that of the contact."""
        _ = self.evaluation  # which compiled loops may have found
        contact, multipliers = self.mechanics.at_end(self._evaluated_at), self._multipliers
        if multipliers is None:
            return MemberState(number, contact, None)
        return MemberState(number, replace(contact, memory=multipliers.memory), multipliers.state)

    def has_begun(self, t: float) -> bool:
        """Whether forces were found in the step that begins at time t [s], or depend on no step."""
        if self.impulses is not None:
            return self._start == t
        return not self.mechanics.remembers or self.mechanics.since == t

    def at(self, mbs: MainSystem, t: float, q: Array) -> None:
        """Find the force of this contact alone at the model's coordinates q, (nq,), and time t [s]."""
        self.accept(start_of_step(mbs), t)
        if self.impulses is not None:
            self.force = self._mean_force(self.impulses, SolverMotion(mbs, self.coordinates_in))
        else:
            self._find_force(mbs, q)

    def _find_force(self, mbs: MainSystem, q: Array) -> None:
        """Find the force within the step, which multipliers ahead of it do not have."""
        mechanics = self.mechanics
        if mechanics.ahead:
            self.force = mechanics.zone_forces(self.coordinates_in(q))
        else:
            motion = None if mechanics.law.elastic else SolverMotion(mbs, self.coordinates_in)
            mechanics.at(self.coordinates_in(q), motion)
            self.force = mechanics.generalised()

    def _mean_force(self, impulses: StepImpulses, motion: SolverMotion) -> Array:
        """Generalised force of multipliers that are means over an implicit step, (n,)."""
        mechanics, last = self.mechanics, self._multipliers
        assert isinstance(last, ImpulseAnswer)
        if motion.step <= 0.0:  # contact does not act on the accelerations with which a run begins
            mechanics.opened(np.zeros(len(mechanics.gaps.row_nodes)), mechanics.evaluation.least_gap)
            return np.zeros(len(self.dofs))
        answer = self._multipliers = impulses.at(last, motion)
        if answer != last:
            mechanics.answered(answer.forces, answer.gap, answer.least_gap)
        return answer.force

    def add_force(self, total: Array) -> None:
        """Add `force` to generalised forces on the model's coordinates, (nq,)."""
        assert self.force is not None
        for place, part in zip(self._slices, self._parts, strict=True):
            total[place] += self.force[part]

    def accept(self, start: float, t: float) -> None:
        """Begin the step from `start` to t [s]: the step before has ended, or this one begins again."""
        if self.impulses is not None:
            self._accept_means(self.impulses, start, t)
        elif start != self._start:
            self.mechanics.accept(start, t)
        elif t != self._evaluated_at:
            # Newton's method settles slowly where rows slide in statics, and would meet the same change of rows again.
            slides = self._static and self.mechanics.gaps.moving and self._evaluated_at != start
            self.mechanics.begin(end=t if t > start else None, freezes=slides)
        self._start, self._evaluated_at = start, t

    def _accept_means(self, impulses: StepImpulses, start: float, t: float) -> None:
        """See `accept`; of an implicit run with multipliers."""
        gaps, last = self.mechanics.gaps, self._multipliers
        assert isinstance(last, ImpulseAnswer)
        if start != self._start:
            gaps.accept(gaps.after())
            self._multipliers = impulses.accept(last)
        elif t != self._evaluated_at:
            gaps.begin(gaps.accepted)
            iterate = last.iterate
            self._multipliers = impulses.begin(iterate.start, iterate.memory, iterate.flexibility, cautious=True)

    @property
    def multipliers_ahead(self) -> ForwardAnswer:
        """Multipliers of the last explicit step."""
        assert isinstance(self._multipliers, ForwardAnswer)
        return self._multipliers

    def apply_ahead(self, answer: ForwardAnswer, end: float) -> None:
        """Take the multipliers of the explicit step that ends at a time [s]."""
        self._multipliers, self._stepped_to = answer, end
        self.mechanics.answered(answer.forces, answer.gap, answer.least_gap)

    def expect_impulse(self) -> None:
        """See `ForwardState.expecting`."""
        self._multipliers = self.multipliers_ahead.expecting()

    def _impulses(self) -> Array | None:
        """Impulses of multipliers so far, (7,) [N s]; None for other forces. Multipliers jump between steps."""
        return None if self._multipliers is None else self._multipliers.impulse

    def force_values(self) -> list[float]:
        """Values of the sensor `sForce` in the state that was evaluated last."""
        if (by_loops := self._values) is not None:
            looped: list[float] = by_loops.tolist()
            return looped
        answer = self.evaluation
        if answer.index.size:
            total = float(answer.lam.take(answer.index).sum())
            gap = float(answer.least_gap) if self.mechanics.compliant else 0.0
            values = [total, float(answer.index.size), *answer.resultant().tolist(), gap]
        else:
            values = [0.0, 0.0, 0.0, 0.0, 0.0, float(answer.least_gap)]
        return values if (impulse := self._impulses()) is None else values + impulse[:4].tolist()

    def publish(self, data: Array) -> None:
        """Write the values of sensors to where they read them, among the model's data coordinates."""
        if self.place is not None:
            values = self.force_values()
            data[self.place : self.place + len(values)] = values
        if self._friction_place is not None:
            data[self._friction_place : self._friction_place + N_FRICTION] = self.friction_values()

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the state at t; `q` returns the model's coordinates at t."""
        answer = self.evaluation
        memory = self._slip_memory or self.mechanics.state.memory
        self.record.keep(t, answer, memory, self._damping_work(answer, t))
        if self.forward is not None and t != self.goes_on_at:  # that time was checked before
            self._check_step(t)
            self.forward.check(self.multipliers_ahead, self.coordinates_in(q()))

    def friction_values(self) -> list[float]:
        """Values of the sensor `sFriction`, see `PartitionContact`."""
        mechanics, answer = self.mechanics, self.evaluation
        if answer.forces is self._open:  # the same object as long as all rows stay open
            return self._open_values
        if answer.index.size:
            stuck, slipping = (float(np.count_nonzero(answer.status == kind)) for kind in (STICK, SLIP))
            values = [*answer.traction.sum(axis=0).tolist(), stuck, slipping, self._dissipated(answer), answer.stored]
        else:
            values = [0.0, 0.0, 0.0, 0.0, 0.0, self._dissipated(answer), answer.stored]
            # What zones and viscous flexibilities store changes as bodies swing.
            if self._impulses() is None and mechanics.zones is None and not mechanics.state.creep.elastic:
                self._open, self._open_values = answer.forces, values
        return values if (impulse := self._impulses()) is None else values + impulse[4:].tolist()

    def _dissipated(self, answer: Evaluation) -> float:
        """Energy that friction has taken since the start of the run until the last answer [J]."""
        memory = self._slip_memory
        return answer.dissipated if memory is None else memory.dissipated

    @property
    def _slip_memory(self) -> RowMemory | None:
        """Slip that multipliers have left behind; None for other forces."""
        last = self._multipliers
        return last.slip_memory if isinstance(last, ForwardAnswer) else None if last is None else last.memory

    @staticmethod
    def _damping_work(answer: Evaluation, t: float) -> float:
        """Energy that viscous flexibilities and the law itself have taken until t [J]."""
        return answer.viscous_work + answer.law_work(t) if answer.parts.damped else 0.0

    @property
    def acts_on_carrier(self) -> bool:
        """Whether `force_on_carrier` may not be zero."""
        return isinstance(self._multipliers, ImpulseAnswer) or self.evaluation.index.size > 0

    def force_on_carrier(self) -> Array:
        """Force on the body that carries the rigid surface, (3,) [N]."""
        last = self._multipliers
        return last.on_carrier[:3] if isinstance(last, ImpulseAnswer) else -self.evaluation.resultant()

    def moment_on_carrier(self, point: Array) -> Array:
        """Its moment about a point in space, (3,) [N m]."""
        last = self._multipliers
        return last.carrier_moment(point) if isinstance(last, ImpulseAnswer) else -self.evaluation.moment(point)

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far; `MultiplierStep` counts those of explicit multipliers."""
        if self.impulses is not None:
            return self.impulses.iterations
        _ = self.evaluation  # which has those of compiled loops
        return self.mechanics.iterations

    def plastic_values(self) -> list[float]:
        """Values of the sensor `sPlastic`, see `PartitionContact`."""
        answer = self.evaluation
        plastic = answer.plastic
        assert plastic is not None
        return [answer.stored, plastic.work, plastic.largest_strain, float(plastic.flowing)]

    def _check_step(self, t: float) -> None:
        """Raise an error if multipliers were not applied in the run."""
        if t > self._stepped_to and not self.joined:
            raise RunError(
                f"contact {self.name!r}: its multipliers were not applied in the step to t = {t:.6g} s, for its "
                "PreStep function was replaced. Set your own with SetPreStepUserFunction before "
                "CreatePartitionContact, or run the model by solve_dynamic"
            )
