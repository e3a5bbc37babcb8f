"""Points of a slave's patch that are kept out of the master, and the rows that they make.

Node-to-segment (paper, section 3) takes the patch's nodes, a row each. On quadratic facets that is poor: a vertex
carries no share of a uniform pressure, so nodal forces are ragged.
Integrated rows take the gap's mean over the patch, weighted by the hat functions of the facets' corners, and its
Kuhn-Tucker conditions hold for each hat: linear multipliers on linear or quadratic displacements (Puso, Laursen and
Solberg 2008), integrated on the slave's facets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from .._checks import validate_choice
from ..errors import MeshError
from .surface import Array, Surface, shape_functions

ROWS = ("node-to-segment", "integrated")

# Symmetric rule of degree 4 on the triangle (Dunavant 1985): barycentric coordinate of two points' orbit, weight.
_ORBITS = ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322))


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Points of a patch, p of them, and nr rows, each the mean of some points' gaps.

    Parameters
    ----------
    nodes : (p, k) int array
        Patch nodes that carry each point.
    weights : (p, k) array
        Their shape functions.
    mean : (nr, p) csr matrix
        Weights of the points in each row; their sum is one.
    row_nodes : (nr,) int array
        Patch node that each row belongs to.
    area : (nr,) array
        Area that each row stands for [m2]; their sum is the patch's.
    pressures : (np, np) csr matrix
        Pressure around each of the facets' corners, by the forces of the rows of all patch nodes [1/m2]: means weighted
        with the corners' hat functions, for single nodal forces of quadratic facets are ragged.
    facets : (nf, p) csr matrix
        Which points belong to which facet.
    """

    nodes: Array
    weights: Array
    mean: sp.csr_matrix
    row_nodes: Array
    area: Array
    pressures: sp.csr_matrix
    facets: sp.csr_matrix

    @property
    def nodal(self) -> bool:
        """Whether each row is one point."""
        return self.mean.shape[0] == self.mean.shape[1]

    def at(self, points: Array) -> Array:
        """Positions, (p, 3), by those of the patch's nodes, (np, 3) [m]."""
        if self.nodes.shape[1] == 1:
            return points[self.nodes[:, 0]]
        return np.einsum("pk,pkd->pd", self.weights, points[self.nodes])

    def restricted(self, points: Array) -> ContactPoints:
        """Take a mask of points; rows are the means of those, and end where none is left."""
        mean = sp.csr_matrix(self.mean[:, points])
        share = np.asarray(mean.sum(axis=1)).ravel()
        kept = np.flatnonzero(share > _LEAST_SHARE)
        scale = sp.diags(1 / share[kept])
        return replace(
            self,
            nodes=self.nodes[points],
            weights=self.weights[points],
            mean=sp.csr_matrix(scale @ mean[kept]),
            row_nodes=self.row_nodes[kept],
            area=self.area[kept] * share[kept],
            facets=self.facets[:, points],
        )


_NO_AREA = 1e-9  # of a mean edge's square
_LEAST_SHARE = 1e-3  # of a row's area: what a row needs at least


