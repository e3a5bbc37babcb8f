"""Mesh files through meshio: points, cells and named faces in the file's own numbering, checked."""

from __future__ import annotations

import contextlib
import io
import sys
import threading
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ..errors import InputError, MeshError, MeshQualityWarning, MissingPackageError
from ..fe.shapes import CELL_FACES, integration_gradients
from ..support.arrays import Array
from ..support.checks import read_only, validate_array, validate_file
from ..support.foreign import MeshioMesh
from ..support.optional import require
from .input_decks import CellRegions, check_deck, check_regions, regions_of

_VOLUMES = ("tetra", "tetra10", "hexahedron")
_FACE_CORNERS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}

# Order of nodes that mirrors an element.
_MIRRORED = {4: [1, 0, 2, 3], 10: [1, 0, 2, 3, 4, 6, 5, 8, 7, 9], 8: [4, 5, 6, 7, 0, 1, 2, 3]}
_NO_VOLUME = 1e-10  # six times the volume of an element, by the cube of its extent, below which it is round-off


@dataclass(frozen=True, eq=False)
class VolumeMesh:
    """Points and volume elements of a mesh file, all of one kind.

    Parameters
    ----------
    points : (n, 3) array
        Nodal positions in the file's order and unit of length.
    cells : (ne, 4), (ne, 10) or (ne, 8) int array
        Linear or quadratic tetrahedra or linear hexahedra, in VTK order with positive volume.
    faces : dict of str to (k, 3) or (k, 4) int array
        Corner nodes of the triangles or quadrilaterals that the file names.
    regions : CellRegions
    """

    points: Array
    cells: Array
    faces: dict[str, Array]
    regions: CellRegions

    def __post_init__(self) -> None:
        read_only(self.points, self.cells, *self.faces.values())

    @property
    def order(self) -> int:
        """Polynomial order of the elements, 1 or 2."""
        return 2 if self.cells.shape[1] == 10 else 1


def read_mesh(path: Path, several: bool = False) -> VolumeMesh:
    """Read the volume elements of a mesh file: VTU, Gmsh, Abaqus, Nastran, or another format of meshio.

    Surface elements are used only to name boundaries (physical groups of Gmsh, element sets of Abaqus). So are sets of
    nodes (Abaqus): they name the faces of elements whose corners they have.

    Parameters
    ----------
    path : Path
    several : bool
        Whether the body may be of several regions.

    Raises
    ------
    InputError
        If there is no such file, or meshio cannot read it.
    MeshError
        If the file has no volume elements, elements other than linear or quadratic tetrahedra or linear hexahedra,
        elements of several kinds or, without `several`, regions, inverted elements, or nodes of no element; or if
        meshio does not read all of it, see `input_decks.check_deck`.
    MissingPackageError
        If meshio, or what it needs for this format, is not installed.
    """
    mesh = _read(path, several)
    counts: dict[str, int] = {}
    for block in mesh.cells:
        counts[block.type] = counts.get(block.type, 0) + len(block)
    volumes = sorted({block.type for block in mesh.cells if block.dim == 3 and len(block)})
    if not volumes:
        raise MeshError(
            f"{path}: expected tetrahedra or hexahedra, got {_listing(counts) or 'no elements'}. Export the volume "
            "mesh, not only the surface"
        )
    if len(volumes) > 1 or volumes[0] not in _VOLUMES:
        raise MeshError(
            f"{path}: expected one of {', '.join(_VOLUMES)} alone, got "
            f"{_listing({kind: counts[kind] for kind in volumes})}. Mesh the body with one kind, best tetra10"
        )
    points = validate_array(f"points of {path}", mesh.points, (None, 3))
    cells = np.asarray(mesh.cells_dict[volumes[0]], dtype=np.int64)
    _check_nodes(path, volumes[0], len(points), cells)
    corners = 4 if volumes[0] == "hexahedron" else 3
    regions = regions_of(path, mesh) if several else CellRegions.one(len(cells))
    return VolumeMesh(points, _outward(path, points, cells), _named_faces(mesh, corners, cells), regions)


def read_triangles(path: Path) -> tuple[Array, Array]:
    """Corners, (n, 3), and triangles, (m, 3), of a surface in a file: STL, OBJ, PLY, or another format of meshio.

    Raises
    ------
    InputError
        If there is no such file, or meshio cannot read it.
    MeshError
        If it has faces other than triangles, or no faces.
    """
    mesh = _read(path, True)
    faces = {block.type: len(block) for block in mesh.cells if block.dim == 2 and len(block)}
    if set(faces) != {"triangle"}:
        raise MeshError(f"{path}: expected triangles with three corners alone, got {_listing(faces) or 'no faces'}")
    points = validate_array(f"points of {path}", mesh.points, (None, 3))
    return points, np.asarray(mesh.cells_dict["triangle"], dtype=np.int64)


def check_order(path: Path, file: VolumeMesh, order: int | None) -> None:
    """Raise unless elements of a file can have an order that a user gave; warn of linear tetrahedra if none is given.

    Raises
    ------
    InputError

    Warns
    -----
    MeshQualityWarning
    """
    n_nodes = file.cells.shape[1]
    if order not in (None, file.order) and n_nodes != 4:
        raise InputError(f"order: {path} holds elements of {n_nodes} nodes, expected {file.order}, got {order}")
    if order is None and n_nodes == 4:
        warnings.warn(
            f"order: {path} holds linear tetrahedra, which bend too stiffly; with two elements across a bar its first "
            "frequency of bending is a quarter too high. Give order=2, which adds nodes in the middle of their edges; "
            "or order=1, to take them as they are",
            MeshQualityWarning,
            stacklevel=4,
        )


