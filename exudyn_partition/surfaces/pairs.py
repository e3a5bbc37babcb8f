"""Pairs of points and facets that move: each closest point is found from the previous one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.vectors import cross
from ..fe.edges import edge_middles
from ..fe.shapes import TABLES, corners_of, curvature, shape_functions
from ..support.arrays import Array
from . import loops
from .holders import (
    AS_NEAR,
    BESIDE,
    BESIDE_ENDS,
    FOLLOWED,
    ON_END,
    Others,
    depths,
    least_depth,
    past_ends,
    places_beside,
    stray,
)
from .points import ContactPoints
from .projection import SETTLED, Projection, newton_step
from .surface import Surface, closest_points

if TYPE_CHECKING:
    from .moving_kernels import Followed, Moving

# Projects points on all facets. It returns projections, whether points face their facets, (k,), their places, (k, 3),
# and those of all nodes of the master, (np, 3) [m].
Meeting = Callable[[ContactPoints], tuple[Projection, Array, Array, Array]]
STEPS = 6


class MovingPairs:
    """Points of one patch on the facets of another, which both move.

    Newton's method starts from the last closest point plus its last motion: in steady motion two steps are enough. A
    point that leaves its facet is projected on the neighbour; if it is not there either, all facets are searched. A
    point past an end of the patch stays on its facet, which is continued, until another one may be as near.

    Parameters
    ----------
    master : Surface
        The facets at the start.
    facet : (p,) int array
        Facet of each point.
    local : (p, 2) array
        Closest points in the facets' coordinates.
    """

    def __init__(self, master: Surface, facet: Array, local: Array) -> None:
        # Loops are compiled again for arrays of another layout.
        self.facets, self.size = np.ascontiguousarray(master.facets), master.facet_size
        self._others, self._ends = master.others, master.ends_of_facets
        # Points do not cross sharp edges: they are searched there, so that their normals decide which face they meet.
        smooth = self._others.around[:, self._ends.shape[1] :, 1] >= 0
        self._neighbours = np.where(smooth, master.neighbours[0], -1), master.neighbours[1]
        self._middles, self._turns = edge_middles(master.facets), master.turns
        self._facet, self._local, self._last = facet.copy(), local.copy(), np.zeros_like(local)
        self._past, self._gone = np.zeros((2, len(facet)), dtype=bool)
        table, others = TABLES[self.facets.shape[1]], (self._others.around, self._others.lean)
        self._of_master = self.facets, *self._neighbours, self._ends, self._turns, self._middles, table, *others
        nf = len(self.facets)
        self._room = np.empty(nf, dtype=bool), np.empty((nf, len(table), 3))
        # Of compiled loops: the points that they follow, their numbers, and how far these have moved last.
        self._points: ContactPoints | None = None
        self._index, self._motion = np.empty(0, dtype=np.int64), np.zeros((0, 2))
        self._moving: Moving
        # Of the last projection: facets and coordinates; compiled, these are those before a last step, which comes
        # third, else the third are shape functions.
        self._here: tuple[Array, Array, Array]

    def rest(self) -> None:
        """Forget the last motion of the points."""
        self._last[:] = self._motion[:] = 0.0

    def follow(
        self,
        points: ContactPoints,
        index: Array,
        x_s: Array,
        x_m: Array,
        meet: Meeting | None = None,
    ) -> tuple[Array, Array]:
        """Project some points again. `carriers` and `nodal_forces` are about those that were projected last.

        Parameters
        ----------
        points : ContactPoints
            The k points, with the rows that they make.
        index : (k,) int array
            Their numbers among the pairs.
        x_s : (ns, 3) array
            Places of the slave's nodes [m].
        x_m : (np, 3) array
            Places of the master's nodes [m]; NaN where they are not followed.
        meet : callable, optional
            Projects points that must be searched, see `Meeting`. Default: on the closest facets, with places x_m.

        Returns
        -------
        (k, 3) array, (k,) array
            Normals, and gaps [m]; the gap of points that face nothing is the size of a facet.
        """
        if loops.at_once():
            normal, gap, lost = loops.follow(self.moving(points, index), x_s, x_m, FOLLOWED, STEPS, self.size)
        else:
            found, lost = self._follow(index, points.at(x_s), x_m)
            self._here, normal = (found.facet, found.local, found.weights), found.normal
            gap = found.gap
        if len(lost):
            self.search(points, index, lost, meet or self._closest_at(x_s, x_m), normal, gap)
        return normal, gap

    def moving(self, points: ContactPoints, index: Array) -> Moving:
        """What compiled loops need to follow some points; it is made once for the same points."""
        if self._points is not points:
            mean, k = points.mean, len(index)
            self._keep()
            last, now = (np.ascontiguousarray(values.take(index, axis=0).T) for values in (self._last, self._local))
            facet, step = self._facet.take(index), np.zeros_like(now)
            self._here, self._motion, self._index = (facet, now.T, step.T), last.T, index
            rows = points.nodes, points.weights, np.ascontiguousarray(index), mean.indptr, mean.indices, mean.data
            state = self._past, self._gone, facet, now, step, last
            room = np.empty((k, 3)), np.empty(k, dtype=np.int64), np.empty((12, k))
            more = np.empty((3, k)), np.empty((self.facets.shape[1], k)), *self._room
            self._moving = loops.moving(*rows, *self._of_master, *state, *room, *more)
            self._points = points
        return self._moving

    def followed(self, points: ContactPoints, index: Array, *choice: Array) -> Followed:
        """What compiled loops need to follow the rows of some points; `choice` are its other fields."""
        return loops.followed(self.moving(points, index), *choice)

    def _keep(self) -> None:
        """Keep what is known of the points that compiled loops have followed."""
        if self._points is not None:
            facet, local, step = self._here
            self._facet[self._index], self._local[self._index] = facet, local + step
            self._last[self._index] = self._motion

    @property
    def facet(self) -> Array:
        """Facet of each point, (p,)."""
        self._keep()
        return self._facet

    @property
    def local(self) -> Array:
        """Closest points in the facets' coordinates, (p, 2)."""
        self._keep()
        return self._local

    def _closest_at(self, x_s: Array, x_m: Array) -> Meeting:
        def meet(points: ContactPoints) -> tuple[Projection, Array, Array, Array]:
            x = points.at(x_s)
            return closest_points(x, x_m[self.facets]), np.ones(len(x), dtype=bool), x, x_m

        return meet

    def search(
        self, points: ContactPoints, index: Array, lost: Array, meet: Meeting, normal: Array, gap: Array
    ) -> None:
        """Project the points `lost` of those that were followed on all facets, and put their normals and gaps right.

        Find out, too, which of them are past an end, see `continue_past_ends`, and which face nothing any more.
        """
        found, faces, x, x_m = meet(replace(points, nodes=points.nodes[lost], weights=points.weights[lost]))
        facet, local, rest = self._here
        searched, nodes = index[lost], x_m[self.facets]
        past, out = continue_past_ends(found, x, nodes, self._ends, self.size)
        hold(found, np.flatnonzero(~past), x, nodes, self._others, self.size)
        gone = ~faces | (out > BESIDE_ENDS * self.size)
        self._past[searched], self._gone[searched] = past, gone
        facet[lost], local[lost] = found.facet, found.local
        rest[lost] = 0.0 if self._points is points else found.weights
        self._facet[searched], self._local[searched] = found.facet, found.local
        normal[lost], gap[lost] = found.normal, np.where(gone, self.size, found.gap)

    @property
    def carriers(self) -> tuple[Array, Array]:
        """Nodes of the master around the closest points, and their shape functions there, (k, n) each."""
        facet, _, weights = self._here
        if loops.at_once():
            weights = loops.weights(self._moving)
        return self.facets.take(facet, axis=0), weights

    def nodal_forces(self, lam: Array, normal: Array, n_s: int, n_m: int) -> list[Array] | None:
        """Forces on the n_s and n_m nodes of both patches, (n, 3) each [N]; None unless it is done at once.

        They are of forces on the rows, (nr,) [N], along normals of the points, (k, 3).
        """
        return loops.nodal_forces(self._moving, lam, normal, n_s, n_m) if loops.at_once() else None

    def _follow(self, index: Array, x: Array, x_m: Array) -> tuple[Projection, Array]:
        """Follow points, x (k, 3), over edges; the second result are those that must be searched, (m,) int array."""
        facet, last = self._facet.take(index), self._last.take(index, axis=0)
        local = self._local.take(index, axis=0) + last
        left = self._on_patch(index, _outside(local, self.facets.shape[1], FOLLOWED))
        if len(left):
            facet[left], local[left], last[left] = self._cross(facet[left], local[left], last[left])
        pairs = follow(x, x_m.take(self.facets.take(facet, axis=0), axis=0), facet, local)
        last += pairs.local - local
        lost = left = self._on_patch(index, _outside(pairs.local, self.facets.shape[1], FOLLOWED))
        if len(left):
            last[left] = 0.0
            lost = self._cross_again(pairs, left, x[left], x_m)
        held = hold(pairs, np.flatnonzero(~self._past[index]), x, x_m[self.facets], self._others, self.size)
        last[held] = 0.0
        self._facet[index], self._local[index], self._last[index] = pairs.facet, pairs.local, last
        gone = self._gone[index]
        pairs.gap[gone] = self.size
        past = np.flatnonzero(self._past[index] & ~gone)
        out, inner = past_ends(pairs.local[past], self._ends[pairs.facet[past]], self.facets.shape[1])
        return pairs, np.concatenate([lost, past[stray(out, inner, self.size)]])

    def _on_patch(self, index: Array, left: Array) -> Array:
        """Those of the points `left`, numbers in `index`, that are not past the edge of the patch."""
        return left[~self._past[index[left]]] if len(left) else left

    def _cross(self, facet: Array, local: Array, last: Array) -> tuple[Array, Array, Array]:
        """Facets across the edges that points have crossed, with coordinates and motion there; unchanged at rims."""
        edge = np.argmin(depths(local, self.facets.shape[1]), axis=0)
        neighbour, its_edge = (of[facet, edge] for of in self._neighbours)
        middle, turn = self._middles, self._turns[facet, edge]
        there = middle[its_edge] + np.einsum("kij,kj->ki", turn, local - middle[edge])
        over = (neighbour >= 0)[:, None]
        turned = np.einsum("kij,kj->ki", turn, last)
        return np.where(over[:, 0], neighbour, facet), np.where(over, there, local), np.where(over, turned, last)

    def _cross_again(self, pairs: Projection, left: Array, x: Array, x_m: Array) -> Array:
        """Project points, x (k, 3), that have left their facets, on the neighbours; return those that are not there."""
        before = pairs.facet[left]
        facet, local, _ = self._cross(before, pairs.local[left], np.zeros((len(left), 2)))
        pairs.put(left, follow(x, x_m[self.facets[facet]], facet, local))
        lost = facet == before
        lost[_outside(pairs.local[left], self.facets.shape[1], FOLLOWED)] = True
        searched: Array = left[lost]
        return searched


