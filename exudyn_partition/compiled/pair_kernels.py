"""Compiled steps of contacts of two bodies whose rows follow facets; `followed_pairs` searches.

`pair_rows` does the same by NumPy. Rows are followed by the loops of `surfaces`, as in Exudyn's runs. Where these
cannot go on, `gaps_of_pair` says so, and `followed_pairs.FollowedPair` finds other rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba.experimental import structref

from ..algebra.product_kernels import matrix_at
from ..contact.kernels import FlatPair, followed_gaps, pushed_pairs, rows_along
from ..frames.node_kernels import FlatNodes, axes_at
from ..support.arrays import Array
from ..support.compiled import called, compiled, inlined, inner
from ..support.struct_kernels import StructType, address_of, define_struct, struct_at
from ..surfaces.kernels import weigh
from .body_kernels import gathered

if TYPE_CHECKING:
    from ..algebra.block_complementarity import FlatBlocks
    from .moving import MovingState

Following = tuple[float, int, float, int, float, float, float]  # see `followed_pairs.FOLLOWING`

find_rows, find_gaps, push_pairs = called(rows_along), called(followed_gaps), called(pushed_pairs)


@structref.register
class SideType(StructType):
    """Type of `PairSide` in compiled loops."""


class PairSide(structref.StructRefProxy):
    """What compiled runs have of a body of a pair besides its nodes.

    Parameters
    ----------
    body, d : int
        Number of the body among `Frames`, -1 in an inertial frame; values of a node in the flexibility.
    x : (np, 3) array
        Room for places of all nodes; NaN where they are not followed.
    F, fields : (d np, d np), (d np, m) arrays
        Of all nodes of the patch, see `Surfaces`.
    """

    body: int
    d: int
    x: Array
    F: Array
    fields: Array


define_struct(PairSide, SideType, [*PairSide.__annotations__])


@structref.register
class PairType(StructType):
    """Type of `Pair` in compiled loops."""


class Pair(structref.StructRefProxy):
    """Present rows of a contact of two bodies.

    Parameters
    ----------
    contact : int
        Number of the contact in the plan.
    dofs : (n,) int array
        Numbers of the coordinates of both bodies.
    flat : FlatPair
    slave, master : PairSide
    slots : (nr,) int array
        Numbers of the present rows among all rows of the patch.
    size, reach, part_reach : float
        Size of a facet; motion after which points are searched again, and parts that are near each other [m].
    parted : (3, 3) array
        Place of the slave relative to the master when such parts were found.
    found, normals : (nr,), (p, 3) arrays
        Room for the present gaps, if they are known, and for the normals at the points; of frozen pairs, of the rows.
    here, at_here : (3, 3) arrays
        Room for the place of the slave relative to the master, now and at the anchor.
    facet_before, local_before : (k,) int, (6, k) arrays
        Room for what is known of the points before they are followed, see `keep_points`.
    known : (1,) bool array
        Whether gaps, normals and place are those of the next evaluation already.
    leaves_at : (nr,) array
        See `stages.PresentRows`.
    along_s, along_m : (p, d) arrays
        Room for the normals at the anchor in the axes of both bodies.
    nodes_m, weights_m : (p, k) arrays
        Room for the master's nodes of the points, and their weights, at the anchor.
    frozen, may_freeze : int
        Whether pairs are frozen, or may be.
    H, h_start, drift, drift_start, slides_at
        Of frozen pairs, see `linear_gaps.LinearGaps`.
    steps : (1,) int array
        Steps since it was last asked whether pairs slide.
    within : (1,) array
    lifting : float
        See `Gaps.within` and `PatchGaps.lifting`.
    leaves_out : int
        Whether not all rows are followed.
    """

    contact: int
    dofs: Array
    flat: FlatPair
    slave: PairSide
    master: PairSide
    slots: Array
    size: float
    reach: float
    part_reach: float
    parted: Array
    found: Array
    normals: Array
    here: Array
    at_here: Array
    facet_before: Array
    local_before: Array
    known: Array
    leaves_at: Array
    along_s: Array
    along_m: Array
    nodes_m: Array
    weights_m: Array
    frozen: int
    may_freeze: int
    H: Array
    h_start: Array
    drift: Array
    drift_start: Array
    slides_at: float
    steps: Array
    within: Array
    lifting: float
    leaves_out: int


define_struct(Pair, PairType, [*Pair.__annotations__])


@structref.register
class PairsType(StructType):
    """Type of `Pairs` in compiled loops."""


class Pairs(structref.StructRefProxy):
    """All contacts of two bodies whose rows follow facets: addresses of `Pair`, (n,), and one of these as an example.

    `offset` is the number of moving contacts before them, `following` as in `followed_pairs`.
    """

    addresses: Array
    example: Pair
    offset: int
    following: Following


define_struct(Pairs, PairsType, [*Pairs.__annotations__])


@compiled
def pair_side(*fields: Any) -> PairSide:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return PairSide(*fields)  # type: ignore[no-untyped-call]


@compiled
def pair(*fields: Any) -> Pair:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Pair(*fields)  # type: ignore[no-untyped-call]


@compiled
def pairs(*fields: Any) -> Pairs:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Pairs(*fields)  # type: ignore[no-untyped-call]


@compiled
def address(one: Pair) -> int:
    """Where a pair is, as long as somebody holds it."""
    found: int = address_of(one)  # type: ignore[call-arg]
    return found


@inlined
def pair_at(some: Pairs, number: int) -> Pair:
    """A pair by its number."""
    found: Pair = struct_at(some.addresses[number], some.example)  # type: ignore[call-arg]
    return found


@inlined
def growing(state: MovingState, body: int) -> Array:
    """Products by which a body grows, see `Kinematics.growing`."""
    found = np.empty(0)
    if body >= 0 and state.grows[body]:
        found = state.products[body]
    return found


@inner
def stays_frozen(pair: Pair, q_j: Array, found: Array) -> bool:
    """Whether points of a pair stay frozen at its coordinates; if so, set the gaps of its rows, (nr,)."""
    for i in range(len(pair.drift_start)):
        total = -pair.drift_start[i]
        for k in range(len(q_j)):
            total += pair.drift[i, k] * q_j[k]
        if not abs(total) <= pair.slides_at:
            return False
    for i in range(len(found)):
        found[i] = pair.h_start[i]
        for k in range(len(q_j)):
            found[i] += pair.H[i, k] * q_j[k]
    return True


@inner
def keep_points(pair: Pair, back: bool) -> None:
    """Keep what is known of the points that are followed, or with `back` go back to what was kept.

    Where loops lose points, `PatchGaps` follows them from there, as in a run of Exudyn, up to the last bit.
    """
    points = pair.flat.rows.points
    for i in range(len(points.facet)):
        if back:
            points.facet[i] = pair.facet_before[i]
        else:
            pair.facet_before[i] = points.facet[i]
        for a in range(2):
            if back:
                points.local[a, i], points.step[a, i] = pair.local_before[a, i], pair.local_before[2 + a, i]
                points.last[a, i] = pair.local_before[4 + a, i]
            else:
                pair.local_before[a, i], pair.local_before[2 + a, i] = points.local[a, i], points.step[a, i]
                pair.local_before[4 + a, i] = points.last[a, i]


@inner
def gaps_of_pair(state: MovingState, pair: Pair, q: Array, gap: Array, following: Following) -> bool:
    """Set the gaps of all rows of the patch, (n,), and what belongs to them; False if other rows must be found.

    Rows that are not present have a gap that they cannot close.
    """
    if pair.known[0]:
        pair.known[0] = False
        fill_slots(pair.slots, pair.found, pair.size, gap)
        return True
    by, steps, near, patience, bulge, _, _ = following
    q_j = gathered(pair.dofs, 0, len(pair.dofs), q)
    if pair.frozen:
        found = np.empty(len(pair.slots))
        if not stays_frozen(pair, q_j, found):
            return False
    else:
        if pair.may_freeze and pair.steps[0] >= patience:
            return False
        keep_points(pair, False)
        here, normals, _, lost, found, least, more = find_gaps(
            pair.flat, q_j, growing(state, pair.slave.body), growing(state, pair.master.body), pair.slave.x,
            pair.master.x, pair.reach, by, steps, pair.size, bulge, near * pair.size, 0.0, pair.within[0],
        )  # fmt: skip
        lost_some = more or len(lost) > 0 or least != least
        for i in range(3):
            for k in range(3):
                lost_some = lost_some or not abs(here[i, k] - pair.parted[i, k]) <= pair.part_reach
                pair.here[i, k] = here[i, k]
        if lost_some:
            keep_points(pair, True)
            return False
        for i in range(len(normals)):
            for a in range(3):
                pair.normals[i, a] = normals[i, a]
    fill_slots(pair.slots, found, pair.size, gap)
    return True


@inner
def lacks_rows(pair: Pair, lam: Array, h: Array, pushed: Array, following: Following) -> bool:
    """Whether rows may close that are not followed; the next search has them, see `PatchGaps.follow_pushed`.

    Arrays are those of all rows of the patch, (n,): forces, gaps, and gaps with what other contacts push. How far a
    surface is pushed outwards is taken by the sum of the forces.
    """
    _, _, near, _, bulge, room, wider = following
    most, total, least, largest, shared = near * pair.size, 0.0, np.inf, 0.0, False
    if pair.frozen or not pair.leaves_out or pair.within[0] >= most:
        return False
    for i in pair.slots:
        total, least, shared = total + lam[i], min(least, pushed[i]), shared or pushed[i] != h[i]
        if lam[i] > 0.0:
            largest = max(largest, h[i])
    shuts = pair.lifting * total
    if shared:
        shuts = max(shuts, wider * largest)
    lacks = total > 0.0 and shuts > max(-bulge * least, least, pair.within[0])
    if lacks or room * shuts < pair.within[0] / 2:
        pair.within[0] = min(room * shuts, most)
    return lacks


@inner
def fill_slots(slots: Array, found: Array, size: float, gap: Array) -> None:
    """Set gaps of all rows of a patch, (n,), by those of the present rows, (nr,); others have the largest of these."""
    most = 0.0 if len(found) > 0 else size
    for i in range(len(found)):
        most = max(most, abs(found[i]))
    for i in range(len(gap)):
        gap[i] = most
    for i in range(len(found)):
        gap[slots[i]] = found[i]


@inner
def keep_gaps(pair: Pair, starts: Array, h: Array) -> None:
    """Keep the gaps of the present rows for the next evaluation, which is at the same coordinates."""
    pair.known[0] = True
    for i in range(len(pair.slots)):
        pair.found[i] = h[starts[pair.contact] + pair.slots[i]]


@inner
def set_along(nodes: FlatNodes, normals: Array, q: Array, along: Array) -> None:
    """Set normals, (p, 3), in the axes of a body, or ones where the flexibility is along the line of contact."""
    if along.shape[1] == 1:
        for i in range(len(along)):
            along[i, 0] = 1.0
        return
    axes = axes_at(nodes, q)
    for i in range(len(along)):
        for a in range(3):
            along[i, a] = 0.0
            for c in range(3):
                along[i, a] += normals[i, c] * axes[c, a]


@inner
def renew_pair_anchor(
    pair: Pair, state: MovingState, q: Array, same: float, anchored: bool, anchor: Array, products: Array
) -> bool:
    """Take an anchor here if there is none, or rows have moved by more than `same` since; whether that was done.

    Set are its coordinates, (nq,), products by which both sides grow, (12,), and what the flexibility needs.
    """
    most = 0.0 if anchored else np.inf
    for i in range(3):
        for k in range(3):
            most = max(most, abs(pair.here[i, k] / pair.size - pair.at_here[i, k] / pair.size))
    if most <= same:
        return False
    for i in range(len(q)):
        anchor[i] = q[i]
    for c in range(6):
        products[c] = state.products[pair.slave.body, c] if pair.slave.body >= 0 else 0.0
        products[6 + c] = state.products[pair.master.body, c] if pair.master.body >= 0 else 0.0
    q_j, n = gathered(pair.dofs, 0, len(pair.dofs), q), pair.flat.n
    for i in range(3):
        for k in range(3):
            pair.at_here[i, k] = pair.here[i, k]
    points = pair.flat.rows.points
    weights, facets, facet = points.weights.T, points.facets, points.facet
    weigh(points.local.T, points.step.T, points.table, weights)
    for i in range(len(facet)):
        for k in range(facets.shape[1]):
            pair.nodes_m[i, k], pair.weights_m[i, k] = facets[facet[i], k], -weights[i, k]
    set_along(pair.flat.slave, pair.normals, q_j[:n], pair.along_s)
    set_along(pair.flat.master, pair.normals, q_j[n:], pair.along_m)
    return True


@inner
def anchor_pair(blocks: FlatBlocks, pair: Pair, state: MovingState, s: int, q: Array, same: float) -> bool:
    """See `moving_kernels.anchor_surface`."""
    if pair.frozen:
        return False
    if renew_pair_anchor(pair, state, q, same, state.anchored[s], state.anchors[s], state.growing[s]):
        state.anchored[s], state.fresh[s], state.found[s] = True, True, False
    if state.found[s]:
        return False
    clear_pair(blocks, pair)
    points = pair.flat.rows.points
    add_flexibility(blocks, pair, pair.slave, points.nodes, points.shares, pair.along_s, -1.0)
    add_flexibility(blocks, pair, pair.master, pair.nodes_m, pair.weights_m, pair.along_m, 1.0)
    own, n = own_of_pair(blocks, pair), blocks.starts[pair.contact + 1] - blocks.starts[pair.contact]
    for i in range(n):
        state.diagonal[blocks.starts[pair.contact] + i] = own[i, i]
    state.found[s], blocks.n_closed[pair.contact], state.added[s] = True, -1, -1.0
    return True


@inlined
def own_of_pair(blocks: FlatBlocks, pair: Pair) -> Array:
    """Flexibility of all rows of a pair's patch, (n, n)."""
    n = blocks.starts[pair.contact + 1] - blocks.starts[pair.contact]
    return matrix_at(blocks.numbers, blocks.own[pair.contact], n, n)


