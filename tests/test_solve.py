"""Runs in Exudyn: oracle, conservation, both integrators, other items, errors, and runs that end early."""

import os
import signal

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from conftest import MARBLE_RADIUS, TOP, relative

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.errors import (
    ContactPatchWarning,
    InputError,
    ModelLimitWarning,
    PartitionWarning,
    RunError,
    StepSizeError,
    StoppedRunWarning,
)
from exudyn_partition.exudyn_contacts.partition_contact import partition_items

END = 60e-6


def verlet(law, bodies, position_velocity, step, steps):
    """The oracle: the same reduced model by central differences in a dozen lines of NumPy."""
    stiffness = np.concatenate([body.stiffness.diagonal() for body in bodies])
    problem, gap, H = Complementarity(law.problem.F), law.gaps.held.gap, law.gaps.H
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
    q, v, force = verlet(contact.law, bodies, start, 0.5e-6, 120)
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


def test_the_caller_s_model_keeps_working(impact):
    """A mass on a spring beside the impact, its sensor, and a PreStep function of the user's own."""
    mbs, _, _, contact = impact
    mass = mbs.AddObject(
        items.MassPoint(physicsMass=1.0, nodeNumber=mbs.AddNode(items.NodePoint(initialVelocities=[1, 0, 0])))
    )
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.AddObject(items.ObjectGround())))
    end = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mass))
    omega = 2 * np.pi / END
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[ground, end], stiffness=[omega**2] * 3, damping=[0] * 3))
    sensor = mbs.AddSensor(
        items.SensorBody(bodyNumber=mass, outputVariableType=exu.OutputVariableType.Position, storeInternal=True)
    )
    calls = []
    mbs.SetPreStepUserFunction(lambda mbs, t: calls.append(t) or True)
    own = mbs.GetPreStepUserFunction()["function"]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    assert len(calls) == 600
    assert mbs.GetPreStepUserFunction()["function"] is own
    np.testing.assert_allclose(result.sensor(sensor)[:, 0], np.sin(omega * result.t) / omega, atol=1e-3 / omega)
    assert contact.force(result).max() > 1e3


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
    K = scipy.linalg.block_diag(*(body.stiffness.toarray() for body in bodies)) + contact.law.closed_stiffness()
    assert ep.stability_limit(mbs) == pytest.approx(2 / np.sqrt(np.linalg.eigvalsh(K)[-1]), rel=1e-3)


def test_step_above_the_stability_limit(impact):
    mbs, *_ = impact
    limit = ep.stability_limit(mbs)
    with pytest.raises(StepSizeError, match=r"above the stability limit .* Take at most"):
        ep.solve_dynamic(mbs, end_time=END, step=1.05 * limit)
    assert ep.solve_dynamic(mbs, end_time=END, step=0.95 * limit).status == "finished"


@pytest.fixture(scope="module", params=["free", "craig-bampton"])
def nodal_bodies(request, pair_of):
    return pair_of(request.param)


def nodal_impact(mbs, nodal_bodies):
    striker = ep.CreatePartitionBody(mbs, nodal_bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, nodal_bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation="lagrange", name="tip")
    mbs.Assemble()
    return striker, target, contact


def test_multipliers_conserve_momentum_and_agree_with_compliance(nodal_bodies, impact):
    mbs = exu.SystemContainer().AddSystem()
    striker, target, contact = nodal_impact(mbs, nodal_bodies)
    result = ep.solve_dynamic(mbs, end_time=30e-6)
    change = [item.momentum(result)[-1, 2] - item.momentum(result)[0, 2] for item in (striker, target)]
    assert change[0] == pytest.approx(-change[1], rel=1e-9)
    assert change[0] == pytest.approx(result.history(contact).impulse, rel=1e-9)
    seldom = ep.solve_dynamic(mbs, end_time=30e-6, sample_period=1e-6)
    assert change[0] == pytest.approx(seldom.history(contact).impulse, rel=1e-9)
    energy = striker.energy(result) + target.energy(result)
    assert energy[-1] == pytest.approx(energy[0], rel=0.02)
    # Bases without the static answer of what is cut are the stiffer ones: their impulse comes earlier.
    compliance = ep.solve_dynamic(impact[0], end_time=30e-6, step=0.1e-6)
    other = impact[1].momentum(compliance)[-1, 2] - impact[1].momentum(compliance)[0, 2]
    assert 0.99 < change[0] / other < 1.25


