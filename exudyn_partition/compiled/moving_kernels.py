"""Compiled steps of bodies in floating frames, and of contacts with rigid surfaces whose rows follow the motion.

`plain_moving` does the same by NumPy. What contacts are evaluated is one sequence: gaps of frozen pairs, gaps of moving
rows, forces on all rows together, generalised forces of frozen pairs, and those of moving rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba.experimental import structref

from ..algebra.kernels import settle_blocks
from ..algebra.product_kernels import matrix_at
from ..contact.kernels import (
    FlatContacts,
    FlatPoints,
    forces_of_frozen,
    pushed_rigid,
    resultant,
    rigid_gaps,
    rows_along,
    stay_frozen,
)
from ..frames.kernels import compose, end_velocities, inertia_force, on_constant_mass
from ..frames.node_kernels import FlatNodes
from ..support.arrays import Array
from ..support.compiled import called, compiled, inlined, inner
from ..support.struct_kernels import StructType, address_of, define_struct, struct_at
from .body_kernels import gathered
from .moving import NAMES
from .pair_kernels import (
    Pairs,
    anchor_pair,
    forces_of_pair,
    gaps_of_pair,
    growing,
    keep_gaps,
    lacks_rows,
    leaves_patch,
    pair_at,
    set_along,
)

if TYPE_CHECKING:
    from ..algebra.block_complementarity import FlatBlocks
    from .moving import Following, Frames, MovingPlan, MovingState, Surfaces
    from .plan import Bodies, Motion
    from .rough_kernels import Rubs

Limits = tuple[float, float, int, int]  # see `block_complementarity.LIMITS`
Bounds = tuple[float, float, float]  # see `MovingPlan`
_PASSES = 100  # in which contacts press each other

find_rigid_gaps, push_rigid, find_rows = called(rigid_gaps), called(pushed_rigid), called(rows_along)
push_mass = called(on_constant_mass)


@structref.register
class FramesType(StructType):
    """Type of `FlatFrames` in compiled loops."""


@structref.register
class RigidSideType(StructType):
    """Type of `RigidSide` in compiled loops."""


class RigidSide(structref.StructRefProxy):
    """A patch that meets a rigid surface: its points and nodes, and room for places of the nodes, (np, 3)."""

    points: FlatPoints
    nodes: FlatNodes
    x: Array


define_struct(RigidSide, RigidSideType, [*RigidSide.__annotations__])


@structref.register
class SurfacesType(StructType):
    """Type of `FlatSurfaces` in compiled loops."""


@structref.register
class StateType(StructType):
    """Type of `FlatState` in compiled loops."""


class FlatFrames(structref.StructRefProxy):
    """`Frames` as one object: code that hands on each array takes long to compile."""


class FlatSurfaces(structref.StructRefProxy):
    """`Surfaces` as one object, with the addresses of their `RigidSide`, (ns,), and one of these as an example."""


class FlatState(structref.StructRefProxy):
    """`MovingState` as one object."""


define_struct(FlatFrames, FramesType, [*NAMES[0]])
define_struct(FlatSurfaces, SurfacesType, [*NAMES[1], "sides", "example"])
define_struct(FlatState, StateType, [*NAMES[2]])


@compiled
def flat_frames(frames: Frames) -> Any:
    """Make one object of bodies in floating frames."""
    return FlatFrames(*frames)  # type: ignore[no-untyped-call]


@compiled
def flat_surfaces(fields: tuple[Any, ...]) -> Any:
    """Make one object of moving contacts."""
    return FlatSurfaces(*fields)  # type: ignore[no-untyped-call]


@compiled
def rigid_side(points: FlatPoints, nodes: FlatNodes, x: Array) -> RigidSide:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return RigidSide(points, nodes, x)  # type: ignore[no-untyped-call]


@compiled
def address(one: RigidSide) -> int:
    """Where a side is, as long as somebody holds it."""
    found: int = address_of(one)  # type: ignore[call-arg]
    return found


@inlined
def side_at(surfaces: Any, s: int) -> RigidSide:
    """Side of a moving contact with a rigid surface, by its number."""
    found: RigidSide = struct_at(surfaces.sides[s], surfaces.example)  # type: ignore[call-arg]
    return found


@compiled
def flat_state(state: MovingState) -> Any:
    """Make one object of what changes; it has the same arrays."""
    return FlatState(*state)  # type: ignore[no-untyped-call]


class Moving(NamedTuple):
    """All that moves in a run as one argument of loops, each part as one object; `bounds` as in `MovingPlan`.

    What a plan does not have is None, so that loops are not compiled for it.
    """

    frames: Frames | None
    surfaces: Surfaces | None
    pairs: Pairs | None
    state: MovingState
    bounds: Bounds


def rigid_sides(contacts: Sequence[Following]) -> list[RigidSide]:
    """The sides of contacts with rigid surfaces of a run; hold them as long as loops use `moving_of`."""
    found = []
    for one in contacts:
        side, rows = one.gaps.slave, one.gaps.stage.rows
        found.append(rigid_side(rows.flat, side.flat, np.empty(side.surface.points.shape)))
        assert found[-1]._numba_type_ == found[0]._numba_type_, "loops would read others as the first one"
    return found


def moving_of(plan: MovingPlan, state: MovingState, sides: Sequence[RigidSide], pairs: Pairs | None) -> Moving:
    """What moves in a run of a plan; loops write to the state's arrays."""
    addresses = np.array([address(side) for side in sides], dtype=np.int64)
    surfaces = flat_surfaces((*plan.surfaces, addresses, sides[0])) if sides else None
    frames = flat_frames(plan.frames) if len(plan.frames.rotation) else None
    return Moving(frames, surfaces, pairs, flat_state(state), plan.bounds)


