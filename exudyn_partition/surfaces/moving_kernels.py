"""Compiled loops over points that follow facets; `pairs` and `points` do the same by NumPy.

What stays the same while some points are followed lies in one object, `Moving`: to pass each of its arrays would take
several times as long as to pass it.
"""

from __future__ import annotations

import math

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, inlined, inner
from ..support.struct_kernels import StructType, define_struct
from .holders import ALONG, AS_NEAR, BESIDE, BESIDE_ENDS, ON_END
from .kernels import (
    cross,
    cross_edge,
    expand,
    go_on,
    hold,
    is_quad,
    nearest_edge,
    newton_steps,
    past_ends,
    place_all,
    turned,
    weigh,
)
from .projection import SETTLED


@structref.register
class MovingType(StructType):
    """Type of `Moving` in compiled loops."""


class Moving(structref.StructRefProxy):
    """The k points that are followed, of p, the rows that they make, and the master's facets.

    Parameters
    ----------
    nodes, shares : (k, m) arrays
        Nodes of the slave's patch that carry each point, and their shape functions there.
    index : (k,) int array
        Numbers of the points among all.
    starts, columns, means : arrays
        The csr matrix of the rows, (nr, k).
    facets, across, its_edge, ends, turns, middles, table, around, lean : arrays
        Of the master, see `pairs.MovingPairs`.
    past, gone : (p,) bool arrays
        Of all points: whether they are past an end of the patch, and whether they face nothing.
    facet, local, step, last : (k,) int array, (2, k) arrays
        Of the last projection: facets, coordinates before the last step of Newton's method, and this step; how far the
        points have moved since the projection before. Loops take their transposes, (k, 2): as such, those of a single
        point would have another type than those of several, and all loops would be compiled again for it.
    x, some, frames, normal, weights, known, places : arrays
        Room to work in: to make it anew each time would take longer. Loops take transposes of `normal` and `weights`.
    """

    nodes: Array
    shares: Array
    index: Array
    starts: Array
    columns: Array
    means: Array
    facets: Array
    across: Array
    its_edge: Array
    ends: Array
    turns: Array
    middles: Array
    table: Array
    around: Array
    lean: Array
    past: Array
    gone: Array
    facet: Array
    local: Array
    step: Array
    last: Array
    x: Array
    some: Array
    frames: Array
    normal: Array
    weights: Array
    known: Array
    places: Array


define_struct(Moving, MovingType, [*Moving.__annotations__])


@compiled
def moving(*fields: Array) -> Moving:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Moving(*fields)  # type: ignore[no-untyped-call]


@inlined
def depth(r: float, s: float, quad: bool) -> float:
    """Least distance from the edges of a facet, in its coordinates; positive inside."""
    return min(min(r, 1 - r), min(s, 1 - s)) if quad else min(min(r, s), 1 - r - s)


