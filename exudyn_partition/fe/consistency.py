"""Whether points, elements, material, mass and stiffness of an FE model belong together.

Any element, of whatever formulation, has the mass of its volume and the energy of a uniform strain, if its sides are
straight. So sums of the matrices, and products with a few motions, tell whether they are those of the elements.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, InvertedElementsError, MeshError
from ..support.arrays import Array
from ..support.checks import validate_array
from .elements import centres_of, kinds_of
from .material import Material, Regions

EQUAL = 1e-4  # relative difference of mass, or of the energy of uniform strain, that files of few digits may make
_OF_AN_ELEMENT = 1e-2  # the same of one element with curved sides, which codes integrate with different points
# The same of the force of a uniform strain at a node, by the largest of an element around it. Codes integrate cubic
# elements by different numbers of points, which differ by 0.02 of coarse curved ones.
_AT_A_NODE, _AT_A_CUBIC_NODE = 0.02, 0.1
CENTRE = 0.05  # of mass, by the body's size: that of nodes is not quite that of curved elements
_SYMMETRIC = 1e-8  # round-off, by the largest entry
# Uniform strains xx, yy, zz, yz, xz, xy as gradients of motions, (6, 3, 3), and what they are called.
UNIFORM_STRAINS = np.zeros((6, 3, 3))
UNIFORM_STRAINS[[0, 1, 2], [0, 1, 2], [0, 1, 2]] = 1.0
UNIFORM_STRAINS[[3, 4, 5], [1, 0, 0], [2, 2, 1]] = UNIFORM_STRAINS[[3, 4, 5], [2, 2, 1], [1, 0, 0]] = 0.5
_CALLED = [f"strain along {axis}" for axis in "xyz"] + [f"shear of {axes}" for axes in ("yz", "xz", "xy")]
ALL_STRAINS = np.array([0.8, -0.5, 0.6, 0.9, -0.4, 0.6])  # a strain that has all of them
Elastic = Material | Regions


def plain_matrix(name: str, matrix: Any, n: int) -> sp.csr_matrix:
    """Return an (n, n) matrix as csr of floats with sorted entries, each once; sparse in any format, or dense.

    Raises
    ------
    MeshError
        If it is no matrix, has another shape, or entries that are no real, finite numbers.
    """
    if isinstance(matrix, np.ndarray):
        matrix = sp.csr_matrix(validate_array(name, matrix, (n, n)))
    if not sp.issparse(matrix):
        raise MeshError(f"{name}: expected a sparse matrix, as scipy.sparse.csr_matrix, got {type(matrix).__name__}")
    if matrix.shape != (n, n):
        raise MeshError(f"{name}: expected shape {(n, n)}, three dofs a node, got {matrix.shape}")
    if matrix.dtype.kind not in "iuf":
        raise MeshError(f"{name}: expected real numbers, got {matrix.dtype}; give damping to CreatePartitionBody")
    plain = sp.csr_matrix(matrix, dtype=float)
    if not plain.has_canonical_format:
        plain = plain.copy()  # the user's is not changed
        plain.sum_duplicates()
    if not np.isfinite(plain.data).all():
        bad = np.count_nonzero(~np.isfinite(plain.data))
        raise MeshError(f"{name}: expected finite numbers, got {bad} that are not; assemble it anew")
    return plain


def check_symmetric(name: str, matrix: sp.csr_matrix, tolerance: float = _SYMMETRIC) -> None:
    """Raise `MeshError` unless a matrix is symmetric, within a tolerance by its largest entry."""
    weights = 1.0 + 0.5 * np.sin(np.arange(matrix.shape[0]))  # none is zero, so that no entry is missed
    off = abs(matrix @ weights - matrix.T @ weights)
    if off.max(initial=0.0) > tolerance * largest_entry(matrix):
        row = int(off.argmax())
        raise MeshError(
            f"{name}: expected a symmetric matrix, row and column {row} ({'xyz'[row % 3]} of node {row // 3}) differ. "
            "Is only one triangle of it stored? Then add the other one: A + A.T - diag(A)"
        )


def largest_entry(matrix: sp.csr_matrix) -> float:
    """Largest absolute value of a matrix; abs(matrix) would copy it."""
    return float(max(matrix.data.max(initial=0.0), -matrix.data.min(initial=0.0)))


def check_elements(
    points: Array,
    cells: Array,
    hexahedra: bool,
    cell_mass: Array,
    mass: sp.csr_matrix,
    stiffness: sp.csr_matrix,
    elastic: Elastic,
) -> None:
    """Compare the matrices with the elements, and with their elasticity and density.

    Parameters are those of `FEModel`.

    Raises
    ------
    InvertedElementsError
        If an element has no positive volume.
    InputError
        If masses, energies of uniform strain, or its forces at nodes differ.
    """
    volume, gradients = integrals(points, cells, hexahedra)
    bad = np.flatnonzero(volume <= 0)
    if len(bad):
        where = ", ".join(f"{x:.4g}" for x in points[cells[bad[0]]].mean(axis=0))
        raise InvertedElementsError(
            f"cells: {len(bad)} of {len(volume)} elements are inverted or have no volume, the first is element "
            f"{bad[0]} at ({where}). Expected nodes in VTK order, which gives positive volumes; exchange two corners"
        )
    _check_mass(mass, cell_mass, elastic.rho * volume, points, cells, hexahedra)
    _check_centre(mass, cell_mass, points, cells, hexahedra)
    motions = np.einsum("na,vab->nbv", points - points.mean(axis=0), UNIFORM_STRAINS).reshape(-1, 6)
    forces = stiffness @ motions
    check_energies(motions.T @ forces, volume, elastic)
    lame, shear = (np.broadcast_to(x, len(volume)) for x in (elastic.lame, elastic.shear_modulus))
    strain = np.einsum("v,vab->ab", ALL_STRAINS, UNIFORM_STRAINS)
    spherical, deviatoric = lame * np.trace(strain), 2 * shear
    of_cells = gradients @ (spherical[:, None, None] * np.eye(3) + deviatoric[:, None, None] * strain)
    cubic = cells.shape[1] == 20 and not hexahedra
    _check_forces(points, cells, (forces @ ALL_STRAINS).reshape(-1, 3), of_cells, cubic)


def _check_mass(
    mass: sp.csr_matrix, cell_mass: Array, expected: Array, points: Array, cells: Array, hexahedra: bool
) -> None:
    """Compare masses of elements, (ne,) [kg], with density times volume, and their sum with the mass matrix."""
    total = float(cell_mass.sum())
    off = abs(cell_mass - expected) / expected
    if off.max() > _OF_AN_ELEMENT or abs(total - expected.sum()) > EQUAL * total:
        worst = int(off.argmax())
        _check_turned(points, cells, hexahedra, np.flatnonzero(off > EQUAL))
        raise InputError(
            f"cell_mass: expected density times volume, {expected.sum():.6g} kg in all, got {total:.6g} kg; element "
            f"{worst} has {cell_mass[worst]:.4g} kg for {expected[worst]:.4g} kg. Are points, cells and material those "
            "that the matrices were made with, in the same units?"
        )
    check_moved_mass(mass, total, f"the elements have {total:.6g} kg by cell_mass", EQUAL)


def _check_turned(points: Array, cells: Array, hexahedra: bool, some: Array) -> None:
    """Raise `InvertedElementsError` if elements, rows of `cells`, are inside out beside their integration points.

    Volumes there are negative, and codes do not agree on those of such elements.
    """
    turned = []
    for kind, rows in kinds_of(cells[some], hexahedra):
        x = points[cells[some[rows]][:, kind.columns]]
        least = np.linalg.det(np.einsum("qnr,end->eqrd", kind.functions(kind.nodes)[1], x)).min(axis=1)
        turned += some[rows[least <= 0]].tolist()
    if turned:
        where = ", ".join(f"{x:.4g}" for x in points[cells[turned[0]]].mean(axis=0))
        raise InvertedElementsError(
            f"cells: {len(turned)} of {len(cells)} elements are inside out in a corner, between integration points, "
            f"the first is element {turned[0]} at ({where}). Curved sides do that to elements that are too large for "
            "the curvature or the thickness of a wall. Take a smaller maxh, or refine there"
        )


def _check_centre(mass: sp.csr_matrix, cell_mass: Array, points: Array, cells: Array, hexahedra: bool) -> None:
    """Compare the centre of the mass matrix with that of the elements; `centres_of` is near it, unless they are few."""
    total, size = cell_mass.sum(), np.ptp(points, axis=0).max()
    centre = (mass @ np.ones(mass.shape[0])).reshape(-1, 3).mean(axis=1) @ points
    for centres in (centres_of, _centroids):
        away = np.linalg.norm(centre - cell_mass @ centres(points, cells, hexahedra))
        if away <= CENTRE * total * size:
            return
    raise InputError(
        f"mass: its centre lies {away / total:.4g} m from that of the elements, expected the same; is the order of "
        "nodes another, or the order of dofs not x y z x y z?"
    )


def _centroids(points: Array, cells: Array, hexahedra: bool) -> Array:
    """Centres of the elements' volumes, (ne, 3) [m]."""
    centres = np.zeros((len(cells), 3))
    for kind, rows in kinds_of(cells, hexahedra):
        x, (local, weight) = points[cells[rows][:, kind.columns]], kind.rule
        places = np.einsum("qn,end->eqd", kind.functions(local)[0], x)
        volumes = weight * np.linalg.det(np.einsum("qnr,end->eqrd", kind.gradients, x))
        centres[rows] = np.einsum("eq,eqd->ed", volumes, places) / volumes.sum(axis=1, keepdims=True)
    return centres


