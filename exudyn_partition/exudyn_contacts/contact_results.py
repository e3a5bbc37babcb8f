"""What a contact tells of a run: forces, pressures, areas, gaps, stress and energy."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.formulation import Formulation, Law, Together
from ..errors import InputError
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_bodies.partition_body import PartitionBody
from ..fe.material import Material
from ..prediction.contact_ellipse import semi_axes
from ..prediction.yielding import Stress
from ..support.arrays import Array
from ..support.checks import validate_result
from ..support.foreign import MainSystem
from ..surfaces.rows import PENETRATION_TOLERANCE
from .friction_results import RunSamples
from .plastic_results import PlasticResults, dent_motion

# Energies of contacts that are solved together, by the list of these, as long as the result exists.
_ENERGIES: WeakKeyDictionary[RunSamples, dict[int, Array]] = WeakKeyDictionary()
_LARGE = 0.8  # of the largest force, above which stresses are looked for
_WHOLE = 0.9  # of a patch's area: what touches there is no Hertz contact


class ContactResults(PlasticResults):
    """A contact of a model, and its results; what changes in a run is in `contact_run.ContactRun`.

    Attributes
    ----------
    name : str
    slave : PartitionBody
    sides : tuple of (PartitionBody, int)
        Slave, and master if that is a partition body too, each with the number of its patch.
    formulation : Formulation
    law : Law
        At the start; each run has its own.
    group : list of ContactResults
        Contacts that are solved together in every run, the same list for all of them.
    together : Together or None
        What finds their forces, if there are several and forces are elastic; each run has its own.
    linked : list of ContactResults
        Earlier ones of these on bodies of this contact.
    moment_about : (3,) array or None
        Point of the moment sensor [m].
    """

    name: str
    slave: PartitionBody
    sides: tuple[tuple[PartitionBody, int], ...]
    formulation: Formulation
    law: Law
    group: list[Any]
    together: Together | None
    linked: list[Any]
    moment_about: Array | None

    def slices(self, mbs: MainSystem) -> list[slice]:
        """Where the coordinates of slave and master are among the model's."""
        return [s for item, _ in self.sides for s in coordinate_slices(mbs, item)]

    @property
    def elastic(self) -> bool:
        """Whether forces follow from the coordinates alone, so that they can be found again at every sample."""
        return self.law.elastic

    @property
    def compliant(self) -> bool:
        """Whether closed rows yield by a flexibility or layer of the contact itself."""
        return self.law.compliant

    @property
    def n_rows(self) -> int:
        """Number of rows that the contact starts with."""
        return len(self.law.node_areas.nonzero()[0]) if self.law.gaps.moving else len(self.law.gaps.row_nodes)

    @property
    def slave_facet_size(self) -> float:
        """Mean edge length of the slave's facets [m]."""
        return float(self.law.gaps.slave.surface.facet_size)

    def force(self, result: RunSamples) -> Array:
        """Sum of the normal forces, (n,) [N], >= 0, at the times of `result`."""
        return self._sampled(result, "sForce", slice(0, 1), slice(6, 7))[:, 0]

    def force_on_slave(self, result: RunSamples) -> Array:
        """Resultant force on the slave, (n, 3) [N]; the master has its opposite. Curved patches spread the normals."""
        return self._sampled(result, "sForce", slice(2, 5), slice(7, 10))

    def moment_on_slave(self, result: RunSamples) -> Array:
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

    def closed_rows(self, result: RunSamples) -> Array:
        """Number of closed contact rows, (n,).

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return result.sensor_of(self, self["sForce"])[:, 1].astype(int)

    def gap(self, result: RunSamples) -> Array:
        """Smallest gap of the surfaces, (n,) [m]; negative where they lie within each other.

        It is that of the lowest point, as the coordinates move the surfaces, with dents, but without what the contact's
        own flexibility or layer yields: in contact minus the depth to which they are pressed. Multipliers hold gaps at
        zero; theirs is zero in contact up to the tolerance of meshes. Infinite where no point faces the master.

        Where the surfaces are not known after the run, and where no point faces the master, it is the smallest gap of
        the rows, which the sensor `sForce` has: of a rigid surface that another body carries, and of results that were
        read without their model. Integrated rows have mean gaps around nodes: a convex tip closes the first one later
        than its lowest point touches, by the order of a facet's size squared over the radius.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        gap = result.sensor_of(self, self["sForce"])[:, 5].copy()
        if (surface := self._gap_of_surface(result)) is None:
            return gap
        found = np.array([surface(sample) for sample in range(len(gap))])
        known = np.isfinite(found)
        if not self.compliant:  # in contact, zero up to tolerance
            known &= (gap != 0.0) | (found < -PENETRATION_TOLERANCE * self.law.gaps.size)
        return np.where(known, found, gap)

    def depth(self, result: RunSamples) -> float:
        """Largest depth of the surfaces within each other in the run [m], see `gap`; zero if they did not touch.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        return float(max(-self.gap(result).min(initial=0.0), 0.0))

    def _gap_of_surface(self, result: RunSamples) -> Callable[[int], float] | None:
        """Gap of the lowest point of the surface at a sample [m]; None where it is not known."""
        gaps = self.law.gaps
        if gaps.carried:
            return None
        try:
            dents = dent_motion(self, result)
        except InputError:  # of a file, or with too many states of the zones to be kept
            return None
        q = np.hstack([item.coordinates(result) for item, _ in self.sides])
        return functools.cache(lambda sample: gaps.surface_gap(q[sample], dents(sample)))

    def row_forces(self, result: RunSamples) -> sp.csr_matrix:
        """Force of the row of each of the slave's patch nodes, (n, np) [N], in the order of the patch's nodes.

        Raises
        ------
        InputError
            If the result is none, of another model, or of a run of which nothing was kept.
        """
        validate_result(result)
        return self._row_forces(result, result.t)

    def _row_forces(self, result: RunSamples, times: Array) -> sp.csr_matrix:
        """See `row_forces`; at some times of the result, (k,) [s]."""
        run, place = result.kept(self), {t: i for i, t in enumerate(times)}
        kept = [(place[t], nodes, lam) for t, nodes, lam in run.samples if t in place]
        at = np.repeat([i for i, *_ in kept], [len(nodes) for _, nodes, _ in kept]).astype(int)
        nodes = np.concatenate([np.empty(0, dtype=int), *(nodes for _, nodes, _ in kept)])
        forces = np.concatenate([np.empty(0), *(lam for *_, lam in kept)])
        return sp.csr_matrix((forces, (at, nodes)), shape=(len(times), len(run.areas)))

    def pressure(self, result: RunSamples) -> sp.csr_matrix:
        """Contact pressure around the slave's patch nodes, (n, np) [Pa], columns as those of `row_forces`.

        Means over hat functions: with integrated rows over that of each node, with node-to-segment rows over those of
        the facets' corners; columns of mid-side nodes are empty then.
        """
        return sp.csr_matrix(self.row_forces(result) @ self.law.node_pressures.T)

    def area(self, result: RunSamples) -> Array:
        """Contact area, the sum of the closed rows' areas, (n,) [m2].

        Rows that lie partly outside of the contact may be open, so that it lacks part of the rim where pressure does
        not fall to zero there, as in plastic flow.
        """
        closed = self.row_forces(result)
        closed.data[:] = closed.data > 0
        value: Array = closed @ self.law.node_areas
        return value

    def radius(self, result: RunSamples) -> Array:
        """Radius of a circle of the contact area, (n,) [m]."""
        return np.sqrt(self.area(result) / np.pi)

    @property
    def side_names(self) -> tuple[str, ...]:
        """Names of slave and master in sentences."""
        roles = zip(self.sides, ("the slave", "the master"), strict=False)
        return tuple(f"body {item.name!r}" if item.name else role for (item, _), role in roles)

    def largest_stress(self, result: RunSamples) -> Stress | None:
        """Largest Hertz-equivalent pressure of the run, and the von Mises stress beneath it; None if nothing touched.

        That of the Hertz contact with the same force, and with the same second moments of the pressure on the rows
        (`contact_ellipse`). It is looked for where the force is above 0.8 of its largest value. A contact that closes
        all of a patch is no Hertz contact: there the mean pressure counts as the stress in a bar, if it is larger.
        Friction, the bodies' other loads, and stress at the edges of flat patches are not in it, and nothing is judged
        of bodies whose patch yields itself.

        Raises
        ------
        InputError
            If the result is none, of another model, or of a run of which nothing was kept.
        """
        force, run = self.force(result), result.kept(self)
        large = np.flatnonzero((force >= _LARGE * force.max(initial=0.0)) & (force > 0))
        n = len(self.law.gaps.slave.surface.points)
        rows, areas = self._row_forces(result, result.t[large])[:, :n], run.areas[:n]
        touching = np.asarray(rows.sum(axis=1)).ravel() > 0
        if not touching.any():
            return None
        large, rows = large[touching], rows[touching]
        places = self.slave.body.points[self.law.gaps.slave.surface.nodes]
        axes = semi_axes(rows, places, areas, not self.law.gaps.points.nodal)
        peak = int((force[large] / axes.prod(axis=1)).argmax())
        whole = run.edge is None and areas[rows[peak].indices].sum() >= _WHOLE * areas.sum()
        load, (a, b) = float(force[large[peak]]), map(float, axes[peak])
        return Stress.beneath(
            load,
            (a, b),
            self._elastic_materials,
            mean=load / areas.sum() if whole else 0.0,
            time=float(result.t[large[peak]]),
        )

    @property
    def _elastic_materials(self) -> list[Material | None]:
        """Materials of the sides; without a yield stress where the patch yields itself."""
        found = []
        for (item, patch), side in zip(self.sides, self.law.gaps.sides, strict=False):
            material = item.body.partition.patches[patch].material or item.body.material
            if side.zone is not None and material is not None:
                material = replace(material, yield_stress=None, hardening=None, kinematic_hardening=0.0)
            found.append(material)
        return found

    def edge_reached(self, result: RunSamples) -> tuple[float, Array] | None:
        """When and where the contact reached the edge of its patch first, [s] and (3,) [m]; None if it did not.

        Raises
        ------
        InputError
            If the result is none, of another model, or of a run of which nothing was kept.
        """
        validate_result(result)
        return result.kept(self).edge

    def energy(self, result: RunSamples) -> Array:
        """Energy stored in the contact's own flexibility, (n,) [J]; multipliers store none.

        It is what the run told. Where nothing was kept, elastic contacts are evaluated again at the coordinates of the
        samples, in their order.

        Raises
        ------
        InputError
            If the result is none, or of another model, or from a file while a body of another kind carries the surface.
        """
        validate_result(result)
        if self.friction is not None:
            return self._friction_samples(result)[:, 6]
        if self.yielding is not None:
            return self._plastic_samples(result)[:, 0]
        if not self.elastic:
            return np.zeros(len(result.t))
        if result.runs:
            kept = result.kept(self).stored
            return np.array([kept.get(t, 0.0) for t in result.t.tolist()])
        if self.together is None:
            law = self.law.for_run("explicit")
            return np.array([law.potential(q) for (q,) in self._coordinates(result)])
        found = _ENERGIES.setdefault(result, {})  # of all contacts of the group, which are found together
        if id(self.group) not in found:
            found[id(self.group)] = np.array([[law.stored() for law in laws] for laws in self._again(result)])
        return found[id(self.group)][:, self._place_in_group].copy()

    def nodal_forces(self, result: RunSamples) -> list[Array]:
        """Forces on the nodes of each side's patch, (n, np, 3) in space [N], in the order of `sides`.

        The contact is evaluated again at the stored coordinates, in their order; with friction or plastic zones, and
        where a body of another kind carries the rigid surface, the forces are those that the run kept.

        Raises
        ------
        InputError
            If the forces are multipliers.
        """
        if self.law.gaps.carried:
            return self._kept_of_carried(result)
        if self.friction is not None or self.yielding is not None:
            return self._kept_on_nodes(result)
        if not self.elastic:
            raise InputError("nodal_forces: multipliers are not known from coordinates; row_forces has what was stored")
        forces = [laws[self._place_in_group].nodal_forces() for laws in self._again(result)]
        return [np.array(side) for side in zip(*forces, strict=True)]

    def _kept_of_carried(self, result: RunSamples) -> list[Array]:
        """See `nodal_forces`; what carries the rigid surface has moved it, and a result does not have its motion."""
        validate_result(result)
        run, sides = result.kept(self), self.law.gaps.sides
        forces = [np.zeros((len(result.t), len(side.surface.points), 3)) for side in sides]
        closed = {t for t, *_ in run.samples}
        for i, t in enumerate(result.t):
            if t in closed:
                for on_side, now in zip(forces, run.on_nodes[t], strict=True):
                    on_side[i] = now
        return forces

    def _again(self, result: RunSamples) -> Iterator[Sequence[Law]]:
        """Laws of the contacts that are solved together, at each time of `result`."""
        laws = [contact.law.for_run("explicit") for contact in ([self] if self.together is None else self.group)]
        together = None if self.together is None else self.together.for_run(laws)
        for coordinates in self._coordinates(result):
            if together is None:
                laws[0].potential(coordinates[0])
            else:
                together.forces(coordinates)
            yield laws

    def _coordinates(self, result: RunSamples) -> Iterator[Sequence[Array]]:
        """Coordinates of the contacts that are solved together, at each time of `result`."""
        if self.law.gaps.carried:
            raise InputError(
                "contact: its forces are not known after the run where a body of another kind carries the rigid surface"
            )
        group = [self] if self.together is None else self.group
        return zip(*(np.hstack([item.coordinates(result) for item, _ in c.sides]) for c in group), strict=True)

    @property
    def _place_in_group(self) -> int:
        return 0 if self.together is None else next(i for i, contact in enumerate(self.group) if contact is self)

    @property
    def left_out(self) -> list[str]:
        """What the contact leaves out, in sentences."""
        unpaired = self.law.gaps.unpaired
        said = ["tangential rows: the contact is frictionless"] * (self.friction is None)
        if self.yielding is not None:
            said.append("plastic flow outside the plastic zones, and the change of gaps' normals by dents")
            said.append(
                "plastic strain in stresses and static answers that `recovery` and `output` compute: these are elastic"
            )
        if not self.law.gaps.faced:
            said.append("pairs at the start: the patches do not face each other yet, pairs are found when they do")
        elif unpaired and not any(side.surface.wanders for side in self.law.gaps.sides):
            slave = self.slave.name or "the slave"
            said.append(f"{unpaired} contact points of {slave} that face no facet of the master patch")
        return said
