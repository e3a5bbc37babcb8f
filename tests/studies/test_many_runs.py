"""Many compiled runs: each entry is the run of its own model, whatever the others are."""

import os
import signal
import sys
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R
from oracles import each_way, without_numba

import exudyn_partition as ep
from exudyn_partition.compiled import friction_steps, loops
from exudyn_partition.contact.formulations import compliance
from exudyn_partition.errors import CompiledRunError, InputError, MemoryLimitError, StepSizeError

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
CLOSE = 1e-9  # of the largest value
END, STEP = 25e-6, 0.1e-6
STEEL = replace(ep.STEEL, yield_stress=None)


def reduced(material):
    """A marble with a patch at either pole."""
    refine = [ep.Refine(p, 0.5e-3, 0.25e-3) for p in ((0, 0, -R), (0, 0, R))]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), material, maxh=3e-3, refine=refine, grading=0.6)
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.6e-3, name=name) for z, name in ((-R, "south"), (R, "north"))]
    f_cut = 200e3 * np.sqrt(material.E / STEEL.E * STEEL.rho / material.rho)
    return ep.reduce(fem, patches[0] | patches[1], f_cut=f_cut)


@pytest.fixture(scope="module")
def marble():
    return reduced(STEEL)


@pytest.fixture(scope="module")
def rough():
    """A marble whose patches carry friction."""
    refine = [ep.Refine(p, 0.5e-3, 0.2e-3) for p in ((0, 0, -R), (0, 0, R))]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), STEEL, maxh=4e-3, refine=refine, grading=0.6)
    ends = (-R, "south"), (R, "north")
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.5e-3, name=name, axes="xyz") for z, name in ends]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=200e3)


def fall(marble, *, friction=None, **options):
    """A marble that falls on a plane."""
    mbs = exu.SystemContainer().AddSystem()
    at = {"referencePosition": [0, 0, R + 1e-6], "initialVelocity": [0, 0, -1.0]}
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", **(at | options))
    rub = {"friction": friction, "name": "floor"}
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", **rub)
    mbs.Assemble()
    return mbs, [ball], [contact]


def in_a_row(marbles, speed=0.5, aside=0.0, friction=None):
    """Marbles in a row, the last of which hits the others."""
    mbs, balls = exu.SystemContainer().AddSystem(), []
    for i, marble in enumerate(marbles):
        velocity = [aside, 0, -speed] if i == len(marbles) - 1 else [0, 0, 0]
        place = {"referencePosition": [0, 0, (2 * R + 1e-7) * i], "initialVelocity": velocity}
        balls.append(ep.CreatePartitionBody(mbs, marble, name=str(i), **place))
    patches = {"slavePatch": "south", "masterPatch": "north"}
    pairs = zip(balls[1:], balls[:-1], strict=True)
    patches["friction"] = friction
    contacts = [ep.CreatePartitionContact(mbs, *pair, name=f"contact {i}", **patches) for i, pair in enumerate(pairs)]
    mbs.Assemble()
    return mbs, balls, contacts


def many(mbs, vary, **options):
    return ep.run_many(mbs, vary=vary, **({"end_time": END, "step": STEP, "histories": ("force",)} | options))


def alone(model, **options):
    """Forces of all contacts of a model in a run by Exudyn, (nc, n) [N]."""
    mbs, _, contacts = model
    result = ep.solve_dynamic(mbs, **({"end_time": END, "step": STEP} | options))
    return np.array([contact.force(result) for contact in contacts])


def assert_close(found, right, within=CLOSE):
    assert right.any()
    np.testing.assert_allclose(found, right, rtol=0, atol=within * abs(right).max())


# Entries are runs of their own models.

VALUES = {
    "initialVelocity": [[0.0, 0.0, -0.5], [0.0, 0.0, -1.7]],
    "gravity": [[0.0, 0.0, -3e4], [10.0, 0.0, 2e4]],
    "damping": [0.01, 0.05],
    "referencePosition": [[0.0, 0.0, R + 2e-6], [1e-5, 0.0, R + 0.5e-6]],
}


@pytest.mark.parametrize("name", VALUES)
def test_an_entry_is_the_run_of_its_own_model(marble, name):
    mbs, [ball], _ = fall(marble)
    runs = many(mbs, {ball: {name: np.array(VALUES[name])}})
    for entry, value in enumerate(VALUES[name]):
        assert_close(runs.force[entry], alone(fall(marble, **{name: value})))


