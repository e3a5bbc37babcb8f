"""Inertia of a deformable body in mean axes, as equations of motion ask for it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..support.arrays import Array


class Inertia(Protocol):
    """Inertia of a deformation z, (n,), of unit mass: `reduction.inertia.InertiaIntegrals` or `NodalInertia`."""

    @property
    def tensor(self) -> Array:
        """(3, 3) array: inertia of the undeformed body about its centre of mass [kg m2]."""

    def turned(self, axes: Array) -> Inertia:
        """Inertia by components along other axes, the columns of (3, 3)."""

    def products(self, z: Array, z_t: Array) -> tuple[Array, Array, Array, Array]:
        """Half the derivative of J's components by z (6, n), J (3, 3), C (3, n) and the cross integrals with z_t."""

    def of_place(self, z: Array) -> tuple[Array, Array]:
        """J(z), (3, 3), and C(z), (3, n), of the angular momentum J omega + C z_t."""

    def crossed(self, z: Array) -> Array:
        """Cross integrals of all shapes with the field of z, (3, n)."""

    def by_shapes(self, z: Array) -> Array:
        """Part of half the derivative of J's components by z, (6, n), that is linear in z."""

    def inertia_form(self, weights: Array) -> Array:
        """Integrals of products of two shapes, (n, n), in the six components with weights (6,)."""

    def cross_form(self, omega: Array) -> Array:
        """Integrals of omega . (psi_i x psi_j), (n, n), for a vector omega, (3,)."""

    def angular_momentum(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Angular momentum about the centre of mass in the body's axes, (..., 3) [N m s]."""

    def kinetic_energy(self, omega: Array, z: Array, z_t: Array) -> Array:
        """Kinetic energy but for that of the centre of mass, (...,) [J]."""


def angular_acceleration(J: Array, C: Array, torque: Array, force: Array) -> Array:
    """Angular acceleration, (3, ...), of a deformable body of unit modal mass, about its centre of mass.

    Its momenta are J omega + C z_t and C' omega + z_t, so that the elastic accelerations are force - C' omega_t.

    Parameters
    ----------
    J, C : (3, 3), (3, n) arrays
        See `Inertia.of_place`.
    torque, force : (3, ...), (n, ...) arrays
        Torque about the centre of mass in the body's axes, and forces on the elastic coordinates.
    """
    return np.asarray(np.linalg.solve(J - C @ C.T, torque - C @ force))
