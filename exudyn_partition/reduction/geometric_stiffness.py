"""Geometric stiffness of a reduced body: how stress from its loads stiffens or softens it, and energy to third order.

The stress of unit loads, sigma_k, does work on the product of displacement gradients, so that

    G_k = T' (integral of sigma_k : grad u' grad v) T .

Of a body that keeps the motion of its patches only slow motion counts: rigid motion, modes and static answers. The
rest of its motion are dents, to which stress adds nothing, as it adds nothing to the residual flexibility of others.

Module `stress_states` has the m states of stress sigma_k, which are of unit energy and orthogonal to each other. The
coordinates q stress the body by amplitudes a = S q, and a load f by S K^+ f.

The amplitudes of a run come from the deformation, not from the loads, which a body does not know (joints). With the
stretch s_k = q' G_k q / 2 that rotation of parts of the body adds, the strain energy is

    U = q' K q / 2 + a . s + s . s / 2 = q' (K - S' S) q / 2 + |a + s|^2 / 2 .

It is never negative. In equilibrium a + s are the amplitudes of the loads, whatever the body's deflection: K plus their
geometric stiffness is what remains for small motion. SID files and Wallrapp and Schwertassek have the same matrices.

O. Wallrapp, R. Schwertassek, Representation of geometric stiffening in multibody system simulation, 1991.

Theory: examples/site/theory.md, "Geometric stiffness".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from ..support.checks import check_floats, read_only


@dataclass(frozen=True, eq=False)
class GeometricStiffness:
    """States of stress of a body, and the geometric stiffness of each.

    Parameters
    ----------
    states : (m, k) array
        S, amplitudes of the states by k motions; the energy of an amplitude a is a^2 / 2.
    matrices : (m, k, k) array
        G_k of unit amplitudes.
    onto : (k, n_dofs) array, optional
        The motions by the coordinates of the body. Default: they are the coordinates.
    """

    states: Array
    matrices: Array
    onto: Array | None = None

    def __post_init__(self) -> None:
        check_floats("states", self.states, (None, None))
        m, k = self.states.shape
        check_floats("matrices", self.matrices, (m, k, k))
        for name in ("states", "matrices"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))
        if self.onto is not None:
            check_floats("onto", self.onto, (k, None))
            read_only(self.onto)
        read_only(self.states, self.matrices)

    @property
    def n_dofs(self) -> int:
        """Number of coordinates of the body."""
        return int((self.states if self.onto is None else self.onto).shape[1])

    def of_answer(self, q: Array) -> Array:
        """Geometric stiffness, (n_dofs, n_dofs), of the stress in a static answer q, (n_dofs,), to first order."""
        return self.matrix_on_coordinates(np.tensordot(self.states @ self.motion(q), self.matrices, 1))

    def without_rigid(self, restrict: Callable[[Array], Array]) -> GeometricStiffness:
        """The same for deformation alone, in mean axes: `restrict` returns rows on it of rows on the coordinates."""
        if self.onto is None:  # six rigid shapes stand first
            return GeometricStiffness(self.states[:, 6:], self.matrices[:, 6:, 6:])
        return GeometricStiffness(self.states, self.matrices, restrict(self.onto))

    def force(self, q: Array) -> Array:
        """Generalised forces, (n_dofs,), beside K q, that oppose the deformation."""
        return self.on_coordinates(self.force_on_motion(self.motion(q)))

    def tangent(self, q: Array) -> Array:
        """Derivative of `force`, (n_dofs, n_dofs)."""
        return self.matrix_on_coordinates(self.tangent_on_motion(self.motion(q)))

    def force_on_motion(self, motion: Array) -> Array:
        """The same as `force` for the motions, (k,)."""
        amplitudes, stretch, turned = self._answer(motion)
        force: Array = amplitudes @ turned + stretch @ self.states
        return force

    def tangent_on_motion(self, motion: Array) -> Array:
        """Derivative of `force_on_motion`, (k, k)."""
        amplitudes, _, turned = self._answer(motion)
        mixed = self.states.T @ turned
        tangent: Array = np.tensordot(amplitudes, self.matrices, 1) + mixed + mixed.T + turned.T @ turned
        return tangent

    def energy(self, q: Array) -> Array:
        """Strain energy beside q' K q / 2, (...) [J], of coordinates (..., n_dofs)."""
        motion = self.motion(q)
        stretch = np.einsum("...i,kij,...j->...k", motion, self.matrices, motion, optimize=True) / 2
        energy: Array = np.sum((motion @ self.states.T + stretch / 2) * stretch, axis=-1)
        return energy

    def motion(self, q: Array) -> Array:
        """Motions, (..., k), by coordinates (..., n_dofs)."""
        return q if self.onto is None else q @ self.onto.T

    def on_coordinates(self, force: Array) -> Array:
        """Force on the coordinates, (n_dofs,), of one on the motions, (k,)."""
        return force if self.onto is None else force @ self.onto

    def matrix_on_coordinates(self, matrix: Array) -> Array:
        """Matrix on the coordinates, (n_dofs, n_dofs), of one on the motions, (k, k)."""
        return np.asarray(matrix if self.onto is None else self.onto.T @ matrix @ self.onto)

    def _answer(self, motion: Array) -> tuple[Array, Array, Array]:
        """Amplitudes a + s, (m,), their part s, (m,), and each matrix times the motion, (m, k)."""
        turned = self.matrices @ motion
        stretch = turned @ motion / 2
        return self.states @ motion + stretch, stretch, turned
