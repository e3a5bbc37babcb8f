"""Mesh files through meshio: points, cells and named faces in the file's own numbering, checked."""

from __future__ import annotations

import contextlib
import io
import logging
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from ..errors import InputError, InvertedElementsError, MeshError, MeshQualityWarning, MissingPackageError
from ..fe.elements import HEXAHEDRA, Kind, faces_of, kinds_named, kinds_of, rows_of_cells
from ..fe.facets import check_connected, check_neighbours, parts_of
from ..support.arrays import Array, consecutive
from ..support.checks import read_only, validate_array, validate_file, validate_flag, validate_path, validate_positive
from ..support.foreign import Meshio, MeshioMesh
from ..support.optional import require
from ..support.plugins import plugin
from ..support.warn import warn
from .abaqus_decks import read_abaqus
from .ansys_decks import ENDINGS as ANSYS
from .ansys_decks import read_ansys
from .collapsed import as_they_are, with_middles
from .deck_materials import DeckMaterial
from .file_bodies import FileBodies, check_one_body, elements_named, listed_names
from .file_mesh import FACE_CORNERS, CellRegions, FileMesh, Origins, refuse_regions
from .gmsh_files import for_meshio
from .med_files import write_mesh_alone
from .mesh_counts import counts_said
from .nastran_decks import ENDINGS, is_bulk_data, read_nastran
from .netgen_mesh import ONE_AT_A_TIME
from .regions import families_of, groups_of, names_of_families, regions_of, tags_of_cells
from .universal_files import ENDINGS as UNIVERSAL
from .universal_files import read_universal

_LOG = logging.getLogger(__name__)

Said = Callable[[int], str]  # names an element of a kind by its row
DECKS = (".inp", *ENDINGS, *ANSYS)  # endings of input decks, which have materials
WITH_OTHERS = (*DECKS, *UNIVERSAL)  # of files that may hold springs, masses and others beside the solid elements

# What to do with files that nobody reads here, by their endings.
_NO_READER = {
    ".k .key .dyn": "LS-PrePost writes an LS-DYNA model as a deck of Nastran or Abaqus",
    ".odb .frd .op2 .f06": "It has results; give the input deck, .inp or .bdf",
    ".db .rst": "Write the mesh in Ansys by CDWRITE, which makes a .cdb",
    ".mphtxt .mphbin .mph": "COMSOL exports the mesh as a deck of Nastran",
    ".hm .rad": "HyperMesh exports the mesh as a deck of Abaqus, Nastran or OptiStruct",
    ".mail .mgib .sauv": "Code_Aster reads it by LIRE_MAILLAGE or PRE_GIBI, and writes MED by IMPR_RESU",
    ".x_t .x_b .sat .sab .sldprt .sldasm .catpart .catproduct .ipt .iam .prt .jt .3dm .fcstd .scdoc":
        "Export the shape as STEP from the CAD program, or from FreeCAD",
}  # fmt: skip

_ORDERS = ({"tetra", "hexahedron", "wedge", "pyramid"}, {"tetra10", "hexahedron20", "wedge15", "pyramid13"})
# Corners of an element in the order that mirrors it, by their number.
_MIRRORED = {4: [1, 0, 2, 3], 5: [0, 3, 2, 1, 4], 6: [3, 4, 5, 0, 1, 2], 8: [4, 5, 6, 7, 0, 1, 2, 3]}
_NO_VOLUME = 1e-10  # six times the volume of an element, by the cube of its extent, below which it is round-off


@dataclass(frozen=True, eq=False)
class VolumeMesh:
    """Points and volume elements of a mesh file, all of one order.

    Parameters
    ----------
    points : (n, 3) array
        Nodal positions in the file's order, times the scale.
    cells : (ne, 4), (ne, 10), (ne, 8) or (ne, 20) int array
        Tetrahedra or hexahedra, in VTK order with positive volume; see `fe.elements` for wedges and pyramids.
    faces : dict of str to (k, 3) or (k, 4) int array
        Corner nodes of the faces that the file names; the fourth of a triangle among quadrilaterals is its third.
    regions : CellRegions
    hexahedra : bool
        Whether rows of `cells` are those of hexahedra.
    materials : dict of str to DeckMaterial
        Of a deck, by the names of the regions.
    """

    points: Array
    cells: Array
    faces: dict[str, Array]
    regions: CellRegions
    hexahedra: bool
    materials: dict[str, DeckMaterial]

    def __post_init__(self) -> None:
        read_only(self.points, self.cells, *self.faces.values())

    @property
    def order(self) -> int:
        """Polynomial order of the elements, 1 or 2."""
        return 1 if self.cells.shape[1] in (4, 8) else 2