@inner
def clear_pair(blocks: FlatBlocks, pair: Pair) -> None:
    """Set the flexibility and the fields of the present rows to zero."""
    own, n_fields, n = own_of_pair(blocks, pair), blocks.amplitudes.shape[1], len(pair.slots)
    fields = matrix_at(blocks.numbers, blocks.fields[pair.contact], n_fields, len(own))
    for i in range(n):
        for k in range(n):
            own[pair.slots[i], pair.slots[k]] = 0.0
        for f in range(n_fields):
            fields[f, pair.slots[i]] = 0.0


@inner
def used_nodes(nodes: Array, n: int) -> tuple[Array, Array]:
    """Those of n nodes that carry points, (m,), and the numbers among them of the nodes of each point, (p, k)."""
    column, used, m = np.full(n, -1), np.empty(n, np.int64), 0
    compact = np.empty(nodes.shape, np.int64)
    for i in range(nodes.shape[0]):
        for k in range(nodes.shape[1]):
            node = nodes[i, k]
            if column[node] < 0:
                column[node], used[m] = m, node
                m += 1
            compact[i, k] = column[node]
    return used[:m], compact


@inner
def flexibility_of(side: PairSide, used: Array) -> Array:
    """Flexibility of some nodes of a side, (d m, d m)."""
    d, n = side.d, len(used)
    F = np.empty((d * n, d * n))
    for i in range(n):
        for a in range(d):
            for k in range(n):
                for b in range(d):
                    F[d * i + a, d * k + b] = side.F[d * used[i] + a, d * used[k] + b]
    return F