@inlined
def sizes_of(surfaces: Surfaces, s: int) -> tuple[int, int, int, int, int, int, int]:
    """See `Surfaces.sizes`."""
    size = surfaces.sizes[s]
    return size[0], size[1], size[2], size[3], size[4], size[5], size[6]


# Contacts.


@inner
def turn_frames(frames: Frames | None, state: MovingState, v: Array) -> None:
    """Set by what products of angular velocities bodies grow at the model's velocities, see `turn`."""
    if frames is not None:
        for b in range(len(frames.rotation)):
            first, products, axes = frames.places[b] + 3, state.products[b], frames.node_axes[b]
            omega, square = np.zeros(3), 0.0
            for i in range(3):
                square += v[frames.dofs[first + i]] ** 2
                for k in range(3):
                    omega[i] += axes[i, k] * v[frames.dofs[first + k]]
            x, y, z = omega
            products[0], products[1], products[2] = x * x, y * y, z * z
            products[3], products[4], products[5] = y * z, x * z, x * y
            growth = 0.0
            for c in range(6):
                growth += abs(products[c]) * frames.largest[b, c]
            state.grows[b] = not square <= frames.slow[b] and not growth <= frames.least[b]
            if not state.grows[b]:
                for c in range(6):
                    products[c] = 0.0


@inner
def gaps_of_surface(surfaces: Surfaces, state: MovingState, s: int, q_s: Array, gap: Array) -> None:
    """Set the gaps of the rows of a moving contact, (nr,), and the normals at its points."""
    side, first = side_at(surfaces, s), surfaces.firsts[s]
    surface = surfaces.kind[s], surfaces.point[s], surfaces.axis[s], surfaces.radius[s], surfaces.sign[s]
    products = growing(state, surfaces.body[s])
    found, normals = find_rigid_gaps(side.points, side.nodes, surface, q_s, np.empty(0), products, side.x)
    for i in range(len(normals)):
        for a in range(3):
            state.normals[first + i, a] = normals[i, a]
    for i in range(len(gap)):
        gap[i] = found[i]


