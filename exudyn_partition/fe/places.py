"""Points of a body by its nodes: the nearest node, those around a point, and interpolation between them."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..support.arrays import Array, Vector
from ..support.checks import validate_vector

_NEAR = 12  # nodes for the interpolation of a point's motion: more than lie on one face of a tetrahedron or hexahedron


def nearest_node(points: Array, point: Vector) -> int:
    """Index of the node of a body, points (n, 3), that is nearest to `point`, (3,) [m].

    Raises
    ------
    InputError
        If every node is further away than a tenth of the body's size.
    """
    distance = np.linalg.norm(points - validate_vector("point", point), axis=1)
    size = np.ptp(points, axis=0).max()
    if distance.min() > 0.1 * size:
        raise InputError(
            f"point: {point} is {distance.min():.4g} m away from the nearest node of a body of {size:.4g} m; points "
            "are given in the body's own coordinates, without referencePosition"
        )
    return int(distance.argmin())


def validate_long_axis(long_axis: Vector | None, radius: float) -> Array | None:
    """Return the longer semi-axis of an ellipsoid as a read-only vector, (3,) [m]; None means a ball of that radius.

    Raises
    ------
    InputError
        If it is shorter than the radius.
    """
    if long_axis is None:
        return None
    vector = validate_vector("long_axis", long_axis)
    length = float(np.linalg.norm(vector))
    if length < radius:
        raise InputError(
            f"long_axis: expected a vector of at least radius = {radius:.4g} m, the other semi-axes, got {length:.4g} m"
        )
    return vector


def distance_within(points: Array, center: Array, radius: float, long_axis: Array | None) -> Array:
    """Distance of points, (n, 3) [m], from a centre, (n,) [m]: at most `radius` within the ball or the ellipsoid.

    The ellipsoid is round about its long axis; ways along this are shortened to those of the ball.
    """
    away = points - center
    if long_axis is not None:
        length = np.linalg.norm(long_axis)
        away = away - np.outer(away @ long_axis / length, (1 - radius / length) * long_axis / length)
    distance: Array = np.linalg.norm(away, axis=1)
    return distance


def interpolation(points: Array, point: Vector) -> tuple[Array, Array]:
    """Nodes around a point, (k,), and weights, (k,), that reproduce every linear field there.

    So the point follows every rigid motion exactly, and a force at it has its exact resultant and moment. The nearest
    node has the weight one; to this come weights that carry its motion on to the point, by the smallest sum of squares
    of distance times weight. Steep fields, as around a dent, are then not blurred over all the nodes.

    Parameters
    ----------
    points : (n, 3) array
        Places of the nodes [m].
    point : (3,) array
        Place of the point [m].

    Raises
    ------
    InputError
        If the point is further from the nearest nodes than these are from each other.
    """
    point = validate_vector("point", point)
    distance = np.linalg.norm(points - point, axis=1)
    order = np.argsort(distance, kind="stable")
    near = order[:_NEAR]
    if distance[near[0]] > np.linalg.norm(points[near[1:]] - points[near[0]], axis=1).max():
        raise InputError(
            f"point: expected a point on or in the body, got {point}, {distance[near[0]]:.4g} m away from its nearest "
            f"node at {points[near[0]]}; give points in the body's own coordinates, those of its mesh"
        )
    if distance[near[0]] < 1e-9 * distance[near[-1]]:
        return near[:1], np.ones(1)
    while True:
        size = distance[near[-1]]
        closeness = size / distance[near]
        linear = np.vstack([np.ones(len(near)), (points[near] - point).T / size])
        way = np.array([1.0, 0.0, 0.0, 0.0]) - linear[:, 0]  # from the nearest node to the point
        more = closeness * np.linalg.lstsq(linear * closeness, way, rcond=None)[0]
        # Nodes of one plane cannot tell what is beside it.
        if np.allclose(linear @ more, way, rtol=0.0, atol=1e-9) or len(near) == len(points):
            more[0] += 1.0
            return near, more
        near = order[: 2 * len(near)]
