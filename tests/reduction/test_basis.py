"""The bases against the full FE model: reduced matrices, static exactness, dynamics, full-basis limit."""

import math
import re

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import SPHERE_RADIUS, dense_basis, end, mass_matrix, relative

import exudyn_partition as ep
from exudyn_partition.fe.model import node_dofs, rigid_modes
from exudyn_partition.reduction.free_body import FreeBody
from exudyn_partition.reduction.inertia import PAIRS

BASES = ["free", "craig-bampton", "residual", "contact-adapted"]


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
    """At equal truncation the free basis is far too stiff at the contact."""
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
    reduced = scipy.linalg.eigvalsh(body.stiffness.toarray(), body.mass.toarray(), subset_by_index=(6, 9))
    full = _lumped_eigenvalues(block)[6:10]
    assert (reduced > full * (1 - 1e-9)).all()


_CACHE = {}


def _lumped_eigenvalues(fem):
    if id(fem) not in _CACHE:
        mass = fem.lumped_mass_matrix.tocsc()
        _CACHE[id(fem)] = np.sort(
            scipy.sparse.linalg.eigsh(fem.stiffness.tocsc(), 12, mass, sigma=-1e9, return_eigenvectors=False)
        )
    return _CACHE[id(fem)]


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


@pytest.fixture(scope="module")
def rotor():
    """A square shaft with two square discs, whose modes in two planes are pairs, and its ends [m]."""
    size = [((-6e-3, -6e-3, 0), (6e-3, 6e-3, 0.2)), ((-0.03, -0.03, 0.07), (0.03, 0.03, 0.08))]
    shaft, disc = (occ.Box(*corners) for corners in size)
    return ep.fe_model(shaft + disc, ep.STEEL, maxh=20e-3)


@pytest.fixture(scope="module", params=["bearings", "rub", "one spot"])
def held(rotor, request):
    """The rotor, its boundary, and its elastic frequencies by ARPACK with rigid interfaces, ascending [Hz].

    The boundary is bearings at the ends, or one of them and a spot on the rim, where it rubs, or that spot.
    """
    first, last = (
        ep.Partition.interface(rotor, name, plane=((0, 0, z), (0, 0, way)))
        for name, z, way in (("first", 0.0, -1), ("last", 0.2, 1))
    )
    rub = ep.Partition.ball(rotor, (0.03, 0, 0.075), 8e-3)
    partition = {"bearings": first | last, "rub": first | rub, "one spot": rub}[request.param]
    model = FreeBody(rotor, partition).model
    values = scipy.sparse.linalg.eigsh(
        model.stiffness.tocsc(), 40, model.mass.tocsc(), sigma=-1e6, return_eigenvectors=False
    )
    return rotor, partition, np.sqrt(np.sort(values)[6:]) / (2 * np.pi)


CUTS = [3e3, 9e3, 20e3]


@pytest.mark.parametrize("f_cut", CUTS)
def test_craig_bampton_has_each_mode_below_f_cut_within_a_per_cent(held, f_cut):
    """Held modes below f_cut alone leave some of these frequencies tens of per cent too high."""
    rotor, partition, exact = held
    body = ep.reduce(rotor, partition, basis="craig-bampton", f_cut=f_cut)
    found, below = body.basis.omega[6:] / (2 * np.pi), exact[exact < f_cut]
    assert 0 < len(below) < len(exact)
    assert ((1 - 1e-6) * below < found[: len(below)]).all()  # Rayleigh-Ritz
    assert (found[: len(below)] < 1.01 * below).all()


def named(body):
    """Frequencies that a body says to be off, (k,) [Hz]."""
    said = [sentence for sentence in body.left_out if sentence.startswith("accurate frequencies")]
    return np.array([float(f) for sentence in said for f in re.findall(r"([\d.]+) Hz", sentence)])