@inner
def rows_on_nodes(surfaces: Surfaces, state: MovingState, s: int) -> Array:
    """Rows of a moving contact on the values of its nodes that its flexibility has, (nr, d k), at the anchor."""
    points, along = side_at(surfaces, s).points, state.along[surfaces.firsts[s] : surfaces.firsts[s + 1]]
    k, d = surfaces.sizes[s, 0], surfaces.sizes[s, 5]
    if d == 1:
        along = np.full((len(along), 1), -1.0)
    return find_rows(points.starts, points.columns, points.means, points.nodes, points.weights, along, k)


@inner
def products_of(rows: Array, F: Array, on_nodes: Array, n_fields: int) -> tuple[Array, Array]:
    """Flexibility of rows, (m, m) [m/N], and their displacements in fields, (m, n_fields).

    Parameters
    ----------
    rows : (m, n) array
        Rows on the values of a contact's nodes; few entries of each are not zero.
    F : (n, n) array
        Flexibility of the nodes [m/N].
    on_nodes : (n n_fields,) array
        Displacements of the nodes in the fields.
    """
    m, n = rows.shape
    own, fields = np.empty((m, m)), np.zeros((m, n_fields))
    used, ends, moved = np.empty(rows.size, np.int64), np.zeros(m + 1, np.int64), np.empty(n)
    for row in range(m):
        ends[row + 1] = ends[row]
        for c in range(n):
            moved[c] = 0.0
            if rows[row, c] != 0.0:
                used[ends[row + 1]] = c
                ends[row + 1] += 1
        for i in range(ends[row], ends[row + 1]):
            share, place = rows[row, used[i]], used[i]
            for c in range(n):
                moved[c] += share * F[place, c]
            for f in range(n_fields):
                fields[row, f] += share * on_nodes[place * n_fields + f]
        for other in range(row + 1):
            total = 0.0
            for i in range(ends[other], ends[other + 1]):
                total += rows[other, used[i]] * moved[used[i]]
            own[row, other], own[other, row] = total, total
    return own, fields


@inner
def find_flexibility(blocks: FlatBlocks, surfaces: Surfaces, state: MovingState, s: int) -> None:
    """Set flexibility and fields of the rows of a moving contact, as they are at its anchor."""
    k, _, _, nr, _, d, n_fields = sizes_of(surfaces, s)
    j, rows, n = surfaces.contact[s], rows_on_nodes(surfaces, state, s), d * k
    F, on_nodes = matrix_at(surfaces.numbers, surfaces.flexibility[s], n, n), surfaces.numbers[surfaces.fields[s] :]
    own, start = matrix_at(blocks.numbers, blocks.own[j], nr, nr), blocks.starts[j]
    fields = matrix_at(blocks.numbers, blocks.fields[j], n_fields, nr)
    of_rows, moved = products_of(rows, F, on_nodes, n_fields)
    for row in range(nr):
        for other in range(nr):
            own[row, other] = of_rows[row, other]
        for f in range(n_fields):
            fields[f, row] = moved[row, f]
        state.diagonal[start + row] = own[row, row]
    state.found[s], blocks.n_closed[j], state.added[s] = True, -1, -1.0


@inner
def renew_anchor(
    surfaces: Surfaces, state: MovingState, s: int, q: Array, normals: Array, kept: tuple[Array, Array, Array],
    anchored: bool, same: float,
) -> bool:  # fmt: skip
    """Let a contact's anchor be where it is now, if it has none, or if normals have changed by more than `same` since.

    Return whether the anchor is new. Normals count in the body's axes: `kept` are these, coordinates and growth at the
    anchors, `normals` present ones in space, at all points.
    """
    along, anchors, growths = kept
    first, end, b, d = surfaces.firsts[s], surfaces.firsts[s + 1], surfaces.body[s], surfaces.sizes[s, 5]
    here, most = np.empty((end - first, d)), 0.0 if anchored else np.inf
    if d > 1:
        q_s = gathered(surfaces.dofs, surfaces.places[s], surfaces.places[s + 1], q)
        set_along(side_at(surfaces, s).nodes, normals[first:end], q_s, here)
        for i in range(first, end):
            for a in range(3):
                most = max(most, abs(here[i - first, a] - along[i, a]))
    if most <= same:
        return False
    for i in range(len(q)):
        anchors[s, i] = q[i]
    for c in range(6):
        growths[s, c] = state.products[b, c] if b >= 0 else 0.0
    if d > 1:
        for i in range(first, end):
            for a in range(3):
                along[i, a] = here[i - first, a]
    return True


