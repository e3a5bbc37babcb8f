"""How stiff a body's skin is when the body lies on it: what limits explicit steps of contact that may be anywhere.

Nobody knows beforehand which rows will close. A body is as stiff as it gets when it lies flat on something rigid. So it
is laid on each of its six sides. Few nodes of each side are held, spread over it: they hold the kept shapes, which are
smooth, almost as well as all nodes do, and ask for few columns of the flexibility.
"""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np

from ..algebra.complementarity import regularised
from ..algebra.products import dense
from ..fe.model import node_dofs
from ..reduction.body import ReducedBody
from ..support.arrays import Array

_HELD = 60  # nodes that are held on each side
_FLAT = 0.25  # of a facet's size: nodes that are no farther from the outermost one belong to the side
_KEPT: WeakKeyDictionary[ReducedBody, dict[tuple[int, bool], float]] = WeakKeyDictionary()


def stiffest_landing(body: ReducedBody, patch: int, *, sticks: bool) -> float:
    """Largest squared circular frequency of a body that lies on a side of its patch, [rad2/s2].

    It is computed once for a body.

    Parameters
    ----------
    body : ReducedBody
        With a residual flexibility.
    patch : int
        Number of the patch.
    sticks : bool
        Whether nodes are held in all directions, as by friction, or along the normal of the side.
    """
    kept = _KEPT.setdefault(body, {})
    if (patch, sticks) not in kept:
        scale = 1 / np.sqrt(body.mass.diagonal())
        K = body.stiffness.toarray()
        squares = [_largest(scale, K + support) for support in _landings(body, patch, sticks)]
        kept[patch, sticks] = max(squares)
    return kept[patch, sticks]


def _largest(scale: Array, stiffness: Array) -> float:
    return float(np.linalg.eigvalsh(scale[:, None] * stiffness * scale)[-1])


def _landings(body: ReducedBody, patch: int, sticks: bool) -> Iterator[Array]:
    """Stiffness on the body's coordinates, (n, n), of each landing."""
    surface = body.surface(np.zeros(3), patch)
    axes = np.linalg.svd(surface.points - surface.points.mean(axis=0), full_matrices=False)[2]
    by_normals = body.partition.patches[patch].n_axes == 1
    for outward in np.vstack([axes, -axes]):
        height = surface.points @ outward
        side = np.flatnonzero(height >= height.max() - _FLAT * surface.facet_size)
        chosen = side[spread_over(surface.points[side], _HELD)]
        shapes = dense(body.rows(surface.nodes[chosen]))
        if by_normals:
            normals = surface.normals_at(chosen[:, None], np.ones((len(chosen), 1)))
            H, dofs = np.einsum("kd,kdn->kn", normals, shapes.reshape(len(chosen), 3, -1)), chosen
        else:
            H, dofs = shapes, node_dofs(chosen)
        F = np.asarray(body.flexibility(patch)[np.ix_(dofs, dofs)])
        if not (sticks or by_normals):
            along = np.kron(np.eye(len(chosen)), outward)
            H, F = along @ H, along @ F @ along.T
        yield H.T @ np.linalg.solve(regularised(F), H)


def spread_over(points: Array, count: int) -> Array:
    """Numbers of at most `count` of some points, (k, 3), of which each is as far as possible from those before it."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)
