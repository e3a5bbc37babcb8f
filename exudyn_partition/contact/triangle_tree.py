"""A tree of boxes around triangles, in which the triangle closest to a point is found by a few comparisons.

References
----------
C. Ericson, Real-Time Collision Detection, 2005, section 6.1: hierarchies of bounding boxes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..support.arrays import Array

_FEW = 4  # triangles in a box that is not divided


class TriangleTree(NamedTuple):
    """Boxes around triangles, each before its halves; the first half of a box follows it.

    Parameters
    ----------
    low, high : (n, 3) arrays
        Corners of the boxes [m].
    second : (n,) int array
        Number of a box's second half; zero for a box that is not divided.
    first, last : (n,) int arrays
        The triangles of a box are those with the numbers ``order[first:last]``.
    order : (m,) int array
    """

    low: Array
    high: Array
    second: Array
    first: Array
    last: Array
    order: Array

    @classmethod
    def of(cls, corners: Array) -> TriangleTree:
        """Divide boxes at the middle one of their triangles along their longest edge; `corners` are (m, 3, 3) [m]."""
        centroids, order = corners.mean(axis=1), np.arange(len(corners))
        lows, highs = corners.min(axis=1), corners.max(axis=1)
        bounds: list[tuple[Array, Array]] = []
        ranges: list[tuple[int, int]] = []
        second: list[int] = []
        todo = [(0, len(corners), -1)]
        while todo:
            first, last, before = todo.pop()
            inside = order[first:last]
            if before >= 0:
                second[before] = len(second)
            bounds.append((lows[inside].min(axis=0), highs[inside].max(axis=0)))
            ranges.append((first, last))
            second.append(0)
            if last - first > _FEW:
                middle = (first + last) // 2
                along = centroids[inside, np.ptp(centroids[inside], axis=0).argmax()]
                order[first:last] = inside[np.argpartition(along, middle - first)]
                todo += [(middle, last, len(second) - 1), (first, middle, -1)]  # the last one comes next
        low, high = (np.array(ends) for ends in zip(*bounds, strict=True))
        starts, ends = (np.array(values) for values in zip(*ranges, strict=True))
        return cls(low, high, np.array(second), starts, ends, order)
