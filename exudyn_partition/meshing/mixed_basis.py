"""Hexahedra, wedges, pyramids and tetrahedra in NGSolve, and its coefficients of functions with values at their nodes.

Of hexahedra NGSolve has all products of polynomials, of order 2 with nodes in the middle of faces and elements. The
functions of elements without such nodes are among them. So the matrices of these elements follow from NGSolve's.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..errors import MeshError
from ..fe.elements import Kind
from ..support.arrays import Array
from ..support.foreign import NGSolve, NGSolveMesh, NGSolveObject

Blocks = list[tuple[Kind, Array]]

_ROUND_OFF = 1e-7  # of coefficients that are whole numbers; NGSolve moves the tips of pyramids by some 1e-10
_EXACT = 1e-8  # error of a shape function in NGSolve's functions


def to_coefficients(ngsolve: NGSolve, mesh: NGSolveMesh, kinds: Blocks, n: int) -> sp.csr_matrix:
    """From values at n nodes to the coefficients of NGSolve's m functions, (m, n).

    Parameters
    ----------
    ngsolve : module
    mesh : ngsolve.Mesh
        Its elements are those of `kinds`, in this order.
    kinds : list of (Kind, (k, nodes) int array)
        Elements of each kind, all of one order.
    n : int

    Raises
    ------
    MeshError
        If elements do not share the nodes on their common edges.
    """
    order = kinds[0][0].order
    if order == 2:
        _check_shared(kinds, mesh.nv, mesh.nedge, n)
    space = ngsolve.H1(mesh, order=order)
    rows, columns, values, start = [], [], [], 0
    seen = np.zeros(space.ndof, dtype=bool)
    for kind, own in kinds:
        numbers = range(start, start + len(own))
        start += len(own)
        first = space.GetFE(ngsolve.ElementId(ngsolve.VOL, numbers[0]))
        of_element = _of_element(first, kind)
        dofs = np.array([space.GetDofNrs(ngsolve.ElementId(ngsolve.VOL, i)) for i in numbers])
        known, place = np.unique(dofs, return_index=True)  # coefficients of a dof are the same in all its elements
        known, place = known[~seen[known]], place[~seen[known]]
        seen[known] = True
        element, local = np.divmod(place, dofs.shape[1])
        i, node = np.nonzero(of_element[local])
        rows.append(known[i])
        columns.append(own[element[i], node])
        values.append(of_element[local[i], node])
    where = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_matrix((np.concatenate(values), where), shape=(space.ndof, n))


def _of_element(element: NGSolveObject, kind: Kind) -> Array:
    """Coefficients, (m, n), of the functions of a kind of elements in NGSolve's m functions."""
    local = _spread_points(kind)
    theirs = np.array([np.array(element.CalcShape(*point)) for point in _in_ngsolve(kind, local).tolist()])
    ours = kind.functions(local)[0]
    coefficients = np.linalg.lstsq(theirs, ours, rcond=None)[0]
    if abs(theirs @ coefficients - ours).max() > _EXACT:
        raise MeshError(f"mesh: NGSolve's functions on a {kind.name} are others than expected; is it another version?")
    whole = np.rint(coefficients)
    return np.asarray(np.where(abs(coefficients - whole) < _ROUND_OFF, whole, coefficients))


def _spread_points(kind: Kind) -> Array:
    """Points in an element that determine polynomials of order 2."""
    x = np.array([0.0, 0.3, 0.7, 1.0])
    r, s, t = (grid.ravel() for grid in np.meshgrid(x, x, x))
    if kind.corners == 6:
        s = s * (1 - r)
    elif kind.corners == 5:
        t = 0.9 * t
        r, s = r * (1 - t), s * (1 - t)
    elif kind.corners == 4:
        s, t = s * (1 - r), t * (1 - r) * (1 - s)
    return np.column_stack([r, s, t])


def _in_ngsolve(kind: Kind, local: Array) -> Array:
    """Local coordinates of NGSolve, whose triangles and tetrahedra have their last corner at the origin."""
    r, s, t = local.T
    if kind.corners == 6:
        return np.column_stack([1 - r - s, r, t])
    if kind.corners == 4:
        return np.column_stack([1 - r - s - t, r, s])
    return local


def _check_shared(kinds: Blocks, n_vertices: int, n_edges: int, n: int) -> None:
    """Refuse mid-side nodes that are not one for each edge."""
    ends, middles = [], []
    for kind, own in kinds:
        ends.append(np.sort(own[:, kind.edges], axis=2).reshape(-1, 2))
        middles.append(own[:, kind.corners :].ravel())
    edges, number = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    middle = np.concatenate(middles)
    of_edge = np.empty(len(edges), dtype=np.int64)
    of_edge[number.ravel()] = middle
    if n != n_vertices + n_edges or (of_edge[number.ravel()] != middle).any():
        raise MeshError(
            f"mesh: {n_edges} edges have {n - n_vertices} mid-side nodes, expected one each that all elements on an "
            "edge share. Merge coincident nodes or mesh anew"
        )
