"""Facets of a contact patch and the closest point on them (paper, section 3: node-to-segment, eq. 19)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..errors import ComplementarityError
from ..fe.edges import edge_middles, neighbours_across, sharp_nodes
from ..fe.facets import area_vectors, facet_corners, of_one_shape
from ..fe.patches import Patch
from ..fe.shapes import shape_functions
from ..support.arrays import Array
from . import loops
from .holders import Others
from .projection import Projection

_CANDIDATES = 8  # facets that are tried for each point, nearest centroids first
_FEW = 300  # places up to which each of them is asked for its distance; a tree of more is quicker
_NOT_FINITE = "the places of the patches are not finite: the run has become unstable"


@dataclass(frozen=True, eq=False)
class Surface:
    """A contact patch in space: positions of nodes, facets and the line of contact.

    Parameters
    ----------
    points : (np, 3) array
        Positions of the patch's nodes [m].
    facets : (nf, 3), (nf, 6), (nf, 10), (nf, 4), (nf, 8), (nf, 7) or (nf, 13) int array
        Nodes of each facet as rows of `points`, ordered so that normals point outward. Those of a patch with triangles
        and quadrilaterals are in halves, see `fe.halves`.
    direction : (3,) array
        Outward unit vector: the line of contact of the patch.
    rim : (k,) int array
        Rows of `points` beyond which the surface of the body continues.
    nodes : (np,) int array
        Numbers of these nodes in the body.
    direction_given : bool
        Whether the user gave `direction`. If not, it follows from the mesh.
    wanders : bool
        Whether contact wanders over the patch, so that its normals decide and not `direction`.
    sharp : (k,) int array
        Rows of `points` on sharp edges, where integrated rows are the gaps of nodes; see `points`.
    ends : (k,) int array
        Those of them where the patch ends; the others are between its facets.
    """

    points: Array
    facets: Array
    direction: Array
    rim: Array
    nodes: Array
    direction_given: bool = False
    wanders: bool = False
    sharp: Array = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    ends: Array = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def of(cls, points: Array, patch: Patch, position: Array) -> Surface:
        """Contact patch of a body with the nodes `points`, (n, 3) [m], shifted by `position`, (3,) [m]."""
        nodes = patch.nodes
        facets, rim = (np.searchsorted(nodes, part) for part in (patch.facets, patch.rim))
        facets = of_one_shape(facets)
        places, given = points[nodes] + position, patch.direction_given
        found = cls(places, facets, patch.direction, rim, nodes, given, patch.wanders)
        sharp, ends = sharp_nodes(places, facets), found.ends
        if patch.ends is not None:
            ends = np.searchsorted(nodes, patch.ends)
        return replace(found, sharp=np.union1d(sharp, ends), ends=ends)

    @cached_property
    def without_edges(self) -> Surface:
        """The same patch without rows of its own at sharp edges."""
        return replace(self, sharp=self.sharp[:0], ends=self.ends[:0])

    @property
    def flatness(self) -> float:
        """How certain `direction` is: length of the mean unit normal, 1 for a plane; 2 if the user gave it."""
        if self.direction_given:
            return 2.0
        normals = area_vectors(self.points, self.facets)
        return float(np.linalg.norm(normals.sum(axis=0)) / np.linalg.norm(normals, axis=1).sum())

    def has(self, nodes: Array) -> Array:
        """Whether each node of the patch is one of some nodes, (np,) bool."""
        found = np.zeros(len(self.points), dtype=bool)
        found[nodes] = True
        return found

    @cached_property
    def normal_here(self) -> Array:
        """Mean unit normal of the facets in their present places, (3,)."""
        total = area_vectors(self.points, self.facets).sum(axis=0)
        normal: Array = total / math.hypot(*total)
        return normal

    def normals_at(self, nodes: Array, weights: Array) -> Array:
        """Unit normals at points, (p, 3): means over the facets around their nodes, in their present places.

        Beside a sharp edge the normals of points within a facet do not turn towards the other face.

        Parameters
        ----------
        nodes : (p, k) int array
            Rows of `points` that carry each point.
        weights : (p, k) array
            Shape functions of these nodes at the points.
        """
        vectors, around = area_vectors(self.points, self.facets), np.zeros_like(self.points)
        for axis in range(3):
            each = (vectors[:, axis, None] * self._first).ravel()
            around[:, axis] = np.bincount(self.facets.ravel(), each, minlength=len(around))
        around /= np.maximum(np.linalg.norm(around, axis=1), 1e-300)[:, None]
        of_nodes = around[nodes]
        if len(self.sharp) and nodes.shape[1] > 1:
            sharp, within = np.zeros(len(around), dtype=bool), weights.max(axis=1) < 1
            sharp[self.sharp] = True
            own = area_vectors(self.points, nodes)
            own /= np.maximum(np.linalg.norm(own, axis=1), 1e-300)[:, None]
            of_nodes = np.where((sharp[nodes] & within[:, None])[:, :, None], own[:, None], of_nodes)
        normals = np.einsum("pk,pkd->pd", weights, of_nodes)
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None])

    @cached_property
    def _first(self) -> Array:
        """(nf, k) bool array: the first place of each node in its facet."""
        facets = self.facets
        again = [(facets[:, :i] == facets[:, i : i + 1]).any(axis=1) for i in range(facets.shape[1])]
        return ~np.stack(again, axis=1)

    @cached_property
    def facet_size(self) -> float:
        """Mean edge length of the facets [m]."""
        corners = self.points[facet_corners(self.facets)]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @cached_property
    def longest(self) -> float:
        """Longest edge of the facets [m]."""
        corners = self.points[facet_corners(self.facets)]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())

    @cached_property
    def neighbours(self) -> tuple[Array, Array]:
        """Neighbour across each facet's edges 01, 12, ..., and the number of the shared edge in the neighbour.

        Two (nf, number of edges) arrays; the neighbour is -1 where there is none.
        """
        return neighbours_across(self.facets)

    @cached_property
    def ends_of_facets(self) -> Array:
        """Height of each facet above its edges where the patch ends [m], zero at others, (nf, number of edges)."""
        corners = self.points[facet_corners(self.facets)]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        area = np.linalg.norm(area_vectors(self.points, self.facets), axis=1)
        heights = (2.0 if corners.shape[1] == 3 else 1.0) * area[:, None] / np.maximum(lengths, 1e-300)
        return np.where(self.neighbours[0] < 0, heights, 0.0)

    @cached_property
    def others(self) -> Others:
        """Facets that may have the points of a facet, too."""
        return Others.of(self.points, self.facets, self.neighbours[0])

    @cached_property
    def turns(self) -> Array:
        """(nf, number of edges, 2, 2) array: turns a step in a facet's coordinates to those of each neighbour."""
        middles, n_nodes = edge_middles(self.facets), self.facets.shape[1]
        tangents = np.einsum("ein,fnd->fedi", shape_functions(middles, n_nodes)[:, 1:], self.points[self.facets])
        turns: Array = np.linalg.pinv(tangents[self.neighbours]) @ tangents
        return turns