def follow(points: Array, nodes: Array, facet: Array, local: Array, steps: int = STEPS) -> Projection:
    """Project points that have moved a little, each on its facet, which is continued past its edges.

    Parameters
    ----------
    points : (k, 3) array
        Places of the points [m].
    nodes : (k, n, 3) array
        Positions of the nodes of each point's facet [m].
    facet : (k,) int array
        Numbers of the facets, for the result.
    local : (k, 2) array
        First guess of the closest points in the facets' coordinates.
    steps : int
        Most steps of Newton's method.
    """
    if loops.at_once():
        there, weights, normal, gap = loops.follow_on(points, nodes, local, steps)
        return Projection(facet, there, weights, normal, gap, np.zeros(len(gap)))
    shape = shape_functions(local, nodes.shape[1])
    frame = shape @ nodes
    miss = points - frame[:, 0]
    bends = curvature(local, np.einsum("knd,kd->kn", nodes, miss))
    step, _, squared = newton_step(frame, miss, bends)
    # The last step changes the weights to first order, but not the gap.
    weights = shape[:, 0] + step[:, :1] * shape[:, 1] + step[:, 1:] * shape[:, 2]
    normal = cross(frame[:, 1], frame[:, 2]) / np.sqrt(squared)[:, None]
    gap = np.einsum("kd,kd->k", miss, normal)
    found = Projection(facet, local + step, weights, normal, gap, np.zeros(len(gap)))
    if steps > 1:
        far = np.flatnonzero(np.maximum(abs(step[:, 0]), abs(step[:, 1])) > SETTLED)
        if len(far):
            start = local[far] + np.clip(step[far], -1.0, 1.0)
            found.put(far, follow(points[far], nodes[far], facet[far], start, steps - 1))
    return found


