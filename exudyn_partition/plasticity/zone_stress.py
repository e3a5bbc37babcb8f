"""Stress in a plastic zone: what plastic strain, and elements that do not lock, change in Hooke's law of the strain.

Components are in Voigt order xx, yy, zz, yz, xz, xy, in the body's own axes.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..errors import MeshError
from ..fe.material import Material
from ..fe.model import FEModel
from ..fe.patches import PlasticRegion
from ..fe.shapes import ORDERS, TET_NODES, integration_points, tetrahedron_functions
from ..support.arrays import Array
from .dilatation import LEFT, locks, mean_dilatation

_FROM_MANDEL = np.array([1, 1, 1, *[np.sqrt(0.5)] * 3])


class ZoneStress:
    """Stress in the tetrahedra of a plastic zone.

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
        if region.hexahedra:
            raise MeshError("cells: expected tetrahedra; the stress in a plastic zone of hexahedra is not recovered")
        self._shear, self._bulk = material.shear_modulus, material.lame + 2 / 3 * material.shear_modulus
        self._nodes = fem.points[region.cells]
        self._mean = mean_dilatation(fem.points, region.cells, False)[2].reshape(len(region.cells), self._k, 3)
        numbers = {cell.tobytes(): i for i, cell in enumerate(region.cells)}
        self._number = np.full(len(fem.cells), -1)
        for cell in np.flatnonzero(np.isin(fem.cells, region.nodes).all(axis=1)):
            self._number[cell] = numbers.get(fem.cells[cell].astype(region.cells.dtype).tobytes(), -1)
        at = integration_points(self._k)
        self._to_polynomial = np.linalg.pinv(_polynomials(at, self._k))
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
            self._mass_around = np.bincount(fem.cells.ravel(), np.repeat(fem.cell_mass, self._k), fem.n_nodes)
        total, everything = np.zeros((fem.n_nodes, 6)), np.arange(len(cells))
        mass = np.zeros(len(cells))
        mass[self._number[self._number >= 0]] = fem.cell_mass[self._number >= 0]
        for local, nodes in zip(TET_NODES[self._k], cells.T, strict=True):
            at = np.broadcast_to(local, (len(cells), 3))
            stress = -self._plastic(everything, at, strain)
            dilatation = np.einsum("cka,cka->c", self._apart(everything, at), displacement[cells])
            stress[:, :3] += self._bulk * dilatation[:, None]
            np.add.at(total, nodes, mass[:, None] * stress)
        return total / self._mass_around[:, None]

    def _inside(self, cell: Array) -> tuple[Array, Array]:
        """Which of some elements of the body are in the zone, and their numbers there."""
        inside = np.flatnonzero(self._number[cell] >= 0)
        return inside, self._number[cell[inside]]

    def _apart(self, number: Array, local: Array) -> Array:
        """theta_e - theta at a point in each of m elements by displacements of its nodes, (m, k, 3) [1/m]."""
        if not locks(self._k, False):
            return np.zeros((len(number), self._k, 3))
        derivatives, nodes = tetrahedron_functions(local, self._k)[1], self._nodes[number]
        gradient = derivatives @ np.linalg.inv(np.einsum("mka,mkj->maj", nodes, derivatives))
        apart: Array = (1 - LEFT) * (self._mean[number] - gradient)
        return apart

    def _plastic(self, number: Array, local: Array, strain: Array) -> Array:
        """2 G eps_p at a point in each of m elements, (m, 6) [Pa]."""
        coefficients = self._to_polynomial @ strain.reshape(len(self._region.cells), -1, 6)[number]
        value = np.einsum("mp,mpv->mv", _polynomials(local, self._k), coefficients)
        return np.asarray(2 * self._shear * _FROM_MANDEL * value)


def _polynomials(local: Array, n_nodes: int) -> Array:
    """Polynomials of the strain in a straight tetrahedron at local coordinates, (m, 3): (m, 1, 4 or 10)."""
    columns = [np.ones(len(local))]
    if ORDERS[n_nodes] > 1:
        columns += [*local.T]
    if ORDERS[n_nodes] > 2:
        columns += [local[:, i] * local[:, j] for i in range(3) for j in range(i, 3)]
    return np.column_stack(columns)
