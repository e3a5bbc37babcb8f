"""Which parts of two patches are near each other, and their pairs at the start, where contact wanders over a patch.

A patch that contact wanders over may have thousands of nodes, of which a few dozen touch. Trees of nodes find the parts
that may touch soon; only these are projected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import EmptyRegionError, PenetrationError
from ..fe.facets import area_vectors, facet_corners
from ..support.arrays import Array
from .facing import LOCALLY, PENETRATION_TOLERANCE, closest_met, facing
from .points import ContactPoints, RowKind, contact_points
from .rows import TOUCHING, ContactRows, rows_of
from .surface import Surface

_OPPOSITE = math.cos(math.radians(30))  # between normals and the line across a gap
NODE_TO_FACET = 0.6  # of a facet's longest edge: no point of it is further from the nearest node
_START = 2.0  # facets around the nearest nodes that are projected at the start
_APPROACHES = 10  # most projections until patches touch
LIMIT = 0.75  # of a facet's size: rows with larger gaps are no pairs


def near_patches(
    surfaces: Sequence[Surface], owners: Sequence[int], within: float | None = None
) -> list[tuple[int, int]]:
    """Numbers of patches that face each other across a small distance, and belong to different bodies.

    Parameters
    ----------
    surfaces : sequence of Surface
    owners : sequence of int
        Number of each patch's body.
    within : float, optional
        Distance [m]. Default: the radius of the smaller patch, from its centre to its farthest node.
    """
    centres = np.array([surface.points.mean(axis=0) for surface in surfaces])
    radii = [float(np.linalg.norm(s.points - c, axis=1).max()) for s, c in zip(surfaces, centres, strict=True)]
    far = 2 * max(radii) + (max(radii) if within is None else within)
    found = []
    for i, j in sorted(cKDTree(centres).query_pairs(far)):
        one, other = surfaces[i], surfaces[j]
        reach = min(radii[i], radii[j]) if within is None else within
        apart = float(np.linalg.norm(centres[i] - centres[j])) - radii[i] - radii[j]
        if owners[i] == owners[j] or apart > reach:
            continue
        distance, nearest = cKDTree(other.points).query(one.points)
        k = int(distance.argmin())
        if distance[k] <= reach + NODE_TO_FACET * max(one.longest, other.longest):
            normal, opposite = (s.normals_at(np.array([[node]]), np.ones((1, 1)))[0] for s, node in (
                (one, k), (other, nearest[k]),
            ))  # fmt: skip
            if normal @ opposite < -LOCALLY:
                found.append((i, j))
    return found


def faces_near(surface: Surface, gap: Array, normals: Array, within: float | None, *, anywhere: bool) -> bool:
    """Whether a patch faces a rigid surface across a small distance.

    Parameters
    ----------
    surface : Surface
    gap, normals : (np,), (np, 3) arrays
        Gaps of its nodes [m], and normals of the rigid surface there.
    within : float, optional
        Distance [m]. Default: the radius of the patch, from its centre to its farthest node.
    anywhere : bool
        Whether it need not face the surface now, for it turns.
    """
    nearest = int(gap.argmin())
    reach = float(np.linalg.norm(surface.points - surface.points.mean(axis=0), axis=1).max())
    if gap[nearest] > (reach if within is None else within):
        return False
    normal = surface.normals_at(np.array([[nearest]]), np.ones((1, 1)))[0]
    return anywhere or bool(normal @ normals[nearest] < -LOCALLY)


def edge_meets(one: Surface, other: Surface) -> bool:
    """Whether a sharp edge or corner of one patch is where both are nearest to each other, opposite another face."""
    if not len(one.sharp):
        return False
    least, size = np.inf, one.facet_size
    for surface, opposite in ((other, one), (one, other)):  # the last ones are those of the first patch
        near = NearParts.of(surface, opposite)
        normals = surface.normals_at(near.nodes[:, None], np.ones((len(near.nodes), 1)))
        part = replace(opposite, facets=opposite.facets[near.master_facets])
        found = closest_met(surface.points[near.nodes], normals, part)
        met = facing(found, normals, opposite.facet_size)
        least = min(least, float(found.gap[met].min(initial=np.inf)))
    met &= found.gap <= least + TOUCHING * size
    return bool(np.isin(near.nodes[met], one.sharp).any())


def opposite_parts(surface: Surface) -> tuple[Surface, Surface]:
    """The two parts of a patch that folds which face each other across its narrowest gap.

    Their normals are within 30 degrees of the line across that gap, so that each facet of one faces those of the other.

    Raises
    ------
    EmptyRegionError
        If no facet of the patch faces another one.
    """
    centres = surface.points[facet_corners(surface.facets)].mean(axis=1)
    normals = area_vectors(surface.points, surface.facets)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    narrowest, line, faces = np.inf, np.zeros(3), np.zeros(len(centres), dtype=bool)
    for i, (centre, normal) in enumerate(zip(centres, normals, strict=True)):
        way = centres - centre
        ahead = way @ normal
        met = (normals @ normal < -_OPPOSITE) & (ahead > 0)
        met[met] = np.linalg.norm(way[met] - np.outer(ahead[met], normal), axis=1) <= surface.facet_size
        faces[i] = met.any()
        if faces[i] and ahead[met].min() < narrowest:
            narrowest, line = float(ahead[met].min()), normal
    if not faces.any():
        raise EmptyRegionError(
            "slavePatch, masterPatch: a patch that touches itself has to fold, so that some of its facets face others "
            "across a gap; no facet of this one does. Name two patches, or choose more faces for Partition.surface"
        )
    one, other = (_part(surface, sign * normals @ line > _OPPOSITE, faces) for sign in (1, -1))
    return one, other


def _part(surface: Surface, chosen: Array, faces: Array) -> Surface:
    """The facets of a choice, (nf,) bool, that hang together with some that face others; the rim is the part's."""
    number = np.flatnonzero(chosen)
    neighbours = surface.neighbours[0][number]
    i, edge = np.nonzero((neighbours >= 0) & chosen[neighbours])
    beside = np.searchsorted(number, neighbours[i, edge])
    graph = sp.csr_matrix((np.ones(len(i)), (i, beside)), shape=(len(number),) * 2)
    _, piece = connected_components(graph, directed=False)
    own = np.isin(piece, piece[faces[number]])
    facets, others = surface.facets[number[own]], np.delete(surface.facets, number[own], axis=0)
    rim = np.intersect1d(facets, np.union1d(others, surface.rim))
    return replace(surface, facets=facets, rim=rim)


