"""Pairs of points and facets that move: each closest point is found from the previous one."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from types import ModuleType

import numpy as np

from ..fe.shapes import TABLES, corners_of, shape_functions
from ..support.arrays import Array
from ..support.compiled import kernels
from .points import ContactPoints, at_points
from .rows import EDGE_TOLERANCE
from .surface import Projection, Surface, closest_points, cross, newton_step

_STEPS = 6
_FOLLOWED = 1e-4  # of a facet: largest last step of Newton's method, and how far a point may pass a facet's edge
_ON_EDGE = 1e-6  # of a facet's size: round-off of a point that lies on the patch


class MovingPairs:
    """Points of one patch on the facets of another, which both move.

    Newton's method starts from the last closest point plus its last motion: in steady motion one step is enough. A
    point that leaves its facet is projected on the neighbour; if it is not there either, all facets are searched.
    Points past the edge of the patch are not searched.

    Parameters
    ----------
    master : Surface
        The facets at the start.
    facet : (p,) int array
        Facet of each point.
    local : (p, 2) array
        Closest points in the facets' coordinates.

    Attributes
    ----------
    any_gone : bool
        Whether some points are past the edge of the patch.
    """

    def __init__(self, master: Surface, facet: Array, local: Array) -> None:
        self.facets, self.size = master.facets, master.facet_size
        self._neighbours = master.neighbours
        self._middles, self._turns = _middles(master.facets), _turns(master)
        self.facet, self.local, self._last = facet.copy(), local.copy(), np.zeros_like(local)
        self._past, self._gone = np.zeros((2, len(facet)), dtype=bool)
        self.any_gone = False
        self._compiled = self.facets, *self._neighbours, self._turns, self._middles, TABLES[self.facets.shape[1]]

    def rest(self) -> None:
        """Forget the last motion of the points."""
        self._last[:] = 0.0

    def follow(
        self,
        points: ContactPoints,
        index: Array,
        x_s: Array,
        x_m: Array,
        everywhere: Callable[[], Array] | None = None,
    ) -> tuple[Projection, Array]:
        """Project some points again, and tell which points are past the edge.

        Parameters
        ----------
        points : ContactPoints
            The k points.
        index : (k,) int array
            Their numbers among the pairs.
        x_s : (ns, 3) array
            Places of the slave's nodes [m].
        x_m : (np, 3) array
            Places of the master's nodes [m]; NaN where they are not followed.
        everywhere : callable, optional
            Places of all nodes of the master, for points that must be searched. Default: x_m.

        Returns
        -------
        Projection, (k,) bool array
        """
        if loops := kernels("surfaces"):
            pairs, lost = self._follow_compiled(loops, points, index, x_s, x_m)
        else:
            pairs, lost = self._follow(index, points.at(x_s), x_m)
        if len(lost):
            x = at_points(points.nodes[lost], points.weights[lost], x_s)
            self._search(index, pairs, lost, x, x_m if everywhere is None else everywhere())
        return pairs, self._gone.take(index)

    def _follow(self, index: Array, x: Array, x_m: Array) -> tuple[Projection, Array]:
        """Follow points, x (k, 3), over edges; the second result are those that must be searched."""
        facet, last = self.facet.take(index), self._last.take(index, axis=0)
        local = self.local.take(index, axis=0) + last
        left = self._on_patch(index, _outside(local, self.facets.shape[1]))
        if len(left):
            facet[left], local[left], last[left] = self._cross(facet[left], local[left], last[left])
        pairs = follow(x, x_m.take(self.facets.take(facet, axis=0), axis=0), facet, local)
        last += pairs.local - local
        lost = left = self._on_patch(index, _outside(pairs.local, self.facets.shape[1], _FOLLOWED))
        if len(left):
            last[left] = 0.0
            lost = self._cross_again(pairs, left, x[left], x_m)
        self.facet[index], self.local[index], self._last[index] = pairs.facet, pairs.local, last
        return pairs, lost

    def _follow_compiled(
        self, loops: ModuleType, points: ContactPoints, index: Array, x_s: Array, x_m: Array
    ) -> tuple[Projection, Array]:
        """Do the same as `_follow`, compiled."""
        state = self.facet, self.local, self._last, self._past
        found = loops.follow(points.nodes, points.weights, x_s, index, x_m, *self._compiled, *state, _FOLLOWED, _STEPS)
        facet, local, weights, normal, gap, lost = found
        return Projection(facet, local, weights, normal, gap, np.zeros(len(index))), lost

    def _search(self, index: Array, pairs: Projection, lost: Array, x: Array, x_m: Array) -> None:
        """Project the points `lost`, x (k, 3), on all facets; find out which of them are past the edge."""
        pairs.put(lost, closest_points(x, x_m[self.facets]))
        self.facet[index[lost]], self.local[index[lost]] = pairs.facet[lost], pairs.local[lost]
        offset = np.where(self._at_rim(pairs.facet[lost], pairs.local[lost]), pairs.offset[lost], 0.0)
        self._past[index[lost]] = offset > _ON_EDGE * self.size
        self._gone[index[lost]] = offset > EDGE_TOLERANCE * self.size
        self.any_gone = bool(self._gone.any())

    def _on_patch(self, index: Array, left: Array) -> Array:
        """Those of the points `left`, numbers in `index`, that are not past the edge of the patch."""
        return left[~self._past[index[left]]] if len(left) else left

    def _cross(self, facet: Array, local: Array, last: Array) -> tuple[Array, Array, Array]:
        """Facets across the edges that points have crossed, with coordinates and motion there; unchanged at rims."""
        edge = np.argmin(_depths(local, self.facets.shape[1]), axis=0)
        neighbour, its_edge = (of[facet, edge] for of in self._neighbours)
        middle, turn = self._middles, self._turns[facet, edge]
        there = middle[its_edge] + np.einsum("kij,kj->ki", turn, local - middle[edge])
        over = (neighbour >= 0)[:, None]
        turned = np.einsum("kij,kj->ki", turn, last)
        return np.where(over[:, 0], neighbour, facet), np.where(over, there, local), np.where(over, turned, last)

    def _at_rim(self, facet: Array, local: Array) -> Array:
        """Which closest points lie on edges without a neighbour facet, (k,) bool."""
        on = np.stack(_depths(local, self.facets.shape[1]), axis=1) < _ON_EDGE
        return np.asarray((on & (self._neighbours[0][facet] < 0)).any(axis=1))

    def _cross_again(self, pairs: Projection, left: Array, x: Array, x_m: Array) -> Array:
        """Project points, x (k, 3), that have left their facets, on the neighbours; return those that are not there."""
        before = pairs.facet[left]
        facet, local, _ = self._cross(before, pairs.local[left], np.zeros((len(left), 2)))
        pairs.put(left, follow(x, x_m[self.facets[facet]], facet, local))
        lost = facet == before
        lost[_outside(pairs.local[left], self.facets.shape[1], _FOLLOWED)] = True
        searched: Array = left[lost]
        return searched


def _middles(facets: Array) -> Array:
    """Local coordinates of the middles of a facet's edges, (number of edges, 2)."""
    corners = corners_of(facets)
    return (corners + np.roll(corners, -1, axis=0)) / 2


