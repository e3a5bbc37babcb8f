"""Compiled steps of contacts with friction whose rows follow the motion on rigid surfaces; see `rubbing`.

`plain_rubbing` does the same by NumPy. `friction_kernels` calls these, and finds the forces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.product_kernels import matrix_at
from ..contact.kernels import at_points, directed_rows, rigid_gaps, rows_along, tangents_of
from ..contact.tangential import STEEP
from ..frames.node_kernels import act, axes_at
from ..support.arrays import Array
from ..support.compiled import called, inner
from .body_kernels import gathered
from .moving_kernels import RigidSide, address, flat_state, flat_surfaces, products_of, renew_anchor, side_at
from .pair_kernels import growing
from .rough_kernels import Rubs, rubs

if TYPE_CHECKING:
    from .moving import MovingState, Surfaces
    from .pair_kernels import Pairs
    from .rough_kernels import Friction
    from .rubbing import Rubbing, RubbingState

find_rigid_gaps, find_tangents, find_pushes = called(rigid_gaps), called(tangents_of), called(at_points)
find_rows, find_directed = called(rows_along), called(directed_rows)


def rubs_of(
    plan: Rubbing, state: RubbingState, moving: MovingState, sides: Sequence[RigidSide], pairs: Pairs | None
) -> Rubs:
    """These contacts in a run, which loops write to; hold the sides as long as loops use it."""
    addresses = np.array([address(side) for side in sides], dtype=np.int64)
    surfaces = flat_surfaces((*plan.surfaces, addresses, sides[0])) if sides else None
    return rubs(flat_state(moving), surfaces, pairs, *plan[2:-1], *state)


@inner
def set_tangents(r: Rubs, s: int, normals: Array, tangents: Array) -> None:
    """Set the tangents, (n, 2, 3), to normals of rows of a contact, by the first axis that none is nearly along."""
    axis, least = np.empty(3), np.inf
    for trial in range(3):
        number, steepest = (r.first_axis[s] + trial) % 3, 0.0
        for a in range(3):
            axis[a] = r.axes[s, a, number]
        found, cosines = find_tangents(normals, axis)
        for i in range(len(normals)):
            steepest = max(steepest, cosines[i])
        if steepest < least:
            least, r.axis[s] = steepest, number
            for i in range(len(normals)):
                for a in range(3):
                    tangents[i, 0, a], tangents[i, 1, a] = found[i, 0, a], found[i, 1, a]
        if steepest <= STEEP:
            return


@inner
def place_rows(f: Friction, r: Rubs, s: int, q: Array) -> None:
    """Set gaps, normals, places and tangents of the rows of a contact at the model's coordinates."""
    surfaces, j = r.surfaces, r.surfaces.contact[s]
    side, first, end, point = side_at(surfaces, s), f.rows.starts[j], f.rows.starts[j + 1], surfaces.firsts[s]
    surface = surfaces.kind[s], surfaces.point[s], surfaces.axis[s], surfaces.radius[s], surfaces.sign[s]
    q_s = gathered(surfaces.dofs, surfaces.places[s], surfaces.places[s + 1], q)
    products = growing(r.moving, surfaces.body[s])
    gap, normals = find_rigid_gaps(side.points, side.nodes, surface, q_s, np.empty(0), products, side.x)
    for i in range(len(normals)):
        for a in range(3):
            r.normals[point + i, a] = normals[i, a]
    points, x = side.points, side.x
    starts, columns, means, nodes, weights = points.starts, points.columns, points.means, points.nodes, points.weights
    of_rows, place = matrix_at(f.rows.numbers, f.rows.normals[j], end - first, 3), r.place[first:end]
    gaps, pushed = f.gap[first:end], f.pushed[first:end]
    for i in range(end - first):
        gaps[i] = pushed[i] = gap[i]
        for a in range(3):
            of_rows[i, a] = place[i, a] = 0.0
        for e in range(starts[i], starts[i + 1]):
            share, number = means[e], columns[e]
            for a in range(3):
                of_rows[i, a] += share * normals[number, a]
            for k in range(nodes.shape[1]):
                part = share * weights[number, k]
                for a in range(3):
                    place[i, a] += part * x[nodes[number, k], a]
    axes = axes_at(side.nodes, q_s)
    for a in range(3):
        for b in range(3):
            r.axes[s, a, b] = axes[a, b]
    if f.frictional[j]:
        set_tangents(r, s, of_rows, f.tangents[first:end])


