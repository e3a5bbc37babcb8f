"""From an OCC shape or NGSolve mesh to an `FEModel`; the only module that imports NGSolve and Netgen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ._checks import validate_positive, validate_vector
from ._optional import require
from .errors import InputError, MeshError
from .fem import FEModel
from .material import Material

Array = np.ndarray

# Edges of a tetrahedron in the order in which VTK lists their mid-side nodes.
_TET_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])


@dataclass(frozen=True)
class Refine:
    """Local mesh size around a point.

    Parameters
    ----------
    center : (3,) array
        Centre of the refined ball [m].
    radius : float
        Its radius [m].
    h : float
        Element size within it [m]; quadratic elements have nodes every h / 2.
    """

    center: Array
    radius: float
    h: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", validate_vector("center", self.center))
        validate_positive("radius", self.radius, "m")
        validate_positive("h", self.h, "m")

    def points(self) -> Array:
        """(n, 3) array: a grid of spacing h that fills the ball [m]."""
        n = int(np.ceil(self.radius / self.h))
        grid = self.h * np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3), axis=-1).reshape(-1, 3)
        return self.center + grid[np.linalg.norm(grid, axis=1) <= self.radius]


def generate_mesh(shape: Any, *, maxh: float, refine: Iterable[Refine] = (), grading: float = 0.3) -> Any:
    """Mesh an OCC shape with tetrahedra.

    Parameters
    ----------
    shape : netgen.occ.TopoDS_Shape
        The body, one solid.
    maxh : float
        Largest element size [m].
    refine : iterable of Refine
        Balls with smaller elements.
    grading : float
        How fast elements grow away from them, 0 (slowly) to 1.

    Returns
    -------
    ngsolve.Mesh
        Elements curved to the geometry with order 2.

    Raises
    ------
    InputError
        If the shape is no OCC shape or a size is not above zero.
    MissingPackageError
        If ngsolve is not installed.
    """
    ngsolve, occ, meshing = require("ngsolve"), require("netgen.occ"), require("netgen.meshing")
    validate_positive("maxh", maxh, "m")
    validate_positive("grading", grading)
    if not isinstance(shape, occ.TopoDS_Shape):
        raise InputError(f"shape: expected an OCC shape of netgen.occ, got {type(shape).__name__}")
    parameters = meshing.MeshingParameters(maxh=maxh, grading=grading)
    for region in refine:
        for x, y, z in region.points():
            parameters.RestrictH(x=x, y=y, z=z, h=region.h)
    mesh = ngsolve.Mesh(occ.OCCGeometry(shape).GenerateMesh(mp=parameters))
    mesh.Curve(2)
    return mesh


def fe_model(
    shape_or_mesh: Any,
    material: Material,
    *,
    order: int = 2,
    maxh: float | None = None,
    refine: Iterable[Refine] = (),
    grading: float = 0.3,
) -> FEModel:
    """Assemble the FE model of a free body.

    Parameters
    ----------
    shape_or_mesh : netgen.occ.TopoDS_Shape or ngsolve.Mesh
        An OCC shape, which is meshed with `generate_mesh`, or a mesh of tetrahedra as it is. A mesh that is to be
        curved to its geometry must be curved with order 2 beforehand, as `generate_mesh` does.
    material : Material
        In units that fit the geometry's, SI unless all are chosen otherwise.
    order : {1, 2}
        Linear elements with straight sides, or quadratic ones that follow the mesh's curvature.
    maxh, refine, grading :
        For a shape, see `generate_mesh`.

    Returns
    -------
    FEModel

    Raises
    ------
    InputError, MeshError, MissingPackageError

    Warns
    -----
    UnitsWarning
        If size and density give an implausible frequency or mass.
    """
    ngsolve = require("ngsolve")
    if order not in (1, 2):
        raise InputError(f"order: expected 1 or 2, got {order!r}")
    if isinstance(shape_or_mesh, ngsolve.Mesh):
        mesh = shape_or_mesh
    else:
        if maxh is None:
            raise InputError("maxh: a shape needs a largest element size [m]")
        mesh = generate_mesh(shape_or_mesh, maxh=maxh, refine=refine, grading=grading)
    if mesh.dim != 3 or {len(el.vertices) for el in mesh.Elements(ngsolve.VOL)} != {4}:
        raise MeshError("mesh: expected a three-dimensional mesh of tetrahedra")
    curve_order = mesh.GetCurveOrder()
    if order == 1:
        mesh.Curve(1)
    try:
        fem = _assemble(ngsolve, mesh, material, order)
    finally:
        if order == 1:
            mesh.Curve(curve_order)
    fem.warn_if_units_slipped()
    return fem


def _assemble(ngsolve: Any, mesh: Any, material: Material, order: int) -> FEModel:
    """Matrices by NGSolve, changed from its hierarchical basis to nodal values and from x..y..z.. to xyz order."""
    space = ngsolve.VectorH1(mesh, order=order)
    u, v = space.TnT()

    def strain(w: Any) -> Any:
        return ngsolve.Sym(ngsolve.Grad(w))

    with ngsolve.TaskManager():
        stress = 2 * material.shear_modulus * strain(u) + material.lame * ngsolve.div(u) * ngsolve.Id(3)
        stiffness = ngsolve.BilinearForm(ngsolve.InnerProduct(stress, strain(v)) * ngsolve.dx).Assemble()
        mass = ngsolve.BilinearForm(material.rho * u * v * ngsolve.dx).Assemble()
        cell_mass = material.rho * np.array(ngsolve.Integrate(ngsolve.CF(1), mesh, ngsolve.VOL, element_wise=True))
        position = ngsolve.GridFunction(space)
        position.Set(ngsolve.CF((ngsolve.x, ngsolve.y, ngsolve.z)))

    numbering = mesh.ngmesh.Elements3D().NumPy()
    corners = numbering["nodes"][:, :4].astype(np.int64) - 1
    to_hierarchical, edges = _nodal_basis(ngsolve, mesh, order)
    points = np.column_stack(_nodal_values(position.vec, to_hierarchical))
    cells = _cells(corners, edges, points, mesh.nv)
    n = len(points)
    interleave = np.arange(3 * n).reshape(3, n).T.ravel()
    change = sp.block_diag([to_hierarchical] * 3, format="csr")[:, interleave]
    fem = FEModel(
        points=points,
        cells=cells,
        mass=_symmetric(change.T @ _csr(mass.mat) @ change),
        stiffness=_symmetric(change.T @ _csr(stiffness.mat) @ change),
        cell_mass=cell_mass,
        material=material,
        boundaries={},
    )
    fem.boundaries.update(_named_boundaries(mesh, fem.facets))
    return fem


def _nodal_basis(ngsolve: Any, mesh: Any, order: int) -> tuple[sp.csr_matrix, Array]:
    """Matrix from nodal values to NGSolve's hierarchical coefficients of one component, and the mesh's edges.

    At order 2 an edge function is c times the nodal one, so u_mid = (u_1 + u_2) / 2 + c b, b = (u_mid - ...) / c.
    """
    nv = mesh.nv
    if order == 1:
        return sp.identity(nv, format="csr"), np.empty((0, 2), dtype=np.int64)
    edges = np.array([[vertex.nr for vertex in edge.vertices] for edge in mesh.edges])
    scalar = ngsolve.H1(mesh, order=2)
    if scalar.ndof != nv + len(edges):
        raise MeshError("mesh: its order-2 space has other dofs than one a vertex and one an edge")
    element = ngsolve.ElementId(ngsolve.VOL, 0)
    midpoint_values = scalar.GetFE(element).CalcShape(0.5, 0.5, 0.0)
    c = float(max(np.array(midpoint_values)[4:], key=abs))
    ne = len(edges)
    rows = nv + np.arange(ne)
    weights = sp.csr_matrix((np.full(2 * ne, -0.5 / c), (np.r_[rows, rows], edges.T.ravel())), shape=(nv + ne, nv + ne))
    return (weights + sp.diags(np.r_[np.ones(nv), np.full(ne, 1 / c)])).tocsr(), edges


def _nodal_values(vector: Any, to_hierarchical: sp.csr_matrix) -> list[Array]:
    """Nodal values of the three components of a VectorH1 function (the basis change is unit lower triangular)."""
    n = to_hierarchical.shape[0]
    coefficients = np.array(vector).reshape(3, n)
    diagonal = to_hierarchical.diagonal()
    vertex_part = coefficients * (diagonal == 1.0)
    below = to_hierarchical - sp.diags(diagonal)
    return [(c - below @ v) / diagonal for c, v in zip(coefficients, vertex_part, strict=True)]


def _cells(corners: Array, edges: Array, points: Array, nv: int) -> Array:
    """Tetrahedra of positive volume, with their mid-side nodes if there are edges, in VTK order."""
    a, b, c, d = (points[corners[:, i]] for i in range(4))
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
    if not (volume != 0).all():
        raise MeshError(f"mesh: {np.count_nonzero(volume == 0)} elements have no volume")
    flip = volume < 0
    corners[flip, :2] = corners[flip, 1::-1]
    if not len(edges):
        return corners
    key = np.sort(edges, axis=1) @ [nv, 1]
    order = np.argsort(key)
    wanted = np.sort(corners[:, _TET_EDGES], axis=2) @ [nv, 1]
    middle = nv + order[np.searchsorted(key[order], wanted)]
    return np.hstack([corners, middle])


def _named_boundaries(mesh: Any, facets: Array) -> dict[str, Array]:
    """Rows of `facets` on each named boundary of the mesh."""
    elements = mesh.ngmesh.Elements2D().NumPy()
    triangles = np.sort(elements["nodes"][:, :3].astype(np.int64) - 1, axis=1)
    names = np.array(mesh.GetBoundaries())[elements["index"] - 1]
    weights = np.array([mesh.nv**2, mesh.nv, 1], dtype=object if mesh.nv > 2_000_000 else np.int64)
    own = np.sort(facets[:, :3], axis=1) @ weights
    theirs = triangles @ weights
    return {str(name): np.flatnonzero(np.isin(own, theirs[names == name])) for name in np.unique(names)}


def _csr(matrix: Any) -> sp.csr_matrix:
    values, columns, starts = matrix.CSR()
    return sp.csr_matrix((np.array(values), np.array(columns), np.array(starts)), shape=(matrix.height, matrix.width))


def _symmetric(matrix: sp.spmatrix) -> sp.csr_matrix:
    """Remove the round-off asymmetry of a triple product."""
    result = ((matrix + matrix.T) / 2).tocsr()
    result.sort_indices()
    return result