def write_vtu(path: Path, points: Array, kind: str, cells: Array, fields: dict[str, Array]) -> None:
    """Write cells of one of meshio's kinds, with nodal fields, (n,) or (n, k), to a VTU file."""
    meshio = require("meshio")
    meshio.Mesh(points, [(kind, cells)], point_data=fields).write(path, file_format="vtu")


def _read(path: Path, several: bool) -> MeshioMesh:
    """Read a file as a `meshio.Mesh`."""
    validate_file("path", path)
    meshio = require("meshio")
    said = _Said(sys.stdout)
    try:
        # meshio prints what it could not read, and ends the process.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(path)
    except ImportError as error:
        raise MissingPackageError(
            f"{error.name} is needed to read {path} and could not be imported: pip install {error.name}"
        ) from error
    except (Exception, SystemExit) as error:  # its readers raise whatever a broken file makes them run into
        reason = " ".join(said.getvalue().split()) or f"{type(error).__name__}: {error}"
        raise InputError(
            f"path: {path} could not be read by meshio ({reason}). Is it complete, and does its ending name its format?"
        ) from error
    check_deck(path, mesh, several)
    if not several:
        check_regions(path, mesh)
    return mesh


class _Said(io.StringIO):
    """Keeps what its own thread prints, and passes on what other threads print."""

    def __init__(self, others: TextIO) -> None:
        super().__init__()
        self._others, self._thread = others, threading.get_ident()

    def write(self, text: str) -> int:
        return super().write(text) if threading.get_ident() == self._thread else self._others.write(text)


def _check_nodes(path: Path, kind: str, n: int, cells: Array) -> None:
    """Refuse nodes that do not exist, that no element has, or that an element has twice."""
    if cells.min() < 0 or cells.max() >= n:
        bad = np.flatnonzero(((cells < 0) | (cells >= n)).any(axis=1))
        raise MeshError(
            f"{path}: {len(bad)} of {len(cells)} elements name nodes that are not in the file, the first is element "
            f"{bad[0]} (counted from 0). Export nodes and elements together"
        )
    orphans = np.setdiff1d(np.arange(n), cells)
    if len(orphans):
        raise MeshError(
            f"{path}: {len(orphans)} of {n} nodes belong to no volume element, the first is node {orphans[0]} (counted "
            f"from 0). Export the mesh without them, or number the others anew: m = meshio.read({str(path)!r}); used, "
            f"cells = numpy.unique(m.cells_dict[{kind!r}], return_inverse=True); meshio.Mesh(m.points[used], "
            f"{{{kind!r}: cells.reshape(-1, {cells.shape[1]})}}).write(...)"
        )
    collapsed = np.flatnonzero((np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1))
    if len(collapsed):
        raise MeshError(
            f"{path}: {len(collapsed)} of {len(cells)} elements have a node twice, the first is element {collapsed[0]} "
            "(counted from 0). Collapsed hexahedra are wedges; mesh the body with one kind of element"
        )


def _outward(path: Path, points: Array, cells: Array) -> Array:
    """Cells of positive volume; all are mirrored if the file has the other convention."""
    bad = inverted(points, cells)
    if len(bad) == len(cells):
        cells = cells[:, _MIRRORED[cells.shape[1]]]
        bad = inverted(points, cells)
    if len(bad):
        raise MeshError(
            f"{path}: {len(bad)} of {len(cells)} elements are inverted or have no volume, the first is element "
            f"{bad[0]} (counted from 0), of nodes {cells[bad[0]].tolist()}. Check the order of its nodes and where "
            "they lie, or mesh anew"
        )
    return cells


def inverted(points: Array, cells: Array) -> Array:
    """Rows of `cells`, (ne, 4), (ne, 10) or (ne, 8), without positive volume at some integration point."""
    corners = points[cells]
    determinant = np.linalg.det(np.einsum("qki,ekd->eqid", integration_gradients(cells.shape[1]), corners))
    extent = np.ptp(corners, axis=1).max(axis=1)
    return np.flatnonzero(determinant.min(axis=1) <= _NO_VOLUME * extent**3)


def _named_faces(mesh: MeshioMesh, corners: int, cells: Array) -> dict[str, Array]:
    """Corner nodes of the faces with so many corners in named sets and in Gmsh's named physical groups."""
    sets = {name: members for name, members in mesh.cell_sets_dict.items() if not name.startswith("gmsh:")}
    for kind, tags in mesh.cell_data_dict.get("gmsh:physical", {}).items():
        for name, (tag, dimension) in mesh.field_data.items():
            if dimension == 2 and name not in mesh.cell_sets:
                sets.setdefault(name, {})[kind] = np.flatnonzero(tags == tag)
    faces: dict[str, list[Array]] = {}
    for name, members in sets.items():
        for kind, rows in members.items():
            if _FACE_CORNERS.get(kind) == corners and len(rows):
                faces.setdefault(name, []).append(mesh.cells_dict[kind][rows][:, :corners])
    of_cells = cells[:, CELL_FACES[cells.shape[1]][:, :corners]].reshape(-1, corners)
    for name, nodes in mesh.point_sets.items():
        within = of_cells[np.isin(of_cells, nodes).all(axis=1)]
        if len(within):
            faces.setdefault(name, [within])
    return {name: np.concatenate(blocks).astype(np.int64) for name, blocks in faces.items()}


def _listing(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items())
