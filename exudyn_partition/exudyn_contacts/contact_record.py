"""What results need of a contact in a run. It grows with each sample, and no force depends on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..contact.evaluation import Evaluation
from ..contact.memory import RowMemory
from ..contact.patch_contact import PatchContact
from ..contact.plasticity.yielding_patches import ZonesAnswer
from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone import PlasticZone
from ..support.arrays import Array
from ..support.checks import read_only


class LoopedSamples:
    """What results need of samples that compiled loops have evaluated, of all contacts of a group."""

    def __init__(self) -> None:
        self._kept: dict[float, tuple[Array, Sequence[int], Array, Sequence[float]]] = {}  # keys are times [s]

    def drop(self, t: float) -> None:
        """Drop the sample of this time [s], if there is one."""
        self._kept.pop(t, None)

    def add(self, t: float, nodes: Array, bounds: Sequence[int], lam: Array, stored: Sequence[float]) -> None:
        """Keep a sample.

        Parameters
        ----------
        t : float
            [s]
        nodes, lam : (na,) arrays
            Patch nodes of the closed rows, and the forces on them [N].
        bounds : list of int
            Places where the rows of each contact begin, and where the last ones end.
        stored : list of float
            Energy that each contact stores [J]; zero where all its rows are open.
        """
        self._kept[t] = nodes, bounds, lam, stored

    def samples(self, place: int) -> list[tuple[float, Array, Array]]:
        """Samples of the contact at a place of the group, see `ContactRecord.samples`."""
        return [
            (t, nodes[start:end], lam[start:end])
            for t, (nodes, bounds, lam, _) in self._kept.items()
            if (start := bounds[place]) < (end := bounds[place + 1])
        ]

    def rows_at(self, times: Sequence[float], place: int) -> list[tuple[Array, Array] | None]:
        """See `ContactRecord.rows_at`, of the contact at a place of the group."""
        rows_of_times: list[tuple[Array, Array] | None] = []
        for sample in map(self._kept.get, times):
            rows = None
            if sample is not None and (start := sample[1][place]) < (end := sample[1][place + 1]):
                rows = sample[0][start:end], sample[2][start:end]
            rows_of_times.append(rows)
        return rows_of_times

    def stored_at(self, times: Sequence[float], place: int) -> list[float]:
        """See `ContactRecord.stored_at`, of the contact at a place of the group."""
        return [0.0 if sample is None else sample[3][place] for sample in map(self._kept.get, times)]

    def stored(self, place: int) -> dict[float, float]:
        """Energy that this contact stored while it was closed [J]; keys are times [s]."""
        return {
            t: stored[place] for t, (_, bounds, _, stored) in self._kept.items() if bounds[place] < bounds[place + 1]
        }


class ContactRecord:
    """Samples of a contact in a run.

    Parameters
    ----------
    mechanics : PatchContact
        The contact at the start of the run.

    Attributes
    ----------
    law_name : str
        Name of the law's class.
    areas : (np,) array
        Area of the row of each of the slave's patch nodes [m2].
    pressures : (np, np) csr matrix
        Matrix from forces of rows to pressures around these nodes [1/m2].
    goes_on : bool
        Whether the run begins where the last one ended.
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
    near : bool
        Whether the sides were ever so near that the contact was evaluated, see `broad_phase`.
    edge : (float, (3,) array) or None
        Time and place at which the contact first reached the edge of its patch [s, m].
    """

    def __init__(self, mechanics: PatchContact) -> None:
        gaps, zones = mechanics.gaps, mechanics.zones
        self.law_name, self.goes_on = type(mechanics.law).__name__, False
        self.areas, self.pressures = gaps.all_points.node_areas, gaps.all_points.pressures
        self.tangential: dict[float, tuple[Array, Array]] = {}
        self.on_nodes: dict[float, list[Array]] = {}
        self.viscous_works: dict[float, float] = {}
        self.edge: tuple[float, Array] | None = None
        self.near = True
        self.plastic_strains = {} if zones is None else {side: StrainHistory(z.zone) for side, z in zones.motions}
        self._carried, self._damped, self._elastic = gaps.carried, mechanics.damped, mechanics.elastic
        self._samples: dict[float, tuple[Array, Array]] = {}  # keys are times [s]
        self._stored: dict[float, float] = {}
        self._looped, self._place = LoopedSamples(), 0
        self._closed = self._closed_nodes = np.empty(0, dtype=np.int64)
        self._memory: RowMemory = mechanics.state.memory
        self._plastic: ZonesAnswer | None = mechanics.evaluation.plastic

    def share(self, looped: LoopedSamples, place: int) -> None:
        """Share the samples of compiled loops with a group, in which the contact has this place."""
        self._looped, self._place = looped, place

    def keep(self, t: float, answer: Evaluation, memory: RowMemory, taken: float) -> None:
        """Keep the sample at time t [s].

        Parameters
        ----------
        t : float
        answer : Evaluation
            That of the contact at t.
        memory : RowMemory
            What its rows remember.
        taken : float
            Energy that viscous flexibilities and the law itself have dissipated until t [J].
        """
        self._memory, self._plastic = memory, answer.plastic
        if self._damped:
            self._stored[t], self.viscous_works[t] = answer.stored, taken
        if answer.plastic is not None:
            answer.plastic.check()
            for side, state in answer.plastic.present.items():
                self.plastic_strains[side].keep(t, state)
        closed = answer.index
        if not closed.size:
            return
        if closed is not self._closed:  # the same array as long as no row opens or closes
            self._closed, self._closed_nodes = closed, answer.row_nodes[closed]
        self.look_for_edge(t, answer)
        self._samples[t] = self._closed_nodes, answer.lam.take(closed)  # perhaps again
        if self._elastic:
            self._stored[t] = answer.stored
        if answer.parts.friction is not None:
            self.tangential[t] = answer.traction[closed], answer.status[closed]
        if self._carried:
            self.on_nodes[t] = answer.nodal_forces()

    def keep_rows(
        self, t: float, nodes: Array, lam: Array, stored: float, tangential: tuple[Array, Array] | None
    ) -> None:
        """Keep a sample of closed rows, which compiled steps have made.

        Parameters
        ----------
        t : float
            [s]
        nodes, lam : (na,) arrays
            Patch nodes of the rows, and the normal forces on them [N].
        stored : float
            Energy that the contact stores [J].
        tangential : ((na, 3) array, (na,) int8 array) or None
            With friction: tangential forces in space [N], and whether the rows stick or slip.
        """
        self._samples[t] = nodes, lam
        if self._elastic:
            self._stored[t] = stored
        if tangential is not None:
            self.tangential[t] = tangential

    def end_with(self, memory: RowMemory) -> None:
        """Keep what rows remember at the end of a run that compiled steps have made."""
        self._memory = memory

    def look_for_edge(self, t: float, answer: Evaluation) -> None:
        """Record the time t [s] and the place at which a closed row first leaves its patch."""
        if self.edge is None and (reached := answer.edge_reached()) is not None:
            read_only(reached)  # results return it
            self.edge = t, reached

    @property
    def samples(self) -> list[tuple[float, Array, Array]]:
        """Times with closed rows [s], the slave's patch nodes of these rows, and the forces on them [N]."""
        looped = self._looped.samples(self._place)
        recorded = [(t, nodes, lam) for t, (nodes, lam) in self._samples.items()]
        return sorted([*recorded, *looped], key=lambda sample: sample[0]) if recorded else looped

    def rows_at(self, times: Sequence[float]) -> list[tuple[Array, Array] | None]:
        """The slave's patch nodes of the closed rows at some times [s], and forces there [N]; None where all are open.

        Of the same time, what loops have found last counts.
        """
        looped = self._looped.rows_at(times, self._place)
        if not self._samples:
            return looped
        return [rows or self._samples.get(t) for t, rows in zip(times, looped, strict=True)]

    def stored_at(self, times: Sequence[float]) -> list[float]:
        """Energy that an elastic contact stored at each time [s]; none where all rows were open [J]."""
        if not self._stored:
            return self._looped.stored_at(times, self._place)
        kept = self.stored
        return [kept.get(t, 0.0) for t in times]

    @property
    def stored(self) -> dict[float, float]:
        """Energy that an elastic contact stores while rows are closed [J]; keys are times [s]."""
        looped = self._looped.stored(self._place)
        return self._stored | looped if self._stored else looped

    @property
    def slip_path(self) -> Array:
        """Length of the slip so far of the row of each of the slave's patch nodes, (np,) [m]."""
        return np.array(self._memory.path)

    @property
    def plastic_ends(self) -> dict[int, PlasticState]:
        """Last state of each plastic zone; keys are the numbers of the sides."""
        return {} if self._plastic is None else self._plastic.present

    def histories(self, zones: Mapping[int, PlasticZone]) -> dict[int, StrainHistory]:
        """Return `plastic_strains`. The same method of a record from a file needs these zones."""
        return self.plastic_strains
