"""Compiled pass back over the samples of a run; `loops.go_back` and `rows_back` do the same by NumPy.

Arrays of an object are taken out before a loop: to find one there takes as long as some ten products.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, inlined, inner, unlocked
from ..support.struct_kernels import StructType, define_struct
from .body_kernels import gathered
from .frames_back_kernels import (
    add_growth,
    back_over_inertia,
    turn_back,
)
from .rows_back import RowsBack
from .surfaces_back import SurfaceRows

if TYPE_CHECKING:
    from .frames_back import FramesBack
    from .loops import Adjoint
    from .plan import Bodies

Room = tuple[Array, Array, Array, Array, Array]  # see `room_of`
SLIPS = 2  # see `rows_back`
WHOLE, ALONG, ACROSS = 0, 1, 2  # a direction of a row, or with and across the tangential force on one that slips


@structref.register
class BackType(StructType):
    """Type of `Back` in compiled loops."""


class Back(structref.StructRefProxy):
    """A `RowsBack` as one object."""


define_struct(Back, BackType, RowsBack._fields)


@structref.register
class SurfaceRowsType(StructType):
    """Type of `OnSurfaces` in compiled loops."""


class OnSurfaces(structref.StructRefProxy):
    """`SurfaceRows` as one object."""


define_struct(OnSurfaces, SurfaceRowsType, SurfaceRows._fields)


@compiled
def surfaces_of(*fields: Any) -> OnSurfaces:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return OnSurfaces(*fields)  # type: ignore[no-untyped-call]


@compiled
def back_of(*fields: Any) -> Back:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Back(*fields)  # type: ignore[no-untyped-call]


@inlined
def direction_of(plain: int, row: int) -> int:
    """First direction of a row; so many rows before have one, the others three."""
    return row if row < plain else 3 * row - 2 * plain


@inlined
def along_way(rows: RowsBack, s: int, top: int, kind: int, i: int, values: Array) -> float:
    """What values by direction, (d,), are along a way in which forces may change."""
    value: float = values[top]
    if kind == WHOLE:
        return value
    d1, d2 = rows.along[s, i, 0], rows.along[s, i, 1]
    turned: float = d1 * values[top + 1] + d2 * values[top + 2]
    across: float = d1 * values[top + 2] - d2 * values[top + 1]
    return across if kind == ACROSS else value + rows.mu[s, i] * turned


@inner
def list_changes(rows: RowsBack, s: int, first: int, end: int, changes: Array) -> tuple[int, int, int]:
    """List the ways in which forces on the rows of a group may change; the list has those of the sample after.

    Return the number of those that are the same at the sample after, those without slipping rows, and all.
    """
    m, kept, order, plain, here = 0, 0, rows.order, rows.plain, rows.ways[s]
    same, later = s + 1 < len(rows.ways), rows.ways[min(s + 1, len(rows.ways) - 1)]
    for p in range(first, end):
        i = order[p]
        ways = 0 if here[i] == SLIPS else here[i]
        same = same and ways == (0 if later[i] == SLIPS else later[i])
        if same:
            m += ways
            kept = m
            continue
        for a in range(ways):
            changes[m, 0], changes[m, 1], changes[m, 2] = direction_of(plain, i) + a, WHOLE, 0
            m += 1
    stuck = m
    for p in range(first, end):
        i = order[p]
        if here[i] == SLIPS:
            for kind in (ALONG, ACROSS):
                changes[m, 0], changes[m, 1], changes[m, 2] = direction_of(plain, i), kind, i - plain
                m += 1
    return kept, stuck, m


@inner
def set_jacobian(rows: RowsBack, s: int, changes: Array, m: int, J: Array, kept: int) -> None:
    """Set how rows move as their forces change, m times m, see `rows_back`, but for what is kept of its factors."""
    F = rows.F
    for u in range(m):
        top, kind, i = changes[u, 0], changes[u, 1], changes[u, 2]
        slips, share, values = kind == ACROSS, 1.0, F[top + 2 if kind == ACROSS else top]
        if slips:
            share = rows.across[s, i] * rows.along[s, i, 0]
        for v in range(kept if u < kept else 0, m):
            J[u, v] = share * along_way(rows, s, changes[v, 0], changes[v, 1], changes[v, 2], values)
        if slips:
            share, values = rows.across[s, i] * rows.along[s, i, 1], F[top + 1]
            for v in range(m):
                J[u, v] -= share * along_way(rows, s, changes[v, 0], changes[v, 1], changes[v, 2], values)
            J[u, u] += rows.yielding[s, i]


@inner
def factorise(J: Array, m: int, pivots: Array, kept: int, stuck: int) -> None:
    """Replace J, m times m, by its factors, line by line; so many first lines and columns are kept of its last ones.

    The flexibility of rows that do not slip is positive definite and needs no pivots. They follow in its columns.
    """
    column = np.empty(kept)
    for v in range(kept, m if kept > 0 else kept):
        for u in range(kept):
            total = J[u, v]
            for k in range(u):
                total -= J[u, k] * column[k]
            J[u, v] = column[u] = total
    for u in range(kept):
        pivots[u] = u
    for u in range(kept, m):
        for k in range(u):
            J[u, k] /= J[k, k]
            share = J[u, k]
            for v in range(k + 1, m):
                J[u, v] -= share * J[k, v]
        best = u
        for v in range(u + 1 if u >= stuck else m, m):
            if abs(J[u, v]) > abs(J[u, best]):
                best = v
        pivots[u] = best
        if best != u:
            for i in range(m):
                J[i, u], J[i, best] = J[i, best], J[i, u]


@inner
def solve_transposed(J: Array, pivots: Array, x: Array) -> None:
    """Solve J' x = x, (m,), by the factors of J."""
    m = len(x)
    for i in range(m):
        x[i], x[pivots[i]] = x[pivots[i]], x[i]
    for i in range(m):
        x[i] /= J[i, i]
        push = x[i]
        for a in range(i + 1, m):
            x[a] -= J[i, a] * push
    for i in range(m - 1, -1, -1):
        push = x[i]
        for a in range(i):
            x[a] -= J[i, a] * push