def read_bodies(source: str | Path, *, scale: float = 1.0, only_solids: bool = False) -> FileBodies:
    """Read a mesh file and tell what bodies it holds, before a model is made of any.

    Decks of Abaqus, CalculiX and Nastran are read by own readers, other formats by meshio. Surface elements are used
    only to name boundaries (physical groups of Gmsh, element sets of Abaqus). So are Abaqus' surfaces, and sets of
    nodes: these name the faces of elements whose corners they have.

    Parameters
    ----------
    source : str or Path
        A deck, or a mesh of Gmsh, VTK, MED or another program.
    scale : float
        Factor on all lengths: 1e-3 turns millimetres into metres.
    only_solids : bool
        Whether shells, beams, masses and others in a deck are left out.

    Returns
    -------
    FileBodies
        `print` lists the bodies, other names of elements, and what is tied or touches.

    Raises
    ------
    InputError
        If there is no such file, or it cannot be read.
    MeshError
        If the file has no volume elements, or others than linear or quadratic tetrahedra, hexahedra, wedges and
        pyramids; or if not all of it is read.
    MissingPackageError
        If meshio, or what it needs for this format, is not installed.
    """
    path, scale = validate_path("source", source), validate_positive("scale", scale)
    validate_flag("only_solids", only_solids)
    with ONE_AT_A_TIME:
        file = _read(path, only_solids)
    if not file.solids:
        raise MeshError(
            f"{path}: expected solid elements, got {_listing(file.cells) or 'no elements'}"
            f"{file.first_line and f' ({file.first_line})'}. Export the volume mesh, not only the surface"
        )
    if not set(file.solids) <= set.union(*_ORDERS):
        _refuse_kinds(path, file)
    return FileBodies(path, as_they_are(path, with_middles(path, file)), scale)


def volume_mesh(bodies: FileBodies, solid: str | None = None, *, several: bool = False) -> VolumeMesh:
    """Mesh of one body, or of the elements of a name. Nodes of no volume element are left out.

    Parameters
    ----------
    bodies : FileBodies
    solid : str, optional
        Default: the only body.
    several : bool
        Whether the body may be of several regions.

    Raises
    ------
    InputError
        If there are no elements of this name.
    MeshError
        If they are of several bodies, of linear and quadratic elements, of several regions without `several`, or
        inverted.
    """
    path, file = bodies.path, elements_named(bodies, solid)
    solids = file.solids
    if not any(set(solids) <= kinds for kinds in _ORDERS):
        choose = f". Or choose one by solid=, of {listed_names(bodies.names)}" if len(bodies.names) > 1 else ""
        _refuse_kinds(path, file, choose)
    points = validate_array(f"points of {path}", file.points, (None, 3))
    blocks, start = [], 0
    for kind, (name, of_kind) in zip(kinds_named([*solids]), solids.items(), strict=True):
        nodes = np.asarray(of_kind, dtype=np.int64)

        def said(row: int, name: str = name, start: int = start) -> str:
            return file.said(start + row, name, row)

        _check_nodes(path, len(points), nodes, said)
        blocks.append((kind.name, _outward(path, points, kind, nodes, said, file.either_hand)))
        start += len(nodes)
    cells, hexahedra = rows_of_cells(blocks)
    by_kind = np.concatenate([rows for _, rows in kinds_of(cells, hexahedra)])
    cells = cells[by_kind]
    faces_of_all = faces_of(cells, hexahedra)
    origins = file.origins and file.origins.subset(by_kind)
    if origins:
        check_neighbours(cells, *faces_of_all, origins.all_said)
    if parts_of(faces_of_all[1]).any():
        check_one_body(bodies, solid)
        check_connected(faces_of_all[1], origins and origins.all_said)  # elements of a name that are one body's
    regions = _regions(path, file, several, len(cells))
    regions = regions._replace(number=regions.number[by_kind])
    if origins:
        _check_middles(cells, hexahedra, origins)
    used, numbers = np.unique(cells, return_inverse=True)
    if len(used) < len(points):
        _LOG.info("%s: left out %d nodes of no volume element", path, len(points) - len(used))
    number_of = np.full(len(points), -1)
    number_of[used] = np.arange(len(used))
    faces = _named_faces(file, *faces_of_all, 4 if hexahedra else 3)
    faces = {name: number_of[rows][(number_of[rows] >= 0).all(axis=1)] for name, rows in faces.items()}
    faces = {name: rows for name, rows in faces.items() if len(rows) or solid is None}
    return VolumeMesh(
        bodies.scale * points[used], numbers.reshape(cells.shape), faces, regions, hexahedra, file.materials
    )


