"""From an OCC shape, NGSolve mesh or file to an `FEModel`: assembly by NGSolve."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, InvertedElementsError, MemoryLimitError, MeshError, MeshQualityWarning
from ..fe.consistency import integrals
from ..fe.elements import centres_of, corner_keys, faces_of, kinds_of
from ..fe.facets import check_conforming
from ..fe.material import Material, Regions
from ..fe.mesh_quality import check_inside, warn_of_damage, warn_of_stiff_walls
from ..fe.model import FEModel
from ..fe.patch_facets import show
from ..fe.shapes import ORDERS, TET_NODES
from ..support.arrays import Array, consecutive
from ..support.checks import (
    validate_type,
)
from ..support.foreign import NGSolve, NGSolveMesh, NGSolveObject, Shape
from ..support.machine import alone
from ..support.optional import require
from ..support.progress import pulsing
from ..support.spelling import spelled
from ..support.warn import warn
from .file_bodies import FileBodies, check_apart
from .file_mesh import CellRegions
from .materials import GivenMaterial, Modulus
from .mesh_files import inverted
from .mesh_size import Refine, check_memory_of_model
from .mixed_basis import to_coefficients
from .model_plan import FilePlan, ModelPlan, ShapePlan, plan_model, refuse_mesh_options
from .netgen_mesh import (
    CURVATURE,
    GRADING,
    ONE_AT_A_TIME,
    distances,
    meshed,
    regions_of,
)
from .nodal_basis import NodalBasis
from .step_assembly import StepAssembly
from .surplus import Surplus

_LOG = logging.getLogger(__name__)

# Factors on sizes of elements: the next one is tried if curved sides turn elements of a shape inside out.
_FINER = 1.0, 0.9, 0.75, 0.6, 0.45

_HIGHER = {1: 7.0, 2: 3.3, 3: 2.4}  # nodes of elements of one order more, by those of the order
_AT_ONCE = 1000  # pyramids
_THREADS_FROM = 5_000  # nodes; fewer are assembled before NGSolve's threads have started, which wait by spinning
_VOLUME_MISSED = 0.05  # allowed relative difference in volume of a mesh and its shape


@spelled
def fe_model(
    source: Shape | NGSolveMesh | StepAssembly | FileBodies | str | Path,
    material: Material | Mapping[str, Material] | None = None,
    *,
    modulus: Modulus | None = None,
    order: int | None = None,
    maxh: float | None = None,
    refine: Iterable[Refine] = (),
    grading: float = GRADING,
    scale: float = 1.0,
    only_solids: bool = False,
    solid: str | None = None,
) -> FEModel:
    """Assemble the FE model of a free body.

    Parameters
    ----------
    source : netgen.occ.TopoDS_Shape, ngsolve.Mesh, StepAssembly, FileBodies, str or pathlib.Path
        An OCC shape, which is meshed with `generate_mesh`, or a mesh of tetrahedra as it is. A mesh that is to be
        curved to its geometry must be curved beforehand, with at most `order`; `generate_mesh` does it with order 2.
        A path leads to a shape in a file of STEP, IGES or BREP, or to a mesh file of linear or quadratic tetrahedra,
        hexahedra, wedges and pyramids, see `ep.read_bodies`. Netgen reads STEP and IGES in millimetres: give
        scale=1e-3. The nodes of a mesh file keep their order, and quadratic elements their own mid-side nodes; its
        named faces, and sets of nodes that span faces, become boundaries.
    material : Material or dict of str to Material
        In units that fit the geometry's, SI unless all are chosen otherwise. A dict has one for each region: for each
        name of `mat` of an OCC shape's solids, which `Glue` joins, of a mesh's materials, or of a file's physical
        groups (Gmsh), solid sections (Abaqus), properties (Nastran) or numbers of materials. Default: the materials of
        an input deck, `*ELASTIC` and `*DENSITY`, MAT1, or MPDATA, in the deck's units; with scale=1e-3 those of a
        deck in millimetres become SI units. The log has their numbers.
    modulus : callable, optional
        Young's modulus by place, in place of the materials': called with the centres of the elements, (ne, 3), after
        scaling; returns (ne,) [Pa]. It is constant in an element.
    order : {1, 2, 3}, optional
        Linear elements with straight sides, or quadratic or cubic ones that follow the mesh's curvature. Default: 2, or
        that of a mesh file. Linear elements of a file bend too stiffly: raise them by order=2. The nodes that this
        adds follow those of the file, and lie on straight edges. Thin bodies need far fewer nodes with order 3
        (`validation/mesh/order.py`).
    maxh, refine, grading :
        For a shape or the file of one, see `generate_mesh`; in lengths after scaling. Where curved sides turn elements
        inside out, it is meshed again with smaller ones, as the log tells.
    scale : float
        Factor on all lengths of a shape or file: 1e-3 turns millimetres into metres.
    only_solids : bool
        Whether shells, beams, springs, masses and others beside the solid elements of an input deck are left out; the
        log names them. Default: such a deck is refused.
    solid : str, optional
        Which solid of a STEP file or of `ep.read_step` is meshed, by its name. Or which body of a mesh file or of
        `ep.read_bodies` is taken: by the name of an instance, part, element set, material, property or group, or of a
        connected piece. It stays where it is in the assembly.

    Returns
    -------
    FEModel

    Raises
    ------
    InputError
        If an argument is of the wrong kind or has no effect on this source, or a file cannot be read. A STEP file is
        first read in a child process, because a damaged one may crash it.
    MeshError
        If the mesh or shape is of several regions, which are named, and one material is given; if it is of several
        parts, or cannot be used.
    MemoryLimitError
        If mesh or matrices would not fit into the free memory, by an estimate before the work.
    MissingPackageError

    Warns
    -----
    UnitsWarning
        If no solid has this material, size and density give an unlikely frequency or mass, `maxh` is longer than the
        body, or a ball of `refine` misses it or has no effect.
    MeshQualityWarning
        If the mesh looks damaged, see `mesh_quality.warn_of_damage`, or its volume is off that of the shape by 5 %. Or
        if a file holds linear tetrahedra and no order is given.

    Notes
    -----
    Threads take turns, because NGSolve and Netgen allow one at a time.
    """
    try:
        plan = plan_model(
            source, material, modulus=modulus, order=order, maxh=maxh, refine=refine, grading=grading, scale=scale,
            only_solids=only_solids, solid=solid,
        )  # fmt: skip
        with ONE_AT_A_TIME:
            fem = _built(plan)
    except MemoryLimitError:
        raise
    except MemoryError as error:
        raise MemoryLimitError(
            "mesh: its matrices do not fit into memory. Take larger elements far from the contact, or order=1"
        ) from error
    _LOG.info("FE model: %d nodes, %d elements of order %d", fem.n_nodes, len(fem.cells), fem.order)
    _LOG.debug("FE model: %d entries in the stiffness, resolves %.4g Hz", fem.stiffness.nnz, fem.resolved_frequency)
    _warn_of_mesh(plan, fem)
    fem.warn_if_units_slipped()
    return fem


@spelled
def fe_models(
    assembly: StepAssembly | FileBodies,
    materials: Mapping[str, Material | Mapping[str, Material] | None],
    *,
    maxh: float | Mapping[str, float] | None = None,
    refine: Iterable[Refine] = (),
    order: int | None = None,
    grading: float = GRADING,
) -> dict[str, FEModel]:
    """Assemble FE models of several bodies of an assembly, each where it stands there.

    Parameters
    ----------
    assembly : StepAssembly or FileBodies
        Of `ep.read_step` or `ep.read_bodies`.
    materials : dict of str to Material, dict or None
        By the names of the bodies that are wanted, see `fe_model`; None is the material of an input deck. Others are
        left out, and the log says so.
    maxh : float or dict of str to float
        Of a STEP file: largest element size [m], the same for all or one for each name.
    refine : iterable of Refine
        Of a STEP file: balls with smaller elements, in the assembly's coordinates; each counts for the solids that it
        meets.
    order, grading :
        See `fe_model`.

    Returns
    -------
    dict of str to FEModel

    Raises
    ------
    InputError
        If a name is not in the assembly or has no size, two names have an element in common, or a ball meets no solid.
    MeshError, MemoryLimitError, MissingPackageError
        See `fe_model`.

    Warns
    -----
    UnitsWarning, MeshQualityWarning
        See `fe_model`.
    """
    if not isinstance(assembly, FileBodies):
        validate_type("assembly", assembly, StepAssembly, "ep.read_step() or ep.read_bodies()")
    if not isinstance(materials, Mapping) or not materials:
        raise InputError(f"materials: expected a dict {{name: Material}}, got {materials!r}")
    if isinstance(assembly, FileBodies):
        check_apart(assembly, [*materials])
        refuse_mesh_options(maxh, refine, grading)
        return {name: fe_model(assembly, given, order=order, solid=name) for name, given in materials.items()}
    shapes = {name: assembly.find(name) for name in materials}
    sizes = maxh if isinstance(maxh, Mapping) else dict.fromkeys(shapes, maxh)
    if set(sizes) != set(shapes):
        raise InputError(f"maxh: expected one for each of {', '.join(map(repr, shapes))}, got {sizes!r}")
    balls = _balls_by_solid(shapes, refine)
    beside = [name for name in assembly.names if name not in shapes]
    if beside:
        _LOG.info("%s: left out the solids %s", assembly.path, ", ".join(beside))
    return {
        name: fe_model(shape, materials[name], order=order, maxh=sizes[name], refine=balls[name], grading=grading)
        for name, shape in shapes.items()
    }


def _balls_by_solid(shapes: Mapping[str, Shape], refine: Iterable[Refine]) -> dict[str, list[Refine]]:
    """Balls that each solid meets."""
    balls: dict[str, list[Refine]] = {name: [] for name in shapes}
    for ball in regions_of(refine):
        met = [name for name, shape in shapes.items() if distances(shape, ball.center[None])[0] <= ball.radius]
        if not met:
            raise InputError(
                f"refine: the ball around {show(ball.center)} m meets none of {', '.join(map(repr, shapes))}"
            )
        for name in met:
            balls[name].append(ball)
    return balls


def _built(plan: ModelPlan) -> FEModel:
    """FE model of a plan, without inverted elements."""
    if isinstance(plan, ShapePlan):
        return _from_shape(plan)
    with pulsing("assemble"):
        ngsolve = require("ngsolve")
        if isinstance(plan, FilePlan):
            fem = _from_file(ngsolve, plan)
        else:
            fem = _from_mesh(ngsolve, plan.mesh, plan.given, plan.order)
    check_inside(fem)
    return fem


def _from_shape(plan: ShapePlan) -> FEModel:
    """FE model of a shape, which is meshed with ever smaller elements until none of them is inverted."""
    ngsolve = require("ngsolve")
    for finer in _FINER:
        mesh, unit = meshed(plan.shape, finer * plan.maxh, plan.refine, plan.grading, plan.order, CURVATURE / finer)
        try:
            with pulsing("assemble"):
                fem = _from_mesh(ngsolve, mesh, plan.given, plan.order, unit=unit)
            check_inside(fem)
        except InvertedElementsError as error:
            if finer == _FINER[-1]:
                raise
            _LOG.info("%s. It is meshed again with smaller elements", error)
        else:
            break
    return fem


def _warn_of_mesh(plan: ModelPlan, fem: FEModel) -> None:
    """Warn of a mesh that looks damaged, is too stiff, or has not the volume of its shape."""
    from_shape = isinstance(plan, ShapePlan)
    warn_of_damage(fem, meshed=from_shape)
    if plan.order != 1 and not (fem.order == 1 and fem.tetrahedral):  # of which `check_order` has warned
        warn_of_stiff_walls(fem, meshed=from_shape)
    if isinstance(plan, ShapePlan) and fem.order > 1:
        missed = fem.cell_volume.sum() / plan.shape.mass - 1
        if abs(missed) > _VOLUME_MISSED:
            warn(
                f"shape: its mesh has {missed:+.1%} of its volume, {plan.shape.mass:.4g} m3. Take smaller elements "
                "where it is curved; or is the shape damaged, such that faces miss each other?",
                MeshQualityWarning,
            )


def _from_mesh(
    ngsolve: NGSolve,
    mesh: NGSolveMesh,
    given: GivenMaterial,
    order: int,
    regions: CellRegions | None = None,
    unit: float = 1.0,
) -> FEModel:
    """FE model with NGSolve's own numbering: vertices, then edges; `unit` is the mesh's unit of length [m]."""
    if mesh.dim != 3 or {len(el.vertices) for el in mesh.Elements(ngsolve.VOL)} != {4}:
        raise MeshError("mesh: expected a three-dimensional mesh of tetrahedra")
    corners = mesh.ngmesh.Elements3D().NumPy()["nodes"][:, :4].astype(np.int64) - 1
    beside = mesh.nv - len(np.unique(corners))
    if beside:
        raise MeshError(
            f"mesh: {beside} of {mesh.nv} vertices belong to no tetrahedron, as those of free edges and faces beside a "
            "solid. Mesh the solids alone, occ.Compound(shape.solids), or give the shape itself"
        )
    curve_order = mesh.GetCurveOrder()
    if order > 1 and curve_order > order:
        raise MeshError(
            f"mesh: it is curved with order {curve_order}, expected at most {order}, that of the elements; "
            f"mesh.Curve({order})"
        )
    if order == 1:
        mesh.Curve(1)
    try:
        basis = NodalBasis(ngsolve, mesh, order)
        points = unit * _places(ngsolve, mesh, basis.numbers(corners), basis.to_hierarchical.shape[0])
        cells = basis.cells(corners, points)
        _check_volume(points, cells)
        if regions is None:
            number = mesh.ngmesh.Elements3D().NumPy()["index"].astype(np.int64) - 1
            regions = CellRegions("solids", tuple(mesh.GetMaterials()), number)
        elastic = given.on("mesh", regions, points[cells].mean(axis=1))
        fem = _assemble(ngsolve, mesh, elastic, points, cells, basis.to_hierarchical, unit=unit)
    finally:
        if order == 1:
            mesh.Curve(curve_order)
    elements = mesh.ngmesh.Elements2D().NumPy()
    triangles = elements["nodes"][:, :3].astype(np.int64) - 1
    names = np.array(mesh.GetBoundaries())[elements["index"] - 1]
    fem.boundaries.update(_boundaries(fem.facets, {str(name): triangles[names == name] for name in np.unique(names)}))
    return fem


def _places(ngsolve: NGSolve, mesh: NGSolveMesh, numbers: Array, n: int) -> Array:
    """Places of n nodes, (n, 3), by their numbers in each element, (ne, 4), (ne, 10) or (ne, 20)."""
    local = TET_NODES[numbers.shape[1]]
    # NGSolve's tetrahedron has its first three vertices at the ends of the axes.
    local = np.column_stack([1 - local.sum(axis=1), local[:, :2]])
    rule = ngsolve.IntegrationRule([tuple(x) for x in local.tolist()], [1.0] * len(local))
    at = mesh.MapToAllElements({ngsolve.ET.TET: rule}, ngsolve.VOL)
    points = np.zeros((n, 3))
    points[numbers] = ngsolve.CF((ngsolve.x, ngsolve.y, ngsolve.z))(at).reshape(*numbers.shape, 3)
    return points


def _check_volume(points: Array, cells: Array) -> None:
    """Refuse elements that curved sides turn inside out. NGSolve would integrate them with a positive volume."""
    ((kind, _),) = kinds_of(cells, False)
    bad = inverted(points, cells, kind)
    if len(bad):
        where = ", ".join(f"{x:.4g}" for x in points[cells[bad[0]]].mean(axis=0))
        raise InvertedElementsError(
            f"mesh: {len(bad)} of {len(cells)} elements are inverted or have no volume, the first at ({where}). Curved "
            "sides do that to elements that are too large for the curvature or the thickness of a wall: take a smaller "
            "maxh, or refine there"
        )


def _from_file(ngsolve: NGSolve, plan: FilePlan) -> FEModel:
    """FE model with the nodes of a mesh file in their order."""
    file = plan.file
    if plan.raised_to:
        mesh = _volume_mesh(ngsolve, file.points, file.cells)
        fem = _from_mesh(ngsolve, mesh, plan.given, plan.raised_to, file.regions)
    else:
        centres = centres_of(file.points, file.cells, file.hexahedra)
        elastic = plan.given.on(str(plan.path), file.regions, centres)
        if file.hexahedra:
            mesh, to_hierarchical = _mixed_mesh(ngsolve, file.points, file.cells)
        elif file.order == 2:
            mesh, to_hierarchical = _deformed_mesh(ngsolve, file.points, file.cells)
        else:
            mesh = _volume_mesh(ngsolve, file.points, file.cells)
            to_hierarchical = NodalBasis(ngsolve, mesh, 1).to_hierarchical
        fem = _assemble(ngsolve, mesh, elastic, file.points, file.cells, to_hierarchical, hexahedra=file.hexahedra)
    fem.boundaries.update(_boundaries(fem.facets, file.faces))
    return fem


def _volume_mesh(ngsolve: NGSolve, points: Array, *blocks: Array) -> NGSolveMesh:
    """`ngsolve.Mesh` of linear elements, by the corners of each kind, its vertices in the order of `points`."""
    mesh = require("netgen.meshing").Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(points))
    for cells in blocks:
        mesh.AddElements(dim=3, index=1, data=np.ascontiguousarray(cells, dtype=np.int32), base=0)
    return ngsolve.Mesh(mesh)


def _mixed_mesh(ngsolve: NGSolve, points: Array, cells: Array) -> tuple[NGSolveMesh, sp.csr_matrix]:
    """Mesh of hexahedra, wedges and others, kind by kind, whose nodes are `points`; see `to_coefficients`."""
    check_conforming(*faces_of(cells, True))
    kinds = [(kind, cells[rows][:, kind.columns]) for kind, rows in kinds_of(cells, True)]
    vertices = np.unique(np.concatenate([nodes[:, : kind.corners].ravel() for kind, nodes in kinds]))
    corners = [np.searchsorted(vertices, nodes[:, : kind.corners]) for kind, nodes in kinds]
    mesh = _volume_mesh(ngsolve, points[vertices], *corners)
    to_hierarchical = to_coefficients(ngsolve, mesh, kinds, len(points))
    offsets = np.zeros_like(points)
    for kind, nodes in kinds:
        middles = nodes[:, kind.corners :]
        offsets[middles] = points[middles] - points[nodes[:, kind.edges]].mean(axis=2)[:, : middles.shape[1]]
    _deform(ngsolve, mesh, to_hierarchical @ offsets, kinds[0][0].order)
    return mesh, to_hierarchical


def _deform(ngsolve: NGSolve, mesh: NGSolveMesh, coefficients: Array, order: int) -> None:
    """Move straight elements to their nodes; NGSolve curves elements only by a geometry."""
    deformation = ngsolve.GridFunction(ngsolve.VectorH1(mesh, order=order))
    deformation.vec.FV().NumPy()[:] = coefficients.T.ravel()
    mesh.SetDeformation(deformation)


def surplus_of(fem: FEModel) -> Surplus:
    """Functions of one order more on the elements of an FE model, and its matrices between them and the model's nodes.

    Raises
    ------
    MeshError
        If the elements are no tetrahedra.
    InputError
        If they are not known.
    MemoryLimitError
    MissingPackageError
    """
    fem.need_cells("the error of its mesh")
    if not fem.tetrahedral:
        raise MeshError("cells: expected tetrahedra; the error of a mesh of hexahedra is not estimated")
    ngsolve, order = require("ngsolve"), fem.order
    check_memory_of_model(int(_HIGHER[order] * fem.n_nodes), min(order + 1, 3))
    with ONE_AT_A_TIME:
        mesh, to_hierarchical = _deformed_mesh(ngsolve, fem.points, fem.cells)
        stiffness, mass = _forms(ngsolve, mesh, fem.elastic, order + 1, False, _pyramids(fem.cells, False))
        return Surplus(fem, ngsolve, mesh, to_hierarchical, _csr(stiffness.mat), _csr(mass.mat))


def _deformed_mesh(ngsolve: NGSolve, points: Array, cells: Array) -> tuple[NGSolveMesh, sp.csr_matrix]:
    """Mesh of tetrahedra whose nodes are `points`, and the matrix from values there to NGSolve's coefficients."""
    order = ORDERS[cells.shape[1]]
    vertices, corners = np.unique(cells[:, :4], return_inverse=True)
    corners = corners.reshape(-1, 4)
    mesh = _volume_mesh(ngsolve, points[vertices], corners)
    basis = NodalBasis(ngsolve, mesh, order)
    to_hierarchical = basis.to_hierarchical
    numbers = basis.numbers(corners)
    number_of = np.empty(len(points), dtype=np.int64)
    number_of[cells] = numbers
    if len(points) != to_hierarchical.shape[0] or (number_of[cells] != numbers).any():
        raise MeshError(
            f"mesh: {len(basis.edges)} edges have {len(points) - mesh.nv} mid-side nodes, expected one each that all "
            "elements on an edge share. Merge coincident nodes or mesh anew"
        )
    to_hierarchical = to_hierarchical[:, number_of]
    local = TET_NODES[cells.shape[1]][4:]
    straight = np.column_stack([1 - local.sum(axis=1), local]) @ points[cells[:, :4]]
    offsets = np.zeros_like(points)
    offsets[cells[:, 4:]] = points[cells[:, 4:]] - straight
    _deform(ngsolve, mesh, to_hierarchical @ offsets, order)
    return mesh, to_hierarchical


