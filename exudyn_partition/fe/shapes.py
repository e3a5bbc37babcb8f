"""Shape functions of facets and volume elements, and their derivatives."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

# Facets: corners in the facet's coordinates.
_TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

# Shape functions as polynomials: coefficients of 1, r, s, r^2, rs, s^2, a row for each node.
_POLYNOMIALS = {
    3: [[1, -1, -1, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]],
    4: [[1, -1, -1, 0, 1, 0], [0, 1, 0, 0, -1, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, -1, 0]],
    6: [
        [1, -3, -3, 2, 4, 2],
        [0, -1, 0, 2, 0, 0],
        [0, 0, -1, 0, 0, 2],
        [0, 4, 0, -4, -4, 0],
        [0, 0, 0, 0, 4, 0],
        [0, 0, 4, 0, -4, -4],
    ],
}


def _table(polynomials: list[list[int]]) -> Array:
    """(6, 3n) array: coefficients of all values, then of the derivatives by r, then by s."""
    value = np.array(polynomials, dtype=float).T
    by_r, by_s = np.zeros((2, *value.shape))
    by_r[0], by_r[1], by_r[2] = value[1], 2 * value[3], value[4]
    by_s[0], by_s[1], by_s[2] = value[2], value[4], 2 * value[5]
    return np.hstack([value, by_r, by_s])


_TABLES = {n_nodes: _table(polynomials) for n_nodes, polynomials in _POLYNOMIALS.items()}

# Second derivatives by rr, rs and ss, the same everywhere in a facet, (n, 3).
SECOND_DERIVATIVES = {n_nodes: np.array(p, dtype=float)[:, 3:] * [2, 1, 2] for n_nodes, p in _POLYNOMIALS.items()}


def corners_of(facets: Array) -> Array:
    """Coordinates of the corners in their facet, (3 or 4, 2)."""
    return _SQUARE if facets.shape[1] == 4 else _TRIANGLE


def shape_functions(local: Array, n_nodes: int) -> Array:
    """Shape functions of triangles or quads and their derivatives.

    Parameters
    ----------
    local : (k, 2) array
        Coordinates (r, s) with r, s >= 0, r + s <= 1, or r, s <= 1 for quads.
    n_nodes : {3, 6, 4}
        Triangle: corners, then mid-side nodes of edges 01, 12, 20. Quad: corners.

    Returns
    -------
    (k, 3, n_nodes) array
        Values, derivatives by r, derivatives by s.
    """
    monomials = np.empty((len(local), 6))
    monomials[:, 0] = 1.0
    monomials[:, 1:3] = local
    np.multiply(local[:, :1], local, out=monomials[:, 3:5])
    np.multiply(local[:, 1], local[:, 1], out=monomials[:, 5])
    return (monomials @ _TABLES[n_nodes]).reshape(len(local), 3, n_nodes)


# Tetrahedra: edges in the order in which VTK lists their mid-side nodes, and all nodes in local coordinates.
TET_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_CORNERS = np.vstack([np.zeros(3), np.eye(3)])
TET_NODES = np.vstack([_CORNERS, _CORNERS[TET_EDGES].mean(axis=1)])
_CORNER_GRADIENT = np.vstack([-np.ones(3), np.eye(3)])  # of the barycentric coordinates


def tetrahedron_functions(local: Array, n_nodes: int) -> tuple[Array, Array]:
    """Shape functions of tetrahedra, (m, n_nodes), and their derivatives, (m, n_nodes, 3), at `local`, (m, 3).

    Corners stand first, then the mid-side nodes of `TET_EDGES`.
    """
    corner = np.column_stack([1 - local.sum(axis=1), local])
    if n_nodes == 4:
        return corner, np.broadcast_to(_CORNER_GRADIENT, (len(local), 4, 3))
    a, b = TET_EDGES.T
    values = np.hstack([corner * (2 * corner - 1), 4 * corner[:, a] * corner[:, b]])
    at_corners = (4 * corner - 1)[:, :, None] * _CORNER_GRADIENT
    at_edges = 4 * (corner[:, a, None] * _CORNER_GRADIENT[b] + corner[:, b, None] * _CORNER_GRADIENT[a])
    return values, np.concatenate([at_corners, at_edges], axis=1)


def integration_gradients(n_nodes: int) -> Array:
    """(q, n_nodes, 3) array: derivatives of an element's shape functions at the q points where it is integrated.

    One point for tetrahedra of 4 nodes, four for those of 10, and Gauss' eight for hexahedra of 8.
    """
    if n_nodes == 8:
        sign = np.array([[-1, 1, 1, -1] * 2, [-1, -1, 1, 1] * 2, [-1] * 4 + [1] * 4]).T
        factors = (1 + sign * sign[:, None] / np.sqrt(3)) / 2  # at each Gauss point, of each node, along each axis
        others = factors[..., [1, 0, 0]] * factors[..., [2, 2, 1]]
        return np.asarray(sign / 2 * others)
    if n_nodes == 4:
        return _CORNER_GRADIENT[None]
    at = np.full((4, 4), (5 - np.sqrt(5)) / 20) + np.eye(4) / np.sqrt(5)  # four-point rule, barycentric
    return tetrahedron_functions(at[:, 1:], 10)[1]
