"""The bases against the full FE model: reduced matrices, static exactness, dynamics, full-basis limit."""

import math
import re
import tracemalloc

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from conftest import SPHERE_RADIUS, box, relative
from hypothesis import given, settings
from hypothesis import strategies as st

import exudyn_partition as ep
from exudyn_partition.errors import FrequencyRangeError, InputError, MemoryLimitError, MemoryWarning
from exudyn_partition.fe.model import rigid_modes
from exudyn_partition.fe.patches import Patch
from exudyn_partition.reduction import free_body, loads, memory

BASES = ["free", "craig-bampton", "residual", "contact-adapted"]


@pytest.fixture(scope="module", params=BASES)
def body(request, block, top):
    return ep.reduce(block, top, basis=request.param, f_cut=80e3)


def dense_basis(body):
    """T as a dense matrix, column by column."""
    return np.column_stack([body.displacement(unit).ravel() for unit in np.eye(body.n_dofs)])


def mass_matrix(fem, body):
    return fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix


def test_reduced_matrices_are_those_of_a_dense_product(block, body):
    T = dense_basis(body)
    for reduced, full in ((body.mass, mass_matrix(block, body)), (body.stiffness, block.stiffness)):
        expected = T.T @ (full @ T)
        np.testing.assert_allclose(reduced.toarray(), expected, atol=1e-9 * abs(expected).max())
    assert np.linalg.eigvalsh(body.mass.toarray())[0] > 0


def test_rigid_motion_is_in_every_basis(block, body):
    motion = np.array([0.1, -0.2, 0.3, 4.0, 5.0, -6.0])
    np.testing.assert_allclose(body.displacement(body.rigid @ motion).ravel(), block.rigid_modes @ motion, atol=1e-9)


def test_rows_are_rows_of_the_basis(body):
    T = dense_basis(body)
    nodes = np.r_[body.partition.nodes[::7], 0]
    rows = body.rows(nodes)
    rows = rows if isinstance(rows, np.ndarray) else rows.toarray()
    np.testing.assert_array_equal(rows, T.reshape(-1, 3, body.n_dofs)[nodes].reshape(-1, body.n_dofs))


@pytest.mark.parametrize("basis", ["craig-bampton", "residual", "contact-adapted"])
def test_static_exactness(block, top, basis):
    """A self-equilibrated answer to any load on the patch is the full FE one at the patch."""
    body = ep.reduce(block, top, basis=basis, f_cut=80e3)
    nodes = top.patch_nodes
    load = np.random.default_rng(0).random(len(nodes))
    if basis == "craig-bampton":  # whose constraint modes answer the patch alone, not the inertia of rigid motion
        resultants = (rigid_modes(block.points[nodes]).reshape(-1, 3, 6) * top.patches[0].direction[:, None]).sum(
            axis=1
        )
        load -= resultants @ np.linalg.lstsq(resultants, load, rcond=None)[0]
    full_load = np.zeros((block.n_nodes, 3))
    full_load[nodes] = load[:, None] * top.patches[0].direction
    rigid = block.rigid_modes
    inertia = rigid.T @ (block.mass @ rigid)
    balanced = full_load.ravel() - block.mass @ rigid @ np.linalg.solve(inertia, rigid.T @ full_load.ravel())
    held = block.stiffness + block.mass @ rigid @ rigid.T @ block.mass * 1e16  # removes the null space, dense but small
    u = scipy.linalg.solve(np.asarray(held.todense() if hasattr(held, "todense") else held), balanced, assume_a="pos")
    u -= rigid @ np.linalg.solve(inertia, rigid.T @ (block.mass @ u))
    expected = u.reshape(-1, 3)[nodes] @ top.patches[0].direction

    G = body.rows(nodes).reshape(len(nodes), 3, -1).transpose(0, 2, 1) @ top.patches[0].direction
    elastic = body.basis.omega > 0
    modal = G[:, elastic] @ ((G[:, elastic].T @ load) / body.basis.omega[elastic] ** 2)
    if body.basis.flexibility is not None:
        modal = modal + body.basis.flexibility @ load
    assert relative(modal, expected) < 1e-8


