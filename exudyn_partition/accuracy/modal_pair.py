"""The impact of two reduced bodies, or of one and a rigid surface, in their own coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..contact.rigid import RigidSurface
from ..errors import EmptyRegionError, PenetrationError
from ..fe.model import FEModel, node_dofs
from ..fe.patches import Patch
from ..fe.shapes import FACET_NODES
from ..prediction.modal_impact import Impact
from ..prediction.pair_impact import ImpactSide, impact_between
from ..reduction.body import ReducedBody
from ..reduction.loads import patch_slice
from ..support.arrays import Array
from ..surfaces.facing import PENETRATION_TOLERANCE
from ..surfaces.points import ContactPoints, coarser_hats, contact_points
from ..surfaces.rows import directed_matrix, pair_surfaces, point_matrix
from ..surfaces.surface import Surface

Pair = tuple[FEModel, ReducedBody]


@dataclass(frozen=True, eq=False)
class Side:
    """A body in the impact.

    Parameters
    ----------
    fem : FEModel
    body : ReducedBody
    on_patch : (nr, 3 np) csr matrix
        Rows of the contact on the displacements of the patch's nodes.
    patch : Patch
    corners, local, normals : (p, 3) int array, (p, 2) array, (p, 3) array
        Facets' corner nodes, places in the facets, and directions of the contact points.
    mean : (nr, p) csr matrix
        Weights of the points in each row.
    coarse : (nc, nr) array
        Rows on a coarser grid of the slave's facets, as means of the rows.
    spacing : float
        Of that grid, by that of the rows; 1 if there is none.
    """

    fem: FEModel
    body: ReducedBody
    on_patch: sp.csr_matrix
    patch: Patch
    corners: Array
    local: Array
    normals: Array
    mean: sp.csr_matrix
    coarse: Array
    spacing: float


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of the contact.

    Parameters
    ----------
    gap : (nr,) array
        [m]
    points : ContactPoints
    approach : (3,) array
        Way of the slave to its partner.
    directed, plain : tuple of csr matrices
        Rows on the displacements of each patch, with and without directions.
    places : tuple of (facets' nodes, local places, directions)
        Of the points, on each body.
    """

    gap: Array
    points: ContactPoints
    approach: Array
    directed: Sequence[sp.csr_matrix]
    plain: Sequence[sp.csr_matrix]
    places: Sequence[tuple[Array, Array, Array]]


def impact_of(
    pairs: Sequence[Pair], numbers: Sequence[int], speed: float, rigid: RigidSurface | None = None
) -> tuple[list[Side], Impact]:
    """Sides and their impact, at the place where they touch.

    Parameters
    ----------
    pairs : sequence of (FEModel, ReducedBody)
        Slave and master; the slave alone if there is a rigid surface.
    numbers : sequence of int
        Of their patches.
    speed : float
        [m/s]
    rigid : RigidSurface, optional

    Raises
    ------
    EmptyRegionError, PenetrationError
    """
    surfaces = [
        Surface.of(fem.points, body.partition.patches[i], np.zeros(3))
        for (fem, body), i in zip(pairs, numbers, strict=True)
    ]
    rows = _between(*surfaces) if rigid is None else _to_rigid(surfaces[0], rigid)
    coarser = _coarser(surfaces[0], rows.points)
    sides, moving = [], []
    for (fem, body), i, on_patch, weight, (nodes, local, normals) in zip(
        pairs, numbers, rows.directed, rows.plain, rows.places, strict=True
    ):
        patch, columns = body.partition.patches[i], patch_slice(body.partition, i)
        assert body.basis.flexibility is not None
        flexibility = np.asarray(body.basis.flexibility[columns, columns])
        shapes = body.basis.shapes[node_dofs(patch.nodes)]
        moving.append(ImpactSide(on_patch, weight, shapes, flexibility, body.basis.omega))
        corners = patch.nodes[nodes[:, :3]]
        mean = rows.points.mean
        sides.append(Side(fem, body, on_patch, patch, corners, local, normals, mean, *coarser))
    velocity = pairs[0][1].rigid @ np.r_[speed * rows.approach, np.zeros(3)]
    return sides, impact_between(moving, rows.gap, rows.approach, velocity, surfaces[0].facet_size)


def _coarser(slave: Surface, points: ContactPoints) -> tuple[Array, float]:
    """Rows on a coarser grid as means of the rows, (nc, nr), and its spacing; see `coarser_hats`."""
    grid, spacing = coarser_hats(slave)
    hats: Array = grid[:, points.row_nodes].toarray() * points.area
    hats = hats[hats.any(axis=1)]
    return hats / hats.sum(axis=1)[:, None], spacing


def _between(slave: Surface, master: Surface) -> _Rows:
    contact = pair_surfaces(slave, master, placed_by="the points of its mesh, which are taken as they are")
    sizes = len(slave.points), len(master.points)
    points = contact.points
    return _Rows(
        gap=contact.gap,
        points=points,
        approach=contact.approach,
        directed=contact.matrices(*sizes),
        plain=contact.interpolation(*sizes),
        places=(
            (points.nodes, points.weights @ FACET_NODES[points.nodes.shape[1]], contact.normals),
            (contact.master, contact.local, -contact.normals),
        ),
    )


def _to_rigid(slave: Surface, rigid: RigidSurface) -> _Rows:
    """Rows of a patch before a rigid surface, along the normals where it lies."""
    points = contact_points(slave, "integrated")
    distance, normals = rigid.project(points.at(slave.points))
    gap = points.mean @ distance
    approach = -(points.mean @ normals)[gap.argmin()]
    if approach @ slave.direction <= 0:
        raise EmptyRegionError(
            f"the patch, with outward normal {slave.direction}, faces away from the rigid surface, whose normal there "
            f"is {-approach}. Check the place of the surface and the center of the partition"
        )
    if gap.min() < -PENETRATION_TOLERANCE * slave.facet_size:
        raise PenetrationError(
            f"{np.count_nonzero(gap < 0)} of {len(gap)} contact rows start inside the rigid surface, the worst by "
            f"{-gap.min():.4g} m. Move the surface by at least that"
        )
    n = len(slave.points)
    return _Rows(
        gap=gap,
        points=points,
        approach=approach / np.linalg.norm(approach),
        directed=[points.mean @ directed_matrix(points.nodes, points.weights, normals, n)],
        plain=[points.mean @ point_matrix(points.nodes, points.weights, n)],
        places=[(points.nodes, points.weights @ FACET_NODES[points.nodes.shape[1]], normals)],
    )
