"""Facets that are bent, in flat triangles that are small enough to look round."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..fe.facets import FLAT_TRIANGLES, by_shape
from ..fe.shapes import FACET_NODES, shape_functions
from ..support.arrays import Array

_BENT = 2e-4  # distance of a side's middle from its chord, by the size of the body, above which a side is halved


class Rounded(NamedTuple):
    """Flat triangles of a surface whose bent sides are halved.

    Attributes
    ----------
    triangles : (k, 3) int array
        Outward, as rows of the nodes and of the points that were added.
    places : (n + m, n) sparse array
        Places of nodes and added points, from those of the n nodes, by the facets' shape functions.
    values : (n + m, n) sparse array
        Values there: between two nodes, their mean, which is never above or below both.
    """

    triangles: Array
    places: sp.csr_matrix
    values: sp.csr_matrix


def rounded(points: Array, facets: Array) -> Rounded:
    """Halve the sides of flat triangles where the facets, (nf, k) int, of nodes at `points`, (n, 3) [m], are bent."""
    count, tolerance = len(points), _BENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    triangles, added = [], dict[str, list[Array]]({"ends": [], "nodes": [], "shares": []})
    for rows, columns in by_shape(facets):
        nodes, flat = facets[rows][:, columns], FLAT_TRIANGLES[len(columns)]
        triangles.append(nodes[:, flat].reshape(-1, 3))
        sides = np.unique(np.sort(np.vstack([flat[:, [0, 1]], flat[:, [1, 2]], flat[:, [2, 0]]]), axis=1), axis=0)
        shares = shape_functions(FACET_NODES[len(columns)][sides].mean(axis=1), len(columns))[:, 0]
        middles = np.einsum("sn,fnd->fsd", shares, points[nodes])
        off = np.linalg.norm(middles - points[nodes[:, sides]].mean(axis=2), axis=2)
        facet, side = np.nonzero(off > tolerance)
        added["ends"].append(np.sort(nodes[facet[:, None], sides[side]], axis=1))
        width = facets.shape[1] - len(columns)
        added["nodes"].append(np.pad(nodes[facet], ((0, 0), (0, width))))
        added["shares"].append(np.pad(shares[side], ((0, 0), (0, width))))
    flat, (ends, nodes, shares) = np.concatenate(triangles), (np.concatenate(parts) for parts in added.values())
    ends, first = np.unique(ends, axis=0, return_index=True)  # neighbours share a side
    more = len(ends)
    entries = np.repeat(np.arange(more), nodes.shape[1]), nodes[first].ravel()
    curved = sp.csr_matrix((shares[first].ravel(), entries), shape=(more, count))
    halves = sp.csr_matrix((np.full(2 * more, 0.5), (np.repeat(np.arange(more), 2), ends.ravel())), shape=(more, count))
    same = sp.eye(count, format="csr")
    return Rounded(
        _halved(flat, ends, count), sp.vstack([same, curved], format="csr"), sp.vstack([same, halves], format="csr")
    )


def _halved(triangles: Array, ends: Array, count: int) -> Array:
    """Triangles with new corners, `count` + i, in the middles of the sides between the nodes `ends`, (m, 2)."""
    size = count + 1
    keys = ends[:, 0] * size + ends[:, 1]  # ascending
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    wanted = sides[..., 0] * size + sides[..., 1]
    place = np.searchsorted(keys, wanted).clip(0, max(len(keys) - 1, 0))
    is_halved = keys[place] == wanted if len(keys) else np.zeros(wanted.shape, dtype=bool)
    halves = is_halved.sum(axis=1)
    # Turn each so that with one halved side it is the first, and with two the third is whole.
    turn = np.where(halves == 1, is_halved.argmax(axis=1), np.where(halves == 2, (is_halved.argmin(axis=1) + 1) % 3, 0))
    columns = (np.arange(3) + turn[:, None]) % 3
    corners, middles = (np.take_along_axis(values, columns, axis=1) for values in (triangles, count + place))
    six = np.hstack([corners, middles])  # corners a b c, then the middles of ab, bc, ca
    patterns = {
        0: [[0, 1, 2]],
        1: [[0, 3, 2], [3, 1, 2]],
        2: [[3, 1, 4], [0, 3, 4], [0, 4, 2]],
        3: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    }
    return np.concatenate([six[halves == n][:, pattern].reshape(-1, 3) for n, pattern in patterns.items()])
