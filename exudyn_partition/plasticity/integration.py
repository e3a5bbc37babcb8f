"""Integration points of the elements of a plastic zone, whatever their kinds."""

from __future__ import annotations

import numpy as np

from ..fe.elements import HEXAHEDRA, Kind, kinds_of
from ..fe.shapes import integration_gradients, integration_points, integration_weights
from ..support.arrays import Array

_EQUAL = 1e-9  # shares of corners that differ by rounding alone


def flow_places(kind: Kind) -> Array:
    """Local coordinates, (q, 3), of the points of `flow_rule`."""
    if not kind.hexahedral:
        return integration_points(len(kind.nodes))
    if kind.name == "hexahedron":  # each point is the one nearest to a corner
        return np.asarray(0.5 + (kind.nodes - 0.5) / np.sqrt(3))
    return kind.gauss(2)[0]


def nearest_corners(kind: Kind) -> Array:
    """(q, corners) bool array: which corner of an element is nearest to each of `flow_places`; all if it has one."""
    shares = HEXAHEDRA[8][kind.corners].functions(flow_places(kind))[0]
    return np.asarray(shares > (1 - _EQUAL) * shares.max(axis=1)[:, None])


def flow_rule(kind: Kind) -> tuple[Array, Array]:
    """Derivatives of the shape functions, (q, n, 3), and weights, (q,), where the elements of a zone may yield.

    Quadratic hexahedra, wedges and pyramids yield at two points each way, as C3D20R: at more they would lock.
    """
    n = len(kind.nodes)
    if not kind.hexahedral or kind.name == "hexahedron":
        return integration_gradients(n), integration_weights(n)
    local, weights = kind.gauss(2)
    return kind.functions(local)[1], weights


def exact_rule(kind: Kind) -> tuple[Array, Array]:
    """Derivatives and weights with which the stiffness of elements is integrated."""
    return (kind.gradients, kind.rule[1]) if kind.hexahedral and kind.order == 2 else flow_rule(kind)


def points_an_element(cells: Array, hexahedra: bool) -> int:
    """Number of points where an element of a zone may yield; all its kinds have the same."""
    return len(flow_rule(kinds_of(cells, hexahedra)[0][0])[1])


def at_points(points: Array, cells: Array, hexahedra: bool, *, exact: bool = False) -> tuple[Array, Array]:
    """Gradients of shape functions, (c, q, k, 3) [1/m], and volumes, (c, q) [m3], at the points of c elements.

    Parameters
    ----------
    points : (n, 3) array
    cells : (c, k) int array
    hexahedra : bool
        Whether cells are rows of hexahedra, see `fe.elements`.
    exact : bool
        Whether points are those of `exact_rule`; default: of `flow_rule`.
    """
    both: tuple[Array, Array] | None = None
    for kind, rows in kinds_of(cells, hexahedra):
        derivatives, weights = exact_rule(kind) if exact else flow_rule(kind)
        jacobian = np.einsum("cka,qkj->cqaj", points[cells[rows][:, kind.columns]], derivatives)
        gradient = derivatives @ np.linalg.inv(jacobian)  # (c, q, n, 3)
        if both is None:
            q = len(weights)
            both = np.zeros((len(cells), q, cells.shape[1], 3)), np.zeros((len(cells), q))
        both[0][rows] = kind.on_row(gradient.reshape(-1, *gradient.shape[2:])).reshape(len(rows), q, -1, 3)
        both[1][rows] = weights * np.linalg.det(jacobian)
    assert both is not None
    return both