def nearest_places(tree: cKDTree, points: Array, count: int = 1) -> Array:
    """Numbers of the places in a tree that are nearest to each of some points, (k, count).

    Raises
    ------
    ComplementarityError
        If points are so far away that no place is nearest.
    """
    if math.isfinite(points.sum()):
        distance, found = tree.query(points, k=count)
        if math.isfinite(distance.sum()):
            return np.asarray(found).reshape(len(points), count)
    raise ComplementarityError(_NOT_FINITE)


def _nearest_of(places: Array, points: Array, count: int) -> Array:
    """Do the same with places, (n, 3), that are not in a tree: to ask each of a few is quicker."""
    found = loops.nearest(places, points, count) if len(places) <= _FEW else None
    if found is None:
        return nearest_places(cKDTree(places), points, count)
    if found.min(initial=0) < 0:
        raise ComplementarityError(_NOT_FINITE)
    return found


def closest_points(points: Array, facets: Array) -> Projection:
    """Project points on a surface of triangles or quads, flat or curved.

    Newton's method in the facet's coordinates, clipped to the facet. The nearest of several candidates is taken.

    Parameters
    ----------
    points : (k, 3) array
        Places of the points [m].
    facets : (nf, n, 3) array
        Positions of the facets' nodes [m].

    Returns
    -------
    Projection

    Raises
    ------
    ComplementarityError
        See `nearest_places`.
    """
    centre = facets.mean(axis=(0, 1))
    points, facets = points - centre, facets - centre  # reduces round-off
    candidates = min(_CANDIDATES, len(facets))
    return loops.closest(points, facets, _nearest_of(facet_corners(facets).mean(axis=1), points, candidates))