def test_multipliers_keep_gaps_closed(mbs, nodal_bodies):
    _, _, contact = nodal_impact(mbs, nodal_bodies)
    result = ep.solve_dynamic(mbs, end_time=3e-6)
    q = np.hstack([contact.slave.coordinates(result), contact.master.coordinates(result)])
    gaps = contact.law.gaps.held.gap[:, None] + contact.law.G @ q.T
    assert gaps.min() > -1e-15
    assert contact.force(result).max() > 100


def test_ctrl_c_keeps_what_was_computed(impact):
    mbs, _, _, contact = impact
    before = signal.getsignal(signal.SIGINT)
    interrupted = []

    def press_ctrl_c(share):
        if share > 0.5 and not interrupted:
            interrupted.append(share)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.warns(StoppedRunWarning, match="interrupted by the user; results are kept up to") as caught:
        result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6, progress=press_ctrl_c)
    assert caught[0].filename == __file__  # the user's line, not one of the library
    assert result.status == "interrupted"
    assert 0.45 * END < result.t[-1] < 0.6 * END
    assert contact.force(result).max() > 1e3
    assert signal.getsignal(signal.SIGINT) is before


def test_an_unstable_run_keeps_what_was_computed(impact):
    """Made unstable by a user's own force, which no check beforehand can see."""
    mbs, striker, _, contact = impact
    n = striker.body.n_dofs
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=[striker["nModal"]],
            forceUserFunction=lambda mbs, t, i, q, v: 1e16 * np.asarray(q) if t > 30e-6 else np.zeros(n),
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    mbs.Assemble()
    with pytest.warns(PartitionWarning) as caught:
        result = ep.solve_dynamic(mbs, end_time=2000e-6, step=0.5e-6)
    said = [str(warning.message) for warning in caught if warning.category is StoppedRunWarning]
    assert len(said) == 1
    assert "results are kept up to t = " in said[0]
    assert result.status == "unstable"
    assert 30e-6 <= result.t[-1] < 1500e-6
    assert np.isfinite(contact.force(result)).all()
    assert np.isfinite(striker.coordinates(result)).all()


def collide(bodies, mbs=None, gap=0.0, formulation="compliance", **options):
    """Ball and block at 1 m/s, assembled."""
    mbs = mbs or exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(
        mbs, bodies[0], referencePosition=np.add(TOP, [0, 0, gap]), **{"initialVelocity": [0, 0, -1.0], **options}
    )
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation=formulation)
    mbs.Assemble()
    return mbs, striker, target, contact


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


def test_a_prestep_function_set_after_the_multipliers(nodal_bodies):
    mbs, _, _, contact = collide(nodal_bodies, formulation="lagrange")
    calls = []
    mbs.SetPreStepUserFunction(lambda mbs, t: calls.append(t) or True)
    result = ep.solve_dynamic(mbs, end_time=2e-6)
    assert contact.force(result).max() > 10
    assert len(calls) == result.steps

    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 2e-6, result.steps
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    with pytest.raises(Exception, match="its multipliers were not applied in the step"):
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)


def test_a_second_run_is_the_first_again(nodal_bodies, impact):
    lagrange = collide(nodal_bodies, formulation="lagrange")
    for mbs, *_, contact in (lagrange, impact):
        first, second = (contact.force(ep.solve_dynamic(mbs, end_time=3e-6)) for _ in range(2))
        np.testing.assert_array_equal(first, second)
        assert first[0] < 0.02 * first.max()


def test_multipliers_keep_all_steps_of_plain_runs(nodal_bodies):
    """Exudyn reads its sensors at the ends alone; explicit multipliers are found before the steps that they act in."""
    mbs, *_, contact = collide(nodal_bodies, formulation="lagrange")
    for method, solver in (("explicit", "VelocityVerlet"), ("implicit", "GeneralizedAlpha")):
        ours = ep.solve_dynamic(mbs, end_time=20e-8, step=1e-8, method=method)
        expected = contact.force(ours)
        settings = exu.SimulationSettings()
        settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = ours.t[-1], ours.steps
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
        settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
        result = ep.collect(mbs)
        assert expected.max() > 1
        np.testing.assert_allclose(result.t, ours.t, atol=1e-15)
        np.testing.assert_allclose(contact.force(result), expected, atol=1e-5 * expected.max())


