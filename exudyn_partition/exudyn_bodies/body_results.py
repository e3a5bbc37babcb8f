"""What a partition body tells of a run: motion, strain and stress, momentum and energy."""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..fe.model import FEModel
from ..fe.places import interpolation
from ..frames.damping import Damping
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import validate_result, validate_vector
from ..support.foreign import ItemIndex, MainSystem, NodeIndex
from ..support.items import Item
from .damping_work import damping_work
from .model import Samples
from .static_part import (
    Static,
    check_static,
    static_motion,
    static_part,
    stress_parts,
    warn_near_contact,
    warn_within_zones,
)
from .user_functions import RIGID

Kinematics = InertialKinematics | FloatingKinematics

_BLOCK = 1e5  # displacements of patches that are recovered at a time: few enough for the processor's cache


class BodyResults(Item[ItemIndex]):
    """A partition body and its results; `partition_body.PartitionBody` makes its items in the model.

    Attributes
    ----------
    body : ReducedBody
    name : str
    kinematics : Kinematics
        Motion of the body in space.
    damping : Damping or None
        Of the modes, as joints held the body in the last run.
    weight : (n_dofs,) array or None
        Generalised forces of gravity.
    """

    body: ReducedBody
    name: str
    kinematics: Kinematics
    damping: Damping | None
    weight: Array | None

    @property
    def nodes(self) -> list[NodeIndex]:
        """Exudyn nodes of the body, in the order of its coordinates."""
        return [self[key] for key in ("nRigid", "nModal", "nNodal") if key in self]

    @property
    def node_sizes(self) -> list[int]:
        """Number of coordinates of each node."""
        first = RIGID if "nRigid" in self else self.body.n_shapes
        return [size for size in (first, self.body.n_dofs - first) if size]

    def is_in(self, mbs: MainSystem, number: int | None = None) -> bool:
        """Whether the model has this body's object, with the same nodes and size.

        It is looked for by the number that it had, or by another one, `number`.
        """
        try:
            nodes = mbs.GetObjectParameter(self["oGenericODE2"] if number is None else number, "nodeNumbers")
            if [*map(int, nodes)] != [*map(int, self.nodes)]:
                return False
            sizes = [len(mbs.GetNodeParameter(node, "referenceCoordinates")) for node in nodes]
        except ValueError:  # items of another kind, without such a parameter
            return False
        return bool(sum(sizes) == self.body.n_dofs)

    def coordinates(self, result: Samples) -> Array:
        """Coordinates q, (n, n_dofs), at the times of `result`.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.hstack([result.sensor_of(self, s) for s in self["sCoordinates"]])

    def coordinates_t(self, result: Samples) -> Array:
        """Velocities of the coordinates, (n, n_dofs), at the times of `result`.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.hstack([result.sensor_of(self, s) for s in self["sCoordinates_t"]])

    def displacement(self, result: Samples, point: Vector, *, fem: Static | None = None) -> Array:
        """Displacement of a point on or in the body, (n, 3) [m].

        A point between nodes moves by the nodes around it, see `fe.places.interpolation`.

        Parameters
        ----------
        result : Result
        point : (3,) array
            In the body's own coordinates [m].
        fem : FEModel or recovery.StaticAnswer, optional
            Adds the part of the static answer to contact forces that the kept shapes do not have (mode acceleration).
            It matters near a contact. For many points, a StaticAnswer is factorised only once.

        Raises
        ------
        InputError
            If the point is not on or in the body, or the FE model is of another one.

        Warns
        -----
        ModelLimitWarning
            If `fem` is not given, and the missing part is estimated as more than 2 % of the history.
        """
        point = validate_vector("point", point)
        nodes, weights = nodes_around(self.body, point)
        q, around = self.coordinates(result), self.kinematics.at(nodes)
        kept: Array = weights @ around.displacements(q)
        grown = around.grown(self.coordinates_t(result))
        if grown is not None:
            kept += weights @ (grown @ around.frame(q)[1].swapaxes(1, 2))
        if fem is not None:
            return kept + static_motion(self, result, nodes, weights, fem)
        warn_near_contact(self, result, point, kept, "displacement", lambda force: force)
        return kept

    def velocity(self, result: Samples, point: Vector, *, fem: Static | None = None) -> Array:
        """Velocity of a point on or in the body, (n, 3) [m/s]; see `displacement`.

        The part that `fem` adds is the rate of change of the static answer from sample to sample.

        Raises
        ------
        InputError
            If the point is not on or in the body, or the FE model is of another one.
        """
        point = validate_vector("point", point)
        q, q_t = self.coordinates(result), self.coordinates_t(result)
        nodes, weights = nodes_around(self.body, point)
        kept: Array = weights @ self.kinematics.at(nodes).velocities(q, q_t)
        if fem is not None:
            check_static(self.body, fem)
        if len(result.t) < 2:
            return kept
        rate = partial(np.gradient, axis=0)
        if fem is not None:
            value: Array = kept + rate(static_motion(self, result, nodes, weights, fem), result.t)
            return value
        warn_near_contact(self, result, point, kept, "velocity", lambda force: rate(force, result.t))
        return kept

    def velocity_rows(self, point: Vector) -> Array:
        """Velocity of a point by the velocities of the coordinates, (3, n_dofs), in a frame that does not move.

        Parameters
        ----------
        point : (3,) array
            In the body's own coordinates [m].

        Raises
        ------
        InputError
            If the point is not on or in the body.
        """
        nodes, weights = nodes_around(self.body, validate_vector("point", point))
        rows = self.body.rows(nodes)
        dense = rows if isinstance(rows, np.ndarray) else rows.toarray()
        return np.tensordot(weights, dense.reshape(len(nodes), 3, -1), axes=1)

    def recover(self, result: Samples, rows: sp.csr_matrix, *, fem: Static | None = None) -> Array:
        """History of `rows` times the nodal displacements, (n, k): strains or stresses, see module `recovery`.

        `fem` adds what the kept shapes do not have. Displacements are relative to the frame, in its axes.

        Parameters
        ----------
        result : Result
        rows : (k, 3 nodes) csr matrix
        fem : FEModel or recovery.StaticAnswer, optional

        Warns
        -----
        YieldWarning
            If rows lie within a plastic zone that has flowed, where those of stress lack plastic strain; see `stress`.
        """
        kept = self._kept_part(result, rows)
        warn_within_zones(self, result, rows)
        return kept if fem is None else kept + static_part(self, result, rows, fem)

    def stress(self, result: Samples, points: Array, fem: FEModel) -> Array:
        """Stress at points, (n, k, 6) [Pa]: xx, yy, zz, yz, xz, xy in the body's own axes, also where it has yielded.

        It has the static answer to contact forces and plastic strain that the kept shapes do not have.

        Parameters
        ----------
        result : Result
        points : (k, 3) array
            In the body's own coordinates [m].
        fem : FEModel
            Of the body.

        Raises
        ------
        InputError
            If a point lies outside the body, the FE model is of another one, or a contact's forces on nodes or its
            plastic strain are not known, as in results from files.
        MeshError
            If a plastic zone has other elements than tetrahedra.
        """
        validate_result(result)
        self.body.check_fem(fem)
        rows, taken = stress_parts(self, result, points, fem)
        whole = self._kept_part(result, rows) + static_part(self, result, rows, fem)
        return whole.reshape(len(result.t), -1, 6) - taken

    def _kept_part(self, result: Samples, rows: sp.csr_matrix) -> Array:
        """`rows` times the nodal displacements of the coordinates and of the growth by rotation, (n, k)."""
        kept: Array = self.kinematics.elastic(self.coordinates(result)) @ self.body.reduced_rows(rows).T
        products = self.kinematics.products(self.coordinates_t(result))
        return kept if products is None else kept + products @ self.body.growth_in(rows).T

    def momentum(self, result: Samples) -> Array:
        """Linear momentum of the body, (n, 3) [N s]."""
        return self.kinematics.momentum(self.coordinates_t(result))

    def angular_momentum(self, result: Samples, point: Vector = (0.0, 0.0, 0.0)) -> Array:
        """Angular momentum of the body about `point`, (3,) in space [m], (n, 3) [N m s].

        Raises
        ------
        InputError
            If the point is not a vector of three numbers.
        """
        q, q_t = self.coordinates(result), self.coordinates_t(result)
        return self.kinematics.angular_momentum(q, q_t, validate_vector("point", point))

    def energy(self, result: Samples) -> Array:
        """Kinetic and strain energy, (n,) [J]."""
        q = self.coordinates(result)
        strain = self.body.strain_energy(self.kinematics.elastic(q))
        value: Array = self.kinematics.kinetic_energy(q, self.coordinates_t(result)) + strain
        return value

    def dissipated_energy(self, result: Samples) -> Array:
        """Energy that damping has taken from the body since the start of the result, (n,) [J].

        It is what the steps take, if each has a sample. Otherwise it is integrated by the trapezoidal rule; the samples
        must resolve the vibration.
        """
        return damping_work(
            result,
            self.coordinates(result),
            self.coordinates_t(result),
            result.dampings_of(self),
            lambda damping, q_t: np.sum(q_t * damping.force(q_t), axis=1),
        )

    def rigid_motion(self, q: Array) -> Array:
        """Rigid motion at coordinates q, (n, n_dofs): (n, 6), translation [m] and rotation [rad] of the whole body.

        Raises
        ------
        InputError
            If q has another shape.
        """
        return self.kinematics.rigid_motion(self._coordinates(q))

    def deformation(self, q: Array) -> Array:
        """Largest elastic displacement on the contact patches at coordinates q, (n, n_dofs): (n,) [m].

        Raises
        ------
        InputError
            If q has another shape.
        """
        q = self._coordinates(q)
        nodes = self.body.partition.patch_nodes
        patches = self.kinematics.at(nodes)
        blocks = np.array_split(q, int(3 * len(nodes) * len(q) / _BLOCK) + 1)
        return np.concatenate([abs(patches.deformation(block)).max(axis=(1, 2), initial=0.0) for block in blocks])

    def _coordinates(self, q: Array) -> Array:
        """Check coordinates q, (n, n_dofs); infinite values pass, as an unstable run may have them."""
        if not isinstance(q, np.ndarray) or q.dtype.kind != "f" or q.ndim != 2 or q.shape[1] != self.body.n_dofs:
            got = f"one of {q.dtype} {q.shape}" if isinstance(q, np.ndarray) else type(q).__name__
            raise InputError(f"q: expected an array of floats of shape (n, {self.body.n_dofs}), got {got}")
        return q


def nodes_around(body: ReducedBody, point: Array) -> tuple[Array, Array]:
    """Nodes around a point, (k,), and weights, (k,); of a body without its inside, only nodes on its surface."""
    body.check_nodes(np.array([body.nearest_node(point)]))
    known = body.basis.shape_nodes
    if known is None:
        return interpolation(body.points, point)
    nodes, weights = interpolation(body.points[known], point)
    return known[nodes], weights
