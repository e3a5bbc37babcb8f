"""Integration over facets and their edges: points, weights, areas, and nodal forces of uniform loads."""

from __future__ import annotations

import numpy as np

from ..errors import EmptyRegionError
from ..support.arrays import Array
from .facets import FLAT_TRIANGLES, by_shape
from .halves import in_square, joined
from .shapes import FACET_NODES, QUADS, shape_functions

Rule = tuple[Array, Array, Array]


def area_mean(points: Array, facets: Array) -> Array:
    """Mean place, (3,) [m], over the area of facets, (nf, k), curved ones too, of points, (n, 3) [m]."""
    places, total = np.zeros(3), 0.0
    for rows, columns in by_shape(facets):
        nodes = facets[rows][:, columns]
        shape, area = facet_integration(points, nodes)
        places += np.einsum("fq,qk,fkd->d", area, shape, points[nodes])
        total += area.sum()
    return places / total


def facet_integration(points: Array, facets: Array) -> tuple[Array, Array]:
    """Shape functions at the integration points, (nq, k), and the area of each point in each facet, (nf, nq) [m2]."""
    local, weight, _ = RULES[facets.shape[1]]
    shape = shape_functions(local, facets.shape[1])
    tangents = np.einsum("qin,fnd->ifqd", shape[:, 1:], points[facets])
    return shape[:, 0], weight * np.linalg.norm(np.cross(*tangents), axis=2)


def facet_forces(points: Array, facets: Array, direction: Array | None) -> Array:
    """Nodal forces, (nf, k, 3) [N], of 1 Pa on facets, (nf, k): along a unit vector, (3,), or against the normals.

    Pressures are integrated exactly on curved facets too, so that those of a closed surface are in balance.
    """
    forces = np.zeros((*facets.shape, 3))
    for rows, columns in by_shape(facets):
        n = len(columns)
        local, weight = _square_gauss() if n in QUADS else _triangle_gauss()
        shape = shape_functions(local, n)
        normals = np.cross(*np.einsum("qin,fnd->ifqd", shape[:, 1:], points[facets[rows][:, columns]]))
        if direction is None:
            of_shape = -np.einsum("q,qk,fqd->fkd", weight, shape[:, 0], normals)
        else:
            areas = np.einsum("q,qk,fq->fk", weight, shape[:, 0], np.linalg.norm(normals, axis=2))
            of_shape = areas[:, :, None] * direction
        forces[np.ix_(rows, columns)] = of_shape
    return forces


def edges_between(facets: Array, nodes: Array) -> Array:
    """Edges of facets, (ne, 2), (ne, 3) or (ne, 4) nodes with ends first, all of whose nodes are among `nodes`, (k,).

    Raises
    ------
    EmptyRegionError
        If there is none.
    """
    edges = facets[:, _EDGES[facets.shape[1]]].reshape(-1, len(_EDGES[facets.shape[1]][0]))
    edges = edges[np.isin(edges, nodes).all(axis=1) & (edges[:, 0] != edges[:, 1])]  # a triangle's fourth has no length
    _, first = np.unique(np.sort(edges[:, :2], axis=1), axis=0, return_index=True)
    if not len(first):
        raise EmptyRegionError(
            "line: no edge of the surface's mesh has all its nodes among these; give nodes along edges"
        )
    return np.asarray(edges[first])


def edge_lengths(points: Array, edges: Array) -> Array:
    """Lengths, (ne, k) [m], of edges, which may be curved, as a uniform line load shares them among their nodes."""
    x, weight = np.polynomial.legendre.leggauss(4)
    x, weight = (x + 1) / 2, weight / 2
    at = np.r_[0.0, 1.0, np.arange(1, edges.shape[1] - 1) / (edges.shape[1] - 1)]
    polynomials = np.linalg.inv(np.vander(at, increasing=True))  # of each node, a column
    powers = np.vander(x, len(at), increasing=True)
    slopes = np.hstack([np.zeros((len(x), 1)), powers[:, :-1] * np.arange(1, len(at))])
    tangents = np.einsum("qk,ekd->eqd", slopes @ polynomials, points[edges])
    return np.asarray(np.einsum("q,eq,qk->ek", weight, np.linalg.norm(tangents, axis=2), powers @ polynomials))


