"""Compiled loops over the rows of contacts; `patch_gaps` and `tangential` do the same by NumPy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba.experimental import structref

from ..algebra.kernels import blocks_object, on_active, settle_blocks
from ..algebra.product_kernels import matrix_at
from ..frames.node_kernels import FlatNodes, act, set_places
from ..support.arrays import Array
from ..support.compiled import called, compiled, inlined, inner
from ..support.struct_kernels import StructType, define_struct
from ..surfaces.moving_kernels import Followed, follow_rows, forces_on_nodes, gaps_of_rows
from .linear_gaps import FlatRows

if TYPE_CHECKING:
    from ..algebra.block_complementarity import FlatBlocks

Choosing = tuple[float, float, int, int, float]  # see `formulations.compliance.CHOOSING`


@compiled
def row_gaps(
    r: Followed, of_points: Array, here: Array, bulge: float, most: float, begins: float, within: float
) -> tuple[Array, float, bool]:
    """See `gaps_of_rows`."""
    return gaps_of_rows(r, of_points, here, bulge, most, begins, within)


@structref.register
class FlatPairType(StructType):
    """Type of `FlatPair` in compiled loops."""


class FlatPair(structref.StructRefProxy):
    """Rows that are followed, with the nodes of both sides; one object is passed in less time than three.

    Parameters
    ----------
    rows : Followed
    slave, master : FlatNodes
    n, n_s, n_m : int
        Numbers of the slave's coordinates, and of the nodes of both patches.
    """

    rows: Followed
    slave: FlatNodes
    master: FlatNodes
    n: int
    n_s: int
    n_m: int


define_struct(FlatPair, FlatPairType, [*FlatPair.__annotations__])


@compiled
def flat_pair(rows: Followed, slave: FlatNodes, master: FlatNodes, n: int, n_s: int, n_m: int) -> FlatPair:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return FlatPair(rows, slave, master, n, n_s, n_m)  # type: ignore[no-untyped-call]


@compiled
def followed_gaps(
    pair: FlatPair,
    q: Array,
    growing_s: Array,
    growing_m: Array,
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
    """See `loops.followed_gaps`."""
    set_places(pair.slave, q[: pair.n], growing_s, x_s)
    set_places(pair.master, q[pair.n :], growing_m, x_m)
    return follow_rows(pair.rows, x_s, x_m, reach, by, steps, size, bulge, most, begins, within)


@compiled
def pushed_pairs(pair: FlatPair, lam: Array, normals: Array, q: Array) -> tuple[Array, Array]:
    """Generalised forces, (n,), and sum, (3,), of forces on the rows, (nr,), see `loops.pushed_pairs`."""
    of_slave, of_master = forces_on_nodes(pair.rows.points, lam, normals, pair.n_s, pair.n_m)
    result = np.zeros(len(q))
    act(pair.slave, q[: pair.n], of_slave, result[: pair.n])
    act(pair.master, q[pair.n :], of_master, result[pair.n :])
    total = np.zeros(3)
    for node in range(len(of_slave)):
        for a in range(3):
            total[a] += of_slave[node, a]
    return result, total


_push_pairs = called(pushed_pairs)


@compiled
def pair_rows(pair: FlatPair, index: Array, normals: Array, q: Array, n: int) -> Array:
    """Derivative of the gaps of rows, (na,) of n, by the coordinates, (na, len(q)), see `loops.pair_rows`."""
    result, lam = np.empty((len(index), len(q))), np.zeros(n)
    for i in range(len(index)):
        lam[index[i]] = 1.0
        row, _ = _push_pairs(pair, lam, normals, q)
        lam[index[i]] = 0.0
        for k in range(len(q)):
            result[i, k] = row[k]
    return result


@structref.register
class FlatPointsType(StructType):
    """Type of `FlatPoints` in compiled loops."""


class FlatPoints(structref.StructRefProxy):
    """Points of rows, see `surfaces.points.ContactPoints`: their nodes, weights, and the csr matrix of means."""

    nodes: Array
    weights: Array
    starts: Array
    columns: Array
    means: Array


define_struct(FlatPoints, FlatPointsType, [*FlatPoints.__annotations__])


@compiled
def flat_points(*fields: Array) -> FlatPoints:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return FlatPoints(*fields)  # type: ignore[no-untyped-call]


@compiled
def resultant(points: FlatPoints, lam: Array, normals: Array) -> Array:
    """See `loops.resultant`."""
    starts, columns, means, result = points.starts, points.columns, points.means, np.zeros(3)
    for row in range(len(lam)):
        if lam[row] != 0.0:
            for k in range(starts[row], starts[row + 1]):
                for a in range(3):
                    result[a] += means[k] * lam[row] * normals[columns[k], a]
    return result


@compiled
def rigid_gaps(
    points: FlatPoints,
    nodes: FlatNodes,
    surface: tuple[int, Array, Array, float, float],
    q: Array,
    pose: Array,
    growing: Array,
    x: Array,
) -> tuple[Array, Array]:
    """Gaps of rows, (nr,), and normals at their points, (p, 3), see `loops.rigid_gaps`."""
    set_places(nodes, q, growing, x)
    carriers, weights, starts, columns, means = (
        points.nodes,
        points.weights,
        points.starts,
        points.columns,
        points.means,
    )
    p, (kind, point, axis, radius, sign) = len(carriers), surface
    of_points, normals, gap = np.empty(p), np.empty((p, 3)), np.zeros(len(starts) - 1)
    px, py, pz, a, b, c = in_space_at(point, axis, pose)
    for i in range(p):
        u, v, w = -px, -py, -pz
        for k in range(carriers.shape[1]):
            node, share = carriers[i, k], weights[i, k]
            u += share * x[node, 0]
            v += share * x[node, 1]
            w += share * x[node, 2]
        of_points[i], normals[i, 0], normals[i, 1], normals[i, 2] = project(kind, u, v, w, (a, b, c), radius, sign)
    for row in range(len(gap)):
        for k in range(starts[row], starts[row + 1]):
            gap[row] += means[k] * of_points[columns[k]]
    return gap, normals


_find_rigid_gaps = called(rigid_gaps)


@compiled
def near_gaps(
    points: FlatPoints,
    nodes: FlatNodes,
    surface: tuple[int, Array, Array, float, float],
    motion: tuple[Array, Array, Array],
    x: Array,
    witnesses: Array,
    here: Array,
) -> tuple[Array, Array, float]:
    """Gaps of rows, (nr,), normals at their points, (p, 3), and way of some nodes, see `loops.near_gaps`."""
    q, pose, growing = motion
    gap, normals = _find_rigid_gaps(points, nodes, surface, q, pose, growing, x)
    way = 0.0
    for i in range(len(witnesses)):
        node = witnesses[i]
        for a in range(3):
            now = x[node, a]
            if len(pose) > 0:
                now = 0.0
                for b in range(3):
                    now += (x[node, b] - pose[b]) * pose[3 + 3 * b + a]
            change = abs(now - here[i, a])
            if change > way or math.isnan(change):
                way = change
    return gap, normals, way


@compiled
def rigid_moment(points: FlatPoints, lam: Array, normals: Array, x: Array, about: Array) -> Array:
    """Moment, (3,), of forces on rows, (nr,), see `loops.rigid_moment`."""
    carriers, weights, starts, columns, means = (
        points.nodes,
        points.weights,
        points.starts,
        points.columns,
        points.means,
    )
    result = np.zeros(3)
    for row in range(len(lam)):
        if lam[row] != 0.0:
            for i in range(starts[row], starts[row + 1]):
                point, push = columns[i], means[i] * lam[row]
                u, v, w = -about[0], -about[1], -about[2]
                for k in range(carriers.shape[1]):
                    node, share = carriers[point, k], weights[point, k]
                    u, v, w = u + share * x[node, 0], v + share * x[node, 1], w + share * x[node, 2]
                a, b, c = push * normals[point, 0], push * normals[point, 1], push * normals[point, 2]
                result[0] += v * c - w * b
                result[1] += w * a - u * c
                result[2] += u * b - v * a
    return result


@compiled
def pushed_rigid(points: FlatPoints, nodes: FlatNodes, lam: Array, normals: Array, q: Array, n: int) -> Array:
    """Generalised forces, (n,), of forces on the rows, (nr,), see `loops.pushed_rigid`."""
    carriers, weights, starts, columns, means = (
        points.nodes,
        points.weights,
        points.starts,
        points.columns,
        points.means,
    )
    forces, result = np.zeros((n, 3)), np.zeros(len(q))
    for row in range(len(lam)):
        if lam[row] != 0.0:
            for i in range(starts[row], starts[row + 1]):
                point, push = columns[i], means[i] * lam[row]
                for k in range(carriers.shape[1]):
                    for a in range(3):
                        forces[carriers[point, k], a] += weights[point, k] * push * normals[point, a]
    act(nodes, q, forces, result)
    return result


_push_rigid = called(pushed_rigid)


@compiled
def rigid_rows(points: FlatPoints, nodes: FlatNodes, index: Array, normals: Array, q: Array, n: int) -> Array:
    """Derivative of the gaps of rows, (na,), by the coordinates, (na, len(q)), see `loops.rigid_rows`."""
    result, lam = np.empty((len(index), len(q))), np.zeros(len(points.starts) - 1)
    for i in range(len(index)):
        lam[index[i]] = 1.0
        row = _push_rigid(points, nodes, lam, normals, q, n)
        lam[index[i]] = 0.0
        for k in range(len(q)):
            result[i, k] = row[k]
    return result


@compiled
def answer_as_before(
    h: Array,
    limit: float,
    near: Array,
    now: Array,
    then: Array,
    by: float,
    F: Array,
    factor: Array,
    index: Array,
    rounding: float,
) -> tuple[int, Array]:
    """See `loops.answer_as_before`."""
    lam = np.zeros((len(h), 1))
    for i in range(len(now)):
        if not abs(now[i] - then[i]) <= by:
            return -1, lam
    if not same_rows(h, limit, near):
        return -1, lam
    some = np.empty(len(near))
    for i in range(len(near)):
        some[i] = h[near[i]]
    forces, _, count = on_active(F, factor, index, some, rounding, 0.0)
    for i in range(len(near)):
        lam[near[i], 0] = forces[i]
    return count, lam


@compiled
def shuts(F: Array, gap: Array, index: Array, forces: Array, depth: float) -> bool:
    """See `loops.shuts`."""
    at_index = 0
    for i in range(len(gap)):
        if at_index < len(index) and index[at_index] == i:
            at_index += 1
            continue
        pushed = gap[i]
        for k in range(len(index)):
            if forces[k] != 0.0:
                pushed += F[i, index[k]] * forces[k]
        if pushed < depth:
            return True
    return False


@inlined
def pushed_gap(gap: float, pushing: Array, forces: Array) -> float:
    """A gap with the motion by forces, (m,), by a row of `loops.close_pushed`, (m,)."""
    for k in range(len(forces)):
        gap += pushing[k] * forces[k]
    return gap


@compiled
def close_pushed(pushing: Array, gap: Array, near: Array, forces: Array, depth: float) -> bool:
    """See `loops.close_pushed`."""
    any_closes = False
    for i in range(len(gap)):
        if not near[i] and pushed_gap(gap[i], pushing[i], forces) < depth:
            near[i] = any_closes = True
    return any_closes


@compiled
def same_rows(h: Array, limit: float, index: Array) -> bool:
    """Whether `index` has exactly the rows with h below a limit, in ascending order."""
    count = 0
    for row in range(len(h)):
        if h[row] < limit:
            if count == len(index) or index[count] != row:
                return False
            count += 1
    return count == len(index)


@inlined
def in_space_at(point: Array, axis: Array, pose: Array) -> tuple[float, float, float, float, float, float]:
    """Point and axis of a surface in space, where its carrier is at a pose; empty if it is at rest in space."""
    if len(pose) == 0:
        return point[0], point[1], point[2], axis[0], axis[1], axis[2]
    at, along = np.empty(3), np.empty(3)
    for a in range(3):
        at[a], along[a] = pose[a], 0.0
        for b in range(3):
            at[a] += pose[3 + 3 * a + b] * point[b]
            along[a] += pose[3 + 3 * a + b] * axis[b]
    return at[0], at[1], at[2], along[0], along[1], along[2]


@inlined
def project(
    kind: int,
    u: float,
    v: float,
    w: float,
    along: tuple[float, float, float],
    radius: float,
    sign: float,
) -> tuple[float, float, float, float]:
    """Gap and normal of a place, which an arm (u, v, w) leads to from the point of a surface with an axis."""
    a, b, c = along
    share = u * a + v * b + w * c
    if kind == 0:
        return share, a, b, c
    u, v, w = u - share * a, v - share * b, w - share * c
    distance = math.sqrt(u * u + v * v + w * w)
    scale = sign / max(distance, 1e-300)
    return sign * (distance - radius), scale * u, scale * v, scale * w


@compiled
def projected(
    kind: int, point: Array, axis: Array, radius: float, sign: float, x: Array, pose: Array
) -> tuple[Array, Array]:
    """See `loops.projected`."""
    n = len(x)
    gap, normals = np.empty(n), np.empty((n, 3))
    px, py, pz, a, b, c = in_space_at(point, axis, pose)
    for i in range(n):
        gap[i], normals[i, 0], normals[i, 1], normals[i, 2] = project(
            kind, x[i, 0] - px, x[i, 1] - py, x[i, 2] - pz, (a, b, c), radius, sign
        )
    return gap, normals


@compiled
def pushes(starts: Array, columns: Array, shares: Array, lam: Array, normals: Array) -> Array:
    """Forces at points, (p, 3), from forces on rows, (nr,), along the normals of their points."""
    result = np.zeros((len(normals), 3))
    for row in range(len(lam)):
        if lam[row] != 0.0:
            for k in range(starts[row], starts[row + 1]):
                point, push = columns[k], shares[k] * lam[row]
                for axis in range(3):
                    result[point, axis] += push * normals[point, axis]
    return result


@compiled
def rows_along(
    starts: Array, columns: Array, shares: Array, nodes: Array, weights: Array, along: Array, n: int
) -> Array:  # fmt: skip
    """Rows on d values of each of n nodes, (nr, d n): means of points, along a vector of each point, (p, d)."""
    d = along.shape[1]
    result = np.zeros((len(starts) - 1, d * n))
    for row in range(len(starts) - 1):
        for k in range(starts[row], starts[row + 1]):
            point = columns[k]
            for j in range(nodes.shape[1]):
                node, weight = nodes[point, j], shares[k] * weights[point, j]
                for axis in range(d):
                    result[row, d * node + axis] += weight * along[point, axis]
    return result


@compiled
def directed_rows(
    starts: Array, columns: Array, shares: Array, index: Array, nodes: Array, weights: Array,
    normals: Array, tangents: Array, n: int,
) -> Array:  # fmt: skip
    """Rows of some normals and tangents on n nodes of a side, (3 na, 3 n), see `TangentialRows.side_rows`.

    The first three arguments are the csr matrix of the rows' means. Normals belong to points, tangents to rows.
    """
    result = np.zeros((3 * len(index), 3 * n))
    for i in range(len(index)):
        row, carried = index[i], np.zeros(n)
        for k in range(starts[row], starts[row + 1]):
            point = columns[k]
            for j in range(nodes.shape[1]):
                node, weight = nodes[point, j], shares[k] * weights[point, j]
                carried[node] += weight
                for axis in range(3):
                    result[3 * i, 3 * node + axis] += weight * normals[point, axis]
        for node in range(n):
            if carried[node] != 0.0:
                for axis in range(3):
                    result[3 * i + 1, 3 * node + axis] = carried[node] * tangents[i, 0, axis]
                    result[3 * i + 2, 3 * node + axis] = carried[node] * tangents[i, 1, axis]
    return result


@compiled
def in_space(tangents: Array, along: Array) -> Array:
    """Vectors in space, (nr, 3), of components along tangents, (nr, 2)."""
    result = np.empty((len(along), 3))
    for i in range(len(along)):
        for axis in range(3):
            result[i, axis] = along[i, 0] * tangents[i, 0, axis] + along[i, 1] * tangents[i, 1, axis]
    return result


@compiled
def along(tangents: Array, vectors: Array) -> Array:
    """Components along tangents, (nr, 2), of vectors in space, (nr, 3)."""
    result = np.empty((len(vectors), 2))
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for k in range(2):
            result[i, k] = x * tangents[i, k, 0] + y * tangents[i, k, 1] + z * tangents[i, k, 2]
    return result


@compiled
def at_points(starts: Array, columns: Array, shares: Array, lam: Array, tangents: Array, normals: Array) -> Array:
    """Forces at points, (p, 3), from forces along the directions of rows, (nr, 3), see `TangentialRows.at_points`."""
    result = np.zeros((len(normals), 3))
    for row in range(len(lam)):
        push, u, v = lam[row, 0], lam[row, 1], lam[row, 2]
        if push != 0.0 or u != 0.0 or v != 0.0:
            for k in range(starts[row], starts[row + 1]):
                point, share = columns[k], shares[k]
                for axis in range(3):
                    tangential = u * tangents[row, 0, axis] + v * tangents[row, 1, axis]
                    result[point, axis] += share * (push * normals[point, axis] + tangential)
    return result


@compiled
def tangents_of(normals: Array, axis: Array) -> tuple[Array, Array]:
    """See `tangential.tangents_of`."""
    n = len(normals)
    tangents, cosines = np.empty((n, 2, 3)), np.empty(n)
    a, b, c = axis[0], axis[1], axis[2]
    for i in range(n):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        cosines[i] = abs(x * a + y * b + z * c)
        u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
        length = math.sqrt(u * u + v * v + w * w)
        u, v, w = u / length, v / length, w / length
        tangents[i, 0, 0], tangents[i, 0, 1], tangents[i, 0, 2] = u, v, w
        tangents[i, 1, 0], tangents[i, 1, 1], tangents[i, 1, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return tangents, cosines


@inner
def choose_near(gap: Array, last: Array, near: Array, more: bool, choosing: Choosing) -> bool:
    """See `loops.choose_rows`."""
    bulge, margin, spare, most, few_spare = choosing
    least, many, inside, size = 0.0, 0, 0, 0
    for i in range(len(gap)):
        least = min(least, gap[i])
    for i in range(len(gap)):
        needed = gap[i] < -bulge * least or last[i, 0] > 0.0 or (more and near[i])
        many += needed
        inside += needed and near[i]
        size += near[i]
    if many == inside and size < (2.0 * many + spare if many < most else few_spare * many):
        return False
    for i in range(len(gap)):
        needed = gap[i] < -bulge * least or last[i, 0] > 0.0 or (more and near[i])
        near[i] = needed or gap[i] < -margin * least
    return True


@compiled
def choose_rows(gap: Array, last: Array, near: Array, more: bool, choosing: Choosing) -> bool:
    """See `loops.choose_rows`."""
    return choose_near(gap, last, near, more, choosing)


@inlined
def coordinates_of(rows: FlatRows, j: int, q: Array) -> Array:
    """Coordinates of contact j, (n,)."""
    dofs = rows.dofs[rows.places[j] : rows.places[j + 1]]
    q_j = np.empty(len(dofs))
    for k in range(len(dofs)):
        q_j[k] = q[dofs[k]]
    return q_j


@inner
def slid(rows: FlatRows, j: int, q_j: Array) -> float:
    """How far pairs of contact j have slid at its coordinates [m]; NaN if these are not finite."""
    n, first, end = len(q_j), rows.drift_starts[j], rows.drift_starts[j + 1]
    drift, most = matrix_at(rows.numbers, rows.drift[j], end - first, n), 0.0
    for i in range(end - first):
        total = -rows.drift_start[first + i]
        for k in range(n):
            total += drift[i, k] * q_j[k]
        if not abs(total) <= most:
            most = abs(total)
    return most


@inner
def gaps_of_contact(rows: FlatRows, j: int, q_j: Array, gap: Array) -> None:
    """Set the gaps of contact j, (nr,), at its coordinates."""
    n, start = len(q_j), rows.starts[j]
    H = matrix_at(rows.numbers, rows.H[j], n, len(gap))
    for i in range(len(gap)):
        gap[i] = rows.start[start + i]
    most = n - n % 4
    for k in range(0, most, 4):
        a, b, c, d = q_j[k], q_j[k + 1], q_j[k + 2], q_j[k + 3]
        for i in range(len(gap)):
            gap[i] += a * H[k, i] + b * H[k + 1, i] + c * H[k + 2, i] + d * H[k + 3, i]
    for k in range(most, n):
        way = q_j[k]
        for i in range(len(gap)):
            gap[i] += way * H[k, i]


@inner
def stay_frozen(rows: FlatRows, q: Array, h: Array) -> bool:
    """Whether all pairs stay frozen at coordinates q; if so, set h to their gaps, see `frozen.FrozenContacts`."""
    for j in range(len(rows.reach)):
        q_j = coordinates_of(rows, j, q)
        if not slid(rows, j, q_j) <= rows.reach[j]:
            return False
        gaps_of_contact(rows, j, q_j, h[rows.starts[j] : rows.starts[j + 1]])
    return True


@inner
def forces_of_frozen(
    rows: FlatRows, h: Array, lam: Array, pushed: Array, force: Array, values: Array, stored: Array
) -> int:
    """Set generalised forces, and values of sensors, see `frozen.FrozenContacts`; return how many contacts push."""
    pushing = 0
    for k in range(len(force)):
        force[k] = 0.0
    for j in range(len(values)):
        stored[j] = 0.0
        for k in range(values.shape[1]):
            values[j, k] = 0.0
        dofs, start, values_j = rows.dofs[rows.places[j] : rows.places[j + 1]], rows.starts[j], values[j]
        n, nr, least = len(dofs), rows.starts[j + 1] - start, np.inf
        H = matrix_at(rows.numbers, rows.H[j], n, nr)
        normals = matrix_at(rows.numbers, rows.normals[j], nr, 3)
        force_j = np.zeros(n)
        for i in range(nr):
            least, push = min(least, pushed[start + i]), lam[start + i]
            if push != 0.0:
                for k in range(n):
                    force_j[k] += push * H[k, i]
                values_j[0] += push
                values_j[1] += 1.0
                for k in range(3):
                    values_j[2 + k] += push * normals[i, k]
                stored[j] -= 0.5 * push * h[start + i]
        values_j[5] = least
        if values_j[1] > 0.0:
            pushing += 1
            for k in range(n):
                force[dofs[k]] += force_j[k]
    return pushing


@structref.register
class RowsType(StructType):
    """Type of `RowsObject` in compiled loops."""


class RowsObject(structref.StructRefProxy):
    """`FlatRows` as one object: code that hands on each array takes long to compile."""


define_struct(RowsObject, RowsType, FlatRows._fields)


@compiled
def rows_object(*arrays: Array) -> RowsObject:
    """Make one of its arrays; unlike its own constructor, this is kept on disk."""
    return RowsObject(*arrays)  # type: ignore[no-untyped-call]


@structref.register
class FlatContactsType(StructType):
    """Type of `FlatContacts` in compiled loops."""


class FlatContacts(structref.StructRefProxy):
    """What stays where it is while pairs are frozen, see `frozen.FrozenContacts`.

    It is one object, because to pass each of its arrays takes longer than the loops themselves. `rows` is a
    `RowsObject`.
    """

    rows: FlatRows
    blocks: FlatBlocks
    h: Array
    values: Array
    stored: Array


define_struct(FlatContacts, FlatContactsType, [*FlatContacts.__annotations__])


@compiled
def flat_contacts(rows: RowsObject, blocks: FlatBlocks, *results: Array) -> FlatContacts:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return FlatContacts(rows, blocks_object(blocks), *results)  # type: ignore[no-untyped-call]


@compiled
def evaluate_frozen(
    contacts: FlatContacts, q: Array, force: Array, rounding: float, settled: float, steps: int, patience: int
) -> int:
    """Find gaps, forces and values of sensors; return how many contacts push, or -1 if pairs slide or none settle."""
    rows, blocks, h = contacts.rows, contacts.blocks, contacts.h
    if not stay_frozen(rows, q, h) or not settle_blocks(blocks, h, rounding, settled, steps, patience):
        return -1
    return forces_of_frozen(rows, h, blocks.lam, blocks.pushed, force, contacts.values, contacts.stored)
