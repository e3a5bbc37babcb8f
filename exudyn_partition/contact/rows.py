"""Gap rows of a contact pair: g = g0 + G_s u_s + G_m u_m (paper, eq. 19-27), node-to-segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .._checks import read_only
from ..errors import EmptyRegionError, PenetrationError
from ..fem import area_vectors, facet_corners
from ..partition import Patch
from .surface import closest_points

Array = np.ndarray

_EDGE_TOLERANCE = 0.02  # of a facet's size: how far a node may look past the patch's edge and still be paired
_FACING = 0.9  # cosine between the slave's line of contact and the master's normal, below which nodes do not meet
_TOUCHING = 1e-3  # of a facet's size: as close as patches are brought before pairing
_APPROACHES = 10  # projections at most to get there
_PENETRATION_TOLERANCE = 1e-4  # of a facet's size: round-off and the faceting of curved surfaces


@dataclass(frozen=True, eq=False)
class Surface:
    """A contact patch in place: node positions, facets and the line of contact.

    Parameters
    ----------
    points : (np, 3) array
        Positions of the patch's nodes [m].
    facets : (nf, 3), (nf, 6) or (nf, 4) int array
        Facets as rows of `points`, outward.
    direction : (3,) array
        Outward unit vector, the patch's line of contact.
    rim : (k,) int array
        Rows of `points` beyond which the body's surface goes on.
    direction_given : bool
        Whether the user gave `direction`; else it is the mesh's.
    """

    points: Array
    facets: Array
    direction: Array
    rim: Array
    direction_given: bool = False

    @classmethod
    def of(cls, points: Array, patch: Patch, position: Array) -> Surface:
        """Contact patch with its body's `points`, (n, 3), shifted by `position`, (3,) [m]."""
        nodes = patch.nodes
        facets, rim = (np.searchsorted(nodes, part) for part in (patch.facets, patch.rim))
        return cls(points[nodes] + position, facets, patch.direction, rim, patch.direction_given)

    @property
    def flatness(self) -> float:
        """How well `direction` is known: length of the facets' mean unit normal, 1 for a plane; 2 if it was given."""
        if self.direction_given:
            return 2.0
        normals = area_vectors(self.points, self.facets)
        return float(np.linalg.norm(normals.sum(axis=0)) / np.linalg.norm(normals, axis=1).sum())

    @property
    def facet_size(self) -> float:
        """Mean edge length of the facets [m]."""
        corners = self.points[facet_corners(self.facets)]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Frozen node-to-segment pairs of a slave patch and a master patch, nc of them.

    Parameters
    ----------
    slave : (nc,) int array
        Patch node of each row.
    master : (nc, k) int array
        Patch nodes of the facet that it faces.
    weights : (nc, k) array
        Shape functions of that facet at the closest point.
    normal : (nc, 3) array
        Outward unit normal of the master there.
    gap : (nc,) array
        g0, gap in the reference configuration [m].
    at_edge : (nc,) bool array
        Rows whose slave node is at the edge of what can touch: contact that reaches them leaves its patch.
    facet_size : float
        Mean edge length of the master's facets [m]; sliding beyond it needs new pairs.
    unpaired : int
        Slave nodes that face no master facet and therefore have no row.
    approach : (3,) array
        Unit vector along which the slave was brought to the master.
    """

    slave: Array
    master: Array
    weights: Array
    normal: Array
    gap: Array
    at_edge: Array
    facet_size: float
    unpaired: int
    approach: Array

    def __post_init__(self) -> None:
        read_only(self.slave, self.master, self.weights, self.normal, self.gap, self.at_edge)

    def __len__(self) -> int:
        return len(self.gap)

    def matrices(self, n_slave: int, n_master: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """G_s, (nc, 3 n_slave), and G_m, (nc, 3 n_master), on the patches' nodal displacements, xyz interleaved."""
        nc, k = self.master.shape
        xyz = np.arange(3)
        rows = np.repeat(np.arange(nc), 3)
        G_s = sp.csr_matrix(
            (self.normal.ravel(), (rows, (3 * self.slave[:, None] + xyz).ravel())), shape=(nc, 3 * n_slave)
        )
        rows = np.repeat(np.arange(nc), 3 * k)
        values = -self.weights[:, :, None] * self.normal[:, None, :]
        G_m = sp.csr_matrix(
            (values.ravel(), (rows, (3 * self.master[:, :, None] + xyz).ravel())), shape=(nc, 3 * n_master)
        )
        return G_s, G_m

    def interpolation(self, n_slave: int, n_master: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Weights of the patches' nodes in each row, (nc, n_slave) and (nc, n_master), whatever their direction."""
        nc, k = self.master.shape
        rows = np.arange(nc)
        at_slave = sp.csr_matrix((np.ones(nc), (rows, self.slave)), shape=(nc, n_slave))
        where = (np.repeat(rows, k), self.master.ravel())
        return at_slave, sp.csr_matrix((self.weights.ravel(), where), shape=(nc, n_master))


def node_to_segment(slave: Surface, master: Surface) -> ContactRows:
    """Pair every slave node with the point of the master patch that it will meet.

    The slave is first moved along the line of contact, the flatter patch's, until it touches; there each node takes the
    closest point of the master, and the way is given back to the gaps: so pairs are right for bodies that start apart
    and approach along that line.

    Raises
    ------
    EmptyRegionError
        If no slave node faces a master facet.
    PenetrationError
        If a pair overlaps.
    """
    facets, size = master.points[master.facets], master.facet_size
    approach = slave.direction if slave.flatness > master.flatness else -master.direction
    way = 0.0
    for _ in range(_APPROACHES):
        projection = closest_points(slave.points + way * approach, facets)
        facing = projection.normal @ slave.direction < -_FACING
        paired = (projection.offset <= _EDGE_TOLERANCE * size) & facing
        if way == 0.0 and paired.any() and projection.gap[paired].min() < -_PENETRATION_TOLERANCE * size:
            gap = projection.gap[paired]
            worst = np.flatnonzero(paired)[gap.argmin()]
            raise PenetrationError(
                f"{np.count_nonzero(gap < 0)} of {len(gap)} contact nodes start inside the other body, the worst by "
                f"{-gap.min():.4g} m at {slave.points[worst]} m. Move one body by at least that along its normal "
                "(referencePosition)"
            )
        clearance = projection.gap[paired].min(initial=np.inf)
        if not paired.any():  # far apart and aside: let the nearest node decide
            clearance = float(np.hypot(projection.gap, projection.offset).min())
        if abs(clearance) <= _TOUCHING * size:
            break
        way += clearance
    if not paired.any():
        raise EmptyRegionError(
            f"none of the {len(slave.points)} slave nodes faces a facet of the master patch: their centres are "
            f"{slave.points.mean(axis=0)} and {master.points.mean(axis=0)} m, their outward normals "
            f"{slave.direction} and {master.direction}. Check referencePosition and the centers of the partitions"
        )
    if abs(clearance) > _TOUCHING * size:
        raise EmptyRegionError(
            f"the patches do not come together along {approach}: after {_APPROACHES} projections {clearance:.3g} m are "
            "left. Give both partitions a direction, the line along which the bodies meet"
        )
    nodes, facet = np.flatnonzero(paired), projection.facet[paired]
    normal = projection.normal[paired]
    # At the edge are also the neighbours of nodes that look past the rim of the master's patch, where its body goes on,
    # and of nodes that lie on it but face it too much aslant.
    past_rim = np.isin(master.facets[projection.facet], master.rim).any(axis=1)
    lost = ~paired & (past_rim | (projection.offset <= _EDGE_TOLERANCE * size))
    beside = np.unique(slave.facets[lost[slave.facets].any(axis=1)])
    return ContactRows(
        slave=nodes,
        master=master.facets[facet],
        weights=projection.weights[paired],
        normal=normal,
        gap=projection.gap[paired] - way * (normal @ approach),
        at_edge=np.isin(nodes, np.union1d(slave.rim, beside)),
        facet_size=size,
        unpaired=int(np.count_nonzero(~paired)),
        approach=approach,
    )