# Nodes of a facet's edges, by the number of its nodes: ends, then the others from the first end on.
_EDGES = {
    3: [[0, 1], [1, 2], [2, 0]],
    4: [[0, 1], [1, 2], [2, 3], [3, 0]],
    6: [[0, 1, 3], [1, 2, 4], [2, 0, 5]],
    8: [[0, 1, 4], [1, 2, 5], [2, 3, 6], [3, 0, 7]],
    10: [[0, 1, 3, 4], [1, 2, 5, 6], [2, 0, 7, 8]],
}


def _square_gauss() -> tuple[Array, Array]:
    """Gauss' five points each way on the unit square, exact to degree 9 in each, and their weights."""
    x, w = np.polynomial.legendre.leggauss(5)
    x, w = (x + 1) / 2, w / 2
    return np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2), np.outer(w, w).ravel()


def _triangle_gauss() -> tuple[Array, Array]:
    """The same on the triangle, by folding the square (Duffy), exact to degree 8."""
    square, weight = _square_gauss()
    r, s = square.T
    return np.column_stack([r, s * (1 - r)]), weight * (1 - r)


def _triangle_rule() -> Rule:
    """Three points in the triangle, of degree 2."""
    barycentric = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    return barycentric[:, 1:], np.full(3, 1 / 6), barycentric


def _split_triangle_rule() -> Rule:
    """Three points in each of the four triangles between the nodes of a quadratic one."""
    nodes = FACET_NODES[6]
    triangles = FLAT_TRIANGLES[6]
    _, weight, barycentric = _triangle_rule()
    local = (barycentric @ nodes[triangles]).reshape(-1, 2)
    hats = (barycentric @ np.eye(6)[triangles]).reshape(-1, 6)
    return local, np.tile(weight / 4, 4), hats


def _cubic_triangle_rule() -> Rule:
    """Points in each of the nine triangles between the nodes of a cubic one: degree 3 in all, degree 2 in each.

    A uniform pressure then makes the exact nodal forces. Three points have degree 2; their errors of degree 3 in the
    six triangles that stand upright are twice those in the other three. So these have a fourth point in their middle,
    of such a weight w that their errors are minus twice as large.
    """
    _, _, three = _triangle_rule()

    def excess(w: float) -> tuple[Array, float]:
        """Four points of degree 2, and their error of the integral of 27 times the product of the coordinates."""
        # Mean squares of the coordinates are 1/6: (1 - w) (6 a^2 - 4 a + 1) / 3 + w / 9 = 1 / 6.
        a = (2 - np.sqrt(4 - 6 * (1 - (0.5 - w / 3) / (1 - w)))) / 6
        points = np.vstack([np.full((3, 3), a) + (1 - 3 * a) * np.eye(3), np.full((1, 3), 1 / 3)])
        return points, float((1 - w) * 27 * a * a * (1 - 2 * a) + w - 0.45)

    goal, w = 2 * excess(0.0)[1], 0.0  # errors grow with w
    for k in range(2, 54):
        w += 0.5**k if excess(w + 0.5**k)[1] < goal else 0.0
    four, _ = excess(w)
    nodes, triangles = FACET_NODES[10], FLAT_TRIANGLES[10]
    parts = [(three, np.full(3, 1 / 3), triangles[:6]), (four, np.r_[np.full(3, (1 - w) / 3), w], triangles[6:])]
    local = [(barycentric @ nodes[corners]).reshape(-1, 2) for barycentric, _, corners in parts]
    hats = [(barycentric @ np.eye(10)[corners]).reshape(-1, 10) for barycentric, _, corners in parts]
    weights = [np.tile(share / 18, len(corners)) for _, share, corners in parts]
    return np.vstack(local), np.concatenate(weights), np.vstack(hats)


def _square_rule() -> Rule:
    """Gauss' three points each way."""
    x, w = np.polynomial.legendre.leggauss(3)
    x, w = (x + 1) / 2, w / 2
    local = np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2)
    return local, np.outer(w, w).ravel(), shape_functions(local, 4)[:, 0]