def receptance_defect(block, body, top, frequency):
    """What the reduced body lacks of the patch's answer to a uniform harmonic load on it, and that answer [m]."""
    nodes = top.patch_nodes
    omega_squared = (2 * np.pi * frequency) ** 2
    full_load = np.zeros((block.n_nodes, 3))
    full_load[nodes] = top.patches[0].direction
    dynamic = (block.stiffness - omega_squared * mass_matrix(block, body)).tocsc()
    full = full_load.ravel() @ scipy.sparse.linalg.spsolve(dynamic, full_load.ravel())
    rows = body.rows(nodes)
    rows = (rows if isinstance(rows, np.ndarray) else rows.toarray()).reshape(len(nodes), 3, -1)
    load = np.einsum("kdn,d->n", rows, top.patches[0].direction)
    reduced = (body.stiffness - omega_squared * body.mass).toarray()
    answer = load @ np.linalg.solve(reduced, load)
    if body.basis.flexibility is not None:
        answer += body.basis.flexibility.sum()
    return full - answer, full


@pytest.mark.parametrize("f_cut", [80e3, 150e3])
@pytest.mark.parametrize("frequency", [5e3, 20e3, 33e3])
def test_residual_basis_lacks_only_the_inertia_of_what_is_cut(block, top, f_cut, frequency):
    """Their p^2 (1/(w_k^2 - w^2) - 1/w_k^2) > 0 is below w^2 / (w_cut^2 - w^2) times their static answer."""
    body = ep.reduce(block, top, basis="residual", f_cut=f_cut)
    defect, _ = receptance_defect(block, body, top, frequency)
    assert 0 < defect < frequency**2 / (f_cut**2 - frequency**2) * body.basis.flexibility.sum()


@pytest.mark.parametrize("frequency", [5e3, 20e3, 33e3])
def test_contact_adapted_basis_lacks_no_more_than_the_residual_one(block, top, frequency):
    residual, adapted = (ep.reduce(block, top, basis=basis, f_cut=80e3) for basis in ("residual", "contact-adapted"))
    lacking = abs(receptance_defect(block, residual, top, frequency)[0])
    assert abs(receptance_defect(block, adapted, top, frequency)[0]) < 1.1 * lacking


def test_the_paper_s_basis_lacks_the_static_field(block, top):
    """What method.md says of it: at equal truncation the free basis is far too stiff at the contact."""
    defect = {}
    for basis in BASES:
        body = ep.reduce(block, top, basis=basis, f_cut=80e3)
        lacking, full = receptance_defect(block, body, top, 5e3)
        defect[basis] = lacking / abs(full)
    assert defect["free"] > 10 * abs(defect["contact-adapted"])


def test_region_that_covers_the_body_is_the_full_model(block):
    everything = ep.Partition.ball(block, (0, 0, 0.03), 1.0, contact_radius=7e-3)
    body = ep.reduce(block, everything, basis="free", f_cut=80e3)
    assert body.n_dofs == block.n_dofs
    assert abs(body.stiffness - block.stiffness).max() == 0
    np.testing.assert_array_equal(body.mass.diagonal(), np.repeat(block.lumped_mass, 3))


