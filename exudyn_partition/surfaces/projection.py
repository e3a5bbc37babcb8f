"""Closest points on facets, and the steps of Newton's method that lead to them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..algebra.vectors import cross
from ..support.arrays import Array

SETTLED = 1e-9  # of a facet: largest last step of Newton's method; closest points depend so little on its start
CONVEX = 0.1  # curvature is left out if second derivatives are below this share of those of a flat facet


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
    def from_tangents(cls, facet: Array, local: Array, shape: Array, frame: Array, miss: Array) -> Projection:
        """Make it of `shape_functions` at the closest points, places and tangents, (k, 3, 3), and vectors to points."""
        a, b = frame[:, 1], frame[:, 2]
        normal = cross(a, b)
        normal /= np.sqrt(np.einsum("kd,kd->k", normal, normal))[:, None]
        gap = np.einsum("kd,kd->k", miss, normal)
        aside = miss - gap[:, None] * normal
        return cls(facet, local, shape[:, 0], normal, gap, np.sqrt(np.einsum("kd,kd->k", aside, aside)))


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
        convex = (det > CONVEX * squared) & (rr > CONVEX * aa)
        rr, rs, ss, det = (np.where(convex, *p) for p in ((rr, aa), (rs, ab), (ss, bb), (det, squared)))
    step = np.empty((len(miss), 2))
    np.divide(ss * am - rs * bm, det, out=step[:, 0])
    np.divide(rr * bm - rs * am, det, out=step[:, 1])
    return step, (rr, rs, ss), squared


def clip(local: Array, step: Array, metric: Array, domain: Array) -> Array:
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
