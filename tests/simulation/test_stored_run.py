"""Results in files, and the models that they are of."""

import pickle
import warnings
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import InputError

END = 60e-6


def striking(mbs, bodies, **options):
    """Ball and block, assembled: model, ball, contact."""
    ball = ep.CreatePartitionBody(
        mbs, bodies[0], name="ball", referencePosition=TOP, initialVelocity=[0, 0, -1.0], **options
    )
    block = ep.CreatePartitionBody(mbs, bodies[1], name="block")
    contact = ep.CreatePartitionContact(mbs, ball, block, name="tip")
    mbs.Assemble()
    return mbs, ball, contact


def test_a_result_that_is_saved_is_that_of_the_model_built_again(mbs, bodies, tmp_path):
    """All that sensors and contacts told, to the bit."""
    _, ball, contact = striking(mbs, bodies)
    result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6)
    path = tmp_path / "run.npz"
    result.save(path)
    again, same_ball, same_contact = striking(exu.SystemContainer().AddSystem(), bodies)
    loaded = ep.Result.load(path, again)
    assert repr(loaded) == repr(result)
    np.testing.assert_array_equal(loaded.t, result.t)
    np.testing.assert_array_equal(same_contact.force(loaded), contact.force(result))
    point = (0, 0, 0.02)
    np.testing.assert_array_equal(same_ball.velocity(loaded, point), ball.velocity(result, point))
    np.testing.assert_allclose(same_contact.energy(loaded), contact.energy(result), atol=1e-12)
    assert same_contact.impacts(loaded) == contact.impacts(result)
    for name in ("row_forces", "pressure"):
        of_file, of_run = (getattr(c, name)(r) for c, r in ((same_contact, loaded), (contact, result)))
        assert of_run.nnz > 0
        np.testing.assert_array_equal(of_file.toarray(), of_run.toarray())
    assert same_contact.largest_stress(loaded) == contact.largest_stress(result)
    assert loaded.warnings == result.warnings
    with pytest.raises(InputError, match="expected one of the model that body 'ball' belongs to"):
        ball.momentum(loaded)


def test_results_of_other_models_are_refused(mbs, bodies, tmp_path):
    striking(mbs, bodies)
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    path = tmp_path / "run.npz"
    result.save(path)
    floating, *_ = striking(exu.SystemContainer().AddSystem(), bodies, frame="floating")
    with pytest.raises(
        InputError, match=r"mbs: expected the model that was run.* 'ball', inertial.*has body 'ball', flo"
    ):
        ep.Result.load(path, floating)
    with pytest.raises(InputError, match="this one has nothing"):
        ep.Result.load(path, exu.SystemContainer().AddSystem())
    bodies[0].save(tmp_path / "ball.npz")
    with pytest.raises(InputError, match="expected a saved result"):
        ep.Result.load(tmp_path / "ball.npz", mbs)


@pytest.fixture
def saved(mbs, bodies, tmp_path):
    """The contact, the result of its run, and the file of this result."""
    _, ball, contact = striking(mbs, bodies)
    result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6)
    result.save(tmp_path / "run.npz")
    return ball, contact, result, tmp_path / "run.npz"


def test_a_pickled_result_has_no_meshes(saved):
    """Its size is that of what was recorded: it is smaller than each of the bodies."""
    _, contact, result, _ = saved
    bodies = [len(pickle.dumps(item.body)) for item in result.bodies]
    recorded = sum(samples.nbytes for samples in result.sensors.values()) + 12 * contact.row_forces(result).nnz
    size = len(pickle.dumps(result))
    assert size < 0.5 * min(bodies)
    assert size < 4 * recorded