@dataclass(frozen=True, eq=False)
class NearParts:
    """Parts of two patches that are near each other.

    Parameters
    ----------
    nodes : (k,) int array
        Nodes of the slave's patch, as rows of its points.
    slave_facets, master_facets : (k,) int arrays
        Facets around them, and those of the master that they may touch.
    least : float
        Lower bound of the distance between the patches [m].
    """

    nodes: Array
    slave_facets: Array
    master_facets: Array
    least: float

    @classmethod
    def of(cls, slave: Surface, master: Surface, within: float | None = None) -> NearParts:
        """Parts within a distance [m] of each other; by default, those around the nearest nodes.

        `slave` and `master` are the patches in their present places, with all their facets.
        """
        apart = NODE_TO_FACET * (slave.longest + master.longest)
        own, others = np.unique(slave.facets), np.unique(master.facets)  # both may be parts of one patch
        distance = np.full(len(slave.points), np.inf)
        distance[own] = cKDTree(master.points[others]).query(slave.points[own])[0]
        nearest = float(distance.min())
        reach = nearest + _START * master.facet_size + apart if within is None else within + apart
        nodes = np.flatnonzero(distance <= reach)
        slave_facets = master_facets = np.empty(0, dtype=np.int64)
        if len(nodes):
            back, _ = cKDTree(slave.points[nodes]).query(master.points, distance_upper_bound=reach)
            slave_facets = np.flatnonzero(np.isin(slave.facets, nodes).any(axis=1))
            master_facets = np.flatnonzero(np.isfinite(back)[master.facets].any(axis=1))
        return cls(nodes, slave_facets, master_facets, max(nearest - apart, 0.0))

    def points(self, points: ContactPoints) -> ContactPoints:
        """Contact points of the slave's part."""
        return points.of_rows(np.isin(points.row_nodes, self.nodes))[0]


def near_rows(
    points: ContactPoints, slave: Surface, master: Surface, approach: Array, way: float = 0.0
) -> tuple[ContactRows, float]:
    """Pairs of the rows with gaps below the size of a facet, and the least distance [m].

    Parameters
    ----------
    points : ContactPoints
        Of the slave's part.
    slave, master : Surface
        The parts that are near each other.
    approach : (3,) array
        Where the slave is moved to, for the result.
    way : float
        How far it was moved from where it is; gaps are those before [m].
    """
    size = master.facet_size
    normals = slave.normals_at(points.nodes, points.weights)
    found = closest_met(points.at(slave.points), normals, master)
    paired = facing(found, normals, size)
    least = found.gap[paired].min(initial=np.hypot(found.gap, found.offset).min())
    # A row is a pair if its mean gap is small; points that face nothing count as far away.
    gaps = points.mean @ np.where(paired, found.gap, LIMIT * size)
    some, index = points.of_rows(np.flatnonzero(gaps < LIMIT * size))
    found = found.part(index)
    if way:
        found = replace(found, gap=found.gap - way * (found.normal @ approach))
    return rows_of(some, found, paired[index], slave, master, approach), float(least)