@inner
def solve_group(rows: RowsBack, s: int, changes: Array, J: Array, pivots: Array, x: Array) -> None:
    """Take what the forces of a group do from the slips; `rows.total`, (k, d), are the derivatives by the forces."""
    for j in range(len(rows.total)):
        given, slips = rows.total[j], rows.slips[s, j]
        for u in range(len(x)):
            x[u] = along_way(rows, s, changes[u, 0], changes[u, 1], changes[u, 2], given)
        solve_transposed(J, pivots, x)
        for u in range(len(x)):
            top, kind, i = changes[u, 0], changes[u, 1], changes[u, 2]
            if kind == ACROSS:
                share = rows.across[s, i] * x[u]
                slips[top + 1] += share * rows.along[s, i, 1]
                slips[top + 2] -= share * rows.along[s, i, 0]
            else:
                slips[top] -= x[u]


@inner
def add_moved(rows: RowsBack, s: int, first: int, end: int, given: Array, sign: float, normals: bool) -> None:
    """Add the flexibility of a group's directions times the slips of a sample to what is given, (k, d)."""
    F = rows.F
    for j in range(len(given)):
        slips, to = rows.slips[s, j], given[j]
        for i in range(first, end):
            slip = sign * slips[i]
            if slip != 0.0 and (normals or (i - first) % 3 > 0):
                for a in range(first, end):
                    to[a] += slip * F[i, a]