@pytest.mark.parametrize("how", ["file", "pickle", "file of a pickle"])
def test_a_result_is_read_without_its_model(saved, tmp_path, how):
    """It has what was told of the run, to the bit, and names what it has not."""
    ball, contact, result, path = saved
    loaded = ep.Result.load(path) if how == "file" else pickle.loads(pickle.dumps(result))
    if how == "file of a pickle":
        loaded.save(tmp_path / "again.npz")
        loaded = ep.Result.load(tmp_path / "again.npz")
    assert repr(loaded) == repr(result)
    assert (loaded.work, loaded.warnings) == (result.work, result.warnings)
    (same_contact,), same_ball = loaded.contacts, loaded.bodies[0]
    gap = same_contact.gap(loaded)
    assert gap[0] > 0 >= gap.min()
    for name in ("force", "force_on_slave", "closed_rows", "area", "radius", "energy", "dissipated_energy"):
        np.testing.assert_array_equal(getattr(same_contact, name)(loaded), getattr(contact, name)(result))
    for name in ("row_forces", "pressure"):
        np.testing.assert_array_equal(
            getattr(same_contact, name)(loaded).toarray(), getattr(contact, name)(result).toarray()
        )
    for name in ("coordinates", "coordinates_t", "energy", "momentum"):
        np.testing.assert_array_equal(getattr(same_ball, name)(loaded), getattr(ball, name)(result))
    assert (same_contact.name, same_ball.name) == ("tip", "ball")
    of_file, of_run = loaded.history(same_contact), result.history(contact)
    np.testing.assert_array_equal(of_file.force, of_run.force)
    assert ep.compare(of_file, of_run).error["force"] == 0.0
    assert len(ep.plot.force(None, loaded).lines) > 0
    with pytest.raises(InputError, match=r"bodies of a file come with their model, Result.load\(path, mbs"):
        ep.plot.bodies(loaded)
    for missing in (
        lambda: same_contact.nodal_forces(loaded),
        lambda: same_contact.impacts(loaded),
        lambda: same_ball.velocity(loaded, (0, 0, 0.02)),
        lambda: loaded.report(tmp_path / "page.html"),
    ):
        with pytest.raises(
            InputError, match=r"needs the model, and this result was read without it.*Result.load\(path, mbs"
        ):
            missing()
    with pytest.raises(InputError, match="expected one of the model that body 'ball' belongs to"):
        ball.momentum(loaded)


def test_a_pickle_holds_what_the_run_told_and_not_the_model(saved):
    """It was 148 MB for 245 steps: matrices of the bodies and flexibilities of the contacts."""
    *_, result, path = saved
    assert len(pickle.dumps(result)) < 1.2 * path.stat().st_size
    told = sum(data.nbytes for data in result.sensors.values())
    end = [member.contact for member in result.end.contacts.contacts]  # and the state at the end
    told += sum(state.memory.forces.nbytes + 3 * state.memory.path.nbytes + 3 * state.gaps.q.nbytes for state in end)
    assert path.stat().st_size < 2.2 * told  # each array of the file has a header


def test_friction_and_plastic_strain_are_in_files(mbs, tmp_path):
    """States and tractions of rows, slip paths, strains and what is left behind."""
    soft = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=300e6, hardening=1e9)
    shape, refine = occ.Sphere(occ.Pnt(0, 0, 0.01), 0.01), [ep.Refine((0, 0, 0), 1e-3, 0.5e-3)]
    fem = ep.fe_model(shape, soft, maxh=5e-3, refine=refine)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1e-3, axes="xyz"), f_cut=60e3)

    def slides():
        model = exu.SystemContainer().AddSystem()
        options = {"initialVelocity": [0.5, 0, -1.0], "referencePosition": [0, 0, 1e-6]}
        item = ep.CreatePartitionBody(model, body, **options)
        contact = ep.CreatePartitionContact(model, item, ep.RigidPlane(), friction=0.3)
        model.Assemble()
        return model, contact

    model, contact = slides()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ep.solve_dynamic(model, end_time=12e-6, step=0.25e-6)
    result.save(tmp_path / "run")
    again, same = slides()
    loaded, alone = ep.Result.load(tmp_path / "run", again), ep.Result.load(tmp_path / "run")
    assert contact.plastic.work(result)[-1] > 0
    for one, of in ((same, loaded), (alone.contacts[0], alone)):
        assert one.friction
        assert one.plastic
        for name in ("states", "row_forces", "traction", "slip_path", "tangential_force", "work"):
            np.testing.assert_array_equal(getattr(one.friction, name)(of), getattr(contact.friction, name)(result))
        np.testing.assert_array_equal(one.plastic.strain(of), contact.plastic.strain(result))
        (state,), (expected,) = one.plastic.states(of).values(), contact.plastic.states(result).values()
        np.testing.assert_array_equal(state.strain, expected.strain)
    for missing in (alone.contacts[0].plastic.dents, alone.contacts[0].plastic.flow_at_border):
        with pytest.raises(InputError, match=r"'zones' needs the model, and this result was read without it"):
            missing(alone)
    assert same.plastic.dents(loaded) == contact.plastic.dents(result)
    (history,), (expected,) = same.plastic.strain_histories(loaded), contact.plastic.strain_histories(result)
    numbers = history.numbers(result.t)
    np.testing.assert_array_equal(numbers, expected.numbers(result.t))
    np.testing.assert_array_equal(history.strain(numbers[-1]), expected.strain(numbers[-1]))


