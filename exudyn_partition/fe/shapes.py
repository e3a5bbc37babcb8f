"""Shape functions of facets and volume elements, and their derivatives."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from .halves import in_square, joined

# Facets: nodes in the facet's coordinates. Corners come first, then the nodes on edges 01, 12, ..., then the middle.
_TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_RING = np.array([[0, 1], [1, 2], [2, 0]])
QUADS = (4, 8)  # numbers of nodes of quadrilaterals
CUBIC = (8, 10, 13)  # of facets whose polynomials have terms of degree three


def nodes_on_edges(corners: Array, edges: Array) -> Array:
    """Points a third and two thirds along each edge, (..., 2 k, d), from its first corner to its second.

    Parameters
    ----------
    corners : (..., n, d) array
    edges : (k, 2) int array
    """
    a, b = corners[..., edges[:, 0], :], corners[..., edges[:, 1], :]
    value: Array = np.stack([(2 * a + b) / 3, (a + 2 * b) / 3], axis=-2)
    return value.reshape(*corners.shape[:-2], -1, corners.shape[-1])


FACET_NODES = {
    3: _TRIANGLE,
    4: _SQUARE,
    6: np.vstack([_TRIANGLE, _TRIANGLE[_RING].mean(axis=1)]),
    8: np.vstack([_SQUARE, (_SQUARE + np.roll(_SQUARE, -1, axis=0)) / 2]),
    10: np.vstack([_TRIANGLE, nodes_on_edges(_TRIANGLE, _RING), np.full((1, 2), 1 / 3)]),
}
# Of triangles or halves of quadrilaterals, see `halves`: functions times these are the place in the triangle.
FACET_NODES |= {k: np.vstack([FACET_NODES[n], np.zeros((k - n, 2))]) for k, n in ((7, 3), (13, 6))}

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


def _monomials(local: Array, n_nodes: int) -> Array:
    """1, r, s, r^2, rs, s^2 at points, (k, 6); for facets of 8 or 10 nodes also r^3, r^2 s, r s^2, s^3, (k, 10)."""
    cubic = n_nodes in CUBIC
    monomials = np.empty((len(local), 10 if cubic else 6))
    monomials[:, 0] = 1.0
    monomials[:, 1:3] = local
    np.multiply(local[:, :1], local, out=monomials[:, 3:5])
    np.multiply(local[:, 1], local[:, 1], out=monomials[:, 5])
    if cubic:
        np.multiply(local[:, :1], monomials[:, 3:6], out=monomials[:, 6:9])
        np.multiply(local[:, 1], monomials[:, 5], out=monomials[:, 9])
    return monomials


def _cubic_polynomials(n_nodes: int) -> Array:
    """(n_nodes, 10) array: Lagrange's polynomials of the nodes of `CUBIC` facets; their coefficients are halves.

    Those of quadrilaterals have neither r^3 nor s^3 (serendipity).
    """
    powers = np.setdiff1d(np.arange(10), [6, 9]) if n_nodes == 8 else np.arange(10)
    value = np.zeros((n_nodes, 10))
    value[:, powers] = np.rint(2 * np.linalg.inv(_monomials(FACET_NODES[n_nodes], n_nodes)[:, powers]).T) / 2
    return value


def _derivative(value: Array, axis: int) -> Array:
    """Coefficients of derivatives by r or s, of the same size as those of the polynomials, `value`, (6 or 10, n)."""
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    result = np.zeros_like(value)
    for row, exponents in enumerate(powers[: len(value)]):
        if exponents[axis]:
            lower = (exponents[0] - (axis == 0), exponents[1] - (axis == 1))
            result[powers.index(lower)] = exponents[axis] * value[row]
    return result


def _table(polynomials: Array) -> Array:
    """(6 or 10, 3n) array: coefficients of all values, then of the derivatives by r, then by s."""
    value = polynomials.T
    return np.ascontiguousarray(np.hstack([value, _derivative(value, 0), _derivative(value, 1)]))


_COEFFICIENTS = {n: np.array(p, dtype=float) for n, p in _POLYNOMIALS.items()}
_COEFFICIENTS |= {n: _cubic_polynomials(n) for n in (8, 10)}
TABLES = {n_nodes: _table(polynomials) for n_nodes, polynomials in _COEFFICIENTS.items()}


def _of_halves(n: int, n_triangle: int, n_square: int) -> Array:
    """(n, 6 or 10) array: polynomials of facets that are triangles or halves of quadrilaterals, see `halves`."""
    local = FACET_NODES[10 if n in CUBIC else 6]
    functions = joined(shape_functions(local, n_triangle)[:, 0], shape_functions(in_square(local), n_square)[:, 0])
    return np.asarray(np.rint(2 * np.linalg.solve(_monomials(local, n), functions).T) / 2)


def shape_functions(local: Array, n_nodes: int) -> Array:
    """Shape functions of triangles or quads and their derivatives.

    Parameters
    ----------
    local : (k, 2) array
        Coordinates (r, s) with r, s >= 0, r + s <= 1, or r, s <= 1 for quads.
    n_nodes : {3, 6, 10, 4, 8, 7, 13}
        Triangle: corners, then nodes on the edges 01, 12, 20, then the middle, see `FACET_NODES`. Quad: corners, then
        nodes on its edges. Those of 7 and 13 nodes are triangles or halves of quads, see `halves`.

    Returns
    -------
    (k, 3, n_nodes) array
        Values, derivatives by r, derivatives by s.
    """
    return (_monomials(local, n_nodes) @ TABLES[n_nodes]).reshape(len(local), 3, n_nodes)


for _n, _parts in {7: (3, 4), 13: (6, 8)}.items():
    _COEFFICIENTS[_n] = _of_halves(_n, *_parts)
    TABLES[_n] = _table(_COEFFICIENTS[_n])
_BENDS = {
    n: np.stack([_derivative(_derivative(_COEFFICIENTS[n].T, i), j) for i, j in ((0, 0), (0, 1), (1, 1))], axis=2)
    for n in CUBIC
}

# Second derivatives by rr, rs and ss, the same everywhere in a facet that is not cubic, (n, 3).
_SECOND_DERIVATIVES = {n: p[:, 3:] * [2, 1, 2] for n, p in _COEFFICIENTS.items() if n not in CUBIC}


def curvature(local: Array, arms: Array) -> Array:
    """Second derivatives by rr, rs and ss of the sum of the shape functions times `arms`, (k, n), at `local`, (k, 2).

    Returns
    -------
    (3, k) array
    """
    n = arms.shape[1]
    if n not in CUBIC:
        return np.asarray((arms @ _SECOND_DERIVATIVES[n]).T)
    bends: Array = np.einsum("km,mnd,kn->dk", _monomials(local, n), _BENDS[n], arms, optimize=True)
    return bends


def linear_shares(n_nodes: int) -> Array:
    """(n_nodes, 3 or 4) array: weights of a facet's corners at its nodes, of functions linear between corners."""
    value: Array = np.rint(6 * shape_functions(FACET_NODES[n_nodes], 4 if n_nodes in QUADS else 3)[:, 0]) / 6
    return value


