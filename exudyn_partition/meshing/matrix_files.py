"""Mass and stiffness in files of CalculiX, Abaqus, Nastran and Ansys, and of anything that writes sparse matrices."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..fe.material import Material
from ..fe.model import FEModel
from ..support.arrays import Array
from ..support.checks import (
    check_indices,
    validate_array,
    validate_file,
    validate_path,
    validate_positive,
    validate_whole,
)
from ..support.optional import require
from .abaqus_decks import read_abaqus
from .ansys_decks import ENDINGS as ANSYS
from .ansys_decks import read_ansys
from .nastran_decks import ENDINGS, read_nastran
from .nastran_matrices import read_dmig, read_op4
from .ngsolve_fem import fe_model
from .triples import Triples, joined

_LOG = logging.getLogger(__name__)

_EMPTY = 1e-12  # of rotations and of nodes that are left out, by the largest entry
_FORMATS = "CalculiX (.sti, .mas, .dof), Abaqus (.mtx), Nastran (.op4, .pch), Ansys (.full), Matrix Market (.mtx)"


@dataclass(frozen=True, eq=False)
class FileMatrices:
    """Mass and stiffness as another program wrote them, and what each row and column is.

    Parameters
    ----------
    mass, stiffness : (r, r) csr matrix
        Both triangles [kg, N/m].
    nodes : (r,) int array or None
        Number of each row's node in that program; None if the files do not tell it, and rows are in the order of
        ascending numbers.
    directions : (r,) int array or None
        1 to 3 for x, y, z, and 4 to 6 for rotations.
    """

    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    nodes: Array | None = None
    directions: Array | None = None

    def on(self, labels: Array) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Mass and stiffness in the order x y z of some nodes, as `FEModel.from_matrices` takes them.

        Parameters
        ----------
        labels : (n,) int array
            Numbers of the nodes in the program that wrote the files, in the order of the model's points.

        Returns
        -------
        mass, stiffness : (3n, 3n) csr matrix

        Raises
        ------
        InputError
            If a direction of a node is missing, as of one that was held; or if rotations or other nodes have mass or
            stiffness.
        """
        wanted = validate_whole("labels", labels, "numbers of nodes, (n,)")
        check_indices("labels", wanted, (None,))
        if not len(wanted):
            raise InputError("labels: expected at least one node, got none")
        if len(np.unique(wanted)) < len(wanted):
            raise InputError("labels: expected each node once")
        nodes, directions = self._rows(wanted)
        order = np.argsort(wanted)
        place = np.minimum(np.searchsorted(wanted, nodes, sorter=order), len(wanted) - 1)
        number = order[place]
        kept = np.flatnonzero((wanted[number] == nodes) & (directions <= 3))
        self._check_left_out(np.setdiff1d(np.arange(len(nodes)), kept), nodes, directions)
        row = np.full(3 * len(wanted), -1)
        row[3 * number[kept] + directions[kept] - 1] = kept
        missing = np.flatnonzero(row < 0)
        if len(missing):
            raise InputError(
                f"matrices: {len(missing)} of {3 * len(wanted)} dofs are not in the files, the first is "
                f"{'xyz'[missing[0] % 3]} of node {wanted[missing[0] // 3]}. Held and tied dofs are left out by that "
                "program; remove the boundary conditions, ties and equations, and write the matrices of the free body"
            )
        return self.mass[row][:, row], self.stiffness[row][:, row]

    def fe_model(
        self, mesh: str | Path, material: Material | Mapping[str, Material] | None = None, *, scale: float = 1.0
    ) -> FEModel:
        """FE model of the elements of an input deck, with these matrices instead of ours.

        Parameters
        ----------
        mesh : str or Path
            Deck of Abaqus, CalculiX, Nastran or Ansys (`.cdb`) that the matrices were made of; its nodes have numbers.
        material : Material or dict of str to Material, optional
            The one that the matrices were made with, or those of the deck's regions. Default: what the deck says, see
            `ep.fe_model`.
        scale : float
            Of the deck's lengths to metres; see `ep.fe_model`.

        Returns
        -------
        FEModel

        Raises
        ------
        InputError
            If the mesh is no deck, dofs of it are missing, or the matrices are not those of elements and material.
        MeshError
            If the deck cannot be read, or a matrix is not symmetric.

        Warns
        -----
        MeshQualityWarning, UnitsWarning
            See `ep.fe_model`.
        """
        path = validate_path("mesh", mesh)
        validate_file("mesh", path)
        read = {".inp": read_abaqus} | dict.fromkeys(ENDINGS, read_nastran) | dict.fromkeys(ANSYS, read_ansys)
        if path.suffix.lower() not in read:
            raise InputError(
                f"mesh: expected a deck with numbers of nodes, {', '.join(read)}, got {path.suffix!r}. Of other meshes "
                "give points to FEModel.from_matrices, with matrices.on(labels)"
            )
        file = read[path.suffix.lower()](path)
        ours = fe_model(path, material, scale=scale, order=1 if "tetra" in file.solids else None)
        labels = np.asarray(file.labels)[np.unique(np.concatenate([rows.ravel() for rows in file.solids.values()]))]
        mass, stiffness = self.on(labels)
        _LOG.info("%s: matrices of %d dofs instead of ours", path, mass.shape[0])
        return replace(ours, mass=mass, stiffness=stiffness)

    def _rows(self, labels: Array) -> tuple[Array, Array]:
        """Node and direction of each row; in ascending order if the files do not tell."""
        if self.nodes is not None and self.directions is not None:
            return self.nodes, self.directions
        r, n = self.mass.shape[0], len(labels)
        if r not in (3 * n, 6 * n):
            raise InputError(
                f"matrices: these files do not tell which node a row is of, so that {3 * n} rows are expected of {n} "
                f"nodes, or {6 * n} with rotations, got {r}. Are dofs held, or nodes of no element in it?"
            )
        each = r // n
        return np.repeat(np.sort(labels), each), np.tile(np.arange(1, each + 1), n)

    def _check_left_out(self, rows: Array, nodes: Array, directions: Array) -> None:
        """Refuse to leave out rows that have mass or stiffness."""
        if not len(rows):
            return
        for name in ("mass", "stiffness"):
            matrix = getattr(self, name)
            largest = abs(matrix[rows]).max(axis=1).toarray().ravel()
            if largest.max() > _EMPTY * abs(matrix).max():
                worst = rows[int(largest.argmax())]
                raise InputError(
                    f"matrices: direction {directions[worst]} of node {nodes[worst]} has {name}, but no place in the "
                    "model: expected dofs 1 to 3 of the nodes of solid elements alone. Shells, beams, masses and "
                    "springs belong into the Exudyn model; elements with modes of their own, as CalculiX' C3D8I, have "
                    "such nodes, take C3D20R"
                )
        _LOG.info("left out %d dofs without mass and stiffness", len(rows))


