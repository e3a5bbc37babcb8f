"""Runs by `mbs.SolveDynamic` directly, whose sensors Exudyn reads each hundredth of a second, and their results."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning, InputError, ModelLimitWarning, StoppedRunWarning
from exudyn_partition.exudyn_contacts import run_record

END = 60e-6
VERLET, IMPLICIT = exu.DynamicSolverType.VelocityVerlet, exu.DynamicSolverType.GeneralizedAlpha
SOLVERS = {"explicit": VERLET, "implicit": IMPLICIT}


def plain(mbs, steps, solver=VERLET, end=END, start=0.0, period=None, **options):
    """A run as Exudyn's users call it."""
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.startTime, integration.endTime, integration.numberOfSteps = start, end, steps
    integration.verboseMode, settings.solution.file.write = 0, False
    integration.generalizedAlpha.spectralRadius = 0.9
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    if period is not None:
        settings.solution.sensors.writePeriod = period
    mbs.SolveDynamic(settings, solverType=solver, **options)


@pytest.mark.parametrize(("frame", "method"), [
    ("inertial", "explicit"), ("inertial", "implicit"), ("floating", "explicit"),
])  # fmt: skip
def test_sensors_that_are_read_seldom_cost_nothing(mbs, bodies, frame, method):
    """All steps are there, equal to those that sensors of every step store, rows and bodies with them."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0], frame=frame)
    contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, bodies[1], frame=frame))
    mbs.Assemble()
    plain(mbs, 120, SOLVERS[method])
    seldom = ep.collect(mbs)
    rows = contact.row_forces(seldom)
    force, (impact,) = contact.force(seldom), contact.impacts(seldom)
    momentum = striker.momentum(seldom)
    assert force.max() > 500
    assert impact.peak == force.max()
    assert impact.impulse == pytest.approx(momentum[-1, 2] - momentum[0, 2], rel=1e-4)
    np.testing.assert_allclose(rows @ np.ones(rows.shape[1]), force, rtol=1e-12)
    assert (seldom.method, seldom.steps, seldom.step) == (method, 120, pytest.approx(END / 120))

    plain(mbs, 120, SOLVERS[method], period=END / 24)  # sensors and the next step ask for the same times
    some = ep.collect(mbs)
    np.testing.assert_array_equal(contact.force(some), force)
    np.testing.assert_array_equal(contact.row_forces(some).toarray(), rows.toarray())

    plain(mbs, 120, SOLVERS[method], period=END / 120)
    every = ep.collect(mbs)
    np.testing.assert_array_equal(seldom.t, every.t)
    np.testing.assert_array_equal(force, contact.force(every))
    np.testing.assert_array_equal(striker.coordinates(seldom), striker.coordinates(every))
    np.testing.assert_array_equal(striker.coordinates_t(seldom), striker.coordinates_t(every))


@pytest.mark.parametrize("solver", ["RK44", "DOPRI5", "TrapezoidalIndex2"])
def test_every_solver_of_exudyn(impact, solver):
    """Also those that ask for forces several times a step, or choose their steps themselves."""
    mbs, striker, _, contact = impact
    plain(mbs, 120, getattr(exu.DynamicSolverType, solver))
    result = ep.collect(mbs)
    momentum = striker.momentum(result)
    assert (np.diff(result.t) > 0).all()
    assert result.history(contact).impulse == pytest.approx(momentum[-1, 2] - momentum[0, 2], rel=1e-3)
    reference = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    assert contact.force(result).max() == pytest.approx(contact.force(reference).max(), rel=2e-3)


def test_runs_one_after_the_other(impact):
    """The last one counts: after a run that failed, and on from where one ended."""
    mbs, striker, _, contact = impact
    plain(mbs, 120)
    whole = ep.collect(mbs)
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 20e-6 or 1 / 0)
    with pytest.raises(Exception, match="ZeroDivisionError"):
        plain(mbs, 120)
    with pytest.warns(StoppedRunWarning, match="the solver stopped at t = .* before the end of the run"):
        failed = ep.collect(mbs)
    assert failed.status == "interrupted"
    assert failed.t[-1] == pytest.approx(20e-6, abs=1e-6)
    np.testing.assert_array_equal(contact.force(failed), contact.force(whole)[: len(failed.t)])
    mbs.SetPreStepUserFunction(0)

    plain(mbs, 60, end=END / 2, updateInitialValues=True)
    first = ep.collect(mbs)
    plain(mbs, 60, start=END / 2, updateInitialValues=True)
    second = ep.collect(mbs)
    assert second.t[0] == pytest.approx(first.t[-1])
    together = np.r_[contact.force(first), contact.force(second)[1:]]
    np.testing.assert_allclose(together, contact.force(whole), atol=1e-6 * together.max())
    np.testing.assert_allclose(striker.momentum(second)[-1], striker.momentum(whole)[-1], rtol=1e-6)


def test_reading_a_sensor_between_steps_leaves_no_hole(impact):
    mbs, _, _, contact = impact
    plain(mbs, 120)
    force = contact.force(ep.collect(mbs))
    mbs.SetPreStepUserFunction(lambda mbs, t: len(mbs.GetSensorValues(contact["sForce"])) > 0)
    plain(mbs, 120)
    np.testing.assert_array_equal(contact.force(ep.collect(mbs)), force)


def test_other_sensors_are_not_taken_for_those_of_every_step(impact):
    mbs, striker, *_ = impact
    sensor = mbs.AddSensor(
        items.SensorNode(
            nodeNumber=striker["nModal"], outputVariableType=exu.OutputVariableType.Coordinates, storeInternal=True
        )
    )
    mbs.Assemble()
    plain(mbs, 120)
    result = ep.collect(mbs)
    with pytest.raises(InputError, match=r"read sensor \d+ less often .*writePeriod to the step"):
        result.sensor(sensor)
    assert len(mbs.GetSensorStoredData(sensor)) == 2


def test_more_steps_than_memory_are_told(impact, monkeypatch):
    mbs, *_ = impact
    monkeypatch.setattr(run_record, "MOST", 5000)
    plain(mbs, 120)
    with (
        pytest.warns(ModelLimitWarning, match="closed, but in no sample"),
        pytest.warns(ModelLimitWarning, match="more steps than contacts keep .* Set settings.solution.sensors"),
    ):
        result = ep.collect(mbs)
    assert len(result.t) == 2


def test_steps_too_long_for_an_impact_are_told(impact):
    mbs, *_ = impact
    plain(mbs, 30, IMPLICIT, end=30 * 15e-6)
    with (
        pytest.warns(ModelLimitWarning, match="the bodies have gained .* J of energy"),
        pytest.warns(ModelLimitWarning, match="the impact is over within .* steps .* give bodies energy"),
    ):
        ep.collect(mbs)


def test_steps_above_the_stability_limit_are_told(mbs, bodies):
    """Also in free flight, where nothing grows yet."""
    ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, 1.0])
    mbs.Assemble()
    step = 1.5 * ep.stability_limit(mbs)
    plain(mbs, 10, end=10 * step)
    with pytest.warns(ModelLimitWarning, match="above the stability limit"):
        ep.collect(mbs)


def test_turns_and_edges_are_told(mbs, bodies):
    spinning = ep.CreatePartitionBody(mbs, bodies[0], frame="floating", initialAngularVelocity=[0, 0, 1e4], name="top")
    mbs.Assemble()
    plain(mbs, 5, IMPLICIT, end=5 * 2e-4)
    with pytest.warns(ModelLimitWarning, match="body 'top' turns by 2 rad in a step"):
        ep.collect(mbs)
    assert spinning.frame == "floating"


def test_the_edge_of_a_patch_is_told(mbs, ball):
    """A patch that a ball of 3 m/s covers."""
    body = ep.reduce(ball[0], ep.Partition.ball(ball[0], (0, 0, 0), 0.4e-3), f_cut=150e3)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -3.0])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="tip")
    mbs.Assemble()
    plain(mbs, 120)
    with pytest.warns(ContactPatchWarning, match="contact 'tip' reached the edge of its patch"):
        result = ep.collect(mbs)
    assert contact.edge_reached(result) is not None
