"""Shape functions of facets and their derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..support.arrays import Array

if TYPE_CHECKING:
    pass


_TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # corners in the facet's coordinates


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
