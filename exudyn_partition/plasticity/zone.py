"""The plastic zone of a contact patch: elements that may yield, their strains and pseudo-forces (paper, region II).

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..fe.elements import centres_of, kinds_of
from ..fe.material import Material
from ..fe.model import node_dofs
from ..fe.patches import PlasticRegion
from ..support.arrays import Array
from ..support.attributes import copied
from ..support.checks import read_only
from . import loops
from .flow import Flow, PlasticState
from .integration import at_points, nearest_corners

if TYPE_CHECKING:
    from typing import Self

# Deviatoric strain in Mandel's notation of a displacement gradient: e_v = sum_ab _MANDEL[v, a, b] du_a/dx_b.
_MANDEL = np.zeros((6, 3, 3))
_MANDEL[[0, 1, 2], [0, 1, 2], [0, 1, 2]] = 1.0
_MANDEL[:3] -= np.eye(3) / 3
_MANDEL[[3, 4, 5], [1, 0, 0], [2, 2, 1]] = _MANDEL[[3, 4, 5], [2, 2, 1], [1, 0, 0]] = np.sqrt(0.5)


class PlasticZone:
    """Elements around a contact patch that may yield; everything else of the body stays elastic.

    Plastic strain e_p acts on the elastic body as the nodal forces p = sum of w E' 2 G e_p over the integration points:
    `pseudo_forces`. They are balanced in themselves, so that rigid motion does not feel them.

    Parameters
    ----------
    points : (n, 3) array
        Nodes of the body [m].
    region : PlasticRegion
    material : Material

    Attributes
    ----------
    nodes : (nz,) int array
        Of the body, ascending.
    gradient : (g, k, 3) array
        Of the shape functions of each point's element [1/m].
    own : (g, k) int array
        Nodes of that element, as places in `nodes`.
    weight : (g,) array
        Volume of each integration point [m3].
    flow : Flow
    border : (g,) bool array
        Points whose nearest corner of their element lies at the edge of the zone, beyond which the body goes on.
    spacing : (g,) array
        Mean distance of neighbouring nodes along the edges of each point's element [m].
    """

    def __init__(self, points: Array, region: PlasticRegion, material: Material) -> None:
        self.nodes, in_zone = np.unique(region.cells, return_inverse=True)
        in_zone = in_zone.reshape(region.cells.shape)
        self.flow = Flow(material)
        gradient, volume = at_points(points, region.cells, region.hexahedra)
        q, k = gradient.shape[1:3]
        self.weight = volume.ravel()
        self.gradient, self.own = gradient.reshape(-1, k, 3), np.repeat(in_zone, q, axis=0)
        self.border = _at_border(region).ravel()
        self._places = np.repeat(centres_of(points, region.cells, region.hexahedra), q, axis=0)
        self._edge = points[region.border]
        read_only(self._places, self._edge)
        self.spacing = np.repeat(_spacings(points, region), q)

    @cached_property
    def strain(self) -> sp.csr_matrix:
        """E, (6 g, 3 nz): deviatoric strains at the points in Mandel's notation, by displacements of the nodes."""
        values = np.einsum("vab,pkb->pvka", _MANDEL, self.gradient).ravel()
        columns = np.repeat(node_dofs(self.own.ravel()).reshape(len(self), 3 * self.own.shape[1]), 6, axis=0)
        starts = columns.shape[1] * np.arange(6 * len(self) + 1)
        return sp.csr_matrix((values, columns.ravel(), starts), shape=(6 * len(self), 3 * len(self.nodes)))

    @cached_property
    def _force(self) -> sp.csr_matrix:
        return sp.csr_matrix(self.strain.T)

    def part(self, chosen: Array) -> Self:
        """Return the zone of some points only, (g,) bool, and of the nodes of their elements.

        Its `nodes` are numbers among the nodes of this zone.
        """
        result = copied(self)
        for known in ("strain", "_force"):
            vars(result).pop(known, None)
        result.nodes, in_part = np.unique(self.own[chosen], return_inverse=True)
        result.gradient, result.own = self.gradient[chosen], in_part.reshape(-1, self.own.shape[1])
        result.weight, result.border, result._places = self.weight[chosen], self.border[chosen], self._places[chosen]
        return result

    def __len__(self) -> int:
        return len(self.weight)

    def strains(self, displacement: Array) -> Array:
        """Deviatoric strains, (g, 6), by displacements of the nodes, (3 nz,) [m]."""
        return np.asarray(self.strain @ displacement).reshape(-1, 6)

    def stress(self, displacement: Array, state: PlasticState) -> Array:
        """Deviatoric stresses, (g, 6) [Pa] in Mandel's notation, by displacements of the nodes, (3 nz,) [m]."""
        return self.flow.stress(self.strains(displacement), state)

    def excess(self, displacement: Array, state: PlasticState) -> Array:
        """Von Mises stress beyond the flow stress, (g,) [Pa], by displacements of the nodes, (3 nz,) [m]."""
        return loops.excess(self, displacement, state)

    def answer(self, displacement: Array, state: PlasticState) -> tuple[PlasticState, Array, Array]:
        """State at the end of a step, its deviatoric strains, and how much flow has changed the pseudo-forces.

        Parameters
        ----------
        displacement : (3 nz,) array
            Of the nodes at the end of the step [m].
        state : PlasticState
            At its begin.

        Returns
        -------
        state : PlasticState
        strain : (g, 6) array
        change : (3 nz,) array
            [N]
        """
        return loops.answer(self, displacement, state)

    def pseudo_forces(self, strain: Array) -> Array:
        """Forces p on the nodes, (3 nz,) [N], by which plastic strain, (g, 6), acts on the elastic body."""
        if not strain.any():  # the matrix is large, and a run from the virgin state needs none
            return np.zeros(3 * len(self.nodes))
        return np.asarray(self._force @ self.stress_volumes(strain).ravel())

    def stress_volumes(self, strain: Array) -> Array:
        """Stresses 2 G e of plastic strains, (g, 6), times the points' volume [N m]."""
        value: Array = (2 * self.flow.shear_modulus * self.weight)[:, None] * strain
        return value

    def own_energy(self, state: PlasticState) -> float:
        """Elastic energy of plastic strain in a body that cannot move, 1/2 e_p C e_p [J]."""
        return self.flow.shear_modulus * float(self.weight @ np.einsum("gi,gi->g", state.strain, state.strain))

    def work(self, before: tuple[PlasticState, Array], after: tuple[PlasticState, Array]) -> float:
        """Plastic work between two states with their deviatoric strains, (g, 6) [J]: by the trapezoid of stresses."""
        flow = after[0].strain - before[0].strain
        elastic = before[1] - before[0].strain + after[1] - after[0].strain
        return self.flow.shear_modulus * float(self.weight @ np.einsum("gi,gi->g", elastic, flow))

    def place(self, point: int | Array) -> Array:
        """Centre of the element of an integration point, (3,), or of several, (k, 3) [m], in the body's coordinates."""
        place: Array = self._places[point]
        return place

    def edge_near(self, point: int) -> Array:
        """Node at the edge of the zone, (3,) [m], that is nearest to the element of an integration point."""
        nearest: Array = self._edge[np.linalg.norm(self._edge - self._places[point], axis=1).argmin()]
        return nearest


def _spacings(points: Array, region: PlasticRegion) -> Array:
    """Mean distance of neighbouring nodes along the edges of each element, (nc,) [m]."""
    spacing = np.empty(len(region.cells))
    for kind, rows in kinds_of(region.cells, region.hexahedra):
        ends = points[region.cells[rows][:, kind.columns[: kind.corners]][:, kind.edges]]
        spacing[rows] = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).mean(axis=1) / kind.order
    return spacing


def _at_border(region: PlasticRegion) -> Array:
    """Integration points of elements, (nc, q) bool, that are nearest to a corner on the border of the region."""
    by_kind = []
    for kind, rows in kinds_of(region.cells, region.hexahedra):
        corners = np.isin(region.cells[rows][:, kind.columns[: kind.corners]], region.border)
        by_kind.append((rows, corners @ nearest_corners(kind).T))
    order = np.argsort(np.concatenate([rows for rows, _ in by_kind]))
    at_border: Array = np.concatenate([points for _, points in by_kind])[order]
    return at_border