@inner
def solve_groups(rows: RowsBack, s: int) -> None:
    """Set slips of a sample and what they leave to the sample before. Factors are kept of rows that stay closed."""
    plain, d, factors, room = rows.plain, len(rows.F), rows.factors, np.empty(len(rows.F))
    for g in range(len(rows.groups) - 1):
        first, end = rows.groups[g], rows.groups[g + 1]
        top, last = direction_of(plain, first), direction_of(plain, end)
        if first >= plain:
            add_moved(rows, s, top, last, rows.total, 1.0, True)
        changes = rows.changes[top:last]
        kept, stuck, m = list_changes(rows, s, first, end, changes)
        if m > 0:
            J, pivots = factors[top * d :][: (last - top) ** 2].reshape(last - top, last - top), rows.pivots[top:last]
            if kept < m:
                set_jacobian(rows, s, changes, m, J, kept)
                factorise(J, m, pivots, kept, stuck)
            solve_group(rows, s, changes, J, pivots, room[:m])
        if first >= plain:
            add_moved(rows, s, top, last, rows.given, 1.0, True)
            add_moved(rows, s, top, last, rows.forces, -1.0, False)


@inner
def take_coordinates(rows: RowsBack, s: int, y: Array) -> None:
    """Set derivatives by the forces of a sample, and add those of the next coefficients to slips."""
    ways, plain, nq, B, by_forces = rows.ways[s], rows.plain, y.shape[1], rows.B, rows.by_forces[s]
    for j in range(len(y)):
        slips, given, total, forces, of_y = rows.slips[s, j], rows.given[j], rows.total[j], rows.forces[j], y[j]
        for i in range(len(ways)):
            top = direction_of(plain, i)
            for a in range(top, direction_of(plain, i + 1)):
                push = 0.0
                if ways[i] > 1 or (ways[i] == 1 and a == top):
                    for b in range(nq):
                        push += B[a, b] * of_y[b]
                    push += by_forces[j, a] + forces[a]
                given[a] = total[a] = push
                forces[a] = 0.0
        for i in range(len(ways) - plain):
            for a in range(2):
                slips[plain + 3 * i + 1 + a] += rows.mu_next[j, i] * rows.by_speed[s, i, a]


@inner
def back_over_rows(rows: RowsBack, s: int, y: Array, q: Array) -> None:
    """Go back over the forces of sample s, see `rows_back`: add derivatives by its coordinates, (k, nq), to q."""
    nq, before, plain, B = y.shape[1], rows.before, rows.plain, rows.B
    take_coordinates(rows, s, y)
    solve_groups(rows, s)
    for j in range(len(y)):
        given, slips, of_q, of_before = rows.given[j], rows.slips[s, j], q[j], before[j]
        for i in range(rows.mu_next.shape[1]):
            top = plain + 3 * i
            turned = given[top + 1] * rows.along[s, i, 0] + given[top + 2] * rows.along[s, i, 1]
            rows.by_mu[s, j, i] = rows.mu_next[j, i] = rows.push[s, i] * turned
        for a in range(nq):
            of_before[a] = 0.0
        for i in range(len(slips)):
            slip = slips[i]
            if slip != 0.0:
                for a in range(nq):
                    of_q[a] += slip * B[i, a]
                if i >= plain and (i - plain) % 3 > 0:
                    for a in range(nq):
                        of_before[a] += slip * B[i, a]


@inner
def room_of(some: SurfaceRows | None, k: int) -> Room:
    """Room for ways of points and nodes, (k, 3, p), (k, v, 3), derivatives by places of nodes, and forces, (v, 3).

    Also for whether closed rows push the nodes, (v,).
    """
    p, v = 0, 0
    if some is not None:
        p, v = some.push.shape[1], len(some.shapes)
    return np.zeros((k, 3, p)), np.zeros((k, v, 3)), np.zeros((k, v, 3)), np.zeros((v, 3)), np.zeros(v, np.bool_)


@inner
def find_pushed(some: SurfaceRows | None, s: int, pushed: Array) -> None:
    """Set which nodes closed rows push in a sample, (v,); others do not count, and are left out."""
    if some is not None:
        there, starts, nodes = some.place[s], some.node_starts, some.nodes
        for v in range(len(pushed)):
            pushed[v] = False
        if there >= 0:
            push = some.push[there]
            for p in range(len(push)):
                for e in range(starts[p], starts[p + 1] if push[p] != 0.0 else starts[p]):
                    pushed[nodes[e]] = True


