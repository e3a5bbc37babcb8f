"""Compiled loops over triangles; `rigid_mesh` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled, inlined, inner

_DEEPEST = 64  # boxes within boxes: halves of as many triangles as a computer can hold


@inlined
def to_box(x: Array, low: Array, high: Array) -> float:
    """Square of the distance of a point to a box [m2]."""
    total = 0.0
    for d in range(3):
        miss = max(low[d] - x[d], 0.0, x[d] - high[d])
        total += miss * miss
    return total


@inner
def on_triangle(x: Array, corners: Array) -> tuple[float, float, int]:
    """Weights of the second and third corner at the closest place of a triangle, and its feature, see `rigid_mesh`."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for d in range(3):
        ab, ac = corners[1, d] - corners[0, d], corners[2, d] - corners[0, d]
        d1 += ab * (x[d] - corners[0, d])
        d2 += ac * (x[d] - corners[0, d])
        d3 += ab * (x[d] - corners[1, d])
        d4 += ac * (x[d] - corners[1, d])
        d5 += ab * (x[d] - corners[2, d])
        d6 += ac * (x[d] - corners[2, d])
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0, 1
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0, 2
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0, 3
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0, 4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / (d4 - d3 + d5 - d6)
        return 1.0 - w, w, 5
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6), 6
    return vb / (va + vb + vc), vc / (va + vb + vc), 0


@compiled
def closest_triangles(
    x: Array,
    corners: Array,
    low: Array,
    high: Array,
    second: Array,
    first: Array,
    last: Array,
    order: Array,
    triangle: Array,
    place: Array,
    feature: Array,
) -> None:
    """Set the closest triangle of each point, (k,), the closest place on it, (k, 3), and its feature, (k,)."""
    waiting, at = np.empty(_DEEPEST, dtype=np.int64), np.empty(3)
    for i in range(len(x)):
        best, count, waiting[0] = np.inf, 1, 0
        while count:
            count -= 1
            box = waiting[count]
            if to_box(x[i], low[box], high[box]) >= best:
                continue
            if second[box]:
                near, far = box + 1, second[box]
                if to_box(x[i], low[far], high[far]) < to_box(x[i], low[near], high[near]):
                    near, far = far, near
                waiting[count], waiting[count + 1] = far, near
                count += 2
                continue
            for k in range(first[box], last[box]):
                t = order[k]
                v, w, kind = on_triangle(x[i], corners[t])
                square = 0.0
                for d in range(3):
                    a = corners[t, 0, d]
                    at[d] = a + v * (corners[t, 1, d] - a) + w * (corners[t, 2, d] - a)
                    square += (x[i, d] - at[d]) ** 2
                if square < best:
                    best, triangle[i], feature[i] = square, t, kind
                    for d in range(3):
                        place[i, d] = at[d]
