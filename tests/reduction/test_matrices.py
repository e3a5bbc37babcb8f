"""Matrices for other codes: an impact from them alone is Exudyn's, and files bring them back."""

import re
from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.optimize
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition.errors import InputError


@pytest.fixture(scope="module")
def given(ball):
    """The ball with a patch at its south pole, an interface and a load, and its matrices."""
    fem, _ = ball
    part = ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, direction=(0, 0, -1))
    high = np.flatnonzero(fem.points[:, 2] > 0.017)
    part = part | ep.Partition.interface(fem, "top", high, kind="averaged")
    part |= ep.Partition.load(fem, "push", ((-1, -1, 0.015), (1, 1, 1)), direction=(0, 0, -1))
    body = ep.reduce(fem, part, f_cut=60e3)
    return fem, body, body.matrices()


def impact(matrices, gap, velocity, step, steps):
    """Forces of a body that flies down to a rigid plane, by the matrices alone: central differences, SciPy's nnls."""
    (contact,) = matrices.contacts.values()
    L = scipy.linalg.cholesky(contact.flexibility, lower=True)
    M, K, G = matrices.mass.diagonal(), matrices.stiffness, contact.rows
    h0 = contact.points[:, 2] + gap
    q, v = np.zeros(len(M)), matrices.rigid @ np.r_[0, 0, velocity, 0, 0, 0]

    def forces(q):
        # The plane presses upwards, against the outward normals: a gap is z less what the patch yields.
        down = scipy.linalg.solve_triangular(L, h0 - G @ q, lower=True)
        return scipy.optimize.nnls(L.T, -down)[0]

    lam = forces(q)
    found = [lam.sum()]
    for _ in range(steps):
        v = v + step / 2 * (-K @ q - G.T @ lam) / M
        q = q + step * v
        lam = forces(q)
        v = v + step / 2 * (-K @ q - G.T @ lam) / M
        found.append(lam.sum())
    return np.array(found)


def test_an_impact_from_the_matrices_is_that_of_exudyn(given):
    _, body, matrices = given
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -1e-7)), rows="node-to-segment")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.25e-6)
    own = impact(matrices, 1e-7, -1.0, 0.25e-6, result.steps)
    np.testing.assert_allclose(own, contact.force(result), atol=1e-6 * own.max())


def test_rows_of_interfaces_and_loads(given):
    fem, _, matrices = given
    np.testing.assert_allclose(matrices.interfaces["top"][:3] @ matrices.rigid[:, :3], np.eye(3), atol=1e-9)
    (pattern,) = (load for load in given[1].partition.loads)
    work = matrices.loads["push"] @ matrices.rigid[:, 2]
    assert work == pytest.approx(pattern.forces[:, 2].sum(), rel=1e-9)
    assert matrices.rigid[:, 0] @ (matrices.mass @ matrices.rigid[:, 0]) == pytest.approx(fem.total_mass, rel=1e-9)
    assert len(matrices.coordinates) == matrices.mass.shape[0]


def test_files_bring_them_back(given, tmp_path):
    *_, matrices = given
    found = scipy.io.loadmat(matrices.save(tmp_path / "ball.mat"))
    folder = matrices.save(tmp_path / "ball")
    for name, value in matrices.arrays().items():
        expected = value.toarray() if sp.issparse(value) else np.atleast_2d(value)
        for read in (found[name], scipy.io.mmread(folder / f"{name}.mtx")):
            read = read.toarray() if sp.issparse(read) else read
            np.testing.assert_array_equal(read, expected)
    assert "unit modal mass" in str(found["legend"])
    assert "0: " in (folder / "legend.txt").read_text()
    with pytest.raises(InputError, match=r"\.mat, or a folder"):
        matrices.save(tmp_path / "ball.npz")