@inner
def set_forces(some: SurfaceRows | None, frames: FramesBack, s: int, forces: Array, pushed: Array) -> bool:
    """Set shapes and forces on bodies in floating frames, see `SurfaceRows.turn`; return whether there are any forces.

    Also sets the forces on nodes, (v, 3).
    """
    if some is not None:
        there, dofs, shapes, counts, firsts = some.place[s], some.dofs, some.shapes, some.counts, some.node_firsts
        force, q, arms = frames.force, frames.q[s], some.arms
        for i in range(len(force)):
            force[i] = 0.0
        if there >= 0:
            forces_on_nodes(some, there, forces)
            for c in range(len(dofs)):
                b, own, n = some.bodies[c], dofs[c], counts[c]
                if b >= 0:
                    of_body, q_b, axes = np.zeros(n), gathered(own, 0, n, q), frames.node_axes[b]
                    for v in range(firsts[c], firsts[c + 1]):
                        if pushed[v]:
                            turn_shapes(arms[v], axes, q_b, shapes[v])
                            push_body(shapes[v], forces[v], of_body)
                    for i in range(n):
                        force[own[i]] += of_body[i]
            return True
    return False


@inner
def forces_on_nodes(some: SurfaceRows, there: int, forces: Array) -> None:
    """Set forces on nodes, (v, 3), by those on points."""
    starts, nodes, weights, normals, pushes = some.node_starts, some.nodes, some.weights, some.normals, some.push
    for v in range(len(forces)):
        forces[v, 0], forces[v, 1], forces[v, 2] = 0.0, 0.0, 0.0
    for p in range(pushes.shape[1]):
        push = pushes[there, p]
        if push != 0.0:
            x, y, z = push * normals[there, 0, p], push * normals[there, 1, p], push * normals[there, 2, p]
            for e in range(starts[p], starts[p + 1]):
                node, weight = nodes[e], weights[e]
                forces[node, 0] += weight * x
                forces[node, 1] += weight * y
                forces[node, 2] += weight * z


@inlined
def turn_shapes(arm: Array, axes: Array, q: Array, shapes: Array) -> None:
    """Set how a node moves, (3, n), as its frame turns about the axes of its node, at the coordinates of its body."""
    x, y, z = arm[0], arm[1], arm[2]
    for i in range(6, len(q)):
        x += shapes[0, i] * q[i]
        y += shapes[1, i] * q[i]
        z += shapes[2, i] * q[i]
    for i in range(3):
        a, b, c = axes[0, i], axes[1, i], axes[2, i]
        shapes[0, 3 + i], shapes[1, 3 + i], shapes[2, 3 + i] = b * z - c * y, c * x - a * z, a * y - b * x


@inlined
def push_body(shapes: Array, push: Array, force: Array) -> None:
    """Add to a body's generalised forces, (n,), what a force on a node does."""
    x, y, z = push[0], push[1], push[2]
    for i in range(len(force)):
        force[i] += x * shapes[0, i] + y * shapes[1, i] + z * shapes[2, i]


@inner
def add_pushes(some: SurfaceRows | None, rows: RowsBack, s: int, y: Array, room: Room) -> None:
    """See `SurfaceRows.add_pushes`; sets the ways of the points, (k, 3, p), and of the nodes, (k, v, 3)."""
    if some is not None:
        there, dofs, shapes, counts, firsts = some.place[s], some.dofs, some.shapes, some.counts, some.node_firsts
        if there >= 0:
            ways, ways_of_nodes, _, _, pushed = room
            normals, along = some.normals[there], np.zeros(ways.shape[2])
            of_y = np.zeros(dofs.shape[1])
            for j in range(len(y)):
                way, of_nodes = ways[j], ways_of_nodes[j]
                for c in range(len(dofs)):
                    n = counts[c]
                    for k in range(n):
                        of_y[k] = y[j, dofs[c, k]]
                    for v in range(firsts[c], firsts[c + 1]):
                        if not pushed[v]:
                            continue
                        u, v_y, w = 0.0, 0.0, 0.0
                        for k in range(n):
                            u += shapes[v, 0, k] * of_y[k]
                            v_y += shapes[v, 1, k] * of_y[k]
                            w += shapes[v, 2, k] * of_y[k]
                        of_nodes[v, 0], of_nodes[v, 1], of_nodes[v, 2] = u, v_y, w
                on_points(some, of_nodes, some.push[there], way)
                for p in range(len(along)):
                    along[p] = way[0, p] * normals[0, p] + way[1, p] * normals[1, p] + way[2, p] * normals[2, p]
                on_rows(some, along, rows.by_forces[s, j])