def _assemble(
    ngsolve: NGSolve,
    mesh: NGSolveMesh,
    elastic: Material | Regions,
    points: Array,
    cells: Array,
    to_hierarchical: sp.csr_matrix,
    *,
    hexahedra: bool = False,
    unit: float = 1.0,
) -> FEModel:
    """Assemble by NGSolve, in the mesh's unit of length [m]; change from its hierarchical basis to nodal values."""
    order = 2 if hexahedra and cells.shape[1] == 20 else ORDERS[cells.shape[1]]
    check_memory_of_model(to_hierarchical.shape[0], order)
    pyramids = _pyramids(cells, hexahedra)
    stiffness, mass = _forms(ngsolve, mesh, elastic, order, hexahedra, pyramids)
    if hexahedra:  # NGSolve moves the tips of pyramids a little
        volume = integrals(points, cells, True)[0]
    else:
        with _threads(ngsolve, len(points)):
            degree = _degree_of_volume(order, hexahedra)
            volume = np.array(ngsolve.Integrate(ngsolve.CF(1), mesh, ngsolve.VOL, degree, element_wise=True))
        volume *= unit**3
    change = sp.kron(to_hierarchical, sp.identity(3), format="csr")
    back, back_scalar = change.T.tocsr(), to_hierarchical.T.tocsr()  # products of rows with rows need no conversion
    of_one = back_scalar @ (_csr(mass.mat) @ to_hierarchical)
    if len(pyramids):
        of_one = of_one + _mass_of_pyramids(points, cells, pyramids, elastic.rho)
    return FEModel(
        points=points,
        cells=cells,
        mass=sp.kron(_symmetric(of_one), unit**3 * sp.identity(3), "csr"),
        stiffness=unit * _symmetric(back @ (_csr(stiffness.mat) @ change)),
        cell_mass=elastic.rho * volume,
        material=elastic.largest(volume) if isinstance(elastic, Regions) else elastic,
        boundaries={},
        regions=elastic if isinstance(elastic, Regions) else None,
        hexahedra=hexahedra,
    )


