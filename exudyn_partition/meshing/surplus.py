"""What functions of one order more would add to an FE model, on the same elements.

Theory: examples/site/theory.md, "The error of a mesh".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..fe.model import FEModel, node_dofs
from ..support.arrays import Array
from ..support.foreign import NGSolve, NGSolveMesh


class Surplus:
    """Functions on the elements of an FE model of order k that together with it make the space of order k + 1.

    Parameters
    ----------
    fem : FEModel
    ngsolve : module
    mesh : ngsolve.Mesh
        Its vertices are those of `fem`, ascending, and its elements those of `fem`.
    to_hierarchical : (n, n) csr matrix
        From nodal values to NGSolve's coefficients of order k.
    stiffness, mass : csr matrix
        Of a vector, dofs xyz interleaved, and of one component, in NGSolve's basis of order k + 1.

    Attributes
    ----------
    stiffness : (3 s, 3 s) csr matrix
        Between the s functions; dofs xyz interleaved.
    coupling, mass_coupling : (3 s, 3 n) csr matrix
        Stiffness and mass between the functions and the nodes.
    """

    def __init__(
        self,
        fem: FEModel,
        ngsolve: NGSolve,
        mesh: NGSolveMesh,
        to_hierarchical: sp.csr_matrix,
        stiffness: sp.csr_matrix,
        mass: sp.csr_matrix,
    ) -> None:
        k = fem.order
        self._ngsolve, self._mesh, self._space = ngsolve, mesh, ngsolve.H1(mesh, order=k + 1)
        self._vertices, self._cells = np.unique(fem.cells[:, :4]), fem.cells[:, :4]
        n = self._space.ndof
        # On vertices, edges, faces and cells NGSolve lists functions of lower orders first; see `NodalBasis` for k.
        counts = [(mesh.nv, 1), (mesh.nedge, k), (mesh.nface, k * (k - 1) // 2)]
        lower = [1, k - 1, (k - 1) * (k - 2) // 2]
        new = [np.tile(np.arange(own) >= old, many) for (many, own), old in zip(counts, lower, strict=True)]
        is_new = np.concatenate([*new, np.ones(n - sum(map(len, new)), dtype=bool)])
        self._number = np.where(is_new, np.cumsum(is_new) - 1, -1)
        added, old = np.flatnonzero(is_new), np.flatnonzero(~is_new)
        self.size = len(added)
        ours, to_nodes = node_dofs(added), sp.kron(to_hierarchical, sp.identity(3), format="csr")
        rows = stiffness[ours]
        self.stiffness = rows[:, ours]
        self.coupling = sp.csr_matrix(rows[:, node_dofs(old)] @ to_nodes)
        self.mass_coupling = sp.kron(mass[added][:, old] @ to_hierarchical, sp.identity(3), format="csr")

    def values_at(self, corners: Array, local: Array) -> sp.csr_matrix:
        """Values of the functions at points of the surface, (p, s).

        Parameters
        ----------
        corners : (p, 3) int array
            Nodes at the corners of each point's facet.
        local : (p, 2) array
            The point in the facet's coordinates.
        """
        n = len(self._vertices)
        cells = np.searchsorted(self._vertices, self._cells)
        ours = np.searchsorted(self._vertices, corners)
        powers = np.array([n * n, n, 1])
        faces = np.sort(cells[:, [(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)]], axis=2) @ powers
        order = np.argsort(faces, axis=None)
        found = order[np.searchsorted(faces.ravel()[order], np.sort(ours, axis=1) @ powers)] // 4
        shares = np.column_stack([1 - local.sum(axis=1), local])
        rows, columns, values = [], [], []
        for point, (cell, nodes, share) in enumerate(zip(found, ours, shares, strict=True)):
            element = self._ngsolve.ElementId(self._ngsolve.VOL, int(cell))
            # NGSolve's tetrahedron has its first three vertices at the ends of the axes.
            vertices = [vertex.nr for vertex in self._mesh[element].vertices]
            place = np.zeros(4)
            place[[vertices.index(node) for node in nodes]] = share
            shape = np.array(self._space.GetFE(element).CalcShape(*place[:3]))
            number = self._number[np.array(self._space.GetDofNrs(element))]
            own = np.flatnonzero((number >= 0) & (shape != 0))
            rows.append(np.full(len(own), point))
            columns.append(number[own])
            values.append(shape[own])
        where = (np.concatenate(rows), np.concatenate(columns))
        return sp.csr_matrix((np.concatenate(values), where), shape=(len(local), self.size))
