"""Facets of a mesh: corners, areas, the shares of nodes in them, and what they tell of its elements."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import MeshError
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


def check_neighbours(cells: Array, faces: Array, number: Array) -> None:
    """Refuse elements that are there twice, that share a face with two others, or that lie on their neighbour's side.

    Parameters
    ----------
    cells : (ne, k) int array
        Nodes of elements of positive volume.
    faces : (faces an element * ne, m) int array
        Nodes of all elements' faces, outward.
    number : (ne, faces an element) int array
        Numbers that equal faces have in common.

    Raises
    ------
    MeshError
    """
    count = np.bincount(number.ravel())
    by_faces = np.sort(number, axis=1)
    order = np.lexsort(by_faces.T)
    same = np.flatnonzero((np.diff(by_faces[order], axis=0) == 0).all(axis=1))
    if len(same):
        raise MeshError(
            f"cells: {len(same)} of {len(cells)} elements are there twice, the first are elements "
            f"{order[same[0]]} and {order[same[0] + 1]} (counted from 0), of the same nodes. Their mass and stiffness "
            "would count twice; remove them"
        )
    if count.max() > 2:
        owners = np.flatnonzero((number == count.argmax()).any(axis=1))
        raise MeshError(
            f"cells: {np.count_nonzero(count > 2)} faces belong to more than two elements, the first to elements "
            f"{', '.join(map(str, owners))} (counted from 0), so that some of them overlap. Remove those, or mesh anew"
        )
    # Outward faces of two neighbours turn opposite ways.
    ring = facet_corners(faces)
    start = ring.argmin(axis=1)[:, None]
    k = ring.shape[1]
    after, before = (np.take_along_axis(ring, (start + step) % k, axis=1)[:, 0] for step in (1, -1))
    turn = np.bincount(number.ravel(), np.where(after < before, 1, -1))
    overlapping = np.flatnonzero((count == 2) & (turn != 0))
    if len(overlapping):
        owners = np.flatnonzero((number == overlapping[0]).any(axis=1))
        raise MeshError(
            f"cells: {len(overlapping)} pairs of elements overlap, for both lie on the same side of the face that "
            f"they share, the first are elements {' and '.join(map(str, owners))} (counted from 0). A node lies where "
            "it does not belong, or the order of nodes is wrong; mesh anew"
        )


def part_sizes(face: Array) -> Array:
    """Number of elements of each part that is connected through faces, (ne, faces an element), largest first."""
    of = sp.csr_matrix((np.ones(face.size), (np.repeat(np.arange(len(face)), face.shape[1]), face.ravel())))
    part = connected_components(of @ of.T, directed=False)[1]
    return np.sort(np.bincount(part))[::-1]
