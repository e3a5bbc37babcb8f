"""Multipliers in explicit runs: conservation, closed gaps, plain and interrupted runs, other solvers."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import TOP, collide, ctrl_c_after

import exudyn_partition as ep
from exudyn_partition.errors import StepSizeError, StoppedRunWarning
from exudyn_partition.exudyn_contacts.partition_contact import partition_items


@pytest.fixture(scope="module", params=["craig-bampton"])  # of a free basis steps are as many, and slower
def nodal_bodies(request, pair_of):
    return pair_of(request.param)


both_bases = pytest.mark.parametrize("nodal_bodies", ["free", "craig-bampton"], indirect=True)


def nodal_impact(mbs, nodal_bodies):
    striker = ep.CreatePartitionBody(mbs, nodal_bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, nodal_bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation="lagrange", name="tip")
    mbs.Assemble()
    return striker, target, contact


@both_bases
def test_multipliers_take_explicit_steps_of_nanoseconds(mbs, nodal_bodies):
    """On these coarse meshes below a tenth of a microsecond: the kept nodes vibrate far above f_cut."""
    nodal_impact(mbs, nodal_bodies)
    assert ep.stability_limit(mbs) < 2e-7
    with pytest.raises(StepSizeError, match="above the stability limit"):
        ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6, method="explicit")


@pytest.mark.parametrize(("basis", "fine"), [("free", False), ("craig-bampton", True)])
def test_multipliers_conserve_momentum_and_agree_with_compliance(pair_of, impact, basis, fine):
    mbs = exu.SystemContainer().AddSystem()
    striker, target, contact = nodal_impact(mbs, pair_of(basis, fine))
    result = ep.solve_dynamic(mbs, end_time=30e-6)
    change = [item.momentum(result)[-1, 2] - item.momentum(result)[0, 2] for item in (striker, target)]
    assert change[0] == pytest.approx(-change[1], rel=1e-9)
    assert change[0] == pytest.approx(result.history(contact).impulse, rel=1e-9)
    seldom = ep.solve_dynamic(mbs, end_time=10e-6, sample_period=1e-6)  # with slightly shorter steps
    assert np.ptp(striker.momentum(seldom)[[0, -1], 2]) == pytest.approx(seldom.history(contact).impulse, rel=1e-9)
    energy = striker.energy(result) + target.energy(result)
    assert energy[-1] == pytest.approx(energy[0], rel=0.02)
    # Bases without the static answer of what is cut are the stiffer ones: their impulse comes earlier.
    compliance = ep.solve_dynamic(impact[0], end_time=30e-6, step=0.1e-6)
    other = impact[1].momentum(compliance)[-1, 2] - impact[1].momentum(compliance)[0, 2]
    assert 0.99 < change[0] / other < 1.25


@both_bases
def test_multipliers_keep_gaps_closed(mbs, nodal_bodies):
    _, _, contact = nodal_impact(mbs, nodal_bodies)
    result = ep.solve_dynamic(mbs, end_time=3e-6)
    q = np.hstack([contact.slave.coordinates(result), contact.master.coordinates(result)])
    gaps = contact.mechanics.gaps.stage.linear.start[:, None] + contact.mechanics.gaps.stage.linear.H @ q.T
    assert gaps.min() > -1e-15
    assert contact.force(result).max() > 100


def test_energy_does_not_swing_while_multipliers_push(mbs, nodal_bodies):
    """Half of the impulse that acts at a sample is in the velocities there, in sensors as in what plain runs keep."""
    striker, target, _ = nodal_impact(mbs, nodal_bodies)
    step, steps = 0.5 * ep.stability_limit(mbs), 600
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = steps * step, steps
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False

    def plain():
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
        return ep.collect(mbs)

    def by_library():
        mbs.SetPostStepUserFunction(lambda mbs, t: True)  # set after contacts
        return ep.solve_dynamic(mbs, end_time=steps * step, step=step)

    for run in (plain, by_library):
        result = run()
        energy = striker.energy(result) + target.energy(result)
        assert len(energy) == steps + 1
        assert abs(energy / energy[0] - 1).max() < 1e-5
        assert energy.max() < energy[0] * (1 + 1e-9)


def test_times_of_an_impact_are_those_of_its_speeds(mbs, nodal_bodies):
    """Forces come and go with steps: the last sample without one before, and the first one after, are known."""
    place, way = np.add(TOP, [0, 0, 0.2e-6]), [0, 0, -1.0]
    striker = ep.CreatePartitionBody(mbs, nodal_bodies[0], referencePosition=place, initialVelocity=way)
    target = ep.CreatePartitionBody(mbs, nodal_bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation="lagrange")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=50e-6, step=0.5 * ep.stability_limit(mbs), sample_period=0.1e-6)
    impact = contact.impacts(result, merge=2e-6)[0]
    momentum = striker.momentum(result)[:, 2]
    mass, other = (item.body.total_mass for item in (striker, target))
    separation = momentum / mass - (momentum[0] - momentum) / other
    assert impact.speed_before == pytest.approx(-np.interp(impact.start, result.t, separation), rel=1e-6)
    assert impact.speed_after == pytest.approx(np.interp(impact.end, result.t, separation), rel=1e-2)
    assert impact.impulse == pytest.approx(mass + momentum[-1], rel=1e-2)


@both_bases
def test_pairs_that_are_followed_from_now_on_cause_no_impact(mbs, nodal_bodies):
    """The ball slides out of reach of the frozen pairs: gaps jump by what they did not know, and the force does not."""
    striker = ep.CreatePartitionBody(mbs, nodal_bodies[0], referencePosition=TOP, initialVelocity=[16.0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, nodal_bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation="lagrange")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=10e-6, step=0.5 * ep.stability_limit(mbs))
    assert result.work.pair_searches > 0
    force = contact.force(result)
    assert abs(np.diff(force)).max() < 0.005 * force.max()


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


def test_a_second_run_is_the_first_again(pair_of, impact):
    lagrange = collide(pair_of("craig-bampton", fine=True), formulation="lagrange")
    for mbs, *_, contact in (lagrange, impact):
        first, second = (contact.force(ep.solve_dynamic(mbs, end_time=3e-6)) for _ in range(2))
        np.testing.assert_array_equal(first, second)
        assert first[0] < 0.02 * first.max()


@both_bases
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

    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        ep.solve_dynamic(mbs, end_time=3e-6, sample_period=3e-6, progress=ctrl_c_after(0.4))
    np.testing.assert_array_equal(contact.force(ep.solve_dynamic(mbs, end_time=3e-6)), whole)


def test_reading_the_force_during_a_run_changes_nothing(nodal_bodies):
    mbs, *_, contact = collide(nodal_bodies, formulation="lagrange")
    undisturbed = contact.force(ep.solve_dynamic(mbs, end_time=3e-6, sample_period=0.3e-6))
    mbs.SetPreStepUserFunction(lambda mbs, t: len(mbs.GetSensorValues(contact["sForce"])) > 0)
    read = contact.force(ep.solve_dynamic(mbs, end_time=3e-6, sample_period=0.3e-6))
    np.testing.assert_allclose(read, undisturbed, rtol=1e-12)


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
