"""Functions of one order more: with those of a model they are the space of the next order."""

import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from oracles import box, hexahedra, write

import exudyn_partition as ep
from exudyn_partition.errors import MeshError
from exudyn_partition.fe.shapes import shape_functions
from exudyn_partition.meshing.ngsolve_fem import surplus_of


@pytest.mark.parametrize("order", [1, 2])
def test_surplus_completes_the_space_of_the_next_order(order):
    """Forces at points of a facet do the same work in both; four nodes are held."""
    shape = box(0.01, 0.02, 0.03)
    low, high = (ep.fe_model(shape, ep.STEEL, order=k, maxh=9e-3) for k in (order, order + 1))
    surplus = surplus_of(low)
    assert low.n_dofs + 3 * surplus.size == high.n_dofs
    facet, local = low.facets[3], np.array([[0.2, 0.3], [0.7, 0.1]])
    theirs = high.facets[(np.sort(high.facets[:, :3], axis=1) == np.sort(facet[:3])).all(axis=1)][0]
    turn = [list(theirs[:3]).index(node) for node in facet[:3]]
    shares = np.column_stack([1 - local.sum(axis=1), local])
    at_theirs = np.empty_like(shares)
    at_theirs[:, turn] = shares

    def load(fem, nodes, places):
        values = np.zeros((fem.n_nodes, 3))
        np.add.at(values, nodes, np.outer(shape_functions(places, len(nodes))[:, 0].sum(axis=0), [1.0, 2.0, 3.0]))
        return values.ravel()

    fixed = np.unique(low.cells[0, :4])
    free = np.setdiff1d(np.arange(low.n_dofs), (3 * fixed[:, None] + np.arange(3)).ravel())
    on_surplus = np.outer(np.asarray(surplus.values_at(np.tile(facet[:3], (2, 1)), local).sum(axis=0)), [1.0, 2.0, 3.0])
    whole = sp.bmat(
        [[low.stiffness[free][:, free], surplus.coupling[:, free].T], [surplus.coupling[:, free], surplus.stiffness]]
    )
    f = np.r_[load(low, facet, local)[free], on_surplus.ravel()]
    work = f @ scipy.sparse.linalg.spsolve(sp.csc_matrix(whole), f)
    free = np.setdiff1d(np.arange(high.n_dofs), (3 * fixed[:, None] + np.arange(3)).ravel())
    f = load(high, theirs, at_theirs[:, 1:])[free]
    expected = f @ scipy.sparse.linalg.spsolve(sp.csc_matrix(high.stiffness[free][:, free]), f)
    assert work == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_rigid_motion_strains_no_surplus(order):
    fem = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.01, h=0.01), ep.STEEL, order=order, maxh=0.02)
    surplus = surplus_of(fem)
    assert abs(surplus.coupling @ fem.rigid_modes).max() < 1e-10 * abs(surplus.coupling).max()
    accelerated = surplus.mass_coupling @ fem.rigid_modes[:, :3]
    assert accelerated.shape == (3 * surplus.size, 3)
    np.linalg.cholesky(surplus.stiffness.toarray())  # raises unless it is positive definite


def test_hexahedra_have_none(tmp_path):
    fem = ep.fe_model(write(tmp_path / "box.vtu", *hexahedra(2, 2, 2)), ep.STEEL)
    with pytest.raises(MeshError, match="expected tetrahedra"):
        surplus_of(fem)