def check_moved_mass(mass: sp.csr_matrix, total: float, of: str, equal: float) -> None:
    """Raise `InputError` unless a motion along each axis moves the total mass [kg], within a relative difference."""
    for axis, name in enumerate("xyz"):
        along = np.zeros(mass.shape[0])
        along[axis::3] = 1.0
        moved = float(along @ (mass @ along))
        if abs(moved - total) > equal * total:
            raise InputError(
                f"mass: a motion along {name} moves {moved:.6g} kg by the mass matrix, but {of}, "
                f"{total / moved:.4g} times as much. Expected the matrix of these points, facets or "
                "cells, and material, in the same units"
            )


def check_energies(energies: Array, volume: Array, elastic: Elastic, equal: float = EQUAL) -> None:
    """Compare twice the energies of uniform strains, (6, 6) [J], with those of some volumes, (ne,) [m3].

    Raises
    ------
    InputError
        If they differ by more than `equal`, by the largest.
    """
    lame, shear = (np.broadcast_to(x, len(volume)) for x in (elastic.lame, elastic.shear_modulus))
    traces = np.einsum("vaa->v", UNIFORM_STRAINS)
    products = np.einsum("vab,wab->vw", UNIFORM_STRAINS, UNIFORM_STRAINS)
    expected = (lame @ volume) * np.outer(traces, traces) + 2 * (shear @ volume) * products
    off = (abs(energies - expected) > equal * expected.max()).any(axis=1)
    if off.any():
        first, per = int(off.argmax()), 2 * volume.sum()
        raise InputError(
            f"material: a uniform {_CALLED[first]} stores {energies[first, first] / per:.6g} J/m3 by the stiffness "
            f"matrix, but {expected[first, first] / per:.6g} J/m3 by E = {_spread(elastic.E)} Pa and nu = "
            f"{_spread(elastic.nu)}. Expected the material, and the units, that the matrices were made with"
        )


