"""Coordinates of a body's deformation, apart from its rigid motion: mean axes.

A motion q of a basis with diagonal mass M is split into rigid motion and deformation, q = R r + E z with R' M E = 0.
Axes in which the deformation has this property are mean axes (Agrawal and Shabana 1985). Here E' M E = 1, so z has unit
mass.

Let X be the orthonormal rigid motion in the scaled coordinates M^1/2 q. There, E consists of all columns but the first
six of the block reflector

    H = 1 - V (1 + P)^-1 V',    V = X + [U; 0],    X_1 = U P (polar decomposition of X's first six rows),

(Schreiber and Parlett 1988). H maps the first six columns of the identity onto rigid motion, and changes the others by
a matrix of rank six. If six rigid shapes stand first, E is the identity below them.

Theory: examples/site/theory.md, "Floating frame".
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..support.arrays import Array


class MeanAxes:
    """The matrix E of a basis, applied without being formed.

    Parameters
    ----------
    mass : (n,) array
        Diagonal of the reduced mass matrix.
    rigid : (n, 6) array
        Coordinates of rigid motion.
    """

    def __init__(self, mass: Array, rigid: Array) -> None:
        self._inverse_root = 1 / np.sqrt(mass)
        X = np.linalg.qr(rigid / self._inverse_root[:, None])[0]
        U, P = scipy.linalg.polar(X[:6])
        V = X.copy()
        V[:6] += U
        self._tail, self._reflected = V[6:], np.linalg.solve(np.eye(6) + P, V.T)

    def expand(self, z: Array) -> Array:
        """Coordinates q = E z of the basis, (..., n), of deformation z, (..., n - 6)."""
        q: Array = -(z @ self._tail) @ self._reflected
        q[..., 6:] += z
        q *= self._inverse_root
        return q

    def restrict(self, rows: Array) -> Array:
        """Rows on z, (..., n - 6), of rows on q, (..., n); generalised forces likewise."""
        rows = rows * self._inverse_root
        on_z: Array = rows[..., 6:] - (rows @ self._reflected.T) @ self._tail.T
        return on_z

    def deformation(self, q: Array) -> Array:
        """Deformation z = E' M q, (..., n - 6), of any motion q, (..., n)."""
        return self.restrict(q / self._inverse_root**2)
