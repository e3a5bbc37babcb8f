"""Mass and stiffness that another program assembled: their order, and whether they fit to the body's surface.

Without elements the surface still tells what the body inside has: by the divergence theorem its volume and its centre,
and the forces at all nodes under a uniform strain, which any element makes in balance with the traction on its sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import InputError, MeshError
from ..support.arrays import Array
from ..support.checks import check_indices, validate_type, validate_whole
from .consistency import (
    ALL_STRAINS,
    CENTRE,
    EQUAL,
    UNIFORM_STRAINS,
    check_energies,
    check_moved_mass,
    check_symmetric,
    largest_entry,
    plain_matrix,
)
from .facets import area_vectors, facet_corners
from .material import Material, Regions
from .quadrature import facet_forces
from .shapes import CELL_FACES

_SAME = 1e-6  # of the masses along x, y and z, and of those between them, by the largest
_HELD = 1e6  # largest by median of the stiffness' diagonal entries; penalties and 1e36 of held dofs are beyond
_CURVED = 0.01  # error of volumes by a few points in curved elements, by what curves add to flat facets (1e-5)
_BALANCE = 0.01  # of a node's force under a uniform strain, by the sum of those that its neighbours make


def ordered(name: str, matrix: Any, n_nodes: int, dofs: Array | None) -> sp.csr_matrix:
    """Matrix as csr in the order x y z of node after node, with both triangles exactly alike.

    Parameters
    ----------
    name : str
    matrix : (3n, 3n) sparse matrix or array
    n_nodes : int
    dofs : (3n, 2) int array or None
        Node and direction, 0 to 2, of each row; None if they are in order.

    Raises
    ------
    MeshError
        If it is no such matrix, or not symmetric.
    InputError
        If `dofs` has not each direction of each node once.
    """
    plain = plain_matrix(name, matrix, 3 * n_nodes)
    check_symmetric(name, plain, EQUAL)
    if dofs is not None:
        place = _places(dofs, n_nodes)
        moved = plain.tocoo()
        plain = sp.csr_matrix((moved.data, (place[moved.row], place[moved.col])), shape=plain.shape)
    turned = plain.T.tocsr()  # whose columns are in order
    both = turned + turned.T.tocsr()
    both.data *= 0.5
    return both


def _places(dofs: Array, n_nodes: int) -> Array:
    """Row of each dof in the order x y z of node after node."""
    numbers = validate_whole("dofs", dofs, "whole numbers of shape (3n, 2), node and direction of each row")
    check_indices("dofs", numbers, (3 * n_nodes, 2), None)
    node, direction = numbers.T
    if node.max(initial=0) >= n_nodes or direction.max(initial=0) > 2:
        raise InputError(
            f"dofs: expected rows of points, 0 to {n_nodes - 1}, and directions 0 to 2, got nodes up to {node.max()} "
            f"and directions up to {direction.max()}. Programs count both from 1"
        )
    place = 3 * node + direction
    missing = np.setdiff1d(np.arange(3 * n_nodes), place)
    if len(missing):
        raise InputError(
            f"dofs: expected each direction of each node once; {len(missing)} are missing, the first is "
            f"{'xyz'[missing[0] % 3]} of node {missing[0] // 3}"
        )
    return np.asarray(place)


def given_material(material: object, regions: object = None) -> Material:
    """Return the one material of a model of a surface, or of elements without names.

    Raises
    ------
    InputError
        If there are several, or `regions` without several.
    """
    if isinstance(material, Mapping):
        raise InputError("material: several need cells= and regions=, the name of the material of each element")
    if regions is not None:
        raise InputError("regions: has no effect with one material; give {name: Material}, and cells=")
    validate_type("material", material, Material, "ep.Material()")
    assert isinstance(material, Material)
    return material


def given_elastic(material: object, regions: object, n: int) -> Material | Regions:
    """Elastic constants of n elements: the one material, or those that `regions` name.

    Raises
    ------
    InputError
        If names and materials do not belong together.
    """
    if not isinstance(material, Mapping) or regions is None:
        return given_material(material, regions)
    for name, given in material.items():
        validate_type(f"material[{name!r}]", given, Material, "ep.Material()")
    names = np.asarray(regions)
    if names.dtype.kind not in "UO" or names.shape != (n,):
        raise InputError(f"regions: expected {n} names, one for each element, got {names.dtype} of shape {names.shape}")
    keys = list(material)
    if set(names.tolist()) != set(keys):
        raise InputError(
            f"material: expected one for each name of regions, {sorted(map(str, set(names.tolist())))[:8]}, got {keys}"
        )
    number = np.array([keys.index(name) for name in names.tolist()], dtype=np.int64)
    materials = tuple(material.values())
    return Regions(tuple(keys), materials, number, np.array([given.E for given in materials])[number])


def check_free(mass: sp.csr_matrix, stiffness: sp.csr_matrix) -> None:
    """Refuse matrices with held nodes, with masses that differ by direction, or of several bodies.

    Raises
    ------
    InputError
    MeshError
    """
    diagonal = stiffness.diagonal()
    held = np.flatnonzero(diagonal > _HELD * np.median(diagonal))
    if len(held):
        raise InputError(
            f"stiffness: {len(held)} diagonal entries, as that of {'xyz'[held[0] % 3]} of node {held[0] // 3}, are "
            f"{diagonal[held].max() / np.median(diagonal):.3g} times as large as others: dofs are held there. Expected "
            "a free body; remove the boundary conditions, and write the matrices anew"
        )
    plain = mass.tocoo()
    across = (plain.row - plain.col) % 3 != 0
    parts = [mass[i::3, i::3] for i in range(3)]
    apart = max(largest_entry(parts[0] - parts[i]) for i in (1, 2))
    coupled = abs(plain.data[across]).max(initial=0.0)
    if max(apart, coupled) > _SAME * largest_entry(mass):
        what = "couple x, y and z" if coupled > apart else "differ between x, y and z"
        raise InputError(
            f"mass: its entries {what} by {max(apart, coupled):.3g} kg, expected one mass between each two nodes, the "
            "same along x, y and z, as solid elements have. Is the order of dofs another (dofs=), or has the model "
            "beams, shells or masses on arms besides?"
        )
    n, numbers = connected_components(stiffness, directed=False)
    if n > 1:
        sizes = np.sort(np.bincount(numbers))[::-1]
        raise MeshError(
            f"stiffness: {n} parts are not connected, of {', '.join(str(s) for s in sizes[:5])} dofs; expected one "
            "body. Make one FE model of each, and leave out nodes that belong to no element"
        )


def cells_beneath(facets: Array) -> int:
    """Number of nodes of the elements that have such facets, (nf, k).

    Raises
    ------
    MeshError
        If we have none.
    """
    sizes = [n for n, faces in CELL_FACES.items() if faces.shape[1] == facets.shape[1]]
    if facets.shape[1] == 8:
        sizes = [20]
    if not sizes or not len(facets):
        raise MeshError(
            f"facets: expected triangles with 3, 6 or 10 nodes or quads with 4 or 8, got {len(facets)} facets of "
            f"{facets.shape[1]} nodes; corners first, then the nodes on edges"
        )
    return sizes[0]


def check_surface(points: Array, facets: Array) -> float:
    """Volume inside a surface [m3]; refuse one that is open or turned inside out.

    Raises
    ------
    MeshError
    """
    corners = facet_corners(facets)
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    real = starts != ends  # a triangle among quadrilaterals has one corner twice
    starts, ends = starts[real], ends[real]
    number = np.unique(np.sort(np.column_stack([starts, ends]), axis=1), axis=0, return_inverse=True)[1].ravel()
    count, turn = np.bincount(number), np.bincount(number, np.where(starts < ends, 1, -1))
    for wrong, said in (
        (count != 2, "edges that two facets have in common; the surface is open there, or facets are there twice"),
        (turn != 0, "outward facets, whose common edges run opposite ways; one of two is turned there"),
    ):
        if wrong.any():
            at = int(np.flatnonzero(wrong[number])[0])
            raise MeshError(
                f"facets: expected the whole surface of the body: {np.count_nonzero(wrong)} edges are not such of "
                f"{said}. The first is between nodes {starts[at]} and {ends[at]}"
            )
    volume = enclosed_volume(points, facets)
    if volume <= 0:
        raise MeshError(
            f"facets: they enclose {volume:.4g} m3, expected a positive volume, with corners that turn "
            "counter-clockwise seen from outside; reverse their order: facets[:, ::-1] of linear ones"
        )
    return volume


def enclosed_volume(points: Array, facets: Array) -> float:
    """Volume inside a closed surface of facets, which may be curved [m3]."""
    return float(-np.einsum("fkd,fkd->", points[facets], facet_forces(points, facets, None)) / 3)


def _centre(points: Array, facets: Array) -> Array:
    """Centre, (3,) [m], of the volume inside a closed surface, whose facets are taken as flat."""
    corners = facet_corners(facets)
    fans = [corners[:, [0, i, i + 1]] for i in range(1, corners.shape[1] - 1)]
    middle = points.mean(axis=0)
    a, b, c = (points[np.concatenate(fans)] - middle).transpose(1, 0, 2)
    volumes = np.einsum("ti,ti->t", a, np.cross(b, c))  # six times those of tetrahedra between facets and the middle
    return np.asarray(middle + volumes @ (a + b + c) / (4 * volumes.sum()))


def check_against_surface(
    points: Array, facets: Array, mass: sp.csr_matrix, stiffness: sp.csr_matrix, material: Material
) -> None:
    """Compare matrices with a material and with the closed surface of the body.

    Raises
    ------
    InputError
        If the mass is not density times volume, uniform strains store another energy, or forces at nodes differ from
        those of the tractions.
    """
    volume = enclosed_volume(points, facets)
    vectors = area_vectors(points, facets)
    flat = float(np.einsum("fkd,fd->", points[facet_corners(facets)], vectors) / (3 * facet_corners(facets).shape[1]))
    equal = EQUAL + _CURVED * abs(volume - flat) / volume
    expected = material.rho * volume
    check_moved_mass(mass, expected, f"density times the volume inside the facets is {expected:.6g} kg", equal)
    size, centre = np.ptp(points, axis=0).max(), _centre(points, facets)
    weights = (mass @ np.ones(mass.shape[0])).reshape(-1, 3).mean(axis=1)
    away = np.linalg.norm(weights @ points / weights.sum() - centre)
    if away > CENTRE * size:
        raise InputError(
            f"mass: its centre lies {away:.4g} m from that of the volume inside the facets, expected the same; is the "
            "order of nodes another?"
        )
    motions = np.einsum("na,vab->nbv", points - points.mean(axis=0), UNIFORM_STRAINS).reshape(-1, 6)
    forces = stiffness @ motions
    check_energies(motions.T @ forces, np.array([volume]), material, equal)
    strain = np.einsum("v,vab->ab", ALL_STRAINS, UNIFORM_STRAINS)
    stress = material.lame * np.trace(strain) * np.eye(3) + 2 * material.shear_modulus * strain
    tractions = -facet_forces(points, facets, None) @ stress
    at_nodes = np.column_stack(
        [np.bincount(facets.ravel(), t.ravel(), len(points)) for t in tractions.T.swapaxes(1, 2)]
    )
    off = np.linalg.norm((forces @ ALL_STRAINS).reshape(-1, 3) - at_nodes, axis=1)
    scale = _pulls(stiffness, (motions @ ALL_STRAINS).reshape(-1, 3))
    wrong = np.flatnonzero(off > max(_BALANCE, equal) * scale)
    if len(wrong):
        node = int(wrong[(off[wrong] / scale[wrong]).argmax()])
        raise InputError(
            f"stiffness: at {len(wrong)} nodes, as node {node} at {points[node]} m, the force of a uniform strain is "
            f"{off[node]:.3g} N away from that of the traction on the facets around, where neighbours make "
            f"{scale[node]:.3g} N. Is the order of nodes or dofs another, an element or a facet missing, or a part of "
            "another material?"
        )


def _pulls(stiffness: sp.csr_matrix, motion: Array) -> Array:
    """Sum of the sizes of the forces, (n,) [N], that each node's neighbours make by a motion of theirs, (n, 3) [m]."""
    blocks, node = _coupled(stiffness)
    forces = np.einsum("bij,bj->bi", blocks.data, motion[blocks.indices] - motion[node])
    return np.bincount(node, np.linalg.norm(forces, axis=1), len(motion))


def _coupled(stiffness: sp.csr_matrix) -> tuple[sp.bsr_matrix, Array]:
    """Blocks of three by three of a stiffness, and the node of each block's rows."""
    blocks = sp.bsr_matrix(stiffness, blocksize=(3, 3))
    return blocks, np.repeat(np.arange(stiffness.shape[0] // 3), np.diff(blocks.indptr))


def reach(points: Array, stiffness: sp.csr_matrix) -> Array:
    """(n,) array: distance of each node from the farthest one that the stiffness couples it with [m]."""
    blocks, node = _coupled(stiffness)
    farthest = np.zeros(len(points))
    np.maximum.at(farthest, node, np.linalg.norm(points[blocks.indices] - points[node], axis=1))
    return farthest


def lumped_by_diagonal(mass: sp.csr_matrix) -> Array:
    """(n,) array: nodal masses [kg], the diagonal of the mass matrix scaled to its total.

    This is HRZ lumping if all elements are of one kind and of straight sides; a lumped mass stays as it is.
    """
    diagonal = mass.diagonal().reshape(-1, 3).mean(axis=1)
    return np.asarray(diagonal * (mass.sum() / 3 / diagonal.sum()))
