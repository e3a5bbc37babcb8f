"""Points, elements, material, mass and stiffness of an FE model are of one model, or refused with what differs."""

from dataclasses import replace

import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from meshing.test_regions import glued
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.fe.material import Regions
from exudyn_partition.plasticity.dilatation import with_mean_dilatation

SOFT = ep.Material(E=7e9, nu=0.3, rho=1200.0)


def changed(matrix, row, column, share):
    """A matrix with one entry changed by a share of the largest."""
    change = sp.csr_matrix(([share * abs(matrix).max()], ([row], [column])), matrix.shape)
    return sp.csr_matrix(matrix + change)


def in_order(matrix, nodes):
    """A matrix with its nodes in another order."""
    dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
    return matrix[dofs][:, dofs]


def light_ones_below(fem):
    """An order of nodes that gives those of little mass to the lower places."""
    order = np.empty(fem.n_nodes, dtype=int)
    order[np.argsort(fem.points[:, 2])] = np.argsort(fem.lumped_mass)
    return order


def without(fem, cell):
    """Elements without one that touches the surface, and their masses; the matrices still have it."""
    kept = np.arange(len(fem.cells)) != cell
    return {"cells": fem.cells[kept], "cell_mass": fem.cell_mass[kept]}


def inverted(cells, some=slice(None)):
    """Two corners of some elements exchanged, with the nodes on their edges."""
    cells = cells.copy()
    cells[some] = cells[some, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    return cells


def softer(fem, cell, share):
    """Material of the same modulus, but for one element."""
    moduli = np.full(len(fem.cells), fem.material.E)
    moduli[cell] *= 1 + share
    return Regions(("",), (fem.material,), np.zeros(len(fem.cells), dtype=int), moduli)


WRONG = {
    "mass times 1000": (
        lambda fem: {"mass": 1000 * fem.mass},
        "mass: a motion along x moves 46.8 kg by the mass matrix, but the elements have 0.0468 kg .* 0.001 times",
    ),
    "mass along one axis": (
        lambda fem: {"mass": fem.mass @ sp.diags(np.tile([1, 1, 1.001], fem.n_nodes))},
        "mass: expected a symmetric matrix|mass: a motion along z",
    ),
    "stiffness times 1000": (
        lambda fem: {"stiffness": 1000 * fem.stiffness},
        "material: a uniform strain along x stores 1.4.*e[+]14 J/m3 by the stiffness matrix, but 1.4.*e[+]11 J/m3",
    ),
    "points times 2": (
        lambda fem: {"points": 2 * fem.points},
        "cell_mass: expected density times volume, 0.3744 kg in all, got 0.0468 kg",
    ),
    "a material of another density": (
        lambda fem: {"material": replace(ep.STEEL, rho=7850.0)},
        "cell_mass: expected density times volume, 0.0471 kg in all, got 0.0468 kg",
    ),
    "a material of another modulus": (
        lambda fem: {"material": replace(ep.STEEL, E=206e9)},
        "material: a uniform strain along x stores .* by E = 2.06e[+]11 Pa and nu = 0.3",
    ),
    "a material of another Poisson's ratio": (
        lambda fem: {"material": replace(ep.STEEL, nu=0.29)},
        "material: a uniform strain along x stores",
    ),
    "both constants, which leave the first modulus": (
        # lambda + 2 mu stays, mu does not
        lambda fem: {"material": replace(ep.STEEL, nu=0.2, E=210e9 * (0.7 / 1.3 / 0.4) / (0.8 / 1.2 / 0.6))},
        "material: a uniform (strain|shear)",
    ),
    "all in millimetres but the points": (
        lambda fem: {"material": ep.Material(E=210e3, nu=0.3, rho=7.8e-9)},
        "cell_mass: expected density times volume, 4.68e-14 kg in all",
    ),
    "mass of another order of nodes": (
        lambda fem: {"mass": in_order(fem.mass, light_ones_below(fem))},
        "mass: its centre lies .* m from that of the elements",
    ),
    "a missing element": (lambda fem: without(fem, 5), "mass: a motion along x|cell_mass"),
    "an inverted element": (
        lambda fem: {"cells": inverted(fem.cells, 0)},
        "cells: [0-9]+ pairs of elements overlap, .* the order of nodes is wrong",
    ),
    "all elements inverted": (
        lambda fem: {"cells": inverted(fem.cells)},
        "cells: ([0-9]+) of \\1 elements are inverted or have no volume, the first is element 0 at",
    ),
    "an unsymmetric mass": (
        lambda fem: {"mass": changed(fem.mass, 0, 3, 1e-6)},
        r"mass: expected a symmetric matrix, row and column [03] \(x of node [01]\) differ",
    ),
    "an unsymmetric stiffness": (
        lambda fem: {"stiffness": changed(fem.stiffness, 7, 3, 1e-6)},
        "stiffness: expected a symmetric matrix",
    ),
    "one triangle of the stiffness": (
        lambda fem: {"stiffness": sp.triu(fem.stiffness, format="csr")},
        "stiffness: expected a symmetric matrix",
    ),
    "a modulus at another place": (
        lambda fem: {"regions": softer(fem, 7, 0.1)},
        "material: a uniform strain|stiffness: at [0-9]+ nodes",
    ),
    "complex": (
        lambda fem: {"stiffness": fem.stiffness * (1 + 0.1j)},
        "stiffness: expected real numbers, got complex128",
    ),
    "complex and dense": (lambda fem: {"mass": fem.mass.toarray() * 1j}, "mass: expected numbers of shape"),
    "truth values": (lambda fem: {"mass": fem.mass.astype(bool)}, "mass: expected real numbers, got bool"),
    "a list": (lambda fem: {"mass": [1.0]}, "mass: expected a sparse matrix"),
    "nothing": (lambda fem: {"mass": None}, "mass: expected a sparse matrix"),
    "not square": (lambda fem: {"mass": fem.mass[:-3]}, "mass: expected shape"),
    "not finite": (lambda fem: {"mass": fem.mass * np.inf}, "mass: expected finite numbers, got [0-9]+ that are not"),
    "negative": (lambda fem: {"stiffness": -fem.stiffness}, "stiffness: .* diagonal entries are not positive"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_belong_together_is_refused(block, name):
    change, message = WRONG[name]
    with pytest.raises(InputError, match=message):
        replace(block, **change(block))


def test_two_elements_whose_moduli_are_exchanged_are_found():
    """All energies are the same; only forces at nodes tell."""
    shape = glued("hard", "soft")
    fem = ep.fe_model(shape, {"hard": ep.STEEL, "soft": SOFT}, maxh=5e-3)
    hard, soft = (np.flatnonzero(fem.regions.number == i) for i in (0, 1))
    one, other = next((i, j) for i in hard for j in soft if abs(fem.cell_volume[i] / fem.cell_volume[j] - 1) < 1e-9)
    number, moduli, masses = fem.regions.number.copy(), fem.regions.E.copy(), fem.cell_mass.copy()
    for values in (number, moduli, masses):
        values[[one, other]] = values[[other, one]]
    with pytest.raises(InputError, match=r"stiffness: at [0-9]+ nodes, as node [0-9]+ at"):
        replace(fem, regions=Regions(fem.regions.names, fem.regions.materials, number, moduli), cell_mass=masses)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("shape", ["half a ball", "tube"])
def test_coarse_elements_with_curved_sides_are_taken(order, shape):
    """They are integrated by points that are not exact there: this must not look like another material."""
    ball = occ.Sphere(occ.Pnt(0, 0, 0), 1e-2)
    tube = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, 5e-3, 1e-2) - occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, 4e-3, 1e-2)
    half = ball * occ.Box((-1, -1, 0), (1, 1, 1))
    fem = ep.fe_model({"half a ball": half, "tube": tube}[shape], ep.STEEL, maxh=8e-3, order=order)
    replace(fem)


def test_what_is_legal_stays_so(block, bricks):
    """Lumped masses, other formats, moduli by place, free plastic zones, and hexahedra."""
    lumped = replace(block, mass=block.lumped_mass_matrix)
    assert lumped.mass.nnz == block.n_dofs
    for kind in (sp.lil_matrix, sp.coo_matrix, sp.csc_matrix, sp.csr_array, sp.bsr_matrix, lambda m: m.toarray()):
        other = replace(block, mass=kind(block.mass), stiffness=kind(block.stiffness))
        for name in ("mass", "stiffness"):
            assert isinstance(getattr(other, name), sp.csr_matrix)
            assert abs(getattr(other, name) - getattr(block, name)).max() == 0
    graded = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=1e-2, modulus=lambda x: 210e9 * (1 + 50 * x[:, 2]))
    replace(graded)
    with_mean_dilatation(block, block.cells[:20], block.material)
    replace(bricks)


def test_entries_that_are_stored_in_parts_are_summed(block):
    """The user's matrix is not changed."""
    twice = block.mass.tocoo()
    parts = sp.csr_matrix(block.mass.shape)
    parts.data, parts.indices = np.repeat(twice.data / 2, 2), np.repeat(block.mass.indices, 2)
    parts.indptr = 2 * block.mass.indptr
    entries = parts.nnz
    model = replace(block, mass=parts)
    assert model.mass.nnz == block.mass.nnz
    assert abs(model.mass - block.mass).max() == 0
    assert parts.nnz == entries
