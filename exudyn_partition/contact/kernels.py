"""Compiled loops over the rows of contacts; `patch_gaps` and `tangential` do the same by NumPy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.kernels import check_active, solve_blocks
from ..frames.kernels import Fixed, add_on_shapes, place_active
from ..support.arrays import Array
from ..support.compiled import compiled, inlined
from ..surfaces.moving_kernels import Followed, Moving, follow_rows, forces_on_nodes, gaps_of_rows

if TYPE_CHECKING:
    from ..algebra.block_complementarity import FlatBlocks
    from .linear_gaps import FlatRows, LowestRows


@compiled
def row_gaps(r: Followed, of_points: Array, here: Array, bulge: float, most: float) -> tuple[Array, float, bool]:
    """See `gaps_of_rows`."""
    return gaps_of_rows(r, of_points, here, bulge, most)


@compiled
def followed_gaps(
    x_s: Array, x_m: Array, r: Followed, reach: float, by: float, steps: int, size: float, bulge: float, most: float
) -> tuple[Array, Array, Array, Array, Array, float, bool]:
    """See `follow_rows`."""
    return follow_rows(r, x_s, x_m, reach, by, steps, size, bulge, most)


@compiled
def same_rows(h: Array, limit: float, index: Array) -> bool:
    """Whether `index` has exactly the rows with h below a limit, in ascending order."""
    found = 0
    for row in range(len(h)):
        if h[row] < limit:
            if found == len(index) or index[found] != row:
                return False
            found += 1
    return found == len(index)


@compiled
def answer_again(
    gap: Array, near: Array, F: Array, factor: Array, index: Array, bulge: float, rounding: float
) -> tuple[Array, float, bool]:
    """Forces on all rows and the least gap, if the rows that can close, `near`, and the closed ones stay the same.

    F, `factor` and `index` are as in `check_active`. The last result is whether they do; if not, the forces are wrong.
    """
    least, total, lam = np.inf, 0.0, np.zeros(len(gap))
    for row in range(len(gap)):
        least, total = min(least, gap[row]), total + gap[row]
    if not (least < 0.0 and math.isfinite(total) and same_rows(gap, -bulge * least, near)):
        return lam, least, False
    h = np.empty(len(near))
    for i in range(len(near)):
        h[i] = gap[near[i]]
    some, _, count = check_active(F, factor, index, h, rounding, 0.0)
    for i in range(len(near)):
        lam[near[i]] = some[i]
    return lam, least, count == 0


@compiled
def generalised(m: Moving, lam: Array, normals: Array, slave: Fixed, master: Fixed) -> Array:
    """Generalised forces on both bodies, (n,), from forces on followed rows, along their points' normals."""
    rows_s, rows_m = slave.rows, master.rows
    of_slave, of_master = forces_on_nodes(m, lam, normals, len(rows_s) // 3, len(rows_m) // 3)
    n = rows_s.shape[1]
    result = np.zeros(n + rows_m.shape[1])
    add_on_shapes(rows_s, of_slave, result, 0)
    add_on_shapes(rows_m, of_master, result, n)
    return result


@compiled
def pressed_at(
    q: Array, slave: Fixed, master: Fixed, r: Followed, reach: float, by: float, steps: int, size: float, bulge: float,
    most: float, stood: Array, same: float, near: Array, F: Array, factor: Array, index: Array, rounding: float,
) -> tuple[Array, Array, Array, Array, Array, float, bool, Array, Array, bool]:  # fmt: skip
    """Follow rows of patches whose frames do not move, and find forces if nothing else changes.

    Parameters
    ----------
    q : (n,) array
    stood : (3, 3) array
        Place of the slave, divided by `size`, when the flexibility was found; it may change by `same`.
    near, F, factor, index, rounding
        See `answer_again`; `near` is empty if no forces are needed.

    Returns
    -------
    The results of `follow_rows`, forces on the rows, (nr,), generalised forces, (n,), and whether these two are right.
    """
    place_active(slave, q, 0)
    place_active(master, q, slave.rows.shape[1])
    x_s, x_m = slave.x, master.x
    here, normals, of_points, lost, gap, least, more = follow_rows(r, x_s, x_m, reach, by, steps, size, bulge, most)
    lam = force = np.empty(0)
    settled = len(near) > 0 and not more and least < 0.0
    for i in range(3):
        for j in range(3):
            settled = settled and abs(here[i, j] / size - stood[i, j]) <= same
    if settled:
        lam, _, settled = answer_again(gap, near, F, factor, index, bulge, rounding)
        if settled:
            force = generalised(r.points, lam, normals, slave, master)
    return here, normals, of_points, lost, gap, least, more, lam, force, settled


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


@inlined
def coordinates_of(rows: FlatRows, j: int, q: Array) -> Array:
    """Coordinates of contact j, (n,)."""
    dofs = rows.dofs[rows.places[j] : rows.places[j + 1]]
    own = np.empty(len(dofs))
    for k in range(len(dofs)):
        own[k] = q[dofs[k]]
    return own


@inlined
def slid(rows: FlatRows, j: int, own: Array) -> float:
    """How far pairs of contact j have slid at its coordinates [m]; NaN if these are not finite."""
    n, first, end = len(own), rows.drift_starts[j], rows.drift_starts[j + 1]
    drift, most = rows.numbers[rows.drift[j] :][: (end - first) * n].reshape(end - first, n), 0.0
    for i in range(end - first):
        total = -rows.drift_start[first + i]
        for k in range(n):
            total += drift[i, k] * own[k]
        if not abs(total) <= most:
            most = abs(total)
    return most


@inlined
def gaps_of_contact(rows: FlatRows, j: int, own: Array, gap: Array) -> None:
    """Set the gaps of contact j, (nr,), at its coordinates."""
    n = len(own)
    H = rows.numbers[rows.H[j] :][: n * len(gap)].reshape(n, len(gap))
    gap[:] = rows.start[rows.starts[j] : rows.starts[j + 1]]
    most = n - n % 4
    for k in range(0, most, 4):
        a, b, c, d = own[k], own[k + 1], own[k + 2], own[k + 3]
        for i in range(len(gap)):
            gap[i] += a * H[k, i] + b * H[k + 1, i] + c * H[k + 2, i] + d * H[k + 3, i]
    for k in range(most, n):
        way = own[k]
        for i in range(len(gap)):
            gap[i] += way * H[k, i]


@compiled
def gaps_of_frozen(rows: FlatRows, q: Array, h: Array) -> bool:
    """Set h to the gaps at coordinates q; return whether all pairs stay frozen, see `frozen.FrozenContacts`."""
    for j in range(len(rows.reach)):
        own = coordinates_of(rows, j, q)
        if not slid(rows, j, own) <= rows.reach[j]:
            return False
        gaps_of_contact(rows, j, own, h[rows.starts[j] : rows.starts[j + 1]])
    return True


@compiled
def choose_lowest(rows: FlatRows, lowest: LowestRows, j: int, own: Array, gap: Array) -> float:
    """Choose the lowest rows of contact j at its coordinates; `gap` is work space.

    Return the smallest gap [m], or NaN if pairs have slid too far.
    """
    n, few, nr = len(own), lowest.start.shape[1], len(gap)
    gaps_of_contact(rows, j, own, gap)
    least, chosen = np.full(few + 1, np.inf), np.zeros(few + 1, np.int64)  # in ascending order
    for i in range(nr):
        if gap[i] < least[few]:
            k = few
            while k and gap[i] < least[k - 1]:
                least[k], chosen[k] = least[k - 1], chosen[k - 1]
                k -= 1
            least[k], chosen[k] = gap[i], i
    place, start = rows.places[j], rows.start[rows.starts[j] :]
    H = rows.numbers[rows.H[j] :][: n * nr].reshape(n, nr)
    few_H = lowest.H[few * place :][: n * few].reshape(n, few)
    for k in range(n):
        lowest.at[place + k] = own[k]
        for i in range(few):
            few_H[k, i] = H[k, chosen[i]]
    for i in range(few):
        lowest.start[j, i] = start[chosen[i]]
    lowest.room[j], lowest.slack[j] = least[few] - least[0], rows.reach[j] - slid(rows, j, own)
    return least[0] if lowest.slack[j] >= 0.0 else np.nan


@compiled
def fly_on(rows: FlatRows, lowest: LowestRows, q: Array, h: Array, told: Array) -> bool:
    """Write the smallest gaps to `told`; return False if a contact closes or slides. See `linear_gaps.LowestRows`."""
    few, gap = lowest.start.shape[1], np.empty(lowest.start.shape[1])
    for j in range(len(told)):
        own, place, turned, slides, least = coordinates_of(rows, j, q), rows.places[j], 0.0, 0.0, np.inf
        n, turn, slide = len(own), lowest.numbers[lowest.turn[j] :], lowest.numbers[lowest.slide[j] :]
        for k in range(n):
            way = abs(own[k] - lowest.at[place + k])
            turned += way * turn[k]
            slides += way * slide[k]
        if turned < lowest.room[j] and slides < lowest.slack[j]:
            H = lowest.H[few * place :][: n * few].reshape(n, few)
            gap[:] = lowest.start[j]
            for k in range(n):
                for i in range(few):
                    gap[i] += own[k] * H[k, i]
            for i in range(few):
                least = min(least, gap[i])
        else:
            least = choose_lowest(rows, lowest, j, own, h[rows.starts[j] : rows.starts[j + 1]])
        if not least > 0.0:
            return False
        told[j, 5] = least
    return True


@compiled
def forces_of_frozen(
    rows: FlatRows, h: Array, lam: Array, pushed: Array, force: Array, values: Array, stored: Array
) -> None:
    """Set generalised forces, and values of sensors, see `frozen.FrozenContacts`."""
    force[:], values[:], stored[:] = 0.0, 0.0, 0.0
    for j in range(len(values)):
        dofs, start, own_values = rows.dofs[rows.places[j] : rows.places[j + 1]], rows.starts[j], values[j]
        n, nr, least = len(dofs), rows.starts[j + 1] - start, np.inf
        H = rows.numbers[rows.H[j] :][: n * nr].reshape(n, nr)
        normals = rows.numbers[rows.normals[j] :][: 3 * nr].reshape(nr, 3)
        own = np.zeros(n)
        for i in range(nr):
            least, push = min(least, pushed[start + i]), lam[start + i]
            if push != 0.0:
                for k in range(n):
                    own[k] += push * H[k, i]
                own_values[0] += push
                own_values[1] += 1.0
                for k in range(3):
                    own_values[2 + k] += push * normals[i, k]
                stored[j] -= 0.5 * push * h[start + i]
        own_values[5] = least
        if own_values[1] > 0.0:
            for k in range(n):
                force[dofs[k]] += own[k]


@compiled
def evaluate_frozen(
    rows: FlatRows, blocks: FlatBlocks, q: Array, h: Array, force: Array, values: Array, stored: Array,
    rounding: float, settled: float, steps: int, patience: int,
) -> bool:  # fmt: skip
    """Find gaps, forces and values of sensors; return whether all pairs stay frozen and the forces settle."""
    if not gaps_of_frozen(rows, q, h) or not solve_blocks(blocks, h, rounding, settled, steps, patience):
        return False
    forces_of_frozen(rows, h, blocks.lam, blocks.pushed, force, values, stored)
    return True
