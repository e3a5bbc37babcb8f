"""Contact points of a slave's patch, which must not enter the master, and the rows that they make.

Node-to-segment (paper, section 3) has a row for each node of the patch. On quadratic facets that is poor: a uniform
pressure has no share at the vertices, so forces vary strongly from node to node.

Integrated rows take a weighted mean of the gap for each node; the weight is a hat function. The Kuhn-Tucker conditions
hold for each mean. Multipliers are then piecewise linear, displacements linear, quadratic or cubic, and integrals are
those over the slave's facets. Quadratic triangles are split into the four between their nodes, cubic ones into nine, so
that all hats are positive (Puso, Laursen and Solberg 2008). Nodes at sharp edges have rows of their own, see `edges`.

Rows "edges" are these alone, for the edges of a master beside a contact whose rows are those of its slave.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..errors import MeshError
from ..fe.facets import NODAL_SHARES, facet_corners
from ..fe.halves import whole_facets
from ..fe.quadrature import RULES, facet_integration, half_hats
from ..fe.shapes import FACET_NODES, linear_shares
from ..support.arrays import Array, as_read_only
from ..support.checks import validate_choice
from . import loops
from .edges import beside_edges
from .surface import Surface

RowKind = Literal["integrated", "node-to-segment", "edges", "spot"]
ROW_KINDS: tuple[RowKind, ...] = get_args(RowKind)
ROWS = ROW_KINDS[:2]  # of a whole patch


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """The p contact points of a patch, and nr rows; the gap of a row is the mean of those of some points.

    Parameters
    ----------
    nodes : (p, k) int array
        Patch nodes that carry each point.
    weights : (p, k) array
        Shape functions of these nodes at the points.
    mean : (nr, p) csr matrix
        Weights of the points in each row; their sum is one.
    row_nodes : (nr,) int array
        Patch node that each row belongs to.
    area : (nr,) array
        Area that each row stands for [m2]; their sum is the patch's. Rows of nodes at sharp edges have none.
    pressures : (np, np) csr matrix
        Pressure around the patch's nodes, by the forces of the rows [1/m2]. Integrated rows: the mean over the hat
        function of each node. Node-to-segment: the mean over hats of the facets' corners, because nodal forces of
        quadratic facets vary strongly.
    """

    nodes: Array
    weights: Array
    mean: sp.csr_matrix
    row_nodes: Array
    area: Array
    pressures: sp.csr_matrix

    @property
    def nodal(self) -> bool:
        """Whether each row is a single point."""
        return bool(self.nodes.shape[1] == 1)

    @cached_property
    def quick_mean(self) -> Array | sp.csr_matrix:
        """`mean` as what multiplies fastest."""
        return self.mean.toarray() if math.prod(self.mean.shape) <= _DENSE else self.mean

    @cached_property
    def node_areas(self) -> Array:
        """Area of the row of each node of the patch, (np,) [m2]; zero without a row, or at a sharp edge."""
        areas = np.zeros(self.pressures.shape[0])
        areas[self.row_nodes] = self.area
        return as_read_only(areas)

    @cached_property
    def triplets(self) -> tuple[Array, Array, Array]:
        """`mean` as rows, points and weights."""
        row, point, share = sp.find(self.mean)
        return row, point, share

    def rows_of(self, nodes: Array) -> Array:
        """Numbers of the rows of some nodes, (k,) int array."""
        return np.searchsorted(self.row_nodes, nodes)

    def average(self, values: Array) -> Array:
        """Means of each row, (nr, ...), of values at the points, (p, ...)."""
        if self.nodal:
            return values
        return loops.average(self, values)

    def spread(self, forces: Array) -> Array:
        """Forces at the points, (p, ...), of forces on the rows, (nr, ...): the transpose of `average`."""
        if self.nodal:
            return forces
        return loops.spread(self, forces)

    def at(self, points: Array) -> Array:
        """Positions of the contact points, (p, 3), from those of the patch's nodes, (np, 3) [m]."""
        return loops.at_points(self.nodes, self.weights, points)

    def restricted(self, points: Array) -> ContactPoints:
        """Take some points (a mask); rows become the means of these, and rows without points are dropped."""
        mean, n = self.mean, len(self.area)  # by its arrays: products of sparse matrices take ten times as long
        row, used = np.repeat(np.arange(n), np.diff(mean.indptr)), points[mean.indices]
        share = np.bincount(row[used], mean.data[used], minlength=n)
        kept = share > _LEAST_SHARE
        used &= kept[row]
        of_rows, number = row[used], np.cumsum(points) - 1
        starts = np.concatenate([[0], np.cumsum(np.bincount(of_rows, minlength=n)[kept])])
        values = mean.data[used] / share[of_rows], number[mean.indices[used]], starts
        return replace(
            self,
            nodes=self.nodes[points],
            weights=self.weights[points],
            mean=sp.csr_matrix(values, shape=(len(starts) - 1, np.count_nonzero(points))),
            row_nodes=self.row_nodes[kept],
            area=self.area[kept] * share[kept],
        )

    def of_rows(self, rows: Array) -> tuple[ContactPoints, Array]:
        """Return some rows, an index, with their points; the second value is the numbers of these points."""
        mean, numbers = self.mean, np.arange(len(self.area))[rows]  # by its arrays, as in `restricted`
        starts = np.concatenate([[0], np.cumsum(np.diff(mean.indptr)[numbers])])
        entries = np.arange(starts[-1]) + np.repeat(mean.indptr[numbers] - starts[:-1], np.diff(starts))
        used = np.zeros(len(self.nodes), dtype=bool)
        used[mean.indices[entries]] = True
        points, number = np.flatnonzero(used), np.cumsum(used) - 1
        values = mean.data[entries], number[mean.indices[entries]], starts
        kept = replace(
            self,
            nodes=self.nodes[points],
            weights=self.weights[points],
            mean=sp.csr_matrix(values, shape=(len(numbers), len(points))),
            row_nodes=self.row_nodes[numbers],
            area=self.area[numbers],
        )
        return kept, points