@inner
def follow_points(m: Moving, x_s: Array, x_m: Array, by: float, steps: int, size: float) -> tuple[Array, Array, Array]:
    """Normals, (k, 3), and gaps, (k,), of points that have moved, see `pairs.MovingPairs.follow`.

    Facets, local coordinates and last steps of `m` become those of the new places. Points that face nothing have a gap
    of `size`. The last result are the points that must be searched for: those that have left their facet and are not on
    its neighbour either, and those past an end of the patch that may have another facet. Until then, they have normal
    and gap to the neighbour, or to their own facet if there is none.
    """
    index, facets, past, gone = m.index, m.facets, m.past, m.gone
    across, its_edge, turns, middles, table = m.across, m.its_edge, m.turns, m.middles, m.table
    facet, local, step, last = m.facet, m.local.T, m.step.T, m.last.T
    k, cubic, quad = len(index), len(table) == 10, is_quad(facets)
    x, some, known, places, frames, along = m.x, m.some, m.known, m.places, m.frames, m.normal.T
    inside = frames[0]
    for i in range(k):
        local[i, 0] += step[i, 0] + last[i, 0]
        local[i, 1] += step[i, 1] + last[i, 1]
        inside[i] = depth(local[i, 0], local[i, 1], quad)
    for i in range(k):
        if inside[i] < -by and not past[index[i]]:
            r, s, f = local[i, 0], local[i, 1], facet[i]
            edge = nearest_edge(r, s, quad)[1]
            if across[f, edge] >= 0:
                last[i, 0], last[i, 1] = turned(turns, f, edge, last[i, 0], last[i, 1])
                facet[i], local[i, 0], local[i, 1] = cross_edge(f, edge, r, s, across, its_edge, turns, middles)
    for i in range(k):
        last[i, 0] -= local[i, 0]
        last[i, 1] -= local[i, 1]
    for f in range(len(known)):
        known[f] = False
    expand(facet, facets, x_m, table, known, places)
    gap = np.empty(k)
    place_all(m.nodes, m.shares, x_s, x)
    for turn in range(2):  # all points at once, which is quicker than one by one
        if cubic:
            newton_steps(0, k, x, places, facet, local, step, along, gap, frames, True)
        else:
            newton_steps(0, k, x, places, facet, local, step, along, gap, frames, False)
        n_some = 0
        for i in range(k):
            if max(abs(step[i, 0]), abs(step[i, 1])) > SETTLED:
                some[n_some] = i
                n_some += 1
        if turn > 0 or n_some < k // 2:
            break
        for i in range(k):
            local[i, 0] += min(max(step[i, 0], -1.0), 1.0)
            local[i, 1] += min(max(step[i, 1], -1.0), 1.0)
    go_on(some[:n_some], x, places, facet, local, step, along, gap, frames, SETTLED, steps, cubic)
    for i in range(k):
        r, s = local[i, 0] + step[i, 0], local[i, 1] + step[i, 1]
        last[i, 0] += r
        last[i, 1] += s
        inside[i] = depth(r, s, quad)
    n_some = 0
    for i in range(k):
        if inside[i] < -by and not past[index[i]]:
            last[i, 0] = last[i, 1] = 0.0
            some[n_some] = i
            n_some += 1
    lost = cross(
        some[:n_some], x, facets, x_m, table, known, places, facet, local, step, along, gap, frames,
        across, its_edge, turns, middles, by, steps,
    )  # fmt: skip
    n_some, beside = 0, BESIDE * by
    for i in range(k):
        within = beside + m.lean[facet[i]] * abs(gap[i])
        if inside[i] < within and not past[index[i]]:
            here = depth(local[i, 0] + step[i, 0], local[i, 1] + step[i, 1], quad)
            if here >= -by:
                some[n_some] = i
                n_some += 1
    hold(
        some[:n_some], x, facets, x_m, table, known, places, facet, local, step, last, along, gap, frames,
        m.around, m.lean, by, beside, AS_NEAR * size, steps,
    )  # fmt: skip
    normal, n_some = np.empty((k, 3)), 0
    for i in range(k):
        normal[i, 0], normal[i, 1], normal[i, 2] = along[i, 0], along[i, 1], along[i, 2]
        if gone[index[i]]:
            gap[i] = size
        elif past[index[i]]:
            out, inner = past_ends(local[i, 0] + step[i, 0], local[i, 1] + step[i, 1], facet[i], m.ends, quad)
            if out <= ON_END * size or (out <= BESIDE_ENDS * size and inner < ALONG + out / size):  # `holders.stray`
                some[n_some] = i
                n_some += 1
    return normal, gap, np.concatenate((lost, some[:n_some])) if n_some > 0 else lost


@compiled
def follow(m: Moving, x_s: Array, x_m: Array, by: float, steps: int, size: float) -> tuple[Array, Array, Array]:
    """See `follow_points`."""
    return follow_points(m, x_s, x_m, by, steps, size)


