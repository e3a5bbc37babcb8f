"""State of a contact in one run, and what it keeps for the results. The next run makes another one."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..algebra.friction import SLIP, STICK
from ..algebra.products import dense
from ..contact.formulations.formulation import Law, Method, Together
from ..contact.formulations.frictional import FrictionalContact
from ..contact.frozen import FrozenContacts
from ..errors import RunError
from ..exudyn_bodies.model import SolverMotion, start_of_step
from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone import PlasticZone
from ..support.arrays import Array
from ..support.foreign import Coordinates, MainSystem

_FEW = 200  # coordinates that are converted from Exudyn's list faster than they are gathered from the model's

TOLD, TOLD_AHEAD = 6, 10  # values of `sForce`; those of multipliers tell impulses too


class ContactRun:
    """A contact in a run.

    Parameters
    ----------
    name : str
        The contact's.
    law : Law
        At the start of the run.
    slices : list of slice
        Where the coordinates of slave and master are among the model's.
    t : float
        When the run begins [s].
    method : {"explicit", "implicit", "static"}
    place_told : int, optional
        First of the data coordinates that the sensor `sForce` reads. Default: it asks the contact itself.

    Attributes
    ----------
    tangential : dict of float to ((na, 3) array, (na,) int8 array)
        With friction: tangential forces on the same rows in space [N], and whether they stick or slip, by the time.
    on_nodes : dict of float to list of (np, 3) arrays
        Where another body carries the rigid surface: forces on the nodes of the patch in space [N], by the time; they
        are not known from the bodies' coordinates alone.
    plastic_strains : dict of int to StrainHistory
        Plastic strain of each zone, by the number of its side.
    areas : (np,) array
        Area of the row of each of the slave's patch nodes [m2].
    edge : (float, (3,) array) or None
        When and where the contact reached the edge of its patch first [s, m].
    together : Together or None
        What finds the forces of this contact and of others on the same bodies.
    time_s : float
        Time in the contact's force so far [s].
    joined : bool
        Whether the multipliers are found together with those of joints.
    goes_on : bool
        Whether the run begins where the last one ended.
    """

    def __init__(
        self, name: str, law: Law, slices: Sequence[slice], t: float, method: Method, place_told: int | None = None
    ) -> None:
        self.name, self._law, self.slices, self.place_told = name, law, [*slices], place_told
        self._explicit = method == "explicit"  # then the last evaluation is the end of the last step
        self.dofs = np.concatenate([np.r_[s] for s in slices])
        self.together: Together | None = None
        self._group: GroupRun | None = None
        self.joined = self.goes_on = False
        self.time_s = 0.0
        self.areas = law.node_areas
        self._members: list[ContactRun] = [self]
        self._place = 0  # among the members
        self._remembering: list[ContactRun] = []
        self._evaluation: object = None
        self._jacobian: Array | None = None
        self._open_index: Array | None = None
        self._open_values: list[float] = []  # of `sFriction`
        self._samples: list[tuple[float, Array, Array]] = []
        self._stored: dict[float, float] = {}
        self.tangential: dict[float, tuple[Array, Array]] = {}
        self.on_nodes: dict[float, list[Array]] = {}
        self.plastic_strains = {} if law.yielding is None else {i: StrainHistory(z.zone) for i, z in law.yielding.zones}
        self.edge: tuple[float, Array] | None = None
        # Impulses of normal forces, sum and vector, and vector of tangential ones: so far, of the last step, to come.
        self._impulse, self._last, self._rest = np.zeros(7), np.zeros(7), np.zeros(7)
        self._stepped_to = t
        self._start, self._at = -np.inf, t
        self._force: Array | None = None  # of the last evaluation
        self._goes_on_at: float | None = None  # when the run that this one goes on from ended
        self._closed = self._closed_nodes = np.empty(0, dtype=np.int64)

    @property
    def law(self) -> Law:
        """The contact's, in its present state."""
        if self._group is not None:
            self._group.tell_laws()
        return self._law

    @property
    def samples(self) -> list[tuple[float, Array, Array]]:
        """Times with closed rows [s], the slave's patch nodes of these, and the forces on them [N]."""
        if self._group is None:
            return self._samples
        return sorted([*self._samples, *self._group.samples(self._place)], key=lambda sample: sample[0])

    @property
    def stored(self) -> dict[float, float]:
        """Energy that elastic contacts store with closed rows [J], by the time."""
        return self._stored if self._group is None else self._stored | self._group.stored(self._place)

    @property
    def law_name(self) -> str:
        """Name of the law's class."""
        return type(self._law).__name__

    @property
    def slip_path(self) -> Array:
        """Path that the row of each of the slave's patch nodes has slipped so far, (np,) [m]."""
        return np.array(self.law.slip_path)

    @property
    def plastic_ends(self) -> dict[int, PlasticState]:
        """Present state of each plastic zone, by the number of its side."""
        yielding = self.law.yielding
        return {} if yielding is None else {side: zone.present for side, zone in yielding.zones}

    def histories(self, zones: Mapping[int, PlasticZone]) -> dict[int, StrainHistory]:
        """`plastic_strains`; of a run from a file, in these zones."""
        return self.plastic_strains

    def of(self, coordinates: Array) -> Array:
        """Coordinates of slave and master, (n,), of the model's."""
        return np.concatenate([coordinates[s] for s in self.slices])

    def join(self, together: Together, members: list[ContactRun]) -> None:
        """Find the forces together with those of other contacts; `members` are all, this one included."""
        self.together, self._members, self._place = together, members, members.index(self)
        self._remembering = [member for member in members if member.law.remembers]

    def go_on(self, earlier: ContactRun, t: float) -> None:
        """Go on from the end of an earlier run at time t [s]; this one's law is the twin of that one's."""
        for name in ("_start", "_at", "_force", "_impulse", "_last", "_rest", "_stepped_to"):
            setattr(self, name, copy.copy(getattr(earlier, name)))
        self._goes_on_at = t

    @property
    def evaluated(self) -> bool:
        """Whether it has been evaluated by itself; a run may begin anew before."""
        return self._force is not None

    def at_once(self, group: GroupRun) -> None:
        """Leave the forces to the group, which finds those of all members at once."""
        self._group = group

    def evaluate(self, mbs: MainSystem, t: float, q: Coordinates | None = None) -> Array:
        """Generalised contact force, (n,), in the model's present state at time t [s].

        `q` are the contact's coordinates, if Exudyn has handed them to a user function.
        """
        if self._force is None or t != self._goes_on_at:  # the law has evaluated that state already
            self._force = self._evaluated(mbs, t, q)
        return self._force

    def _evaluated(self, mbs: MainSystem, t: float, q: Coordinates | None) -> Array:
        if self.together is not None:
            for member in self._remembering:
                member.follow(start_of_step(mbs), t)
            data = mbs.systemData.GetODE2Coordinates(copy=False)
            forces = self.together.forces_at(data, lambda: [member.of(data) for member in self._members])
            self._note(forces)
            return forces[self._place]
        law = self.law
        if law.remembers:
            if self._explicit and law.flies_on(self._at):
                self._start, self._at = self._at, t
            else:
                self.follow(start_of_step(mbs), t)
        if law.elastic or isinstance(law, FrictionalContact):
            few = q is not None and len(q) <= _FEW
            return law.force(np.asarray(q) if few else self.of(mbs.systemData.GetODE2Coordinates(copy=False)))
        return law.evaluate(SolverMotion(mbs, self.of))

    def update(self, mbs: MainSystem, t: float, q: Coordinates | None = None) -> None:
        """Bring the law to the model's present state at time t [s]."""
        if self._group is None:
            self.evaluate(mbs, t, q)
        else:
            self._group.force(mbs.systemData.GetODE2Coordinates(copy=False))
            self._note(self._group.evaluated)

    def _note(self, evaluation: object) -> None:
        """Forget what belongs to another evaluation."""
        if evaluation is not self._evaluation:
            self._evaluation, self._jacobian = evaluation, None

    def row_jacobian(self) -> Array:
        """Closed rows on the coordinates, (na, n), in the state that was evaluated last; links with others share it."""
        if self.together is None:
            return dense(self.law.row_jacobian())
        if self._jacobian is None:
            self._jacobian = dense(self.law.row_jacobian())
        return self._jacobian

    def follow(self, start: float, t: float) -> None:
        """Tell a law that depends on the path which step is computed, from `start` to t [s]."""
        if start != self._start:
            self.law.commit(start)
        elif t != self._at:
            self.law.rollback()
        self._start, self._at = start, t

    def stepped(self, t: float, step: float, *, half: bool = False) -> None:
        """Count what multipliers push at the start of the step to t; velocities there have all of it, or `half`."""
        law, share = self.law, 0.5 if half else 1.0
        self._last = np.zeros(7)
        if law.index.size:
            along = np.zeros(3) if law.friction is None else law.traction.sum(axis=0)
            self._last = step * np.r_[law.lam.sum(), law.resultant(), along]
        self._impulse += self._rest + share * self._last
        self._rest = (1 - share) * self._last
        self._stepped_to = t

    def foretell(self) -> None:
        """Count half of the last step's impulse again, until that of the next step is known."""
        self._impulse += 0.5 * self._last
        self._rest = -0.5 * self._last

    def _impulses(self) -> Array | None:
        """Impulses so far of multipliers, which jump between steps, (7,) [N s]; None of forces that do not."""
        return self._impulse if self._law.ahead else self._law.impulse

    def told(self) -> list[float]:
        """Values of the sensor `sForce` in the state that was evaluated last."""
        if self._group is not None and (told := self._group.told) is not None:
            values: list[float] = told[self._place].tolist()
            return values
        law = self.law
        if law.index.size:
            total, gap = float(law.lam.take(law.index).sum()), float(law.least_gap) if law.compliant else 0.0
            values = [total, float(law.index.size), *law.resultant().tolist(), gap]
        else:
            values = [0.0, 0.0, 0.0, 0.0, 0.0, float(law.least_gap)]
        return values if (impulse := self._impulses()) is None else values + impulse[:4].tolist()

    def tell(self, data: Array) -> None:
        """Write these values to where the sensor reads them, among the model's data coordinates."""
        if self.place_told is not None:
            values = self.told()
            data[self.place_told : self.place_told + len(values)] = values

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep what results need of the state at t; `q` returns the model's coordinates there."""
        law = self._law
        closed = law.index
        if law.yielding is not None:
            law.yielding.check()
            for side, zone in law.yielding.zones:
                self.plastic_strains[side].keep(t, zone.present.strain)
        if law.ahead and t != self._goes_on_at:  # which was checked there, and looking moves pairs
            self._check_step(t)
            law.check(self.of(q()))
        if closed.size:
            if closed is not self._closed:  # the same array as long as no row opens or closes
                self._closed, self._closed_nodes = closed, law.row_nodes[closed]
                self.look_for_edge(t)
            lam = law.lam.take(closed)
            if self._samples and self._samples[-1][0] == t:  # asked for again
                self._samples.pop()
            self._samples.append((t, self._closed_nodes, lam))
            if law.elastic:
                self._stored[t] = law.stored()
            if law.friction is not None:
                self.tangential[t] = law.traction[closed], law.state[closed]
            if law.gaps.carried:
                self.on_nodes[t] = law.nodal_forces()

    def look_for_edge(self, t: float) -> None:
        """Note when and where a row at the edge of its patch closes first."""
        if self.edge is None and (reached := self.law.edge_reached()) is not None:
            self.edge = t, reached

    def friction_values(self) -> list[float]:
        """Values of the sensor `sFriction`, see `PartitionContact`."""
        law = self.law
        if law.index is self._open_index:  # the same array as long as all rows stay open
            return self._open_values
        if law.index.size:
            stuck, slipping = (float(np.count_nonzero(law.state == kind)) for kind in (STICK, SLIP))
            values = [*law.traction.sum(axis=0).tolist(), stuck, slipping, law.dissipated(), law.stored()]
        else:
            values = [0.0, 0.0, 0.0, 0.0, 0.0, law.dissipated(), law.stored()]
            if self._impulses() is None:
                self._open_index, self._open_values = law.index, values
        return values if (impulse := self._impulses()) is None else values + impulse[4:].tolist()

    def plastic_values(self) -> list[float]:
        """Values of the sensor `sPlastic`, see `PartitionContact`."""
        yielding = self.law.yielding
        assert yielding is not None
        return [self.law.stored(), yielding.work(), yielding.largest_strain(), float(yielding.flowing())]

    def _check_step(self, t: float) -> None:
        """Refuse a run in which multipliers were not applied."""
        if t > self._stepped_to and not self.joined:
            raise RunError(
                f"contact {self.name!r}: its multipliers were not applied in the step to t = {t:.6g} s, for its "
                "PreStep function was replaced. Set your own with SetPreStepUserFunction before "
                "CreatePartitionContact, or run the model by solve_dynamic"
            )