def pair_as_placed(
    points: ContactPoints, slave: Surface, master: Surface, placed_by: str = "referencePosition"
) -> ContactRows:
    """Pair what is near of two patches where they are; there are no pairs if they are far apart, or do not face.

    Parameters
    ----------
    points : ContactPoints
        All points of the slave.
    slave, master : Surface
    placed_by : str
        What a user changes to move a body, for messages.

    Raises
    ------
    PenetrationError
        If a pair overlaps.
    """
    way = master.points.mean(axis=0) - slave.points.mean(axis=0)
    approach = way / length if (length := np.linalg.norm(way)) else slave.direction
    near = NearParts.of(slave, master, (LIMIT + 1.0) * master.facet_size)
    if not len(near.nodes):
        return _no_rows(points, master, approach)
    part = replace(slave, facets=slave.facets[near.slave_facets])
    other = replace(master, facets=master.facets[near.master_facets])
    rows = near_rows(near.points(points), part, other, approach)[0]
    worst = int(rows.gap.argmin()) if len(rows) else 0
    if len(rows) and rows.gap[worst] < -PENETRATION_TOLERANCE * master.facet_size:
        raise PenetrationError(
            f"{np.count_nonzero(rows.gap < 0)} of {len(rows)} rows start inside the other body, the worst by "
            f"{-rows.gap[worst]:.4g} m at {slave.points[rows.points.row_nodes[worst]]} m. Move one of the bodies by at "
            f"least that along {rows.normal[worst].round(3)} ({placed_by})"
        )
    return rows


def _no_rows(points: ContactPoints, master: Surface, approach: Array) -> ContactRows:
    some, index = points.of_rows(np.empty(0, dtype=np.int64))
    k = master.facets.shape[1]
    return ContactRows(
        points=some,
        facet=index,
        local=np.empty((0, 2)),
        master=np.empty((0, k), dtype=master.facets.dtype),
        weights=np.empty((0, k)),
        normals=np.empty((0, 3)),
        gap=np.empty(0),
        leaves_at=np.empty(0),
        facet_size=master.facet_size,
        unpaired=len(points.nodes),
        approach=approach,
    )


def pair_wandering(
    slave: Surface,
    master: Surface,
    rows: RowKind = "integrated",
    placed_by: str = "referencePosition",
    *,
    pressed: bool = False,
) -> ContactRows:
    """Pair what is nearest of two patches, of which contact wanders over one at least.

    The slave is moved against the master's normal at the nearest point until it touches; see `rows.pair_surfaces`.

    Raises
    ------
    EmptyRegionError
        If the parts of the patches that are nearest do not face each other.
    PenetrationError
        If a pair overlaps, unless `pressed`: then pairs are found where the slave is.
    """
    everything, size = contact_points(slave, rows), master.facet_size
    approach, way = np.zeros(3), 0.0
    for attempt in range(_APPROACHES):
        moved = replace(slave, points=slave.points + way * approach)
        near = NearParts.of(moved, master)
        part = replace(moved, facets=moved.facets[near.slave_facets])
        other = replace(master, facets=master.facets[near.master_facets])
        points = near.points(everything)
        places = points.at(part.points)
        normals = part.normals_at(points.nodes, points.weights)
        found = closest_met(places, normals, other)
        paired = facing(found, normals, size)
        if rows == "edges" and not paired.any():  # they may meet a face later
            return near_rows(points, part, other, -found.normal[found.gap.argmin()])[0]
        if not paired.any():
            raise EmptyRegionError(
                f"the patches are nearest around {places.mean(axis=0)} m, but do not face each other there: a patch "
                f"ends, or an edge is in between. Choose more faces for Partition.surface, or check {placed_by}"
            )
        nearest = np.flatnonzero(paired)[found.gap[paired].argmin()]
        clearance = float(found.gap[nearest])
        if attempt == 0:
            approach = -found.normal[nearest]
            if pressed and clearance < -PENETRATION_TOLERANCE * size:
                return near_rows(points, part, other, approach)[0]
            if clearance < -PENETRATION_TOLERANCE * size:
                raise PenetrationError(
                    f"{np.count_nonzero(found.gap[paired] < 0)} of {len(places)} contact points start inside the other "
                    f"body, the worst by {-clearance:.4g} m at {places[nearest]} m. Move the slave by at least that "
                    f"along {found.normal[nearest].round(3)}, or the master the other way ({placed_by})"
                )
        if abs(clearance) <= TOUCHING * size:
            return near_rows(points, part, other, approach, way)[0]
        way += clearance
    raise EmptyRegionError(
        f"the patches do not come together along {approach}: after {_APPROACHES} projections {clearance:.3g} m are "
        f"left. Place the bodies nearer to each other ({placed_by})"
    )