def _refuse_kinds(path: Path, file: FileMesh, choose: str = "") -> NoReturn:
    """Raise MeshError that names the kinds of elements of a body, which are not of one order."""
    raise MeshError(
        f"{path}: expected some of {', '.join(sorted(_ORDERS[0]))}, or of {', '.join(sorted(_ORDERS[1]))}, got "
        f"{_listing(file.solids)}{_first_of_orders(file)}. Mesh the body with elements of one order, best tetra10"
        f"{choose}"
    )


def _regions(path: Path, file: FileMesh, several: bool, n: int) -> CellRegions:
    """Regions of n volume elements.

    Raises
    ------
    MeshError
        If there are some and not `several`, or an element belongs to none of several.
    """
    if not several:
        for regions in file.regions:
            if len(regions.names) > 1:
                refuse_regions(path, regions.kind, [repr(name) for name in regions.names])
        return CellRegions.single(n)
    regions = next(iter(file.regions), CellRegions.single(n))
    outside = np.flatnonzero(regions.number < 0)
    if len(outside):
        first = "" if file.origins is None else f", the first is {file.origins.said(outside[0])}"
        raise MeshError(
            f"{path}: {len(outside)} of {n} elements are in no {regions.kind}{first}; expected a material for each"
        )
    return regions


def read_triangles(path: Path) -> tuple[Array, Array]:
    """Corners, (n, 3), and triangles, (m, 3), of a surface in a file: STL, OBJ, PLY, or another format of meshio.

    Raises
    ------
    InputError
        If there is no such file, or meshio cannot read it.
    MeshError
        If it has faces other than triangles, or no faces.
    """
    file = _read(path)
    faces = file.surfaces
    if set(faces) != {"triangle"}:
        raise MeshError(f"{path}: expected triangles with three corners alone, got {_listing(faces) or 'no faces'}")
    points = validate_array(f"points of {path}", file.points, (None, 3))
    return points, np.asarray(faces["triangle"], dtype=np.int64)


def check_order(path: Path, file: VolumeMesh, order: int | None) -> None:
    """Raise unless elements of a file can have an order that a user gave; warn of linear tetrahedra if none is given.

    Raises
    ------
    InputError

    Warns
    -----
    MeshQualityWarning
    """
    possible = (2,) if file.order == 2 else (1, 2) if file.hexahedra else (1, 2, 3)
    if order is not None and order not in possible:
        kinds = ", ".join(kind.name for kind, _ in kinds_of(file.cells, file.hexahedra))
        expected = " or ".join(map(str, possible))
        raise InputError(f"order: {path} holds {kinds}, expected {expected}, got {order}")
    if order is None and file.cells.shape[1] == 4:
        warn(
            f"order: {path} holds linear tetrahedra, which bend too stiffly; with two elements across a bar its first "
            "frequency of bending is a quarter too high. Give order=2, which adds nodes in the middle of their edges; "
            "or order=1, to take them as they are",
            MeshQualityWarning,
        )