def test_a_ratio_for_each_mode(marble):
    """It takes the place of the body's own."""
    n = len(marble.basis.omega) - 6
    ratios = np.array([np.linspace(0.0, 0.1, n), np.full(n, 0.02)])
    mbs, [ball], _ = fall(marble, damping=0.05)
    runs = many(mbs, {ball: {"damping": ratios}})
    for entry, value in enumerate(ratios):
        assert_close(runs.force[entry], alone(fall(marble, damping=value)))
    with pytest.raises(InputError, match="vary: damping: expected shape"):
        many(mbs, {ball: {"damping": ratios[:, 1:]}})


def test_a_damped_body_with_gravity(marble):
    """What does not vary stays; what varies takes its place."""
    mbs, [ball], _ = fall(marble, damping=0.03, gravity=[0, 0, -2e4])
    runs = many(mbs, {ball: {"initialVelocity": np.array([[0, 0, -0.4]]), "damping": np.array([0.0])}})
    assert_close(runs.force[0], alone(fall(marble, initialVelocity=[0, 0, -0.4], gravity=[0, 0, -2e4])))


def test_stiffness_and_mass_without_a_new_reduction(marble):
    """They are those of bodies that are reduced anew."""
    mbs, balls, _ = in_a_row([marble] * 2)
    materials = [replace(STEEL, E=70e9, rho=2700.0), replace(STEEL, E=110e9)]
    vary = {
        balls[0]: {"E": np.array([one.E for one in materials]), "rho": np.array([one.rho for one in materials])},
        balls[1]: {"E": np.array([STEEL.E, 300e9])},
    }
    runs = many(mbs, vary)
    others = [marble, reduced(replace(STEEL, E=300e9))]
    for entry, material in enumerate(materials):
        assert_close(runs.force[entry], alone(in_a_row([reduced(material), others[entry]])), 1e-6)


@pytest.mark.parametrize("damping", [0.02, ep.Rayleigh(alpha=3e4)])
def test_the_same_speed_of_waves(marble, damping):
    """Forces, energies and momenta go with E if rho does too, also of weight and damping."""
    mbs, [ball], _ = fall(marble, damping=damping, gravity=[0, 0, -1e4])
    factor = np.array([1.0, 2.5])
    runs = many(mbs, {ball: {"E": factor * STEEL.E, "rho": factor * STEEL.rho}})
    for values in (runs.force, runs.energy, runs.momentum, runs.peak, runs.impulse):
        assert_close(values[1], 2.5 * values[0])
    assert_close(runs.restitution[1], runs.restitution[0])


def test_contacts_that_move_each_other(marble):
    """E of all bodies, or of one."""
    mbs, balls, _ = in_a_row([marble] * 3)
    factor = np.array([1.0, 1.5])
    runs = many(mbs, {ball: {"E": factor * STEEL.E, "rho": factor * STEEL.rho} for ball in balls})
    assert [contact.name for contact in runs.contacts] == ["contact 0", "contact 1"]
    assert_close(runs.force[0], alone(in_a_row([marble] * 3)))
    assert_close(runs.force[1], 1.5 * runs.force[0])
    one = many(mbs, {balls[1]: {"E": factor * STEEL.E}})
    others = [marble, reduced(replace(STEEL, E=1.5 * STEEL.E)), marble]
    assert_close(one.force[1], alone(in_a_row(others)), 1e-6)


# Entries do not know of each other.


def same_bits(one, other, entries):
    """Whether entries of two results are equal."""
    for name in (
        "ends",
        "peak",
        "impulse",
        "duration",
        "counts",
        "restitution",
        "energy",
        "stored",
        "dissipated",
        "momentum",
        "force",
    ):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[entries])


@pytest.mark.parametrize("workers", [1, 3])
def test_bits_do_not_depend_on_other_entries(marble, workers):
    mbs, balls, _ = in_a_row([marble] * 2)
    rng = np.random.default_rng(0)
    speeds, E = np.zeros((7, 3)), STEEL.E * rng.uniform(0.8, 1.2, 7)
    speeds[:, 2], E[[1, 4]] = -rng.uniform(0.1, 1.0, 7), STEEL.E
    whole = many(mbs, {balls[1]: {"initialVelocity": speeds}, balls[0]: {"E": E}})
    for some in ([3], [6, 0, 4], [*range(6, -1, -1)]):
        part = many(mbs, {balls[1]: {"initialVelocity": speeds[some]}, balls[0]: {"E": E[some]}}, workers=workers)
        same_bits(part, whole, some)