def test_names_that_differ_in_signs_or_capitals_alone_have_files_of_their_own(given, tmp_path):
    """Also names longer than MATLAB's; each is told in the legend."""
    *_, matrices = given
    (contact,), (rows,), (load,) = (kind.values() for kind in (matrices.contacts, matrices.interfaces, matrices.loads))
    names = ["pad 1", "pad-1", "Pad.1", "pad_1_2", "ä", "ö", "a" * 60, "a" * 60 + "b"]
    contacts = {name: replace(contact, area=i * contact.area) for i, name in enumerate(names, 1)}
    interfaces = {name: i * rows for i, name in enumerate(names, 1)}
    loads = {name: i * load for i, name in enumerate(names, 1)}
    several = replace(matrices, contacts=contacts, interfaces=interfaces, loads=loads)
    found = scipy.io.loadmat(several.save(tmp_path / "ball.mat"))
    folder = several.save(tmp_path / "ball")
    said = (folder / "legend.txt").read_text(encoding="utf-8")
    new = dict(re.findall(r"names of files and variables, '(.*)' is (.*)\.\n", said))
    assert set(names) - set(new) <= {"pad_1_2"}
    for i, name in enumerate(names, 1):
        plain = new.get(name, name)
        for key, value in ((f"contact_{plain}_area", contact.area), (f"load_{plain}", load)):
            assert len(key) <= 63
            np.testing.assert_allclose(np.ravel(found[key]), i * value)
            np.testing.assert_allclose(np.ravel(scipy.io.mmread(folder / f"{key}.mtx")), i * value)
        np.testing.assert_allclose(scipy.io.mmread(folder / f"interface_{plain}.mtx"), i * rows)
    assert len({path.name.casefold() for path in folder.iterdir()}) == len(several.arrays()) + 1


def test_a_model_of_pymor_responds_as_the_matrices_do(given):
    """Transfer function from all forces to all motions, with the patch's own flexibility, against a dense solution."""
    defaults = pytest.importorskip("pymor.core.defaults")
    defaults.set_defaults({"pymor.operators.interface.as_array_max_length.value": 1000})
    _, body, _ = given
    mbs = exu.SystemContainer().AddSystem()
    matrices = ep.CreatePartitionBody(mbs, body, damping=0.02).matrices()
    model, s = matrices.to_pymor(), 2j * np.pi * 21e3
    (contact,) = matrices.contacts.values()
    outputs = np.vstack([contact.rows, matrices.interfaces["top"]])
    inputs = np.column_stack([outputs.T, matrices.loads["push"]])
    dynamic = s**2 * matrices.mass + s * matrices.damping + matrices.stiffness
    expected = outputs @ np.linalg.solve(dynamic.toarray(), inputs.astype(complex))
    k = len(contact.rows)
    expected[:k, :k] += contact.flexibility
    np.testing.assert_allclose(model.transfer_function.eval_tf(s), expected, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_damping_is_that_of_the_item(given, frame):
    """Half of the ratio's rate for each elastic mode, none for rigid motion; None without damping."""
    _, body, matrices = given
    mbs = exu.SystemContainer().AddSystem()
    damped = ep.CreatePartitionBody(mbs, body, frame=frame, damping=0.02, name="damped").matrices()
    expected = np.r_[np.zeros(6), 2 * 0.02 * body.basis.omega[6:]]
    np.testing.assert_allclose(damped.damping.toarray(), np.diag(expected), rtol=1e-14)
    assert "damping" in damped.arrays()
    assert matrices.damping is ep.CreatePartitionBody(mbs, body, frame=frame, name="free").matrices().damping is None


def test_damping_of_kept_nodes_has_no_place_in_a_floating_frame(given):
    fem, _, _ = given
    part = ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, direction=(0, 0, -1))
    body = ep.reduce(fem, part, f_cut=190e3, basis="free")
    mbs = exu.SystemContainer().AddSystem()
    rayleigh = ep.Rayleigh(10.0, 1e-7)
    found = ep.CreatePartitionBody(mbs, body, damping=rayleigh, name="one").matrices()
    expected = 10.0 * body.mass + 1e-7 * body.stiffness
    assert abs(found.damping - expected).max() < 1e-12 * abs(expected).max()
    with pytest.raises(InputError, match="floating frame has coordinates of its own"):
        ep.CreatePartitionBody(mbs, body, damping=rayleigh, frame="floating", name="two").matrices()
