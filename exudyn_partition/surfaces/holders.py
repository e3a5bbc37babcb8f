"""Which facet has a point that several have: on an edge, or beside it where facets meet at an angle.

A followed point stays on its facet until it has passed an edge by a tolerance, and where facets meet at an angle, a
point off the surface is opposite to both of them. The answer must not depend on the way to the place. So the nearest
facet has the point, and of those that are as near, as on an edge, the first one. Facets beyond a sharp edge do not
count: there the normals of the points decide, see `facing`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..fe.facets import facet_corners
from ..fe.shapes import QUADS, corners_of, shape_functions
from ..support.arrays import Array

FOLLOWED = 2e-6  # of a facet: how far a point may pass its edge
AS_NEAR = 1e-8  # of a facet's size: difference of distances that are the same
BESIDE = 4.0  # of FOLLOWED: within it, other facets may have the point
BESIDE_ENDS = 0.6  # of a facet's size: points further past an end than this do not come back before the next search
ON_END = 1e-6  # of a facet's size: round-off of a point that lies on the end of a patch
ALONG = 0.1  # of a facet, and more as points are further past: next to it, facets beside may be as near past an end
_SHARP = 0.5  # sine of the angle between normals on both sides, above which an edge is sharp
_SKEW = 2.0  # by angle and height above the surface: distance from an edge within which both facets may have a point


@dataclass(frozen=True, eq=False)
class Others:
    """Facets that may have the points of a facet, too.

    Parameters
    ----------
    around : (nf, 2 ne, m) int array
        Those around each corner of a facet, and at each of its edges, as far as no sharp edge is between: in ascending
        order, itself among them; -1 where there are no more.
    lean : (nf,) array
        Distance from an edge within which another facet is opposite to a point, too, by that of the point from the
        surface; the former in the facet's coordinates [1/m].
    """

    around: Array
    lean: Array

    @classmethod
    def of(cls, points: Array, facets: Array, across: Array) -> Others:
        """Find them of facets, (nf, k), with nodes at points, (np, 3) [m], and neighbours across edges, (nf, ne)."""
        nf, ne = across.shape
        corners, normals = facet_corners(facets), _normals(points, facets)
        facet, edge = np.nonzero(across >= 0)
        other = across[facet, edge]
        shared = corners[other] == np.stack([corners[facet, edge], corners[facet, (edge + 1) % ne]])[:, :, None]
        # Of an edge's ends in both facets: numbers of the corners among those of all facets.
        own, its = ne * facet + np.stack([edge, (edge + 1) % ne]), ne * other + shared.argmax(axis=2)
        sine = np.linalg.norm(np.cross(normals.reshape(-1, 3)[own], normals.reshape(-1, 3)[its]), axis=2).max(axis=0)
        smooth = sine < _SHARP
        ends = own[:, smooth].ravel(), its[:, smooth].ravel()
        links = sp.csr_matrix((np.ones(len(ends[0])), ends), (ne * nf, ne * nf))
        spread = connected_components(links, directed=False)[1]
        order = np.argsort(spread, kind="stable")
        size = np.bincount(spread)
        column = np.arange(len(order)) - np.repeat(np.cumsum(size) - size, size)
        members = np.full((len(size), max(size.max(), 2)), -1)
        members[spread[order], column] = order // ne
        around = np.full((nf, 2 * ne, members.shape[1]), -1)
        around[:, :ne] = members[spread].reshape(nf, ne, -1)
        around[facet[smooth], ne + edge[smooth], :2] = np.sort(np.column_stack([facet, other])[smooth], axis=1)
        angle = np.zeros(nf)
        np.maximum.at(angle, facet[smooth], sine[smooth])
        x = points[corners]
        shortest = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).min(axis=1)
        return cls(around, _SKEW * angle / np.maximum(shortest, 1e-300))


def _normals(points: Array, facets: Array) -> Array:
    """Unit normals of curved facets at their corners, (nf, ne, 3)."""
    shapes = shape_functions(corners_of(facets), facets.shape[1])[:, 1:]
    tangents = np.einsum("mcn,fnd->fmcd", shapes, points[facets])
    normals = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[:, :, None])


def depths(local: Array, n_nodes: int) -> list[Array]:
    """Distances of points from each edge of their facet, (k,) each, in its coordinates; positive inside."""
    r, s = local[:, 0], local[:, 1]
    return [s, 1 - r, 1 - s, r] if n_nodes in QUADS else [s, 1 - r - s, r]


def least_depth(local: Array, n_nodes: int) -> Array:
    """Least of these distances, (k,)."""
    return np.asarray(reduce(np.minimum, depths(local, n_nodes)))


def past_ends(local: Array, ends: Array, n_nodes: int) -> tuple[Array, Array]:
    """How far points are past the ends of a patch, (k,) [m], and how far from the other edges of their facets, (k,).

    Parameters
    ----------
    local : (k, 2) array
        Coordinates of the points in their facets, which are continued past the ends.
    ends : (k, number of edges) array
        `Surface.ends_of_facets` of each point's facet [m].
    n_nodes : int
        Nodes of a facet.

    Returns
    -------
    (k,) array, (k,) array
        Zero where a point is not past an end; the least depth in the facet's coordinates, infinite if all edges are
        ends.
    """
    depth = np.stack(depths(local, n_nodes), axis=1)
    return (-depth * ends).max(axis=1, initial=0.0), np.where(ends > 0.0, np.inf, depth).min(axis=1)


def stray(out: Array, inner: Array, size: float) -> Array:
    """Which points past the ends of a patch may have another facet, (k,) bool; see `past_ends`, and `size` [m].

    They are back on the patch, or not far enough from where the next facet begins.
    """
    return (out <= ON_END * size) | ((out <= BESIDE_ENDS * size) & (inner < ALONG + out / size))


def places_beside(local: Array, n_nodes: int, within: Array) -> Array:
    """Number of the corner, or of the edge after all corners, to which a point is near, (k,); -1 if to none.

    `within`, (k,), is the distance in the facet's coordinates.
    """
    near = np.stack(depths(local, n_nodes), axis=1) < within[:, None]
    ne = near.shape[1]
    at_corner = near & np.roll(near, 1, axis=1)
    found = np.where(near.any(axis=1), ne + near.argmax(axis=1), -1)
    return np.where(at_corner.any(axis=1), at_corner.argmax(axis=1), found)