def test_an_interrupted_run_leaves_nothing_to_the_next(nodal_bodies):
    mbs, *_, contact = collide(nodal_bodies, formulation="lagrange")
    whole = contact.force(ep.solve_dynamic(mbs, end_time=3e-6))

    def press_ctrl_c(share):
        if 0.4 < share < 0.6:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        ep.solve_dynamic(mbs, end_time=3e-6, sample_period=3e-6, progress=press_ctrl_c)
    np.testing.assert_array_equal(contact.force(ep.solve_dynamic(mbs, end_time=3e-6)), whole)


def test_reading_the_force_during_a_run_changes_nothing(nodal_bodies):
    mbs, *_, contact = collide(nodal_bodies, formulation="lagrange")
    undisturbed = contact.force(ep.solve_dynamic(mbs, end_time=3e-6, sample_period=0.3e-6))
    mbs.SetPreStepUserFunction(lambda mbs, t: len(mbs.GetSensorValues(contact["sForce"])) > 0)
    read = contact.force(ep.solve_dynamic(mbs, end_time=3e-6, sample_period=0.3e-6))
    np.testing.assert_allclose(read, undisturbed, rtol=1e-12)


@pytest.mark.parametrize("nodal_bodies", ["craig-bampton"], indirect=True)  # nodes of mass would only be slower
def test_multipliers_refuse_the_static_solver(nodal_bodies):
    """One load step presses the ball into the block, for multipliers act on velocities."""
    mbs, striker, _, _ = collide(nodal_bodies, formulation="lagrange", initialVelocity=[0, 0, 0])
    for item in partition_items(mbs)[0]:
        # Springs hold the rigid motion of both; 50 N, spread over its mass, press the striker down.
        M_rigid = item.body.mass @ item.body.rigid
        load = -50.0 / item.body.total_mass * M_rigid[:, 2] * (item is striker)
        mbs.AddObject(
            items.ObjectGenericODE2(
                nodeNumbers=item.nodes,
                stiffnessMatrix=exu.MatrixContainer(sp.csr_matrix(1e6 / item.body.total_mass**2 * M_rigid @ M_rigid.T)),
                forceVector=load,
                visualization=items.VObjectGenericODE2(show=False),
            )
        )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    with pytest.raises(Exception, match="needs Exudyn's explicit solver VelocityVerlet"):
        mbs.SolveStatic(settings)


def test_force_on_the_slave_is_its_change_of_momentum(impact):
    mbs, striker, _, contact = impact
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    impulse = np.trapezoid(contact.force_on_slave(result), result.t, axis=0)
    change = striker.momentum(result)[-1] - striker.momentum(result)[0]
    np.testing.assert_allclose(impulse, change, atol=1e-9 * change[2])


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


def test_a_result_prints_itself_in_a_line(impact):
    result = ep.solve_dynamic(impact[0], end_time=1e-6, step=0.5e-6)
    assert repr(result) == "Result(finished: reached 1e-06 s; 2 steps of 5e-07 s, explicit, 3 samples)"
    said = "Result(finished: samples of the model's last run; 2 steps of 5e-07 s, explicit, 3 samples)"
    assert str(ep.collect(impact[0])) == said


def test_a_result_of_another_model_is_refused(bodies):
    """Sensors of equal models have equal numbers: what they stored would pass for the other's."""
    (mbs, *_), (_, striker, _, contact) = collide(bodies), collide(bodies)
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    for ask in (striker.energy, striker.momentum, contact.force, contact.closed_rows, contact.gap, contact.row_forces):
        with pytest.raises(InputError, match=r"result: .* model that (the contact|the body) belongs to, .* another"):
            ask(result)


def test_results_of_a_model_live_side_by_side(impact):
    """What a contact keeps beside its sensors belongs to the run: a later one takes nothing of it."""
    mbs, _, _, contact = impact
    first = ep.solve_dynamic(mbs, end_time=20e-6)
    force, rows = contact.force(first), contact.row_forces(first)
    assert force.max() > 0
    asked = (contact.row_forces, contact.pressure, contact.area, contact.radius, contact.energy, contact.nodal_forces)
    before = [ask(first) for ask in asked]
    np.testing.assert_allclose(contact.row_forces(first.at(3)).sum(axis=1).A1, contact.force(first.at(3)))
    np.testing.assert_array_equal(contact.row_forces(ep.collect(mbs)).data, rows.data)
    second = ep.solve_dynamic(mbs, end_time=2e-6)
    for ask, was in zip(asked, before, strict=True):
        assert not same(ask(second), was)
        assert same(ask(first), was)
    np.testing.assert_array_equal(contact.force(first), force)