@inner
def anchor_surface(blocks: FlatBlocks, surfaces: Surfaces, state: MovingState, s: int, q: Array, same: float) -> bool:
    """Find the flexibility of a moving contact if it is not that of its anchor, or that is far; see `Anchoring.anchor`.

    Return whether it was found.
    """
    kept = state.along, state.anchors, state.growing
    if renew_anchor(surfaces, state, s, q, state.normals, kept, state.anchored[s], same):
        state.anchored[s], state.fresh[s], state.found[s] = True, True, False
    if state.found[s]:
        return False
    find_flexibility(blocks, surfaces, state, s)
    return True


@inner
def anchor_rows(
    blocks: FlatBlocks, surfaces: Surfaces | None, pairs: Pairs | None, state: MovingState, s: int, q: Array,
    same: float,
) -> bool:  # fmt: skip
    """See `anchor_surface`, of a contact with a rigid surface or of two bodies."""
    if surfaces is not None:
        if s < len(surfaces.contact):
            return anchor_surface(blocks, surfaces, state, s, q, same)
    if pairs is not None:
        return anchor_pair(blocks, pair_at(pairs, s - pairs.offset), state, s, q, same)
    return False


@inner
def regularise_rows(blocks: FlatBlocks, state: MovingState, s: int, gap: Array, bulge: float, share: float) -> None:
    """Choose the rows of a moving contact that can close at some gaps, and regularise by them; see `regularised`."""
    j = state.contact[s]
    start, nr = blocks.starts[j], len(gap)
    if state.frozen[s]:  # all rows are near, and regularised
        for i in range(nr):
            state.near[start + i] = True
        return
    own, least, total, count = matrix_at(blocks.numbers, blocks.own[j], nr, nr), np.inf, 0.0, 0
    for i in range(nr):
        least = min(least, gap[i])
    for i in range(nr):
        state.near[start + i] = gap[i] < -bulge * least
        if state.near[start + i]:
            total += state.diagonal[start + i]
            count += 1
    added = share * total / max(count, 1)
    if added != state.added[s]:
        state.added[s], blocks.n_closed[j] = added, -1
        for i in range(nr):
            own[i, i] = state.diagonal[start + i] + added


@inner
def presses(blocks: FlatBlocks, j: int, gap: Array, near: Array) -> bool:
    """Whether rows of a contact have negative gaps that are not among those that may close."""
    found = False
    for i in range(blocks.starts[j], blocks.starts[j + 1]):
        found |= gap[i] < 0.0 and not near[i]
    return found