def corners_of(facets: Array) -> Array:
    """Coordinates of the corners in their facet, (3 or 4, 2)."""
    return _SQUARE if facets.shape[1] in QUADS else _TRIANGLE


ORDERS = {4: 1, 10: 2, 20: 3, 8: 1}  # of tetrahedra and hexahedra, by their number of nodes

# Tetrahedra: edges and faces in the order in which VTK lists the nodes on them, and all nodes in local coordinates.
TET_EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
TET_FACES = np.array([[0, 1, 3], [1, 2, 3], [0, 2, 3], [0, 1, 2]])
_CORNERS = np.vstack([np.zeros(3), np.eye(3)])
TET_NODES = {
    4: _CORNERS,
    10: np.vstack([_CORNERS, _CORNERS[TET_EDGES].mean(axis=1)]),
    20: np.vstack([_CORNERS, nodes_on_edges(_CORNERS, TET_EDGES), _CORNERS[TET_FACES].mean(axis=1)]),
}
_CORNER_GRADIENT = np.vstack([-np.ones(3), np.eye(3)])  # of the barycentric coordinates

# Corners of a tetrahedron's faces, outward for positive volume.
_TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def _tetrahedron_faces(n_nodes: int, n_on_face: int) -> Array:
    """(4, n_on_face) array: the nodes of a tetrahedron on each of its faces, in the order of `FACET_NODES`."""
    nodes = TET_NODES[n_nodes]
    places = linear_shares(n_on_face) @ nodes[_TRIANGLES]
    found: Array = np.linalg.norm(places[:, :, None] - nodes, axis=3).argmin(axis=2)
    return found


# Local faces of an element by its number of nodes, outward for positive volume: see `FACET_NODES`.
CELL_FACES = {
    4: _TRIANGLES,
    10: _tetrahedron_faces(10, 6),
    20: _tetrahedron_faces(20, 10),
    8: np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]),
}


