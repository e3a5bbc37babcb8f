"""Compiled steps of contacts of two bodies with friction whose rows follow facets; see `rubbing` and `pair_kernels`.

`rubbing_pairs` searches for rows, and does the same by NumPy. Rows are all of the slave's patch: those that are not
present have infinite gaps, and no forces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..algebra.product_kernels import matrix_at
from ..contact.kernels import at_points, directed_rows, rows_along, tangents_of
from ..frames.node_kernels import act, axes_at, set_places
from ..support.arrays import Array
from ..support.compiled import called, inner
from ..surfaces.kernels import weigh
from .body_kernels import gathered
from .moving_kernels import products_of
from .pair_kernels import (
    Pair,
    Pairs,
    PairSide,
    flexibility_of,
    gaps_of_pair,
    growing,
    keep_gaps,
    lacks_rows,
    leaves_patch,
    pair_at,
    renew_pair_anchor,
    used_nodes,
)
from .rubbing_kernels import keep_tractions, link_rows, set_tangents

if TYPE_CHECKING:
    from .pair_kernels import Following
    from .rough_kernels import Friction, Rubs

find_tangents, find_pushes = called(tangents_of), called(at_points)
find_rows, find_directed = called(rows_along), called(directed_rows)


@inner
def rub_pairs(f: Friction, r: Rubs, pairs: Pairs | None, q: Array) -> bool:
    """Set gaps, tangents and ways of the rows between bodies; False if other rows must be found for one, which is told.

    Gaps that are found already are kept for the next evaluation, at the same coordinates.
    """
    if pairs is not None:
        r.lost[0] = -1
        for number in range(len(pairs.addresses)):
            one, s = pair_at(pairs, number), pairs.offset + number
            if not place_pair(f, r, one, s, pairs.following, q):
                r.lost[0] = number
                for i in range(number):
                    keep_gaps(pair_at(pairs, i), f.rows.starts, f.gap)
                return False
            if f.frictional[one.contact]:
                slide_pair(f, r, one, s, number)
    return True


@inner
def place_pair(f: Friction, r: Rubs, one: Pair, s: int, following: Following, q: Array) -> bool:
    """Set gaps, normals and tangents of the rows of a pair, and places of its nodes; False if it needs other rows."""
    first, end = f.rows.starts[one.contact], f.rows.starts[one.contact + 1]
    gap, pushed, known = f.gap[first:end], f.pushed[first:end], one.known[0]
    if not gaps_of_pair(r.moving, one, q, gap, following):
        return False
    q_j, n = gathered(one.dofs, 0, len(one.dofs), q), one.flat.n
    if known:  # by a search, which has not set the places
        set_places(one.flat.slave, q_j[:n], growing(r.moving, one.slave.body), one.slave.x)
        set_places(one.flat.master, q_j[n:], growing(r.moving, one.master.body), one.master.x)
    all_normals = matrix_at(f.rows.numbers, f.rows.normals[one.contact], end - first, 3)
    for i in range(end - first):
        pushed[i] = np.inf
        for a in range(3):
            all_normals[i, a] = 0.0
    points, normals = one.flat.rows.points, np.zeros((len(one.slots), 3))
    starts, columns, means = points.starts, points.columns, points.means
    for i in range(len(one.slots)):
        slot = one.slots[i]
        pushed[slot] = gap[slot]
        for e in range(starts[i], starts[i + 1]):
            for a in range(3):
                normals[i, a] += means[e] * one.normals[columns[e], a]
        for a in range(3):
            all_normals[slot, a] = normals[i, a]
    for i in range(end - first):
        gap[i] = pushed[i]
    axes = axes_at(one.flat.master, q_j[n:])
    for a in range(3):
        for b in range(3):
            r.axes[s, a, b] = axes[a, b]
    if f.frictional[one.contact]:
        tangents = np.empty((len(normals), 2, 3))
        set_tangents(r, s, normals, tangents)
        for i in range(len(normals)):
            for k in range(2):
                for a in range(3):
                    f.tangents[first + one.slots[i], k, a] = tangents[i, k, a]
    return True


@inner
def slide_pair(f: Friction, r: Rubs, one: Pair, s: int, number: int) -> None:
    """Set how far the rows of a pair have slid in the step, and the forces of the last one.

    Places count relative to the master. Where it turns, the offset between both turns with it. Forces are kept in its
    axes, and turn with it too.
    """
    points, first, axes, then = one.flat.rows.points, f.rows.starts[one.contact], r.axes[s], r.axes_before[s]
    starts, columns, means, nodes, shares = points.starts, points.columns, points.means, points.nodes, points.shares
    facets, facet, weights = points.facets, points.facet, points.weights.T
    weigh(points.local.T, points.step.T, points.table, weights)
    before_s = r.nodes[r.nodes_from[number, 0] :]
    before_m, moved, apart, seen = r.nodes[r.nodes_from[number, 1] :], np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(one.slots)):
        row = first + one.slots[i]
        for a in range(3):
            moved[a], apart[a] = 0.0, 0.0
        for e in range(starts[i], starts[i + 1]):
            point, share = columns[e], means[e]
            for k in range(nodes.shape[1]):
                part, node = share * shares[point, k], nodes[point, k]
                for a in range(3):
                    moved[a] += part * (one.slave.x[node, a] - before_s[node, a])
                    apart[a] += part * before_s[node, a]
            for k in range(facets.shape[1]):
                part, node = share * weights[point, k], facets[facet[point], k]
                for a in range(3):
                    moved[a] -= part * (one.master.x[node, a] - before_m[node, a])
                    apart[a] -= part * before_m[node, a]
        if one.flat.master.floats:
            for b in range(3):
                seen[b] = 0.0
                for a in range(3):
                    seen[b] += then[a, b] * apart[a]
            for a in range(3):
                moved[a] += apart[a]
                for b in range(3):
                    moved[a] -= axes[a, b] * seen[b]
        for k in range(2):
            way, force = 0.0, 0.0
            for a in range(3):
                along = f.tangents[row, k, a]
                way += along * moved[a]
                for b in range(3):
                    force += along * axes[a, b] * f.tractions[row, b]
            f.way[row, k], f.forces[row, 1 + k] = way, force


@inner
def anchor_pairs(f: Friction, r: Rubs, pairs: Pairs | None, g: int, q: Array) -> None:
    """Find the flexibility of the rows of a group again that have moved far since, see `Anchoring.anchor`."""
    if pairs is not None:
        for number in range(len(pairs.addresses)):
            one, s = pair_at(pairs, number), pairs.offset + number
            if r.groups[s] == g:
                if renew_pair_anchor(one, r.moving, q, r.same[s], r.anchored[s], r.anchors[s], r.growing[s]):
                    r.anchored[s], r.found_axis[s] = True, -1
                if r.found_axis[s] != r.axis[s]:
                    find_pair_flexibility(f, r, one, s)


@inner
def find_pair_flexibility(f: Friction, r: Rubs, one: Pair, s: int) -> None:
    """Set flexibility and fields of the rows of a pair, as they are at its anchor, with the present axis."""
    j, g, m = one.contact, r.groups[s], r.n_fields
    top, first, end = f.rows.starts[f.groups[g]], f.rows.starts[j], f.rows.starts[j + 1]
    size, d = 3 * (f.rows.starts[f.groups[g + 1]] - top), 3 if f.frictional[j] else 1
    own, fields = (
        matrix_at(f.flexible, f.F_starts[g], size, size),
        matrix_at(r.numbers, r.fields[j], 3 * (end - first), m),
    )
    for i in range(3 * (first - top), 3 * (end - top)):
        for k in range(3 * (first - top), 3 * (end - top)):
            own[i, k] = 0.0
    for i in range(len(fields)):
        for c in range(m):
            fields[i, c] = 0.0
    points, of_slave, of_master = one.flat.rows.points, np.empty((0, 2, 3)), np.empty((0, 2, 3))
    if d == 3:
        of_slave, of_master = tangents_at_anchor(r, one, s)
    if len(one.slave.F) > 0:
        add_side(f, r, one, s, one.slave, points.nodes, points.shares, one.along_s, of_slave, -1.0)
    if len(one.master.F) > 0:
        add_side(f, r, one, s, one.master, one.nodes_m, one.weights_m, one.along_m, of_master, 1.0)
    trace = 0.0
    for slot in one.slots:
        trace += own[3 * (first - top + slot), 3 * (first - top + slot)]
    if d == 1:  # nothing moves a row without friction along tangents
        for slot in one.slots:
            for a in range(1, 3):
                own[3 * (first - top + slot) + a, 3 * (first - top + slot) + a] = trace / len(one.slots)
    link_rows(f, r, j, g)
    r.found_axis[s], r.fresh[s], f.fresh[g] = r.axis[s], True, True


@inner
def tangents_at_anchor(r: Rubs, one: Pair, s: int) -> tuple[Array, Array]:
    """Tangents of the rows at the anchor, (nr, 2, 3), in the axes of the slave and of the master."""
    points, normals, axis = one.flat.rows.points, np.zeros((len(one.slots), 3)), np.zeros(3)
    for i in range(len(normals)):
        for e in range(points.starts[i], points.starts[i + 1]):
            for a in range(3):
                normals[i, a] += points.means[e] * one.along_m[points.columns[e], a]
    axis[r.axis[s]] = 1.0
    of_master, _ = find_tangents(normals, axis)
    q_j, n, of_slave = gathered(one.dofs, 0, len(one.dofs), r.anchors[s]), one.flat.n, np.zeros(of_master.shape)
    axes_s, axes_m = axes_at(one.flat.slave, q_j[:n]), axes_at(one.flat.master, q_j[n:])
    for i in range(len(normals)):
        for k in range(2):
            for c in range(3):
                in_space = 0.0
                for b in range(3):
                    in_space += axes_m[c, b] * of_master[i, k, b]
                for a in range(3):
                    of_slave[i, k, a] += axes_s[c, a] * in_space
    return of_slave, of_master


@inner
def add_side(
    f: Friction, r: Rubs, one: Pair, s: int, side: PairSide, nodes: Array, weights: Array, along: Array,
    tangents: Array, sign: float,
) -> None:  # fmt: skip
    """Add the flexibility of a side to that of the rows, and its fields.

    `along` and `tangents` are normals at points and tangents of rows, in the body's axes; `sign` is as in
    `pair_kernels.add_flexibility`.
    """
    j, g, m, (used, compact) = one.contact, r.groups[s], r.n_fields, used_nodes(nodes, len(side.x))
    first, n, points, d = f.rows.starts[j] - f.rows.starts[f.groups[g]], len(used), one.flat.rows.points, side.d
    size = 3 * (f.rows.starts[f.groups[g + 1]] - f.rows.starts[f.groups[g]])
    own = matrix_at(f.flexible, f.F_starts[g], size, size)
    fields, t = matrix_at(r.numbers, r.fields[j], 3 * (f.rows.starts[j + 1] - f.rows.starts[j]), m), 1
    if f.frictional[j]:
        every, t = np.empty(len(one.slots), np.int64), 3
        for i in range(len(every)):
            every[i] = i
        mean = points.starts, points.columns, points.means
        rows = find_directed(mean[0], mean[1], mean[2], every, compact, weights, along, tangents, n)
    else:
        rows = find_rows(points.starts, points.columns, points.means, compact, weights, along, n)
    on_nodes, factor = np.empty(d * n * m), sign if d == 1 else 1.0
    for i in range(n):
        for a in range(d):
            for c in range(m):
                on_nodes[(d * i + a) * m + c] = factor * side.fields[d * used[i] + a, c]
    of_rows, moved = products_of(rows, flexibility_of(side, used), on_nodes, m)
    for row in range(len(rows)):
        at = 3 * one.slots[row // t] + row % t
        for c in range(m):
            fields[at, c] += moved[row, c]
        for other in range(len(rows)):
            own[3 * first + at, 3 * first + 3 * one.slots[other // t] + other % t] += of_rows[row, other]


@inner
def push_pairs(f: Friction, r: Rubs, pairs: Pairs | None, q: Array, force: Array) -> None:
    """Add the generalised forces of these contacts."""
    if pairs is not None:
        for number in range(len(pairs.addresses)):
            one = pair_at(pairs, number)
            if len(one.slots) == 0:
                f.values[one.contact, 5] = np.inf
            if f.values[one.contact, 1] > 0.0:
                push_pair(f, one, q, force)


@inner
def push_pair(f: Friction, one: Pair, q: Array, force: Array) -> None:
    """Add the generalised forces of a pair."""
    points, nr, first = one.flat.rows.points, len(one.slots), f.rows.starts[one.contact]
    lam, tangents, weights = np.empty((nr, 3)), np.empty((nr, 2, 3)), points.weights.T
    for i in range(nr):
        for a in range(3):
            lam[i, a] = f.lam[first + one.slots[i], a]
            for k in range(2):
                tangents[i, k, a] = f.tangents[first + one.slots[i], k, a]
    pushes = find_pushes(points.starts, points.columns, points.means, lam, tangents, one.normals)
    weigh(points.local.T, points.step.T, points.table, weights)
    on_slave, on_master = np.zeros(one.slave.x.shape), np.zeros(one.master.x.shape)
    for p in range(len(pushes)):
        for a in range(3):
            for k in range(points.nodes.shape[1]):
                on_slave[points.nodes[p, k], a] += points.shares[p, k] * pushes[p, a]
            for k in range(points.facets.shape[1]):
                on_master[points.facets[points.facet[p], k], a] -= weights[p, k] * pushes[p, a]
    if f.frictional[one.contact] and one.flat.master.floats:
        add_couple(one, pushes, on_master)
    q_j, n, pushed = gathered(one.dofs, 0, len(one.dofs), q), one.flat.n, np.zeros(len(one.dofs))
    act(one.flat.slave, q_j[:n], on_slave, pushed[:n])
    act(one.flat.master, q_j[n:], on_master, pushed[n:])
    for i in range(len(pushed)):
        force[one.dofs[i]] += pushed[i]


@inner
def add_couple(one: Pair, pushes: Array, on_master: Array) -> None:
    """Let the master's forces act at the slave's points, see `TangentialRows.nodal_forces`."""
    points, active, x, moment = one.flat.rows.points, one.flat.master.active, one.master.x, np.zeros(3)
    apart, weights, centre = np.empty(3), points.weights.T, np.zeros(3)
    for p in range(len(pushes)):
        for a in range(3):
            apart[a] = 0.0
            for k in range(points.nodes.shape[1]):
                apart[a] += points.shares[p, k] * one.slave.x[points.nodes[p, k], a]
            for k in range(points.facets.shape[1]):
                apart[a] -= weights[p, k] * x[points.facets[points.facet[p], k], a]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            moment[a] += apart[b] * pushes[p, c] - apart[c] * pushes[p, b]
    for node in active:
        for a in range(3):
            centre[a] += x[node, a] / len(active)
    inertia, arm = np.zeros((3, 3)), np.empty(3)
    for node in active:
        for a in range(3):
            arm[a] = x[node, a] - centre[a]
        square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]
        for a in range(3):
            inertia[a, a] += square
            for b in range(3):
                inertia[a, b] -= arm[a] * arm[b]
    turn = solved(inertia, moment)
    for node in active:
        for a in range(3):
            arm[a] = x[node, a] - centre[a]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            on_master[node, a] -= turn[b] * arm[c] - turn[c] * arm[b]


@inner
def solved(A: Array, b: Array) -> Array:
    """Solution x of A x = b, for a symmetric matrix A, (3, 3)."""
    x, minors = np.zeros(3), np.empty((3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for column in range(3):
            m, n = (column + 1) % 3, (column + 2) % 3
            minors[i, column] = A[j, m] * A[k, n] - A[j, n] * A[k, m]
    size = A[0, 0] * minors[0, 0] + A[0, 1] * minors[0, 1] + A[0, 2] * minors[0, 2]
    for i in range(3):
        for row in range(3):
            x[i] += minors[row, i] * b[row] / size
    return x


@inner
def accept_pairs(f: Friction, r: Rubs, pairs: Pairs | None) -> None:
    """Take the answer as the end of a step, from which rows slide in the next one."""
    if pairs is not None:
        for number in range(len(pairs.addresses)):
            one, s, at = pair_at(pairs, number), pairs.offset + number, r.nodes_from[number]
            for node in one.flat.slave.active:
                for a in range(3):
                    r.nodes[at[0] + node, a] = one.slave.x[node, a]
            for node in one.flat.master.active:
                for a in range(3):
                    r.nodes[at[1] + node, a] = one.master.x[node, a]
            for a in range(3):
                for b in range(3):
                    r.axes_before[s, a, b] = r.axes[s, a, b]
            for c in range(6):
                r.growing_before[s, c] = r.moving.products[one.slave.body, c] if one.slave.body >= 0 else 0.0
                r.growing_before[s, 6 + c] = r.moving.products[one.master.body, c] if one.master.body >= 0 else 0.0
            keep_tractions(f, r.axes[s], f.rows.starts[one.contact], f.rows.starts[one.contact + 1])


@inner
def lack_rough_rows(f: Friction, r: Rubs, pairs: Pairs | None) -> bool:
    """Whether a pair lacks rows that forces may push shut, which is told; see `pair_kernels.lacks_rows`."""
    if pairs is not None:
        for number in range(len(pairs.addresses)):
            one = pair_at(pairs, number)
            some = slice(f.rows.starts[one.contact], f.rows.starts[one.contact + 1])
            if lacks_rows(one, f.lam[some, 0], f.gap[some], f.pushed[some], pairs.following):
                r.lost[0] = number
                for i in range(len(pairs.addresses)):
                    if i != number:
                        keep_gaps(pair_at(pairs, i), f.rows.starts, f.gap)
                return True
    return False


@inner
def watch_rough_edges(f: Friction, r: Rubs, pairs: Pairs | None, q: Array) -> None:
    """See `moving_kernels.watch_edges`."""
    if pairs is not None:
        for number in range(len(pairs.addresses)):
            one, s = pair_at(pairs, number), pairs.offset + number
            some = slice(f.rows.starts[one.contact], f.rows.starts[one.contact + 1])
            closed = f.values[one.contact, 1] > 0.0
            if closed and not r.left[s] and leaves_patch(one, f.gap[some], f.lam[some, 0]):
                r.left[s] = True
                for i in range(len(q)):
                    r.left_at[s, i] = q[i]
