"""Runs in Exudyn: oracle, conservation, both integrators, other items, errors, and runs that end early."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.linalg
from oracles import MARBLE_RADIUS, SPHERE_RADIUS, TOP, box, collide, relative

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.errors import (
    ContactPatchWarning,
    InputError,
    ModelLimitWarning,
    RunError,
    StepSizeError,
    StoppedRunWarning,
)

END = 60e-6


def verlet(law, bodies, position_velocity, step, steps):
    """The oracle: the same reduced model by central differences in a dozen lines of NumPy."""
    stiffness = np.concatenate([body.stiffness.diagonal() for body in bodies])
    problem, gap, H = Complementarity(law.law.problem.F), law.gaps.stage.linear.start, law.gaps.stage.linear.H
    q, v = np.zeros(len(stiffness)), position_velocity.copy()
    a, force = np.zeros(len(q)), np.zeros(steps + 1)
    for n in range(steps):
        q = q + step * v + step**2 / 2 * a
        lam = problem.solve(gap + H @ q)
        new = H.T @ lam - stiffness * q
        v, a, force[n + 1] = v + step / 2 * (a + new), new, lam.sum()
    return q, v, force


def test_exudyn_integrates_what_numpy_does(impact, bodies):
    mbs, striker, target, contact = impact
    result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6)
    assert result.status == "finished"
    assert result.steps == 120
    start = np.concatenate([-bodies[0].rigid[:, 2], np.zeros(bodies[1].n_dofs)])
    q, v, force = verlet(contact.mechanics, bodies, start, 0.5e-6, 120)
    assert contact.force(result).max() > 1e3
    np.testing.assert_allclose(contact.force(result), force, atol=1e-8 * force.max())
    got = np.hstack([striker.coordinates(result)[-1], target.coordinates(result)[-1]])
    np.testing.assert_allclose(got, q, atol=1e-9 * abs(q).max())
    got = np.hstack([striker.coordinates_t(result)[-1], target.coordinates_t(result)[-1]])
    np.testing.assert_allclose(got, v, atol=1e-8 * abs(v).max())


def test_momentum_and_energy(impact):
    mbs, striker, target, contact = impact
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    history = result.history(contact)
    change = [item.momentum(result)[-1] - item.momentum(result)[0] for item in (striker, target)]
    np.testing.assert_allclose(change[0], [0, 0, history.impulse], atol=1e-9 * history.impulse)
    np.testing.assert_allclose(change[1], -change[0], atol=1e-9 * history.impulse)
    energy = striker.energy(result) + target.energy(result) + contact.energy(result)
    assert energy[0] == pytest.approx(0.5 * striker.body.total_mass)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-3)
    assert contact.closed_rows(result).max() > 1
    assert contact.force(result).min() >= 0


def test_energy_error_is_of_second_order_in_the_step(mbs, bodies):
    errors = []
    for step in (0.4e-6, 0.2e-6):
        model = exu.SystemContainer().AddSystem()
        striker = ep.CreatePartitionBody(model, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
        target = ep.CreatePartitionBody(model, bodies[1])
        contact = ep.CreatePartitionContact(model, striker, target)
        model.Assemble()
        result = ep.solve_dynamic(model, end_time=20e-6, step=step)
        energy = striker.energy(result) + target.energy(result) + contact.energy(result)
        errors.append(abs(energy / energy[0] - 1).max())
    assert 2.5 < errors[0] / errors[1] < 6


def test_explicit_and_implicit_agree_and_converge(impact):
    mbs, *_, contact = impact
    explicit = contact.force(ep.solve_dynamic(mbs, end_time=END, step=0.05e-6, sample_period=1e-6))
    errors = []
    for step in (0.4e-6, 0.1e-6):
        result = ep.solve_dynamic(
            mbs, end_time=END, step=step, sample_period=1e-6, method="implicit", spectral_radius=1.0
        )
        force = np.interp(np.linspace(0, END, len(explicit)), result.t, contact.force(result))
        errors.append(relative(force, explicit))
    assert errors[1] < 0.01
    assert errors[1] < errors[0]


def test_velocity_of_a_rigid_body_before_contact(mbs, bodies):
    body = ep.CreatePartitionBody(
        mbs,
        bodies[0],
        referencePosition=[1, 2, 3],
        initialVelocity=[1, 2, 3],
        initialAngularVelocity=[0.1, 0, 0],
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    point = bodies[0].points[bodies[0].nearest_node((0.008, 0.0, 0.015))]
    expected = np.array([1, 2, 3]) + np.cross([0.1, 0, 0], point - bodies[0].centre_of_mass)
    np.testing.assert_allclose(body.velocity(result, point)[0], expected, rtol=1e-9)
    np.testing.assert_allclose(body.displacement(result, point)[-1], 1e-6 * expected, rtol=1e-4)


def test_plain_solve_dynamic_gives_the_same(impact):
    mbs, _, _, contact = impact
    ours = contact.force(ep.solve_dynamic(mbs, end_time=END, step=0.5e-6))
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, 120
    settings.timeIntegration.verboseMode = 0
    settings.solution.sensors.writePeriod = END / 120
    settings.solution.file.write = False
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    np.testing.assert_allclose(contact.force(ep.collect(mbs)), ours, atol=1e-9 * ours.max())


def test_stability_limit_against_dense_eigenvalues(impact, bodies):
    mbs, _, _, contact = impact
    K = scipy.linalg.block_diag(*(body.stiffness.toarray() for body in bodies)) + contact.mechanics.closed_stiffness()
    assert ep.stability_limit(mbs) == pytest.approx(2 / np.sqrt(np.linalg.eigvalsh(K)[-1]), rel=1e-3)


def test_step_above_the_stability_limit(impact):
    mbs, *_ = impact
    limit = ep.stability_limit(mbs)
    with pytest.raises(StepSizeError, match=r"above the stability limit .* Take at most"):
        ep.solve_dynamic(mbs, end_time=END, step=1.05 * limit)
    assert ep.solve_dynamic(mbs, end_time=END, step=0.95 * limit).status == "finished"


def test_pairs_are_right_for_bodies_that_start_apart(bodies, marble):
    """Two spheres: closest points in the reference would pair nodes that never meet, and lose half the force."""
    peaks = []
    for gap in (0.0, 1.5e-3):  # further away only with the partitions' direction given
        mbs = exu.SystemContainer().AddSystem()
        place = [0, 0, MARBLE_RADIUS + gap]
        striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=place, initialVelocity=[0, 0, -1.0])
        contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, marble), masterPatch="north")
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=gap + 30e-6, step=0.3e-6)
        peaks.append(contact.force(result).max())
    assert peaks[1] == pytest.approx(peaks[0], rel=0.01)


def test_a_model_is_rebuilt_after_reset(impact, bodies):
    mbs, *old = impact
    mbs.Reset()
    with pytest.raises(InputError, match="belongs to another model, or to this one before a Reset"):
        ep.CreatePartitionContact(mbs, *old[:2])
    alone = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, 1.0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    assert alone.velocity(result, (0, 0, 0))[-1, 2] == pytest.approx(1.0)


def test_bodies_of_another_model(impact, bodies):
    other = exu.SystemContainer().AddSystem()
    with pytest.raises(InputError, match="belongs to another model"):
        ep.CreatePartitionContact(other, impact[1], ep.CreatePartitionBody(other, bodies[1]))


def test_two_contacts_on_one_patch(impact, bodies):
    mbs, _, target, _ = impact
    second = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP)
    with pytest.raises(InputError, match="already has the contact 'tip'"):
        ep.CreatePartitionContact(mbs, second, target, formulation="penalty")


def test_contact_at_the_rim_of_its_patch_warns(ball, block, top):
    small = ep.Partition.ball(ball[0], (0, 0, 0), 0.3e-3)
    bodies = [ep.reduce(*pair, basis="residual", f_cut=150e3) for pair in ((ball[0], small), (block, top))]
    mbs, *_ = collide(bodies)
    with pytest.warns(
        ContactPatchWarning, match="reached the edge .* Enlarge the contact radius of both partitions$"
    ) as caught:
        ep.solve_dynamic(mbs, end_time=END)
    assert caught[0].filename == __file__
    mbs = exu.SystemContainer().AddSystem()
    ep.CreatePartitionContact(mbs, ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -1]), ep.RigidPlane())
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="Enlarge the contact radius of the partition$"):
        ep.solve_dynamic(mbs, end_time=END)


def test_whole_faces_have_no_rim(block):
    """A patch that ends where the body ends is complete."""
    face = ep.Partition.ball(block, TOP, 0.02)
    assert len(face.patches[0].rim) == 0
    assert set(block.points[face.patch_nodes, 2].round(9)) == {0.03}
    assert len(ep.Partition.ball(block, TOP, 6e-3).patches[0].rim) > 0


@pytest.mark.parametrize(("steps", "step"), [(100, 1e-5), (50, 4e-4)])
def test_rounding_of_stiff_nodes_in_flight_divides_no_implicit_step(mbs, steps, step):
    """Elastic forces of nodes cancel out in flight, but for rounding that grows with the way."""
    fem = ep.fe_model(box(0.01, 0.006, 0.1), ep.ALUMINIUM, maxh=6e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0.003, 0.05), 9e-3), f_cut=20e3, basis="free")
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, -1.0, 0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=steps * step, step=step, method="implicit")
    assert result.steps == steps
    momentum = item.momentum(result)
    assert abs(momentum - momentum[0]).max() < 1e-6 * abs(momentum).max()


def test_large_rotation_warns(mbs, bodies):
    ep.CreatePartitionBody(mbs, bodies[0], name="ball", initialAngularVelocity=[500.0, 0, 0])
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=r"body 'ball' has rotated by more than 0.1 rad at t = 0.0002"):
        ep.solve_dynamic(mbs, end_time=0.4e-3)


@pytest.mark.filterwarnings("ignore:contact 'hit' at t")  # few rows close
@pytest.mark.parametrize(("turn", "told"), [(0.05, True), (0.01, False)])
def test_a_body_that_has_turned_before_it_hits_warns(mbs, round_body, turn, told):
    """To take its rotation as small makes a ball larger by r phi^2 / 2, and its speed of approach by r phi omega."""
    apart, speed = 0.2e-3, 0.1
    rate, grown = turn * speed / apart, SPHERE_RADIUS * turn**2 / 2
    place = {"referencePosition": [0, 0, apart], "initialVelocity": [0, 0, -speed]}
    ball = ep.CreatePartitionBody(mbs, round_body, name="ball", initialAngularVelocity=[0, rate, 0], **place)
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), name="hit")
    mbs.Assemble()
    options = {"end_time": apart / speed, "step": 0.5e-6}
    if not told:
        ep.solve_dynamic(mbs, **options)
        return
    said = r"of which (\S+) m/s are wrong: body 'ball' has turned by 0.04\d rad until then, and frame='inertial'"
    with pytest.warns(ModelLimitWarning, match=said) as texts:
        ep.solve_dynamic(mbs, **options)
    (wrong,) = [float(found[1]) for text in texts if (found := re.search(said, str(text.message)))]
    assert wrong == pytest.approx(SPHERE_RADIUS * turn * rate * (1 - grown / apart), rel=0.1)


def test_the_step_that_is_taken_is_never_longer_than_asked_for(impact):
    mbs, *_ = impact
    limit = ep.stability_limit(mbs)
    result = ep.solve_dynamic(mbs, end_time=3.4 * limit, step=0.99 * limit)
    assert result.steps == 4
    assert result.step <= 0.99 * limit


def test_a_model_that_exudyn_cannot_run(mbs, bodies):
    ep.CreatePartitionBody(mbs, bodies[0])
    mbs.AddNode(items.NodePoint())  # without mass
    mbs.Assemble()
    with pytest.raises(RunError, match="Exudyn cannot run the model"):
        ep.solve_dynamic(mbs, end_time=1e-6)


def test_joints_that_hold_the_same_twice_are_told(mbs, arm_body):
    item = ep.CreatePartitionBody(mbs, arm_body)
    for _ in range(2):
        base = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
        mbs.AddObject(items.GenericJoint(markerNumbers=[base, item.CreateInterfaceMarker(mbs, "foot")]))
    mbs.Assemble()
    with pytest.warns(StoppedRunWarning, match=r"not factorized.*joints hold the same motion twice"):
        ep.solve_dynamic(mbs, end_time=2e-6, step=1e-6, method="implicit")


@pytest.mark.parametrize(("period", "said"), [(80e-6, "closed, but in no sample"), (30e-6, "has . samples with a")])
def test_samples_that_miss_an_impact_warn(mbs, bodies, period, said):
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, bodies[1]))
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=rf"{said}.* too far apart"):
        result = ep.solve_dynamic(mbs, end_time=160e-6, sample_period=period)
    assert contact.force(result)[-1] == 0


@pytest.mark.parametrize(
    ("step", "period", "end", "samples"),
    [
        (None, 2e-6, 50e-6, 25),  # 25 periods, whatever the default step is
        (0.3e-6, 1e-6, 20e-6, 20),  # a period of no whole number of steps
        (1e-6, 1.4e-6, 21e-6, 15),
        (1e-6, 3e-6, 20e-6, 7),  # 6.7 periods
        (1e-6, 1e-6, 10.5e-6, 11),  # 10.5 steps, and each has a sample
        (1e-6, 0.3e-6, 10e-6, 10),
        (1e-6, 1.0, 10e-6, 1),
    ],
)
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_samples_are_equally_spaced(impact, method, step, period, end, samples):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=end, step=step, sample_period=period, method=method)
    np.testing.assert_allclose(result.t, np.linspace(0, end, samples + 1), atol=1e-6 * end)
    assert step is None or result.step < step * (1 + 1e-9)


def test_a_body_that_is_nodes_alone(mbs, block):
    """Region of the whole body: the full FE model in Exudyn, in free flight."""
    everything = ep.Partition.ball(block, TOP, 1.0, contact_radius=6e-3)
    body = ep.reduce(block, everything, basis="free", f_cut=80e3)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 1.0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.1e-6)
    np.testing.assert_allclose(item.velocity(result, (0, 0, 0))[-1], [0, 0, 1], atol=1e-9)


def test_misuse(mbs, bodies, block):
    with pytest.raises(InputError, match="expected what reduce"):
        ep.CreatePartitionBody(mbs, block)
    with pytest.raises(InputError, match="frame: expected one of 'inertial', 'floating', 'auto', got 'rotating'"):
        ep.CreatePartitionBody(mbs, bodies[0], frame="rotating")
    with pytest.raises(InputError, match=r"initialVelocity: expected shape \(3,\)"):
        ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[1.0])
    body = ep.CreatePartitionBody(mbs, bodies[0])
    with pytest.raises(InputError, match="expected two bodies, or two patches of one"):
        ep.CreatePartitionContact(mbs, body, body)
    with pytest.raises(InputError, match="formulation: expected one of"):
        ep.CreatePartitionContact(mbs, body, ep.CreatePartitionBody(mbs, bodies[1]), formulation="glue")
    with pytest.raises(RunError, match=r"call mbs.Assemble\(\)"):
        ep.solve_dynamic(mbs, end_time=1e-3)


@pytest.mark.filterwarnings("ignore")
def test_settings_of_a_user_stay_as_they_are(mbs, bodies):
    """Start, end and steps of one run had stayed in them, and moved the next one; also after an error."""
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[0, 0, 1e-6], initialVelocity=[0, 0, -0.5])
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode, settings.staticSolver.verboseMode = False, 0, 0
    given, own = settings.GetDictionary(), {"step": 0.25e-6, "settings": settings}
    first = ep.solve_dynamic(mbs, start_time=1e-6, end_time=2e-6, **own)
    ep.solve_dynamic(mbs, end_time=3e-6, go_on=True, **own)
    ep.solve_dynamic(mbs, end_time=2e-6, method="implicit", adaptive=True, spectral_radius=0.5, **own)
    ep.solve_static(mbs, load_steps=7, load_factor=False, settings=settings)
    mbs.SetPreStepUserFunction(lambda mbs, t: 1 / 0)
    with pytest.raises(RunError, match="ZeroDivisionError"):
        ep.solve_dynamic(mbs, end_time=2e-6, adaptive=True, **own)
    mbs.SetPreStepUserFunction(0)
    assert settings.GetDictionary() == given
    last = ep.solve_dynamic(mbs, end_time=2e-6, **own)
    assert (first.t[0], last.t[0]) == (1e-6, 0.0)
