"""Inertia of a deformable body in a floating frame: integrals over the body of products of two fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..fe.model import FEModel, MassKind
from ..support.arrays import Array
from ..support.checks import check_floats, read_only

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # order of the six blocks of `InertiaIntegrals.inertia`

PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # of component a, b among them


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Integrals over the body of products of two fields: field 0 is the place X - c, the others are the n shapes.

    Parameters
    ----------
    inertia : (6, 1 + n, 1 + n) array
        Components xx, yy, zz, yz, xz, xy of psi_i . psi_j 1 - psi_i psi_j', symmetrised. For i = j = 0 that is the
        inertia tensor of the undeformed body about its centre of mass [kg m2].
    cross : (3, n, n) array
        Components x, y, z of psi_i x psi_j, of shapes only: with the place it is zero in mean axes.
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
        cls, fem: FEModel, shapes: Array, mass: MassKind = "consistent", nodal: Sequence[int] | Array = ()
    ) -> InertiaIntegrals:
        """Integrals with the mass of an FE model, which must be the same in all three directions.

        Parameters
        ----------
        fem : FEModel
        shapes : (3N, n) array
            Orthogonal to rigid motion, or zero at `nodal`.
        mass : {"consistent", "lumped"}
        nodal : (k,) int array
            Nodes whose mass is left out. The mass must then be lumped.
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

    @cached_property
    def tensor(self) -> Array:
        """(3, 3) array: inertia of the undeformed body about its centre of mass [kg m2]."""
        tensor: Array = self.inertia[:, 0, 0][PLACE]
        return tensor

    def turned(self, axes: Array) -> InertiaIntegrals:
        """Integrals by components along other axes, the columns of (3, 3)."""
        components = np.einsum("ai,bj,abmn->ijmn", axes, axes, self.inertia[PLACE])
        return InertiaIntegrals(
            np.array([components[pair] for pair in PAIRS]), np.einsum("ai,amn->imn", axes, self.cross)
        )

    def of_place(self, z: Array) -> tuple[Array, Array]:
        """J(z), (3, 3), and C(z), (3, n), of the angular momentum J omega + C z_t, at elastic coordinates z, (n,)."""
        place = np.concatenate([[1.0], z])
        return ((self.inertia @ place) @ place)[PLACE], -(self.cross @ z)

    def products(self, z: Array, z_t: Array) -> tuple[Array, Array, Array, Array]:
        """Half the derivative of J's components by z (6, n), J (3, 3), C (3, n) and the cross integrals with z_t."""
        place = np.concatenate([[1.0], z])
        by_place = self.inertia @ place
        return by_place[:, 1:], (by_place @ place)[PLACE], -(self.cross @ z), self.crossed(z_t)

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
        """C(z) z_t, (..., 3): the part of the angular momentum that comes from vibration alone."""
        return forms(self.cross, z, z_t)

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
        J = forms(self.inertia, place, place)[..., PLACE]
        momentum: Array = np.einsum("...ab,...b->...a", J, omega) + self.spin(z, z_t)
        return momentum

    def kinetic_energy(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Kinetic energy without that of the centre of mass, (...,) [J]; arguments as for `angular_momentum`."""
        momentum = self.angular_momentum(omega, z, z_t) + self.spin(z, z_t)
        energy: Array = (np.sum(omega * momentum, axis=-1) + np.sum(z_t**2, axis=-1)) / 2
        return energy


def forms(matrices: Array, x: Array, y: Array) -> Array:
    """Bilinear forms x' A y of k matrices, (..., k)."""
    return np.stack([np.sum((x @ A) * y, axis=-1) for A in matrices], axis=-1)