@inner
def add_flexibility(
    blocks: FlatBlocks, pair: Pair, side: PairSide, nodes: Array, weights: Array, along: Array, sign: float
) -> None:
    """Add the flexibility of a side to that of the rows, and its fields.

    `sign` is that of what closes the gap where the flexibility is along the line of contact: `NormalRows.side_rows`.
    """
    if len(side.F) == 0:
        return
    d, (used, compact) = side.d, used_nodes(nodes, len(side.x))
    n, points = len(used), pair.flat.rows.points
    rows = find_rows(points.starts, points.columns, points.means, compact, weights, along, n)
    own, nr, m = own_of_pair(blocks, pair), len(pair.slots), d * n
    F, moved, n_fields = flexibility_of(side, used), np.empty(m), side.fields.shape[1]
    fields = matrix_at(blocks.numbers, blocks.fields[pair.contact], blocks.amplitudes.shape[1], len(own))
    for row in range(nr):
        for c in range(m):
            moved[c] = 0.0
        for i in range(m):
            share = rows[row, i]
            if share != 0.0:
                for c in range(m):
                    moved[c] += share * F[i, c]
                for f in range(n_fields):
                    on_node = side.fields[d * used[i // d] + i % d, f]
                    fields[f, pair.slots[row]] += (sign if d == 1 else 1.0) * share * on_node
        for other in range(row + 1):
            total = 0.0
            for c in range(m):
                total += rows[other, c] * moved[c]
            own[pair.slots[row], pair.slots[other]] += total
            if other < row:
                own[pair.slots[other], pair.slots[row]] += total


@inner
def forces_of_pair(pair: Pair, q: Array, lam: Array, force: Array, values: Array) -> None:
    """Add the generalised forces of a pair, and set its resultant, by forces on all rows of its patch, (n,)."""
    nr = len(pair.slots)
    push = np.empty(nr)
    for i in range(nr):
        push[i] = lam[pair.slots[i]]
    if pair.frozen:
        for i in range(nr):
            if push[i] != 0.0:
                for a in range(3):
                    values[2 + a] += push[i] * pair.normals[i, a]
                for k in range(pair.H.shape[1]):
                    force[pair.dofs[k]] += push[i] * pair.H[i, k]
        return
    pushed, total = push_pairs(pair.flat, push, pair.normals, gathered(pair.dofs, 0, len(pair.dofs), q))
    for a in range(3):
        values[2 + a] += total[a]
    for k in range(len(pushed)):
        force[pair.dofs[k]] += pushed[k]


@inner
def leaves_patch(pair: Pair, h: Array, lam: Array) -> bool:
    """Whether a closed row is where its patch ends, see `contact_record.look_for_edge`."""
    for i in range(len(pair.slots)):
        row = pair.slots[i]
        if lam[row] > 0.0 and (pair.leaves_at[i] == 0.0 or -h[row] >= pair.leaves_at[i]):
            return True
    return False