def test_bodies_that_are_reduced_again_are_the_same_but_for_rounding(mbs, bodies, tmp_path):
    """The time that the reduction took was part of what was compared, so that no second process could read a run."""
    striking(mbs, bodies)
    ep.solve_dynamic(mbs, end_time=1e-6).save(tmp_path / "run")
    ball, block = bodies
    rounded = sp.csr_matrix(ball.stiffness * (1 + 1e-12))
    same = replace(ball, reduce_s=9.9, stiffness=rounded, material=None, points=np.asfortranarray(ball.points))
    model, *_ = striking(exu.SystemContainer().AddSystem(), (same, block))
    ep.Result.load(tmp_path / "run", model)
    for changed, what in (
        ({"stiffness": sp.csr_matrix(ball.stiffness * (1 + 1e-5))}, r"other numbers in matrices\.3"),
        ({"f_cut": 1.001 * ball.f_cut}, "other numbers in its options"),
        ({"basis": replace(ball.basis, shapes=ball.basis.shapes * np.r_[np.ones(ball.n_shapes - 1), -1])}, "basis"),
        ({"facets": ball.facets[::-1].copy()}, "of another mesh, partition or size"),
    ):
        model, *_ = striking(exu.SystemContainer().AddSystem(), (replace(ball, **changed), block))
        with pytest.raises(InputError, match=rf"mbs: expected the model that was run.* body 'ball'.*{what}"):
            ep.Result.load(tmp_path / "run", model)


OTHERS = {
    "damping": ({"damping": 0.5}, {}),
    "no damping": ({"damping": None}, {}),
    "gravity": ({"gravity": [0, 0, -9.81]}, {}),
    "plane": ({}, {"master": ep.RigidPlane((0, 0, -1e-6))}),
    "tilted plane": ({}, {"master": ep.RigidPlane((0, 0, 0), (1e-4, 0, 1))}),
    "sphere": ({}, {"master": ep.RigidSphere((0, 0, -0.02), 0.02)}),
    "friction": ({}, {"friction": 0.21}),
    "no friction": ({}, {"friction": None}),
    "rows": ({}, {"rows": "node-to-segment"}),
    "penalty": ({}, {"formulation": "penalty"}),
    "layer": ({}, {"formulation": "penalty", "stiffness": 1e14}),
    "carrier": ({}, {"masterBody": 0}),
}
SAID = {
    "damping": "with other damping", "no damping": "with other damping", "gravity": "with other weight",
    "plane": "with other numbers in surface.point", "tilted plane": r"with other numbers in surface\.",
    "sphere": "RigidPlane.*this one has.*RigidSphere", "friction": "with other friction",
    "rows": "integrated rows.*this one has.*node-to-segment rows",
    "penalty": "Compliance.*this one has.*Penalty", "carrier": "this one has.*on the body with number",
}  # fmt: skip


def test_what_changes_an_answer_is_another_model(round_body, tmp_path):
    """Runs of other damping, planes and weights were read without a word, with other energies, gaps and stresses."""

    def placed(body_options, contact_options):
        mbs = exu.SystemContainer().AddSystem()
        if "masterBody" in contact_options:
            mbs.CreateGround()
        options = {"damping": 0.05, "referencePosition": [0, 0, 1e-6], "initialVelocity": [0.1, 0, -0.3]}
        ball = ep.CreatePartitionBody(mbs, round_body, name="ball", **options | body_options)
        options = {"master": ep.RigidPlane(), "friction": 0.2, "name": "floor"} | contact_options
        ep.CreatePartitionContact(mbs, ball, options.pop("master"), **options)
        mbs.Assemble()
        return mbs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ep.solve_dynamic(placed({}, {}), end_time=2e-6).save(tmp_path / "run")
        layer = {"formulation": "penalty", "stiffness": 1.01e14}
        ep.solve_dynamic(placed({}, layer), end_time=2e-6, method="implicit", step=1e-6).save(tmp_path / "layer")
    ep.Result.load(tmp_path / "run", placed({"initialVelocity": [9, 9, 9]}, {}))  # the start changes no answer
    ep.Result.load(tmp_path / "layer", placed({}, layer))
    for name, other in OTHERS.items():
        with pytest.raises(InputError, match=SAID.get(name, "mbs: expected the model that was run")):
            ep.Result.load(tmp_path / ("layer" if name == "layer" else "run"), placed(*other))