@pytest.mark.parametrize("f_cut", [3e3, 10e3, 16e3, 22e3, 30e3])
def test_contact_adapted_names_the_frequencies_that_are_not_within_a_per_cent(held, f_cut):
    rotor, partition, exact = held
    body = ep.reduce(rotor, partition, f_cut=f_cut)
    found, off = body.basis.omega[6:] / (2 * np.pi), named(body)
    found = found[found < f_cut]
    wrong = [f for f in found if abs(f / exact - 1).min() > 0.01]
    assert all((abs(off / f - 1) < 1e-4).any() for f in wrong)
    assert len(off) <= max(3, len(found) // 3)


def test_the_residual_basis_has_each_mode_below_f_cut(held):
    rotor, partition, exact = held
    body = ep.reduce(rotor, partition, basis="residual", f_cut=20e3)
    below = exact[exact < 20e3]
    np.testing.assert_allclose(body.basis.omega[6 : 6 + len(below)] / (2 * np.pi), below, rtol=1e-6)
    assert not len(named(body))


def test_the_paper_s_basis_names_the_frequencies_that_its_lumped_mass_changes(rotor):
    """The mesh is coarse: lumping slows some of its modes by more than a per cent, against the consistent mass."""
    rub = ep.Partition.ball(rotor, (0.03, 0, 0.075), 8e-3)
    body, consistent = (ep.reduce(rotor, rub, basis=basis, f_cut=20e3) for basis in ("free", "residual"))
    stiffness, mass = body.stiffness.toarray(), body.mass.toarray()
    exact = consistent.basis.omega[6:] / (2 * np.pi)
    found = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[6 : 6 + len(exact)]) / (2 * np.pi)
    off, change = named(body), abs(found / exact - 1)
    assert change.max() > 0.02
    for f, by in zip(found, change, strict=True):
        if f <= 1.0001 * off.max():  # of many, the lowest are named
            assert (abs(off / f - 1) < 1e-4).any() == (by > 0.01) or 0.006 < by < 0.012


def centrifugal_forces(fem, mass, omega):
    """-M w x (w x r) about the centre of mass, (3n,)."""
    return mass @ -np.cross(omega, np.cross(omega, fem.points - fem.centre_of_mass)).ravel()


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("kind", ["rigid", "averaged"])
def test_a_body_that_a_joint_holds_grows_as_the_whole_fe_model_does(link, basis, kind):
    """Coordinates and growth together have the static answer to rotation about any axis, with the interface held.

    The interface does not see the growth: joints pull at coordinates alone.
    """
    patch = ep.Partition.ball(link, (0.005, 0.004, 0.06), 4e-3)
    part = patch | ep.Partition.interface(link, "foot", end(link, 0.0), kind=kind)
    body = ep.reduce(link, part, basis=basis, f_cut=60e3)
    omega = np.array([700.0, -400.0, 900.0])
    products = [omega[a] * omega[b] for a, b in PAIRS]
    growth = (body.basis.growth @ products).reshape(-1, 3)
    T, rows, held = dense_basis(body), body.interface_rows("foot"), part.interfaces[0]

    force = centrifugal_forces(link, mass_matrix(link, body), omega)
    zero = np.zeros((6, 6))
    if kind == "rigid":  # all its nodes stand still
        free = np.setdiff1d(np.arange(link.n_dofs), node_dofs(held.nodes))
        exact = np.zeros(link.n_dofs)
        exact[free] = scipy.sparse.linalg.spsolve(link.stiffness[free][:, free].tocsc(), force[free])
    else:  # their mean motion is none
        dofs = node_dofs(held.nodes)
        motion = sp.csr_matrix((held.motion.ravel(), (np.repeat(range(6), len(dofs)), np.tile(dofs, 6))), (6, len(T)))
        whole = sp.bmat([[link.stiffness, motion.T * 1e9], [motion * 1e9, zero]], format="csc")
        exact = scipy.sparse.linalg.spsolve(whole, np.r_[force, np.zeros(6)])[:-6]
    K = np.block([[body.stiffness.toarray(), rows.T * 1e9], [rows * 1e9, zero]])
    kept = T @ np.linalg.solve(K, np.r_[T.T @ force, np.zeros(6)])[:-6]

    size = abs(exact).max()
    assert abs(kept + growth.ravel() - exact).max() < 1e-6 * size
    assert abs(held.motion[:3] @ growth[held.nodes].ravel()).max() < 1e-8 * size


def test_growth_makes_the_answer_of_few_coordinates_whole(link):
    """Without it a body of rigid motion and contact alone would not grow at all."""
    body = ep.reduce(link, ep.Partition.ball(link, (0.005, 0.004, 0.06), 4e-3), f_cut=3e3)
    growth = (body.basis.growth[:, 0] * 1000.0**2).reshape(-1, 3)  # turns about x
    length = 0.03 - abs(link.points[:, 2] - 0.03).min()
    ends = abs(link.points[:, 2] - 0.03) > 0.9999 * length
    bar = link.material.rho * 1000.0**2 * 0.03**3 / (3 * link.material.E)  # each half, from the middle
    np.testing.assert_allclose(abs(growth[ends, 2]).mean(), bar, rtol=0.02)  # the faces are not quite plane
