"""Facets of a surface mesh: corners, areas and the shares of nodes in them."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

# Flat triangles that a facet is split into, by the number of its nodes.
FLAT_TRIANGLES = {
    3: np.array([[0, 1, 2]]),
    4: np.array([[0, 1, 2], [0, 2, 3]]),
    6: np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
}


def facet_corners(facets: Array) -> Array:
    """Corners, on axis 1, of triangles (nf, 3, ...), quadratic triangles (nf, 6, ...) or quads (nf, 4, ...)."""
    return facets[:, : 4 if facets.shape[1] == 4 else 3]


def area_vectors(points: Array, facets: Array) -> Array:
    """(nf, 3) array: outward normals of the facets, by their corners; their length is the area [m2]."""
    a, b, c, *rest = points[facet_corners(facets)].transpose(1, 0, 2)
    d = rest[0] if rest else a
    return np.cross(c - a, d - b) / 2


def nodal_area(points: Array, facets: Array) -> Array:
    """(n,) array: area [m2] of each of n points under a uniform traction on `facets`.

    Only the mid-side nodes of a quadratic triangle have a share, a third each.
    """
    area = np.linalg.norm(area_vectors(points, facets), axis=1)
    n_loaded = facet_corners(facets).shape[1]
    return np.bincount(facets[:, -n_loaded:].ravel(), np.repeat(area / n_loaded, n_loaded), minlength=len(points))
