"""The middle of a face of a body, where joints attach."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.optional import require
from .facets import area_vectors, facet_corners
from .quadrature import area_mean

_ROUND = 1e-3  # by the radius: distance of a bore's corners from the cylinder, and of their middle from the mean
_UNKNOWNS = 5  # of a cylinder
_OPEN = 0.3  # a face goes around if the sum of its normals is below this share of the area; half a bore has 0.64


def middle(points: Array, facets: Array) -> Array:
    """Mean place over the area of a face, (3,) [m]; for a bore or a pin, the middle of its axis.

    In a mesh of a cylinder, chords replace arcs. If the elements differ in size, this moves the mean, but not the
    circle through the corners, nor the ends. If a bore's ends are not alike, so that the mean along the axis is not
    midway between them, it is the point of the axis nearest to the mean.

    Parameters
    ----------
    points : (n, 3) array
        Nodes of the body [m].
    facets : (nf, 3), (nf, 6), (nf, 10) or (nf, 4) int array
        The face's.
    """
    mean = area_mean(points, facets)
    normals = area_vectors(points, facets)
    area = np.linalg.norm(normals, axis=1)
    corners = points[np.unique(facet_corners(facets))] - mean
    if np.linalg.norm(normals.sum(axis=0)) > _OPEN * area.sum() or len(corners) <= _UNKNOWNS:
        return mean
    # The normals of a cylinder are perpendicular to its axis.
    axes = np.linalg.eigh(normals.T @ normals)[1].T[::-1]
    local = corners @ axes.T
    radius = np.sqrt((local[:, :2] ** 2).sum(axis=1).mean())

    def axis(x: Array) -> tuple[Array, Array]:
        """A point of the axis and its direction, by two coordinates and two slopes."""
        direction = np.array([x[2], x[3], 1.0])
        return radius * np.array([x[0], x[1], 0.0]), direction / np.linalg.norm(direction)

    def off(x: Array) -> Array:
        point, direction = axis(x)
        misses: Array = np.linalg.norm(np.cross(local - point, direction), axis=1) / radius - x[4]
        return misses

    fit = require("scipy.optimize").least_squares(off, np.r_[np.zeros(4), 1.0], method="lm", xtol=1e-15, ftol=1e-15)
    if abs(fit.fun).max() > _ROUND:
        return mean
    point, direction = axis(fit.x)
    along = local @ direction
    midway = (along.min() + along.max()) / 2
    there = midway if abs(midway) < _ROUND * radius else 0.0
    return np.asarray(mean + (point + direction * (there - point @ direction)) @ axes)
