"""What reviews have in common: the run that they look at, and what they find."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ...errors import ModelLimitWarning
from ...exudyn_bodies.partition_body import PartitionBody
from ...exudyn_contacts.contact_record import ContactRecord
from ...exudyn_contacts.kept_run import KeptRun
from ...exudyn_contacts.partition_contact import PartitionContact
from ...exudyn_contacts.row_samples import RowSamples
from ...exudyn_contacts.run_record import Solver
from ...reduction.body import ReducedBody
from ...results.impacts import Ringing, closed_spans
from ...support.arrays import Array
from ...support.attributes import FoundOnce
from ...support.checks import read_only
from ...support.foreign import MainSystem
from ...support.once import once
from ...surfaces.surface import Surface
from ..joint_checks import OpenJoints
from ..result import Result

LARGEST_DEFORMATION = 0.1  # share of a body's size; linear elasticity is not valid far below it


@dataclass(frozen=True)
class Finding:
    """What a review has found.

    Parameters
    ----------
    text : str
    category : type or None
        Of the warning; None if it is no warning, and only logged.
    """

    text: str
    category: type[Warning] | None = ModelLimitWarning


class ReviewedBody:
    """A body in a run. What reviews ask for is found once.

    Parameters
    ----------
    item : PartitionBody
    result : Result
    """

    def __init__(self, item: PartitionBody, result: Result) -> None:
        self.item, self._result = item, result

    @FoundOnce
    def q(self) -> Array:
        """Coordinates, (n, n_dofs)."""
        return self.item.coordinates(self._result)

    @FoundOnce
    def q_t(self) -> Array:
        """Velocities of the coordinates, (n, n_dofs)."""
        return self.item.coordinates_t(self._result)

    @FoundOnce
    def finite(self) -> Array:
        """Samples with finite coordinates, (n,) bool."""
        finite = np.isfinite(self.q)
        return np.ones(len(finite), dtype=bool) if finite.all() else np.asarray(finite.all(axis=1))

    @FoundOnce
    def deformed(self) -> Array:
        """Coordinates of the deformation, (n, n_dofs); zero where coordinates are not finite."""
        q = self.q if self.finite.all() else np.where(self.finite[:, None], self.q, 0.0)
        return self.item.kinematics.deformed(q)

    @FoundOnce
    def deformed_share(self) -> Array:
        """Largest elastic displacement on the patches over the body's size, (n,), or a bound on it, if it is small."""
        return deformed_share(self.item, np.where(self.finite[:, None], self.q, 0.0), self.deformed)

    @FoundOnce
    def rigid_motion(self) -> Array:
        """Translation [m] and rotation [rad] of the whole body, (n, 6)."""
        return self.item.rigid_motion(self.q)

    @FoundOnce
    def way(self) -> float:
        """Bound on how far any node of the surface is from its place at the start, at any time of the run [m]."""
        body, (motions, reach) = self.item.body, _reach_of(self.item.body)

        def largest(deformed: Array) -> Array:
            nodal = abs(deformed[:, body.n_shapes :]).max(axis=1, initial=0.0)
            return np.asarray(math.sqrt(3) * (abs(deformed[:, : body.n_shapes]) @ motions + nodal))

        motion = self.rigid_motion - self.rigid_motion[0]
        arm = reach + largest(self.deformed[:1])
        ways = lengths(motion[:, :3]) + lengths(motion[:, 3:]) * arm
        return float((ways + largest(self.deformed - self.deformed[0])).max())

    @FoundOnce
    def kinetic_energy(self) -> Array:
        """Of each sample, (n,) [J]."""
        return np.asarray(self.item.kinematics.kinetic_energy(self.q, self.q_t))

    @FoundOnce
    def strain_energy(self) -> Array:
        """Of each sample, (n,) [J]."""
        return self.item.body.strain_energy(self.item.kinematics.elastic(self.q))

    @property
    def energy(self) -> Array:
        """Kinetic and strain energy, (n,) [J]."""
        value: Array = self.kinetic_energy + self.strain_energy
        return value