@inner
def on_points(some: SurfaceRows, of_nodes: Array, push: Array, ways: Array) -> None:
    """Set ways of points with forces, (3, p), by those of nodes, (v, 3); rows that are closed push all their points."""
    starts, nodes, weights = some.node_starts, some.nodes, some.weights
    for p in range(ways.shape[1]):
        x, y, z = 0.0, 0.0, 0.0
        for e in range(starts[p], starts[p + 1] if push[p] != 0.0 else starts[p]):
            x += weights[e] * of_nodes[nodes[e], 0]
            y += weights[e] * of_nodes[nodes[e], 1]
            z += weights[e] * of_nodes[nodes[e], 2]
        ways[0, p], ways[1, p], ways[2, p] = x, y, z


@inner
def on_rows(some: SurfaceRows, along: Array, by_forces: Array) -> None:
    """Add what rows have of values at points, (p,), to derivatives by forces, (d,)."""
    rows, starts, columns, means = some.rows, some.starts, some.columns, some.means
    for i in range(len(rows)):
        total = 0.0
        for e in range(starts[i], starts[i + 1]):
            total += means[e] * along[columns[e]]
        by_forces[rows[i]] += total


@inner
def back_on_surfaces(some: SurfaceRows | None, rows: RowsBack, s: int, room: Room, q: Array) -> None:
    """See `SurfaceRows.back`; added to q, (k, nq). Sets derivatives by places of the nodes, (k, v, 3)."""
    if some is not None:
        there, dofs, shapes, counts, firsts = some.place[s], some.dofs, some.shapes, some.counts, some.node_firsts
        if there >= 0:
            of_q, (ways, _, by_nodes, _, pushed) = np.empty(dofs.shape[1]), room
            for j in range(len(q)):
                of_nodes = by_nodes[j]
                push_nodes(some, there, rows.slips[s, j], ways[j], of_nodes)
                for c in range(len(dofs)):
                    n = counts[c]
                    for k in range(n):
                        of_q[k] = 0.0
                    for v in range(firsts[c], firsts[c + 1]):
                        if not pushed[v]:
                            continue
                        x, y, z = of_nodes[v, 0], of_nodes[v, 1], of_nodes[v, 2]
                        for k in range(n):
                            of_q[k] += x * shapes[v, 0, k] + y * shapes[v, 1, k] + z * shapes[v, 2, k]
                    for k in range(n):
                        q[j, dofs[c, k]] += of_q[k]


@inner
def push_nodes(some: SurfaceRows, there: int, slips: Array, ways: Array, of_nodes: Array) -> None:
    """Set what nodes have of the derivatives by gaps, (d,), and of the curvature along ways of points, (3, p)."""
    rows, starts, columns, means, along = some.rows, some.starts, some.columns, some.means, np.zeros(ways.shape[1])
    for i in range(len(rows)):
        slip = slips[rows[i]]
        if slip != 0.0:
            for e in range(starts[i], starts[i + 1]):
                along[columns[e]] += slip * means[e]
    for v in range(len(of_nodes)):
        of_nodes[v, 0], of_nodes[v, 1], of_nodes[v, 2] = 0.0, 0.0, 0.0
    normals, push, curved = some.normals[there], some.push[there], some.curved[there]
    axes, firsts = some.axes[there], some.firsts
    starts, nodes, weights = some.node_starts, some.nodes, some.weights
    for c in range(len(axes)):
        a, b, d = axes[c, 0], axes[c, 1], axes[c, 2]
        for p in range(firsts[c], firsts[c + 1]):
            if push[p] == 0.0:
                continue
            share, x, y, z = push[p] * curved[p], normals[0, p], normals[1, p], normals[2, p]
            u, v, w = ways[0, p], ways[1, p], ways[2, p]
            n_way, a_way = x * u + y * v + z * w, a * u + b * v + d * w
            n_way = along[p] - share * n_way
            x, y, z = n_way * x + share * (u - a_way * a), n_way * y + share * (v - a_way * b), n_way * z
            z += share * (w - a_way * d)
            for e in range(starts[p], starts[p + 1]):
                node, weight = nodes[e], weights[e]
                of_nodes[node, 0] += weight * x
                of_nodes[node, 1] += weight * y
                of_nodes[node, 2] += weight * z


