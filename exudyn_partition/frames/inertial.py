"""Motion of a reduced body whose frame does not move: small rotations about its place."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..reduction.body import ReducedBody
from ..support.arrays import Array

NO_NODES = np.empty(0, dtype=np.int64)


class InertialKinematics:
    """A body whose frame does not move: x = X + position + Phi q.

    Parameters
    ----------
    body : ReducedBody
    position : (3,) array
        Where the origin of the body's mesh is put [m].
    nodes : (k,) int array
        Nodes of the FE model that the methods for nodes are about.
    """

    linear = True  # in the coordinates
    node_axes = np.eye(3)

    def __init__(self, body: ReducedBody, position: Array, nodes: Array = NO_NODES) -> None:
        self.body, self.position, self.nodes = body, position, nodes
        self.mass: Array = body.mass.diagonal()
        self.arms = body.points[nodes] - body.centre_of_mass
        self.rows: Any = body.rows(nodes)
        self._start = position + body.points[nodes]

    def at(self, nodes: Array) -> InertialKinematics:
        """Kinematics of other nodes, (k,) int array."""
        return InertialKinematics(self.body, self.position, nodes)

    def frame(self, q: Array) -> tuple[Array, Array]:
        """Place of the frame's origin, (..., 3) [m], and rotation matrix of its axes, (..., 3, 3)."""
        origin, axes = self.position + self.body.centre_of_mass, np.eye(3)
        return np.broadcast_to(origin, (*q.shape[:-1], 3)), np.broadcast_to(axes, (*q.shape[:-1], 3, 3))

    @property
    def from_basis(self) -> sp.csr_matrix:
        """(n_dofs, n_dofs) matrix: the coordinates' velocities by those of the body's basis, at the start."""
        return sp.identity(self.body.n_dofs, format="csr")

    def elastic(self, q: Array) -> Array:
        """Coordinates q of the motion within the frame."""
        return q

    def moved(self, q: Array, way: Array) -> Array:
        """Coordinates after a way, (n_dofs,), velocity times time, from q, (n_dofs,)."""
        return q + way

    def accelerations(self, q: Array, forces: Any) -> Any:
        """Accelerations, (n_dofs, m), dense or csr, by generalised forces, (n_dofs, m), so stored."""
        if sp.issparse(forces):
            return sp.csr_matrix(forces.multiply(1 / self.mass[:, None]))
        return forces / self.mass[:, None]

    def place(self, q: Array) -> Array:
        """Places of the nodes, (..., k, 3) [m]."""
        return self._start + self.displacements(q)

    def displacements(self, q: Array) -> Array:
        """Displacements of the nodes from where they are at q = 0, (..., k, 3) [m]."""
        return node_fields(self.rows, q)

    def velocities(self, q: Array, q_t: Array) -> Array:
        """Velocities of the nodes, (..., k, 3) [m/s]."""
        return node_fields(self.rows, q_t)

    def generalised(self, q: Array, forces: Array) -> Array:
        """Generalised forces, (n_dofs,), of forces on the nodes, (k, 3) [N]."""
        return self.rows.T @ forces.ravel()

    def on_coordinates(self, q: Array, rows: sp.csr_matrix) -> Any:
        """Rows on the coordinates' velocities, (m, n_dofs), dense or csr, of rows on the nodes' velocities, (m, 3k)."""
        return rows @ self.rows

    def in_frame(self, q: Array, directions: Array) -> Array:
        """Directions in space, (m, 3), in the body's axes."""
        return directions

    def weight(self, gravity: Array) -> Array:
        """Generalised forces, (n_dofs,), of an acceleration of gravity, (3,) [m/s2]."""
        return self.body.mass @ (self.body.rigid[:, :3] @ gravity)

    @property
    def mass_integral(self) -> Array:
        """Linear momentum by velocities of the coordinates within the frame, (3, n_dofs)."""
        return np.asarray(self.body.mass @ self.body.rigid[:, :3]).T

    def momentum(self, q_t: Array) -> Array:
        """Linear momentum, (..., 3) [N s]."""
        return q_t @ self.mass_integral.T

    def angular_momentum(self, q: Array, q_t: Array, point: Array) -> Array:
        """Angular momentum about a point in space, (3,) [m], first order in deformation and rotation, (..., 3)."""
        arm = self.frame(q)[0] + self.rigid_motion(q)[..., :3] - point
        return np.cross(arm, self.momentum(q_t)) + q_t @ (self.body.mass @ self.body.rigid[:, 3:])

    def kinetic_energy(self, q: Array, q_t: Array) -> Array:
        """Kinetic energy, (...,) [J]."""
        return np.sum(q_t * (self.body.mass @ q_t.T).T, axis=-1) / 2

    def rigid_motion(self, q: Array) -> Array:
        """Translation of the centre of mass [m] and rotation [rad] of the whole body, (..., 6)."""
        M_rigid = self.body.mass @ self.body.rigid
        return np.linalg.solve(self.body.rigid.T @ M_rigid, M_rigid.T @ q.T).T

    def deformed(self, q: Array) -> Array:
        """Coordinates, in the basis, of the deformation alone."""
        return q - self.rigid_motion(q) @ self.body.rigid.T

    def proportional_force(self, q: Array, alpha: float, beta: float) -> Array:
        """Generalised forces (alpha M + beta K) of the deformation in coordinates or velocities q, (..., n_dofs)."""
        return alpha * self.mass * self.deformed(q) + beta * (self.body.stiffness @ q.T).T

    def proportional_matrix(self, alpha: float, beta: float) -> sp.csr_matrix:
        """(n_dofs, n_dofs): alpha M + beta K, rigid motion included."""
        return sp.csr_matrix(alpha * self.body.mass + beta * self.body.stiffness)

    def deformation(self, q: Array) -> Array:
        """Displacements of the nodes by deformation alone, in the body's axes, (..., k, 3) [m]."""
        return node_fields(self.rows, self.deformed(q))


def node_fields(rows: Any, q: Array) -> Array:
    """Vectors at k nodes, (..., k, 3), by rows (3k, n)."""
    return np.asarray((rows @ q.T).T).reshape(*q.shape[:-1], -1, 3)
