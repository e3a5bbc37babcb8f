"""Gap rows of a contact pair: g = g0 + G_s u_s + G_m u_m (paper, eq. 19, 20).

Theory: examples/site/theory.md, "Rows of gaps".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..errors import EmptyRegionError, PenetrationError
from ..fe.facets import facet_corners
from ..support.arrays import Array
from ..support.checks import read_only
from .facing import ALONG_LINE, EDGE_TOLERANCE, PENETRATION_TOLERANCE, closest_met, facing
from .points import ContactPoints, RowKind, contact_points
from .projection import Projection
from .surface import Surface

TOUCHING = 1e-3  # of a facet's size: patches are brought as close as this before pairing
_APPROACHES = 10  # most projections to get there


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Pairs of the slave's contact points with points of the master's patch, and the rows that they make.

    Parameters
    ----------
    points : ContactPoints
        The p points that are paired, and the nr rows.
    facet : (p,) int array
        The master's facet that each point faces.
    local : (p, 2) array
        Closest point in the facet's coordinates.
    master : (p, k) int array
        Patch nodes of that facet.
    weights : (p, k) array
        Shape functions of that facet at the closest point.
    normals : (p, 3) array
        Outward unit normals of the master there.
    gap : (nr,) array
        Gaps of the rows at the places where they were paired [m].
    leaves_at : (nr,) array
        Depth of each row at which contact leaves the patches [m]; infinite but at their edge.
    facet_size : float
        Mean edge length of the master's facets [m].
    unpaired : int
        Number of the slave's points that face no facet of the master.
    approach : (3,) array
        Unit vector along which the slave was moved to the master.
    """

    points: ContactPoints
    facet: Array
    local: Array
    master: Array
    weights: Array
    normals: Array
    gap: Array
    leaves_at: Array
    facet_size: float
    unpaired: int
    approach: Array

    def __post_init__(self) -> None:
        read_only(self.facet, self.local, self.master, self.weights, self.normals, self.gap, self.leaves_at)

    def __len__(self) -> int:
        return len(self.gap)

    @property
    def normal(self) -> Array:
        """(nr, 3) array: mean normal of each row."""
        normal: Array = self.points.mean @ self.normals
        return normal

    def interpolation(self, n_slave: int, n_master: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Weights of the patches' nodes in each row, (nr, n_slave) and (nr, n_master), without directions."""
        at_slave = point_matrix(self.points.nodes, self.points.weights, n_slave)
        at_master = point_matrix(self.master, self.weights, n_master)
        return self.points.mean @ at_slave, self.points.mean @ at_master

    def matrices(self, n_slave: int, n_master: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """G_s, (nr, 3 n_slave), and G_m, (nr, 3 n_master), on the patches' nodal displacements, xyz interleaved."""
        G_s = directed_matrix(self.points.nodes, self.points.weights, self.normals, n_slave)
        G_m = directed_matrix(self.master, self.weights, -self.normals, n_master)
        return self.points.mean @ G_s, self.points.mean @ G_m


def point_matrix(nodes: Array, weights: Array, n_nodes: int) -> sp.csr_matrix:
    """(p, n_nodes) csr matrix of the weights, (p, k), of each point's nodes, (p, k)."""
    p, k = nodes.shape
    return sp.csr_matrix((weights.ravel(), nodes.ravel(), k * np.arange(p + 1)), shape=(p, n_nodes))


def directed_matrix(nodes: Array, weights: Array, directions: Array, n_nodes: int) -> sp.csr_matrix:
    """(p, 3 n_nodes) csr matrix: the weights times each point's direction, (p, 3)."""
    p, k = nodes.shape
    values = weights[:, :, None] * directions[:, None, :]
    columns = 3 * nodes[:, :, None] + np.arange(3)
    return sp.csr_matrix((values.ravel(), columns.ravel(), 3 * k * np.arange(p + 1)), shape=(p, 3 * n_nodes))


def pair_surfaces(
    slave: Surface,
    master: Surface,
    rows: RowKind = "integrated",
    placed_by: str = "referencePosition",
    *,
    pressed: bool = False,
) -> ContactRows:
    """Pair every contact point of the slave with the point of the master's patch that it will touch.

    The slave is first moved along the line of contact, that of the flatter patch, until it touches. There each point is
    paired with the closest point of the master, and the way is added to the gaps. So pairs are right for bodies that
    start apart and approach along that line.

    Parameters
    ----------
    slave, master : Surface
    rows : {"integrated", "node-to-segment"}
        See module `points`.
    placed_by : str
        What a user changes to move a body, for messages.
    pressed : bool
        Whether pairs may overlap. They are then found where the slave is.

    Raises
    ------
    EmptyRegionError
        If no contact point faces a master facet.
    PenetrationError
        If a pair overlaps, unless `pressed`.
    """
    points = contact_points(slave, rows)
    places = points.at(slave.points)
    size = master.facet_size
    approach = slave.direction if slave.flatness > master.flatness else -master.direction
    way = 0.0
    for _ in range(_APPROACHES):
        projection = closest_met(places + way * approach, slave.direction, master)
        paired = facing(projection, slave.direction, size, ALONG_LINE)
        if way == 0.0 and paired.any() and projection.gap[paired].min() < -PENETRATION_TOLERANCE * size:
            if pressed:
                return rows_of(points, projection, paired, slave, master, approach)
            gap = projection.gap[paired]
            worst = np.flatnonzero(paired)[gap.argmin()]
            raise PenetrationError(
                f"{np.count_nonzero(gap < 0)} of {len(gap)} contact points start inside the other body, the worst by "
                f"{-gap.min():.4g} m at {places[worst]} m. Move the slave by at least that along "
                f"{projection.normal[worst].round(3)}, or the master the other way ({placed_by})"
            )
        clearance = projection.gap[paired].min(initial=np.inf)
        if not paired.any():  # far apart and to the side: the nearest point decides
            clearance = float(np.hypot(projection.gap, projection.offset).min())
        if abs(clearance) <= TOUCHING * size:
            break
        way += clearance
    if not paired.any():
        raise EmptyRegionError(
            f"none of the {len(places)} contact points of the slave faces a facet of the master patch. The centres of "
            f"the patches are {slave.points.mean(axis=0)} and {master.points.mean(axis=0)} m, their outward normals "
            f"{slave.direction} and {master.direction}. Check {placed_by} and the centers of the partitions"
        )
    if abs(clearance) > TOUCHING * size:
        raise EmptyRegionError(
            f"the patches do not come together along {approach}: after {_APPROACHES} projections {clearance:.3g} m are "
            "left. Give both partitions a direction: the line along which the bodies meet"
        )
    gap = projection.gap - way * (projection.normal @ approach)
    return rows_of(points, replace(projection, gap=gap), paired, slave, master, approach)


def rows_of(
    points: ContactPoints, projection: Projection, paired: Array, slave: Surface, master: Surface, approach: Array
) -> ContactRows:
    """Rows of the points that are paired (a mask), by their projection on the master."""
    kept, size = points.restricted(paired), master.facet_size
    gap = kept.mean @ projection.gap[paired]
    facet = projection.facet[paired]
    return ContactRows(
        points=kept,
        facet=facet,
        local=projection.local[paired],
        master=master.facets[facet],
        weights=projection.weights[paired],
        normals=projection.normal[paired],
        gap=gap,
        leaves_at=_leaves_at(points, projection, paired, slave, master, (kept.row_nodes, gap)),
        facet_size=size,
        unpaired=int(np.count_nonzero(~paired)),
        approach=approach,
    )


def _leaves_at(
    points: ContactPoints,
    projection: Projection,
    paired: Array,
    slave: Surface,
    master: Surface,
    rows: tuple[Array, Array],
) -> Array:
    """Depth at which contact of each row leaves the patches, (nr,) [m]; `rows` are their nodes and gaps.

    It is zero at the rim of the slave, and infinite within. Rows are also at the edge beside points that project past
    the rim of the master's patch, where its surface continues, and beside points on the patch that face it too
    obliquely. At a sharp edge of either, one side always may: the body ends there, not the patch. Such a point is
    further apart than the row, and touches when the row is deeper than this difference: earlier than in truth, for the
    surfaces yield most where they are deepest.
    """
    facets, within = master.facets[projection.facet], projection.offset <= EDGE_TOLERANCE * master.facet_size
    past_rim, past_edge = (master.has(nodes)[facets].any(axis=1) for nodes in (master.rim, master.sharp))
    gap, beside = projection.gap.copy(), np.flatnonzero(~paired & past_rim & ~within)
    gap[beside] -= _rise(projection, beside, master)
    past = _least_around(points, beside, gap, slave)
    aslant = _least_around(points, np.flatnonzero(~paired & within & ~past_edge), gap, slave)
    aslant[slave.sharp] = np.inf
    nodes, of_rows = rows
    value: Array = np.maximum(np.minimum(past, aslant)[nodes] - of_rows, 0.0)
    value[slave.has(slave.rim)[nodes]] = 0.0
    return value


def _least_around(points: ContactPoints, chosen: Array, gap: Array, slave: Surface) -> Array:
    """Least gap of chosen points, an index, in the facets around each node of the slave's patch, (np,) [m].

    A point is in the facet of its nodes, or at one of them and in all facets around that.
    """
    least = np.full(len(slave.points), np.inf)
    if len(chosen):
        nodes, of_point, at_node = points.nodes[chosen], gap[chosen], points.weights[chosen] == 1.0
        np.minimum.at(least, nodes[at_node], of_point[at_node.any(axis=1)])
        around = least[slave.facets].min(axis=1)
        np.minimum.at(least, slave.facets, around[:, None])
        within = ~at_node.any(axis=1)
        np.minimum.at(least, nodes[within], of_point[within, None])
    return least


def _rise(projection: Projection, beside: Array, master: Surface) -> Array:
    """How far a hollow master may rise above its tangents at the closest points, for points beside it, an index: (k,).

    Its curvature is that of the normals at the facet's corners. At the rim these are means over one side alone, and
    show as little as half of it.
    """
    if not len(beside):
        return np.zeros(0)
    normals = master.normals_at(np.arange(len(master.points))[:, None], np.ones((len(master.points), 1)))
    corners = facet_corners(master.facets[projection.facet[beside]])
    x, n = (values[corners] - values[np.roll(corners, 1, axis=1)] for values in (master.points, normals))
    bend = (np.einsum("kcd,kcd->kc", n, x) / np.einsum("kcd,kcd->kc", x, x)).min(axis=1)
    return np.asarray(np.maximum(-bend, 0.0) * projection.offset[beside] ** 2)