def same(one, other):
    """Whether two answers, arrays or sparse matrices or lists of such, are equal."""
    if isinstance(one, list):
        return all(map(same, one, other))
    if one.shape != other.shape:
        return False
    return (one != other).nnz == 0 if sp.issparse(one) else np.array_equal(one, other)


def test_questions_change_no_run(impact):
    """A run is the same whether results of an earlier one are asked in the midst of it or not."""
    mbs, striker, _, contact = impact
    first = ep.solve_dynamic(mbs, end_time=20e-6)
    asked = []

    def ask(share):
        asked.append(share)
        contact.energy(first)
        contact.nodal_forces(first)
        ep.stability_limit(mbs)
        q = np.zeros(contact.law.gaps.n)
        ep.time_to_contact(contact, q, q)

    second = ep.solve_dynamic(mbs, end_time=20e-6, progress=ask)
    assert len(asked) > 50
    np.testing.assert_array_equal(contact.force(second), contact.force(first))
    np.testing.assert_array_equal(striker.coordinates(second), striker.coordinates(first))


def test_two_contacts_on_one_patch(impact, bodies):
    mbs, _, target, _ = impact
    second = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP)
    with pytest.raises(InputError, match="already has the contact 'tip'"):
        ep.CreatePartitionContact(mbs, second, target)


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


def test_a_run_that_grows_beyond_all_bounds_is_not_finished(impact):
    """Far above the stability limit by plain SolveDynamic, which nothing checks beforehand."""
    mbs, *_ = impact
    step = 3 * ep.stability_limit(mbs)
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 40 * step, 40
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = step
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    with pytest.warns(PartitionWarning) as caught:
        result = ep.collect(mbs)
    assert result.status == "unstable"
    assert any("grown beyond all bounds" in str(warning.message) for warning in caught)
    assert 0 < len(result.t) < 40


@pytest.mark.parametrize("sample_period", [0.5e-6, END])
def test_a_user_function_that_ends_the_run(impact, sample_period):
    mbs, *_ = impact
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 20e-6)
    with pytest.warns(StoppedRunWarning, match="user function ended the run at .* s; results are kept"):
        result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6, sample_period=sample_period)
    assert result.status == "interrupted"
    assert result.steps in (40, 41)


def test_large_rotation_warns(mbs, bodies):
    ep.CreatePartitionBody(mbs, bodies[0], name="ball", initialAngularVelocity=[500.0, 0, 0])
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=r"body 'ball' has rotated by more than 0.1 rad at t = 0.0002"):
        ep.solve_dynamic(mbs, end_time=0.4e-3)


def test_the_step_that_is_taken_is_never_longer_than_asked_for(impact):
    mbs, *_ = impact
    limit = ep.stability_limit(mbs)
    result = ep.solve_dynamic(mbs, end_time=3.4 * limit, step=0.99 * limit)
    assert result.steps == 4
    assert result.step <= 0.99 * limit


def test_the_user_s_settings_are_kept(impact, tmp_path):
    mbs, *_ = impact
    settings = exu.SimulationSettings()
    settings.solution.file.name = str(tmp_path / "solution.txt")
    settings.timeIntegration.verboseMode = 0
    ep.solve_dynamic(mbs, end_time=END, settings=settings)
    assert (tmp_path / "solution.txt").stat().st_size > 1000
    settings.timeIntegration.startTime = 1.0
    with pytest.raises(InputError, match=r"end_time: expected more than timeIntegration.startTime, 1 s, got 6e-05 s"):
        ep.solve_dynamic(mbs, end_time=END, settings=settings)


def test_a_model_that_exudyn_cannot_run(mbs, bodies):
    ep.CreatePartitionBody(mbs, bodies[0])
    mbs.AddNode(items.NodePoint())  # without mass
    mbs.Assemble()
    with pytest.raises(RunError, match="Exudyn cannot run the model"):
        ep.solve_dynamic(mbs, end_time=1e-6)


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
    with pytest.raises(InputError, match="expected two bodies, got the same twice"):
        ep.CreatePartitionContact(mbs, body, body)
    with pytest.raises(InputError, match="formulation: expected one of"):
        ep.CreatePartitionContact(mbs, body, ep.CreatePartitionBody(mbs, bodies[1]), formulation="glue")
    with pytest.raises(RunError, match=r"call mbs.Assemble\(\)"):
        ep.solve_dynamic(mbs, end_time=1e-3)
