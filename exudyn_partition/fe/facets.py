"""Facets of a surface mesh: corners, areas and the shares of nodes in them."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

# Flat triangles that a facet is split into, by the number of its nodes.
FLAT_TRIANGLES = {
    3: np.array([[0, 1, 2]]),
    4: np.array([[0, 1, 2], [0, 2, 3]]),
    6: np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
    10: np.array([[0, 3, 8], [3, 4, 9], [4, 1, 5], [8, 9, 7], [9, 5, 6], [7, 6, 2], [3, 9, 8], [4, 5, 9], [9, 6, 7]]),
}
# Share of each node in a uniform pressure on a facet; corners of quadratic facets have none.
NODAL_SHARES = {
    3: np.full(3, 1 / 3),
    4: np.full(4, 1 / 4),
    6: np.r_[np.zeros(3), np.full(3, 1 / 3)],
    10: np.r_[np.full(3, 1 / 30), np.full(6, 3 / 40), 9 / 20],
}


def facet_corners(facets: Array) -> Array:
    """Corners, on axis 1, of triangles (nf, 3, ...), (nf, 6, ...) or (nf, 10, ...), or of quads (nf, 4, ...)."""
    return facets[:, : 4 if facets.shape[1] == 4 else 3]


def area_vectors(points: Array, facets: Array) -> Array:
    """(nf, 3) array: outward normals of the facets, by their corners; their length is the area [m2]."""
    a, b, c, *rest = points[facet_corners(facets)].transpose(1, 0, 2)
    d = rest[0] if rest else a
    return np.cross(c - a, d - b) / 2


def nodal_area(points: Array, facets: Array) -> Array:
    """(n,) array: area [m2] of each of n points under a uniform traction on `facets`, see `NODAL_SHARES`."""
    area = np.linalg.norm(area_vectors(points, facets), axis=1)
    shares = NODAL_SHARES[facets.shape[1]]
    loaded = shares > 0
    parts = area[:, None] / (1 / shares[loaded])
    return np.bincount(facets[:, loaded].ravel(), parts.ravel(), minlength=len(points))
