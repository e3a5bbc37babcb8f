"""Facets of a mesh: corners, areas, the shares of nodes in them, and what they tell of its elements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..algebra.vectors import cross
from ..errors import MeshError
from ..support.arrays import Array
from .halves import in_halves, joined
from .shapes import QUADS

Naming = Callable[[Array], str]  # names elements by their rows, for messages

# Flat triangles that a facet is split into, by the number of its nodes.
FLAT_TRIANGLES = {
    3: np.array([[0, 1, 2]]),
    4: np.array([[0, 1, 2], [0, 2, 3]]),
    6: np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
    8: np.array([[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6], [4, 6, 7]]),
    10: np.array([[0, 3, 8], [3, 4, 9], [4, 1, 5], [8, 9, 7], [9, 5, 6], [7, 6, 2], [3, 9, 8], [4, 5, 9], [9, 6, 7]]),
}
# Share of each node in a uniform pressure on a facet; corners of quadratic triangles have none. Those of quadrilaterals
# of 8 nodes would have negative ones: theirs are of hats between the nodes, see `quadrature`.
NODAL_SHARES = {
    3: np.full(3, 1 / 3),
    4: np.full(4, 1 / 4),
    6: np.r_[np.zeros(3), np.full(3, 1 / 3)],
    8: np.r_[np.full(4, 1 / 24), np.full(4, 5 / 24)],
    10: np.r_[np.full(3, 1 / 30), np.full(6, 3 / 40), 9 / 20],
}
# A half of a quadrilateral has half of its area, and the same part of each share.
NODAL_SHARES |= {k: joined(NODAL_SHARES[n], NODAL_SHARES[m]) for k, n, m in ((7, 3, 4), (13, 6, 8))}


def facet_corners(facets: Array) -> Array:
    """Corners, on axis 1, of triangles (nf, 3, ...), (nf, 6, ...) or (nf, 10, ...), or of quads (nf, 4 or 8, ...)."""
    return facets[:, : 4 if facets.shape[1] in QUADS else 3]


def folded(facets: Array) -> Array:
    """Whether each of some facets, (nf, k) int, is a triangle `a b c c` among quadrilaterals, (nf,) bool."""
    if facets.shape[1] not in QUADS:
        return np.zeros(len(facets), dtype=bool)
    return np.asarray(facets[:, 2] == facets[:, 3])


def by_shape(facets: Array) -> list[tuple[Array, Array]]:
    """Rows of facets of one shape, (m,) int, and the columns of their nodes, for each shape that there is."""
    if facets.shape[1] not in QUADS:
        return [(np.arange(len(facets)), np.arange(facets.shape[1]))]
    triangles = np.array([0, 1, 2] if facets.shape[1] == 4 else [0, 1, 2, 4, 5, 7])
    is_folded = folded(facets)
    shapes = [(np.flatnonzero(~is_folded), np.arange(facets.shape[1])), (np.flatnonzero(is_folded), triangles)]
    return [(rows, columns) for rows, columns in shapes if len(rows)]


def unfolded(facets: Array) -> Array:
    """Facets of a patch: triangles among quadrilaterals as such, if there are no others."""
    parts = by_shape(facets)
    return facets if len(parts) > 1 else facets[:, parts[0][1]]


def of_one_shape(facets: Array) -> Array:
    """Facets of a patch with one set of shape functions: in halves if there are triangles and quadrilaterals."""
    return in_halves(facets) if len(by_shape(facets)) > 1 else facets


def flat_triangles(facets: Array) -> tuple[Array, Array]:
    """Flat triangles that facets are split into, (m, 3) int, and the facet of each, (m,) int."""
    triangles, owner = [], []
    for rows, columns in by_shape(facets):
        parts = columns[FLAT_TRIANGLES[len(columns)]]
        triangles.append(facets[rows][:, parts].reshape(-1, 3))
        owner.append(np.repeat(rows, len(parts)))
    return np.concatenate(triangles), np.concatenate(owner)


def area_vectors(points: Array, facets: Array) -> Array:
    """(nf, 3) array: outward normals of the facets, by their corners; their length is the area [m2]."""
    a, b, c, *rest = points[facet_corners(facets)].transpose(1, 0, 2)
    return cross(c - a, (rest[0] if rest else a) - b) / 2


def nodal_area(points: Array, facets: Array) -> Array:
    """(n,) array: area [m2] of each of n points under a uniform traction on `facets`, see `NODAL_SHARES`."""
    area = np.linalg.norm(area_vectors(points, facets), axis=1)
    total = np.zeros(len(points))
    for rows, columns in by_shape(facets):
        shares = NODAL_SHARES[len(columns)]
        loaded = shares > 0
        parts = area[rows, None] / (1 / shares[loaded])
        total += np.bincount(facets[rows][:, columns[loaded]].ravel(), parts.ravel(), minlength=len(points))
    return total


def counted(rows: Array) -> str:
    """Name elements by their rows."""
    listed = (" and " if len(rows) == 2 else ", ").join(map(str, rows))
    return f"element{'s' * (len(rows) > 1)} {listed} (counted from 0)"


def check_neighbours(cells: Array, faces: Array, number: Array, said: Naming = counted) -> None:
    """Refuse elements that are there twice, that share a face with two others, or that lie on their neighbour's side.

    Parameters
    ----------
    cells : (ne, k) int array
        Nodes of elements of positive volume.
    faces : (faces an element * ne, m) int array
        Nodes of all elements' faces, outward.
    number : (ne, faces an element) int array
        Numbers that equal faces have in common; -1 where there is none.
    said : callable
        Names elements in the messages.

    Raises
    ------
    MeshError
    """
    check_conforming(faces, number, said)
    real = number.ravel() >= 0
    count = np.bincount(number.ravel()[real])
    by_faces = np.sort(number, axis=1)
    order = np.lexsort(by_faces.T)
    same = np.flatnonzero((np.diff(by_faces[order], axis=0) == 0).all(axis=1))
    if len(same):
        raise MeshError(
            f"cells: {len(same)} of {len(cells)} elements are there twice, the first are "
            f"{said(np.sort(order[same[0] : same[0] + 2]))}, of the same nodes. Their mass and stiffness "
            "would count twice; remove them"
        )
    crowded = (count > 2) & ~covered_quads(faces, number)
    if crowded.any():
        owners = np.flatnonzero((number == crowded.argmax()).any(axis=1))
        raise MeshError(
            f"cells: {np.count_nonzero(crowded)} faces belong to more than two elements, the first to "
            f"{said(owners)}, so that some of them overlap. Remove those, or mesh anew"
        )
    # Outward faces of two neighbours turn opposite ways.
    faces = faces[real]
    ring = facet_corners(faces)
    start = ring.argmin(axis=1)[:, None]
    k = (ring.shape[1] - folded(faces))[:, None]
    after, before = (np.take_along_axis(ring, (start + step) % k, axis=1)[:, 0] for step in (1, -1))
    turn = np.bincount(number.ravel()[real], np.where(after < before, 1, -1))
    overlapping = np.flatnonzero((count == 2) & (turn != 0))
    if len(overlapping):
        owners = np.flatnonzero((number == overlapping[0]).any(axis=1))
        raise MeshError(
            f"cells: {len(overlapping)} pairs of elements overlap, for both lie on the same side of the face that "
            f"they share, the first are {said(owners)}. A node lies where "
            "it does not belong, or the order of nodes is wrong; mesh anew"
        )


def covered_quads(faces: Array, number: Array) -> Array:
    """Whether each number is that of a quadrilateral and the two triangles that cover it, see `elements.faces_of`."""
    real = number.ravel() >= 0
    of, is_folded = number.ravel()[real], folded(faces[real])
    return np.asarray((np.bincount(of) == 3) & (np.bincount(of, ~is_folded) == 1))


def check_conforming(faces: Array, number: Array, said: Naming = counted) -> None:
    """Refuse quadrilaterals that triangles cover in part, or quadratic ones, which would leave a crack between them.

    Parameters
    ----------
    faces : (faces an element * ne, m) int array
        Nodes of all elements' faces.
    number : (ne, faces an element) int array
        Numbers that equal faces have in common; -1 where there is none.
    said : callable
        Names elements in the message.

    Raises
    ------
    MeshError
    """
    flat = number.ravel()
    alone = (np.bincount(flat[flat >= 0])[flat] == 1) & (flat >= 0)
    corners, is_folded = facet_corners(faces[alone]), folded(faces[alone])
    if not is_folded.any():
        return
    triples = np.sort(corners[~is_folded][:, [(0, 1, 2), (1, 2, 3), (2, 3, 0), (3, 0, 1)]].reshape(-1, 3), axis=1)
    triangles = np.sort(corners[is_folded][:, :3], axis=1)
    _, place, count = np.unique(np.vstack([triangles, triples]), axis=0, return_inverse=True, return_counts=True)
    met = np.flatnonzero(count[place.ravel()[: len(triangles)]] > 1)
    if len(met):
        owner = np.repeat(np.arange(len(number)), number.shape[1])[alone][is_folded][met[0]]
        raise MeshError(
            f"cells: {len(met)} triangles of elements lie on quadrilaterals of others, the first is of "
            f"{said(np.array([owner]))}. Their edges fit, but their displacements do not; put pyramids between them"
        )


def check_connected(face: Array, said: Naming | None = None) -> None:
    """Refuse elements in several parts: a common edge is a hinge, which leaves a motion without stiffness.

    Parameters
    ----------
    face : (ne, faces an element) int array
        Numbers that equal faces have in common; -1 where there is none.
    said : callable, optional
        Names the first element of each part in the message.

    Raises
    ------
    MeshError
    """
    part = parts_of(face)
    sizes = np.bincount(part)
    if len(sizes) > 1:
        largest = np.argsort(-sizes, kind="stable")[:5]
        more = ", ..." if len(sizes) > 5 else ""
        first = np.unique(part, return_index=True)[1][largest]
        raise MeshError(
            f"cells: expected one connected body, got {len(sizes)} parts that share no face, of "
            f"{', '.join(map(str, sizes[largest]))}{more} elements"
            f"{f', which begin with {said(first)}{more}' if said else ''}. Merge coincident nodes "
            "where they touch, or make one FE model of each"
        )


def part_sizes(face: Array) -> Array:
    """Number of elements of each part that is connected through faces, (ne, faces an element), largest first."""
    return np.sort(np.bincount(parts_of(face)))[::-1]


def parts_of(face: Array) -> Array:
    """Number of each element's part, (ne,), by the numbers that equal faces have in common; see `check_connected`."""
    real = face.ravel() >= 0
    owner = np.repeat(np.arange(len(face)), face.shape[1])[real]
    of = sp.csr_matrix((np.ones(len(owner)), (owner, face.ravel()[real])))
    part: Array = connected_components(of @ of.T, directed=False)[1]
    return part
