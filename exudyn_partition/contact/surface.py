"""Facets of a contact patch and the closest point on them (paper, section 3: node-to-segment)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..fem import facet_corners

Array = np.ndarray

_NEWTON_STEPS = 30
_CANDIDATES = 8  # facets tried a point, nearest centroids first
_TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # corners in the facet's coordinates
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def shape_functions(local: Array, n_nodes: int) -> tuple[Array, Array]:
    """Shape functions of triangles or quads and their derivatives.

    Parameters
    ----------
    local : (k, 2) array
        Coordinates (r, s) with r, s >= 0, r + s <= 1, or r, s <= 1 for quads.
    n_nodes : {3, 6, 4}
        Triangle: corners, then mid-side nodes of edges 01, 12, 20. Quad: corners.

    Returns
    -------
    values : (k, n_nodes) array
    derivatives : (k, n_nodes, 2) array
    """
    r, s = local.T
    if n_nodes == 4:
        values = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=1)
        along_r, along_s = [s - 1, 1 - s, s, -s], [r - 1, -r, r, 1 - r]
        return values, np.stack([np.stack(along_r, axis=1), np.stack(along_s, axis=1)], axis=2)
    corner = np.stack([1 - r - s, r, s], axis=1)
    gradient = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if n_nodes == 3:
        return corner, np.broadcast_to(gradient, (len(local), 3, 2))
    following = corner[:, [1, 2, 0]]
    values = np.hstack([corner * (2 * corner - 1), 4 * corner * following])
    at_corners = (4 * corner - 1)[:, :, None] * gradient
    at_edges = 4 * (corner[:, :, None] * gradient[[1, 2, 0]] + following[:, :, None] * gradient)
    return values, np.concatenate([at_corners, at_edges], axis=1)


@dataclass(frozen=True, eq=False)
class Projection:
    """Closest points of k points on a surface.

    Parameters
    ----------
    facet : (k,) int array
        Facet that each point projects to.
    weights : (k, 3), (k, 6) or (k, 4) array
        Shape functions at the closest point.
    normal : (k, 3) array
        Unit outward normal of the facet there.
    gap : (k,) array
        Signed distance along the normal, positive outside [m].
    offset : (k,) array
        Distance from the point's foot on that normal to the closest point [m]: zero where the closest point lies
        inside the surface, above zero where the point looks past its edge.
    """

    facet: Array
    weights: Array
    normal: Array
    gap: Array
    offset: Array


def closest_points(points: Array, facets: Array) -> Projection:
    """Project points on a surface of triangles, flat or curved, or of bilinear quads.

    Gauss-Newton in the facet's coordinates, clipped to the facet; the nearest of several candidate facets wins.

    Parameters
    ----------
    points : (k, 3) array
        [m]
    facets : (nf, 3, 3), (nf, 6, 3) or (nf, 4, 3) array
        Positions of the facets' nodes [m].

    Returns
    -------
    Projection
    """
    k, (nf, n_nodes, _) = len(points), facets.shape
    candidates = min(_CANDIDATES, nf)
    _, nearest = cKDTree(facet_corners(facets).mean(axis=1)).query(points, k=candidates)
    nearest = np.asarray(nearest).reshape(-1)
    targets = np.repeat(points, candidates, axis=0)
    nodes = facets[nearest]
    domain = _SQUARE if n_nodes == 4 else _TRIANGLE
    local = np.tile(domain.mean(axis=0), (len(targets), 1))
    for _ in range(_NEWTON_STEPS):
        values, derivatives = shape_functions(local, n_nodes)
        miss = targets - np.einsum("kn,knd->kd", values, nodes)
        tangents = np.einsum("knj,knd->kdj", derivatives, nodes)
        local_next = _clip(local, _tangent_step(tangents, miss), tangents, domain)
        change = abs(local_next - local).max()
        local = local_next
        if change < 1e-14:
            break
    values, derivatives = shape_functions(local, n_nodes)
    miss = targets - np.einsum("kn,knd->kd", values, nodes)
    best = (miss**2).sum(axis=1).reshape(k, candidates).argmin(axis=1) + candidates * np.arange(k)
    tangents = np.einsum("knj,knd->kdj", derivatives[best], nodes[best])
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    gap = np.einsum("kd,kd->k", miss[best], normal)
    offset = np.linalg.norm(miss[best] - gap[:, None] * normal, axis=1)
    return Projection(nearest[best], values[best], normal, gap, offset)


def _tangent_step(tangents: Array, miss: Array) -> Array:
    """Least-squares step towards the foot of `miss` on the tangent plane, (k, 2)."""
    gram = np.einsum("kdi,kdj->kij", tangents, tangents)
    return np.linalg.solve(gram, np.einsum("kdi,kd->ki", tangents, miss)[:, :, None])[:, :, 0]


def _clip(local: Array, step: Array, tangents: Array, domain: Array) -> Array:
    """Closest point of the domain, corners (3 or 4, 2), to local + step, in the metric of the facet's tangents."""
    target = local + step
    inside = (target >= 0).all(axis=1) & ((target.sum(axis=1) if len(domain) == 3 else target.max(axis=1)) <= 1)
    if inside.all():
        return target
    best, best_distance = target.copy(), np.where(inside, 0.0, np.inf)
    gram = np.einsum("kdi,kdj->kij", tangents, tangents)
    for start, end in zip(domain, np.roll(domain, -1, axis=0), strict=True):
        edge = end - start
        length = np.einsum("i,kij,j->k", edge, gram, edge)
        along = np.einsum("ki,kij,j->k", target - start, gram, edge) / length
        foot = start + np.clip(along, 0, 1)[:, None] * edge
        distance = np.einsum("ki,kij,kj->k", target - foot, gram, target - foot)
        closer = distance < best_distance
        best[closer], best_distance[closer] = foot[closer], distance[closer]
    return best