def test_a_single_compiled_run_has_these_bits(marble):
    mbs, [ball], [contact] = fall(marble)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, solver="compiled")
    runs = many(mbs, {ball: {"gravity": np.zeros((2, 3))}}, histories=("force", "coordinates"))
    for entry in range(2):
        np.testing.assert_array_equal(runs.force[entry, 0], contact.force(result))
        np.testing.assert_array_equal(runs.q[entry], ball.coordinates(result))
        np.testing.assert_array_equal(runs.q_t[entry], ball.coordinates_t(result))
    np.testing.assert_allclose(runs.t, result.t, rtol=0, atol=1e-18)


ASIDE = {"initialVelocity": [0.5, 0.0, -1.0]}


def test_friction_varies(rough):
    """Each entry is the run of its own model, and has the same bits whatever the others are."""
    mbs, [ball], [contact] = fall(rough, friction=ep.Coulomb(0.3, 0.1), **ASIDE)
    mu, E = np.array([0.05, 0.2, 0.4]), STEEL.E * np.array([1.0, 0.8, 0.8])
    vary = {contact: {"friction": mu}, ball: {"E": E}}
    runs = many(mbs, vary)
    for some in ([2], [1, 0], [2, 1, 0]):
        part = {contact: {"friction": mu[some]}, ball: {"E": E[some]}}
        same_bits(many(mbs, part, workers=len(some)), runs, some)
    right = fall(rough, friction=mu[0], **ASIDE)
    result = ep.solve_dynamic(right[0], end_time=END, step=STEP)
    force = right[2][0].force(result)
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=CLOSE * force.max())
    assert runs.dissipated[0, 0] == pytest.approx(right[2][0].friction.work(result)[-1], rel=CLOSE)
    start, end = runs.energy.sum(axis=2).T
    np.testing.assert_allclose(runs.dissipated[:, 0], start - end - runs.stored[:, 0], rtol=0, atol=2e-3 * start[0])
    assert (np.diff(runs.dissipated[:, 0]) != 0.0).all()


def test_friction_of_the_model_is_kept_where_it_does_not_vary(rough):
    mbs, [ball], [contact] = fall(rough, friction=0.3, **ASIDE)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, solver="compiled")
    runs = many(mbs, {ball: {"gravity": np.zeros((2, 3))}})
    np.testing.assert_array_equal(runs.force[1, 0], contact.force(result))
    assert runs.dissipated[1, 0] == contact.friction.work(result)[-1]


@pytest.mark.parametrize("several", [False, True], ids=["one", "several"])
def test_rows_that_forces_push_shut_enter(rough, monkeypatch, several):
    """Forces do not depend on which rows are tried first: here none but the deepest are, by Exudyn and in loops."""

    def model():
        return in_a_row([rough] * 3, aside=0.02, friction=0.2) if several else fall(rough, friction=0.3)

    options = {"end_time": 5e-6}
    right = alone(model(), solver="compiled", **options)
    monkeypatch.setattr(compliance, "CHOOSING", (-0.9, -0.9, *compliance.CHOOSING[2:]))
    for module in (friction_steps, loops):
        monkeypatch.setattr(module, "CHOICES", (-0.9, -0.9, *module.CHOICES[2:]))
    by_exudyn, compiled = alone(model(), **options), alone(model(), solver="compiled", **options)
    with without_numba():
        by_numpy = alone(model(), solver="compiled", **options)
    assert_close(compiled, right)
    for found in (by_exudyn, by_numpy):
        assert_close(found, compiled, 1e-11)


def test_stiffness_of_rough_marbles_that_move_each_other_varies(rough):
    """With E and rho by the same factor, bodies move the same, and all forces go with it."""
    mbs, balls, _ = in_a_row([rough] * 3, aside=0.02, friction=0.2)
    vary = {item: {"E": STEEL.E * np.array([1.0, 0.5]), "rho": STEEL.rho * np.array([1.0, 0.5])} for item in balls}
    runs = many(mbs, vary)
    np.testing.assert_allclose(runs.force[1], 0.5 * runs.force[0], rtol=0, atol=1e-9 * runs.force[0].max())