@inner
def settle_moving(
    blocks: FlatBlocks,
    surfaces: Surfaces | None,
    pairs: Pairs | None,
    state: MovingState,
    q: Array,
    h: Array,
    limits: Limits,
    bounds: Bounds,
) -> bool:
    """Find the forces on all rows. Moving contacts enter as they press, or are pressed by others.

    Flexibilities are looked at of those that enter, and of those that are moved by contacts which press.
    """
    (rounding, settled, steps, patience), (bulge, same, share) = limits, bounds
    starts, ns, gaps = blocks.starts, len(state.contact), h.copy()
    pressing, enters, again = np.zeros(len(blocks.own), np.bool_), np.zeros(ns, np.bool_), True
    for i in range(len(h)):
        state.near[i] = False
    for j in range(len(pressing)):
        pressing[j] = presses(blocks, j, h, state.near)
    for s in range(ns):
        enters[s] = pressing[state.contact[s]]
    passes = 0
    while again and passes < _PASSES:
        passes += 1
        for s in range(ns):
            j, looks = state.contact[s], enters[s]
            for i in range(blocks.core.starts[j], blocks.core.starts[j + 1]):
                looks |= pressing[blocks.core.sources[i]]
            if looks and (anchor_rows(blocks, surfaces, pairs, state, s, q, same) or enters[s]):
                regularise_rows(blocks, state, s, gaps[starts[j] : starts[j + 1]], bulge, share)
        if not settle_blocks(blocks, h, rounding, settled, steps, patience):
            return False
        again = False
        for j in range(len(pressing)):
            for i in range(starts[j], starts[j + 1]):
                if not pressing[j] and blocks.lam[i] > 0.0:
                    pressing[j] = again = True
        for s in range(ns):
            j = state.contact[s]
            enters[s] = presses(blocks, j, blocks.pushed, state.near)
            if enters[s]:
                again = pressing[j] = True
                for i in range(starts[j], starts[j + 1]):
                    gaps[i] = blocks.pushed[i]
    return not again


@inner
def forces_of_surface(
    surfaces: Surfaces, state: MovingState, s: int, q: Array, lam: Array, force: Array, values: Array
) -> None:
    """Add the generalised forces of a moving contact, and set its resultant, by forces on its rows, (nr,)."""
    side, normals = side_at(surfaces, s), state.normals[surfaces.firsts[s] : surfaces.firsts[s + 1]]
    total = resultant(side.points, lam, normals)
    for a in range(3):
        values[2 + a] += total[a]
    begin, end = surfaces.places[s], surfaces.places[s + 1]
    pushed = push_rigid(side.points, side.nodes, lam, normals, gathered(surfaces.dofs, begin, end, q), len(side.x))
    for i in range(end - begin):
        force[surfaces.dofs[begin + i]] += pushed[i]


@inner
def act_on_masses(frames: Frames | None, q: Array, force: Array) -> None:
    """Replace forces of contacts on bodies in floating frames by those on the constant mass, see `on_constant_mass`."""
    if frames is not None:
        for b in range(len(frames.rotation)):
            first, end, some = frames.places[b], frames.places[b + 1], False
            for i in range(first, end):
                some |= force[frames.dofs[i]] != 0.0
            if some and not frames.constant[b]:
                q_b, pushed = gathered(frames.dofs, first, end, q), gathered(frames.dofs, first, end, force)
                n = end - first - 6
                integrals = frames.numbers[frames.integrals[b] :][: 6 * (n + 1) ** 2].reshape(6, n + 1, n + 1)
                cross = frames.numbers[frames.cross[b] :][: 3 * n * n].reshape(3, n, n)
                pushed = push_mass(integrals, cross, frames.tensor[b], q_b[6:], pushed)
                for i in range(first, end):
                    force[frames.dofs[i]] = pushed[i - first]


@inner
def gaps_of_surfaces(surfaces: Surfaces | None, state: MovingState, starts: Array, q: Array, h: Array) -> None:
    """Set the gaps of the rows to rigid surfaces."""
    if surfaces is not None:
        for s in range(len(surfaces.contact)):
            q_s, j = gathered(surfaces.dofs, surfaces.places[s], surfaces.places[s + 1], q), surfaces.contact[s]
            gaps_of_surface(surfaces, state, s, q_s, h[starts[j] : starts[j + 1]])


@inner
def gaps_of_pairs(pairs: Pairs | None, state: MovingState, starts: Array, q: Array, h: Array) -> bool:
    """Set the gaps of the rows between bodies; False if other rows must be found for a pair, which is told."""
    if pairs is not None:
        for s in range(len(pairs.addresses)):
            one = pair_at(pairs, s)
            gap = h[starts[one.contact] : starts[one.contact + 1]]
            if not gaps_of_pair(state, one, q, gap, pairs.following):
                state.lost[0] = s
                for i in range(s):
                    keep_gaps(pair_at(pairs, i), starts, h)
                return False
    return True


