"""Inertia of a deformable body in a floating frame: mean axes at the centre of mass.

With x = r + A (X - c + Phi z), shapes Phi mass-normalised and orthogonal to rigid motion, the kinetic energy is

    T = m r_t^2 / 2 + omega' J(z) omega / 2 + omega' C(z) z_t + z_t' z_t / 2,

angular velocity omega and all else but r in the body's axes. J is quadratic and C linear in z, so that integrals over
the body of products of two shapes hold all of it. Lagrange's equations, with the outer forces (tau, f):

    J(z) omega_t + C(z) z_tt  = tau - omega x (J(z) omega + C(z) z_t) - J_t omega
    z_tt + C(z)' omega_t + K z = f + d(omega' J(z) omega)/dz / 2 + 2 (omega . N) z_t

Shabana, Dynamics of Multibody Systems (2013), chapter 5; mean axes: Agrawal and Shabana (1985).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ._checks import check_floats, read_only
from .fem import FEModel

if TYPE_CHECKING:
    from .nodal_inertia import NodalInertia

Array = np.ndarray

TERMS = {
    "gyroscopic": "gyroscopic torque omega x J omega: the axis of rotation stays where it is in the body",
    "coriolis": "Coriolis forces of vibration and rotation on each other",
    "centrifugal": "centrifugal forces: rotation does not stretch the body",
    "coupling": "inertia that changes with deformation, but for that of gyroscopic, Coriolis and centrifugal forces",
}
"""Inertia forces of a floating frame, and what a body is without each."""

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # order of the six blocks of `InertiaIntegrals.inertia`
_SKEW = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)  # of the three axes
_PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # of component a, b among them


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Integrals over the body of products of two displacement fields; field 0 is the place X - c, then the n shapes.

    Parameters
    ----------
    inertia : (6, 1 + n, 1 + n) array
        Components xx, yy, zz, yz, xz, xy of psi_i . psi_j 1 - psi_i psi_j', symmetrised; the integral for i = j = 0 is
        the inertia tensor of the undeformed body about its centre of mass [kg m2].
    cross : (3, n, n) array
        Components x, y, z of psi_i x psi_j, shapes only: mean axes let it vanish for the place.
    """

    inertia: Array
    cross: Array

    def __post_init__(self) -> None:
        check_floats("cross", self.cross, (3, None, None))
        n = self.cross.shape[1]
        check_floats("cross", self.cross, (3, n, n))
        check_floats("inertia", self.inertia, (6, 1 + n, 1 + n))
        read_only(self.inertia, self.cross)

    @classmethod
    def of(
        cls, fem: FEModel, shapes: Array, mass: str = "consistent", nodal: Sequence[int] | Array = ()
    ) -> InertiaIntegrals:
        """Integrals by a mass that weighs the three directions alike.

        Parameters
        ----------
        fem : FEModel
        shapes : (3N, n) array
            Orthogonal to rigid motion, or zero at `nodal`.
        mass : {"consistent", "lumped"}
        nodal : (k,) int array
            Nodes whose mass is left out; it must be lumped.
        """
        weights = fem.mass[::3, ::3] if mass == "consistent" else sp.diags(fem.lumped_mass)
        arms = fem.points - fem.centre_of_mass
        arms[nodal] = 0.0
        fields = [np.column_stack([arms[:, a], shapes[a::3]]) for a in range(3)]
        weighted = [weights @ field for field in fields]
        xx, yy, zz, yz, xz, xy = (fields[a].T @ weighted[b] for a, b in PAIRS)
        products = np.array([-(G + G.T) / 2 for G in (yz, xz, xy)])
        cross = np.array([yz - yz.T, xz.T - xz, xy - xy.T])
        return cls(np.concatenate([[yy + zz, xx + zz, xx + yy], products]), np.ascontiguousarray(cross[:, 1:, 1:]))

    @property
    def tensor(self) -> Array:
        """(3, 3) array: inertia of the undeformed body about its centre of mass [kg m2]."""
        return self.inertia[:, 0, 0][_PLACE]

    def turned(self, axes: Array) -> InertiaIntegrals:
        """Integrals by components along other axes, the columns of (3, 3)."""
        components = np.einsum("ai,bj,abmn->ijmn", axes, axes, self.inertia[_PLACE])
        return InertiaIntegrals(
            np.array([components[pair] for pair in PAIRS]), np.einsum("ai,amn->imn", axes, self.cross)
        )

    def of_place(self, z: Array) -> tuple[Array, Array]:
        """J(z), (3, 3), and C(z), (3, n), of the angular momentum J omega + C z_t, at elastic coordinates z, (n,)."""
        place = np.concatenate([[1.0], z])
        return ((self.inertia @ place) @ place)[_PLACE], -(self.cross @ z)

    def products(self, z: Array, z_t: Array) -> tuple[Array, Array, Array, Array]:
        """Half the derivative of J's components by z (6, n), J (3, 3), C (3, n) and the cross integrals with z_t."""
        place = np.concatenate([[1.0], z])
        by_place = self.inertia @ place
        return by_place[:, 1:], (by_place @ place)[_PLACE], -(self.cross @ z), self.crossed(z_t)

    def crossed(self, z: Array) -> Array:
        """Cross integrals of all shapes with the field of z, (3, n)."""
        return self.cross @ z

    def by_shapes(self, z: Array) -> Array:
        """Part of half the derivative of J's components by z, (6, n), that is linear in z, (n,)."""
        return self.inertia[:, 1:, 1:] @ z

    def inertia_form(self, weights: Array) -> Array:
        """Integrals of products of two shapes, (n, n), in the six components with weights (6,)."""
        return np.tensordot(weights, self.inertia[:, 1:, 1:], 1)

    def cross_form(self, omega: Array) -> Array:
        """Integrals of omega . (psi_i x psi_j), (n, n), for a vector omega, (3,)."""
        return np.tensordot(omega, self.cross, 1)

    def spin(self, z: Array, z_t: Array) -> Array:
        """C(z) z_t, the part of the angular momentum that vibration has by itself, (..., 3)."""
        return _forms(self.cross, z, z_t)

    def angular_momentum(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Angular momentum about the centre of mass in the body's axes, J(z) omega + C(z) z_t, (..., 3) [N m s].

        Parameters
        ----------
        omega : (..., 3) array
            Angular velocity in the body's axes [rad/s].
        z, z_t : (..., n) array
            Elastic coordinates and their velocities.
        """
        place = np.concatenate([np.ones((*z.shape[:-1], 1)), z], axis=-1)
        J = _forms(self.inertia, place, place)[..., _PLACE]
        return np.einsum("...ab,...b->...a", J, omega) + self.spin(z, z_t)

    def kinetic_energy(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Kinetic energy but for that of the centre of mass, (...,) [J]; arguments as for `angular_momentum`."""
        momentum = self.angular_momentum(omega, z, z_t) + self.spin(z, z_t)
        return (np.sum(omega * momentum, axis=-1) + np.sum(z_t**2, axis=-1)) / 2


class InertiaForces:
    """Inertia forces on constant mass diag(J, 1): what a solver is given instead of the equations above.

    Mass that changes with deformation would have to be factorised in every step. Instead the accelerations that the
    true mass gives to inertia and elastic forces are computed here, by a 3 x 3 solve as the elastic mass is the
    identity, and returned times the constant mass. Outer forces, which are not known here, act on the constant mass:
    they lack the change of inertia, which is of the relative size of the deformation.

    Parameters
    ----------
    integrals : InertiaIntegrals or nodal_inertia.NodalInertia
    elastic : callable
        Elastic forces K z, (n,), of the elastic coordinates z, (n,).
    terms : collection of str
        Those of `TERMS` to be kept.
    """

    def __init__(
        self,
        integrals: InertiaIntegrals | NodalInertia,
        elastic: Callable[[Array], Array],
        terms: Collection[str] = tuple(TERMS),
    ) -> None:
        self.tensor, self._integrals = integrals.tensor, integrals
        self.elastic = elastic
        self.gyroscopic, self.coriolis, self.centrifugal, self.coupling = (name in terms for name in TERMS)

    def coriolis_force(self, omega: Array, z_t: Array) -> Array:
        """Coriolis forces on the elastic coordinates, (n,)."""
        return 2 * (omega @ self._integrals.crossed(z_t)) if self.coriolis else np.zeros_like(z_t)

    def force(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Torque in the body's axes [N m] and forces on the elastic coordinates, (3 + n,).

        Parameters
        ----------
        omega : (3,) array
            Angular velocity in the body's axes [rad/s].
        z, z_t : (n,) array
            Elastic coordinates and their velocities.
        """
        by_place, J, C, cross_t = self._integrals.products(z, z_t)
        torque, force, turn = np.zeros(3), np.zeros(len(z)), skew(omega)
        if self.gyroscopic:
            torque -= turn @ (J @ omega)
        if self.coriolis:
            J_t = 2 * (by_place @ z_t)[_PLACE]
            torque -= turn @ (C @ z_t) + J_t @ omega
            force += 2 * (omega @ cross_t)
        if self.centrifugal:
            force += _products(omega) @ by_place
        if self.coupling:
            omega_t = np.linalg.solve(J - C @ C.T, torque - C @ (force - self.elastic(z)))
            torque, force = self.tensor @ omega_t, force - C.T @ omega_t
        return np.concatenate([torque, force])

    def derivatives(self, omega: Array, z: Array, z_t: Array) -> tuple[Array, Array]:
        """Derivatives of `force` by z, (3 + n, n), and by omega and z_t, (3 + n, 3 + n).

        Those of the coupling are left out: second order in deformation, for Newton's method only.
        """
        by_place, J, C, cross_t = self._integrals.products(z, z_t)
        n = len(z)
        by_z, by_velocity = np.zeros((3 + n, n)), np.zeros((3 + n, 3 + n))
        turn, J_omega = skew(omega), by_place[_PLACE].transpose(0, 2, 1) @ omega  # d(J omega)/dz = 2 J_omega
        if self.gyroscopic:
            by_z[:3] -= 2 * turn @ J_omega
            by_velocity[:3, :3] += skew(J @ omega) - turn @ J
        if self.coriolis:
            J_t = 2 * (by_place @ z_t)[_PLACE]
            by_shape_t = self._integrals.by_shapes(z_t)[_PLACE].transpose(0, 2, 1) @ omega
            by_z[:3] -= turn @ cross_t + 2 * by_shape_t
            by_velocity[:3, :3] += skew(C @ z_t) - J_t
            by_velocity[:3, 3:] -= turn @ C + 2 * J_omega
            by_velocity[3:, :3] += 2 * cross_t.T
            by_velocity[3:, 3:] += 2 * self._integrals.cross_form(omega)
        if self.centrifugal:
            by_velocity[3:, :3] += 2 * J_omega.T
            by_z[3:] += self._integrals.inertia_form(_products(omega))
        return by_z, by_velocity


def skew(v: Array) -> Array:
    """Matrix of v x, (..., 3, 3), of vectors (..., 3)."""
    return (v @ _SKEW).reshape(*v.shape, 3)


def rotation_matrix(v: Array) -> Array:
    """Rotation matrices, (..., 3, 3), of rotation vectors (..., 3) [rad]."""
    half = np.linalg.norm(v, axis=-1)[..., None, None] / (2 * np.pi)
    turn = skew(v)
    return np.eye(3) + np.sinc(2 * half) * turn + np.sinc(half) ** 2 / 2 * (turn @ turn)


def _forms(matrices: Array, x: Array, y: Array) -> Array:
    """Bilinear forms x' A y of k matrices, (..., k)."""
    return np.stack([np.sum((x @ A) * y, axis=-1) for A in matrices], axis=-1)


def _products(omega: Array) -> Array:
    """Weights of the six components in omega' J omega."""
    a, b, c = omega
    return np.array([a * a, b * b, c * c, 2 * b * c, 2 * a * c, 2 * a * b])