def test_entries_with_friction_go_on_in_a_file(rough, tmp_path):
    mbs, _, [contact] = fall(rough, friction=0.3, **ASIDE)
    options = {"file": tmp_path / "runs.jsonl", "histories": ()}
    first = many(mbs, {contact: {"friction": [0.1]}}, **options)
    both = many(mbs, {contact: {"friction": [0.1, 0.2]}}, **options)
    assert both.dissipated[0] == first.dissipated[0]
    assert both.dissipated[1] != first.dissipated[0]
    assert {"floor.friction": 0.2} in ep.Study.load(options["file"]).parameters


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"E": [1.0]}, "for contact 'floor' expected {'friction': array}"),
        ({"friction": [-0.1]}, "expected a coefficient of friction, 0 to 10"),
        ({"friction": []}, "friction has no entries"),
        ({"friction": 0.3}, "friction"),
    ],
)
def test_wrong_frictions(rough, given, said):
    mbs, _, [contact] = fall(rough, friction=0.3)
    with pytest.raises(InputError, match=said):
        many(mbs, {contact: given})


def test_friction_of_a_contact_without(marble):
    mbs, _, [contact] = fall(marble)
    with pytest.raises(InputError, match="contact 'floor' has no friction in the model; create it with friction="):
        many(mbs, {contact: {"friction": [0.3]}})


def test_failures_are_entries(marble):
    """Pairs of one entry slide; the others stay as they are."""
    mbs, balls, _ = in_a_row([marble] * 2)
    velocities = np.array([[0, 0, -0.5], [5.0, 0, -0.5], [0, 0, -0.7]])
    runs = many(mbs, {balls[1]: {"initialVelocity": velocities}})
    assert [*runs.failures] == [1]
    assert "pairs of contact 'contact 0' begin to slide" in runs.failures[1]
    assert "1 failed" in repr(runs)
    for values in (runs.peak, runs.force, runs.energy):
        assert np.isnan(values[1]).all()
        assert np.isfinite(values[[0, 2]]).all()
    same_bits(many(mbs, {balls[1]: {"initialVelocity": velocities[[0, 2]]}}), runs, [0, 2])


def test_bodies_that_fly_apart_and_aside(marble):
    """Pairs slide after the impact: the entry ends there, and all numbers of the impact are known."""
    mbs, balls, [contact] = in_a_row([marble] * 2)
    velocities, long = np.array([[0, 0, -0.5], [0.12, 0, -0.5]]), {"end_time": 120e-6}
    runs = many(mbs, {balls[1]: {"initialVelocity": velocities}}, **long)
    assert not runs.failures
    assert runs.ends[0] == runs.t[-1]
    assert runs.t[200] < runs.ends[1] < runs.t[-1]
    assert np.isnan(runs.force[1, 0, -1])
    mbs, balls, [contact] = in_a_row([marble] * 2, aside=0.12)
    result = ep.solve_dynamic(mbs, step=STEP, **long)
    [impact] = contact.impacts(result)
    assert runs.peak[1, 0] == pytest.approx(impact.peak, rel=CLOSE)
    assert runs.impulse[1, 0] == pytest.approx(impact.impulse, rel=CLOSE)
    assert runs.restitution[1, 0] == pytest.approx(impact.speed_after / impact.speed_before, rel=1e-4)
    momenta = [item.momentum(result)[-1] for item in balls]
    np.testing.assert_allclose(runs.momentum[1, 1], momenta, rtol=0, atol=1e-9 * abs(momenta[0]).max())


def test_the_model_and_its_last_run_stay(marble):
    mbs, [ball], [contact] = fall(marble)
    first = ep.solve_dynamic(mbs, end_time=12e-6, step=STEP)
    many(mbs, {ball: {"initialVelocity": np.array([[0, 0, -3.0]])}})
    assert_close(contact.force(ep.collect(mbs)), contact.force(first))
    later = ep.solve_dynamic(mbs, end_time=END, step=STEP, go_on=True)
    assert_close(contact.force(later), alone(fall(marble))[0][120:])


# A file that grows.


def varied(count=6):
    """Speeds and moduli of some entries; pairs of the fourth slide."""
    speeds, E = np.zeros((count, 3)), STEEL.E * np.linspace(0.8, 1.2, count)
    speeds[:, 2], speeds[3, 0] = -np.linspace(0.3, 0.8, count), 5.0
    return speeds, E