def _check_forces(points: Array, cells: Array, forces: Array, of_cells: Array, cubic: bool) -> None:
    """Compare forces of a uniform strain at nodes, (n, 3) [N], with those of the elements around, (ne, k, 3) [N]."""
    nodes, n = cells.ravel(), len(points)
    expected = np.column_stack([np.bincount(nodes, f.ravel(), n) for f in of_cells.transpose(2, 0, 1)])
    off = np.sqrt(((forces - expected) ** 2).sum(axis=1))
    largest = np.sqrt((of_cells**2).sum(axis=2).max(axis=1))
    tolerance = _AT_A_CUBIC_NODE if cubic else _AT_A_NODE
    if off.max() <= tolerance * largest.min():
        return
    scale = np.zeros(n)
    np.maximum.at(scale, cells, largest[:, None])
    wrong = np.flatnonzero(off > tolerance * scale)
    if len(wrong):
        node = int(wrong[(off[wrong] / scale[wrong]).argmax()])
        raise InputError(
            f"stiffness: at {len(wrong)} nodes, as node {node} at {points[node]} m, the force of a uniform strain "
            f"differs by {off[node]:.3g} N from that of the elements around it, of which one makes {scale[node]:.3g} "
            "N. Is an element missing in cells, a modulus at the wrong place, or a node's number another?"
        )


def integrals(points: Array, cells: Array, hexahedra: bool) -> tuple[Array, Array]:
    """Volumes of elements, (ne,) [m3], and integrals of the gradients of their shape functions, (ne, k, 3) [m2]."""
    volume, gradients = np.zeros(len(cells)), np.zeros((*cells.shape, 3))
    for kind, rows in kinds_of(cells, hexahedra):
        x, volumes = points[cells[rows][:, kind.columns]], np.zeros(len(rows))
        slopes_of_nodes = np.zeros(x.shape)
        for weight, slopes in zip(kind.rule[1], kind.gradients, strict=True):
            r, s, t = (np.tensordot(x, slope, (1, 0)).T for slope in slopes.T)  # tangents, (3, ne)
            areas = np.stack([_cross(s, t), _cross(t, r), _cross(r, s)])
            volumes += weight * (r * areas[0]).sum(axis=0)
            slopes_of_nodes += weight * np.tensordot(slopes, areas, (1, 0)).transpose(2, 0, 1)
        volume[rows], gradients[rows] = volumes, kind.on_row(slopes_of_nodes)
    return volume, gradients


def _cross(a: Array, b: Array) -> Array:
    """Products of vectors, (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _spread(values: float | Array) -> str:
    low, high = np.min(values), np.max(values)
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