@compiled
def frame_of(a: Array, b: Array, c: Array) -> Array:
    """Axes of the frame of three points, (3, 3), as columns, see `witnesses.triangle_frame`."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    d, e, f = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    u, v, w = y * f - z * e, z * d - x * f, x * e - y * d
    length = math.sqrt(u * u + v * v + w * w)
    u, v, w = u / length, v / length, w / length
    return np.array([[x, v * z - w * y, u], [y, w * x - u * z, v], [z, u * y - v * x, w]])


@inlined
def see(x_s: Array, some: Array, x_m: Array, others: Array) -> Array:
    """Places of three of the slave's nodes in the frame of three of the master's, (3, 3) [m]."""
    origin = x_m[others[0]]
    axes = frame_of(origin, x_m[others[1]], x_m[others[2]])
    result = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                result[i, j] += (x_s[some[i], k] - origin[k]) * axes[k, j]
    return result


@compiled
def seen_from(x_s: Array, some: Array, x_m: Array, others: Array) -> Array:
    """See `see`."""
    return see(x_s, some, x_m, others)


@structref.register
class FollowedType(StructType):
    """Type of `Followed` in compiled loops."""


class Followed(structref.StructRefProxy):
    """Rows that are followed, and what tells whether others may close, see `followed.FollowedRows`.

    Parameters
    ----------
    points : Moving
    some, others : (3,) int arrays
        Nodes of the slave and of the master by which the patches are seen.
    searched_at : (3, 3) array
        Where the slave was seen at the last search.
    gap, rigidly, pose : (m,), (m, 12), (12,) arrays
        Gaps of all rows when those that are followed were chosen, which come first, and their derivatives by the
        slave's pose; the pose then.
    """

    points: Moving
    some: Array
    others: Array
    searched_at: Array
    gap: Array
    rigidly: Array
    pose: Array


define_struct(Followed, FollowedType, [*Followed.__annotations__])


@compiled
def followed(
    points: Moving, some: Array, others: Array, searched_at: Array, gap: Array, rigidly: Array, pose: Array
) -> Followed:
    """Make one of its fields; unlike its own constructor, this is kept on disk. One tuple of them would take longer."""
    return Followed(points, some, others, searched_at, gap, rigidly, pose)  # type: ignore[no-untyped-call]


@inlined
def gaps_of_rows(
    r: Followed, of_points: Array, here: Array, bulge: float, most: float, begins: float, within: float
) -> tuple[Array, float, bool]:
    """Gaps of the rows, (nr,), means of those of their points, the least, and whether others may close.

    The least is NaN if a gap is. See `followed.FollowedRows.others_close`.
    """
    starts, columns, means = r.points.starts, r.points.columns, r.points.means
    start, rigidly, pose = r.gap, r.rigidly, r.pose
    gap = np.zeros(len(starts) - 1)
    for row in range(len(gap)):
        for k in range(starts[row], starts[row + 1]):
            gap[row] += means[k] * of_points[columns[k]]
    least, off, nearest, total = np.inf, 0.0, np.inf, 0.0
    for row in range(len(gap)):
        least, total = min(least, gap[row]), total + gap[row]
    if len(start) > len(gap):
        axes, change = frame_of(here[0], here[1], here[2]), np.empty(12)
        for i in range(3):
            change[i] = here[0, i] - pose[i]
            for j in range(3):
                change[3 + 3 * i + j] = axes[i, j] - pose[3 + 3 * i + j]
        for row in range(len(start)):
            rigid = start[row]
            for k in range(12):
                rigid += rigidly[row, k] * change[k]
            if row < len(gap):
                off = max(off, abs(gap[row] - rigid))
            else:
                nearest = min(nearest, rigid)
    others = nearest - 2 * off < min(max(least, begins - bulge * (least - begins), within), most)
    return gap, least if math.isfinite(total) else math.nan, others


@inner
def follow_rows(
    r: Followed,
    x_s: Array,
    x_m: Array,
    reach: float,
    by: float,
    steps: int,
    size: float,
    bulge: float,
    most: float,
    begins: float,
    within: float,
) -> tuple[Array, Array, Array, Array, Array, float, bool]:
    """Follow points, see `follow_points`, and find what `gaps_of_rows` does, unless the patches have moved too far.

    Returns
    -------
    Where the slave is seen, (3, 3), normals, gaps of points, points that must be searched, and what `gaps_of_rows`
    returns. If there are points to be searched, or none were followed, the gaps of rows are empty.
    """
    here, nothing, far = see(x_s, r.some, x_m, r.others), np.empty(0), False
    for i in range(3):
        for j in range(3):
            far = far or not abs(here[i, j] - r.searched_at[i, j]) <= reach
    if far:
        return here, np.empty((0, 3)), nothing, np.empty(0, np.int64), nothing, math.nan, True
    normals, of_points, lost = follow_points(r.points, x_s, x_m, by, steps, size)
    if len(lost):
        return here, normals, of_points, lost, nothing, math.nan, True
    gap, least, more = gaps_of_rows(r, of_points, here, bulge, most, begins, within)
    return here, normals, of_points, lost, gap, least, more


@compiled
def weights(m: Moving) -> Array:
    """Shape functions at the closest points, (k, n)."""
    weigh(m.local.T, m.step.T, m.table, m.weights.T)
    return np.ascontiguousarray(m.weights.T)


@inlined
def put(nodes: Array, row: int, shares: Array, point: int, x: float, y: float, z: float, n: int, forces: Array) -> None:
    """Add shares of a force to those on n nodes; as for `find_polynomials`, n may be a number that is known."""
    for c in range(n):
        node, share = nodes[row, c], shares[point, c]
        forces[node, 0] += share * x
        forces[node, 1] += share * y
        forces[node, 2] += share * z


@inner
def forces_on_nodes(m: Moving, lam: Array, normals: Array, n_s: int, n_m: int) -> tuple[Array, Array]:
    """Forces on all nodes of both patches, (n, 3), of forces on the rows along their points' normals, (k, 3)."""
    nodes, shares, starts, columns, means = m.nodes, m.shares, m.starts, m.columns, m.means
    facets, facet, weights = m.facets, m.facet, m.weights.T
    k, push = len(facet), m.frames[0]
    for i in range(k):
        push[i] = 0.0
    for row in range(len(lam)):
        if lam[row] != 0.0:
            for i in range(starts[row], starts[row + 1]):
                push[columns[i]] += means[i] * lam[row]
    weigh(m.local.T, m.step.T, m.table, weights)
    of_slave, of_master = np.zeros((n_s, 3)), np.zeros((n_m, 3))
    for i in range(k):
        if push[i] != 0.0:
            x, y, z = push[i] * normals[i, 0], push[i] * normals[i, 1], push[i] * normals[i, 2]
            if nodes.shape[1] == 6:
                put(nodes, i, shares, i, x, y, z, 6, of_slave)
            else:
                put(nodes, i, shares, i, x, y, z, nodes.shape[1], of_slave)
            if facets.shape[1] == 6:
                put(facets, facet[i], weights, i, -x, -y, -z, 6, of_master)
            else:
                put(facets, facet[i], weights, i, -x, -y, -z, facets.shape[1], of_master)
    return of_slave, of_master


@compiled
def nodal_forces(m: Moving, lam: Array, normals: Array, n_s: int, n_m: int) -> tuple[Array, Array]:
    """See `forces_on_nodes`."""
    return forces_on_nodes(m, lam, normals, n_s, n_m)