@inner
def lack_rows(pairs: Pairs | None, state: MovingState, starts: Array, blocks: FlatBlocks, h: Array) -> bool:
    """Whether a pair lacks rows that forces may push shut, which is told; see `lacks_rows`."""
    if pairs is not None:
        for s in range(len(pairs.addresses)):
            one = pair_at(pairs, s)
            some = slice(starts[one.contact], starts[one.contact + 1])
            if lacks_rows(one, blocks.lam[some], h[some], blocks.pushed[some], pairs.following):
                state.lost[0] = s
                for i in range(len(pairs.addresses)):
                    if i != s:
                        keep_gaps(pair_at(pairs, i), starts, h)
                return True
    return False


@inner
def forces_of_surfaces(
    contacts: FlatContacts, surfaces: Surfaces | None, state: MovingState, q: Array, force: Array
) -> None:
    """Add the generalised forces of contacts with rigid surfaces, and set their resultants."""
    if surfaces is not None:
        starts, lam = contacts.blocks.starts, contacts.blocks.lam
        for s in range(len(surfaces.contact)):
            j = surfaces.contact[s]
            if contacts.values[j, 1] > 0.0:
                of_rows = lam[starts[j] : starts[j + 1]]
                forces_of_surface(surfaces, state, s, q, of_rows, force, contacts.values[j])


@inner
def forces_of_pairs(contacts: FlatContacts, pairs: Pairs | None, q: Array, force: Array) -> None:
    """Add the generalised forces of contacts of two bodies, and set their resultants."""
    if pairs is not None:
        starts, lam = contacts.blocks.starts, contacts.blocks.lam
        for s in range(len(pairs.addresses)):
            one = pair_at(pairs, s)
            j = one.contact
            if contacts.values[j, 1] > 0.0:
                forces_of_pair(one, q, lam[starts[j] : starts[j + 1]], force, contacts.values[j])
            if len(one.slots) == 0:
                contacts.values[j, 5] = np.inf


@compiled
def evaluate_moving(
    contacts: FlatContacts | None, moving: Moving, q: Array, v: Array, force: Array, limits: Limits
) -> int:
    """Find forces of contacts without friction at coordinates, with bodies that grow as they turn at velocities.

    They act on the true masses, see `act_on_masses`. Return how many contacts push, or -1 if pairs slide, other rows
    must be found, or none settle.
    """
    frames, surfaces, pairs, state, bounds = moving
    turn_frames(frames, state, v)
    if contacts is None:
        for k in range(len(force)):
            force[k] = 0.0
        return 0
    rows, blocks, h = contacts.rows, contacts.blocks, contacts.h
    state.lost[0] = -1
    if not stay_frozen(rows, q, h):
        return -1
    gaps_of_surfaces(surfaces, state, rows.starts, q, h)
    if not gaps_of_pairs(pairs, state, rows.starts, q, h):
        return -1
    if not settle_moving(blocks, surfaces, pairs, state, q, h, limits, bounds):
        return -1
    if lack_rows(pairs, state, rows.starts, blocks, h):
        return -1
    pushing = forces_of_frozen(rows, h, blocks.lam, blocks.pushed, force, contacts.values, contacts.stored)
    forces_of_surfaces(contacts, surfaces, state, q, force)
    forces_of_pairs(contacts, pairs, q, force)
    return pushing


@inner
def count_steps(pairs: Pairs | None) -> None:
    """Count a step of pairs that slide, and may be frozen again."""
    if pairs is not None:
        for s in range(len(pairs.addresses)):
            one = pair_at(pairs, s)
            if one.may_freeze and not one.frozen and len(one.slots) > 0:
                one.steps[0] += 1


