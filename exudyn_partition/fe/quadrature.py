"""Integration over facets: points, weights and areas."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from .facets import FLAT_TRIANGLES
from .shapes import shape_functions

Rule = tuple[Array, Array, Array]


def area_mean(points: Array, facets: Array) -> Array:
    """Mean place, (3,) [m], over the area of facets, (nf, k), curved ones too, of points, (n, 3) [m]."""
    shape, area = facet_integration(points, facets)
    places = np.einsum("fq,qk,fkd->d", area, shape, points[facets])
    return np.asarray(places / area.sum())


def facet_integration(points: Array, facets: Array) -> tuple[Array, Array]:
    """Shape functions at the integration points, (nq, k), and the area of each point in each facet, (nf, nq) [m2]."""
    local, weight, _ = RULES[facets.shape[1]]
    shape = shape_functions(local, facets.shape[1])
    tangents = np.einsum("qin,fnd->ifqd", shape[:, 1:], points[facets])
    return shape[:, 0], weight * np.linalg.norm(np.cross(*tangents), axis=2)


def _triangle_rule() -> Rule:
    """Three points in the triangle, of degree 2."""
    barycentric = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    return barycentric[:, 1:], np.full(3, 1 / 6), barycentric


def _split_triangle_rule() -> Rule:
    """Three points in each of the four triangles between the nodes of a quadratic one."""
    nodes = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)])
    triangles = FLAT_TRIANGLES[6]
    _, weight, barycentric = _triangle_rule()
    local = (barycentric @ nodes[triangles]).reshape(-1, 2)
    hats = (barycentric @ np.eye(6)[triangles]).reshape(-1, 6)
    return local, np.tile(weight / 4, 4), hats


def _square_rule() -> Rule:
    """Gauss' three points each way."""
    x, w = np.polynomial.legendre.leggauss(3)
    x, w = (x + 1) / 2, w / 2
    local = np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2)
    return local, np.outer(w, w).ravel(), shape_functions(local, 4)[:, 0]


# By the number of a facet's nodes: points, their weights, and the nodes' hat functions there, (nq, k).
RULES = {3: _triangle_rule(), 4: _square_rule(), 6: _split_triangle_rule()}