@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_goes_on(marble, tmp_path, workers):
    """What it holds is not run again, has the same bits, and is a study for whoever reads it."""
    mbs, balls, _ = in_a_row([marble] * 2)
    speeds, E = varied()
    options = {"histories": (), "workers": workers}

    def runs(some, **more):
        return many(mbs, {balls[1]: {"initialVelocity": speeds[some]}, balls[0]: {"E": E[some]}}, **options, **more)

    whole, file, shares = runs(range(6)), tmp_path / "map.jsonl", []
    some = runs([4, 0, 3], file=file)
    assert [*some.failures] == [2]
    with file.open("a") as lines:
        lines.write('{"parameters": {"1.initialVel')  # the process was killed while it wrote
    again = runs(range(6), file=file, progress=shares.append)
    assert len(shares) == 4  # entries 1, 2, 5, and 3, which had failed
    assert shares[-1] == 1.0
    for name in ("ends", "peak", "impulse", "duration", "counts", "restitution", "energy", "stored", "momentum"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    assert again.failures == whole.failures
    read = ep.Study.load(file)
    assert len(read) == 6
    assert "begin to slide" in next(iter(read.failures.values())).message
    order = [int(np.flatnonzero(E == modulus)[0]) for modulus in read["0.E"]]
    np.testing.assert_array_equal(read["peak"][:, 0], whole.peak[order, 0])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_a_killed_process_leaves_its_entries(marble, tmp_path):
    mbs, [ball], _ = fall(marble)
    vary, file = (
        {ball: {"initialVelocity": np.array([[0, 0, -0.3 - 0.1 * i] for i in range(5)])}},
        tmp_path / "map.jsonl",
    )
    options = {"histories": (), "file": file}
    if not (child := os.fork()):
        try:
            many(mbs, vary, progress=lambda share: share > 0.5 and os.kill(os.getpid(), signal.SIGKILL), **options)
        finally:
            os._exit(1)
    _, status = os.waitpid(child, 0)
    assert os.WTERMSIG(status) == signal.SIGKILL
    shares = []
    runs = many(mbs, vary, progress=shares.append, **options)
    assert len(shares) == 2
    np.testing.assert_array_equal(runs.peak, many(mbs, vary).peak)


def test_files_that_are_refused(marble, tmp_path):
    mbs, [ball], _ = fall(marble)
    other, [heavier], _ = fall(marble, gravity=[0, 0, -1e4])
    values, options = {"damping": np.array([0.01, 0.02])}, {"histories": (), "file": tmp_path / "map.jsonl"}
    many(mbs, {ball: values}, **options)
    with pytest.raises(InputError, match="is of other model"):
        many(other, {heavier: values}, **options)
    with pytest.raises(InputError, match="is of other end_time"):
        many(mbs, {ball: values}, **options, end_time=2 * END)
    with pytest.raises(InputError, match="histories: expected none with file="):
        many(mbs, {ball: values}, file=tmp_path / "other.jsonl")
    with pytest.raises(InputError, match="file: expected"):
        many(mbs, {ball: values}, histories=(), file=1)


# What is measured.


def test_restitution_of_a_ball_that_slides(rough):
    """Friction spins it up, and it has gone on by 0.4 mm when it ends: its own centre has no such motion aside."""
    mbs, [ball], _ = fall(rough, friction=0.1)
    velocity = np.array([[0, -10.0, -1.0], [0, 0, -1.0]])
    runs = many(mbs, {ball: {"initialVelocity": velocity}}, histories=(), end_time=40e-6)
    mean = runs.momentum[:, 1, 0, 2] / rough.total_mass  # of which each point of the line of contact has the same
    np.testing.assert_allclose(runs.restitution[:, 0], mean, rtol=2e-4)


def test_what_is_measured(marble):
    mbs, balls, [contact] = in_a_row([marble] * 2)
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=STEP)
    [impact] = contact.impacts(result)
    runs = many(mbs, {balls[1]: {"initialVelocity": np.array([[0, 0, -0.5]])}}, end_time=40e-6)
    assert runs.peak[0, 0] == pytest.approx(impact.peak, rel=CLOSE)
    assert runs.impulse[0, 0] == pytest.approx(impact.impulse, rel=CLOSE)
    # The arms of many runs are those of the largest force.
    assert runs.restitution[0, 0] == pytest.approx(impact.speed_after / impact.speed_before, rel=1e-5)
    assert runs.counts[0, 0] == 1
    closed = result.t[contact.force(result) > 0]
    assert closed[-1] - closed[0] <= runs.duration[0, 0] <= closed[-1] - closed[0] + 2 * STEP
    for place, item in enumerate(balls):
        np.testing.assert_allclose(runs.energy[0, :, place], item.energy(result)[[0, -1]], rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(runs.momentum[0, :, place], item.momentum(result)[[0, -1]], rtol=1e-9, atol=1e-12)
    assert runs.energy[0].sum(axis=1)[1] == pytest.approx(runs.energy[0, 0].sum(), rel=1e-3)


def test_energy_in_contact_at_the_end(marble):
    mbs, balls, [contact] = in_a_row([marble] * 2)
    result = ep.solve_dynamic(mbs, end_time=12e-6, step=STEP)
    runs = many(mbs, {balls[1]: {"initialVelocity": np.array([[0, 0, -0.5]])}}, end_time=12e-6)
    assert runs.stored[0, 0] == pytest.approx(contact.energy(result)[-1], rel=CLOSE)


def test_bits_by_numpy_do_not_depend_on_other_entries(marble):
    mbs, balls, _ = in_a_row([marble] * 3)
    speeds = np.array([[0, 0, -0.5], [0, 0, -0.8]])
    with without_numba():
        both, last = (many(mbs, {balls[-1]: {"initialVelocity": some}}, end_time=4e-6) for some in (speeds, speeds[1:]))
    assert last.peak[:, -1].all()
    same_bits(last, both, [1])


def test_by_numpy(marble):
    def peaks():
        mbs, [ball], _ = fall(marble)
        return many(mbs, {ball: {"initialVelocity": np.array([[0, 0, -1.0], [0, 0, -1.2]])}}, end_time=8e-6).peak

    compiled, plain = each_way(peaks)
    np.testing.assert_allclose(plain, compiled, rtol=CLOSE)


# What is refused.


def test_the_step(marble):
    """By default stiff and light entries have a shorter one; a step above their limit is refused."""
    mbs, [ball], _ = fall(marble)
    limit, E = ep.stability_limit(mbs), np.array([1.0, 16.0]) * STEEL.E
    runs = many(mbs, {ball: {"E": E}}, step=None)
    assert runs.t[1] <= limit / 4
    with pytest.raises(StepSizeError, match="above the stability limit of entry 1"):
        many(mbs, {ball: {"E": E}}, step=0.5 * limit)


def test_histories_that_take_too_much(marble, monkeypatch):
    mbs, [ball], _ = fall(marble)
    monkeypatch.setattr(sys.modules[ep.ManyRuns.__module__], "available_memory", lambda: (1e3, 1e3))
    with pytest.raises(MemoryLimitError, match="2 runs of 251 times take"):
        many(mbs, {ball: {"damping": np.zeros(2)}})


def test_a_model_that_is_not_held(marble):
    mbs, [ball], _ = fall(marble, frame="floating", inertiaTerms=("gyroscopic",))
    with pytest.raises(CompiledRunError, match="body 'ball' leaves out inertia forces by inertiaTerms"):
        many(mbs, {ball: {"damping": np.zeros(2)}})


@pytest.mark.parametrize(
    ("of_body", "message"),
    [
        ({}, "got dict for body"),
        ({"speed": np.zeros((2, 3))}, "expected names among initialVelocity, .*, got 'speed'"),
        ({"initialVelocity": np.zeros(3)}, "vary: initialVelocity: expected"),
        ({"initialVelocity": np.zeros((2, 3)), "damping": np.zeros(3)}, "vary: damping: expected"),
        ({"damping": np.zeros(0)}, "no entries"),
        ({"damping": np.array([-0.1])}, "of at least zero"),
        ({"E": np.array([0.0])}, "above zero"),
    ],
)
def test_wrong_values(marble, of_body, message):
    mbs, [ball], _ = fall(marble)
    with pytest.raises(InputError, match=message):
        many(mbs, {ball: of_body})


def test_other_wrong_arguments(marble):
    mbs, [ball], _ = fall(marble)
    _, [stranger], _ = fall(marble)
    for vary in ({}, None, {stranger: {"damping": np.zeros(2)}}, {"ball": {"damping": np.zeros(2)}}):
        with pytest.raises(InputError, match="vary: expected a dict of body"):
            many(mbs, vary)
    with pytest.raises(InputError, match="histories: expected a collection of 'force', 'coordinates'"):
        many(mbs, {ball: {"damping": np.zeros(2)}}, histories="force")
    mbs, [ball], _ = fall(marble, damping=lambda f: 0.02 + 0 * f)
    with pytest.raises(InputError, match="whose damping is a function of frequency"):
        many(mbs, {ball: {"E": np.array([STEEL.E])}})


@pytest.mark.parametrize(("speed", "step_of_start"), [(0.5, 27), (15.0, 1)])
def test_a_contact_lasts_from_where_its_rows_close(marble, speed, step_of_start):
    """Between steps, by a straight flight until then; also where rows close in the first step. It ends with the run."""
    options = {"end_time": 12e-6, "step": 2 * STEP}
    mbs, balls, [contact] = in_a_row([marble] * 2, speed)
    start = ep.solve_dynamic(mbs, **options).sensor(contact["sForce"])[0, 5] / speed  # smallest gap of the rows
    assert np.ceil(start / (2 * STEP)) == step_of_start
    runs = many(mbs, {balls[1]: {"initialVelocity": np.array([[0, 0, -speed]])}}, **options)
    assert runs.duration[0, 0] == pytest.approx(12e-6 - start, abs=0.05 * STEP)


# What is told after runs.


@pytest.fixture(scope="module")
def yielding():
    """A marble whose patches are so small that fast impacts leave them, of a material that yields early."""
    refine = [ep.Refine((0, 0, -R), 0.5e-3, 0.08e-3)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=4e-3, refine=refine, grading=0.6)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, -R), 0.22e-3, name="south"), f_cut=200e3)