@inner
def turn_forces(some: SurfaceRows | None, frames: FramesBack, s: int, room: Room, q: Array) -> None:
    """See `SurfaceRows.turn_back`; adds to q, (k, nq)."""
    if some is not None:
        there, moved = some.place[s], frames.moved
        if there < 0:
            return
        for c in range(len(some.dofs)):
            if some.bodies[c] >= 0:
                for j in range(len(q)):
                    turn_contact(some, frames, s, c, j, room)
        dofs = frames.dofs
        for b in range(len(frames.node_axes)):
            first, axes, way = frames.places[b], frames.axes[s, b], np.empty(3)
            for j in range(len(q)):
                for a in range(3):
                    way[a] = moved[j, dofs[first + a]]
                for a in range(3):
                    moved[j, dofs[first + a]] = axes[a, 0] * way[0] + axes[a, 1] * way[1] + axes[a, 2] * way[2]
        add_to(q, moved)


@inner
def turn_contact(some: SurfaceRows, frames: FramesBack, s: int, c: int, j: int, room: Room) -> None:
    """Add what a contact has of derivatives as its body's frame turns with forces, see `SurfaceRows.turn_back`."""
    b, dofs, n, shapes, growth = some.bodies[c], some.dofs[c], some.counts[c], some.shapes, some.growth
    _, all_ways, all_by_nodes, forces, pushed = room
    way, ways, by_nodes, place, pulled = frames.pushed[j], all_ways[j], all_by_nodes[j], np.empty(3), np.zeros(n)
    axes, moved, products, grows = frames.node_axes[b], frames.moved[j], frames.products[s, b], False
    omega, turn, by_products = np.zeros(3), np.zeros(3), np.zeros(6)
    for k in range(6):
        grows |= products[k] != 0.0
    for a in range(3):
        place[a] = way[dofs[a]]
        for k in range(3):
            omega[a] += axes[a, k] * way[dofs[3 + k]]
    x, y, z = omega
    for v in range(some.node_firsts[c], some.node_firsts[c + 1]):
        if pushed[v]:
            f, g, h = forces[v, 0], forces[v, 1], forces[v, 2]
            add_product(ways[v, 0] - place[0], ways[v, 1] - place[1], ways[v, 2] - place[2], f, g, h, turn)
            if grows:
                add_grown(growth[v], products, by_nodes[v], by_products, turn)
            u, w, r = g * z - h * y, h * x - f * z, f * y - g * x
            for i in range(6, n):
                pulled[i] += shapes[v, 0, i] * u + shapes[v, 1, i] * w + shapes[v, 2, i] * r
    for i in range(6, n):
        moved[dofs[i]] += pulled[i]
    for k in range(3):
        for a in range(3):
            moved[dofs[3 + k]] += turn[a] * axes[a, k]
    add_growth(frames, s, b, j, by_products)


@inlined
def add_product(x: float, y: float, z: float, f: float, g: float, h: float, result: Array) -> None:
    """Add a vector product to a vector."""
    result[0] += y * h - z * g
    result[1] += z * f - x * h
    result[2] += x * g - y * f


@inlined
def add_grown(growth: Array, products: Array, by_node: Array, by_products: Array, turn: Array) -> None:
    """Add what growth of a node, (3, 6), has of derivatives by products, (6,), and by a turn, (3,)."""
    x, y, z = 0.0, 0.0, 0.0
    f, g, h = by_node[0], by_node[1], by_node[2]
    for k in range(6):
        a, b, c = growth[0, k], growth[1, k], growth[2, k]
        x += a * products[k]
        y += b * products[k]
        z += c * products[k]
        by_products[k] += a * f + b * g + c * h
    add_product(x, y, z, f, g, h, turn)


