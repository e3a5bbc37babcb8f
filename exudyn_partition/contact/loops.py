"""The loops over the rows of contacts: compiled if numba is installed, else in NumPy.

No other module of `contact` knows which of them run. Module `kernels` has the compiled loops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

import numpy as np

from ..algebra.block_complementarity import LIMITS
from ..algebra.complementarity import ROUNDING
from ..algebra.vectors import cross
from ..support.arrays import Array, as_read_only, plain
from ..support.compiled import kernels
from ..surfaces.points import ContactPoints
from ..surfaces.surface import Surface

if TYPE_CHECKING:
    from ..algebra.block_complementarity import FlatBlocks
    from ..frames.node_kernels import FlatNodes
    from ..surfaces.moving_kernels import Followed
    from .kernels import FlatContacts, FlatPair, FlatPoints, RowsObject
    from .linear_gaps import FlatRows
    from .triangle_tree import TriangleTree

_Gaps: TypeAlias = tuple[Array, Array, Array, Array, Array, float, bool]  # see `followed_gaps`


class SideNodes(Protocol):
    """The part of `side.Side` that loops need."""

    @property
    def surface(self) -> Surface:
        """The patch at the start."""

    @property
    def n(self) -> int:
        """Number of coordinates."""

    @property
    def flat(self) -> FlatNodes:
        """The nodes that are followed."""


def at_once() -> bool:
    """Whether one call can do several steps of an evaluation, or several contacts; only compiled loops can.

    The functions at the end of this module are only for compiled loops.
    """
    return kernels("contact") is not None


def pushes(points: ContactPoints, lam: Array, normals: Array) -> Array:
    """Forces at points, (p, 3) [N], from forces on the rows, (nr,) [N], along the normals of their points, (p, 3)."""
    if compiled := kernels("contact"):
        mean = points.mean
        forces: Array = compiled.pushes(mean.indptr, mean.indices, mean.data, plain(lam), as_read_only(normals))
        return forces
    return points.spread(lam)[:, None] * normals


def rows_along(points: ContactPoints, nodes: Array, weights: Array, along: Array, n: int) -> Array:
    """Rows on d values of each of n nodes, (nr, d n): means over points, along a vector of each point.

    Parameters
    ----------
    points : ContactPoints
    nodes, weights : (p, k) int array, (p, k) array
        Nodes that carry each point, by their numbers among the n, and their signed weights.
    along : (p, d) array
    n : int
    """
    if compiled := kernels("contact"):
        mean = points.mean
        rows: Array = compiled.rows_along(mean.indptr, mean.indices, mean.data, nodes, weights, plain(along), n)
        return rows
    (row, point, share), d = points.triplets, along.shape[1]
    columns = d * nodes[point][:, :, None] + np.arange(d)
    cells = columns + d * n * row[:, None, None]
    values = (share[:, None] * weights[point])[:, :, None] * along[point][:, None, :]
    size = len(points.area), d * n
    return np.bincount(cells.ravel(), values.ravel(), minlength=math.prod(size)).reshape(size)


def directed_rows(
    points: ContactPoints, index: Array, nodes: Array, weights: Array, normals: Array, tangents: Array, n: int
) -> Array:
    """Rows of the normals and tangents of some rows on n nodes, (3 na, 3 n): normal, two tangents, row after row.

    Parameters
    ----------
    points : ContactPoints
    index : (na,) int array
        Numbers of the rows.
    nodes, weights : (p, k) int array, (p, k) array
        See `rows_along`.
    normals : (p, 3) array
        Of the points.
    tangents : (na, 2, 3) array
        Of the rows `index`.
    n : int
    """
    if compiled := kernels("contact"):
        mean = points.mean.indptr, points.mean.indices, points.mean.data
        rows: Array = compiled.directed_rows(*mean, index, nodes, weights, plain(normals), tangents, n)
        return rows
    carried = rows_along(points, nodes, weights, np.ones((len(normals), 1)), n)[index]
    result = np.empty((len(index), 3, n, 3))
    result[:, 0] = rows_along(points, nodes, weights, normals, n)[index].reshape(len(index), n, 3)
    result[:, 1:] = carried[:, None, :, None] * tangents[:, :, None, :]
    return result.reshape(3 * len(index), 3 * n)


def in_space(tangents: Array, along: Array) -> Array:
    """Vectors in space, (nr, 3), of components, (nr, 2), along two tangents of each row, (nr, 2, 3)."""
    if compiled := kernels("contact"):
        found: Array = compiled.in_space(tangents, plain(along))
        return found
    vectors: Array = np.einsum("rk,rkd->rd", along, tangents)
    return vectors


def along(tangents: Array, vectors: Array) -> Array:
    """Components, (nr, 2), along two tangents of each row, (nr, 2, 3), of vectors in space, (nr, 3)."""
    if compiled := kernels("contact"):
        found: Array = compiled.along(tangents, vectors)
        return found
    components: Array = np.einsum("rd,rkd->rk", vectors, tangents)
    return components


def at_points(points: ContactPoints, lam: Array, tangents: Array, normals: Array) -> Array:
    """Forces at points, (p, 3) [N], from forces on the rows along their normals and tangents, (nr, 3) [N].

    Tangents belong to rows, (nr, 2, 3), normals to points, (p, 3).
    """
    if compiled := kernels("contact"):
        mean = points.mean
        forces: Array = compiled.at_points(mean.indptr, mean.indices, mean.data, lam, tangents, plain(normals))
        return forces
    pushed = points.spread(np.hstack([lam[:, :1], in_space(tangents, lam[:, 1:])]))
    return np.asarray(pushed[:, :1] * normals + pushed[:, 1:])


def tangents_of(normals: Array, axis: Array) -> tuple[Array, Array]:
    """Two unit tangents, (k, 2, 3), of normals, (k, 3), the first across an axis, (3,); cosines of normals and axis."""
    if compiled := kernels("contact"):
        tangents, cosines = compiled.tangents_of(plain(normals), np.ascontiguousarray(axis))
        return tangents, cosines
    normal = normals / np.sqrt(np.einsum("rd,rd->r", normals, normals))[:, None]
    first = cross(normal, axis[None])
    first /= np.sqrt(np.einsum("rd,rd->r", first, first))[:, None]
    return np.stack([first, cross(normal, first)], axis=1), abs(normal @ axis)


def rows_below(h: Array, limit: float, last: Array | None) -> Array:
    """Numbers of the rows with gaps h, (nr,), below a limit [m], ascending; `last` itself if it has the same."""
    if last is not None and (compiled := kernels("contact")):
        return last if compiled.same_rows(h, limit, last) else np.flatnonzero(h < limit)
    below = np.flatnonzero(h < limit)
    return last if last is not None and np.array_equal(below, last) else below


def choose_rows(
    gap: Array, last: Array, near: Array, more: bool, choosing: tuple[float, float, int, int, float]
) -> bool:
    """Choose the rows that can close; rows that were near stay near for a while. Return whether the choice changes.

    Parameters
    ----------
    gap : (nr,) array
        [m]
    last : (nr, 3) array
        Forces at the end of the last step [N].
    near : (nr,) bool array
        Rows that were chosen; it is changed.
    more : bool
        Whether rows that were chosen are needed.
    choosing
        Shares of the deepest row's depth below which rows are needed, and chosen; how many rows too many may stay; the
        number of rows that can close from which only so many times as many may stay.
    """
    if compiled := kernels("contact"):
        return bool(compiled.choose_rows(gap, last, near, more, choosing))
    bulge, margin, spare, most, few_spare = choosing
    least = float(gap.min(initial=0.0))
    needed = (gap < -bulge * least) | (last[:, 0] > 0.0) | (near & more)
    many = needed.sum()
    if many == (needed & near).sum() and near.sum() < (2 * many + spare if many < most else few_spare * many):
        return False
    near[:] = needed | (gap < -margin * least)
    return True


def shuts(F: Array, gap: Array, index: Array, forces: Array, depth: float) -> bool:
    """Whether forces push other rows shut, see `RowFlexibility.shuts`; F, (nr, nr) [m/N], is symmetric."""
    if compiled := kernels("contact"):
        return bool(compiled.shuts(F, gap, index, forces, depth))
    pushed = gap + forces @ F.take(index, axis=0)
    pushed[index] = 0.0
    return bool((pushed < depth).any())


def close_pushed(pushing: Array, gap: Array, near: Array, forces: Array, depth: float) -> bool:
    """Let rows enter that forces push deeper than to a gap `depth` [m]; return whether there are any.

    Parameters
    ----------
    pushing : (nr, m) array
        Motion of all rows along their normals by unit forces [m/N].
    gap : (nr,) array
        Without these forces [m].
    near : (nr,) bool array
        Rows that have entered; it is changed.
    forces : (m,) array
        [N]
    depth : float
    """
    if compiled := kernels("contact"):
        return bool(compiled.close_pushed(pushing, gap, near, forces, depth))
    shut = ~near & (gap + pushing @ forces < depth)
    near |= shut
    return bool(shut.any())


# Several steps in one call, only if `at_once()`.


def closest_triangles(x: Array, corners: Array, tree: TriangleTree) -> tuple[Array, Array, Array]:
    """Closest triangle of each point, (k,), the closest place on it, (k, 3), and its feature, see `RigidMesh`.

    Parameters
    ----------
    x : (k, 3) array
        [m]
    corners : (m, 3, 3) array
        Of the triangles [m].
    tree : TriangleTree
    """
    compiled = kernels("contact", "triangle_kernels")
    assert compiled is not None, "asked for what is only done at once"
    found = np.zeros(len(x), dtype=np.int64), np.empty((len(x), 3)), np.zeros(len(x), dtype=np.int64)
    compiled.closest_triangles(np.ascontiguousarray(x), corners, *tree, *found)
    return found


class Primitive(NamedTuple):
    """A rigid plane, sphere or cylinder.

    Parameters
    ----------
    kind : int
        0: plane, 1: what has a radius.
    point : (3,) array
        On the plane, in the centre or on the axis [m].
    axis : (3,) array
        Unit normal of the plane, unit vector along the axis of a cylinder; zero for a sphere.
    radius : float
        [m]
    sign : float
        -1 for a bore, else 1.
    """

    kind: int
    point: Array
    axis: Array
    radius: float
    sign: float


def projected(surface: Primitive, x: Array, pose: Array) -> tuple[Array, Array]:
    """Gaps, (k,) [m], and outward unit normals in space, (k, 3), at points x, (k, 3) [m].

    `pose` is `Carrier.pose`, in which the surface is at rest; empty if it is at rest in space.
    """
    found: tuple[Array, Array] = _compiled().projected(*surface, np.ascontiguousarray(x), pose)
    return found


def flat_pair(rows: Followed, sides: Sequence[SideNodes]) -> FlatPair:
    """Rows that are followed, with the nodes of both sides, as one object."""
    slave, master = sides
    n_nodes = len(slave.surface.points), len(master.surface.points)
    found: FlatPair = _compiled().flat_pair(rows, slave.flat, master.flat, slave.n, *n_nodes)
    return found


def followed_gaps(
    pair: FlatPair, q: Array, growing: Sequence[Array], places: Sequence[Array], how: tuple[float, ...]
) -> _Gaps:
    """Follow points and find the gaps of their rows; see `surfaces.moving_kernels.follow_rows`.

    `places` are what `places_begun` of both sides gave at coordinates q, (n,) [m]; those of their nodes are set.
    `growing` are products by which each side grows, see `Kinematics.growing`.
    """
    gaps: _Gaps = _compiled().followed_gaps(pair, plain(q), *growing, *places, *how)
    return gaps


def pushed_pairs(pair: FlatPair, lam: Array, normals: Array, q: Array) -> tuple[Array, Array]:
    """Generalised forces, (n,), at coordinates q, (n,), and sum, (3,) [N], of forces on rows that are followed, (nr,).

    They act along the normals of the rows' points, (k, 3). Both sides must flatten.
    """
    found: tuple[Array, Array] = _compiled().pushed_pairs(pair, lam, normals, q)
    return found


def pair_rows(pair: FlatPair, index: Array, normals: Array, q: Array, n: int) -> Array:
    """Derivative of the gaps of some rows, (na,), of the n that are followed with respect to coordinates, (na, len(q)).

    See `pushed_pairs`, whose forces are those of unit forces on each row.
    """
    found: Array = _compiled().pair_rows(pair, index, normals, q, n)
    return found


def flat_points(points: ContactPoints) -> FlatPoints:
    """Points of rows as one object."""
    mean = points.mean
    arrays = points.nodes, points.weights, mean.indptr, mean.indices, mean.data
    found: FlatPoints = _compiled().flat_points(*(np.require(values, requirements=["C", "W"]) for values in arrays))
    return found


def resultant(points: FlatPoints, lam: Array, normals: Array) -> Array:
    """Sum of forces, (3,) [N], on rows, (nr,) [N], along the normals of their points, (p, 3)."""
    found: Array = _compiled().resultant(points, plain(lam), normals)
    return found


def rigid_gaps(
    points: FlatPoints, side: SideNodes, surface: Primitive, q: Array, pose: Array, growing: Array, x: Array
) -> tuple[Array, Array]:
    """Gaps of rows to a rigid surface, (nr,) [m], and outward normals at their points, (p, 3).

    Parameters
    ----------
    points : FlatPoints
    side : SideNodes
    surface : Primitive
    q : (n,) array
    pose : (12,) array
        See `projected`.
    growing : (6,) array
        Products by which the side grows, see `Kinematics.growing`; empty if it does not.
    x : (np, 3) array
        What `places_begun` gave; places of the nodes are set [m].
    """
    found: tuple[Array, Array] = _compiled().rigid_gaps(points, side.flat, tuple(surface), plain(q), pose, growing, x)
    return found


def near_gaps(
    points: FlatPoints,
    side: SideNodes,
    surface: Primitive,
    motion: tuple[Array, Array, Array],
    x: Array,
    witnesses: Array,
    here: Array,
) -> tuple[Array, Array, float]:
    """Gaps and normals as in `rigid_gaps`, and how far some nodes are from where they were, seen from the surface [m].

    `motion` are `q`, `pose` and `growing` of `rigid_gaps`. `witnesses`, (k,), are the nodes, and `here`, (k, 3), is
    where they were [m]. The way is the largest change of a component; NaN if one is.
    """
    found: tuple[Array, Array, float] = _compiled().near_gaps(
        points, side.flat, tuple(surface), motion, x, witnesses, here
    )
    return found


def rigid_moment(points: FlatPoints, lam: Array, normals: Array, x: Array, about: Array) -> Array:
    """Moment on the slave about a point, (3,) [N m], of forces on rows, (nr,) [N], along the normals of their points.

    Places of nodes, x, (np, 3), and of the point `about`, (3,), count from one origin [m].
    """
    found: Array = _compiled().rigid_moment(points, lam, normals, x, about)
    return found


def pushed_rigid(points: FlatPoints, lam: Array, normals: Array, side: SideNodes, q: Array) -> Array:
    """Generalised forces, (n,), of forces on rows, (nr,) [N], see `pushed_pairs`."""
    found: Array = _compiled().pushed_rigid(points, side.flat, lam, normals, q, len(side.surface.points))
    return found


def rigid_rows(points: FlatPoints, index: Array, normals: Array, side: SideNodes, q: Array) -> Array:
    """Derivative of the gaps of some rows, (na,), to a rigid surface with respect to the coordinates q, (na, n)."""
    found: Array = _compiled().rigid_rows(points, side.flat, index, normals, q, len(side.surface.points))
    return found


def answer_as_before(
    gap: Array, limit: float, near: Array, stance: tuple[Array, Array, float], problem: tuple[Array, Array, Array]
) -> tuple[int, Array]:
    """Forces on all rows, (nr, 1) [N], if the same rows may close and are active as before, and have hardly moved.

    Parameters
    ----------
    gap : (nr,) array
        [m]
    limit : float
        Rows with smaller gaps may close [m].
    near : (k,) int array
        Those that could before.
    stance : two arrays and float
        `Gaps.stance` now and where the flexibility was found, and the largest change.
    problem : three arrays
        `Complementarity.compiled` of these rows.

    Returns
    -------
    How many rows violate their condition, with which forces are wrong; -1 if other rows may close, or have moved.
    """
    now, then, by = stance
    count, forces = _compiled().answer_as_before(gap, limit, near, now.ravel(), then.ravel(), by, *problem, ROUNDING)
    return count, forces


def row_gaps(rows: Followed, of_points: Array, here: Array, *bounds: float) -> tuple[Array, float, bool]:
    """Gaps of rows from those of their points, the least gap [m], and whether other rows may close."""
    gaps: tuple[Array, float, bool] = _compiled().row_gaps(rows, of_points, here, *bounds)
    return gaps


def rows_object(rows: FlatRows) -> RowsObject:
    """The same arrays as one object."""
    found: RowsObject = _compiled().rows_object(*rows)
    return found


def flat_contacts(rows: FlatRows, blocks: FlatBlocks, h: Array, values: Array, stored: Array) -> FlatContacts:
    """Contacts with frozen pairs, and room for their results, see `evaluate_frozen`."""
    contacts: FlatContacts = _compiled().flat_contacts(rows_object(rows), blocks, h, values, stored)
    return contacts


def evaluate_frozen(contacts: FlatContacts, q: Array, force: Array) -> int:
    """Set gaps h, (nr,) [m], forces, and all else from the model's coordinates q, (nq,), see `frozen.FrozenContacts`.

    Return how many contacts push; -1 if pairs begin to slide, or forces do not settle soon.
    """
    return int(_compiled().evaluate_frozen(contacts, q, force, *LIMITS))


def _compiled() -> ModuleType:
    compiled = kernels("contact")
    assert compiled is not None, "asked for what is only done at once"
    return compiled
