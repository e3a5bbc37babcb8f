"""The free body: growth of the contact-adapted basis until it has settled, and static answers in blocks."""

import tracemalloc

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from oracles import box, relative

import exudyn_partition as ep
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


def mobility(bar, end, body, f_cut=40e3):
    """Of the patch at frequencies below f_cut, by the shapes and the residual flexibility."""
    load = loads.pressure(bar, end.patches[0])
    s = 2 * np.pi * f_cut * np.array([0.05, 0.2, 0.45, 0.7, 0.95]) * (0.02 + 1j)
    squares = (body.rows(np.arange(bar.n_nodes)).T @ load) ** 2
    on_patch = loads.patch_rows(bar, end) @ load
    rest = on_patch @ body.basis.flexibility @ on_patch
    return np.array([x * (squares @ (1 / (body.stiffness.diagonal() + x**2)) + rest) for x in s])


@pytest.fixture(scope="module")
def exact_bar(bar_end):
    """The same with factors in double precision."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(free_body, "LARGE", np.inf)
        return ep.reduce(*bar_end, f_cut=40e3)


def test_krylov_vectors_of_large_bodies_need_few_digits(bar_end, adapted_bar, exact_bar):
    """Another basis of the same size, with the same mobility and the same static answers."""
    assert bar_end[0].n_dofs > free_body.LARGE
    assert not np.array_equal(adapted_bar.basis.omega, exact_bar.basis.omega)
    assert abs(adapted_bar.n_dofs - exact_bar.n_dofs) <= 3
    found = [mobility(*bar_end, body) for body in (adapted_bar, exact_bar)]
    assert relative(*found) < 0.1 * free_body.SETTLED
    static = []
    for body in (adapted_bar, exact_bar):
        rows = loads.patch_rows(*bar_end) @ body.basis.shapes[:, 6:] / body.basis.omega[6:]
        static.append(rows @ rows.T + body.basis.flexibility)
    assert relative(*static) < 1e-9


def test_krylov_vectors_that_would_be_too_rough_have_all_digits(bar_end, exact_bar, monkeypatch):
    monkeypatch.setattr(free_body, "ROUGH", 1e-9)
    np.testing.assert_array_equal(ep.reduce(*bar_end, f_cut=40e3).basis.omega, exact_bar.basis.omega)


def test_contact_adapted_leaves_out_what_an_axial_load_does_not_excite(bar_end, adapted_bar):
    residual = ep.reduce(*bar_end, basis="residual", f_cut=40e3)
    assert adapted_bar.n_dofs < 0.7 * residual.n_dofs


def test_static_answers_of_all_rows_are_never_held_at_once(monkeypatch):
    """Dense arrays of all dofs by all patch rows: 16 GB for a fine patch, of which its own rows are read."""
    fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=2e-3)
    part = ep.Partition.ball(fem, (0, 0, 0.03), 9e-3)
    rows, body = loads.patch_rows(fem, part), free_body.FreeBody(fem, part)
    flexibility = body.flexibility()
    tracemalloc.start()
    static = body.static_answers(flexibility)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.4 * 8 * fem.n_dofs * rows.shape[0]
    assert relative(static.at_patches, rows @ flexibility(rows.T.toarray())) < 1e-12