class GroupRun:
    """Contacts in a run whose forces are found together and applied at once.

    As long as their pairs are frozen, compiled loops evaluate all of them at once. This keeps what the sensors tell,
    and laws learn of it only when they are looked at. Else each contact is evaluated by its law.

    Parameters
    ----------
    together : Together
    members : sequence of ContactRun

    Attributes
    ----------
    time_s : float
        Time in forces so far [s].
    evaluated : object
        Another object after each evaluation in another state.
    pushes : bool
        Whether any force was there in the last evaluation.
    """

    def __init__(self, together: Together, members: Sequence[ContactRun]) -> None:
        self.time_s, self.evaluated, self.pushes = 0.0, object(), False
        self._together, self._members = together, [*members]
        self._dofs = [member.dofs for member in members]
        self._twice = [len(np.unique(dofs)) < len(dofs) for dofs in self._dofs]  # of a body that touches itself
        self._frozen: FrozenContacts | None = None
        self._q: Array | None = None  # of the evaluation, if compiled loops made it
        self._laws_know = True
        readers = [(j, member.place_told) for j, member in enumerate(members) if member.place_told is not None]
        starts = np.reshape(readers, (-1, 2)).astype(int) * [TOLD, 1]
        self._from, self._to = np.add.outer(starts.T, np.arange(TOLD)).reshape(2, -1)  # of `told` to data coordinates
        self._closed: Array | None = None
        self._kept: list[tuple[float, Array, list[int], Array, Array]] = []
        for member in members:
            member.at_once(self)

    def force(self, q: Array) -> Array:
        """Generalised forces of all members, (nq,), at the model's coordinates q, (nq,)."""
        if self._q is not None and self._frozen is not None and (q == self._q).all():
            return self._frozen.force
        begin = time.perf_counter()
        if self._q is None:
            known, self._frozen = self._frozen, self._together.frozen(self._dofs, self._frozen)
            self._closed = self._closed if self._frozen is known else None
        if self._frozen is not None and self._frozen.evaluate(q):
            self.evaluated = self._q = q.copy()
            self._laws_know, force = False, self._frozen.force
            self.pushes = self._frozen.pushes
        else:
            self._q, self._laws_know, force = None, True, np.zeros(len(q))
            self.evaluated = forces = self._together.forces_at(q, lambda: [member.of(q) for member in self._members])
            for dofs, twice, own in zip(self._dofs, self._twice, forces, strict=True):
                if twice:
                    np.add.at(force, dofs, own)
                else:
                    force[dofs] += own
            self.pushes = bool(force.any())
        self.time_s += time.perf_counter() - begin
        return force

    def tell_laws(self) -> None:
        """Let the laws take what compiled loops have found, if they do not know it yet."""
        if self._laws_know or self._q is None or self._frozen is None:
            return
        self._laws_know, q = True, self._q
        known = self._frozen.whole or self._frozen.evaluate_rows(q)
        if not (known and self._together.take(self._frozen, [member.of(q) for member in self._members])):
            self._q = None

    def end(self) -> None:
        """Leave the last state to the laws alone."""
        self.tell_laws()
        self._q = self._frozen = None

    @property
    def _looped(self) -> FrozenContacts | None:
        """What compiled loops have found in the last evaluation; None if the laws have made it."""
        return None if self._q is None else self._frozen

    @property
    def told(self) -> Array | None:
        """Values of the sensors `sForce` of all members, (n, 6); None if their laws have evaluated them."""
        return None if self._looped is None else self._looped.told

    def tell(self, data: Array) -> None:
        """Write these values to where the sensors read them, among the model's data coordinates."""
        if (told := self.told) is not None:
            data[self._to] = told.take(self._from)
            return
        for member in self._members:
            member.tell(data)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep what results need of the members' state at t; `q` returns the model's coordinates there."""
        if (frozen := self._looped) is None:
            for member in self._members:
                member.keep(t, q)
            return
        if self._kept and self._kept[-1][0] == t:  # asked for again
            self._kept.pop()
        if not self.pushes:
            return
        closed = np.flatnonzero(frozen.lam > 0.0)
        if self._closed is None or not np.array_equal(closed, self._closed):
            self._closed, self._nodes = closed, frozen.row_nodes[closed]
            self._bounds = np.searchsorted(closed, frozen.starts).tolist()
            at_edge = closed[frozen.at_edge[closed]]
            for j in np.unique(np.searchsorted(frozen.starts, at_edge, side="right")) - 1:
                self._members[j].look_for_edge(t)
        if len(closed):
            self._kept.append((t, self._nodes, self._bounds, frozen.lam[closed], frozen.stored.copy()))

    def samples(self, place: int) -> list[tuple[float, Array, Array]]:
        """What was kept of a member, see `ContactRun.samples`."""
        found = []
        for t, nodes, bounds, lam, _ in self._kept:
            start, end = bounds[place : place + 2]
            if start < end:
                found.append((t, nodes[start:end], lam[start:end]))
        return found

    def stored(self, place: int) -> dict[float, float]:
        """Energy that a member stored while it was closed [J], by the time."""
        return {t: float(stored[place]) for t, _, bounds, _, stored in self._kept if bounds[place] < bounds[place + 1]}