_DENSE = 200_000  # entries of a matrix up to which a dense one multiplies faster than a sparse one
_NO_AREA = 1e-9  # a facet has no area if it is below this, by the square of the mean edge
_LEAST_SHARE = 1e-3  # a row is dropped if less than this share of its area is left


def contact_points(surface: Surface, rows: RowKind) -> ContactPoints:
    """Contact points of a slave's patch.

    Parameters
    ----------
    surface : Surface
    rows : {"integrated", "node-to-segment", "edges"}

    Raises
    ------
    MeshError
        If a facet has no area.
    """
    validate_choice("rows", rows, ROW_KINDS)
    if rows == "edges":
        every = contact_points(surface, "integrated")
        return every.of_rows(np.isin(every.row_nodes, surface.sharp))[0]
    facets, n = surface.facets, len(surface.points)
    nf, k = facets.shape
    _, weight, hats = RULES[k]
    shape, area = facet_integration(surface.points, facets)
    flat = np.flatnonzero(area.sum(axis=1) <= _NO_AREA * surface.facet_size**2)
    if len(flat):
        where = surface.points[facet_corners(facets[flat[:1]])].mean(axis=(0, 1))
        raise MeshError(
            f"{len(flat)} of {nf} facets of the contact patch have no area, such as the one at {where} m: their nodes "
            "lie on a line or at one point. Repair or refine the mesh there"
        )
    share = area[:, :, None] * hats  # (nf, nq, k)
    hat_area = np.bincount(facets.ravel(), share.sum(axis=1).ravel(), minlength=n)
    used = np.unique(facets)
    if rows == "integrated":
        points = np.arange(area.size).reshape(area.shape)
        where = np.broadcast_arrays(facets[:, None, :], points[:, :, None])
        weighted = sp.csr_matrix((share.ravel(), [x.ravel() for x in where]), shape=(n, area.size))
        weighted.eliminate_zeros()
        of_facets = sp.kron(sp.identity(nf), np.ones((1, len(weight))), format="csc")
        carriers = np.repeat(facets, len(weight), axis=0), np.tile(shape, (nf, 1))
        return _integrated(surface, weighted, area.ravel(), carriers, of_facets)
    of_corners = corner_hats(surface)
    corner_area = of_corners @ hat_area
    inverse = sp.diags(np.divide(1.0, corner_area, out=np.zeros(n), where=corner_area > 0))
    shares = np.outer(area.sum(axis=1), NODAL_SHARES[k]).ravel()
    return ContactPoints(
        nodes=used[:, None],
        weights=np.ones((len(used), 1)),
        mean=sp.identity(len(used), format="csr"),
        row_nodes=used,
        area=np.bincount(facets.ravel(), shares, minlength=n)[used],
        pressures=sp.csr_matrix(inverse @ of_corners),
    )


