"""The impact of two bodies, or of one and something rigid, of their rows, shapes and residual flexibilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..algebra.coulomb import Coulomb
from ..support.arrays import Array
from .modal_impact import Impact, ObliqueImpact


@dataclass(frozen=True, eq=False)
class ImpactSide:
    """A body in an impact, in its own coordinates.

    Parameters
    ----------
    directed : (nr, 3 np) csr matrix
        From displacements of the patch's nodes to gaps of the rows.
    plain : (nr, np) csr matrix
        The same without directions: from values at the nodes to those at the rows.
    shapes : (3 np, n) array
        Displacements of the patch's nodes by the coordinates.
    flexibility : (3 np, 3 np) or (np, np) array
        Residual flexibility of the patch in all directions, or along its normal [m/N].
    omega : (n,) array
        [rad/s], zero for rigid motion.
    """

    directed: sp.csr_matrix
    plain: sp.csr_matrix
    shapes: Array
    flexibility: Array
    omega: Array

    @property
    def gaps(self) -> Array:
        """Gaps of the rows by the coordinates, (nr, n)."""
        return np.asarray(self.directed @ self.shapes)

    @property
    def residual(self) -> Array:
        """Residual flexibility at the rows, (nr, nr) [m/N]."""
        all_directions = len(self.flexibility) == self.directed.shape[1]
        to_rows = self.directed if all_directions else self.plain
        return np.asarray(to_rows @ self.flexibility @ to_rows.T)


def impact_between(
    sides: Sequence[ImpactSide],
    gap: Array,
    approach: Array,
    velocity: Array,
    size: float,
    friction: Coulomb | None = None,
) -> Impact:
    """The impact of one or two bodies, of which the first one moves.

    Parameters
    ----------
    sides : sequence of ImpactSide
        Slave and master; the slave alone on something rigid.
    gap : (nr,) array
        [m]; the bodies are moved along the line of contact until they touch.
    approach : (3,) array
        Line of contact, from the slave to the other.
    velocity : (n,) array
        Initial velocities of the first body's coordinates.
    size : float
        Of the slave's facets [m].
    friction : Coulomb, optional
        With it, flexibilities are those of all directions.
    """
    omega = np.concatenate([side.omega for side in sides])
    start = np.zeros(len(omega))
    start[: len(velocity)] = velocity
    H, F = np.hstack([side.gaps for side in sides]), np.sum([side.residual for side in sides], axis=0)
    normal = gap - gap.min(), H, F, omega, start, size
    if friction is None:
        return Impact(*normal)
    along = [
        sp.kron(sign * side.plain, tangents(approach), format="csr") for sign, side in zip((1, -1), sides, strict=False)
    ]
    order, F_all = _interleaved(len(gap)), np.zeros((3 * len(gap), 3 * len(gap)))
    for rows, side in zip(along, sides, strict=True):
        every = sp.vstack([side.directed, rows], format="csr")[order]
        F_all += every @ side.flexibility @ every.T
    H_t = np.hstack([rows @ side.shapes for rows, side in zip(along, sides, strict=True)])
    return ObliqueImpact(*normal, H_t, F_all, friction)


def tangents(approach: Array) -> Array:
    """Two directions across the line of contact, (2, 3)."""
    value: Array = np.linalg.svd(approach[None])[2][1:]
    return value


def _interleaved(n: int) -> Array:
    """Where normal and tangents of each of n rows are among n normals and n pairs of tangents, (3 n,)."""
    value: Array = np.column_stack([np.arange(n), n + 2 * np.arange(n), n + 2 * np.arange(n) + 1]).ravel()
    return value
