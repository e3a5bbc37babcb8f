"""Coordinates of a body's deformation, apart from its rigid motion: mean axes.

Motion q of a basis with diagonal mass M splits into q = R r + E z, rigid motion and deformation, R' M E = 0. Mean axes
(Agrawal and Shabana 1985) are those in which all deformation is of that kind. Here E' M E = 1, so that z has unit mass.

In scaled coordinates M^1/2 q, with X the orthonormal rigid motion there, E is what the block reflector

    H = 1 - V (1 + P)^-1 V',    V = X + [U; 0],    X_1 = U P (polar decomposition of X's first six rows),

leaves of the identity without its first six columns (Schreiber and Parlett 1988): H takes those onto rigid motion, and
the others stay what they are but for a motion of rank six. Where six rigid shapes stand first, E is the identity below
them.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..support.arrays import Array


class MeanAxes:
    """E of a basis, as an operator.

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

    def of(self, q: Array) -> Array:
        """Deformation z = E' M q, (..., n - 6), of any motion q, (..., n)."""
        return self.restrict(q / self._inverse_root**2)