def raised(file: VolumeMesh) -> VolumeMesh:
    """Mesh of quadratic hexahedra and others in place of linear ones; new nodes, in the middle of edges, come last."""
    kinds = [(kind, rows, file.cells[rows][:, kind.columns]) for kind, rows in kinds_of(file.cells, True)]
    ends = [np.sort(corners[:, kind.edges], axis=2).reshape(-1, 2) for kind, _, corners in kinds]
    edges, number = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    middles = consecutive(list(map(len, ends)))
    cells = np.empty((len(file.cells), 20), dtype=np.int64)
    for (kind, rows, corners), part in zip(kinds, middles, strict=True):
        nodes = np.hstack([corners, len(file.points) + number.ravel()[part].reshape(len(corners), -1)])
        cells[rows] = nodes[:, HEXAHEDRA[20][kind.corners].of_row]
    points = np.vstack([file.points, file.points[edges].mean(axis=1)])
    return replace(file, points=points, cells=cells)


def write_vtu(path: Path, points: Array, blocks: list[tuple[str, Array]], fields: dict[str, Array]) -> None:
    """Write cells by their names in meshio, with nodal fields, (n,) or (n, k), to a VTU file."""
    _meshio().Mesh(points, blocks, point_data=fields).write(path, file_format="vtu")


def _read(path: Path, only_solids: bool = False) -> FileMesh:
    """Read a file by the reader of its format."""
    validate_file("source", path)
    suffix = path.suffix.lower()
    if suffix == ".inp":
        return read_abaqus(path, only_solids)
    if is_bulk_data(path):
        return read_nastran(path, only_solids)
    if suffix in ANSYS:
        return read_ansys(path, only_solids)
    if suffix in UNIVERSAL:
        return read_universal(path, only_solids)
    if only_solids:
        raise InputError(f"only_solids: is for input decks and universal files, got {path}")
    if (reader := plugin("readers", suffix.removeprefix("."))) is not None:
        return _file_of(path, reader(path))
    for endings, advice in _NO_READER.items():
        if suffix in endings.split():
            raise InputError(f"source: files of {suffix} have no reader here, got {path}. {advice}")
    mesh = _read_by_meshio(path)
    _check_counts(path, mesh)
    return _file_of(path, mesh)


def _file_of(path: Path, mesh: MeshioMesh) -> FileMesh:
    """What is needed of a mesh of meshio."""
    if not isinstance(mesh, _meshio().Mesh):
        raise InputError(f"source: expected a meshio.Mesh from the reader of {path}, got {type(mesh).__name__}")
    cells = {kind: np.asarray(rows) for kind, rows in mesh.cells_dict.items()}
    faces = _faces_of_groups(mesh, cells)
    regions = list(regions_of(mesh))
    node_sets = dict(mesh.point_sets) | _nodes_of_families(mesh)
    return FileMesh(mesh.points, cells, faces, node_sets, regions, groups=list(groups_of(mesh, regions)))


def _check_counts(path: Path, mesh: MeshioMesh) -> None:
    """Refuse a mesh that has fewer nodes or elements than its file says."""
    read = {
        "nodes": len(mesh.points),
        "elements": sum(map(len, mesh.cells)),
        "volume elements": sum(len(block) for block in mesh.cells if block.dim == 3),
    }
    for name, said in counts_said(path).items():
        if said != read[name]:
            raise MeshError(
                f"{path}: it says that it has {said} {name}, of which meshio reads {read[name]}. Export it in another "
                "format, such as VTU or Gmsh's"
            )


def _meshio() -> Meshio:
    """Return meshio, which knows all elements that it reads and writes."""
    meshio = require("meshio")
    for kind in ("wedge15", "pyramid13"):  # 5.3.5 has forgotten them in this one table, and fails on them
        require("meshio._mesh").topological_dimension.setdefault(kind, 3)
    return meshio


