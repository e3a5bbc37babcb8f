"""Distance of convex hulls of points from each other, bounded from below."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array

_STEPS = 40  # at most; each has the points of both hulls that are furthest along one direction
_ACCURATE = 0.05  # difference of both bounds by the upper one, below which the lower one is good enough


def hull_distance(first: Array, second: Array) -> float:
    """Lower bound of the distance of two convex hulls of points, (k, 3) and (m, 3) [m]; not above zero if they overlap.

    By Gilbert's algorithm (SIAM J. Control 4, 61-80, 1966): the points of both hulls that are furthest along a
    direction bound the distance, and give a better direction. A vector from hull to hull is the upper bound.
    """
    way, least = first.mean(axis=0) - second.mean(axis=0), -math.inf
    for _ in range(_STEPS):
        size = float(np.linalg.norm(way))
        if size == 0.0:
            break
        along, other = first @ way, second @ way
        near, far = along.argmin(), other.argmax()
        least = max(least, float(along[near] - other[far]) / size)
        if least >= (1 - _ACCURATE) * size:
            break
        step = first[near] - second[far] - way
        square = float(step @ step)
        if square == 0.0:
            break
        way = way + min(max(-float(way @ step) / square, 0.0), 1.0) * step
    return least
