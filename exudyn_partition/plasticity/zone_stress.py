"""Stress in a plastic zone: what plastic strain, and elements that do not lock, change in Hooke's law of the strain.

Components are in Voigt order xx, yy, zz, yz, xz, xy, in the body's own axes.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..fe.elements import Kind, kinds_of
from ..fe.material import Material
from ..fe.model import FEModel
from ..fe.patches import PlasticRegion
from ..support.arrays import Array
from .dilatation import LEFT, freed, mean_dilatation
from .integration import flow_places

_FROM_MANDEL = np.array([1, 1, 1, *[np.sqrt(0.5)] * 3])


class ZoneStress:
    """Stress in the elements of a plastic zone.

    With the strain eps, its dilatation theta, and the plastic strain eps_p, which is known at the integration points
    and a polynomial between them, the stress is

        C eps - 2 G eps_p + K (theta_e - theta) 1.

    Here theta_e is the dilatation that the element's stiffness knows, see module `dilatation`.

    Parameters
    ----------
    fem : FEModel
    region : PlasticRegion
    material : Material
    """

    def __init__(self, fem: FEModel, region: PlasticRegion, material: Material) -> None:
        self._fem, self._region, self._k = fem, region, region.cells.shape[1]
        self._kinds = kinds_of(region.cells, region.hexahedra)
        self._kind = np.empty(len(region.cells), dtype=np.int64)  # of each element, among these
        for i, (_, rows) in enumerate(self._kinds):
            self._kind[rows] = i
        self._shear, self._bulk = material.shear_modulus, material.lame + 2 / 3 * material.shear_modulus
        self._of_mean = np.where(freed(fem, region.cells), 1 - LEFT, 0.0)  # share of the dilatation that is the mean
        self._mean = mean_dilatation(fem.points, region.cells, region.hexahedra)[2].reshape(
            len(region.cells), self._k, 3
        )
        numbers = {cell.tobytes(): i for i, cell in enumerate(region.cells)}
        self._number = np.full(len(fem.cells), -1)
        for cell in np.flatnonzero(np.isin(fem.cells, region.nodes).all(axis=1)):
            self._number[cell] = numbers.get(fem.cells[cell].astype(region.cells.dtype).tobytes(), -1)
        self._to_polynomial = [np.linalg.pinv(_polynomials(flow_places(kind), kind)) for kind, _ in self._kinds]
        self._mass_around: Array | None = None

    def rows(self, cell: Array, local: Array) -> sp.csr_matrix:
        """Change of the stress at m points by displacements of all nodes, (6m, 3n) [Pa/m], see `recovery.stress_rows`.

        Parameters
        ----------
        cell : (m,) int array
            Elements of the FE model in which the points lie.
        local : (m, 3) array
            Their local coordinates there.
        """
        inside, number = self._inside(cell)
        apart = self._bulk * self._apart(number, local[inside])
        values = np.repeat(apart.reshape(len(inside), 1, -1), 3, axis=1)
        dofs = (3 * self._region.cells[number][:, :, None] + np.arange(3)).reshape(len(inside), 1, -1)
        at = np.broadcast_to((6 * inside[:, None] + np.arange(3))[:, :, None], values.shape)
        places = at.ravel(), np.broadcast_to(dofs, values.shape).ravel()
        return sp.csr_matrix((values.ravel(), places), shape=(6 * len(cell), self._fem.n_dofs))

    def taken(self, cell: Array, local: Array, strain: Array) -> Array:
        """Stresses 2 G eps_p at m points, (m, 6) [Pa], by plastic strains of the zone, (g, 6); zero outside it."""
        inside, number = self._inside(cell)
        stress = np.zeros((len(cell), 6))
        stress[inside] = self._plastic(number, local[inside], strain)
        return stress

    def at_nodes(self, displacement: Array, strain: Array) -> Array:
        """Change of the nodal stress, (n, 6) [Pa], see `recovery.nodal_stress`, by the displacement of all nodes.

        Parameters
        ----------
        displacement : (n, 3) array
            [m]
        strain : (g, 6) array
            Plastic strains of the zone.
        """
        fem, cells = self._fem, self._region.cells
        if self._mass_around is None:
            self._mass_around = np.zeros(fem.n_nodes)
            for kind, rows in fem.kinds:
                of_nodes = fem.cells[rows][:, kind.columns]
                np.add.at(self._mass_around, of_nodes, fem.cell_mass[rows, None])
        total = np.zeros((fem.n_nodes, 6))
        mass = np.zeros(len(cells))
        mass[self._number[self._number >= 0]] = fem.cell_mass[self._number >= 0]
        for kind, rows in self._kinds:
            for local, column in zip(kind.nodes, kind.columns, strict=True):
                at = np.broadcast_to(local, (len(rows), 3))
                stress = -self._plastic(rows, at, strain)
                dilatation = np.einsum("cka,cka->c", self._apart(rows, at), displacement[cells[rows]])
                stress[:, :3] += self._bulk * dilatation[:, None]
                np.add.at(total, cells[rows][:, column], mass[rows, None] * stress)
        return total / self._mass_around[:, None]

    def _inside(self, cell: Array) -> tuple[Array, Array]:
        """Which of some elements of the body are in the zone, and their numbers there."""
        inside = np.flatnonzero(self._number[cell] >= 0)
        return inside, self._number[cell[inside]]

    def _apart(self, number: Array, local: Array) -> Array:
        """theta_e - theta at a point in each of m elements by displacements of its nodes, (m, k, 3) [1/m]."""
        apart = np.zeros((len(number), self._k, 3))
        if not self._of_mean[number].any():
            return apart
        for kind, of_kind in self._each(number):
            derivatives = kind.functions(local[of_kind])[1]
            nodes = self._fem.points[self._region.cells[number[of_kind]][:, kind.columns]]
            gradient = derivatives @ np.linalg.inv(np.einsum("mka,mkj->maj", nodes, derivatives))
            of_mean = self._of_mean[number[of_kind], None, None]
            apart[of_kind] = of_mean * (self._mean[number[of_kind]] - kind.on_row(gradient))
        return apart

    def _each(self, number: Array) -> list[tuple[Kind, Array]]:
        """Kinds of some elements of the zone, each with the places of its own among them."""
        each = [(kind, np.flatnonzero(self._kind[number] == i)) for i, (kind, _) in enumerate(self._kinds)]
        return [(kind, of_kind) for kind, of_kind in each if len(of_kind)]

    def _plastic(self, number: Array, local: Array, strain: Array) -> Array:
        """2 G eps_p at a point in each of m elements, (m, 6) [Pa]."""
        value, of_cells = np.zeros((len(number), 6)), strain.reshape(len(self._region.cells), -1, 6)
        for i, (kind, _) in enumerate(self._kinds):
            of_kind = np.flatnonzero(self._kind[number] == i)
            coefficients = self._to_polynomial[i] @ of_cells[number[of_kind]]
            value[of_kind] = np.einsum("mp,mpv->mv", _polynomials(local[of_kind], kind), coefficients)
        return np.asarray(2 * self._shear * _FROM_MANDEL * value)


def _polynomials(local: Array, kind: Kind) -> Array:
    """Polynomials of the strain in a straight element at local coordinates, (m, 3): (m, 1, 4 or 10)."""
    columns = [np.ones(len(local))]
    if kind.order > 1 or kind.corners > 4:
        columns += [*local.T]
    if kind.order > 2:
        columns += [local[:, i] * local[:, j] for i in range(3) for j in range(i, 3)]
    return np.column_stack(columns)
