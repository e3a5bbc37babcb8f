"""Motion of a reduced body whose frame does not move: small rotations about its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from ..fe.model import node_dofs
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..support.attributes import copied
from ..support.once import once
from . import loops
from .kinematics import NO_NODES, STILL, node_fields

if TYPE_CHECKING:
    from .node_kernels import FlatNodes


class InertialKinematics:
    """A body whose frame does not move, x = X + position + Phi q: see `Kinematics`.

    Parameters
    ----------
    body : ReducedBody
    position : (3,) array
        Where the origin of the body's mesh is put [m].
    nodes : (k,) int array
        Nodes of the FE model that the methods for nodes are about.
    """

    linear = True
    rotation: Array = np.zeros(3)
    node_axes: Array = np.eye(3)

    def __init__(self, body: ReducedBody, position: Array, nodes: Array = NO_NODES) -> None:
        self.body, self.position, self.nodes = body, position, nodes
        self.mass: Array = body.mass.diagonal()
        self.arms: Array = body.points[nodes] - body.centre_of_mass
        self.rows = body.rows(nodes)
        self.start: Array = position + body.points[nodes]

    def at(self, nodes: Array) -> InertialKinematics:
        """See `Kinematics.at`."""
        return InertialKinematics(self.body, self.position, nodes)

    def some(self, index: Array) -> InertialKinematics:
        """See `Kinematics.some`."""
        result = copied(self)
        result.nodes, result.arms, result.start = self.nodes[index], self.arms[index], self.start[index]
        result.rows = self.rows[node_dofs(index)]
        return result

    def displaced(self, by: Array) -> InertialKinematics:
        """See `Kinematics.displaced`."""
        result = copied(self)
        result.arms, result.start = self.arms + by, self.start + by
        return result

    def seen_from(self, point: Array) -> InertialKinematics:
        """See `Kinematics.seen_from`."""
        result = copied(self)
        result.start = self.start - point
        return result

    def frame(self, q: Array) -> tuple[Array, Array]:
        """See `Kinematics.frame`; the origin is the centre of mass at the start."""
        origin, axes = self.position + self.body.centre_of_mass, np.eye(3)
        if q.ndim == 1:
            return origin, axes
        return np.broadcast_to(origin, (*q.shape[:-1], 3)), np.broadcast_to(axes, (*q.shape[:-1], 3, 3))

    @property
    def from_basis(self) -> LinearOperator:
        """See `Kinematics.from_basis`."""
        return aslinearoperator(sp.identity(self.body.n_dofs))

    def elastic(self, q: Array) -> Array:
        """See `Kinematics.elastic`; rigid motion is within the frame."""
        return q

    def rigid_part(self, q_t: Array) -> Array:
        """See `Kinematics.rigid_part`."""
        rigid: Array = self.body.rigid @ self.rigid_motion(q_t)
        return rigid

    def moved(self, q: Array, way: Array) -> Array:
        """See `Kinematics.moved`."""
        moved: Array = q + way
        return moved

    def way(self, q: Array, end: Array) -> Array:
        """See `Kinematics.way`."""
        way: Array = end - q
        return way

    def accelerations(self, q: Array, forces: Array | sp.csr_matrix) -> Array | sp.csr_matrix:
        """See `Kinematics.accelerations`."""
        if isinstance(forces, np.ndarray):
            return forces / self.mass[:, None]
        return sp.csr_matrix(forces.multiply(1 / self.mass[:, None]))

    def place(self, q: Array, growing: Array = STILL) -> Array:
        """See `Kinematics.place`; the body does not grow."""
        return loops.moved_places(self.start, self.rows, q)

    def flat(self, active: Array) -> FlatNodes:
        """See `Kinematics.flat`."""
        motion = self.start, self.arms, self.rows, np.zeros((0, 6))
        return loops.flat_nodes(active, motion, (self.rotation, self.node_axes, np.eye(3)), floats=False)

    def displacements(self, q: Array) -> Array:
        """See `Kinematics.displacements`."""
        return node_fields(self.rows, q)

    def growing(self, q_t: Array) -> Array:
        """See `Kinematics.growing`."""
        return STILL

    def products(self, q_t: Array) -> None:
        """See `Kinematics.products`."""

    def grown(self, q_t: Array) -> None:
        """See `Kinematics.grown`."""

    def velocities(self, q: Array, q_t: Array) -> Array:
        """See `Kinematics.velocities`."""
        return node_fields(self.rows, q_t)

    def mean_velocity(self, q: Array, q_t: Array, point: Array) -> Array:
        """See `Kinematics.mean_velocity`; projection with the mass matrix keeps both momenta."""
        motion, centre = self.rigid_motion(q_t), self.frame(q)[0] + self.rigid_motion(q)[..., :3]
        velocity: Array = motion[..., :3] + np.cross(motion[..., 3:], point - centre)
        return velocity

    def generalised(self, q: Array, forces: Array) -> Array:
        """See `Kinematics.generalised`."""
        return loops.on_shapes(self.rows, forces)

    def on_coordinates(self, q: Array, rows: sp.csr_matrix) -> Array | sp.csr_matrix:
        """See `Kinematics.on_coordinates`; csr if the body keeps nodes."""
        return rows @ self.rows

    def in_frame(self, q: Array, directions: Array) -> Array:
        """See `Kinematics.in_frame`."""
        return directions

    def weight(self, gravity: Array) -> Array:
        """See `Kinematics.weight`."""
        weight: Array = self.body.mass @ (self.body.rigid[:, :3] @ gravity)
        return weight

    @property
    def mass_integral(self) -> Array:
        """See `Kinematics.mass_integral`; of all coordinates, (3, n_dofs)."""
        return _mass_integral(self.body)

    def momentum(self, q_t: Array) -> Array:
        """See `Kinematics.momentum`."""
        momentum: Array = q_t @ self.mass_integral.T
        return momentum

    def angular_momentum(self, q: Array, q_t: Array, point: Array) -> Array:
        """See `Kinematics.angular_momentum`; first order in deformation and rotation."""
        arm = self.frame(q)[0] + self.rigid_motion(q)[..., :3] - point
        momentum: Array = np.cross(arm, self.momentum(q_t)) + q_t @ (self.body.mass @ self.body.rigid[:, 3:])
        return momentum

    def kinetic_energy(self, q: Array, q_t: Array) -> Array:
        """See `Kinematics.kinetic_energy`."""
        energy: Array = np.square(q_t) @ self.mass / 2
        return energy

    def rigid_motion(self, q: Array) -> Array:
        """See `Kinematics.rigid_motion`; found by projection with the mass matrix."""
        motion: Array = q @ self.projection
        return motion

    @property
    def projection(self) -> Array:
        """Rigid motion by coordinates, transposed, (n_dofs, 6)."""
        return _projection(self.body)

    def deformed(self, q: Array) -> Array:
        """See `Kinematics.deformed`."""
        deformed: Array = q - self.rigid_motion(q) @ self.body.rigid.T
        return deformed

    def proportional_force(self, q: Array, alpha: float, beta: float) -> Array:
        """See `Kinematics.proportional_force`."""
        force: Array = alpha * self.mass * self.deformed(q) + beta * (self.body.stiffness @ q.T).T
        return force

    def proportional_matrix(self, alpha: float, beta: float) -> sp.csr_matrix:
        """See `Kinematics.proportional_matrix`."""
        return sp.csr_matrix(alpha * self.body.mass + beta * self.body.stiffness)

    def deformation(self, q: Array) -> Array:
        """See `Kinematics.deformation`."""
        return node_fields(self.rows, self.deformed(q))


@once
def _mass_integral(body: ReducedBody) -> Array:
    return np.asarray(body.mass @ body.rigid[:, :3]).T


@once
def _projection(body: ReducedBody) -> Array:
    M_rigid = body.mass @ body.rigid
    return np.linalg.solve(body.rigid.T @ M_rigid, M_rigid.T).T