def read_matrices(
    source: str | Path, mass: str | Path | None = None, *, mass_unit: float = 1.0, stiffness_unit: float = 1.0
) -> FileMatrices:
    """Read mass and stiffness that another program assembled.

    The body must be free: without boundary conditions, ties and equations.

    Parameters
    ----------
    source : str or Path
        `.sti`, `.mas` or `.dof` of CalculiX (`*FREQUENCY, SOLVER=MATRIXSTORAGE`), the other two beside it. Stiffness
        `.mtx` of Abaqus (`*MATRIX GENERATE, STIFFNESS, MASS` with `*MATRIX OUTPUT` in any format). `.op4` of Nastran
        with K... and M... (needs pyyeti), or its DMIG in `.pch`. `.full` of Ansys (needs ansys-mapdl-reader). Stiffness
        `.mtx` of Matrix Market.
    mass : str or Path, optional
        The mass, where that is another file. Default: the file beside it with MASS for STIF in its name.
    mass_unit, stiffness_unit : float
        Unit of the files in kg and in N/m: 1e3 both for t, mm and s.

    Returns
    -------
    FileMatrices

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, or has no mass or stiffness.
    MissingPackageError
        If a package that reads this format is not installed.
    """
    path = validate_path("source", source)
    units = validate_positive("mass_unit", mass_unit, "kg"), validate_positive("stiffness_unit", stiffness_unit, "N/m")
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise InputError(f"source: expected matrices of {_FORMATS}, got a file that ends with {suffix!r}")
    validate_file("source", path)
    if suffix != ".mtx" and mass is not None:
        raise InputError(f"mass: {path} has the mass, or a file beside it; expected none besides")
    matrices = _READERS[suffix](path, mass)
    return replace(matrices, mass=matrices.mass * units[0], stiffness=matrices.stiffness * units[1])


def _calculix(path: Path, _: str | Path | None) -> FileMatrices:
    """Upper triangles, row column value, and the node and direction of each row as NODE.DIRECTION."""
    files = [path.with_suffix(suffix) for suffix in (".mas", ".sti", ".dof")]
    for file in files:
        validate_file("source", file)
    try:
        dofs = np.array(files[2].read_text(encoding="ascii").replace(".", " ").split(), dtype=np.int64).reshape(-1, 2)
    except ValueError as error:
        raise InputError(f"source: {files[2]}: expected lines of NODE.DIRECTION: {error}") from error
    matrices = []
    for file in files[:2]:
        triples = _triples(_table(file, 3))
        if triples.last + 1 != len(dofs):
            raise InputError(
                f"source: {file} has {triples.last + 1} rows, {files[2]} names {len(dofs)} dofs; expected as many. Are "
                "they of one run, without cyclic symmetry?"
            )
        matrices.append(triples.matrix(len(dofs)))
    return FileMatrices(matrices[0], matrices[1], dofs[:, 0], dofs[:, 1])