@inner
def slide_rows(f: Friction, r: Rubs, s: int) -> bool:
    """Set how far the rows of a contact have slid in the step, and the forces of the last one; whether all is finite.

    Those are kept in the body's axes, and turn with it.
    """
    j, total, axes = r.surfaces.contact[s], 0.0, r.axes[s]
    some = slice(f.rows.starts[j], f.rows.starts[j + 1])
    gap, tangents, ways, place, before = f.gap[some], f.tangents[some], f.way[some], r.place[some], r.before[some]
    forces, tractions = f.forces[some], f.tractions[some]
    for i in range(len(gap)):
        total += gap[i]
        for k in range(2 if f.frictional[j] else 0):
            way, force = 0.0, 0.0
            for a in range(3):
                along = tangents[i, k, a]
                way += along * (place[i, a] - before[i, a])
                for b in range(3):
                    force += along * axes[a, b] * tractions[i, b]
            ways[i, k], forces[i, 1 + k] = way, force
    return math.isfinite(total)


@inner
def rub(f: Friction, r: Rubs, surfaces: Surfaces | None, q: Array) -> bool:
    """Set gaps, tangents and ways of all these rows at the model's coordinates; whether they are finite."""
    if surfaces is not None:
        for s in range(len(surfaces.contact)):
            place_rows(f, r, s, q)
            if not slide_rows(f, r, s):
                return False
    return True


@inner
def anchor_rubbing(f: Friction, r: Rubs, surfaces: Surfaces | None, g: int, q: Array) -> None:
    """Find the flexibility of the rows of a group again that have moved far since, see `Anchoring.anchor`."""
    if surfaces is not None:
        for s in range(len(surfaces.contact)):
            if r.groups[s] == g:
                kept = r.along, r.anchors, r.growing
                if renew_anchor(surfaces, r.moving, s, q, r.normals, kept, r.anchored[s], r.same[s]):
                    r.anchored[s], r.found_axis[s] = True, -1
                if r.found_axis[s] != r.axis[s]:
                    find_flexibility(f, r, s)


@inner
def rows_at_anchor(f: Friction, r: Rubs, s: int) -> Array:
    """Rows of a contact on the values of its nodes that its flexibility has, as they are at its anchor.

    They are (3 nr, 3 k) with friction, else (nr, d k).
    """
    surfaces, j = r.surfaces, r.surfaces.contact[s]
    side, k, d = side_at(surfaces, s), surfaces.sizes[s, 0], surfaces.sizes[s, 5]
    points, nr = side.points, f.rows.starts[j + 1] - f.rows.starts[j]
    starts, columns, means, nodes, weights = points.starts, points.columns, points.means, points.nodes, points.weights
    along = r.along[surfaces.firsts[s] : surfaces.firsts[s + 1]]
    if not f.frictional[j]:
        if d == 1:
            along = np.full((len(along), 1), -1.0)
        return find_rows(starts, columns, means, nodes, weights, along, k)
    normals, axis, every = np.zeros((nr, 3)), np.zeros(3), np.empty(nr, np.int64)
    for i in range(nr):
        every[i] = i
        for e in range(starts[i], starts[i + 1]):
            for a in range(3):
                normals[i, a] += means[e] * along[columns[e], a]
    axis[r.axis[s]] = 1.0
    tangents, _ = find_tangents(normals, axis)
    return find_directed(starts, columns, means, every, nodes, weights, along, tangents, k)