def _split_square_rule() -> Rule:
    """Three points in each triangle at a corner of a quadrilateral of 8 nodes, four in the square between its middles.

    The rule is as symmetric as the square, so that its degree is three.
    """
    nodes, triangles = FACET_NODES[8], np.array([[0, 4, 7], [1, 5, 4], [2, 6, 5], [3, 7, 6]])
    _, weight, barycentric = _triangle_rule()
    x = (np.polynomial.legendre.leggauss(2)[0] + 1) / 2
    inside = np.zeros((4, 8))
    inside[:, 4:] = shape_functions(np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2), 4)[:, 0]
    hats = np.vstack([(barycentric @ np.eye(8)[triangles]).reshape(-1, 8), inside])
    return hats @ nodes, np.r_[np.tile(weight / 4, 4), np.full(4, 1 / 8)], hats


def _rule_of_halves() -> Rule:
    """Gauss' three points each way on a triangle or a half of a linear quadrilateral, exact to degree 4."""
    x, w = np.polynomial.legendre.leggauss(3)
    x, w = (x + 1) / 2, w / 2
    r, s = np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2).T
    local = np.column_stack([r, s * (1 - r)])
    hats = joined(shape_functions(local, 3)[:, 0], shape_functions(in_square(local), 4)[:, 0])
    return local, np.outer(w, w).ravel() * (1 - r), hats


def _split_rule_of_halves() -> Rule:
    """Three points in each part of a triangle or of a half of a quadrilateral in which the hats of both are smooth.

    Parts of a triangle lie between its nodes. The half is cut at a quarter and at three quarters of its third edge too,
    where the lines between the middles of the quadrilateral's edges meet it. Both halves together are symmetric about
    its middle, so that the rule's degree is three.
    """
    _, weight, barycentric = _triangle_rule()
    places = np.vstack([FACET_NODES[6], [[0.0, 0.25], [0.0, 0.75]]])  # a b c, middles e f g, and these two
    parts = np.array([[0, 3, 6], [6, 3, 5], [3, 4, 5], [5, 4, 7], [7, 4, 2], [3, 1, 4]])
    x, y, z = places[parts].transpose(1, 0, 2)
    areas = abs((y - x)[:, 0] * (z - x)[:, 1] - (y - x)[:, 1] * (z - x)[:, 0])
    local = (barycentric @ places[parts]).reshape(-1, 2)
    hats = joined(half_hats(local), _hats_of_square(in_square(local)))
    return local, np.outer(areas, weight).ravel(), hats


def half_hats(local: Array) -> Array:
    """Hats of corners and middles of edges 01, 12, 20 of a triangle, (k, 6), linear in the four triangles between."""
    corners = np.column_stack([1 - local.sum(axis=1), local])
    ends, others = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    middles = np.minimum(np.minimum(2 * corners, 2 * ends), 1 - 2 * others)
    hats: Array = np.maximum(np.hstack([2 * corners - 1, middles]), 0.0)
    return hats


def _hats_of_square(local: Array) -> Array:
    """Hats of the nodes of a quadrilateral with 8 nodes, (k, 8): see `_split_square_rule`."""
    hats = np.zeros((len(local), 8))
    x, y = local.T
    inside = np.ones(len(local), dtype=bool)
    for corner, (a, b) in enumerate([(x, y), (1 - x, y), (1 - x, 1 - y), (x, 1 - y)]):
        in_corner = a + b < 0.5
        along_x, along_y = [(4, 7), (4, 5), (6, 5), (6, 7)][corner]
        hats[in_corner, corner] = 1 - 2 * (a + b)[in_corner]
        hats[in_corner, along_x], hats[in_corner, along_y] = 2 * a[in_corner], 2 * b[in_corner]
        inside &= ~in_corner
    u, v = (x + y - 0.5)[inside], (y - x + 0.5)[inside]
    hats[inside, 4:] = shape_functions(np.column_stack([u, v]), 4)[:, 0]
    return hats


# By the number of a facet's nodes: points, their weights, and the nodes' hat functions there, (nq, k).
RULES = {
    3: _triangle_rule(),
    4: _square_rule(),
    6: _split_triangle_rule(),
    8: _split_square_rule(),
    10: _cubic_triangle_rule(),
    7: _rule_of_halves(),
    13: _split_rule_of_halves(),
}
