"""Between NGSolve's hierarchical basis on tetrahedra and values at nodes, for orders 1 to 3."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..errors import InvertedElementsError, MeshError
from ..fe.shapes import TET_EDGES, TET_FACES
from ..support.arrays import Array
from ..support.foreign import NGSolve, NGSolveMesh, NGSolveObject


class NodalBasis:
    """Nodes of a mesh, and the matrix from values there to NGSolve's coefficients.

    Nodes are numbered as NGSolve's functions: first the vertices, then those on the edges, one at order 2, two at order
    3, then at order 3 one on each face.

    Parameters
    ----------
    ngsolve : module
    mesh : ngsolve.Mesh
        Of tetrahedra.
    order : {1, 2, 3}

    Attributes
    ----------
    to_hierarchical : (n, n) csr matrix
        From nodal values to the coefficients of one component.
    edges : (k, 2) int array
        Vertices of the mesh's edges; none at order 1. At order 3 the first node of an edge is nearer to the vertex with
        the smaller number.

    Raises
    ------
    MeshError
        If NGSolve has other functions than one for each node.
    """

    def __init__(self, ngsolve: NGSolve, mesh: NGSolveMesh, order: int) -> None:
        self._order, self._nv = order, mesh.nv
        self.edges, self._faces = np.empty((0, 2), dtype=np.int64), np.empty((0, 3), dtype=np.int64)
        if order == 1:
            self.to_hierarchical = sp.identity(mesh.nv, format="csr")
            return
        self.edges = np.array([[vertex.nr for vertex in edge.vertices] for edge in mesh.edges])
        scalar = ngsolve.H1(mesh, order=order)
        element = ngsolve.ElementId(ngsolve.VOL, 0)
        if order == 3:
            self.edges = np.sort(self.edges, axis=1)
            self._faces = np.array([[vertex.nr for vertex in face.vertices] for face in mesh.faces])
        if scalar.ndof != mesh.nv + (order - 1) * len(self.edges) + len(self._faces):
            raise MeshError(f"mesh: expected one dof for each node in its space of order {order}")
        first = [vertex.nr for vertex in mesh[element].vertices][:2]
        self.to_hierarchical = (
            self._quadratic(scalar.GetFE(element))
            if order == 2
            else self._cubic(scalar.GetFE(element), first[0] < first[1])
        )

    def _quadratic(self, shapes: NGSolveObject) -> sp.csr_matrix:
        """An edge function is c times the nodal one: u_mid = (u_1 + u_2) / 2 + c b, b = (u_mid - ...) / c."""
        nv, ne = self._nv, len(self.edges)
        c = float(max(np.array(shapes.CalcShape(0.5, 0.5, 0.0))[4:], key=abs))
        rows = nv + np.arange(ne)
        where = (np.r_[rows, rows], self.edges.T.ravel())
        weights = sp.csr_matrix((np.full(2 * ne, -0.5 / c), where), shape=(nv + ne, nv + ne))
        return (weights + sp.diags(np.r_[np.ones(nv), np.full(ne, 1 / c)])).tocsr()

    def _cubic(self, shapes: NGSolveObject, ascending: bool) -> sp.csr_matrix:
        """An edge has an even and an odd function, and a face has one.

        With x = u_1 and x' = u_2 at an edge's ends, and a sum over the ends or edges of a face,
            u = (2 x + x') / 3 + even b + odd b',  u' = (x + 2 x') / 3 + even b - odd b' on an edge,
            u = sum(x) / 3 + across sum(b) + own b'' on a face.
        """
        on_edge = np.array(shapes.CalcShape(2 / 3, 1 / 3, 0.0))[4:]
        on_face = np.array(shapes.CalcShape(1 / 3, 1 / 3, 0.0))[4:]
        start = int(abs(on_edge).argmax())
        even_by, odd_by = float(on_edge[start]), float(on_edge[start + 1]) * (1 if ascending else -1)
        across, own_by = float(on_face[start]), float(max(on_face[12:], key=abs))
        nv, ne, nf = self._nv, len(self.edges), len(self._faces)
        n = nv + 2 * ne + nf
        even = nv + 2 * np.arange(ne)
        ends, pair = self.edges.T, np.stack([even, even + 1])
        sums = _matrix(n, even, [(ends, -1.0), (pair, 1.0)]) / (2 * even_by)
        turns = _matrix(n, even + 1, [(ends[:1], -1 / 3), (ends[1:], 1 / 3), (pair[:1], 1.0), (pair[1:], -1.0)]) / (
            2 * odd_by
        )
        own = nv + 2 * ne + np.arange(nf)
        sides = even[self._edges_between(self._faces[:, [0, 1, 2]], self._faces[:, [1, 2, 0]])].T
        faces = _matrix(n, own, [(own[None], 1.0), (self._faces.T, -1 / 3)])
        faces = (faces - across * (_matrix(n, own, [(sides, 1.0)]) @ sums)) / own_by
        return sp.csr_matrix(sp.diags(np.arange(n) < nv, dtype=float) + sums + turns + faces)

    def cells(self, corners: Array, points: Array) -> Array:
        """(ne, 4), (ne, 10) or (ne, 20) nodes of tetrahedra with `corners`, (ne, 4), of positive volume, in VTK order.

        Corners of elements with negative volume are exchanged in place.

        Raises
        ------
        InvertedElementsError
            If an element has no volume.
        """
        a, b, c, d = (points[corners[:, i]] for i in range(4))
        volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
        if not (volume != 0).all():
            raise InvertedElementsError(f"mesh: {np.count_nonzero(volume == 0)} elements have no volume")
        flip = volume < 0
        corners[flip, :2] = corners[flip, 1::-1]
        return self.numbers(corners)

    def numbers(self, corners: Array) -> Array:
        """(ne, 4), (ne, 10) or (ne, 20) nodes of tetrahedra with `corners`, (ne, 4), in VTK order."""
        if self._order == 1:
            return corners
        a, b = corners[:, TET_EDGES[:, 0]], corners[:, TET_EDGES[:, 1]]
        edges = self._edges_between(a, b)
        if self._order == 2:
            return np.hstack([corners, self._nv + edges])
        on_edges = self._nv + 2 * edges[:, :, None] + np.where((a < b)[:, :, None], [0, 1], [1, 0])
        faces = self._nv + 2 * len(self.edges) + _find(self._faces, corners[:, TET_FACES], self._nv)
        return np.hstack([corners, on_edges.reshape(len(corners), -1), faces])

    def _edges_between(self, a: Array, b: Array) -> Array:
        """Numbers of the edges between vertices."""
        return _find(self.edges, np.stack([a, b], axis=-1), self._nv)


def _find(known: Array, wanted: Array, n: int) -> Array:
    """Rows of `known`, (m, k), with the same numbers below n, in any order, as those on the last axis of `wanted`."""
    powers = n ** np.arange(known.shape[1])[::-1]
    key = np.sort(known, axis=1) @ powers
    order = np.argsort(key)
    return order[np.searchsorted(key[order], np.sort(wanted, axis=-1) @ powers)]


def _matrix(n: int, rows: Array, parts: list[tuple[Array, float]]) -> sp.csr_matrix:
    """(n, n) matrix with a value in `rows`, (m,), at each of some columns, (k, m)."""
    i = np.concatenate([np.broadcast_to(rows, columns.shape).ravel() for columns, _ in parts])
    j = np.concatenate([columns.ravel() for columns, _ in parts])
    values = np.concatenate([np.full(columns.size, value) for columns, value in parts])
    return sp.csr_matrix((values, (i, j)), shape=(n, n))
