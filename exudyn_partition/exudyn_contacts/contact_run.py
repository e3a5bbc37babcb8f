"""State of a contact in one run, and of a group of contacts whose forces are found together.

They also keep the data that results read. Each run makes new ones. No other module evaluates contact forces in a run.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..algebra.friction import SLIP, STICK
from ..contact.evaluation import Evaluation
from ..contact.formulations.explicit_multipliers import ForwardAnswer, ForwardRows, ForwardState
from ..contact.formulations.formulation import Method, Together
from ..contact.formulations.implicit_multipliers import ImpulseAnswer, ImpulseState, StepImpulses
from ..contact.frozen import FrozenContacts
from ..contact.law import Forces
from ..contact.patch_contact import PatchContact
from ..contact.state import ContactState
from ..errors import RunError
from ..exudyn_bodies.model import SolverMotion, start_of_step
from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone import PlasticZone
from ..support.arrays import Array, consecutive, joined_slices
from ..support.checks import read_only
from ..support.foreign import MainSystem
from .run_state import MemberState

N_VALUES, N_VALUES_AHEAD = 6, 10  # numbers of values of `sForce`; those of multipliers include impulses


class LoopedSamples:
    """What results need of samples that compiled loops have evaluated, of all contacts of a group."""

    def __init__(self) -> None:
        self._kept: list[tuple[float, Array, list[int], Array, Array]] = []

    def drop(self, t: float) -> None:
        """Drop the last sample if it has this time [s]."""
        if self._kept and self._kept[-1][0] == t:
            self._kept.pop()

    def add(self, t: float, nodes: Array, bounds: list[int], lam: Array, stored: Array) -> None:
        """Keep a sample.

        Parameters
        ----------
        t : float
            [s]
        nodes, lam : (na,) arrays
            Patch nodes of the closed rows, and the forces on them [N].
        bounds : list of int
            Places where the rows of each contact begin, and where the last ones end.
        stored : (n,) array
            Energy that each contact stores [J].
        """
        self._kept.append((t, nodes, bounds, lam, stored))

    def samples(self, place: int) -> list[tuple[float, Array, Array]]:
        """Samples of the contact at a place of the group, see `ContactRun.samples`."""
        return [
            (t, nodes[start:end], lam[start:end])
            for t, nodes, bounds, lam, _ in self._kept
            if (start := bounds[place]) < (end := bounds[place + 1])
        ]

    def stored(self, place: int) -> dict[float, float]:
        """Energy that this contact stored while it was closed [J]; keys are times [s]."""
        return {t: float(stored[place]) for t, _, bounds, _, stored in self._kept if bounds[place] < bounds[place + 1]}


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
    place : int, optional
        First of the data coordinates that the sensor `sForce` reads. Default: the sensor calls the contact itself.

    Attributes
    ----------
    dofs : (n,) int array
        Numbers of the contact's coordinates in the model.
    force : (n,) array or None
        Generalised force of the last evaluation; None before the first one, or if compiled loops found the force.
    tangential : dict of float to ((na, 3) array, (na,) int8 array)
        With friction: tangential forces on the closed rows in space [N], and whether the rows stick or slip. Keys are
        times [s].
    on_nodes : dict of float to list of (np, 3) arrays
        Where another body carries the rigid surface: forces on the nodes of the patch in space [N]. Keys are times [s].
        The bodies' coordinates alone do not determine these forces.
    viscous_works : dict of float to float
        Energy that viscous flexibilities and a damped law have dissipated [J]; keys are times [s]. Empty without any.
    plastic_strains : dict of int to StrainHistory
        Plastic strain of each zone. Keys are the numbers of the sides.
    areas : (np,) array
        Area of the row of each of the slave's patch nodes [m2].
    edge : (float, (3,) array) or None
        Time and place at which the contact first reached the edge of its patch [s, m].
    forward : ForwardRows or None
        Multipliers that act ahead of the steps of an explicit run.
    impulses : StepImpulses or None
        Multipliers of an implicit run, whose forces are means within steps.
    joined : bool
        Whether the multipliers are found together with those of joints.
    goes_on : bool
        Whether the run begins where the last one ended.
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
    ) -> None:
        self.name, self.mechanics, self.place = name, mechanics, place
        self._static = method == "static"
        self.forward = ForwardRows(mechanics) if mechanics.ahead and method == "explicit" else None
        self.impulses = StepImpulses(mechanics) if mechanics.ahead and method == "implicit" else None
        self.dofs = np.concatenate([np.r_[s] for s in slices])
        self._slices = joined_slices(slices)  # fewer slices are quicker
        self._parts = consecutive([s.stop - s.start for s in self._slices])
        self._group_of: Callable[[], GroupRun | None] = lambda: None
        self._looped = LoopedSamples()
        self._place = 0  # in the group
        self.joined = self.goes_on = False
        self.areas = mechanics.node_areas
        self._open: Forces | None = None
        self._open_values: list[float] = []  # values of `sFriction` while all rows are open, without plastic zones
        self._samples: list[tuple[float, Array, Array]] = []
        self._stored: dict[float, float] = {}
        self.viscous_works: dict[float, float] = {}
        self.tangential: dict[float, tuple[Array, Array]] = {}
        self.on_nodes: dict[float, list[Array]] = {}
        self.plastic_strains = (
            {} if mechanics.zones is None else {i: StrainHistory(z.zone) for i, z in mechanics.zones.motions}
        )
        self.edge: tuple[float, Array] | None = None
        self._multipliers: ForwardAnswer | ImpulseAnswer | None = None  # their last answer
        self._begin_multipliers(None)
        self._stepped_to = t
        self._start, self._evaluated_at = -np.inf, t
        self.force: Array | None = None
        self.goes_on_at: float | None = None
        self._closed = self._closed_nodes = np.empty(0, dtype=np.int64)

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
        return self.mechanics.closing(q, q_t, q_tt)

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
    def group(self) -> GroupRun:
        """Contacts whose forces are found together with this one's."""
        group = self._group_of()
        assert group is not None
        return group

    @property
    def _values(self) -> Array | None:
        """Values of the sensor `sForce`, (6,), if compiled loops have found them."""
        group = self._group_of()
        values = None if group is None else group.values
        return None if values is None else values[self._place]

    @property
    def acts_within(self) -> bool:
        """Whether the contact has forces within a step; multipliers ahead of the step do not count."""
        return self.forward is None or self.mechanics.zones is not None

    @property
    def pushes(self) -> bool:
        """Whether any force may not be zero in the last evaluation."""
        return self.force is not None and (self.impulses is not None or self.evaluation.pushes)

    @property
    def remembers(self) -> bool:
        """Whether forces depend on earlier steps."""
        return self.impulses is not None or self.mechanics.remembers

    @property
    def samples(self) -> list[tuple[float, Array, Array]]:
        """Times with closed rows [s], the slave's patch nodes of these rows, and the forces on them [N]."""
        looped = self._looped.samples(self._place)
        return sorted([*self._samples, *looped], key=lambda sample: sample[0]) if self._samples else looped

    @property
    def stored(self) -> dict[float, float]:
        """Energy that an elastic contact stores while rows are closed [J]; keys are times [s]."""
        return self._stored | self._looped.stored(self._place)

    @property
    def law_name(self) -> str:
        """Name of the law's class."""
        return type(self.mechanics.law).__name__

    @property
    def slip_path(self) -> Array:
        """Length of the slip so far of the row of each of the slave's patch nodes, (np,) [m]."""
        return np.array(self.mechanics.state.memory.path)

    @property
    def plastic_ends(self) -> dict[int, PlasticState]:
        """Present state of each plastic zone; keys are the numbers of the sides."""
        plastic = self.evaluation.plastic
        return {} if plastic is None else plastic.present

    def histories(self, zones: Mapping[int, PlasticZone]) -> dict[int, StrainHistory]:
        """Return `plastic_strains`. The same method of a run from a file needs these zones."""
        return self.plastic_strains

    def coordinates_in(self, q: Array) -> Array:
        """Coordinates of slave and master, (n,), out of the model's."""
        return np.concatenate([q[s] for s in self._slices])

    def join(self, group: GroupRun, place: int) -> None:
        """Let the group find the forces; `place` is this contact's place in it.

        The group is the model's. Held by a contact and holding it, its memory would wait for the collector of garbage.
        """
        self._group_of, self._place, self._looped = weakref.ref(group), place, group.kept

    def begin(self, state: MemberState, t: float) -> None:
        """Begin at time t [s] from the state at the end of a run, as if both runs were one."""
        self.begin_contact(state.contact, t)
        self._begin_multipliers(state.multipliers)
        if isinstance(self._multipliers, ImpulseAnswer):
            self.force = self._multipliers.force
        elif self.acts_within:
            self.force = self.mechanics.generalised()
        self._evaluated_at = self._stepped_to = self.goes_on_at = t

    def begin_contact(self, state: ContactState, t: float) -> None:
        """Begin at time t [s] from the state of a contact alone; its multipliers are those of a new run."""
        self.mechanics.begin(state, t)
        self._begin_multipliers(None)

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
        self.group.evaluation(self._place)  # which compiled loops may have found
        contact, multipliers = self.mechanics.at_end(self._evaluated_at), self._multipliers
        if multipliers is None:
            return MemberState(number, contact, None)
        return MemberState(number, replace(contact, memory=multipliers.memory), multipliers.state)

    def begun(self, t: float) -> bool:
        """Whether forces were found in the step that begins at time t [s]."""
        if self.impulses is not None:
            return self._start == t
        return not self.mechanics.remembers or self.mechanics.since == t

    def step_back(self, mbs: MainSystem, t: float, q: Array) -> bool:
        """Return to the start of a step, t [s], at the model's coordinates q, (nq,); whether that can be done."""
        if not self.begun(t):
            return True
        if self.impulses is not None:  # they are means of the whole step
            return False
        self._evaluated_at, mechanics = t, self.mechanics
        mechanics.retry()
        self._find_force(mbs, q)
        return True

    def evaluate(self, mbs: MainSystem, t: float, q: Array) -> None:
        """Find the force of this contact alone at the model's coordinates q, (nq,), and time t [s]."""
        self.follow(start_of_step(mbs), t)
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
        answer = self._multipliers = impulses.evaluate(last, motion)
        if answer != last:
            mechanics.answered(answer.forces, answer.gap, answer.least_gap)
        return answer.force

    def add_force(self, total: Array) -> None:
        """Add `force` to generalised forces on the model's coordinates, (nq,)."""
        assert self.force is not None
        for place, part in zip(self._slices, self._parts, strict=True):
            total[place] += self.force[part]

    def follow(self, start: float, t: float) -> None:
        """Begin the step from `start` to t [s], or begin it again."""
        if self.impulses is not None:
            self._follow_means(self.impulses, start, t)
        elif start != self._start:
            self.mechanics.accept(start)
        elif t != self._evaluated_at:
            gaps = self.mechanics.gaps
            slides = self._static and gaps.moving
            self.mechanics.retry()
            if slides:  # Newton's method settles slowly then, and would meet the same change of rows again
                gaps.freeze()
        self.mechanics.ends_at(t)
        self._start, self._evaluated_at = start, t

    def _follow_means(self, impulses: StepImpulses, start: float, t: float) -> None:
        """Begin the step from `start` to t [s] of an implicit run with multipliers, or begin it again."""
        mechanics, last = self.mechanics, self._multipliers
        assert isinstance(last, ImpulseAnswer)
        if start != self._start:
            mechanics.remember(last.memory)
            mechanics.gaps.accept(mechanics.gaps.after())
            self._multipliers = impulses.accept(last)
        elif t != self._evaluated_at:
            mechanics.gaps.retry()
            self._multipliers = impulses.retry(last)

    def accept_ahead(self) -> ForwardAnswer:
        """Accept the explicit step that has ended, and return the multipliers of it."""
        gaps, last = self.mechanics.gaps, self._multipliers
        assert isinstance(last, ForwardAnswer)
        gaps.accept(gaps.after())
        return last

    def apply_ahead(self, answer: ForwardAnswer, end: float) -> None:
        """Take the multipliers of the explicit step that ends at a time [s]."""
        self._multipliers, mechanics = answer, self.mechanics
        mechanics.answered(answer.forces, answer.gap, answer.least_gap)
        if mechanics.friction is not None:
            mechanics.remember(answer.slip_memory)
        self._stepped_to = end

    def expect_impulse(self) -> None:
        """See `ForwardState.expecting`."""
        assert isinstance(self._multipliers, ForwardAnswer)
        self._multipliers = self._multipliers.expecting()

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
        """Write these values to where the sensor reads them, among the model's data coordinates."""
        if self.place is not None:
            values = self.force_values()
            data[self.place : self.place + len(values)] = values

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the state at t; `q` returns the model's coordinates at t."""
        mechanics, answer = self.mechanics, self.evaluation
        closed = answer.index
        traction = answer.traction if mechanics.friction is not None and closed.size else None  # before pairs move
        if mechanics.damped:
            self._stored[t], self.viscous_works[t] = answer.stored, self._damping_work(answer, t)
        if answer.plastic is not None:
            answer.plastic.check()
            for side, state in answer.plastic.present.items():
                self.plastic_strains[side].keep(t, state)
        if self.forward is not None and t != self.goes_on_at:  # that time was checked before, and a check moves pairs
            self._check_step(t)
            assert isinstance(self._multipliers, ForwardAnswer)
            self.forward.check(self._multipliers, self.coordinates_in(q()))
        if closed.size:
            if closed is not self._closed:  # the same array as long as no row opens or closes
                self._closed, self._closed_nodes = closed, answer.row_nodes[closed]
            self.look_for_edge(t)
            lam = answer.lam.take(closed)
            if self._samples and self._samples[-1][0] == t:  # a second call for this time
                self._samples.pop()
            self._samples.append((t, self._closed_nodes, lam))
            if mechanics.elastic:
                self._stored[t] = answer.stored
            if traction is not None:
                self.tangential[t] = traction[closed], answer.status[closed]
            if mechanics.gaps.carried:
                self.on_nodes[t] = answer.nodal_forces()

    def look_for_edge(self, t: float) -> None:
        """Record the time and place at which a closed row first leaves its patch."""
        if self.edge is None and (reached := self.evaluation.edge_reached()) is not None:
            read_only(reached)  # results return it
            self.edge = t, reached

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
        last = self._multipliers
        if last is None:
            return answer.dissipated
        return last.slip_memory.dissipated if isinstance(last, ForwardAnswer) else last.memory.dissipated

    @staticmethod
    def _damping_work(answer: Evaluation, t: float) -> float:
        """Energy that viscous flexibilities and the law itself have taken until t [J]."""
        return answer.viscous_work + answer.law_work(t)

    def on_carrier(self, point: Array) -> Array:
        """Force on the body that carries the rigid surface, and its moment about a point in space, (6,) [N, N m]."""
        last = self._multipliers
        return last.carrier_force(point) if isinstance(last, ImpulseAnswer) else self.evaluation.on_carrier(point)

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows so far; `MultiplierStep` counts those of explicit multipliers."""
        if self.impulses is not None:
            return self.impulses.iterations
        self.group.evaluation(self._place)  # which has those of compiled loops
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


class GroupRun:
    """Contacts in a run whose forces are found together. A contact that is solved alone is a group of its own.

    As long as the pairs of all contacts are frozen, compiled loops evaluate all contacts at once, with the values of
    the sensors. Then evaluations of single contacts are made only when somebody asks for one. Otherwise contacts
    answer themselves.

    Parameters
    ----------
    members : sequence of ContactRun
    together : Together, optional
        Finds their forces together. Default: each contact is evaluated alone.

    Attributes
    ----------
    pushes : bool
        Whether any force was not zero in the last evaluation.
    kept : LoopedSamples
    """

    def __init__(self, members: Sequence[ContactRun], together: Together | None = None) -> None:
        self.members, self.together = [*members], together
        self._within = [member for member in members if member.acts_within]
        self._remembering = [member for member in members if member.remembers]
        all_found = all(member.force is not None for member in self._within)
        self._known_at = members[0].goes_on_at if all_found else None  # time of a state that is evaluated already
        self._find_whether_pushes()
        self._dofs = [member.dofs for member in members]
        self._frozen: FrozenContacts | None = None
        self._looped: tuple[float, Array] | None = None  # time and coordinates of the last answer, if loops found it
        self._told = False  # whether members have evaluations of that answer
        readers = [(j, member.place) for j, member in enumerate(members) if member.place is not None]
        starts = np.reshape(readers, (-1, 2)).astype(int) * [N_VALUES, 1]
        self._from, self._to = np.add.outer(starts.T, np.arange(N_VALUES)).reshape(2, -1)  # places, from and to
        self.kept = LoopedSamples()
        self._at_edge = np.empty(0, dtype=np.int64)  # closed rows whose depth is watched, see `_look_for_edges`
        for place, member in enumerate(members):
            member.join(self, place)

    @property
    def acts_within(self) -> bool:
        """Whether any contact has forces within a step; multipliers ahead of the step do not count."""
        return bool(self._within)

    def evaluate(self, mbs: MainSystem, t: float, q: Array) -> None:
        """Find the forces of all members at the model's coordinates q, (nq,), and time t [s]."""
        if t == self._known_at:
            return
        if self.together is None:
            for member in self._within:
                member.evaluate(mbs, t, q)
        elif self._find_by_loops(t, q):
            return
        else:
            start = start_of_step(mbs)
            for member in self._within:
                member.follow(start, t)
            self._find_together(q)
        self._find_whether_pushes()

    def step_back(self, mbs: MainSystem, t: float, q: Array) -> bool:
        """Return to the start of a step, t [s], at the model's coordinates q, (nq,); whether all members can."""
        self._known_at = None
        if self.together is None:
            returned = [member.step_back(mbs, t, q) for member in self._within]
        elif not self._remembering:
            returned = []
            self.evaluate(mbs, t, q)
        else:
            returned = [member.impulses is None or not member.begun(t) for member in self._remembering]
            if any(member.begun(t) for member in self._remembering):
                self._find_together(q)
        self._find_whether_pushes()
        return all(returned)

    def _find_together(self, q: Array) -> None:
        assert self.together is not None
        forces = self.together.forces_at(q, lambda: [member.coordinates_in(q) for member in self.members])
        for member, force in zip(self.members, forces, strict=True):
            member.force = force

    def _find_whether_pushes(self) -> None:
        self.pushes = any([member.pushes for member in self._within])

    def _find_by_loops(self, t: float, q: Array) -> bool:
        """Find the forces by compiled loops, if the group has them and all pairs are frozen; returns whether it did."""
        assert self.together is not None
        if self._looped is not None and t == self._looped[0] and (q == self._looped[1]).all():
            return True
        if self._looped is None:
            self._frozen = self.together.frozen(self._dofs, self._frozen)
        if self._frozen is None or not self._frozen.evaluate(q):
            self._looped = None
            return False
        if self._looped is None:
            for member in self.members:
                member.force = None
        self._looped, self._told, self.pushes = (t, q.copy()), False, self._frozen.pushes
        return True

    def add_force(self, total: Array) -> None:
        """Add the generalised forces of all members to those on the model's coordinates, (nq,)."""
        if self._looped is not None and self._frozen is not None:
            total += self._frozen.force
            return
        for member in self._within:
            member.add_force(total)

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together.stiffness`."""
        if self.together is not None:
            return self.together.stiffness(rows)
        return {(j, j): self.members[j].evaluation.stiffness_along(H) for j, H in rows.items()}

    def evaluation(self, place: int) -> Evaluation:
        """Last answer of the contact at a place of the group."""
        if self._looped is not None and not self._told and self._frozen is not None:
            assert self.together is not None
            self._told = True
            coordinates = [member.coordinates_in(self._looped[1]) for member in self.members]
            if not self.together.answer_as(self._frozen, coordinates):
                self._looped = None
        return self.members[place].mechanics.evaluation

    def end(self) -> None:
        """Make evaluations of the last answer, and drop the data of compiled loops."""
        self.evaluation(0)
        self._looped = self._frozen = None

    @property
    def values(self) -> Array | None:
        """Values of the sensors `sForce` of all members, (n, 6); None unless compiled loops have found them."""
        return None if self._looped is None or self._frozen is None else self._frozen.values

    @property
    def stored(self) -> Array | None:
        """Energy that each member stores, (n,) [J]; None unless compiled loops have found it."""
        return None if self._looped is None or self._frozen is None else self._frozen.stored

    def publish(self, data: Array) -> None:
        """Write these values to where the sensors read them, among the model's data coordinates."""
        if (values := self.values) is not None:
            data[self._to] = values.take(self._from)
            return
        for member in self.members:
            member.publish(data)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the members' state at t; `q` returns the model's coordinates at t."""
        frozen = self._frozen
        self.kept.drop(t)  # a second call for this time
        if self._looped is None or frozen is None:
            for member in self.members:
                member.keep(t, q)
            return
        if not self.pushes:
            return
        closed = np.flatnonzero(frozen.lam > 0.0)
        if frozen.kept is None or not np.array_equal(closed, frozen.kept):
            frozen.kept, self._nodes = closed, frozen.row_nodes[closed]
            self._bounds = np.searchsorted(closed, frozen.starts).tolist()
            self._at_edge = closed[np.isfinite(frozen.leaves_at[closed])]
        if len(self._at_edge):
            self._look_for_edges(t, frozen)
        if len(closed):
            self.kept.add(t, self._nodes, self._bounds, frozen.lam[closed], frozen.stored.copy())

    def _look_for_edges(self, t: float, frozen: FrozenContacts) -> None:
        """Let members whose closed rows leave their patch record it; then they look no more at the same rows."""
        rows, deepest = self._at_edge, np.maximum(-frozen.h[self._at_edge], 0.0)
        members = np.searchsorted(frozen.starts, rows, side="right") - 1
        leaving = np.unique(members[deepest >= frozen.leaves_at[rows]])
        for j in leaving:
            self.members[j].look_for_edge(t)
        self._at_edge = rows[~np.isin(members, leaving)]