def contact_points(surface: Surface, rows: str) -> ContactPoints:
    """Contact points of a slave's patch.

    Parameters
    ----------
    surface : Surface
    rows : {"node-to-segment", "integrated"}

    Raises
    ------
    MeshError
        If a facet has no area.
    """
    validate_choice("rows", rows, ROWS)
    n_corners = 4 if surface.facets.shape[1] == 4 else 3
    local, weight = _square_rule() if n_corners == 4 else _triangle_rule()
    shape = shape_functions(local, surface.facets.shape[1])
    hats = shape_functions(local, n_corners)[:, 0]
    tangents = np.einsum("qin,fnd->ifqd", shape[:, 1:], surface.points[surface.facets])
    area = weight * np.linalg.norm(np.cross(*tangents), axis=2)  # (nf, nq)
    nf, nq = area.shape
    flat = np.flatnonzero(area.sum(axis=1) <= _NO_AREA * surface.facet_size**2)
    if len(flat):
        where = surface.points[surface.facets[flat[0], :n_corners]].mean(axis=0)
        raise MeshError(
            f"{len(flat)} of {nf} facets of the contact patch have no area, such as the one at {where} m: their nodes "
            "lie on a line or in a point. Repair or refine the mesh there"
        )
    corners = surface.facets[:, :n_corners]
    share = area[:, :, None] * hats  # (nf, nq, n_corners)
    n = len(surface.points)
    hat_area = np.bincount(corners.ravel(), share.sum(axis=1).ravel(), minlength=n)
    inverse = sp.diags(np.divide(1.0, hat_area, out=np.zeros(n), where=hat_area > 0))
    if rows == "integrated":
        row_nodes, row = np.unique(corners, return_inverse=True)
        row = row.reshape(corners.shape)
        point = np.arange(nf * nq).reshape(nf, nq)
        where = np.broadcast_arrays(row[:, None, :], point[:, :, None])
        mean = sp.csr_matrix((share.ravel(), [x.ravel() for x in where]), shape=(len(row_nodes), nf * nq))
        row_area = np.asarray(mean.sum(axis=1)).ravel()
        return ContactPoints(
            nodes=np.repeat(surface.facets, nq, axis=0),
            weights=np.tile(shape[:, 0], (nf, 1)),
            mean=sp.csr_matrix(sp.diags(1 / row_area) @ mean),
            row_nodes=row_nodes,
            area=row_area,
            pressures=sp.csr_matrix(inverse),
            facets=sp.kron(sp.identity(nf), np.ones((1, nq)), format="csr"),
        )
    facet_area = area.sum(axis=1)
    where = np.repeat(np.arange(nf), surface.facets.shape[1]), surface.facets.ravel()
    return ContactPoints(
        nodes=np.arange(n)[:, None],
        weights=np.ones((n, 1)),
        mean=sp.identity(n, format="csr"),
        row_nodes=np.arange(n),
        area=np.bincount(surface.facets.ravel(), np.outer(facet_area, _nodal_shares(surface)).ravel(), minlength=n),
        pressures=sp.csr_matrix(inverse @ _corner_hats(surface)),
        facets=sp.csr_matrix((np.ones(surface.facets.size), where), shape=(nf, n)),
    )


def _nodal_shares(surface: Surface) -> Array:
    """Share of each node in a uniform pressure on a facet: on a quadratic one, corners have none."""
    return {
        3: np.full(3, 1 / 3),
        4: np.full(4, 1 / 4),
        6: np.r_[np.zeros(3), np.full(3, 1 / 3)],
    }[surface.facets.shape[1]]


def _corner_hats(surface: Surface) -> sp.csr_matrix:
    """Values of the corners' hat functions at all nodes, (np, np): one at the corner, a half at its mid-side nodes."""
    n, facets = len(surface.points), surface.facets
    hats = sp.lil_matrix((n, n))
    corners = np.unique(facets[:, :4] if facets.shape[1] == 4 else facets[:, :3])
    hats[corners, corners] = 1.0
    for ends, middle in zip(((0, 1), (1, 2), (2, 0)), facets[:, 3:].T if facets.shape[1] == 6 else (), strict=False):
        for end in ends:
            hats[facets[:, end], middle] = 0.5
    return sp.csr_matrix(hats)


def _triangle_rule() -> tuple[Array, Array]:
    local, weight = [], []
    for a, w in _ORBITS:
        local += [(a, a), (1 - 2 * a, a), (a, 1 - 2 * a)]
        weight += [w / 2] * 3
    return np.array(local), np.array(weight)


def _square_rule() -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(3)
    x, w = (x + 1) / 2, w / 2
    return np.stack(np.meshgrid(x, x), axis=2).reshape(-1, 2), np.outer(w, w).ravel()
