"""The loops over points, facets and rows: compiled if numba is there, else by NumPy.

This is the only module of `surfaces` that knows which. `kernels` and `moving_kernels` beside it have the compiled
loops.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.sparse as sp

from ..algebra.vectors import triangle_frame
from ..fe.shapes import TABLES, corners_of, curvature, shape_functions
from ..support.arrays import Array, as_read_only, plain
from ..support.compiled import kernels
from .projection import CONVEX, Projection, clip, newton_step

if TYPE_CHECKING:
    from .moving_kernels import Followed, Moving

_NEWTON_STEPS = 30
_CONVERGED = 1e-10  # of a facet: the last step
_SAME = 1e-9  # relative difference of squared distances: the first of these facets is taken


class Means(Protocol):
    """Rows that are means of points, see `ContactPoints`: the csr matrix, (nr, p), and what multiplies fastest."""

    @property
    def mean(self) -> sp.csr_matrix:
        """By its three arrays."""

    @property
    def quick_mean(self) -> Array | sp.csr_matrix:
        """The same matrix, dense if it is small."""


def average(points: Means, values: Array) -> Array:
    """Means of each row, (nr, ...), of values at the points, (p, ...)."""
    if compiled := kernels("surfaces"):
        mean, columns = points.mean, values if values.ndim == 2 else values[:, None]
        means: Array = compiled.average(mean.indptr, mean.indices, mean.data, as_read_only(plain(columns)))
        return means if values.ndim == 2 else means[:, 0]
    value: Array = points.quick_mean @ values
    return value


def spread(points: Means, forces: Array) -> Array:
    """Forces at the points, (p, ...), of forces on the rows, (nr, ...): the transpose of `average`."""
    if compiled := kernels("surfaces"):
        mean, columns = points.mean, forces if forces.ndim == 2 else forces[:, None]
        found: Array = compiled.spread(mean.indptr, mean.indices, mean.data, plain(columns), mean.shape[1])
        return found if forces.ndim == 2 else found[:, 0]
    value: Array = points.quick_mean.T @ forces
    return value


def at_points(nodes: Array, weights: Array, values: Array) -> Array:
    """Vectors at points, (p, 3), of those at the nodes, (n, 3), that carry each, (p, k), by their weights, (p, k)."""
    if compiled := kernels("surfaces"):
        found: Array = compiled.at_points(nodes, weights, plain(values))
        return found
    if nodes.shape[1] == 1:
        return weights * values[nodes[:, 0]]
    return (weights[:, None] @ values.take(nodes, axis=0))[:, 0]


def on_nodes(nodes: Array, weights: Array, forces: Array, n: int) -> Array:
    """Forces on n nodes, (n, 3), of forces at points, (p, 3), with the nodes that carry each and their weights."""
    if compiled := kernels("surfaces"):
        carried: Array = compiled.on_nodes(as_read_only(nodes), weights, forces, n)
        return carried
    active = np.flatnonzero(forces.any(axis=1))
    at, share, some = nodes.take(active, axis=0).ravel(), weights.take(active, axis=0), forces.take(active, axis=0)
    result = np.empty((n, 3))
    for axis in range(3):  # np.add.at takes several times as long
        result[:, axis] = np.bincount(at, (share * some[:, axis, None]).ravel(), minlength=n)
    return result


def nearest(places: Array, points: Array, count: int) -> Array | None:
    """Numbers of the places nearest to each point, (k, count), -1 if there are none; None without compiled loops."""
    if compiled := kernels("surfaces"):
        found: Array = compiled.nearest(plain(places), plain(points), count)
        return found
    return None


def closest(points: Array, facets: Array, nearest: Array) -> Projection:
    """Project points, (k, 3) [m], on the closest of some facets each.

    Parameters
    ----------
    points : (k, 3) array
    facets : (nf, n, 3) array
        Positions of the facets' nodes [m].
    nearest : (k, c) int array
        The facets that are tried for each point.
    """
    (k, candidates), n_nodes = nearest.shape, facets.shape[1]
    domain = corners_of(facets)
    if compiled := kernels("surfaces"):
        limits = _NEWTON_STEPS, _CONVERGED, CONVEX, _SAME
        return Projection(*compiled.closest(plain(points), facets, nearest, domain, TABLES[n_nodes], *limits))
    targets = np.repeat(points, candidates, axis=0)
    nodes = facets[nearest.ravel()]
    local = np.tile(domain.mean(axis=0), (len(targets), 1))
    left = np.arange(len(targets))  # points that have not converged
    for _ in range(_NEWTON_STEPS):
        frame = shape_functions(local[left], n_nodes) @ nodes[left]
        miss = targets[left] - frame[:, 0]
        bends = curvature(local[left], np.einsum("knd,kd->kn", nodes[left], miss))
        step, (rr, rs, ss), _ = newton_step(frame, miss, bends)
        there = clip(local[left], step, np.stack([rr, rs, rs, ss], axis=1).reshape(-1, 2, 2), domain)
        change = abs(there - local[left]).max(axis=1)
        local[left] = there
        left = left[change >= _CONVERGED]
        if not left.size:
            break
    miss = targets - (shape_functions(local, n_nodes)[:, 0, None] @ nodes)[:, 0]
    distance = (miss**2).sum(axis=1).reshape(k, candidates)
    closest = distance <= distance.min(axis=1, keepdims=True) * (1 + _SAME)
    best = np.where(closest, nearest, len(facets)).argmin(axis=1) + candidates * np.arange(k)
    shape = shape_functions(local[best], n_nodes)
    return Projection.from_tangents(nearest.ravel()[best], local[best], shape, shape @ nodes[best], miss[best])


def seen_from(x_s: Array, some: Array, x_m: Array, others: Array) -> Array:
    """Places of three of the nodes x_s, (ns, 3) [m], in the frame of three of the nodes x_m, (nm, 3): (3, 3) [m]."""
    if compiled := kernels("surfaces", "moving_kernels"):
        here: Array = compiled.seen_from(x_s, some, x_m, others)
        return here
    origin, axes = triangle_frame(x_m[others])
    value: Array = (x_s[some] - origin) @ axes
    return value


def at_once() -> bool:
    """Whether one call follows points, over edges too; only compiled loops do. Else `MovingPairs` goes step by step.

    The functions at the end of this module are only for these.
    """
    return kernels("surfaces", "moving_kernels") is not None


# Several steps in one call, only where loops do them `at_once`.


def moving(*fields: Array) -> Moving:
    """What stays the same while some points are followed, see `moving_kernels.Moving`."""
    found: Moving = _compiled().moving(*fields)
    return found


def followed(points: Moving, *choice: Array) -> Followed:
    """Rows that are followed, see `moving_kernels.Followed`."""
    found: Followed = _compiled().followed(points, *choice)
    return found


def follow(points: Moving, x_s: Array, x_m: Array, by: float, steps: int, size: float) -> tuple[Array, Array, Array]:
    """Normals, (k, 3), and gaps, (k,) [m], of points that have moved, and which of them must be searched."""
    found: tuple[Array, Array, Array] = _compiled().follow(points, x_s, x_m, by, steps, size)
    return found


def follow_on(x: Array, nodes: Array, local: Array, steps: int) -> tuple[Array, Array, Array, Array]:
    """Coordinates, weights, normals and gaps of points, x (k, 3) [m], each on its facet; see `pairs.follow`."""
    compiled = kernels("surfaces")
    assert compiled is not None, "asked for what is only done at once"
    found: tuple[Array, Array, Array, Array] = compiled.follow_on(x, nodes, local, TABLES[nodes.shape[1]], steps)
    return found


def weights(points: Moving) -> Array:
    """Shape functions at the closest points, (k, n)."""
    found: Array = _compiled().weights(points)
    return found


def nodal_forces(points: Moving, lam: Array, normals: Array, n_s: int, n_m: int) -> list[Array]:
    """Forces on the n_s and n_m nodes of both patches, (n, 3) each [N], of forces on rows, (nr,) [N]."""
    return [*_compiled().nodal_forces(points, lam, normals, n_s, n_m)]


def _compiled() -> ModuleType:
    compiled = kernels("surfaces", "moving_kernels")
    assert compiled is not None, "asked for what is only done at once"
    return compiled
