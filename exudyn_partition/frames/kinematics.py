"""Motion of a reduced body in space, as contact, markers and results see it: one protocol for all frames.

Its methods ask for the paper's places and velocities of nodes (eq. 1, 2a), rows B of these velocities (eq. 4a, 5a) and
generalised forces (eq. 8c). `floating` has the formulas.

A body in an inertial frame moves by small rotations about its place (`inertial`), one in a floating frame by any
rotation (`floating`). Coordinates q are those of the body's Exudyn nodes, (n_dofs,), or a history of them,
(m, n_dofs). Where a shape begins with `...`, a method takes both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from ..reduction.body import ReducedBody
from ..support.arrays import Array

if TYPE_CHECKING:
    from .node_kernels import FlatNodes

Rows = Array | sp.csr_matrix  # dense where bodies move by shapes, sparse where they move by nodes
Frame = Literal["inertial", "floating"]
FrameChoice = Literal[Frame, "auto"]
FRAMES: tuple[FrameChoice, ...] = get_args(FrameChoice)
NO_NODES = np.empty(0, dtype=np.int64)
STILL = np.empty(0)  # products of angular velocities of a body that does not grow


class Kinematics(Protocol):
    """Motion of a body in its frame, and of some nodes of its FE model.

    Attributes
    ----------
    linear : bool
        Whether places are linear in the coordinates.
    body : ReducedBody
    position : (3,) array
        Where the origin of the body's mesh is put [m].
    rotation : (3,) array
        Rotation vector of the node's axes at the start [rad].
    node_axes : (3, 3) array
        Axes of the frame's Exudyn node, as columns, in those of the body.
    mass : (n_dofs,) array
        Diagonal of the coordinates' mass matrix, which is constant.
    nodes : (k,) int array
        Nodes of the FE model that the methods for nodes are about.
    arms : (k, 3) array
        From the centre of mass to these nodes, undeformed, in the body's axes [m].
    rows : (3k, n) array or csr matrix
        Displacements of these nodes in the body's axes, by the coordinates of the motion within the frame.
    start : (k, 3) array
        Places of these nodes at q = 0 [m].
    """

    linear: bool
    body: ReducedBody
    position: Array
    rotation: Array
    node_axes: Array
    mass: Array
    nodes: Array
    arms: Array
    rows: Array | sp.csr_matrix
    start: Array

    def at(self, nodes: Array) -> Kinematics:
        """Kinematics of other nodes, (k,) int array."""

    def some(self, index: Array) -> Kinematics:
        """Kinematics of some of its nodes, (k,) int array of their places in `nodes`."""

    def displaced(self, by: Array) -> Kinematics:
        """Kinematics of places beside its nodes, which move with them; `by`, (k, 3) [m], is in the body's axes."""

    def seen_from(self, point: Array) -> Kinematics:
        """The same kinematics, but with places of nodes that count from a point of space, (3,) [m].

        Numbers near zero have small rounding errors. Frame and velocities are those of space.
        """

    @property
    def from_basis(self) -> LinearOperator:
        """(n_dofs, n_dofs) operator: the coordinates' velocities by those of the body's basis, at the start.

        Of floating frames it has no zeros as a matrix, and takes long to form.
        """

    def frame(self, q: Array) -> tuple[Array, Array]:
        """Place of the frame's origin, (..., 3) [m], and rotation matrix of its axes, (..., 3, 3)."""

    def elastic(self, q: Array) -> Array:
        """Coordinates, in the basis, of the motion within the frame, (..., n_dofs)."""

    def deformed(self, q: Array) -> Array:
        """Coordinates, in the basis, of the deformation alone, (..., n_dofs)."""

    def rigid_motion(self, q: Array) -> Array:
        """Translation of the centre of mass [m] and rotation vector of the body [rad], (..., 6)."""

    def rigid_part(self, q_t: Array) -> Array:
        """Velocities, (n_dofs,), of the rigid motion within velocities q_t, (n_dofs,)."""

    def moved(self, q: Array, way: Array) -> Array:
        """Coordinates after a way, (n_dofs,), which is velocity times time, from q, (n_dofs,)."""

    def way(self, q: Array, end: Array) -> Array:
        """Way, (n_dofs,), that leads from coordinates q to `end`, (n_dofs,): the inverse of `moved`."""

    def place(self, q: Array, growing: Array = STILL) -> Array:
        """Places of the nodes, (..., k, 3) [m]; `growing` are products by which the body grows, see `growing`."""

    def flat(self, active: Array) -> FlatNodes:
        """The nodes, as compiled loops take them; `active`, (k,) int array, are their numbers there."""

    def growing(self, q_t: Array) -> Array:
        """Products of angular velocities by which places grow at velocities q_t, (n_dofs,): (6,) [rad2/s2].

        Empty if the growth is not known, the frame does not turn, or round-off of the places hides it.
        """

    def displacements(self, q: Array) -> Array:
        """Displacements of the nodes from where they are at q = 0, (..., k, 3) [m]."""

    def deformation(self, q: Array) -> Array:
        """Displacements of the nodes by deformation alone, in the body's axes, (..., k, 3) [m]."""

    def products(self, q_t: Array) -> Array | None:
        """Products of angular velocities by velocities q_t, (..., 6) [rad2/s2], in the order of `inertia.PAIRS`.

        They make the body grow. None if the growth is not known, or the frame does not turn.
        """

    def grown(self, q_t: Array) -> Array | None:
        """Displacements of the nodes by centrifugal forces beyond the coordinates, (..., k, 3) [m], in the body's axes.

        They are in `place` only if that gets their products.
        """

    def velocities(self, q: Array, q_t: Array) -> Array:
        """Velocities of the nodes, (..., k, 3) [m/s]."""

    def mean_velocity(self, q: Array, q_t: Array, point: Array) -> Array:
        """Velocity at a point in space, (3,) [m], of a rigid body with the same momenta, (..., 3) [m/s]."""

    def in_frame(self, q: Array, directions: Array) -> Array:
        """Directions in space, (m, 3), in the body's axes."""

    def on_coordinates(self, q: Array, rows: sp.csr_matrix) -> Array | sp.csr_matrix:
        """Rows on the coordinates' velocities, (m, n_dofs), of rows on the nodes' velocities, (m, 3k)."""

    def generalised(self, q: Array, forces: Array) -> Array:
        """Generalised forces, (n_dofs,), of forces on the nodes, (k, 3) [N]."""

    def accelerations(self, q: Array, forces: Array | sp.csr_matrix) -> Array | sp.csr_matrix:
        """Accelerations, (n_dofs, m), by generalised forces, (n_dofs, m); sparse ones only if `linear`."""

    def weight(self, gravity: Array) -> Array:
        """Generalised forces, (n_dofs,), of an acceleration of gravity, (3,) [m/s2]."""

    def proportional_force(self, q: Array, alpha: float, beta: float) -> Array:
        """Generalised forces (alpha M + beta K) of the deformation in coordinates or velocities q, (..., n_dofs)."""

    def proportional_matrix(self, alpha: float, beta: float) -> sp.csr_matrix:
        """(n_dofs, n_dofs): alpha M + beta K; of an inertial frame, rigid motion included."""

    @property
    def mass_integral(self) -> Array:
        """Linear momentum by velocities of the coordinates within the frame, (3, n)."""

    def momentum(self, q_t: Array) -> Array:
        """Linear momentum, (..., 3) [N s]."""

    def angular_momentum(self, q: Array, q_t: Array, point: Array) -> Array:
        """Angular momentum about a point in space, (3,) [m], (..., 3) [N m s]."""

    def kinetic_energy(self, q: Array, q_t: Array) -> Array:
        """Kinetic energy, (...,) [J]."""


def node_fields(rows: Array | sp.csr_matrix, q: Array) -> Array:
    """Vectors at k nodes, (..., k, 3), by rows (3k, n) of the coordinates q, (..., n)."""
    if q.ndim == 1:
        return np.asarray(rows @ q).reshape(-1, 3)
    return np.asarray((rows @ q.T).T).reshape(*q.shape[:-1], -1, 3)