def _turns(surface: Surface) -> Array:
    """(nf, number of edges, 2, 2) array: turns a step in a facet's coordinates to those of each neighbour."""
    middles, n_nodes = _middles(surface.facets), surface.facets.shape[1]
    tangents = np.einsum("ein,fnd->fedi", shape_functions(middles, n_nodes)[:, 1:], surface.points[surface.facets])
    turns: Array = np.linalg.pinv(tangents[surface.neighbours]) @ tangents
    return turns


def follow(points: Array, nodes: Array, facet: Array, local: Array, steps: int = _STEPS) -> Projection:
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
    shape = shape_functions(local, nodes.shape[1])
    frame = shape @ nodes
    miss = points - frame[:, 0]
    step, _, squared = newton_step(frame, miss)
    # The last step changes the weights to first order, but not the gap.
    weights = shape[:, 0] + step[:, :1] * shape[:, 1] + step[:, 1:] * shape[:, 2]
    normal = cross(frame[:, 1], frame[:, 2]) / np.sqrt(squared)[:, None]
    gap = np.einsum("kd,kd->k", miss, normal)
    found = Projection(facet, local + step, weights, normal, gap, np.zeros(len(gap)))
    if steps > 1:
        far = np.flatnonzero(np.maximum(abs(step[:, 0]), abs(step[:, 1])) > _FOLLOWED)
        if len(far):
            start = local[far] + np.clip(step[far], -1.0, 1.0)
            found.put(far, follow(points[far], nodes[far], facet[far], start, steps - 1))
    return found


def _depths(local: Array, n_nodes: int) -> list[Array]:
    """Distances of points from each edge of their facet, (k,) each, in its coordinates; positive inside."""
    r, s = local[:, 0], local[:, 1]
    return [s, 1 - r, 1 - s, r] if n_nodes == 4 else [s, 1 - r - s, r]


def _outside(local: Array, n_nodes: int, by: float = 0.0) -> Array:
    """Numbers of the points that are outside of their facets, (k,) int array."""
    return np.flatnonzero(reduce(np.minimum, _depths(local, n_nodes)) < -by)
