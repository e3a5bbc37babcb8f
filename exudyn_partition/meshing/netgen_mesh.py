"""Tetrahedral meshes of OCC shapes and STEP files, by Netgen; this module and `ngsolve_fem` alone import it."""

from __future__ import annotations

import contextlib
import logging
import pickle
import shutil
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import InputError, MeshError, UnitsWarning
from ..fe.patch_facets import show
from ..fe.places import distance_within
from ..support.arrays import Array
from ..support.checks import listed, validate_file, validate_number, validate_path, validate_positive
from ..support.foreign import NGSolveMesh, Shape, ShapeAssembly, ShapeSurface
from ..support.machine import alone
from ..support.optional import require
from ..support.progress import pulsing
from ..support.spelling import spelled
from ..support.warn import warn
from .mesh_size import Refine, SurfaceSizes, check_memory_of_mesh, check_sizes
from .step_files import ENDINGS, check_readable, kind_of, solids_said
from .trials import failure

_LOG = logging.getLogger(__name__)

_SHARP = np.sin(np.radians(44.0))  # sine of a cone's half angle, below which Netgen fails at the tip
GRADING = 0.3
CURVATURE = 2.0  # elements in a radius of curvature
_OWN_SCALE = (1e-3, 1e4)  # sizes [m] of bodies for which Netgen's tolerances, which are lengths, are meant
_OF_NETGEN = (".step", ".stp", ".iges", ".brep")  # endings that it knows, in small letters alone
_GAP = 1e-5  # of the size of a shape, within which faces of a file belong together
_LOOKS = 2000  # places all over a surface at which the mesher's sizes are asked for
_SCALED_COPY = 2.0  # factor of a shape that shares nothing with the one it is made of
_NO_SIZE = 1e98  # of elements on a face that was given none
_SCALES = (1e-9, 1e9)  # beyond these, OCC raises errors of its own, or crashes
_TRIAL = """
import pickle, sys, ngsolve
from netgen.meshing import MeshingParameters
geometry, options, sizes = pickle.load(sys.stdin.buffer)
parameters = MeshingParameters(**options)
for x, y, z, h in sizes:
    parameters.RestrictH(x=x, y=y, z=z, h=h)
ngsolve.Mesh(geometry.GenerateMesh(mp=parameters)).Curve(2)
"""
_GRADINGS = (0.05, 1.0)  # below these, Netgen forgets local sizes or crashes; above, it does not end

# Threads wait by spinning. Where other processes want the cores too, they make a small mesh much slower. The mesh is
# the same with and without them.
_MANY = 30_000  # elements, from which Netgen's threads always pay
_SOME = 5_000  # elements, from which NGSolve's threads pay, if nothing else runs

# NGSolve and Netgen keep global state: two threads that mesh or assemble at once crash or mix up their results.
ONE_AT_A_TIME = threading.RLock()


