"""Facets of patches with triangles and quadrilaterals: all are triangles, of which some are halves of quadrilaterals.

Loops over facets know one set of shape functions. So these facets have the nodes of both: first a triangle's, then
those of the quadrilateral whose half it is. A half of a quadrilateral a b c d is the triangle a b c:
                half                         triangle
    linear      a b c a | b c d              a b c a | a a a
    quadratic   a b c e f a | b c d e f g h  a b c e f g | a a a a a a a
Shape functions of the second part are those of the quadrilateral less those of the triangle; that of the first node is
one less all others. So a node that stands in the place of another one, here a, has no effect there. All that sums up to
one in a facet is written like this: shape functions, hats, shares.
"""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

# Of facets in this form, by their number of nodes: number of nodes of a triangle; columns of a quadrilateral's nodes.
TRIANGLE = {7: 3, 13: 6}
QUADRILATERAL = {7: [0, 4, 5, 6], 13: [0, 6, 7, 8, 9, 10, 11, 12]}


def in_halves(facets: Array) -> Array:
    """Triangles and halves of quadrilaterals, (m, 7) or (m, 13) int, of facets with both, (nf, 4) or (nf, 8) int."""
    is_folded = facets[:, 2] == facets[:, 3]
    triangles, quads = facets[is_folded], facets[~is_folded]
    # The other half is that of the same quadrilateral, whose nodes begin at the opposite corner.
    turned = [2, 3, 0, 1] if facets.shape[1] == 4 else [2, 3, 0, 1, 6, 7, 4, 5]
    halves = np.stack([quads, quads[:, turned]], axis=1).reshape(-1, facets.shape[1])
    first = [[0, 1, 2, 0], [0, 1, 2, 0]] if facets.shape[1] == 4 else [[0, 1, 2, 4, 5, 7], [0, 1, 2, 4, 5, 0]]
    of_triangles = np.hstack([triangles[:, first[0]], np.repeat(triangles[:, :1], facets.shape[1] - 1, axis=1)])
    return np.vstack([of_triangles, np.hstack([halves[:, first[1]], halves[:, 1:]])])


def whole_facets(facets: Array) -> list[Array]:
    """Triangles, and quadrilaterals twice, of facets in halves; other facets are returned as they are."""
    k = facets.shape[1]
    if k not in TRIANGLE:
        return [facets]
    is_half = facets[:, QUADRILATERAL[k][2]] != facets[:, 0]
    return [facets[~is_half][:, : TRIANGLE[k]], facets[is_half][:, QUADRILATERAL[k]]]


def in_square(local: Array) -> Array:
    """Coordinates in a quadrilateral of places in its half, (k, 2)."""
    r, s = local.T
    return np.column_stack([r + s, s])


def joined(triangle: Array, quadrilateral: Array) -> Array:
    """Values of functions of such facets, (..., 7) or (..., 13), of those of a triangle and of a quadrilateral.

    Both sum up to one, or their derivatives to zero; those of the triangle have `TRIANGLE` nodes.
    """
    total = triangle.sum(axis=-1, keepdims=True)
    b_c_e_f = [1, 2] if triangle.shape[-1] == 3 else [1, 2, 3, 4]
    of_quadrilateral = quadrilateral[..., 1:].copy()
    at = [0, 1] if triangle.shape[-1] == 3 else [0, 1, 3, 4]
    of_quadrilateral[..., at] -= triangle[..., b_c_e_f]
    pad = np.zeros_like(total) if triangle.shape[-1] == 3 else triangle[..., :0]
    others = np.concatenate([triangle[..., 1:], pad, of_quadrilateral], axis=-1)
    return np.asarray(np.concatenate([total - others.sum(axis=-1, keepdims=True), others], axis=-1))