def continue_past_ends(found: Projection, points: Array, nodes: Array, ends: Array, size: float) -> tuple[Array, Array]:
    """Project points that are a little past the ends of a patch on their facets beyond it, as when they are followed.

    So forces do not depend on when points were searched.

    Parameters
    ----------
    found : Projection
        Of the k points on the patch; it is changed.
    points : (k, 3) array
        Places of the points [m].
    nodes : (nf, n, 3) array
        Positions of the nodes of each facet [m].
    ends : (nf, number of edges) array
        `Surface.ends_of_facets` [m].
    size : float
        Of the facets [m].

    Returns
    -------
    (k,) bool array, (k,) array
        Which points are past an end, and how far [m].
    """
    n_nodes = nodes.shape[1]
    on = np.stack(depths(found.local, n_nodes), axis=1) < ON_END
    out = np.where((on & (ends[found.facet] > 0.0)).any(axis=1), found.offset, 0.0)
    past = out > ON_END * size
    near = np.flatnonzero(past & (out <= BESIDE_ENDS * size))
    if len(near):
        own = found.facet[near]
        found.put(near, follow(points[near], nodes[own], own, found.local[near]))
        out[near], _ = past_ends(found.local[near], ends[own], n_nodes)
    return past, out


def hold(found: Projection, some: Array, points: Array, nodes: Array, others: Others, size: float) -> Array:
    """Put projections of points that several facets have on the one that has them wherever they come from.

    Parameters
    ----------
    found : Projection
        Of the k points; it is changed.
    some : (m,) int array
        Numbers of the points that are looked at.
    points : (k, 3) array
        Places of the points [m].
    nodes : (nf, n, 3) array
        Positions of the nodes of each facet [m].
    others : Others
    size : float
        Of the facets [m].

    Returns
    -------
    (j,) int array
        Points that changed their facets. The gap of a point is NaN if a facet is that is not followed.
    """
    n_nodes = nodes.shape[1]
    some = some[least_depth(found.local[some], n_nodes) >= -FOLLOWED]
    facet = found.facet[some]
    at = places_beside(found.local[some], n_nodes, BESIDE * FOLLOWED + others.lean[facet] * abs(found.gap[some]))
    some, tried = some[at >= 0], others.around[facet[at >= 0], at[at >= 0]]
    if not len(some):
        return np.empty(0, dtype=np.int64)
    row, column = np.nonzero((tried >= 0) & (tried != found.facet[some, None]))
    index, facet = some[row], tried[row, column]
    middle = np.tile(corners_of(nodes).mean(axis=0), (len(index), 1))
    every = follow(points[index], nodes[facet], facet, middle)
    away = np.where(tried < 0, np.inf, abs(found.gap[some])[:, None])
    away[row, column] = np.where(least_depth(every.local, n_nodes) >= -FOLLOWED, abs(every.gap), np.inf)
    first = (away <= away.min(axis=1, keepdims=True) + AS_NEAR * size).argmax(axis=1)
    changed = first[row] == column
    found.put(index[changed], every.part(changed))
    found.gap[index[np.isnan(every.gap)]] = np.nan
    return np.asarray(index[changed])


def _outside(local: Array, n_nodes: int, by: float = 0.0) -> Array:
    """Numbers of the points that are outside of their facets, (k,) int array."""
    return np.flatnonzero(least_depth(local, n_nodes) < -by)
