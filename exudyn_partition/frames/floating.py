"""Motion of a reduced body in a floating frame: any rotation, and small deformation in mean axes.

Places and velocities of nodes (paper, eq. 1, 2a), rows B of these velocities (eq. 4a, 5a), generalised forces (eq. 8c,
with the rows of T also those of eq. 16), elastic forces (eq. 8d), and the velocities v = (r_t, omega, deformation) of
eq. 12 and 14.

Theory: examples/site/theory.md, "Floating frame".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..fe.model import node_dofs
from ..reduction.body import ReducedBody
from ..reduction.geometric_stiffness import GeometricStiffness
from ..reduction.inertia import PAIRS
from ..support.arrays import Array
from ..support.attributes import copied
from . import loops
from .inertia import Inertia, angular_acceleration
from .inertial import InertialKinematics
from .kinematics import NO_NODES, STILL, node_fields
from .mean_axes import MeanAxes
from .nodal_inertia import NodalInertia
from .rotations import rotation_matrix, turned

if TYPE_CHECKING:
    from .node_kernels import FlatNodes

_FIRST, _SECOND = np.array(PAIRS).T
_ROUND_OFF = 1e-13  # of places of nodes, by the body's size


@dataclass
class ActingMass:
    """The mass that forces on a body act on: one for all copies of its kinematics.

    Parameters
    ----------
    constant : bool
        Whether it is that of the undeformed body, as if deformation did not change it.
    settled : bool
        Whether it stays so, whatever acts on the body.
    items : (int, int)
        Numbers of objects and loads that the model had when this was looked at.
    """

    constant: bool
    settled: bool
    items: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Spin:
    """Which rotations make a body grow so much that its nodes' places show it.

    Parameters
    ----------
    largest : (6,) array
        Largest growth of a node, by each product of angular velocities [m s2].
    least : float
        Growth that round-off of the nodes' places hides [m].
    axes : (3, 3) array
        Axes of the frame's node in those of the body, as columns.
    """

    largest: Array
    least: float
    axes: Array

    @cached_property
    def slow(self) -> float:
        """Square of an angular velocity up to which growth is hidden, whatever the axis [rad2/s2]; as each product."""
        total = float(self.largest.sum())
        return self.least / total if total else np.inf

    @cached_property
    def _numbers(self) -> tuple[list[list[float]], list[float]]:
        return self.axes.tolist(), self.largest.tolist()

    def products(self, omega: Array) -> Array:
        """Products of the angular velocity omega, (3,), in the node's axes, (6,) [rad2/s2]; empty if growth is hidden.

        Without arrays, which is quicker.
        """
        u, v, w = omega.tolist()
        if u * u + v * v + w * w <= self.slow:
            return STILL
        rows, sizes = self._numbers
        x, y, z = [row[0] * u + row[1] * v + row[2] * w for row in rows]
        products = x * x, y * y, z * z, y * z, x * z, x * y
        hidden = sum([abs(product) * size for product, size in zip(products, sizes, strict=True)]) <= self.least
        return STILL if hidden else np.array(products)


class FloatingKinematics:
    """A body in its mean axes, x = r + A (X - c + Phi z): see `Kinematics`.

    Coordinates are q = (r - r0, rotation vector - that at the start, z), with r the centre of mass.

    The frame's Exudyn node, a NodeRigidBodyRotVecLG, has axes of its own. Rotation vector and angular velocity are
    those of the node: velocities are q_t = (r_t, angular velocity in the node's axes, z_t). Generalised forces and
    `inertia` are in the node's axes too; everything else is in the body's axes.

    Deformation z is that of module `mean_axes`, with unit mass.

    Parameters
    ----------
    body : ReducedBody
    position : (3,) array
        Where the origin of the body's mesh is put [m].
    rotation : (3,) array
        Rotation vector of its axes there [rad].
    nodes : (k,) int array
        Nodes of the FE model that the methods for nodes are about.
    node_rotation : (3,) array, optional
        Rotation vector of the node's axes at the start [rad]; default: the body's.

    Attributes
    ----------
    acting : ActingMass
        See `on_constant_mass`; constant for a body with geometric stiffness.
    spin : Spin or None
        Rotations by which the body grows; None if the growth is not known.

    Raises
    ------
    InputError
        If the body has no moment of inertia about some axis.
    """

    linear = False

    def __init__(
        self,
        body: ReducedBody,
        position: Array,
        rotation: Array,
        nodes: Array = NO_NODES,
        node_rotation: Array | None = None,
    ) -> None:
        self.body, self.position = body, position
        self.rotation = rotation if node_rotation is None else node_rotation
        axes = rotation_matrix(rotation)
        self.node_axes = np.eye(3) if node_rotation is None else axes.T @ rotation_matrix(node_rotation)
        self.mean_axes = MeanAxes(body.mass.diagonal(), body.rigid)
        self.inertia = _inertia(body, self.mean_axes).turned(self.node_axes)
        self.mass = np.r_[np.full(3, body.total_mass), np.diag(self.inertia.tensor), np.ones(body.n_dofs - 6)]
        self.origin = position + axes @ body.centre_of_mass
        self.acting = ActingMass(constant=body.stiffening is not None, settled=body.stiffening is not None)
        growth = body.basis.growth
        self.spin = None
        if growth is not None:
            hidden = _ROUND_OFF * float(np.ptp(body.points, axis=0).max())
            self.spin = Spin(abs(growth).max(axis=0), hidden, self.node_axes)
        self._follow(nodes)

    def _follow(self, nodes: Array) -> None:
        self.nodes = nodes
        self.arms = self.body.points[nodes] - self.body.centre_of_mass
        self.start = self.origin + self.arms @ self._axes_at_start.T
        rows = self.body.rows(nodes)
        self.rows = self.mean_axes.restrict(rows if isinstance(rows, np.ndarray) else rows.toarray())
        self.growth = self.body.growth_rows(nodes)

    def at(self, nodes: Array) -> FloatingKinematics:
        """See `Kinematics.at`."""
        result = copied(self)
        result._follow(nodes)
        return result

    def some(self, index: Array) -> FloatingKinematics:
        """See `Kinematics.some`."""
        result = copied(self)
        result.nodes, result.arms, result.rows = self.nodes[index], self.arms[index], self.rows[node_dofs(index)]
        result.start = self.start[index]
        result.growth = None if self.growth is None else self.growth[node_dofs(index)]
        return result

    def displaced(self, by: Array) -> FloatingKinematics:
        """See `Kinematics.displaced`."""
        result = copied(self)
        result.arms, result.start = self.arms + by, self.start + by @ self._axes_at_start.T
        return result

    def seen_from(self, point: Array) -> FloatingKinematics:
        """See `Kinematics.seen_from`."""
        result = copied(self)
        result.start = self.start - point
        return result

    @cached_property
    def _axes_at_start(self) -> Array:
        return rotation_matrix(self.rotation) @ self.node_axes.T

    def frame(self, q: Array) -> tuple[Array, Array]:
        """See `Kinematics.frame`; the origin is the centre of mass."""
        return self.origin + q[..., :3], rotation_matrix(self.rotation + q[..., 3:6]) @ self.node_axes.T

    @property
    def from_basis(self) -> LinearOperator:
        """See `Kinematics.from_basis`."""
        n, mass = self.body.n_dofs, self.body.mass.diagonal()
        rigid = InertialKinematics(self.body, self.position).projection.T
        rigid = np.vstack([self.frame(np.zeros(n))[1] @ rigid[:3], self.node_axes.T @ rigid[3:]])

        def coordinates(v: Array) -> Array:
            return np.concatenate([rigid @ v, self.mean_axes.deformation(v.T).T])

        def transposed(forces: Array) -> Array:
            value: Array = rigid.T @ forces[:6] + (mass * self.mean_axes.expand(forces[6:].T)).T
            return value

        maps = {"matvec": coordinates, "matmat": coordinates, "rmatvec": transposed, "rmatmat": transposed}
        return LinearOperator((n, n), dtype=float, **maps)

    def elastic(self, q: Array) -> Array:
        """See `Kinematics.elastic`; that is the deformation."""
        return self.mean_axes.expand(q[..., 6:])

    deformed = elastic

    def elastic_force(self, z: Array) -> Array:
        """Generalised forces K z, (..., n_dofs - 6), of deformation z, (..., n_dofs - 6)."""
        return self.mean_axes.restrict((self.body.stiffness @ self.mean_axes.expand(z).T).T)

    @property
    def stiffening(self) -> GeometricStiffness | None:
        """Geometric stiffness on the deformation z, if the body has it."""
        stiffening = self.body.stiffening
        return None if stiffening is None else stiffening.without_rigid(self.mean_axes.restrict)

    @cached_property
    def elastic_stiffness(self) -> Array:
        """K of the deformation, (n_dofs - 6, n_dofs - 6), dense."""
        rows = self.mean_axes.restrict(self.body.stiffness.toarray())
        return self.mean_axes.restrict(rows.T)

    def proportional_force(self, q: Array, alpha: float, beta: float) -> Array:
        """See `Kinematics.proportional_force`."""
        z = q[..., 6:]
        return np.concatenate([np.zeros((*z.shape[:-1], 6)), alpha * z + beta * self.elastic_force(z)], axis=-1)

    def proportional_matrix(self, alpha: float, beta: float) -> sp.csr_matrix:
        """See `Kinematics.proportional_matrix`; zero for rigid motion."""
        n = self.body.n_dofs - 6
        of_shapes = alpha * np.eye(n) + beta * self.elastic_stiffness
        return sp.block_diag([sp.csr_matrix((6, 6)), of_shapes], format="csr")

    def rigid_part(self, q_t: Array) -> Array:
        """See `Kinematics.rigid_part`."""
        return np.concatenate([q_t[:6], np.zeros(len(q_t) - 6)])

    def moved(self, q: Array, way: Array) -> Array:
        """See `Kinematics.moved`; rotations are composed."""
        result = q + way
        result[3:6] = turned(self.rotation + q[3:6], way[3:6]) - self.rotation
        return result

    def way(self, q: Array, end: Array) -> Array:
        """See `Kinematics.way`."""
        result = end - q
        result[3:6] = turned(-(self.rotation + q[3:6]), self.rotation + end[3:6])
        return result

    def accelerations(self, q: Array, forces: Array | sp.csr_matrix) -> Array:
        """See `Kinematics.accelerations`; with the mass that q gives, see `on_constant_mass`."""
        J, C = self.inertia.of_place(q[6:])
        if self.acting.constant:
            J, C = self.inertia.tensor, np.zeros_like(C)
        omega_t = angular_acceleration(J, C, forces[3:6], forces[6:])
        return np.concatenate([forces[:3] / self.body.total_mass, omega_t, forces[6:] - C.T @ omega_t])

    def place(self, q: Array, growing: Array = STILL) -> Array:
        """See `Kinematics.place`."""
        start, arms = self.start, self.arms
        if len(growing) and self.growth is not None:
            grown = node_fields(self.growth, growing)
            start, arms = start + grown @ self._axes_at_start.T, arms + grown
        places: Array = loops.places(q, start, self.rotation, self.node_axes, arms, self.rows)
        return places

    def flat(self, active: Array) -> FlatNodes:
        """See `Kinematics.flat`."""
        growth = np.zeros((0, 6)) if self.growth is None else self.growth
        frame = self.rotation, self.node_axes, self._axes_at_start
        return loops.flat_nodes(active, (self.start, self.arms, self.rows, growth), frame, floats=True)

    def growing(self, q_t: Array) -> Array:
        """See `Kinematics.growing`."""
        return STILL if self.spin is None else self.spin.products(q_t[3:6])

    def products(self, q_t: Array) -> Array | None:
        """See `Kinematics.products`."""
        if self.growth is None:
            return None
        omega = q_t[..., 3:6] @ self.node_axes.T
        products: Array = omega[..., _FIRST] * omega[..., _SECOND]
        return products

    def grown(self, q_t: Array) -> Array | None:
        """See `Kinematics.grown`."""
        products = self.products(q_t)
        return None if products is None or self.growth is None else node_fields(self.growth, products)

    def displacements(self, q: Array) -> Array:
        """See `Kinematics.displacements`."""
        return self.place(q) - self.place(np.zeros(q.shape[-1]))

    def velocities(self, q: Array, q_t: Array) -> Array:
        """See `Kinematics.velocities`."""
        arms, grown = self._arms(q), self.grown(q_t)
        arms = arms if grown is None else arms + grown
        local = np.cross((q_t[..., 3:6] @ self.node_axes.T)[..., None, :], arms) + node_fields(self.rows, q_t[..., 6:])
        velocities: Array = q_t[..., None, :3] + local @ self.frame(q)[1].swapaxes(-1, -2)
        return velocities

    def velocity_along(self, q: Array, q_t: Array, weights: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Velocity of a point along a direction in space, (3,), and its derivatives.

        Parameters
        ----------
        q, q_t : (n, n_dofs) arrays
            Coordinates and their velocities at n samples.
        weights : (k,) array
            Of the nodes, whose weighted mean is the point.
        direction : (3,) array

        Returns
        -------
        The velocity, (n,) [m/s], and its derivatives by coordinates and velocities, (n, n_dofs) each. Those by the
        rotation belong to small turns about the axes of the frame's node.
        """
        shapes = np.tensordot(weights, self.rows.reshape(len(weights), 3, -1), axes=1)
        omega, along = q_t[:, 3:6] @ self.node_axes.T, direction @ self.frame(q)[1]
        arm, grown = weights @ self.arms + q[:, 6:] @ shapes.T, self.products(q_t)
        growth = np.zeros((3, 6))
        if grown is not None and self.growth is not None:
            growth = np.tensordot(weights, self.growth.reshape(len(weights), 3, 6), axes=1)
            arm = arm + grown @ growth.T
        local, by_arm = np.cross(omega, arm) + q_t[:, 6:] @ shapes.T, np.cross(along, omega)
        by_q, by_v = np.zeros((2, *q.shape))
        by_q[:, 3:6], by_q[:, 6:] = np.cross(local, along) @ self.node_axes, by_arm @ shapes
        of_omega = np.cross(arm, along) + by_products(omega, by_arm @ growth)
        by_v[:, :3], by_v[:, 3:6], by_v[:, 6:] = direction, of_omega @ self.node_axes, along @ shapes
        return q_t[:, :3] @ direction + np.einsum("na,na->n", local, along), by_q, by_v

    def recovered(self, q: Array, q_t: Array, row: Array, growth: Array) -> tuple[Array, Array, Array]:
        """A row, (n_dofs,) in the basis, times the deformation, and its derivatives, as `velocity_along` returns them.

        `growth`, (6,), is the same by products of angular velocities.
        """
        by_z = row @ self.mean_axes.expand(np.eye(q.shape[1] - 6)).T
        by_q, by_v = np.zeros((2, *q.shape))
        values, by_q[:, 6:], products = q[:, 6:] @ by_z, by_z, self.products(q_t)
        if products is not None:
            values = values + products @ growth
            omega = q_t[:, 3:6] @ self.node_axes.T
            by_v[:, 3:6] = by_products(omega, np.tile(growth, (len(q), 1))) @ self.node_axes
        return values, by_q, by_v

    def mean_velocity(self, q: Array, q_t: Array, point: Array) -> Array:
        """See `Kinematics.mean_velocity`; that of the mean axes, whose deformation has momenta of second order only."""
        r, A = self.frame(q)
        omega = np.einsum("...ab,...b->...a", A @ self.node_axes, q_t[..., 3:6])
        velocity: Array = q_t[..., :3] + np.cross(omega, point - r)
        return velocity

    def generalised(self, q: Array, forces: Array) -> Array:
        """See `Kinematics.generalised`; the torque is in the node's axes."""
        return loops.generalised(q, self.rotation, self.node_axes, self.arms, self.rows, forces)

    def on_coordinates(self, q: Array, rows: sp.csr_matrix) -> Array:
        """See `Kinematics.on_coordinates`."""
        A, arms = self.frame(q)[1], self._arms(q)
        turning = np.cross(self.node_axes.T, arms[:, None, :]).swapaxes(1, 2)  # unit rotations about the node's axes
        of_nodes = np.empty((len(arms), 3, self.body.n_dofs))
        of_nodes[:, :, :3], of_nodes[:, :, 3:6] = np.eye(3), A @ turning
        of_nodes[:, :, 6:] = A @ self.rows.reshape(len(arms), 3, -1)
        return np.asarray(rows @ of_nodes.reshape(3 * len(arms), -1))

    def in_frame(self, q: Array, directions: Array) -> Array:
        """See `Kinematics.in_frame`."""
        return loops.in_axes(q, self.rotation, self.node_axes, directions)

    def on_constant_mass(self, q: Array, force: Array) -> Array:
        """Forces that act on the constant mass diag(m, J, 1) as `force` acts on the true mass: same accelerations.

        `InertiaForces` does the same for inertia and elastic forces, if all other forces on the body are known. Exudyn
        has those of joints, springs and loads act on the constant mass. Then all forces must: elastic forces balance
        them in a steady state, and on the true mass would leave a torque, force times deflection. That torque is as
        large as geometric stiffness, and free bodies alone have none.
        """
        if self.acting.constant:
            return force
        return loops.on_constant_mass(self.inertia, q[6:], force)

    def weight(self, gravity: Array) -> Array:
        """See `Kinematics.weight`."""
        return np.concatenate([self.body.total_mass * gravity, np.zeros(self.body.n_dofs - 3)])

    @property
    def mass_integral(self) -> Array:
        """See `Kinematics.mass_integral`; (3, n_dofs - 6), zero in mean axes."""
        return np.zeros((3, self.body.n_dofs - 6))

    def momentum(self, q_t: Array) -> Array:
        """See `Kinematics.momentum`."""
        return self.body.total_mass * q_t[..., :3]

    def angular_momentum(self, q: Array, q_t: Array, point: Array) -> Array:
        """See `Kinematics.angular_momentum`."""
        r, A = self.frame(q)
        local = self.inertia.angular_momentum(q_t[..., 3:6], q[..., 6:], q_t[..., 6:])
        spin = np.einsum("...ab,...b->...a", A @ self.node_axes, local)
        momentum: Array = np.cross(r - point, self.momentum(q_t)) + spin
        return momentum

    def kinetic_energy(self, q: Array, q_t: Array) -> Array:
        """See `Kinematics.kinetic_energy`."""
        translation = np.sum(q_t[..., :3] * self.momentum(q_t), axis=-1) / 2
        energy: Array = translation + self.inertia.kinetic_energy(q_t[..., 3:6], q[..., 6:], q_t[..., 6:])
        return energy

    def kinetic_energy_by(self, z: Array, q_t: Array) -> tuple[Array, Array]:
        """Derivatives of the kinetic energy by the deformation z, (n,), and by the velocities q_t, (6 + n,)."""
        (omega, z_t), (by_place, J, C, crossed) = (q_t[3:6], q_t[6:]), self.inertia.products(z, q_t[6:])
        doubled = np.where(_FIRST == _SECOND, 1.0, 2.0)
        by_z = (omega[_FIRST] * omega[_SECOND] * doubled) @ by_place + omega @ crossed
        return by_z, np.concatenate([self.momentum(q_t), J @ omega + C @ z_t, omega @ C + z_t])

    def rigid_motion(self, q: Array) -> Array:
        """See `Kinematics.rigid_motion`."""
        axes = self.frame(q)[1]
        turn = Rotation.from_matrix(axes.reshape(-1, 3, 3)).as_rotvec().reshape(*axes.shape[:-2], 3)
        return np.concatenate([q[..., :3], turn], axis=-1)

    def deformation(self, q: Array) -> Array:
        """See `Kinematics.deformation`."""
        return node_fields(self.rows, q[..., 6:])

    def _arms(self, q: Array) -> Array:
        return self.arms + self.deformation(q)


def by_products(omega: Array, by: Array) -> Array:
    """Derivatives by angular velocities, (n, 3), from those by their products, (n, 6), see `Kinematics.products`."""
    result = np.zeros_like(omega)
    for c, (i, j) in enumerate(PAIRS):
        result[:, i] += by[:, c] * omega[:, j]
        result[:, j] += by[:, c] * omega[:, i]
    return result


def _inertia(body: ReducedBody, mean_axes: MeanAxes) -> Inertia:
    """Inertia of a body, with nodes that it keeps as point masses; raises InputError if it has none about an axis."""
    inertia: Inertia = body.inertia
    if len(body.basis.nodal):
        masses = body.mass.diagonal()[body.n_shapes :: 3]
        arms = body.points[body.basis.nodal] - body.centre_of_mass
        inertia = NodalInertia(body.inertia, masses, arms, mean_axes, np.eye(3))
    moments = np.linalg.eigvalsh(inertia.tensor)
    if moments[0] <= 1e-12 * moments[2]:
        raise InputError(
            f"body: expected moments of inertia above zero about all axes, got {moments} kg m2; a floating frame "
            "cannot rotate about an axis without inertia. Give the body an extension across it, or take "
            "frame='inertial'"
        )
    return inertia