def tetrahedron_functions(local: Array, n_nodes: int) -> tuple[Array, Array]:
    """Shape functions of tetrahedra, (m, n_nodes), and their derivatives, (m, n_nodes, 3), at `local`, (m, 3).

    Corners stand first, then the nodes on `TET_EDGES`, one or two each, then those on `TET_FACES`.
    """
    corner = np.column_stack([1 - local.sum(axis=1), local])
    if n_nodes == 4:
        return corner, np.broadcast_to(_CORNER_GRADIENT, (len(local), 4, 3))
    if n_nodes == 20:
        return _cubic_tetrahedron(corner)
    a, b = TET_EDGES.T
    values = np.hstack([corner * (2 * corner - 1), 4 * corner[:, a] * corner[:, b]])
    at_corners = (4 * corner - 1)[:, :, None] * _CORNER_GRADIENT
    at_edges = 4 * (corner[:, a, None] * _CORNER_GRADIENT[b] + corner[:, b, None] * _CORNER_GRADIENT[a])
    return values, np.concatenate([at_corners, at_edges], axis=1)


def _cubic_tetrahedron(corner: Array) -> tuple[Array, Array]:
    """`tetrahedron_functions` of order 3 at barycentric coordinates, (m, 4)."""
    m = len(corner)
    a, b = TET_EDGES.T
    x, y = corner[:, a], corner[:, b]
    to_a, to_b = (_CORNER_GRADIENT[ends] for ends in (a, b))

    def along(x: Array, y: Array, to_x: Array, to_y: Array) -> tuple[Array, Array]:
        """Functions of the nodes near the corners of x."""
        by_x, by_y = 4.5 * y * (6 * x - 1), 4.5 * x * (3 * x - 1)
        return 4.5 * x * y * (3 * x - 1), by_x[:, :, None] * to_x + by_y[:, :, None] * to_y

    near_a, near_b = along(x, y, to_a, to_b), along(y, x, to_b, to_a)
    on_edges = np.stack([near_a[0], near_b[0]], axis=2).reshape(m, -1)
    slopes = np.stack([near_a[1], near_b[1]], axis=2).reshape(m, -1, 3)
    f, g, h = (corner[:, ends] for ends in TET_FACES.T)
    of_faces = 27 * np.stack([g * h, f * h, f * g], axis=2)
    values = np.hstack([corner * (3 * corner - 1) * (3 * corner - 2) / 2, on_edges, 27 * f * g * h])
    at_corners = (13.5 * corner**2 - 9 * corner + 1)[:, :, None] * _CORNER_GRADIENT
    at_faces = np.einsum("mfi,fid->mfd", of_faces, _CORNER_GRADIENT[TET_FACES])
    return values, np.concatenate([at_corners, slopes, at_faces], axis=1)


def integration_gradients(n_nodes: int) -> Array:
    """(q, n_nodes, 3) array: derivatives of an element's shape functions at the q points where it is integrated.

    One point for tetrahedra of 4 nodes, four for those of 10, Gauss' 27 on a collapsed cube for those of 20, and
    Gauss' eight for hexahedra of 8.
    """
    if n_nodes == 8:
        sign = np.array([[-1, 1, 1, -1] * 2, [-1, -1, 1, 1] * 2, [-1] * 4 + [1] * 4]).T
        factors = (1 + sign * sign[:, None] / np.sqrt(3)) / 2  # at each Gauss point, of each node, along each axis
        others = factors[..., [1, 0, 0]] * factors[..., [2, 2, 1]]
        return np.asarray(sign / 2 * others)
    return tetrahedron_functions(integration_points(n_nodes), n_nodes)[1]


def integration_points(n_nodes: int) -> Array:
    """(q, 3) array: points of `integration_gradients` of tetrahedra, in local coordinates."""
    if n_nodes == 4:
        return np.full((1, 3), 0.25)
    if n_nodes == 20:
        x = (np.polynomial.legendre.leggauss(3)[0] + 1) / 2
        r, s, t = (grid.ravel() for grid in np.meshgrid(x, x, x))
        return np.column_stack([r, s * (1 - r), t * (1 - r) * (1 - s)])
    at = np.full((4, 4), (5 - np.sqrt(5)) / 20) + np.eye(4) / np.sqrt(5)  # four-point rule, barycentric
    return np.asarray(at[:, 1:])


def integration_weights(n_nodes: int) -> Array:
    """(q,) array: weights of the points of `integration_gradients`; their sum is the element's volume there."""
    if n_nodes == 20:
        x, w = (values / 2 for values in np.polynomial.legendre.leggauss(3))
        end = 0.5 - x  # from the faces of the cube that collapse
        return np.asarray(np.einsum("i,j,k->jik", w * end**2, w * end, w)).ravel()  # in the order of meshgrid
    return {4: np.array([1 / 6]), 10: np.full(4, 1 / 24), 8: np.ones(8)}[n_nodes]