@spelled
def generate_mesh(shape: Shape, *, maxh: float, refine: Iterable[Refine] = (), grading: float = GRADING) -> NGSolveMesh:
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
        How fast elements grow away from them, 0.05 (slowly) to 1.

    Returns
    -------
    ngsolve.Mesh
        Elements curved to the geometry with order 2.

    Raises
    ------
    InputError
        If the shape is no OCC shape or has no finite size, a size is not above zero, `grading` is out of range, or a
        ball takes more elements than memory holds.
    MeshError
        If the shape has no solid, or Netgen cannot mesh it with this size.
    MemoryLimitError
        If the mesh would not fit into the memory that is free, before it is begun.
    MissingPackageError
        If ngsolve is not installed.

    Warns
    -----
    UnitsWarning
        If `maxh` is longer than the body, or a ball misses it or has no effect.
    """
    with ONE_AT_A_TIME:
        return in_metres(shape, *meshed(shape, maxh, refine, grading, 1), 2)


def in_metres(shape: Shape, mesh: NGSolveMesh, unit: float, order: int) -> NGSolveMesh:
    """Mesh that `meshed` made of a shape, in metres, curved with some order."""
    if unit != 1:
        mesh.ngmesh.Scale(unit)
        mesh.ngmesh.SetGeometry(require("netgen.occ").OCCGeometry(solids_alone(shape)))
        mesh = require("ngsolve").Mesh(mesh.ngmesh)
    if unit != 1 or mesh.GetCurveOrder() != order:
        mesh.Curve(order)
    return mesh


def volume_of(mesh: NGSolveMesh) -> float:
    """Volume of a mesh, whose sides may be curved [m3]."""
    ngsolve = require("ngsolve")
    with ONE_AT_A_TIME:
        return float(ngsolve.Integrate(ngsolve.CF(1), mesh))


def meshed(
    shape: Shape, maxh: object, refine: object, grading: object, order: int, curvature: float = CURVATURE
) -> tuple[NGSolveMesh, float]:
    """Do the work of `generate_mesh`, also for `fe_model`, of some order; warnings name the line that called either.

    Returns
    -------
    ngsolve.Mesh
    float
        Its unit of length [m]: the size of the body, if it is so small or large that Netgen and OCC would fail.
    """
    ngsolve, occ, meshing = require("ngsolve"), require("netgen.occ"), require("netgen.meshing")
    maxh, grading = validate_positive("maxh", maxh, "m"), validate_number("grading", grading)
    if not _GRADINGS[0] <= grading <= _GRADINGS[1]:
        raise InputError(f"grading: expected {_GRADINGS[0]} (slow) to {_GRADINGS[1]:g} (fast), got {grading:g}")
    if not isinstance(shape, occ.TopoDS_Shape):
        raise InputError(f"shape: expected an OCC shape of netgen.occ, got {type(shape).__name__}")
    shape, regions = solids_alone(shape), regions_of(refine)
    if not np.isfinite([[v.p.x, v.p.y, v.p.z] for v in shape.vertices]).all():  # OCC crashes on some of these
        raise InputError("shape: expected a body of finite size, got corners that are not finite")
    low, high = (np.array([p.x, p.y, p.z]) for p in shape.bounding_box)
    size = check_sizes(low, high, maxh, regions)
    tip = _sharp_tip(shape, size)
    unit = 1.0 if _OWN_SCALE[0] <= size <= _OWN_SCALE[1] else float(np.clip(size, *_SCALES))
    options = {"maxh": maxh / unit, "grading": grading, "curvaturesafety": curvature}
    _, volume, surface = measured(shape)
    at_surface = partial(_surface_sizes, shape, unit, maxh, grading, curvature)
    elements = check_memory_of_mesh(size, volume, surface, maxh, regions, grading, order, at_surface)
    geometry = occ.OCCGeometry(scaled(shape, 1 / unit))
    sizes = [(x / unit, y / unit, z / unit, region.h / unit) for region in regions for x, y, z in region.points()]
    if tip:
        _try_tip(tip, maxh, pickle.dumps((geometry, options, sizes)))
    parameters = meshing.MeshingParameters(**options, parallel_meshing=elements > _MANY)
    for x, y, z, h in sizes:
        parameters.RestrictH(x=x, y=y, z=z, h=h)
    try:
        threads = ngsolve.TaskManager() if elements > _SOME and alone() else contextlib.nullcontext()
        with pulsing("mesh"), threads:
            mesh = ngsolve.Mesh(geometry.GenerateMesh(mp=parameters))
    except (meshing.NgException, RuntimeError) as error:  # OCC raises the latter
        raise MeshError(
            f"shape: Netgen could not mesh it with maxh={maxh:.4g} m ({error}). Take a smaller maxh; walls need "
            "elements not much larger than they are thick"
        ) from error
    vertices = unit * np.array(mesh.ngmesh.Coordinates())
    for region in regions:
        distance = distance_within(vertices, region.center, region.radius, region.long_axis).min()
        if distance > region.radius + region.h:
            warn(
                f"refine: the ball of radius {region.radius:g} m at {tuple(map(float, region.center))} misses the "
                f"body, of {size:.4g} m, by {distance - region.radius:.3g} m. Give its centre in the shape's own "
                "coordinates and unit, metres",
                UnitsWarning,
            )
    mesh.Curve(max(order, 2))
    _LOG.info(
        "mesh: %d elements, %d vertices, elements up to %.4g m, finer in %d balls", mesh.ne, mesh.nv, maxh, len(regions)
    )
    return mesh, unit


def measured(shape: Shape) -> tuple[float, float, float]:
    """Diagonal [m], volume [m3] and surface [m2] of a shape."""
    low, high = (np.array([*corner]) for corner in shape.bounding_box)
    return float(np.linalg.norm(high - low)), float(abs(shape.mass)), float(sum(face.mass for face in shape.faces))


def _surface_sizes(shape: Shape, unit: float, maxh: float, grading: float, curvature: float) -> SurfaceSizes | None:
    """Sizes of elements at a surface, as Netgen finds them before it meshes; None if it does not tell."""
    occ, meshing = require("netgen.occ"), require("netgen.meshing")
    # A copy, for a shape that Netgen has looked at once gets another mesh. Only a scaled shape is one.
    unit /= _SCALED_COPY
    geometry = occ.OCCGeometry(scaled(shape, 1 / unit))
    try:
        parameters = meshing.MeshingParameters(maxh=maxh / unit, grading=grading, curvaturesafety=curvature)
        field = geometry.GenerateMesh(mp=parameters, perfstepsend=meshing.MeshingStep.MESHEDGES).GetLocalH(1)
        corners = np.array(geometry._visualizationData()["vertices"], float).reshape(-1, 3, 3)
    except (meshing.NgException, RuntimeError, AttributeError, KeyError):  # the mesh itself will tell what is wrong
        return None
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # Triangles that draw the surface: each is asked once, long ones at many places.
    times = np.ceil(_LOOKS * area / max(area.sum(), 1e-300)).astype(int)
    triangle = np.repeat(np.arange(len(area)), times)
    a, b = np.sort(np.random.default_rng(0).random((2, len(triangle))), axis=0)
    places = corners[triangle, 0] + a[:, None] * sides[triangle, 0] + (b - a)[:, None] * sides[triangle, 1]
    sizes = np.array([field.GetH(meshing.Pnt(*place)) for place in places.tolist()])
    areas = area[triangle] / times[triangle]
    if not len(sizes) or not (sizes > 0).all():
        return None
    return SurfaceSizes(unit * places, unit**2 * areas, np.minimum(unit * sizes, maxh))


def _sharp_tip(shape: Shape, size: float) -> str:
    """Say where the tip of a sharp cone is, on which Netgen may fail after it has damaged memory; blank if nowhere.

    A cone is a surface whose straight lines, along its second parameter, meet in one point.
    """
    for face in shape.faces:
        surface = face.surf
        (_, along_0, line_0), (_, along_1, line_1) = (_derivatives(surface, v) for v in (0.0, 1.0))
        widening = (np.linalg.norm(along_1) - np.linalg.norm(along_0)) / max(float(np.linalg.norm(line_0)), 1e-300)
        if not np.allclose(line_0, line_1, atol=1e-9 * size) or not 1e-6 < abs(widening) < _SHARP:
            continue
        v = -np.linalg.norm(along_0) / (np.linalg.norm(along_1) - np.linalg.norm(along_0))
        tip, beside = (np.array([*surface.Value(u, v)]) for u in (0.0, 1.0))
        corners = np.array([[*vertex.p] for vertex in face.vertices])
        if np.linalg.norm(tip - beside) < 1e-9 * size and np.linalg.norm(corners - tip, axis=1).min() < 1e-6 * size:
            half_angle = np.degrees(np.arcsin(abs(widening)))
            return f"the cone with its tip at {tip} m is sharp, its half angle {half_angle:.3g} degrees"
    return ""


def _try_tip(said: str, maxh: float, given: bytes) -> None:
    """Mesh a shape with a sharp tip in a child process; MeshError if Netgen fails there."""
    reason = failure(_TRIAL, given=given) if sys.executable else "it is not tried inside another program"
    if reason:
        raise MeshError(
            f"shape: {said}. Netgen fails on it with maxh={maxh:.4g} m ({reason}), as on many tips below 45 degrees. "
            "Take another maxh; round the tip, or cut it off where it is a few elements wide; or bring a mesh file"
        )
    _LOG.info("shape: %s; a trial in a child process has meshed it", said)


def _derivatives(surface: ShapeSurface, v: float) -> list[Array]:
    """Place on a surface at (0, v), and its derivatives by both parameters."""
    return [np.array([x.x, x.y, x.z]) for x in surface.D1(0.0, v)]


def surface_triangles(shape: Shape, maxh: float) -> tuple[Array, Array]:
    """Corners, (n, 3) [m], and triangles, (m, 3), of the surface of a shape; see `generate_mesh`."""
    mesh = generate_mesh(shape, maxh=maxh).ngmesh
    triangles = [[vertex.nr - 1 for vertex in element.vertices] for element in mesh.Elements2D()]
    return np.array(mesh.Coordinates()), np.array(triangles)


def regions_of(refine: object) -> list[Refine]:
    """Balls of an option `refine`, one or several."""
    regions = [refine] if isinstance(refine, Refine) else listed(refine)
    regions = [refine] if regions is None else regions
    balls = [region for region in regions if isinstance(region, Refine)]
    if len(balls) < len(regions):
        wrong = next(region for region in regions if not isinstance(region, Refine))
        raise InputError(f"refine: expected ep.Refine(center, radius, h) for each ball, got {wrong!r}")
    return balls


def step_shape(path: Path, name: str = "source") -> Shape:
    """OCC shape of a file, of STEP with all its root products.

    Raises
    ------
    InputError
        If Netgen cannot read it.
    MeshError
        If it reads fewer solids than the file defines.
    """
    shape, products = _read_step(path, name)
    # Netgen's shape is that of the first root alone.
    alone = sum(len(part.solids) for _, part in products) <= len(shape.solids)
    return shape if alone else require("netgen.occ").Compound([part for _, part in products])


def products_of(path: Path, name: str = "source") -> list[tuple[str, Shape]]:
    """Names and shapes, in place, of the products of a STEP file that have solids; raises as `step_shape`.

    Raises
    ------
    MeshError
        If there is no solid.
    """
    shape, products = _read_step(path, name)
    solid_products = [(product, part) for product, part in products if len(part.solids)]
    if sum(len(part.solids) for _, part in solid_products) < len(shape.solids):
        solid_products = [("", shape)]
    if not solid_products:
        solids_alone(shape, name)  # raises
    return solid_products


def _read_step(path: Path, name: str) -> tuple[Shape, list[tuple[str, Shape]]]:
    """Netgen's shape of a file, and the names and shapes of the products of a STEP file."""
    occ = require("netgen.occ")
    validate_file(name, path)
    kind = kind_of(path)
    with tempfile.TemporaryDirectory() as folder:
        if path.suffix not in _OF_NETGEN:
            path = Path(shutil.copy(path, (Path(folder) / path.name).with_suffix(f".{kind.lower()}")))
        check_readable(path, name)
        geometry, said = occ.OCCGeometry(str(path)), solids_said(path)
    if kind != "STEP":
        return _sewn(geometry.shape), []
    shape, products = geometry.shape, list(_products(geometry.GetAssemblyTree()))
    read = max(len(shape.solids), sum(len(part.solids) for _, part in products))
    if read < said:
        raise MeshError(
            f"{name}: {path} defines {said} solids, of which Netgen reads {read}. Are the others damaged, "
            "or of no product? Export the body that you need as a file of its own"
        )
    return shape, products