@inner
def forget_later(rows: RowsBack) -> None:
    """Forget what the samples after leave: the first step goes on from the memory of the start."""
    for j in range(len(rows.forces)):
        for i in range(rows.forces.shape[1]):
            rows.forces[j, i] = 0.0
        for i in range(rows.mu_next.shape[1]):
            rows.mu_next[j, i] = 0.0


@inner
def back_over_contacts(
    rows: RowsBack | None,
    on_surfaces: SurfaceRows | None,
    frames: FramesBack | None,
    s: int,
    room: Room,
    y: Array,
    q: Array,
) -> None:
    """Go back over the forces of contacts in sample s: add derivatives by its coordinates, (k, nq), to q."""
    if rows is not None:
        if frames is None:
            add_pushes(on_surfaces, rows, s, y, room)
            back_over_rows(rows, s, y, q)
            back_on_surfaces(on_surfaces, rows, s, room, q)
        else:
            add_pushes(on_surfaces, rows, s, frames.pushed, room)
            back_over_rows(rows, s, y, q)
            back_on_surfaces(on_surfaces, rows, s, room, frames.moved)
            turn_forces(on_surfaces, frames, s, room, q)


@inner
def step_back(bodies: Bodies, adjoint: Adjoint, rows: RowsBack | None, y: Array, h: float, begins: bool) -> None:
    """Go back over the step that ends at a sample, which may be the start."""
    q, u, v = adjoint.q, adjoint.u, adjoint.v
    for j in range(len(q)):
        for i in range(q.shape[1]):
            v[j, i] -= bodies.damping[i] * y[j, i]
            if not begins:
                v[j, i] += h * q[j, i]
                u[j, i] = v[j, i]
    if rows is not None:
        before = rows.before
        for j in range(len(q)):
            for i in range(q.shape[1]):
                q[j, i] -= before[j, i]


@inlined
def add_to(values: Array, more: Array) -> None:
    """Add to values, (k, nq)."""
    for j in range(len(values)):
        for i in range(values.shape[1]):
            values[j, i] += more[j, i]


@unlocked
def go_back(
    bodies: Bodies,
    by_q: Array,
    by_v: Array,
    h: float,
    first: int,
    adjoint: Adjoint,
    rows: RowsBack | None,
    on_surfaces: SurfaceRows | None,
    frames: FramesBack | None,
    y: Array,
) -> None:
    """Go back over the samples of a block, see `loops.go_back`. What a block does not have is not compiled."""
    q, u, v = adjoint.q, adjoint.u, adjoint.v
    k, n = q.shape
    room = room_of(on_surfaces, k)
    for s in range(len(y) - 1, -1, -1):
        begins = first + s == 0
        for j in range(k):
            for i in range(n):
                v[j, i] += by_v[s, j, i]
                y[s, j, i] = 0.5 * h / bodies.mass[i] * (u[j, i] if begins else u[j, i] + v[j, i])
        find_pushed(on_surfaces, s, room[4])
        if frames is not None:
            touches = set_forces(on_surfaces, frames, s, room[3], room[4])
            back_over_inertia(frames, s, y[s], q, bodies, 0.0 if begins else 0.5 * h, touches)
        for j in range(k):
            for i in range(n):
                q[j, i] += by_q[s, j, i] - bodies.stiffness[i] * y[s, j, i]
        back_over_contacts(rows, on_surfaces, frames, s, room, y[s], q)
        if frames is not None:
            add_to(v, frames.u)
            if not begins:
                turn_back(frames, s, h, q, v)
        step_back(bodies, adjoint, rows, y[s], h, begins)
        if frames is not None:
            add_to(q, frames.q_then)
            add_to(v, frames.v_then)
        if rows is not None:
            if first + s == 1:
                forget_later(rows)