@pytest.mark.parametrize("n_outside", [1, 2, 4, 12])
def test_region_that_nearly_covers_the_body_loses_no_motion(block, n_outside):
    """A few nodes outside have fewer dofs than the modes that are kept there: what depends on the rest is left out."""
    part = ep.Partition.ball(block, (0, 0, 0.03), 7e-3)
    outside = np.argsort(-np.linalg.norm(block.points - np.array([0, 0, 0.03]), axis=1))[:n_outside]
    nodes = np.delete(np.arange(block.n_nodes), outside)
    body = ep.reduce(
        block, ep.Partition(nodes, part.patches, (), block.n_nodes, block.fingerprint), basis="free", f_cut=80e3
    )
    assert body.n_dofs == block.n_dofs - max(0, 3 * n_outside - body.n_shapes)
    T = dense_basis(body)
    np.testing.assert_allclose(body.mass.toarray(), T.T @ (block.lumped_mass_matrix @ T), atol=1e-12)
    np.testing.assert_allclose(T @ body.rigid, block.rigid_modes, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(radius=st.floats(3e-3, 25e-3), f_cut=st.floats(60e3, 120e3))
def test_free_basis_frequencies_are_never_below_the_full_ones(block, radius, f_cut):
    """Rayleigh-Ritz: a reduced model is stiffer than the full one, whatever the region."""
    partition = ep.Partition.ball(block, (0, 0, 0.03), radius)
    body = ep.reduce(block, partition, basis="free", f_cut=f_cut)
    reduced = scipy.linalg.eigvalsh(body.stiffness.toarray(), body.mass.toarray())[6:10]
    full = _lumped_eigenvalues(block)[6:10]
    assert (reduced > full * (1 - 1e-9)).all()


_CACHE = {}


def _lumped_eigenvalues(fem):
    if id(fem) not in _CACHE:
        _CACHE[id(fem)] = scipy.linalg.eigvalsh(
            fem.stiffness.toarray(), fem.lumped_mass_matrix.toarray(), subset_by_index=(0, 12)
        )
    return _CACHE[id(fem)]


@pytest.fixture(scope="module")
def bar_end():
    """A slim bar and its end: many vectors are needed to carry waves along it."""
    bar = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.005, h=0.4), ep.STEEL, maxh=0.01)
    return bar, ep.Partition.ball(bar, (0, 0, 0.4), 4e-3)


def test_contact_adapted_basis_grows_until_it_has_settled(bar_end):
    """Mobility of the patch on the line on which growth is judged, against the full FE model."""
    bar, end = bar_end
    f_cut = 40e3
    body = ep.reduce(bar, end, f_cut=f_cut)
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
    assert relative(np.array(got), np.array(expected)) < free_body._SETTLED
    assert body.n_dofs > 26


def test_contact_adapted_leaves_out_what_an_axial_load_does_not_excite(bar_end):
    adapted, residual = (ep.reduce(*bar_end, basis=basis, f_cut=40e3) for basis in ("contact-adapted", "residual"))
    assert adapted.n_dofs < 0.7 * residual.n_dofs


def test_a_body_prints_itself(body):
    assert body.basis.name in repr(body)
    lines = body.table().splitlines()
    assert len(lines) == len(body.labels) == body.n_dofs
    assert all("Hz" in sentence or "(" in sentence or "recovery" in sentence for sentence in body.left_out)


def test_frequency_above_what_the_mesh_resolves(block, top):
    with pytest.raises(FrequencyRangeError, match=r"the mesh resolves .* Refine it to elements of .* or lower f_cut"):
        ep.reduce(block, top, f_cut=1e7)


def test_the_proposed_maxh_resolves_the_frequency(block, top):
    f_cut = 2 * block.resolved_frequency
    with pytest.raises(FrequencyRangeError, match="with a maxh of about") as caught:
        ep.reduce(block, top, f_cut=f_cut)
    maxh = float(re.search(r"maxh of about ([^,]*),", str(caught.value))[1])
    assert ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=maxh).resolved_frequency > f_cut


def test_what_is_left_out_above_says_how_to_keep_it(block, top, ball):
    (said,) = (s for s in ep.reduce(block, top, f_cut=80e3).left_out if s.startswith("the dynamics"))
    assert "motion above 120000 Hz, 1.5 f_cut (f_cut raises that)" in said
    (said,) = (s for s in ep.reduce(*ball, tolerance=0.5).left_out if s.startswith("the dynamics"))
    assert "(a smaller tolerance keeps more)" in said


@pytest.mark.parametrize("basis", ["free", "craig-bampton"])
def test_no_mode_below_the_truncation_frequency(block, top, basis):
    with pytest.raises(FrequencyRangeError, match=r"no elastic mode lies below 100 Hz.*take .*contact-adapted"):
        ep.reduce(block, top, basis=basis, f_cut=100.0)


