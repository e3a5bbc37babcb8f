"""Press fits: the slave's surface is moved so that each row overlaps by the same length before load steps close it.

Facets of curved surfaces lie beside the true surface, by more than a common interference. So patches that are drawn on
each other have gaps and overlaps between them. Here the nodes of the slave are moved along their normals until each row
has the overlap that is meant; the mean of the moved surface is then where the true one is.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ..errors import InputError, PenetrationError
from ..fe.facets import facet_corners
from ..surfaces.facing import PENETRATION_TOLERANCE
from ..surfaces.rows import directed_matrix
from ..surfaces.surface import Surface
from .gaps import Gaps
from .side import Side

_FAR = 0.5  # of a facet's size: longest way of the surface
_HIGHER_ORDER = 0.1  # of the sagitta of flat facets: what remains of it with curved ones
_SOLVED = 1e-10  # relative residual of the ways


def fitted(gaps: Gaps, overlap: float) -> Side:
    """The slave with its surface moved so that each row overlaps by a length [m].

    `gaps` are those between the sides as they are placed.

    Raises
    ------
    PenetrationError
        If the sides are placed deeper within each other.
    InputError
        If they are placed far apart, or if their surfaces do not lie on each other.
    """
    points, normals, gap = gaps.placed_rows()
    side, size, middle = gaps.slave, gaps.size, float(np.median(gap))
    uneven = float(abs(gap - middle).max())
    by_facets = PENETRATION_TOLERANCE * size + sum(_sagitta(any_side.surface) for any_side in gaps.sides)
    if middle < -overlap - by_facets:
        raise PenetrationError(
            f"interference: the patches overlap by {-middle:.4g} m as they are placed, more than the {overlap:.4g} m "
            "that are meant. Check places and units, or give interference='placed'"
        )
    if overlap + middle > _FAR * size:
        raise InputError(
            f"interference: to overlap by {overlap:.4g} m, the patches, whose gap is {middle:.4g} m as placed, "
            f"have to come nearer by more than {_FAR:g} of a facet's size, {size:.3g} m. Place the bodies so that they "
            "touch, or check units"
        )
    if uneven > by_facets:
        raise InputError(
            f"interference: expected surfaces that lie on each other, got gaps that differ by {uneven:.3g} m from "
            f"{middle:.3g} m, more than facets explain ({by_facets:.2g} m). Place the bodies so that the surfaces "
            "coincide. For other shapes, draw the overlap, and give interference='placed'"
        )
    outward = side.outward
    n = len(outward)
    by_nodes = points.mean @ directed_matrix(points.nodes, points.weights, normals, n)
    along = (
        by_nodes @ sp.csr_matrix((outward.ravel(), np.arange(3 * n), np.arange(0, 3 * n + 1, 3)), shape=(n, 3 * n)).T
    )
    ways = np.full(n, overlap + middle)
    missing = -overlap - gap - along @ ways
    ways += scipy.sparse.linalg.lsqr(along, missing, atol=_SOLVED, btol=_SOLVED)[0]
    return side.grown(ways)


def _sagitta(surface: Surface) -> float:
    """How far facets may lie beside the smooth surface through their corners [m]."""
    corners = facet_corners(surface.facets)
    normals = surface.normals_at(np.arange(len(surface.points))[:, None], np.ones((len(surface.points), 1)))
    x, n = surface.points[corners], normals[corners]
    turned = np.einsum("fed,fed->fe", np.roll(x, -1, axis=1) - x, np.roll(n, -1, axis=1) - n)
    flat = float(abs(turned).max()) / 8
    return flat if corners.shape == surface.facets.shape else _HIGHER_ORDER * flat