def _forms(
    ngsolve: NGSolve, mesh: NGSolveMesh, elastic: Material | Regions, order: int, hexahedra: bool, pyramids: Array
) -> tuple[NGSolveObject, NGSolveObject]:
    """Stiffness of a vector, dofs xyz interleaved, and mass of one component, in NGSolve's basis.

    The mass is exact, also of tapered and curved elements. That of pyramids, rows of cells, is left out: NGSolve moves
    their tips, by which it has a relative error of some 1e-10.
    """
    u, v = ngsolve.H1(mesh, order=order, dim=3).TnT()  # a VectorH1 has the same matrix, but takes longer
    scalar = ngsolve.H1(mesh, order=order)
    p, q = scalar.TnT()

    def by_element(value: float | Array) -> float | NGSolveObject:
        if isinstance(value, float):
            return value
        constants = ngsolve.GridFunction(ngsolve.L2(mesh, order=0))  # one number an element
        constants.vec.FV().NumPy()[:] = value
        return constants

    density = elastic.rho
    if len(pyramids):
        density = np.broadcast_to(density, mesh.ne).copy()
        density[pyramids] = 0.0
    shear, lame, density = map(by_element, (elastic.shear_modulus, elastic.lame, density))
    beyond = _degree_of_volume(order, hexahedra)  # NGSolve integrates as if all elements had straight, parallel sides
    with _threads(ngsolve, scalar.ndof):
        grad = ngsolve.Grad(u)  # alone: div(u) beside it would cost half as much again
        stress = 2 * shear * ngsolve.Sym(grad) + lame * ngsolve.Trace(grad) * ngsolve.Id(3)
        stiffness = ngsolve.BilinearForm(ngsolve.InnerProduct(stress, ngsolve.Grad(v)) * ngsolve.dx).Assemble()
        mass = ngsolve.BilinearForm(density * p * q * ngsolve.dx(bonus_intorder=beyond)).Assemble()
    return stiffness, mass