def _sewn(shape: Shape) -> Shape:
    """Solids within the faces of a shape that has none, as files of IGES often; the shape, if they enclose none."""
    occ = require("netgen.occ")
    if len(shape.solids) or not len(shape.faces):
        return shape
    low, high = (np.array([*corner]) for corner in shape.bounding_box)
    gap = _GAP * float(np.linalg.norm(high - low))
    shells = list(occ.Sew(list(shape.faces), gap).shells)
    solids = [occ.Solid(shell) for shell in shells if _is_closed(shell, gap)]
    if not solids:
        return shape
    if len(solids) < len(shells):
        _LOG.info("shape: left out %d surfaces that enclose no volume", len(shells) - len(solids))
    return occ.Compound([solid if solid.mass > 0 else solid.Reversed() for solid in solids])


def _is_closed(shell: Shape, gap: float) -> bool:
    """Whether each edge of a shell that is longer than a gap is between two faces, or on the seam of one."""
    count = Counter(edge for face in shell.faces for edge in face.edges)
    return all(number > 1 or edge.mass <= gap for edge, number in count.items())


def _products(node: ShapeAssembly | None) -> Iterator[tuple[str, Shape]]:
    """Names and shapes of all parts of an assembly, in place."""
    if node is not None and node.is_assembly:
        for child in node.children:
            yield from _products(child)
    elif node is not None:
        yield node.name.strip(), node.shape


