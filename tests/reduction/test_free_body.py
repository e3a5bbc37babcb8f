"""The free body: growth of the contact-adapted basis until it has settled, and static answers in blocks."""

import tracemalloc
from dataclasses import replace

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from oracles import box, end, relative

import exudyn_partition as ep
from exudyn_partition.algebra.sparse import multifrontal, solver
from exudyn_partition.errors import IndefiniteMatrixError
from exudyn_partition.reduction import free_body, loads


@pytest.fixture(scope="module")
def bar_end():
    """A slim bar and its end: many vectors are needed to carry waves along it."""
    bar = ep.fe_model(box(0.009, 0.009, 0.3), ep.STEEL, maxh=0.01)
    return bar, ep.Partition.ball(bar, (0, 0, 0.3), 5e-3)


@pytest.fixture(scope="module")
def adapted_bar(bar_end):
    """As a large body is reduced."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(free_body, "LARGE", 1000)
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
        dynamic = (bar.stiffness + s**2 * bar.mass).tocsc()
        full = scipy.sparse.linalg.splu(dynamic, permc_spec="MMD_AT_PLUS_A").solve(load.astype(complex))
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
    assert bar_end[0].n_dofs < free_body.LARGE
    return ep.reduce(*bar_end, f_cut=40e3)


def test_krylov_vectors_of_large_bodies_need_few_digits(bar_end, adapted_bar, exact_bar):
    """Another basis of the same size, with the same mobility and the same static answers."""
    assert bar_end[0].n_dofs > 1000
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
    monkeypatch.setattr(free_body, "LARGE", 1000)
    monkeypatch.setattr(free_body, "ROUGH", 1e-9)
    np.testing.assert_array_equal(ep.reduce(*bar_end, f_cut=40e3).basis.omega, exact_bar.basis.omega)


def test_contact_adapted_leaves_out_what_an_axial_load_does_not_excite(bar_end, adapted_bar):
    residual = ep.reduce(*bar_end, basis="residual", f_cut=40e3)
    assert adapted_bar.n_dofs < 0.7 * residual.n_dofs


@pytest.mark.parametrize("basis", ["contact-adapted", "residual", "free", "craig-bampton"])
def test_a_mesh_is_put_in_order_once(basis, monkeypatch):
    """For all factors of a reduction, and for the next one; a Craig-Bampton basis orders what its boundary leaves."""
    fem, asked = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=1e-2), []
    find = multifrontal.find_fronts
    monkeypatch.setattr(multifrontal, "find_fronts", lambda *matrix: asked.append(1) or find(*matrix))
    tip, other = (ep.Partition.ball(fem, (0, 0, z), 6e-3) for z in (0.03, 0.0))
    ep.reduce(fem, tip, basis=basis, f_cut=100e3)
    first = len(asked)
    found = ep.reduce(fem, other, basis=basis, f_cut=80e3)
    assert (first, len(asked)) == ((1, 2) if basis == "craig-bampton" else (1, 1))
    anew = ep.reduce(replace(fem), other, basis=basis, f_cut=80e3)
    assert len(asked) > first
    np.testing.assert_array_equal(found.basis.omega, anew.basis.omega)


def test_static_answers_of_all_rows_are_never_held_at_once(monkeypatch):
    """Dense arrays of all dofs by all patch rows: 16 GB for a fine patch, of which its own rows are read."""
    fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=2.5e-3)
    part = ep.Partition.ball(fem, (0, 0, 0.03), 9e-3)
    rows, body = loads.patch_rows(fem, part), free_body.FreeBody(fem, part)
    flexibility = body.flexibility()
    tracemalloc.start()
    static = body.static_answers(flexibility)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.4 * 8 * fem.n_dofs * rows.shape[0]
    assert relative(static.at_patches, rows @ flexibility(rows.T.toarray())) < 1e-12


@pytest.fixture(scope="module")
def tube():
    """A thin tube, and its whole outer face: more cells of load patterns than modes."""
    solid = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.02, h=0.03)
    solid -= occ.Cylinder(occ.Pnt(0, 0, -1), occ.Z, r=0.019, h=2)
    fem = ep.fe_model(solid, ep.STEEL, maxh=4e-3)
    return fem, ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), 0.02))


@pytest.fixture(scope="module")
def all_modes(tube):
    """The same with all its modes below 60 kHz, which were counted."""
    return ep.reduce(*tube, f_cut=60e3, basis="residual")


def test_a_space_grows_with_the_modes_and_not_with_the_rows_of_a_large_patch(tube, all_modes):
    """Several vectors for each cell were 12 times as much work at four times the frequency."""
    f_cut, exact = 40e3, all_modes.basis.omega[6:]
    space = free_body.AdaptedSpace(*tube, f_cut)
    space.grow(f_cut)
    assert space.loads.shape[1] > 500
    assert space.krylov.size < 5 * len(exact) < 400
    found, inside = space.pairs(f_cut).omega, exact < 2 * np.pi * f_cut
    assert len(found) >= len(exact) - 2  # near 60 kHz, where nothing is promised
    np.testing.assert_allclose(found[: inside.sum()], exact[inside], rtol=1e-5)


def test_mobility_of_each_node_of_a_large_patch_is_that_of_all_modes_and_of_the_full_model(tube, all_modes):
    """Normal forces on single nodes, which no load of the space is like."""
    (fem, part), f_cut = tube, 40e3
    adapted, rows, some = ep.reduce(fem, part, f_cut=f_cut), loads.patch_rows(fem, part), slice(None, None, 97)
    for share in (0.05, 0.5, 0.95):
        s = 2 * np.pi * f_cut * share * (0.02 + 1j)
        found = []
        for body in (adapted, all_modes):
            on_shapes = rows[some] @ body.basis.shapes
            modal = (on_shapes / (body.basis.omega**2 + s**2)) @ on_shapes.T
            found.append(modal + body.basis.flexibility[some, some])
        assert relative(*found) < 0.05 * free_body.SETTLED
    dynamic, forces = (fem.stiffness + s**2 * fem.mass).tocsc(), rows[some].T.toarray().astype(complex)
    full = rows[some] @ scipy.sparse.linalg.splu(dynamic, permc_spec="MMD_AT_PLUS_A").solve(forces)
    assert relative(found[0], full) < free_body.SETTLED


@pytest.fixture(scope="module")
def plain_link(link_with_patch):
    """The same reduced as ever."""
    return ep.reduce(*link_with_patch, f_cut=60e3)


@pytest.fixture(scope="module")
def link_with_patch():
    """A bar with a patch, a rigid and an averaged interface."""
    fem = ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=4e-3)
    foot, side = (
        end(fem, 0.0),
        np.flatnonzero((fem.points[:, 0] < 1e-6) & (fem.points[:, 2] > 0.02) & (fem.points[:, 2] < 0.03)),
    )
    part = ep.Partition.ball(fem, (0.005, 0.004, 0.06), 3e-3) | ep.Partition.interface(fem, "foot", foot)
    return fem, part | ep.Partition.interface(fem, "side", side, kind="averaged")


@pytest.mark.parametrize("rough", [False, True], ids=["rounded factors", "factors that are too rough"])
def test_static_answers_of_huge_bodies_have_all_digits(link_with_patch, plain_link, rough, monkeypatch):
    """Their factors are rounded when each front has done its work, and solutions are refined."""
    monkeypatch.setattr(free_body, "HUGE", 0)

    def refuse(*_):
        raise IndefiniteMatrixError("too rough")

    if rough:
        monkeypatch.setattr(solver, "refined", refuse)
    body = ep.reduce(*link_with_patch, f_cut=60e3)
    np.testing.assert_allclose(body.basis.omega, plain_link.basis.omega, rtol=1e-9)
    assert relative(body.basis.flexibility, plain_link.basis.flexibility) < 1e-9
    rows = [
        (loads.patch_rows(*link_with_patch) @ one.basis.shapes[:, 6:] / one.basis.omega[6:])
        for one in (body, plain_link)
    ]
    assert relative(*(one @ one.T for one in rows)) < 1e-9