@inner
def keep_fresh(state: MovingState, rubs: Rubs | None, fresh: Array) -> None:
    """Keep which contacts have found another anchor since the last sample, (ns,); those with friction come last."""
    n = len(state.fresh)
    for s in range(n):
        fresh[s], state.fresh[s] = state.fresh[s], False
    if rubs is not None:
        for s in range(len(rubs.fresh)):
            fresh[n + s], rubs.fresh[s] = rubs.fresh[s], False


@inner
def watch_edges(contacts: FlatContacts, pairs: Pairs | None, state: MovingState, q: Array) -> None:
    """Keep the coordinates of the first sample in which a closed row of a pair leaves its patch."""
    if pairs is not None:
        starts, lam = contacts.blocks.starts, contacts.blocks.lam
        for s in range(len(pairs.addresses)):
            one = pair_at(pairs, s)
            j = one.contact
            some = slice(starts[j], starts[j + 1])
            if not state.left[s] and contacts.values[j, 1] > 0.0 and leaves_patch(one, contacts.h[some], lam[some]):
                state.left[s] = True
                for i in range(len(q)):
                    state.left_at[s, i] = q[i]


# Steps.


@inner
def turn_on(frames: Frames | None, m: Motion, h: float) -> None:
    """Compose the rotations at the start of a step with those of the step; Exudyn adds up everything else."""
    if frames is not None:
        v, way, result = np.empty(3), np.empty(3), np.empty(3)
        for b in range(len(frames.rotation)):
            first = frames.places[b] + 3
            for i in range(3):
                dof = frames.dofs[first + i]
                v[i], way[i] = frames.rotation[b, i] + m.q_start[dof], h * m.v[dof]
            compose(v, way, result)
            for i in range(3):
                m.q[frames.dofs[first + i]] = result[i] - frames.rotation[b, i]


@inner
def add_inertia(bodies: Bodies, frames: Frames | None, m: Motion, half_step: float) -> None:
    """Add inertia forces of floating frames to those of contacts, see `user_functions.inertia_functions`.

    `half_step` is that since the middle of the step, to which velocities belong; zero if they belong to its end.
    """
    if frames is not None:
        for b in range(len(frames.rotation)):
            first, end = frames.places[b], frames.places[b + 1]
            n, moves = end - first - 6, False
            v, z = gathered(frames.dofs, first + 3, end, m.v), gathered(frames.dofs, first + 6, end, m.q)
            for i in range(len(v)):
                moves |= v[i] != 0.0
            if not moves:
                continue
            integrals = frames.numbers[frames.integrals[b] :][: 6 * (n + 1) ** 2].reshape(6, n + 1, n + 1)
            cross = frames.numbers[frames.cross[b] :][: 3 * n * n].reshape(3, n, n)
            elastic, change = np.empty(n), np.empty(n)
            for i in range(n):
                dof = frames.dofs[first + 6 + i]
                elastic[i] = bodies.stiffness[dof] * z[i]
                change[i] = bodies.stiffness[dof] * (z[i] - m.q_start[dof])
            if half_step > 0.0:
                q_t, q_tt = gathered(frames.dofs, first + 3, end, m.v_start), gathered(frames.dofs, first + 3, end, m.a)
                v = end_velocities(cross, v, change, q_t, q_tt, half_step)
            found = inertia_force(integrals, cross, frames.tensor[b], elastic, frames.coupled[b], v[:3], z, v[3:])
            for i in range(len(found)):
                m.force[frames.dofs[first + 3 + i]] += found[i]


@inner
def turn_accelerations(bodies: Bodies, frames: Frames | None, m: Motion) -> None:
    """Set the angular accelerations, whose inertia is no diagonal."""
    if frames is not None:
        for b in range(len(frames.rotation)):
            first = frames.places[b] + 3
            for i in range(3):
                m.a[frames.dofs[first + i]] = 0.0
                for k in range(3):
                    dof = frames.dofs[first + k]
                    m.a[frames.dofs[first + i]] += frames.inverse[b, i, k] * (m.force[dof] + bodies.load[dof])
