"""New Jacobians of implicit steps, and the goal at which Newton's method ends."""

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities as utilities
import numpy as np
from oracles import HINGE, jointed

import exudyn_partition as ep
from exudyn_partition.simulation.renewals import Iterations


def test_a_jacobian_is_new_when_its_age_has_cost_as_much():
    """Each step takes as many iterations as the first after it, plus those of its age; other Jacobians count too."""
    of_run, made, renewed = Iterations(), 0, []
    for step, many in enumerate([3, 2, 3, 4, 4, 2, 2, 2, 2, 7, 2, 2, 2]):
        made += many
        of_run = of_run.after(made, 1 + len(renewed) + (step >= 9))  # Exudyn found one of its own in the step of 7
        if of_run.too_many:
            renewed.append(step)
    assert renewed == [4]  # 1 + 2 + 2 above the fewest
    assert of_run == Iterations(made, 3, 2, 0)


def test_joints_that_turn_get_new_jacobians_before_they_take_many_iterations(arm_body):
    """Without them, most steps take four iterations or five. The motion is that of tight tolerances."""
    mbs, item, _ = jointed(arm_body, "floating", HINGE, initialAngularVelocity=[0, 100, 0], initialVelocity=[3, 0, 0])
    mbs.Assemble()
    settings, runs, steps = exu.SimulationSettings(), [], 100
    settings.solution.file.write, newton = False, settings.timeIntegration.newton
    newton.relativeTolerance, newton.modifiedNewtonJacUpdatePerStep = 1e-12, True
    for given in (settings, None):
        runs.append(ep.solve_dynamic(mbs, end_time=4e-6 * steps, step=4e-6, method="implicit", settings=given))
    assert runs[0].work.jacobians >= steps  # settings of the user are kept
    assert runs[1].work.jacobians < 0.5 * steps
    assert runs[1].work.newton_iterations < 3.5 * steps
    tight, default = (item.coordinates(run) for run in runs)
    np.testing.assert_allclose(default, tight, rtol=0, atol=1e-8 * abs(tight).max())


def test_reactions_do_not_alternate():
    """Two bars in space: with a new Jacobian, one iteration leaves 1e-8 of the first residual, and joints half closed.

    Reactions then alternate with an error that grows to a third of them.
    """
    length, bar = 1.0, utilities.InertiaCuboid(1000, [1.0, 0.1, 0.1])
    reactions = []
    for tight in (True, False):
        mbs, settings = exu.SystemContainer().AddSystem(), None
        axis, below = [0, 0, 1], mbs.CreateGround()
        for place in (0.5 * length, 1.5 * length):
            body = mbs.CreateRigidBody(
                inertia=bar,
                nodeType=exu.NodeType.RotationEulerParameters,
                referencePosition=[place, 0, 0],
                gravity=[0, -9.81, 0],
            )
            joint = mbs.CreateRevoluteJoint(
                itemNumbers=[below, body], position=[place - length / 2, 0, 0], axis=axis, useGlobalFrame=True
            )
            axis, below = [0, 1, 1], body
        force = exu.OutputVariableType.ForceLocal
        sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=force, storeInternal=True))
        mbs.Assemble()
        if tight:
            settings = exu.SimulationSettings()
            settings.solution.file.write, newton = False, settings.timeIntegration.newton
            newton.relativeTolerance, newton.useModifiedNewton = 1e-12, False
        result = ep.solve_dynamic(mbs, end_time=0.1, step=1e-4, method="implicit", settings=settings)
        reactions.append(result.sensor(sensor)[1:])
    assert abs(reactions[1] - reactions[0]).max() < 1e-5 * abs(reactions[0]).max()