class ReviewedContact:
    """A contact in a run. What reviews ask for is found once.

    Parameters
    ----------
    contact : PartitionContact
    result : Result
    """

    def __init__(self, contact: PartitionContact, result: Result) -> None:
        self.contact, self._result = contact, result

    @FoundOnce
    def kept(self) -> ContactRecord | KeptRun:
        """Data that the contact kept of the run."""
        return self._result.kept(self.contact)

    @FoundOnce
    def force(self) -> Array:
        """Sum of the normal forces, (n,) [N]."""
        return self.contact.force(self._result)

    @FoundOnce
    def force_on_slave(self) -> Array:
        """Resultant force on the slave, (n, 3) [N]."""
        return self.contact.force_on_slave(self._result)

    @FoundOnce
    def closed_rows(self) -> Array:
        """Number of closed rows, (n,)."""
        return self.contact.closed_rows(self._result)

    @FoundOnce
    def pressed(self) -> Array:
        """Depth of the deepest row by the coordinates alone, (n,) [m], negative where all gaps are open.

        The contact's own flexibility, which yields by this depth, is not among the coordinates.
        """
        return -self._result.sensor_of(self.contact, self.contact["sForce"])[:, 5]

    @FoundOnce
    def spans(self) -> list[tuple[int, int]]:
        """First and last sample with a force, of each time of uninterrupted contact."""
        return closed_spans(self.force)

    @FoundOnce
    def rows(self) -> RowSamples:
        """Forces of the rows."""
        return RowSamples(self.kept, self._result.t)

    def place_at(self, sample: int) -> Array | None:
        """Place of the mean normal force at a sample, (3,) [m]; None if no forces of rows were kept there."""
        (item, number), (rows, forces) = self.contact.sides[0], self.rows.at_sample(sample)
        if not forces.sum() > 0.0:
            return None
        nodes = item.body.partition.patches[number].nodes[rows]
        places = item.kinematics.at(nodes).place(item.coordinates(self._result)[sample])
        return np.asarray(forces @ places / forces.sum())

    @FoundOnce
    def ringing(self) -> Ringing | None:
        """Ringing of the force; None if there is none."""
        return self.contact.ringing(self._result)

    def radius_at(self, sample: int) -> float:
        """Radius of a circle of the contact area at a sample [m]."""
        if (axes := self.contact.mechanics.law.semi_axes(float(self.force[sample]))) is not None:
            return math.sqrt(math.prod(axes))
        nodes, forces = self.rows.at_sample(sample)
        return math.sqrt(float(self.contact.mechanics.node_areas[nodes[forces > 0]].sum()) / math.pi)


@dataclass(frozen=True, eq=False)
class ReviewedRun:
    """A run, as reviews see it: the model after the run, its result, and what bodies and contacts did.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    result : Result
    open_joints : OpenJoints, optional
        Joints that were open at its start.
    share_made : float
        Energy that long steps in contact made, as a share of that of the largest velocities.
    equal_steps : bool
        Whether its steps have one length.
    solver : Solver, optional
        Exudyn's solver, if the user called it directly, so that nothing was checked before.
    """

    mbs: MainSystem
    result: Result
    open_joints: OpenJoints | None = None
    share_made: float = 0.0
    equal_steps: bool = False
    solver: Solver | None = None

    @FoundOnce
    def bodies(self) -> list[ReviewedBody]:
        """All bodies of the model."""
        return [ReviewedBody(item, self.result) for item in self.result.bodies]

    @FoundOnce
    def contacts(self) -> list[ReviewedContact]:
        """All contacts of the model whose sides were near each other."""
        result = self.result
        near = (contact for contact in result.contacts if not result.runs or result.kept(contact).near)
        return [ReviewedContact(contact, result) for contact in near]

    @FoundOnce
    def _histories(self) -> dict[PartitionBody, ReviewedBody]:
        return {body.item: body for body in self.bodies}

    def body(self, item: PartitionBody) -> ReviewedBody:
        """History of a body of the model."""
        return self._histories[item]

    @FoundOnce
    def closings(self) -> list[Finding]:
        """What closing the joints that were open at the start has changed visibly."""
        return [] if self.open_joints is None else [Finding(text) for text in self.open_joints.shows(self.result)]


Review = Callable[[ReviewedRun], Iterable[Finding]]


@functools.lru_cache(maxsize=16)
def evenly(count: int, most: int) -> Array:
    """Numbers of some of `count` samples, spread evenly, (k,) int; the first and the last are among them."""
    some = np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))
    read_only(some)
    return some


def lengths(vectors: Array) -> Array:
    """Lengths of vectors, (n, 3) -> (n,)."""
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", vectors, vectors)))


@once
def size_of(body: ReducedBody) -> float:
    """Largest side of the box around a body along its axes [m]."""
    return float(np.ptp(body.points, axis=0).max())


@once
def surface_of(body: ReducedBody, patch: int) -> Surface:
    """Surface of a patch in the body's own coordinates, by its number."""
    return body.surface(np.zeros(3), patch)


def deformed_share(item: PartitionBody, q: Array, deformed: Array) -> Array:
    """See `ReviewedBody.deformed_share`: at coordinates q, and at those of the deformation alone, (n, n_dofs) each."""
    body, motion = item.body, abs(deformed)
    of_nodes = motion[:, body.n_shapes :].max(axis=1, initial=0.0) / size_of(body)
    bound: Array = motion[:, : body.n_shapes] @ _largest_motions(body) + of_nodes
    return bound if bound.max(initial=0.0) < LARGEST_DEFORMATION else item.deformation(q) / size_of(body)


@once
def _largest_motions(body: ReducedBody) -> Array:
    """Largest displacement on the patches over the body's size by a unit of each shape, (n_shapes,)."""
    rows = body.shape_rows(body.partition.patch_nodes)
    return np.asarray(abs(rows).max(axis=0, initial=0.0) / size_of(body))


@once
def _reach_of(body: ReducedBody) -> tuple[Array, float]:
    """Largest motion of a node of the surface by each shape, along an axis, (n_shapes,), and largest arm [m]."""
    nodes = np.unique(body.facets)
    arms = body.points[nodes] - body.centre_of_mass
    return abs(body.shape_rows(nodes)).max(axis=0, initial=0.0), float(np.linalg.norm(arms, axis=1).max())