def is_shape(value: object) -> bool:
    """Whether something is an OCC shape."""
    return isinstance(value, require("netgen.occ").TopoDS_Shape)


def is_mesh(value: object) -> bool:
    """Whether something is a mesh of NGSolve."""
    return isinstance(value, require("ngsolve").Mesh)


def center_of(shape: Shape) -> Array:
    """Centre of volume, (3,) [m]."""
    return np.array([*shape.center])


def solids_alone(shape: Shape, name: str = "shape") -> Shape:
    """Shape without edges and faces of no solid, such as sketches that CAD exports beside it.

    Raises
    ------
    MeshError
        If it has no solid.
    """
    solids = shape.solids
    if not len(solids):
        raise MeshError(f"{name}: expected a solid, got none: its faces enclose no volume, or some are missing")
    alone = require("netgen.occ").Compound(solids)
    beside = [
        f"{many - few} {kind}"
        for kind in ("faces", "edges", "vertices")
        if (many := len(set(getattr(shape, kind)))) > (few := len(set(getattr(alone, kind))))
    ]
    if not beside:
        return shape
    _LOG.info("%s: left out %s that belong to no solid", name, ", ".join(beside))
    return alone


def check_one_part(shape: Shape) -> None:
    """Refuse a shape of several parts before it is meshed.

    Raises
    ------
    MeshError
        If not all solids hang together through faces that they share.
    """
    solids = list(shape.solids)
    number = {face: i for i, face in enumerate(dict.fromkeys(face for solid in solids for face in solid.faces))}
    owners = [(i, number[face]) for i, solid in enumerate(solids) for face in solid.faces]
    of = sp.csr_matrix((np.ones(len(owners)), tuple(np.transpose(owners))), shape=(len(solids), len(number)))
    parts, part = connected_components(of @ of.T, directed=False)
    if parts > 1:
        first = [
            f"{i}{f' {solid.name!r}' if solid.name else ''} around {show(center_of(solid))}"
            for i, solid in enumerate(solids)
            if part[i] not in part[:i]
        ]
        listed = ", ".join(first[:8]) + (", ..." if parts > 8 else "")
        raise MeshError(
            f"shape: expected one connected body, got {parts} parts that share no face, of {len(solids)} solids: "
            f"solid {listed}. Make an FE model of each body, shape.solids[i], and connect them in Exudyn; or join "
            "those that touch, occ.Glue(shape.solids)"
        )


