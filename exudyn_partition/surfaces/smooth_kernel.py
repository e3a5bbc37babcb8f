"""A smooth pressure around a point of a patch, as forces on its nodes: load and average of a contact at a point.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from ..fe.shapes import QUADS, shape_functions
from ..support.arrays import Array

_FINE = 12  # parts of a facet's edge for the integrals over it
_WHOLE = 2 / 3 * np.pi  # integral of sqrt(1 - r^2) over the unit disc
_DETERMINED = 1e-6  # determinant of two equations by their squared trace, above which both unknowns are determined
_NEVER = 1e-6  # share of a kernel on the patch, below which there is none


@dataclass(frozen=True, eq=False)
class Kernel:
    """Shares of a unit force on nodes of a patch, from the pressure sqrt(1 - r^2 / s^2) around a point.

    Parameters
    ----------
    nodes : (k,) int array
        Rows of the patch's points.
    weights : (k,) array
        Their sum is one.
    arms : (k, 3) array
        From the centre to the nodes, within the tangent plane [m].
    inverse : (3, 3) array
        Pseudo-inverse of the second moments of the weights [1/m2].
    centre : (3,) array
        [m]
    normal : (3,) array
        Unit normal there.
    coverage : float
        Share of the disc of radius s that lies on the patch.
    """

    nodes: Array
    weights: Array
    arms: Array
    inverse: Array
    centre: Array
    normal: Array
    coverage: float

    @cached_property
    def slopes(self) -> Array:
        """(k, 3) array: for each node, its share in the slope of a field on the patch around the centre [1/m]."""
        return np.asarray(self.weights[:, None] * (self.arms - self.weights @ self.arms) @ self.inverse)

    @cached_property
    def _tilts(self) -> Array:
        """(k, 2) array: changes of the weights that move their mean place along two tangents."""
        return np.asarray(self.slopes @ np.linalg.svd(self.normal[None])[2][1:].T)

    def around(self, places: Array, point: Array, normal: Array) -> Array:
        """Weights, (k,), whose mean place is on the normal line of the surface through a point beside the centre.

        A force along that line has then no lever about the point.

        Parameters
        ----------
        places : (k, 3) array
            Of the nodes [m].
        point, normal : (3,) arrays
        """
        tilts = self._tilts
        off = point - self.weights @ places
        moves = places.T @ tilts
        across, along = moves - np.outer(normal, normal @ moves), off - (normal @ off) * normal
        return np.asarray(self.weights + tilts @ _least_squares(across, along))


def _least_squares(matrix: Array, right: Array) -> Array:
    """Two unknowns, (2,), by a (3, 2) matrix; at an edge, where one is not determined, the smallest of them."""
    (a, b), (_, c) = (matrix.T @ matrix).tolist()
    determinant = a * c - b * b
    if determinant > _DETERMINED * (a + c) ** 2:
        first, second = (right @ matrix).tolist()
        return np.array([(c * first - b * second) / determinant, (a * second - b * first) / determinant])
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def kernel_around(points: Array, facets: Array, centre: Array, normal: Array, radius: float) -> Kernel:
    """Kernel around a point of the true surface.

    Parameters
    ----------
    points : (np, 3) array
        Nodes of the patch [m].
    facets : (nf, n) int array
    centre : (3,) array
        [m]
    normal : (3,) array
        Outward unit normal there.
    radius : float
        s [m].
    """
    near, pressure, N = _pressures(points, facets, centre, normal, radius)
    total = float(pressure.sum())
    if total < _NEVER * _WHOLE * radius**2:
        return _nothing(points, facets, centre, normal)
    shares = np.bincount(facets[near].ravel(), (pressure @ N).ravel(), minlength=len(points)) / total
    nodes = np.flatnonzero(shares)
    weights, arms = shares[nodes], points[nodes] - centre
    arms = arms - np.outer(arms @ normal, normal)
    about = arms - weights @ arms
    inverse = np.linalg.pinv((weights[:, None] * about).T @ about, rcond=1e-8)
    return Kernel(nodes, weights, arms, inverse, centre, normal, total / (_WHOLE * radius**2))


def coverage_around(points: Array, facets: Array, centre: Array, normal: Array, radius: float) -> float:
    """Share of a kernel that lies on some facets, see `kernel_around`; it is continuous in the place."""
    return float(_pressures(points, facets, centre, normal, radius)[1].sum()) / (_WHOLE * radius**2)


def _pressures(points: Array, facets: Array, centre: Array, normal: Array, radius: float) -> tuple[Array, Array, Array]:
    """Which facets are near, pressures at points on these times area, and shape functions there.

    They are a (k,) int array, (k, q) [m2] and (q, n). Arguments are those of `kernel_around`.
    """
    arms = points - centre
    height = arms @ normal
    beside = np.sqrt(np.maximum(np.einsum("kd,kd->k", arms, arms) - height**2, 0.0))
    near = np.flatnonzero(abs(height)[facets].min(axis=1) < radius)
    nodal = arms[facets[near]]
    reach = np.linalg.norm(np.ptp(nodal, axis=1), axis=1)
    some = beside[facets[near]].min(axis=1) < radius + reach
    some &= np.einsum("fd,d->f", _normals(nodal, facets.shape[1]), normal) > 0
    near, nodal = near[some], nodal[some]
    area, N, dN = _rule(facets.shape[1])
    x, first, second = N @ nodal, dN[0] @ nodal, dN[1] @ nodal
    area = area * abs(np.einsum("fqd,fqd->fq", first @ np.cross(np.eye(3), normal), second))
    square = np.einsum("fqd,fqd->fq", x, x) - (x @ normal) ** 2
    return near, area * np.sqrt(np.maximum(1 - square / radius**2, 0.0)), N


def _nothing(points: Array, facets: Array, centre: Array, normal: Array) -> Kernel:
    """Kernel at a point off the patch: even weights on its nearest facet, which no force should use."""
    nearest = np.linalg.norm(points[facets].mean(axis=1) - centre, axis=1).argmin()
    nodes = np.unique(facets[nearest])
    arms, weights = points[nodes] - centre, np.full(len(nodes), 1 / len(nodes))
    return Kernel(nodes, weights, arms, np.zeros((3, 3)), centre, normal, 0.0)


def _normals(nodal: Array, n_nodes: int) -> Array:
    """Vectors along the normals of facets, (nf, 3), by their corners, (nf, n, 3)."""
    last = 3 if n_nodes in QUADS else 2
    return np.cross(nodal[:, 1] - nodal[:, 0], nodal[:, last] - nodal[:, 0])


@cache
def _rule(n_nodes: int) -> tuple[Array, Array, Array]:
    """Areas of points in a facet's coordinates, (q,), shape functions there, (q, n), and derivatives, (2, q, n)."""
    steps = (np.arange(_FINE) + 0.5) / _FINE
    if n_nodes in QUADS:
        local = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        area = np.full(len(local), 1 / len(local))
    else:
        i, j = (part.ravel() for part in np.meshgrid(np.arange(_FINE), np.arange(_FINE)))
        up, down = i + j < _FINE, i + j < _FINE - 1
        upward = np.column_stack([i[up], j[up]]) + 1 / 3
        downward = np.column_stack([i[down], j[down]]) + 2 / 3
        local = np.vstack([upward, downward]) / _FINE
        area = np.full(len(local), 0.5 / len(local))
    shape = shape_functions(local, n_nodes)
    return area, np.ascontiguousarray(shape[:, 0]), np.ascontiguousarray(shape[:, 1:].swapaxes(0, 1))
