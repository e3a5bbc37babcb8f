"""FE models from Exudyn's FEMinterface: matrices that NGSolve, Abaqus or ANSYS assembled, and Exudyn imported."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.spatial import cKDTree

from ..errors import InputError, MeshError
from ..fe.consistency import EQUAL, check_symmetric, plain_matrix
from ..fe.material import Material
from ..fe.mesh_quality import check_inside, warn_of_damage
from ..fe.model import FEModel
from ..fe.shapes import TET_EDGES, integration_gradients, integration_weights
from ..support.arrays import Array
from ..support.checks import validate_array, validate_type
from ..support.foreign import FEMinterface

_NODES = {"Tet4": 4, "Tet10": 10, "Hex8": 8}  # of an element, by Exudyn's name
_FLIPPED = {  # order of nodes that turns an element of negative volume
    4: [1, 0, 2, 3],
    10: [1, 0, 2, 3, 4, 6, 5, 8, 7, 9],
    8: [4, 5, 6, 7, 0, 1, 2, 3],
}
_STRAIGHT = ". Linear elements must be assembled on straight sides: mesh.Curve(1) before ImportMeshFromNGsolve"
_AROUND = 8  # nodes near the middle of an edge, one of which is its mid-side node


def from_feminterface(fem: FEMinterface, material: Material) -> FEModel:
    """FE model with the mesh and the matrices of Exudyn's FEMinterface.

    Nodes keep their numbers, so that node lists of an existing model go on working. Node sets whose nodes span facets
    of the surface become boundaries with the same names. Mass and stiffness are taken as they are. They are compared
    with the material: by the total mass, and by the energy of uniform strains, which any element integrates exactly.

    Parameters
    ----------
    fem : exudyn.FEM.FEMinterface
        With nodes, one kind of elements (Tet4, Tet10 or Hex8), mass and stiffness matrix. Of a quadratic mesh from
        NGSolve, Exudyn keeps the corners of the elements only; their mid-side nodes are found at the edges.
    material : Material
        What the matrices were made with, for waves, contact and stresses.

    Returns
    -------
    FEModel

    Raises
    ------
    InputError
        If `fem` is no FEMinterface, something in it is missing, or the material is not that of the matrices.
    MeshError
        If elements are of several or other kinds, or mesh and matrices do not fit together.

    Warns
    -----
    MeshQualityWarning
        If the mesh looks damaged, see `mesh_quality.warn_of_damage`.
    """
    validate_type("material", material, Material, "ep.Material()")
    mass, stiffness, points = _parts(fem)
    cells = _cells(fem, points)
    gradients = integration_gradients(cells.shape[1])
    jacobian = np.einsum("qnd,cnx->cqdx", gradients, points[cells])
    volume = np.linalg.det(jacobian) @ integration_weights(cells.shape[1])
    flip = volume < 0
    cells[flip] = cells[flip][:, _FLIPPED[cells.shape[1]]]
    cell_mass, total = material.rho * abs(volume), float(mass.sum()) / 3
    if abs(total - cell_mass.sum()) > EQUAL * total:
        raise InputError(
            f"material: the mass matrix has {total:.6g} kg, elements of a volume of {abs(volume).sum():.6g} m3 with "
            f"rho = {material.rho:.6g} kg/m3 have {cell_mass.sum():.6g} kg. Expected the material, and the units, that "
            f"the matrices were made with{_STRAIGHT if cells.shape[1] == _NODES['Tet4'] else ''}"
        )
    try:
        model = FEModel(points, cells, mass, stiffness, cell_mass, material, {})
    except InputError as error:
        if isinstance(error, MeshError) or cells.shape[1] != _NODES["Tet4"]:
            raise  # straight sides do not mend a mesh
        raise InputError(f"{error}{_STRAIGHT}") from error
    for nodes in fem.nodeSets:
        facets = np.flatnonzero(np.isin(model.facets, np.asarray(nodes["NodeNumbers"], dtype=np.int64)).all(axis=1))
        if len(facets):
            model.boundaries[str(nodes["Name"])] = facets
    check_inside(model)
    warn_of_damage(model)
    return model


def _parts(fem: FEMinterface) -> tuple[sp.csr_matrix, sp.csr_matrix, Array]:
    """Mass and stiffness, and places of the nodes."""
    needed = ("massMatrix", "stiffnessMatrix", "nodes", "elements", "nodeSets")
    if isinstance(fem, type) or not all(hasattr(fem, name) for name in needed):
        raise InputError(f"fem: expected a FEMinterface of exudyn.FEM, got {type(fem).__name__}")
    if set(fem.nodes) != {"Position"}:
        raise InputError(f"fem: expected nodes with positions only, got {', '.join(fem.nodes) or 'none'}")
    points = np.array(validate_array("fem: nodes", fem.nodes["Position"], (None, 3)))
    matrices = []
    for name in needed[:2]:
        matrix = getattr(fem, name)
        if matrix is None or not sp.issparse(matrix):
            raise InputError(
                f"fem: has no sparse {name}, got {type(matrix).__name__}; import it by ImportMeshFromNGsolve, or read "
                "it from the files of Abaqus or ANSYS"
            )
        if matrix.shape != (points.size,) * 2:
            raise MeshError(f"fem: {name} has shape {matrix.shape}, expected {(points.size,) * 2} for its nodes")
        matrix = plain_matrix(f"fem: {name}", matrix, points.size)
        check_symmetric(f"fem: {name}", matrix, EQUAL)
        matrix = ((matrix + matrix.T) / 2).tocsr()  # round-off of text files
        matrix.sort_indices()
        matrices.append(matrix)
    return matrices[0], matrices[1], points


def _cells(fem: FEMinterface, points: Array) -> Array:
    """Elements in VTK order, with mid-side nodes if other nodes than corners are left over."""
    kinds = [(kind, value) for entry in fem.elements for kind, value in entry.items() if kind != "Name"]
    if len(kinds) != 1 or kinds[0][0] not in _NODES:
        raise MeshError(
            f"fem: expected elements of one kind, {', '.join(_NODES)}, got {', '.join(k for k, _ in kinds) or 'none'}"
        )
    kind, value = kinds[0]
    cells = np.array(value, dtype=np.int64)
    if cells.ndim != 2 or cells.shape[1] != _NODES[kind] or cells.min() < 0 or cells.max() >= len(points):
        raise MeshError(
            f"fem: expected {kind} of shape (n, {_NODES[kind]}) with node numbers from 0 to {len(points) - 1}, got "
            f"shape {cells.shape}"
        )
    beside = np.setdiff1d(np.arange(len(points)), cells)
    if kind != "Tet4" or not len(beside):
        return cells
    ends = np.sort(cells[:, TET_EDGES], axis=2).reshape(-1, 2)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    middle = _one_each(points[edges].mean(axis=1), points[beside])
    if middle is None:
        raise MeshError(
            f"fem: {len(beside)} nodes belong to no Tet4, whose {len(edges)} edges expect one mid-side node each; are "
            "the elements those of the nodes?"
        )
    return np.hstack([cells, beside[middle][number.reshape(-1, 6)]])


def _one_each(places: Array, points: Array) -> Array | None:
    """Number of the point, (n,), that belongs to each of n places, (n, 3), or None if not all have one of their own.

    The nearest point does, but in coarse meshes of curved sides; there the sum of all squared distances is smallest.
    """
    if len(places) != len(points):
        return None
    distance, near = cKDTree(points).query(places, k=min(_AROUND, len(points)))
    if len(np.unique(near[:, 0])) == len(points):
        return np.asarray(near[:, 0])
    size = distance.max()
    cost = 1 + (distance / size) ** 2  # zeros would be no candidates
    candidates = sp.csr_matrix((cost.ravel(), near.ravel(), np.arange(0, near.size + 1, near.shape[1])))
    try:
        return np.asarray(min_weight_full_bipartite_matching(candidates)[1])
    except ValueError:  # there is none
        return None