def scaled(shape: Shape, scale: float) -> Shape:
    """Shape with all lengths times a factor."""
    if not _SCALES[0] <= scale <= _SCALES[1]:
        raise InputError(
            f"scale: expected {_SCALES[0]:g} to {_SCALES[1]:g}, such as 1e-3 for millimetres, got {scale:g}"
        )
    if scale == 1:
        return shape
    larger = shape.Scale(require("netgen.occ").Pnt(0, 0, 0), scale)
    for kind in ("solids", "faces", "edges", "vertices"):  # which keep the sizes of elements that they were given
        for part in set(getattr(larger, kind)):
            if part.maxh < _NO_SIZE:
                part.maxh *= scale
    return larger


def shape_of(source: Shape | str | Path, scale: float, name: str = "source") -> Shape:
    """OCC shape, also of a STEP file, with all lengths times `scale`.

    Raises
    ------
    InputError
        If it is neither a shape nor a STEP file.
    MeshError
        If it has no solid.
    """
    if not isinstance(source, require("netgen.occ").TopoDS_Shape):
        if not isinstance(source, str | Path):
            raise InputError(
                f"{name}: expected an OCC shape of netgen.occ or the path of a file of STEP, IGES or BREP, got "
                f"{type(source).__name__}"
            )
        path = validate_path(name, source)
        if path.suffix.lower() not in ENDINGS:
            raise InputError(f"{name}: expected a file of STEP, IGES or BREP ({', '.join(ENDINGS)}), got {path}")
        source = step_shape(path, name)
    return scaled(solids_alone(source, name), scale)


def distances(shape: Shape, points: Array) -> Array:
    """Distances of points, (k, 3) [m], from the surface of a shape, (k,) [m], never negative."""
    occ = require("netgen.occ")
    vertices = [occ.Vertex(occ.Pnt(*map(float, point))) for point in points]
    return np.array([min(face.Distance(vertex) for face in shape.faces) for vertex in vertices])


def depths(shape: Shape, starts: Array, way: Array, length: float) -> Array:
    """Depths at which lines enter a shape, (k,) [m]; nan for those that miss it.

    Parameters
    ----------
    shape : netgen.occ.TopoDS_Shape
    starts : (k, 3) array
        [m]
    way : (3,) array
        Unit vector along the lines.
    length : float
        Of the lines [m].
    """
    occ = require("netgen.occ")
    depth = np.full(len(starts), np.nan)
    for i, start in enumerate(starts):
        ends = (occ.Pnt(*map(float, end)) for end in (start, start + length * way))
        inside = [np.array([v.p.x, v.p.y, v.p.z]) for edge in (occ.Segment(*ends) * shape).edges for v in edge.vertices]
        if inside:
            depth[i] = ((np.array(inside) - start) @ way).min()
    return depth


def share_of_cube(shape: Shape, center: Array, side: float) -> tuple[float, Array]:
    """Share of a cube's volume that lies within a shape, and the middle of that share, (3,) [m]."""
    occ = require("netgen.occ")
    middle = occ.Pnt(*map(float, center))
    low, high = (occ.Pnt(*map(float, center + sign * side / 2)) for sign in (-1, 1))
    # Turned, because cuts are less safe where faces coincide.
    part = shape * occ.Box(low, high).Rotate(occ.Axis(middle, occ.Dir(0.31, 0.53, 0.79)), 41.0)
    middle = part.center
    return part.mass / side**3, np.array([middle.x, middle.y, middle.z])