def _abaqus(path: Path, mass: str | Path | None) -> FileMatrices:
    """Lines of node, dof, node, dof, value; or of row, column, value; or a file of Matrix Market."""
    if mass is None:
        beside = path.with_name(re.sub("stif", _like_mass, path.name, flags=re.IGNORECASE))
        if beside == path or not beside.is_file():
            raise InputError(f"mass: expected the file of the mass matrix, there is none beside {path}")
        mass = beside
    files = [validate_path("mass", mass), path]
    validate_file("mass", files[0])
    with path.open(encoding="ascii", errors="replace") as file:
        if file.readline().startswith("%%MatrixMarket"):
            return FileMatrices(_market(files[0]), _market(path))
    tables = [_table(file, 5, 3) for file in files]
    if {table.shape[1] for table in tables} == {3}:
        triples = [_triples(table) for table in tables]
        n = 1 + max(triple.last for triple in triples)
        return FileMatrices(triples[0].matrix(n), triples[1].matrix(n))
    if {table.shape[1] for table in tables} != {5}:
        raise InputError(f"mass: {files[0]} and {path} have different formats, expected one of both")
    nodes, directions, matrices = joined(
        [[table[:, i].astype(np.int64) for i in range(4)] + [table[:, 4]] for table in tables]
    )
    if nodes.min(initial=1) < 1:
        raise InputError(
            f"source: {path} has {np.count_nonzero(np.unique(nodes) < 1)} internal nodes, with numbers below 1, "
            "expected those of solid elements alone; write the matrices of a model without couplings and connectors"
        )
    return FileMatrices(matrices[0], matrices[1], nodes, directions)


def _like_mass(match: re.Match[str]) -> str:
    return "MASS" if match[0].isupper() else "mass"


def _market(path: Path) -> sp.csr_matrix:
    """Sparse matrix of a file of Matrix Market."""
    try:
        return sp.csr_matrix(require("scipy.io").mmread(path))
    except (ValueError, OSError) as error:
        raise InputError(f"source: {path} could not be read as a file of Matrix Market: {error}") from error


def _table(path: Path, *columns: int) -> Array:
    """Numbers of a text, separated by commas or blanks, in one of these numbers of columns; lines with * are none."""
    with path.open(encoding="ascii", errors="replace") as file:
        first = next((line for line in file if line.strip() and line[0] != "*"), "")
    if not first:
        raise InputError(f"source: {path}: expected lines of {columns[0]} numbers, got none")
    try:
        table = np.loadtxt(path, comments="*", delimiter="," if "," in first else None, ndmin=2)
    except ValueError as error:
        raise InputError(f"source: {path}: expected lines of {columns[0]} numbers: {error}") from error
    if table.shape[1] not in columns:
        raise InputError(
            f"source: {path}: expected lines of {' or '.join(map(str, columns))} numbers, got {table.shape[0]} of "
            f"{table.shape[1]}"
        )
    return validate_array(f"source: {path}", table, table.shape)


def _triples(table: Array) -> Triples:
    """Entries of a table of row and column, from 1 on, and value."""
    return Triples(table[:, 0].astype(np.int64) - 1, table[:, 1].astype(np.int64) - 1, table[:, 2])


def _nastran_binary(path: Path, _: str | Path | None) -> FileMatrices:
    mass, stiffness = read_op4(path)
    return FileMatrices(mass, stiffness)


def _nastran_punch(path: Path, _: str | Path | None) -> FileMatrices:
    nodes, directions, (mass, stiffness) = read_dmig(path)
    return FileMatrices(mass, stiffness, nodes, directions)


def _ansys(path: Path, _: str | Path | None) -> FileMatrices:
    reader = require("ansys.mapdl.reader", "ansys-mapdl-reader")
    try:
        full = reader.read_binary(str(path))
        dofs, stiffness, mass = full.load_km(sort=True)
        n_fixed = len(full.const)
    except Exception as error:  # it raises whatever a broken file makes it run into
        raise InputError(f"source: {path} could not be read by ansys-mapdl-reader: {error}") from error
    return of_ansys(path, dofs, stiffness, mass, n_fixed)


def of_ansys(path: Path, dofs: Array, stiffness: sp.spmatrix, mass: sp.spmatrix, held: int) -> FileMatrices:
    """Matrices as ansys-mapdl-reader reads them: upper triangles, and node and direction, from 0 on, of each row.

    Raises
    ------
    InputError
        If some dofs are held, or there is no mass.
    """
    if held:
        raise InputError(
            f"source: {held} dofs are held in {path}, expected a free body; remove D, CP and CE, and write it anew"
        )
    both = []
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        if matrix is None or not sp.issparse(matrix) or not matrix.nnz:
            raise InputError(f"source: {path} has no {name}; write it by a modal analysis, ANTYPE,MODAL")
        found = matrix.tocoo()
        both.append(Triples(found.row.astype(np.int64), found.col.astype(np.int64), found.data).matrix(len(dofs)))
    return FileMatrices(both[0], both[1], np.asarray(dofs[:, 0]), np.asarray(dofs[:, 1]) + 1)


_READERS: dict[str, Callable[[Path, str | Path | None], FileMatrices]] = {
    ".sti": _calculix,
    ".mas": _calculix,
    ".dof": _calculix,
    ".mtx": _abaqus,
    ".op4": _nastran_binary,
    ".pch": _nastran_punch,
    ".full": _ansys,
}
