"""What a contact tells of a run: forces, pressures, areas, gaps, sub-impacts and energy."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.coupled import CoupledContacts
from ..contact.formulations.lagrange import LagrangeContact
from ..contact.rigid import RigidGaps
from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..results.history import at_times
from ..support.arrays import Array
from ..support.checks import validate_result

if TYPE_CHECKING:
    from ..simulation.result import Result

_LOOKED_AT = 200  # samples beside an impact, until its surface has opened


@dataclass(frozen=True)
class SubImpact:
    """A time of uninterrupted contact.

    Parameters
    ----------
    start, end : float
        [s]
    impulse : float
        Of the total normal force [N s].
    peak : float
        Largest total normal force [N].
    """

    start: float
    end: float
    impulse: float
    peak: float


class ContactResults(dict):
    """Results of a contact, by what its sensors and itself have stored.

    Attributes
    ----------
    name : str
    slave : PartitionBody
    sides : tuple of (PartitionBody, int)
        Slave, and master if that is a partition body too, each with the number of its patch.
    law : ContactLaw or TwoPass
    laws : dict of str to ContactLaw
        Of multipliers, that of explicit runs and that of implicit ones, which take turns as `law`.
    run : object
        A new one for each run, by which results know whether what is kept here is theirs.
    group : list of ContactResults
        Contacts that are solved together; `together` solves them if there are several.
    """

    name: str
    slave: PartitionBody
    sides: tuple[tuple[PartitionBody, int], ...]
    run: object
    law: Any  # which one decides what it can do
    laws: dict[str, Any]
    group: list[Any]
    together: CoupledContacts
    _samples: list[tuple[float, Array, Array]]
    _areas: Array

    @property
    def n_rows(self) -> int:
        """Number of rows that the contact starts with."""
        return len(self._areas.nonzero()[0]) if self.law.gaps.moving else len(self.law.gaps.row_nodes)

    @property
    def slave_facet_size(self) -> float:
        """Mean edge length of the slave's facets [m]."""
        return float(self.law.gaps.slave.surface.facet_size)

    def force(self, result: Result) -> Array:
        """Sum of the normal forces, (n,) [N], >= 0, at the times of `result`."""
        return self._sampled(result, slice(0, 1), slice(6, 7))[:, 0]

    def force_on_slave(self, result: Result) -> Array:
        """Resultant force on the slave, (n, 3) [N]; the master has its opposite. Curved patches spread the normals."""
        return self._sampled(result, slice(2, 5), slice(7, 10))

    def _sampled(self, result: Result, forces: slice, impulses: slice) -> Array:
        """Forces at the times of `result`; single multipliers jump, theirs come from the impulses between samples."""
        validate_result(result)
        samples = result.sensor_of(self, self["sForce"])
        if not self.ahead or len(result.t) < 2:
            return samples[:, forces]
        impulse = samples[:, impulses]
        means = np.diff(impulse, axis=0, prepend=impulse[:1]) / np.diff(result.t, prepend=-1.0)[:, None]
        return at_times(result.t, means)

    def moment_on_slave(self, result: Result) -> Array:
        """Moment on the slave about the point of `AddMomentSensor`, (n, 3) [N m].

        Raises
        ------
        InputError
            If there is no such sensor.
        """
        if "sMoment" not in self:
            raise InputError("contact: it has no moment sensor; call AddMomentSensor(mbs) before mbs.Assemble()")
        validate_result(result)
        return result.sensor_of(self, self["sMoment"])

    def closed_rows(self, result: Result) -> Array:
        """Number of closed contact rows, (n,).

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return result.sensor_of(self, self["sForce"])[:, 1].astype(int)

    def gap(self, result: Result) -> Array:
        """Smallest gap, (n,) [m]: zero in contact; infinite where no point faces the master or is near it.

        Integrated rows have mean gaps around nodes: a convex tip touches when the first mean closes, after its lowest
        point by the order of a facet's size squared over the radius.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return result.sensor_of(self, self["sForce"])[:, 5]

    def row_forces(self, result: Result) -> sp.csr_matrix:
        """Force of the row of each of the slave's patch nodes, (n, np) [N], in the order of the patch's nodes.

        With two passes, those of the master's patch nodes follow; both halves together are the total force.

        Raises
        ------
        InputError
            If the model has been run again since `result`: forces of rows are kept of the last run only.
        """
        validate_result(result)
        result.check_last_run(self)
        place = {t: i for i, t in enumerate(result.t)}
        kept = [(place[t], nodes, lam) for t, nodes, lam in self._samples if t in place]
        at = np.repeat([i for i, *_ in kept], [len(nodes) for _, nodes, _ in kept]).astype(int)
        nodes = np.concatenate([np.empty(0, dtype=int), *(nodes for _, nodes, _ in kept)])
        forces = np.concatenate([np.empty(0), *(lam for *_, lam in kept)])
        return sp.csr_matrix((forces, (at, nodes)), shape=(len(result.t), len(self._areas)))

    def pressure(self, result: Result) -> sp.csr_matrix:
        """Contact pressure around the slave's patch nodes, (n, np) [Pa], columns as those of `row_forces`.

        Means over hat functions: with integrated rows over that of each node, with node-to-segment rows over those of
        the facets' corners; columns of mid-side nodes are empty then.
        """
        return sp.csr_matrix(self.row_forces(result) @ self.law.node_pressures.T)

    def area(self, result: Result) -> Array:
        """Contact area, the sum of the closed rows' areas, (n,) [m2]."""
        closed = self.row_forces(result)
        closed.data[:] = closed.data > 0
        return closed @ self._areas

    def radius(self, result: Result) -> Array:
        """Radius of a circle of the contact area, (n,) [m]."""
        return np.sqrt(self.area(result) / np.pi)

    def impacts(self, result: Result) -> list[SubImpact]:
        """Times of uninterrupted contact, with the impulse and peak of each.

        Contact starts and ends when the first point of the surface closes and the last one opens, between samples by
        linear interpolation. Mean gaps of integrated rows, which make the force, close later. Times are those of
        samples with a force where the surface is not known: with multipliers, and where a body of another kind carries
        the rigid surface.
        """
        force, t, found = self.force(result), result.t, []
        spans, gap = self.closed_samples(result), self._surface_gap(result)
        for k, (first, last) in enumerate(spans):
            around = slice(max(first - 1, 0), min(last + 2, len(t)))
            impulse = float(np.trapezoid(force[around], t[around]))
            start = _crossing(t, gap, first, spans[k - 1][1] if k else -1)
            end = _crossing(t, gap, last, spans[k + 1][0] if k + 1 < len(spans) else len(t))
            found.append(SubImpact(start, end, impulse, float(force[around].max())))
        return found

    def closed_samples(self, result: Result) -> list[tuple[int, int]]:
        """First and last sample with a force, of each time of uninterrupted contact."""
        edges = np.diff(np.r_[0, self.force(result) > 0, 0].astype(int))
        return [*zip(np.flatnonzero(edges > 0).tolist(), (np.flatnonzero(edges < 0) - 1).tolist(), strict=True)]

    def _surface_gap(self, result: Result) -> Callable[[int], float] | None:
        """Gap of the lowest point of the surface at a sample [m]; None where it is not known."""
        gaps = self.law.gaps
        if self.multipliers or (isinstance(gaps, RigidGaps) and gaps.carried):
            return None
        q = np.hstack([item.coordinates(result) for item, _ in self.sides])
        return functools.cache(lambda sample: gaps.surface_gap(q[sample]))

    def energy(self, result: Result) -> Array:
        """Energy stored in the contact's own flexibility, (n,) [J]; multipliers store none.

        The contact is evaluated again at the stored coordinates, in their order.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        if self.multipliers:
            validate_result(result)
            return np.zeros(len(result.t))
        if len(self.group) == 1:
            return np.array([self.law.potential(q) for q in self._again(result)])
        kept = self.together.energies  # of all, which are found together
        if result not in kept:
            kept[result] = np.array([[c.law.stored() for c in self.group] for _ in self._again(result)])
        return kept[result][:, self._place_in_group].copy()

    def nodal_forces(self, result: Result) -> list[Array]:
        """Forces on the nodes of each side's patch, (n, np, 3) in space [N], in the order of `sides`.

        The contact is evaluated again at the stored coordinates, in their order.

        Raises
        ------
        InputError
            If the forces are multipliers, or a body of another kind carries the rigid surface.
        """
        if self.multipliers:
            raise InputError("nodal_forces: multipliers are not known from coordinates; row_forces has what was stored")
        forces = []
        for q in self._again(result):
            if len(self.group) == 1:
                self.law.force(q)
            forces.append(self.law.nodal_forces())
        return [np.array(side) for side in zip(*forces, strict=True)]

    def _again(self, result: Result) -> Iterator[Array]:
        """Coordinates of the sides at each time of `result`, with all contacts that are solved together evaluated."""
        if isinstance(self.law.gaps, RigidGaps) and self.law.gaps.carried:
            raise InputError(
                "contact: its forces are not known after the run where a body of another kind carries the rigid surface"
            )
        histories = [np.hstack([item.coordinates(result) for item, _ in c.sides]) for c in self.group]
        if len(self.group) == 1:
            self.law.reset()
        else:
            self.together.reset()
        for coordinates in zip(*histories, strict=True):
            if len(self.group) > 1:
                self.together.forces(coordinates)
            yield coordinates[self._place_in_group]

    @property
    def _place_in_group(self) -> int:
        return next(i for i, contact in enumerate(self.group) if contact is self)

    @property
    def multipliers(self) -> bool:
        """Whether forces are multipliers, of patches with mass."""
        return bool(self.laws)

    @property
    def ahead(self) -> bool:
        """Whether forces are multipliers that are applied ahead of each explicit step."""
        return isinstance(self.law, LagrangeContact)

    @property
    def left_out(self) -> list[str]:
        """What the contact leaves out, in sentences."""
        unpaired = self.law.gaps.unpaired
        said = ["tangential rows: the contact is frictionless"]
        if not self.law.gaps.faced:
            said.append("pairs at the start: the patches do not face each other yet, pairs are found when they do")
        elif unpaired:
            slave = self.slave.name or "the slave"
            said.append(f"{unpaired} contact points of {slave} that face no facet of the master patch")
        return said


def _crossing(t: Array, gap: Callable[[int], float] | None, sample: int, other: int) -> float:
    """Time at which a gap vanishes [s], from a sample in contact towards another one, which is in contact or none."""
    way = 1 if other > sample else -1
    if gap is not None:
        for inside in range(sample, sample + way * _LOOKED_AT, way):
            if inside + way == other or gap(inside) > 0:
                break
            if gap(inside + way) > 0:
                share = gap(inside) / (gap(inside) - gap(inside + way))
                return float(t[inside] + share * (t[inside + way] - t[inside]))
    return float(t[sample])
