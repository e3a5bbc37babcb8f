"""Inertia in a floating frame of a body that keeps nodes: point masses, beside the integrals of its shapes.

In the paper's basis the shapes are zero at the kept nodes, and the mass is lumped. So what `InertiaIntegrals` holds as
dense matrices is a sum over point masses for these nodes, as in the paper (eq. 8a, 8b). For the equations of motion see
module `inertia_forces`.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..reduction.inertia import PAIRS, InertiaIntegrals
from ..support.arrays import Array
from .mean_axes import MeanAxes
from .rotations import skew

_MOMENTS = np.zeros((6, 3, 3))  # J's components of a unit mass at p are p' D p
for _component, (_a, _b) in zip(_MOMENTS, PAIRS, strict=True):
    _component[_a, _b] -= 0.5
    _component[_b, _a] -= 0.5
    if _a == _b:
        _component += np.eye(3)


class NodalInertia:
    """Inertia of shapes and kept nodes together, as an `Inertia` of the deformation z of mean axes.

    Parameters
    ----------
    integrals : InertiaIntegrals
        Of the n_shapes shapes, over the region without kept nodes.
    masses : (k,) array
        Of the kept nodes [kg].
    arms : (k, 3) array
        From the centre of mass to them, along `axes` [m].
    mean_axes : MeanAxes
        From z to shape coordinates and the displacements of the kept nodes.
    axes : (3, 3) array
        Axes, as columns, of all components, in those of the body.
    """

    def __init__(
        self, integrals: InertiaIntegrals, masses: Array, arms: Array, mean_axes: MeanAxes, axes: Array
    ) -> None:
        self._integrals, self._masses, self._arms = integrals, masses, arms
        self._mean_axes, self._axes = mean_axes, axes
        self.tensor: Array = integrals.tensor + self._moments(masses[:, None] * arms, arms)

    def turned(self, axes: Array) -> NodalInertia:
        """Inertia by components along other axes, the columns of (3, 3)."""
        return NodalInertia(
            self._integrals.turned(axes), self._masses, self._arms @ axes, self._mean_axes, self._axes @ axes
        )

    def products(self, z: Array, z_t: Array) -> tuple[Array, Array, Array, Array]:
        """See `InertiaIntegrals.products`."""
        (s, w), (s_t, w_t) = self._parts(z), self._parts(z_t)
        by_shapes, J, C, cross_t = self._integrals.products(s, s_t)
        weighted = self._masses[:, None] * (self._arms + w)
        return (
            self._restricted(by_shapes, weighted @ _MOMENTS),
            J + self._moments(weighted, self._arms + w),
            self._restricted(C, self._turned_by(w)),
            self._restricted(cross_t, -self._turned_by(w_t)),
        )

    def crossed(self, z: Array) -> Array:
        """See `InertiaIntegrals.crossed`."""
        s, w = self._parts(z)
        return self._restricted(self._integrals.crossed(s), -self._turned_by(w))

    def by_shapes(self, z: Array) -> Array:
        """See `InertiaIntegrals.by_shapes`."""
        s, w = self._parts(z)
        return self._restricted(self._integrals.by_shapes(s), (self._masses[:, None] * w) @ _MOMENTS)

    def of_place(self, z: Array) -> tuple[Array, Array]:
        """See `InertiaIntegrals.of_place`."""
        s, w = self._parts(z)
        (J, C), place = self._integrals.of_place(s), self._arms + w
        return J + self._moments(self._masses[:, None] * place, place), self._restricted(C, self._turned_by(w))

    def inertia_form(self, weights: Array) -> Array:
        """See `InertiaIntegrals.inertia_form`."""
        return self._form(self._integrals.inertia_form(weights), np.tensordot(weights, _MOMENTS, 1))

    def cross_form(self, omega: Array) -> Array:
        """See `InertiaIntegrals.cross_form`."""
        return self._form(self._integrals.cross_form(omega), -skew(omega))

    def angular_momentum(self, omega: Array, z: Array, z_t: Array) -> Array:
        """See `InertiaIntegrals.angular_momentum`."""
        (s, w), (s_t, w_t) = self._parts(z), self._parts(z_t)
        place = self._arms + w
        of_nodes = np.cross(place, np.cross(omega[..., None, :], place)) + np.cross(w, w_t)
        momentum: Array = self._integrals.angular_momentum(omega, s, s_t) + self._masses @ of_nodes
        return momentum

    def kinetic_energy(self, omega: Array, z: Array, z_t: Array) -> Array:
        """See `InertiaIntegrals.kinetic_energy`."""
        (s, w), (s_t, w_t) = self._parts(z), self._parts(z_t)
        of_nodes = self._integrals.spin(s, s_t) + self._masses @ np.cross(w, w_t)
        of_spin = np.sum(omega * (self.angular_momentum(omega, z, z_t) + of_nodes), axis=-1)
        energy: Array = (of_spin + np.sum(z_t**2, axis=-1)) / 2
        return energy

    def _parts(self, z: Array) -> tuple[Array, Array]:
        """Shape coordinates, (..., n_shapes), and displacements of the kept nodes, (..., k, 3), along `axes`."""
        q = self._mean_axes.expand(z)
        nodal = q[..., self._n_shapes :].reshape(*z.shape[:-1], -1, 3)
        return q[..., : self._n_shapes], nodal @ self._axes

    @property
    def _n_shapes(self) -> int:
        return int(self._integrals.cross.shape[1])

    def _restricted(self, on_shapes: Array, on_nodes: Array) -> Array:
        """Rows on z, (m, n - 6), of rows on shapes, (m, n_shapes), and on kept nodes along `axes`, (m, k, 3)."""
        on_nodes = (on_nodes @ self._axes.T).reshape(len(on_shapes), -1)
        return self._mean_axes.restrict(np.hstack([on_shapes, on_nodes]))

    def _form(self, of_shapes: Array, of_unit_mass: Array) -> Array:
        """Bilinear form on z, (n - 6, n - 6), of that on shapes and that of a unit mass at a node, (3, 3)."""
        of_nodes = self._axes @ of_unit_mass @ self._axes.T
        form = scipy.linalg.block_diag(of_shapes, np.kron(np.diag(self._masses), of_nodes))
        return self._mean_axes.restrict(self._mean_axes.restrict(form).T).T

    def _turned_by(self, w: Array) -> Array:
        """Matrices of m w x, (3, k, 3), of the kept nodes' displacements, (k, 3)."""
        return skew(self._masses[:, None] * w).swapaxes(0, 1)

    @staticmethod
    def _moments(weighted: Array, place: Array) -> Array:
        """Inertia tensor, (3, 3), of masses at places, (k, 3), given also times the masses."""
        products = weighted.T @ place
        moments: Array = np.trace(products) * np.eye(3) - products
        return moments
