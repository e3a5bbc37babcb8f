"""The free body: growth of the contact-adapted basis until it has settled, and static answers in blocks."""

import tracemalloc

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from oracles import relative

import exudyn_partition as ep
from exudyn_partition.fe.patches import Patch
from exudyn_partition.reduction import free_body, loads


@pytest.fixture(scope="module")
def bar_end():
    """A slim bar and its end: many vectors are needed to carry waves along it."""
    bar = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.005, h=0.3), ep.STEEL, maxh=0.01)
    return bar, ep.Partition.ball(bar, (0, 0, 0.3), 4e-3)


@pytest.fixture(scope="module")
def adapted_bar(bar_end):
    return ep.reduce(*bar_end, f_cut=40e3)


def test_contact_adapted_basis_grows_until_it_has_settled(bar_end, adapted_bar):
    """Mobility of the patch on the line on which growth is judged, against the full FE model."""
    bar, end = bar_end
    f_cut, body = 40e3, adapted_bar
    load = loads.pressure(bar, end.patches[0])
    reduced_load = body.rows(np.arange(bar.n_nodes)).T @ load
    F = body.basis.flexibility
    on_patch = loads.patch_rows(bar, end) @ load
    got, expected = [], []
    for share in (0.05, 0.2, 0.45, 0.7, 0.95):
        s = 2 * np.pi * f_cut * share * (0.02 + 1j)
        full = scipy.sparse.linalg.spsolve((bar.stiffness + s**2 * bar.mass).tocsc(), load)
        expected.append(s * (load @ full))
        modal = reduced_load**2 @ (1 / (body.stiffness.diagonal() + s**2))
        got.append(s * (modal + on_patch @ F @ on_patch))
    assert relative(np.array(got), np.array(expected)) < free_body.SETTLED
    assert body.n_dofs > 26


def test_contact_adapted_leaves_out_what_an_axial_load_does_not_excite(bar_end, adapted_bar):
    residual = ep.reduce(*bar_end, basis="residual", f_cut=40e3)
    assert adapted_bar.n_dofs < 0.7 * residual.n_dofs


def test_static_answers_of_all_rows_are_never_held_at_once(block, monkeypatch):
    """Dense arrays of all dofs by all patch rows: 16 GB for a fine patch, of which its own rows are read."""
    whole = Patch(block.facets, np.array([0, 0, 1.0]), np.empty(0, dtype=np.int64))
    part = ep.Partition(whole.nodes, (whole,), (), block.n_nodes, block.fingerprint)
    body = free_body.FreeBody(block, part)
    flexibility = body.flexibility()
    expected = flexibility(loads.patch_rows(block, part).T.toarray())
    expected = loads.patch_rows(block, part) @ expected
    monkeypatch.setattr(free_body, "columns", lambda n: 8)
    tracemalloc.start()
    static = body.static_answers(flexibility)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.8 * 8 * block.n_dofs * len(whole.nodes)
    assert relative(static.at_patches, expected) < 1e-12
