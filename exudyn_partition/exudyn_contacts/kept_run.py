"""Data of a run that a contact kept, as arrays for files: forces of rows, states, strains and the state at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone import PlasticZone
from ..support.arrays import Array
from ..support.checks import read_only
from .contact_record import ContactRecord


@dataclass(frozen=True, eq=False)
class KeptStrains:
    """A `StrainHistory` as arrays.

    Parameters
    ----------
    side : int
    times : (k,) array
        Times at which the strains changed [s].
    starts : (k + 1,) int array
        Places where the entries of each time begin.
    points : (m,) int array
        Points that have flowed since the time before.
    strains : (m, 6) array
        Their plastic strains.
    """

    side: int
    times: Array
    starts: Array
    points: Array
    strains: Array

    @classmethod
    def of_history(cls, side: int, history: StrainHistory) -> KeptStrains:
        """Strains of a history."""
        times, kept = history.kept
        points, strains = (np.concatenate([change[i] for change in kept] or [np.empty(0)]) for i in range(2))
        return cls(
            side,
            np.array(times, dtype=float),
            _starts([len(some) for some, _ in kept]),
            points.astype(np.int64),
            strains.reshape(-1, 6),
        )

    def history(self, zone: PlasticZone) -> StrainHistory:
        """Return the history in its zone."""
        spans = zip(self.starts[:-1], self.starts[1:], strict=True)
        kept = [(self.points[start:end], self.strains[start:end]) for start, end in spans]
        return StrainHistory.of(zone, self.times.tolist(), kept)


@dataclass(frozen=True, eq=False)
class KeptRun:
    """Data of a run that a contact kept. Results read it as they read a `ContactRecord`.

    Parameters
    ----------
    law_name : str
    goes_on : bool
    areas : (np,) array
        Area of the row of each of the slave's patch nodes [m2].
    pressures : (np, np) csr matrix
        Matrix from forces of rows to pressures around these nodes [1/m2].
    times : (k,) array
        Times with closed rows [s].
    starts : (k + 1,) int array
        Places where the rows of each time begin.
    nodes : (m,) int array
        Patch nodes of the rows.
    forces : (m,) array
        Normal forces of the rows [N].
    tractions : (m, 3) array or None
        Tangential forces in space [N]; None without friction.
    states : (m,) int8 array or None
        Whether the rows stick or slip.
    stored_times, stored_energies : (j,) arrays
        Times while an elastic contact was closed, and the energy that it stored [s, J].
    viscous_times, viscous_energies : (v,) arrays
        Times, and the energy that viscous flexibilities and a damped law have dissipated until then [s, J].
    edge_place : (4,) array or None
        Time and place at which the edge of the patch was first reached [s, m].
    slip_path : (np,) array
        Length of the slip of each row [m].
    plastic_sides : tuple of int
    plastic_states : tuple of PlasticState
        States of the zones at the end.
    strains : tuple of KeptStrains
    on_nodes_times : (c,) array
        Times at which forces on nodes were kept, if a body of another kind carries the rigid surface [s].
    forces_on_nodes : tuple of (c, np, 3) arrays
        Forces on the nodes of each side [N].
    """

    law_name: str
    goes_on: bool
    areas: Array
    pressures: sp.csr_matrix
    times: Array
    starts: Array
    nodes: Array
    forces: Array
    tractions: Array | None
    states: Array | None
    stored_times: Array
    stored_energies: Array
    edge_place: Array | None
    slip_path: Array
    plastic_sides: tuple[int, ...]
    plastic_states: tuple[PlasticState, ...]
    strains: tuple[KeptStrains, ...]
    on_nodes_times: Array
    forces_on_nodes: tuple[Array, ...]
    viscous_times: Array = field(default_factory=lambda: np.empty(0))
    viscous_energies: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        read_only(*(value for value in vars(self).values() if isinstance(value, np.ndarray)))

    @classmethod
    def of_record(cls, record: ContactRecord | KeptRun) -> KeptRun:
        """Data that was kept of a run, at its end."""
        if isinstance(record, KeptRun):
            return record
        samples, tangential = record.samples, record.tangential
        nodes, forces = (np.concatenate([np.empty(0), *(sample[i] for sample in samples)]) for i in (1, 2))
        along = [tangential[t] for t, *_ in samples if t in tangential]
        frictional = len(along) == len(samples) > 0
        ends = record.plastic_ends
        return cls(
            law_name=record.law_name,
            goes_on=record.goes_on,
            areas=np.array(record.areas),
            pressures=sp.csr_matrix(record.pressures),
            times=np.array([t for t, *_ in samples]),
            starts=_starts([len(some) for _, some, _ in samples]),
            nodes=nodes.astype(np.int64),
            forces=forces,
            tractions=np.concatenate([traction for traction, _ in along]) if frictional else None,
            states=np.concatenate([state for _, state in along]) if frictional else None,
            stored_times=np.array([*record.stored], dtype=float),
            stored_energies=np.array([*record.stored.values()], dtype=float),
            viscous_times=np.array([*record.viscous_works], dtype=float),
            viscous_energies=np.array([*record.viscous_works.values()], dtype=float),
            edge_place=None if record.edge is None else np.r_[record.edge[0], record.edge[1]],
            slip_path=record.slip_path,
            plastic_sides=tuple(ends),
            plastic_states=tuple(ends.values()),
            strains=tuple(KeptStrains.of_history(side, history) for side, history in record.plastic_strains.items()),
            on_nodes_times=np.array([*record.on_nodes], dtype=float),
            forces_on_nodes=tuple(map(np.array, zip(*record.on_nodes.values(), strict=True))),
        )

    @property
    def samples(self) -> list[tuple[float, Array, Array]]:
        """See `ContactRecord.samples`."""
        spans = zip(self.times.tolist(), self.starts[:-1], self.starts[1:], strict=True)
        return [(t, self.nodes[start:end], self.forces[start:end]) for t, start, end in spans]

    @cached_property
    def _rows(self) -> dict[float, tuple[Array, Array]]:
        return {t: (nodes, forces) for t, nodes, forces in self.samples}

    def rows_at(self, times: Sequence[float]) -> list[tuple[Array, Array] | None]:
        """See `ContactRecord`."""
        return [*map(self._rows.get, times)]

    def stored_at(self, times: Sequence[float]) -> list[float]:
        """See `ContactRecord`."""
        kept = self.stored
        return [kept.get(t, 0.0) for t in times]

    @property
    def tangential(self) -> dict[float, tuple[Array, Array]]:
        """See `ContactRecord`."""
        if self.tractions is None or self.states is None:
            return {}
        spans = zip(self.times.tolist(), self.starts[:-1], self.starts[1:], strict=True)
        return {t: (self.tractions[start:end], self.states[start:end]) for t, start, end in spans}

    @property
    def stored(self) -> dict[float, float]:
        """See `ContactRecord`."""
        return dict(zip(self.stored_times.tolist(), self.stored_energies.tolist(), strict=True))

    @property
    def near(self) -> bool:
        """See `ContactRecord`; not known of a run from a file."""
        return True

    @property
    def viscous_works(self) -> dict[float, float]:
        """See `ContactRecord`."""
        return dict(zip(self.viscous_times.tolist(), self.viscous_energies.tolist(), strict=True))

    @property
    def on_nodes(self) -> dict[float, list[Array]]:
        """See `ContactRecord`."""
        return {t: [side[i] for side in self.forces_on_nodes] for i, t in enumerate(self.on_nodes_times.tolist())}

    @property
    def edge(self) -> tuple[float, Array] | None:
        """See `ContactRecord`."""
        return None if self.edge_place is None else (float(self.edge_place[0]), self.edge_place[1:])

    @property
    def plastic_ends(self) -> dict[int, PlasticState]:
        """See `ContactRecord`."""
        return dict(zip(self.plastic_sides, self.plastic_states, strict=True))

    def histories(self, zones: Mapping[int, PlasticZone]) -> dict[int, StrainHistory]:
        """See `ContactRecord`."""
        return {strains.side: strains.history(zones[strains.side]) for strains in self.strains}


KEPT = KeptRun, KeptStrains, PlasticState


def _starts(counts: list[int]) -> Array:
    """Places where parts of these lengths begin, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(np.array(counts, dtype=np.int64))])