def _read_by_meshio(path: Path) -> MeshioMesh:
    """Read a file as a `meshio.Mesh`."""
    meshio = _meshio()
    said = _Said(sys.stdout)
    try:
        # meshio prints what it could not read, and ends the process.
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            tempfile.TemporaryDirectory() as folder,
        ):
            clean = path
            if path.suffix.lower() == ".msh" and for_meshio(data := path.read_bytes()) != data:
                clean = Path(folder) / path.name
                clean.write_bytes(for_meshio(data))
            elif path.suffix.lower() == ".med":
                clean = Path(folder) / path.name
                write_mesh_alone(path, clean)
            return meshio.read(clean)
    except ImportError as error:
        raise MissingPackageError(
            f"{error.name} is needed to read {path} and could not be imported: pip install {error.name}"
        ) from error
    except (Exception, SystemExit) as error:  # its readers raise whatever a broken file makes them run into
        reason = " ".join(said.getvalue().split()) or f"{type(error).__name__}: {error}"
        raise InputError(
            f"source: {path} could not be read by meshio ({reason}). Is it complete, and does its ending name its "
            "format?"
        ) from error


def _faces_of_groups(mesh: MeshioMesh, cells: dict[str, Array]) -> dict[str, list[Array]]:
    """Corner nodes of the surface elements in named sets, Gmsh's named physical groups, and groups of MED."""
    sets = {name: members for name, members in mesh.cell_sets_dict.items() if not name.startswith("gmsh:")}
    for kind, tags in mesh.cell_data_dict.get("gmsh:physical", {}).items():
        for name, (tag, dimension) in mesh.field_data.items():
            if dimension == 2 and name not in mesh.cell_sets:
                sets.setdefault(name, {})[kind] = np.flatnonzero(tags == tag)
    for kind, families in mesh.cell_data_dict.get("cell_tags", {}).items():
        for name in names_of_families(tags_of_cells(mesh)):
            is_member = np.isin(families, families_of(tags_of_cells(mesh), name))
            sets.setdefault(name, {})[kind] = np.flatnonzero(is_member)
    faces: dict[str, list[Array]] = {}
    for name, members in sets.items():
        for kind, rows in members.items():
            if kind in FACE_CORNERS and len(rows):
                faces.setdefault(name, []).append(cells[kind][rows][:, : FACE_CORNERS[kind]])
    return faces


def _nodes_of_families(mesh: MeshioMesh) -> dict[str, Array]:
    """Rows of the nodes in each group of nodes of MED."""
    tags, numbers = getattr(mesh, "point_tags", {}), mesh.point_data.get("point_tags")
    if numbers is None:
        return {}
    return {name: np.flatnonzero(np.isin(numbers, families_of(tags, name))) for name in names_of_families(tags)}


class _Said(io.StringIO):
    """Keeps what its own thread prints, and passes on what other threads print."""

    def __init__(self, others: TextIO) -> None:
        super().__init__()
        self._others, self._thread = others, threading.get_ident()

    def write(self, text: str) -> int:
        return super().write(text) if threading.get_ident() == self._thread else self._others.write(text)


def _check_nodes(path: Path, n: int, cells: Array, said: Said) -> None:
    """Refuse nodes that do not exist, or that an element has twice."""
    if cells.min() < 0 or cells.max() >= n:
        bad = np.flatnonzero(((cells < 0) | (cells >= n)).any(axis=1))
        raise MeshError(
            f"{path}: {len(bad)} of {len(cells)} elements name nodes that are not in the file, the first is "
            f"{said(bad[0])}. Export nodes and elements together"
        )
    collapsed = np.flatnonzero((np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1))
    if len(collapsed):
        raise MeshError(
            f"{path}: {len(collapsed)} of {len(cells)} elements have a node twice, and are no wedges, pyramids or "
            f"tetrahedra, the first is {said(collapsed[0])}. Mesh anew"
        )


def _first_of_orders(file: FileMesh) -> str:
    """Name the first element of each order in a deck, for a message."""
    origins = file.origins
    if origins is None:
        return ""
    counts = [len(rows) for rows in file.solids.values()]
    starts = dict(zip(file.solids, np.cumsum([0, *counts[:-1]]), strict=True))
    starts_of_orders = [[start for kind, start in starts.items() if kind in kinds] for kinds in _ORDERS]
    first = [min(rows, key=lambda row: int(origins.lines[row])) for rows in starts_of_orders if rows]
    return f", the first of each order are {origins.all_said(np.array(first))}"