def _pyramids(cells: Array, hexahedra: bool) -> Array:
    """Rows of cells that are pyramids."""
    return next((rows for kind, rows in kinds_of(cells, hexahedra) if kind.corners == 5), np.zeros(0, dtype=int))


def _mass_of_pyramids(points: Array, cells: Array, pyramids: Array, density: float | Array) -> sp.csr_matrix:
    """Mass of one component of pyramids, rows of cells, by nodes, (n, n), of points in metres."""
    kind, n = next((kind for kind, _ in kinds_of(cells[pyramids], True))), len(points)
    density = np.broadcast_to(density, len(cells))[pyramids]
    rows, mass = cells[pyramids][:, kind.columns], sp.csr_matrix((n, n))
    for some in np.array_split(np.arange(len(rows)), len(rows) // _AT_ONCE + 1):
        own = density[some, None, None] * kind.masses(points[rows[some]])
        at = np.broadcast_to(rows[some, :, None], own.shape)
        mass += sp.csr_matrix((own.ravel(), (at.ravel(), np.swapaxes(at, 1, 2).ravel())), shape=(n, n))
    return mass


def _degree_of_volume(order: int, hexahedra: bool) -> int:
    """Degree of the Jacobian's determinant: in all coordinates of tetrahedra, in each coordinate of hexahedra."""
    return 3 * order - 1 if hexahedra else 3 * order - 3


def _threads(ngsolve: NGSolve, nodes: int) -> contextlib.AbstractContextManager[object]:
    """NGSolve's threads, for models that are worth them, unless other work has the other cores."""
    return ngsolve.TaskManager() if nodes >= _THREADS_FROM and alone() else contextlib.nullcontext()


def _boundaries(facets: Array, faces: dict[str, Array]) -> dict[str, Array]:
    """Rows of `facets` on each named boundary, whose faces are given by their corner nodes."""
    if not faces:
        return {}
    keys = np.vstack([corner_keys(facets), *map(corner_keys, faces.values())])
    number = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    of_facets, *of_faces = (number[part] for part in consecutive([len(facets), *map(len, faces.values())]))
    return {name: np.flatnonzero(np.isin(of_facets, named)) for name, named in zip(faces, of_faces, strict=True)}


def _csr(matrix: NGSolveObject) -> sp.csr_matrix:
    """NGSolve's matrix, of numbers or of blocks of 3 by 3; one of numbers is a view, as long as that is there."""
    values, columns, starts = (np.asarray(part) for part in matrix.CSR())
    if len(values) == len(columns):
        return sp.csr_matrix((values, columns, starts), shape=(matrix.height, matrix.width))
    return sp.bsr_matrix((values.reshape(-1, 3, 3), columns, starts)).tocsr()


def _symmetric(matrix: sp.spmatrix) -> sp.csr_matrix:
    """Remove the round-off asymmetry of a triple product."""
    turned = matrix.T.tocsr()  # whose columns are in order, as sums need them
    result = turned + turned.T.tocsr()
    result.data *= 0.5
    return result