def _integrated(
    surface: Surface, hats: sp.csr_matrix, area: Array, carriers: tuple[Array, Array], facets: sp.csc_matrix
) -> ContactPoints:
    """Integrated rows, and rows of the nodes at sharp edges.

    Parameters
    ----------
    surface : Surface
    hats : (np, p) csr matrix
        Hats of the nodes at the integration points, times `area`.
    area : (p,) array
        Area of each integration point [m2].
    carriers : (p, k) int array, (p, k) array
        Nodes of each point's facet, and their shape functions there.
    facets : (nf, p) csc matrix
        Whether each facet has each point.
    """
    n, used, sharp = len(surface.points), np.unique(surface.facets), np.intersect1d(surface.sharp, surface.facets)
    weighted = beside_edges(hats, facets, area, sharp) if len(sharp) else hats
    of_rows = np.asarray(weighted.sum(axis=1)).ravel()
    mean = sp.diags(_inverse(of_rows), format="csr") @ weighted
    at_node = sp.csr_matrix((np.ones(len(sharp)), (sharp, np.arange(len(sharp)))), shape=(n, len(sharp)))
    facet, column = _places_of(surface.facets, sharp)
    at_edges = hats[sharp]
    # A facet all of whose nodes are at edges has no other rows: its area belongs to them.
    carried = np.asarray(weighted.sum(axis=0)).ravel() > 0
    of_rows[sharp] = at_edges @ (~carried)
    # Forces make a pressure at the points; its mean over each hat is the result. Those at edges act on their own hats,
    # on facets that belong to them, if there are some.
    alone = (of_rows[sharp] > 0).astype(float)
    on_hats = sp.diags(1 - alone) @ at_edges + sp.diags(alone) @ at_edges @ sp.diags((~carried).astype(float))
    pressing = sp.csr_matrix(weighted + sp.csr_matrix(at_node @ on_hats))
    to_pressure = sp.diags(1 / area) @ pressing.T @ sp.diags(_inverse(np.asarray(pressing.sum(axis=1)).ravel()))
    pressures = sp.diags(_inverse(np.asarray(hats.sum(axis=1)).ravel())) @ hats @ to_pressure
    nodes, weights = carriers
    return ContactPoints(
        nodes=np.vstack([nodes[carried], surface.facets[facet]]),
        weights=np.vstack([weights[carried], np.eye(nodes.shape[1])[column]]),
        mean=sp.csr_matrix(sp.hstack([mean[:, carried], at_node]))[used],
        row_nodes=used,
        area=of_rows[used],
        pressures=sp.csr_matrix(pressures),
    )


def _inverse(values: Array) -> Array:
    """Inverses, and zeros of zeros."""
    return np.divide(1.0, values, out=np.zeros(len(values)), where=values > 0)


def _places_of(facets: Array, nodes: Array) -> tuple[Array, Array]:
    """A facet of each of some nodes, (k,), and its column there."""
    facet, column = np.nonzero(np.isin(facets, nodes))
    _, first = np.unique(facets[facet, column], return_index=True)
    return facet[first], column[first]


def corner_hats(surface: Surface) -> sp.csr_matrix:
    """Hat functions of the corners at all nodes, (np, np): one at the corner, linear along edges of its facets."""
    n = len(surface.points)
    hats = sp.lil_matrix((n, n))
    for facets in whole_facets(surface.facets):
        for node, of_corners in enumerate(linear_shares(facets.shape[1])):
            for corner in np.flatnonzero(of_corners):
                hats[facets[:, corner], facets[:, node]] = of_corners[corner]
    return sp.csr_matrix(hats)


def coarser_hats(surface: Surface) -> tuple[sp.csr_matrix, float]:
    """Hat functions on a coarser grid of the same facets, at all nodes, (k, np), and its spacing by that of the nodes.

    That of the corners for quadratic facets, that of corners and middles of edges for cubic ones. Facets with nodes at
    their corners alone have none coarser.
    """
    facets, n = surface.facets, len(surface.points)
    if facets.shape[1] != 10:
        return corner_hats(surface), {6: 2.0, 8: 2.0, 13: 2.0}.get(facets.shape[1], 1.0)
    edges = np.sort(facets[:, [(0, 1), (1, 2), (2, 0)]], axis=2)
    number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 3)
    hats = sp.lil_matrix((n + number.max() + 1, n))
    coarse = np.hstack([facets[:, :3], n + number])
    for node, shares in enumerate(half_hats(FACET_NODES[10])):
        for k in np.flatnonzero(shares):
            hats[coarse[:, k], facets[:, node]] = shares[k]
    return sp.csr_matrix(hats), 1.5
