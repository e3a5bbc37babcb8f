"""Contacts of a run that belong together: each finds its own forces, or all find them in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..contact.evaluation import Evaluation
from ..contact.formulations.coupled import Coupled
from ..contact.formulations.formulation import Together
from ..contact.frozen import FrozenContacts
from ..contact.state import ContactState
from ..exudyn_bodies.model import start_of_step
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .broad_phase import BroadPhase
from .contact_record import LoopedSamples
from .contact_run import N_VALUES, ContactRun
from .run_state import MemberState


class GroupRun:
    """Contacts in a run of which each finds its forces within a step alone.

    Multipliers ahead of steps may still be found together, see `central_differences`.

    Parameters
    ----------
    members : sequence of ContactRun
    together : Together
        It knows the stiffness of the contacts.

    Attributes
    ----------
    members : list of ContactRun
    pushes : bool
        Whether any force was not zero in the last evaluation.
    samples : LoopedSamples
        What compiled loops have found.
    """

    def __init__(self, members: Sequence[ContactRun], together: Together) -> None:
        self.samples = LoopedSamples()
        self.members, self.together = [*members], together
        self._within = [member for member in members if member.acts_within]
        self._by_means = any(member.impulses is not None for member in members)
        all_found = all(member.force is not None for member in self._within)
        self._known_at = members[0].goes_on_at if all_found else None  # time of a state that is evaluated already
        self.pushes = self._any_pushes()
        for place, member in enumerate(members):
            member.join(self, place)
            member.record.share(self.samples, place)

    def begin(self, states: Sequence[ContactState], t: float) -> None:
        """Take states of the members, with their forces, at time t [s]: they are not found again there."""
        for member, state in zip(self.members, states, strict=True):
            member.begin(MemberState(0, state, None), t)
        self._known_at = t
        self.pushes = self._any_pushes()

    @property
    def acts_within(self) -> bool:
        """Whether any contact has forces within a step; multipliers ahead of the step do not count."""
        return bool(self._within)

    def _any_pushes(self) -> bool:
        return any([member.pushes for member in self._within])

    def at(self, mbs: MainSystem, t: float, q: Array) -> None:
        """Find the forces of all members at the model's coordinates q, (nq,), and time t [s]."""
        if t != self._known_at:
            self._known_at = None
            self._find(mbs, t, q)

    def _find(self, mbs: MainSystem, t: float, q: Array) -> None:
        """See `at`."""
        for member in self._within:
            member.at(mbs, t, q)
        self.pushes = self._any_pushes()

    def at_start(self, mbs: MainSystem, t: float, q: Array) -> bool:
        """Find the forces at the start of a step, t [s] and q, (nq,), that has failed; whether that can be done.

        Multipliers that are means of the step are not known there, once they have been found in it.
        """
        self._known_at = None
        begun = [member for member in self._within if member.has_begun(t)]
        if self._by_means:
            return not begun
        for member in begun:
            member.at(mbs, t, q)
        self.pushes = self._any_pushes()
        return True

    def add_force(self, total: Array) -> None:
        """Add the generalised forces of all members to those on the model's coordinates, (nq,)."""
        for member in self._within:
            member.add_force(total)

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together.stiffness`."""
        return self.together.stiffness(rows)

    def closed_stiffness(self, places: Sequence[int]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together.closed_stiffness`."""
        return self.together.closed_stiffness(places)

    def evaluation(self, place: int) -> Evaluation:
        """Last answer of the contact at a place of the group."""
        return self.members[place].mechanics.evaluation

    def closing(self, place: int, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `PatchContact.closing`, of the contact at a place of the group."""
        return self.members[place].mechanics.closing(q, q_t, q_tt)

    def end(self) -> None:
        """Drop the data that only the run needed."""

    @property
    def values(self) -> Array | None:
        """Values of the sensors `sForce` of all members, (n, 6); None unless compiled loops have found them."""
        return None

    @property
    def stored(self) -> Array | None:
        """Energy that each member stores, (n,) [J]; None unless compiled loops have found it."""
        return None

    def publish(self, data: Array, *, whole: bool = False) -> None:
        """Write these values to where the sensors read them, among the model's data coordinates.

        With `whole`, values are written that were written before, too.
        """
        for member in self.members:
            member.publish(data)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the members' state at t; `q` returns the model's coordinates at t."""
        for member in self.members:
            member.keep(t, q)


class CoupledRun(GroupRun):
    """Contacts in a run whose forces are found together. One contact may be such a group of its own.

    As long as the pairs of all contacts are frozen, compiled loops evaluate all contacts at once, with the values of
    the sensors. Then evaluations of single contacts are made only when somebody asks for one. Otherwise contacts
    answer themselves. Those of bodies that may meet anywhere sleep while they are far apart, see `broad_phase`.

    Parameters
    ----------
    members : sequence of ContactRun
    coupled : Coupled
        Finds their forces.
    sleeps : bool
        Whether contacts may sleep.
    """

    def __init__(self, members: Sequence[ContactRun], coupled: Coupled, *, sleeps: bool = False) -> None:
        self._awake = [*members]
        super().__init__(members, coupled)
        self._whole = coupled
        self._broad: BroadPhase | None = None
        self._sleeps = sleeps and coupled.divides and any(member.mechanics.gaps.anywhere for member in members)
        self._places: tuple[int, ...] = tuple(range(len(self.members)))  # of members that are awake
        self._always = [j for j, member in enumerate(self.members) if member.mechanics.damped]
        self._told_of = self._places  # the same when values of sensors were written last
        self._frozen: FrozenContacts | None = None
        self._looped: tuple[float, Array] | None = None  # time and coordinates of the last answer, if loops found it
        self._told = False  # whether members have evaluations of that answer
        self._coupled = coupled
        self._dofs = [member.dofs for member in members]
        readers = [(N_VALUES * j, member.place) for j, member in enumerate(members) if member.place is not None]
        self._from, self._to = (  # places, from and to
            np.array([first[k] + i for first in readers for i in range(N_VALUES)], dtype=np.int64) for k in (0, 1)
        )
        self._at_edge = np.empty(0, dtype=np.int64)  # closed rows whose depth is watched, see `_look_for_edges`

    def _find(self, mbs: MainSystem, t: float, q: Array) -> None:
        """See `at`."""
        if self._find_by_loops(t, q):
            return
        if self._sleeps:
            self._wake(q)
        start = start_of_step(mbs)
        for member in self._awake:
            member.accept(start, t)
        self._find_together(q)

    def _wake(self, q: Array) -> None:
        """Choose the members that are awake at the model's coordinates q, (nq,)."""
        if self._broad is None:
            self._broad = BroadPhase([member.mechanics for member in self.members], self._dofs, len(q))
            for member in self.members:
                member.record.near = False
            self._places, self._awake = (), []
        places = self._broad.look(q)
        if places != self._places:
            self._places, self._awake = places, [self.members[j] for j in places]
            for member in self._awake:
                member.record.near = True
            self._coupled = self._whole.some(places)

    def _any_pushes(self) -> bool:
        return any([member.pushes for member in self._awake])

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """See `GroupRun`; all closed rows are those of members that are awake."""
        number = {place: i for i, place in enumerate(self._places)}
        blocks = self._coupled.stiffness({number[j]: H for j, H in rows.items()})
        return {(self._places[j], self._places[k]): K for (j, k), K in blocks.items()}

    def closing(self, place: int, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `GroupRun`; a contact that sleeps is not asked."""
        if self._broad is None or place in self._places:
            return super().closing(place, q, q_t, q_tt)
        return self._broad.closing(place, q, q_t, q_tt)

    def at_start(self, mbs: MainSystem, t: float, q: Array) -> bool:
        """See `GroupRun`; multipliers are no such group."""
        self._known_at = None
        if all([member.has_begun(t) for member in self._awake]):  # others know of no step
            self._find(mbs, t, q)
        return True

    def _find_together(self, q: Array) -> None:
        if not self._awake:
            self.pushes = False
            return
        forces = self._coupled.forces_at(q, lambda: [member.coordinates_in(q) for member in self._awake])
        for member, force in zip(self._awake, forces, strict=True):
            member.force = force
        self.pushes = self._any_pushes()

    def _find_by_loops(self, t: float, q: Array) -> bool:
        """Find the forces by compiled loops, if the group has them and all pairs are frozen; returns whether it did."""
        if self._looped is not None and t == self._looped[0] and (q == self._looped[1]).all():
            return True
        if self._looped is None:
            self._frozen = self._coupled.frozen(self._dofs, self._frozen)
        if self._frozen is None or not self._frozen.at(q):
            self._looped = None
            return False
        if self._looped is None:
            for member in self.members:
                member.force = None
        self._looped, self._told, self.pushes = (t, q.copy()), False, self._frozen.pushes
        return True

    def add_force(self, total: Array) -> None:
        """See `GroupRun`."""
        if self._looped is not None and self._frozen is not None:
            total += self._frozen.force
        else:
            for member in self._awake:
                member.add_force(total)

    def evaluation(self, place: int) -> Evaluation:
        """See `GroupRun`."""
        if self._looped is not None and not self._told and self._frozen is not None:
            self._told = True
            coordinates = [member.coordinates_in(self._looped[1]) for member in self.members]
            if not self._coupled.answer_as(self._frozen, coordinates):
                self._looped = None
        return self.members[place].mechanics.evaluation

    def end(self) -> None:
        """Make evaluations of the last answer, and drop the data of compiled loops."""
        self.evaluation(0)
        self._looped = self._frozen = None

    @property
    def values(self) -> Array | None:
        """See `GroupRun`."""
        return None if self._looped is None or self._frozen is None else self._frozen.values

    @property
    def stored(self) -> Array | None:
        """See `GroupRun`."""
        return None if self._looped is None or self._frozen is None else self._frozen.stored

    def publish(self, data: Array, *, whole: bool = False) -> None:
        """See `GroupRun`; the values of contacts that sleep stay."""
        if (values := self.values) is not None:
            data[self._to] = values.take(self._from)
            return
        changed = self.members
        if self._sleeps and not whole:
            changed = [self.members[j] for j in {*self._places, *self._told_of}]
        self._told_of = self._places
        for member in changed:
            member.publish(data)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """See `GroupRun`."""
        frozen = self._frozen
        self.samples.drop(t)  # a second call for this time
        if self._looped is None or frozen is None:
            for member in self._keeping():
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
            self.samples.add(t, self._nodes, self._bounds, frozen.lam[closed], frozen.stored.tolist())

    def _keeping(self) -> Sequence[ContactRun]:
        """Members with a sample to keep: those that are awake, and those whose energies are kept while open."""
        if not self._sleeps:
            return self.members
        return [self.members[j] for j in sorted({*self._places, *self._always})]

    def _look_for_edges(self, t: float, frozen: FrozenContacts) -> None:
        """Let members whose closed rows leave their patch record it; then they look no more at the same rows."""
        rows, deepest = self._at_edge, np.maximum(-frozen.h[self._at_edge], 0.0)
        members = np.searchsorted(frozen.starts, rows, side="right") - 1
        leaving = np.unique(members[deepest >= frozen.leaves_at[rows]])
        for j in leaving:
            self.members[j].record.look_for_edge(t, self.evaluation(j))
        self._at_edge = rows[~np.isin(members, leaving)]