@inner
def find_flexibility(f: Friction, r: Rubs, s: int) -> None:
    """Set flexibility and fields of the rows of a contact, as they are at its anchor, with the present axis."""
    surfaces, j, g = r.surfaces, r.surfaces.contact[s], r.groups[s]
    top, first, end = f.rows.starts[f.groups[g]], f.rows.starts[j], f.rows.starts[j + 1]
    size, rows = 3 * (f.rows.starts[f.groups[g + 1]] - top), rows_at_anchor(f, r, s)
    own, n, m = matrix_at(f.flexible, f.F_starts[g], size, size), rows.shape[1], r.n_fields
    F, on_nodes = matrix_at(surfaces.numbers, surfaces.flexibility[s], n, n), surfaces.numbers[surfaces.fields[s] :]
    fields, d, trace = matrix_at(r.numbers, r.fields[j], 3 * (end - first), m), 3 if f.frictional[j] else 1, 0.0
    of_rows, moved = products_of(rows, F, on_nodes, m)
    for row in range(len(rows)):
        place = 3 * (row // d) + row % d
        at = 3 * (first - top) + place
        for c in range(m):
            fields[place, c] = moved[row, c]
        for other in range(len(rows)):
            own[at, 3 * (first - top) + 3 * (other // d) + other % d] = of_rows[row, other]
        trace += own[at, at]
    for i in range(3 * (first - top), 3 * (end - top)):  # nothing moves a row without friction along tangents
        if d == 1 and i % 3 > 0:
            own[i, i] = trace / len(rows)
    link_rows(f, r, j, g)
    r.found_axis[s], r.fresh[s], f.fresh[g] = r.axis[s], True, True


@inner
def link_rows(f: Friction, r: Rubs, j: int, g: int) -> None:
    """Set the flexibility between the rows of a contact and those of others that move each other."""
    starts, m, top = f.rows.starts, r.n_fields, f.rows.starts[f.groups[g]]
    size = 3 * (starts[f.groups[g + 1]] - top)
    F = matrix_at(f.flexible, f.F_starts[g], size, size)
    for link in range(len(r.links)):
        if r.links[link, 0] != j:
            continue
        k, core = r.links[link, 1], matrix_at(r.numbers, r.cores[link], m, m)
        of_j = matrix_at(r.numbers, r.fields[j], 3 * (starts[j + 1] - starts[j]), m)
        of_k, amplitudes = matrix_at(r.numbers, r.fields[k], 3 * (starts[k + 1] - starts[k]), m), np.empty(m)
        for i in range(len(of_j)):
            for c in range(m):
                amplitudes[c] = 0.0
            for b in range(m):
                for c in range(m):
                    amplitudes[c] += of_j[i, b] * core[b, c]
            for n in range(len(of_k)):
                total = 0.0
                for c in range(m):
                    total += amplitudes[c] * of_k[n, c]
                at, to = 3 * (starts[j] - top) + i, 3 * (starts[k] - top) + n
                F[at, to], F[to, at] = total, total


@inner
def push_rubbing(f: Friction, r: Rubs, surfaces: Surfaces | None, q: Array, force: Array) -> None:
    """Add the generalised forces of these contacts."""
    if surfaces is not None:
        starts = f.rows.starts
        for s in range(len(surfaces.contact)):
            j, side = surfaces.contact[s], side_at(surfaces, s)
            if f.values[j, 1] == 0.0:
                continue
            some, points, nodes = slice(starts[j], starts[j + 1]), side.points, side.points.nodes
            normals = r.normals[surfaces.firsts[s] : surfaces.firsts[s + 1]]
            mean = points.starts, points.columns, points.means
            pushes = find_pushes(mean[0], mean[1], mean[2], f.lam[some], f.tangents[some], normals)
            on_nodes, begin, end = np.zeros(side.x.shape), surfaces.places[s], surfaces.places[s + 1]
            for p in range(len(nodes)):
                for k in range(nodes.shape[1]):
                    for a in range(3):
                        on_nodes[nodes[p, k], a] += points.weights[p, k] * pushes[p, a]
            pushed = np.zeros(end - begin)
            act(side.nodes, gathered(surfaces.dofs, begin, end, q), on_nodes, pushed)
            for i in range(end - begin):
                force[surfaces.dofs[begin + i]] += pushed[i]


@inner
def accept_rubbing(f: Friction, r: Rubs, surfaces: Surfaces | None) -> None:
    """Take the answer as the end of a step, from which rows slide in the next one."""
    if surfaces is not None:
        for s in range(len(surfaces.contact)):
            first, end = f.rows.starts[surfaces.contact[s]], f.rows.starts[surfaces.contact[s] + 1]
            for i in range(first, end):
                for b in range(3):
                    r.before[i, b] = r.place[i, b]
            keep_tractions(f, r.axes[s], first, end)


@inner
def keep_tractions(f: Friction, axes: Array, first: int, end: int) -> None:
    """Keep the tangential forces on some rows in axes of a body."""
    for i in range(first, end):
        for b in range(3):
            f.tractions[i, b] = 0.0
        for a in range(3):
            along = f.lam[i, 1] * f.tangents[i, 0, a] + f.lam[i, 2] * f.tangents[i, 1, a]
            for b in range(3):
                f.tractions[i, b] += axes[a, b] * along