@pytest.mark.parametrize("basis", ["contact-adapted", "residual"])
def test_a_compact_body_is_rigid_but_for_its_contact(ball, basis):
    """At what Hertz's impact asks for, which lies below all modes of a ball; F is the whole static answer."""
    fem, part = ball
    f_cut = ep.hertz.impact(fem.total_mass, 0.01, SPHERE_RADIUS, math.inf, ep.STEEL).truncation_frequency()
    body = ep.reduce(fem, part, basis=basis, f_cut=f_cut)
    assert body.n_dofs == 6
    assert body.left_out[0].startswith("all vibration: the body is rigid but for the static answer of its contact")
    richer = ep.reduce(fem, part, basis="residual", f_cut=160e3)
    at_patch = richer.rows(part.patches[0].nodes)[:, 6:].reshape(-1, 3, richer.n_dofs - 6)
    at_patch = np.einsum("kdn,d->kn", at_patch, part.patches[0].direction) / richer.basis.omega[6:]
    assert relative(body.flexibility(), richer.flexibility() + at_patch @ at_patch.T) < 1e-9


def test_a_frequency_that_round_off_hides(block, top):
    with pytest.raises(FrequencyRangeError, match=r"round-off hides modes among the rigid ones, got 0\.001 Hz"):
        ep.reduce(block, top, basis="residual", f_cut=1e-3)


def test_bad_arguments(block, top, sphere):
    with pytest.raises(InputError, match=r"basis: expected one of 'free', 'craig-bampton', .*, got 'cms'"):
        ep.reduce(block, top, basis="cms", f_cut=1e5)
    for f_cut in (float("nan"), 0.0, -1.0):
        with pytest.raises(InputError, match=f"f_cut: expected a finite number above zero in Hz, got {f_cut}"):
            ep.reduce(block, top, f_cut=f_cut)
    with pytest.raises(InputError, match="made for another mesh"):
        ep.reduce(block, sphere[1], f_cut=1e5)


def test_static_answers_of_all_rows_are_never_held_at_once(block, monkeypatch):
    """Dense arrays of all dofs by all patch rows: 16 GB for a fine patch, of which its own rows are read."""
    whole = Patch(block.facets, np.array([0, 0, 1.0]), np.empty(0, dtype=np.int64))
    part = ep.Partition(whole.nodes, (whole,), (), block.n_nodes, block.fingerprint)
    body = free_body.FreeBody(block, part)
    flexibility = body.flexibility()
    expected = flexibility(loads.patch_rows(block, part).T.toarray())
    expected = loads.patch_rows(block, part) @ expected
    monkeypatch.setattr(free_body, "COLUMNS", 8)
    tracemalloc.start()
    static = body.static_answers(flexibility)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.8 * 8 * block.n_dofs * len(whole.nodes)
    assert relative(static.at_patches, expected) < 1e-12


def test_memory_is_told_before_it_is_asked_for(block, top, monkeypatch):
    need = memory.needed([(block, top)], "contact-adapted")
    assert 1e6 < need < 1e8
    assert 1.1 * need < memory.needed([(block, top)] * 2, "contact-adapted") < 1.9 * need  # one after the other
    assert memory.needed([(block, top)], "craig-bampton") > need
    free, most = memory.available_memory()
    assert 0 < free <= most
    monkeypatch.setattr(memory, "available_memory", lambda: (0.5 * need, 2 * need))
    with pytest.warns(MemoryWarning, match=r"1560 dofs with 21 patch nodes needs some 0\.0\d+ GB .* Coarsen") as said:
        ep.reduce(block, top, f_cut=80e3)
    assert said[0].filename == __file__
    monkeypatch.setattr(memory, "available_memory", lambda: (0.5 * need, 0.5 * need))
    for reduction in (
        lambda: ep.reduce(block, top, f_cut=80e3),
        lambda: ep.reduce_pair((block, top), (block, top), tolerance=0.1, speed=1.0),
    ):
        with pytest.raises(MemoryLimitError, match="three elements per contact radius are enough"):
            reduction()


def test_memory_that_runs_out_is_named(block, top, monkeypatch):
    def full(*_):
        raise MemoryError

    monkeypatch.setattr(free_body.BlockKrylov, "grow", full)
    with pytest.raises(MemoryLimitError, match="memory ran out while reducing 1560 dofs with 21 patch nodes"):
        ep.reduce(block, top, f_cut=80e3)
