"""Where the bodies of an assembly come near each other: facets that face another body, found by geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..support.arrays import Array
from .facets import area_vectors, flat_triangles

_OPPOSITE = -0.5  # largest cosine between the normals of facets that face each other
_WITHIN = np.vstack([np.full((3, 3), 1 / 6) + np.eye(3) / 2, np.full((1, 3), 1 / 3)])  # points within a triangle
_OVERLAP = 0.25  # how far a point may lie behind a facet, by the distance within which facets belong together


class Side(NamedTuple):
    """Surface of a body as flat triangles, and points within them.

    Parameters
    ----------
    normals : (nf, 3) array
        Outward unit normals of the facets.
    triangles : (nt, 3, 3) array
        Corners [m].
    owner : (nt,) int array
        Facet of each triangle.
    points : (nt, 4, 3) array
        Points within each triangle [m].
    """

    normals: Array
    triangles: Array
    owner: Array
    points: Array

    @classmethod
    def of(cls, points: Array, facets: Array) -> Side:
        """Surface of a body by its nodes, (n, 3) [m], and its outward facets, (nf, k) int."""
        vectors = area_vectors(points, facets)
        corners, owner = flat_triangles(facets)
        triangles = points[corners]
        return cls(
            vectors / np.linalg.norm(vectors, axis=1)[:, None],
            triangles,
            owner,
            np.einsum("pc,tcd->tpd", _WITHIN, triangles),
        )


def facing_facets(sides: Sequence[Side], within: float) -> list[dict[int, Array]]:
    """Numbers of the facets of each body that face another one, by the number of that one.

    Two facets face each other if their normals are opposite within 60 degrees, and a point within one of them lies
    before the other, at most `within` [m] away from it. So a facet that only begins at the other's edge does not.
    """
    facing: list[dict[int, Array]] = [{} for _ in sides]
    low, high = (np.array([pick(side.triangles, axis=(0, 1)) for side in sides]) for pick in (np.min, np.max))
    boxes_meet = (low[:, None] <= high[None] + within).all(axis=2)
    for i, j in np.argwhere(np.tril(boxes_meet & boxes_meet.T, -1)):
        ours, theirs = _near(sides[i], sides[j], within)
        back, forth = _near(sides[j], sides[i], within)
        if len(ours) or len(back):
            facing[i][int(j)], facing[j][int(i)] = np.union1d(ours, forth), np.union1d(theirs, back)
    return facing


def _near(first: Side, second: Side, within: float) -> tuple[Array, Array]:
    """Facets of one body with a point that a facet of another body is near, and the latter, each ascending."""
    points, facet = first.points.reshape(-1, 3), np.repeat(first.owner, len(_WITHIN))
    lower, upper = (pick(second.triangles, axis=(0, 1)) for pick in (np.min, np.max))
    close = np.flatnonzero(((points >= lower - within) & (points <= upper + within)).all(axis=1))
    if not len(close):
        return close, close
    middle = second.triangles.mean(axis=1)
    reach = np.linalg.norm(second.triangles - middle[:, None], axis=2).max(axis=1) + within
    candidates = cKDTree(points[close]).query_ball_point(middle, reach)
    triangle = np.repeat(np.arange(len(middle)), [len(near) for near in candidates])
    point = close[np.concatenate([np.empty(0), *candidates]).astype(np.int64)]
    ours, theirs = facet[point], second.owner[triangle]
    n, m = first.normals[ours], second.normals[theirs]
    facing = np.flatnonzero(np.einsum("pi,pi->p", n, m) < _OPPOSITE)
    away = nearest_on_triangles(points[point[facing]], second.triangles[triangle[facing]]) - points[point[facing]]
    near = np.linalg.norm(away, axis=1) <= within
    before = np.einsum("pi,pi->p", away, n[facing]) >= -_OVERLAP * within
    behind = np.einsum("pi,pi->p", away, m[facing]) <= _OVERLAP * within
    met = facing[near & before & behind]
    return np.unique(ours[met]), np.unique(theirs[met])


def nearest_on_triangles(points: Array, triangles: Array) -> Array:
    """(k, 3) array: the point of each of k triangles, (k, 3, 3), that is nearest to each of k points, (k, 3) [m]."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ki,ki->k", normal, normal)
    real = squared > 0
    height = np.einsum("ki,ki->k", points - a, normal) / np.where(real, squared, 1.0)
    foot = points - height[:, None] * normal
    inside, best, distance = real.copy(), a.copy(), np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        side = end - start
        inside &= np.einsum("ki,ki->k", np.cross(side, foot - start), normal) >= 0
        length = np.einsum("ki,ki->k", side, side)
        share = np.einsum("ki,ki->k", points - start, side) / np.where(length > 0, length, 1.0)
        place = start + np.clip(share, 0.0, 1.0)[:, None] * side
        away = np.linalg.norm(points - place, axis=1)
        nearer = away < distance
        best[nearer], distance[nearer] = place[nearer], away[nearer]
    return np.asarray(np.where(inside[:, None], foot, best))


def connected(facets: Array) -> Array:
    """Number, from 0 on, of the part that each of some facets, (nf, k) int, belongs to; parts share no node."""
    nodes, place = np.unique(facets, return_inverse=True)
    owner = np.repeat(np.arange(len(facets)), facets.shape[1])
    shared = sp.coo_matrix((np.ones(facets.size), (owner, place.ravel())), shape=(len(facets), len(nodes))).tocsr()
    return np.asarray(connected_components(shared @ shared.T, directed=False)[1])
