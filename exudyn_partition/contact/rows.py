"""Gap rows of a contact pair: g = g0 + G_s u_s + G_m u_m (paper, eq. 19-27), node-to-segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .._checks import read_only
from ..errors import EmptyRegionError, PenetrationError
from ..fem import facet_corners
from ..partition import Partition
from .surface import closest_points

Array = np.ndarray

_EDGE_TOLERANCE = 0.02  # of a facet's size: how far a node may look past the patch's edge and still be paired
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
    """

    points: Array
    facets: Array
    direction: Array

    @classmethod
    def of(cls, points: Array, partition: Partition, position: Array) -> Surface:
        """Contact patch of `partition` with its body's `points`, (n, 3), shifted by `position`, (3,) [m]."""
        nodes = partition.patch_nodes
        return cls(points[nodes] + position, np.searchsorted(nodes, partition.facets), partition.direction)

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
    """

    slave: Array
    master: Array
    weights: Array
    normal: Array
    gap: Array
    at_edge: Array
    facet_size: float
    unpaired: int

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


def node_to_segment(slave: Surface, master: Surface) -> ContactRows:
    """Pair every slave node with the closest point of the master patch in the reference configuration.

    Raises
    ------
    EmptyRegionError
        If no slave node faces a master facet.
    PenetrationError
        If a pair overlaps.
    """
    projection = closest_points(slave.points, master.points[master.facets])
    size = master.facet_size
    facing = projection.normal @ slave.direction < -0.5
    paired = (projection.offset <= _EDGE_TOLERANCE * size) & facing
    if not paired.any():
        raise EmptyRegionError(
            f"none of the {len(slave.points)} slave nodes faces a facet of the master patch: their centres are "
            f"{slave.points.mean(axis=0)} and {master.points.mean(axis=0)} m, their outward normals "
            f"{slave.direction} and {master.direction}. Check referencePosition and the centers of the partitions"
        )
    gap = projection.gap[paired]
    if gap.min() < -_PENETRATION_TOLERANCE * size:
        worst = np.flatnonzero(paired)[gap.argmin()]
        raise PenetrationError(
            f"{np.count_nonzero(gap < 0)} of {len(gap)} contact nodes start inside the other body, the worst by "
            f"{-gap.min():.4g} m at {slave.points[worst]} m. Move one body by at least that along its normal "
            "(referencePosition)"
        )
    nodes = np.flatnonzero(paired)
    edge = np.isin(nodes, _boundary_nodes(slave.facets)) | (~paired).any() & _near_unpaired(slave.facets, paired)[nodes]
    return ContactRows(
        slave=nodes,
        master=master.facets[projection.facet[paired]],
        weights=projection.weights[paired],
        normal=projection.normal[paired],
        gap=gap,
        at_edge=edge,
        facet_size=size,
        unpaired=int(np.count_nonzero(~paired)),
    )


def _boundary_nodes(facets: Array) -> Array:
    """Nodes on the rim of a patch: on edges that belong to one facet only."""
    corners = facet_corners(facets)
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).transpose(1, 0, 2).reshape(-1, 2)
    middle = facets[:, 3:].T.ravel() if facets.shape[1] == 6 else np.full(len(edges), -1)
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    rim = first[counts == 1]
    nodes = np.r_[edges[rim].ravel(), middle[rim]]
    return np.unique(nodes[nodes >= 0])


def _near_unpaired(facets: Array, paired: Array) -> Array:
    """Mark nodes that share a facet with a node that has no pair."""
    touched = np.unique(facets[(~paired)[facets].any(axis=1)])
    mark = np.zeros(len(paired), dtype=bool)
    mark[touched] = True
    return mark