def texts_of(warnings_of):
    """What each run is told, by words that a single run is told too."""
    words = "edge of its patch", "rotated by more", "has turned by", "yield", "overlap", "closed"
    return {word for word in words if any(word in text for text in warnings_of)}


@pytest.mark.parametrize("workers", [1, 2])
def test_entries_are_told_what_single_runs_are_told(yielding, tmp_path, workers):
    given = {
        "initialVelocity": np.array([[0, 0, -2e-4], [0, 0, -0.3], [0, 0, -3.0], [0, 0, -2e-4]]),
        "initialAngularVelocity": np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 5e3, 0.0]]),
    }
    mbs, [ball], _ = fall(yielding)
    to_file = {"histories": (), "file": tmp_path / "runs.jsonl", "workers": workers}
    with pytest.warns(ep.errors.PartitionWarning) as told:
        runs = many(mbs, {ball: given}, **to_file)
    single = []
    for entry in range(4):
        model = fall(yielding, **{name: values[entry] for name, values in given.items()})[0]
        result = ep.solve_dynamic(model, end_time=END, step=STEP, solver="compiled")
        single.append(texts_of(result.warnings))
    assert [texts_of(runs.warnings.get(entry, ())) for entry in range(4)] == single
    assert single[2] == {"edge of its patch", "yield"}
    assert single[3] == single[2] | {"rotated by more", "has turned by"}
    said = [str(w.message) for w in told]
    assert sum("2 of 4 runs: contact 'floor' reached the edge of its patch" in text for text in said) == 1
    assert any(w.category is ep.errors.ContactPatchWarning for w in told)
    with pytest.warns(ep.errors.PartitionWarning) as again:  # the file has it too
        assert many(mbs, {ball: given}, **to_file).warnings == runs.warnings
    assert sorted(str(w.message) for w in again) == sorted(said)


def test_entries_that_start_within_the_plane_are_told(yielding):
    mbs, [ball], _ = fall(yielding)
    places = {"referencePosition": np.array([[0, 0, R + 1e-6], [0, 0, R - 2e-6]]), "initialVelocity": np.zeros((2, 3))}
    with pytest.warns(ep.errors.ModelLimitWarning, match="1 of 2 runs: contact 'floor' starts with an overlap"):
        runs = many(mbs, {ball: places})
    assert [*runs.warnings] == [1]


def test_depths_of_rows_by_numpy_and_by_loops_are_equal(yielding):
    (mbs, [ball], _), speeds = fall(yielding), {"initialVelocity": np.array([[0, 0, -3.0]])}
    texts = [many(mbs, {ball: speeds}).warnings]
    with without_numba():
        texts.append(many(mbs, {ball: speeds}).warnings)
    assert texts[0] == texts[1]
    assert "edge of its patch" in texts_of(texts[0][0])