def _check_middles(cells: Array, hexahedra: bool, origins: Origins) -> None:
    """Refuse elements of a deck that have different nodes on the edge that they share."""
    kinds = [(kind, rows, cells[rows][:, kind.columns]) for kind, rows in kinds_of(cells, hexahedra) if kind.order == 2]
    if not kinds:
        return
    ends = np.concatenate([np.sort(nodes[:, kind.edges], axis=2).reshape(-1, 2) for kind, _, nodes in kinds])
    middle = np.concatenate([nodes[:, kind.corners :].ravel() for kind, _, nodes in kinds])
    owner = np.concatenate([np.repeat(rows, len(kind.edges)) for kind, rows, _ in kinds])
    _, first, number = np.unique(ends @ [cells.max() + 1, 1], return_index=True, return_inverse=True)
    differing = np.flatnonzero(middle != middle[first[number]])
    if len(differing):
        pair = np.array([owner[first[number[differing[0]]]], owner[differing[0]]])
        raise MeshError(
            f"mesh: {len(np.unique(number[differing]))} edges have several mid-side nodes, expected one each that all "
            f"elements on an edge share, the first is one of {origins.all_said(pair)}. Merge coincident nodes or mesh "
            "anew"
        )


def _outward(path: Path, points: Array, kind: Kind, cells: Array, said: Said, each: bool) -> Array:
    """Cells of positive volume; all of a kind, or `each` one, are mirrored if they have the other convention."""
    bad = inverted(points, cells, kind)
    if len(bad) == len(cells) or each:
        cells = cells.copy()
        cells[bad] = cells[bad][:, _mirrored(kind)]
        bad = inverted(points, cells, kind)
    if len(bad):
        raise InvertedElementsError(
            f"{path}: {len(bad)} of {len(cells)} elements are inverted or have no volume, the first is {said(bad[0])}. "
            "Check the order of its nodes and where they lie, or mesh anew"
        )
    return cells


def _mirrored(kind: Kind) -> Array:
    """Order of nodes that mirrors an element."""
    corners = np.array(_MIRRORED[kind.corners])
    if kind.order == 1:
        return corners
    known = {frozenset(edge): kind.corners + i for i, edge in enumerate(kind.edges.tolist())}
    return np.asarray(np.r_[corners, [known[frozenset(ends)] for ends in corners[kind.edges].tolist()]])


def inverted(points: Array, cells: Array, kind: Kind) -> Array:
    """Rows of elements of a kind, (ne, n), without positive volume at some integration point."""
    corners = points[cells]
    jacobian = np.tensordot(corners, kind.gradients, (1, 1)).transpose(0, 2, 1, 3)  # einsum takes ten times as long
    determinant = np.linalg.det(jacobian)
    extent = np.ptp(corners, axis=1).max(axis=1)
    return np.flatnonzero(determinant.min(axis=1) <= _NO_VOLUME * extent**3)


def _named_faces(file: FileMesh, all_faces: Array, number: Array, corners: int) -> dict[str, Array]:
    """Corner nodes of the faces that have names, or whose corners are in a set of nodes."""
    faces = {}
    for name, named in file.faces.items():
        fitting = [rows for rows in named if rows.shape[1] <= corners]
        padded = [rows if rows.shape[1] == corners else rows[:, [0, 1, 2, 2]] for rows in fitting]
        if padded:
            faces[name] = np.concatenate(padded).astype(np.int64)
    of_cells = all_faces[number.ravel() >= 0, :corners]
    for name, nodes in file.node_sets.items():
        within = np.zeros(len(file.points), dtype=bool)
        within[nodes] = True
        chosen = of_cells[within[of_cells].all(axis=1)]
        if len(chosen):
            faces.setdefault(name, chosen)
    return faces


def _listing(cells: dict[str, Array]) -> str:
    return ", ".join(f"{len(rows)} {kind}" for kind, rows in cells.items())
