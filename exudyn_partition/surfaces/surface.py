"""Facets of a contact patch and the closest point on them (paper, section 3: node-to-segment)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..errors import ComplementarityError
from ..fe.facets import area_vectors, facet_corners
from ..fe.patches import Patch
from ..fe.shapes import TABLES, corners_of, curvature, shape_functions
from ..support.arrays import Array
from ..support.compiled import kernels

_NEWTON_STEPS = 30
_CONVERGED = 1e-10  # of a facet: the last step
_CONVEX = 0.1  # curvature is left out if second derivatives are below this share of those of a flat facet
_CANDIDATES = 8  # facets that are tried for each point, nearest centroids first
_SAME = 1e-9  # relative difference of squared distances: of facets that share the closest point, the first is taken


@dataclass(frozen=True, eq=False)
class Surface:
    """A contact patch in space: positions of nodes, facets and the line of contact.

    Parameters
    ----------
    points : (np, 3) array
        Positions of the patch's nodes [m].
    facets : (nf, 3), (nf, 6), (nf, 10), (nf, 4) or (nf, 8) int array
        Nodes of each facet as rows of `points`, ordered so that normals point outward.
    direction : (3,) array
        Outward unit vector: the line of contact of the patch.
    rim : (k,) int array
        Rows of `points` beyond which the surface of the body continues.
    nodes : (np,) int array
        Numbers of these nodes in the body.
    direction_given : bool
        Whether the user gave `direction`. If not, it follows from the mesh.
    wanders : bool
        Whether contact wanders over the patch, so that its normals decide and not `direction`.
    """

    points: Array
    facets: Array
    direction: Array
    rim: Array
    nodes: Array
    direction_given: bool = False
    wanders: bool = False

    @classmethod
    def of(cls, points: Array, patch: Patch, position: Array) -> Surface:
        """Contact patch of a body with the nodes `points`, (n, 3) [m], shifted by `position`, (3,) [m]."""
        nodes = patch.nodes
        facets, rim = (np.searchsorted(nodes, part) for part in (patch.facets, patch.rim))
        return cls(points[nodes] + position, facets, patch.direction, rim, nodes, patch.direction_given, patch.wanders)

    @property
    def flatness(self) -> float:
        """How certain `direction` is: length of the mean unit normal, 1 for a plane; 2 if the user gave it."""
        if self.direction_given:
            return 2.0
        normals = area_vectors(self.points, self.facets)
        return float(np.linalg.norm(normals.sum(axis=0)) / np.linalg.norm(normals, axis=1).sum())

    @property
    def normal_here(self) -> Array:
        """Mean unit normal of the facets in their present places, (3,)."""
        total = area_vectors(self.points, self.facets).sum(axis=0)
        normal: Array = total / np.linalg.norm(total)
        return normal

    def normals_at(self, nodes: Array, weights: Array) -> Array:
        """Unit normals at points, (p, 3): means over the facets around their nodes, in their present places.

        Parameters
        ----------
        nodes : (p, k) int array
            Rows of `points` that carry each point.
        weights : (p, k) array
            Shape functions of these nodes at the points.
        """
        vectors, around = area_vectors(self.points, self.facets), np.zeros_like(self.points)
        for axis in range(3):
            each = np.repeat(vectors[:, axis], self.facets.shape[1])
            around[:, axis] = np.bincount(self.facets.ravel(), each, minlength=len(around))
        around /= np.maximum(np.linalg.norm(around, axis=1), 1e-300)[:, None]
        normals = np.einsum("pk,pkd->pd", weights, around[nodes])
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None])

    @cached_property
    def facet_size(self) -> float:
        """Mean edge length of the facets [m]."""
        corners = self.points[facet_corners(self.facets)]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @cached_property
    def neighbours(self) -> tuple[Array, Array]:
        """Neighbour across each facet's edges 01, 12, ..., and the number of the shared edge in the neighbour.

        Two (nf, number of edges) arrays; the neighbour is -1 where there is none.
        """
        corners = facet_corners(self.facets)
        edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        order = np.lexsort(edges.T)
        same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
        other = np.full(len(edges), -1)
        other[order[same]], other[order[same + 1]] = order[same + 1], order[same]
        facet, edge = np.divmod(other, corners.shape[1])
        return facet.reshape(corners.shape), edge.reshape(corners.shape)


@dataclass(frozen=True, eq=False)
class Projection:
    """Closest points of k points on a surface.

    Parameters
    ----------
    facet : (k,) int array
        Facet that each point projects to.
    local : (k, 2) array
        Coordinates of the closest point in the facet.
    weights : (k, n) array
        Shape functions at the closest point, of the n nodes of a facet.
    normal : (k, 3) array
        Unit outward normal of the facet there.
    gap : (k,) array
        Signed distance along the normal, positive outside [m].
    offset : (k,) array
        Distance of the point from the line along that normal through the closest point [m]. It is zero if the closest
        point lies inside the surface, and above zero if the point projects past the edge.
    """

    facet: Array
    local: Array
    weights: Array
    normal: Array
    gap: Array
    offset: Array

    def put(self, index: Array, other: Projection) -> None:
        """Replace the projections of some points, (k,) int array, by others."""
        for field in fields(self):
            getattr(self, field.name)[index] = getattr(other, field.name)

    def part(self, index: Array) -> Projection:
        """Projections of some points, an index."""
        return Projection(*(getattr(self, field.name)[index] for field in fields(self)))

    @classmethod
    def at(cls, facet: Array, local: Array, shape: Array, frame: Array, miss: Array) -> Projection:
        """Make it of `shape_functions` at the closest points, places and tangents, (k, 3, 3), and vectors to points."""
        a, b = frame[:, 1], frame[:, 2]
        normal = cross(a, b)
        normal /= np.sqrt(np.einsum("kd,kd->k", normal, normal))[:, None]
        gap = np.einsum("kd,kd->k", miss, normal)
        aside = miss - gap[:, None] * normal
        return cls(facet, local, shape[:, 0], normal, gap, np.sqrt(np.einsum("kd,kd->k", aside, aside)))


def cross(a: Array, b: Array) -> Array:
    """Vector products, (k, 3); np.cross takes ten times as long for few points."""
    result = np.empty_like(a)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[:, j] * b[:, k], a[:, k] * b[:, j], out=result[:, i])
    return result


def nearest_places(tree: cKDTree, points: Array, count: int = 1) -> Array:
    """Numbers of the places in a tree that are nearest to each of some points, (k, count).

    Raises
    ------
    ComplementarityError
        If points are so far away that no place is nearest.
    """
    if math.isfinite(points.sum()):
        distance, found = tree.query(points, k=count)
        if math.isfinite(distance.sum()):
            return np.asarray(found).reshape(len(points), count)
    raise ComplementarityError("the places of the patches are not finite: the run has become unstable")


def closest_points(points: Array, facets: Array) -> Projection:
    """Project points on a surface of triangles or quads, flat or curved.

    Newton's method in the facet's coordinates, clipped to the facet. The nearest of several candidates is taken.

    Parameters
    ----------
    points : (k, 3) array
        Places of the points [m].
    facets : (nf, n, 3) array
        Positions of the facets' nodes [m].

    Returns
    -------
    Projection

    Raises
    ------
    ComplementarityError
        See `nearest_places`.
    """
    k, (nf, n_nodes, _) = len(points), facets.shape
    centre = facets.mean(axis=(0, 1))
    points, facets = points - centre, facets - centre  # reduces round-off
    candidates = min(_CANDIDATES, nf)
    nearest = nearest_places(cKDTree(facet_corners(facets).mean(axis=1)), points, candidates).ravel()
    if loops := kernels("surfaces"):
        own = facets, nearest.reshape(k, candidates), corners_of(facets), TABLES[n_nodes]
        return Projection(*loops.closest(points, *own, _NEWTON_STEPS, _CONVERGED, _CONVEX, _SAME))
    targets = np.repeat(points, candidates, axis=0)
    nodes = facets[nearest]
    domain = corners_of(facets)
    local = np.tile(domain.mean(axis=0), (len(targets), 1))
    left = np.arange(len(targets))  # points that have not converged
    for _ in range(_NEWTON_STEPS):
        frame = shape_functions(local[left], n_nodes) @ nodes[left]
        miss = targets[left] - frame[:, 0]
        bends = curvature(local[left], np.einsum("knd,kd->kn", nodes[left], miss))
        step, (rr, rs, ss), _ = newton_step(frame, miss, bends)
        there = _clip(local[left], step, np.stack([rr, rs, rs, ss], axis=1).reshape(-1, 2, 2), domain)
        change = abs(there - local[left]).max(axis=1)
        local[left] = there
        left = left[change >= _CONVERGED]
        if not left.size:
            break
    miss = targets - (shape_functions(local, n_nodes)[:, 0, None] @ nodes)[:, 0]
    distance = (miss**2).sum(axis=1).reshape(k, candidates)
    closest = distance <= distance.min(axis=1, keepdims=True) * (1 + _SAME)
    best = closest.argmax(axis=1) + candidates * np.arange(k)
    shape = shape_functions(local[best], n_nodes)
    return Projection.at(nearest[best], local[best], shape, shape @ nodes[best], miss[best])


def newton_step(frame: Array, miss: Array, bends: Array | None = None) -> tuple[Array, tuple[Array, ...], Array]:
    """Newton's step towards the closest point.

    Where the distance is not convex, as inside a curved surface, it is the step of Gauss and Newton, which takes the
    facet as flat. That step is good near the facet. Far from it, it would pass the closest point, by the ratio of
    distance and radius of curvature.

    Parameters
    ----------
    frame : (k, 3, 3) array
        Place and tangents on the facet [m].
    miss : (k, 3) array
        Vector from the place to the point [m].
    bends : (3, k) array, optional
        Second derivatives rr, rs and ss of the place, times `miss` [m2]. Default: flat facets.

    Returns
    -------
    (k, 2) array
        Step in the facet's coordinates.
    three (k,) arrays
        Second derivatives rr, rs and ss of half the squared distance [m2].
    (k,) array
        Squared area of the tangents' parallelogram [m4].
    """
    a, b = frame[:, 1], frame[:, 2]
    aa, ab, bb, am, bm = (np.einsum("kd,kd->k", x, y) for x, y in ((a, a), (a, b), (b, b), (a, miss), (b, miss)))
    rr, rs, ss = aa, ab, bb
    squared = det = aa * bb - ab * ab
    if bends is not None:
        rr, rs, ss = np.stack([aa, ab, bb]) - bends
        det = rr * ss - rs * rs
        convex = (det > _CONVEX * squared) & (rr > _CONVEX * aa)
        rr, rs, ss, det = (np.where(convex, *p) for p in ((rr, aa), (rs, ab), (ss, bb), (det, squared)))
    step = np.empty((len(miss), 2))
    np.divide(ss * am - rs * bm, det, out=step[:, 0])
    np.divide(rr * bm - rs * am, det, out=step[:, 1])
    return step, (rr, rs, ss), squared


def _clip(local: Array, step: Array, metric: Array, domain: Array) -> Array:
    """Point of the domain with these corners, (3 or 4, 2), closest to local + step in the metric, (k, 2, 2)."""
    target = local + step
    inside = (target >= 0).all(axis=1) & ((target.sum(axis=1) if len(domain) == 3 else target.max(axis=1)) <= 1)
    if inside.all():
        return target
    outside = np.flatnonzero(~inside)
    aim, metric = target[outside], metric[outside]
    best, best_distance = aim.copy(), np.full(len(aim), np.inf)
    for start, end in zip(domain, np.roll(domain, -1, axis=0), strict=True):
        edge = end - start
        weighted = metric @ edge
        along = np.einsum("ki,ki->k", aim - start, weighted) / (weighted @ edge)
        foot = start + np.clip(along, 0, 1)[:, None] * edge
        miss = aim - foot
        distance = np.einsum("ki,ki->k", miss, (metric @ miss[:, :, None])[:, :, 0])
        closer = distance < best_distance
        best[closer], best_distance[closer] = foot[closer], distance[closer]
    target[outside] = best
    return target
